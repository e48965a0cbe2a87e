"""Measure with dial indicators: a reading is the distance of the tool's ball along a fixed direction.

The ball moves the flat anvil of the indicator, whose direction and zero are fitted. Readings that are positive towards
a normal in the lower half are taken with their sign changed, so that the parameters of a direction are smooth.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from lab.calibration.sensor import SensorTerms
from lab.core.measurements import FIXTURE, Measurements
from lab.core.se3 import Array, transform
from lab.core.units import MM
from lab.formats.measurement_csv import ObservedColumns
from lab.kinematics.model import Model
from lab.sensors.contact import DrawnContacts, FixtureSimulation
from lab.sensors.fixtures import NONE, Fixtures, FixtureSensor
from lab.sensors.plane import Planes, plane_through
from lab.sensors.sensor_options import VirtualSetup

__all__ = ["DialSensor", "Dials"]

_STROKE_M = 10e-3  # of a simulated indicator
_ANVIL_M = 10e-3  # radius of its flat anvil
_RIM = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]])  # which have to be within reach


@dataclass(frozen=True)
class Dials(Planes):
    """Distances from the planes in which indicators read zero: ``n'p - z`` (m) along the direction n.

    Attributes:
        reversed: numbers of the indicators whose readings are counted against their own direction.
    """

    reversed: frozenset[int] = frozenset()
    group: ClassVar[str] = "dial"
    contact: ClassVar[bool] = False

    def located(self, points: Array, observed: Array, rows: Array = NONE) -> Array:
        """Return the plane ``(3,)`` of zero: readings are linear in the points."""
        normal, centre = _direction(points, observed[:, 0]), points.mean(axis=0)
        return plane_through(normal, centre - normal * observed.mean())

    def at_base(self, placed: Array, T_base_instrument: Array, scale: float) -> Array:
        """Return planes ``(k, 3)`` from directions and zeros ``(k, 4)`` in the instrument's frame."""
        signs = np.array([-1.0 if number in self.reversed else 1.0 for number in self.numbers])
        normals = placed[:, :3] @ T_base_instrument[:3, :3].T * signs[:, None]
        points = transform(T_base_instrument, scale * placed[:, :3] * placed[:, 3:])
        return np.array([plane_through(normal, point) for normal, point in zip(normals, points, strict=True)])


def _direction(points: Array, readings: Array) -> Array:
    """Return the direction ``(3,)`` in which readings ``(n,)`` grow along points ``(n, 3)``, all m."""
    normal = np.linalg.lstsq(points - points.mean(axis=0), readings - readings.mean())[0]
    return np.asarray(normal / max(float(np.linalg.norm(normal)), 1e-300))


@dataclass(frozen=True)
class DialSensor(FixtureSensor):
    """Readings of dial indicators, one after the other or several around one place."""

    name: ClassVar[str] = "dial"
    terms: ClassVar[SensorTerms] = SensorTerms(
        measured="readings of dial indicators",
        reading="reading of a dial indicator",
        error="error of the indicator's reading",
        placed="tool and indicators",
        names_targets=False,
    )
    columns: ClassVar[ObservedColumns] = ObservedColumns(
        positions=False, numbers=("dial_mm",), texts=("location",), observed="dial"
    )
    model: ClassVar[type[Fixtures]] = Dials
    reading: ClassVar[str] = "dial_mm"

    def observation(self, arm: Model, data: Measurements, nominal: Array) -> tuple[Model, Measurements]:
        """Return the indicators and their readings, each counted towards the upper half of the base's frame.

        Raises:
            LabError: as for every fixture.
        """
        model, seen = super().observation(arm, data, nominal)
        assert isinstance(model, Dials)
        points = arm.points(seen.inputs(arm.conditions), np.asarray(nominal)[: len(arm.names)])[:, 0]
        number, readings = seen.conditions[FIXTURE], seen.points[:, 0, 0]
        lower = [i for i in model.numbers if _direction(points[number == i], readings[number == i])[2] < 0]
        signs = np.where(np.isin(number, lower), -1.0, 1.0)[:, None, None]
        return replace(model, reversed=frozenset(lower)), replace(seen, points=signs * seen.points)

    def drawn(self, arm: FixtureSimulation, setup: VirtualSetup) -> DrawnContacts:
        """Place indicators at random; each is read within its stroke and on its anvil."""
        frames, near = arm.frames_within_reach(setup.fixtures, _ANVIL_M * _RIM, upright=False)
        zeros, normals = frames[:, :3, 3], frames[:, :3, 2]
        count = len(arm.bad)
        number = np.arange(count) % setup.fixtures
        # on the anvil, which is flat across the direction
        aside = _ANVIL_M / np.sqrt(2) * arm.rng.uniform(-1, 1, (count, 3))
        along = normals[number]
        aside -= along * (aside * along).sum(axis=1, keepdims=True)
        readings = arm.rng.uniform(0, _STROKE_M, count)
        places = zeros[number] + aside + along * readings[:, None] + arm.displaced
        shown = readings + (arm.displaced * along).sum(axis=1) + arm.noise[:, 0]
        heights = (normals * zeros).sum(axis=1)
        placed = {
            f"dial.{1 + i}": np.append(normal, z) for i, (normal, z) in enumerate(zip(normals, heights, strict=True))
        }
        texts = {"location": tuple(str(1 + i) for i in number.tolist())}
        return DrawnContacts.at(places, near[number], placed, texts, {"dial_mm": MM.of(shown)})
