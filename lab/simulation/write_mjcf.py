"""Bodies put where a Denavit-Hartenberg chain has its axes, and the result as an exact MJCF."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import mujoco

from lab.core import se3
from lab.core.se3 import Array
from lab.formats.description import DescriptionFormat
from lab.formats.link_tree import free_name
from lab.kinematics.serial.arm import SerialArm
from lab.simulation.model import FLANGE, TRACKER, compiled
from lab.simulation.serial_model import SerialModel

__all__ = ["MJCF", "calibrated_mjcf", "set_vectors", "write_in_full"]


def calibrated_mjcf(robot: SerialModel, arm: SerialArm, values: Array) -> str:
    """The identified arm as an MJCF whose sites, in the tracker's frame, are the identified ones to rounding.

    Shells are left out, so that the file stands alone; masses and collision shapes are kept.
    MuJoCo writes six digits, so every number that kinematics uses is written here, in full.
    """
    spec = _without_shells(robot)
    taken = [name for name in (FLANGE, TRACKER) if name in arm.targets]  # a measured point may be called so
    placed = replace(arm, targets=tuple(f"{name} as measured" if name in taken else name for name in arm.targets))
    for target in placed.targets:
        if target not in robot.tool:
            spec.body(robot.carrier).add_site(name=target)
    model = compiled(robot.path, spec)
    robot.place_bodies(model, placed, values)
    robot.place_tracker(model, robot.T_world_frame0 @ se3.inverse(arm.T_tracker_frame0(values)))
    root = ET.fromstring(spec.to_xml())
    write_in_full(root, model)
    names = {name: free_name(name, arm.targets) for name in taken}
    names |= dict(zip(placed.targets, arm.targets, strict=True))
    for site in root.iter("site"):
        if (name := site.get("name")) in names:
            site.set("name", names[name])
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


MJCF: DescriptionFormat[SerialArm, SerialModel] = DescriptionFormat(
    "calibrated.xml", lambda identified: calibrated_mjcf(identified.model, identified.arm, identified.values)
)


def _without_shells(robot: SerialModel) -> mujoco.MjSpec:
    """A copy without meshes; a body whose mass came from one keeps it."""
    spec = robot.spec.copy()
    for geom in [geom for geom in spec.geoms if geom.type == mujoco.mjtGeom.mjGEOM_MESH]:
        body, built = geom.parent, robot.model.body(geom.parent.name)
        if built.mass[0] > 0 and not body.explicitinertial:
            body.explicitinertial, body.mass = True, built.mass[0]
            body.ipos, body.iquat, body.inertia = built.ipos, built.iquat, built.inertia
        spec.delete(geom)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    return spec


def write_in_full(root: ET.Element, model: mujoco.MjModel) -> None:
    """Replace what MuJoCo rounded: places of bodies, joints and sites."""
    world = root.find("worldbody")
    assert world is not None
    for element in world.iter("body"):
        body = model.body(element.get("name", ""))
        set_vectors(element, pos=body.pos, quat=body.quat)
        for joint_element in element.findall("joint"):
            joint = model.joint(joint_element.get("name", ""))
            set_vectors(joint_element, pos=joint.pos, axis=joint.axis)
    for element in world.iter("site"):
        site = model.site(element.get("name", ""))
        set_vectors(element, pos=site.pos, quat=site.quat)


def set_vectors(element: ET.Element, **vectors: Array) -> None:
    """Give an element attributes in full, for whatever they stand in place of."""
    for stale in ("euler", "axisangle", "xyaxes", "zaxis", "fromto"):
        element.attrib.pop(stale, None)
    for name, vector in vectors.items():
        element.set(name, " ".join(repr(float(value)) for value in vector))
