"""Sections ``[[link]]`` of a robot's TOML: what its elastic links are made of, and where their lines run.

They stand in a robot's table, or in a file whose ``robot`` is another robot's name or file.
"""

from pathlib import Path
from typing import Any

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.robot_toml import LENGTHS, Section
from lab.formats.toml import is_number, read_toml
from lab.kinematics.dynamics.sections import MATERIALS, LinkSections, Material, tube

__all__ = ["described_links", "links_of"]

_KNOWN = (
    "number, material (or young_gpa, shear_gpa) with tube_mm, or ei_nm2 (or ei_y_nm2, ei_z_nm2), gj_nm2, ea_n; path_mm"
)
_MODULI = {"gpa": 1e9}


def described_links(path: Path) -> tuple[str, Any] | None:
    """The robot that a file takes from elsewhere, as it names it, and its ``[[link]]`` sections; None of another file.

    Raises:
        LabError: the file is no TOML, or has more than that.
    """
    content = read_toml(path)
    if "robot" not in content:
        return None
    if unknown := set(content) - {"robot", "link"}:
        raise LabError(f"{path}: unknown key '{sorted(unknown)[0]}'; beside robot there are [[link]] sections alone")
    if not isinstance(content["robot"], str) or not content["robot"]:
        raise LabError(f'{path}: robot is {content["robot"]!r}; give a model\'s name or a file, e.g. "irb120"')
    return content["robot"], content.get("link", [])


def links_of(path: Path, sections: Any, size: int) -> LinkSections:
    """What ``[[link]]`` sections say of an arm with so many links.

    Raises:
        LabError: a link is unknown or named twice, or its section is missing, doubled or impossible.
    """
    if not isinstance(sections, list) or not sections:
        raise LabError(f"{path}: no links; give each elastic link a [[link]] section")
    compliances, paths, said = np.zeros((size, 4)), {}, set()
    for i, content in enumerate(sections):
        section = Section(f"{path}, [[link]] {i + 1}", content)
        number = section.take("number")
        if not isinstance(number, int) or isinstance(number, bool) or not 1 <= number <= size:
            raise LabError(f"{section.where}: number is {number!r}; give a link's, from 1 to {size}")
        if number in said:
            raise LabError(f"{section.where}: link {number} has a section already; keep one")
        said.add(number)
        section.where = f"{path}, link {number}"
        compliances[number - 1] = _compliances(section)
        if (line := _path(section)) is not None:
            paths[number - 1] = line
        section.refuse_the_rest(_KNOWN)
    return LinkSections(compliances, paths)


def _compliances(section: Section) -> Array:
    """``(4,)``, from a tube or from its stiffnesses."""
    given = [section.positive(name, {unit: 1.0}) for name, unit in _STIFFNESSES]
    both, y, z, twist, extension = given
    if "tube_mm" in section.content:
        if not np.isnan(given).all():
            raise LabError(f"{section.where}: tube_mm and stiffnesses are both there; keep one")
        return _tube(section)
    if "material" in section.content or {"young_gpa", "shear_gpa"} & section.unread:
        raise LabError(f"{section.where}: a material without a section; give tube_mm = [outer diameter, wall]")
    if not np.isnan(both) and not np.isnan([y, z]).all():
        raise LabError(f"{section.where}: ei_nm2 is about every axis; leave out ei_y_nm2 and ei_z_nm2, or that")
    bending = [y, z] if np.isnan(both) else [both, both]
    stiffness = np.array([*bending, twist, extension])
    if np.isnan(stiffness).all() and "path_mm" not in section.content:
        raise LabError(f"{section.where}: nothing says how stiff it is; known are {_KNOWN}")
    return np.nan_to_num(1 / stiffness)


_STIFFNESSES = (("ei", "nm2"), ("ei_y", "nm2"), ("ei_z", "nm2"), ("gj", "nm2"), ("ea", "n"))


def _tube(section: Section) -> Array:
    name, size = section.take("material"), section.take("tube_mm")
    moduli = [section.positive(each, _MODULI) for each in ("young", "shear")]
    if name is None:
        if np.isnan(moduli).any():
            raise LabError(f"{section.where}: give a material ({', '.join(MATERIALS)}), or young_gpa and shear_gpa")
        material = Material(*moduli)
    else:
        if not isinstance(name, str) or name not in MATERIALS:
            known = ", ".join(MATERIALS)
            raise LabError(f"{section.where}: material is {name!r}; known are {known}; or give young_gpa and shear_gpa")
        if not np.isnan(moduli).all():
            raise LabError(f"{section.where}: a material and moduli are both there; keep one")
        material = MATERIALS[name]
    if not isinstance(size, list) or len(size) != 2 or not all(is_number(each) and each > 0 for each in size):
        raise LabError(f"{section.where}: tube_mm is {size!r}; give [outer diameter, wall], e.g. [80, 4]")
    outer, wall = (float(each) * LENGTHS["mm"] for each in size)
    if 2 * wall > outer:
        raise LabError(f"{section.where}: tube_mm: a wall of {size[1]:g} mm in a diameter of {size[0]:g}; half at most")
    return tube(outer, wall, material)


def _path(section: Section) -> Array | None:
    """``(k, 3)`` m, if the section has one."""
    line = section.take("path_mm")
    if line is None:
        return None
    points = line if isinstance(line, list) else []
    if len(points) < 2 or not all(isinstance(p, list) and len(p) == 3 and all(map(is_number, p)) for p in points):
        raise LabError(f"{section.where}: path_mm is to be a list of two or more points [x, y, z]")
    return np.array(points, dtype=np.float64) * LENGTHS["mm"]
