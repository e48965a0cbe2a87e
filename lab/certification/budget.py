"""An uncertainty budget of a calibrated robot's positions, and of the distances between them.

The errors of a position are linear in the input quantities, e = sum of c x, with the columns c that the fit and the
closed forms of the errors give. The law of propagation sums their variances (JCGM 100:2008, GUM, 5.1.2), the effective
degrees of freedom are those of Welch and Satterthwaite (G.4.1). Beside it the quantities are drawn from their
distributions (JCGM 101:2008, Supplement 1); where the two differ by more than the digits that are given, what was drawn
counts (clause 8). A third time whole calibrations are drawn, and the parameters that they shift go through the full
kinematics: positions are not linear in them, and where that shows in the digits that are given, it counts.

What is stated is of the whole workspace: positions are at random poses of it. Of a position the error is a vector and
the expanded uncertainty the length that 95 % of the errors do not exceed, over poses and calibrations like this one.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import floor, log10
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import RANK_TOLERANCE, Observations
from lab.calibration.observation import Observation
from lab.core.linear_model import LinearModel, covariance_root
from lab.core.measurements import seen_mask
from lab.core.probability import Uncertain, normal_ppf
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.significance import VARIANCE_COMPONENTS
from lab.core.units import KELVIN, MICRONS, PPM, Unit
from lab.noise.instruments import SystematicError, TrackerErrors
from lab.prediction.workspace_prediction import length_not_exceeded

__all__ = [
    "COVERAGE",
    "LARGEST_SCALE_ERROR",
    "MEASURANDS",
    "Budget",
    "BudgetLine",
    "FrameMotion",
    "InputQuantity",
    "Measurand",
    "Placement",
    "Propagation",
    "RandomErrors",
    "RandomScatter",
    "RangeUncertainty",
    "budget_of",
    "lack_of_fit_of",
    "motion_of",
    "propagated",
    "quantities_of",
    "scale_of",
    "temperature_of",
    "unseen_move_of",
]

Measurand = Literal["position", "distance"]
Placement = Literal["in the noise", "in the residuals", "beside"]
COVERAGE = 0.95
MEASURANDS: tuple[Measurand, ...] = ("position", "distance")
_DRAWS = 500  # at each of the poses
_CALIBRATIONS = 400  # drawn, each at all of the poses
_POSES = 200
LARGEST_SCALE_ERROR = 5e-3  # relative: more makes links longer than manufacture does, which a run shows
_DETECTED = 0.95  # chance with which a move of this size would have been found
_OF_AIR = ("air_temperature", "temperature_gradient")
_MIN_DOF = 3.0  # that a budget can state
_DIGITS = 2  # of an expanded uncertainty (JCGM 100:2008, 7.2.6)


@dataclass(frozen=True)
class InputQuantity:
    """An input quantity of the position uncertainty, with its standard uncertainty.

    Attributes:
        group: misalignment, reflector, temperature, repeatability, model, stability or parameters.
        name: what it is.
        source: where its uncertainty comes from.
        uncertainty: of each of its components, SI.
        columns: ``(w, 3, c)`` how far a unit of each component moves the positions at w poses, m.
        anew: whether it is another one at each position; else all positions share it.
        shifts: ``(f, c)`` how far a unit of each component shifts the identified parameters; None for what does not
            come through the fit.
        detail: of ``name``; may be empty.
        placed: whether it is another error in each pose, of the fitted ones and of others.
    """

    group: str
    name: str
    source: str
    unit: Unit
    uncertainty: Uncertain
    columns: Array
    anew: bool = False
    shifts: Array | None = None
    detail: str = ""
    placed: bool = False

    @property
    def label(self) -> str:
        """The name with its detail."""
        return f"{self.name}: {self.detail}" if self.detail else self.name


@dataclass(frozen=True)
class BudgetLine:
    """A line of an uncertainty budget.

    Attributes:
        contribution_m: what the quantity contributes to the standard uncertainty (root mean square over the
            workspace).
    """

    quantity: InputQuantity
    contribution_m: float
    share: float

    @property
    def sensitivity(self) -> float:
        """Contribution by unit of the quantity, m over its SI unit."""
        return self.contribution_m / self.quantity.uncertainty.standard


@dataclass(frozen=True)
class _KinematicDraws:
    """The length that 95 % of the errors do not exceed, of the same drawn calibrations.

    Attributes:
        linear_m: with positions linear in the identified parameters.
        full_m: with positions by the full kinematics.
        draws: how many calibrations, each at all poses.
    """

    linear_m: float
    full_m: float
    draws: int


@dataclass(frozen=True)
class Budget:
    """The uncertainty of a measurand.

    Attributes:
        combined_m: combined standard uncertainty, root mean square over the workspace.
        propagated_m: expanded uncertainty by the law of propagation.
        drawn_m: the same by drawing the quantities so many times, with ``drawn_std_m`` its own standard deviation.
        kinematics: the same by drawing calibrations, linear and through the full kinematics.
    """

    measurand: Measurand
    lines: tuple[BudgetLine, ...]
    combined_m: float
    dof: float
    propagated_m: float
    drawn_m: float
    drawn_std_m: float
    draws: int
    kinematics: _KinematicDraws

    @cached_property
    def tolerance_m(self) -> float:
        """Half a unit of the last digit that is given of the expanded uncertainty (JCGM 101:2008, 7.9.2)."""
        return 0.5 * 10.0 ** (floor(log10(self.propagated_m)) + 1 - _DIGITS)

    @property
    def agrees(self) -> bool:
        """Check whether the Monte Carlo draws agree with the propagated value, within the draws' own error."""
        return abs(self.drawn_m - self.propagated_m) <= self.tolerance_m + 2 * self.drawn_std_m

    @property
    def is_linear(self) -> bool:
        """Check whether the full kinematics agree with the linear ones to the digits given."""
        return abs(self.kinematics.full_m - self.kinematics.linear_m) <= self.tolerance_m

    @property
    def expanded_m(self) -> float:
        """Expanded uncertainty for 95 % coverage, m: as propagated, or as drawn where that differs.

        Where positions are not linear in the parameters, it grows or shrinks as the drawn calibrations do.
        """
        linear = self.propagated_m if self.agrees else self.drawn_m
        return linear if self.is_linear else linear * self.kinematics.full_m / self.kinematics.linear_m

    @property
    def coverage_factor(self) -> float:
        """k: expanded over combined standard uncertainty."""
        return self.expanded_m / self.combined_m


