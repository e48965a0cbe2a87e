"""What groups explain, against fits without them."""

import numpy as np
import pytest
from helpers.robots import IRB120, somewhere

from lab.calibration.identification import identify
from lab.calibration.weights import Noise
from lab.core.measurements import Measurements, measured
from lab.kinematics.model import Model
from lab.verdict.remaining_error import ExplainedError, explained_errors

GROUPS = ("harmonics", "gear")
SIZES = {"joint2.sin1": 3e-4, "joint4.cos1": 2e-4, "joint1.gear": 1e-4}
SIGMA = 5e-6


def campaign(groups: tuple[str, ...]) -> tuple[Model, Measurements]:
    """An arm with these groups, and 120 poses of one whose joints run out, and one of whose gears is off."""
    rng, arm = np.random.default_rng(0), IRB120.arm_with(("p1",), GROUPS)
    joints = IRB120.chain.random_joints(120, rng)
    values = arm.nominal(IRB120.tool)
    values[: len(arm.rigid.names)] = somewhere(arm.rigid, rng)
    for name, size in SIZES.items():
        values[arm.names.index(name)] = size
    points = arm.points(joints, values) + SIGMA * rng.standard_normal((120, 1, 3))
    return IRB120.arm_with(("p1",), groups), measured(IRB120.chain.joint_names, joints, ("p1",), points)


def explained(groups: tuple[str, ...]) -> tuple[tuple[ExplainedError, ...], float]:
    """What each group explains, and the sum of the squared residuals."""
    model, data = campaign(groups)
    found = identify(model, data, model.nominal(IRB120.tool), Noise())
    own = {name: [each.name for each in model.parameters if each.group == name] for name in groups}
    return explained_errors(model, data, found.values, found.fit.free, own), float((found.residuals**2).sum())


def test_what_a_group_explains_is_what_a_fit_without_it_leaves() -> None:
    """Least squares: leaving out columns raises the sum of squares by what only they explain."""
    both, squares = explained(GROUPS)
    for each, other in zip(both, GROUPS[::-1], strict=True):
        alone = explained((other,))[1]
        assert 3 * 120 * each.size_m**2 == pytest.approx(alone - squares, rel=0.01)
    nothing, geometry = explained(())
    assert nothing == ()
    assert [each.share for each in both] == pytest.approx(
        [3 * 120 * each.size_m**2 / geometry for each in both], rel=0.01
    )
    assert [each.group for each in both] == list(GROUPS) and all(each.size_m > 3 * SIGMA for each in both)
