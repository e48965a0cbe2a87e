"""Whether a drawing's inverse has a closed form, and which: the arms that ``closed_forms`` knows."""

from lab.geometry.chain import Chain
from lab.geometry.closed_forms.form import ClosedForm, Solutions
from lab.geometry.closed_forms.scara import Scara
from lab.geometry.closed_forms.spherical_wrist import SphericalWrist

__all__ = ["ClosedForm", "Solutions", "closed_form_of"]


def closed_form_of(chain: Chain) -> ClosedForm | None:
    """The closed form of a drawing; None where its shape has none that is known here."""
    return SphericalWrist.of(chain) or Scara.of(chain)
