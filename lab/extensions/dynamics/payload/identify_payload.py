"""Run ``lab payload``: identify a payload from the joints' torques, a wrist sensor's wrench, or the arm's sag."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.core.checks import Check
from lab.core.errors import LabError, error_context
from lab.core.limits import one_serial
from lab.core.measurements import Measurements, copied_rows, describe_copies
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.dynamics.arm_simulation import drawn_mounting, own_dynamics
from lab.extensions.dynamics.dynamics_options import PayloadOptions
from lab.extensions.dynamics.dynamics_phrases import phrase
from lab.extensions.dynamics.dynamics_plausibility import (
    ArmSize,
    implausibilities,
    misplaced_points,
    not_of_the_arm,
    stuck_channels,
)
from lab.extensions.dynamics.load_files import WRENCH, Mounting, PayloadSamples, read_loads, read_mounting
from lab.extensions.dynamics.payload.methods import CompliantArm, from_sag, from_torques, from_wrench
from lab.extensions.dynamics.payload.payload_estimate import LoadEstimate
from lab.extensions.dynamics.payload.payload_result import PayloadResult, UncertaintyCost, wild_sample
from lab.extensions.dynamics.payload.physical_consistency import physical_estimate
from lab.extensions.dynamics.simulated_session import MeasuringBench, simulated_load
from lab.formats.measurement_csv import read_measurements
from lab.kinematics.dynamics.rigid_body import sag_uncertainty, torque_regressor
from lab.kinematics.serial.serial_arm import SerialArm
from lab.library.load_run import CalibrationRun, RunLike, calibrated_by, folder_of, load_run
from lab.options.call_options import options_of, takes
from lab.robots.load_robot import load_robot, load_virtual, robot_of_call
from lab.robots.robot import Robot
from lab.simulation.collisions import random_poses

__all__ = ["payload"]

_SIMULATED_KG = 1.0
_MIN_TORQUE = 0.1  # m, times gravity: a drive whose torque a load changes by less may stand still
_COST_POSES = 200  # poses over which the cost of an uncertain load is averaged
_SAME_RAD = 1e-6  # rad or m: joint positions of one pose


@takes(PayloadOptions)
def payload(
    file: str | Path | PayloadOptions | None = None,
    robot: str | Path | Robot | None = None,
    run: RunLike = None,
    **options: Any,
) -> PayloadResult:
    """Identify the payload at the flange: its mass, centre of mass and inertia, each with its interval.

    Args:
        file: rows of a loaded and an unloaded run: joint positions with torques, a sensor's wrench, or tracked points;
            or all options in one object. None where the session is simulated (``simulate``).
        robot: the nominal model: a name, a path, or a loaded robot; by default that of ``run``, and of a simulated
            session ``irb120``.
        run: of tracked points, what calibrated the robot with its compliances: a result, or the folder of a run.
        options: those of ``lab payload``, by name: ``sensor``, ``method``, ``friction`` and so on.

    Returns:
        Mass (kg), centre of mass (m) and inertia (kg m²), in the frame of the flange.

    Raises:
        LabError: the file lacks what the method needs, or does not show a payload.

    Example:
        >>> import lab
        >>> found = lab.payload(simulate=True, robot="tx40", payload_kg=1.5, seconds=5.0, seed=7)
        >>> f"{found.to_dict()['mass_kg']['value']:.1f} kg"
        '1.5 kg'
    """
    if isinstance(file, PayloadOptions):
        file.check()
        calibrated = None if file.run is None else load_run(file.run, accept_edited=file.accept_edited)
        return _payload(file, file.robot, calibrated)
    given = {"file": None if file is None else str(file), **folder_of(run), **options}
    if run is None:
        nominal = robot_of_call("lab.payload", file, robot)
        requested = options_of("lab.payload", PayloadOptions, {**given, "robot": nominal.source})
        requested.check()
        return _payload(requested, nominal, None)
    requested = options_of("lab.payload", PayloadOptions, given)
    requested.check()
    assert requested.run is not None
    by = calibrated_by(run, requested.run, accept_edited=requested.accept_edited)
    if robot is not None and load_robot(robot).sha256 != by.robot.sha256:
        raise LabError(f"lab.payload: the run {requested.run} is of {by.robot.name}, not of {robot}; leave robot out")
    return _payload(replace(requested, robot=by.robot.source), by.robot, by)


def _payload(options: PayloadOptions, nominal: str | Robot, run: CalibrationRun | None) -> PayloadResult:
    if run is not None:
        stated = {str(run.folder): run.serial, "--serial": options.serial}
        serial = one_serial(stated, "identify its payload with a run of its own")
        return _by_sag(replace(options, serial=serial), run)
    robot = load_virtual(nominal, options.cell) if options.rehearsal.simulate else load_robot(nominal, options.cell)
    truth = None
    if options.file is None:
        samples, mounting, truth = _simulated(options, robot)
    else:
        samples, mounting = _read(options, options.file, robot)
    method = options.method or ("torques" if samples.wrench is None else "wrench")
    arm = robot.serial_arm(("p1",))
    file = options.file or "--simulate"
    with error_context(file), np.errstate(all="ignore"):  # numbers of a nonsensical file may overflow
        fitted = _fitted(options, robot, samples, mounting, method)
        implausible = (
            *_stuck(robot, samples, mounting, method),
            *implausibilities(
                fitted,
                ArmSize.of(robot.serial_model.chain, robot.loads),
                samples,
                lambda other: _fitted(options, robot, other, mounting, method),
                lambda joints: arm.flange(joints, arm.nominal(robot.tool))[:, 2, :3],
            ),
        )
        _refuse_impossible(fitted, implausible)
    estimate = physical_estimate(fitted) if options.physical else fitted
    compliance = _compliance(robot, options.stiffness_nm_per_rad)
    cost = _cost(robot, arm, arm.nominal(robot.tool), compliance, mounting, estimate)
    warnings = (*robot.warnings, *samples.warnings, *_warnings(estimate, implausible))
    return PayloadResult(
        options, robot, samples, mounting, estimate, cost, warnings, implausible=implausible, truth=truth
    )


def _read(options: PayloadOptions, file: Path, robot: Robot) -> tuple[PayloadSamples, Mounting]:
    """Read the file, and the mounting of arm and sensor."""
    chain = robot.chain
    samples = read_loads(file, chain.joint_names, chain.prismatic, (chain.lower, chain.upper))
    samples = samples.without_copies(file)
    wrench = samples.wrench is not None if options.method is None else options.method == "wrench"
    if options.sensor is not None:
        return samples, read_mounting(options.sensor, sensor=wrench)
    if wrench:
        raise LabError(f"{file}: a wrench needs its sensor's sign; give --sensor FILE.toml")
    return samples, drawn_mounting(robot.serial_model)


def _simulated(options: PayloadOptions, robot: Robot) -> tuple[PayloadSamples, Mounting, Array]:
    """Simulate a measurement session: return its readings, the nominal mounting, and the load's phi ``(10,)``."""
    session = options.rehearsal
    load = simulated_load(session.payload_kg or _SIMULATED_KG, session)
    bench = MeasuringBench(robot, session, load)
    if options.method == "wrench":
        return bench.at_rest(), bench.mounting, load.phi
    arm = robot.serial_arm(("p1",))
    values, gravity = arm.nominal(robot.tool), bench.mounting.gravity

    def regressor(joints: Array, speeds: Array, accelerations: Array) -> Array:
        return torque_regressor(arm, values, joints, speeds, accelerations, gravity)

    return bench.driven(bench.designed(regressor), 0), bench.mounting, load.phi


