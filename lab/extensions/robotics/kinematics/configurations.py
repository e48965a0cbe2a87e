"""What configuration of an arm some joint positions are of: on which side of each of its singularities it stands."""

import numpy as np

from lab.core.se3 import Array
from lab.kinematics.inverse.closed_form import Determinant

__all__ = ["configurations"]

_ON = 1e-9  # of a factor: smaller is at the singularity itself


def configurations(determinant: Determinant, joints: Array) -> list[dict[str, str]]:
    """Of joint positions ``(n, joints)`` the sign of every factor of det J, by the singularity's name: + or -, or 0.

    An arm changes such a sign only where it passes the singularity (Borrel & Liegeois 1986). A factor that is constant
    is left out.
    """
    factors = [factor for factor in determinant.factors if factor.terms]
    signs = [np.where(np.abs(value := factor.at(joints)) <= _ON, 0, np.sign(value)).astype(int) for factor in factors]
    names = [factor.name for factor in factors]
    return [dict(zip(names, ("0+-"[sign] for sign in row), strict=True)) for row in zip(*signs, strict=True)]
