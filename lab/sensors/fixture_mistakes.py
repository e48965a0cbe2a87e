"""Miss readings at fixtures by a nominal arm that is placed robustly, and find what may be wrong with them.

Target and fixtures have no nominal values. Each fixture is placed by the few of its rows that most others are near to
(least median of squares: Rousseeuw 1984). Then all are fitted by Gauss-Newton steps, from several such starts at once,
to the rows near the majority of their fixture alone. Links stay nominal.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lab.calibration.guess import columns_of
from lab.core.measurements import FIXTURE, Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.diagnosis.hypothesis import Hypothesis
from lab.kinematics.model import Model
from lab.sensors.tip import tip_rotations

if TYPE_CHECKING:
    from lab.sensors.fixtures import Fixtures, FixtureSensor, PredictedReadings

__all__ = [
    "LENGTH_UNITS",
    "PlacedFixtures",
    "exchanged_fixtures",
    "moved_fixtures",
    "placed_fixtures",
    "scaled_readings",
]

LENGTH_UNITS = (("cm", 10.0), ("inches", 25.4), ("m", 1e3), ("a tenth of mm", 0.1), ("µm", 1e-3))  # to mm
_FITTED_ROWS = 150  # of very many
_STEPS = 8  # of Gauss-Newton
_NEAR = 2.5  # times the median of a fixture's rows: a row farther off is left out
_ORDINARY_M = 2e-3  # miss of a nominal arm: a row as near is like the others
_LEAST_M = 1e-6
_CAP = 3.0  # times the median: a larger miss counts as this
_DAMPING = 1e-8  # of the mean square slope
_LONGEST_STEP = 0.7  # m and rad
_CLEARLY = 3.0  # times as near to another fixture, and times the ordinary miss
_MOST_FIXTURES = 40  # among which another one of a row is searched


@dataclass(frozen=True)
class PlacedFixtures:
    """A nominal arm with its target and fixtures placed by the majority of the readings.

    Attributes:
        model: of the fixtures that have enough rows.
        rows: ``(m,)`` number in the file of each row that they have.
        index: ``(m,)`` its fixture.
        residuals: ``(m, d)`` m.
        misses: ``(n,)`` root mean square residual of each row of the file (m): NaN without a reading, infinite where
            its fixture has too few.
        gap_at: gives residuals ``(m, d)`` of all rows at one fixture.
    """

    model: "Fixtures"
    rows: NDArray[np.int_]
    index: NDArray[np.int_]
    residuals: Array
    misses: Array
    gap_at: Callable[[int], Array]

    @cached_property
    def ordinary_m(self) -> float:
        """Miss of a row like most others (m)."""
        return max(float(np.median(_sizes(self.residuals))), _LEAST_M)


def placed_fixtures(sensor: "FixtureSensor", arm: Model, data: Measurements, nominal: Array) -> PlacedFixtures:
    """Place target and fixtures robustly, with links as they are.

    Args:
        arm: measured by one point.
        nominal: ``(p,)`` nominal parameters of ``arm``.

    Raises:
        LabError: the readings cannot be used.
    """
    numbered = {**data.conditions, _ROW: np.arange(len(data), dtype=np.float64)}
    alone = replace(data, targets=(), points=np.empty((len(data), 0, 3)), conditions=numbered)
    model, observed = sensor.observation(arm, alone, nominal)
    observed = observed[observed.used]
    rows = observed.conditions[_ROW].astype(np.int_)
    task = _Placing.of(model, observed, nominal)  # type: ignore[arg-type]
    values = task.best()
    residuals = task.residuals(values[None], rates=False)[0][0]
    # a reading at a fixture with too few rows cannot be explained
    readable = sensor.rows(data) & data.used
    misses = np.where(readable, np.inf, np.nan)
    misses[rows] = _sizes(residuals)
    return PlacedFixtures(task.model, rows, task.index, residuals, misses, partial(task.gap_at, values))


_ROW = FIXTURE + "'s row"


def _sizes(residuals: Array) -> Array:
    """Return the root mean square of the numbers of each residual ``(..., d)``."""
    return np.asarray(np.sqrt((residuals**2).mean(axis=-1)))


@dataclass(frozen=True)
class _Placing:
    """Least squares of target and fixtures with a nominal arm: values are target, what fixtures share, and fixtures.

    Attributes:
        origins, axes: ``(n, 3)`` and ``(n, 3, 3)`` of the frame that carries the target.
        index: ``(n,)`` fixture of each row.
        measured: ``(n, d)`` m.
        rows: ``(n, r)`` what else is known of each.
        shared: number of shared values that are free.
    """

    model: "Fixtures"
    origins: Array
    axes: Array
    index: NDArray[np.int_]
    measured: Array
    rows: Array
    shared: int
    start: Array

    @staticmethod
    def of(model: "Fixtures", observed: Measurements, nominal: Array) -> "_Placing":
        inputs = observed.inputs(model.conditions)
        of_arm = inputs[:, : inputs.shape[1] - len(model.row_conditions)]
        tool = list(columns_of(model.arm, ("tool",)))
        points = model.arm.points(of_arm, nominal)
        axes = tip_rotations(model.arm, of_arm, nominal, points)
        origins = points[:, 0] - axes @ nominal[tool]
        number = {number: i for i, number in enumerate(model.numbers)}
        index = np.array([number[int(each)] for each in inputs[:, -1]], dtype=np.int_)
        free = sum(each.group in model.placed for each in model.shared)
        rows = inputs[:, of_arm.shape[1] : -1]
        return _Placing(model, origins, axes, index, observed.points[:, 0], rows, free, nominal[tool])

    def take(self, rows: NDArray[np.int_]) -> "_Placing":
        parts = {name: getattr(self, name)[rows] for name in ("origins", "axes", "index", "measured", "rows")}
        return replace(self, **parts)

    @property
    def _size(self) -> int:
        return 3 + self.shared + len(self.model.numbers) * len(self.model.axes)

    def _fixtures(self, values: Array) -> Array:
        """Return the fixtures ``(b, f, k)`` of values ``(b, q)``."""
        return values[:, 3 + self.shared :].reshape(len(values), len(self.model.numbers), len(self.model.axes))

    def residuals(self, values: Array, *, rates: bool = True) -> tuple[Array, Array]:
        """Return residuals ``(b, n, d)`` and, where wanted, slopes of the readings ``(b, n, d, q)`` at ``(b, q)``."""
        b, (n, d), k = len(values), self.measured.shape, len(self.model.axes)
        fixtures = self._fixtures(values)[:, self.index]
        found = self._predicted(values, fixtures)
        left = self.measured - found.observed.reshape(b, n, d)
        if not rates:
            return left, np.empty(0)
        slopes = np.zeros((b, n, d, self._size))
        slopes[..., :3] = found.by_point.reshape(b, n, d, 3) @ self.axes
        slopes[..., 3 : 3 + self.shared] = found.by_shared.reshape(b, n, d, -1)[..., : self.shared]
        columns = 3 + self.shared + k * self.index[:, None] + np.arange(k)
        by_fixture = found.by_fixture.reshape(b, n, d, k)
        slopes[:, np.arange(n)[:, None, None], np.arange(d)[:, None], columns[:, None]] = by_fixture
        return left, slopes

    def _predicted(self, values: Array, fixtures: Array) -> "PredictedReadings":
        """Predict the readings of all rows, at fixtures ``(b, n, k)``, one batch after another."""
        b, n = fixtures.shape[:2]
        points = self.origins + (self.axes @ values[:, None, :3, None])[..., 0]
        shared = np.repeat(values[:, 3 : 3 + self.shared], n, axis=0)
        many = np.tile(self.rows, (b, 1))
        return self.model.predict(points.reshape(-1, 3), fixtures.reshape(b * n, -1), many, shared)

    def gap_at(self, values: Array, fixture: int) -> Array:
        """Return the residuals ``(n, d)`` of all rows at one fixture."""
        fixtures = np.broadcast_to(
            self._fixtures(values[None])[:, fixture, None], (1, len(self.index), len(self.model.axes))
        )
        return np.asarray(self.measured - self._predicted(values[None], fixtures).observed)

    def best(self) -> Array:
        """Return the values ``(q,)`` that most rows agree on."""
        few, rng = self._thinned(), rng_for(0, "null")
        values = few._starts(rng)
        for _ in range(_STEPS):
            left, slopes = few.residuals(values)
            values = values + few._steps(values, left, slopes, few._near(left))
        sizes = _sizes(few.residuals(values, rates=False)[0])
        cap = _CAP * max(float(np.median(sizes, axis=1).min()), _ORDINARY_M)
        costs = (np.minimum(np.nan_to_num(sizes, nan=np.inf), cap) ** 2).sum(axis=1)
        return np.asarray(values[int(np.argmin(costs))])

    def _thinned(self) -> "_Placing":
        """Return about as many rows as are fitted, evenly from each fixture."""
        each = max(_FITTED_ROWS // len(self.model.numbers), 3 * self.model.least_rows)
        picked = []
        for i in range(len(self.model.numbers)):
            own = np.flatnonzero(self.index == i)
            picked.append(own[np.unique(np.linspace(0, len(own) - 1, min(each, len(own))).round().astype(np.int_))])
        return self.take(np.sort(np.concatenate(picked)))

    def _starts(self, rng: np.random.Generator) -> Array:
        """Return values ``(s, q)``: the target where it is nominally, and fixtures by all rows, by the best few, ..."""
        located = [self.take(np.flatnonzero(self.index == i))._located(rng) for i in range(len(self.model.numbers))]
        fixed = np.concatenate([self.start, np.zeros(self.shared)])
        count = self.model.starts
        return np.stack(
            [np.concatenate([fixed, *(each[min(i, len(each) - 1)] for each in located)]) for i in range(count)]
        )

    def _located(self, rng: np.random.Generator) -> list[Array]:
        """Return places ``(k,)`` of the fixture of all rows: by all, then by few, those near to most others first."""
        points, n = self.origins + self.axes @ self.start, len(self.index)
        few = min(self.model.least_rows, n)
        found = list[Array]()
        for _ in range(self.model.draws if n > few else 1):
            rows = rng.permutation(n)[:few]
            found.append(self.model.located(points[rows], self.measured[rows], self.rows[rows]))
        # how far half of the rows are from each (Rousseeuw 1984)
        b, many = len(found), np.repeat(np.stack(found), n, axis=0)
        predicted = self.model.predict(np.tile(points, (b, 1)), many, np.tile(self.rows, (b, 1))).observed
        sizes = _sizes(self.measured - predicted.reshape(b, n, -1))
        order = np.argsort(np.median(np.nan_to_num(sizes, nan=np.inf), axis=1), kind="stable")
        return [self.model.located(points, self.measured, self.rows), *(found[i] for i in order)]

    def _near(self, left: Array) -> NDArray[np.bool_]:
        """Return the rows ``(b, n)`` near the majority of their fixture."""
        sizes, near = _sizes(left), np.zeros(left.shape[:2], dtype=np.bool_)
        for i in range(len(self.model.numbers)):
            own = self.index == i
            middle = np.median(sizes[:, own], axis=1, keepdims=True)
            near[:, own] = sizes[:, own] <= _NEAR * np.maximum(middle, _ORDINARY_M)
        return near

    def _steps(self, values: Array, left: Array, slopes: Array, near: NDArray[np.bool_]) -> Array:
        """Return Gauss-Newton's steps ``(b, q)`` on some rows, with what else the model knows of its parameters."""
        b, q = values.shape
        rows = np.where(near[:, :, None, None], slopes, 0.0).reshape(b, -1, q)
        normal = np.swapaxes(rows, 1, 2) @ rows
        right = (np.swapaxes(rows, 1, 2) @ left.reshape(b, -1, 1))[..., 0]
        for i in range(b):
            residuals, known = self.model.extra_residuals(self._whole(values[i]))
            own = known[:, self._columns]
            normal[i] += own.T @ own
            right[i] += own.T @ residuals
        size = np.trace(normal, axis1=1, axis2=2)[:, None, None] / q
        step = np.linalg.solve(normal + _DAMPING * size * np.eye(q), right[..., None])[..., 0]
        return np.asarray(np.clip(np.nan_to_num(step), -_LONGEST_STEP, _LONGEST_STEP))

    @cached_property
    def _columns(self) -> list[int]:
        """Columns of the values among the model's parameters."""
        size = len(self.model.arm.names)
        fixtures = range(self.model.first, len(self.model.names))
        return [*columns_of(self.model.arm, ("tool",)), *range(size, size + self.shared), *fixtures]

    def _whole(self, values: Array) -> Array:
        """Return parameters ``(p,)`` of the model with these values, and an arm of zeros."""
        whole = np.zeros(len(self.model.names))
        whole[self._columns] = values
        return whole


