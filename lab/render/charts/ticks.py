"""Scales from values to places, and the round numbers along them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lab.core.se3 import Array

__all__ = ["Scale", "round_numbers", "tick_words"]

_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
_LEAST, _MOST = 1e-4, 1e6  # between them, numbers are written without a power of ten


@dataclass(frozen=True)
class Scale:
    """Values from ``low`` to ``high`` along places from ``start`` to ``end``, linear or by the logarithm."""

    low: float
    high: float
    start: float
    end: float
    logarithmic: bool = False

    def __call__(self, values: Array | float) -> Array:
        """The places of values ``(...)``; NaN where a logarithm has none."""
        given, low, high = np.asarray(values, dtype=float), self.low, self.high
        if self.logarithmic:
            given, low, high = np.log(np.where(given > 0, given, np.nan)), np.log(low), np.log(high)
        return np.asarray(self.start + (given - low) / (high - low) * (self.end - self.start))


def round_numbers(low: float, high: float, most: int) -> Array:
    """Round numbers from ``low`` to ``high``, at most about ``most`` steps and at least two numbers."""
    raw = (high - low) / max(1, most)
    power = 10.0 ** np.floor(np.log10(raw))
    sizes = [power * each for each in _STEPS if power * each >= raw * (1 - 1e-9)]
    smaller = [power / 10 * each for each in _STEPS[::-1]] + [power * each for each in _STEPS[::-1]]
    for step in (sizes[0], *(each for each in sorted(smaller, reverse=True) if each < sizes[0])):
        count = np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1)
        if len(count) >= 2:
            break
    return np.asarray(count * step)


def tick_words(values: Sequence[float] | Array) -> list[str]:
    """Numbers with as many decimals as tell them apart."""
    given = np.asarray(values, dtype=float)
    largest = float(np.abs(given).max(initial=0.0))
    if largest and not _LEAST <= largest < _MOST:
        return [f"{value:g}".replace("-", "−") for value in given]
    size = max(largest, 1e-9)
    digits = next((d for d in range(10) if np.abs(given - given.round(d)).max(initial=0.0) < 1e-6 * size), 10)
    return [f"{value + 0.0:.{digits}f}".replace("-", "−") for value in given.round(digits)]