@dataclass(frozen=True)
class _Propagated:
    """Result of the law of propagation of uncertainty for a measurand.

    Attributes:
        columns: ``(w, d, c)`` of each, m: what a unit of its components does to the d numbers of the measurand.
        variances: ``(quantities,)`` m^2, what each contributes.
    """

    quantities: tuple[InputQuantity, ...]
    columns: tuple[Array, ...]
    variances: Array
    dof: float
    expanded_m: float

    @property
    def combined_m(self) -> float:
        """Combined standard uncertainty."""
        return float(np.sqrt(self.variances.sum()))


def propagated(
    measurand: Measurand, quantities: Sequence[InputQuantity], positions: Array, rng: np.random.Generator
) -> _Propagated:
    """Propagate the uncertainty of positions, or of distances between random pairs of them.

    Args:
        quantities: those that matter; at least one has an uncertainty above zero.
        positions: ``(w, 3)`` m.
    """
    retained = [quantity for quantity in quantities if quantity.uncertainty.standard and quantity.columns.any()]
    columns = [quantity.columns for quantity in retained]
    if measurand == "distance":
        columns = _of_distances(retained, positions, rng)
    # u_i^2 c_i c_i' of each quantity, and its mean over the positions
    stds = np.array([quantity.uncertainty.standard for quantity in retained])
    squares = [std**2 * c @ np.swapaxes(c, 1, 2) for std, c in zip(stds.tolist(), columns, strict=True)]
    variances = np.array([np.trace(square, axis1=1, axis2=2).mean() for square in squares])
    # Welch and Satterthwaite's degrees of freedom
    freedoms = np.array([quantity.uncertainty.dof for quantity in retained])
    spread = float((variances**2 / freedoms).sum())  # an infinite one adds nothing
    dof = float(variances.sum() ** 2 / spread) if spread else np.inf
    expanded = length_not_exceeded(np.sum(squares, axis=0), None if np.isinf(dof) else dof)
    return _Propagated(tuple(retained), tuple(columns), variances, dof, expanded)


