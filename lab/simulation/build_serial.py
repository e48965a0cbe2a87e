"""A robot's MuJoCo model from its Denavit-Hartenberg table: bodies on the axes, with rods for links."""

from pathlib import Path

import mujoco
import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.formats.link_tree import link_tree
from lab.formats.robot_toml import RobotTable
from lab.kinematics.serial.arm import DEFAULT_TOOL, SerialArm
from lab.simulation.meshes import dress, reach_of
from lab.simulation.model import FLANGE, TRACKER, SerialModel, add_targets, add_tracker, compiled

__all__ = ["table_model"]

_SMALL_M = 1.0  # reach of an arm beside which the tracker stands at its usual place
_PEDESTAL_M = 0.1  # of a floor-standing arm's reach, the radius of what carries it


def table_model(path: Path, table: RobotTable) -> SerialModel:
    """The arm of a table on the floor, where the table says how high it stands; else in the air."""
    chain = table.chain
    named = {name: place for name, place in table.tool.items() if name not in (FLANGE, TRACKER)}
    tool = named or {name: np.array(place) for name, place in DEFAULT_TOOL.items()}
    arm = SerialArm(chain, tuple(tool))
    tree = link_tree(arm, arm.nominal(tool))
    spec = mujoco.MjSpec()
    spec.compiler.autolimits, spec.compiler.degree = True, False
    T_world_frame0 = table.T_world_frame0
    if T_world_frame0 is None:
        T_world_frame0 = se3.pose(np.eye(3), np.array([0.0, 0.0, table.height_m or 0.0]))
    reach = reach_of(chain)
    body = base = _add_body(spec.worldbody, tree.base.name, T_world_frame0)
    if table.height_m is not None:
        _add_pedestal(spec, base, table.height_m, _PEDESTAL_M * reach)
    bodies = []
    for link in tree.moving:
        assert link.joint is not None
        i, slides = link.joint, chain.prismatic[link.joint]
        body = _add_body(body, link.name, link.T_parent_link)
        bodies.append(link.name)
        body.add_joint(
            name=chain.joint_names[i],
            type=mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE,
            axis=[0.0, 0.0, link.sign],
            range=[chain.lower[i], chain.upper[i]],
            **({} if np.isnan(table.torque[i]) else {"actfrcrange": [-table.torque[i], table.torque[i]]}),
        )
    hand = _add_body(body, tree.flange.name, tree.flange.T_parent_link)
    hand.add_site(name=FLANGE)
    add_targets(hand, np.eye(4), tool)
    add_tracker(spec, max(1.0, reach / _SMALL_M))
    weighted = dress(path, spec, chain, T_world_frame0, bodies, tool, table.mass_kg)
    model = compiled(path, spec)
    return SerialModel(
        path=path, spec=spec, model=model, chain=chain, T_world_frame0=T_world_frame0, bodies=tuple(bodies),
        base_body=tree.base.name, tool=tool, shapes_assumed=True, masses_assumed=weighted,
        links=table.links,
    )  # fmt: skip


def _add_body(parent: mujoco.MjsBody, name: str, T_parent_body: Array) -> mujoco.MjsBody:
    quat = se3.quaternion_from_rotation(T_parent_body[:3, :3])
    return parent.add_body(name=name, pos=T_parent_body[:3, 3], quat=quat)


def _add_pedestal(spec: mujoco.MjSpec, base: mujoco.MjsBody, height_m: float, radius_m: float) -> None:
    """A floor, and a column on it up to frame 0."""
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05])
    if height_m > 0:
        base.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[radius_m, height_m / 2, 0],
            pos=[0, 0, -height_m / 2],
            rgba=[0.58, 0.60, 0.64, 1],
            mass=0,
        )
