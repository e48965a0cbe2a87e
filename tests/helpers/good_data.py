"""Random good data sets: measurements of random arms, with the options of ``lab identify`` to fit them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from helpers.robots import perturbed, somewhere
from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.effects.effect import SessionInfo, absent
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot

__all__ = ["GoodData", "good_data"]

SERIAL_MODELS = ("irb120", "rx130", "scara", "scemi", "scorbot", "tx40")
FITTED = (
    "geometric",
    "geometric",
    "auto",
    "auto",
    "auto",
    "residual",
    "auto+residual",
    "coupling+gear",
    "harmonics",
    "drift",
)
EFFECTS = {"harmonics": 1e-3, "gear": 1e-3, "coupling": 1e-3, "drift": 1e-4}  # and their sizes (rad, m or 1)
ORDERS = ("pose by pose", "round by round", "by chance")
NAMES = {"session": ("monday", "tuesday", "friday"), "station": ("west", "east", "north")}


@dataclass(frozen=True)
class GoodData:
    """Files and options of one identification.

    Attributes:
        files: their texts, by name: the measurements, and the robot's table where it is no model of the lab.
        options: of ``lab identify``, the file of measurements first.
        poses: how many distinct poses there are.
        about: what was drawn, for whoever reads a failure.
    """

    files: dict[str, str]
    options: tuple[str, ...]
    poses: int
    about: str

    def write(self, folder: Path) -> None:
        """Write the files into a folder."""
        for name, text in self.files.items():
            (folder / name).write_text(text, encoding="utf-8")


def good_data(seed: int, folder: Path, *, most_poses: int = 60, most_repeats: int = 12) -> GoodData:
    """A random data set: 2 to 60 distinct poses, each measured 1 to 12 times, of an arm with 3 to 7 joints.

    The real arm is off by 0.5 mm and 1.5 mrad, and half of the arms also have an effect of the robot.

    Args:
        folder: where a robot's table may be written.
    """
    rng = np.random.default_rng(seed)
    files, robot = _robot(rng, folder)
    targets = tuple(f"p{i + 1}" for i in range(rng.integers(1, 5)))
    poses = round(2 * (most_poses / 2) ** rng.random())
    rows = _visits(rng, poses, round(most_repeats ** rng.random()))
    joints = robot.chain.random_joints(poses, rng)[rows]
    if rng.random() < 0.3:  # read from the encoders, not commanded
        joints = joints + 1e-5 * rng.standard_normal(joints.shape)
    others = _other_columns(rng, len(rows), robot)
    points = _measured(rng, robot, targets, joints, others)
    lines = {f"{name}_{'m' if slides else 'rad'}": joints[:, j] for j, (name, slides) in enumerate(_kinds(robot))}
    lines |= {f"{t}_{axis}_mm": 1e3 * points[:, k, i] for k, t in enumerate(targets) for i, axis in enumerate("xyz")}
    columns = {name: [("" if np.isnan(v) else f"{v:.12g}") for v in column] for name, column in lines.items()} | others
    text = "\n".join([",".join(columns), *(",".join(row) for row in zip(*columns.values(), strict=True))]) + "\n"
    options = _options(rng, next(iter(files), robot.source))
    counts = f"{robot.chain.size} joints, {poses} poses, {len(rows)} rows, {len(targets)} targets"
    about = f"seed {seed}: {counts}, columns {', '.join(others)}; {' '.join(options)}"
    return GoodData({**files, "measured.csv": text}, ("measured.csv", *options), poses, about)


def _kinds(robot: Robot) -> list[tuple[str, bool]]:
    """Name of each joint, and whether it slides."""
    return list(zip(robot.chain.joint_names, robot.chain.prismatic, strict=True))


def _robot(rng: np.random.Generator, folder: Path) -> tuple[dict[str, str], Robot]:
    """A model of the lab, or a table of 3 to 7 joints, with its file."""
    if rng.random() < 0.4:
        return {}, load_robot(str(rng.choice(SERIAL_MODELS)))
    text = _table(rng, int(rng.integers(3, 8)))
    path = folder / "arm.toml"
    path.write_text(text, encoding="utf-8")
    return {path.name: text}, load_robot(str(path))


def _table(rng: np.random.Generator, size: int) -> str:
    """An arm whose neighbouring axes are parallel or perpendicular; one in five has a prismatic joint."""
    slide = int(rng.integers(size)) if rng.random() < 0.2 else -1
    parts = [f'name = "arm"\nconvention = "{rng.choice(["craig", "distal"])}"\n']
    for j in range(size):
        a, d = (int(length) if rng.random() < 0.6 else 0 for length in rng.integers(50, 500, 2))
        limits = "lower_mm = 0\nupper_mm = 400" if j == slide else "lower_deg = -150\nupper_deg = 150"
        kind = 'type = "prismatic"\n' if j == slide else ""
        alpha = rng.choice([-90, 90, 90, 0])
        place = f"theta_deg = 0\nd_mm = {d}\na_mm = {a}\nalpha_deg = {alpha}"
        parts.append(f'[[joint]]\nname = "q{j + 1}"\n{kind}{place}\n{limits}\n')
    return "\n".join(parts)


def _visits(rng: np.random.Generator, poses: int, most: int) -> Array:
    """The pose of each row, in the order of the visits: every pose once at least, and ``most`` times at most."""
    times = np.full(poses, most) if rng.random() < 0.5 else rng.integers(1, most + 1, poses)
    match rng.choice(ORDERS):
        case "pose by pose":
            return np.repeat(np.arange(poses), times)
        case "round by round":
            return np.concatenate([np.flatnonzero(times > i) for i in range(most)])
    return np.asarray(rng.permutation(np.repeat(np.arange(poses), times)))


def _other_columns(rng: np.random.Generator, rows: int, robot: Robot) -> dict[str, list[str]]:
    """Sessions, stations and conditions, each of them in some data sets."""
    found = {}
    for column, names in NAMES.items():
        if rng.random() < 0.25:
            some = names[: rng.integers(1, 4)]
            found[column] = [some[min(i * len(some) // rows, len(some) - 1)] for i in range(rows)]
            if rng.random() < 0.5:
                found[column] = [str(name) for name in rng.choice(some, rows)]
    if rng.random() < 0.3:
        found["time_s"] = [f"{20 * i}" for i in range(rows)]
    if rng.random() < 0.2:
        found["temp_C"] = [f"{20 + 5 * i / rows:.2f}" for i in range(rows)]
    if rng.random() < 0.3:
        found["payload_kg"] = [str(mass) for mass in rng.choice([0, 1, 3], rows)]
    if rng.random() < 0.2:
        found |= {f"approach_{name}": [str(way) for way in rng.choice([-1, 1], rows)] for name, _ in _kinds(robot)}
    if rng.random() < 0.15:
        found["use"] = [str(use) for use in rng.choice(["calibrate", "test"], rows, p=[0.8, 0.2])]
        found["use"][0] = "calibrate"
    if rng.random() < 0.15:
        found["sigma_mm"] = [f"{size:.3f}" for size in rng.choice([0.01, 0.02], rows)]
    return found


def _measured(
    rng: np.random.Generator, robot: Robot, targets: tuple[str, ...], joints: Array, others: dict[str, list[str]]
) -> Array:
    """Points ``(n, k, 3)`` of a real arm, with the noise of a tracker, each station's in a frame of its own."""
    effect = [str(rng.choice(list(EFFECTS)))] if rng.random() < 0.5 else []
    arm = robot.arm_with(targets, effect, SessionInfo(timed="time_s" in others))
    names = tuple(arm.names)
    values = somewhere(robot.arm(targets), rng)
    nominal = np.concatenate([values, np.zeros(len(names) - len(values))])
    place = dict(zip(robot.arm(targets).names, perturbed(robot.arm(targets), values, rng, 5e-4, 1.5e-3), strict=True))
    tool = {f"tool.{t}.{axis}": 0.1 * rng.normal() for t in targets for axis in "xyz"}
    drawn = {name: sum(EFFECTS[each] for each in effect) * rng.normal() for name in names if name not in place}
    truth = np.array([(drawn | place | tool).get(name, at) for name, at in zip(names, nominal, strict=True)])
    given = [
        np.array(others[name], dtype=np.float64) if name in others else absent(name, len(joints))
        for name in arm.conditions
    ]
    points = arm.points(np.column_stack([joints, *given]), truth)
    points = points + rng.choice([1e-5, 3e-5]) * rng.standard_normal(points.shape)
    for name in sorted(set(others.get("station", ()))):
        here = np.array(others["station"]) == name
        T = se3.pose(se3.exp(rng.normal(size=3)), rng.normal(size=3))
        points[here] = se3.transform(T, points[here])
    if len(targets) > 1 and rng.random() < 0.5:
        points[rng.random(points.shape[:2]) < rng.choice([0.05, 0.3])] = np.nan
    return np.asarray(points)


def _options(rng: np.random.Generator, robot: str) -> tuple[str, ...]:
    """Options of the identification; what goes together only."""
    model = str(rng.choice(FITTED))
    chosen = ["--robot", robot, "--model", model, "--seed", str(rng.integers(100))]
    if rng.random() < 0.3:
        chosen.append("--robust")
    if rng.random() < 0.4:
        chosen += ["--holdout", "0.3"]
    if rng.random() < 0.15 and "residual" not in model:
        chosen.append("--prior")
    match rng.integers(4):
        case 0:
            chosen += ["--instrument", "leica-at960"]
        case 1:
            chosen += ["--noise-mm", "0.02"]
    return tuple(chosen)
