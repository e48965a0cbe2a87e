"""Set up the design problem of a measurement session: candidates, what is read there, and what it is to identify."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.limits import WAYPOINTS
from lab.core.measurements import STATION
from lab.core.progress import Progress, no_progress
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import joints_to_si
from lab.formats.measurement_csv import read_measurements
from lab.kinematics.effects.arm_with_effects import Arm, ArmWithEffects
from lab.kinematics.effects.effect import PAYLOAD, SessionInfo
from lab.kinematics.effects.sessions import station_parameters
from lab.kinematics.gauge import BaseSet, base_set
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import Model, RigidArm
from lab.kinematics.parameter import Parameter, indices_of_groups
from lab.noise.instruments import Instrument, observing
from lab.options.named_instruments import named_instrument
from lab.options.option_groups import Fitting
from lab.options.virtual_campaign import DesignOptions
from lab.planning.pose_inputs import PointDerivatives, carrying, feasible_inputs, inputs_of, station_of, with_stations
from lab.planning.reachability import ReachabilityGraph, free_home, reachability
from lab.planning.task_poses import TEST_POSES, task_poses
from lab.pose_selection.criteria import CRITERIA, Criterion, DesignTask, Scaling, criterion
from lab.pose_selection.exchange import Feasible, Sensitivity, information
from lab.pose_selection.own_criterion import prepared
from lab.prediction.regions import without_columns
from lab.prediction.task_region import task_region
from lab.robots.load_robot import load_virtual
from lab.robots.robot import Robot
from lab.sensors.sensor_options import FitInputs, SensorOptions
from lab.sensors.sensor_registry import configured_sensor
from lab.sensors.virtual_sensor import PlannedReadings
from lab.simulation.candidate_poses import (
    Candidates,
    draw_candidates,
    stations_in,
)
from lab.simulation.collisions import LOWER_CLEARANCE, describe_collisions, random_poses, unchecked
from lab.simulation.free_path import planning_model
from lab.simulation.robot_model import RobotModel

__all__ = ["PoseProblem", "pose_problem"]

_MEASURED_SLACK = 1e-3  # rad or m: allowed excess of joint positions over a data sheet's limits


@dataclass(frozen=True)
class PoseProblem:
    """A planning problem, from which designs of any size are chosen.

    Inputs are joint positions, for an instrument with several stations an indicator column (1 or 0)
    of each station but the first, and, if payloads are given, a column of the payload (kg).

    Attributes:
        values: nominal parameters ``(p,)``, with the base before the nominal tracker.
        seen: the arm with the effects of the stations and of the model; its parameters begin with those of
            ``arm``.
        inputs: ``(m, joints + stations - 1 + payload)`` of the candidates.
        payloads: ``(l,)`` kg, of which each pose carries one; none if they are not given.
        pool: ``(m, r, f)`` scaled sensitivities of the candidates.
        sensitivity: from inputs to such sensitivities, in the units of the scaling, for the criterion.
        task: what a criterion may need of it.
        goal: the criterion.
        before: ``(n0, r, f)`` sensitivities at the poses measured before.
        whitened: from inputs to Jacobians ``(n, r, f)`` of the base set in standard deviations of the noise.
        test: ``(t, 3, f)`` m, Jacobians of the targets at the poses where the error is predicted.
        already: ``(n0, joints + stations - 1 + payload)``, poses measured before.
        planned: what a sensor reads, whose readings come and go with the poses; None for measured points.
        access: the collision-free paths between the poses; None after pickling or copying, because it is too large;
            ``pool`` is then computed again.
    """

    robot: Robot
    arm: RigidArm
    seen: Model
    structure: BaseSet
    values: Array
    candidates: Candidates
    inputs: Array
    payloads: Array
    pool: Array
    sensitivity: Sensitivity
    task: DesignTask
    goal: Criterion
    before: Array
    whitened: Sensitivity
    test: Array
    scaling: Scaling
    access: ReachabilityGraph = field(compare=False)
    already: Array
    warnings: tuple[str, ...]
    planned: PlannedReadings | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "access": None, "pool": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, pool=state["sensitivity"](state["inputs"]))

    @property
    def measured(self) -> Array | None:
        """Information ``(f, f)`` of the poses measured before, in the criterion's scaling; None without any."""
        return information(self.before) if len(self.before) else None

    def station(self, inputs: Array) -> NDArray[np.int_]:
        """Return the station ``(n,)``, from 0, of each of these inputs."""
        size = self.arm.chain.size
        return station_of(inputs[:, size : size + len(self.robot.model.station_sites) - 1])

    def payload(self, inputs: Array) -> Array:
        """Return the payload ``(n,)`` kg of each of these inputs; zero if none are given."""
        return inputs[:, -1] if len(self.payloads) else np.zeros(len(inputs))


