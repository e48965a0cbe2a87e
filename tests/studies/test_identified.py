"""Campaigns of a study that are identified one by one, and those that fail."""

from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import lab
from lab.calibration.estimator import EstimationProblem
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.options.option_groups import Effects
from lab.robots.load_robot import load_virtual
from lab.simulation.collisions import random_poses
from lab.studies.campaigns import METRICS, cell_poses, refuse_impossible, run_task
from lab.studies.executors import local_executor
from lab.studies.grid import Study, Task
from lab.studies.identified import RANK_DEFICIENT
from lab.studies.run_study import read_campaigns, run_study

SOFT = {"soft": Effects(stiffness_nm_per_rad=1e5, harmonic_mrad=0.1)}


def study_of(robots: int = 1, draws: int = 2, **factors: tuple[Any, ...]) -> Study:
    chosen = {"criterion": ("random",), "poses": (20,), **factors}
    return Study(robots=robots, draws=draws, fresh=40, factors=chosen, effects=SOFT if "effects" in factors else {})


def rows(study: Study, cell: int = 0) -> dict[str, Array]:
    return run_task(study, Task(cell, 0, study.robots), cell_poses(study, study.cells[cell]))


@pytest.mark.thorough
def test_a_campaign_alone_is_that_of_many_fitted_together() -> None:
    """Without weakly observable directions the automatic prior takes no part, so that both are least squares."""
    study = study_of(effects=("soft",), model=("compliance+harmonics",), prior=("off", "auto"))
    together, alone = (rows(study, cell) for cell in range(2))
    for name in METRICS:
        tolerance = 1e-3 if name == "before_mm" else 1e-5  # one without noise, the other of the noisy campaign
        np.testing.assert_allclose(alone[name], together[name], rtol=tolerance, err_msg=name)
    assert together["fresh_mean_mm"].max() < 0.03 and (together["failure"] == "").all()


@pytest.mark.thorough
def test_a_robust_fit_withstands_outliers() -> None:
    effects = {"bad": Effects(bad_share=0.1)}
    factors = {"criterion": ("random",), "poses": (30,), "effects": ("bad",), "robust": (False, True)}
    study = Study(robots=1, draws=2, fresh=40, factors=factors, effects=effects)
    plain, robust = (rows(study, cell)["fresh_mean_mm"] for cell in range(2))
    assert (robust < 0.05 * plain).all()


@pytest.mark.parametrize(
    ("observe", "device"), [pytest.param("pose", "uniform-8um", marks=pytest.mark.thorough), ("cable", "draw-wire")]
)
def test_what_is_measured_is_a_factor(observe: str, device: str) -> None:
    """Errors of the parameters are those that their covariance predicts: 27 or more, 2 campaigns."""
    found = rows(study_of(observe=(observe,), instrument=(device,), poses=(40,)))
    assert (found["failure"] == "").all() and (found["nees"] > 0.3).all() and (found["nees"] < 3).all()
    assert (found["fresh_mean_mm"] < 0.1 * found["before_mm"]).all()


def test_a_refused_campaign_is_a_row_with_its_reason() -> None:
    found = rows(study_of(poses=(12,), model=("compliance+harmonics",), prior=("auto",)))
    assert not found["converged"].any() and np.isnan(found["fresh_mean_mm"]).all()
    assert set(found["failure"]) == {
        "refused: 12 poses, but the 41 identifiable parameters need at least 14: measure more"
    }


def plan_without_joint_6(folder: Path, still: bool = True) -> str:
    robot = load_virtual("irb120")
    joints = random_poses(robot.model, 30, rng_for(5, "poses"))
    if still:
        joints[:, 5] = 0.3
    names = robot.chain.joint_names
    lines = [",".join(map(repr, np.rad2deg(row).tolist())) for row in joints]
    path = folder / "still.csv"
    path.write_text("\n".join([",".join(f"{name}_deg" for name in names), *lines]) + "\n")
    return str(path)


