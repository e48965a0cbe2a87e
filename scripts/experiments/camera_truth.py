"""Does a printed board make an arm better than its maker's table? Factory calibrations of real arms as the truth.

Each true arm has the lengths and twists that a controller's factory calibration gives it; its maker's table is the
nominal model. A camera in the hand (or in the room) takes pictures of a board that is printed larger or smaller than
stated. The error is that of the flange over poses near the measured ones, with base and tool placed anew for every arm
that is compared: the maker's table, and the identified one.
"""

import csv
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from shared import Answer, Document, Flag, Section, Table, run_script, short

import lab
from lab.core import se3
from lab.core.measurements import Measurements, measured
from lab.core.se3 import Array
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm

_TABLES = {  # d1, a2, a3, d4, d5, d6 in mm (Universal Robots, "DH parameters")
    "ur3": (151.9, -243.65, -213.25, 112.35, 85.35, 81.9),
    "ur5": (89.159, -425.0, -392.25, 109.15, 94.65, 82.3),
    "ur3e": (151.85, -243.55, -213.2, 131.05, 85.35, 92.1),
    "ur5e": (162.5, -425.0, -392.2, 133.3, 99.7, 99.6),
    "ur10e": (180.7, -612.7, -571.55, 174.15, 119.85, 116.55),
}
_FOCAL_PX, _SIZE_PX = 1200.0, np.array([1280.0, 960.0])
_CORNERS = np.array([[x, y, 0.0] for y in range(6) for x in range(9)])
_SQUARE_M = 0.025
_NEAR, _FAR, _INCIDENCE = 0.25, 0.9, np.deg2rad(55)
_TRIES, _BLOCK, _AROUND = 200, 4000, 0.4
_JUDGED, _SPREAD = 300, 0.15  # poses that judge, and how far (rad) they are from measured ones


@dataclass(frozen=True)
class Options:
    """What to try."""

    factory: Path
    """Factory calibrations, a row for each arm (CSV)."""
    camera: str = "hand"
    """Where the camera is: hand, or room (then the board is in the hand)."""
    board_percent: float = 0.5
    """Size of the board's error: 1σ over the seeds; the board is as often larger as smaller."""
    stated_percent: float | None = None
    """Uncertainty of the board's size that the user states; none by default."""
    poses: int = 25
    """Pictures."""
    noise_px: float = 0.3
    """Noise of a corner (1σ)."""
    seeds: int = 2
    """Campaigns of each arm."""
    json: Flag = False
    """Print one JSON object."""


def makers_table(model: str) -> Array:
    """Return the maker's table ``(6, 5)`` (theta, d, a, alpha, beta; m, rad), distal."""
    d1, a2, a3, d4, d5, d6 = np.array(_TABLES[model]) / 1e3
    table = np.zeros((6, 5))
    table[:, 1], table[1:3, 2] = (d1, 0, 0, d4, d5, d6), (a2, a3)
    table[[0, 3, 4], 3] = np.pi / 2 * np.array([1, 1, -1])
    return table


def _robot_toml(model: str) -> str:
    text = f'name = "{model}"\nconvention = "distal"\n'
    for i, (theta, d, a, alpha, _) in enumerate(makers_table(model).tolist()):
        text += f'[[joint]]\nname = "q{i + 1}"\ntheta_deg = {theta}\nd_mm = {1e3 * d}\na_mm = {1e3 * a}\n'
        text += f"alpha_deg = {np.rad2deg(alpha)}\nlower_deg = -360\nupper_deg = 360\n"
    return text


def true_table(nominal: Array, row: dict[str, str]) -> Array:
    """Return the table ``(6, 5)`` (theta, d, a, alpha, beta; m, rad) of a real arm by its factory calibration."""
    value = {name: float(text) for name, text in row.items() if name.endswith(("_mm", "_rad"))}

    def twist(name: str) -> float:  # between parallel axes: modulo a half turn
        return float((value[name] + np.pi / 2) % np.pi - np.pi / 2)

    table = nominal.copy()
    table[0, 1:4] = value["d1_mm"] / 1e3, value["a1_mm"] / 1e3, value["alpha1_rad"]
    table[1, 2:] = value["a2_mm"] / 1e3, twist("forearm_roll_rad"), twist("forearm_pitch_rad")
    table[2, 2:] = value["a3_mm"] / 1e3, twist("wrist1_roll_rad"), twist("wrist1_pitch_rad")
    table[2, 0] += value["y3_mm"] / value["a3_mm"]
    table[3:6, 1] = value["d4_mm"] / 1e3, value["d5_mm"] / 1e3, value["d6_mm"] / 1e3
    table[3:5, 3] = value["alpha4_rad"], -value["alpha5_rad"]
    return table


