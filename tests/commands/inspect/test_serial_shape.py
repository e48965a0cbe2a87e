"""What `lab inspect` says of a shape: reach, ways to a pose, the determinant, examples of singularities."""

import json

import numpy as np
import pytest

from lab.cli.main import main
from lab.kinematics.serial.serial_arm import SerialArm
from lab.library.inspected_model import shape_of
from lab.robots.load_robot import load_robot

# facts-robots, section 1: the flange's reach (mm), the ways to a pose, the determinant
ARMS = {
    "irb120": (652.006, 8, "-0.27 (0.302 cos q3 + 0.07 sin q3) sin q5 "),
    "irb140": (875.0, 8, "-0.36 * 0.38 cos q3 sin q5 (0.07 + 0.36 sin q2 + 0.38 cos(q2+q3))"),
    "irb2400": (1634.958, 8, "-0.705 (0.755 cos q3 + 0.135 sin q3) sin q5 (0.1 + 0.705 sin q2 + 0.135 sin(q2+q3) + "),
    "rx130": (1360.0, 8, "-0.625 * 0.625 sin q3 sin q5 (0.625 sin q2 + 0.625 sin(q2+q3))"),
    "tx40": (516.36, 8, "-0.225 * 0.225 sin q3 sin q5 (0.225 sin q2 + 0.225 sin(q2+q3))"),
    "versatran": (1200.0, 4, "-q3 sin q5"),
    "scemi": (1100.0, 8, "0.5 * 0.5 cos q3 sin q5 (0.5 cos q2 - 0.5 sin(q2+q3))"),
    "scara": (650.0, 2, "0.4 * 0.25 sin q2"),
    "scorbot": (601.125, 4, "-0.22 * 0.22 sin q3 (0.016 + 0.22 cos q2 + 0.22 cos(q2+q3))"),
    "planar3r": (850.0, 2, "0.4 * 0.3 sin q2"),
    "course2r": (1000.0, None, ""),
}
BEYOND_LIMITS = {"versatran": "q3", "irb2400": "0.755 cos q3 + 0.135 sin q3"}  # factors that limits keep from zero


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ARMS)
def test_reach_ways_and_determinant(name: str) -> None:
    reach_mm, ways, determinant = ARMS[name]
    shape = shape_of(load_robot(name).chain)
    assert 1e3 * shape.reach_m == pytest.approx(reach_mm, abs=0.01)
    assert shape.branches == ways and shape.determinant.startswith(determinant)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", [name for name in ARMS if ARMS[name][1] and name != "scorbot"])
def test_at_each_example_a_combination_of_joints_moves_nothing(name: str) -> None:
    chain = load_robot(name).chain
    arm = SerialArm(chain)
    for each in shape_of(chain).singularities:
        if each.joints is None:
            assert each.factor.text == BEYOND_LIMITS[name]
            continue
        assert not chain.beyond_limits(each.joints, 0.0).any() and len(each.free)
        jacobian = arm.tool(each.joints[None], arm.nominal())[1][0]
        np.testing.assert_allclose(jacobian @ each.free.T, 0.0, atol=1e-9)
        if each.factor.name == "wrist":
            np.testing.assert_allclose(np.abs(each.free), [[0, 0, 0, 1, 0, 1]], atol=1e-9)


def test_above_axis_1_five_axes_lose_a_motion_and_gain_none() -> None:
    """The hand still turns about the upright axis, so that no combination of joints moves nothing."""
    elbow, shoulder = shape_of(load_robot("scorbot").chain).singularities
    assert (elbow.factor.name, shoulder.factor.name) == ("elbow", "shoulder")
    assert len(elbow.free) == 1 and shoulder.joints is not None and not len(shoulder.free)


def test_inspect_gives_it_as_json(capsys) -> None:
    assert main(["inspect", "course2r", "--json"]) == 0
    seen = json.loads(capsys.readouterr().out)
    assert seen["freedoms"] | {"free": []} == seen["freedoms"] and seen["freedoms"]["degrees_of_freedom"] == 2
    assert seen["determinant"] is None and seen["ways"] is None and seen["singularities"] == []
