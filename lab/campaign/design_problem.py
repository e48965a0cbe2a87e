"""Set up and solve the design problem of a measurement session: candidates, sensitivities, reachability."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.calibration.stations import STATION_POINTS
from lab.campaign.instruments import named_instrument
from lab.campaign.options import DesignOptions
from lab.campaign.robot import Robot, load_virtual
from lab.core.errors import LabError
from lab.core.limits import WAYPOINTS
from lab.core.linear_model import whitening
from lab.core.progress import Progress, no_progress
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import joints_to_si
from lab.core.whole_folder import Columns, Keep, at_once, current_keep
from lab.formats.measurement_csv import read_measurements
from lab.kinematics.effects.arm import Arm
from lab.kinematics.effects.effect import SessionInfo
from lab.kinematics.effects.sessions import station_parameters
from lab.kinematics.gauge import BaseSet, base_set
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.noise.instruments import Instrument, is_isotropic, observing
from lab.pose_selection.criteria import Criterion, Scaling, criterion, is_singular
from lab.pose_selection.exchange import Design, Feasible, Sensitivity, ascend, exchange, information
from lab.pose_selection.tour import FreePath, fastest_path
from lab.render.terminal import Stage, no_stage
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
from lab.simulation.model import RobotModel

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

_BLOCK = 500  # paths that are checked, and stored, together
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
    chain: JointSpec, access: ReachabilityGraph, joints: Array, progress: Progress = no_progress, keep: Keep = at_once
) -> tuple[Array, NDArray[np.int_]]:
    """Find a free path from home through poses in the given order, and home again.

    Args:
        chain: with known rates.
        joints: ``(n, joints)``, each with a free path to it.
        progress: called with the number of checked paths.
        keep: stores the checked paths.

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

    def paths(first: int, last: int) -> Columns:
        waypoints, which = [], []
        for i in range(first, last):
            progress(i, len(joints) + 1)
            path = fastest_path(nodes[i], nodes[i + 1], access.hubs, chain, free)[1:]
            waypoints.append(path)
            which.append(np.append(np.full(len(path) - 1, -1), i if i < len(joints) else -1))
        return {"stops": np.concatenate(waypoints), "which": np.concatenate(which)}

    waypoints, which = [home[None]], [np.array([-1])]
    for first in range(0, len(joints) + 1, _BLOCK):
        last = min(first + _BLOCK, len(joints) + 1)
        piece = keep("ways", [np.array([first]), nodes[first : last + 1], access.hubs], partial(paths, first, last))
        waypoints.append(piece["stops"])
        which.append(piece["which"])
    return np.concatenate(waypoints), np.concatenate(which)


_TEST_POSES = 500
_MEASURED_SLACK = 1e-3  # rad or m: allowed excess of joint positions over a data sheet's limits


@dataclass(frozen=True)
class PoseProblem:
    """A planning problem, from which designs of any size are chosen.

    Inputs are joint positions and, for an instrument with several stations, an indicator column (1 or 0)
    of each station but the first.

    Attributes:
        values: nominal parameters ``(p,)``, with the base before the nominal tracker.
        seen: the arm with the effects of the stations; its parameters begin with those of ``arm``.
        inputs: ``(m, joints + stations - 1)`` of the candidates.
        whitened: inputs to Jacobians ``(n, r, f)`` of the base set in standard deviations.
        sensitivity: the same in the units of the scaling, for the criterion.
        pool: ``(m, r, f)``, sensitivities of the candidates.
        test: ``(t, 3, f)``, Jacobians (m) of the targets at random poses.
        already: ``(n0, joints + stations - 1)``, poses measured before.
        before: ``(n0, r, f)``, sensitivities there.
        access: the collision-free paths between the poses; None after pickling or copying, because it is too large.
    """

    robot: Robot
    arm: RigidArm
    seen: Arm
    structure: BaseSet
    values: Array
    candidates: Candidates
    inputs: Array
    whitened: Sensitivity
    sensitivity: Sensitivity
    pool: Array
    goal: Criterion
    scaling: Scaling
    test: Array
    access: ReachabilityGraph = field(compare=False)
    already: Array
    before: Array
    warnings: tuple[str, ...]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "access": None}

    @property
    def measured(self) -> Array | None:
        """Information ``(f, f)`` of the poses measured before, in the criterion's scaling; None without any."""
        return information(self.before) if len(self.before) else None

    def station(self, inputs: Array) -> NDArray[np.int_]:
        """Return the station ``(n,)``, from 0, of each of these inputs."""
        return _station_of(inputs[:, self.arm.chain.size :])


