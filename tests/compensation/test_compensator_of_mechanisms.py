"""Targets of a robot with loops are corrected as an arm's are: by the identified mechanism, within its reach."""

import numpy as np
import pytest
from closed_loop import compensator_of

from lab.compensation.compensator import Compensator
from lab.core.errors import LabError
from lab.kinematics.inverse.branches import NominalInverse
from lab.kinematics.inverse.newton_inverse import PoseTarget
from lab.library.calibrate import calibrate
from lab.options.virtual_campaign import VirtualCampaign
from lab.robots.load_robot import load_robot
from lab.simulation.collisions import random_poses

EXACT = VirtualCampaign(robot="delta/small", seed=3, poses=20, instrument="exact")


@pytest.mark.thorough
def test_a_delta_goes_where_it_is_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its errors of a millimetre are gone, at targets that were never measured; MuJoCo says where it is."""
    monkeypatch.setattr("lab.library.virtual_arm.FRESH_POSES", 20)
    outcome = calibrate(EXACT)
    assert outcome.truth.robot is not None
    compensator = compensator_of(outcome)
    joints = random_poses(outcome.robot.model, 6, np.random.default_rng(8))
    places = compensator.nominal.tool(joints)[0][:, :3, 3]
    anywhere, nothing = np.full((6, 3), np.nan), np.empty((6, 0))
    wanted = PoseTarget(places, np.full((6, 3, 3), np.nan))
    found = compensator(wanted, nothing, anywhere)
    assert found.converged.mean() > 0.9 and all("joint limit" in why for why in found.reasons if why)
    there, before = (outcome.truth.robot.points(q[found.converged], ("p1",))[:, 0] for q in (found.joints, joints))
    np.testing.assert_allclose(there, places[found.converged], rtol=0, atol=1e-9)
    assert np.linalg.norm(before - places[found.converged], axis=1).mean() > 3e-4
    up = compensator.nominal.arm.T_tracker_frame0(compensator.nominal.values)[:3, 2]
    below = compensator(PoseTarget(places[:1] - up, wanted.rotations[:1]), nothing[:1], anywhere[:1])
    assert all("out of reach" in why for why in below.reasons)  # a metre lower


def test_what_moves_in_a_plane_with_three_joints_is_refused() -> None:
    robot = load_robot("rpr3")
    arm = robot.arm(tuple(robot.tool) or ("p1",))
    values = arm.nominal(robot.tool)
    with pytest.raises(LabError, match="in 2 of three directions"):
        Compensator(NominalInverse(arm, values), arm, values)


def test_the_way_to_a_singularity_is_the_readings_own() -> None:
    """Far down all three arms come in line with their rods at once, where cos θ = (r - R) / (L + l).

    Each leg's factor of det J falls in proportion to its angle from there: the gradient of their product leads there
    by an angle over √3.
    """
    robot = load_robot("delta/small")
    arm = robot.arm(("p1",))
    straight = np.arccos((0.052 - 0.200) / (0.3545 + 0.800))
    angles = np.array([0.02, 0.01, 0.005])
    distance, _ = arm.singular_distance(straight - angles[:, None] * np.ones(3), arm.nominal(robot.tool))
    np.testing.assert_allclose(distance, angles / np.sqrt(3), rtol=0.05)
