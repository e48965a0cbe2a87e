"""Build an arm whose elastic links are chains of rigid pieces on springs: a truth for beams without beam theory.

A straight part, of length L, of an elastic link is N + 1 rigid pieces, half ones at its ends, with N sprung joints
between them, L/N apart: hinges of stiffness EI N/L and GJ N/L, and a slide of EA N/L. At a corner of a link's line the
half pieces of two parts are welded. Each piece has its share of the link's mass, beside the line as the link's centre
of mass is. For N to infinity that is the beam, with an error in N^-2. Its rest under gravity,
a payload and the inertia of a motion is quasi-static: each spring deflects under the load that MuJoCo computes for it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.dynamics.beam import Beam
from lab.kinematics.dynamics.gravity import link_loads
from lab.simulation.elastic_links import AT_REST, JointMotion
from lab.simulation.load_model import bodies_of_links, loads_of
from lab.simulation.robot_model import SerialModel, at_zero, body_pose, last_frame

__all__ = ["BeamChain"]

_STILL = 1e-13  # rad or m; what a step this small changes in the loads moves nothing beyond rounding
_MAX_STEPS = 100
_LEAST = 1e-9  # kg, kg m^2: what MuJoCo asks of a moving body
_SPRINGS = (("hinge", 1, "y"), ("hinge", 2, "z"), ("hinge", 0, "x"), ("slide", 0, "s"))  # as beam.COMPLIANCES


@dataclass(frozen=True)
class _Pieces:
    """A straight part of an elastic link: where it begins and how its axes (rows) are in the link's, what it weighs."""

    near: Array
    length: float
    axes: Array
    beside: Array
    mass: float


