"""Define an error term: one kind of error that measured numbers share, with all that the noise model needs of it.

In units of the instrument's noise the covariance of all numbers is V = 1 + sum v_i S_i P_i S_i', with a variance v_i
and a shape S_i for each term. Its structure P_i is one of three: drawn anew at each pose (``pose``), first-order
autoregressive in time (``autoregressive``), or coefficients that are the same at all poses (``lasting``). Weights,
likelihood, search, small-sample corrections and serialization go through the terms of ``terms.TERMS``, and know none
by name. Of the first two structures there is one term each; of the third any number.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np

from lab.core.probability import chi2_sf
from lab.core.se3 import Array
from lab.core.units import MM, Unit
from lab.noise.change_points import ChangePoint

__all__ = ["Components", "ErrorShapes", "ErrorSizes", "ErrorTerm", "Move"]


@dataclass(frozen=True)
class Components:
    """Variances of the terms in units of the instrument's.

    Attributes:
        variances: by the term's name, each per unit of its shape; a term that is missing has none.
        carry: the correlation of the autoregressive term over one unit of time, in [0, 1).
    """

    variances: Mapping[str, float] = field(default_factory=dict)
    carry: float = 0.0

    def __getitem__(self, name: str) -> float:
        """The variance of a term; zero where it has none."""
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
        along: ``(n,)`` where each pose lies in the campaign, from -1 to 1, with mean zero; one for all of another day.
        times: ``(n,)`` when each pose was measured; far apart where a new session begins.
        changes: when the base moved at once.
    """

    scatter: Array
    shift: Array
    along: Array
    times: Array
    changes: tuple[ChangePoint, ...] = ()

    @cached_property
    def trend(self) -> Array:
        """``(n, m, 3)`` of the shift at the end of a steady drift against its mean."""
        return np.asarray(self.along[:, None, None] * self.shift)


@dataclass(frozen=True)
class Move:
    """A move of the base or the instrument at once.

    Attributes:
        change: when.
        before, after: ids of the rows between which it did.
        size_m: how far.
        description: for a person.
    """

    change: ChangePoint
    before: str
    after: str
    size_m: float
    description: str = ""


@dataclass(frozen=True)
class ErrorSizes:
    """Sizes of the noise model that a term's description may need beside its own.

    Attributes:
        carry: the correlation of the autoregressive term from one pose to the next.
        moves: of the base.
    """

    carry: float
    moves: tuple[Move, ...]


class ErrorTerm(ABC):
    """An error term of the noise model.

    Attributes:
        name: of its variance, in ``Components`` and in the errors of these.
        kind: as the search for it is reported.
        structure: how its coefficients depend on the pose.
        unit: in which people read its standard deviation.
        key: in ``result.json``, in that unit; "" for one under ``further``, by its name.
        family: of terms that look alike in a campaign: families are searched one without the other; "" for none.
        scanned: whether it is found by a scan over the rows for change points.
    """

    name: ClassVar[str]
    kind: ClassVar[str]
    structure: ClassVar[Literal["pose", "autoregressive", "lasting"]]
    unit: ClassVar[Unit] = MM
    key: ClassVar[str] = ""
    family: ClassVar[Literal["", "moving", "wandering"]] = ""
    scanned: ClassVar[bool] = False

    @abstractmethod
    def shape(self, of: ErrorShapes) -> Array:
        """Return the effect ``(n, m, c)`` of its coefficients on the numbers of each pose."""

    @abstractmethod
    def describe(self, size: float, of: ErrorSizes) -> tuple[str, ...]:
        """Describe errors of this standard deviation (above zero, in SI units) for a person."""

    def p_value(self, ratio: float) -> float:
        """Return the p-value of a likelihood ratio: half of a chi squared's, as no variance is below zero."""
        return 1.0 if ratio <= 0 else 0.5 * float(chi2_sf(ratio, 1))

    def variance_within(self, size: float, moves: Sequence[Move]) -> float:
        """Return the mean variance (m^2) of a coordinate that the base's part of it makes in its own campaign."""
        return size**2

    def changed_at(self, of: ErrorShapes, moves: Sequence[Move], *, another_session: bool) -> ErrorShapes:
        """Return the shapes of errors whose change points are known: as they are, where the term has none."""
        return of
