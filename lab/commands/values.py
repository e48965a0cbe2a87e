"""Plain values that the results of several commands hold: numbers that JSON can say, statistics of errors."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from lab.core.se3 import Array

__all__ = ["ErrorStatistics", "error_statistics", "exit_code_of", "joint_values", "number", "plain_numbers"]


@dataclass(frozen=True)
class ErrorStatistics:
    """Statistics of lengths, mm, and of how many."""

    mean: float
    rms: float
    p95: float
    max: float
    count: int

    def to_dict(self) -> dict[str, float | int]:
        """The statistics by name."""
        return asdict(self)


def error_statistics(errors: Array) -> ErrorStatistics:
    """Statistics of errors in m; NaN is left out."""
    lengths = 1e3 * errors[np.isfinite(errors)]
    return ErrorStatistics(
        float(lengths.mean()),
        float(np.sqrt(np.mean(lengths**2))),
        float(np.percentile(lengths, 95)),
        float(lengths.max()),
        int(lengths.size),
    )


def exit_code_of(verdict: str, require: str | None) -> int:
    """Return the exit code of a verdict: 1 where it is bad, 3 where it is not the required one, else 0."""
    if verdict == "bad":
        return 1
    return 0 if require in (None, verdict) else 3


def joint_values(prismatic: Sequence[bool], joints: Array) -> Array:
    """Joint positions or rates ``(..., n)`` (rad, m of a slide) as a person reads them: degrees, mm of a slide."""
    return np.asarray(joints * np.where(prismatic, 1e3, 180 / np.pi))


def number(value: float) -> float | None:
    """The value, or None where it is not finite."""
    return float(value) if np.isfinite(value) else None


def plain_numbers(values: Array | float) -> Any:
    """An array as nested lists, a number as it is; None where not finite."""
    array = np.asarray(values, dtype=np.float64)
    return number(float(array)) if array.ndim == 0 else [plain_numbers(part) for part in array]
