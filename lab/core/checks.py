"""Results of tests as numbers: verdicts are decided by them, and sentences are made from them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

__all__ = ["Check", "Outcome"]

Outcome = Literal["passed", "failed", "not tested", "noted"]


@dataclass(frozen=True)
class Check:
    """A test of data or of a fit: numbers with a level, from which verdicts and sentences are made.

    Attributes:
        name: what is tested, e.g. ``lack_of_fit.repeats``; the phrase of this name words it.
        outcome: what came out at ``level``; ``noted`` where a fact is reported and nothing was tested.
        statistic: the test's; NaN where there is none.
        p: its p-value; NaN where there is none.
        level: below which ``p`` is a failure; NaN where there is none.
        data: what else a sentence or a decision needs, in SI units.
    """

    name: str
    outcome: Outcome
    statistic: float = float("nan")
    p: float = float("nan")
    level: float = float("nan")
    data: Mapping[str, Any] = field(default_factory=dict)
