"""Set up and solve the design problem of a measurement session: candidates, sensitivities, reachability."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.calibration.stations import STATION_POINTS
from lab.core.errors import LabError
from lab.core.limits import WAYPOINTS
from lab.core.linear_model import whitening
from lab.core.measurements import STATION
from lab.core.progress import Progress, Stage, no_progress, no_stage
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM, joints_to_si
from lab.formats.measurement_csv import read_measurements
from lab.kinematics.effects.arm_with_effects import Arm, ArmWithEffects
from lab.kinematics.effects.effect import PAYLOAD, SessionInfo
from lab.kinematics.effects.sessions import station_parameters
from lab.kinematics.gauge import BaseSet, base_set
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import Model, RigidArm
from lab.kinematics.parameter import Parameter, indices_of_groups
from lab.noise.instruments import Instrument, is_isotropic, observing
from lab.options.named_instruments import named_instrument
from lab.options.option_groups import Fitting
from lab.options.virtual_campaign import DesignOptions
from lab.pose_selection.criteria import CRITERIA, Criterion, DesignTask, Scaling, criterion, is_singular
from lab.pose_selection.exchange import (
    Design,
    Feasible,
    OneCriterion,
    Sensitivity,
    climb,
    exchange,
    information,
)
from lab.pose_selection.own_criterion import prepared
from lab.pose_selection.tour import FreePath, fastest_path
from lab.prediction.regions import region_of_points, without_columns
from lab.prediction.task_region import TaskRegion, task_region
from lab.robots.load_robot import load_virtual
from lab.robots.robot import Robot
from lab.sensors.sensor_options import FitInputs, SensorOptions
from lab.sensors.sensor_registry import configured_sensor
from lab.sensors.virtual_sensor import PlannedReadings
from lab.simulation.candidate_poses import (
    MARGIN,
    Candidates,
    draw_candidates,
    feasibility,
    refuse_idle_stations,
    seeing_station,
    stations_in,
)
from lab.simulation.collisions import LOWER_CLEARANCE, collides, describe_collisions, random_poses, unchecked
from lab.simulation.free_path import path_check, planning_model
from lab.simulation.robot_model import RobotModel

__all__ = [
    "HUBS",
    "PoseProblem",
    "ReachabilityGraph",
    "best_design",
    "exchanged",
    "free_home",
    "pose_problem",
    "reachability",
    "refusals",
    "waypoints_in_order",
]

HUBS = 20  # candidates tried as waypoints to others


@dataclass(frozen=True)
class ReachabilityGraph:
    """Collision-free poses of the arm and the paths between them.

    Inputs are joint positions, with further columns, if any, on how a pose is measured.

    Attributes:
        hubs: ``(h, joints)``, home (zero joint positions, or the nearest pose without contact) and poses with a
            free path to it.
        free: whether the joint path between two poses is free of collisions.
        reachable: whether a free path leads from a hub to inputs ``(n, joints + further)``.
        feasible: whether they are feasible as well.
    """

    hubs: Array
    free: FreePath
    reachable: Feasible
    feasible: Feasible


def free_home(model: RobotModel, candidates: Array) -> Array:
    """Return the robot's home ``(joints,)``; if in collision, the nearest of free poses ``(m, joints)``."""
    home = model.chain.home
    if not collides(model, home[None])[0]:
        return home
    return np.asarray(candidates[np.argmin(np.abs(candidates - home).max(axis=1))])


def reachability(
    model: RobotModel, home: Array, candidates: Array, allowed: Feasible, most: int = HUBS
) -> ReachabilityGraph:
    """Find hubs among the first of the candidates ``(m, joints)``, and build the tests of reachability from them.

    Args:
        allowed: test of inputs ``(n, joints + further)``: allowed for the arm, and measurable.
    """
    free = path_check(model)
    found = [home]
    for pose in candidates[:most]:
        if any(free(hub, pose) for hub in found):
            found.append(pose)

    stored: dict[bytes, bool] = {}  # designs of other sizes test the same candidates again

    def leads_to(pose: Array) -> bool:
        key = pose.tobytes()
        if key not in stored:
            stored[key] = any(free(hub, pose) for hub in found)
        return stored[key]

    def reachable(joints: Array) -> NDArray[np.bool_]:
        return np.array([leads_to(pose) for pose in joints[:, : model.chain.size]], dtype=bool)

    def feasible(joints: Array) -> NDArray[np.bool_]:
        fine = allowed(joints)
        fine[fine] = reachable(joints[fine])
        return fine

    return ReachabilityGraph(np.array(found), free, reachable, feasible)


