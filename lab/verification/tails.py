"""Sums of squares of noise with the tails of Student's t, whose distribution has no name: by draws.

Of very many numbers the few that lie beyond a bound are drawn one by one, and the sum of the others, which are bounded,
is normal by the central limit theorem: its error is far below that of the draws.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from scipy import integrate, stats

from lab.core.se3 import Array

__all__ = ["DRAWS", "squares_of_tails"]

DRAWS = 1999  # (draws + 1) x level is a whole number
_MOST_ESTIMATING = 3000
_MOST_DRAWN = 3000  # numbers that are drawn one by one
_MEAN = 30  # errors
_AT_ONCE = 32  # means
_BEYOND = 300  # numbers of each draw that lie beyond the bound where there are more


@lru_cache(maxsize=64)
def squares_of_tails(tail_dof: float, numbers: int, dof: int | None, each_of: int = 1) -> Array:
    """Sums of squares ``(draws,)`` of so many numbers of unit variance, over an estimated variance of ``dof`` others.

    The draws are always the same ones.

    Args:
        tail_dof: degrees of freedom of Student's t, above 2.
        each_of: how many independent errors each number is a mean of, times their square root. Such means are nearer to
            normal than the errors are, so more than thirty count as thirty.
    """
    rng = np.random.default_rng(0)
    squares = _sums(tail_dof, numbers, rng) if each_of < 2 else _of_means(tail_dof, numbers, min(each_of, _MEAN))
    if dof is not None and dof <= _MOST_ESTIMATING:  # of more the variance is known as well as need be
        squares = squares / (_sums(tail_dof, dof, rng) / dof)
    return squares


def _sums(tail_dof: float, numbers: int, rng: np.random.Generator) -> Array:
    size = (tail_dof - 2) / tail_dof
    if numbers <= _MOST_DRAWN:
        drawn: Array = size * (rng.standard_t(tail_dof, (DRAWS, numbers)) ** 2).sum(axis=1)
        return drawn
    student, share = stats.t(tail_dof), _BEYOND / numbers
    bound = float(student.isf(share / 2))
    mean, square = (_within(student, bound, power) / (1 - share) for power in (2, 4))
    beyond = rng.binomial(numbers, share, DRAWS)
    within = numbers - beyond
    sums = mean * within + np.sqrt(within * (square - mean**2)) * rng.standard_normal(DRAWS)
    tails = student.isf(share / 2 * rng.random(int(beyond.sum()))) ** 2
    sums += np.bincount(np.repeat(np.arange(DRAWS), beyond), weights=tails, minlength=DRAWS)
    return np.asarray(size * sums)


def _of_means(tail_dof: float, numbers: int, each_of: int) -> Array:
    return np.asarray(_summed_means(tail_dof, -(-numbers // _AT_ONCE) * _AT_ONCE, each_of)[:, numbers - 1])


@lru_cache(maxsize=8)
def _summed_means(tail_dof: float, most: int, each_of: int) -> Array:
    """Sums ``(draws, most)`` of the squares of the first mean, of the first two, and so on."""
    rng, size = np.random.default_rng(1), (tail_dof - 2) / tail_dof / each_of
    means = [rng.standard_t(tail_dof, (DRAWS, each_of)).sum(axis=1) for _ in range(most)]
    return size * np.cumsum(np.square(means).T, axis=1)


def _within(student: Any, bound: float, power: int) -> float:
    """The integral of a power of what is drawn, where it is within a bound."""
    return float(2 * integrate.quad(lambda t: t**power * student.pdf(t), 0, bound, limit=500)[0])
