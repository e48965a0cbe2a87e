"""Bodies put where a Denavit-Hartenberg chain has its axes, and the result as an exact MJCF."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import mujoco
import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.formats.description import DescriptionFormat
from lab.formats.link_tree import free_name
from lab.kinematics.serial.arm import SerialArm
from lab.simulation.model import FLANGE, TRACKER, RobotModel, SerialModel, at_zero, body_pose, last_frame


def place_bodies(model: mujoco.MjModel, robot: SerialModel, arm: SerialArm, values: Array) -> None:
    """Move the model's bodies and target sites so that it has the chain's axes and targets.

    Each jointed body turns by the smallest rotation that aligns its axis and shifts across it;
    a body without a joint stays where it is on the one that carries it. ``values``' base is
    not used: frame 0 stands where the model has it.
    """
    still = values.copy()
    still[:6] = 0.0
    data = at_zero(robot.model)
    moved = _moved_poses(robot, arm, still, data)
    T_world_last = robot.T_world_frame0 @ arm.flange(np.zeros((1, arm.chain.size)), still)[0]
    carrier = robot.carrier
    if carrier not in robot.bodies:
        nominal_last = last_frame(robot.chain, robot.T_world_frame0)
        body = model.body(carrier).id
        moved[body] = T_world_last @ se3.inverse(nominal_last) @ body_pose(data, body)
    for name in dict.fromkeys([*robot.bodies, carrier]):
        body = model.body(name).id
        local = se3.inverse(moved[int(model.body_parentid[body])]) @ moved[body]
        model.body_pos[body], model.body_quat[body] = local[:3, 3], se3.quaternion_from_rotation(local[:3, :3])
    targets = arm.split(still)[2]
    sites = {model.site(i).name: i for i in range(model.nsite)}
    for target, point in zip(arm.targets, targets, strict=True):
        if target not in sites:  # a measured target that the model does not have
            continue
        site = sites[target]
        T_body_last = se3.inverse(moved[int(model.site_bodyid[site])]) @ T_world_last
        model.site_pos[site] = se3.transform(T_body_last, point[None])[0]


def _moved_poses(robot: SerialModel, arm: SerialArm, values: Array, data: mujoco.MjData) -> list[Array]:
    """World poses of all bodies, at zero readings, with the chain's axes."""
    model, T = robot.model, robot.T_world_frame0
    poses: list[Array] = [np.eye(4)]
    motions = {motion.joint: motion for motion in arm.motions(values) if motion.joint is not None}
    for body in range(1, model.nbody):
        nominal = body_pose(data, body)
        parent = int(model.body_parentid[body])
        name = model.body(body).name
        if name not in robot.bodies:
            poses.append(poses[parent] @ se3.inverse(body_pose(data, parent)) @ nominal)
            continue
        motion = motions[robot.bodies.index(name)]
        joint = int(model.body(body).jntadr[0])
        axis = T[:3, :3] @ motion.axis[:3, 0] * arm.chain.sign[robot.bodies.index(name)]
        turn = se3.rotation_between(data.xaxis[joint], axis)
        anchor = data.xanchor[joint]
        moved_anchor = anchor
        if motion.origin is not None:
            origin = se3.transform(T, motion.origin[:3].T)[0]
            moved_anchor = origin + axis * np.dot(anchor - origin, axis)
        poses.append(se3.pose(turn @ nominal[:3, :3], moved_anchor + turn @ (nominal[:3, 3] - anchor)))
    return poses


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
    model = spec.compile()
    place_bodies(model, robot, placed, values)
    place_tracker(model, robot, robot.T_world_frame0 @ se3.inverse(arm.T_tracker_frame0(values)))
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


def place_tracker(model: mujoco.MjModel, robot: RobotModel, T_world_tracker: Array) -> None:
    """Move the body that carries the tracker's site, which stands in the world, so that the site gets there."""
    body = int(model.site(TRACKER).bodyid[0])
    if not body:
        return
    T_body_site = se3.inverse(body_pose(at_zero(robot.model), body)) @ robot.T_world_tracker
    stand = T_world_tracker @ se3.inverse(T_body_site)
    model.body_pos[body], model.body_quat[body] = stand[:3, 3], se3.quaternion_from_rotation(stand[:3, :3])


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
