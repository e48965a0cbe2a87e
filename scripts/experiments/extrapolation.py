"""What extrapolates and what does not: nested cross-validation, blocked by regions of joint space.

The model is chosen anew on the poses that are left (nothing of those held out is seen), and the poses held out are at
random, a region of joint space, or beyond an end of a joint's measured range. Per kind of split and model: the mean
error, the largest, and how many of the errors 95 % bounds hold, with and without what the edges of the measured range
say of poses beyond it. The bounds are those of the F distribution, or Student's t where the residuals are like that.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from shared import Answer, Document, Flag, Section, Table, run_script, short

import lab
from lab.calibration.identification import Identification
from lab.calibration.row_groups import configurations, folds
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.formats.measurement_csv import read_measurements
from lab.prediction.extrapolation import MeasuredRange, joint_regions, model_covariances
from lab.prediction.residual_spread import ResidualSpread
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot

Split = Literal["random", "regions", "beyond"]
_SHARES = (
    "beyond_share",
    "within_bounds",
    "within_bounds_of_covariance",
    "uncovered_share",
    "within_bounds_covered",
)
_DRAWS = 20_000  # of squares of Student's t, for their 95 % bound


@dataclass(frozen=True)
class Options:
    """What to cross-validate."""

    file: Path
    """Measured points, a CSV file."""
    robot: str = "irb120"
    """The nominal robot: a model's name or a path."""
    models: tuple[str, ...] = ("geometric", "auto")
    """Models to identify, as ``--model`` names them."""
    kinds: tuple[Split, ...] = ("random", "regions", "beyond")
    """How poses are held out."""
    count: int = 5
    """Parts, each held out once, at random or by region; beyond are both ends of the first three joints."""
    share: float = 0.1
    """Poses beyond an end of a joint's range, of all."""
    most_poses: int = 600
    """Poses, at random, of a larger file."""
    json: Flag = False
    """Print one JSON object."""


def splits(joints: Array, turning: NDArray[np.bool_], kind: Split, count: int, share: float) -> list[NDArray[np.bool_]]:
    """Which poses ``(n,)`` each part holds out, of joint positions ``(n, joints)``, of which some turn."""
    if kind == "random":
        parts = folds(configurations(joints), 0)
        return [parts == part for part in range(int(parts.max()) + 1)]
    if kind == "regions":
        labels = joint_regions(joints, turning, count, 0)
        return [labels == label for label in range(count)]
    found = []
    for positions in joints[:, :3].T:
        low, high = np.quantile(positions, [share, 1 - share])
        found += [positions < low, positions > high]
    return found


def cross_validated(robot: Robot, data: Measurements, model: str, held: list[NDArray[np.bool_]]) -> dict[str, float]:
    """Errors of the parts held out, each by what the others say, and how many of them their bounds hold."""
    lengths, within, plain, far, lone = [], [], [], [], []
    for out in held:
        rows, rest = data[~out], data[out]
        report = lab.identify(rows, robot, model=model, validate=rest).state
        found = report.identification
        inputs = rest.inputs(found.model.conditions)
        bound = _bound(found.dof, report.tail_dof)
        both = prediction_squares(found, report.measured, inputs, rest.points, report.residual_spread)
        within.append(both[0][rest.seen] < bound)
        plain.append(both[1][rest.seen] < bound)
        lengths.append(np.linalg.norm(rest.points - found.model.points(inputs, found.values), axis=2)[rest.seen])
        assert report.measured is not None
        far.append(report.measured.beyond(rest.joints).any(axis=1))
        lone.append(np.broadcast_to(report.measured.uncovered(rest.joints)[:, None], rest.seen.shape)[rest.seen])
    error, covered, inside = np.concatenate(lengths), ~np.concatenate(lone), np.concatenate(within)
    return {
        "mean_mm": float(1e3 * error.mean()),
        "max_mm": float(1e3 * error.max()),
        "beyond_share": float(np.concatenate(far).mean()),
        "within_bounds": float(inside.mean()),
        "uncovered_share": float((~covered).mean()),
        "within_bounds_covered": float(inside[covered].mean()) if covered.any() else float("nan"),
        "within_bounds_of_covariance": float(np.concatenate(plain).mean()),
    }


def prediction_squares(
    found: Identification, measured: MeasuredRange | None, inputs: Array, points: Array, left: ResidualSpread
) -> tuple[Array, Array]:
    """Squares e' V^-1 e ``(n, k)`` of measured less predicted points, and the same by noise and parameters alone.

    V is that of the noise (as large as the residuals are), of the parameters, and of what is beyond the range.

    Args:
        inputs: ``(n, joints + conditions)``.
        points: ``(n, k, 3)`` m.
        left: what the fit left of the measurements that it comes from.
    """
    error = points - found.model.points(inputs, found.values)[:, : points.shape[1]]
    with_range, without = (
        np.einsum("nki,nki->nk", error, np.linalg.solve(each, error[..., None])[..., 0])
        for each in (
            model_covariances(found, what, inputs, left) + left.total_m**2 * np.eye(3) for what in (measured, None)
        )
    )
    return with_range, without


def _bound(dof: int, tail_dof: float) -> float:
    """What the sum of three squares exceeds in 5 % of the cases."""
    if np.isinf(tail_dof):
        return float(3 * stats.f.ppf(0.95, 3, dof))
    drawn = np.random.default_rng(0).standard_t(tail_dof, (_DRAWS, 3)) * np.sqrt((tail_dof - 2) / tail_dof)
    return float(np.quantile((drawn**2).sum(axis=1), 0.95))


def answer(options: Options) -> Answer:
    """All kinds of splits with all models."""
    robot = load_robot(options.robot)
    data = read_measurements(options.file, robot.chain.joint_names, robot.chain.prismatic)
    if len(data) > options.most_poses:
        data = data[np.sort(np.random.default_rng(0).permutation(len(data))[: options.most_poses])]
    turning = ~np.array(robot.chain.prismatic, dtype=np.bool_)
    parts = {kind: splits(data.joints, turning, kind, options.count, options.share) for kind in options.kinds}
    values = {
        f"{kind}, {model}": cross_validated(robot, data, model, held)
        for kind, held in parts.items()
        for model in options.models
    }
    columns = (
        "poses held out, model",
        "mean, mm",
        "max, mm",
        "beyond, %",
        "in 95 % bounds, %",
        "of the covariance, %",
        "not covered, %",
        "in 95 % bounds of those covered, %",
    )
    rows = tuple(
        (
            name,
            short(each["mean_mm"]),
            short(each["max_mm"]),
            *(f"{100 * each[key]:.1f}" for key in _SHARES),
        )
        for name, each in values.items()
    )
    caption = f"{len(data)} poses"
    document = Document("What extrapolates", (Section("Nested cross-validation", (Table(columns, rows, caption),)),))
    return Answer(values, document)


if __name__ == "__main__":
    run_script("extrapolation")