def pose_problem(
    options: DesignOptions, robot: Robot | None = None, progress: Progress = no_progress, own: Criterion | None = None
) -> PoseProblem:
    """Load the arm, draw candidates, and set up what a design needs.

    Args:
        own: the criterion, in place of that of the options.
        progress: called with the number of candidates found.

    Raises:
        LabError: the robot, instrument, targets or criterion cannot be used, or hardly a pose is feasible.
    """
    robot = load_virtual(options.robot, options.cell) if robot is None else load_virtual(robot)
    if options.no_check:
        robot = replace(robot, model=unchecked(robot.model))
    device, scaling = _noisy(options.instrument), Scaling(options.scaling)
    arm = robot.arm(options.targets)
    robot.refuse_unknown(options.targets)
    model = planning_model(robot.model, options.targets, device, options.clearances)
    seen = robot.arm_with(options.targets, (), SessionInfo(stations=model.stations))
    values = model.values_before(arm, model.T_world_tracker)
    all_values = np.concatenate([values, *station_parameters(model.Ts_world_station)])
    structure = base_set(seen, all_values)
    identifiable = list(structure.identifiable)
    candidates = draw_candidates(
        model,
        options.targets,
        device,
        options.candidates,
        rng_for(options.seed, "candidates"),
        progress=progress,
        keep=current_keep(),
    )
    inputs = _assigned(options, model, device, candidates.joints)
    derivatives = _Derivatives(seen, all_values, tuple(identifiable), device)
    jacobians = derivatives.whitened if scaling.kind == "whitened" else derivatives.unweighted
    pool = jacobians(inputs)
    factors = scaling.columns([seen.parameters[i] for i in identifiable], pool)
    fresh = random_poses(robot.model, _TEST_POSES // len(arm.targets), rng_for(options.seed, "fresh"))
    test = derivatives.unweighted(_inputs(model, fresh)).reshape(-1, 3, len(identifiable))  # every target counts
    home, warnings = _home(options, robot.chain, model, candidates.joints)
    already = _measured_before(options, robot)
    return PoseProblem(
        robot=robot,
        arm=arm,
        seen=seen,
        structure=structure,
        values=values,
        candidates=candidates,
        inputs=inputs,
        whitened=derivatives.whitened,
        sensitivity=partial(_scaled, jacobians, factors),
        pool=pool * factors,
        goal=criterion(options.criterion, len(identifiable), test[::5] * factors) if own is None else own,
        scaling=scaling,
        test=test,
        access=reachability(model, home, candidates.joints, _feasible(model, options.targets, device)),
        already=already,
        before=jacobians(already) * factors,
        warnings=(*robot.warnings, *warnings, *_unchecked(options)),
    )


def _scaled(jacobians: Sensitivity, factors: Array, inputs: Array) -> Array:
    return np.asarray(jacobians(inputs) * factors)


@dataclass(frozen=True)
class _Derivatives:
    """Derivatives ``(n, r, f)`` of measured points by the base set, at inputs ``(n, joints + conditions)``.

    Attributes:
        seen: the arm with the effects of the stations.
        values: ``(p,)`` its parameters.
        retained: f of them, the base set.
        device: of the noise units of ``whitened``.
    """

    seen: Arm
    values: Array
    retained: tuple[int, ...]
    device: Instrument

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
        if further := len(self.seen.conditions):  # differences move these columns too, which are whole numbers
            inputs = np.append(inputs[:, :-further], inputs[:, -further:].round(), axis=1)
        points, jacobian = self.seen.observe(inputs, self.values)
        return _finite(points), _finite(jacobian[..., list(self.retained)])

    def _flat(self, jacobian: Array) -> Array:
        flat: Array = jacobian.reshape(len(jacobian), 3 * len(self.seen.targets), len(self.retained))
        return flat


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
    if len(allowed) == 1:
        return allowed[0]

    def feasible(inputs: Array) -> NDArray[np.bool_]:
        joints, fine = inputs[:, : model.chain.size], np.zeros(len(inputs), dtype=np.bool_)
        at = _station_of(inputs[:, model.chain.size :])
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
    chain = robot.chain
    if options.extend is None:
        return _inputs(robot.model, np.empty((0, chain.size)))
    plan = read_measurements(options.extend, chain.joint_names, chain.prismatic, points=False, most=WAYPOINTS)
    rows = plan.only("calibrate")
    robot.refuse_beyond_limits(options.extend, rows, _MEASURED_SLACK)
    robot.refuse_impossible(options.extend, rows)
    measured = rows.seen.all(axis=1)
    rows = rows.take(np.flatnonzero(measured)) if measured.any() else rows
    if not len(rows):
        raise LabError(f"{options.extend}: no row has use = calibrate; mark some, or leave --extend out")
    return _inputs(robot.model, rows.joints, stations_in(options.extend, rows, robot.model))


_ROUNDS = 4  # uphill


def best_design(options: DesignOptions, problem: PoseProblem, count: int, progress: Stage = no_stage) -> Design:
    """Return the best of several starts, each exchanged among the candidates and then moved uphill.

    The best start is chosen after the first round uphill, which gains most; that one alone continues.
    """
    rng = rng_for(options.seed, "design")
    best: Design | None = None
    for start in range(options.starts):
        progress(f"2 of 5, design of {count} poses, start {start + 1} of {options.starts}", start, options.starts)
        design = _begun(problem, count, rng)
        if best is None or design.score > best.score:
            best = design
    assert best is not None
    best = _uphill(problem, best, _ROUNDS - 1)
    measured = 0.0 if problem.measured is None else problem.measured
    if is_singular(information(best.jacobian) + measured):
        raise LabError(
            f"criterion {problem.goal.name} chose {count} poses that cannot tell all parameters: a score must be worse "
            "than any other where the information is singular"
        )
    return best


def _begun(problem: PoseProblem, count: int, rng: np.random.Generator) -> Design:
    """Compute one start, exchanged and moved uphill once; it is stored with the generator's state after it."""

    def work() -> Columns:
        design = _uphill(problem, exchanged(problem, count, rng), 1)
        return asdict(design) | {"score": np.array(design.score), "state": _state(rng)}

    found = current_keep()("start", [np.array([count]), _state(rng), problem.inputs, problem.already], work)
    rng.bit_generator.state = json.loads(str(found["state"]))
    return Design(found["rows"], found["joints"], found["jacobian"], float(found["score"]))


def _state(rng: np.random.Generator) -> NDArray[np.str_]:
    return np.array(json.dumps(rng.bit_generator.state))


def _uphill(problem: PoseProblem, design: Design, rounds: int) -> Design:
    chain = problem.robot.chain
    keep_off = MARGIN * (chain.upper - chain.lower)
    further = problem.inputs.shape[1] - chain.size  # columns of stations, which do not change: their slope is zero
    return ascend(
        design,
        problem.sensitivity,
        problem.goal,
        problem.access.feasible,
        np.append(chain.lower + keep_off, np.zeros(further)),
        np.append(chain.upper - keep_off, np.ones(further)),
        rounds=rounds,
        measured=problem.measured,
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
