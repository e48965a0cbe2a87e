"""The rows at which the anchor of a cable was moved, from the lengths alone: binary segmentation of the rows.

With nominal links and the target and the offset fitted, the length L of the cable to an anchor a is linear in a and
a'a (trilateration): (p'p - L^2) / 2L = (2 p'a - a'a) / 2L, in metres along the cable. The cost of a segment of rows
is the least squares of that. Rows are cut where the cost falls most, with target and offset fitted anew each time.
The number of sessions is chosen by Schwarz's criterion (1978) with his penalty times a margin, as the errors of
nominal links correlate the residuals of neighbouring rows; a cut that a later one made needless is removed. Moves
that are not large beside the nominal model's errors are therefore not detected.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.identify import fit_base_and_tool
from lab.calibration.observations.fixtures import FIXTURE, Fixtures
from lab.core.measurements import Measurements
from lab.core.se3 import Array

__all__ = ["found_sessions", "with_sessions"]

LEAST_ROWS = 15  # of a session: a few bad rows are not one
MOST_SESSIONS = 10
MARGIN = 8.0  # times Schwarz's criterion
PARAMETERS = 5  # that a change adds: a, a'a, and its row
FAR = 5.0  # standard deviations from which on a row is bad, if it is alone
ALONE = 1 / 3  # of the rows around it, as many as a session has at least: more of them are a session


def found_sessions(model: Fixtures, data: Measurements, nominal: Array) -> tuple[int, ...]:
    """The rows at which a new anchor begins, the first 0.

    Args:
        model: of a cable with one anchor for all rows.
        data: the lengths, in the order in which they were measured.
        nominal: ``(p,)`` nominal parameters of the arm.
    """
    n, starts = len(data), [0]
    best: tuple[float, list[int], Array, Array] | None = None
    while len(starts) < MOST_SESSIONS:
        left, rows = _trilateration(model, data, nominal, starts)
        criterion = n * np.log(max(_total(starts, n, left, rows), 1e-300)) + len(starts) * _penalty(n)
        if best is None or criterion < best[0]:
            best = criterion, starts, left, rows
        split = _best_split(starts, left, rows)
        if split is None:
            break
        starts = sorted([*starts, split])
    assert best is not None
    _, starts, left, rows = best
    while (weakest := _weakest(starts, left, rows)) is not None:
        starts = [start for start in starts if start != weakest]
    return tuple(starts)


def with_sessions(data: Measurements, starts: tuple[int, ...]) -> Measurements:
    """The measurements with sessions ``1``, ``2``, … that begin at these rows."""
    number = np.searchsorted(starts, np.arange(len(data)), side="right")
    return replace(data, sessions=tuple(str(i) for i in number.tolist()))


def _trilateration(model: Fixtures, data: Measurements, nominal: Array, starts: list[int]) -> tuple[Array, Array]:
    """Left sides ``(n,)`` and rows ``(n, 4)`` of the module's equations about the mean point; zero for bad rows.

    Target and offset are those that fit with an anchor for each session, without the bad rows.
    """
    number = (np.searchsorted(starts, np.arange(len(data)), side="right") - 1).astype(np.float64)
    numbers = tuple(range(len(starts)))
    observation = replace(model, numbers=numbers, labels=tuple(str(i) for i in numbers))
    data = replace(data, conditions={**data.conditions, FIXTURE: number})
    inputs, weights = data.inputs(observation.conditions), np.ones((len(data), 1))
    good = np.ones(len(data), dtype=np.bool_)
    for _ in range(2):
        observed = Observations(inputs[good], data.points[good], weights[good])
        values = fit_base_and_tool(observation, observed, observation.nominal(nominal))
        good = ~_bad((data.points - observation.points(inputs, values))[:, 0, 0])
    size = len(model.arm.names)
    points = model.arm.points(inputs[:, :-1], values[:size])[:, 0]
    points = points - points.mean(axis=0)
    length = data.points[:, 0] - values[size : observation.first].sum()
    left = ((points**2).sum(axis=1) - length[:, 0] ** 2) / (2 * length[:, 0])
    rows = np.column_stack([points, -0.5 * np.ones(len(points))]) / length
    return np.where(good, left, 0.0), rows * good[:, None]


def _bad(residual: Array) -> NDArray[np.bool_]:
    """``(n,)``: rows whose residual ``(n,)`` is large while those of the rows around them are not."""
    spread = 1.4826 * np.median(np.abs(residual - np.median(residual)))
    far = np.abs(residual) > FAR * spread
    around = np.convolve(far, np.ones(LEAST_ROWS), mode="same") / LEAST_ROWS
    return np.asarray(far & (around < ALONE))


def _costs(left: Array, rows: Array) -> Array:
    """Sums of squares ``(n,)`` of the first one, two, and so on rows, each with an anchor of its own."""
    moments = np.cumsum(rows[:, :, None] * rows[:, None, :], axis=0) + 1e-9 * np.eye(rows.shape[1])
    right, squares = np.cumsum(rows * left[:, None], axis=0), np.cumsum(left**2)
    return np.asarray(squares - (right * np.linalg.solve(moments, right[..., None])[..., 0]).sum(axis=1))


def _split_of(left: Array, rows: Array) -> tuple[int, float]:
    """The best row to cut at, and the cost that remains; 0 and the whole cost if there are too few rows."""
    ahead, back = _costs(left, rows), _costs(left[::-1], rows[::-1])[::-1]
    cuts = np.arange(LEAST_ROWS, len(left) - LEAST_ROWS + 1)
    if not len(cuts):
        return 0, float(ahead[-1])
    total = ahead[cuts - 1] + back[cuts]
    return int(cuts[np.argmin(total)]), float(total.min())


def _best_split(starts: list[int], left: Array, rows: Array) -> int | None:
    """The cut that lowers the cost most; None where all sessions are too short for one."""
    best: tuple[float, int] | None = None
    for a, b in zip(starts, [*starts[1:], len(left)], strict=True):
        cut, cost = _split_of(left[a:b], rows[a:b])
        gain = _total([a], b, left, rows) - cost
        if cut and (best is None or gain > best[0]):
            best = gain, a + cut
    return None if best is None else best[1]


def _weakest(starts: list[int], left: Array, rows: Array) -> int | None:
    """The start whose removal raises the cost least, where the criterion prefers it removed; None for none."""
    n = len(left)
    whole = max(_total(starts, n, left, rows), 1e-300)
    without = {start: _total([i for i in starts if i != start], n, left, rows) for start in starts[1:]}
    if not without:
        return None
    weakest = min(without, key=lambda start: without[start])
    kept = n * np.log(without[weakest] / whole) > _penalty(n)
    return None if kept else weakest


def _penalty(rows: int) -> float:
    """What a session must lower ``rows`` log(cost) by."""
    return MARGIN * PARAMETERS * float(np.log(rows))


def _total(starts: list[int], end: int, left: Array, rows: Array) -> float:
    """The cost of these sessions, the last of which ends before ``end``."""
    return float(sum(_costs(left[a:b], rows[a:b])[-1] for a, b in zip(starts, [*starts[1:], end], strict=True)))