def _looking(eye: Array, at: Array, up: Array) -> Array:
    """Return the pose ``(4, 4)`` of a camera at ``eye`` whose z axis leads to ``at``."""
    z = (at - eye) / np.linalg.norm(at - eye)
    x = np.cross(up, z)
    x /= np.linalg.norm(x)
    return se3.pose(np.stack([x, np.cross(z, x), z], axis=1), eye)


def scene(reach: float, camera: str) -> tuple[Array, Array]:
    """Return the poses ``(4, 4)`` of what the flange carries and of what stands in the room."""
    middle = _SQUARE_M * _CORNERS.mean(axis=0)
    if camera == "hand":
        T_flange_camera = se3.pose(se3.exp(np.array([0.05, -0.1, 0.3])), np.array([0.01, 0.06, 0.04]))
        down = np.diag([1.0, -1.0, -1.0])  # z of the board leads away from who looks at it
        T_base_board = se3.pose(down, np.array([0.55 * reach, 0.1 * reach, 0.01]) - down @ middle)
        return T_flange_camera, T_base_board
    turned = np.diag([1.0, -1.0, -1.0])
    T_flange_board = se3.pose(turned, np.array([0.005, 0.01, 0.03]) - turned @ middle)
    eye, at = np.array([1.3 * reach, 0.2 * reach, 0.6 * reach]), np.array([0.4 * reach, 0.0, 0.3 * reach])
    return T_flange_board, _looking(eye, at, np.array([0.0, 0.0, -1.0]))


