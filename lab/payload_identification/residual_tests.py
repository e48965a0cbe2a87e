"""Whether residuals are what independent noise explains, and if not, what they follow.

Intervals count every number as independent and the model as right. Each suspect (a delay, friction that grows with
the load, ...) is a few columns that the fit has not: F of the fall in squares if they were fitted too (Seber & Lee
2003, section 4.3). What has no name shows in a motion as residuals that are larger where they are slow, as the load's
own columns are, than where they are quick. The least p counts, times the number of tests (Bonferroni).

Positions bring noise of their own, the more the quicker it is, into accelerations and so into the columns and the
residuals alike. It makes intervals too wide rather than too small; to be blind to it, suspects are slow parts too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to

from lab.core.linear_model import p_value_of_squares
from lab.core.se3 import Array
from lab.core.significance import PAYLOAD_RESIDUALS
from lab.payload_identification.least_squares import ChannelSolution

__all__ = ["BiasCandidate", "ResidualVerdict", "Series", "verdict"]

_SLOW_HZ = 5.0  # below it a quick arm's torques change
_MOST_SLOW = 0.5  # of the band
_NEW = 1e-6  # of a suspect's column: what the fit's own columns must leave of it


@dataclass(frozen=True)
class BiasCandidate:
    """What a residual may follow.

    Attributes:
        columns: ``(n, d, k)`` beside those fitted.
        words: what it is, and how it is cured.
    """

    columns: Array
    words: str


@dataclass(frozen=True)
class Series:
    """Rows that are evenly timed samples, one after the other, of which a band of half their rate is used.

    Attributes:
        first, last: the rows are ``first:last``.
        band_hz: of what is in them.
    """

    first: int
    last: int
    band_hz: float

    @property
    def slow(self) -> int:
        """How many of a cosine transform's coefficients are slow."""
        return round((self.last - self.first) * min(_SLOW_HZ / self.band_hz, _MOST_SLOW))


@dataclass(frozen=True)
class ResidualVerdict:
    """Whether the residuals are what noise explains.

    Attributes:
        adequate: None where there are too few numbers to tell.
        p: the chance of residuals like these if they are noise; NaN if not told.
        words: a sentence with its figures.
    """

    adequate: bool | None
    p: float
    words: str


def verdict(
    solution: ChannelSolution, suspects: Sequence[BiasCandidate], series: Sequence[Series] = ()
) -> ResidualVerdict:
    """All tests that there are numbers for; rows that are in no series are poses, or anything in no order."""
    outcomes = [(_added(solution, _slow(suspect.columns, series)), suspect.words) for suspect in suspects]
    outcomes.append((_slowness(solution, series), "something slow without a name, as the load's own torques are slow"))
    if solution.sigma_known:
        outcomes.append(
            (_too_large(solution), "more than the noise's given sigma: it is larger, or the model is wrong")
        )
    tested = [(p, words) for p, words in outcomes if not np.isnan(p)]
    if not tested:
        return ResidualVerdict(
            None, np.nan, "whether the residuals are noise cannot be said: there are too few of them"
        )
    least, words = min(tested)
    p = min(1.0, len(tested) * least)
    counted = f"(p = {p:.2g}, the least of {len(tested)} tests)"
    if p >= PAYLOAD_RESIDUALS:
        return ResidualVerdict(True, p, f"the residuals are what independent noise explains {counted}")
    return ResidualVerdict(False, p, f"the intervals are too small: the residuals follow {words} {counted}")


def _added(solution: ChannelSolution, columns: Array) -> float:
    """The p of F for further columns; NaN where the fit's own columns or the numbers leave nothing of them."""
    rows = (columns / solution.sigma[:, None]).reshape(solution.residual.size, -1)
    length = np.linalg.norm(rows, axis=0)
    rows = rows[:, length > 0] / length[length > 0]
    rows = solution.model.residual(rows)
    u, sizes, _ = np.linalg.svd(rows, full_matrices=False)
    pull = u[:, sizes > _NEW].T @ solution.residual.ravel()
    squares, gained = float((solution.residual**2).sum()), float(pull @ pull)
    dof = solution.model.dof - len(pull)
    if len(pull) == 0 or dof < 3:
        return float("nan")
    if solution.sigma_known:
        return float(p_value_of_squares(gained, len(pull)))
    noise = max((squares - gained) / dof, 1.0 if solution.rounding else 1e-300)
    return float(p_value_of_squares(gained, len(pull), dof, noise))


def _slow(columns: Array, series: Sequence[Series]) -> Array:
    """The columns ``(n, d, k)`` without what is quick in them."""
    slow = np.array(columns)
    for part in series:
        rows = slice(part.first, part.last)
        transformed = scipy.fft.dct(columns[rows], axis=0, norm="ortho")
        transformed[part.slow :] = 0.0
        slow[rows] = scipy.fft.idct(transformed, axis=0, norm="ortho")
    return slow


def _slowness(solution: ChannelSolution, series: Sequence[Series]) -> float:
    """The p of F of the residuals' slow part against their quick one, each by its rows less its leverages."""
    squares, dof = np.zeros(2), np.zeros(2)
    basis = solution.model.basis.reshape(*solution.residual.shape, -1)
    for part in series:
        rows = slice(part.first, part.last)
        power = scipy.fft.dct(solution.residual[rows], axis=0, norm="ortho") ** 2
        left = 1 - (scipy.fft.dct(basis[rows], axis=0, norm="ortho") ** 2).sum(axis=2)
        for i, which in enumerate((slice(0, part.slow), slice(part.slow, None))):
            squares[i] += power[which].sum()
            dof[i] += left[which].sum()
    if dof.min() < 3:
        return float("nan")
    mean = np.maximum(squares / dof, 1.0 if solution.rounding else 1e-300)
    return float(p_value_of_squares(mean[0] * dof[0], dof[0], dof[1], mean[1]))


def _too_large(solution: ChannelSolution) -> float:
    """The p of chi squared of all residuals, by the given sigma."""
    dof = solution.model.dof
    return float(p_value_of_squares((solution.residual**2).sum(), dof)) if dof > 0 else float("nan")
