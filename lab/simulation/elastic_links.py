"""Compute the deflection of an arm under its loads: joints like springs, links like beams.

A joint driven to q settles at ``q' = q - c tau(q')``, with its compliance c and MuJoCo's torque tau that holds the arm
at q' (``mj_rne``; in motion the torque that moves it). The far end of an elastic link is displaced by its torsor
(``kinematics.dynamics.beam``): between its end and the body there is ``T_flex = Rot Trans`` (Benmisra 2007, eq. 3.34),
under the force of the body on it that MuJoCo computes (``cfrc_int``). Loads are those of the deflected arm: a fixed
point. Motion is quasi-static: inertia loads the rigid motion, and nothing vibrates.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.dynamics.beam import COMPLIANCES, Beam, loads_on
from lab.kinematics.dynamics.gravity import link_loads
from lab.simulation.load_model import bodies_of_links, loads_of
from lab.simulation.robot_model import SerialModel, at_zero, body_pose, last_frame

__all__ = ["AT_REST", "FlexibleArm", "JointMotion", "along_the_line"]

_STILL = 1e-13  # rad or m; smaller steps change the loads within rounding
_MAX_STEPS = 100


@dataclass(frozen=True)
class JointMotion:
    """Joint speeds and accelerations ``(m, n)`` at m poses; None at rest."""

    speeds: Array | None = None
    accelerations: Array | None = None


AT_REST = JointMotion()


@dataclass(frozen=True)
class _Deflection:
    """Deflected configuration of an arm at each of m poses.

    Attributes:
        joints: ``(m, n)``, rad or m.
        torsors: ``(m, n, 6)`` m and rad, displacements of the links' far ends, in the links' axes.
    """

    joints: Array
    torsors: Array


class FlexibleArm:
    """A copy of an arm's model with a payload and elastic links."""

    def __init__(
        self,
        model: mujoco.MjModel,
        robot: SerialModel,
        payload_at_m: Array | None = None,
        sections: Array | None = None,
    ) -> None:
        """Copy a model of a robot, its bodies perturbed or not.

        Args:
            payload_at_m: ``(3,)`` m, payloads' centre in the last frame; at its origin if not given.
            sections: ``(n, 4)`` each link's compliances (``beam.COMPLIANCES``); all links are stiff if not given. The
                mass of an elastic link is spread along its line.

        Raises:
            LabError: an elastic link has no length.
        """
        self._model = copy.deepcopy(model)
        self._data = mujoco.MjData(self._model)
        joints = [model.joint(name) for name in robot.chain.joint_names]
        self._qpos, self._dof = [int(j.qposadr[0]) for j in joints], [int(j.dofadr[0]) for j in joints]
        self._bodies = [int(model.body(name).id) for name in robot.bodies]
        stiff = np.zeros((len(joints), len(COMPLIANCES)))
        self._links = _Links.of(self._model, robot, self._bodies, stiff if sections is None else sections)
        if self._links.beams:
            along_the_line(self._model, robot, tuple(self._links.beams))
        self._payload = _Payload.carried_by(self._model, robot, np.zeros(3) if payload_at_m is None else payload_at_m)

    def straight(self, joints: Array) -> _Deflection:
        """Return the arm at joints ``(m, n)``, no link bent."""
        return _Deflection(joints, np.zeros((*joints.shape, 6)))

    def settled(
        self,
        driven: Array,
        compliance: Array,
        payload_kg: Array,
        motion: JointMotion = AT_REST,
        cubic: Array | float = 0.0,
    ) -> _Deflection:
        """Solve the arm's equilibrium under its weight and a payload, and in motion under their inertia.

        The method is a fixed point, not Newton's: MuJoCo computes the loads of the bent arm without derivatives.

        Args:
            driven: ``(m, n)``, joint positions set by the motors, rad or m.
            compliance: ``(n,)`` rad/Nm (m/N for a slide), of the joints.
            payload_kg: ``(m,)``.
            motion: of the driven joints.
            cubic: ``(n,)`` rad/(Nm)^3 (m/N^3), the joints' compliance to the cube of their torque.

        Raises:
            LabError: no equilibrium is found, as the arm is too soft.
        """
        deflected, last = self.straight(driven), np.zeros((*driven.shape, 7))
        for _ in range(_MAX_STEPS):
            torques, loads = self.loads(deflected, payload_kg, motion)
            sag, torsors = compliance * torques + cubic * torques**3, self._links.torsors(loads)
            deflected = _Deflection(driven - sag, torsors)
            flexed = np.concatenate([sag[..., None], torsors], axis=2)
            if np.abs(flexed - last).max(initial=0.0) <= _STILL:
                return deflected
            last = flexed
        raise LabError(
            f"no equilibrium under the load in {_MAX_STEPS} steps: the arm is too soft; lower its compliances"
        )

    def loads(self, deflected: _Deflection, payload_kg: Array, motion: JointMotion = AT_REST) -> tuple[Array, Array]:
        """Return torques ``(m, n)`` Nm (N for a slide) that hold the arm, and loads ``(m, n, 18)`` on its links.

        The loads are those of ``beam.loads_on``; on links that do not bend they are zero.
        """
        m, n = deflected.joints.shape
        torques, loads = np.empty((m, n)), np.zeros((m, n, 18))
        model, data, held = self._model, self._data, np.empty(self._model.nv)
        placed = self._links.placed(deflected.torsors)
        data.qvel[:], data.qacc[:] = 0.0, 0.0
        for i in range(m):
            self._payload.hang(model, payload_kg[i])
            if motion.speeds is not None and motion.accelerations is not None:
                data.qvel[self._dof], data.qacc[self._dof] = motion.speeds[i], motion.accelerations[i]
            self._kinematics(deflected.joints[i], placed[i])
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            mujoco.mj_rne(model, data, 1, held)
            torques[i] = held[self._dof]
            if self._links.beams:
                mujoco.mj_rnePostConstraint(model, data)
                for link in self._links.beams:
                    loads[i, link] = self._on_link(link, payload_kg[i])
        return torques, loads

    def positions(self, deflected: _Deflection, sites: Sequence[int]) -> Array:
        """Return world positions ``(m, k, 3)`` m of the sites."""
        world = np.empty((len(deflected.joints), len(sites), 3))
        placed, last = self._links.placed(deflected.torsors), len(self._bodies) - 1
        for i in range(len(world)):
            self._kinematics(deflected.joints[i], placed[i])
            world[i] = self._data.site_xpos[sites]
            if last in self._links.beams:  # without a next body to be moved
                T_world_end = self._links.T_world_end(self._data, last)
                local = se3.transform(se3.inverse(T_world_end), world[i])
                world[i] = se3.transform(T_world_end @ _flexed(deflected.torsors[i, last]), local)
        return world

    def _kinematics(self, joints: Array, placed: Array) -> None:
        self._data.qpos[self._qpos] = joints
        for link in self._links.beams:
            if link + 1 < len(self._bodies):
                body = self._bodies[link + 1]
                self._model.body_pos[body] = placed[link, :3, 3]
                self._model.body_quat[body] = se3.quaternion_from_rotation(placed[link, :3, :3])
        mujoco.mj_kinematics(self._model, self._data)

    def _on_link(self, link: int, payload_kg: float) -> Array:
        """Return the loads ``(18,)`` on one link, after MuJoCo's inverse dynamics."""
        data, body = self._data, self._bodies[link]
        T_world_end = self._links.T_world_end(data, link)
        rotation, far = T_world_end[:3, :3], T_world_end[:3, 3]
        acceleration = np.empty(6)  # of the body's origin, gravity in it as in an accelerometer's
        mujoco.mj_objectAcceleration(self._model, data, mujoco.mjtObj.mjOBJ_XBODY, body, acceleration, 0)
        omega = se3.skew(data.cvel[body, :3])
        change = -(se3.skew(acceleration[:3]) + omega @ omega)
        near = far - rotation @ self._links.ends[link]
        pull = -acceleration[3:] + change @ (near - data.xpos[body])
        if link + 1 < len(self._bodies):
            next_body = self._bodies[link + 1]
            force, moment = -data.cfrc_int[next_body, 3:], -data.cfrc_int[next_body, :3]
            about = data.subtree_com[self._model.body_rootid[next_body]]
        else:
            about = self._payload.position(data)
            force, moment = payload_kg * (pull + change @ (about - near)), np.zeros(3)
        moment = moment + np.cross(about - far, force)
        return loads_on(rotation.T @ force, rotation.T @ moment, rotation.T @ pull, rotation.T @ change @ rotation)


