"""Find the physically consistent parameters nearest to an estimate, in the metric of its covariance.

A body has positive mass everywhere: its pseudo-inertia J is positive definite (Wensing, Kim & Slotine 2018); motor
inertias and friction are positive. The set is convex, so its point nearest to the least-squares estimate, by the data's
weights, is never farther from the truth. A weak prior, -w log det J, keeps parameters off the boundary of flat bodies;
in directions without data, w tr(J0^-1 J) keeps them near a reference (the divergence of Lee, Wensing & Park 2020).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.newton import least_squares_step
from lab.core.se3 import Array
from lab.extensions.dynamics.payload.payload_estimate import LoadEstimate
from lab.kinematics.dynamics.rigid_body import is_physical, pseudo_inertia

__all__ = ["BodyCone", "WeightedTarget", "nearest_physical", "physical_estimate"]

_PRIOR = 1e-4  # weight w: it moves the parameters by far less than a standard deviation
_FALL = 0.2  # of the weight, from one that outweighs the misfit at the start down to the prior's
_MAX_ITERATIONS, _CONVERGED = 60, 1e-14  # Newton's steps at each weight, and half its decrement squared at the end
_MIN_MASS = 1e-4  # of the mass's standard deviation, to which a mass below zero is raised
_BASIS = np.array([pseudo_inertia(unit) for unit in np.eye(10)])  # (10, 4, 4): J = phi . basis


@dataclass(frozen=True)
class WeightedTarget:
    """A weighted target: |root (matrix x - target)| is the distance of parameters x in standard deviations."""

    matrix: Array
    target: Array
    root: Array

    def misfit(self, x: Array) -> Array:
        """Return the whitened misfit ``(m,)``."""
        misfit: Array = self.root @ (self.matrix @ x - self.target)
        return misfit


@dataclass(frozen=True)
class BodyCone:
    """Cone of parameters x ``(p,)``, some of bodies and others positive.

    Attributes:
        bodies: ``(k, 10)`` indices, each as ``rigid_body.LOAD``.
        positive: ``(s,)`` indices.
        reference: ``(p,)`` inside the cone, near which undetermined directions are kept; None where there are none.
    """

    bodies: NDArray[np.int_]
    positive: NDArray[np.int_]
    reference: Array | None = None

    def nearest(self, aim: WeightedTarget, start: Array) -> Array:
        """Minimize squared distance / 2 + w barrier(x), from a large w down to the prior's.

        The function is convex and its barrier self-concordant: Newton's steps, halved while they leave the set or do
        not descend, converge from any start in it (Boyd & Vandenberghe 2004, section 9.6).
        """
        x = start
        weight = max(_PRIOR, float(np.sum(aim.misfit(x) ** 2)))
        while True:
            x = self._descended(x, aim, weight)
            if weight <= _PRIOR:
                return x
            weight = max(weight * _FALL, _PRIOR)

    def _descended(self, x: Array, aim: WeightedTarget, weight: float) -> Array:
        """Minimize at one weight of the prior."""

        def value(x: Array) -> float:
            barrier = self._barrier(x)
            return np.inf if barrier is None else float(np.sum(aim.misfit(x) ** 2) / 2 + weight * barrier)

        pull = aim.root @ aim.matrix
        for _ in range(_MAX_ITERATIONS):
            flat, wanted = self._barrier_rows(x)
            # least squares of both parts at once: its normal equations are Newton's
            rows = np.concatenate([pull, np.sqrt(weight) * flat])
            target = np.concatenate([-aim.misfit(x), np.sqrt(weight) * wanted])
            step = least_squares_step(rows, target)
            slope = float(np.sum((rows @ step) ** 2))
            if slope / 2 < _CONVERGED * weight:
                return x
            now, length = value(x), 1.0
            while value(x + length * step) > now - 0.1 * length * slope and length > 1e-10:
                length /= 2
            if length <= 1e-10:  # rounding: no descent is left
                return x
            x = x + length * step
        return x

    def _barrier(self, x: Array) -> float | None:
        """Return -log det J of the bodies less the logarithms of positive parameters, with the reference's part.

        None outside the cone.
        """
        if (x[self.positive] <= 0).any():
            return None
        total = -float(np.log(x[self.positive]).sum())
        for body in self.bodies:
            factor = _upper_factor(x[body])
            if factor is None:
                return None
            total -= 2 * float(np.log(np.diag(factor)).sum())
        if self.reference is not None:
            total += float((x[self.positive] / self.reference[self.positive]).sum())
            total += sum(
                float(np.trace(np.linalg.solve(pseudo_inertia(self.reference[body]), pseudo_inertia(x[body]))))
                for body in self.bodies
            )
        return total

    def _barrier_rows(self, x: Array) -> tuple[Array, Array]:
        """Return rows F and targets t with the barrier's second derivatives F'F and its slope -F't.

        With J = U U' the rows of one body are U^-1 B_i U^-T, and t = 1 - U' J0^-1 U.
        """
        parts, targets = [], []
        for body in self.bodies:
            factor = _upper_factor(x[body])
            assert factor is not None
            inverse = np.linalg.inv(factor)
            rows = np.zeros((16, len(x)))
            rows[:, body] = (inverse @ _BASIS @ inverse.T).reshape(10, 16).T
            wanted = np.eye(4)
            if self.reference is not None:
                wanted = wanted - factor.T @ np.linalg.solve(pseudo_inertia(self.reference[body]), factor)
            parts.append(rows)
            targets.append(wanted.ravel())
        alone = np.zeros((len(self.positive), len(x)))
        alone[np.arange(len(self.positive)), self.positive] = 1 / x[self.positive]
        ones = np.ones(len(self.positive))
        if self.reference is not None:
            ones = ones - x[self.positive] / self.reference[self.positive]
        return np.concatenate([*parts, alone]), np.concatenate([*targets, ones])


def _upper_factor(phi: Array) -> Array | None:
    """Return U with J = U U', upper triangular with a positive diagonal; None where J is not positive definite."""
    try:
        lower = np.linalg.cholesky(pseudo_inertia(phi)[::-1, ::-1])
    except np.linalg.LinAlgError:
        return None
    return np.asarray(lower[::-1, ::-1])


