"""Whether a nominal model's inverse has a closed form, and which: the arms that ``closed_forms`` knows."""

from lab.kinematics.inverse.analytic.protocol import ClosedForm, Solutions
from lab.kinematics.inverse.analytic.scara import Scara
from lab.kinematics.inverse.analytic.spherical_wrist import SphericalWrist
from lab.kinematics.inverse.analytic.three_parallel import ThreeParallel
from lab.kinematics.serial.chain import Chain

__all__ = ["ClosedForm", "Solutions", "closed_form_of"]


def closed_form_of(chain: Chain) -> ClosedForm | None:
    """The closed form of a nominal model; None where its shape has none that is known here."""
    return SphericalWrist.of(chain) or ThreeParallel.of(chain) or Scara.of(chain)
