"""Which errors of real arms are the largest? The thesis' ranking of sources, on measured positions.

Mahdadi and Bouafia (2020), after Judd and Knasinski (1990) and Damak (1996), rank the joints' zeros and gains first,
then geometry, then the rest. Four models are fitted to measured positions: base and tool alone; with the joints' zeros
and gains; with all other entries of the Denavit-Hartenberg table; with both. Each is judged on the poses of the fold
that it did not see. A source's part of the mean square error is the mean of what it removes when it comes first and
when it comes last (Shapley 1953), since some zeros look like geometry. What neither removes is the rest: effects that
are not geometric, and the instrument. Intervals are of 95 %, by the bootstrap over poses.
"""

import csv
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from shared import Answer, Document, Flag, Paragraph, Row, Table, run_script

from lab.core import se3
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.kinematics.parameter import TOLERANCE_M, TOLERANCE_RAD
from lab.kinematics.serial.serial_arm import SerialArm
from lab.robots.load_robot import load_robot
from lab.robots.robot_files import models_folder

FILES = {"ur5": "ur5_jacobi_1000.csv", "ur10": "ur10_ipa_C.csv"}
SOURCES = ("joints", "geometry", "rest")
STEPS, SETTLED = 20, 1e-9
SIGMA_M = 1e-4  # of a measured coordinate, against the prior
PRIOR_M, PRIOR_RAD, PRIOR_GAIN = 10 * TOLERANCE_M, 10 * TOLERANCE_RAD, 1e-2  # standard deviations
RESAMPLES = 2000


@dataclass(frozen=True)
class Options:
    """Which arms."""

    robots: tuple[str, ...] = tuple(FILES)
    """Arms with measured positions: ur5, ur10."""
    folds: int = 5
    """Folds of the cross-validation."""
    seed: int = 0
    """Seed of the folds."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Sources:
    """Parts of the error of one arm.

    Attributes:
        rms_mm: of the positions in folds that were not fitted, by model: none, joints, geometry, both.
        shares: of the mean square error with base and tool alone, by source, with intervals.
        ratio: root of joints' part over geometry's, with its interval.
        resamples: share of resamples in which joints' part is the larger.
    """

    robot: str
    poses: int
    rms_mm: dict[str, float]
    shares: dict[str, tuple[float, float, float]]
    ratio: tuple[float, float, float]
    resamples: float


def measured(robot: str) -> tuple[Array, Array]:
    """Read joint positions ``(n, joints)`` rad and positions ``(n, 3)`` m."""
    with (models_folder() / robot / "measured" / FILES[robot]).open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    unit = "deg" if "q1_deg" in rows[0] else "rad"
    names = [name for name in rows[0] if name.endswith(f"_{unit}") and name.startswith("q")]
    places = [name for name in rows[0] if name.endswith(("x_mm", "y_mm", "z_mm"))]
    joints, points = (np.array([[float(row[name]) for name in wanted] for row in rows]) for wanted in (names, places))
    return np.deg2rad(joints) if unit == "deg" else joints, points / 1e3


def before(arm: SerialArm, joints: Array, points: Array) -> Array:
    """Return nominal parameters with base and tool fitted, from the best rotation of the last frame's origins."""
    values = arm.nominal({"p1": np.zeros(3)})
    nominal = arm.points(joints, values)[:, 0]
    u, _, vt = np.linalg.svd((points - points.mean(axis=0)).T @ (nominal - nominal.mean(axis=0)))
    R = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    base = np.concatenate([points.mean(axis=0) - R @ nominal.mean(axis=0), se3.log(R)])
    values[: len(base)] = base
    return values


def fitted(arm: SerialArm, groups: Sequence[str], joints: Array, points: Array) -> tuple[Array, Array]:
    """Fit base, tool and groups of errors by least squares, with a wide prior along undetermined directions.

    Returns:
        Parameters ``(p,)``, and the joints' gains ``(joints,)``.
    """
    values, gains = before(arm, joints, points), np.zeros(arm.chain.size)
    zeros, placed = _kinds(arm)
    angles = np.array([parameter.is_angle for parameter in arm.parameters])
    columns = placed | (zeros if "joints" in groups else False) | (~zeros & ~placed if "geometry" in groups else False)
    width = np.where(placed, np.inf, np.where(angles, PRIOR_RAD, PRIOR_M))[columns]
    nominal = values.copy()
    if "joints" in groups:
        width = np.concatenate([width, np.full(len(gains), PRIOR_GAIN)])
    for _ in range(STEPS):
        turned = joints * (1 + gains)
        seen, rates = arm.observe(turned, values)
        J, off = rates.reshape(-1, len(values))[:, columns], (values - nominal)[columns]
        if "joints" in groups:
            by_joint = arm.joint_jacobian(turned, values)[:, 0] * joints[:, None, :]
            J, off = np.concatenate([J, by_joint.reshape(len(J), -1)], axis=1), np.concatenate([off, gains])
        rows = np.concatenate([J / SIGMA_M, np.diag(1 / width)])
        sides = np.concatenate([(points - seen[:, 0]).ravel() / SIGMA_M, -off / width])
        step = np.linalg.lstsq(rows, sides, rcond=None)[0]
        values[columns] += step[: int(columns.sum())]
        if "joints" in groups:
            gains += step[-len(gains) :]
        if np.abs(step).max() < SETTLED:
            break
    return values, gains


