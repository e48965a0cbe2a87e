"""Measure on a cube: its faces are touched, planes of known distances at right angles; its pose is fitted."""

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

__all__ = ["Cube", "CubeSensor"]

_FACES = {
    f"{axis}{sign}": sense * np.eye(3)[i] for i, axis in enumerate("xyz") for sign, sense in (("+", 1), ("-", -1))
}
_ON_A_TABLE = ("x+", "x-", "y+", "y-", "z+")  # the faces that can be touched
_VERTICES = np.stack(np.meshgrid((-1, 1), (-1, 1), (-1, 1)), axis=-1).reshape(-1, 3)
_WITHIN = 0.8  # of a face, where it is touched


@dataclass(frozen=True)
class Cube(Artefact):
    """Points on the faces of cubes: the distance along a face's normal n is ``n'y = edge / 2 + tip``.

    A feature is its normal (3), half of the edge along it, and the radius of the tip.
    """

    group: ClassVar[str] = "cube"
    least_rows: ClassVar[int] = 7

    def centres(self, known: Array) -> Array:
        """Return the centres of the faces."""
        return known[:, :3] * known[:, 3:4]

    def gap(self, near: Array, known: Array, scale: float) -> tuple[Array, Array, Array]:
        """Return distances from the faces."""
        normal, half, tip = known[:, :3], known[:, 3:4], known[:, 4:]
        return (normal * near).sum(axis=1, keepdims=True) - scale * half - tip, normal[:, None], -half


@dataclass(frozen=True)
class CubeSensor(ArtefactSensor):
    """Contacts with the faces of a cube."""

    name: ClassVar[str] = "cube"
    terms: ClassVar[SensorTerms] = SensorTerms(
        measured="contacts with the faces of a cube",
        reading="face and edge of a cube",
        error="distance from the cube's face",
        placed="tool and cubes",
        names_targets=False,
    )
    columns: ClassVar[ObservedColumns] = ObservedColumns(
        positions=False, numbers=("edge_mm",), texts=("location", "face"), observed="cube"
    )
    flags: ClassVar[type[ProbeOptions]] = ProbeOptions
    model: ClassVar[type[Fixtures]] = Cube

    def known(self, data: Measurements) -> tuple[Sequence[str], Array]:
        """Return the touched faces, with their normals and half the edge along each.

        Raises:
            LabError: a column is missing, a face is none of a cube, or an edge is not above zero.
        """
        if "face" not in data.other:
            raise LabError(f"column face is missing: {option_name('observe')} cube needs x+, x-, y+, y-, z+ or z-")
        faces = data.other["face"]
        for row, face in enumerate(faces):
            if face and face not in _FACES:
                raise LabError(f"{data.where(row)}, column face: '{face}' is none of {', '.join(_FACES)}")
        there = np.array([bool(face) for face in faces], dtype=np.bool_)
        half = known_lengths(data, "edge_mm", "cube", there) / 2
        normals = np.array([_FACES.get(face, np.zeros(3)) for face in faces]).reshape(-1, 3)
        return faces, np.column_stack([normals, half, np.full(len(data), self.tip_m)])

    def undetermined(self, known: Array) -> str:
        """Return the axes along which no face was touched."""
        along = np.abs(known[:, :3]).sum(axis=0)
        axes = [axis for axis, touched in zip("xyz", along, strict=True) if not touched]
        return f"no face along {' or '.join(axes)} was touched, so its pose is unknown; touch all three" if axes else ""

    def drawn(self, arm: FixtureSimulation, setup: VirtualSetup) -> DrawnContacts:
        """Touch the five free faces of cubes on a table."""
        edge_m = MM.to_si(setup.artefact_mm)
        frames, near, cube, face = self.on_a_table(arm, setup, edge_m / 2 * _VERTICES, len(_ON_A_TABLE))
        scale = drawn_size(self.size_u, arm.rng)
        normals = np.array([_FACES[name] for name in _ON_A_TABLE])[face]
        aside = _WITHIN * edge_m / 2 * arm.rng.uniform(-1, 1, (len(face), 3)) * (normals == 0)
        on = aside + normals * ((1 + scale) * edge_m / 2 + self.tip_m + arm.noise)
        places = transform(frames[cube], on[:, None])[:, 0] + arm.displaced
        texts = {"location": tuple(str(1 + i) for i in cube), "face": tuple(_ON_A_TABLE[i] for i in face)}
        numbers = {"edge_mm": np.full(len(face), setup.artefact_mm)}
        return DrawnContacts.at(places, near[cube], self.placed_artefacts(frames, scale), texts, numbers)
