"""Hypotheses of what is wrong with measurements, and findings: those that a refit confirmed."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

from lab.core.checks import Check
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.kinematics.model import Model

__all__ = ["Correction", "Diagnosable", "Finding", "Hypothesis", "MeasuresOrientations", "hypotheses_of", "unchanged"]

Correction = Callable[[Measurements], Measurements]
"""Undo a discrete mistake: measurements as they were read, to what they would be without it, in the same rows."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One thing that may be wrong with measurements.

    A discrete mistake has ``corrected``; a continuous one has ``columns``.

    Attributes:
        name: its kind, e.g. ``joint_sign``; the phrase ``diagnosis.<name>`` words it.
        of: what it applies to, as a sentence names it: a joint, targets, ids of rows, the two rows that it is between.
        alternatives: number of hypotheses of its kind that were tried, which its evidence has to pay for.
        corrected: undoes a discrete mistake.
        sensor: reads the corrected measurements, where it is another one: cameras in the hand for in the room.
        columns: ``(n, k, d, c)`` derivatives of the observed numbers of the rows by the c numbers of a continuous one.
        units: of these numbers: ``m``, ``rad``, or ``1`` for a ratio.
        largest: the sizes in these units beyond which they make no sense; none where they may be of any size.
        data: further words of its phrase.
    """

    name: str
    of: tuple[str, ...] = ()
    alternatives: float = 1
    corrected: Correction | None = None
    sensor: Any = None
    columns: Array | None = None
    units: tuple[str, ...] = ()
    largest: tuple[float, ...] | None = None
    data: tuple[tuple[str, Any], ...] = ()

    @property
    def key(self) -> str:
        """Name by which a user accepts it: ``joint_sign:q3``."""
        return ":".join((self.name, *self.of[:1]))

    def price(self, numbers: int, rows: int) -> float:
        """Return what its numbers and its alternatives cost of twice the log-likelihood of so many rows."""
        return numbers * math.log(rows) + self.price_of_alternatives

    @property
    def price_of_alternatives(self) -> float:
        """What the choice among its alternatives costs of twice the log-likelihood."""
        return 2 * math.log(self.alternatives)


@dataclass(frozen=True, eq=False)
class Finding:
    """A hypothesis that a refit confirmed.

    Attributes:
        evidence: twice the logarithm of the likelihood ratio, refitted with all variances, less the price of its
            alternatives.
        sizes, stds: of its numbers, in ``hypothesis.units``, from the refit; empty where it is discrete.
        explains_m: root mean square error that it explains at the measured points.
        before_m, after_m: of a discrete mistake, the root mean square miss of the placed arm with it, and undone.
        rivals: keys of hypotheses that explain the measurements nearly as well.
        accepted: whether the fit has it in: undone by the user's consent, or fitted.
    """

    hypothesis: Hypothesis
    evidence: float
    sizes: tuple[float, ...] = ()
    stds: tuple[float, ...] = ()
    explains_m: float = float("nan")
    before_m: float = float("nan")
    after_m: float = float("nan")
    rivals: tuple[str, ...] = ()
    accepted: bool = False

    @property
    def name(self) -> str:
        """Kind of the hypothesis."""
        return self.hypothesis.name

    @property
    def is_discrete(self) -> bool:
        """Whether it is a mistake of reading that is undone as a whole."""
        return self.hypothesis.corrected is not None

    @property
    def makes_sense(self) -> bool:
        """Whether its sizes are such as the hypothesis can have."""
        largest = self.hypothesis.largest
        return largest is None or all(abs(size) <= limit for size, limit in zip(self.sizes, largest, strict=True))

    @property
    def check(self) -> Check:
        """The finding as a check, with all that its sentence needs; failed unless the fit has it in."""
        of = self.hypothesis
        data = {
            "of": of.of,
            "key": of.key,
            "sizes": self.sizes,
            "stds": self.stds,
            "units": of.units,
            "explains_m": self.explains_m,
            "before_m": self.before_m,
            "after_m": self.after_m,
            "rivals": self.rivals,
            "accepted": self.accepted,
            "discrete": self.is_discrete,
            **dict(of.data),
        }
        return Check(f"diagnosis.{of.name}", "noted" if self.accepted else "failed", self.evidence, data=data)

    def as_accepted(self) -> "Finding":
        """Return the finding as one that the fit has in."""
        return replace(self, accepted=True)


def unchanged(rows: Measurements) -> Measurements:
    """Return the rows: the mistake is in an option of the sensor, not in them."""
    return rows


@runtime_checkable
class Diagnosable(Protocol):
    """A sensor that knows what goes wrong with its readings."""

    def mistakes(self, arm: Model, data: Measurements) -> Sequence[Hypothesis]:
        """Return discrete mistakes of these readings, as they were read from a file.

        Args:
            arm: the arm, measured by points.
        """
        ...

    def misses(self, arm: Model, data: Measurements, nominal: Array) -> Array:
        """Return how far ``(n,)`` the nominal arm misses each row (m), where base, tool and fixtures are placed best.

        A placement is robust: a part of the rows may be wrong. A row without a reading of its own is NaN (all corners
        of a picture but the first, rows to be skipped); a reading that the arm cannot explain at all is infinite.

        Args:
            nominal: ``(p,)`` nominal parameters of ``arm``.
        """
        ...


@runtime_checkable
class MeasuresOrientations(Protocol):
    """A sensor of points that measures orientations, too, and knows what goes wrong with these."""

    def mistakes(self, arm: Model, data: Measurements) -> Sequence[Hypothesis]:
        """Return discrete mistakes of the orientations."""
        ...

    def turned_misses(self, arm: Model, data: Measurements, values: Array) -> Array:
        """Return how far ``(n,)`` a point at a lever is off by each orientation (m); NaN where none was measured.

        Args:
            values: ``(p,)`` of the arm, as the positions place it.
        """
        ...


def hypotheses_of(sensor: object, arm: Model, data: Measurements) -> tuple[Hypothesis, ...]:
    """Return the mistakes that a sensor knows of its readings; none of a sensor that knows none."""
    return tuple(sensor.mistakes(arm, data)) if isinstance(sensor, Diagnosable | MeasuresOrientations) else ()
