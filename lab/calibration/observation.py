"""Define an observation: the model that predicts a sensor's readings, and initial values for what they place."""

from dataclasses import dataclass
from typing import Protocol, Self, cast, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.guess import initial_guess
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.kinematics.effects.sessions import GROUP, further_stations
from lab.kinematics.model import Model
from lab.kinematics.parameter import placed_parameters

__all__ = [
    "ROTATION_PARAMETERS",
    "ArmObservation",
    "Observation",
    "Points",
    "ReadingsInWholes",
    "UnscaledObservation",
    "UnsizedObservation",
    "WeighsPriors",
    "no_extra_residuals",
    "observation_of",
    "only_positions",
    "placed_in_instrument_frame",
]

_OBSERVES: dict[type, bool] = {}  # whether models of a class are observations
ROTATION_PARAMETERS = placed_parameters("tool", "tool", ("rx", "ry", "rz"))  # of a measured orientation


@runtime_checkable
class Observation(Protocol):
    """Observation of an arm: the information that identification needs beside its model.

    An arm that is measured by points in an instrument's frame needs none of its own (``observation_of``).
    """

    @property
    def model(self) -> Model:
        """The arm, with the parameters that the measurements add to it."""

    @property
    def placed(self) -> tuple[str, ...]:
        """Groups of parameters without a nominal value, e.g. ``("base", "tool")``: fitted for the nominal arm, too."""

    @property
    def units(self) -> Array:
        """``(k,)``: the noise of each observed quantity, in its unit, where that of a position is 1 m."""

    @property
    def positions(self) -> int:
        """Number of observed quantities, from the first, that are positions in the instrument's frame."""

    def within(self, data: Measurements) -> Self:
        """Return the observation with the parameters that these measurements depend on."""

    def nominal(self, values: Array) -> Array:
        """Return nominal parameters ``(p,)`` from those of the arm, which are the first of ``values``."""

    def initial_guess(self, observed: Observations, values: Array) -> Array:
        """Return ``values`` ``(p,)`` with ``placed`` groups near enough for Gauss-Newton, without initial values."""

    def extra_residuals(self, values: Array) -> tuple[Array, Array]:
        """Return prior information: residuals ``(r,)`` in m, and derivatives ``(r, p)`` of their model.

        They have the weight of positions; scale up more accurate information accordingly.
        """

    def errors(self, data: Measurements, values: Array) -> Array:
        """Lengths ``(n, k)`` in m of the errors at rows that were not fitted, NaN where nothing was observed.

        What only these rows can place (the centre of a socket) is placed by them.
        """

    def cv_groups(self, data: Measurements) -> NDArray[np.int_] | None:
        """Labels ``(n,)`` of rows that are fitted or held out together; None for repeats of a configuration."""


@runtime_checkable
class UnsizedObservation(Observation, Protocol):
    """Observation that may not show an arm's size: contacts with fixtures, pictures of boards of unknown size."""

    @property
    def unsized(self) -> bool:
        """Check whether the readings alone determine the arm's shape and not its size."""

    @property
    def scale_link(self) -> int:
        """Index of the length that stays nominal where the size is not shown."""


@runtime_checkable
class WeighsPriors(Observation, Protocol):
    """Observation whose own parameters have priors in units of their own, which weigh by the noise of the readings."""

    @property
    def sigma(self) -> float:
        """Noise of a reading where its unit is one, by which ``extra_residuals`` weighs the priors."""

    def weighed(self, sigma: float) -> Self:
        """Return the observation whose priors weigh by this noise."""


@runtime_checkable
class UnscaledObservation(Observation, Protocol):
    """Observation whose readings spread by parameters that have no nominal values, so that a unit does not show."""

    @property
    def spreads_freely(self) -> bool:
        """Check whether the spread of the readings says nothing of their unit."""


@runtime_checkable
class ReadingsInWholes(Observation, Protocol):
    """Observation of places ``(n, 1, 2)`` that come in wholes, off together: corners in pictures."""

    def wholes(self, inputs: Array) -> NDArray[np.int_]:
        """Return the number of each row's whole, from 0 on."""


@runtime_checkable
class ArmObservation(Observation, Protocol):
    """Observation of an arm whose parameters are the first, and whose conditions are the first."""

    @property
    def arm(self) -> Model:
        """The arm, measured by points."""


@dataclass(frozen=True)
class Points:
    """Positions of targets in an instrument's frame; base and tool are placed, and its stations if it had several."""

    model: Model

    @property
    def placed(self) -> tuple[str, ...]:
        """Groups of parameters without a nominal value."""
        return placed_in_instrument_frame(self.model)

    @property
    def units(self) -> Array:
        """``(k,)`` ones: all are positions."""
        return np.ones(len(self.model.targets))

    @property
    def positions(self) -> int:
        """Number of targets: all of them are positions."""
        return len(self.model.targets)

    def within(self, data: Measurements) -> Self:
        """Return the observation unchanged: no parameter is of some rows alone."""
        return self

    def nominal(self, values: Array) -> Array:
        """Return the arm's own ``(p,)``."""
        return values

    def initial_guess(self, observed: Observations, values: Array) -> Array:
        """Estimate base and tool by the direct linear transform."""
        return initial_guess(self.model, observed, values)

    def extra_residuals(self, values: Array) -> tuple[Array, Array]:
        """Return no extra residuals."""
        return no_extra_residuals(self.model)

    def errors(self, data: Measurements, values: Array) -> Array:
        """Lengths ``(n, k)`` of position errors in m."""
        residuals = self.model.points(data.inputs(self.model.conditions), values) - data.points
        return np.asarray(np.linalg.norm(residuals, axis=2))

    def cv_groups(self, data: Measurements) -> None:
        """Return no groups: repeats of a configuration are held out together."""


def placed_in_instrument_frame(model: Model) -> tuple[str, ...]:
    """Return the groups without nominal values where positions in the instrument's frame are observed."""
    return ("base", "tool", *((GROUP,) if further_stations(model.parameters) else ()))


def no_extra_residuals(model: Model) -> tuple[Array, Array]:
    """Return no residuals ``(0,)``, and no derivatives ``(0, p)``."""
    return np.empty(0), np.empty((0, len(model.names)))


def observation_of(model: Model) -> Observation:
    """Return the model if it is an observation; else the arm measured by points."""
    kind = type(model)
    if kind not in _OBSERVES:  # looking for every member of a protocol takes as long as the points of 100 poses
        _OBSERVES[kind] = isinstance(model, Observation)
    return cast(Observation, model) if _OBSERVES[kind] else Points(model)


def only_positions(observation: Observation) -> bool:
    """Check whether everything that is observed is a position in the instrument's frame."""
    return observation.positions == len(observation.units)
