"""Run ``lab dynamics``: find an arm's base parameters, and identify them from a file."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lab.core.checks import Check
from lab.core.errors import LabError, error_context
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.dynamics.arm.base_parameters import base_parameters
from lab.extensions.dynamics.arm.dynamics_result import DynamicsResult, SimulatedSession
from lab.extensions.dynamics.arm.identify_dynamics import (
    DynamicModel,
    DynamicsEstimate,
    identify_dynamics,
    nearest_physical_arm,
)
from lab.extensions.dynamics.arm_simulation import drawn_mounting
from lab.extensions.dynamics.dynamics_options import DynamicsOptions
from lab.extensions.dynamics.dynamics_phrases import phrase
from lab.extensions.dynamics.dynamics_plausibility import ArmSize, implausible_dynamics, stuck_channels
from lab.extensions.dynamics.load_files import PayloadSamples, read_load, read_motion, read_mounting
from lab.extensions.dynamics.simulated_session import MeasuringBench, simulated_load
from lab.formats.drives_toml import Drives, drives_in, read_drives
from lab.formats.structured import read_toml
from lab.kinematics.dynamics.rigid_body import LOAD, ArmDynamics, khalil_chain
from lab.options.call_options import options_of, takes
from lab.robots.load_robot import load_robot, load_virtual, robot_of_call
from lab.robots.robot import Robot
from lab.simulation.load_model import link_inertias

__all__ = ["dynamics"]

_MAX_NAMED = 8  # base parameters in a warning


@takes(DynamicsOptions)
def dynamics(
    file: str | Path | DynamicsOptions | None = None, robot: str | Path | Robot | None = None, **options: Any
) -> DynamicsResult:
    """Identify the dynamic parameters of an arm; without a file, say which ones its torques determine.

    Args:
        file: a motion: joint positions with torques or motor currents, with a payload, without, or both; or all
            options in one object.
        robot: the nominal model: a name, a path, or a loaded robot; needed with a file, else ``irb120``.
        options: those of ``lab dynamics``, by name: ``drives``, ``validate``, ``without`` and so on.

    Returns:
        The base parameters, as formulas of the standard ones, with their values and intervals where there is a file.

    Raises:
        LabError: the robot has loops, or the file lacks what is needed.

    Example:
        >>> import lab
        >>> lab.dynamics(robot="course2r").to_dict()["formulas"]["XXR2"]
        'XX2 − YY2'
    """
    if isinstance(file, DynamicsOptions):
        file.check()
        return _identified(file, load_virtual(file.robot) if file.rehearsal.simulate else load_robot(file.robot))
    nominal = robot_of_call("lab.dynamics", file, robot)
    given = {"file": None if file is None else str(file), "robot": nominal.source, **options}
    requested = options_of("lab.dynamics", DynamicsOptions, given)
    requested.check()
    return _identified(requested, load_virtual(nominal) if requested.rehearsal.simulate else nominal)


def _identified(options: DynamicsOptions, robot: Robot) -> DynamicsResult:
    model, left_out = robot.serial_model, set(options.without)
    drives = _drives(options, robot)
    mounting = drawn_mounting(model) if options.sensor is None else read_mounting(options.sensor, sensor=False)
    arm = ArmDynamics(
        khalil_chain(model.chain),
        mounting.gravity,
        np.eye(model.chain.size) if drives is None else drives.couplings,
        motor_inertia="motor-inertia" not in left_out,
        friction="friction" not in left_out,
        offsets="offsets" not in left_out,
        distal=model.chain.convention == "distal",
    )
    base = base_parameters(arm, rng_for(0, "structure"))
    described = DynamicsResult(options, robot, arm, base, drives, None, None, None, None, tuple(robot.warnings))
    if options.rehearsal.simulate:
        session = _simulated(described)
        return _measured(replace(described, session=session), session.samples, session.other)
    if options.file is None:
        return described
    other = None if options.validate is None else _read(robot, options.validate, drives)
    return _measured(described, _read(robot, options.file, drives), other)


def _drives(options: DynamicsOptions, robot: Robot) -> Drives | None:
    """Return the drives by ``--drives`` or by the robot's table; None where neither gives them."""
    size, path = robot.serial_model.chain.size, robot.model.path
    if options.drives is not None:
        return read_drives(options.drives, size)
    return drives_in(path, read_toml(path), size) if path.suffix == ".toml" else None


