"""Measure on a plate of spheres: their centres are found or their surfaces touched; the plate's pose is fitted."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lab.calibration.sensor import SensorTerms
from lab.core.errors import LabError, option_name
from lab.core.measurements import Measurements
from lab.core.se3 import Array, transform
from lab.core.units import MM
from lab.formats.measurement_csv import ObservedColumns
from lab.sensors.artefact import Artefact, ArtefactSensor
from lab.sensors.contact import DrawnContacts, FixtureSimulation
from lab.sensors.fixtures import Fixtures, known_lengths
from lab.sensors.sensor_options import ProbeOptions, VirtualSetup
from lab.sensors.size import drawn_size

__all__ = ["SpherePlate", "SpherePlateSensor", "TouchedSpheres"]

_AXES = tuple(f"sphere_{axis}_mm" for axis in "xyz")
_CORNERS = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0], [0.0, 0.0, 0.0]])
_OFF_A_LINE = 1e-3  # of the spheres' extent


@dataclass(frozen=True)
class SpherePlate(Artefact):
    """A seat on the tool that is centred on the spheres of plates: ``y - centre = 0``.

    A feature is the centre of its sphere (3), and the distance of the tool's point from it in contact.
    """

    group: ClassVar[str] = "plate"
    least_rows: ClassVar[int] = 3

    def centres(self, known: Array) -> Array:
        """Return the centres of the spheres."""
        return known[:, :3]

    def gap(self, near: Array, known: Array, scale: float) -> tuple[Array, Array, Array]:
        """Return vectors from the centres."""
        one = np.broadcast_to(np.eye(3), (len(near), 3, 3))
        return near - scale * known[:, :3], one, -known[:, :3]


@dataclass(frozen=True)
class TouchedSpheres(SpherePlate):
    """A ball on the tool that touches the surfaces of a plate's spheres: ``|y - centre| - distance = 0``."""

    least_rows: ClassVar[int] = 7

    def gap(self, near: Array, known: Array, scale: float) -> tuple[Array, Array, Array]:
        """Return distances from the surfaces."""
        away = near - scale * known[:, :3]
        distance = np.sqrt((away * away).sum(axis=1, keepdims=True))
        along = away / distance
        return distance - known[:, 3:], along[:, None], -(along * known[:, :3]).sum(axis=1, keepdims=True)


@dataclass(frozen=True)
class SpherePlateSensor(ArtefactSensor):
    """Contacts with the spheres of a plate: their surfaces where the file has their radius, else their centres."""

    name: ClassVar[str] = "sphere-plate"
    terms: ClassVar[SensorTerms] = SensorTerms(
        measured="contacts with the spheres of a plate",
        reading="sphere of a plate, and its centre",
        error="distance from the sphere",
        placed="tool and plates",
        names_targets=False,
    )
    columns: ClassVar[ObservedColumns] = ObservedColumns(
        positions=False, numbers=(*_AXES, "radius_mm"), texts=("location", "sphere"), observed="sphere-plate"
    )
    flags: ClassVar[type[ProbeOptions]] = ProbeOptions
    model: ClassVar[type[Fixtures]] = SpherePlate
    numbers: ClassVar[int] = 3

    def model_of(self, data: Measurements) -> type[Fixtures]:
        """Return the model of touched surfaces where the file has a radius, else that of centres."""
        return TouchedSpheres if "radius_mm" in data.conditions else SpherePlate

    def numbers_a_row(self, data: Measurements) -> int:
        """Return how many numbers a contact is: a vector from a centre, or a distance from a surface."""
        return 1 if "radius_mm" in data.conditions else 3

    def known(self, data: Measurements) -> tuple[Sequence[str], Array]:
        """Return the spheres, with the centre of each and the distance of the tool's point from it.

        Raises:
            LabError: a column is missing, a sphere lacks a coordinate, or a radius is given with centred spheres.
        """
        if "sphere" not in data.other:
            raise LabError(f"column sphere is missing: {option_name('observe')} sphere-plate needs the sphere's name")
        spheres = data.other["sphere"]
        there = np.array([bool(name) for name in spheres], dtype=np.bool_)
        centres = [known_lengths(data, column, "plate", there, positive=False) for column in _AXES]
        if "radius_mm" in data.conditions:
            distance = known_lengths(data, "radius_mm", "plate", there) + self.tip_m
        elif self.tip_m:
            raise LabError(
                f"{option_name('tip_radius_mm')} is of touched surfaces, and without a column radius_mm the spheres "
                "are centred: add the column, or leave the option out"
            )
        else:
            distance = np.zeros(len(data))
        return spheres, np.column_stack([*centres, distance])

    def undetermined(self, known: Array) -> str:
        """Return that the touched spheres lie on a line, where they do."""
        spread = np.linalg.svd(known[:, :3] - known[:, :3].mean(axis=0), compute_uv=False)
        if len(known) > 2 and spread[1] > _OFF_A_LINE * spread[0]:
            return ""
        return "its touched spheres lie on a line, so its pose is unknown; touch three that do not"

    def drawn(self, arm: FixtureSimulation, setup: VirtualSetup) -> DrawnContacts:
        """Centre on the spheres of plates on a table, four in a square and one in its middle."""
        centres = MM.to_si(setup.artefact_mm) * _CORNERS
        frames, near, plate, sphere = self.on_a_table(arm, setup, centres, len(centres))
        scale = drawn_size(self.size_u, arm.rng)
        on = (1 + scale) * centres[sphere]
        places = transform(frames[plate], on[:, None])[:, 0] + arm.noise + arm.displaced
        texts = {"location": tuple(str(1 + i) for i in plate), "sphere": tuple(str(1 + i) for i in sphere)}
        numbers = dict(zip(_AXES, MM.of(centres[sphere]).T, strict=True))
        return DrawnContacts.at(places, near[plate], self.placed_artefacts(frames, scale), texts, numbers)
