"""Plan a measurement session: which poses, in what order, how many, and how good the choice is."""

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from lab.calibration.identifiability import enough_poses
from lab.campaign.design_problem import PoseProblem, best_design, exchanged, pose_problem
from lab.campaign.options import DesignOptions
from lab.campaign.robot import Robot, load_virtual
from lab.commands.command_line import options_of, takes
from lab.commands.design.result import DesignResult, DesignStep, PlanCheckResult, check_plan
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.kinematics.joints import JointSpec
from lab.pose_selection.criteria import (
    Criterion,
    PredictedAccuracy,
    indices,
    own_criterion,
    predict,
    smallest_count,
)
from lab.pose_selection.exchange import Certificate, Design, certify, information
from lab.pose_selection.tour import Tour, one_after_another, plan_tour, rated, with_reference
from lab.render.terminal import Stage, status

__all__ = ["design", "planned_session"]

POSES = 30  # where neither a number nor an accuracy is asked for
_CURVE_STEPS = 10
_NO_WEIGHT = 1e-6  # of the continuous design: a pose with less is left out
MOST_POSES = 200  # where an accuracy is asked for


@takes(DesignOptions)
def design(robot: str | Path | Robot | DesignOptions = "irb120", **options: Any) -> DesignResult | PlanCheckResult:
    """Choose the poses to measure among feasible candidates, improve them, certify them, and order them.

    Args:
        robot: a model's name, a path, or a loaded robot; or all options in one object.
        options: those of ``lab design``, by name: ``poses`` or ``accuracy_mm``, ``criterion``, ``instrument`` and so
            on; ``criterion`` may be an object of a subclass of ``lab.Criterion``.

    Returns:
        Joint positions (rad or m) in the order of the tour, and what accuracy to expect of them; with ``check`` whether
        an earlier plan can be run.

    Raises:
        LabError: the request cannot be met; the message says by what.

    Example:
        >>> import lab
        >>> plan = lab.design("irb120", poses=14, candidates=100, starts=1)
        >>> plan.joints.shape
        (14, 6)
    """
    own = None
    if not isinstance(options.get("criterion", ""), str):
        own = own_criterion(options["criterion"])
        options["criterion"] = own.name
    if isinstance(robot, DesignOptions):
        requested, known = robot, load_virtual(robot.robot, robot.cell)
    else:
        known = load_virtual(robot)
        requested = options_of("lab.design", DesignOptions, {"robot": known.source, **options})
        known = known.placed_in(requested.cell)
    requested.refuse_nonsense()
    return check_plan(requested, known) if requested.check is not None else planned_session(requested, known, own)


def planned_session(options: DesignOptions, robot: Robot | None = None, own: Criterion | None = None) -> DesignResult:
    """Choose poses, and order them.

    Args:
        options: what is asked.
        robot: in its cell; loaded as the options say, if not given.
        own: the criterion, in the place of the one that the options name.

    Raises:
        LabError: the request cannot be met; the message says by what.
    """
    with status("planning") as progress:
        known = load_virtual(options.robot, options.cell) if robot is None else robot
        return _planned(options, known, own, progress)


