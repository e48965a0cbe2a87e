"""The kinds of places: anchors of a draw-wire, sockets for a ball, planes that are touched."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lab.calibration.observations.fixtures import PLACE, Fixtures
from lab.core.measurements import Measurements
from lab.core.se3 import Array, exp, left_jacobian
from lab.kinematics.parameter import Parameter, placed_parameters

DISTANCE_WEIGHT = 30.0  # a distance between sockets is known that much better (0.01 mm) than a ball sits (0.3 mm)
WHOLE_LOCATIONS = 3  # from this many on, a location is fitted or held out as one


@dataclass(frozen=True)
class Cable(Fixtures):
    """Distances from a target to anchors: a draw-wire's length, ``|p - anchor| + offset`` (m).

    The offset is the wire's between its guide and the point whose distance a zero reading means.
    """

    group: ClassVar[str] = "anchor"
    least_rows: ClassVar[int] = 4
    touched: ClassVar[bool] = False
    offset: ClassVar[tuple[Parameter, ...]] = placed_parameters("cable", "cable", ("offset",), scaled=True)

    def seen(self, points: Array, places: Array) -> tuple[Array, Array, Array]:
        """Lengths ``(n, 1)``; they grow along the wire."""
        wire = points - places
        length = np.sqrt((wire * wire).sum(axis=1, keepdims=True))
        along = (wire / length)[:, None]
        return length, along, -along

    def placed_by(self, points: Array, observed: Array) -> Array:
        """Trilateration: |p|^2 - L^2 = 2 p'a - a'a is linear in a and a'a, about the mean point."""
        centre = points.mean(axis=0)
        near = points - centre
        system = np.column_stack([2 * near, -np.ones(len(near))]) / observed
        right = ((near**2).sum(axis=1) - observed[:, 0] ** 2) / observed[:, 0]
        return np.asarray(centre + np.linalg.lstsq(system, right)[0][:3])

    def through(self, points: Array, rng: np.random.Generator) -> Array:
        """The points themselves."""
        return points


@dataclass(frozen=True)
class Sockets(Fixtures):
    """A ball on the tool in sockets: within a location and socket its centre is one point, ``p - centre = 0``.

    Labels are ``<location>.<socket>``.

    Attributes:
        distance_m: known between the two sockets of every location; None if it is not.
    """

    distance_m: float | None = None
    group: ClassVar[str] = "socket"
    least_rows: ClassVar[int] = 2
    touched: ClassVar[bool] = True

    def seen(self, points: Array, places: Array) -> tuple[Array, Array, Array]:
        """Vectors ``(n, 3)`` from the centres."""
        one = np.broadcast_to(np.eye(3), (len(points), 3, 3))
        return points - places, one, -one

    def placed_by(self, points: Array, observed: Array) -> Array:
        """The mean of the predictions."""
        return np.asarray(points.mean(axis=0))

    def through(self, points: Array, rng: np.random.Generator) -> Array:
        """The points themselves."""
        return points

    def extra_residuals(self, values: Array) -> tuple[Array, Array]:
        """Of each pair of sockets, how far the known distance is from that of the centres."""
        pairs = self._pairs()
        rows, left = np.zeros((len(pairs), len(self.names))), np.zeros(len(pairs))
        for row, (i, j) in enumerate(pairs):
            a, b = (slice(self.first + 3 * k, self.first + 3 * k + 3) for k in (i, j))
            apart = float(np.linalg.norm(values[b] - values[a]))
            along = (values[b] - values[a]) / max(apart, 1e-300)
            assert self.distance_m is not None
            left[row] = self.distance_m - apart
            rows[row, a], rows[row, b] = -along, along
        return DISTANCE_WEIGHT * left, DISTANCE_WEIGHT * rows

    def cv_groups(self, data: Measurements) -> NDArray[np.int_] | None:
        """Rows of one location, where there are three or more."""
        location = {number: label.rpartition(".")[0] for number, label in zip(self.numbers, self.labels, strict=True)}
        order = {name: i for i, name in enumerate(dict.fromkeys(location.values()))}
        if len(order) < WHOLE_LOCATIONS:
            return None
        return np.array([order[location[int(number)]] for number in data.conditions[PLACE]], dtype=np.int_)

    def _pairs(self) -> list[tuple[int, int]]:
        """Indices of the two sockets of each location that has both."""
        if self.distance_m is None:
            return []
        at: dict[str, list[int]] = {}
        for i, label in enumerate(self.labels):
            at.setdefault(label.rpartition(".")[0], []).append(i)
        return [(pair[0], pair[1]) for pair in at.values() if len(pair) == 2]


@dataclass(frozen=True)
class Planes(Fixtures):
    """Points that touch a plane: ``n'p - z = 0`` with the normal n = exp(rx, ry, 0) e_z and the distance z (m).

    A plane has a normal in the upper half: the chart is smooth there, wherever the plane is.
    """

    group: ClassVar[str] = "plane"
    axes: ClassVar[tuple[str, str, str]] = ("rx", "ry", "z")
    least_rows: ClassVar[int] = 4
    touched: ClassVar[bool] = True

    def seen(self, points: Array, places: Array) -> tuple[Array, Array, Array]:
        """Distances ``(n, 1)`` from the planes: a turn w of a normal changes them by w'(n x p)."""
        turn = places * np.array([1.0, 1.0, 0.0])
        normal = exp(turn)[..., 2]
        observed = (normal * points).sum(axis=1, keepdims=True) - places[:, 2:]
        by_turn = np.cross(normal, points)[:, None] @ left_jacobian(turn)[..., :2]
        return observed, normal[:, None], np.concatenate([by_turn, -np.ones((len(points), 1, 1))], axis=2)

    def placed_by(self, points: Array, observed: Array) -> Array:
        """The plane of least squares: the normal is the direction of least spread."""
        centre = points.mean(axis=0)
        normal = np.linalg.svd(points - centre)[2][-1]
        return _plane(normal if normal[2] >= 0 else -normal, centre)

    def through(self, points: Array, rng: np.random.Generator) -> Array:
        """Planes of random normals in the upper half."""
        normals = rng.normal(size=(len(points), 3))
        normals[:, 2] = np.abs(normals[:, 2])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return np.array([_plane(normal, point) for normal, point in zip(normals, points, strict=True)])


def _plane(normal: Array, point: Array) -> Array:
    """``(rx, ry, z)`` of the plane through a point: e_z turns into the normal about e_z x n."""
    level = float(np.hypot(normal[0], normal[1]))
    angle = float(np.arctan2(level, normal[2]))
    turn = angle / level if level > 1e-12 else 1.0
    return np.array([-turn * normal[1], turn * normal[0], float(normal @ point)])