def _fitted(
    options: PayloadOptions, robot: Robot, samples: PayloadSamples, mounting: Mounting, method: str
) -> LoadEstimate:
    arm = robot.serial_arm(("p1",))
    values = arm.nominal(robot.tool)
    if method == "wrench":
        _refuse(options, "friction", options.friction, "torques")
        return from_wrench(arm, values, samples, mounting, tilt=options.tilt, turn=options.turn, delay=options.delay)
    _refuse(options, "tilt", options.tilt, "wrench")
    _refuse(options, "turn", options.turn, "wrench")
    if robot.loads is None:
        raise LabError(
            f"robot {robot.name} has no masses, so its own torques hide the payload's; give mass_kg "
            "of its joints, or measure with a wrist sensor"
        )
    own = own_dynamics(robot.serial_model, mounting.gravity)
    return from_torques(arm, values, samples, mounting.gravity, own=own, friction=options.friction, delay=options.delay)


def _stuck(robot: Robot, samples: PayloadSamples, mounting: Mounting, method: str) -> tuple[Check, ...]:
    """Return channels that should change or follow the arm's own weight, and do not."""
    if method == "wrench":
        return stuck_channels(samples.run(True), [f"the column {name}" for name in WRENCH], np.ones(6, dtype=np.bool_))
    arm = robot.serial_arm(("p1",))
    joints, rest = samples.joints, np.zeros_like(samples.joints)
    weight = torque_regressor(arm, arm.nominal(robot.tool), joints, rest, rest, mounting.gravity)[..., :4]
    shows = (np.ptp(weight, axis=0) > _MIN_TORQUE).any(axis=1)
    names = [f"the torque of {name}" for name in robot.chain.joint_names]
    stuck = stuck_channels(replace(samples, wrench=None), names, np.asarray(shows, dtype=np.bool_))
    still = samples.run(False)
    if samples.time_s is not None or still.torques is None:
        return stuck
    nothing = np.zeros_like(still.joints)
    expected = own_dynamics(robot.serial_model, mounting.gravity)(still.joints, nothing, nothing)
    return stuck + not_of_the_arm(still.torques, expected, robot.chain.joint_names)


def _refuse_impossible(found: LoadEstimate, implausible: Sequence[Check]) -> None:
    """Refuse an estimate without identified parameters, or with a mass below zero."""
    if not found.identified:
        raise LabError("nothing of the load shows: move the arm, so that gravity pulls at its joints in other ways")
    if found.mass_kg + found.mass_half_width_kg < 0:
        cause = "loaded and unloaded rows are exchanged, or the sensor's sign is the other one"
        if len(implausible) > 1:
            cause = phrase(implausible[-1])
        raise LabError(f"the load would weigh {found.mass_kg:.4g} kg: {cause}; mend that")


