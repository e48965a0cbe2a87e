"""The MuJoCo model of a serial arm: where its bodies are put for other parameters, and how far they move."""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.dynamics.sections import LinkSections
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.chain import Chain
from lab.simulation.model import RobotModel, at_zero, body_pose, coordinates, flange_body

__all__ = ["SerialModel", "last_frame"]


@dataclass(frozen=True, kw_only=True)
class SerialModel(RobotModel):
    """A serial arm.

    Attributes:
        chain: its distal Denavit-Hartenberg table.
        bodies: the jointed bodies, base outward.
        links: what its description says of elastic links; None where it says nothing.
    """

    chain: Chain
    bodies: tuple[str, ...]
    links: LinkSections | None = None

    @property
    def carrier(self) -> str:
        """The body that carries the flange's site, else the last jointed one."""
        return flange_body(self.model, self.bodies)

    def qpos(self, joints: Array) -> Array:
        """A joint's coordinate is its position; all others are zero."""
        return coordinates(self.model, self.chain.joint_names, joints)

    def travel_per_joint(self) -> Array:
        """From the balls about each body's origin, around it and all that it carries."""
        model = self.model
        touching = (model.geom_contype | model.geom_conaffinity) != 0
        joints = [model.joint(name) for name in self.chain.joint_names]
        travel = np.zeros(model.nbody)
        for joint, slides in zip(joints, self.chain.prismatic, strict=True):
            far = np.abs(joint.range).max() if slides else 2 * np.linalg.norm(joint.pos)
            travel[joint.bodyid[0]] = far
        ball = np.zeros(model.nbody)  # about each body's origin, around it and all that it carries
        for geom in np.flatnonzero(touching):
            body = model.geom_bodyid[geom]
            ball[body] = max(ball[body], np.linalg.norm(model.geom_pos[geom]) + model.geom_rbound[geom])
        for body in range(model.nbody - 1, 0, -1):  # MuJoCo numbers parents before children
            parent = model.body_parentid[body]
            ball[parent] = max(ball[parent], np.linalg.norm(model.body_pos[body]) + travel[body] + ball[body])
        moved = [ball[joint.bodyid[0]] + np.linalg.norm(joint.pos) for joint in joints]
        return np.where(self.chain.prismatic, 1.0, moved)

    def with_parameters(self, targets: tuple[str, ...], values: Array, joints: Array) -> tuple[mujoco.MjModel, Array]:
        """A copy with its bodies moved onto the joint axes that the parameters say."""
        model = copy.deepcopy(self.model)
        self.place_bodies(model, SerialArm(self.chain, targets), values)
        return model, self.qpos(joints)

    def place_bodies(self, model: mujoco.MjModel, arm: SerialArm, values: Array) -> None:
        """Move the bodies and target sites of a copy of the model so that it has the chain's axes and targets.

        Each jointed body turns by the smallest rotation that aligns its axis and shifts across it;
        a body without a joint stays where it is on the one that carries it. ``values``' base is
        not used: frame 0 stands where the model has it.
        """
        moved = self.moved_bodies(arm, values)
        carrier = self.carrier
        still = _without_base(values)
        T_world_last = self.T_world_frame0 @ arm.flange(np.zeros((1, arm.chain.size)), still)[0]
        for name in dict.fromkeys([*self.bodies, carrier]):
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

    def moved_bodies(self, arm: SerialArm, values: Array) -> list[Array]:
        """Poses ``(4, 4)`` (m) of all bodies in the world, joint positions zero, as ``place_bodies`` puts them."""
        still, data = _without_base(values), at_zero(self.model)
        moved = self._moved_poses(arm, still, data)
        if self.carrier not in self.bodies:
            T_world_last = self.T_world_frame0 @ arm.flange(np.zeros((1, arm.chain.size)), still)[0]
            body = self.model.body(self.carrier).id
            moved[body] = (
                T_world_last @ se3.inverse(last_frame(self.chain, self.T_world_frame0)) @ body_pose(data, body)
            )
        return moved

    def _moved_poses(self, arm: SerialArm, values: Array, data: mujoco.MjData) -> list[Array]:
        """World poses of all bodies, at joint positions zero, with the chain's axes."""
        model, T = self.model, self.T_world_frame0
        poses: list[Array] = [np.eye(4)]
        motions = {motion.joint: motion for motion in arm.motions(values) if motion.joint is not None}
        for body in range(1, model.nbody):
            nominal = body_pose(data, body)
            parent = int(model.body_parentid[body])
            name = model.body(body).name
            if name not in self.bodies:
                poses.append(poses[parent] @ se3.inverse(body_pose(data, parent)) @ nominal)
                continue
            motion = motions[self.bodies.index(name)]
            joint = int(model.body(body).jntadr[0])
            axis = T[:3, :3] @ motion.axis[:3, 0] * arm.chain.sign[self.bodies.index(name)]
            turn = se3.rotation_between(data.xaxis[joint], axis)
            anchor = data.xanchor[joint]
            moved_anchor = anchor
            if motion.origin is not None:
                origin = se3.transform(T, motion.origin[:3].T)[0]
                moved_anchor = origin + axis * np.dot(anchor - origin, axis)
            poses.append(se3.pose(turn @ nominal[:3, :3], moved_anchor + turn @ (nominal[:3, 3] - anchor)))
        return poses


def _without_base(values: Array) -> Array:
    """Parameters with the base at the origin: frame 0 stands where the model has it."""
    still = values.copy()
    still[:6] = 0.0
    return still


def last_frame(chain: Chain, T_world_frame0: Array) -> Array:
    """Pose ``(4, 4)`` of the table's last frame in the world, joint positions zero."""
    arm = SerialArm(chain)
    pose: Array = T_world_frame0 @ arm.flange(np.zeros((1, chain.size)), arm.nominal())[0]
    return pose