def budget_of(
    measurand: Measurand,
    quantities: Sequence[InputQuantity],
    positions: Array,
    moved: Callable[[Array], Array],
    rng: np.random.Generator,
) -> Budget:
    """Return the budget of positions, or of distances between random pairs of them.

    Args:
        quantities: those that matter; at least one has an uncertainty above zero.
        positions: ``(w, 3)`` m.
        moved: the same positions with the identified parameters shifted by ``(f,)``, by the full kinematics.
    """
    found = propagated(measurand, quantities, positions, rng)
    lengths = _drawn_lengths(found.quantities, found.columns, rng)
    drawn, std = _quantile(lengths)
    shares = found.variances / found.variances.sum()
    lines = [
        BudgetLine(quantity, float(np.sqrt(variance)), float(share))
        for quantity, variance, share in zip(found.quantities, found.variances, shares, strict=True)
    ]
    kinematics = _through_kinematics(measurand, found.quantities, positions, moved, rng)
    return Budget(
        measurand, tuple(lines), found.combined_m, found.dof, found.expanded_m, drawn, std, lengths.size, kinematics
    )


def _of_distances(quantities: Sequence[InputQuantity], positions: Array, rng: np.random.Generator) -> list[Array]:
    """Columns ``(w, 1, c)`` of the distance between each position and another one."""
    there = _partners(len(positions), rng)
    apart = positions - positions[there]
    along = (apart / np.linalg.norm(apart, axis=1, keepdims=True))[:, None]  # (w, 1, 3)
    found = []
    for each in quantities:
        here, far = along @ each.columns, along @ each.columns[there]
        found.append(np.concatenate([here, far], axis=2) if each.anew else here - far)
    return found


def _partners(count: int, rng: np.random.Generator) -> NDArray[np.int_]:
    return (np.arange(count) + rng.integers(1, count, count)) % count


def _through_kinematics(
    measurand: Measurand,
    quantities: Sequence[InputQuantity],
    positions: Array,
    moved: Callable[[Array], Array],
    rng: np.random.Generator,
) -> _KinematicDraws:
    """Draw calibrations: the same ones with the linear map and with the full kinematics."""
    count = len(positions)
    other: Array = np.zeros((_CALIBRATIONS, count, 3))  # what does not come through the fit
    mapped, shifts = np.zeros_like(other), list[Array]()
    for each in quantities:
        kinds = each.columns.shape[2]
        if each.anew:
            values = _together(each, rng, (count, _CALIBRATIONS, kinds))
            other += np.einsum("wci,wdi->dwc", each.columns, values)
            continue
        values = _together(each, rng, (1, _CALIBRATIONS, kinds))[0]
        through = (values @ each.columns.reshape(-1, kinds).T).reshape(other.shape)
        if each.shifts is None:
            other += through
        else:
            mapped, shifts = mapped + through, [*shifts, values @ each.shifts.T]
    full = np.stack([moved(shift) for shift in sum(shifts[1:], shifts[0])]) - positions if shifts else mapped
    if measurand == "distance":
        there = _partners(count, rng)
        apart = positions - positions[there]
        lengths = np.linalg.norm(apart, axis=1)
        along = (apart / lengths[:, None])[..., None]
        linear, bent = mapped + other, full + other
        steps = [
            ((linear - linear[:, there])[..., None, :] @ along)[..., 0, 0],
            np.linalg.norm(apart + bent - bent[:, there], axis=2) - lengths,
        ]
    else:
        steps = [np.linalg.norm(errors + other, axis=2) for errors in (mapped, full)]
    met = np.isfinite(steps[1])  # a loop may not close so far off
    linear_m, full_m = (_quantile(np.abs(each[met]))[0] for each in steps)
    return _KinematicDraws(linear_m, full_m, _CALIBRATIONS)


