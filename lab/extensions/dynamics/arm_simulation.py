"""Simulate torques and wrist wrenches of an arm with and without a rigid load at its flange.

Torques and the wrist's wrench are MuJoCo's ``mj_inverse`` of the nominal masses alone: damping, friction loss, springs,
armature, contacts and limits are off, because MuJoCo includes them, and friction loss only softly. Friction is added
afterwards (``RunErrors``).
"""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from scipy import signal

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.dynamics.load_files import Mounting, PayloadSamples
from lab.kinematics.dynamics.rigid_body import Dynamics, directions
from lab.simulation.robot_model import SerialModel, at_zero, body_pose, compiled, last_frame, update_constants

__all__ = ["CarryingArm", "LoadBench", "RigidLoad", "RunErrors", "drawn_mounting", "own_dynamics", "peak_torques"]

_MIN_KG = 1e-6  # of all moving bodies: with less there are no dynamics
_UPPER = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # the inertia's elements in their order in phi
_ROUNDING = 1e-12  # of an inertia
_PER_JOINT = (
    "encoder_rad",
    "torque_noise_nm",
    "coulomb_nm",
    "viscous_nm_s",
    "motor_inertia_kgm2",
    "motor_coulomb_nm",
    "motor_viscous_nm_s",
)  # errors that may be given for each joint
_FILTER_ORDER = 2  # of the torque channel's Butterworth filter

Path = Callable[[Array], tuple[Array, Array, Array]]
"""Times ``(n,)`` s to joint positions, speeds and accelerations ``(n, J)``; also shortly before and after the run."""


@dataclass(frozen=True)
class RigidLoad:
    """A rigid load at the hand; its frame is the arm's last one.

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
        """Parameters ``(10,)``: mass, mass times centre, inertia about the last frame's origin (xx yy zz xy xz yz)."""
        lever = se3.skew(self.centre_m)
        about_origin = self.inertia_kgm2 - self.mass_kg * lever @ lever
        return np.array([self.mass_kg, *(self.mass_kg * self.centre_m), *(about_origin[cell] for cell in _UPPER)])


class CarryingArm:
    """Exact inverse dynamics of the nominal arm with or without a load; for one thread."""

    def __init__(self, robot: SerialModel, gravity: Array, load: RigidLoad | None = None) -> None:
        """Create the dynamics under gravity ``(3,)`` m/s^2 in frame 0.

        Raises:
            LabError: no moving body of the arm weighs anything.
        """
        if robot.model.body_subtreemass[robot.model.body(robot.bodies[0]).id] < _MIN_KG:
            raise LabError(f"{robot.path}: no link has a mass, so there is no dynamics; give mass_kg of its joints")
        self._loaded = load is not None
        self._model = _bare(robot.model if load is None else _with_load(robot, load))
        self._model.opt.gravity[:] = robot.T_world_frame0[:3, :3] @ gravity
        self._data = mujoco.MjData(self._model)
        joints = [self._model.joint(name) for name in robot.chain.joint_names]
        self._qpos, self._dof = [int(j.qposadr[0]) for j in joints], [int(j.dofadr[0]) for j in joints]

    def torques(self, joints: Array, speeds: Array, accelerations: Array) -> Array:
        """Return the torques ``(n, J)`` of a motion, without friction; Nm (N of a slide)."""
        return self.torques_and_wrench(joints, speeds, accelerations)[0]

    def torques_and_wrench(self, joints: Array, speeds: Array, accelerations: Array) -> tuple[Array, Array]:
        """Return the torques, and the wrench ``(n, 6)`` (N, Nm) of the hand on the load.

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


def own_dynamics(robot: SerialModel, gravity: Array) -> Dynamics:
    """Return the arm's own inverse dynamics without a load, under gravity ``(3,)`` m/s^2 in frame 0.

    Raises:
        LabError: no link weighs anything.
    """
    return CarryingArm(robot, gravity).torques


def peak_torques(robot: SerialModel) -> Array:
    """Return the joints' largest torques ``(J,)``, Nm (N of a slide).

    Raises:
        LabError: the robot's model lacks one.
    """
    joints = [robot.model.joint(name) for name in robot.chain.joint_names]
    for joint in joints:
        if not robot.model.jnt_actfrclimited[joint.id]:
            raise LabError(f"{robot.path}: joint {joint.name} has no peak torque; give torque_nm of every joint")
    return np.array([np.abs(robot.model.jnt_actfrcrange[joint.id]).max() for joint in joints])


def drawn_mounting(robot: SerialModel) -> Mounting:
    """Return the nominal mounting, with a sensor that reads the hand's wrench on the load."""
    return Mounting(robot.T_world_frame0[:3, :3].T @ robot.model.opt.gravity)


