"""An upper bound of most errors with confidence: what 95 % of them do not exceed, said wrongly in 5 % of campaigns."""

import numpy as np
import scipy  # its statistics are loaded at their first use

from lab.core.probabilities import binomial_cdf, normal_ppf
from lab.core.se3 import Array

__all__ = ["upper_tolerance_bound"]

_SHARE = _CONFIDENCE = 0.95
_FEWEST = 3


def upper_tolerance_bound(lengths: Array) -> float:
    """The 95 %/95 % upper tolerance bound of independent lengths ``(n,)``; infinite where there are fewer than three.

    From 59 lengths on it is the smallest of them that serves, whatever their distribution is (Wilks 1941). Of fewer,
    the cube root of their squares is taken for normal (Wilson & Hilferty 1931), with the factor of a normal sample
    (Krishnamoorthy & Mathew 2009, equation 2.2.3).
    """
    count = len(lengths)
    if count < _FEWEST:
        return float("inf")
    ranks = np.arange(1, count + 1)
    serves = binomial_cdf(ranks - 1, count, _SHARE) >= _CONFIDENCE
    if serves.any():
        return float(np.sort(lengths)[int(np.argmax(serves))])
    roots = np.cbrt(lengths**2)
    factor = scipy.stats.nct.ppf(_CONFIDENCE, count - 1, normal_ppf(_SHARE) * np.sqrt(count)) / np.sqrt(count)
    return float((roots.mean() + factor * roots.std(ddof=1)) ** 1.5)
