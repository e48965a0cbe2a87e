"""Measure with a ball on the tool in sockets: each socket's centre is a fitted point."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from lab.calibration.sensor import SensorTerms
from lab.core.errors import LabError, option_name
from lab.core.limits import positive
from lab.core.measurements import FIXTURE, Measurements
from lab.core.se3 import Array
from lab.core.units import MM
from lab.diagnosis.hypothesis import Hypothesis, unchanged
from lab.formats.measurement_csv import ObservedColumns
from lab.kinematics.model import Model, RigidArm
from lab.kinematics.parameter import Parameter
from lab.sensors.contact import DrawnContacts, FixtureSimulation
from lab.sensors.fixture_mistakes import LENGTH_UNITS
from lab.sensors.fixtures import NONE, FixtureRows, Fixtures, FixtureSensor, PredictedReadings, refuse_blank
from lab.sensors.sensor_options import FitInputs, SocketOptions, VirtualSetup
from lab.sensors.size import SOCKET_DISTANCE, drawn_size, size_parameters, size_residuals, stated_size_u

__all__ = ["SocketSensor", "Sockets"]

_DISTANCE_WEIGHT = 30.0  # a distance between sockets is that much more accurate (0.01 mm) than a ball's seat (0.3 mm)
_WHOLE_LOCATIONS = 3  # from this many on, a location is fitted or held out as one
_APART_M = 0.1  # of a location's two sockets, where no distance is given
_NAMES = ("a", "b")
_COLUMNS = ("location", "socket")


@dataclass(frozen=True)
class Sockets(Fixtures):
    """A ball on the tool in sockets: within a location and socket its centre is one point, ``p - centre = 0``.

    Labels are ``<location>.<socket>``.

    Attributes:
        distance_m: between the two sockets of every location; None if it is not given.
        size_u: standard uncertainty of the factor of all these distances; 0 where they are exact.
    """

    distance_m: float | None = None
    size_u: float = 0.0
    group: ClassVar[str] = "socket"
    least_rows: ClassVar[int] = 2
    contact: ClassVar[bool] = True

    @property
    def shared(self) -> tuple[Parameter, ...]:
        """The factor of the given distances less one, where it is uncertain."""
        return () if self.distance_m is None else size_parameters(self.group, self.size_u)

    def predict(self, points: Array, fixtures: Array, rows: Array = NONE, shared: Array = NONE) -> PredictedReadings:
        """Return vectors ``(n, 3)`` from the centres."""
        one = np.broadcast_to(np.eye(3), (len(points), 3, 3))
        return PredictedReadings(points - fixtures, one, -one, np.zeros((len(points), 3, len(shared))))

    def located(self, points: Array, observed: Array, rows: Array = NONE) -> Array:
        """Return the centre ``(3,)``: the mean of the points."""
        return np.asarray(points.mean(axis=0))

    def extra_residuals(self, values: Array) -> tuple[Array, Array]:
        """Return the given distance of each pair of sockets less that of the centres, and the prior of their size."""
        pairs, shared = self._pairs(), slice(len(self.arm.names), self.first)
        rows, residuals = np.zeros((len(pairs), len(self.names))), np.zeros(len(pairs))
        for row, (i, j) in enumerate(pairs):
            a, b = (slice(self.first + 3 * k, self.first + 3 * k + 3) for k in (i, j))
            apart = float(np.linalg.norm(values[b] - values[a]))
            along = (values[b] - values[a]) / max(apart, 1e-300)
            assert self.distance_m is not None
            residuals[row] = self.distance_m * (1.0 + values[shared].sum()) - apart
            rows[row, a], rows[row, b], rows[row, shared] = -along, along, -self.distance_m
        prior, slopes = size_residuals(self.parameters, values, self.sigma)
        residuals, rows = _DISTANCE_WEIGHT * residuals, _DISTANCE_WEIGHT * rows
        return np.concatenate([residuals, prior]), np.concatenate([rows, slopes])

    def cv_groups(self, data: Measurements) -> NDArray[np.int_] | None:
        """Return labels ``(n,)`` of the rows' locations, if there are three or more."""
        location = {number: label.rpartition(".")[0] for number, label in zip(self.numbers, self.labels, strict=True)}
        order = {name: i for i, name in enumerate(dict.fromkeys(location.values()))}
        if len(order) < _WHOLE_LOCATIONS:
            return None
        return np.array([order[location[int(number)]] for number in data.conditions[FIXTURE]], dtype=np.int_)

    def _pairs(self) -> list[tuple[int, int]]:
        if self.distance_m is None:
            return []
        at: dict[str, list[int]] = {}
        for i, label in enumerate(self.labels):
            at.setdefault(label.rpartition(".")[0], []).append(i)
        return [(pair[0], pair[1]) for pair in at.values() if len(pair) == 2]


