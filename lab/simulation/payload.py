"""A rigid load welded to a virtual arm's flange, and the arm's exact inverse dynamics with and without it.

Torques and the wrist's wrench are MuJoCo's ``mj_inverse`` of the nominal masses alone: its damping, friction loss,
springs, armature, contacts and limits are off, because it counts them in, and friction loss only softly. What an arm
has of friction is added by hand (``load_runs``).
"""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.load_samples import Mounting
from lab.core.se3 import Array
from lab.kinematics.dynamics.rigid_body import Dynamics
from lab.simulation.model import at_zero, body_pose, compiled, update_constants
from lab.simulation.serial_model import SerialModel, last_frame

__all__ = ["CarryingArm", "RigidLoad", "drawn_mounting", "own_dynamics", "peak_torques"]

_LEAST_KG = 1e-6  # of all moving bodies: with less there is no dynamics
_UPPER = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # the inertia's elements in their order in phi
_ROUNDING = 1e-12  # of an inertia


@dataclass(frozen=True)
class RigidLoad:
    """What hangs at the hand; its frame is the arm's last one.

    Attributes:
        mass_kg: above zero.
        centre_m: ``(3,)``, the centre of mass.
        inertia_kgm2: ``(3, 3)`` about the centre of mass, in the last frame's axes.
    """

    mass_kg: float
    centre_m: Array
    inertia_kgm2: Array

    def __post_init__(self) -> None:
        assert self.centre_m.shape == (3,) and self.inertia_kgm2.shape == (3, 3)
        if not (0 < self.mass_kg < np.inf) or not np.isfinite(self.centre_m).all():
            raise LabError(f"a load of {self.mass_kg:g} kg at {self.centre_m} m: give a mass above zero and a place")
        inertia = self.inertia_kgm2
        least = _ROUNDING * np.abs(inertia).max(initial=0.0)
        if not np.isfinite(inertia).all() or np.abs(inertia - inertia.T).max() > least:
            raise LabError("a load's inertia is to be finite and symmetric, (3, 3) in kg m^2")
        moments = np.linalg.eigvalsh(inertia)
        if moments[0] < -least or moments[2] > moments[0] + moments[1] + least:
            raise LabError(f"no body has principal inertias of {moments} kg m^2: one is above the sum of the others")

    @property
    def phi(self) -> Array:
        """The ten parameters: mass, mass times centre, inertia about the last frame's origin (xx yy zz xy xz yz)."""
        lever = se3.skew(self.centre_m)
        about_origin = self.inertia_kgm2 - self.mass_kg * lever @ lever
        return np.array([self.mass_kg, *(self.mass_kg * self.centre_m), *(about_origin[cell] for cell in _UPPER)])


class CarryingArm:
    """The nominal arm with a load (or none) under some gravity: its exact inverse dynamics. By one thread."""

    def __init__(self, robot: SerialModel, gravity: Array, load: RigidLoad | None = None) -> None:
        """Gravity ``(3,)`` m/s^2 in frame 0.

        Raises:
            LabError: no moving body of the arm weighs anything.
        """
        if _moving_mass(robot) < _LEAST_KG:
            raise LabError(f"{robot.path}: no link has a mass, so there is no dynamics; give mass_kg of its joints")
        self._loaded = load is not None
        self._model = _bare(robot.model if load is None else _with_load(robot, load))
        self._model.opt.gravity[:] = robot.T_world_frame0[:3, :3] @ gravity
        self._data = mujoco.MjData(self._model)
        joints = [self._model.joint(name) for name in robot.chain.joint_names]
        self._qpos, self._dof = [int(j.qposadr[0]) for j in joints], [int(j.dofadr[0]) for j in joints]

    def torques(self, joints: Array, speeds: Array, accelerations: Array) -> Array:
        """Torques ``(n, J)`` that move the arm so, without friction; Nm (N of a slide)."""
        return self.torques_and_wrench(joints, speeds, accelerations)[0]

    def torques_and_wrench(self, joints: Array, speeds: Array, accelerations: Array) -> tuple[Array, Array]:
        """The torques, and the wrench ``(n, 6)`` (N, Nm) of the hand on the load.

        The wrench is about the last frame's origin, in its axes; zero without a load.
        """
        model, data = self._model, self._data
        torques, wrench = np.empty_like(joints), np.zeros((len(joints), 6))
        rows = zip(joints, speeds, accelerations, strict=True)
        for i, (data.qpos[self._qpos], data.qvel[self._dof], data.qacc[self._dof]) in enumerate(rows):
            mujoco.mj_inverse(model, data)
            torques[i] = data.qfrc_inverse[self._dof]
            if self._loaded:
                wrench[i] = data.sensordata[-6:]
        return torques, wrench


