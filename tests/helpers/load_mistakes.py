"""Records of arms and loads, legitimate ones and ones with a mistake that physics or the record itself shows."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

import lab
from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.dynamics.arm_simulation import LoadBench, RigidLoad, RunErrors, drawn_mounting
from lab.extensions.dynamics.dynamics_options import PayloadOptions
from lab.extensions.dynamics.dynamics_phrases import phrase
from lab.extensions.dynamics.dynamics_plausibility import ArmSize, implausibilities, misplaced_points
from lab.extensions.dynamics.load_files import Mounting, PayloadSamples, write_loads, write_mounting
from lab.extensions.dynamics.payload.excitation import Limits, random_path
from lab.extensions.dynamics.payload.identify_payload import payload
from lab.extensions.dynamics.payload.methods import CompliantArm, from_sag
from lab.extensions.dynamics.payload.payload_result import wild_sample
from lab.kinematics.dynamics.rigid_body import torque_regressor
from lab.robots.load_robot import load_virtual
from lab.robots.robot import Robot
from lab.simulation.collisions import random_poses

__all__ = [
    "OF_DYNAMICS",
    "OF_SAG",
    "OF_TORQUES",
    "OF_WRENCH",
    "Record",
    "Sag",
    "dynamics_answer",
    "motion",
    "payload_answer",
    "poses",
    "sag",
    "sag_answer",
]

BEARING = (1, 2, 4)  # of a serial arm with a wrist: the drives that gravity pulls at most
TARGETS = ("p1", "p2", "p3")


@dataclass(frozen=True)
class Record:
    """What is written into the files.

    Attributes:
        mounting: what the sensor's file says.
    """

    robot: Robot
    samples: PayloadSamples
    mounting: Mounting

    def torques(self, values: Array) -> "Record":
        """With other torques."""
        return replace(self, samples=replace(self.samples, torques=values))

    def wrench(self, values: Array) -> "Record":
        """With another wrench."""
        return replace(self, samples=replace(self.samples, wrench=values))

    def joints(self, values: Array) -> "Record":
        """With other joint positions."""
        return replace(self, samples=replace(self.samples, joints=values))

    def loaded(self) -> "Record":
        """With loaded and unloaded rows exchanged."""
        return replace(self, samples=replace(self.samples, loaded=~self.samples.loaded))

    def times(self, factor: float) -> "Record":
        """With times in another unit."""
        assert self.samples.time_s is not None
        return replace(self, samples=replace(self.samples, time_s=factor * self.samples.time_s))


@dataclass(frozen=True)
class Sag:
    """Points of a soft arm at the same joint positions ``(n, J)``, without and with a load: ``(n, k, 3)`` m."""

    robot: Robot
    soft: CompliantArm
    joints: Array
    unloaded: Array
    loaded: Array


Change = Callable[[Record, np.random.Generator], Record]


def drawn_load(rng: np.random.Generator) -> RigidLoad:
    """A load that arms of this size carry: a block."""
    mass, sides = rng.uniform(0.5, 2.5), rng.uniform(0.04, 0.15, 3)
    inertia = mass / 12 * np.diag((sides**2).sum() - sides**2)
    return RigidLoad(mass, rng.uniform([-0.03, -0.03, 0.02], [0.03, 0.03, 0.1]), inertia)


def motion(robot: str, seed: int, *, loaded: bool) -> Record:
    """A random motion as the drives feel it, with friction, motors' inertias and noise; with a load or without."""
    rng, arm = np.random.default_rng(seed), load_virtual(robot)
    load, mounting = drawn_load(rng), drawn_mounting(arm.serial_model)
    path = random_path(Limits.of(arm.chain), rng, at_rest=True).at
    errors = RunErrors(
        encoder_rad=rng.uniform(0, 1e-5),
        torque_noise=rng.uniform(0.002, 0.01),
        coulomb_nm=rng.uniform(0.5, 2.0),
        viscous_nm_s=rng.uniform(0.2, 1.0),
        motor_inertia_kgm2=rng.uniform(0.05, 0.15),
        torque_offset_nm=tuple(rng.uniform(-0.2, 0.2, 6)),
    )
    samples = LoadBench(arm.serial_model, load, mounting, errors).moving(path, rng.uniform(5, 8), 100.0, rng)
    samples = replace(samples, wrench=None)
    return Record(arm, samples if loaded else samples.run(False), mounting)


def poses(robot: str, seed: int) -> Record:
    """Static poses without and with a load, with noise and offsets of the sensor."""
    rng, arm = np.random.default_rng(seed), load_virtual(robot)
    load, mounting = drawn_load(rng), Mounting.tilted(rng.uniform(-0.05, 0.05, 2), sign=-1.0)
    errors = RunErrors(
        torque_noise=rng.uniform(0.002, 0.006),
        force_noise_n=rng.uniform(0.02, 0.1),
        moment_noise_nm=rng.uniform(0.001, 0.004),
        wrench_offset=tuple(rng.uniform(-3, 3, 6)),
    )
    where = random_poses(arm.model, int(rng.integers(14, 30)), rng)
    return Record(arm, LoadBench(arm.model, load, mounting, errors).resting(where, rng), mounting)


