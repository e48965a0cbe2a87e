"""Measure by touching planes: a point of the tool on planes whose positions are fitted."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lab.calibration.sensor import SensorTerms
from lab.core.se3 import Array, exp, left_jacobian, transform
from lab.formats.measurement_csv import ObservedColumns
from lab.sensors.contact import DrawnContacts, FixtureSimulation
from lab.sensors.fixtures import NONE, Fixtures, FixtureSensor, PredictedReadings
from lab.sensors.sensor_options import VirtualSetup

__all__ = ["PlaneSensor", "Planes", "plane_through"]


@dataclass(frozen=True)
class Planes(Fixtures):
    """Points that touch a plane: ``n'p - z = 0`` with the normal n = exp(rx, ry, 0) e_z and the distance z (m).

    A plane has a normal in the upper half: the chart is smooth there, wherever the plane is.
    """

    group: ClassVar[str] = "plane"
    axes: ClassVar[tuple[str, ...]] = ("rx", "ry", "z")
    least_rows: ClassVar[int] = 4
    contact: ClassVar[bool] = True

    def predict(self, points: Array, fixtures: Array, rows: Array = NONE, shared: Array = NONE) -> PredictedReadings:
        """Return distances ``(n, 1)`` from the planes: a rotation w of a normal changes them by w'(n x p)."""
        rotation = fixtures * np.array([1.0, 1.0, 0.0])
        normal = exp(rotation)[..., 2]
        observed = (normal * points).sum(axis=1, keepdims=True) - fixtures[:, 2:]
        by_rotation = np.cross(normal, points)[:, None] @ left_jacobian(rotation)[..., :2]
        by_plane = np.concatenate([by_rotation, -np.ones((len(points), 1, 1))], axis=2)
        return PredictedReadings(observed, normal[:, None], by_plane, np.empty((len(points), 1, 0)))

    def located(self, points: Array, observed: Array, rows: Array = NONE) -> Array:
        """Return the plane ``(3,)`` of least squares: the normal is the direction of least spread."""
        centre = points.mean(axis=0)
        normal = np.linalg.svd(points - centre)[2][-1]
        return plane_through(_upper(normal), centre)

    def at_base(self, placed: Array, T_base_instrument: Array, scale: float) -> Array:
        """Return planes ``(m, 3)`` from normals and distances ``(m, 4)`` in the instrument's frame."""
        normals = placed[:, :3] @ T_base_instrument[:3, :3].T
        points = transform(T_base_instrument, scale * placed[:, :3] * placed[:, 3:])
        return np.array([plane_through(_upper(n), point) for n, point in zip(normals, points, strict=True)])

    def random_fixtures(self, points: Array, rng: np.random.Generator) -> Array:
        """Return planes ``(m, 3)`` through the points, with random normals in the upper half."""
        normals = rng.normal(size=(len(points), 3))
        normals[:, 2] = np.abs(normals[:, 2])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return np.array([plane_through(normal, point) for normal, point in zip(normals, points, strict=True)])


@dataclass(frozen=True)
class PlaneSensor(FixtureSensor):
    """Contacts with planes: by location, by session, or one for the whole file."""

    name: ClassVar[str] = "plane"
    terms: ClassVar[SensorTerms] = SensorTerms(
        measured="contacts with planes",
        reading="contact with a plane",
        error="distance from the plane",
        placed="tool and planes",
        names_targets=False,
    )
    columns: ClassVar[ObservedColumns] = ObservedColumns(positions=False, texts=("location",), observed="plane")
    model: ClassVar[type[Fixtures]] = Planes

    def drawn(self, arm: FixtureSimulation, setup: VirtualSetup) -> DrawnContacts:
        """Draw planes of any direction through places within reach."""
        on, near = arm.reachable_points(setup.fixtures)
        normals = arm.rng.standard_normal(on.shape)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        heights, number = (normals * on).sum(axis=1), np.arange(len(arm.bad)) % len(on)

        def gap(points: Array, rows: NDArray[np.int_]) -> Array:
            plane = number[rows]
            along = (normals[plane] * (points[:, 0] - arm.displaced[rows])).sum(axis=1)
            return np.asarray(along - heights[plane] - arm.noise[rows, 0])[:, None]

        placed = {
            f"plane.{1 + i}": np.append(normal, z) for i, (normal, z) in enumerate(zip(normals, heights, strict=True))
        }
        return DrawnContacts(near[number], gap, placed, {"location": tuple(str(1 + i) for i in number.tolist())})


def plane_through(normal: Array, point: Array) -> Array:
    """Return ``(rx, ry, z)`` of the plane through a point: e_z rotates into the normal ``(3,)`` about e_z x n."""
    level = float(np.hypot(normal[0], normal[1]))
    angle = float(np.arctan2(level, normal[2]))
    ratio = angle / level if level > 1e-12 else 1.0
    return np.array([-ratio * normal[1], ratio * normal[0], float(normal @ point)])


def _upper(normal: Array) -> Array:
    return -normal if normal[2] < 0 else normal