def physical_estimate(estimate: LoadEstimate) -> LoadEstimate:
    """Return the estimate if it is physical, else with the nearest physical parameters.

    Covariance and intervals remain those of least squares, which still cover the truth. Without an identified inertia
    only the mass is made positive.

    Raises:
        LabError: mass or centre of mass are not identified.
    """
    if not np.isfinite(estimate.phi[:4]).all():
        raise LabError("mass and centre of mass are not identified: there is nothing to make physical; add poses")
    if estimate.physical:
        return estimate
    nearest = nearest_physical if np.isfinite(estimate.phi).all() else _positive_mass
    return replace(estimate, phi=nearest(estimate.phi, estimate.covariance), moved=True)


def nearest_physical(phi: Array, covariance: Array) -> Array:
    """Return the nearest physical load, by the covariance ``(10, 10)``."""
    scale = np.sqrt(np.diag(covariance))
    root = np.linalg.inv(np.linalg.cholesky(covariance / np.outer(scale, scale))) / scale  # C^-1 = root' root
    cone = BodyCone(np.arange(10)[None], np.empty(0, dtype=np.int_))
    return cone.nearest(WeightedTarget(np.eye(10), phi, root), _inside(phi))


def _inside(phi: Array) -> Array:
    """Return a physical load nearby: eigenvalues of J, with lengths in the load's own size, raised to a thousandth."""
    mass = max(abs(phi[0]), 1e-6)
    size = np.sqrt(max(np.abs(phi[4:7]).max() / mass, float(phi[1:4] @ phi[1:4]) / mass**2, 1e-8))
    unit = np.array([size, size, size, 1.0]) * np.sqrt(mass)
    sizes, axes = np.linalg.eigh(pseudo_inertia(phi) / np.outer(unit, unit))
    matrix = (axes * np.maximum(sizes, 1e-3)) @ axes.T * np.outer(unit, unit)
    flat: Array = np.linalg.lstsq(_BASIS.reshape(10, 16).T, matrix.ravel(), rcond=None)[0]
    assert is_physical(flat)
    return flat


def _positive_mass(phi: Array, covariance: Array) -> Array:
    """Raise the mass to a little of its sigma, and move the first moment to its best value for that."""
    raised = _MIN_MASS * np.sqrt(covariance[0, 0]) - phi[0]
    moved = phi.copy()
    moved[:4] += covariance[:4, 0] / covariance[0, 0] * raised
    return moved