def sag(robot: str, seed: int) -> Sag:
    """What a tracker sees of a soft arm, with noise."""
    rng, arm = np.random.default_rng(seed), load_virtual(robot)
    load, loads = drawn_load(rng), arm.loads
    assert loads is not None
    soft = CompliantArm(rng.uniform(0.5, 2.0, arm.chain.size) * 1e-4, loads)
    joints, serial = random_poses(arm.model, int(rng.integers(14, 30)), rng), arm.serial_arm(TARGETS)
    values, points, sigma_m = serial.nominal(arm.tool), [], rng.uniform(5e-6, 2e-5)
    for phi in (np.zeros(10), load.phi):
        given, still = np.zeros_like(joints), np.zeros_like(joints)
        for _ in range(60):  # the equilibrium as it is written
            force, _ = loads.forces(joints + given, np.zeros(len(joints)))
            columns = torque_regressor(serial, values, joints + given, still, still, loads.gravity)
            given = soft.compliance * (force - columns @ phi)
        seen = serial.points(joints + given, values)
        points.append(seen + sigma_m * rng.standard_normal(seen.shape))
    return Sag(arm, soft, joints, points[0], points[1])


def dynamics_answer(record: Record, folder: Path) -> list[str]:
    """Why ``lab dynamics`` does not accept a record; nothing where it does."""
    chain = record.robot.chain
    write_loads(folder / "motion.csv", record.samples, chain.joint_names, chain.prismatic)
    write_mounting(folder / "sensor.toml", record.mounting)
    try:
        found = lab.dynamics(folder / "motion.csv", robot=record.robot, sensor=folder / "sensor.toml")
    except LabError as error:
        return [f"refused: {error}"]
    return list(found.warnings) if found.exit_code else []


def payload_answer(record: Record, folder: Path, method: Literal["torques", "wrench"]) -> list[str]:
    """Why ``lab payload`` does not accept a record; nothing where it does."""
    chain = record.robot.chain
    write_loads(folder / "runs.csv", record.samples, chain.joint_names, chain.prismatic)
    write_mounting(folder / "sensor.toml", record.mounting)
    try:
        asked = PayloadOptions(folder / "runs.csv", record.robot.name, sensor=folder / "sensor.toml", method=method)
        found = payload(asked)
    except LabError as error:
        return [f"refused: {error}"]
    return list(found.warnings) if found.exit_code else []


def sag_answer(record: Sag) -> list[str]:
    """Why the load is not accepted that ``lab payload`` finds from sag; nothing where it is."""
    robot, arm = record.robot, record.robot.serial_arm(TARGETS)
    try:
        with np.errstate(all="ignore"):
            values = arm.nominal(robot.tool)
            found = from_sag(arm, values, record.soft, record.joints, record.unloaded, record.loaded)
    except (LabError, np.linalg.LinAlgError) as error:
        return [f"refused: {error}"]
    strange = misplaced_points(arm.points(record.joints, values), record.unloaded, record.loaded)
    strange += implausibilities(found, ArmSize.of(robot.chain, robot.loads))
    said = [phrase(each) for each in strange]
    said += [] if np.isfinite(found.phi[:4]).all() else ["not identified"]
    said += [phrase(found.verdict)] if found.adequate is False else []
    return said + [phrase(each) for each in wild_sample(found)]


def _drive(change: Callable[[Array], Array]) -> Change:
    """One drive's torques changed; at rest those of a drive that bears its arm and load."""

    def changed(record: Record, rng: np.random.Generator) -> Record:
        assert record.samples.torques is not None
        torques = record.samples.torques.copy()
        all_move = record.samples.time_s is not None
        drive = int(rng.integers(6)) if all_move else int(rng.choice(BEARING))
        torques[:, drive] = change(torques[:, drive])
        return record.torques(torques)

    return changed


def _exchanged(values: Array, rng: np.random.Generator) -> Array:
    """Two columns exchanged, of joints that bear arm and load."""
    one, other = rng.choice(BEARING, 2, replace=False)
    order = np.arange(values.shape[1])
    order[[one, other]] = order[[other, one]]
    return values[:, order]


def _turned_gravity(record: Record, rng: np.random.Generator) -> Record:
    gravity = record.mounting.gravity
    axis = np.cross(rng.standard_normal(3), gravity)
    turn = se3.exp(rng.uniform(np.pi / 2, np.pi) * axis / np.linalg.norm(axis))
    return replace(record, mounting=replace(record.mounting, gravity=turn @ gravity))


def _stuck(record: Record, channel: int, share: float) -> Record:
    """A channel of the wrench that always has that share of its first reading."""
    assert record.samples.wrench is not None
    wrench = record.samples.wrench.copy()
    wrench[:, channel] = share * wrench[0, channel]
    return record.wrench(wrench)


