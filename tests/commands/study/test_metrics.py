"""The metric of a study: of the arm's own dimensions, on terminal and page, in JSON, on readable axes."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lab
from lab.core.errors import LabError
from lab.kinematics.serial.serial_arm import SerialArm
from lab.report.views.study_texts import varying
from lab.studies.analysis import groups
from lab.studies.grid import ANY, GridCell, Study
from lab.studies.identified import parameter_errors

GRID = """
name = "own lengths"
robots = 5
draws = 2
fresh = 40
metric = "link_length_rms_mm"

[factors]
criterion = "random"
poses = [12, 20]
"""


def test_errors_of_links_leave_base_and_tool_out() -> None:
    arm = SerialArm(lab.load_robot("irb120").chain)
    off = np.array([[1e-3 if each.is_link else 9e-3 for each in arm.parameters]])
    found = parameter_errors(off, arm.parameters)
    assert found["link_length_rms_mm"][0] == pytest.approx(1.0) and found["link_angle_rms_mrad"][0] == pytest.approx(
        1.0
    )
    assert found["length_rms_mm"][0] > 2


@pytest.mark.thorough
def test_the_metric_of_the_grid_is_in_json(tmp_path: Path) -> None:
    (tmp_path / "grid.toml").write_text(GRID)
    result = lab.study(tmp_path / "grid.toml", out=tmp_path / "out", workers=1)
    found = json.loads(json.dumps(result.to_dict()))
    assert found["metric"] == "link_length_rms_mm"
    mean = {each["cell"]: each for each in found["means"] if each["metric"] == found["metric"]}
    assert mean[0]["lower_95"] < mean[0]["mean"] < mean[0]["upper_95"] and mean[0]["mean"] > mean[1]["mean"]
    (pair,) = (each for each in found["pairs"] if each["metric"] == found["metric"])
    assert pair["factor"] == "poses" and (pair["first"], pair["second"]) == ("12 poses", "20 poses")
    assert pair["second_to_first"] < 1 and pair["used"] == 10
    ranks = [each for each in found["ranks"] if each["metric"] == found["metric"]]
    assert [each["level"] for each in ranks] == ["20 poses", "12 poses"] and sum(ranks[0]["chances"]) == pytest.approx(
        1
    )
    assert {each["metric"] for each in found["pairs"]} == {found["metric"], "fresh_mean_mm", "fresh_worst_mm"}
    (tmp_path / "grid.toml").write_text(GRID.replace("link_length_rms_mm", "steps"))
    again = lab.study(tmp_path / "grid.toml", out=tmp_path / "out", workers=1, resume=True)
    assert again.done.computed == 0 and again.to_dict()["metric"] == "steps"


@pytest.mark.parametrize("metric", ["nees", "lengths"])
def test_a_metric_of_which_less_is_not_better_is_refused(metric: str) -> None:
    with pytest.raises(LabError, match=f"metric '{metric}'"):
        Study(metric=metric)


CELLS = (GridCell("random", ANY, 20), GridCell("O1", ANY, 20), GridCell("lengths", "whitened", 20))


def test_the_scaling_of_one_criterion_is_no_factor_that_varies() -> None:
    assert varying(CELLS) == ("criterion",) and groups(CELLS, ["criterion"])[0].shared == {}
    assert varying((*CELLS, replace(CELLS[2], scaling="raw"))) == ("criterion", "scaling")
