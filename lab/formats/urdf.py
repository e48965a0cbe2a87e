"""A calibrated arm as URDF, which most robot software reads."""

import xml.etree.ElementTree as ET

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.formats.description import IdentifiedRobot
from lab.formats.link_tree import Link, free_name, last_axis_frame, link_tree
from lab.formats.ur_calibration import ur_frames
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.chain import Chain

__all__ = ["identified_urdf"]

_PLACEHOLDER_KG = 1e-3
_GYRATION_M = 0.05
_ABOUT = """\
The identified geometry alone: no sag, no backlash, no shapes.
The root link is the frame in which the arm was measured. Lengths in m, angles in rad.
A velocity or an effort of 0 is one that is not known.
"""


def identified_urdf(identified: IdentifiedRobot[SerialArm, object]) -> str:
    """The identified arm as links and joints, to the last digit.

    Joints have the chain's names. Links are those of ``formats.link_tree``: the instrument's frame, the
    table's frame 0, one a joint, the table's last frame, and one a target; of an arm of Universal Robots also tool0, as
    ``ur_kinematics.yaml`` has it.
    """
    chain, loads = identified.arm.chain, identified.loads
    root = ET.Element("robot", name=identified.name)
    ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", fusestatic="false")  # MuJoCo keeps fixed links
    for link in [*link_tree(identified.arm, identified.values).links, *_tool0(identified)]:
        element = ET.SubElement(root, "link", name=link.name)
        if link.joint is not None:
            _add_mass(element, *_mass_and_centre(loads, link))
        if link.parent is not None:
            _add_joint(root, chain, link, link.parent)
    ET.indent(root)
    head = f'<?xml version="1.0"?>\n<!--\n{_ABOUT}{_masses_note(loads)}\n-->\n'
    return head + ET.tostring(root, encoding="unicode") + "\n"


def _tool0(identified: IdentifiedRobot[SerialArm, object]) -> list[Link]:
    """Tool0 of an arm of Universal Robots, fixed to the last link; none of another arm."""
    arm, values = identified.arm, identified.values
    found, tree = ur_frames(arm, values), link_tree(arm, values)
    name = free_name("tool0", [link.name for link in tree.links])
    if found is None:
        return []
    T_instrument_last = arm.T_tracker_frame0(values) @ last_axis_frame(arm, values)
    T_last_tool0 = se3.inverse(T_instrument_last) @ found.T_instrument_base @ found.joints[-1]
    return [Link(name, tree.moving[-1].name, T_last_tool0, np.eye(4))]


def _add_mass(element: ET.Element, mass_kg: float, centre: Array) -> None:
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "origin", xyz=_numbers(centre), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=repr(mass_kg))
    moment = repr(_placeholder_inertia(mass_kg))
    ET.SubElement(inertial, "inertia", ixx=moment, iyy=moment, izz=moment, ixy="0", ixz="0", iyz="0")


def _add_joint(root: ET.Element, chain: Chain, link: Link, parent: str) -> None:
    """The joint that moves the link, or fixes it to its parent."""
    i = link.joint
    kind = "fixed" if i is None else "prismatic" if chain.prismatic[i] else "revolute"
    name = free_name(f"{link.name}_fixed", chain.joint_names) if i is None else chain.joint_names[i]
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=link.name)
    T = link.T_parent_link
    ET.SubElement(joint, "origin", xyz=_numbers(T[:3, 3]), rpy=_numbers(se3.roll_pitch_yaw(T[:3, :3])))
    if i is None:
        return
    ET.SubElement(joint, "axis", xyz=_numbers(np.array([0.0, 0.0, link.sign])))
    lower, upper, speed = (repr(float(value[i])) for value in (chain.lower, chain.upper, np.nan_to_num(chain.speed)))
    ET.SubElement(joint, "limit", lower=lower, upper=upper, effort="0", velocity=speed)


def _mass_and_centre(loads: Loads | None, link: Link) -> tuple[float, Array]:
    """Mass (kg) and its centre ``(3,)`` (m) in the frame of a moving link: the nominal model's, or a placeholder."""
    assert link.joint is not None
    mass = 0.0 if loads is None else float(loads.mass_kg[link.joint])
    if loads is None or mass <= 0:
        return _PLACEHOLDER_KG, np.zeros(3)
    return mass, se3.transform(link.T_link_frame, loads.centre_m[link.joint][None])[0]


def _placeholder_inertia(mass_kg: float) -> float:
    """A moment of inertia (kg m^2) about every axis, for readers that refuse a moving link without one."""
    return mass_kg * _GYRATION_M**2


def _masses_note(loads: Loads | None) -> str:
    """What of the masses is known, for a comment in the file."""
    if loads is None:
        return "Masses and inertias are placeholders: the robot's are not known."
    return "Masses and their centres are the nominal model's (1 g where it has none); inertias are placeholders."


def _numbers(vector: Array) -> str:
    """Every digit of a vector, with spaces between; zero without a sign."""
    return " ".join(repr(float(value) + 0.0) for value in vector)
