"""Measure with a sensor of one's own: its readings are a function of the pose of the tool and of unknown parameters.

A reading h(T, x) depends on the pose T of the frame that carries the tool's target, with its origin at the target, and
on parameters x of the sensor: where an anchor is, how an inclinometer is mounted. The arm's own parameters enter by T:
dh = (dh/dp) dp + (dh/dw) dw + (dh/dx) dx, with the velocity dp of the target and the rotation dw of its frame, which
the arm has in closed form, and derivatives of h by central differences.
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations, fit
from lab.calibration.identification import Identification
from lab.calibration.observation import no_extra_residuals
from lab.calibration.sensor import SensorTerms
from lab.calibration.weights import Noise
from lab.core import se3
from lab.core.errors import LabError, option_name
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import DEGREES, MM, MRAD, Unit
from lab.formats.measurement_csv import ObservedColumns
from lab.kinematics.gauge import STRUCTURE_POSES
from lab.kinematics.model import Model
from lab.kinematics.parameter import (
    Parameter,
    indices_of_groups,
    is_reserved_owner,
    names_of,
    placed_parameters,
)
from lab.kinematics.serial.axes_to_dh import Truth
from lab.kinematics.serial.serial_arm import SerialArm
from lab.kinematics.tree import TreeArm
from lab.sensors.contact import POINT, DrawnContacts, FixtureSimulation
from lab.sensors.sensor_options import FitInputs, SensorOptions, VirtualSetup
from lab.sensors.tip import tip_rates, tip_rotations
from lab.sensors.virtual_sensor import SimulatedReadings, VirtualSensor
from lab.simulation.effects import TrueEffects
from lab.simulation.tracking import VirtualMeasurement, target_rotations
from lab.simulation.true_robot import TrueRobot

__all__ = ["Sensor"]

_UNITS: dict[str, Unit] = {"mm": MM, "mrad": MRAD, "deg": DEGREES}  # at the end of a column's name
_STEP = 1e-5  # of central differences, m or rad; relative for parameters above one


@dataclass(frozen=True)
class Sensor(VirtualSensor):
    """A sensor whose readings are a function of the tool's pose and of unknown parameters.

    Your own is a subclass with a ``name`` and ``readings``; every call with an option ``observe`` takes it. Readings of
    a file are in the columns ``columns_read``, of measurements in memory in their ``conditions``. The base stays
    nominal, as the readings are of poses in its frame; the tool is identified as far as they show it.

    Attributes:
        name: in options, and before the names of its parameters: ``wire.x``.
        parameters: initial values by name, in m; in rad of ``rx``, ``ry``, ``rz`` and of names that end with ``_rad``.
        columns_read: columns of the readings, one a number, whose names end with their unit: ``_mm``, ``_mrad``,
            ``_deg``; by default ``NAME_mm``.
        sigma: noise of a reading (1 sigma, m or rad); None for the instrument's, or to estimate it.
        spread: of the true parameters of a simulated sensor around the initial values (1 sigma, m and rad).

    Example:
        >>> import numpy as np
        >>> import lab
        >>> class Wire(lab.Sensor):
        ...     name = "wire"
        ...     parameters = {"x": 1.0, "y": 0.0, "z": 0.5}  # m: where its anchor may be
        ...     sigma = 20e-6  # m
        ...
        ...     def readings(self, Ts, values):  # m: the distance to the anchor
        ...         return np.linalg.norm(Ts[:, :3, 3] - values, axis=1)
        >>> day = lab.simulate("irb120", poses=80, seed=7, observe=Wire)
        >>> lab.identify(day.measurements, observe=Wire).verdict.word
        'good'
    """

    in_instrument_frame: ClassVar[bool] = False
    parameters: ClassVar[Mapping[str, float]] = {}
    columns_read: ClassVar[tuple[str, ...]] = ()
    sigma: ClassVar[float | None] = None
    spread: ClassVar[float] = 0.02

    def __init_subclass__(cls, **more: Any) -> None:
        """Derive words and columns from the name."""
        super().__init_subclass__(**more)
        name = getattr(cls, "name", "")
        cls.columns_read = cls.columns_read or (f"{name.replace('-', '_')}_mm",)
        suffixes = {column.rpartition("_")[2] for column in cls.columns_read}
        unit = _UNITS.get(min(suffixes), MM)
        cls.columns = ObservedColumns(positions=False, numbers=cls.columns_read, observed=name)
        cls.terms = SensorTerms(
            measured=f"readings of {name}",
            reading=f"reading of {name}",
            error=f"error of a reading of {name}",
            placed=f"tool and {name}",
            names_targets=False,
            unit=unit,
        )

    @abstractmethod
    def readings(self, Ts: Array, values: Array) -> Array:
        """Return the readings ``(n,)``, or ``(n, d)`` of d columns, in m or rad.

        Args:
            Ts: ``(n, 4, 4)`` poses of the frame that carries the target, with its origin at the target (m), in the
                frame of the robot's base.
            values: of the parameters, in their order.
        """

    @classmethod
    def configured(cls, options: SensorOptions, fit: FitInputs) -> Self:
        """Return the sensor, which no instrument weights.

        Raises:
            LabError: an instrument or a validation file is given, or the sensor is named like a part of the arm.
        """
        fit.refuse_those_of_points(cls.name)
        if is_reserved_owner(cls.name):
            raise LabError(f"sensor '{cls.name}': parameters of the arm have this name; give it another")
        if strange := [column for column in cls.columns_read if column.rpartition("_")[2] not in _UNITS]:
            raise LabError(f"sensor '{cls.name}': end the column {strange[0]} with its unit, _{', _'.join(_UNITS)}")
        return cls()

    def targets(self, data: Measurements) -> tuple[str, ...]:
        """Return the target whose pose is read: the first measured one, else ``p1``."""
        return data.targets[:1] or (POINT,)

    def rows(self, data: Measurements) -> NDArray[np.bool_]:
        """Return the rows ``(n,)`` with all readings."""
        return np.asarray(np.isfinite(self._readings_of(data)).all(axis=1))

    def noise(self, given: Noise) -> Noise:
        """Return the noise that is given as a number, else the sensor's own."""
        own = self.sigma is not None and given.sigma_m is None
        return replace(given, instrument=None, sigma_m=self.sigma) if own else given

    def observation(self, arm: Model, data: Measurements, nominal: Array) -> tuple[Model, Measurements]:
        """Return the model of the readings, and the rows that have them.

        Raises:
            LabError: a column is missing.
        """
        if missing := [column for column in self.columns_read if column not in data.conditions]:
            raise LabError(f"column {missing[0]} is missing: {option_name('observe')} {self.name} reads it")
        model = _ReadingsModel(arm, self)
        return model, replace(data, targets=model.targets, points=self._readings_of(data)[:, None])[self.rows(data)]

    def _readings_of(self, data: Measurements) -> Array:
        """Return the readings ``(n, d)`` of a file, m or rad; NaN where there are none."""
        blank = np.full(len(data), np.nan)
        units = [_UNITS[column.rpartition("_")[2]] for column in self.columns_read]
        columns = [data.conditions.get(column, blank) for column in self.columns_read]
        return np.stack([unit.to_si(column) for unit, column in zip(units, columns, strict=True)], axis=1)

    def read(self, points: Array, rotations: Array, values: Array) -> Array:
        """Return the readings ``(n, d)`` at points ``(n, 3)`` and rotations ``(n, 3, 3)``; NaN where these are.

        Raises:
            LabError: there are not as many readings of a pose as columns.
        """
        Ts = se3.pose(rotations, points)
        known = np.isfinite(Ts).all(axis=(1, 2))
        returned = self.readings(Ts[known], values)
        returned = returned[:, None] if returned.ndim == 1 else returned
        if returned.shape[1] != (count := len(self.columns_read)):
            raise LabError(f"sensor '{self.name}': readings returns {returned.shape[1]} a pose; return {count}")
        readings = np.full((len(Ts), count), np.nan)
        readings[known] = returned
        return readings

    def simulate(self, poses: VirtualMeasurement, setup: VirtualSetup) -> SimulatedReadings:
        """Read the true arm's poses in the frame of its base, by a sensor near the initial values.

        Raises:
            LabError: the arm has loops, or other targets than one ``p1`` are to be measured.
        """
        arm = FixtureSimulation.of_one_point(self.name, poses, len(self.columns_read))
        truth = arm.robot.truth(poses.targets)
        if truth is None or not isinstance(truth.arm, SerialArm | TreeArm):
            raise LabError(f"{option_name('observe')} {self.name}: a virtual arm of this kind has no frame of its base")
        values = np.array(list(self.parameters.values()), dtype=np.float64)
        values = values + self.spread * arm.rng.standard_normal(len(values))
        # the frame that carries the target, as the model without effects has it at rest
        target, rest = poses.targets[0], np.zeros((1, poses.joints.shape[1]))
        rigid = arm.robot.with_effects(TrueEffects.none(rest.shape[1]))
        R_last_target = truth.arm.tool(rest, truth.values)[0][0, :3, :3].T @ target_rotations(rigid, rest, target)[0]
        rotations = target_rotations(arm.robot, poses.joints, target, arm.conditions, arm.scatter) @ R_last_target.T
        # in the frame of the true base, which the identification holds at the origin
        T_base_tracker = se3.inverse(truth.arm.T_tracker_frame0(truth.values))
        points = se3.transform(T_base_tracker, arm.points(poses.joints))
        exact = self.read(points, T_base_tracker[:3, :3] @ rotations, values)
        noise = arm.noise if self.sigma is None else self.sigma * arm.rng.standard_normal(exact.shape)
        units = (_UNITS[column.rpartition("_")[2]] for column in self.columns_read)
        numbers = zip(self.columns_read, units, (exact + noise).T, strict=True)
        columns = {column: np.asarray(unit.of(readings)) for column, unit, readings in numbers}
        return arm.readings(DrawnContacts(poses.joints, None, {self.name: values}, numbers=columns))

    def observed_truth(
        self, truth: Truth, found: Identification, real: TrueRobot, placed: Mapping[str, Array]
    ) -> Truth | None:
        """Return the parameters that read as the true ones do, with those that are not identifiable at nominal."""
        model, values = found.model, truth.values.copy()
        values[:6] = 0.0
        known = self.placed_truth(model, truth, real, placed, np.eye(4))
        true = replace(truth, values=values, effects={**truth.effects, **known}).of(model.names)
        # the true readings, fitted by the parameters that these readings can show
        inputs = model.structure_joints(STRUCTURE_POSES, rng_for(0, "structure"))
        exact = Observations(inputs, model.points(inputs, true), np.ones((len(inputs), 1)))
        start, free = found.values.copy(), list(found.base_set.identifiable)
        start[free] = true[free]
        alike, size = fit(model, exact, free, start).values, len(values)
        return replace(truth, values=alike[:size], effects=dict(zip(model.names[size:], alike[size:], strict=True)))

    def placed_truth(
        self, model: Model, truth: Truth, real: TrueRobot, placed: Mapping[str, Array], T_frame_instrument: Array
    ) -> dict[str, float]:
        """Return the sensor's true parameters by their names."""
        names = (f"{self.name}.{symbol}" for symbol in self.parameters)
        return dict(zip(names, placed[self.name].tolist(), strict=True))


