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

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import floor, log10
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.calibration.workspace_prediction import length_not_exceeded
from lab.core.distributions import Uncertain
from lab.core.se3 import Array

__all__ = [
    "COVERAGE",
    "MEASURANDS",
    "Budget",
    "BudgetLine",
    "InputQuantity",
    "KinematicDraws",
    "Measurand",
    "Propagated",
    "budget_of",
    "propagated",
]

Measurand = Literal["position", "distance"]
COVERAGE = 0.95
MEASURANDS: tuple[Measurand, ...] = ("position", "distance")
_DRAWS = 500  # at each of the poses
_CALIBRATIONS = 400  # drawn, each at all of the poses
_DIGITS = 2  # of an expanded uncertainty (JCGM 100:2008, 7.2.6)


@dataclass(frozen=True)
class InputQuantity:
    """What a position depends on that is known within an uncertainty.

    Attributes:
        group: misalignment, reflector, temperature, repeatability, model, stability or parameters.
        name: what it is.
        source: where its uncertainty comes from.
        unit: in which a person reads it, ``factor`` of which are one SI unit; empty for a vector of many.
        uncertainty: of each of its components, SI.
        columns: ``(w, 3, c)`` how far a unit of each component moves the positions at w poses, m.
        anew: whether it is another one at each position; else all positions share it.
        shifts: ``(f, c)`` how far a unit of each component shifts the identified parameters; None for what does not
            come through the fit.
        detail: what is meant by ``name``; empty where that says all.
        placed: whether it is another error in each pose, of the fitted ones and of others.
    """

    group: str
    name: str
    source: str
    unit: str
    factor: float
    uncertainty: Uncertain
    columns: Array
    anew: bool = False
    shifts: Array | None = None
    detail: str = ""
    placed: bool = False

    @property
    def words(self) -> str:
        """The name with its detail."""
        return f"{self.name}: {self.detail}" if self.detail else self.name


@dataclass(frozen=True)
class BudgetLine:
    """One line of a budget.

    Attributes:
        contribution_m: what the quantity contributes to the standard uncertainty (root mean square over the
            workspace).
        share: of the combined variance.
    """

    quantity: InputQuantity
    contribution_m: float
    share: float

    @property
    def sensitivity(self) -> float:
        """Contribution by unit of the quantity, m over its SI unit."""
        return self.contribution_m / self.quantity.uncertainty.standard


@dataclass(frozen=True)
class KinematicDraws:
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
        lines: the quantities that contribute.
        combined_m: combined standard uncertainty, root mean square over the workspace.
        freedom: its effective degrees of freedom.
        propagated_m: expanded uncertainty by the law of propagation.
        drawn_m: the same by drawing the quantities so many times, with ``drawn_std_m`` its own standard deviation.
        kinematics: the same by drawing calibrations, linear and through the full kinematics.
    """

    measurand: Measurand
    lines: tuple[BudgetLine, ...]
    combined_m: float
    freedom: float
    propagated_m: float
    drawn_m: float
    drawn_std_m: float
    draws: int
    kinematics: KinematicDraws

    @cached_property
    def tolerance_m(self) -> float:
        """Half a unit of the last digit that is given of the expanded uncertainty (JCGM 101:2008, 7.9.2)."""
        return 0.5 * 10.0 ** (floor(log10(self.propagated_m)) + 1 - _DIGITS)

    @property
    def agrees(self) -> bool:
        """Whether what was drawn confirms what was propagated, as far as so many draws can tell."""
        return abs(self.drawn_m - self.propagated_m) <= self.tolerance_m + 2 * self.drawn_std_m

    @property
    def is_linear(self) -> bool:
        """Whether the full kinematics leave the digits that are given as they are."""
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
class Propagated:
    """What the law of propagation says of a measurand.

    Attributes:
        quantities: those that contribute.
        columns: ``(w, d, c)`` of each, m: what a unit of its components does to the d numbers of the measurand.
        variances: ``(quantities,)`` m^2, what each contributes.
        freedom: effective degrees of freedom.
        expanded_m: expanded uncertainty.
    """

    quantities: tuple[InputQuantity, ...]
    columns: tuple[Array, ...]
    variances: Array
    freedom: float
    expanded_m: float

    @property
    def combined_m(self) -> float:
        """Combined standard uncertainty."""
        return float(np.sqrt(self.variances.sum()))


def propagated(
    measurand: Measurand, quantities: Sequence[InputQuantity], positions: Array, rng: np.random.Generator
) -> Propagated:
    """The uncertainty of positions, or of distances between random pairs of them.

    Args:
        quantities: those that matter; at least one has an uncertainty above zero.
        positions: ``(w, 3)`` m.
        rng: of the pairs.
    """
    kept = [each for each in quantities if each.uncertainty.standard and each.columns.any()]
    columns = [each.columns for each in kept]
    if measurand == "distance":
        columns = _of_distances(kept, positions, rng)
    squares = [each.uncertainty.standard**2 * c @ np.swapaxes(c, 1, 2) for each, c in zip(kept, columns, strict=True)]
    variances = np.array([np.trace(square, axis1=1, axis2=2).mean() for square in squares])
    freedoms = np.array([each.uncertainty.freedom for each in kept])
    spread = float((variances**2 / freedoms).sum())  # an infinite one adds nothing
    freedom = float(variances.sum() ** 2 / spread) if spread else np.inf
    expanded = length_not_exceeded(np.sum(squares, axis=0), None if np.isinf(freedom) else freedom)
    return Propagated(tuple(kept), tuple(columns), variances, freedom, expanded)


def budget_of(
    measurand: Measurand,
    quantities: Sequence[InputQuantity],
    positions: Array,
    moved: Callable[[Array], Array],
    rng: np.random.Generator,
) -> Budget:
    """The budget of positions, or of distances between random pairs of them.

    Args:
        quantities: those that matter; at least one has an uncertainty above zero.
        positions: ``(w, 3)`` m.
        moved: the same positions with the identified parameters shifted by ``(f,)``, by the full kinematics.
        rng: of the pairs and of the draws.
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
        measurand, tuple(lines), found.combined_m, found.freedom, found.expanded_m, drawn, std, lengths.size, kinematics
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
    """Of each position another one."""
    return (np.arange(count) + rng.integers(1, count, count)) % count


def _through_kinematics(
    measurand: Measurand,
    quantities: Sequence[InputQuantity],
    positions: Array,
    moved: Callable[[Array], Array],
    rng: np.random.Generator,
) -> KinematicDraws:
    """Errors of drawn calibrations: the same ones with the linear map and with the full kinematics."""
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
    return KinematicDraws(linear_m, full_m, _CALIBRATIONS)


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
    if np.isinf(uncertainty.freedom):
        return uncertainty.sample(rng, shape)
    spread = np.sqrt(uncertainty.freedom / rng.chisquare(uncertainty.freedom, (*shape[:2], 1)))
    return np.asarray(uncertainty.standard * spread * rng.standard_normal(shape))


def _quantile(lengths: Array) -> tuple[float, float]:
    """The length that 95 % do not exceed, and its standard deviation (by the binomial of the order statistics)."""
    ordered = np.sort(lengths)
    count = len(ordered)
    wide = np.sqrt(COVERAGE * (1 - COVERAGE) * count)
    low, at, high = (round(COVERAGE * count + step) for step in (-wide, 0.0, wide))
    return float(ordered[at]), float(ordered[min(high, count - 1)] - ordered[low]) / 2
