"""Measure with a draw-wire: lengths of a cable from a target of the tool to anchors whose positions are fitted.

Where a file names no sessions, the rows at which the anchor was moved are found from the lengths alone, by binary
segmentation. With nominal links and the target and the offset fitted, the length L of the cable to an anchor a is
linear in a and a'a (trilateration): (p'p - L^2) / 2L = (2 p'a - a'a) / 2L, in metres along the cable. The cost of a
segment of rows is the least squares of that. Rows are cut where the cost falls most, with target and offset fitted
anew each time. The number of sessions is chosen by Schwarz's criterion (1978) with his penalty times a margin, as the
errors of nominal links correlate the residuals of neighbouring rows; a cut that a later one made needless is removed.
Moves that are not large beside the nominal model's errors are therefore not detected.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.identification import fit_base_and_tool
from lab.calibration.observation import Points
from lab.calibration.sensor import SensorTerms
from lab.core.errors import LabError
from lab.core.measurements import FIXTURE, Measurements, rows_called
from lab.core.se3 import Array, inverse, transform
from lab.core.units import MM
from lab.formats.measurement_csv import ObservedColumns
from lab.kinematics.model import Model
from lab.kinematics.parameter import Parameter, placed_parameters
from lab.sensors.contact import DrawnContacts, FixtureSimulation
from lab.sensors.fixtures import NONE, FixtureRows, Fixtures, FixtureSensor, PredictedReadings, refuse_blank
from lab.sensors.sensor_options import VirtualSetup

__all__ = ["Cable", "CableSensor", "found_sessions", "trilaterated", "with_sessions"]

_MIN_ROWS = 15  # of a session: a few outliers are not one
_MAX_SESSIONS = 10
_MARGIN = 8.0  # times Schwarz's criterion
_PARAMETERS = 5  # that a change adds: a, a'a, and its row
_OUTLIER = 5.0  # standard deviations from which on a row is an outlier, if it is alone
_ALONE = 1 / 3  # of the rows around it, as many as a session has at least: more of them are a session
_OFFSET_M = 0.01  # standard deviation of the length at which the instrument reads zero
_AWAY = 1.5  # times the farthest point of the arm: where anchors are, on a circle about the base
_LOWEST, _HIGHEST = -0.3, 0.5  # heights of anchors, as multiples of that distance
_CONTRADICTION = 10.0  # times the median distance: no noise does that
_CONTRADICTION_M = 5e-3  # more than a nominal model's error
_PLACING = 10  # rows that place base and tool with room to spare


@dataclass(frozen=True)
class Cable(Fixtures):
    """Lengths of a cable from a target to anchors: ``|p - anchor| + offset`` (m).

    The offset is the cable's between its guide and the point whose distance a zero reading means.
    """

    group: ClassVar[str] = "anchor"
    least_rows: ClassVar[int] = 4
    contact: ClassVar[bool] = False

    @property
    def shared(self) -> tuple[Parameter, ...]:
        """The offset."""
        return placed_parameters("cable", "cable", ("offset",), scaled=True)

    def predict(self, points: Array, fixtures: Array, rows: Array = NONE, shared: Array = NONE) -> PredictedReadings:
        """Return lengths ``(n, 1)``; they grow along the cable."""
        cable = points - fixtures
        length = np.sqrt((cable * cable).sum(axis=1, keepdims=True))
        along = (cable / length)[:, None]
        return PredictedReadings(
            length + shared.sum(axis=-1, keepdims=True), along, -along, np.ones((len(points), 1, shared.shape[-1]))
        )

    def located(self, points: Array, observed: Array, rows: Array = NONE) -> Array:
        """Return the anchor ``(3,)`` by trilateration."""
        return trilaterated(points, observed[:, 0])


def trilaterated(points: Array, lengths: Array) -> Array:
    """Return the anchor ``(3,)`` at these distances ``(n,)`` from points ``(n, 3)``, all m.

    About the mean, |p|^2 - L^2 = 2 p'a - a'a is linear in a and a'a.
    """
    centre = points.mean(axis=0)
    near = points - centre
    system = np.column_stack([2 * near, -np.ones(len(near))]) / lengths[:, None]
    right = ((near**2).sum(axis=1) - lengths**2) / lengths
    return np.asarray(centre + np.linalg.lstsq(system, right)[0][:3])


@dataclass(frozen=True)
class CableSensor(FixtureSensor):
    """Lengths of a cable; a session of the file is an anchor."""

    name: ClassVar[str] = "cable"
    terms: ClassVar[SensorTerms] = SensorTerms(
        measured="lengths of a cable",
        reading="length of the cable",
        error="error of the cable's length",
        placed="tool and anchors",
        names_targets=False,
    )
    columns: ClassVar[ObservedColumns] = ObservedColumns(positions=False, numbers=("cable_mm",), observed="cable")
    model: ClassVar[type[Fixtures]] = Cable
    reading: ClassVar[str] = "cable_mm"
    finds_poses: ClassVar[bool] = False

    def with_sessions(self, arm: Model, data: Measurements, nominal: Array) -> Measurements:
        """Return the measurements with a session for each anchor found in the lengths, if the file names none."""
        if any(data.sessions):
            return data
        model, observed = self.observation(arm, data, nominal)
        assert isinstance(model, Cable)
        found = found_sessions(model, observed, nominal)
        if len(found) == 1:
            return data
        starts = (0, *rows_called(data, [observed.ids[start] for start in found[1:]]))
        rows = ", ".join(data.ids[start] for start in starts[1:])
        moved = (
            f"the anchor seems to have moved before rows {rows}: {len(starts)} anchors; name them in a column session"
        )
        return replace(with_sessions(data, starts), warnings=(*data.warnings, moved))

    def fixture_rows(self, data: Measurements) -> FixtureRows:
        """Return an anchor a session, and the lengths.

        Raises:
            LabError: the lengths are missing, one is not above zero, or a row does not name its session.
        """
        lengths = self.readings(data)
        if (bad := np.flatnonzero(lengths[:, 0] <= 0)).size:
            where = f"{data.where(bad[0])}, column cable_mm"
            raise LabError(f"{where}: a wire's length is above zero; mend it, or leave the cell empty")
        if any(data.sessions):
            refuse_blank(data, "session", data.sessions, Cable.group, self.rows(data))
        return data.sessions, lengths

    def contradictions(self, arm: Model, data: Measurements, nominal: Array) -> tuple[str, ...]:
        """Return warnings of rows whose point, beside the length, is not where their joints put it, farthest first.

        The arm of the points has nominal links, with base and tool fitted.
        """
        if arm.targets != data.targets or data.points.shape[1] == 0 or int(data.seen.sum()) < _PLACING:
            return ()
        observed = Observations(data.inputs(arm.conditions), data.points, np.ones(data.points.shape[:2]))
        values = fit_base_and_tool(Points(arm), observed, nominal)
        distance = np.linalg.norm(data.points - arm.points(observed.inputs, values), axis=2)
        distance = np.where(np.isnan(distance), 0.0, distance).max(axis=1)
        typical = float(np.median(distance[data.seen.any(axis=1)]))
        rows = np.flatnonzero(distance > max(_CONTRADICTION * typical, _CONTRADICTION_M))
        return tuple(
            f"row {data.ids[row]}: its point is {MM.text(float(distance[row]))} from where its joints put it: check "
            "the row (the wire's length alone is fitted)"
            for row in rows[np.argsort(-distance[rows], kind="stable")].tolist()
        )

    def drawn(self, arm: FixtureSimulation, setup: VirtualSetup) -> DrawnContacts:
        """Draw anchors about the arm, to which the cable stays straight; a row is at its anchor's session."""
        points = arm.points(arm.joints)
        anchors = _anchors(arm, points, setup.fixtures)
        offset_m = _OFFSET_M * float(arm.rng.standard_normal())
        number = np.arange(len(points)) * setup.fixtures // len(points)
        lengths = np.linalg.norm(points - anchors[number], axis=1) + offset_m + arm.noise[:, 0]
        placed = {f"anchor.{1 + i}": anchor for i, anchor in enumerate(anchors)} | {"cable": np.array([offset_m])}
        sessions = tuple(str(1 + i) for i in number.tolist())
        return DrawnContacts(arm.joints, None, placed, numbers={"cable_mm": MM.of(lengths)}, sessions=sessions)


