"""A calibrated arm that was given as a table as MJCF; one with a model keeps its bodies (``virtual.placement``)."""

import xml.etree.ElementTree as ET

import numpy as np

from lab import frames
from lab.frames import Array
from lab.geometry.links import Link, free_name, link_tree
from lab.geometry.serial import SerialArm
from lab.output.link_mass import mass_and_centre, masses_note, numbers, placeholder_inertia
from lab.study.robots import Robot


def table_mjcf(robot: Robot, arm: SerialArm, values: Array) -> str:
    """Bodies on the axes of the arm with parameters ``values`` ``(p,)``, to the last digit.

    The world is the instrument's frame, where site ``tracker`` is; the last body has the sites
    ``flange`` (the table's last frame) and the targets'.
    """
    tree = link_tree(arm, values)
    root = ET.Element("mujoco", model=robot.name)
    root.append(
        ET.Comment(f" The identified geometry alone; the world is the instrument's frame. {masses_note(robot)} ")
    )
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    world = ET.SubElement(root, "worldbody")
    ET.SubElement(world, "site", name=free_name("tracker", (*arm.targets, tree.flange.name)))
    body = _add(world, "body", tree.base.name, tree.base.T_parent_link)
    for link in tree.moving:
        body = _add(body, "body", link.name, link.T_parent_link)
        _add_joint(body, robot, arm, link)
    T_body_flange = tree.flange.T_parent_link
    _add(body, "site", tree.flange.name, T_body_flange)
    for target in tree.targets:
        _add(body, "site", target.name, T_body_flange @ target.T_parent_link)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _add(parent: ET.Element, kind: str, name: str, T_parent_child: Array) -> ET.Element:
    """A body or site at a pose ``(4, 4)`` in its parent's frame."""
    quaternion = frames.quaternion_from_rotation(T_parent_child[:3, :3])
    return ET.SubElement(parent, kind, name=name, pos=numbers(T_parent_child[:3, 3]), quat=numbers(quaternion))


def _add_joint(body: ET.Element, robot: Robot, arm: SerialArm, link: Link) -> None:
    """What moves a body, and the mass without which it may not move."""
    assert link.joint is not None
    i, chain = link.joint, arm.chain
    mass, centre = mass_and_centre(robot, link)
    moments = numbers(np.full(3, placeholder_inertia(mass)))
    ET.SubElement(body, "inertial", pos=numbers(centre), mass=repr(mass), diaginertia=moments)
    limits = numbers(np.array([chain.lower[i], chain.upper[i]]))
    kind, axis = "slide" if chain.prismatic[i] else "hinge", numbers(np.array([0.0, 0.0, link.sign]))
    ET.SubElement(body, "joint", name=chain.joint_names[i], type=kind, axis=axis, range=limits)