def _with_load(robot: SerialModel, load: RigidLoad) -> mujoco.MjModel:
    """Add a body to the arm's model, welded to the flange's carrier in the last frame, and sensors at the weld."""
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
    """Return a copy with masses only, without the other effects that ``mj_inverse`` includes."""
    bare = copy.deepcopy(model)
    off = ("CONSTRAINT", "CONTACT", "SPRING", "DAMPER")  # limits, friction loss; without the last two nothing passive
    bare.opt.disableflags = sum(int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}")) for name in off)
    bare.opt.enableflags = 0
    bare.dof_armature[:] = 0.0
    update_constants(bare)
    return bare


@dataclass(frozen=True)
class RunErrors:
    """Errors of a simulated run; all zero is ideal. Errors ``(J,)`` may be one number for all joints.

    Attributes:
        encoder_rad: standard deviation of a joint encoder, rad (m), ``(J,)``.
        torque_noise: standard deviation of a torque, as a share of the joint's peak torque.
        torque_noise_nm: standard deviation of a torque in Nm (N), ``(J,)``, in addition to that share.
        coulomb_nm: Coulomb friction, Nm (N), ``(J,)``.
        viscous_nm_s: viscous friction, Nm s/rad (N s/m), ``(J,)``.
        load_friction: mu: friction grows by this share of the joint's torque.
        lag_s: delay of the torques.
        motor_inertia_kgm2: inertia of each motor, reflected to its joint, ``(J,)``.
        motor_coulomb_nm, motor_viscous_nm_s: friction of the motors, reflected to their joints, ``(J,)``.
        torque_offset_nm: steady errors of the torques, ``(J,)``; of either sign.
        torque_filter_hz: frequency of a causal low-pass of the torques; 0 is none.
        force_noise_n, moment_noise_nm: standard deviations of the wrist sensor.
        wrench_offset: ``(6,)`` N and Nm.
        tilt_rad: ``(2,)``, tilt of the base beyond the given mounting.
    """

    encoder_rad: Array | float = 0.0
    torque_noise: float = 0.0
    torque_noise_nm: Array | float = 0.0
    coulomb_nm: Array | float = 0.0
    viscous_nm_s: Array | float = 0.0
    load_friction: float = 0.0
    lag_s: float = 0.0
    motor_inertia_kgm2: Array | float = 0.0
    motor_coulomb_nm: Array | float = 0.0
    motor_viscous_nm_s: Array | float = 0.0
    torque_offset_nm: tuple[float, ...] = ()
    torque_filter_hz: float = 0.0
    force_noise_n: float = 0.0
    moment_noise_nm: float = 0.0
    wrench_offset: tuple[float, ...] = (0.0,) * 6
    tilt_rad: tuple[float, ...] = (0.0,) * 2

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not np.isfinite(value).all():
                raise LabError(f"errors of a run: {name} is {value}; give finite numbers")
            default = getattr(RunErrors, name)
            if isinstance(default, tuple) and default and len(value) != len(default):
                raise LabError(f"errors of a run: {name} has {len(value)} numbers; give {len(default)}")
            if not isinstance(default, tuple) and (np.asarray(value) < 0).any():
                raise LabError(f"errors of a run: {name} is {value}; give zero or more")


