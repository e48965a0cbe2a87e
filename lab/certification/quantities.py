"""What a calibrated position depends on: instrument, reflector, temperature, robot, model, stability, parameters."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from lab.certification.budget import InputQuantity
from lab.certification.propagation import Propagation
from lab.core.covariance import covariance_root
from lab.core.distributions import Uncertain
from lab.core.measurements import seen_mask
from lab.core.probabilities import normal_ppf
from lab.core.se3 import Array
from lab.core.significance import VARIANCE_COMPONENTS
from lab.noise.tracker_errors import ErrorTerm, TrackerErrors

__all__ = [
    "LARGEST_SCALE_ERROR",
    "FrameMotion",
    "KnownSpread",
    "Placement",
    "RandomErrors",
    "lack_of_fit_of",
    "motion_of",
    "quantities_of",
    "scale_of",
    "temperature_of",
    "unseen_move_of",
]

LARGEST_SCALE_ERROR = 5e-3  # relative: more makes links longer than manufacture does, which a run shows
_DETECTED = 0.95  # chance with which a move of this size would have been found

_OF_AIR = ("air_temperature", "temperature_gradient")
_LEAST_FREEDOM = 3.0  # that a budget can state
Placement = Literal["in the noise", "in the residuals", "beside"]


@dataclass(frozen=True)
class KnownSpread:
    """How far positions scatter by chance, per axis, and where that comes from.

    Attributes:
        sigma_m: standard deviation of one coordinate.
        freedom: its degrees of freedom.
        of_residuals: whether it was estimated from what the model leaves.
    """

    sigma_m: float
    freedom: float
    source: str
    of_residuals: bool = False

    @property
    def uncertainty(self) -> Uncertain:
        """As a quantity of a budget."""
        return Uncertain(self.sigma_m, freedom=max(self.freedom, _LEAST_FREEDOM))


@dataclass(frozen=True)
class RandomErrors:
    """What is by chance: in the measurements that were fitted, and in the robot.

    Attributes:
        covariance: ``(f, f)`` of the identified parameters, by all random errors of the measurements.
        noise: of one coordinate of them.
        placement: whether how the reflector is placed is in the noise that was given, in the residuals that it was
            estimated from, or in neither.
        repeatability: of the robot; None where nothing is known of it.
        scatter_counted: whether what that does to the measurements is in ``covariance``.
        model: what the model lacks beside; None where nothing was found.
        in_time: what positions have that comes and goes over the poses, by the run's noise model; None likewise.
    """

    covariance: Array
    noise: KnownSpread
    placement: Placement
    repeatability: KnownSpread | None
    scatter_counted: bool
    model: KnownSpread | None
    in_time: KnownSpread | None = None

    @property
    def known(self) -> bool:
        """Whether nothing that was estimated from the residuals is taken for chance."""
        estimated = self.repeatability is not None and self.repeatability.of_residuals
        return self.model is None and self.in_time is None and not estimated


@dataclass(frozen=True)
class FrameMotion:
    """A motion of the measurements' frame during the campaign.

    Attributes:
        detail: what moved, and when.
        offset_m: from where the calibrated positions are to where they were at one end of the campaign.
        freedom: degrees of freedom of that.
    """

    detail: str
    source: str
    offset_m: float
    freedom: float = np.inf


def quantities_of(
    propagation: Propagation, errors: TrackerErrors, source: str, chance: RandomErrors
) -> tuple[InputQuantity, ...]:
    """All of them but the robot's temperature.

    Args:
        errors: systematic errors of the instrument.
        source: who states them.
        chance: what is random.
    """
    placed = [] if chance.placement == "in the residuals" else list(_placements(propagation, errors, source))
    systematic = [_systematic(propagation, errors, source, term) for term in errors.lasting]
    found = [*systematic, *(quantity for quantity, _ in placed)]
    covariance = chance.covariance
    if chance.placement == "in the noise" and placed:  # it has a line of its own
        covariance = covariance - np.sum([part for _, part in placed], axis=0)
    sigma = chance.noise.uncertainty
    said = "parameters", "identified parameters", chance.noise.source, "µm", 1e6, sigma
    shifts = covariance_root(covariance) / sigma.standard
    found.append(_fitted(propagation, shifts, *said, detail="random errors of the measurements"))
    each = np.broadcast_to(np.eye(3), (len(propagation.positions), 3, 3))
    if (robot := chance.repeatability) is not None:
        said = "repeatability", "repeatability of the robot", robot.source, "µm", 1e6, robot.uncertainty
        found.append(InputQuantity(*said, each, anew=True))
        if not chance.scatter_counted:
            alike = np.broadcast_to(np.eye(3), (*propagation.observed.points.shape, 3))
            shifts = covariance_root(propagation.covariance_of(alike))
            said = "repeatability", "repeatability in the measurements", *said[2:]
            found.append(_fitted(propagation, shifts, *said))
    if (lack := chance.model) is not None:
        said = "model", "model", lack.source, "µm", 1e6, lack.uncertainty
        found.append(InputQuantity(*said, each, anew=True, detail="errors of the robot that it leaves"))
    if (slow := chance.in_time) is not None:
        said = "stability", "stability", slow.source, "µm", 1e6, slow.uncertainty
        found.append(InputQuantity(*said, each, anew=True, detail="errors that come and go over the poses"))
    return tuple(found)


def motion_of(propagation: Propagation, motion: FrameMotion) -> InputQuantity:
    """The frame of the measurements moved: a position at the campaign's end is elsewhere by the offset.

    Its direction is not known, so each coordinate has a third of its square. Of two positions each may be of any time,
    so that a distance between them has it twice.
    """
    each = np.broadcast_to(np.eye(3), (len(propagation.positions), 3, 3))
    known = Uncertain(motion.offset_m / float(np.sqrt(3)), freedom=max(motion.freedom, _LEAST_FREEDOM))
    said = "stability", "stability", motion.source, "µm", 1e6, known
    return InputQuantity(*said, each, anew=True, detail=motion.detail)


def lack_of_fit_of(propagation: Propagation, sigma_m: float, freedom: float, source: str) -> InputQuantity:
    """What validation shows beyond the rest of the budget."""
    each = np.broadcast_to(np.eye(3), (len(propagation.positions), 3, 3))
    known = Uncertain(sigma_m, freedom=max(freedom, _LEAST_FREEDOM))
    detail = "errors on validation poses that the budget does not explain"
    return InputQuantity("model", "lack of fit", source, "µm", 1e6, known, each, anew=True, detail=detail)


def scale_of(propagation: Propagation, relative: Uncertain, source: str) -> InputQuantity:
    """The scale of the measurements: all points are farther from the instrument, or nearer, by a share."""
    shifts = propagation.shifts_by(_seen(propagation)[..., None])
    return _fitted(propagation, shifts, "misalignment", "scale of the measurements", source, "ppm", 1e6, relative)


def unseen_move_of(propagation: Propagation, sigma_m: float) -> InputQuantity:
    """A move of base or instrument half way that is too small to be found: calibrated positions are off by half of it.

    A mean of half the points against that of the others finds it with the power stated, at the level of the search for
    change points, of which every pose is one.

    Args:
        sigma_m: what a measured coordinate scatters by.
    """
    points = int(seen_mask(propagation.observed.points).sum())
    level = VARIANCE_COMPONENTS / (2 * len(propagation.observed.points))
    limit = float(normal_ppf(1 - level) + normal_ppf(_DETECTED)) * sigma_m / float(np.sqrt(points))
    each = np.broadcast_to(np.eye(3), (len(propagation.positions), 3, 3))
    words, source = "a move of base or instrument during the campaign", "too small to be found by these poses"
    return InputQuantity("stability", words, source, "µm", 1e6, Uncertain.within(limit), each)


def temperature_of(propagation: Propagation, foot: Array, kelvin: Uncertain, expansion_per_k: float) -> InputQuantity:
    """The robot's temperature: all lengths grow with it about the robot's foot ``(3,)`` m."""
    columns = expansion_per_k * (propagation.positions - foot)[..., None]
    source = f"stated, expansion {1e6 * expansion_per_k:g} ppm/K"
    return InputQuantity("temperature", "temperature of the robot", source, "K", 1.0, kelvin, columns)


def _systematic(propagation: Propagation, errors: TrackerErrors, source: str, term: ErrorTerm) -> InputQuantity:
    """A systematic error of the instrument, through the fit."""
    group = "temperature" if term.name in _OF_AIR else "reflector" if term.name == "centring_depth" else "misalignment"
    shifts = propagation.shifts_by(errors.displacements(term, _seen(propagation)))
    return _fitted(propagation, shifts, group, term.words, source, term.unit, term.factor, errors.quantity(term))


def _placements(propagation: Propagation, errors: TrackerErrors, source: str) -> Iterator[tuple[InputQuantity, Array]]:
    """What nest and range are off by anew in each pose, with the covariance of the parameters that it makes."""
    for term in errors.placement:
        quantity = errors.quantity(term)
        group = "misalignment" if term.name == "lock_on" else "reflector"
        covariance = propagation.covariance_of(errors.placement_covariance(_seen(propagation), (term,)))
        shifts = covariance_root(covariance) / quantity.standard
        said = group, term.words, source, term.unit, term.factor, quantity
        yield _fitted(propagation, shifts, *said, placed=True), covariance


def _fitted(
    propagation: Propagation,
    shifts: Array,
    group: str,
    name: str,
    source: str,
    unit: str,
    factor: float,
    uncertainty: Uncertain,
    *,
    detail: str = "",
    placed: bool = False,
) -> InputQuantity:
    """A quantity that comes through the fit, by its shifts ``(f, c)`` of the identified parameters."""
    columns = propagation.columns_of(shifts)
    said = group, name, source, unit, factor, uncertainty
    return InputQuantity(*said, columns, shifts=shifts, detail=detail, placed=placed)


def _seen(propagation: Propagation) -> Array:
    """The measured points; ones where nothing was measured, which nothing counts."""
    return np.nan_to_num(propagation.observed.points, nan=1.0)
