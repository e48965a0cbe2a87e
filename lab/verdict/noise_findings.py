"""Check whether the errors of a campaign are plausible for an instrument and a robot.

A noise model explains any residuals: a tracker that was moved becomes a step, a joint whose zero was shifted becomes
scatter. So what it explains is a finding. A finding is supported where repeated poses, or an instrument whose stated
noise is as large, show it too. A verdict cannot be good with an unsupported finding, nor with errors larger than
common instruments and industrial arms have.

Beside the shared errors that ``noise.search`` estimates, the residuals are scanned for changes during the campaign
(the base's place and direction, a tool point, a joint's zero, the size of the arm, that of the errors), at every row;
and for an arm that grows steadily as it warms up.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.identification import Identification
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.calibration.statistics.linearized import LinearizedFit, SubsetFit, linearized
from lab.core.checks import Check
from lab.core.measurements import Measurements, evenly
from lab.core.probability import f_sf
from lab.core.se3 import Array
from lab.core.significance import CHANGE_IN_TIME
from lab.kinematics.parameter import targets_of
from lab.noise.change_points import likeliest_change, rows_around, session_of
from lab.noise.error_model import ErrorModel, row_times

__all__ = ["COMMON_NOISE_M", "COMMON_SCATTER_M", "changes_in_time", "finding", "shared_error_findings"]

COMMON_NOISE_M = 0.15e-3
"""Largest white noise (1σ per axis) of instruments in common use: photogrammetry and optical systems of a cell."""
COMMON_SCATTER_M = 0.1e-3
"""Largest scatter (RMS at the tool) of where an industrial arm stops: ISO 9283 repeatabilities are 0.01 to 0.1 mm."""
_COMMON_DRIFT_M = 0.1e-3
"""Largest drift or wandering (1σ per axis) of a set-up that was left alone."""

_MIN_ROWS_EACH_SIDE = 8  # of a change in the size of errors
_MAX_SCANNED_POSES = 2_000
_MIN_VARIANCE_RATIO = 1.5  # of a change in the size of errors: a smaller one harms nothing
_TIME_SPAN_OF_REPEATS = 0.5  # of the campaign, between visits of one pose that show what changes with time
_FLOOR_M = 1e-7  # residuals below are rounding
_SPANNED = 1e-6  # of a column's norm that others leave


def finding(kind: str, size_m: float, *, supported: bool = False, **data: Any) -> Check:
    """Return a finding about the errors of a campaign beyond the instrument's independent noise.

    Args:
        kind: ``step`` of base or instrument, ``drift``, ``correlated`` in time, ``scatter`` of joints, ``noise`` larger
            than common instruments', ``change`` during the campaign of anything else, ``missing``
            effects of the arm.
        size_m: how large it is at the measured points (m).
        supported: whether repeated poses or the stated instrument show it, and its size is common.
        data: ``between``, the ids of the rows between which it happened, where it is an event; what its phrase needs.

    Returns:
        A check that failed where nothing supports the finding.
    """
    return Check(f"finding.{kind}", "noted" if supported else "failed", data={"size_m": size_m, **data})


def shared_error_findings(
    found: Identification,
    rows: Measurements,
    shared: ErrorModel | None,
    adequacy: Check,
    labels: NDArray[np.int_],
) -> list[Check]:
    """Findings from estimated shared errors and from the estimated size of the noise.

    Args:
        shared: errors beside the instrument's that were estimated from the residuals; None where none were.
        labels: ``(n,)`` one a configuration; rows that share one are repeats.
    """
    if found.residual_sigma_m < _FLOOR_M:
        return []
    repeated = adequacy.name == "lack_of_fit.repeats" and adequacy.outcome == "passed"
    findings = list[Check]()
    if shared is not None:
        findings += [finding("step", move.size_m, between=(move.before, move.after)) for move in shared.moves]
        findings += _findings_over_time(shared, revisited=repeated and _revisited(rows, labels))
        if shared.scatter_rad:  # what the stated noise covers is the instrument's
            stated = found.sigma_given and adequacy.outcome != "failed"
            findings.append(_scatter(found, rows, shared.scatter_rad, covered=repeated or stated))
    sigma = found.sigma_m if shared is None else shared.independent_m
    if not found.sigma_given and sigma > COMMON_NOISE_M and not repeated:
        findings.append(finding("noise", sigma))
    return findings


def _findings_over_time(shared: ErrorModel, *, revisited: bool) -> list[Check]:
    """Findings of drift and of correlated errors; the white noise that was stated covers neither.

    Args:
        revisited: whether repeats show what time does, and passed the test of lack of fit.
    """
    findings = list[Check]()
    if shared.drift_m:
        fine = revisited and shared.drift_m < _COMMON_DRIFT_M
        whole_m = 2 * float(np.sqrt(3)) * shared.drift_m  # from its beginning to its end, of all three axes
        findings.append(finding("drift", whole_m, supported=fine))
    if shared.autocorrelated_m:
        fine = revisited and shared.autocorrelated_m < _COMMON_DRIFT_M
        findings.append(finding("correlated", shared.autocorrelated_m, supported=fine, correlation=shared.carry))
    return findings


def _scatter(found: Identification, rows: Measurements, scatter_rad: float, *, covered: bool) -> Check:
    """Finding of joint scatter, with the error that it makes of a point (m, root mean square)."""
    inputs = rows.inputs(found.model.conditions)
    slopes = by_joint_positions(found.model, inputs, found.values, rows.joints.shape[1])
    size_m = scatter_rad * float(np.sqrt(np.nanmean((slopes**2).sum(axis=(2, 3)))))
    return finding("scatter", size_m, supported=covered and size_m < COMMON_SCATTER_M, scatter_rad=scatter_rad)


class _LikeliestChange(NamedTuple):
    """The likeliest of the changes that were scanned.

    Attributes:
        what: the names of what moves.
        p: the chance of as large a change at any row, where nothing changed.
        time: when it happened, between two rows.
        columns: ``(n, m, c)`` whitened derivatives by what moves.
    """

    what: tuple[str, ...]
    p: float
    time: float
    columns: Array


def changes_in_time(found: Identification, observed: Observations, rows: Measurements) -> list[Check]:
    """Return the likeliest change during the campaign, where one is significant: at most one finding.

    F tests of whitened rows for each row at which it may have happened: the base's place and direction at once, each
    tool point, each joint's zero, the size of the arm; of its steady growth; and of the mean square of the errors
    before and after. The level is that of the whole scan (Bonferroni).

    Args:
        observed: the fitted rows, weighted as they were, without estimated shared errors.
    """
    times = row_times(rows)
    if (some := evenly(len(rows), _MAX_SCANNED_POSES)) is not None:
        observed, rows, times = observed.take(some), rows[some], times[some]
    # the linear problem, and the columns of what may change in it
    linear = linearized(found.model, observed, found.values, found.fit.free, found.extra_residuals)
    white = np.concatenate([linear.jacobian, linear.residual[..., None]], axis=2)[: linear.poses]
    within, changing = linear.everywhere(), _changing(found, linear, observed, rows)
    # the likeliest step, change of the errors' size, and steady growth
    step, scanned = _likeliest_step(white, changing, times)
    size = _change_of_size(within, times)
    what_grows = next(what for what in changing if "size" in what)  # a joint that moves points alike is named beside it
    growth = _steady_growth(within, changing[what_grows], times)
    # the most significant of them, at the level of the whole scan
    candidates = list[tuple[float, Callable[[], Check]]]()
    if growth is not None:
        moved_m = growth[1] / observed.typical_weight
        candidates.append((growth[0], partial(_change, rows, _ends(times), moved_m, what=what_grows)))
    if step is not None:
        candidates.append((step.p, partial(_step_finding, found, linear, observed, white, rows, times, step)))
    if size is not None:
        size_m, details = size.ratio * found.residual_sigma_m, {"ratio": size.ratio, "grows": size.grows}
        candidates.append((size.p, partial(_change, rows, rows_around(times, size.time), size_m, **details)))
    p, likeliest = min(candidates, key=lambda candidate: candidate[0], default=(1.0, None))
    return [likeliest()] if likeliest is not None and p < CHANGE_IN_TIME / (2 + scanned) else []


def _ends(times: Array) -> tuple[int, int]:
    """Return the first and the last row in time."""
    return int(np.argmin(times)), int(np.argmax(times))


def _change(rows: Measurements, between: tuple[int, int], size_m: float, **data: Any) -> Check:
    """Finding of a change between two rows."""
    before, after = (rows.ids[i] for i in between)
    return finding("change", size_m, between=(before, after), **data)


def _step_finding(
    found: Identification,
    linear: LinearizedFit,
    observed: Observations,
    white: Array,
    rows: Measurements,
    times: Array,
    step: _LikeliestChange,
) -> Check:
    """Finding of a step, with how far it moved the points."""
    moved_m = _size_of(found, linear, observed, white, step.columns, times, step.time)
    return _change(rows, rows_around(times, step.time), moved_m, what=step.what)


def _likeliest_step(
    white: Array, changing: Mapping[tuple[str, ...], Array], times: Array
) -> tuple[_LikeliestChange | None, int]:
    """Return the likeliest step of anything that may change, and how many such things were scanned.

    Args:
        white: ``(n, m, f + 1)`` whitened derivatives by the fitted parameters and, last, residuals.
    """
    steps = [
        _LikeliestChange(what, scan.p, scan.change.time, columns)
        for what, columns in changing.items()
        if (scan := likeliest_change(white, columns, times)) is not None
    ]
    return min(steps, key=lambda step: step.p, default=None), len(steps)


def _revisited(rows: Measurements, labels: NDArray[np.int_]) -> bool:
    """Find a pose that was measured again after half of the campaign, so that its repeats show what time does."""
    times = row_times(rows)
    session = session_of(times)
    for each in np.unique(session):
        here = session == each
        span = np.ptp(times[here])
        for label in np.unique(labels[here]):
            if np.ptp(times[here & (labels == label)]) >= _TIME_SPAN_OF_REPEATS * span > 0:
                return True
    return False


def _changing(
    found: Identification, linear: LinearizedFit, observed: Observations, rows: Measurements
) -> Mapping[tuple[str, ...], Array]:
    """Whitened derivatives ``(n, m, c)`` by what may change at once, by the names of what moves."""
    model, joints = found.model, rows.joints.shape[1]
    points, jacobian = model.observe(observed.inputs, found.values)
    middle = np.nanmean(points, axis=(0, 1))
    # the base moves and turns
    shifts = np.broadcast_to(np.eye(3), (*points.shape[:2], 3, 3))
    turns = np.stack([np.cross(axis, points - middle) for axis in np.eye(3)], axis=-1)
    columns: dict[tuple[str, ...], Array] = {("base",): linear.rows_of(observed, np.concatenate([shifts, turns], -1))}
    # the arm grows about its base
    base = [model.names.index(f"base.{axis}") for axis in "xyz" if f"base.{axis}" in model.names]
    growth = points - (found.values[base] if len(base) == 3 else middle)
    columns["size",] = linear.rows_of(observed, growth[..., None])
    # a tool point moves
    for target in targets_of(model.parameters):
        of_target = [i for i, name in enumerate(model.names) if name.startswith(f"tool.{target}.")]
        if len(of_target) == 3:
            columns[f"tool.{target}",] = linear.rows_of(observed, jacobian[..., of_target])
    # a joint's zero moves: that of the first is a turn of the base, that of the last a move of a tool point
    slopes = linear.rows_of(observed, by_joint_positions(model, observed.inputs, found.values, joints))
    for joint, name in enumerate(rows.joint_names):
        _add_joint(columns, f"joint.{name}", slopes[..., [joint]])
    return columns


def _add_joint(columns: dict[tuple[str, ...], Array], name: str, column: Array) -> None:
    """Add a joint's zero, beside what moves the points alike if there is such a thing."""
    same = next((what for what, others in columns.items() if _spans(others, column)), None)
    if same is None:
        columns[name,] = column
    else:
        columns[*same, name] = columns.pop(same)