@dataclass(frozen=True)
class _Links:
    """The elastic links of an arm's model.

    Attributes:
        beams: by link, from 0.
        sections: ``(n, 4)`` compliances.
        ends: ``(n, 3)`` m, each link's far end in its axes.
        carriers: the body that carries each link's far end.
        T_carrier_end: ``(n, 4, 4)``, the far end with the link's axes in that body.
        T_end_next: ``(n, 4, 4)``, the next jointed body in that, without loads; identity for the last link.
    """

    beams: dict[int, Beam]
    sections: Array
    ends: Array
    carriers: list[int]
    T_carrier_end: Array
    T_end_next: Array

    @classmethod
    def of(cls, model: mujoco.MjModel, robot: SerialModel, bodies: list[int], sections: Array) -> "_Links":
        """Return the nominal links between the bodies of a model."""
        arm_loads, size = link_loads(loads_of(robot)), robot.chain.size
        elastic = [int(link) for link in np.flatnonzero(sections.any(axis=1))]
        if missing := [link for link in elastic if link not in arm_loads.beams]:
            raise LabError(
                f"robot {robot.chain.name}: link {missing[0] + 1} has no length, so it is stiff; set it stiff"
            )
        data, placed = at_zero(robot.model), arm_loads.loads.frames(np.zeros((1, size)))
        carriers = [int(model.body_parentid[body]) for body in bodies[1:]] + [bodies[-1]]
        ends, nexts = np.tile(np.eye(4), (size, 1, 1)), np.tile(np.eye(4), (size, 1, 1))
        for link in elastic:
            far = placed.end[0] if link == size - 1 else placed.anchors[0, link + 1]
            T_world_end = robot.T_world_frame0 @ se3.pose(placed.rotations[0, link], far)
            ends[link] = se3.inverse(body_pose(data, carriers[link])) @ T_world_end
            if link + 1 < size:
                body = bodies[link + 1]
                turned = se3.rotation_from_quaternion(model.body_quat[body])
                nexts[link] = se3.inverse(ends[link]) @ se3.pose(turned, model.body_pos[body])
        return cls({link: arm_loads.beams[link] for link in elastic}, sections, arm_loads.ends, carriers, ends, nexts)

    def torsors(self, loads: Array) -> Array:
        """Return torsors ``(m, n, 6)`` under loads ``(m, n, 18)``."""
        deformations = np.zeros((*loads.shape[:2], 6))
        for link, beam in self.beams.items():
            deformations[:, link] = beam.torsor(loads[:, link], self.sections[link])
        return deformations

    def placed(self, torsors: Array) -> Array:
        """Return poses ``(m, n, 4, 4)`` of the next jointed bodies in those that carry them."""
        found: Array = self.T_carrier_end @ _flexed(torsors) @ self.T_end_next
        return found

    def T_world_end(self, data: mujoco.MjData, link: int) -> Array:
        """Return pose ``(4, 4)`` of a link's far end, before it is displaced."""
        pose: Array = body_pose(data, self.carriers[link]) @ self.T_carrier_end[link]
        return pose


