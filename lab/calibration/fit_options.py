"""Options of a fit: which model, which prior, which method."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Final, Literal

from lab.calibration.estimator import Estimator
from lab.calibration.gauss_newton import Fit, Observations
from lab.calibration.observation import Observation
from lab.calibration.prior import Tolerance
from lab.core.se3 import Array
from lab.kinematics.effects.effect_registry import CANDIDATES

__all__ = ["PLAIN", "FitOptions", "Solve"]

Solve = Callable[[Observation, Observations, Sequence[int], Array], Fit]
"""Another method to fit the free parameters than all at once."""


@dataclass(frozen=True)
class FitOptions:
    """Options of a fit, in SI units.

    ``identify`` fits one model: it uses ``fix``, ``free``, ``prior``, ``tolerance``, ``estimator``, ``solve`` and
    ``near``. A ``Fitter`` makes the model, by the others.

    Attributes:
        groups: of effects that the model has beside geometry.
        search: whether groups are searched for instead.
        residual: whether what no group explains is predicted as offsets of the joints.
        robust: whether outliers are left out.
        fix, free: names or patterns of parameters to fix at nominal, or to identify though usually fixed.
        prior: use of the tolerances of manufacture: along weakly observable directions at an estimated scale (auto),
            everywhere (on), or not at all (off).
        tolerance: of manufacture.
        estimator: whose estimate takes the place of that of least squares; None for none. Groups are selected by least
            squares.
        solve: a method in place of the fit of all parameters at once (``sensors.sequential_fit``); None for that one.
        near: initial values, by parameters' names; the others start at nominal, base and tool without initial values.
        error_terms: names of error terms that packages add, to be searched among the noise.
        further: groups of packages that a search tries, too.
        accept: kinds or keys of gross mistakes to undo.
    """

    groups: tuple[str, ...] = ()
    search: bool = False
    residual: bool = False
    robust: bool = False
    fix: tuple[str, ...] = ()
    free: tuple[str, ...] = ()
    prior: Literal["auto", "on", "off"] = "auto"
    tolerance: Tolerance = field(default_factory=Tolerance)
    estimator: Estimator | None = None
    solve: Solve | None = None
    near: Mapping[str, float] = field(default_factory=dict)
    error_terms: tuple[str, ...] = ()
    further: tuple[str, ...] = ()
    accept: tuple[str, ...] = ()

    @property
    def candidates(self) -> tuple[str, ...]:
        """The groups that a search tries."""
        return (*CANDIDATES, *self.further)

    @property
    def geometric(self) -> bool:
        """Check whether the model is geometry alone."""
        return not (self.search or self.groups)

    def of(self, names: Sequence[str]) -> "FitOptions":
        """Drop patterns that match none of these parameters: they are of other groups' models."""
        fix, free = (
            tuple(pattern for pattern in patterns if any(fnmatchcase(name, pattern) for name in names))
            for patterns in (self.fix, self.free)
        )
        return replace(self, fix=fix, free=free)


PLAIN: Final = FitOptions(prior="off")
"""Least squares of the geometry, without a prior."""
