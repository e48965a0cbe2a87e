"""A load from how far the arm sags under it, where the joints' stiffness is known: mass and centre of mass."""

from dataclasses import dataclass, replace

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.dynamics.payload.estimate import LoadEstimate, estimate_of, excitation_advice
from lab.extensions.dynamics.regression import BiasCandidate, least_squares, verdict
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.dynamics.rigid_body import LOAD, torque_regressor
from lab.kinematics.serial.arm import SerialArm

__all__ = ["CompliantArm", "from_sag"]

_ROUNDS, _SETTLED = 20, 1e-9  # kg, kg m
_NEWTON = 4


@dataclass(frozen=True)
class CompliantArm:
    """An arm whose joints give way.

    Attributes:
        compliance: ``(J,)`` rad/Nm (m/N of a slide), zero of joints that do not.
        loads: its own masses, with gravity in frame 0.
    """

    compliance: Array
    loads: Loads


def from_sag(
    arm: SerialArm,
    values: Array,
    soft: CompliantArm,
    joints: Array,
    unloaded: Array,
    loaded: Array,
    sigma_m: float | None = None,
) -> LoadEstimate:
    """Mass and centre of mass from the targets' places without and with the load, at the same joint positions.

    The joints stand at q + d with d = C (g(q + d) - W(q + d) phi), by the arm's own weight g and the static columns
    of the load's regressor; Gauss-Newton in phi, the equilibrium solved at each step.

    Args:
        joints: joint positions ``(n, J)``.
        unloaded, loaded: ``(n, k, 3)`` m, in the tracker's frame; poses with a NaN are left out.
        sigma_m: noise of a coordinate in one of the two; else it is estimated.

    Raises:
        LabError: too few poses, or no compliance.
    """
    if not np.any(soft.compliance):
        raise LabError(
            "no joint has a compliance: a stiff arm shows no load by its sag; identify the compliances first"
        )
    both = np.isfinite(unloaded).all(axis=(1, 2)) & np.isfinite(loaded).all(axis=(1, 2))
    if not both.any():
        raise LabError("no pose was seen both with and without the load: measure the same poses twice")
    joints, seen = joints[both], (loaded - unloaded)[both].reshape(int(both.sum()), -1)
    known = None if sigma_m is None else np.full(seen.shape[1], np.sqrt(2) * sigma_m)
    without = joints + _sag(arm, values, soft, joints, np.zeros(10))[0]
    before, phi = arm.points(without, values).reshape(seen.shape), np.zeros(10)
    for _ in range(_ROUNDS):
        sag, slopes = _sag(arm, values, soft, joints, phi)
        lever = arm.joint_jacobian(joints + sag, values).reshape(*seen.shape, -1)
        columns = lever @ slopes
        left = seen - (arm.points(joints + sag, values).reshape(seen.shape) - before) + columns @ phi
        solution = least_squares(LOAD, columns, left, [0] * seen.shape[1], known)
        step, phi = np.abs(solution.values - phi).max(), solution.values
        if step < _SETTLED:
            break
    bend = lever * (sag + joints - without)[:, None, :]
    suspects = [BiasCandidate(bend, "compliances other than those given; identify them with a load that was weighed")]
    unidentified = excitation_advice(solution, False, arm, values, joints)
    return estimate_of("sag", solution, {}, unidentified, verdict(solution, suspects), float(np.sqrt(2)))


def _sag(arm: SerialArm, values: Array, soft: CompliantArm, joints: Array, phi: Array) -> tuple[Array, Array]:
    """How far the joints give way ``(n, J)``, and the derivatives by phi ``(n, J, 10)``: Newton's method.

    The load's mass and first moment are added to the last link's, which they move with.
    """
    mass, centre = soft.loads.mass_kg.copy(), soft.loads.centre_m.copy()
    mass[-1] += phi[0]
    if mass[-1]:
        centre[-1] = (soft.loads.mass_kg[-1] * soft.loads.centre_m[-1] + phi[1:4]) / mass[-1]
    together = replace(soft.loads, mass_kg=mass, centre_m=centre)
    rest, still = together.equilibrium(joints, soft.compliance, np.zeros(len(joints)), _NEWTON), np.zeros_like(joints)
    regressor = torque_regressor(arm, values, joints + rest.offset, still, still, soft.loads.gravity)
    slopes: Array = np.linalg.solve(rest.equations, -soft.compliance[:, None] * regressor).astype(float)
    return rest.offset, slopes