def _kinds(arm: SerialArm) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return flags ``(p,)`` of the joints' zeros, and of base and tool."""
    names = arm.names
    return (
        np.array([name.endswith(".theta") for name in names]),
        np.array([name.startswith(("base.", "tool.")) for name in names]),
    )


MODELS = {"none": (), "joints": ("joints",), "geometry": ("geometry",), "both": ("joints", "geometry")}


def sources_of(robot: str, joints: Array, points: Array, folds: int, seed: int) -> Sources:
    """Fit all four models on each fold's other poses, and divide the squares of the errors among the sources."""
    arm = load_robot(robot).serial_arm(("p1",))
    fold = rng_for(seed, "split").permutation(len(joints)) % folds
    squares = {name: np.empty(len(joints)) for name in MODELS}
    for k in range(folds):
        for name, groups in MODELS.items():
            values, gains = fitted(arm, groups, joints[fold != k], points[fold != k])
            off = arm.points(joints[fold == k] * (1 + gains), values)[:, 0] - points[fold == k]
            squares[name][fold == k] = (off**2).sum(axis=1)
    counts = rng_for(seed, "bootstrap").multinomial(len(joints), np.full(len(joints), 1 / len(joints)), size=RESAMPLES)
    weights = np.concatenate([np.ones((1, len(joints))), counts]) / len(joints)
    mean = {name: weights @ each for name, each in squares.items()}
    parts = {
        "joints": (mean["none"] - mean["joints"] + mean["geometry"] - mean["both"]) / 2,
        "geometry": (mean["none"] - mean["geometry"] + mean["joints"] - mean["both"]) / 2,
        "rest": mean["both"],
    }
    ratio = np.sqrt(np.maximum(parts["joints"], 0) / np.maximum(parts["geometry"], 1e-30))
    return Sources(
        robot, len(joints), {name: float(MM.of(np.sqrt(each.mean()))) for name, each in squares.items()},
        {name: _interval(parts[name] / mean["none"]) for name in SOURCES}, _interval(ratio),
        float((parts["joints"] > parts["geometry"])[1:].mean()),
    )  # fmt: skip


def _interval(values: Array) -> tuple[float, float, float]:
    """Return the estimate, first of the values, with the quantiles of the resamples."""
    low, high = np.quantile(values[1:], (0.025, 0.975))
    return float(values[0]), float(low), float(high)


def answer(options: Options) -> Answer:
    """Rank the sources of each arm."""
    if unknown := [name for name in options.robots if name not in FILES]:
        raise LabError(f"--robots {unknown[0]}: choose of {', '.join(FILES)}")
    if options.folds < 2:
        raise LabError(f"--folds {options.folds}: give 2 or more")
    found = [sources_of(name, *measured(name), options.folds, options.seed) for name in options.robots]
    rows: list[Row] = []
    for each in found:
        shares = ["{:.1f} % ({:.1f} to {:.1f})".format(*(100 * x for x in each.shares[name])) for name in SOURCES]
        errors = [f"{each.rms_mm[name]:.3f}" for name in MODELS]
        rows.append((each.robot, f"{each.poses:,}", *errors, *shares, "{:.2f} ({:.2f} to {:.2f})".format(*each.ratio)))
    heads = ("arm", "poses", "base and tool", "+ joints", "+ geometry", "+ both", *SOURCES, "joints over geometry")
    caption = "RMS position error in folds not fitted, mm, and each source's part of its square"
    first = [each.robot for each in found if each.ratio[1] > 1]
    last = [each.robot for each in found if each.ratio[2] < 1]
    words = (
        f"Joints before geometry: {', '.join(first) or 'none'}; geometry before joints: {', '.join(last) or 'none'}."
    )
    blocks = (Table(heads, tuple(rows), caption), Paragraph(words))
    return Answer({"arms": [asdict(each) for each in found]}, Document("Sources of error of real arms", blocks))


if __name__ == "__main__":
    run_script("error_sources")
