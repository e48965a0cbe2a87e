"""A known load as TOML: ``[load]`` with its mass, its centre of mass in the last frame, and its inertia about that."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.structured import structured
from lab.formats.toml import read_toml
from lab.kinematics.dynamics.rigid_body import is_physical, load_of, symmetric

__all__ = ["read_load"]


@dataclass(frozen=True)
class _LoadSection:
    mass_kg: float
    com_mm: tuple[float, ...]
    inertia_kgcm2: tuple[float, ...]


@dataclass(frozen=True)
class _LoadFile:
    load: _LoadSection


def read_load(path: Path) -> Array:
    """Phi ``(10,)`` of a load about the last frame's origin, as ``rigid_body.LOAD``.

    ``com_mm`` is x y z, ``inertia_kgcm2`` is Ixx Iyy Izz Ixy Ixz Iyz about the centre of mass.

    Raises:
        LabError: the file is missing or malformed, or no body is like that.
    """
    found = structured(path, _LoadFile, read_toml(path)).load
    for name, values, count in (("com_mm", found.com_mm, 3), ("inertia_kgcm2", found.inertia_kgcm2, 6)):
        if len(values) != count or not np.isfinite(values).all():
            raise LabError(f"{path}: [load] {name} is {list(values)}; give {count} finite numbers")
    phi = load_of(found.mass_kg, np.array(found.com_mm) / 1e3, symmetric(np.array(found.inertia_kgcm2) / 1e4))
    if not is_physical(phi):
        raise LabError(f"{path}: [load] no body has this mass and inertia; give mass_kg above zero, and kg cm²")
    return phi