def _planned(options: DesignOptions, robot: Robot, own: Criterion | None, progress: Stage) -> DesignResult:
    started = time.perf_counter()
    problem = pose_problem(options, robot, partial(progress, "1 of 5, candidates"), own)
    least = _least(problem)
    quick = _of_any_size(options, problem)
    if options.accuracy_mm is not None:
        design = _accurate_design(options, problem, least, quick, progress)
    else:
        count = POSES if options.poses is None else options.poses
        if count < least:
            raise LabError(f"--poses {count}: {problem.pool.shape[2]} parameters need {least} poses or more")
        design = best_design(options, problem, count, progress)
    count = len(design.joints)

    progress("3 of 5, certificate")
    pool = np.concatenate([problem.pool, design.jacobian[design.rows < 0]])
    n0 = len(problem.already)
    measured = None if problem.measured is None else problem.measured / n0
    certificate = certify(pool, measured=measured, share=count / (n0 + count))
    everything = np.concatenate([design.jacobian, problem.before])
    most = max(least, min(max(2 * count, least + 10), len(problem.pool) // 2, max(MOST_POSES, count)))
    sizes = np.unique(np.geomspace(least, most, _CURVE_STEPS).round().astype(int)).tolist()
    progress("4 of 5, tour")
    chain, warnings = rated(problem.robot.chain)
    tour = _tour(options, problem, design.joints, chain)
    return DesignResult(
        options=options,
        problem=problem,
        joints=design.joints[list(tour.order), : chain.size],
        stations=problem.station(design.joints)[list(tour.order)],
        design=design,
        certificate=certificate,
        d_efficiency=certificate.efficiency(everything),
        indices=indices(everything),
        prediction=_prediction(problem, design.joints, options.seed),
        curve=tuple(
            _designed_steps(options, problem, sizes, quick, progress)
            if options.curve
            else _continuous_steps(options, problem, sizes, pool, design, certificate)
        ),
        tour=tour,
        seconds=time.perf_counter() - started,
        warnings=(*problem.warnings, *warnings),
    )


def _tour(options: DesignOptions, problem: PoseProblem, inputs: Array, chain: JointSpec) -> Tour:
    """The order of the poses, station by station: between two of them the arm waits at home for the instrument."""
    home, safe, rng = problem.access.hubs[0], problem.access.hubs[1:], rng_for(options.seed, "tour")
    joints, at, parts = inputs[:, : chain.size], problem.station(inputs), []
    for station in np.unique(at):
        rows = np.flatnonzero(at == station)
        part = plan_tour(joints[rows], chain.speed, chain.acceleration, problem.access.free, rng, home, safe)
        if options.reference_every is not None:
            part = with_reference(part, options.reference_every, problem.access.hubs, chain, problem.access.free)
        parts.append(part.among(rows))
    return one_after_another(parts)


def _prediction(problem: PoseProblem, inputs: Array, seed: int) -> PredictedAccuracy:
    everything = problem.whitened(np.concatenate([inputs, problem.already]))
    return predict(information(everything), problem.test, rng_for(seed, "promise"))


def _least(problem: PoseProblem) -> int:
    """The fewest further poses that can show the base set."""
    return enough_poses(problem.pool, problem.before)


def _of_any_size(options: DesignOptions, problem: PoseProblem) -> Callable[[int], Design]:
    """Designs by exchange alone, each made once."""
    made: dict[int, Design] = {}

    def design(count: int) -> Design:
        if count not in made:
            made[count] = exchanged(problem, count, rng_for(options.seed, "design"))
        return made[count]

    return design


def _accurate_design(
    options: DesignOptions, problem: PoseProblem, least: int, quick: Callable[[int], Design], progress: Stage
) -> Design:
    """The smallest design whose predicted error is within the accuracy asked for.

    Exchanged designs find about how many poses; from there ascended ones, whose predicted error is smaller, decide.
    """
    assert options.accuracy_mm is not None
    wanted = MM.to_si(options.accuracy_mm)
    most = max(least, min(MOST_POSES, len(problem.pool) // 2))

    def bound(design: Design) -> float:
        return _prediction(problem, design.joints, options.seed).coverage_radius

    count = smallest_count(lambda size: bound(quick(size)), wanted, least, most)
    design = best_design(options, problem, count, progress)
    while bound(design) > wanted:  # uphill on another criterion may cost accuracy
        count += 1
        if count > most:
            raise LabError(f"{options.accuracy_mm:g} mm is out of reach by criterion {options.criterion}: try O1 or I")
        design = best_design(options, problem, count, progress)
    while count > least:
        fewer = best_design(options, problem, count - 1, progress)
        if bound(fewer) > wanted:
            break
        count, design = count - 1, fewer
    return design


def _designed_steps(
    options: DesignOptions,
    problem: PoseProblem,
    sizes: Sequence[int],
    quick: Callable[[int], Design],
    progress: Stage,
) -> Iterator[DesignStep]:
    """Predicted error and O1 of exchanged designs of these sizes."""
    for done, size in enumerate(sizes):
        progress(f"5 of 5, curve, {size} poses", done, len(sizes))
        chosen = quick(size)
        o1 = float(indices(np.concatenate([chosen.jacobian, problem.before])).o1)
        yield DesignStep(size, _prediction(problem, chosen.joints, options.seed), o1)


def _continuous_steps(
    options: DesignOptions,
    problem: PoseProblem,
    sizes: Sequence[int],
    pool: Array,
    design: Design,
    certificate: Certificate,
) -> Iterator[DesignStep]:
    """Predicted error and O1 of the certificate's continuous design, as if so many poses could be shared out by it.

    At little cost: a design of whole poses comes near it where there are several times as many as the fewest.
    """
    support = np.flatnonzero(certificate.weights > _NO_WEIGHT)
    weights = certificate.weights[support] / certificate.weights[support].sum()
    inputs = np.concatenate([problem.inputs, design.joints[design.rows < 0]])[support]
    weighted = np.sqrt(weights)[:, None, None]
    per_pose, before = information(weighted * problem.whitened(inputs)), information(problem.whitened(problem.already))

    def predicted(information: Array) -> PredictedAccuracy:
        return predict(information, problem.test, rng_for(options.seed, "promise"))

    alone = None if before.any() else predicted(per_pose)
    for size in sizes:
        rows = np.concatenate([np.sqrt(size) * weighted * pool[support], problem.before])
        o1 = indices(rows * np.sqrt(len(rows) / (size + len(problem.before)))).o1
        prediction = predicted(size * per_pose + before) if alone is None else alone.repeated(size)
        yield DesignStep(size, prediction, float(o1))