def _drawn_lengths(quantities: Sequence[InputQuantity], columns: Sequence[Array], rng: np.random.Generator) -> Array:
    """Lengths ``(w draws,)`` m of errors whose quantities are drawn, as often at each pose."""
    total: Array = np.zeros((len(columns[0]), _DRAWS, columns[0].shape[1]))
    for each, given in zip(quantities, columns, strict=True):
        column = _fewest(given) if each.uncertainty.distribution == "normal" else given
        # what is estimated together has one estimate of its spread: Student's t of a vector
        values = _together(each, rng, (len(column), _DRAWS, column.shape[2]))
        total += values @ np.swapaxes(column, 1, 2)
    return np.asarray(np.linalg.norm(total, axis=2).ravel())


def _fewest(columns: Array) -> Array:
    """Columns ``(w, d, d)`` whose normal errors have the same distribution as those of ``(w, d, c)``."""
    if columns.shape[2] <= columns.shape[1]:
        return columns
    sizes, axes = np.linalg.eigh(columns @ np.swapaxes(columns, 1, 2))
    return np.asarray(axes * np.sqrt(np.maximum(sizes, 0.0))[:, None, :])


def _together(quantity: InputQuantity, rng: np.random.Generator, shape: tuple[int, int, int]) -> Array:
    """Values of all components; where the spread was estimated, it is one for all of them."""
    uncertainty = quantity.uncertainty
    if np.isinf(uncertainty.dof):
        return uncertainty.sample(rng, shape)
    spread = np.sqrt(uncertainty.dof / rng.chisquare(uncertainty.dof, (*shape[:2], 1)))
    return np.asarray(uncertainty.standard * spread * rng.standard_normal(shape))


def _quantile(lengths: Array) -> tuple[float, float]:
    """The length that 95 % do not exceed, and its standard deviation (by the binomial of the order statistics)."""
    ordered = np.sort(lengths)
    count = len(ordered)
    wide = np.sqrt(COVERAGE * (1 - COVERAGE) * count)
    low, at, high = (round(COVERAGE * count + step) for step in (-wide, 0.0, wide))
    return float(ordered[at]), float(ordered[min(high, count - 1)] - ordered[low]) / 2