def _simulated(described: DynamicsResult) -> SimulatedSession:
    """Simulate a measurement session: the designed path and another one, with the load if requested."""
    robot, session, base = described.robot, described.options.rehearsal, described.base
    load = None if session.payload_kg is None else simulated_load(session.payload_kg, session)
    bench = MeasuringBench(robot, session, load, described.arm.couplings)
    model = DynamicModel(robot.serial_model.chain, described.arm, base)

    def regressor(joints: Array, speeds: Array, accelerations: Array) -> Array:
        return model.columns(joints, speeds, accelerations)[..., len(LOAD) :]

    samples = bench.driven(bench.designed(regressor), 0)
    other = replace(bench, load=None).driven(bench.another(), 1)
    others = {name: value for name, value in bench.truth().items() if name in base.names}
    truth = base.projection @ described.arm.standard(link_inertias(robot.serial_model), others)
    return SimulatedSession(samples, other, truth, None if load is None else load.phi)


def _measured(described: DynamicsResult, samples: PayloadSamples, other: PayloadSamples | None) -> DynamicsResult:
    options, robot = described.options, described.robot
    file = options.file or "--simulate"
    load = None if options.load is None else _carried_load(options.load, samples, file)
    model = DynamicModel(robot.serial_model.chain, described.arm, described.base)
    with error_context(file), np.errstate(all="ignore"):  # numbers of a nonsensical file may overflow
        estimate = identify_dynamics(
            model, samples, given_load=load, delay=options.delay, holdout=options.holdout, other=other,
            band_hz=options.band_hz,
        )  # fmt: skip
        if not estimate.identified.any():
            raise LabError("nothing of the arm shows: move its joints, several at a time")
    links = None if robot.loads is None else link_inertias(robot.serial_model)
    whole = bool(estimate.identified.all())
    if options.physical and not whole:
        raise LabError("--physical: not every base parameter is identified; move more joints, or leave it out")
    physical = nearest_physical_arm(model, estimate, links) if whole else None
    size = ArmSize.of(robot.serial_model.chain, robot.loads)
    nominal = None if links is None else model.base.projection @ model.arm.standard(links, {})
    names = [f"the torque of {name}" for name in robot.chain.joint_names]
    stuck = stuck_channels(replace(samples, wrench=None), names, np.ones(robot.chain.size, dtype=np.bool_))
    implausible = (*stuck, *implausible_dynamics(estimate, model, size, nominal, physical))
    return replace(
        described,
        samples=samples,
        estimate=estimate,
        physical=physical,
        warnings=(*described.warnings, *samples.warnings, *_warnings(estimate, implausible)),
        implausible=implausible,
    )


def _carried_load(path: Path, samples: PayloadSamples, file: Path | str) -> Array:
    """Read the load of a path's loaded run."""
    load = read_load(path)
    if not samples.loaded.any():
        raise LabError(f"--load {path}: no row of {file} has run = loaded; mark those that carry it")
    return load


def _read(robot: Robot, file: Path, drives: Drives | None) -> PayloadSamples:
    """Read a motion, with motor currents converted to the drives' torques."""
    chain = robot.chain
    samples = read_motion(file, chain.joint_names, chain.prismatic, (chain.lower, chain.upper), drives)
    assert samples.torques is not None
    if not samples.currents:
        return samples
    if drives is None:
        raise LabError(f"{file}: motor currents need gear ratios and drive gains; give --drives FILE.toml")
    torques: Array = drives.torques(samples.torques)
    return replace(samples, torques=torques, currents=False)


def _warnings(estimate: DynamicsEstimate, implausible: Sequence[Check]) -> list[str]:
    warnings = [f"not plausible: {phrase(check)}" for check in implausible]
    if estimate.adequate is False:
        warnings.append(phrase(estimate.verdict))
    hidden = [name for name, seen in zip(estimate.names, estimate.identified, strict=True) if not seen]
    if hidden:
        more = f" and {len(hidden) - _MAX_NAMED} more" if len(hidden) > _MAX_NAMED else ""
        named = ", ".join(hidden[:_MAX_NAMED])
        warnings.append(f"the motion does not show {named}{more}: move more joints at a time, and faster")
    return warnings
