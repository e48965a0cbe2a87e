"""What a robot that is known misses along a motion: of a run, or of a description with elastic links."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lab.campaign.robot import Robot
from lab.commands.calibrate.load_run import CalibrationRun
from lab.commands.hand_load import carrying
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.robotics.trajectory.elastic import Tracking, tracking
from lab.extensions.robotics.trajectory.options import TrajectoryOptions
from lab.kinematics.dynamics.beam import COMPLIANCES
from lab.kinematics.effects.arm import Arm
from lab.kinematics.effects.conditions import PAYLOAD, absent, approach_of, last_move_of, rates_of
from lab.render.phrases.models import listed

__all__ = ["TrackedArm", "tracked_arm", "tracking_along", "tracking_warnings"]

_GROUPS = ("bending", "torsion", "extension")
_BENT = (".ei_y", ".ei_z", ".gj")
_FAR_RAD = np.deg2rad(1.0)  # of a correction of a joint: near a singularity
_LEFT = 1e-8  # m, rad


@dataclass(frozen=True)
class TrackedArm:
    """An arm whose errors along a motion are known.

    Attributes:
        arm: in motion, with its effects.
        values: its parameters ``(p,)``.
        nominal: ``(g,)`` of its geometry, as the controller has it.
        payload_kg: carried all the way.
        warnings: what a reader should be told.
    """

    arm: Arm
    values: Array
    nominal: Array
    payload_kg: float
    warnings: tuple[str, ...]


def tracked_arm(options: TrajectoryOptions, robot: Robot, run: CalibrationRun | None) -> TrackedArm | None:
    """The arm of a run, else the nominal one with the elastic links of its description; None where it is rigid.

    Raises:
        LabError: a payload is given, but nothing bends under it.
    """
    if run is not None:
        return _of_run(options, run)
    robot, load = carrying(robot, options.load, accept_edited=options.accept_edited)
    sections = robot.link_compliances
    if sections is None:
        if options.payload_kg is not None or options.load is not None:
            flag = "--load" if options.payload_kg is None else "--payload-kg"
            raise LabError(
                f"{flag}: nothing bends robot {robot.name} here; give --run, or a robot with [[link]] sections"
            )
        return None
    known = {
        f"link{link + 1}.{symbol}": float(sections[link, i])
        for link in range(len(sections))
        for i, symbol in enumerate(COMPLIANCES)
    }
    arm = robot.arm_with(("p1",), _GROUPS, moving=True)
    values = arm.nominal({"p1": options.tool_m})
    values[len(arm.rigid.names) :] = [known[name] for name in arm.names[len(arm.rigid.names) :]]
    payload = (0.0 if load is None else load.mass_kg) if options.payload_kg is None else options.payload_kg
    return TrackedArm(arm, values, values[: len(arm.rigid.names)], payload, ())


def _of_run(options: TrajectoryOptions, run: CalibrationRun) -> TrackedArm:
    arm = run.robot.arm_with(run.estimate.arm.targets, run.estimate.groups, moving=True)
    hung = 0.0 if run.load is None else run.load.mass_kg
    payload, said = hung if options.payload_kg is None else options.payload_kg, list(run.warnings)
    if payload and PAYLOAD not in arm.conditions:
        said.append(f"{payload:.4g} kg make no difference: the model of {run.folder} has nothing that gives way")
    hidden = [name for name in arm.names if name.endswith(_BENT) and name not in run.estimate.free_names]
    if hidden:
        said.append(
            f"{', '.join(hidden)} did not show at rest and is zero here, though inertia may load it; links that are "
            "round tubes of metal are identified whole by --model tubes"
        )
    unmoved = [name for name in run.estimate.groups if ".gravity" in name]
    if unmoved:
        said.append(f"{', '.join(listed(unmoved))} gives way to unknown masses, whose inertia is left out")
    return TrackedArm(arm, run.estimate.values, run.estimate.nominal[: len(arm.rigid.names)], payload, tuple(said))


def tracking_along(tracked: TrackedArm, joints: Array, speeds: Array, accelerations: Array, times: Array) -> Tracking:
    """Errors and correction at k times of a motion, by its joints ``(k, n)`` and their rates."""
    names = tracked.arm.rigid.chain.joint_names
    columns = dict(zip(rates_of(names), np.concatenate([speeds, accelerations], axis=1).T, strict=True))
    for told in (approach_of, last_move_of):
        columns |= {told(name): np.sign(column) for name, column in zip(names, speeds.T, strict=True)}
    columns |= {PAYLOAD: np.full(len(times), tracked.payload_kg)}
    rest = [columns.get(name, absent(name, len(times))) for name in tracked.arm.conditions]
    stacked = np.stack(rest, axis=1) if rest else np.empty((len(times), 0))
    wanted = tracked.arm.rigid.tool(joints, tracked.nominal)
    return tracking(tracked.arm, tracked.values, wanted, joints, stacked, 0)


def tracking_warnings(tracked: TrackedArm, found: Tracking, joints: Array) -> Sequence[str]:
    """What of the correction cannot be believed or made."""
    chain, corrected = tracked.arm.rigid.chain, found.corrected
    said, times = list(tracked.warnings), len(joints)
    left = np.abs(corrected.left[:, corrected.made]).max(axis=1) > _LEFT
    if left.any():
        said.append(f"at {int(left.sum())} of {times} times the correction does not settle: the arm is singular there")
    far = (np.abs(corrected.joints - joints)[:, ~np.array(chain.prismatic)] > _FAR_RAD).any(axis=1) & ~left
    if far.any():
        said.append(f"at {int(far.sum())} of {times} times a joint is corrected by more than 1°: near a singularity")
    beyond = chain.beyond_limits(corrected.joints, 1e-9).any(axis=1)
    if beyond.any():
        said.append(f"at {int(beyond.sum())} of {times} times corrected joint positions are beyond their limits")
    return said
