"""Plan a measuring day: which poses, in what order, how many, and how good the choice is."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lab import frames
from lab.calibration.accuracy import Prediction, predict, smallest_count
from lab.calibration.certificate import Certificate, certify
from lab.calibration.design import Design, Sensitivity, ascend, exchange, information
from lab.calibration.identifiability import poses_needed
from lab.calibration.observability import Criterion, Indices, Scaling, criterion, indices
from lab.calibration.solver import whitening
from lab.calibration.tour import Tour, joint_speeds, plan_tour
from lab.errors import LabError
from lab.frames import Array
from lab.geometry.gauge import BaseSet, base_set
from lab.geometry.serial import SerialArm
from lab.instruments import Instrument, instrument
from lab.measurement_file import read_measurements
from lab.seeds import stream
from lab.study.options import PlannedCampaign
from lab.study.robots import Robot, load_robot
from lab.virtual.candidates import Candidates, draw_candidates, feasibility, path_check
from lab.virtual.feasible import random_poses
from lab.virtual.robot import RobotModel

TEST_POSES = 500
SAFE_POSES = 20  # candidates that a blocked move may pass through
MOST_POSES = 200  # where an accuracy is asked for


@dataclass(frozen=True)
class Problem:
    """What a design is chosen for.

    Attributes:
        values: nominal parameters ``(p,)``, with the base before the nominal tracker.
        whitened: readings ``(n, joints)`` to Jacobians ``(n, r, f)`` of the base set in standard deviations.
        sensitivity: the same in the units of the scaling, which the criterion sees.
        test: ``(t, 3, f)``, Jacobians (m) of the first target at random poses.
        measured: information ``(f, f)`` of poses measured already, as ``sensitivity`` has it; and how many.
    """

    robot: Robot
    arm: SerialArm
    structure: BaseSet
    values: Array
    candidates: Candidates
    whitened: Sensitivity
    sensitivity: Sensitivity
    goal: Criterion
    test: Array
    already: Array  # (n0, joints)


@dataclass(frozen=True)
class Step:
    """One point of the curve against the number of poses: promise and O1 of an exchanged design."""

    poses: int
    prediction: Prediction
    o1: float


@dataclass(frozen=True)
class Plan:
    """Poses to measure, in the order of the tour.

    Attributes:
        joints: ``(n, joints)``.
        design: the chosen poses before ordering.
        pool: how many poses the certificate is for: the candidates, and those that the ascent moved.
        certificate: the best continuous D-optimal design over them.
        d_efficiency: certified, of the chosen poses with those measured already.
        indices: in the units of the scaling.
        curve: against the number of poses.
    """

    options: PlannedCampaign
    problem: Problem
    joints: Array
    design: Design
    pool: int
    certificate: Certificate
    d_efficiency: float
    indices: Indices
    scaling: Scaling
    prediction: Prediction
    curve: tuple[Step, ...]
    tour: Tour
    seconds: float
    warnings: tuple[str, ...]


def plan_campaign(options: PlannedCampaign) -> Plan:
    """Choose poses among feasible candidates, improve them, certify them, order them.

    Raises:
        LabError: the request cannot be met; the message says by what.
    """
    started = time.perf_counter()
    robot = load_robot(options.robot)
    model = robot.needed_model()
    device = _noisy(options)
    scaling = Scaling(options.scaling)
    problem = pose_problem(options, robot, model, device, scaling)
    pool = problem.sensitivity(problem.candidates.joints)
    count = options.poses if options.accuracy_mm is None else _enough(options, problem, pool)
    design = _best_design(options, problem, pool, count, model, device)

    certified = np.concatenate([pool, design.jacobian[design.rows < 0]])
    before, share = _measured_part(problem, count)
    certificate = certify(certified, measured=before, share=share)
    everything = np.concatenate([design.jacobian, problem.sensitivity(problem.already)])
    prediction = _prediction(problem, design.joints, options.seed)
    speed, warnings = joint_speeds(robot.chain)
    safe = problem.candidates.joints[:SAFE_POSES]
    home = np.clip(np.zeros(robot.chain.size), robot.chain.lower, robot.chain.upper)
    tour = plan_tour(design.joints, speed, path_check(model), stream(options.seed, "tour"), home, safe)
    return Plan(
        options,
        problem,
        design.joints[list(tour.order)],
        design,
        len(certified),
        certificate,
        certificate.efficiency(everything),
        indices(everything),
        scaling,
        prediction,
        _curve(options, problem, pool, count),
        tour,
        time.perf_counter() - started,
        (*robot.warnings, *warnings),
    )


def pose_problem(
    options: PlannedCampaign, robot: Robot, model: RobotModel, device: Instrument, scaling: Scaling
) -> Problem:
    """Candidates and sensitivities for the base set of the nominal arm before the nominal tracker."""
    arm = robot.arm(options.targets)
    values = arm.nominal(robot.tool)
    T_tracker_frame0 = frames.inverse(model.T_world_tracker) @ model.T_world_frame0
    values[:3], values[3:6] = T_tracker_frame0[:3, 3], frames.log(T_tracker_frame0[:3, :3])
    structure = base_set(arm, values)
    kept = list(structure.kept)
    candidates = draw_candidates(model, options.targets, device, options.candidates, stream(options.seed, "candidates"))

    def plain(joints: Array) -> tuple[Array, Array]:
        points, jacobian = arm.observe(joints, values)
        return points, jacobian[..., kept]

    def whitened(joints: Array) -> Array:
        points, jacobian = plain(joints)
        white = whitening(device.covariance(points)) @ jacobian
        return white.reshape(len(joints), 3 * len(arm.targets), len(kept))

    def unweighted(joints: Array) -> Array:
        return plain(joints)[1].reshape(len(joints), 3 * len(arm.targets), len(kept))

    rows = whitened if scaling.kind == "whitened" else unweighted
    names = [arm.names[i] for i in kept]
    factors = scaling.columns(names, rows(candidates.joints))
    test = plain(random_poses(model, TEST_POSES, stream(options.seed, "fresh")))[1][:, 0]
    scaled_test = test * factors
    goal = criterion(options.criterion, len(kept), scaled_test)
    already = np.empty((0, robot.chain.size))
    if options.extend is not None:
        already = read_measurements(options.extend, robot.chain.joint_names, robot.chain.prismatic, points=False).joints
    return Problem(
        robot, arm, structure, values, candidates, whitened, lambda q: rows(q) * factors, goal, test, already
    )


def _noisy(options: PlannedCampaign) -> Instrument:
    device = instrument(options.instrument)
    if device.kind == "exact":
        raise LabError("instrument 'exact' has no noise, so every design is as good: choose another instrument")
    return device


def _best_design(
    options: PlannedCampaign, problem: Problem, pool: Array, count: int, model: RobotModel, device: Instrument
) -> Design:
    """The best of several starts, each exchanged among the candidates and then moved uphill."""
    rng, measured = stream(options.seed, "design"), _measured_information(problem)
    feasible = feasibility(model, options.targets, device)
    chain, best = problem.robot.chain, None
    for _ in range(max(1, options.starts)):
        chosen = exchange(problem.candidates.joints, pool, count, problem.goal, rng, starts=1, measured=measured)
        moved = ascend(chosen, problem.sensitivity, problem.goal, feasible, chain.lower, chain.upper, measured=measured)
        if best is None or moved.score > best.score:
            best = moved
    assert best is not None
    return best


def _measured_information(problem: Problem) -> Array | None:
    return information(problem.sensitivity(problem.already)) if len(problem.already) else None


def _measured_part(problem: Problem, count: int) -> tuple[Array | None, float]:
    """Information per pose of what was measured, and the share of all poses that is still to choose."""
    total = _measured_information(problem)
    if total is None:
        return None, 1.0
    n0 = len(problem.already)
    return total / n0, count / (n0 + count)


def _prediction(problem: Problem, joints: Array, seed: int) -> Prediction:
    everything = problem.whitened(np.concatenate([joints, problem.already]))
    return predict(information(everything), problem.test, stream(seed, "promise"))


def _exchanged(options: PlannedCampaign, problem: Problem, pool: Array) -> Callable[[int], Design]:
    """Designs of any size by exchange alone, each made once."""
    made: dict[int, Design] = {}

    def design(count: int) -> Design:
        if count not in made:
            made[count] = exchange(
                problem.candidates.joints,
                pool,
                count,
                problem.goal,
                stream(options.seed, "design"),
                starts=1,
                measured=_measured_information(problem),
            )
        return made[count]

    return design


def _least(problem: Problem) -> int:
    """The fewest poses that can show the base set."""
    return 1 if len(problem.already) else poses_needed(problem.arm, problem.values, problem.structure)


def _enough(options: PlannedCampaign, problem: Problem, pool: Array) -> int:
    if options.accuracy_mm is None or not options.accuracy_mm > 0:
        raise LabError(f"--accuracy-mm {options.accuracy_mm}: give an accuracy above zero")
    design = _exchanged(options, problem, pool)

    def reached(count: int) -> float:
        return _prediction(problem, design(count).joints, options.seed).reached

    return smallest_count(reached, options.accuracy_mm / 1e3, _least(problem), min(MOST_POSES, len(pool)))


def _curve(options: PlannedCampaign, problem: Problem, pool: Array, count: int) -> tuple[Step, ...]:
    """Promise and O1 against the number of poses, from the fewest possible to twice the plan's."""
    least = _least(problem)
    most = min(max(2 * count, least + 10), len(pool), MOST_POSES)
    design = _exchanged(options, problem, pool)
    steps = []
    for size in np.unique(np.geomspace(least, most, 10).round().astype(int)):
        chosen = design(int(size))
        everything = np.concatenate([chosen.jacobian, problem.sensitivity(problem.already)])
        o1 = float(indices(everything).o1)
        steps.append(Step(int(size), _prediction(problem, chosen.joints, options.seed), o1))
    return tuple(steps)
