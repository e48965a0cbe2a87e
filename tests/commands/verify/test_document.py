"""The page of a verification."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.html_page import Page

import lab
from lab.cli.main import main
from lab.core.errors import LabError
from lab.core.number_text import short
from lab.formats.measurement_csv import write_measurements


@pytest.mark.pages
def test_a_verification_says_good_or_what_has_moved(seven_run: Path, tmp_path: Path, seven) -> None:
    points = seven.measurements.points
    for name, shift, count in (("good", 0.0, 8), ("one", 0.0, 1), ("moved", 2e-4, 8)):
        moved = points + np.array([shift + 1e-9, 0, 0])  # not the rows that were fitted, to the last digit
        data = replace(seven.measurements, points=moved)[:count]
        write_measurements(tmp_path / f"{name}.csv", data, seven.robot.chain.prismatic)
        out = tmp_path / name
        code = main(["verify", str(seven_run), str(tmp_path / f"{name}.csv"), "--out", str(out), "--json"])
        seen, result = Page(out / "report.html"), json.loads((out / "result.json").read_text())
        assert code == (0 if result["good"] else 1) and result["good"] is (name != "moved")
        expected = {"arm-scene", "errors-figure", *(["causes-figure"] if result["hypotheses"] else [])}
        assert set(seen.figures) == expected and short(result["promised_mm"]) in seen.text
        if name == "moved":
            found = seen.table("possible change, likeliest first")
            assert found[0][0] == result["hypotheses"][0]["words"] and found[0][-1] == "yes"


def test_rows_that_the_run_was_identified_from_verify_nothing(seven_run: Path, tmp_path: Path) -> None:
    lines = (seven_run / "measurements.csv").read_text().splitlines(keepends=True)
    (tmp_path / "some.csv").write_text("".join(lines[:9]))
    for file, count in ((seven_run / "measurements.csv", f"{len(lines) - 1} of"), (tmp_path / "some.csv", "8 of 8")):
        with pytest.raises(LabError, match=f"{count} .*rows"):
            lab.verify(seven_run, file)
        assert any("verify nothing new" in each for each in lab.verify(seven_run, file, force=True).warnings)