def _flexed(torsors: Array) -> Array:
    """Return T_flex = Rot Trans ``(..., 4, 4)`` of torsors (Benmisra 2007, eq. 3.34, with exact rotations)."""
    turned = se3.exp(torsors[..., 3:])
    return se3.pose(turned, (turned @ torsors[..., :3, None])[..., 0])


def along_the_line(model: mujoco.MjModel, robot: SerialModel, links: Sequence[int]) -> None:
    """Spread the mass of some links (from 0) of a copy of a robot's model, with welded bodies, along their lines.

    A link's mass and its centre stay, its inertia is that of the line's mass.
    """
    found, bodies = link_loads(loads_of(robot)), bodies_of_links(robot)
    data, placed = at_zero(robot.model), found.loads.frames(np.zeros((1, robot.chain.size)))
    for link in links:
        body, beam = bodies[link][0], found.beams[link]
        T_body_world = se3.inverse(body_pose(data, body))
        rotation = T_body_world[:3, :3] @ robot.T_world_frame0[:3, :3] @ placed.rotations[0, link]
        inertia = np.trace(beam.second_moment) * np.eye(3) - beam.second_moment
        principal, axes = np.linalg.eigh(rotation @ inertia @ rotation.T)
        axes[:, 0] *= np.linalg.det(axes)
        for welded in bodies[link][1:]:
            model.body_mass[welded], model.body_inertia[welded], model.body_subtreemass[welded] = 0.0, 0.0, 0.0
        model.body_mass[body], model.body_inertia[body] = beam.mass_kg, np.maximum(principal, 0.0)
        model.body_iquat[body] = se3.quaternion_from_rotation(axes)
        model.body_ipos[body] = se3.transform(T_body_world @ robot.T_world_frame0, placed.centres[:, link])[0]
        model.body_sameframe[body] = int(mujoco.mjtSameFrame.mjSAMEFRAME_NONE)