@pytest.mark.parametrize("prior", ["off", "auto"])
def test_poses_that_do_not_show_a_parameter_are_counted_as_failures(prior: str, tmp_path: Path) -> None:
    """A joint that stands still shows neither its harmonics nor the tool about it: singular, and not by chance."""
    plan = plan_without_joint_6(tmp_path)
    study = study_of(model=("harmonics",), plan=("none", plan), prior=(prior,))
    chosen, still = (rows(study, cell)["failure"] for cell in range(2))
    assert (chosen == "").all()
    assert set(still) == {RANK_DEFICIENT}


def test_a_plan_s_poses_are_measured_as_they_are(tmp_path: Path) -> None:
    study = study_of(plan=(plan_without_joint_6(tmp_path),))
    joints = cell_poses(study, study.cells[0])
    assert joints.shape == (30, 6) and np.allclose(joints[:, 5], 0.3)


@pytest.mark.thorough
def test_a_plan_s_payloads_are_at_its_poses(tmp_path: Path) -> None:
    """An arm that bends under its load is identified with these, and validated without."""
    plan = Path(plan_without_joint_6(tmp_path, still=False))
    lines = plan.read_text().splitlines()
    loaded = [f"{line},{3 * (i % 2)}" for i, line in enumerate(lines[1:])]
    plan.write_text("\n".join([f"{lines[0]},payload_kg", *loaded]) + "\n")
    study = study_of(effects=("soft",), model=("geometric", "compliance"), plan=(str(plan),), draws=1)
    refuse_impossible(study)
    joints = cell_poses(study, study.cells[0])
    assert joints.shape == (30, 7) and joints[:, 6].tolist() == [0.0, 3.0] * 15
    with ThreadPoolExecutor(1) as executor:
        run_study(study, tmp_path / "study", executor)
    blind, seen = (float(rows(study, cell)["fresh_mean_mm"][0]) for cell in range(2))
    assert seen < 0.8 * blind
    assert "payload_kg" in (tmp_path / "study" / "poses" / "cell0000.csv").read_text().splitlines()[0]
    rigid = study_of(plan=(str(plan),))
    with pytest.raises(LabError, match="a rigid arm does not deflect under a load"):
        refuse_impossible(rigid)
    both = study_of(effects=("soft",), plan=(str(plan),), payload_kg=((2.0,),))
    with pytest.raises(LabError, match="has a column payload_kg, and --payload-kg is given too"):
        refuse_impossible(both)


class Halfway(lab.Estimator):
    """Stops before the minimum."""

    name = "halfway"

    def estimate(self, problem: EstimationProblem) -> tuple[Array, Array]:
        residuals, jacobian = problem.linearized(problem.start)
        covariance = np.linalg.inv(jacobian.T @ jacobian)
        return problem.start + 0.5 * covariance @ jacobian.T @ residuals, covariance


def test_an_estimator_of_a_package_is_a_level(monkeypatch: pytest.MonkeyPatch) -> None:
    entry = SimpleNamespace(load=lambda: Halfway, value="somewhere:Halfway")
    monkeypatch.setattr(
        "lab.extension_points._entries", lambda group: {"halfway": entry} if group == "lab.estimators" else {}
    )
    study = study_of(estimator=("least-squares", "halfway"))
    best, half = (rows(study, cell)["fresh_mean_mm"] for cell in range(2))
    assert (half > 20 * best).all()


MIXED = study_of(1, 2, effects=("soft",), model=("geometric", "compliance+harmonics"), prior=("off", "auto"))


def stored(folder: Path, executor: Executor) -> dict[str, bytes]:
    with executor:
        run_study(MIXED, folder, executor)
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.thorough
def test_campaigns_together_and_alone_have_the_same_bytes_on_any_executor(tmp_path: Path) -> None:
    first = stored(tmp_path / "one", ThreadPoolExecutor(1))
    assert stored(tmp_path / "processes", local_executor(2)) == first
    assert set(read_campaigns(tmp_path / "one")["failure"].to_pylist()) == {""}