class LoadBench:
    """Simulated measurements of an arm with and without a load; one generator state gives one set of records."""

    def __init__(
        self,
        robot: SerialModel,
        load: RigidLoad | None,
        mounting: Mounting,
        errors: RunErrors,
        couplings: Array | None = None,
    ) -> None:
        """Create the bench with its nominal mounting, to which the errors are added.

        Args:
            load: None of an arm without a loaded run.
            couplings: C ``(J, J)``, positions of the drives by those of the joints (``ArmDynamics``); torques are then
                those of the drives.

        Raises:
            LabError: the arm has no masses, or no peak torques for a relative torque noise, or an error has the wrong
                number of joints.
        """
        for name in _PER_JOINT:
            if np.shape(value := getattr(errors, name)) not in ((), (robot.chain.size,)):
                raise LabError(f"errors of a run: {name} is {value}; give one number, or {robot.chain.size} of them")
        leaning = se3.exp(np.append(errors.tilt_rad, 0.0))
        gravity = leaning.T @ mounting.gravity
        if len(errors.torque_offset_nm) not in (0, robot.chain.size):
            raise LabError(f"errors of a run: torque_offset_nm: give {robot.chain.size} numbers, one a joint")
        self._arms = {False: CarryingArm(robot, gravity)}
        if load is not None:
            self._arms[True] = CarryingArm(robot, gravity, load)
        self._couplings = np.eye(robot.chain.size) if couplings is None else couplings
        self._R_last_sensor = mounting.rotation
        self._sign, self._errors, self._size = mounting.sign, errors, robot.chain.size
        share = errors.torque_noise * peak_torques(robot) if errors.torque_noise else np.zeros(self._size)
        self._noise_nm = np.hypot(share, errors.torque_noise_nm)

    def moving(self, path: Path, seconds: float, rate_hz: float, rng: np.random.Generator) -> PayloadSamples:
        """Simulate a loaded and then an unloaded run along a path, sampled from time zero on.

        Raises:
            LabError: there are too few samples in that time.
        """
        times = np.arange(round(seconds * rate_hz)) / rate_hz
        if len(times) < 2:
            raise LabError(f"{seconds:g} s at {rate_hz:g} Hz are {len(times)} samples; ask for more")
        streams = _Streams(rng)
        runs = [self._run(path, times, loaded, streams) for loaded in (True, False) if loaded in self._arms]
        return self._recorded(np.tile(times, len(runs)), runs)

    def resting(self, joints: Array, rng: np.random.Generator) -> PayloadSamples:
        """Simulate static poses ``(n, J)``, first all with the load, then all without it.

        Raises:
            LabError: there is no load.
        """
        if True not in self._arms:
            raise LabError("an arm without a load: poses at rest show a load alone; give one")
        zero, streams = np.zeros_like(joints), _Streams(rng)
        at_rest = [(loaded, self._arms[loaded].torques_and_wrench(joints, zero, zero)) for loaded in (True, False)]
        return self._recorded(None, [self._read(joints, *found, loaded, streams) for loaded, found in at_rest])

    def _run(self, path: Path, times: Array, loaded: bool, streams: "_Streams") -> PayloadSamples:
        arm, late = self._arms[loaded], self._errors.lag_s
        motion = path(times)
        torques, wrench = arm.torques_and_wrench(*motion)
        driven = self._driven(torques, *motion[1:])
        if late:
            before = path(times - late)
            driven = self._driven(arm.torques(*before), *before[1:])
        if self._errors.torque_filter_hz:
            driven = self._filtered(driven, float(times[1] - times[0]))
        return self._read(motion[0], driven, wrench, loaded, streams)

    def _friction(self, torques: Array, speeds: Array) -> Array:
        errors = self._errors
        dry: Array = errors.coulomb_nm + errors.load_friction * np.abs(torques)
        return dry * directions(speeds) + errors.viscous_nm_s * speeds

    def _driven(self, torques: Array, speeds: Array, accelerations: Array) -> Array:
        """Compute drive torques ``(n, J)`` for the joints' torques: tau = C' f, and motor inertia and friction."""
        errors, couplings = self._errors, self._couplings
        turned, rates = speeds @ couplings.T, accelerations @ couplings.T
        given = np.linalg.solve(couplings.T, (torques + self._friction(torques, speeds)).T).T
        own = errors.motor_coulomb_nm * directions(turned) + errors.motor_viscous_nm_s * turned
        driven: Array = given + errors.motor_inertia_kgm2 * rates + own
        return driven + np.array(errors.torque_offset_nm) if errors.torque_offset_nm else driven

    def _filtered(self, torques: Array, step_s: float) -> Array:
        """Filter the torques, from a settled state before the run."""
        if not self._errors.torque_filter_hz < 0.5 / step_s:
            raise LabError(f"torque_filter_hz of {self._errors.torque_filter_hz:g} Hz: above half the sampling rate")
        sections = signal.butter(_FILTER_ORDER, self._errors.torque_filter_hz, fs=1 / step_s, output="sos")
        settled = signal.sosfilt_zi(sections)[..., None] * torques[0]
        filtered: Array = signal.sosfilt(sections, torques, axis=0, zi=settled)[0]
        return filtered

    def _read(self, joints: Array, torques: Array, wrench: Array, loaded: bool, streams: "_Streams") -> PayloadSamples:
        """Simulate the sensor readings of a run; ``wrench`` is the hand's on the load, in the last frame."""
        errors = self._errors
        turned = (wrench.reshape(-1, 2, 3) @ self._R_last_sensor).reshape(-1, 6)  # rows: R' f
        noise = np.repeat([errors.force_noise_n, errors.moment_noise_nm], 3) * streams.wrench.standard_normal(
            wrench.shape
        )
        return PayloadSamples(
            None,
            joints + errors.encoder_rad * streams.encoder.standard_normal(joints.shape),
            torques + self._noise_nm * streams.torque.standard_normal(torques.shape),
            self._sign * turned + errors.wrench_offset + noise,
            np.full(len(joints), loaded),
        )

    def _recorded(self, times: Array | None, runs: list[PayloadSamples]) -> PayloadSamples:
        def joined(name: str) -> Any:
            return np.concatenate([getattr(run, name) for run in runs])

        return PayloadSamples(times, joined("joints"), joined("torques"), joined("wrench"), joined("loaded"))


class _Streams:
    """Independent random streams: more draws of one leave the others unchanged."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.encoder, self.torque, self.wrench = rng.spawn(3)