@dataclass(frozen=True)
class Propagation:
    """The linear map of a fit, from errors of measured points to errors of the calibrated positions.

    Attributes:
        observed: the points that were fitted, as they were weighed.
        gain: ``(f, r)`` from whitened rows to the identified parameters.
        positions: ``(w, 3)`` m of the first target at random poses of the workspace.
        slopes: ``(w, 3, f)`` of these positions by the identified parameters.
        moved: the same positions ``(w, 3)`` m by the full kinematics, with the identified parameters moved by ``(f,)``.
    """

    observed: Observations
    gain: Array
    positions: Array
    slopes: Array
    moved: Callable[[Array], Array]

    @classmethod
    def of(
        cls,
        observation: Observation,
        observed: Observations,
        values: Array,
        free: Sequence[int],
        prior_covariance: Array | None = None,
    ) -> "Propagation":
        """Build the propagation of a fit, at the fitted parameters ``(p,)``.

        Args:
            prior_covariance: ``(f, f)`` of these, in units of the weights, where a prior took part in the fit.
        """
        model = observation.model
        _, slopes = model.observe(observed.inputs, values)
        columns = observed.apply(slopes[..., list(free)])
        if prior_covariance is None:
            solved = LinearModel.of(columns, RANK_TOLERANCE)
            gain = solved.back @ solved.basis.T
        else:
            gain = prior_covariance @ columns.T
        inputs = model.structure_joints(_POSES, rng_for(0, "structure"))
        points, there = model.observe(inputs, values)
        there, points = there[:, 0][..., list(free)], points[:, 0]
        retained = np.isfinite(there).all(axis=(1, 2)) & np.isfinite(points).all(axis=1)

        def moved(shift: Array) -> Array:
            shifted = values.copy()
            shifted[list(free)] += shift
            return model.points(inputs[retained], shifted)[:, 0]

        return cls(observed, gain, points[retained], there[retained], moved)

    def shifts_by(self, displacements: Array) -> Array:
        """Shifts ``(f, c)`` of the identified parameters where the measured points are off by ``(n, k, 3, c)`` m."""
        return np.asarray(self.gain @ self.observed.apply(displacements))

    def columns_of(self, shifts: Array) -> Array:
        """Columns ``(w, 3, c)`` m of shifts ``(f, c)`` of the identified parameters."""
        return np.asarray(self.slopes @ shifts)

    def covariance_of(self, independent: Array) -> Array:
        """Covariance ``(f, f)`` of the parameters by errors with ``(n, k, 3, 3)`` m^2, independent from point to point.

        What the errors of several points share is passed over in the weights: it changes little of these.
        """
        alone = replace(self.observed, correlation=None)
        least = 1e-12 * np.trace(independent, axis1=2, axis2=3).max()  # some are flat: across a beam
        roots = np.linalg.cholesky(independent + least * np.eye(3))
        whitened = alone.in_units_of_noise(roots)[seen_mask(alone.points)]  # (points, 3, 3)
        blocks = self.gain.reshape(len(self.gain), -1, 3).transpose(1, 0, 2) @ whitened
        return np.asarray(np.einsum("pfi,pgi->fg", blocks, blocks))


@dataclass(frozen=True)
class RandomScatter:
    """Random scatter of positions, per axis, and its source.

    Attributes:
        of_residuals: whether it was estimated from what the model leaves.
    """

    sigma_m: float
    dof: float
    source: str
    of_residuals: bool = False

    @property
    def uncertainty(self) -> Uncertain:
        """Scatter as an uncertainty with its degrees of freedom."""
        return Uncertain(self.sigma_m, dof=max(self.dof, _MIN_DOF))


@dataclass(frozen=True)
class RangeUncertainty:
    """Uncertainty of range errors that were fitted with the parameters.

    Attributes:
        stds: of the constant (m) and of the scale.
        shifts: ``(f, 2)`` of the parameters by one sigma of the constant, and by what the scale adds.
        source: where their uncertainty comes from.
    """

    stds: tuple[float, float]
    shifts: Array
    source: str


@dataclass(frozen=True)
class RandomErrors:
    """Random errors of the fitted measurements and of the robot.

    Attributes:
        covariance: ``(f, f)`` of the identified parameters, by all random errors of the measurements.
        noise: of one coordinate of them.
        placement: whether how the reflector is placed is in the noise that was given, in the residuals that it was
            estimated from, or in neither.
        repeatability: of the robot; None where it is unknown.
        scatter_counted: whether what that does to the measurements is in ``covariance``.
        of_range: range errors that were fitted with the parameters, which ``covariance`` is without; None without.
        model: model discrepancy beside these; None where nothing was found.
        in_time: autocorrelated errors of positions over the poses, by the run's noise model; None likewise.
    """

    covariance: Array
    noise: RandomScatter
    placement: Placement
    repeatability: RandomScatter | None
    scatter_counted: bool
    model: RandomScatter | None
    in_time: RandomScatter | None = None
    of_range: RangeUncertainty | None = None

    @property
    def all_given(self) -> bool:
        """Check that no random error was estimated from the residuals."""
        estimated = self.repeatability is not None and self.repeatability.of_residuals
        return self.model is None and self.in_time is None and not estimated


