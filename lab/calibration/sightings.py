"""What is seen of an arm: a model, with a start for what each set of measurements places anew.

Points in an instrument's frame are one kind of sighting; poses, distances, sockets and planes are
others, each a model of the same arm with parameters of its own.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from lab.calibration.locate import locate
from lab.calibration.solver import Observations
from lab.frames import Array
from lab.geometry.model import Model


@runtime_checkable
class Sighting(Protocol):
    """What identification needs to know of a kind of measurement, beside its model.

    A model that is seen by points in an instrument's frame needs none of its own (``sighting_of``).
    """

    @property
    def model(self) -> Model:
        """The arm, with the parameters that the measurements add to it."""

    @property
    def placed(self) -> tuple[str, ...]:
        """Groups of parameters that have no drawing, e.g. ``("base", "tool")``: fitted before, too."""

    @property
    def units(self) -> Array:
        """``(k,)``: how large each observed thing's noise is, in its unit per m of a position's."""

    def located(self, seen: Observations, values: Array) -> Array:
        """``values`` with what is ``placed`` near enough for Gauss-Newton, from no idea of it."""

    def further(self, values: Array) -> tuple[Array, Array]:
        """More residuals ``(r,)`` in m, and what predicts them ``(r, p)``: what is known beside the measurements."""


@dataclass(frozen=True)
class Points:
    """Positions of targets in an instrument's frame: base and tool are placed."""

    model: Model
    placed: tuple[str, ...] = ("base", "tool")

    @property
    def units(self) -> Array:
        """All are positions."""
        return np.ones(len(self.model.targets))

    def located(self, seen: Observations, values: Array) -> Array:
        """Base and tool by the direct linear transform."""
        return locate(self.model, seen, values)

    def further(self, values: Array) -> tuple[Array, Array]:
        """Nothing else is known."""
        return np.empty(0), np.empty((0, len(self.model.names)))


def sighting_of(model: Model) -> Sighting:
    """A model's own sighting where it is one, else by points."""
    return model if isinstance(model, Sighting) else Points(model)
