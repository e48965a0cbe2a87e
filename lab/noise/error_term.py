"""Define the error terms of the noise model: joint scatter, errors correlated in time, drift.

In units of the instrument's noise the covariance of all numbers is V = 1 + sum v_i S_i P_i S_i', with a variance v_i
and a shape S_i for each term. Its structure P_i is one of three: drawn anew at each pose (``pose``), first-order
autoregressive in time (``autoregressive``), or coefficients that are the same at all poses (``lasting``). Weights,
likelihood, search, small-sample corrections and serialization loop over ``TERMS`` and name no term. Each of the first
two structures has one term, which the likelihood is solved with; the third has any number. A new term is a lasting
one: a class and a place in ``TERMS``. A package adds one by an entry point of ``lab.error_terms``; it is searched on
request. A shape is made of ``ErrorShapes``, which know poses and times but no distances: noise that depends on the
distance from the instrument is the ``covariance`` of an ``Instrument``.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np

from lab.core.errors import LabError
from lab.core.probability import chi2_sf
from lab.core.se3 import Array
from lab.core.units import MICRONS, MM, MRAD, Unit
from lab.extension_points import Part, PartKind, numbers, texts
from lab.noise.correlation import Correlation

__all__ = [
    "TERMS",
    "UNCORRELATED",
    "Components",
    "ErrorShapes",
    "ErrorTerm",
    "correlation_of",
    "own_term",
    "term_called",
    "terms_with",
]

UNCORRELATED = 0.15  # largest correlation from one pose to the next that counts as none: the search ends at 0.1
_CORRELATIONS = 3.0  # number of independent correlations that a search amounts to


@dataclass(frozen=True)
class Components:
    """Variances of the terms in units of the instrument's.

    Attributes:
        variances: by the term's name, each per unit of its shape; zero for a missing term.
        carry: the correlation of the autoregressive term over one unit of time, in [0, 1).
    """

    variances: Mapping[str, float] = field(default_factory=dict)
    carry: float = 0.0

    def __getitem__(self, name: str) -> float:
        """Return the variance of a term; zero for a missing one."""
        return self.variances.get(name, 0.0)

    def times(self, factor: float, names: Sequence[str] = ()) -> "Components":
        """Return the components with the variances of some terms multiplied; of all, by default."""
        grown = {name: factor * size if not names or name in names else size for name, size in self.variances.items()}
        return replace(self, variances=grown)


@dataclass(frozen=True)
class ErrorShapes:
    """The effects of errors on the whitened numbers of poses, zero where nothing was observed.

    Attributes:
        scatter: ``(n, m, j)`` of the joints' positions.
        shift: ``(n, m, 3)`` of a shift of the base.
        along: ``(n,)`` time of each pose in the campaign, from -1 to 1, with mean zero; one for all of another session.
        times: ``(n,)`` of each pose; far apart between sessions.
    """

    scatter: Array
    shift: Array
    along: Array
    times: Array

    @cached_property
    def trend(self) -> Array:
        """``(n, m, 3)`` of the shift at the end of a steady drift against its mean."""
        return np.asarray(self.along[:, None, None] * self.shift)


_ERROR_TERMS = PartKind(
    "lab.error_terms",
    "error term",
    "error_terms",
    returned={
        "shape": lambda where, effect, of: numbers(where, effect, (*of.shift.shape[:2], None)),
        "describe": lambda where, description, *_: texts(where, description),
        "p_value": lambda where, p, _: float(numbers(where, p, ())),
        "variance_within": lambda where, variance, *_: float(numbers(where, variance, ())),
    },
)


class ErrorTerm(Part, ABC, kind=_ERROR_TERMS):
    """An error term of the noise model.

    Your own is a subclass with a ``name``, the same ``kind``, structure ``lasting``, a ``shape`` and a ``describe``.
    Every call with an option ``error_terms`` takes objects of it; if a package registers it as an entry point of
    ``lab.error_terms``, ``--error-terms`` takes it by name.

    Attributes:
        name: of its variance, in ``Components`` and in the errors of these.
        kind: its name in reports of the search.
        structure: of its coefficients over the poses.
        unit: of its standard deviation in reports.
        key: in ``result.json``, in that unit; "" for one under ``further``, by its name.
        family: of terms confounded in a campaign: families are searched one without the other; "" for none.
    """

    name: ClassVar[str]
    kind: ClassVar[str]
    structure: ClassVar[Literal["pose", "autoregressive", "lasting"]]
    unit: ClassVar[Unit] = MM
    key: ClassVar[str] = ""
    family: ClassVar[Literal["", "moving", "wandering"]] = ""

    @abstractmethod
    def shape(self, of: ErrorShapes) -> Array:
        """Return the effect ``(n, m, c)`` of its coefficients on the numbers of each pose."""

    @abstractmethod
    def describe(self, size: float, carry: float) -> tuple[str, ...]:
        """Describe errors of this standard deviation (above zero, in SI units).

        Args:
            carry: the correlation of the autoregressive term from one pose to the next.
        """

    def p_value(self, ratio: float) -> float:
        """Return the p-value of a likelihood ratio: half of a chi squared's, as no variance is below zero."""
        return 1.0 if ratio <= 0 else 0.5 * float(chi2_sf(ratio, 1))

    def variance_within(self, size: float) -> float:
        """Return the mean variance (m^2) of a coordinate from shifts of the base in the campaign itself."""
        return size**2


