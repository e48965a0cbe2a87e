"""Measure one arm with several sensors in one fit: points, poses, contacts and pictures as rows of one model.

Each row holds the readings of one sensor, as numbers of their own; a row of a file that holds readings of two sensors
becomes two rows. Noises are compared by their ratios, which are given, or estimated from the residuals as variance
components, one for each sensor and kind of number (Foerstner 1979).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from lab.calibration.fit_options import FitOptions
from lab.calibration.gauss_newton import Observations
from lab.calibration.identification import Identification, component_variances, identify
from lab.calibration.observation import Observation, UnsizedObservation, WeighsPriors, observation_of
from lab.calibration.sensor import SensorTerms
from lab.calibration.weights import Noise
from lab.core import se3
from lab.core.errors import LabError, option_name
from lab.core.measurements import FIXTURE, Measurements, joined
from lab.core.se3 import Array
from lab.core.units import MM, Unit
from lab.formats.measurement_csv import ObservedColumns
from lab.kinematics.model import Model
from lab.kinematics.parameter import Parameter, indices_of_groups, names_of
from lab.kinematics.serial.axes_to_dh import Truth
from lab.kinematics.serial.serial_arm import SerialArm
from lab.noise.instruments import Instrument
from lab.sensors.fixtures import Fixtures
from lab.sensors.full_pose import Poses
from lab.sensors.sensor_options import FitInputs, SensorOptions, VirtualSetup
from lab.sensors.sensor_registry import JOINED, sensor_named
from lab.sensors.size import LEAST_NOISE
from lab.sensors.tip import longest_link, with_tip
from lab.sensors.virtual_sensor import SimulatedReadings, VirtualSensor
from lab.simulation.tracking import VirtualMeasurement
from lab.simulation.true_robot import TrueRobot

__all__ = ["Combined", "CombinedSensor", "combined_sensor"]

SENSOR = FIXTURE + " sensor"  # condition: number of the sensor that a row is of
_ROUNDS, _SETTLED = 6, 0.01  # of the ratios' iteration, and the relative change that ends it
_EXACT = 1e-12  # residuals below this have no noise to be compared


@runtime_checkable
class OnTips(Protocol):
    """A model with parameters of parts that the arm's tips carry, as full poses and cameras have."""

    @property
    def in_world(self) -> tuple[int, ...]:
        """Indices of its own parameters that no tip carries, in their order of preference."""

    @property
    def carried(self) -> tuple[int, ...]:
        """Indices of its own parameters of what tips carry."""


@dataclass(frozen=True)
class _Share:
    """What one sensor has of a combined model.

    Attributes:
        observation: of the sensor alone.
        number: of the sensor, among all.
        columns: its observed numbers, among all: k things of d numbers each.
        own: indices of its own parameters among all; the arm's are the first.
    """

    observation: Observation
    number: int
    columns: tuple[int, int]
    first: int
    own: slice

    @property
    def kinds(self) -> int:
        """Number of noises that are told apart: of a pose, those of positions and of the rotation, which is last."""
        return 2 if isinstance(self.observation, Poses) else 1

    @property
    def there(self) -> slice:
        return slice(self.first, self.first + self.columns[0] * self.columns[1])

    def values(self, values: Array, size: int) -> Array:
        """Return the sensor's parameters: the arm's, and its own."""
        return np.concatenate([values[:size], values[self.own]])