def own_dynamics(robot: SerialModel, gravity: Array, scale: float = 1.0) -> Dynamics:
    """The arm's own torques without a load, as a callable for those who may not know MuJoCo.

    Args:
        gravity: ``(3,)`` m/s^2 in frame 0.
        scale: of all masses and inertias: 1.1 is a model that is wrong by 10 %.

    Raises:
        LabError: no link weighs anything.
    """
    arm = CarryingArm(robot, gravity)
    return lambda joints, speeds, accelerations: scale * arm.torques(joints, speeds, accelerations)


def peak_torques(robot: SerialModel) -> Array:
    """The joints' largest torques ``(J,)``, Nm (N of a slide).

    Raises:
        LabError: the robot does not say one.
    """
    joints = [robot.model.joint(name) for name in robot.chain.joint_names]
    for joint in joints:
        if not robot.model.jnt_actfrclimited[joint.id]:
            raise LabError(f"{robot.path}: joint {joint.name} has no peak torque; give torque_nm of every joint")
    return np.array([np.abs(robot.model.jnt_actfrcrange[joint.id]).max() for joint in joints])


def drawn_mounting(robot: SerialModel) -> Mounting:
    """The nominal arm, with a sensor that reads what the hand does to the load."""
    return Mounting(robot.T_world_frame0[:3, :3].T @ robot.model.opt.gravity)


def _moving_mass(robot: SerialModel) -> float:
    model = robot.model
    return float(model.body_subtreemass[model.body(robot.bodies[0]).id])


def _with_load(robot: SerialModel, load: RigidLoad) -> mujoco.MjModel:
    """The arm's model with one more body, welded to the flange's carrier in the last frame, and sensors at the weld."""
    spec = robot.spec.copy()
    T_world_carrier = body_pose(at_zero(robot.model), int(robot.model.body(robot.carrier).id))
    T_carrier_last = se3.inverse(T_world_carrier) @ last_frame(robot.chain, robot.T_world_frame0)
    name = "load"
    while name in {body.name for body in spec.bodies} | {site.name for site in spec.sites}:
        name += "_"
    body = spec.body(robot.carrier).add_body(
        name=name, pos=T_carrier_last[:3, 3], quat=se3.quaternion_from_rotation(T_carrier_last[:3, :3])
    )
    body.explicitinertial, body.mass, body.inertia, body.ipos = True, 1.0, np.ones(3), np.ones(3)
    body.add_site(name=name)
    for kind in (mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE):
        spec.add_sensor(type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=name)
    model = compiled(robot.path, spec)
    hung = model.body(name)  # in place: compilation rounds off what is nearly a plane or a rod
    moments, axes = np.linalg.eigh(load.inertia_kgm2)
    axes[:, 0] *= np.linalg.det(axes)
    model.body_sameframe[hung.id] = int(mujoco.mjtSameFrame.mjSAMEFRAME_NONE)
    hung.mass[:], hung.ipos[:], hung.inertia[:] = load.mass_kg, load.centre_m, moments
    hung.iquat[:] = se3.quaternion_from_rotation(axes)
    return model


def _bare(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy with nothing but masses: what ``mj_inverse`` counts in besides is off."""
    bare = copy.deepcopy(model)
    off = ("CONSTRAINT", "CONTACT", "SPRING", "DAMPER")  # limits, friction loss; without the last two nothing passive
    bare.opt.disableflags = sum(int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}")) for name in off)
    bare.opt.enableflags = 0
    bare.dof_armature[:] = 0.0
    update_constants(bare)
    return bare