@dataclass(frozen=True)
class FrameMotion:
    """A motion of the measurements' frame during the campaign.

    Attributes:
        detail: what moved, and when.
        offset_m: from where the calibrated positions are to where they were at one end of the campaign.
        dof: degrees of freedom of that.
    """

    detail: str
    source: str
    offset_m: float
    dof: float = np.inf


def quantities_of(
    propagation: Propagation, errors: TrackerErrors, source: str, chance: RandomErrors
) -> tuple[InputQuantity, ...]:
    """Return all input quantities but the robot's temperature."""
    placed = [] if chance.placement == "in the residuals" else list(_placements(propagation, errors, source))
    lasting = (errors if chance.of_range is None else errors.without_range).lasting
    systematic = [_systematic(propagation, errors, source, term) for term in lasting]
    quantities = [*systematic, *(quantity for quantity, _ in placed)]
    covariance = chance.covariance
    if chance.placement == "in the noise" and placed:  # it has a line of its own
        covariance = covariance - np.sum([part for _, part in placed], axis=0)
    sigma = chance.noise.uncertainty
    shifts, detail = covariance_root(covariance) / sigma.standard, "random errors of the measurements"
    fitted = "parameters", "identified parameters", chance.noise.source
    quantities.append(_fitted(propagation, shifts, *fitted, MICRONS, sigma, detail=detail))
    if (ranges := chance.of_range) is not None:
        quantities += _of_range(propagation, ranges)
    quantities += _of_repeatability(propagation, chance)
    anew = partial(_at_each_position, propagation)
    if (lack := chance.model) is not None:
        quantities.append(anew("model", "model", lack, "errors of the robot that it leaves"))
    if (slow := chance.in_time) is not None:
        quantities.append(anew("stability", "stability", slow, "errors that come and go over the poses"))
    return tuple(quantities)


def _at_each_position(
    propagation: Propagation, group: str, name: str, scatter: RandomScatter, detail: str = ""
) -> InputQuantity:
    """Return a random error of a position, in m, that is another one at each position."""
    one = np.broadcast_to(np.eye(3), (len(propagation.positions), 3, 3))
    return InputQuantity(group, name, scatter.source, MICRONS, scatter.uncertainty, one, anew=True, detail=detail)


def _of_range(propagation: Propagation, ranges: RangeUncertainty) -> Iterator[InputQuantity]:
    """Return the constant and the scale of the range, which stand in full along the line of sight."""
    lines = ("range constant", "zero of range and reflector, fitted", MICRONS), ("range scale", "fitted", PPM)
    for std, shifts, (name, detail, unit) in zip(ranges.stds, ranges.shifts.T, lines, strict=True):
        fitted = "misalignment", name, ranges.source, unit, Uncertain(std)
        yield _fitted(propagation, shifts[:, None] / std, *fitted, detail=detail)


def _of_repeatability(propagation: Propagation, chance: RandomErrors) -> Iterator[InputQuantity]:
    """Return the robot's repeatability at a position, and that in the measurements where these do not show it."""
    if (robot := chance.repeatability) is None:
        return
    yield _at_each_position(propagation, "repeatability", "repeatability of the robot", robot)
    if not chance.scatter_counted:
        alike = np.broadcast_to(np.eye(3), (*propagation.observed.points.shape, 3))
        shifts = covariance_root(propagation.covariance_of(alike))
        name = "repeatability in the measurements"
        yield _fitted(propagation, shifts, "repeatability", name, robot.source, MICRONS, robot.uncertainty)


def motion_of(propagation: Propagation, motion: FrameMotion) -> InputQuantity:
    """Return a motion of the measurements' frame as an input quantity.

    A position at the campaign's end is displaced by the offset. Its direction is unknown, so each coordinate has a
    third of its square. Two positions may be of different times, so a distance between them has it twice.
    """
    scatter = RandomScatter(motion.offset_m / float(np.sqrt(3)), max(motion.dof, _MIN_DOF), motion.source)
    return _at_each_position(propagation, "stability", "stability", scatter, motion.detail)


