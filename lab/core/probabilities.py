"""Probabilities of the distributions that tests and intervals stand on, and their inverses.

``scipy.stats`` has them too, but importing it takes a fifth of a short command's time. These are the special functions
below it (``scipy.special``), loaded at the first use.

Each name says the distribution and what is asked: ``sf`` the chance of more than x, ``cdf`` that of no more, ``isf``
the x that is exceeded with chance p, ``ppf`` the x that is not. Arguments broadcast; where degrees of freedom are none,
NaN.
"""

import numpy as np
import scipy  # its special functions are loaded at their first use
from numpy.typing import ArrayLike

from lab.core.se3 import Array

__all__ = [
    "beta_ppf",
    "binomial_cdf",
    "chi2_isf",
    "chi2_ppf",
    "chi2_sf",
    "f_cdf",
    "f_isf",
    "f_sf",
    "normal_ppf",
    "normal_sf",
    "t_isf",
    "t_ppf",
    "t_sf",
]


def normal_sf(x: ArrayLike) -> Array:
    """Of the standard normal distribution."""
    return np.asarray(scipy.special.ndtr(-np.asarray(x, dtype=np.float64)))


def normal_ppf(p: ArrayLike) -> Array:
    """Of the standard normal distribution."""
    return np.asarray(scipy.special.ndtri(p))


def t_sf(x: ArrayLike, dof: ArrayLike) -> Array:
    """Of Student's t."""
    return np.asarray(scipy.special.stdtr(dof, -np.asarray(x, dtype=np.float64)))


def t_ppf(p: ArrayLike, dof: ArrayLike) -> Array:
    """Of Student's t."""
    return np.asarray(scipy.special.stdtrit(dof, p))


def t_isf(p: ArrayLike, dof: ArrayLike) -> Array:
    """Of Student's t."""
    return -t_ppf(p, dof)


def chi2_sf(x: ArrayLike, dof: ArrayLike) -> Array:
    """Of chi squared; all of it lies above zero."""
    return np.asarray(scipy.special.chdtrc(dof, np.maximum(x, 0.0)))


def chi2_isf(p: ArrayLike, dof: ArrayLike) -> Array:
    """Of chi squared."""
    return np.asarray(scipy.special.chdtri(dof, p))


def chi2_ppf(p: ArrayLike, dof: ArrayLike) -> Array:
    """Of chi squared."""
    return np.asarray(2 * scipy.special.gammaincinv(np.asarray(dof) / 2, p))


def f_sf(x: ArrayLike, first: ArrayLike, second: ArrayLike) -> Array:
    """Of F with degrees of freedom of numerator and denominator; all of it lies above zero."""
    return np.asarray(scipy.special.fdtrc(first, second, np.maximum(x, 0.0)))


def f_cdf(x: ArrayLike, first: ArrayLike, second: ArrayLike) -> Array:
    """Of F."""
    return np.asarray(scipy.special.fdtr(first, second, np.maximum(x, 0.0)))


def f_isf(p: ArrayLike, first: ArrayLike, second: ArrayLike) -> Array:
    """Of F: one over F with the degrees of freedom exchanged has the other tail."""
    return np.asarray(1 / scipy.special.fdtri(second, first, p))


def beta_ppf(p: ArrayLike, first: ArrayLike, second: ArrayLike) -> Array:
    """Of the beta distribution."""
    return np.asarray(scipy.special.betaincinv(first, second, p))


def binomial_cdf(count: ArrayLike, trials: ArrayLike, chance: ArrayLike) -> Array:
    """Of so many successes, from -1 on, among so many trials."""
    below = np.floor(np.asarray(count, dtype=np.float64))
    return np.asarray(np.where(below < 0, 0.0, scipy.special.bdtr(np.maximum(below, 0), trials, chance)))