@dataclass(frozen=True)
class Combined:
    """One arm as several sensors observe it.

    Observed are single numbers, ``(n, K, 1)``: those of the first sensor, then those of the second, and so on.

    Attributes:
        arm: the arm, measured by points.
        parts: the observation of each sensor; None of one without rows.
        shapes: k things of d numbers each, of each sensor.
        ratios: noise of each sensor's unit where that of the first is 1.
        in_frame: whether positions in the instrument's frame are observed: else the base is at the origin.
        typical: root mean square of 1 / ``units`` over the observed numbers.
        sigma: noise of a number of typical weight by which priors of the sensors weigh.
        parameters: the arm's, then each sensor's own.
        names: of the parameters.
    """

    arm: Model
    parts: tuple[Observation | None, ...]
    shapes: tuple[tuple[int, int], ...]
    ratios: tuple[float, ...]
    in_frame: bool
    typical: float = 1.0
    sigma: float = LEAST_NOISE
    parameters: tuple[Parameter, ...] = field(init=False, repr=False)
    names: tuple[str, ...] = field(init=False)
    shares: tuple[_Share, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        parameters, shares, first = list(self.arm.parameters), list[_Share](), 0
        for number, (part, shape) in enumerate(zip(self.parts, self.shapes, strict=True)):
            if part is not None:
                own = part.model.parameters[len(self.arm.parameters) :]
                at = slice(len(parameters), len(parameters) + len(own))
                shares.append(_Share(part, number, shape, first, at))
                parameters += own
            first += shape[0] * shape[1]
        object.__setattr__(self, "parameters", tuple(parameters))
        object.__setattr__(self, "names", names_of(parameters))
        object.__setattr__(self, "shares", tuple(shares))

    @property
    def model(self) -> Self:
        """This model, which defines its own observation."""
        return self

    @property
    def targets(self) -> tuple[str, ...]:
        """One name for each observed number."""
        named = [f"{i + 1}.{j + 1}" for i, (k, d) in enumerate(self.shapes) for j in range(k * d)]
        return tuple(f"number {name}" for name in named)

    @property
    def conditions(self) -> tuple[str, ...]:
        """Those of all sensors, then the number of the sensor."""
        named = [name for share in self.shares for name in share.observation.model.conditions]
        return (*dict.fromkeys((*self.arm.conditions, *named)), SENSOR)

    @property
    def placed(self) -> tuple[str, ...]:
        """The groups that some sensor places."""
        return tuple(dict.fromkeys(group for share in self.shares for group in share.observation.placed))

    @property
    def units(self) -> Array:
        """``(K,)``: the noise of each number where that of the first sensor's unit is 1."""
        found = np.ones(sum(k * d for k, d in self.shapes))
        for share in self.shares:
            units = self.ratios[share.number] * share.observation.units
            found[share.there] = np.repeat(units, share.columns[1])
        return found

    @property
    def groups(self) -> list[int]:
        """``(K,)``: numbers of one sensor and one unit share a group, whose variance is estimated."""
        found = np.zeros(sum(k * d for k, d in self.shapes), dtype=np.int_)
        count = 0
        for share in self.shares:
            which = np.arange(share.columns[0]) >= share.columns[0] - share.kinds + 1
            found[share.there] = count + np.repeat(which, share.columns[1])
            count += share.kinds
        return found.tolist()

    @property
    def positions(self) -> int:
        """Zero: numbers are observed one by one."""
        return 0

    def within(self, data: Measurements) -> Self:
        """Return the model with the parameters that these rows depend on."""
        parts = list(self.parts)
        rows = np.flatnonzero(data.seen.any(axis=1))
        sensor = data.conditions[SENSOR]
        for share in self.shares:
            own = rows[sensor[rows] == share.number]
            parts[share.number] = share.observation.within(self._part(share, data[own])) if len(own) else None
        return replace(self, parts=tuple(parts))

    def _part(self, share: _Share, data: Measurements) -> Measurements:
        """Return rows of one sensor as it observes them."""
        k, d = share.columns
        targets = share.observation.model.targets
        return replace(data, targets=targets, points=data.points[:, share.there, 0].reshape(len(data), k, d))

    def nominal(self, values: Array) -> Array:
        """Return the arm's parameters, with those of each sensor without initial values."""
        size, found = len(self.arm.names), np.zeros(len(self.names))
        found[:size] = values[:size]
        for share in self.shares:
            found[share.own] = share.observation.nominal(values[:size])[size:]
        return found

    def _inputs(self, share: _Share, inputs: Array) -> Array:
        joints = inputs.shape[1] - len(self.conditions)
        at = [joints + self.conditions.index(name) for name in share.observation.model.conditions]
        return inputs[:, [*range(joints), *at]]

    def _rows(self, inputs: Array) -> list[tuple[_Share, NDArray[np.int_]]]:
        sensor = inputs[:, -1].real
        found = [(share, np.flatnonzero(sensor == share.number)) for share in self.shares]
        return [(share, rows) for share, rows in found if len(rows)]

    def observe(self, inputs: Array, values: Array) -> tuple[Array, Array]:
        """Return numbers ``(n, K, 1)`` and their derivatives ``(n, K, 1, p)``; zero those of other sensors."""
        size, count = len(self.arm.names), sum(k * d for k, d in self.shapes)
        dtype = np.result_type(inputs, values)
        points = np.zeros((len(inputs), count, 1), dtype=dtype)
        jacobian = np.zeros((len(inputs), count, 1, len(self.names)), dtype=dtype)
        for share, rows in self._rows(inputs):
            model = share.observation.model
            found, slopes = model.observe(self._inputs(share, inputs[rows]), share.values(values, size))
            points[rows, share.there, 0] = found.reshape(len(rows), -1)
            slopes = slopes.reshape(len(rows), -1, slopes.shape[-1])
            jacobian[rows, share.there, 0, :size] = slopes[..., :size]
            jacobian[rows, share.there, 0, share.own] = slopes[..., size:]
        return points, jacobian

    def points(self, inputs: Array, values: Array) -> Array:
        """Return numbers ``(n, K, 1)``; zero those of other sensors."""
        size, count = len(self.arm.names), sum(k * d for k, d in self.shapes)
        points = np.zeros((len(inputs), count, 1), dtype=np.result_type(inputs, values))
        for share, rows in self._rows(inputs):
            found = share.observation.model.points(self._inputs(share, inputs[rows]), share.values(values, size))
            points[rows, share.there, 0] = found.reshape(len(rows), -1)
        return points

    def column_priority(self) -> tuple[int, ...]:
        """Return what stands in the world, then the arm's order with what its tip carries; the base last without frame.

        Beside positions in the instrument's frame the base is identified first, as it is with these alone.
        """
        base, size = indices_of_groups(self.arm.parameters, ["base"]), len(self.arm.names)
        before, carried = list[int](), list[int]()
        for share in self.shares:
            own = share.observation.model
            shift = share.own.start - size
            if isinstance(own, OnTips):
                before += [i + shift for i in own.in_world]
                carried += [i + shift for i in own.carried]
            else:
                before += range(share.own.start, share.own.stop)
        order = with_tip(self.arm, carried, unsized=self.unsized)
        if self.in_frame:
            return (*before, *order)
        return (*before, *(i for i in order if i not in base), *base)

    @property
    def unsized(self) -> bool:
        """Check whether no sensor shows the arm's size."""
        parts = [share.observation for share in self.shares]
        return all(isinstance(part, UnsizedObservation) and part.unsized for part in parts)

    @property
    def scale_link(self) -> int:
        """Index of the link that stays nominal where nothing shows the arm's size."""
        return longest_link(self.arm)

    def rank_point(self, values: Array) -> Array:
        """Return ``values`` for decisions on rank; of an arm in contact its own choice of poses and fixtures."""
        size, found = len(self.arm.names), values.copy()
        found[:size] = self.arm.rank_point(values[:size])
        for share in self.shares:
            own = share.observation.model.rank_point(share.values(values, size))
            if isinstance(share.observation, Fixtures) and share.observation.contact:
                base = [*indices_of_groups(self.arm.parameters, ["base"])]
                arm = own[:size].copy()
                arm[base] = found[base]
                found[:size] = arm
            found[share.own] = own[size:]
        return found

    def structure_joints(self, count: int, rng: np.random.Generator) -> Array:
        """Draw inputs of each sensor in turn."""
        joints = None
        parts = list[Array]()
        for share in self.shares:
            model = share.observation.model
            drawn = model.structure_joints(count, rng)
            joints = drawn.shape[1] - len(model.conditions)
            wide = np.zeros((len(drawn), joints + len(self.conditions)))
            wide[:, :joints] = drawn[:, :joints]
            for i, name in enumerate(model.conditions):
                wide[:, joints + self.conditions.index(name)] = drawn[:, joints + i]
            wide[:, -1] = share.number
            parts.append(wide)
        return np.stack(parts, axis=1).reshape(-1, parts[0].shape[1])

    def initial_guess(self, observed: Observations, values: Array) -> Array:
        """Place what each sensor places: base and tool by measured positions first, then the rest."""
        size, found = len(self.arm.names), values.copy()
        for share, rows in sorted(self._rows(observed.inputs), key=lambda each: -each[0].observation.positions):
            k, d = share.columns
            points = observed.points[rows][:, share.there, 0].reshape(len(rows), k, d)
            own = Observations(self._inputs(share, observed.inputs[rows]), points, np.ones(points.shape[:2]))
            placed = share.observation.initial_guess(own, share.values(found, size))
            found[:size], found[share.own] = placed[:size], placed[size:]
        return found

    def extra_residuals(self, values: Array) -> tuple[Array, Array]:
        """Return what the sensors know beside their readings, each weighted as its own unit."""
        size, residuals, rows = len(self.arm.names), list[Array](), list[Array]()
        for share in self.shares:
            more, slopes = share.observation.extra_residuals(share.values(values, size))
            weight = 1.0 / (self.ratios[share.number] * self.typical)
            wide = np.zeros((len(more), len(self.names)))
            wide[:, :size], wide[:, share.own] = slopes[:, :size], slopes[:, size:]
            residuals.append(weight * more)
            rows.append(weight * wide)
        return np.concatenate([np.empty(0), *residuals]), np.concatenate([np.empty((0, len(self.names))), *rows])

    def weighed(self, sigma: float) -> Self:
        """Return the model whose sensors' priors weigh by this noise of a number of typical weight."""
        parts = list(self.parts)
        for share in self.shares:
            if isinstance(share.observation, WeighsPriors):
                ratio = self.ratios[share.number]
                parts[share.number] = share.observation.weighed(sigma * self.typical * ratio)
        return replace(self, parts=tuple(parts), sigma=sigma)

    def errors(self, data: Measurements, values: Array) -> Array:
        """Return lengths ``(n, K)`` in m as each sensor counts them, in the column of the first number; else NaN.

        Of rows that name no sensor, and so hold points, ``(n, k)``.
        """
        size = len(self.arm.names)
        if SENSOR not in data.conditions:
            of_points = next(share for share in self.shares if share.observation.positions)
            return of_points.observation.errors(data, of_points.values(values, size))
        found = np.full(data.points.shape[:2], np.nan)
        for share in self.shares:
            rows = np.flatnonzero(data.conditions[SENSOR] == share.number)
            if len(rows):
                own = share.observation.errors(self._part(share, data[rows]), share.values(values, size))
                at = share.first + share.columns[1] * np.arange(own.shape[1])
                found[np.ix_(rows, at)] = own
        return found

    def cv_groups(self, data: Measurements) -> None:
        """Return None: readings of one configuration are held out together."""


@dataclass(frozen=True)
class CombinedSensor(VirtualSensor):
    """Several sensors in one fit.

    Attributes:
        parts: the sensors.
        ratios: noise of each one's unit where that of the first is 1; None to estimate them from the residuals.
        sigma_m: noise of the first one's unit, where an instrument gives it.
    """

    parts: tuple[VirtualSensor, ...]
    ratios: tuple[float, ...] | None = None
    sigma_m: float | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Rebuild it by the names of its parts."""
        return _rebuilt, (tuple(self.name.split(JOINED)), self.parts, self.ratios, self.sigma_m)

    @classmethod
    def configured(cls, options: SensorOptions, fit: FitInputs) -> Self:
        """Return the sensors with their options; options of points go to the sensors of points.

        Raises:
            LabError: a validation file is given, or an option makes no sense for its sensor.
        """
        fit.refuse_validation_file(cls.name)
        if getattr(options, "method", "global") != "global":
            raise LabError(
                f"{option_name('method')} sequential is of {option_name('observe')} pose alone; leave it out"
            )
        others = FitInputs(prior=fit.prior)
        of_points = [kind for kind in cls.combines if kind.in_instrument_frame]
        owner = of_points[0] if of_points else cls.combines[0]
        parts = tuple(kind.configured(options, fit if kind is owner else others) for kind in cls.combines)
        sigmas = [sigma for part in parts if (sigma := _given_m(part, fit.noise_mm)) is not None]
        if len(sigmas) < len(parts):
            return cls(parts)
        return cls(parts, tuple(sigma / sigmas[0] for sigma in sigmas), sigmas[0])

    def targets(self, data: Measurements) -> tuple[str, ...]:
        """Return the targets that some sensor needs."""
        return tuple(dict.fromkeys(target for part in self.parts for target in part.targets(data)))

    def with_files(self, data: Measurements, folder: Path) -> Measurements:
        """Return the measurements with what each sensor finds in other files."""
        for part in self.parts:
            data = part.with_files(data, folder)
        return data

    def noise(self, given: Noise) -> Noise:
        """Return the noise of the first sensor's unit where all are given; else none, so that it is estimated."""
        return replace(given, instrument=None, sigma_m=self.sigma_m if self.ratios is not None else None)

    def noises(self, model: Model, sigma_m: float) -> Mapping[Unit, float]:
        """Return the noise of each unit: of several sensors with the same one, that of the first."""
        assert isinstance(model, Combined)
        found = dict[Unit, float]()
        for part, ratio in zip(self.parts, model.ratios, strict=True):
            found.setdefault(part.terms.unit, ratio * sigma_m)
        return found

    def weighted_by(self, instrument: Instrument, data: Measurements) -> Self:
        """Return the sensors with an instrument's noise for the first, where the others' noises are given."""
        points, rest = data.points[data.seen], [_given_m(part, None) for part in self.parts[1:]]
        if instrument.kind == "exact" or not len(points) or any(sigma is None for sigma in rest):
            return self
        sigma = float(np.sqrt(np.trace(instrument.covariance(points), axis1=-2, axis2=-1).mean() / 3))
        parts = (self.parts[0].weighted_by(instrument, data), *self.parts[1:])
        ratios = (1.0, *(each / sigma for each in rest if each is not None))
        return replace(self, parts=parts, ratios=ratios, sigma_m=sigma)

    def rows(self, data: Measurements) -> NDArray[np.bool_]:
        """Return the rows ``(n,)`` with a reading of some sensor."""
        return np.asarray(np.any(self._rows_each(data), axis=0))

    def _rows_each(self, data: Measurements) -> list[NDArray[np.bool_]]:
        """Return the rows ``(n,)`` of each sensor; of one that reads any row, those of no other."""
        found = [part.rows(data) for part in self.parts]
        needs_none = [bool(kind.columns.observed == "plane") for kind in self.combines]
        taken = np.zeros(len(data), dtype=np.bool_)
        for rows, every in zip(found, needs_none, strict=True):
            if not every:
                taken |= rows
        return [rows & ~taken if every else rows for rows, every in zip(found, needs_none, strict=True)]

    def observation(self, arm: Model, data: Measurements, nominal: Array) -> tuple[Model, Measurements]:
        """Return the combined model, and a row for each reading of a sensor.

        Raises:
            LabError: a sensor has no rows, or its columns or cells make no sense.
        """
        at = {name: row for row, name in enumerate(data.ids)}
        wide = _with_targets(data, arm.targets)
        models, tables, rows = list[Observation](), list[Measurements](), list[NDArray[np.int_]]()
        for part, own in zip(self.parts, self._rows_each(data), strict=True):
            if not own.any():
                raise LabError(
                    f"no row holds a {part.terms.reading}: leave {part.name} out of {option_name('observe')}"
                )
            model, table = part.observation(arm, wide[own], nominal)
            table = table.with_points()
            models.append(observation_of(model))
            tables.append(table)
            rows.append(np.array([at[name] for name in table.ids], dtype=np.int_))
        shapes = tuple((table.points.shape[1], table.points.shape[2]) for table in tables)
        ratios = self.ratios or (1.0,) * len(self.parts)
        combined = Combined(arm, tuple(models), shapes, ratios, self.in_instrument_frame)
        order = np.argsort(np.concatenate(rows), kind="stable")
        base = data[np.concatenate(rows)[order]]
        observed = replace(
            base,
            targets=combined.targets,
            points=_side_by_side(tables, shapes)[order],
            sigma_m=self._sigmas(tables, ratios)[order],
            conditions={**base.conditions, **_columns(combined, tables, base, order)},
            warnings=tuple(dict.fromkeys((*data.warnings, *(text for table in tables for text in table.warnings)))),
        )
        return replace(combined, typical=_typical(combined, observed)), observed

    def _sigmas(self, tables: list[Measurements], ratios: tuple[float, ...]) -> Array:
        """Return the noise ``(n,)`` of the rows in the first sensor's unit: given by all, or by none."""
        if self.ratios is None:
            return np.full(sum(map(len, tables)), np.nan)
        return np.concatenate([table.sigma_m / ratio for table, ratio in zip(tables, ratios, strict=True)])

    def balanced(self, model: Model, data: Measurements, nominal: Array, options: FitOptions) -> Model:
        """Return the model with the ratios of all noises estimated from its residuals, where they are not given."""
        assert isinstance(model, Combined)
        if self.ratios is not None:
            return model
        options = replace(options, solve=None, estimator=None)
        for _ in range(_ROUNDS):
            found = identify(model, data, nominal, Noise(), options)
            variances = component_variances(model.within(data), found, data, model.within(data).groups)
            if not np.isfinite(variances).all() or (np.sqrt(variances) < _EXACT).any():
                return model
            changes = np.sqrt(variances / variances[0])
            model = _rescaled(model, changes)
            model = replace(model, typical=_typical(model, data))
            if np.abs(changes - 1).max() < _SETTLED:
                break
        return model

    def weighted_as(self, model: Model) -> Self:
        """Return the sensors with the ratios of this model."""
        assert isinstance(model, Combined)
        parts = tuple(
            part if own is None else part.weighted_as(own.model)
            for part, own in zip(self.parts, model.parts, strict=True)
        )
        return replace(self, parts=parts, ratios=model.ratios)

    def simulate(self, poses: VirtualMeasurement, setup: VirtualSetup) -> SimulatedReadings:
        """Measure with each sensor in turn, in as many poses each."""
        found = [
            part.simulate(replace(poses, rng=rng), setup)
            for part, rng in zip(self.parts, poses.rng.spawn(len(self.parts)), strict=True)
        ]
        tables = [each.measurements for each in found]
        placed = {owner: values for each in found for owner, values in each.placed.items()}
        return SimulatedReadings(_below(tables), np.concatenate([each.bad for each in found]), placed)

    def observed_truth(
        self, truth: Truth, found: Identification, real: TrueRobot, placed: Mapping[str, Array]
    ) -> Truth | None:
        """Return the truth with what each sensor places, in the instrument's frame; in the base's without positions."""
        model = found.model
        assert isinstance(model, Combined)
        if not isinstance(truth.arm, SerialArm):
            return None
        values, T = truth.values.copy(), np.eye(4)
        if not self.in_instrument_frame:
            T = se3.inverse(truth.arm.T_tracker_frame0(values))
            values[:6] = 0.0
        known = dict[str, float]()
        for part, own in zip(self.parts, model.parts, strict=True):
            if own is not None:
                known |= part.placed_truth(own.model, truth, real, placed, T)
        return replace(truth, values=values, effects={**truth.effects, **known})


def _given_m(part: VirtualSensor, noise_mm: float | None) -> float | None:
    """Return the given noise of a sensor's unit; None where it is not given."""
    return part.noise(Noise(sigma_m=None if noise_mm is None else float(MM.to_si(noise_mm)))).sigma_m


def _with_targets(data: Measurements, targets: tuple[str, ...]) -> Measurements:
    """Return the measurements with these targets; NaN for those that were not measured."""
    points = np.full((len(data), len(targets), 3), np.nan)
    for k, target in enumerate(targets):
        if target in data.targets:
            points[:, k] = data.points[:, data.targets.index(target)]
    return replace(data, targets=targets, points=points)


def _side_by_side(tables: list[Measurements], shapes: tuple[tuple[int, int], ...]) -> Array:
    """Return the numbers ``(n, K, 1)`` of all rows; NaN those of other sensors."""
    points = np.full((sum(map(len, tables)), sum(k * d for k, d in shapes), 1), np.nan)
    row = column = 0
    for table, (k, d) in zip(tables, shapes, strict=True):
        points[row : row + len(table), column : column + k * d, 0] = table.points.reshape(len(table), -1)
        row, column = row + len(table), column + k * d
    return points


def _columns(
    model: Combined, tables: list[Measurements], base: Measurements, order: NDArray[np.int_]
) -> dict[str, Array]:
    """Return the conditions that the sensors add; zero in the rows of other sensors."""
    added = {name for share in model.shares for name in share.observation.model.conditions} - set(model.arm.conditions)
    found = {}
    for name in added:
        own = [table.conditions[name] if name in table.conditions else np.zeros(len(table)) for table in tables]
        found[name] = np.concatenate(own)[order]
    found[SENSOR] = np.repeat(np.arange(len(tables), dtype=np.float64), [len(table) for table in tables])[order]
    return found


def _typical(model: Combined, data: Measurements) -> float:
    units = np.broadcast_to(model.units, data.points.shape[:2])[data.seen]
    return float(np.sqrt(np.mean(1 / units**2)))


def _rescaled(model: Combined, changes: Array) -> Combined:
    """Return the model with units changed by group."""
    parts, ratios, group = list(model.parts), list(model.ratios), 0
    for share in model.shares:
        own = share.observation
        ratios[share.number] *= float(changes[group])
        if isinstance(own, Poses):
            parts[share.number] = replace(own, ratio=own.ratio * float(changes[group + 1] / changes[group]))
        group += share.kinds
    return replace(model, parts=tuple(parts), ratios=tuple(ratios))


def _below(tables: list[Measurements]) -> Measurements:
    """Return the rows of several tables below each other, measured one after the other."""
    targets = tuple(dict.fromkeys(target for table in tables for target in table.targets))
    rows = joined([_with_targets(table, targets) for table in tables])
    return replace(rows, ids=tuple(map(str, range(len(rows)))), visits=None)


def combined_sensor(names: tuple[str, ...]) -> type[CombinedSensor]:
    """Return the sensor that combines these.

    Raises:
        LabError: one is unknown, named twice, or two read the same points.
    """
    return _combined(names, tuple(sensor_named(name) for name in names))


@cache
def _combined(names: tuple[str, ...], kinds: tuple[type[VirtualSensor], ...]) -> type[CombinedSensor]:
    if len(set(names)) < len(names):
        raise LabError(f"{option_name('observe')} {JOINED.join(names)}: name each sensor once")
    if {"points", "pose"} <= set(names):
        raise LabError(f"{option_name('observe')} {JOINED.join(names)}: poses hold the points too; leave points out")
    kinds = tuple(sorted(kinds, key=lambda kind: not kind.in_instrument_frame))
    in_frame = any(kind.in_instrument_frame for kind in kinds)
    own = {
        "__module__": __name__,
        "name": JOINED.join(names),
        "combines": kinds,
        "terms": _joined_terms([kind.terms for kind in kinds]),
        "columns": _joined_columns([kind.columns for kind in kinds], JOINED.join(names)),
        "in_instrument_frame": in_frame,
        "read_by": kinds[0].read_by or kinds[0].name,
        "setup": tuple(dict.fromkeys(name for kind in kinds for name in kind.setup)),
        "several_a_pose": any(kind.several_a_pose for kind in kinds),
        "finds_poses": any(kind.finds_poses for kind in kinds),
    }
    return type("CombinedSensor", (CombinedSensor,), own)


def _joined_terms(terms: list[SensorTerms]) -> SensorTerms:
    return SensorTerms(
        measured=_listed([own.measured for own in terms]),
        reading=" or ".join(own.reading for own in terms),
        error="error",
        placed=_listed(list(dict.fromkeys(own.placed for own in terms))),
        names_targets=False,
        unit=terms[0].unit,
    )


def _joined_columns(columns: list[ObservedColumns], observed: str) -> ObservedColumns:
    return ObservedColumns(
        positions=any(own.positions for own in columns),
        orientations=any(own.orientations for own in columns),
        numbers=tuple(dict.fromkeys(name for own in columns for name in own.numbers)),
        texts=tuple(dict.fromkeys(name for own in columns for name in own.texts)),
        observed=observed,
    )


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _rebuilt(names: tuple[str, ...], *parts: Any) -> CombinedSensor:
    return combined_sensor(names)(*parts)