def places_px(
    T_flange: Array, camera: str, carried: Array, standing: Array, size: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Return places ``(n, c, 2)`` px of the corners of a board of some size, and ``(n,)`` whether all are seen well."""
    T_camera, T_board = (T_flange @ carried, standing) if camera == "hand" else (standing, T_flange @ carried)
    T = np.broadcast_to(se3.inverse(T_camera) @ T_board, (len(T_flange), 4, 4))
    points = size * _SQUARE_M * _CORNERS @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        px = _FOCAL_PX * points[..., :2] / points[..., 2:] + _SIZE_PX / 2
    middle = points.mean(axis=1)
    distance = np.linalg.norm(middle, axis=1)
    facing = (middle * T[:, :3, 2]).sum(axis=1) > np.cos(_INCIDENCE) * distance
    inside = ((px > 0) & (px < _SIZE_PX)).all(axis=(1, 2)) & (points[..., 2] > 0).all(axis=1)
    return px, inside & facing & (distance > _NEAR) & (distance < _FAR)


def poses_in_sight(arm: SerialArm, options: Options, placed: tuple[Array, Array], rng: np.random.Generator) -> Array:
    """Draw joint positions ``(n, 6)`` at which the nominal arm sees the whole board, above its table."""
    found, values = np.empty((0, 6)), arm.nominal()
    for number in range(_TRIES):
        joints = rng.uniform(-np.pi, np.pi, (_BLOCK, 6))
        if number % 2 and len(found):
            joints = found[rng.integers(len(found), size=_BLOCK)] + rng.normal(0, _AROUND, (_BLOCK, 6))
        T = arm.flange(joints, values)
        good = places_px(T, options.camera, *placed, 1.0)[1] & (T[:, 2, 3] > 0.05)
        found = np.concatenate([found, joints[good]])
        if len(found) > 20 * options.poses:
            break
    return found[rng.permutation(len(found))[: options.poses]]


def pictures(
    arm: SerialArm, values: Array, joints: Array, options: Options, placed: tuple[Array, Array],
    size: float, rng: np.random.Generator,
) -> Measurements:  # fmt: skip
    """Return the corners that the true arm's camera sees."""
    px = places_px(arm.flange(joints, values), options.camera, *placed, size)[0]
    px += rng.normal(0, options.noise_px, px.shape)
    count = len(_CORNERS)
    rows = np.repeat(joints, count, axis=0)
    data = measured(arm.chain.joint_names, rows, (), np.empty((len(rows), 0, 3)))
    corner = tuple(str(i) for _ in joints for i in range(count))
    conditions = {"u_px": px[..., 0].ravel(), "v_px": px[..., 1].ravel()}
    return Measurements(**{**vars(data), "other": {"corner": corner}, "conditions": conditions})


def flange_errors(found: Array, true: Array) -> Array:
    """Return distances ``(n,)`` (m) of flanges ``(n, 4, 4)`` from true ones, with base and tool placed anew."""

    def residual(x: Array) -> Array:
        points = found[:, :3, :3] @ x[6:] + found[:, :3, 3]
        return np.asarray((points @ se3.exp(x[:3]).T + x[3:6] - true[:, :3, 3]).ravel())

    best = optimize.least_squares(residual, np.zeros(9), x_scale=[1e-3] * 9, method="lm").x
    return np.asarray(np.linalg.norm(residual(best).reshape(-1, 3), axis=1))


_RIG = """
[[camera]]
size_px = [1280, 960]
focal_px = [1200.0, 1200.0]
centre_px = [640.0, 480.0]
fixed_to = "{camera}"
[[board]]
columns = 9
rows = 6
square_mm = 25.0
fixed_to = "{board}"
"""


def campaign(row: dict[str, str], options: Options, seed: int, folder: Path) -> dict[str, Any]:
    """Identify one arm by its pictures, and compare it with its maker's table."""
    (folder / "robot.toml").write_text(_robot_toml(row["model"]))
    in_hand = ("hand", "world") if options.camera == "hand" else ("world", "hand")
    (folder / "cameras.toml").write_text(_RIG.format(camera=in_hand[0], board=in_hand[1]))
    robot = lab.load_robot(folder / "robot.toml")
    assert isinstance(robot.chain, Chain)
    arm = SerialArm(robot.chain)
    rng = np.random.default_rng([seed, int(row["hash"]) % 2**32])
    base, table, tool = arm.split(arm.nominal())
    true = arm.assemble(base, true_table(table, row), tool)
    carried, standing = scene(float(np.abs(table[1:3, 2]).sum()), options.camera)
    # pictures of a board that is larger or smaller than stated
    size = 1 + options.board_percent / 100 * rng.standard_normal()
    joints = poses_in_sight(arm, options, (carried, standing), rng)
    data = pictures(arm, true, joints, options, (carried, standing), size, rng)
    rig, stated = folder / "cameras.toml", options.stated_percent
    result = lab.identify(data, robot, observe="pixels", cameras=rig, size_u_percent=stated)
    # errors of the maker's table and of the identified arm near the measured poses
    near = joints[rng.integers(len(joints), size=_JUDGED)] + rng.normal(0, _SPREAD, (_JUDGED, 6))
    values = arm.nominal()
    known = dict(zip(result.identification.model.names, result.identification.values, strict=True))
    identified = np.array([known.get(name, value) for name, value in zip(arm.names, values, strict=True)])
    truth = arm.flange(near, true)
    before, after = (1e3 * flange_errors(arm.flange(near, each), truth) for each in (values, identified))
    predicted = result.to_dict()["prediction"]["p95_mm"]
    return {
        "model": row["model"],
        "seed": seed,
        "board_percent": 100 * (size - 1),
        "found_percent": 100 * known.get("board.board.scale", 0.0),
        "table_mm": float(before.mean()),
        "identified_mm": float(after.mean()),
        "p95_mm": float(np.quantile(after, 0.95)),
        "predicted_p95_mm": predicted,
        "below_predicted": float((after <= predicted).mean()) if predicted is not None else None,
    }


def answer(options: Options) -> Answer:
    """All arms with all seeds."""
    with options.factory.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    with TemporaryDirectory() as folder:
        found = [campaign(row, options, seed, Path(folder)) for row in rows for seed in range(options.seeds)]
    lines = []
    for model in (*dict.fromkeys(each["model"] for each in found), "all"):
        some = [each for each in found if model in (each["model"], "all")]
        mean = {key: float(np.mean([each[key] for each in some])) for key in some[0] if key.endswith("_mm")}
        covered = float(np.mean([each["below_predicted"] for each in some]))
        worse = sum(each["identified_mm"] > each["table_mm"] for each in some)
        numbers = (mean["table_mm"], mean["identified_mm"], mean["p95_mm"], mean["predicted_p95_mm"])
        lines.append((model, str(len(some)), *map(short, numbers), f"{100 * covered:.1f} %", str(worse)))
    columns = ("arm", "campaigns", "maker's table, mm", "identified, mm", "95 %, mm", "predicted 95 %, mm",
               "errors below predicted 95 %", "worse than the table")  # fmt: skip
    table = Table(columns, tuple(lines), "mean errors of the flange near the measured poses")
    title = f"Pictures of a printed board by real arms: camera in the {options.camera}"
    return Answer({"campaigns": found}, Document(title, (Section("Factory calibrations as the truth", (table,)),)))


if __name__ == "__main__":
    run_script("camera_truth")
