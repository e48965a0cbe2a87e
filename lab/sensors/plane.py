"""Touched planes: a point of the tool on planes whose positions are fitted."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lab.calibration.sensor import SensorTerms
from lab.core.measurements import Measurements
from lab.core.se3 import Array, exp, left_jacobian, transform
from lab.formats.measurement_csv import ObservedColumns
from lab.kinematics.model import Model
from lab.noise.instruments import Instrument
from lab.sensors.contact import Chance, Contacts, fixture_measurements, reachable_points, without_sessions
from lab.sensors.fixtures import FixtureRows, Fixtures, FixtureSensor, refuse_blank
from lab.sensors.options import VirtualSetup
from lab.sensors.virtual_sensor import SimulatedReadings, refuse_several_targets
from lab.simulation.true_robot import TrueRobot

__all__ = ["PlaneSensor", "Planes"]


@dataclass(frozen=True)
class Planes(Fixtures):
    """Points that touch a plane: ``n'p - z = 0`` with the normal n = exp(rx, ry, 0) e_z and the distance z (m).

    A plane has a normal in the upper half: the chart is smooth there, wherever the plane is.
    """

    group: ClassVar[str] = "plane"
    axes: ClassVar[tuple[str, str, str]] = ("rx", "ry", "z")
    least_rows: ClassVar[int] = 4
    contact: ClassVar[bool] = True

    def predict(self, points: Array, fixtures: Array) -> tuple[Array, Array, Array]:
        """Distances ``(n, 1)`` from the planes: a rotation w of a normal changes them by w'(n x p)."""
        rotation = fixtures * np.array([1.0, 1.0, 0.0])
        normal = exp(rotation)[..., 2]
        observed = (normal * points).sum(axis=1, keepdims=True) - fixtures[:, 2:]
        by_rotation = np.cross(normal, points)[:, None] @ left_jacobian(rotation)[..., :2]
        return observed, normal[:, None], np.concatenate([by_rotation, -np.ones((len(points), 1, 1))], axis=2)

    def located(self, points: Array, observed: Array) -> Array:
        """The plane ``(3,)`` of least squares: the normal is the direction of least spread."""
        centre = points.mean(axis=0)
        normal = np.linalg.svd(points - centre)[2][-1]
        return _plane(normal if normal[2] >= 0 else -normal, centre)

    def at_base(self, placed: Array, T_base_instrument: Array, scale: float) -> Array:
        """Planes ``(m, 3)`` from normals and distances ``(m, 4)`` in the instrument's frame."""
        normals = placed[:, :3] @ T_base_instrument[:3, :3].T
        points = transform(T_base_instrument, scale * placed[:, :3] * placed[:, 3:])
        upper = normals * np.where(normals[:, 2:] < 0, -1.0, 1.0)
        return np.array([_plane(normal, point) for normal, point in zip(upper, points, strict=True)])

    def random_fixtures(self, points: Array, rng: np.random.Generator) -> Array:
        """Planes ``(m, 3)`` through the points, of random normals in the upper half."""
        normals = rng.normal(size=(len(points), 3))
        normals[:, 2] = np.abs(normals[:, 2])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return np.array([_plane(normal, point) for normal, point in zip(normals, points, strict=True)])


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
    finds_poses: ClassVar[bool] = True

    def rows(self, data: Measurements) -> NDArray[np.bool_]:
        """``(n,)``: all, as a contact needs no column of its own."""
        return np.ones(len(data), dtype=np.bool_)

    def fixture_rows(self, arm: Model, data: Measurements, nominal: Array) -> FixtureRows:
        """The planes by location, else by session; one plane where nothing names any.

        Raises:
            LabError: some rows name their plane, and another does not.
        """
        column = "location" if "location" in data.other else "session"
        labels = data.other.get("location", data.sessions)
        if any(labels):
            refuse_blank(data, column, labels, Planes.group)
        return FixtureRows(labels, np.zeros((len(data), 1)))

    def fixtures(self, arm: Model, nominal: Array, numbers: tuple[int, ...], labels: tuple[str, ...]) -> Fixtures:
        """The planes."""
        return Planes(arm, nominal, numbers, labels)

    def simulate(
        self,
        real: TrueRobot,
        joints: Array,
        targets: tuple[str, ...],
        instrument: Instrument,
        rng: np.random.Generator,
        readings: int,
        conditions: Mapping[str, Array],
        setup: VirtualSetup,
    ) -> SimulatedReadings:
        """Touch one plane after the other, in as many poses as ``joints`` ``(n, joints)``, which are new ones."""
        refuse_several_targets("plane", targets)
        chance, placing = Chance.of(real, instrument, (len(joints), 1), rng, readings), rng.spawn(1)[0]
        set_there = without_sessions(conditions)
        on, near = reachable_points(real, setup.fixtures, placing)
        normals = placing.standard_normal(on.shape)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        heights, number = (normals * on).sum(axis=1), np.arange(len(joints)) % len(on)

        def gap(points: Array, rows: NDArray[np.int_]) -> Array:
            plane = number[rows]
            along = (normals[plane] * (points - chance.displaced[rows])).sum(axis=1)
            return np.asarray(along - heights[plane] - chance.noise[rows, 0])[:, None]

        touching = Contacts(real, set_there, chance.scatter, gap, near[number]).joints(placing)
        locations = tuple(str(1 + i) for i in number.tolist())
        data = fixture_measurements(real, touching, set_there, {"location": locations})
        placed = {
            f"plane.{1 + i}": np.append(normal, z) for i, (normal, z) in enumerate(zip(normals, heights, strict=True))
        }
        return SimulatedReadings(data, chance.bad, placed)


def _plane(normal: Array, point: Array) -> Array:
    """``(rx, ry, z)`` of the plane through a point ``(3,)``: e_z rotates into the normal ``(3,)`` about e_z x n."""
    level = float(np.hypot(normal[0], normal[1]))
    angle = float(np.arctan2(level, normal[2]))
    ratio = angle / level if level > 1e-12 else 1.0
    return np.array([-ratio * normal[1], ratio * normal[0], float(normal @ point)])
