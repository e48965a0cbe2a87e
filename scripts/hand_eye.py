"""Hand-eye calibration of a known arm: the fit of all corners, beside the five methods of OpenCV on the same pictures.

A camera in the hand looks at a board on a table. The arm has its nominal dimensions, so that the pose of the camera in
the hand and that of the board are unknown to all alike. OpenCV places the board in each picture (``solvePnP``) and
relates the poses (``calibrateHandEye``); the lab starts in closed form and fits all corners at once. Without OpenCV 4
(extra ``camera``) the lab's own closed forms are compared alone.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np
from shared import Answer, Document, Flag, Section, Table, run_script, short

from lab.calibration.gauss_newton import Observations
from lab.calibration.identify import fit_base_and_tool
from lab.campaign.robot import load_robot
from lab.core import se3
from lab.core.measurements import FIXTURE, measured
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.serial.arm import SerialArm
from lab.sensors.cameras.closed_forms import board_poses, hand_eye, robot_world
from lab.sensors.cameras.geometry import projected, sight_lines
from lab.sensors.cameras.observation import Pixels
from lab.sensors.cameras.rig import PX, Rig, usual_rig

_METHODS = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")
_NEAREST_M, _FARTHEST_M, _AROUND = 0.3, 0.6, 0.6


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    sets: int = 1000
    """Sets of pictures, each with a camera, a board and poses of its own."""
    poses: int = 12
    """Pictures of a set."""
    noise_px: float = 0.2
    """Noise of a corner (1 sigma)."""
    robot: str = "irb120"
    """Which arm."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class _Set:
    """Pictures of a board by a camera in the hand.

    Attributes:
        Ts_base_hand, places: of each picture: the hand, and the corners ``(v, c, 2)`` in thousands of pixels.
        T_hand_camera: the truth.
    """

    joints: Array
    Ts_base_hand: Array
    places: Array
    T_hand_camera: Array


def _pictures(arm: SerialArm, values: Array, rig: Rig, options: Options, rng: np.random.Generator) -> _Set:
    """Draw a camera, a board before it, and poses of the arm around that see most of the board."""
    camera, corners = rig.cameras[0], rig.boards[0].corners
    T_hand_camera = se3.pose(se3.exp(0.3 * rng.standard_normal(3)), 0.05 * rng.standard_normal(3))
    middle = arm.chain.lower + (0.3 + 0.4 * rng.random(arm.chain.size)) * (arm.chain.upper - arm.chain.lower)
    ahead = se3.pose(se3.exp(0.2 * rng.standard_normal(3)), np.array([0, 0, rng.uniform(_NEAREST_M, _FARTHEST_M)]))
    T_base_board = arm.flange(middle[None], values)[0] @ T_hand_camera @ ahead
    T_base_board[:3, 3] -= T_base_board[:3, :3] @ corners.mean(axis=0)
    found = list[Array]()
    while len(found) < options.poses:
        joints = middle + _AROUND * rng.standard_normal((500, arm.chain.size))
        places, depth = _seen(arm, values, joints, T_hand_camera, T_base_board, rig)
        inside = camera.sees(places.reshape(-1, 2)).reshape(depth.shape) & (depth > 0.1)
        found += list(joints[inside.all(axis=1)])
    joints = np.array(found[: options.poses])
    places, _ = _seen(arm, values, joints, T_hand_camera, T_base_board, rig)
    noisy = places + PX.to_si(options.noise_px) * rng.standard_normal(places.shape)
    return _Set(joints, arm.flange(joints, values), noisy, T_hand_camera)


def _seen(
    arm: SerialArm, values: Array, joints: Array, T_hand_camera: Array, T_base_board: Array, rig: Rig
) -> tuple[Array, Array]:
    """Return places ``(n, c, 2)`` and depths ``(n, c)`` of all corners."""
    Ts = se3.inverse(arm.flange(joints, values) @ T_hand_camera) @ T_base_board
    points = rig.boards[0].corners @ np.swapaxes(Ts[:, :3, :3], 1, 2) + Ts[:, None, :3, 3]
    places = projected(points.reshape(-1, 3), rig.cameras[0].intrinsic_values)[0]
    return places.reshape(*points.shape[:2], 2), points[..., 2]


