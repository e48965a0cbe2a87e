"""Define an estimator of one's own: measurements in, parameters and their covariance out.

An estimator sees a robot through an ``EstimationProblem`` alone: residuals and derivatives as plain arrays, whitened by
the noise, initial values and a prior. The lab chooses the parameters, and makes the identification of what it returns.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import ExtraResiduals, Fit, Observations, OtherEstimate
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extension_points import Part, PartKind, numbers
from lab.kinematics.model import Model

__all__ = ["LEAST_SQUARES", "EstimationProblem", "Estimator", "Poses", "estimated", "estimator_named"]

Poses = Sequence[int] | NDArray[np.int_] | slice
"""Indices of poses."""
LEAST_SQUARES = "least-squares"
_NEGATIVE = -1e-9  # of the largest eigenvalue of a covariance in units of its standard deviations: below, it is none


@dataclass(frozen=True, repr=False, eq=False)
class EstimationProblem:
    """The measurements of a robot and the parameters to estimate from them, as plain arrays.

    There are f parameters, in m and rad, and n poses. Residuals are measured less predicted, in standard deviations of
    the noise, so that their covariance is the identity; a pose has one for each of its measured numbers.

    Attributes:
        names: names of the parameters ``(f,)``.
        start: initial values ``(f,)``: nominal, with base and tool fitted to the measurements by least squares.
        prior_information: ``(f, f)`` the inverse covariance of the tolerances of manufacture around ``start``; rows of
            zeros for base and tool, which have none, and all zeros with ``prior="off"``.
        sigma_m: noise of a coordinate (m, 1 sigma): given, else estimated from the residuals of least squares.
        inputs: ``(n, joints + conditions)`` joint positions (rad or m), then the conditions that the model takes.
        points: ``(n, k, d)`` the measured points (m) or other quantities, NaN where not measured.
    """

    names: tuple[str, ...]
    start: Array
    prior_information: Array
    sigma_m: float
    inputs: Array
    points: Array
    _model: Model
    _observed: Observations
    _free: tuple[int, ...]
    _all: Array
    _extra: ExtraResiduals

    def predicted(self, values: Array) -> Array:
        """Return the predicted points ``(n, k, d)`` at values ``(f,)``, in the units of ``points``."""
        return self._model.points(self.inputs, self._whole(values))

    def residuals(self, values: Array, poses: Poses | None = None) -> Array:
        """Return the residuals ``(r,)`` at values ``(f,)``; arguments as of ``linearized``."""
        observed, whole = self._of(poses), self._whole(values)
        rows = observed.apply(observed.points - self._model.points(observed.inputs, whole))
        return np.concatenate([rows, self._extra(whole)[0]]) if poses is None else rows

    def linearized(self, values: Array, poses: Poses | None = None) -> tuple[Array, Array]:
        """Return the residuals ``(r,)`` at values ``(f,)``, and the derivatives ``(r, f)`` of the prediction.

        A small change ``d`` of the values changes the residuals by ``-jacobian @ d``.

        Args:
            poses: whose rows to return, by index; by default those of all poses, and after them the rows of
                constraints that the sensor adds (fixtures). Errors that several poses share are whitened among these
                poses alone.
        """
        observed, whole = self._of(poses), self._whole(values)
        predicted, slopes = self._model.observe(observed.inputs, whole)
        rows, jacobian = observed.apply(observed.points - predicted), observed.apply(slopes[..., list(self._free)])
        if poses is not None:
            return rows, jacobian
        more, slopes = self._extra(whole)
        return np.concatenate([rows, more]), np.concatenate([jacobian, slopes[:, list(self._free)]])

    def _of(self, poses: Poses | None) -> Observations:
        if poses is None:
            return self._observed
        return self._observed.take(np.arange(len(self.inputs))[poses])

    def _whole(self, values: Array) -> Array:
        whole = self._all.copy()
        whole[list(self._free)] = values
        return whole


def _estimate(where: str, returned: object, problem: EstimationProblem) -> tuple[Array, Array]:
    """Return an estimate as arrays.

    Raises:
        LabError: it has other shapes, a value is not finite, or the covariance is none.
    """
    if not (isinstance(returned, tuple | list) and len(returned) == 2):
        raise LabError(f"{where} returns {type(returned).__name__}; return values and their covariance")
    size = len(problem.names)
    values = numbers(where, returned[0], (size,), "values")
    covariance = numbers(where, returned[1], (size, size), "a covariance")
    covariance = (covariance + covariance.T) / 2
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    if not (std > 0).all() or np.linalg.eigvalsh(covariance / np.outer(std, std))[0] < _NEGATIVE * size:
        raise LabError(f"{where} returns a covariance that is not positive definite; return one that is")
    return values, covariance


_KIND = PartKind("lab.estimators", "estimator", "estimator", (LEAST_SQUARES,), {"estimate": _estimate}, "estimate")


class Estimator(Part, ABC, kind=_KIND):
    """An estimator of a robot's parameters: measurements in, parameters and their covariance out.

    Your own is a subclass with a ``name`` and an ``estimate``, or a function like ``estimate``. Every call with an
    option ``estimator`` takes an object of it; if a package registers it as an entry point of ``lab.estimators``,
    ``--estimator`` takes it by name. Cross-validation refits with it. Tests of the noise, outliers and lack
    of fit stay those of the least-squares residuals.

    Attributes:
        name: in options and results.

    Example:
        >>> import numpy as np
        >>> import lab
        >>> class OneStep(lab.Estimator):
        ...     name = "one-step"
        ...
        ...     def estimate(self, problem):
        ...         residuals, jacobian = problem.linearized(problem.start)
        ...         covariance = np.linalg.inv(jacobian.T @ jacobian)
        ...         return problem.start + covariance @ jacobian.T @ residuals, covariance
        >>> day = lab.simulate("irb120", poses=40, seed=7)
        >>> result = lab.identify(day.measurements, instrument="uniform-8um", estimator=OneStep())
        >>> result.to_dict()["estimator"]
        'one-step'
    """

    name: str

    @abstractmethod
    def estimate(self, problem: EstimationProblem) -> tuple[Array, Array]:
        """Return the estimated values ``(f,)`` and their covariance ``(f, f)``, in m and rad.

        Raise a ``lab.LabError`` if there is no estimate, e.g. because the iteration does not converge.
        """


def estimator_named(name: str) -> Estimator | None:
    """Return the estimator of this name; None for least squares.

    Raises:
        LabError: there is none, or its package cannot be imported.
    """
    return None if name == LEAST_SQUARES else _KIND.named(name)


def estimated(estimator: Estimator, problem: EstimationProblem, plain: Fit, sigma: float) -> Fit:
    """Return the fit by an estimator, beside that of least squares.

    Args:
        plain: the least squares of the same parameters.
        sigma: standard deviation of ``plain``'s whitened residuals: one where the noise is given.

    Raises:
        LabError: the estimator raises an error, or returns something else than values and a covariance.
    """
    values, covariance = estimator.estimate(problem)
    whole = plain.values.copy()
    whole[list(plain.free)] = values
    other = OtherEstimate(covariance / sigma**2, plain.least_squares)
    return replace(plain, values=whole, status="converged", other=other)
