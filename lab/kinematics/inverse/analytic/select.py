"""Whether a nominal model's inverse has a closed form, and which: the arms that ``closed_forms`` knows."""

import numpy as np

from lab.core.se3 import Array
from lab.kinematics.inverse.analytic.five_axes import FiveAxes
from lab.kinematics.inverse.analytic.planar import PlanarArm
from lab.kinematics.inverse.analytic.protocol import ClosedForm, Solutions
from lab.kinematics.inverse.analytic.scara import Scara
from lab.kinematics.inverse.analytic.spherical_wrist import SphericalWrist
from lab.kinematics.inverse.analytic.three_joints import ThreeJoints
from lab.kinematics.inverse.analytic.three_parallel import ThreeParallel
from lab.kinematics.serial.chain import Chain

__all__ = ["ClosedForm", "Solutions", "closed_form_of"]


def closed_form_of(chain: Chain, point: Array | None = None) -> ClosedForm | None:
    """The closed form of a nominal model; None where its shape has none that is known here.

    Args:
        point: ``(3,)`` m of the last frame that an arm of two or three joints brings somewhere; by default its origin.
    """
    place = np.zeros(3) if point is None else point
    if chain.size <= 3:
        return ThreeJoints.of(chain, place) or PlanarArm.of(chain, place)
    return SphericalWrist.of(chain) or ThreeParallel.of(chain) or FiveAxes.of(chain) or Scara.of(chain)