def _fitted(arm: SerialArm, values: Array, rig: Rig, one: _Set) -> Array:
    """Return the camera in the hand by the fit of all corners."""
    count = one.places.shape[1]
    rows = np.repeat(np.arange(len(one.joints)), count)
    number = np.tile(np.arange(count, dtype=np.float64), len(one.joints))
    data = measured(arm.chain.joint_names, one.joints[rows], ("corner",), one.places.reshape(-1, 1, 2))
    inputs = np.column_stack([data.joints, number])
    model = Pixels(arm, rig, ((0,), (0,)), inputs)
    assert model.conditions == (FIXTURE,)
    observed = Observations(inputs, data.points, np.ones((len(rows), 1)))
    found = fit_base_and_tool(model, observed, model.nominal(values))[model.cameras[0].pose]
    return se3.pose(se3.exp(found[3:]), found[:3])


def _by_opencv(rig: Rig, cv2: Any) -> Mapping[str, Callable[[_Set], Array]]:
    camera, corners = rig.cameras[0], rig.boards[0].corners
    matrix = np.array(
        [[camera.focal_px[0], 0, camera.centre_px[0]], [0, camera.focal_px[1], camera.centre_px[1]], [0, 0, 1]]
    )

    def by(method: int, one: _Set) -> Array:
        turns, places = [], []
        for seen in one.places:
            _, turn, place = cv2.solvePnP(corners, PX.of(seen), matrix, np.array(camera.distortion))
            turns.append(cv2.Rodrigues(turn)[0])
            places.append(place)
        hand = one.Ts_base_hand
        rotation, place = cv2.calibrateHandEye(
            list(hand[:, :3, :3]), list(hand[:, :3, 3]), turns, places, method=method
        )
        return se3.pose(rotation, place.ravel())

    return {f"OpenCV {name.title()}": partial(by, getattr(cv2, f"CALIB_HAND_EYE_{name}")) for name in _METHODS}


def _closed(rig: Rig) -> Mapping[str, Callable[[_Set], Array]]:
    camera, corners = rig.cameras[0], rig.boards[0].corners

    def boards(one: _Set) -> Array:
        flat = sight_lines(one.places.reshape(-1, 2), camera.intrinsic_values).reshape(one.places.shape)
        return np.asarray(se3.inverse(board_poses(corners, flat)[0]))

    return {
        "closed form AX = XB": lambda one: hand_eye(one.Ts_base_hand, boards(one)),
        "closed form AX = ZB": lambda one: robot_world(one.Ts_base_hand, boards(one))[0],
    }


def answer(options: Options) -> Answer:
    """Compare all methods on the same sets."""
    robot, rig = load_robot(options.robot), usual_rig()
    arm = SerialArm(robot.serial_model.chain, ("p1",))
    values = arm.nominal(robot.tool)
    methods = dict(_closed(rig))
    try:
        cv2 = import_module("cv2")
    except ImportError:
        cv2 = None
    if hasattr(cv2, "calibrateHandEye"):
        methods |= _by_opencv(rig, cv2)
    errors: dict[str, list[tuple[float, float]]] = {name: [] for name in ("fit of all corners", *methods)}
    for number in range(options.sets):
        one = _pictures(arm, values, rig, options, rng_for(number, "places"))
        found = {"fit of all corners": _fitted(arm, values, rig, one)}
        found |= {name: method(one) for name, method in methods.items()}
        for name, T in found.items():
            turned = np.linalg.norm(se3.log(one.T_hand_camera[:3, :3].T @ T[:3, :3]))
            errors[name].append((float(np.linalg.norm(T[:3, 3] - one.T_hand_camera[:3, 3])), float(turned)))
    ours = np.array(errors["fit of all corners"])
    results, rows = {}, []
    for name, each in errors.items():
        both = np.array(each)
        ratios = ours / both
        results[name] = {
            "position_mm": float(1e3 * np.sqrt((both[:, 0] ** 2).mean())),
            "rotation_mrad": float(1e3 * np.sqrt((both[:, 1] ** 2).mean())),
            "mean_ratio_position": float(ratios[:, 0].mean()),
            "mean_ratio_rotation": float(ratios[:, 1].mean()),
            "median_ratio_position": float(np.median(ratios[:, 0])),
            "median_ratio_rotation": float(np.median(ratios[:, 1])),
        }
        rows.append((name, *(short(value) for value in results[name].values())))
    head = ("", "mm", "mrad", "ratio of positions", "of rotations", "median of positions", "of rotations")
    caption = f"Root mean square errors of {options.sets} sets, and the paired ratios of the fit's error to each"
    return Answer(
        {"sets": options.sets, "opencv": getattr(cv2, "__version__", None), "methods": results},
        Document("Hand-eye calibration", (Section("Errors", (Table(head, tuple(rows), caption),)),)),
    )


if __name__ == "__main__":
    run_script("hand_eye")
