"""Whether an arm can have the base parameters that were found, and the nearest that one can have."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.linear_model import p_value_of_squares
from lab.core.se3 import Array
from lab.extensions.dynamics.arm.estimate import DynamicsEstimate
from lab.extensions.dynamics.arm.runs import DynamicModel
from lab.extensions.dynamics.payload.physical_consistency import BodyCone, Nearest
from lab.kinematics.dynamics.arm_dynamics import ArmDynamics

__all__ = ["PhysicalFit", "nearest_physical_arm"]

_SAME = 0.1  # standard deviations: parameters that are nearer are those that were found
_UNKNOWN = {"Ia": 0.1, "Fc": 1.0, "Fv": 1.0, "Fcm": 1.0, "Fvm": 1.0}  # a reference where there is none, SI
_BALL_KG, _BALL_M = 2.0, 0.1  # of each link, where no masses are known


@dataclass(frozen=True)
class PhysicalFit:
    """The nearest parameters that an arm can have.

    Attributes:
        standard: ``(p,)`` standard parameters with positive definite pseudo-inertias, and positive inertias of motors
            and friction; those that torques do not determine are near a reference.
        base: ``(b,)`` the base parameters of these.
        distance: of these from what was found, in standard deviations (the root of the sum of squares).
        p: the chance that the noise alone carries an arm's estimate so far out of what is physical.
    """

    standard: Array
    base: Array
    distance: float
    p: float

    @property
    def physical(self) -> bool:
        """Whether what was found is what an arm can have."""
        return self.distance < _SAME


def nearest_physical_arm(model: DynamicModel, found: DynamicsEstimate, links: Array | None = None) -> PhysicalFit:
    """The nearest physical parameters of an arm.

    Args:
        links: ``(J, 10)`` phi of links like the arm's, in Khalil's frames, near which what torques do not determine is
            held; balls of 2 kg where they are not known.

    Raises:
        LabError: some base parameter was not identified.
    """
    if not found.identified.all():
        raise LabError("not every base parameter is identified: there is nothing to make physical; move more joints")
    arm = model.arm
    positive = _positive(arm)
    reference = _reference(arm, links)
    scale = found.sigma
    root = np.linalg.inv(np.linalg.cholesky(found.covariance / np.outer(scale, scale))) / scale
    aim = Nearest(model.base.projection, found.values, root)
    standard = BodyCone(arm.bodies(), positive, reference).nearest(aim, reference)
    distance = float(np.linalg.norm(aim.misfit(standard)))
    return PhysicalFit(
        standard, model.base.projection @ standard, distance, float(p_value_of_squares(distance**2, model.base.size))
    )


def _positive(arm: ArmDynamics) -> NDArray[np.int_]:
    """Indices of motor inertias and friction."""
    return np.array([i for i, name in enumerate(arm.names) if name.rstrip("0123456789") in _UNKNOWN], dtype=np.int_)


def _reference(arm: ArmDynamics, links: Array | None) -> Array:
    others = {name: _UNKNOWN[kind] for name in arm.names if (kind := name.rstrip("0123456789")) in _UNKNOWN}
    moment = 0.4 * _BALL_KG * _BALL_M**2
    ball = np.array([_BALL_KG, 0.0, 0.0, 0.0, moment, moment, moment, 0.0, 0.0, 0.0])
    return arm.standard(np.tile(ball, (arm.chain.size, 1)) if links is None else links, others)
