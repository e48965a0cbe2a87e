"""The page of a verification."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from helpers.html_page import Page

from lab.cli import main
from lab.formats.measurement_csv import write_measurements
from lab.render.format import short


def test_a_verification_says_good_or_what_has_moved(seven_run: Path, tmp_path: Path, seven) -> None:
    points = seven.measurements.points
    for name, shift, count in (("good", 0.0, 8), ("one", 0.0, 1), ("moved", 2e-4, 8)):
        data = replace(seven.measurements, points=points + np.array([shift, 0, 0])).take(range(count))
        write_measurements(tmp_path / f"{name}.csv", data, seven.robot.chain.prismatic)
        out = tmp_path / name
        code = main(["verify", str(seven_run), str(tmp_path / f"{name}.csv"), "--out", str(out), "--json"])
        seen, result = Page(out / "report.html"), json.loads((out / "result.json").read_text())
        assert code == (0 if result["good"] else 1) and result["good"] is (name != "moved")
        assert seen.headings[0] == f"irb120: {'within' if result['good'] else 'beyond'} the predicted error"
        assert set(seen.figures) == {"errors-figure"} and short(result["promised_mm"]) in seen.text
        assert result["words"][1:] in seen.text
        if name == "moved":
            found = seen.table("what may have changed, the best first")
            assert found[0][0] == result["hypotheses"][0]["words"] and found[0][-1] == "yes"
