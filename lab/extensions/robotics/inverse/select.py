"""Choose the closed form of a nominal model's inverse; registered as ``lab.inverses``."""

from lab.core.se3 import Array
from lab.extensions.robotics.inverse.first_joints import ThreeJoints
from lab.extensions.robotics.inverse.five_axes import FiveAxes
from lab.extensions.robotics.inverse.planar import PlanarArm, Scara
from lab.extensions.robotics.inverse.six_axes import SphericalWrist, ThreeParallel
from lab.kinematics.inverse.closed_form import ClosedForm
from lab.kinematics.serial.chain import Chain

__all__ = ["chosen_closed_form"]


def chosen_closed_form(chain: Chain, point: Array) -> ClosedForm | None:
    """Return the closed form of a nominal model; None where its shape has none.

    Args:
        point: ``(3,)`` m of the last frame that an arm of two or three joints brings somewhere.
    """
    if chain.size <= 3:
        return ThreeJoints.of(chain, point) or PlanarArm.of(chain, point)
    return SphericalWrist.of(chain) or ThreeParallel.of(chain) or FiveAxes.of(chain) or Scara.of(chain)