def _anchors(arm: FixtureSimulation, points: Array, count: int) -> Array:
    """Draw anchors ``(count, 3)`` m in the instrument's frame, evenly around the base from a random side on."""
    T_tracker_base = arm.T_tracker_base
    reach = float(np.linalg.norm(transform(inverse(T_tracker_base), points), axis=1).max())
    angle = arm.rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(count) / count
    heights = reach * arm.rng.uniform(_LOWEST, _HIGHEST, count)
    return transform(
        T_tracker_base, np.stack([_AWAY * reach * np.cos(angle), _AWAY * reach * np.sin(angle), heights], axis=1)
    )


def found_sessions(model: Fixtures, data: Measurements, nominal: Array) -> tuple[int, ...]:
    """Return the rows at which a new anchor begins, the first 0.

    Args:
        model: of a cable with one anchor for all rows.
        data: the lengths, in the order in which they were measured.
        nominal: ``(p,)`` nominal parameters of the arm.
    """
    n, starts = len(data), [0]
    best: tuple[float, list[int], Array, Array] | None = None
    while len(starts) < _MAX_SESSIONS:
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
    """Return the measurements with sessions ``1``, ``2``, … that begin at these rows."""
    number = np.searchsorted(starts, np.arange(len(data)), side="right")
    return replace(data, sessions=tuple(str(i) for i in number.tolist()))