class _JointScatter(ErrorTerm):
    """Independent joint errors at each pose, of the same standard deviation in rad (m of a slide)."""

    name = "scatter"
    kind = "scatter"
    structure = "pose"
    unit = MRAD
    key = "joint_scatter_mrad"

    def shape(self, of: ErrorShapes) -> Array:
        """Return the effect of the joints' positions."""
        return of.scatter

    def describe(self, size: float, carry: float) -> tuple[str, ...]:
        """Describe the scatter."""
        return (f"joints scatter by {MRAD.text(size, 2)} from pose to pose",)

    def variance_within(self, size: float) -> float:
        """Return zero: scatter does not shift the base."""
        return 0.0


class _AutocorrelatedShift(ErrorTerm):
    """A shift of the base or the instrument that is correlated in time (AR(1)), of one coordinate."""

    name = "shift"
    kind = "wandering"
    structure = "autoregressive"
    key = "wandering_mm"
    family = "wandering"

    def shape(self, of: ErrorShapes) -> Array:
        """Return the effect of a shift."""
        return of.shift

    def describe(self, size: float, carry: float) -> tuple[str, ...]:
        """Describe the shift and its correlation."""
        text = f"{MICRONS.text(size, 2)} (1σ per axis)"
        if carry > UNCORRELATED:
            return (f"errors are correlated in time: {text}, {carry:.2g} from one pose to the next",)
        return (f"errors that each pose has of its own: {text}, uncorrelated in time",)

    def p_value(self, ratio: float) -> float:
        """Return the p-value of a likelihood ratio that was the largest over the correlations."""
        return 1.0 if ratio <= 0 else min(1.0, _CORRELATIONS * 0.5 * float(chi2_sf(ratio, 1)))


class _Drift(ErrorTerm):
    """A steady drift of the base or the instrument: its shift at the campaign's end, of one coordinate."""

    name = "trend"
    kind = "drift"
    structure = "lasting"
    key = "drift_mm"
    family = "moving"

    def shape(self, of: ErrorShapes) -> Array:
        """Return the effect of the shift at the end."""
        return of.trend

    def describe(self, size: float, carry: float) -> tuple[str, ...]:
        """Describe the drift from the first pose to the last."""
        return (f"the base or the instrument drifts steadily, by {2e6 * size:.2g} µm over the campaign",)

    def variance_within(self, size: float) -> float:
        """Return the mean square of a steady drift from minus to plus that size."""
        return size**2 / 3


TERMS: tuple[ErrorTerm, ...] = (_JointScatter(), _AutocorrelatedShift(), _Drift())
"""All terms, in the order in which their covariances are added and written."""
_ERROR_TERMS.taken = tuple(name for term in TERMS for name in (term.name, term.kind))


def own_term(name: str) -> ErrorTerm:
    """Return a term that a package adds.

    Raises:
        LabError: there is none of this name, its package cannot be imported, or its structure is not ``lasting``.
    """
    term: ErrorTerm = _ERROR_TERMS.named(name)
    if term.structure != "lasting" or term.kind != name or term.key:
        raise LabError(f"error term '{name}': give it the structure lasting, its name as kind, and no key")
    return term


def term_called(kind: str) -> ErrorTerm:
    """Return the term of this kind: the lab's own, or one that a package adds.

    Raises:
        LabError: there is none, or its package cannot be imported.
    """
    return next((term for term in TERMS if term.kind == kind), None) or own_term(kind)


def terms_with(names: Iterable[str]) -> tuple[ErrorTerm, ...]:
    """Return all terms of the lab, and those of these names that packages add.

    Raises:
        LabError: a package that added one cannot be imported.
    """
    own = {term.name for term in TERMS}
    return (*TERMS, *(own_term(name) for name in names if name not in own))


def correlation_of(shapes: ErrorShapes, parts: Components) -> Correlation:
    """Return the shared errors of these variances, each per unit of its shape; a term without variance is left out.

    An autoregressive shift without correlation is independent at each pose, as scatter is.
    """
    alone, lasting, shift = list[Array](), list[Array](), shapes.shift[..., :0]
    for term in terms_with(parts.variances):
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
