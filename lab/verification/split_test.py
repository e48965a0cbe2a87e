"""Test whether a calibrated arm has changed, by the two parts of r' S^-1 r.

The test compares measured less predicted, r, with its predicted covariance S = noise + J C J' (``predicted_points``).
One chi squared over all numbers loses its power as these grow, so whitened r is split into its part in the span of
S^-1/2 J, with J the columns of the identified parameters, and the rest. A change of the arm shows in the first part, an
outlier or larger noise in the second. Both are independent, so each is tested at 1 - (1 - a)^(1/2) (Sidak 1967). The
first part is also how much less r' S^-1 r is where every identified parameter is refitted (Seber & Lee 2003, section
4.1). Where the measurements are no more than the parameters, one test at a is left.
"""

from dataclasses import dataclass, replace

import numpy as np

from lab.core.linear_model import LinearModel
from lab.core.significance import VERIFICATION
from lab.verification.predicted_points import FULL_RANK, CalibrationPrediction, RefitSolution

__all__ = ["ChangeTest", "change_test", "explained", "freed", "split_test"]


@dataclass(frozen=True)
class _PartTest:
    """Part of the test statistic r' S^-1 r.

    Attributes:
        p: the chance of a larger one, if nothing has changed; 1 where it has no degrees of freedom.
    """

    square: float
    numbers: int
    p: float


@dataclass(frozen=True)
class ChangeTest:
    """Test for a change of the arm, by both parts of the statistic.

    Attributes:
        along: the part that the identified parameters span.
    """

    along: _PartTest
    rest: _PartTest

    @property
    def square(self) -> float:
        """Total statistic r' S^-1 r."""
        return self.along.square + self.rest.square

    @property
    def tests(self) -> int:
        """Number of parts that have degrees of freedom."""
        return sum(part.numbers > 0 for part in (self.along, self.rest))

    @property
    def p(self) -> float:
        """The chance of a smaller p of either part, if nothing has changed."""
        least = min(self.along.p, self.rest.p)
        return least if self.tests < 2 else float(-np.expm1(2 * np.log1p(-least))) if least < 1 else 1.0

    @property
    def changed(self) -> bool:
        """Check whether the test rejects at its level."""
        return self.p < VERIFICATION

    @property
    def level(self) -> float:
        """Level of each part."""
        return VERIFICATION if self.tests < 2 else float(-np.expm1(np.log1p(-VERIFICATION) / 2))


def freed(fit: RefitSolution, free: tuple[int, ...]) -> RefitSolution:
    """Refit every identified parameter too, linearized at ``fit``; ``square`` stays that of ``fit``."""
    directions = np.concatenate([fit.directions, np.eye(len(fit.values))[:, list(free)]], axis=1)
    model = LinearModel.of(fit.there.white(fit.there.jacobian @ directions), FULL_RANK)
    return replace(fit, model=model, directions=directions)


def change_test(prediction: CalibrationPrediction, fit: RefitSolution) -> ChangeTest:
    """Test for a change by the statistic that remains at ``fit``."""
    return split_test(prediction, (fit.square, fit.dof), explained(fit, freed(fit, prediction.free)))


def explained(fit: RefitSolution, opened: RefitSolution) -> tuple[float, int]:
    """Return the fall of r' S^-1 r when the parameters are freed, and its degrees of freedom."""
    residual = fit.there.white(fit.there.residual)
    pulls = (float((each.model.coordinates(residual) ** 2).sum()) for each in (opened, fit))
    return next(pulls) - next(pulls), opened.rank - fit.rank


def split_test(prediction: CalibrationPrediction, left: tuple[float, int], along: tuple[float, int]) -> ChangeTest:
    """Return the change test of two statistics with their degrees of freedom.

    Args:
        left: statistic of all coordinates.
        along: the part of it that the identified parameters would explain.
    """
    square, numbers = max(along[0], 0.0), along[1]
    others = left[1] - numbers
    each = max(1, left[1] // max(numbers, 1))
    rest = max(left[0] - square, 0.0)
    return ChangeTest(
        _PartTest(square, numbers, prediction.p(square, numbers, each)),
        _PartTest(rest, others, prediction.p(rest, others)),
    )