def _refuse(options: PayloadOptions, name: str, given: bool, method: str) -> None:
    if given:
        raise LabError(f"--{name} is for --method {method}: leave it out")


def _by_sag(options: PayloadOptions, run: CalibrationRun) -> PayloadResult:
    """Identify the payload from tracker positions with and without it, and the compliances of a calibrated arm."""
    robot, values = run.robot, run.estimate.geometry[1]
    arm = robot.serial_arm(run.estimate.arm.targets)
    assert options.file is not None
    data = read_measurements(options.file, robot.chain.joint_names, robot.chain.prismatic)
    if data.targets != arm.targets:
        raise LabError(
            f"{options.file}: targets {', '.join(data.targets)}, but {options.run} identified "
            f"{', '.join(arm.targets)}; give the file of that tool"
        )
    compliance = run.estimate.compliance
    if robot.loads is None:
        raise LabError(f"{options.run}: robot {robot.name} has no masses, so no compliance was identified; give masses")
    joints, unloaded, loaded, notes = _paired(options, data)
    with error_context(options.file), np.errstate(all="ignore"):  # numbers of a nonsensical file may overflow
        fitted = from_sag(arm, values, CompliantArm(compliance, robot.loads), joints, unloaded, loaded)
        implausible = (
            *misplaced_points(arm.points(joints, values), unloaded, loaded),
            *implausibilities(fitted, ArmSize.of(robot.serial_model.chain, robot.loads)),
        )
        _refuse_impossible(fitted, implausible)
    estimate = physical_estimate(fitted) if options.physical else fitted
    mounting = Mounting(robot.loads.gravity)
    cost = _cost(robot, arm, values, compliance, mounting, estimate)
    warnings = (*run.warnings, *data.warnings, *notes, *_warnings(estimate, implausible))
    return PayloadResult(options, robot, None, mounting, estimate, cost, warnings, data.targets, implausible)


def _rows_by_run(options: PayloadOptions, data: Measurements) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Return the rows with the payload, and those without."""
    column = data.other.get("run")
    if column is None or set(column) - {"loaded", "unloaded"}:
        raise LabError(f"{options.file}: state in column run whether each row is loaded or unloaded")
    return np.flatnonzero(np.array(column) == "loaded"), np.flatnonzero(np.array(column) == "unloaded")


def _paired(options: PayloadOptions, data: Measurements) -> tuple[Array, Array, Array, list[str]]:
    """Return joint positions ``(n, joints)``, and points ``(n, k, 3)`` without and with the payload, at the same poses.

    Pairs that repeat an earlier one to the last digit are left out, with a note.
    """
    with_it, without = _rows_by_run(options, data)
    if len(with_it) != len(without) or np.abs(data.joints[with_it] - data.joints[without]).max(initial=0) > _SAME_RAD:
        raise LabError(f"{options.file}: give the same joint positions loaded and unloaded, in one order")
    parts = data.joints[with_it], data.points[without], data.points[with_it]
    copies = copied_rows(np.concatenate([part.reshape(len(with_it), -1) for part in parts], axis=1))
    retained = np.setdiff1d(np.arange(len(with_it)), [row for row, _ in copies])
    where = [data.where(int(with_it[row])) for row in copies[0]] if copies else []
    notes = [f"{describe_copies(options.file, len(copies), *where)}: left out"] if copies else []
    return parts[0][retained], parts[1][retained], parts[2][retained], notes


def _compliance(robot: Robot, stiffness_nm_per_rad: float) -> Array:
    """Return equal compliances of the joints that bear the arm's weight (or would, if it had a mass)."""
    compliance = np.zeros(robot.chain.size)
    bearing = range(robot.chain.size) if robot.loads is None else robot.loads.bearing(rng_for(0, "structure"))
    compliance[[j for j in bearing if not robot.chain.prismatic[j]]] = 1 / stiffness_nm_per_rad
    return compliance


def _cost(
    robot: Robot, arm: SerialArm, values: Array, compliance: Array, mounting: Mounting, estimate: LoadEstimate
) -> UncertaintyCost:
    covariance = estimate.hand_load.covariance
    if not np.isfinite(covariance).all():
        return UncertaintyCost(compliance, float("nan"))
    joints = random_poses(robot.model, _COST_POSES, rng_for(0, "fresh"))
    errors_m = sag_uncertainty(arm, values, compliance, joints, mounting.gravity, covariance)
    return UncertaintyCost(compliance, float(np.sqrt((errors_m**2).mean())))


def _warnings(estimate: LoadEstimate, implausible: Sequence[Check]) -> list[str]:
    warnings = [f"not plausible: {phrase(check)}" for check in implausible]
    warnings += [phrase(check) for check in wild_sample(estimate)]
    if estimate.adequate is False:
        warnings.append(phrase(estimate.verdict))
    if estimate.physical is False:
        warnings.append("no body has these parameters (its pseudo-inertia is not positive definite): --physical")
    return warnings
