"""Draw the virtual arm of a campaign's options, and its poses."""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations, fit
from lab.calibration.guess import STATION_POINTS
from lab.calibration.most_likely import SAME_M
from lab.core.errors import LabError
from lab.core.limits import WAYPOINTS
from lab.core.measurements import Measurements, measured
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM, MRAD
from lab.formats.measurement_csv import read_measurements
from lab.kinematics.effects.effect import HOUR_S, ArmFacts
from lab.kinematics.effects.effect_registry import GROUPS
from lab.kinematics.gauge import STRUCTURE_POSES, base_set
from lab.kinematics.model import RigidArm
from lab.kinematics.serial.axes_to_dh import Truth
from lab.options.named_instruments import named_instrument
from lab.options.virtual_campaign import VirtualCampaign
from lab.robots.robot import Robot
from lab.sensors.sensor_registry import sensor_named
from lab.simulation.candidate_poses import refuse_idle_stations, seeing_station, station_columns, stations_in
from lab.simulation.collisions import collides, random_poses
from lab.simulation.effects import TrueEffects, random_conditions, random_effects
from lab.simulation.sampler import sampler_named
from lab.simulation.tracking import recorded
from lab.simulation.true_robot import GeometryErrors, TrueRobot, before_stations, random_tracker

__all__ = [
    "FRESH_POSES",
    "draw_conditions",
    "fresh_poses",
    "perturbed_arm",
    "poses_to_measure",
    "requested_conditions",
    "truth_of",
]

FRESH_POSES = 1000
_USUAL_HOURS = 1.0  # default duration of a campaign


def perturbed_arm(robot: Robot, options: VirtualCampaign) -> TrueRobot:
    """Draw the virtual arm of these options, before its tracker at all its stations, with its effects.

    Raises:
        LabError: an option makes no sense for the robot, or the sampler is unknown or draws no finite numbers.
    """
    arm = ArmFacts(robot.chain, robot.loads, sections=robot.link_compliances)
    effects = random_effects(arm, options.effects, rng_for(options.seed, "effects"))
    rngs = [rng_for(options.seed, "tracker", k) for k in range(1, len(robot.model.station_sites))]
    others = np.array([random_tracker(robot.model, rng, k) for k, rng in enumerate(rngs, start=1)])
    return before_stations(_geometry(robot, options).with_effects(effects), others)


def truth_of(real: TrueRobot, arm: RigidArm) -> Truth | None:
    """Return the true parameters, without effects, in the canonical gauge of identification.

    For a serial arm they are read off its joint axes. For a mechanism they are those of the gauge that give its exact
    positions: None if none do, as parameters fixed by the gauge are observable in an imperfect copy.
    """
    if (truth := real.truth(arm.targets)) is not None:
        return truth
    values = real.robot.values_before(arm, real.T_world_tracker)
    structure = base_set(arm, values)
    joints = arm.structure_joints(STRUCTURE_POSES, rng_for(0, "structure"))
    rigid = real.with_effects(TrueEffects.none(arm.chain.size))
    exact = measured(arm.chain.joint_names, joints, arm.targets, rigid.points(joints, arm.targets))
    found = fit(arm, Observations.unweighted(exact), structure.identifiable, values, tolerance_m=1e-12).values
    missed = np.nanmax(np.abs(arm.points(joints, found) - exact.points))
    return Truth(arm, found, structure) if missed < SAME_M else None


def _geometry(robot: Robot, options: VirtualCampaign) -> TrueRobot:
    T_world_tracker = random_tracker(robot.model, rng_for(options.seed, "tracker"))
    errors = GeometryErrors(
        position_sigma_m=MM.to_si(options.position_sigma_mm),
        rotation_sigma_rad=MRAD.to_si(options.rotation_sigma_mrad),
        joint_offset_sigma=MRAD.to_si(options.offset_sigma_mrad),
        table_alone=options.dh_only,
        sampler=sampler_named(options.sampler),
    )
    return robot.perturbed(errors, T_world_tracker, rng_for(options.seed, "arm"))