def lack_of_fit_of(propagation: Propagation, sigma_m: float, dof: float, source: str) -> InputQuantity:
    """Return the excess of the validation errors over the rest of the budget, as an input quantity."""
    scatter = RandomScatter(sigma_m, max(dof, _MIN_DOF), source)
    detail = "errors on validation poses that the budget does not explain"
    return _at_each_position(propagation, "model", "lack of fit", scatter, detail)


def scale_of(propagation: Propagation, relative: Uncertain, source: str) -> InputQuantity:
    """Return the scale of the measurements as an input quantity."""
    shifts = propagation.shifts_by(_seen(propagation)[..., None])
    return _fitted(propagation, shifts, "misalignment", "scale of the measurements", source, PPM, relative)


def unseen_move_of(propagation: Propagation, sigma_m: float) -> InputQuantity:
    """Return the move of base or instrument that is too small to be found, as an input quantity.

    Calibrated positions are displaced by half of it. A mean of half the points against that of the others finds it with
    the power stated, at the level of the search for change points, of which every pose is one.

    Args:
        sigma_m: what a measured coordinate scatters by.
    """
    points = int(seen_mask(propagation.observed.points).sum())
    level = VARIANCE_COMPONENTS / (2 * len(propagation.observed.points))
    limit = float(normal_ppf(1 - level) + normal_ppf(_DETECTED)) * sigma_m / float(np.sqrt(points))
    each = np.broadcast_to(np.eye(3), (len(propagation.positions), 3, 3))
    text, source = "a move of base or instrument during the campaign", "too small to be found by these poses"
    return InputQuantity("stability", text, source, MICRONS, Uncertain.within(limit), each)


def temperature_of(propagation: Propagation, base: Array, kelvin: Uncertain, expansion_per_k: float) -> InputQuantity:
    """Return the robot's temperature as an input quantity: all lengths grow with it about the base ``(3,)`` m."""
    columns = expansion_per_k * (propagation.positions - base)[..., None]
    source = f"stated, expansion {PPM.of(expansion_per_k):g} ppm/K"
    return InputQuantity("temperature", "temperature of the robot", source, KELVIN, kelvin, columns)


def _systematic(propagation: Propagation, errors: TrackerErrors, source: str, term: SystematicError) -> InputQuantity:
    group = "temperature" if term.name in _OF_AIR else "reflector" if term.name == "centring_depth" else "misalignment"
    shifts = propagation.shifts_by(errors.displacements(term, _seen(propagation)))
    return _fitted(propagation, shifts, group, term.description, source, term.unit, errors.quantity(term))


def _placements(propagation: Propagation, errors: TrackerErrors, source: str) -> Iterator[tuple[InputQuantity, Array]]:
    """Yield the per-pose errors of nest and range, each with the covariance of the parameters that it causes."""
    for term in errors.placement:
        quantity = errors.quantity(term)
        group = "misalignment" if term.name == "lock_on" else "reflector"
        covariance = propagation.covariance_of(errors.placement_covariance(_seen(propagation), (term,)))
        shifts = covariance_root(covariance) / quantity.standard
        placed = _fitted(propagation, shifts, group, term.description, source, term.unit, quantity, placed=True)
        yield placed, covariance


def _fitted(
    propagation: Propagation,
    shifts: Array,
    group: str,
    name: str,
    source: str,
    unit: Unit,
    uncertainty: Uncertain,
    *,
    detail: str = "",
    placed: bool = False,
) -> InputQuantity:
    """Return a quantity that comes through the fit, by its shifts ``(f, c)`` of the identified parameters."""
    columns = propagation.columns_of(shifts)
    return InputQuantity(group, name, source, unit, uncertainty, columns, shifts=shifts, detail=detail, placed=placed)


def _seen(propagation: Propagation) -> Array:
    return np.nan_to_num(propagation.observed.points, nan=1.0)