class BeamChain:
    """A robot's model with its elastic links as chains of rigid pieces; MuJoCo alone knows what they bear."""

    def __init__(
        self,
        model: mujoco.MjModel,
        robot: SerialModel,
        sections: Array,
        pieces: int,
        payload_at_m: Array | None = None,
    ) -> None:
        """A model of a robot, its bodies perturbed or not.

        Args:
            sections: ``(n, 4)`` each link's compliances (``beam.COMPLIANCES``).
            pieces: N of each straight part of a link.
            payload_at_m: ``(3,)`` m, payloads' centre in the last frame; at its origin if not given.

        Raises:
            LabError: an elastic link has no length.
        """
        self.spec = mujoco.MjSpec()
        self.spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
        self.spec.option.gravity = model.opt.gravity
        self._source, self._robot, self._pieces = model, robot, pieces
        made: dict[int, mujoco.MjsBody] = {0: self.spec.worldbody}
        ends: dict[int, tuple[mujoco.MjsBody, Array]] = {}  # by body of a link: its last piece, and that in the body
        jointed = [int(model.body(name).id) for name in robot.bodies]
        links = self._elastic(sections)
        self._bodies_of_elastic = [bodies_of_links(robot)[link] for link in links]
        compliances: dict[str, float] = {}
        for body in range(1, model.nbody):
            pose = se3.pose(se3.rotation_from_quaternion(model.body_quat[body]), model.body_pos[body])
            parent, moves_on = int(model.body_parentid[body]), body in jointed or jointed[-1] in self._line(body)[1:]
            if parent in ends and moves_on:
                holder, T_parent_last = ends[parent]
                made[body] = _added(holder, model.body(body).name, se3.inverse(T_parent_last) @ pose)
            else:
                made[body] = _added(made[parent], model.body(body).name, pose)
            self._copy(body, made[body])
            if body in jointed and (link := jointed.index(body)) in links:
                ends[body] = self._grow(made[body], link, links[link], sections[link], compliances)
            holder, T_body_last = ends[body] if body == jointed[-1] and body in ends else (made[body], np.eye(4))
            self._sites(body, holder, T_body_last)
        self._hang(made, ends, np.zeros(3) if payload_at_m is None else payload_at_m)
        self.model = self.spec.compile()
        self._data = mujoco.MjData(self.model)
        joints = [self.model.joint(name) for name in robot.chain.joint_names]
        self._qpos, self._dof = [int(j.qposadr[0]) for j in joints], [int(j.dofadr[0]) for j in joints]
        springs = [self.model.joint(name) for name in compliances]
        self._spring_qpos = [int(joint.qposadr[0]) for joint in springs]
        self._spring_dof = [int(joint.dofadr[0]) for joint in springs]
        self._compliances = np.array(list(compliances.values()))

    def positions(self, driven: Array, sites: Sequence[str], payload_kg: Array, motion: JointMotion = AT_REST) -> Array:
        """World positions ``(m, k, 3)`` m of sites of the model, where the chain has settled.

        Args:
            driven: ``(m, n)`` where the motors put the joints, rad or m.
            payload_kg: ``(m,)``.
            motion: of the joints.

        Raises:
            LabError: no equilibrium is found, as a link is too soft.
        """
        numbers = [self.model.site(name).id for name in sites]
        world = np.empty((len(driven), len(numbers), 3))
        for i in range(len(driven)):
            self._settle(driven[i], float(payload_kg[i]), motion, i)
            world[i] = self._data.site_xpos[numbers]
        return world

    def _settle(self, joints: Array, payload_kg: float, motion: JointMotion, pose: int) -> None:
        model, data, held = self.model, self._data, np.empty(self.model.nv)
        model.body_mass[model.body("load of the chain").id] = payload_kg
        data.qpos[:], data.qvel[:], data.qacc[:] = 0.0, 0.0, 0.0
        data.qpos[self._qpos] = joints
        if motion.speeds is not None and motion.accelerations is not None:
            data.qvel[self._dof], data.qacc[self._dof] = motion.speeds[pose], motion.accelerations[pose]
        for _ in range(_MAX_STEPS):
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            mujoco.mj_rne(model, data, 1, held)
            given = -self._compliances * held[self._spring_dof]
            moved = np.abs(given - data.qpos[self._spring_qpos]).max(initial=0.0)
            if moved <= _STILL:
                return
            data.qpos[self._spring_qpos] = given
        raise LabError(f"no equilibrium of the chain of pieces in {_MAX_STEPS} steps: a link is too soft")

    def _line(self, body: int) -> list[int]:
        """A body and what carries it."""
        line = [body]
        while line[-1]:
            line.append(int(self._source.body_parentid[line[-1]]))
        return line

    def _elastic(self, sections: Array) -> dict[int, list[_Pieces]]:
        found, robot = link_loads(loads_of(self._robot)), self._robot
        elastic = {}
        for link in np.flatnonzero(sections.any(axis=1)).tolist():
            if link not in found.beams:
                raise LabError(f"robot {robot.chain.name}: link {link + 1} has no length, so it does not bend")
            elastic[link] = _straight_parts(found.beams[link])
        return elastic

    def _copy(self, body: int, into: mujoco.MjsBody) -> None:
        """A body's mass and joints."""
        model = self._source
        elastic = any(body in bodies for bodies in self._bodies_of_elastic)
        into.mass = _LEAST if elastic else max(float(model.body_mass[body]), _LEAST)
        into.ipos, into.iquat = model.body_ipos[body], model.body_iquat[body]
        into.inertia = np.full(3, _LEAST) if elastic else np.maximum(model.body_inertia[body], _LEAST)
        into.explicitinertial = True
        first = int(model.body_jntadr[body])
        for joint in range(first, first + int(model.body_jntnum[body])):
            into.add_joint(
                name=model.joint(joint).name, type=mujoco.mjtJoint(int(model.jnt_type[joint])),
                pos=model.jnt_pos[joint], axis=model.jnt_axis[joint],
            )  # fmt: skip

    def _sites(self, body: int, holder: mujoco.MjsBody, T_body_holder: Array) -> None:
        for site in np.flatnonzero(self._source.site_bodyid == body).tolist():
            place = se3.transform(se3.inverse(T_body_holder), self._source.site_pos[site][None])[0]
            holder.add_site(name=self._source.site(site).name, pos=place)

    def _grow(
        self, body: mujoco.MjsBody, link: int, parts: list[_Pieces], section: Array, compliances: dict[str, float]
    ) -> tuple[mujoco.MjsBody, Array]:
        """Put the pieces of a link on its body; the last one, and its pose ``(4, 4)`` in the body."""
        T_body_link = se3.pose(self._link_in_body(link), self._near_in_body(link))
        last, T_body_last = body, np.eye(4)
        for part, pieces in enumerate(parts):
            step, T_body_part = pieces.length / self._pieces, T_body_link @ se3.pose(pieces.axes.T, pieces.near)
            if part:
                last = _added(last, f"link{link + 1} corner {part}", se3.inverse(T_body_last) @ T_body_part)
                T_body_last = T_body_part
            _weigh(last, se3.inverse(T_body_last) @ T_body_part, pieces, step / 2)
            for i in range(self._pieces):
                T_body_piece = T_body_part @ se3.pose(np.eye(3), np.array([(i + 0.5) * step, 0.0, 0.0]))
                number = part * self._pieces + i + 1
                last = _added(last, f"link{link + 1} piece {number}", se3.inverse(T_body_last) @ T_body_piece)
                T_body_last = T_body_piece
                compliances |= _springs(last, link, number, section * step)
                _weigh(last, np.eye(4), pieces, step if i + 1 < self._pieces else step / 2)
        return last, T_body_last

    def _link_in_body(self, link: int) -> Array:
        """Return the rotation of a link's axes in its body, ``(3, 3)``."""
        robot = self._robot
        placed = loads_of(robot).frames(np.zeros((1, robot.chain.size)))
        world = body_pose(at_zero(robot.model), int(robot.model.body(robot.bodies[link]).id))[:3, :3]
        turned: Array = world.T @ robot.T_world_frame0[:3, :3] @ placed.rotations[0, link]
        return turned

    def _near_in_body(self, link: int) -> Array:
        """Return the position of a link's beginning in its body, ``(3,)`` m."""
        robot, found = self._robot, link_loads(loads_of(self._robot))
        placed = found.loads.frames(np.zeros((1, robot.chain.size)))
        far = placed.end[0] if link == robot.chain.size - 1 else placed.anchors[0, link + 1]
        near = se3.transform(robot.T_world_frame0, (far - placed.rotations[0, link] @ found.ends[link])[None])
        body = body_pose(at_zero(robot.model), int(robot.model.body(robot.bodies[link]).id))
        place: Array = se3.transform(se3.inverse(body), near)[0]
        return place

    def _hang(
        self, made: dict[int, mujoco.MjsBody], ends: dict[int, tuple[mujoco.MjsBody, Array]], payload_at_m: Array
    ) -> None:
        """A body that is the payload, in the last frame."""
        robot, last = self._robot, int(self._source.body(self._robot.bodies[-1]).id)
        carrier = int(self._source.body(robot.carrier).id)
        T_carrier_world = se3.inverse(body_pose(at_zero(robot.model), int(robot.model.body(robot.carrier).id)))
        T_carrier_last = T_carrier_world @ last_frame(robot.chain, robot.T_world_frame0)
        holder, T_body_holder = ends[last] if carrier == last and last in ends else (made[carrier], np.eye(4))
        place = se3.transform(se3.inverse(T_body_holder) @ T_carrier_last, payload_at_m[None])[0]
        load = _added(holder, "load of the chain", se3.pose(np.eye(3), place))
        load.mass, load.ipos, load.inertia, load.explicitinertial = _LEAST, np.zeros(3), np.full(3, _LEAST), True


