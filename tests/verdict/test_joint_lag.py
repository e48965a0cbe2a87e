"""Joints that lag: an effect that the model lacks is not taken for a lag, and a lag is found beside it."""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np
import pytest
from helpers.robots import IRB120, perturbed, somewhere

from lab.calibration.fit_options import PLAIN
from lab.calibration.observation import observation_of
from lab.calibration.statistics.candidate_models import SelectionTask
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.calibration.weights import Noise, weigh
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.core.se3 import Array
from lab.kinematics.effects.effect_registry import CANDIDATES
from lab.kinematics.model import Model
from lab.verdict.joint_lag import JointLag, lagging, moves_before

SIGMA, SPRING = 5e-6, 1 / 15_000
TARGETS = ("p1", "p2", "p3")


def campaign(
    seed: int, poses: int, lag: Sequence[float], spring: float, targets: Sequence[str] = TARGETS, repeats: int = 1
) -> Measurements:
    """An arm whose joints 2 and 3 give way, and that lacks a share of each joint's last move."""
    rng = np.random.default_rng(seed)
    rigid, arm = IRB120.arm(targets), IRB120.arm_with(targets, ["compliance"])
    values = np.append(perturbed(rigid, somewhere(rigid, rng), rng, 0.5e-3, 1.5e-3), [spring, spring])
    joints = np.repeat(IRB120.chain.random_joints(poses, rng), repeats, axis=0)
    behind = joints - np.array(lag) * np.diff(joints, axis=0, prepend=joints[:1])
    points = arm.points(np.column_stack([behind, np.zeros(len(joints))]), values)
    points = points + SIGMA * rng.standard_normal(points.shape)
    return measured(IRB120.chain.joint_names, joints, targets, points)


def found_in(data: Measurements, rivals: bool = True) -> tuple[JointLag, ...]:
    """Lags of a model of geometry alone, beside the groups that it lacks or without these."""

    def nominal(model: Model) -> Array:
        return model.nominal(IRB120.tool)

    task = SelectionTask(lambda groups: IRB120.arm_with(data.targets, groups), nominal, data, Noise(), PLAIN)
    found = task.identified(())
    observed, _ = weigh(observation_of(found.model), data, task.noise)

    def omitted() -> list[Array]:
        made = []
        for name in CANDIDATES if rivals else ():
            with suppress(LabError):
                made.append(task.derivatives(name, found))
        return made

    slopes = by_joint_positions(found.model, observed.inputs, found.values, 6)
    moves = moves_before(data, data.ids)
    return lagging(found.model, observed, found.fit, moves, slopes, data.sessions, omitted)


@pytest.mark.thorough
def test_springs_that_a_model_lacks_are_no_lag() -> None:
    """Residuals of half a millimetre, which the three targets of a pose share: F of all rows takes some for a lag."""
    for seed in range(4):
        assert found_in(campaign(seed, 25, [0] * 6, SPRING)) == ()
        assert found_in(campaign(seed, 25, [0] * 6, SPRING, ("p1",), repeats=3)) == ()


@pytest.mark.parametrize(("poses", "targets"), [(60, ("p1",)), (25, TARGETS)], ids=["one target", "three targets"])
def test_a_lag_is_found_beside_the_groups_that_an_arm_could_have(poses: int, targets: tuple[str, ...]) -> None:
    """Joints 2 and 5 short by 1e-3 and 2e-3 of the last move."""
    (lag,) = found_in(campaign(1, poses, [0, 1e-3, 0, 0, 2e-3, 0], 0.0, targets))
    assert lag.is_claimed and lag.significant[[1, 4]].all()
    np.testing.assert_allclose(lag.fractions, [0, -1e-3, 0, 0, -2e-3, 0], atol=1e-4)


def test_an_omitted_group_is_fitted_beside_a_lag() -> None:
    """Without the springs the shares are off by a third."""
    data, truly = campaign(1, 60, [0, 1e-3, 0, 0, 2e-3, 0], SPRING), [0, -1e-3, 0, 0, -2e-3, 0]
    (beside,) = found_in(data)
    np.testing.assert_allclose(beside.fractions, truly, atol=2e-5)
    alone = found_in(data, rivals=False)
    assert alone == () or np.abs(alone[0].fractions - truly).max() > 2e-4
