"""Mistakes in pictures are named by how far the nominal arm misses them; sound pictures are not doubted."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers.campaigns import session

from lab.core.measurements import Measurements
from lab.diagnosis.hypothesis import Diagnosable, Hypothesis
from lab.extensions.cameras.pixels import PixelSensor
from lab.extensions.cameras.rig import Rig, usual_rig
from lab.kinematics.model import RigidArm

POSES = 25
IN_HAND = usual_rig()


@cache
def pictures(robot: str, poses: int = POSES) -> tuple[RigidArm, Measurements]:
    simulated = session(robot, observe="pixels", poses=poses, seed=3)
    return simulated.robot.arm(PixelSensor().targets(simulated.measurements)), simulated.measurements


def cost(misses: np.ndarray) -> float:
    """Capped squares (mm²): a picture that is far off counts as 50 mm."""
    known = misses[~np.isnan(misses)]
    return float((np.minimum(1e3 * known, 50.0) ** 2).mean())


def best(sensor: PixelSensor, arm: RigidArm, data: Measurements) -> tuple[Hypothesis, float, float]:
    """The hypothesis that brings the pictures nearest to the arm, and their costs with it and without any."""
    assert isinstance(sensor, Diagnosable)
    nominal = arm.nominal()
    tried = []
    for each in sensor.mistakes(arm, data):
        assert each.corrected is not None
        tried.append((cost((each.sensor or sensor).misses(arm, each.corrected(data), nominal)), each))
    least, named = min(tried, key=lambda pair: pair[0])
    return named, least, cost(sensor.misses(arm, data, nominal))


def taken_in(data: Measurements, order: Callable[[np.ndarray], np.ndarray]) -> Measurements:
    """The pictures with the joint positions of other poses."""
    pose = PixelSensor().pictures(data).pose_of_row
    first = np.array([int(np.argmax(pose == i)) for i in range(pose.max() + 1)])
    return replace(data, joints=data.joints[first[order(np.arange(len(first)))[pose]]])


def turned(data: Measurements, poses: list[int], corners: int = 54) -> Measurements:
    pose = PixelSensor().pictures(data).pose_of_row
    numbers = [str(corners - 1 - int(c)) if p in poses else c for c, p in zip(data.other["corner"], pose, strict=True)]
    return replace(data, other={**data.other, "corner": tuple(numbers)})


def exchanged(order: np.ndarray) -> np.ndarray:
    order = order.copy()
    order[[4, 17]] = 17, 4
    return order


@pytest.mark.parametrize("robot", ["irb120", "ur5e", "panda"])
def test_sound_pictures_are_near_the_nominal_arm_however_they_are_read(robot: str) -> None:
    arm, data = pictures(robot)
    _, least, as_read = best(PixelSensor(), arm, data)
    assert as_read < 5.0**2 and least > 0.6 * as_read


@pytest.mark.parametrize("robot", ["irb120", "ur5e", "panda"])
@pytest.mark.parametrize(
    ("name", "of", "wrong"),
    [
        ("board_turned", 6, lambda data: turned(data, [1, 3, 8, 11, 17, 19])),
        ("board_turned", 1, lambda data: turned(data, [7])),
        ("pictures_exchanged", 2, lambda data: taken_in(data, exchanged)),
        ("pictures_shifted", 1, lambda data: taken_in(data, lambda i: np.minimum(i + 1, i[-1]))),
        ("pictures_shifted", 1, lambda data: taken_in(data, lambda i: np.maximum(i - 2, 0))),
        ("pictures_shifted", 2, lambda data: taken_in(data, lambda i: np.where(i > 14, np.minimum(i + 1, i[-1]), i))),
    ],
)
def test_a_mistake_in_some_pictures_is_named_and_undone(
    robot: str, name: str, of: int, wrong: Callable[[Measurements], Measurements]
) -> None:
    arm, data = pictures(robot)
    named, least, as_read = best(PixelSensor(), arm, wrong(data))
    clean = cost(PixelSensor().misses(arm, data, arm.nominal()))
    assert named.name == name and len(named.of) == of
    ends = 2 if name == "pictures_shifted" else 0  # pictures that have no pose of their own
    assert least < 1.3 * clean + ends * 50.0**2 / POSES
    assert least < as_read / 1.5


@pytest.mark.parametrize("robot", ["irb120", "ur5e", "panda"])
@pytest.mark.parametrize(
    ("name", "rig", "ratio"),
    [
        ("camera_mount", usual_rig(in_hand=False), None),
        ("focal_length", replace(IN_HAND, cameras=(replace(IN_HAND.cameras[0], focal_px=(1320.0, 1320.0)),)), 1 / 1.1),
        ("square_size", replace(IN_HAND, boards=(replace(IN_HAND.boards[0], square_mm=21.0),)), 1 / 1.05),
    ],
)
def test_a_mistake_in_cameras_and_boards_is_named_with_its_size(
    robot: str, name: str, rig: Rig, ratio: float | None
) -> None:
    arm, data = pictures(robot)
    named, least, as_read = best(PixelSensor(rig), arm, data)
    assert named.name == name and least < as_read / 2
    if ratio is not None:  # as well as a nominal arm, a few mm off, shows it
        assert dict(named.data)["ratio"] == pytest.approx(ratio, abs=0.025)


def test_a_miss_is_of_a_picture_and_joint_positions_do_not_change_which() -> None:
    arm, data = pictures("ur5e")
    misses = PixelSensor().misses(arm, data, arm.nominal())
    assert POSES - 2 <= int(np.isfinite(misses).sum()) <= POSES
    moved = PixelSensor().misses(arm, replace(data, joints=np.roll(data.joints, 1, axis=0)), arm.nominal())
    np.testing.assert_allclose(moved, misses)