@dataclass(frozen=True)
class _Readings:
    """What is read at a pose, where, and how it depends on the parameters.

    Attributes:
        model: of the robot, to plan with.
        seen: the arm with what it is measured by; ``structure``: its base set of f parameters.
        candidates: feasible poses, and ``inputs`` ``(m, c)`` theirs.
        jacobians: from inputs to derivatives ``(n, r, f)`` in the scaling's unit of readings.
        whitened: from inputs to derivatives in standard deviations of the noise.
        test: ``(t, 3, f)`` m, derivatives of positions where the error is predicted.
        feasible: test of inputs.
        already: ``(n0, c)`` inputs of the poses measured before.
    """

    model: RobotModel
    seen: Model
    structure: BaseSet
    candidates: Candidates
    inputs: Array
    jacobians: Sensitivity
    whitened: Sensitivity
    test: Array
    feasible: Feasible
    already: Array
    planned: PlannedReadings | None = None
    warnings: tuple[str, ...] = ()


def pose_problem(options: DesignOptions, robot: Robot | None = None, progress: Progress = no_progress) -> PoseProblem:
    """Load the arm, draw candidates, and set up what a design needs.

    Args:
        progress: called with the number of candidates found.

    Raises:
        LabError: the robot, instrument, targets, model or criterion cannot be used, or hardly a pose is feasible.
    """
    robot = load_virtual(options.robot, options.cell) if robot is None else load_virtual(robot)
    if options.no_check:
        robot = replace(robot, model=unchecked(robot.model))
    arm, scaling = robot.arm(options.targets), Scaling(options.scaling)
    values = robot.model.values_before(arm, robot.model.T_world_tracker)
    read = _points if options.observe == "points" else _sensor_readings
    readings = read(options, robot, arm, values, scaling, progress)
    # The base set in the units of the scaling.
    parameters = [readings.seen.parameters[i] for i in readings.structure.identifiable]
    pool = readings.jacobians(readings.inputs)
    factors = scaling.columns(parameters, pool)
    before = readings.jacobians(readings.already) if len(readings.already) else np.empty((0, *pool.shape[1:]))
    task = _design_task(scaling, parameters, pool, readings.test)
    # The graph of free paths, from home.
    joints = readings.candidates.joints
    home, warnings = _home(options, robot.chain, readings.model, joints)
    return PoseProblem(
        robot=robot,
        arm=arm,
        seen=readings.seen,
        structure=readings.structure,
        values=values,
        candidates=readings.candidates,
        inputs=readings.inputs,
        payloads=np.array(options.payload_kg),
        pool=pool * factors,
        sensitivity=partial(_scaled, readings.jacobians, factors),
        task=task,
        goal=_goal(options, task, pool * factors, before * factors),
        before=before * factors,
        whitened=readings.whitened,
        test=readings.test,
        scaling=scaling,
        access=reachability(readings.model, home, joints, readings.feasible),
        already=readings.already,
        warnings=(*robot.warnings, *warnings, *_unchecked(options), *readings.warnings),
        planned=readings.planned,
    )


def _points(
    options: DesignOptions, robot: Robot, arm: RigidArm, values: Array, scaling: Scaling, progress: Progress
) -> _Readings:
    """Set up measured points of the tool.

    Raises:
        LabError: the instrument, a target, the model or the region cannot be used, or hardly a pose is feasible.
    """
    device = _noisy(options.instrument)
    robot.refuse_unknown(options.targets)
    model = planning_model(robot.model, options.targets, device, options.clearances)
    seen, structure, nominal = _model(options, robot, model)
    region = task_region(options.region)
    points = region.points(arm.T_tracker_frame0(values), robot.chain.joint_names, robot.chain.prismatic)
    # Candidates, each with its best station and each payload.
    rng = rng_for(options.seed, "candidates")
    candidates = draw_candidates(model, options.targets, device, options.candidates, rng, progress)
    payloads = np.array(options.payload_kg)
    inputs = carrying(with_stations(options, model, device, candidates.joints), payloads)
    # Poses where the error is predicted, the payloads in turn.
    poses, missed = task_poses(options, region, points, robot, arm, values, candidates.joints)
    test_inputs = inputs_of(model, poses)
    if len(payloads):
        test_inputs = np.column_stack([test_inputs, np.resize(payloads, len(poses))])
    retained = structure.identifiable
    derivatives = PointDerivatives(seen, nominal, retained, device, options.payload_kg)
    return _Readings(
        model=model,
        seen=seen,
        structure=structure,
        candidates=candidates,
        inputs=inputs,
        jacobians=derivatives.whitened if scaling.kind == "whitened" else derivatives.unweighted,
        whitened=derivatives.whitened,
        test=derivatives.unweighted(test_inputs).reshape(-1, 3, len(retained)),  # every target counts
        feasible=feasible_inputs(model, options.targets, device),
        already=_measured_before(options, robot),
        warnings=missed,
    )


