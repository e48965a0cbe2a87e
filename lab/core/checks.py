"""Test results as numbers, from which verdicts and sentences are made."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

__all__ = ["Check", "Outcome"]

Outcome = Literal["passed", "failed", "not tested", "noted"]


@dataclass(frozen=True)
class Check:
    """Result of a test of data or of a fit.

    Attributes:
        name: what is tested, e.g. ``lack_of_fit.repeats``; the phrase of this name words it.
        outcome: the result at ``level``; ``noted`` for a fact without a test.
        statistic: the test statistic; NaN without one, as ``p`` and ``level``.
        p: the p-value.
        level: the significance level, below which ``p`` is a failure.
        data: further numbers for sentences and decisions, in SI units.
    """

    name: str
    outcome: Outcome
    statistic: float = float("nan")
    p: float = float("nan")
    level: float = float("nan")
    data: Mapping[str, Any] = field(default_factory=dict)