@dataclass(frozen=True)
class _ReadingsModel:
    """An arm whose readings are a function of the pose of one target's frame.

    Attributes:
        arm: the arm, measured by one point.
        parameters: the arm's, then the sensor's.
        names: of the parameters.
    """

    arm: Model
    sensor: Sensor
    parameters: tuple[Parameter, ...] = field(init=False, repr=False)
    names: tuple[str, ...] = field(init=False)
    spreads_freely: ClassVar[bool] = True

    def __post_init__(self) -> None:
        own = [_parameter(self.sensor.name, *each) for each in self.sensor.parameters.items()]
        object.__setattr__(self, "parameters", (*self.arm.parameters, *own))
        object.__setattr__(self, "names", names_of(self.parameters))

    @property
    def model(self) -> Self:
        """This model, which defines its own observation."""
        return self

    @property
    def targets(self) -> tuple[str, ...]:
        """The sensor's name, of all its readings."""
        return (self.sensor.name,)

    @property
    def conditions(self) -> tuple[str, ...]:
        """The arm's."""
        return self.arm.conditions

    @property
    def placed(self) -> tuple[str, ...]:
        """The sensor's parameters, and the tool's."""
        return (self.sensor.name, "tool")

    @property
    def units(self) -> Array:
        """``(1,)``: the noise is of a reading, in its own unit."""
        return np.ones(1)

    @property
    def positions(self) -> int:
        """Zero: no position in an instrument's frame is observed."""
        return 0

    def within(self, data: Measurements) -> Self:
        """Return the model: no parameter is of some rows alone."""
        return self

    def nominal(self, values: Array) -> Array:
        """Return the arm's parameters, and the initial values of the sensor's."""
        return np.concatenate([values[: len(self.arm.names)], [*self.sensor.parameters.values()]])

    def initial_guess(self, observed: Observations, values: Array) -> Array:
        """Return the values: the sensor has initial ones."""
        return values

    def extra_residuals(self, values: Array) -> tuple[Array, Array]:
        """Return no further residuals."""
        return no_extra_residuals(self)

    def errors(self, data: Measurements, values: Array) -> Array:
        """Return the lengths ``(n, 1)`` of the readings' errors, m or rad."""
        return np.asarray(np.linalg.norm(self.points(data.inputs(self.conditions), values) - data.points, axis=2))

    def cv_groups(self, data: Measurements) -> None:
        """Return None: repeats of a configuration are held out together."""

    def column_priority(self) -> tuple[int, ...]:
        """Return the sensor's parameters, then the arm's in its order, its base last."""
        base, size = indices_of_groups(self.arm.parameters, ["base"]), len(self.arm.names)
        order = (i for i in self.arm.column_priority() if i not in base)
        return (*range(size, len(self.names)), *order, *base)

    def rank_point(self, values: Array) -> Array:
        """Return the arm's, with the sensor's parameters as they are."""
        size = len(self.arm.names)
        return np.concatenate([self.arm.rank_point(values[:size]), values[size:]])

    def structure_joints(self, count: int, rng: np.random.Generator) -> Array:
        """Return the arm's."""
        return self.arm.structure_joints(count, rng)

    def points(self, inputs: Array, values: Array) -> Array:
        """Return the readings ``(n, 1, d)``, m or rad."""
        size = len(self.arm.names)
        points = self.arm.points(inputs, values[:size])
        rotations = tip_rotations(self.arm, inputs, values[:size], points)
        T_base_instrument = se3.inverse(self._base(values))
        in_base = se3.transform(T_base_instrument, points[:, 0]), T_base_instrument[:3, :3] @ rotations
        return self.sensor.read(*in_base, values[size:])[:, None]

    def observe(self, inputs: Array, values: Array) -> tuple[Array, Array]:
        """Return the readings ``(n, 1, d)``, m or rad, and their derivatives ``(n, 1, d, p)``."""
        size, read, x = len(self.arm.names), self.sensor.read, values[len(self.arm.names) :]
        # the pose of the target's frame in the base's, and its velocities by the arm's parameters
        points, jacobian = self.arm.observe(inputs, values[:size])
        rotations, turning = tip_rates(self.arm, inputs, values[:size], jacobian)
        T_base_instrument = se3.inverse(self._base(values))
        R_base_instrument = T_base_instrument[:3, :3]
        p, R = se3.transform(T_base_instrument, points[:, 0]), R_base_instrument @ rotations
        velocities = np.concatenate([R_base_instrument @ jacobian[:, 0], R_base_instrument @ turning], axis=1)
        velocities[..., list(indices_of_groups(self.arm.parameters, ["base"]))] = 0.0  # the arm moves with its base
        # derivatives by a shift and a turn of the frame, and by the sensor's parameters
        by_shift = _slopes(lambda moved: read(p + moved, R, x), np.eye(3))
        by_turn = _slopes(lambda turned: read(p, se3.exp(turned) @ R, x), np.eye(3))
        by_arm = np.concatenate([by_shift, by_turn], axis=-1) @ velocities
        by_own = _slopes(lambda changed: read(p, R, x + changed), np.diag(np.maximum(1.0, np.abs(x))))
        return read(p, R, x)[:, None], np.concatenate([by_arm, by_own], axis=-1)[:, None]

    def _base(self, values: Array) -> Array:
        """Return the pose ``(4, 4)`` of the robot's base in the instrument's frame."""
        base = values[list(indices_of_groups(self.arm.parameters, ["base"]))]
        return se3.pose(se3.exp(base[3:6]), base[:3])


def _slopes(function: Callable[[Array], Array], units: Array) -> Array:
    """Return derivatives ``(n, d, m)`` at zero by central differences.

    Args:
        function: of ``(k,)``, to ``(n, d)``.
        units: ``(m, k)`` by whose lengths the differences are taken.
    """
    slopes = [(function(_STEP * unit) - function(-_STEP * unit)) / (2 * _STEP * np.linalg.norm(unit)) for unit in units]
    return np.stack(slopes, axis=-1) if slopes else np.empty((*function(np.empty(0)).shape, 0))


def _parameter(owner: str, symbol: str, start: float) -> Parameter:
    (made,) = placed_parameters(owner, owner, (symbol,))
    if symbol.endswith("_rad"):
        made = replace(made, kind="angle", unit=DEGREES)
    return replace(made, nominal=float(start))