def _steady_growth(within: SubsetFit, columns: Array, times: Array) -> tuple[float, float] | None:
    """Test a growth proportional to the time within each session; None where the rows cannot show one.

    Returns:
        Its p-value, and the whitened root mean square move of points from the first row to the last.

    Args:
        columns: ``(poses, m, 1)`` whitened derivatives by the relative size of the arm.
    """
    # time within each session, about its mean
    session, since = session_of(times), np.zeros(len(times))
    for each in np.unique(session):
        rows = session == each
        since[rows] = times[rows] - times[rows].mean()
    # the column of the growth rate, beside the fitted parameters
    linear, span = within.linear, float(np.ptp(since))
    column = np.zeros_like(linear.residual)
    column[: linear.poses] = since[:, None] * columns[..., 0]
    beside_fit = within.residuals(column)
    dof, column_squares = within.dof - 1, float((beside_fit**2).sum())
    if dof < 1 or column_squares <= _SPANNED * float((column**2).sum()):
        return None
    # F test of what it explains
    product, squares = float((beside_fit * linear.residual).sum()), float((linear.residual**2).sum())
    explained = product**2 / column_squares
    p = f_sf(explained / (max(squares - explained, 1e-300) / dof), 1, dof)
    # the whitened move from the first row to the last
    count = max(int(linear.mask[: linear.poses].sum()), 1)
    return float(p), abs(product / column_squares) * span * float(np.sqrt(3 * (columns**2).sum() / count))