@dataclass(frozen=True)
class SocketSensor(FixtureSensor):
    """Contacts of a ball with sockets.

    Attributes:
        distance_m: between the two sockets of a location; None if not given.
        size_u: standard uncertainty of the factor of all these distances; 0 where they are exact.
    """

    name: ClassVar[str] = "socket"
    terms: ClassVar[SensorTerms] = SensorTerms(
        measured="a ball's contacts with sockets",
        reading="location and socket",
        error="distance from the socket",
        placed="tool and sockets",
        names_targets=False,
    )
    columns: ClassVar[ObservedColumns] = ObservedColumns(positions=False, texts=_COLUMNS, observed="socket")
    flags: ClassVar[type[Any] | None] = SocketOptions
    model: ClassVar[type[Fixtures]] = Sockets
    numbers: ClassVar[int] = 3

    distance_m: float | None = None
    size_u: float = SOCKET_DISTANCE

    @classmethod
    def configured(cls, options: SocketOptions, fit: FitInputs) -> Self:
        """Return the sensor of sockets at the given distance.

        Raises:
            LabError: an instrument or a validation file is given, the distance is not above zero, or its uncertainty
                is below.
        """
        fit.refuse_those_of_points(cls.name)
        size_u = stated_size_u(options.size_u_percent, SOCKET_DISTANCE)
        if options.socket_distance_mm is None:
            return cls(size_u=size_u)
        positive(option_name("socket_distance_mm"), options.socket_distance_mm)
        return cls(MM.to_si(options.socket_distance_mm), size_u)

    def rows(self, data: Measurements) -> NDArray[np.bool_]:
        """Return the rows ``(n,)`` that name a location and a socket."""
        none = ("",) * len(data)
        cells = zip(*(data.other.get(column, none) for column in _COLUMNS), strict=True)
        return np.array([all(texts) for texts in cells], dtype=np.bool_)

    def fixture_rows(self, data: Measurements) -> FixtureRows:
        """Return the sockets by location and name.

        Raises:
            LabError: a column is missing, or empty in a row.
        """
        for column in _COLUMNS:
            if column not in data.other:
                raise LabError(
                    f"column {column} is missing: {option_name('observe')} socket needs location and socket in "
                    f"every row"
                )
            refuse_blank(data, column, data.other[column], Sockets.group)
        labels = [f"{location}.{socket}" for location, socket in zip(*(data.other[c] for c in _COLUMNS), strict=True)]
        return labels, np.zeros((len(data), 3))

    def mistakes(self, arm: RigidArm, data: Measurements) -> Sequence[Hypothesis]:
        """Return those of all fixtures, and other units of the distance between sockets."""
        found = list(super().mistakes(arm, data))
        if self.distance_m is None:
            return found
        for unit, factor in LENGTH_UNITS:
            other = replace(self, distance_m=factor * self.distance_m)
            found.append(Hypothesis("socket_unit", (unit,), len(LENGTH_UNITS), unchanged, other))
        return found

    def relabelled(self, data: Measurements, labels: Mapping[int, str]) -> Measurements:
        """Return the measurements with location and socket of some rows, by their numbers, named otherwise."""
        cells = {column: list(data.other[column]) for column in _COLUMNS}
        for row, label in labels.items():
            cells["location"][row], _, cells["socket"][row] = label.rpartition(".")
        return replace(data, other={**data.other, **{column: tuple(each) for column, each in cells.items()}})

    def fixtures(
        self, kind: type[Fixtures], arm: Model, nominal: Array, numbers: tuple[int, ...], labels: tuple[str, ...]
    ) -> Fixtures:
        """Return the sockets, with the distance between the two of a location.

        Raises:
            LabError: a distance is given, and a location has more than two sockets.
        """
        sockets = Sockets(arm, nominal, numbers, labels)
        if self.distance_m is None:
            return sockets
        locations = [label.rpartition(".")[0] for label in labels]
        for location in dict.fromkeys(locations):
            if locations.count(location) > 2:
                raise LabError(
                    f"location {location} has {locations.count(location)} sockets: "
                    f"{option_name('socket_distance_mm')} is that of "
                    "two; leave it out, or name pairs as locations of their own"
                )
        return replace(sockets, distance_m=self.distance_m, size_u=self.size_u)

    def drawn(self, arm: FixtureSimulation, setup: VirtualSetup) -> DrawnContacts:
        """Draw locations within reach, with two sockets each: the second is around the base's axis from the first."""
        scale = 0.0 if self.distance_m is None else drawn_size(self.size_u, arm.rng)
        apart_m = _APART_M if self.distance_m is None else (1 + scale) * self.distance_m
        first, near = arm.reachable_points(setup.fixtures)
        around = np.cross(arm.T_tracker_base[:3, 2], first - arm.T_tracker_base[:3, 3])
        around /= np.linalg.norm(around, axis=1, keepdims=True)
        second = first + apart_m * around * arm.rng.choice([-1.0, 1.0], (len(first), 1))
        centres = np.stack([first, second], axis=1).reshape(-1, 3)
        number = np.arange(len(arm.bad)) % len(centres)

        def gap(points: Array, rows: NDArray[np.int_]) -> Array:
            return np.asarray(points[:, 0] - centres[number[rows]] - arm.noise[rows] - arm.displaced[rows])

        names = [(f"l{1 + i // 2}", _NAMES[i % 2]) for i in number.tolist()]
        locations, sockets = zip(*names, strict=True)
        placed = {f"socket.l{1 + i // 2}.{_NAMES[i % 2]}": centre for i, centre in enumerate(centres)}
        placed["socket"] = np.array([scale])
        return DrawnContacts(near[number // 2], gap, placed, {"location": locations, "socket": sockets})