def _sensor_readings(
    options: DesignOptions, robot: Robot, arm: RigidArm, values: Array, scaling: Scaling, progress: Progress
) -> _Readings:
    """Set up a sensor that says what it reads at a pose, and where it reads anything.

    Raises:
        LabError: the sensor cannot be used, or hardly a pose is feasible.
    """
    if robot.model.stations:
        raise LabError(f"--observe {options.observe}: stations of a cell are of an instrument; leave them out")
    sensor = configured_sensor(options.observe, SensorOptions(cameras=options.cameras), FitInputs())
    model = planning_model(robot.model, (), named_instrument("exact"), options.clearances)
    planned = sensor.planned(model)
    rng = rng_for(options.seed, "candidates")
    candidates = draw_candidates(
        model, (), named_instrument("exact"), options.candidates, rng, progress, sees=planned.sees
    )
    seen = planned.near(candidates.joints)
    structure = base_set(seen, planned.values)
    readings = partial(planned.readings, retained=structure.identifiable)
    fresh = random_poses(model, TEST_POSES, rng_for(options.seed, "fresh"))
    return _Readings(
        model=model,
        seen=seen,
        structure=structure,
        candidates=candidates,
        inputs=candidates.joints,
        jacobians=readings,
        whitened=readings,
        test=_placed_anew(arm, fresh, values, structure.identifiable),
        feasible=planned.sees,
        already=np.empty((0, robot.chain.size)),
        planned=planned,
    )


def _placed_anew(arm: RigidArm, joints: Array, values: Array, retained: tuple[int, ...]) -> Array:
    """Return derivatives ``(t, 3, f)`` m of points, with base and tool placed anew, at poses ``(n, joints)``.

    Args:
        retained: f parameters, of which those after the arm's move no point.
    """
    jacobian = arm.observe(joints, values)[1].reshape(-1, 3, len(arm.names))
    own = [i for i in retained if i < len(arm.names)]
    placing = jacobian[..., list(indices_of_groups(arm.parameters, ["base", "tool"]))]
    derivatives = np.zeros((*jacobian.shape[:2], len(retained)))
    derivatives[..., : len(own)] = without_columns(jacobian[..., own], placing)
    return derivatives


_TEST_SCORED = 100  # test positions, at most, of criteria G and I


def _model(options: DesignOptions, robot: Robot, model: RobotModel) -> tuple[Arm, BaseSet, Array]:
    """Return the arm with the effects of the stations and of the model, its base set, and its nominal parameters.

    Raises:
        LabError: the robot cannot have the model, a pose needs more than a payload for it, or it feels no payload.
    """
    name = options.model
    seen = robot.arm_with(options.targets, Fitting(model=name).groups, SessionInfo(stations=model.stations))
    needed = [each for each in seen.conditions if each != PAYLOAD and not each.startswith(STATION)]
    if needed:
        raise LabError(
            f"--model {name}: needs {needed[0]} at each pose, which a design does not choose; leave the group out"
        )
    stations = np.concatenate([np.empty(0), *station_parameters(model.Ts_world_station)])
    effects = seen.effects[1 if len(stations) else 0 :] if isinstance(seen, ArmWithEffects) else ()
    typical = [np.array(each.typical or (0.0,) * len(each.parameters)) for each in effects]
    further = np.concatenate([stations, *typical])
    nominal = np.concatenate([model.values_before(seen.rigid, model.T_world_tracker), further])
    if options.payload_kg and PAYLOAD not in seen.conditions:
        raise LabError(f"--payload-kg: no payload matters to --model {name}; add a group such as compliance")
    return seen, base_set(seen, nominal), nominal