def _trilateration(model: Fixtures, data: Measurements, nominal: Array, starts: list[int]) -> tuple[Array, Array]:
    """Return left sides ``(n,)`` and rows ``(n, 4)`` of the module's equations about the mean; zero for outliers.

    Target and offset are those that fit with an anchor for each session, without outliers.
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
        good = ~_outliers((data.points - observation.points(inputs, values))[:, 0, 0])
    size = len(model.arm.names)
    points = model.arm.points(inputs[:, :-1], values[:size])[:, 0]
    points = points - points.mean(axis=0)
    length = data.points[:, 0] - values[size : observation.first].sum()
    left = ((points**2).sum(axis=1) - length[:, 0] ** 2) / (2 * length[:, 0])
    rows = np.column_stack([points, -0.5 * np.ones(len(points))]) / length
    return np.where(good, left, 0.0), rows * good[:, None]


def _outliers(residual: Array) -> NDArray[np.bool_]:
    """Return ``(n,)``: rows whose residual ``(n,)`` is large while those of the rows around them are not."""
    spread = 1.4826 * np.median(np.abs(residual - np.median(residual)))
    far = np.abs(residual) > _OUTLIER * spread
    around = np.convolve(far, np.ones(_MIN_ROWS), mode="same") / _MIN_ROWS
    return np.asarray(far & (around < _ALONE))


def _costs(left: Array, rows: Array) -> Array:
    """Return the sums of squares ``(n,)`` of the first one, two, and so on rows, each with an anchor of its own."""
    moments = np.cumsum(rows[:, :, None] * rows[:, None, :], axis=0) + 1e-9 * np.eye(rows.shape[1])
    right, squares = np.cumsum(rows * left[:, None], axis=0), np.cumsum(left**2)
    return np.asarray(squares - (right * np.linalg.solve(moments, right[..., None])[..., 0]).sum(axis=1))


def _split_of(left: Array, rows: Array) -> tuple[int, float]:
    """Return the best row to cut at, and the cost that remains; 0 and the whole cost if there are too few rows."""
    ahead, back = _costs(left, rows), _costs(left[::-1], rows[::-1])[::-1]
    cuts = np.arange(_MIN_ROWS, len(left) - _MIN_ROWS + 1)
    if not len(cuts):
        return 0, float(ahead[-1])
    total = ahead[cuts - 1] + back[cuts]
    return int(cuts[np.argmin(total)]), float(total.min())


def _best_split(starts: list[int], left: Array, rows: Array) -> int | None:
    """Return the cut that lowers the cost most; None where all sessions are too short for one."""
    best: tuple[float, int] | None = None
    for a, b in zip(starts, [*starts[1:], len(left)], strict=True):
        cut, cost = _split_of(left[a:b], rows[a:b])
        gain = _total([a], b, left, rows) - cost
        if cut and (best is None or gain > best[0]):
            best = gain, a + cut
    return None if best is None else best[1]


def _weakest(starts: list[int], left: Array, rows: Array) -> int | None:
    """Return the start whose removal raises the cost least, if the criterion prefers it removed."""
    n = len(left)
    whole = max(_total(starts, n, left, rows), 1e-300)
    without = {start: _total([i for i in starts if i != start], n, left, rows) for start in starts[1:]}
    if not without:
        return None
    weakest = min(without, key=lambda start: without[start])
    kept = n * np.log(without[weakest] / whole) > _penalty(n)
    return None if kept else weakest


def _penalty(rows: int) -> float:
    """Return the least decrease of ``rows`` log(cost) that a session must bring."""
    return _MARGIN * _PARAMETERS * float(np.log(rows))


def _total(starts: list[int], end: int, left: Array, rows: Array) -> float:
    """Return the cost of these sessions, the last of which ends before ``end``."""
    return float(sum(_costs(left[a:b], rows[a:b])[-1] for a, b in zip(starts, [*starts[1:], end], strict=True)))