def refusals(model: RobotModel, access: ReachabilityGraph | None) -> Callable[[Array], list[str]]:
    """Return a function of joint positions ``(n, joints)``: the reasons against each, "" for none.

    Args:
        access: from which a free path is required; None if paths are given, and each pose is checked alone.
    """

    def refused(joints: Array) -> list[str]:
        messages = [f"collision: {message}" if message else "" for message in describe_collisions(model, joints)]
        for i, message in enumerate(messages):
            if access is not None and not message and not access.reachable(joints[i : i + 1])[0]:
                messages[i] = "no way that is free of collisions was found from home to it"
        return messages

    return refused


def waypoints_in_order(
    chain: JointSpec, access: ReachabilityGraph, joints: Array, progress: Progress = no_progress
) -> tuple[Array, NDArray[np.int_]]:
    """Find a free path from home through poses in the given order, and home again.

    Args:
        chain: with known rates.
        joints: ``(n, joints)``, each with a free path to it.
        progress: called with the number of checked paths.

    Returns:
        Joint positions ``(s, joints)`` to move to one after the other, each in a straight line of all joints, and
        ``(s,)`` the pose of each, -1 for home and detours.
    """
    home, stored = access.hubs[0], dict[bytes, bool]()

    def free(start: Array, end: Array) -> bool:
        key = start.tobytes() + end.tobytes()
        if key not in stored:
            stored[key] = access.free(start, end)
        return stored[key]

    nodes = np.concatenate([home[None], joints, home[None]])

    waypoints, which = [home[None]], [np.array([-1])]
    for i in range(len(joints) + 1):
        progress(i, len(joints) + 1)
        path = fastest_path(nodes[i], nodes[i + 1], access.hubs, chain, free)[1:]
        waypoints.append(path)
        which.append(np.append(np.full(len(path) - 1, -1), i if i < len(joints) else -1))
    return np.concatenate(waypoints), np.concatenate(which)


_TEST_POSES = 500
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
        access: the collision-free paths between the poses; None after pickling or copying, because it is too large.
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
        return {**self.__dict__, "access": None}

    @property
    def measured(self) -> Array | None:
        """Information ``(f, f)`` of the poses measured before, in the criterion's scaling; None without any."""
        return information(self.before) if len(self.before) else None

    def station(self, inputs: Array) -> NDArray[np.int_]:
        """Return the station ``(n,)``, from 0, of each of these inputs."""
        size = self.arm.chain.size
        return _station_of(inputs[:, size : size + len(self.robot.model.station_sites) - 1])

    def payload(self, inputs: Array) -> Array:
        """Return the payload ``(n,)`` kg of each of these inputs; zero if none are given."""
        return inputs[:, -1] if len(self.payloads) else np.zeros(len(inputs))


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
    if options.observe != "points":
        return _problem_of_sensor(options, robot, progress)
    device, scaling = _noisy(options.instrument), Scaling(options.scaling)
    arm = robot.arm(options.targets)
    robot.refuse_unknown(options.targets)
    model = planning_model(robot.model, options.targets, device, options.clearances)
    values, (seen, structure, every) = model.values_before(arm, model.T_world_tracker), _model(options, robot, model)
    region = task_region(options.region)
    points = region.points(arm.T_tracker_frame0(values), robot.chain.joint_names, robot.chain.prismatic)
    candidates = draw_candidates(
        model,
        options.targets,
        device,
        options.candidates,
        rng_for(options.seed, "candidates"),
        progress=progress,
    )
    payloads = np.array(options.payload_kg)
    inputs = _carrying(_assigned(options, model, device, candidates.joints), payloads)
    task, missed = _task(options, region, points, robot, arm, values, candidates.joints)
    test_inputs = _inputs(model, task)
    if len(payloads):
        test_inputs = np.column_stack([test_inputs, np.resize(payloads, len(task))])
    already = _measured_before(options, robot)
    home, warnings = _home(options, robot.chain, model, candidates.joints)
    retained = structure.identifiable
    derivatives = _Derivatives(seen, every, retained, device, options.payload_kg)
    jacobians = derivatives.whitened if scaling.kind == "whitened" else derivatives.unweighted
    pool = jacobians(inputs)
    parameters = [seen.parameters[i] for i in retained]
    factors = scaling.columns(parameters, pool)
    test = derivatives.unweighted(test_inputs).reshape(-1, 3, len(retained))  # every target counts
    design_task = _design_task(scaling, parameters, pool, test)
    before = jacobians(already) * factors
    return PoseProblem(
        robot=robot,
        arm=arm,
        seen=seen,
        structure=structure,
        values=values,
        candidates=candidates,
        inputs=inputs,
        payloads=payloads,
        pool=pool * factors,
        sensitivity=partial(_scaled, jacobians, factors),
        task=design_task,
        goal=_goal(options, design_task, pool * factors, before),
        before=before,
        whitened=derivatives.whitened,
        test=test,
        scaling=scaling,
        access=reachability(model, home, candidates.joints, _feasible(model, options.targets, device)),
        already=already,
        warnings=(*robot.warnings, *warnings, *_unchecked(options), *missed),
    )