@dataclass(frozen=True)
class _Payload:
    """The body that carries a payload, with its mass properties without one.

    Attributes:
        line: this body, then its carriers, to the world.
        place: ``(3,)`` m, of the payload in the body's frame.
        mass, centre: the body's own, kg and ``(3,)`` m.
        subtree: masses of the line with all beyond, kg.
    """

    line: list[int]
    place: Array
    mass: float
    centre: Array
    subtree: Array

    @classmethod
    def carried_by(cls, model: mujoco.MjModel, robot: SerialModel, payload_at_m: Array) -> "_Payload":
        """Return the payload at a place ``(3,)`` in the last frame, on the flange's carrier as nominal."""
        line = [int(model.body(robot.carrier).id)]
        while line[-1]:
            line.append(int(model.body_parentid[line[-1]]))
        T_world_last = last_frame(robot.chain, robot.T_world_frame0)
        T_carrier_last = se3.inverse(body_pose(at_zero(robot.model), line[0])) @ T_world_last
        model.body_sameframe[line[0]] = int(mujoco.mjtSameFrame.mjSAMEFRAME_NONE)  # else its centre cannot move
        mass, centre = float(model.body_mass[line[0]]), model.body_ipos[line[0]].copy()
        place = se3.transform(T_carrier_last, payload_at_m[None])[0]
        return cls(line, place, mass, centre, model.body_subtreemass[line].copy())

    def position(self, data: mujoco.MjData) -> Array:
        """Return the position of the payload in the world, ``(3,)`` m."""
        place: Array = se3.transform(body_pose(data, self.line[0]), self.place[None])[0]
        return place

    def hang(self, model: mujoco.MjModel, payload_kg: float) -> None:
        """Set the body's mass and centre with a payload: at rest, inertia does not matter."""
        mass = self.mass + payload_kg
        model.body_mass[self.line[0]], model.body_subtreemass[self.line] = mass, self.subtree + payload_kg
        if mass > 0:
            model.body_ipos[self.line[0]] = (self.mass * self.centre + payload_kg * self.place) / mass
