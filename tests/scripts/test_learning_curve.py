"""Learning curves: on a rigid arm more poses are better, and the same poses judge all of them."""

import numpy as np
import pytest
from helpers.robots import IRB120
from learning_curve import errors_by_poses

from lab.core.errors import LabError
from lab.core.measurements import measured


@pytest.mark.thorough
def test_more_poses_are_better_and_none_are_invented() -> None:
    rng = np.random.default_rng(1)
    joints, arm = IRB120.chain.random_joints(120, rng), IRB120.arm(("p1",))
    points = arm.points(joints, arm.nominal(IRB120.tool)) + 5e-5 * rng.standard_normal((120, 1, 3))
    data = measured(IRB120.chain.joint_names, joints, ("p1",), points)
    found = errors_by_poses(IRB120, data, ("geometric",), (14, 80), 0.3, 0)["geometric"]
    assert list(found) == ["14", "80"] and found["14"] > 1.3 * found["80"]
    assert found["80"] == pytest.approx(5e-2 * np.sqrt(8 / np.pi), rel=0.35)  # the noise of what judges, mm
    with pytest.raises(LabError, match="are not held out"):
        errors_by_poses(IRB120, data, ("geometric",), (14, 100), 0.3, 0)
