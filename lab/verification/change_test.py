"""The two tests of a verification: along the parameters, and of everything else.

One chi squared over all numbers loses its power as these grow: 300,000 of them scatter by 775, and hide a square of 300
that a moved joint adds. So r, whitened by its whole covariance S = noise + J C J', is split into its part in the span
of S^-1/2 J, with J the columns of the identified parameters, and the rest. What the arm itself can do lies in the
first, with no more degrees of freedom than there are parameters; a bad reading or larger noise shows in the second.
Both parts are independent, so each is tested at 1 - (1 - a)^(1/2) and one of them rejects in a share a (Sidak 1967).

The first part is also how much less r' S^-1 r is where every identified parameter is set free: the classical test of a
linear hypothesis (Seber & Lee 2003, section 4.1). Where the measurements are no more than the parameters, all of r
lies in their span, and one test at a is left.
"""

from dataclasses import dataclass, replace

import numpy as np

from lab.core.linear_model import LinearModel
from lab.core.significance import VERIFICATION
from lab.verification.prediction import FULL_RANK, CalibrationPrediction, RefitSolution

__all__ = ["ChangeTest", "PartTest", "change_test", "explained", "freed", "split_test"]


@dataclass(frozen=True)
class PartTest:
    """One part of r' S^-1 r.

    Attributes:
        square: how large it is.
        numbers: its degrees of freedom.
        p: the chance of a larger one, if nothing has changed; 1 where it has no degrees of freedom.
    """

    square: float
    numbers: int
    p: float


@dataclass(frozen=True)
class ChangeTest:
    """Whether an arm has changed, by both parts.

    Attributes:
        along: the part that the identified parameters span.
        rest: the other.
    """

    along: PartTest
    rest: PartTest

    @property
    def square(self) -> float:
        """What is left of r' S^-1 r."""
        return self.along.square + self.rest.square

    @property
    def tests(self) -> int:
        """How many parts have degrees of freedom."""
        return sum(part.numbers > 0 for part in (self.along, self.rest))

    @property
    def p(self) -> float:
        """The chance of a smaller p of either part, if nothing has changed."""
        least = min(self.along.p, self.rest.p)
        return least if self.tests < 2 else float(-np.expm1(2 * np.log1p(-least))) if least < 1 else 1.0

    @property
    def changed(self) -> bool:
        """Whether the test rejects at its level."""
        return self.p < VERIFICATION

    @property
    def level(self) -> float:
        """Of each part."""
        return VERIFICATION if self.tests < 2 else float(-np.expm1(np.log1p(-VERIFICATION) / 2))


def freed(fit: RefitSolution, free: tuple[int, ...]) -> RefitSolution:
    """The same with every identified parameter fitted, where it was made; ``square`` stays that of ``fit``."""
    directions = np.concatenate([fit.directions, np.eye(len(fit.values))[:, list(free)]], axis=1)
    model = LinearModel.of(fit.there.white(fit.there.jacobian @ directions), FULL_RANK)
    return replace(fit, model=model, directions=directions)


def change_test(prediction: CalibrationPrediction, fit: RefitSolution) -> ChangeTest:
    """Of what is left where ``fit`` was made."""
    return split_test(prediction, (fit.square, fit.dof), explained(fit, freed(fit, prediction.free)))


def explained(fit: RefitSolution, opened: RefitSolution) -> tuple[float, int]:
    """How much less r' S^-1 r is where the parameters are ``freed``, and by how many numbers."""
    residual = fit.there.white(fit.there.residual)
    pulls = (float((each.model.coordinates(residual) ** 2).sum()) for each in (opened, fit))
    return next(pulls) - next(pulls), opened.rank - fit.rank


def split_test(prediction: CalibrationPrediction, left: tuple[float, int], along: tuple[float, int]) -> ChangeTest:
    """Of squares with their degrees of freedom.

    Args:
        left: of all numbers.
        along: of these, what the identified parameters would explain.
    """
    square, numbers = max(along[0], 0.0), along[1]
    others = left[1] - numbers
    each = max(1, left[1] // max(numbers, 1))
    rest = max(left[0] - square, 0.0)
    return ChangeTest(
        PartTest(square, numbers, prediction.p(square, numbers, each)),
        PartTest(rest, others, prediction.p(rest, others)),
    )