def poses_to_measure(robot: Robot, options: VirtualCampaign) -> tuple[Array, dict[str, Array], tuple[str, ...]]:
    """Return the poses to measure, of the plan or random ones without collisions, their conditions, and warnings.

    Raises:
        LabError: the plan has nothing to measure, a pose in collision, an empty condition, or a payload beside the
            option.
    """
    model = robot.model
    if options.plan is None:
        joints = random_poses(model, options.poses, rng_for(options.seed, "poses"))
        return joints, _station_columns(robot, options, _seeing(robot, options, joints)), ()
    chain = robot.chain
    plan = read_measurements(options.plan, chain.joint_names, chain.prismatic, points=False, most=WAYPOINTS)
    plan = plan.only("calibrate")
    if not len(plan):
        raise LabError(f"{options.plan}: no row has use = calibrate; mark some")
    joints = plan.joints
    robot.refuse_beyond_limits(options.plan, plan, 1e-9)
    robot.refuse_impossible(options.plan, plan)
    hit = collides(model, joints)
    if hit.any():
        row = plan.where(int(np.argmax(hit)))
        raise LabError(f"{options.plan}: {row}: the arm collides in this pose; take it out of the plan")
    if "payload_kg" in plan.conditions and any(options.effects.payload_kg):
        raise LabError(f"{options.plan}: has a column payload_kg, and --payload-kg is given too; keep one")
    set_there = _station_columns(robot, options, stations_in(options.plan, plan, model))
    notes = list(plan.warnings)
    for name, column in plan.conditions.items():
        if (empty := np.isnan(column)).any():
            raise LabError(f"{options.plan}: {plan.where(int(np.argmax(empty)))}, column {name}: empty; fill it in")
        started = column[0] if name == "time_s" else 0.0  # the virtual arm's clock starts when the plan does
        set_there[name] = column - started
    if any(plan.sessions):
        notes.append(f"{options.plan}: the column session is passed over: only a bump makes sessions of a virtual arm")
    return joints, set_there, tuple(notes)


def _seeing(robot: Robot, options: VirtualCampaign, joints: Array) -> NDArray[np.int_]:
    """Return the best station ``(n,)``, from 0, of each of random poses ``(n, joints)``; in turn where none is."""
    if len(robot.model.stations) < 2:
        return np.zeros(len(joints), dtype=np.int_)
    best = seeing_station(robot.model, options.targets, named_instrument(options.instrument))(joints)
    return np.where(best >= 0, best, np.arange(len(joints)) % len(robot.model.stations))


def _station_columns(robot: Robot, options: VirtualCampaign, stations: NDArray[np.int_]) -> dict[str, Array]:
    """Return the conditions of poses measured from these stations, from 0; empty if no instrument frame is observed."""
    if not sensor_named(options.observe).in_instrument_frame:
        return {}
    refuse_idle_stations(robot.model, stations, STATION_POINTS)
    return station_columns(robot.model, stations)


def requested_conditions(robot: Robot, options: VirtualCampaign) -> tuple[str, ...]:
    """Return the conditions to record at each pose: those that the model may request and those that options set."""
    groups = (*(GROUPS if options.fitting.searched else ()), *options.fitting.groups)
    requested: dict[str, None] = {}
    for group in groups:
        with suppress(LabError):  # an impossible group is refused when it is fitted
            requested |= dict.fromkeys(robot.arm_with(options.targets, [group]).conditions)
    if any(options.effects.payload_kg):
        requested["payload_kg"] = None
    if options.effects.hours is not None:
        requested["time_s"] = None
    return tuple(requested)


def draw_conditions(
    real: TrueRobot, options: VirtualCampaign, poses: int, rng: np.random.Generator, requested: Sequence[str]
) -> dict[str, Array]:
    """Draw the conditions of each of so many poses of a campaign."""
    hours = _USUAL_HOURS if options.effects.hours is None else options.effects.hours
    chain, loads = real.robot.chain, options.effects.payload_kg
    return random_conditions(chain, real.effects, poses, rng, loads, hours * HOUR_S, requested)


def fresh_poses(
    real: TrueRobot, options: VirtualCampaign, requested: Sequence[str], joints: Array | None = None
) -> Measurements:
    """Simulate the real arm's targets at poses that were never measured, with conditions of their own.

    Args:
        joints: ``(n, joints)`` of these poses; random ones, if not given.
    """
    rng = rng_for(options.seed, "fresh")
    poses = random_poses(real.robot, FRESH_POSES, rng) if joints is None else joints
    conditions = draw_conditions(real, options, len(poses), rng, requested)
    return recorded(real, poses, options.targets, real.points(poses, options.targets, conditions), conditions)