def _straight_parts(beam: Beam) -> list[_Pieces]:
    """The straight parts of a link: x along each, z across it in the plane of x and of the joint's axis."""
    corners, parts = beam.path, []
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    middle = lengths @ (corners[1:] + corners[:-1]) / 2 / lengths.sum()
    for near, far, length in zip(corners[:-1], corners[1:], lengths.tolist(), strict=True):
        x = (far - near) / length
        z = np.array([0.0, 0.0, 1.0]) - x[2] * x
        if np.linalg.norm(z) < 1e-6:
            y = np.array([1.0, 0.0, 0.0])
            z = np.cross(x, y)
        else:
            z /= np.linalg.norm(z)
            y = np.cross(z, x)
        axes = np.stack([x, y, z])
        mass = beam.mass_kg * length / float(lengths.sum())
        parts.append(_Pieces(near, length, axes, axes @ (beam.centre_m - middle), mass))
    return parts


def _springs(piece: mujoco.MjsBody, link: int, number: int, compliances: Array) -> dict[str, float]:
    """The sprung joints of a piece of a link, by their names, with compliances ``(4,)`` (rad/Nm, m/N of the slide)."""
    made = {}
    for (kind, axis, symbol), compliance in zip(_SPRINGS, compliances.tolist(), strict=True):
        if compliance > 0:
            name = f"link{link + 1} {symbol}{number}"
            kinds = {"hinge": mujoco.mjtJoint.mjJNT_HINGE, "slide": mujoco.mjtJoint.mjJNT_SLIDE}
            piece.add_joint(name=name, type=kinds[kind], axis=np.eye(3)[axis], stiffness=1 / compliance)
            made[name] = compliance
    return made


def _added(parent: mujoco.MjsBody, name: str, T_parent_body: Array) -> mujoco.MjsBody:
    quat = se3.quaternion_from_rotation(T_parent_body[:3, :3])
    return parent.add_body(name=name, pos=T_parent_body[:3, 3], quat=quat)


def _weigh(body: mujoco.MjsBody, T_body_piece: Array, pieces: _Pieces, length: float) -> None:
    """Give a body the mass of a thin piece that runs along x of its axes from its origin, ``length`` (m) long."""
    mass = pieces.mass * length / pieces.length
    centre = np.array([length / 2, 0.0, 0.0]) + pieces.beside
    body.mass = max(mass, _LEAST)
    body.ipos = se3.transform(T_body_piece, centre[None])[0]
    body.iquat = se3.quaternion_from_rotation(T_body_piece[:3, :3])
    across = max(mass * length**2 / 12, _LEAST)
    body.inertia, body.explicitinertial = np.array([_LEAST, across, across]), True
