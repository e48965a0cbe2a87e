"""The metric of a study: of the arm's own dimensions, on terminal and page, in JSON, on readable axes."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lab
from lab.commands.study.document import _next_step, varying
from lab.core.errors import LabError
from lab.kinematics.serial.arm import SerialArm
from lab.studies.analysis import analysed, groups
from lab.studies.grid import ANY, Cell, Study
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


def test_the_metric_of_the_grid_is_shown_and_in_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "grid.toml").write_text(GRID)
    result = lab.study(tmp_path / "grid.toml", out=tmp_path / "out", workers=1)
    assert "RMS error of the arm's own lengths" in result.summary()
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
    assert again.done.computed == 0 and "Gauss-Newton steps" in again.summary()


@pytest.mark.parametrize("metric", ["nees", "lengths"])
def test_a_metric_of_which_less_is_not_better_is_refused(metric: str) -> None:
    with pytest.raises(LabError, match=f"metric '{metric}' is none of which less is better: give one of fresh_mean_mm"):
        Study(metric=metric)


CELLS = (Cell("random", ANY, 20), Cell("O1", ANY, 20), Cell("lengths", "whitened", 20))


def test_the_scaling_of_one_criterion_is_no_factor_that_varies() -> None:
    assert varying(CELLS) == ("criterion",) and groups(CELLS, ["criterion"])[0].shared == {}
    assert varying((*CELLS, replace(CELLS[2], scaling="raw"))) == ("criterion", "scaling")


def test_levels_without_a_price_are_not_called_cheap() -> None:
    values = np.repeat([3.0, 2.0, 1.0], 12) * np.tile(np.linspace(1, 1.01, 12), 3)
    columns = {
        "cell": np.repeat([0, 1, 2], 12), "robot": np.tile(np.arange(12), 3), "draw": np.zeros(36, dtype=int),
        "converged": np.ones(36, dtype=bool), "fresh_mean_mm": values,
    }  # fmt: skip
    found = analysed(columns, CELLS, metrics=("fresh_mean_mm",))
    assert "cheaper" not in _next_step(found, "fresh_mean_mm", 12, "lengths")
    priced = analysed(columns, tuple(Cell(poses=poses) for poses in (12, 20, 40)), metrics=("fresh_mean_mm",))
    assert "a cheaper level is" in _next_step(priced, "fresh_mean_mm", 12, "40 poses")


@pytest.mark.thorough
@pytest.mark.figures
@pytest.mark.parametrize("low", [0.0088, 0.011, 3.3])
def test_an_axis_of_less_than_a_decade_has_ticks(low: float) -> None:
    Figure = pytest.importorskip("matplotlib.figure").Figure
    from lab.commands.study.figures import _logarithmic

    axes = Figure().subplots()
    axes.plot([0, 1], [low, 1.2 * low])
    _logarithmic(axes, "y")
    bottom, top = axes.get_ylim()
    shown = [tick for tick in axes.get_yticks() if bottom <= tick <= top]
    assert len(shown) >= 3 and all(label.get_text() for label in axes.get_yticklabels())