def _turned(record: Record, turn: Array) -> Record:
    """Forces and moments in other axes."""
    wrench = record.samples.wrench
    assert wrench is not None
    return record.wrench(np.concatenate([wrench[:, :3] @ turn.T, wrench[:, 3:] @ turn.T], axis=1))


OF_DYNAMICS: dict[str, Change] = {
    "torques negated": lambda r, g: r.torques(-r.samples.torques),
    "torques in Nmm": lambda r, g: r.torques(1e3 * r.samples.torques),
    "one drive in Nmm": _drive(lambda t: 1e3 * t),
    "one drive in kNm": _drive(lambda t: 1e-3 * t),
    "one drive of the other sign": _drive(np.negative),
    "one drive is constant": _drive(lambda t: np.full_like(t, t[0])),
    "one drive is zero": _drive(np.zeros_like),
    "degrees in columns of rad": lambda r, g: r.joints(np.rad2deg(r.samples.joints)),
    "radians in columns of degrees": lambda r, g: r.joints(np.deg2rad(r.samples.joints)),
    "torques of two drives exchanged": lambda r, g: r.torques(_exchanged(r.samples.torques, g)),
    "gravity of another mounting": _turned_gravity,
    "time in ms": lambda r, g: r.times(1e3),
    "one drive twice": lambda r, g: r.torques(r.samples.torques[:, [0, 1, 1, 3, 4, 5]]),
}
_OF_POSES: dict[str, Change] = {
    "degrees in columns of rad": OF_DYNAMICS["degrees in columns of rad"],
    "radians in columns of degrees": OF_DYNAMICS["radians in columns of degrees"],
    "gravity of another mounting": _turned_gravity,
    "loaded and unloaded exchanged": lambda r, g: r.loaded(),
}
OF_TORQUES: dict[str, Change] = _OF_POSES | {
    name: OF_DYNAMICS[name]
    for name in (
        *("torques negated", "torques in Nmm", "one drive in Nmm", "one drive in kNm", "one drive of the other sign"),
        *("one drive is constant", "one drive is zero", "torques of two drives exchanged", "one drive twice"),
    )
}
OF_WRENCH: dict[str, Change] = _OF_POSES | {
    "moments in Nmm": lambda r, g: r.wrench(r.samples.wrench * [1, 1, 1, 1e3, 1e3, 1e3]),
    "forces in mN, moments in Nmm": lambda r, g: r.wrench(1e3 * r.samples.wrench),
    "wrench negated": lambda r, g: r.wrench(-r.samples.wrench),
    "sensor turned a quarter": lambda r, g: _turned(r, se3.exp(np.pi / 2 * np.eye(3)[g.integers(2)])),
    "left-handed axes": lambda r, g: _turned(r, np.diag(1 - 2 * np.eye(3)[g.integers(3)])),
    "forces and moments exchanged": lambda r, g: r.wrench(r.samples.wrench[:, [3, 4, 5, 0, 1, 2]]),
    "two axes exchanged": lambda r, g: r.wrench(r.samples.wrench[:, [1, 0, 2, 4, 3, 5]]),
    "one force is constant": lambda r, g: _stuck(r, int(g.integers(3)), 1.0),
    "one moment is zero": lambda r, g: _stuck(r, 3 + int(g.integers(3)), 0.0),
}


def _sagging(size: float) -> Callable[[Sag, np.random.Generator], Sag]:
    return lambda r, g: replace(r, loaded=r.unloaded + size * (r.loaded - r.unloaded))


def _axes(*columns: Array | list[list[float]]) -> Callable[[Sag, np.random.Generator], Sag]:
    (turn,) = columns
    return lambda r, g: replace(r, unloaded=r.unloaded @ np.array(turn), loaded=r.loaded @ np.array(turn))


OF_SAG: Mapping[str, Callable[[Sag, np.random.Generator], Sag]] = {
    "loaded and unloaded exchanged": lambda r, g: replace(r, unloaded=r.loaded, loaded=r.unloaded),
    "sag in mm": _sagging(1e3),
    "sag of the other sign": _sagging(-1.0),
    "points in mm": _axes(1e3 * np.eye(3)),
    "two axes exchanged": _axes([[0, 1, 0], [1, 0, 0], [0, 0, 1]]),
    "z counted down": _axes([[1, 0, 0], [0, 1, 0], [0, 0, -1]]),
    "springs in Nmm": lambda r, g: replace(r, soft=replace(r.soft, compliance=1e-3 * r.soft.compliance)),
    "another order of poses": lambda r, g: replace(r, loaded=np.roll(r.loaded, 1, axis=0)),
    "a loaded run in another frame": lambda r, g: replace(r, loaded=r.loaded @ se3.exp(np.array([0.0, 0.0, 0.3]))),
    "positions of two joints exchanged": lambda r, g: replace(r, joints=_exchanged(r.joints, g)),
    "degrees in columns of rad": lambda r, g: replace(r, joints=np.rad2deg(r.joints)),
}
