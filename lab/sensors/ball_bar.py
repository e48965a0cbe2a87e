"""Measure with a ball bar: its length between a fixed socket and the tool is known; the socket's place is fitted."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lab.calibration.sensor import SensorTerms
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.measurement_csv import ObservedColumns
from lab.sensors.artefact import Artefact, ArtefactSensor
from lab.sensors.cable import trilaterated
from lab.sensors.contact import DrawnContacts, FixtureSimulation
from lab.sensors.fixtures import NONE, Fixtures, known_lengths
from lab.sensors.sensor_options import VirtualSetup
from lab.sensors.size import drawn_size

__all__ = ["BallBar", "BallBarSensor"]


@dataclass(frozen=True)
class BallBar(Artefact):
    """A bar between the tool and sockets: the distance is its length, ``|p - socket| - length = 0``.

    A feature is the length of the bar that was used.
    """

    group: ClassVar[str] = "bar"
    axes: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    least_rows: ClassVar[int] = 4
    starts: ClassVar[int] = Fixtures.starts
    draws: ClassVar[int] = Fixtures.draws

    def centres(self, known: Array) -> Array:
        """Return the socket, which is the origin."""
        return np.zeros((len(known), 3))

    def gap(self, near: Array, known: Array, scale: float) -> tuple[Array, Array, Array]:
        """Return distances from the sphere on which the bar's end moves."""
        distance = np.sqrt((near * near).sum(axis=1, keepdims=True))
        return distance - scale * known, (near / distance)[:, None], -known

    def located(self, points: Array, observed: Array, rows: Array = NONE) -> Array:
        """Return the socket ``(3,)`` by trilateration."""
        return trilaterated(points, np.array(self.features)[rows[:, 0].astype(np.int_), 0])

    def random_fixtures(self, points: Array, rng: np.random.Generator) -> Array:
        """Draw sockets ``(k, 3)``, one bar's length from the points."""
        away = rng.standard_normal(points.shape)
        return np.asarray(points + max(self.features)[0] * away / np.linalg.norm(away, axis=1, keepdims=True))

    def at_base(self, placed: Array, T_base_instrument: Array, scale: float) -> Array:
        """Return sockets ``(k, 3)`` in the base's frame."""
        return Fixtures.at_base(self, placed, T_base_instrument, scale)


@dataclass(frozen=True)
class BallBarSensor(ArtefactSensor):
    """Poses in which a bar of known length fits between the tool and a socket."""

    name: ClassVar[str] = "ball-bar"
    terms: ClassVar[SensorTerms] = SensorTerms(
        measured="poses of a ball bar",
        reading="length of the ball bar",
        error="error of the bar's length",
        placed="tool and sockets",
        names_targets=False,
    )
    columns: ClassVar[ObservedColumns] = ObservedColumns(
        positions=False, numbers=("bar_mm",), texts=("location",), observed="ball-bar"
    )
    model: ClassVar[type[Fixtures]] = BallBar

    def known(self, data: Measurements) -> tuple[Sequence[str], Array]:
        """Return the bars, named and known by their length.

        Raises:
            LabError: the lengths are missing, or one is not above zero.
        """
        there = np.isfinite(data.conditions.get("bar_mm", np.zeros(len(data))))
        lengths = known_lengths(data, "bar_mm", "bar", there)
        names = [f"{1e3 * length:.9g} mm" if used else "" for length, used in zip(lengths, there, strict=True)]
        return names, lengths[:, None]

    def undetermined(self, known: Array) -> str:
        """Return nothing: one bar places its socket."""
        return ""

    def drawn(self, arm: FixtureSimulation, setup: VirtualSetup) -> DrawnContacts:
        """Draw sockets within reach, about each of which the bar swings."""
        sockets, near = arm.reachable_points(setup.fixtures)
        length_m, count = MM.to_si(setup.artefact_mm), len(arm.bad)
        scale, number = drawn_size(self.size_u, arm.rng), np.arange(count) % setup.fixtures

        def gap(points: Array, rows: NDArray[np.int_]) -> Array:
            away = np.linalg.norm(points[:, 0] - arm.displaced[rows] - sockets[number[rows]], axis=1)
            return np.asarray(away - (1 + scale) * length_m - arm.noise[rows, 0])[:, None]

        texts = {"location": tuple(str(1 + i) for i in number.tolist())}
        placed = {f"bar.{1 + i}": socket for i, socket in enumerate(sockets)} | {"bar": np.array([scale])}
        return DrawnContacts(near[number], gap, placed, texts, {"bar_mm": np.full(count, setup.artefact_mm)})
