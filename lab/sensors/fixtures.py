"""Model arms that are measured against fixtures of unknown positions: anchors of a cable, sockets, planes, artefacts.

Each fixture adds a few parameters, and has the role of a base: the base stays at the origin. A residual that is zero
where the arm touches its fixture is zero too when arm and fixture shrink together; which parameters are identifiable
is therefore decided at poses in contact, and the longest link is the scale unless a length is known.

``Fixtures`` are the geometry: they predict the reading at a fixture, and place it by readings. A ``FixtureSensor`` has
the columns of the file, and draws fixtures about a virtual arm; reading, fitting and simulation are here. The sensors
of this family are ``cable``, ``socket``, ``plane``, ``dial`` and those of ``artefact``.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations, fit
from lab.calibration.identification import Identification
from lab.core import se3
from lab.core.errors import LabError, counted, option_name
from lab.core.measurements import FIXTURE, Measurements
from lab.core.newton import newton
from lab.core.random import rng_for
from lab.core.se3 import Array, transform
from lab.core.units import MM
from lab.diagnosis.hypothesis import Hypothesis
from lab.kinematics.gauge import placed_after_tool, scale_link
from lab.kinematics.model import Model, RigidArm
from lab.kinematics.parameter import SIZE, Parameter, indices_of_groups, names_of, placed_parameters
from lab.kinematics.serial.axes_to_dh import JointAxes, Truth, parameters_from_axes
from lab.kinematics.serial.serial_arm import SerialArm
from lab.sensors.contact import POINT, TOUCHING, DrawnContacts, FixtureSimulation
from lab.sensors.fixture_mistakes import exchanged_fixtures, moved_fixtures, placed_fixtures, scaled_readings
from lab.sensors.sensor_options import FitInputs, SensorOptions, VirtualSetup
from lab.sensors.size import LEAST_NOISE, size_residuals
from lab.sensors.virtual_sensor import SimulatedReadings, VirtualSensor
from lab.simulation.tracking import VirtualMeasurement
from lab.simulation.true_robot import TrueRobot

__all__ = [
    "NONE",
    "FixtureRows",
    "FixtureSensor",
    "Fixtures",
    "PredictedReadings",
    "known_lengths",
    "labels_by_location",
    "refuse_blank",
]

NONE = np.empty(0)  # nothing else is known of a row, or shared

_IN_CONTACT = 1e-11  # m
_SETTLED_M = 1e-9  # of a residual before the last step
_VALIDATING_ROWS = 2  # times the rows that a fixture takes, and a fixture is placed by rows that were not fitted
_NEWTON_STEPS = 12
_LONGEST_STEP = 0.5  # rad or m of a joint
_DIFFERENCE = 1e-7
_ROUNDS = 20


class PredictedReadings(NamedTuple):
    """Readings predicted at fixtures.

    Attributes:
        observed: ``(n, d)`` m.
        by_point, by_fixture, by_shared: its derivatives ``(n, d, 3)``, ``(n, d, m)`` and ``(n, d, s)``.
    """

    observed: Array
    by_point: Array
    by_fixture: Array
    by_shared: Array


@dataclass(frozen=True)
class Fixtures(ABC):
    """An arm with one target, and the fixtures that it is tied to or touches.

    Attributes:
        arm: the arm, measured by one point.
        nominal_arm: ``(arm's p,)`` its nominal parameters, base at the origin.
        numbers: of the fixtures, as in the condition ``fixture``, ascending.
        labels: of the fixtures, as in the names of their parameters: ``anchor.<label>.x``; "" if it has no name.
        sigma: noise (m) of a reading by which the prior of a known size weighs.
        parameters: the arm's, those that all fixtures share, then those of each fixture.
        names: of the parameters.
    """

    arm: Model
    nominal_arm: Array
    numbers: tuple[int, ...]
    labels: tuple[str, ...]
    sigma: float = field(default=LEAST_NOISE, kw_only=True)
    parameters: tuple[Parameter, ...] = field(init=False, repr=False)
    names: tuple[str, ...] = field(init=False)
    group: ClassVar[str]  # name of a fixture
    axes: ClassVar[tuple[str, ...]] = ("x", "y", "z")  # its parameters
    least_rows: ClassVar[int]  # of a fixture, from which on they depend on the arm too
    contact: ClassVar[bool]  # whether the residual is zero at the fixture
    starts: ClassVar[int] = 4  # from which target and fixtures are placed among rows that may be wrong
    draws: ClassVar[int] = 16  # of few rows that place a fixture
    row_conditions: ClassVar[tuple[str, ...]] = (FIXTURE,)  # of each row, after the arm's own

    def __post_init__(self) -> None:
        assert len(self.arm.targets) == 1 and len(self.nominal_arm) == len(self.arm.names)
        owners = [f"{self.group}.{label}" if label else self.group for label in self.labels]
        added = [parameter for owner in owners for parameter in placed_parameters(owner, self.group, self.axes)]
        object.__setattr__(self, "parameters", (*self.arm.parameters, *self.shared, *added))
        object.__setattr__(self, "names", names_of(self.parameters))

    @property
    def shared(self) -> tuple[Parameter, ...]:
        """Parameters that all fixtures share: here, none."""
        return ()

    @abstractmethod
    def predict(self, points: Array, fixtures: Array, rows: Array = NONE, shared: Array = NONE) -> PredictedReadings:
        """Predict the observed quantity of the target at a fixture.

        Args:
            points: ``(n, 3)`` the target, m in the instrument's frame.
            fixtures: ``(n, m)`` the parameters of each row's fixture.
            rows: ``(n, r)`` what else is known of each row: ``row_conditions`` before the fixture.
            shared: ``(s,)`` values of ``shared``.
        """

    @abstractmethod
    def located(self, points: Array, observed: Array, rows: Array) -> Array:
        """Return the fixture ``(m,)`` from predicted points ``(k, 3)`` and observations ``(k, d)`` at its rows."""

    def random_fixtures(self, points: Array, rng: np.random.Generator) -> Array:
        """Draw fixtures ``(k, m)`` that the points ``(k, 3)`` touch: here, the points themselves."""
        return points

    def at_base(self, placed: Array, T_base_instrument: Array, scale: float) -> Array:
        """Return fixtures in the base's frame, where the base is at the origin and lengths may be scaled.

        Args:
            placed: ``(k, 3)`` m, places in the instrument's frame.
            T_base_instrument: ``(4, 4)``, of lengths that are scaled already.
            scale: of all lengths.

        Returns:
            ``(k, m)``, the fixtures' parameters.
        """
        return transform(T_base_instrument, scale * placed)

    @property
    def unsized(self) -> bool:
        """Check whether the arm touches the fixtures: contacts determine its shape and not its size."""
        return self.contact

    @property
    def scale_link(self) -> int:
        """Index of the link length that sets the scale of contacts, if no distance is given."""
        return scale_link(self.arm, self.nominal_arm)

    @property
    def first(self) -> int:
        """Index of the first fixture's first parameter."""
        return len(self.arm.names) + len(self.shared)

    @property
    def model(self) -> Self:
        """This model, which defines its own observation."""
        return self

    @property
    def targets(self) -> tuple[str, ...]:
        """Names of the observed quantities, by the group of the fixtures."""
        return (self.group,)

    @property
    def conditions(self) -> tuple[str, ...]:
        """The arm's, then those of each row, the number of its fixture last."""
        return (*self.arm.conditions, *self.row_conditions)

    @property
    def placed(self) -> tuple[str, ...]:
        """The fixtures, the target, and what these share; a known size has a nominal value."""
        return (self.group, "tool", *(parameter.group for parameter in self.shared if parameter.group != SIZE))

    @property
    def units(self) -> Array:
        """``(1,)``: observations are in metres."""
        return np.ones(1)

    @property
    def positions(self) -> int:
        """Zero: no position in an instrument's frame is observed."""
        return 0

    def within(self, data: Measurements) -> Self:
        """Return the model with the fixtures of these rows."""
        known = np.unique(data.conditions[FIXTURE][data.seen.any(axis=1)])
        picked = [i for i, number in enumerate(self.numbers) if number in known]
        return replace(
            self, numbers=tuple(self.numbers[i] for i in picked), labels=tuple(self.labels[i] for i in picked)
        )

    def nominal(self, values: Array) -> Array:
        """Return the arm's parameters, with every fixture at the origin."""
        return np.concatenate([values[: len(self.arm.names)], np.zeros(len(self.names) - len(self.arm.names))])

    def observe(self, inputs: Array, values: Array) -> tuple[Array, Array]:
        """Return observations ``(n, 1, d)`` in m and their derivatives ``(n, 1, d, p)``."""
        size, index, m = len(self.arm.names), self._index(inputs[:, -1]), len(self.axes)
        points, jacobian = self.arm.observe(self._of_arm(inputs), values[:size])
        found = self._predicted(points[:, 0], inputs, values, index)
        n, d = found.observed.shape
        derivative = np.zeros((n, 1, d, len(self.names)), dtype=found.observed.dtype)
        derivative[:, 0, :, :size] = found.by_point @ jacobian[:, 0]
        derivative[:, 0, :, size : self.first] = found.by_shared
        columns = self.first + m * index[:, None] + np.arange(m)
        derivative[np.arange(n)[:, None, None], 0, np.arange(d)[:, None], columns[:, None]] = found.by_fixture
        return found.observed[:, None], derivative

    def points(self, inputs: Array, values: Array) -> Array:
        """Return observations ``(n, 1, d)`` in m."""
        points = self.arm.points(self._of_arm(inputs), values[: len(self.arm.names)])[:, 0]
        return self._predicted(points, inputs, values, self._index(inputs[:, -1])).observed[:, None]

    def _predicted(self, points: Array, inputs: Array, values: Array, index: NDArray[np.int_]) -> PredictedReadings:
        fixtures = values[self.first :].reshape(-1, len(self.axes))[index]
        return self.predict(points, fixtures, self._of_rows(inputs), values[len(self.arm.names) : self.first])

    def _of_arm(self, inputs: Array) -> Array:
        return inputs[:, : inputs.shape[1] - len(self.row_conditions)]

    def _of_rows(self, inputs: Array) -> Array:
        return inputs[:, inputs.shape[1] - len(self.row_conditions) : -1]

    def column_priority(self) -> tuple[int, ...]:
        """Return fixtures, then the arm's order, its longest link after the target if it is the scale, then base."""
        parameters = self.arm.parameters
        base = indices_of_groups(parameters, ["base"])
        order = tuple(i for i in self.arm.column_priority() if i not in base)
        if self.contact:
            order = placed_after_tool(parameters, order, last=self.scale_link)
        return (*range(self.first, len(self.names)), *range(len(parameters), self.first), *order, *base)

    def rank_point(self, values: Array) -> Array:
        """Return the arm's at ``values``; for contacts the nominal arm's, with the fixtures of ``structure_joints``."""
        size = len(self.arm.names)
        if not self.contact:
            return np.concatenate([self.arm.rank_point(values[:size]), values[size:]])
        arm = self.arm.rank_point(self.nominal_arm)
        joints = self.arm.structure_joints(len(self.numbers), rng_for(0, "structure"))
        points = self.arm.points(joints, arm)[:, 0]
        placed = self.random_fixtures(points, rng_for(1, "structure")).ravel()
        return np.concatenate([arm, np.zeros(len(self.shared)), placed])

    def structure_rows(self, count: int) -> Array:
        """Return row conditions ``(count, r + 1)`` for decisions on rank: each fixture in turn."""
        return np.resize(np.array(self.numbers, dtype=np.float64), count)[:, None]

    def structure_joints(self, count: int, rng: np.random.Generator) -> Array:
        """Return the arm's, with each fixture in turn; for contacts, poses near them that touch.

        Raises:
            LabError: the nominal arm cannot touch every fixture of ``rank_point`` in other poses.
        """
        rows = self.structure_rows(count)
        if not self.contact:
            return np.column_stack([self.arm.structure_joints(count, rng), rows])
        values, found = self.rank_point(self.nominal(self.nominal_arm)), np.empty((0, 0))
        for _ in range(_ROUNDS):
            near = np.column_stack([self.arm.structure_joints(count, rng), rows])
            inputs = self.inputs_in_contact(near, values)
            found = np.concatenate([found, inputs]) if found.size else inputs
            if len(found) >= count:
                return found[:count]
        raise LabError(f"the nominal arm cannot reach every {self.group} again: check the robot's limits")

    def inputs_in_contact(self, inputs: Array, values: Array) -> Array:
        """Return inputs whose joints Newton's steps bring to their fixtures.

        Args:
            inputs: ``(n, joints + conditions)`` to start from; changed in place.
            values: ``(p,)``.

        Returns:
            ``(m, joints + conditions)``: those that converged.
        """
        joints = inputs.shape[1] - len(self.conditions)

        def step(positions: Array, going: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
            near = np.concatenate([positions[going], inputs[going, joints:]], axis=1)
            residual = self.points(near, values)[:, 0]
            slopes = np.empty((*residual.shape, joints))
            for j in range(joints):
                moved = near.copy()
                moved[:, j] += _DIFFERENCE
                slopes[..., j] = (self.points(moved, values)[:, 0] - residual) / _DIFFERENCE
            change, settled = np.zeros_like(positions), np.zeros_like(going)
            change[going] = -(np.linalg.pinv(slopes) @ residual[..., None])[..., 0]
            settled[going] = np.linalg.norm(residual, axis=1) < _SETTLED_M  # the next residual is about its square
            return np.clip(change, -_LONGEST_STEP, _LONGEST_STEP), settled

        inputs[:, :joints] = newton(step, inputs[:, :joints], _NEWTON_STEPS).values
        size = np.linalg.norm(self.points(inputs, values)[:, 0], axis=1)
        return np.asarray(inputs[size < _IN_CONTACT])

    def initial_guess(self, observed: Observations, values: Array) -> Array:
        """Estimate each fixture from the arm at ``values``."""
        inputs = observed.inputs
        points = self.arm.points(self._of_arm(inputs), values[: len(self.arm.names)])[:, 0]
        rows = np.isfinite(observed.points).all(axis=(1, 2))
        chosen = [rows & (inputs[:, -1] == i) for i in self.numbers]
        found = [self.located(points[i], observed.points[i, 0], self._of_rows(inputs[i])) for i in chosen]
        return np.concatenate([values[: self.first], *found])

    def extra_residuals(self, values: Array) -> tuple[Array, Array]:
        """Return the prior of a known size, if it has one."""
        return size_residuals(self.parameters, values, self.sigma)

    def weighed(self, sigma: float) -> Self:
        """Return the model whose prior of a known size weighs by this noise (m)."""
        return replace(self, sigma=sigma)

    def errors(self, data: Measurements, values: Array) -> Array:
        """Return lengths ``(n, 1)`` in m of the residuals, where these rows place fixtures that ``values`` lack.

        NaN where such a fixture has too few rows to be placed and validated by them.
        """
        known, rows = np.unique(data.conditions[FIXTURE][data.seen[:, 0]], return_counts=True)
        enough = known[rows >= _VALIDATING_ROWS * self.least_rows].astype(np.int_).tolist()
        new = [number for number in enough if number not in self.numbers]
        wide = replace(self, numbers=(*self.numbers, *new), labels=(*self.labels, *map(str, new)))
        placed = np.isin(data.conditions[FIXTURE], wide.numbers)
        part = data[placed]
        if new:
            values = wide._with_fixtures(part[np.isin(part.conditions[FIXTURE], new)], values, new)
        errors = np.full((len(data), 1), np.nan)
        residuals = wide.points(part.inputs(self.conditions), values) - part.points
        errors[placed] = np.linalg.norm(residuals, axis=2)
        return errors

    def cv_groups(self, data: Measurements) -> NDArray[np.int_] | None:
        """Return None: repeats of a configuration are held out together."""
        return None

    def _with_fixtures(self, data: Measurements, values: Array, new: Sequence[int]) -> Array:
        """Return ``values``, which end before the ``new`` fixtures, with these as the rows of ``data`` place them."""
        observed = Observations(data.inputs(self.conditions), data.points, np.ones(data.points.shape[:2]))
        alone = replace(self, numbers=tuple(new), labels=tuple(map(str, new)))
        at_origin = np.concatenate([values[: self.first], np.zeros(len(self.axes) * len(new))])
        start = alone.initial_guess(observed, at_origin)[self.first :]
        columns = range(len(values), len(values) + len(self.axes) * len(new))
        return fit(self, observed, columns, np.concatenate([values, start])).values

    def _index(self, numbers: Array) -> NDArray[np.int_]:
        index = {number: i for i, number in enumerate(self.numbers)}
        found, rows = np.unique(numbers.astype(np.int_), return_inverse=True)
        return np.array([index[number] for number in found.tolist()], dtype=np.int_)[rows]


FixtureRows = tuple[Sequence[str], Array]
"""Label of each row's fixture, "" where the file names none; and readings ``(n, d)`` m, NaN where there are none."""


@dataclass(frozen=True)
class FixtureSensor(VirtualSensor, ABC):
    """A sensor at fixtures: of one target, and of nothing in an instrument's frame."""

    model: ClassVar[type[Fixtures]]
    reading: ClassVar[str] = ""  # column of the reading (mm); "" where a row is a contact
    numbers: ClassVar[int] = 1  # that a simulated row is, each with a random error
    in_instrument_frame: ClassVar[bool] = False
    setup: ClassVar[tuple[str, ...]] = ("fixtures",)
    finds_poses: ClassVar[bool] = True

    @abstractmethod
    def drawn(self, arm: FixtureSimulation, setup: VirtualSetup) -> DrawnContacts:
        """Place fixtures about a virtual arm, and choose where it touches or reads them."""

    def simulate(self, poses: VirtualMeasurement, setup: VirtualSetup) -> SimulatedReadings:
        """Measure at one fixture after the other, in as many poses as are given: new ones, where it is touched."""
        arm = FixtureSimulation.of_one_point(self.name, poses, self.numbers)
        return arm.readings(self.drawn(arm, setup))

    def rows(self, data: Measurements) -> NDArray[np.bool_]:
        """Return the rows ``(n,)`` with a reading; all, where a contact needs no column of its own."""
        if not self.reading:
            return np.ones(len(data), dtype=np.bool_)
        return np.isfinite(data.conditions.get(self.reading, np.full(len(data), np.nan)))

    def fixture_rows(self, data: Measurements) -> FixtureRows:
        """Read the fixtures that the file names, by location, else by session; gaps of zero where a row is a contact.

        Raises:
            LabError: a column is missing, or a cell has an impossible value.
        """
        readings = self.readings(data)
        return labels_by_location(data, self.model.group, self.rows(data)), readings

    def readings(self, data: Measurements) -> Array:
        """Return the readings ``(n, 1)`` m.

        Raises:
            LabError: their column is missing.
        """
        if not self.reading:
            return np.zeros((len(data), 1))
        if self.reading not in data.conditions:
            raise LabError(
                f"column {self.reading} is missing: {option_name('observe')} {self.name} needs the {self.terms.reading}"
            )
        return MM.to_si(data.conditions[self.reading])[:, None]

    def contradictions(self, arm: Model, data: Measurements, nominal: Array) -> tuple[str, ...]:
        """Return warnings of rows whose other readings contradict their joint positions: here, none."""
        return ()

    def misses(self, arm: Model, data: Measurements, nominal: Array) -> Array:
        """Return how far ``(n,)`` the nominal arm misses each row (m), with target and fixtures placed by most rows."""
        return placed_fixtures(self, arm, data, nominal).misses

    def mistakes(self, arm: RigidArm, data: Measurements) -> Sequence[Hypothesis]:
        """Return rows at other fixtures than named, fixtures that moved, and other units of a reading."""
        placed = placed_fixtures(self, arm, data, arm.nominal())
        found = [*exchanged_fixtures(self, placed, data), *moved_fixtures(self, placed, data)]
        if self.reading:
            found += scaled_readings(data, self.reading, f"{self.name}_unit")
        return found

    def relabelled(self, data: Measurements, labels: Mapping[int, str]) -> Measurements:
        """Return the measurements with the fixtures of some rows, by their numbers, named otherwise."""
        column = "location" if "location" in data.other else ""
        cells = list(data.other[column] if column else data.sessions)
        for row, label in labels.items():
            cells[row] = label
        if not column:
            return replace(data, sessions=tuple(cells))
        return replace(data, other={**data.other, column: tuple(cells)})

    def model_of(self, data: Measurements) -> type[Fixtures]:
        """Return the model of what a file holds: mostly the only one."""
        return self.model

    def fixtures(
        self, kind: type[Fixtures], arm: Model, nominal: Array, numbers: tuple[int, ...], labels: tuple[str, ...]
    ) -> Fixtures:
        """Return the model of these fixtures.

        Raises:
            LabError: an option of the sensor does not hold for them.
        """
        return kind(arm, nominal, numbers, labels)

    @classmethod
    def configured(cls, options: SensorOptions, fit: FitInputs) -> Self:
        """Return the sensor, whose observations no instrument weights.

        Raises:
            LabError: an instrument or a validation file is given.
        """
        fit.refuse_those_of_points(cls.name)
        return cls()

    def targets(self, data: Measurements) -> tuple[str, ...]:
        """Return the target that touches or is tied, whatever points the file has: that of the column ``target``.

        Raises:
            LabError: rows name several.
        """
        named = tuple(dict.fromkeys(name for name in data.other.get(TOUCHING, ()) if name))
        if len(named) > 1:
            raise LabError(
                f"column {TOUCHING} names {', '.join(named)}: {option_name('observe')} {self.name} is of one point; "
                f"give each a file"
            )
        return named or (POINT,)

    def observation(self, arm: Model, data: Measurements, nominal: Array) -> tuple[Model, Measurements]:
        """Return the fixtures that have enough rows, and these rows; a warning for each of the others.

        Raises:
            LabError: the arm has several targets, no fixture has enough rows, or a cell has an impossible value.
        """
        if len(arm.targets) != 1:
            raise LabError(
                f"{option_name('observe')} {self.name} takes one target, not {', '.join(arm.targets)}: name one"
            )
        (names, observed), kind = self.fixture_rows(data), self.model_of(data)
        measured = np.asarray(np.isfinite(observed).all(axis=1))
        # number the fixtures with readings in the order of their first rows; the others are -1
        labels = list(dict.fromkeys(names[row] for row in np.flatnonzero(measured).tolist()))
        index = {label: i for i, label in enumerate(labels)}
        number = np.array([index.get(name, -1) for name in names])
        counts = np.bincount(number[measured], minlength=len(labels))
        few = np.flatnonzero(counts < kind.least_rows).tolist()
        if len(few) == len(labels):
            most = int(counts.max(initial=0))
            raise LabError(
                f"no {kind.group} has more than {counted(most, 'row')}; its own position takes {len(kind.axes)} "
                f"numbers: measure each from at least {kind.least_rows} poses"
            )
        left_out = tuple(
            f"{kind.group} {labels[i] or 'of the file'} has {counts[i]} of the {kind.least_rows} rows "
            "that say anything of the arm: left out"
            for i in few
        )
        numbers = tuple(np.flatnonzero(counts >= kind.least_rows).tolist())
        model = self.fixtures(kind, arm, np.asarray(nominal), numbers, tuple(labels[i] for i in numbers))
        full = replace(
            data,
            targets=model.targets,
            points=observed[:, None],
            conditions={**data.conditions, FIXTURE: number.astype(np.float64)},
            warnings=(*data.warnings, *self.contradictions(arm, data, nominal), *left_out),
        )
        return model, full[measured & ~np.isin(number, few)]

    def observed_truth(
        self, truth: Truth, found: Identification, real: TrueRobot, placed: Mapping[str, Array]
    ) -> Truth | None:
        """Return the truth with the base at the origin and the fixtures there; None where it is not single.

        Without a given length the arm is scaled so that its longest link has its nominal length, as no contact
        determines its size. An arm with a slide cannot be scaled: its joint positions are lengths. A mechanism has
        another gauge.
        """
        model = found.model
        assert isinstance(model, Fixtures)
        if not isinstance(truth.arm, SerialArm):
            return None
        scale, at = 1.0, model.scale_link
        if model.contact and at not in found.base_set.identifiable:
            if any(truth.arm.chain.prismatic):
                return None
            scale = float(model.nominal_arm[at] / truth.of([model.names[at]])[0])
            truth = replace(_scaled(truth, scale), effects=truth.effects)
        arm, values = truth.arm, truth.values.copy()
        assert isinstance(arm, SerialArm)
        T_base_instrument = se3.inverse(arm.T_tracker_frame0(values))
        values[:6] = 0.0
        known = _placed_at(model, placed, T_base_instrument, scale)
        return replace(truth, values=values, effects={**truth.effects, **known})

    def placed_truth(
        self, model: Model, truth: Truth, real: TrueRobot, placed: Mapping[str, Array], T_frame_instrument: Array
    ) -> dict[str, float]:
        """Return the fixtures in the frame of the parameters."""
        assert isinstance(model, Fixtures)
        return _placed_at(model, placed, T_frame_instrument, 1.0)


def _placed_at(
    model: Fixtures, placed: Mapping[str, Array], T_frame_instrument: Array, scale: float
) -> dict[str, float]:
    """Return the parameters of placed fixtures by their names, in a frame of lengths that may be scaled."""
    owners = [f"{model.group}.{label}" for label in model.labels]
    there = model.at_base(np.stack([placed[owner] for owner in owners]), T_frame_instrument, scale)
    known = dict(zip(model.names[model.first :], there.ravel().tolist(), strict=True))
    return known | {each.name: float(placed[each.owner][0]) for each in model.shared}


def refuse_blank(
    data: Measurements, column: str, labels: Sequence[str], group: str, rows: NDArray[np.bool_] | None = None
) -> None:
    """Refuse rows to be used that do not name their fixture.

    Args:
        data: the file's.
        column: of the labels.
        labels: one a row.
        group: name of a fixture.
        rows: ``(n,)`` those with something observed; all, if not given.

    Raises:
        LabError: the label of such a row is empty.
    """
    for row, label in enumerate(labels):
        if not label and data.use[row] != "skip" and (rows is None or rows[row]):
            raise LabError(f"{data.where(row)}, column {column}: empty; say which {group} the row is of, or use = skip")


def labels_by_location(data: Measurements, group: str, rows: NDArray[np.bool_] | None = None) -> tuple[str, ...]:
    """Return the fixtures ``(n,)`` by location, else by session; empty where nothing names any.

    Raises:
        LabError: some of these rows name their fixture, and another does not.
    """
    column, labels = ("location", data.other["location"]) if "location" in data.other else ("session", data.sessions)
    if any(labels):
        refuse_blank(data, column, labels, group, rows)
    return labels


def known_lengths(
    data: Measurements, column: str, group: str, rows: NDArray[np.bool_], *, positive: bool = True
) -> Array:
    """Return the known lengths ``(n,)`` (m) of a column in mm, 0 in other rows than these.

    Raises:
        LabError: the column is missing, or a cell of these rows is empty or not above zero (where it has to be).
    """
    if column not in data.conditions:
        raise LabError(f"column {column} is missing: {option_name('observe')} needs this length of each {group}")
    lengths = np.where(rows, data.conditions[column], 1.0)
    bad = np.flatnonzero(~np.isfinite(lengths) | (positive & (lengths <= 0)))
    for row in (i for i in bad.tolist() if data.use[i] != "skip"):
        what = "give a length above zero" if positive else "give a coordinate"
        raise LabError(f"{data.where(row)}, column {column}: {what}, or use = skip")
    return np.where(rows & np.isfinite(lengths), MM.to_si(lengths), 0.0)


def _scaled(truth: Truth, scale: float) -> Truth:
    """Return the truth of an arm whose lengths are scaled, in the same gauge: all joints turn."""
    arm = truth.arm
    assert isinstance(arm, SerialArm) and not any(arm.chain.prismatic)
    axes = [motion for motion in arm.motions(truth.values) if motion.joint is not None]
    origins = np.array([motion.origin[:3, 0] for motion in axes if motion.origin is not None])
    directions = np.array([motion.axis[:3, 0] for motion in axes]) * arm.chain.sign[:, None]
    targets = arm.points(np.zeros((1, arm.chain.size)), truth.values)[0]
    return parameters_from_axes(arm, JointAxes(scale * origins, directions, scale * targets), truth.values)