def _spans(columns: Array, own: Array) -> bool:
    """Decide whether one column ``(n, m, 1)`` is a linear combination of others ``(n, m, c)``."""
    flat, wanted = columns.reshape(-1, columns.shape[2]), own.ravel()
    left = wanted - flat @ np.linalg.lstsq(flat, wanted, rcond=None)[0]
    return bool(np.linalg.norm(left) <= _SPANNED * np.linalg.norm(wanted))


@dataclass(frozen=True)
class _ChangeOfSize:
    """A change of the size of the errors.

    Attributes:
        time: when it happened, between two rows.
        p: the chance of as large a ratio at any candidate, where nothing changed.
        ratio: of the larger size to the smaller.
        grows: whether the errors after it are the larger ones.
    """

    time: float
    p: float
    ratio: float
    grows: bool


def _change_of_size(within: SubsetFit, times: Array) -> _ChangeOfSize | None:
    """Return the likeliest change of the errors' size; None where there are too few rows for one.

    Squares of a pose, over what the fit leaves of it, before against after: F with as many degrees of freedom as both
    have, of the larger over the smaller, times two and times the candidates.
    """
    # squares and their degrees of freedom, summed in the order of time
    linear = within.linear
    left, squares = within.left()[: linear.poses], linear.residual[: linear.poses] ** 2
    mask = linear.mask[: linear.poses]
    total, freedom = (np.where(mask, each, 0.0).sum(axis=1) for each in (squares, left))
    order = np.argsort(times, kind="stable")
    sums, dofs = np.cumsum(total[order]), np.cumsum(freedom[order])
    ordered, count = times[order], len(order)
    # the first rows after a change that leave enough on both sides
    starts = np.arange(_MIN_ROWS_EACH_SIDE, count - _MIN_ROWS_EACH_SIDE + 1)
    starts = starts[ordered[starts] > ordered[starts - 1]] if len(starts) else starts
    if not len(starts) or dofs[-1] < 2 * _MIN_ROWS_EACH_SIDE:
        return None
    # F tests of the larger over the smaller mean square, and the likeliest change
    before, after = sums[starts - 1], sums[-1] - sums[starts - 1]
    dof = dofs[starts - 1], dofs[-1] - dofs[starts - 1]
    ratio = np.maximum(after / dof[1], 1e-300) / np.maximum(before / dof[0], 1e-300)
    p = np.where(
        ratio >= 1,
        f_sf(np.maximum(ratio, 1.0), dof[1], dof[0]),
        f_sf(np.maximum(1 / ratio, 1.0), dof[0], dof[1]),
    )
    best = int(np.argmin(p))
    larger = max(ratio[best], 1 / ratio[best])
    if larger < _MIN_VARIANCE_RATIO:
        return None
    time = float(ordered[starts[best] - 1 : starts[best] + 1].mean())
    chance = min(1.0, 2 * float(p[best]) * len(starts))
    return _ChangeOfSize(time, chance, float(np.sqrt(larger)), bool(ratio[best] >= 1))


def _size_of(
    found: Identification,
    linear: LinearizedFit,
    observed: Observations,
    white: Array,
    columns: Array,
    times: Array,
    time: float,
) -> float:
    after = (times > time)[:, None, None] * columns
    fitted = np.concatenate([white[..., :-1], after], axis=2).reshape(-1, white.shape[2] - 1 + columns.shape[2])
    solution = np.linalg.lstsq(fitted, white[..., -1].ravel(), rcond=None)[0][-columns.shape[2] :]
    moved = (columns @ solution)[times > time] / observed.typical_weight
    count = max(int(linear.mask[: linear.poses][times > time].sum()), 1)
    return float(np.sqrt(3 * (moved**2).sum() / count))