def _goal(options: DesignOptions, task: DesignTask, pool: Array, before: Array) -> Criterion:
    """Return the criterion: the lab's, or a user's that is prepared for the task.

    Args:
        pool: ``(m, r, f)`` scaled sensitivities of the candidates, ``before`` those of the poses measured before.
    """
    goal = criterion(options.criterion, len(task.parameters), task.jacobians)
    if goal.name in CRITERIA:
        return goal
    return prepared(goal, task, pool, information(before))


def _design_task(scaling: Scaling, parameters: Sequence[Parameter], pool: Array, test: Array) -> DesignTask:
    """Return what a criterion needs, of sensitivities ``(m, r, f)`` and Jacobians ``(t, 3, f)`` in SI units."""
    units = scaling.units(parameters, pool)
    some = test[:: -(-len(test) // _TEST_SCORED)]
    return DesignTask(tuple(parameters), units, scaling.tolerances(parameters), some * units)


def _scaled(jacobians: Sensitivity, factors: Array, inputs: Array) -> Array:
    return np.asarray(jacobians(inputs) * factors)


def _unchecked(options: DesignOptions) -> tuple[str, ...]:
    return ("nothing was checked for collisions: --no-check",) if options.no_check else ()


def _noisy(name: str) -> Instrument:
    device = observing(named_instrument(name), "points")
    if device.kind == "exact":
        raise LabError("instrument 'exact' has no noise, so every design is as good: choose another instrument")
    return device


def _home(
    options: DesignOptions, chain: JointSpec, model: RobotModel, candidates: Array
) -> tuple[Array, tuple[str, ...]]:
    """Return the requested home; else the robot's home, or a near pose if the arm collides there."""
    if options.home:
        return _home_option(options.home, chain, model), ()
    home = free_home(model, candidates)
    if np.array_equal(home, chain.home):
        return home, ()
    touches = describe_collisions(model, chain.home[None])[0]
    if chain.given_home is not None:
        raise LabError(f"[home] of the cell: {touches} there; start elsewhere, or {LOWER_CLEARANCE}")
    return home, (f"robot {chain.name} at home: {touches}; the tour starts from a pose near it",)


def _home_option(requested: Sequence[float], chain: JointSpec, model: RobotModel) -> Array:
    text = f"--home {','.join(f'{number:g}' for number in requested)}"
    if len(requested) != chain.size or not np.isfinite(requested).all():
        raise LabError(f"{text}: give one finite number for each of {', '.join(chain.joint_names)}")
    home = joints_to_si(np.array(requested), chain.prismatic)
    if (beyond := np.flatnonzero(chain.beyond_limits(home[None], 1e-9)[0])).size:
        raise LabError(f"{text}: {chain.limit_note(int(beyond[0]), home[beyond[0]])}; start within")
    if why := chain.infeasibility_reason(home):
        raise LabError(f"{text}: {why}; start elsewhere")
    if touches := describe_collisions(model, home[None])[0]:
        raise LabError(f"{text}: {touches} there; start elsewhere, or {LOWER_CLEARANCE}")
    return home


def _measured_before(options: DesignOptions, robot: Robot) -> Array:
    """Return poses ``(n0, joints)`` of the file to extend: fully measured ones, or all of a plan not yet measured."""
    chain, carried = robot.chain, bool(options.payload_kg)
    if options.extend is None:
        return inputs_of(robot.model, np.empty((0, chain.size + carried)))
    plan = read_measurements(options.extend, chain.joint_names, chain.prismatic, points=False, most=WAYPOINTS)
    rows = plan.only("calibrate")
    robot.refuse_beyond_limits(options.extend, rows, _MEASURED_SLACK)
    robot.refuse_impossible(options.extend, rows)
    measured = rows.seen.all(axis=1)
    rows = rows[measured] if measured.any() else rows
    if not len(rows):
        raise LabError(f"{options.extend}: no row has use = calibrate; mark some, or leave --extend out")
    inputs = inputs_of(robot.model, rows.joints, stations_in(options.extend, rows, robot.model))
    masses = rows.inputs((PAYLOAD,))[:, -1]
    if not carried:
        if masses.any() and Fitting(model=options.model).groups:
            raise LabError(f"{options.extend}: has payloads; give them with --payload-kg too")
        return inputs
    if (other := np.flatnonzero(~np.isin(masses, options.payload_kg))).size:
        listed = ",".join(f"{each:g}" for each in options.payload_kg)
        raise LabError(
            f"{options.extend}: {rows.where(int(other[0]))}: payload_kg {masses[other[0]]:g} is none of --payload-kg "
            f"{listed}; add it there"
        )
    return np.column_stack([inputs, masses])