def scaled_readings(data: Measurements, column: str, name: str) -> Iterator[Hypothesis]:
    """Yield other units of a column of lengths."""

    def scaled(rows: Measurements, factor: float) -> Measurements:
        return replace(rows, conditions={**rows.conditions, column: rows.conditions[column] * factor})

    for unit, factor in LENGTH_UNITS:
        undo = partial(scaled, factor=factor)
        yield Hypothesis(name, (unit,), len(LENGTH_UNITS), undo, data=(("factor", factor), ("column", column)))


def exchanged_fixtures(sensor: "FixtureSensor", at: PlacedFixtures, data: Measurements) -> Iterator[Hypothesis]:
    """Yield rows that are at another fixture than their label says."""
    count, sizes = len(at.model.numbers), _sizes(at.residuals)
    if not 1 < count <= _MOST_FIXTURES:
        return
    others = np.stack([_sizes(at.gap_at(i)) for i in range(count)], axis=1)
    nearest = others.argmin(axis=1)
    far = sizes > _CLEARLY * np.maximum(others.min(axis=1), at.ordinary_m)
    if not far.any() or far.mean() > 0.5:
        return
    labels = {int(at.rows[i]): at.model.labels[int(nearest[i])] for i in np.flatnonzero(far)}
    name, ids = f"{at.model.group}_exchanged", tuple(data.ids[row] for row in labels)
    price = (len(sizes) * count) ** len(labels)
    yield Hypothesis(name, ids, price, partial(sensor.relabelled, labels=labels))


def moved_fixtures(sensor: "FixtureSensor", at: PlacedFixtures, data: Measurements) -> Iterator[Hypothesis]:
    """Yield fixtures that moved from a row on: the row before which their residuals step most."""
    least = at.model.least_rows
    for i, label in enumerate(at.model.labels):
        own = np.flatnonzero(at.index == i)
        if len(own) < 2 * least:
            continue
        # mean residuals before and from each cut
        total, cuts = np.cumsum(at.residuals[own], axis=0), np.arange(least, len(own) - least + 1)
        before = total[cuts - 1] / cuts[:, None]
        after = (total[-1] - total[cuts - 1]) / (len(own) - cuts)[:, None]
        step = np.linalg.norm(after - before, axis=1)
        best = int(np.argmax(step**2 * cuts * (len(own) - cuts)))
        if step[best] < _CLEARLY * at.ordinary_m:
            continue
        rows = at.rows[own[cuts[best] :]]
        labels = {int(row): f"{label} moved" for row in rows}
        of = (label or at.model.group, data.ids[int(rows[0])])
        undo = partial(sensor.relabelled, labels=labels)
        yield Hypothesis(f"{at.model.group}_moved", of, len(at.rows), undo, data=(("step_m", float(step[best])),))
