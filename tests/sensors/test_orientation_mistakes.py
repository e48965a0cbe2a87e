"""Orientations in another convention than the positions are named; sound ones are near the arm that positions place."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from helpers.campaigns import session

from lab.core import se3
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.diagnosis.hypothesis import Hypothesis, MeasuresOrientations
from lab.diagnosis.placement import placed
from lab.formats.orientations import orientation_texts, read_orientations
from lab.kinematics.model import RigidArm
from lab.sensors.full_pose import PoseSensor

ROBOTS = ("irb120", "ur5e", "panda")
FRAME = se3.exp(np.array([0.3, -0.2, 1.0]))
MIRROR = np.diag([1.0, -1.0, 1.0])


def poses(robot: str) -> tuple[RigidArm, Measurements]:
    simulated = session(robot, observe="pose", poses=30, seed=2)
    return simulated.robot.arm(simulated.measurements.targets), simulated.measurements


def rotations(data: Measurements) -> Array:
    return se3.rotation_from_quaternion(read_orientations(data, data.targets[0]))


def rewritten(data: Measurements, turned: Array, meaning: str | None = None) -> Measurements:
    seen = np.ones(len(data), dtype=np.bool_)
    kept = {name: cells for name, cells in data.other.items() if not name.startswith(f"{data.targets[0]}_q")}
    return replace(data, other={**kept, **orientation_texts(data.targets[0], turned, seen, meaning)})


def inverted(data: Measurements) -> Measurements:
    R = rotations(data)
    points = -(np.swapaxes(R, 1, 2) @ data.points[:, 0, :, None])[..., 0]
    return replace(rewritten(data, np.swapaxes(R, 1, 2)), points=points[:, None])


def rolled(data: Measurements) -> Measurements:
    names = [f"{data.targets[0]}_q{part}" for part in "wxyz"]
    return replace(data, other={**data.other, **{names[i]: data.other[names[(i + 1) % 4]] for i in range(4)}})


def cost(sensor: PoseSensor, arm: RigidArm, data: Measurements) -> float:
    """Mean of misses (mm), of which each counts as 100 mm at most."""
    at = placed(arm, data.joints, data.points, arm.nominal(), rng_for(0, "null"))
    misses = np.hypot(at.misses, sensor.turned_misses(arm, data, at.values))
    return float(np.minimum(1e3 * misses, 100.0).mean())


def best(sensor: PoseSensor, arm: RigidArm, data: Measurements) -> tuple[float, Hypothesis]:
    assert isinstance(sensor, MeasuresOrientations)
    tried = []
    for each in sensor.mistakes(arm, data):
        assert each.corrected is not None
        tried.append((cost(each.sensor or sensor, arm, each.corrected(data)), each))
    return min(tried, key=lambda pair: pair[0])


@pytest.mark.parametrize("robot", ROBOTS)
def test_sound_orientations_are_near_and_nearest_as_they_are(robot: str) -> None:
    arm, data = poses(robot)
    as_read = cost(PoseSensor(), arm, data)
    least, _ = best(PoseSensor(), arm, data)
    assert as_read < 5.0 and least > 0.8 * as_read


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize(
    ("of", "wrong"),
    [
        ("inverse", lambda data: rewritten(data, np.swapaxes(rotations(data), 1, 2))),
        ("another frame", lambda data: rewritten(data, FRAME @ rotations(data))),
        ("another frame", lambda data: rewritten(data, MIRROR @ rotations(data) @ MIRROR)),
        ("columns as qz, qw, qx, qy", rolled),
        ("inverse pose", inverted),
    ],
)
def test_another_convention_is_named_and_undone(
    robot: str, of: str, wrong: Callable[[Measurements], Measurements]
) -> None:
    arm, data = poses(robot)
    spoilt = wrong(data)
    least, named = best(PoseSensor(), arm, spoilt)
    assert (named.name, named.of) == ("orientation_convention", (of,))
    assert cost(PoseSensor(), arm, spoilt) > 50.0
    assert least == pytest.approx(cost(PoseSensor(), arm, data), rel=0.1)


@pytest.mark.parametrize(("given", "true"), [("fixed-xyz", "intrinsic-xyz"), ("rotation-vector", "fixed-xyz")])
def test_another_meaning_of_three_angles_is_named(given: str, true: str) -> None:
    arm, data = poses("ur5e")
    angles = rewritten(data, rotations(data), true)
    _, named = best(PoseSensor(orientation=given), arm, angles)
    assert named.of == (true,) and named.sensor.orientation == true


def test_a_few_wrong_orientations_do_not_hide_the_rest() -> None:
    arm, data = poses("ur5e")
    R = rotations(data)
    R[::5] = R[::5] @ FRAME
    spoilt = rewritten(data, R)
    at = placed(arm, spoilt.joints, spoilt.points, arm.nominal(), rng_for(0, "null"))
    misses = PoseSensor().turned_misses(arm, spoilt, at.values)
    assert (misses[::5] > 0.1).all() and (np.delete(misses, np.s_[::5]) < 5e-3).all()
