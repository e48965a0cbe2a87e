"""How an arm gives way under its own weight and a payload: joints like springs, links that bend.

A joint driven to q stands at ``q' = q - c tau(q')``, with its compliance c and MuJoCo's torque tau that holds the
weight at q' (qfrc_bias at rest). A link bends after the small-rotation scheme of elastic calibration (Khalil &
Besnard 2002: a flexible transform between successive links): between its end and the body that sits there comes
``T_flex = (exp(b m), 0)``, with its compliance b and the moment m, about that end, of the weight of all that is
carried. Loads are those of the arm as it gave way: a fixed point.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.simulation.model import at_zero, body_pose
from lab.simulation.serial_model import SerialModel, last_frame

__all__ = ["FlexibleArm"]

_STILL = 1e-13  # rad or m; what a step this small changes in the loads moves nothing beyond rounding
_MOST_STEPS = 100


@dataclass(frozen=True)
class Stand:
    """How an arm stands at each of m poses.

    Attributes:
        joints: ``(m, n)``, rad or m.
        quaternions: ``(m, n, 4)``, wxyz: how each jointed body is turned in its parent at joint zero.
    """

    joints: Array
    quaternions: Array


class FlexibleArm:
    """A copy of an arm's model on which loads are hung and whose links bend; each question sets all it needs."""

    def __init__(self, model: mujoco.MjModel, robot: SerialModel, payload_at_m: Array | None = None) -> None:
        """Payloads' centre ``(3,)`` m is given in the last frame; at its origin if not given."""
        self._model = copy.deepcopy(model)
        self._data = mujoco.MjData(self._model)
        joints = [model.joint(name) for name in robot.chain.joint_names]
        self._qpos, self._dof = [int(j.qposadr[0]) for j in joints], [int(j.dofadr[0]) for j in joints]
        self._bodies = [int(model.body(name).id) for name in robot.bodies]
        self._carriers = model.body_parentid[self._bodies].tolist()
        self._payload = _Payload.carried_by(self._model, robot, np.zeros(3) if payload_at_m is None else payload_at_m)
        self._straight = model.body_quat[self._bodies].copy()

    def straight(self, joints: Array) -> Stand:
        """The arm at joints ``(m, n)``, no link bent."""
        return Stand(joints, np.broadcast_to(self._straight, (*joints.shape, 4)))

    def settled(self, driven: Array, compliance: Array, bending: Array, payload_kg: Array) -> Stand:
        """Where the arm stands under its weight and a payload.

        A fixed point, not Newton's method: the weight that the bent arm bears is worked out anew by MuJoCo, without
        derivatives.

        Args:
            driven: ``(m, n)``, where the motors put the joints, rad or m.
            compliance: ``(n,)`` rad/Nm (m/N for a slide).
            bending: ``(n,)`` rad/Nm, of what carries each jointed body.
            payload_kg: ``(m,)``.

        Raises:
            LabError: no equilibrium is found, as the arm is too soft.
        """
        stand, last = self.straight(driven), np.zeros((*driven.shape, 4))
        rotations = se3.rotation_from_quaternion(self._straight)  # (n, 3, 3)
        for _ in range(_MOST_STEPS):
            torques, moments = self.loads(stand, payload_kg)
            sag, bends = compliance * torques, bending[:, None] * moments
            stand = Stand(driven - sag, se3.quaternion_from_rotation(se3.exp(bends) @ rotations))
            given = np.concatenate([sag[..., None], bends], axis=2)
            if np.abs(given - last).max(initial=0.0) <= _STILL:
                return stand
            last = given
        raise LabError(
            f"no equilibrium under the load in {_MOST_STEPS} steps: the arm is too soft; lower its compliances"
        )

    def loads(self, stand: Stand, payload_kg: Array) -> tuple[Array, Array]:
        """Torques ``(m, n)`` Nm (N for a slide) that hold the weight, and moments ``(m, n, 3)`` Nm of what is carried.

        A moment is about a jointed body's origin, of the weight of it and all beyond, in its carrier's frame.
        """
        m, n = stand.joints.shape
        torques, lever, mass, rotation = np.empty((m, n)), np.empty((m, n, 3)), np.empty((m, n)), np.empty((m, n, 9))
        model, data, held = self._model, self._data, np.empty(self._model.nv)
        for i in range(m):
            self._payload.hang(model, payload_kg[i])
            self._kinematics(stand, i)
            mujoco.mj_comPos(model, data)
            mujoco.mj_rne(model, data, 0, held)
            torques[i], rotation[i] = held[self._dof], data.xmat[self._carriers]
            lever[i] = data.subtree_com[self._bodies] - data.xpos[self._bodies]
            mass[i] = model.body_subtreemass[self._bodies]
        moments = np.cross(lever, mass[..., None] * model.opt.gravity)[..., None, :]  # rows, in the world
        return torques, (moments @ rotation.reshape(m, n, 3, 3))[..., 0, :]

    def positions(self, stand: Stand, sites: Sequence[int]) -> Array:
        """World positions ``(m, k, 3)`` m of the sites."""
        world = np.empty((len(stand.joints), len(sites), 3))
        for i in range(len(world)):
            self._kinematics(stand, i)
            world[i] = self._data.site_xpos[sites]
        return world

    def _kinematics(self, stand: Stand, pose: int) -> None:
        self._data.qpos[self._qpos] = stand.joints[pose]
        self._model.body_quat[self._bodies] = stand.quaternions[pose]
        mujoco.mj_kinematics(self._model, self._data)


@dataclass(frozen=True)
class _Payload:
    """The body that carries a payload, as it is without one.

    Attributes:
        line: this body, then what carries it, to the world.
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
        """A place ``(3,)`` in the last frame on the flange's carrier, as drawn."""
        line = [int(model.body(robot.carrier).id)]
        while line[-1]:
            line.append(int(model.body_parentid[line[-1]]))
        T_world_last = last_frame(robot.chain, robot.T_world_frame0)
        T_carrier_last = se3.inverse(body_pose(at_zero(robot.model), line[0])) @ T_world_last
        model.body_sameframe[line[0]] = int(mujoco.mjtSameFrame.mjSAMEFRAME_NONE)  # else its centre cannot move
        mass, centre = float(model.body_mass[line[0]]), model.body_ipos[line[0]].copy()
        place = se3.transform(T_carrier_last, payload_at_m[None])[0]
        return cls(line, place, mass, centre, model.body_subtreemass[line].copy())

    def hang(self, model: mujoco.MjModel, payload_kg: float) -> None:
        """Give the body the mass and the centre that it has with a payload: at rest, inertia does not matter."""
        mass = self.mass + payload_kg
        model.body_mass[self.line[0]], model.body_subtreemass[self.line] = mass, self.subtree + payload_kg
        if mass > 0:
            model.body_ipos[self.line[0]] = (self.mass * self.centre + payload_kg * self.place) / mass