def _problem_of_sensor(options: DesignOptions, robot: Robot, progress: Progress) -> PoseProblem:
    """Set up a problem of which a sensor says what it reads at a pose, and where it reads anything.

    Raises:
        LabError: the sensor cannot be used, or hardly a pose is feasible.
    """
    if robot.model.stations:
        raise LabError(f"--observe {options.observe}: stations of a cell are of an instrument; leave them out")
    sensor = configured_sensor(options.observe, SensorOptions(cameras=options.cameras), FitInputs())
    arm, model = (
        robot.arm(options.targets),
        planning_model(robot.model, (), named_instrument("exact"), options.clearances),
    )
    planned = sensor.planned(model)
    rng = rng_for(options.seed, "candidates")
    candidates = draw_candidates(
        model, (), named_instrument("exact"), options.candidates, rng, progress=progress,
        sees=planned.sees,
    )  # fmt: skip
    seen = planned.near(candidates.joints)
    structure, scaling = base_set(seen, planned.values), Scaling(options.scaling)
    retained = structure.identifiable
    readings = partial(planned.readings, retained=retained)
    pool = readings(candidates.joints)
    parameters = [seen.parameters[i] for i in retained]
    factors = scaling.columns(parameters, pool)
    values = model.values_before(arm, model.T_world_tracker)
    fresh = random_poses(model, _TEST_POSES, rng_for(options.seed, "fresh"))
    test = _placed_anew(arm, fresh, values, retained)
    design_task = _design_task(scaling, parameters, pool, test)
    home, warnings = _home(options, robot.chain, model, candidates.joints)
    return PoseProblem(
        robot=robot,
        arm=arm,
        seen=seen,
        structure=structure,
        values=values,
        candidates=candidates,
        inputs=candidates.joints,
        payloads=np.empty(0),
        pool=pool * factors,
        sensitivity=partial(_scaled, readings, factors),
        task=design_task,
        goal=_goal(options, design_task, pool * factors),
        before=np.empty((0, *pool.shape[1:])),
        whitened=readings,
        test=test,
        scaling=scaling,
        access=reachability(model, home, candidates.joints, planned.sees),
        already=np.empty((0, robot.chain.size)),
        warnings=(*robot.warnings, *warnings, *_unchecked(options)),
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
    found = np.zeros((*jacobian.shape[:2], len(retained)))
    found[..., : len(own)] = without_columns(jacobian[..., own], placing)
    return found


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


def _goal(options: DesignOptions, task: DesignTask, pool: Array, before: Array | None = None) -> Criterion:
    """Return the criterion: the lab's, or a user's that is prepared for the task.

    Args:
        pool: ``(m, r, f)`` scaled sensitivities of the candidates, ``before`` those of the poses measured before.
    """
    goal = criterion(options.criterion, len(task.parameters), task.jacobians)
    if goal.name in CRITERIA:
        return goal
    return prepared(goal, task, pool, 0.0 if before is None else information(before))


def _design_task(scaling: Scaling, parameters: Sequence[Parameter], pool: Array, test: Array) -> DesignTask:
    """Return what a criterion needs, of sensitivities ``(m, r, f)`` and Jacobians ``(t, 3, f)`` in SI units."""
    units = scaling.units(parameters, pool)
    some = test[:: -(-len(test) // _TEST_SCORED)]
    return DesignTask(tuple(parameters), units, scaling.tolerances(parameters), some * units)


def _task(
    options: DesignOptions,
    region: TaskRegion,
    points: Array,
    robot: Robot,
    arm: RigidArm,
    values: Array,
    candidates: Array,
) -> tuple[Array, tuple[str, ...]]:
    """Return joint positions ``(t, joints)`` at which the error is predicted, and warnings on points without any.

    In a box or at targets these are some configurations for each point, found from candidates ``(m, joints)`` of which
    the target is near, or from the joint positions of the file.

    Args:
        points: ``(n, 3)`` m of the region, in the frame of the measurements.

    Raises:
        LabError: the arm reaches none of the points.
    """
    chain = robot.chain
    if region.kind == "workspace":
        return random_poses(robot.model, _TEST_POSES // len(arm.targets), rng_for(options.seed, "fresh")), ()
    given = region.joints(chain.joint_names, chain.prismatic)
    starts = [given] if len(given) else [candidates[i::_BRANCHES] for i in range(min(_BRANCHES, len(candidates)))]
    found, reached = [], np.zeros(len(points), bool)
    for start in starts:
        try:
            task = region_of_points(
                region.kind, points, model=arm, values=values, inputs=start, joints=chain, name=_option(region)
            )
        except LabError:  # none of them from these configurations
            continue
        found.append(task.inputs)
        reached |= task.reached if task.reached is not None else False
    frame = _frame_of_points(region, arm, values)
    if not found:
        raise LabError(f"{_option(region)}: the arm reaches none of its {len(points)} points, {frame}; name another")
    return np.concatenate(found), _missed(region, region.names(chain.joint_names, chain.prismatic), reached, frame)


_BRANCHES = 4  # configurations of each point of a task, where the arm has so many
_MOST_NAMED = 5  # targets that are not reached


def _frame_of_points(region: TaskRegion, arm: RigidArm, values: Array) -> str:
    """Describe the frame of a region's coordinates, and of targets where the arm stands in it."""
    if region.file is None:
        return "whose coordinates are in the robot's frame 0"
    base = ", ".join(f"{MM.of(part):.0f}".replace("-", "−") for part in arm.T_tracker_frame0(values)[:3, 3] + 0.0)
    return f"whose coordinates are in the instrument's frame (the robot's base is at {base} mm there)"


def _missed(region: TaskRegion, names: Sequence[str], reached: NDArray[np.bool_], frame: str) -> tuple[str, ...]:
    """Warn of the points of a task that no pose reaches."""
    count = int((~reached).sum())
    if not count:
        return ()
    what = f"{count} of the {len(reached)} points drawn from the box"
    if names:
        missed = [name for name, there in zip(names, reached, strict=True) if not there]
        more = f" and {count - _MOST_NAMED} more" if count > _MOST_NAMED else ""
        what = f"target{'s' * (count > 1)} {', '.join(missed[:_MOST_NAMED])}{more} ({count} of {len(reached)})"
    return (f"{_option(region)}: no pose reaches {what}, {frame}; the error is predicted at the others alone",)


def _option(region: TaskRegion) -> str:
    return "--region" if region.file is None else f"--region {region.file}"


def _scaled(jacobians: Sensitivity, factors: Array, inputs: Array) -> Array:
    return np.asarray(jacobians(inputs) * factors)


@dataclass(frozen=True)
class _Derivatives:
    """Derivatives ``(n, r, f)`` of measured points by the base set, at inputs ``(n, joints + conditions)``.

    Attributes:
        seen: the arm with the effects of the stations and of the model.
        values: ``(p,)`` its parameters.
        retained: f of them, the base set.
        device: of the noise units of ``whitened``.
        payloads: kg, of which the last column of the inputs is one; without them there is no such column.
    """

    seen: Arm
    values: Array
    retained: tuple[int, ...]
    device: Instrument
    payloads: tuple[float, ...] = ()

    def unweighted(self, inputs: Array) -> Array:
        """Return derivatives in m; zeros for an impossible pose."""
        return self._flat(self._observed(inputs)[1])

    def whitened(self, inputs: Array) -> Array:
        """Return derivatives in standard deviations of the device's noise."""
        points, jacobian = self._observed(inputs)
        if not is_isotropic(self.device):
            return self._flat(whitening(self.device.covariance(points)) @ jacobian)
        everywhere = whitening(self.device.covariance(np.ones(3)))
        return self._flat(np.multiply(jacobian, everywhere[0, 0], order="C"))  # contiguous numbers of a pose

    def _observed(self, inputs: Array) -> tuple[Array, Array]:
        points, jacobian = self.seen.observe(self._conditioned(inputs), self.values)
        return _finite(points), _finite(jacobian[..., list(self.retained)])

    def _conditioned(self, inputs: Array) -> Array:
        """Return the inputs with the columns of the arm's conditions.

        Differences move those columns too, which hold whole numbers, or payloads.
        """
        size = self.seen.rigid.chain.size
        further = inputs[:, size : inputs.shape[1] - bool(self.payloads)].round()
        if PAYLOAD not in self.seen.conditions:
            return np.append(inputs[:, :size], further, axis=1) if inputs.shape[1] > size else inputs
        masses = np.array(self.payloads or (0.0,))
        carried = inputs[:, -1] if self.payloads else np.zeros(len(inputs))
        nearest = masses[np.abs(carried[:, None] - masses).argmin(axis=1)]
        return np.column_stack([inputs[:, :size], further, nearest])

    def _flat(self, jacobian: Array) -> Array:
        flat: Array = jacobian.reshape(len(jacobian), 3 * len(self.seen.targets), len(self.retained))
        return flat


def _carrying(inputs: Array, payloads: Array) -> Array:
    """Return inputs ``(m, c)`` with each payload ``(l,)``, as ``(l m, c + 1)``; as they are without any."""
    if not len(payloads):
        return inputs
    return np.concatenate([np.column_stack([inputs, np.full(len(inputs), mass)]) for mass in payloads])


def _assigned(options: DesignOptions, model: RobotModel, device: Instrument, joints: Array) -> Array:
    """Return inputs of candidates ``(m, joints)``, each with its best station."""
    if not model.stations:
        return joints
    stations = seeing_station(model, options.targets, device)(joints)
    refuse_idle_stations(model, stations, STATION_POINTS)
    return _inputs(model, joints, stations)


def _station_of(columns: Array) -> NDArray[np.int_]:
    """Return the station ``(n,)``, from 0, of indicator columns ``(n, stations - 1)`` of the further ones."""
    return np.asarray(columns.round() @ np.arange(1, columns.shape[1] + 1), dtype=np.int_)


def _inputs(model: RobotModel, joints: Array, stations: NDArray[np.int_] | None = None) -> Array:
    """Return joint positions ``(n, joints)`` with indicator columns of the stations ``(n,)``; default is the first."""
    further = np.arange(1, len(model.station_sites))
    at = np.zeros(len(joints), dtype=np.int_) if stations is None else stations
    return np.concatenate([joints, at[:, None] == further], axis=1) if len(further) else joints


def _feasible(model: RobotModel, targets: Sequence[str], device: Instrument) -> Feasible:
    """Return a test of inputs: feasible poses, every target visible to their station."""
    allowed = [feasibility(model, targets, device, station=k) for k in range(len(model.station_sites))]
    size = model.chain.size
    if len(allowed) == 1:
        return lambda inputs: allowed[0](inputs[:, :size])

    def feasible(inputs: Array) -> NDArray[np.bool_]:
        joints, fine = inputs[:, :size], np.zeros(len(inputs), dtype=np.bool_)
        at = _station_of(inputs[:, size : size + len(allowed) - 1])
        for k, check in enumerate(allowed):
            fine[at == k] = check(joints[at == k])
        return fine

    return feasible


def _unchecked(options: DesignOptions) -> tuple[str, ...]:
    return ("nothing was checked for collisions: --no-check",) if options.no_check else ()


def _finite(numbers: Array) -> Array:
    return numbers if np.isfinite(numbers).all() else np.nan_to_num(numbers)


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


def _home_option(given: Sequence[float], chain: JointSpec, model: RobotModel) -> Array:
    text = f"--home {','.join(f'{number:g}' for number in given)}"
    if len(given) != chain.size or not np.isfinite(given).all():
        raise LabError(f"{text}: give one finite number for each of {', '.join(chain.joint_names)}")
    home = joints_to_si(np.array(given), chain.prismatic)
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
        return _inputs(robot.model, np.empty((0, chain.size + carried)))
    plan = read_measurements(options.extend, chain.joint_names, chain.prismatic, points=False, most=WAYPOINTS)
    rows = plan.only("calibrate")
    robot.refuse_beyond_limits(options.extend, rows, _MEASURED_SLACK)
    robot.refuse_impossible(options.extend, rows)
    measured = rows.seen.all(axis=1)
    rows = rows[measured] if measured.any() else rows
    if not len(rows):
        raise LabError(f"{options.extend}: no row has use = calibrate; mark some, or leave --extend out")
    inputs = _inputs(robot.model, rows.joints, stations_in(options.extend, rows, robot.model))
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


_ROUNDS = 4  # uphill


def best_design(options: DesignOptions, problem: PoseProblem, count: int, progress: Stage = no_stage) -> Design:
    """Return the best of several starts, each exchanged among the candidates and then moved uphill.

    The best start is chosen after the first round uphill, which gains most; that one alone continues.
    """
    rng = rng_for(options.seed, "design")
    best: Design | None = None
    for start in range(options.starts):
        progress(f"2 of 5, design of {count} poses, start {start + 1} of {options.starts}", start, options.starts)
        design = _uphill(problem, exchanged(problem, count, rng), 1)
        if best is None or design.score > best.score:
            best = design
    assert best is not None
    best = _uphill(problem, best, _ROUNDS - 1)
    if is_singular(information(problem.sensitivity(best.joints)) + information(problem.before)):
        raise LabError(
            f"criterion {problem.goal.name} chose {count} poses that cannot tell all parameters: a score must be "
            "worse than any other where the information is singular"
        )
    return best


def _uphill(problem: PoseProblem, design: Design, rounds: int) -> Design:
    """Move the poses uphill by the criterion."""
    if problem.planned is not None:  # a reading that goes out of sight is a step, which has no slope
        return design
    aim = OneCriterion(problem.sensitivity, problem.goal, 0.0 if problem.measured is None else problem.measured)
    chain = problem.robot.chain
    keep_off = MARGIN * (chain.upper - chain.lower)
    further = problem.inputs[:, chain.size :]  # stations and payloads, which do not change: their slope is zero
    return climb(
        design,
        aim,
        problem.access.feasible,
        np.concatenate([chain.lower + keep_off, further.min(axis=0)]),
        np.concatenate([chain.upper - keep_off, further.max(axis=0)]),
        rounds=rounds,
    )


def exchanged(problem: PoseProblem, count: int, rng: np.random.Generator) -> Design:
    """Exchange among the candidates to which a free path leads."""
    return exchange(
        problem.inputs,
        problem.pool,
        count,
        problem.goal,
        rng,
        starts=1,
        measured=problem.measured,
        reachable=problem.access.reachable,
    )
