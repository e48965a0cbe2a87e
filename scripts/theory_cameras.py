"""Find a camera in the hand and a board on the table from pictures, in closed form."""

import numpy as np

from lab.core.se3 import exp, inverse, log, pose
from lab.sensors.cameras.closed_forms import board_poses, robot_world
from lab.sensors.cameras.geometry import projected, sight_lines

rng = np.random.default_rng(0)
LENS = np.array([1200.0, 1200.0, 639.5, 479.5, -0.2, 0.05, 0.001, -0.001, 0.0])
corners = np.array([[0.02 * i, 0.02 * j, 0.0] for j in range(6) for i in range(9)])  # m
hand_camera = pose(exp(np.array([0.1, -0.2, 0.3])), np.array([0.06, 0.0, 0.04]))
base_board = pose(exp(np.array([3.0, 0.1, 0.2])), np.array([0.45, 0.1, 0.0]))


def looking(tilt: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return the pose of a board before a camera, with its middle in front."""
    rotation = exp(tilt)
    return pose(rotation, place - rotation @ corners.mean(axis=0))


tilts, sideways = rng.normal(0, 0.4, (15, 3)), rng.normal(0, 0.03, (15, 2))
boards = np.stack([looking(tilt, np.array([*aside, 0.4])) for tilt, aside in zip(tilts, sideways, strict=True)])
hands = base_board @ inverse(boards) @ inverse(hand_camera)  # as an exact arm reports them
points = corners @ boards[:, :3, :3].swapaxes(1, 2) + boards[:, None, :3, 3]

places = projected(points.reshape(-1, 3), LENS)[0]
twice = projected(2 * points.reshape(-1, 3), LENS)[0]
print(f"all lengths doubled, the pictures change by {np.abs(twice - places).max():.6f} px")

for noise_px in (0.0, 0.1, 0.3):
    measured = places + noise_px * rng.standard_normal(places.shape)
    seen = sight_lines(measured, LENS).reshape(15, -1, 2)
    found_boards, _ = board_poses(corners, seen)
    camera, board = robot_world(hands, inverse(found_boards))
    pairs = {"camera": (camera, hand_camera), "board": (board, base_board)}
    for name, (found, true) in pairs.items():
        away = 1e3 * np.linalg.norm(found[:3, 3] - true[:3, 3])
        turned = 1e3 * np.linalg.norm(log(found[:3, :3] @ true[:3, :3].T))
        print(f"noise {noise_px} px: {name} off by {away:.3f} mm and {turned:.3f} mrad")
