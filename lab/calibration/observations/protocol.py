"""What is seen of an arm: a model, with a start for what each set of measurements places anew.

Points in an instrument's frame are one kind of sighting; poses, distances, sockets and planes are
others (``poses``, ``places``), each a model of the same arm with parameters of its own.
"""

from dataclasses import dataclass
from typing import Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.initial_guess import initial_guess
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.kinematics.model import Model


@runtime_checkable
class Observation(Protocol):
    """What identification needs to know of a kind of measurement, beside its model.

    A model that is seen by points in an instrument's frame needs none of its own (``observation_of``).
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

    @property
    def positions(self) -> int:
        """How many of the observed things, from the first, are positions in the instrument's frame."""

    def within(self, data: Measurements) -> Self:
        """The same with the parameters that these measurements can say anything of."""

    def nominal(self, values: Array) -> Array:
        """The drawing's parameters ``(p,)`` from those of the arm, which are the first of ``values``."""

    def initial_guess(self, seen: Observations, values: Array) -> Array:
        """``values`` with what is ``placed`` near enough for Gauss-Newton, from no idea of it."""

    def extra_residuals(self, values: Array) -> tuple[Array, Array]:
        """More residuals ``(r,)`` in m, and what predicts them ``(r, p)``: what is known beside the measurements.

        They weigh as positions do, so what is known better is to be multiplied by how much.
        """

    def errors(self, data: Measurements, values: Array) -> Array:
        """Lengths of the errors ``(n, things)`` in m at rows that were not fitted, NaN where not seen.

        What only these rows can place (the centre of a socket) is placed by them.
        """

    def cv_groups(self, data: Measurements) -> NDArray[np.int_] | None:
        """Labels ``(n,)`` of rows that are fitted or held out as one; None for repeats of a configuration."""


@dataclass(frozen=True)
class Points:
    """Positions of targets in an instrument's frame: base and tool are placed."""

    model: Model
    placed: tuple[str, ...] = ("base", "tool")

    @property
    def units(self) -> Array:
        """All are positions."""
        return np.ones(len(self.model.targets))

    @property
    def positions(self) -> int:
        """All are positions."""
        return len(self.model.targets)

    def within(self, data: Measurements) -> Self:
        """The arm is the same whatever was measured."""
        return self

    def nominal(self, values: Array) -> Array:
        """The arm's own."""
        return values

    def initial_guess(self, seen: Observations, values: Array) -> Array:
        """Base and tool by the direct linear transform."""
        return initial_guess(self.model, seen, values)

    def extra_residuals(self, values: Array) -> tuple[Array, Array]:
        """Nothing else is known."""
        return no_extra_residuals(self.model)

    def errors(self, data: Measurements, values: Array) -> Array:
        """Lengths of position errors ``(n, k)``."""
        left = self.model.points(data.inputs(self.model.conditions), values) - data.points
        return np.asarray(np.linalg.norm(left, axis=2))

    def cv_groups(self, data: Measurements) -> None:
        """Repeats of a configuration."""


def no_extra_residuals(model: Model) -> tuple[Array, Array]:
    """No residuals, and no derivatives of them."""
    return np.empty(0), np.empty((0, len(model.names)))


def observation_of(model: Model) -> Observation:
    """A model's own sighting where it is one, else by points."""
    return model if isinstance(model, Observation) else Points(model)
