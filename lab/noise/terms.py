"""List the error terms of the noise model: joint scatter, errors correlated in time, drift, change points.

A new term is a class and a place in ``TERMS``.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar, Literal

import numpy as np

from lab.core.probability import chi2_sf
from lab.core.se3 import Array
from lab.core.units import MICRONS, MRAD, Unit
from lab.noise.change_points import ANOTHER_SESSION, before_and_after
from lab.noise.correlation import Correlation
from lab.noise.error_term import Components, ErrorShapes, ErrorSizes, ErrorTerm, Move

__all__ = ["TERMS", "UNCORRELATED", "correlation_of", "term_called"]

UNCORRELATED = 0.15  # a correlation from one pose to the next that is taken as none: the search ends at 0.1
_CORRELATIONS = 3.0  # how many independent correlations are as good as tried


class JointScatter(ErrorTerm):
    """Independent joint errors at each pose, of the same standard deviation in rad (m of a slide)."""

    name: ClassVar[str] = "scatter"
    kind: ClassVar[str] = "scatter"
    structure: ClassVar[Literal["pose", "autoregressive", "lasting"]] = "pose"
    unit: ClassVar[Unit] = MRAD
    key: ClassVar[str] = "joint_scatter_mrad"

    def shape(self, of: ErrorShapes) -> Array:
        """Return the effect of the joints' positions."""
        return of.scatter

    def describe(self, size: float, of: ErrorSizes) -> tuple[str, ...]:
        """Describe the scatter."""
        return (f"joints scatter by {MRAD.text(size, 2)} from pose to pose",)

    def variance_within(self, size: float, moves: Sequence[Move]) -> float:
        """Return none of the base's."""
        return 0.0


class AutocorrelatedShift(ErrorTerm):
    """A shift of the base or the instrument that is correlated in time (AR(1)), of one coordinate."""

    name: ClassVar[str] = "shift"
    kind: ClassVar[str] = "wandering"
    structure: ClassVar[Literal["pose", "autoregressive", "lasting"]] = "autoregressive"
    key: ClassVar[str] = "wandering_mm"
    family: ClassVar[Literal["", "moving", "wandering"]] = "wandering"

    def shape(self, of: ErrorShapes) -> Array:
        """Return the effect of a shift."""
        return of.shift

    def describe(self, size: float, of: ErrorSizes) -> tuple[str, ...]:
        """Describe the shift and its correlation."""
        text = f"{MICRONS.text(size, 2)} (1σ per axis)"
        if of.carry > UNCORRELATED:
            return (f"errors are correlated in time: {text}, {of.carry:.2g} from one pose to the next",)
        return (f"errors that each pose has of its own: {text}, uncorrelated in time",)

    def p_value(self, ratio: float) -> float:
        """Return the p-value of a likelihood ratio that was the largest over the correlations."""
        return 1.0 if ratio <= 0 else min(1.0, _CORRELATIONS * 0.5 * float(chi2_sf(ratio, 1)))


class Drift(ErrorTerm):
    """A steady drift of the base or the instrument: its shift at the campaign's end, of one coordinate."""

    name: ClassVar[str] = "trend"
    kind: ClassVar[str] = "drift"
    structure: ClassVar[Literal["pose", "autoregressive", "lasting"]] = "lasting"
    key: ClassVar[str] = "drift_mm"
    family: ClassVar[Literal["", "moving", "wandering"]] = "moving"

    def shape(self, of: ErrorShapes) -> Array:
        """Return the effect of the shift at the end."""
        return of.trend

    def describe(self, size: float, of: ErrorSizes) -> tuple[str, ...]:
        """Describe the drift from the first pose to the last."""
        return (f"the base or the instrument drifts steadily, by {2e6 * size:.2g} µm over the campaign",)

    def variance_within(self, size: float, moves: Sequence[Move]) -> float:
        """Return the mean square of a steady drift from minus to plus that size."""
        return size**2 / 3


class ChangePoints(ErrorTerm):
    """Shifts of the base or the instrument at once, at times that a scan over the rows finds, of one coordinate."""

    name: ClassVar[str] = "step"
    kind: ClassVar[str] = "step"
    structure: ClassVar[Literal["pose", "autoregressive", "lasting"]] = "lasting"
    key: ClassVar[str] = "step_mm"
    family: ClassVar[Literal["", "moving", "wandering"]] = "moving"
    scanned: ClassVar[bool] = True

    def shape(self, of: ErrorShapes) -> Array:
        """Return the effect ``(n, m, 3 c)`` of the shift at each change, against the mean over the rows."""
        along = before_and_after(of.times, of.changes)
        return np.asarray((along[:, None, :, None] * of.shift[:, :, None]).reshape(*of.shift.shape[:2], -1))

    def describe(self, size: float, of: ErrorSizes) -> tuple[str, ...]:
        """Describe each move."""
        return tuple(move.description for move in of.moves)

    def variance_within(self, size: float, moves: Sequence[Move]) -> float:
        """Return the mean square of the moves about their means over the rows."""
        return sum(move.size_m**2 * move.change.share * (1 - move.change.share) / 3 for move in moves)

    def changed_at(self, of: ErrorShapes, moves: Sequence[Move], *, another_session: bool) -> ErrorShapes:
        """Return the shapes with the change points of the moves; on another day with the same shift in all rows."""
        return replace(of, changes=(ANOTHER_SESSION,) if another_session else tuple(move.change for move in moves))


TERMS: tuple[ErrorTerm, ...] = (JointScatter(), AutocorrelatedShift(), Drift(), ChangePoints())
"""All terms, in the order in which their covariances are added and written."""


def term_called(kind: str) -> ErrorTerm:
    """Return the term of this kind."""
    return next(term for term in TERMS if term.kind == kind)


def correlation_of(shapes: ErrorShapes, parts: Components) -> Correlation:
    """Return the shared errors of these variances, each per unit of its shape; a term without variance is left out.

    An autoregressive shift without correlation is drawn anew at each pose, as scatter is: rows are then white pose by
    pose.
    """
    alone, lasting, shift = list[Array](), list[Array](), shapes.shift[..., :0]
    for term in TERMS:
        if not (variance := parts[term.name]):
            continue
        made = np.sqrt(variance) * term.shape(shapes)
        if term.structure == "lasting":
            lasting.append(made)
        elif term.structure == "autoregressive" and parts.carry:
            shift = made
        else:
            alone.append(made)
    none = shapes.shift[..., :0]
    return Correlation(
        np.concatenate(alone or [none], axis=2),
        shift,
        parts.carry,
        np.concatenate(lasting or [none], axis=2),
        shapes.times,
    )
