"""Where a draw-wire's anchor was moved, from its readings alone: binary segmentation of the rows.

With target and offset fitted and nominal links, the wire's length L to an anchor a is linear in a and a'a
(trilateration): (p'p - L^2) / 2L = (2 p'a - a'a) / 2L, in metres along the wire. A segment of rows costs the
least squares of that; rows are cut where the cost falls most, with target and offset fitted anew each time. Of
all these the number of sessions is Schwarz's (1978), with his penalty times a margin, as wrong links make
residuals alike from row to row; and a cut that a later one made needless goes. So moves that are not large
beside what the drawing is wrong by stay unseen.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.identify import fit_base_and_tool
from lab.calibration.observations.fixture_kinds import Cable
from lab.calibration.observations.fixtures import PLACE
from lab.core.measurements import Measurements
from lab.core.se3 import Array

LEAST_ROWS = 15  # of a session: a few bad rows are not one
MOST_SESSIONS = 10
MARGIN = 8.0  # times Schwarz's criterion
PARAMETERS = 5  # that a change adds: a, a'a, and its row
FAR = 5.0  # standard deviations from which on a row is bad, if it is alone
ALONE = 1 / 3  # of the rows around it, as many as a session has at least: more of them are a session


def found_sessions(model: Cable, data: Measurements, nominal: Array) -> tuple[int, ...]:
    """The rows at which a new anchor begins, the first 0, in the order in which the rows were measured.

    Args:
        model: of ``sighted`` where the file names no session: one anchor for all rows.
        data: with it.
        nominal: the drawing's parameters of the arm.
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
    """The measurements with sessions ``1``, ``2``, … from these rows on."""
    number = np.searchsorted(starts, np.arange(len(data)), side="right")
    return replace(data, sessions=tuple(str(i) for i in number.tolist()))


def _trilateration(model: Cable, data: Measurements, nominal: Array, starts: list[int]) -> tuple[Array, Array]:
    """Left sides ``(n,)`` and rows ``(n, 4)`` of the equations above about the mean point; of bad rows zero.

    Target and offset are those that fit with an anchor for each session, without the bad rows.
    """
    place = (np.searchsorted(starts, np.arange(len(data)), side="right") - 1).astype(np.float64)
    numbers = tuple(range(len(starts)))
    observation = replace(model, numbers=numbers, labels=tuple(str(i) for i in numbers))
    data = replace(data, conditions={**data.conditions, PLACE: place})
    inputs, weights = data.inputs(observation.conditions), np.ones((len(data), 1))
    good = np.ones(len(data), dtype=np.bool_)
    for _ in range(2):
        seen = Observations(inputs[good], data.points[good], weights[good])
        values = fit_base_and_tool(observation, seen, observation.nominal(nominal))
        good = ~_bad((data.points - observation.points(inputs, values))[:, 0, 0])
    size = len(model.arm.names)
    points = model.arm.points(inputs[:, :-1], values[:size])[:, 0]
    points = points - points.mean(axis=0)
    length = data.points[:, 0] - values[size : observation.first].sum()
    left = ((points**2).sum(axis=1) - length[:, 0] ** 2) / (2 * length[:, 0])
    rows = np.column_stack([points, -0.5 * np.ones(len(points))]) / length
    return np.where(good, left, 0.0), rows * good[:, None]


def _bad(residual: Array) -> NDArray[np.bool_]:
    """Rows that are far off while those around them are not."""
    spread = 1.4826 * np.median(np.abs(residual - np.median(residual)))
    far = np.abs(residual) > FAR * spread
    around = np.convolve(far, np.ones(LEAST_ROWS), mode="same") / LEAST_ROWS
    return np.asarray(far & (around < ALONE))


def _costs(left: Array, rows: Array) -> Array:
    """Least squares ``(n,)`` of the first rows, one, two, and so on, each with an anchor of its own."""
    moments = np.cumsum(rows[:, :, None] * rows[:, None, :], axis=0) + 1e-9 * np.eye(rows.shape[1])
    right, squares = np.cumsum(rows * left[:, None], axis=0), np.cumsum(left**2)
    return np.asarray(squares - (right * np.linalg.solve(moments, right[..., None])[..., 0]).sum(axis=1))


def _split_of(left: Array, rows: Array) -> tuple[int, float]:
    """Where rows are best cut in two, and the cost that remains; 0 and the whole cost if they are too few."""
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
    """The beginning of a session whose merging with the one before raises the cost least, if it is not believed."""
    n = len(left)
    whole = max(_total(starts, n, left, rows), 1e-300)
    without = {start: _total([i for i in starts if i != start], n, left, rows) for start in starts[1:]}
    if not without:
        return None
    weakest = min(without, key=lambda start: without[start])
    believed = n * np.log(without[weakest] / whole) > _penalty(n)
    return None if believed else weakest


def _penalty(rows: int) -> float:
    """What a session must lower ``rows`` log(cost) by."""
    return MARGIN * PARAMETERS * float(np.log(rows))


def _total(starts: list[int], end: int, left: Array, rows: Array) -> float:
    """The cost of these sessions, the last of which ends before ``end``."""
    return float(sum(_costs(left[a:b], rows[a:b])[-1] for a, b in zip(starts, [*starts[1:], end], strict=True)))
