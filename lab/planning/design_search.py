"""Search the poses of a session of any size or accuracy, and predict their accuracy and that of other sizes."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lab.core.errors import LabError
from lab.core.progress import Stage, no_stage
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.options.virtual_campaign import DesignOptions
from lab.planning.design_problem import PoseProblem
from lab.pose_selection.certificate import DesignCertificate, certify_criterion
from lab.pose_selection.criteria import indices, is_singular
from lab.pose_selection.exchange import Design, OneCriterion, climb, exchange, information
from lab.pose_selection.predicted_accuracy import PredictedAccuracy, predict, smallest_count
from lab.simulation.candidate_poses import MARGIN

__all__ = [
    "DesignStep",
    "accurate_design",
    "best_design",
    "certified",
    "continuous_steps",
    "curve_sizes",
    "designed_steps",
    "designs_of_any_size",
    "predicted_accuracy",
]

_CURVE_STEPS = 10
_NO_WEIGHT = 1e-6  # of the continuous design: a pose with less is left out
_MOST_POSES = 200  # where an accuracy is asked for


@dataclass(frozen=True)
class DesignStep:
    """A point of the curve against the number of poses: predicted error and O1 of a design of that size."""

    poses: int
    prediction: PredictedAccuracy
    o1: float

    def to_dict(self) -> dict[str, float | int]:
        """Return the step with its lengths in mm."""
        rms: Array = MM.of(self.prediction.rms)
        return {
            "poses": self.poses,
            "rms_mm": float(np.sqrt(np.mean(rms**2))),
            "worst_mm": float(rms.max()),
            "promise_mm": MM.of(self.prediction.coverage_radius),
            "o1": self.o1,
        }


def predicted_accuracy(problem: PoseProblem, inputs: Array, seed: int) -> PredictedAccuracy:
    """Return the predicted errors."""
    every = np.concatenate([inputs, problem.already])
    return predict(information(problem.whitened(every)), problem.test, rng_for(seed, "promise"))


def certified(
    problem: PoseProblem, design: Design, certificate: DesignCertificate
) -> tuple[DesignCertificate | None, float | None]:
    """Return the certificate of the criterion and the efficiency by it, if it is not O1.

    Args:
        certificate: of O1, from whose weights the search starts.
    """
    goal, moved = problem.goal, design.joints[design.rows < 0]
    if goal.name == "O1" or goal.growth is None:
        return None, None
    n0, n = len(problem.already), len(design.joints)
    pool = np.concatenate([problem.pool, problem.sensitivity(moved)])
    certificate_of_goal = certify_criterion(goal, pool, problem.before, start=certificate.weights, share=n / (n0 + n))
    if certificate_of_goal is None:
        return None, None
    total = information(problem.sensitivity(design.joints)) + information(problem.before)
    return certificate_of_goal, certificate_of_goal.efficiency(float(goal.score(total)) / goal.growth, n + n0)


def designs_of_any_size(options: DesignOptions, problem: PoseProblem) -> Callable[[int], Design]:
    """Return a function of the number of poses: a design by exchange alone, each made once."""
    made: dict[int, Design] = {}

    def design(count: int) -> Design:
        if count not in made:
            made[count] = _exchanged(problem, count, rng_for(options.seed, "design"))
        return made[count]

    return design


def accurate_design(
    options: DesignOptions, problem: PoseProblem, least: int, quick: Callable[[int], Design], progress: Stage
) -> Design:
    """Return the smallest design whose predicted error is within the accuracy asked for.

    Exchanged designs find about how many poses; from there ascended ones, whose predicted error is smaller, decide.
    """
    assert options.accuracy_mm is not None
    wanted = MM.to_si(options.accuracy_mm)
    most = max(least, min(_MOST_POSES, len(problem.pool) // 2))

    def bound(design: Design) -> float:
        return predicted_accuracy(problem, design.joints, options.seed).coverage_radius

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


def curve_sizes(problem: PoseProblem, least: int, count: int) -> list[int]:
    """Return the numbers of poses at which a curve is computed, around a plan of ``count``; ``least`` is possible."""
    most = max(least, min(max(2 * count, least + 10), len(problem.pool) // 2, max(_MOST_POSES, count)))
    sizes: list[int] = np.unique(np.geomspace(least, most, _CURVE_STEPS).round().astype(int)).tolist()
    return sizes


def designed_steps(
    options: DesignOptions, problem: PoseProblem, sizes: Sequence[int], quick: Callable[[int], Design], progress: Stage
) -> Iterator[DesignStep]:
    """Yield the predicted error and O1 of exchanged designs of these sizes."""
    for done, size in enumerate(sizes):
        progress(f"5 of 5, curve, {size} poses", done, len(sizes))
        chosen = quick(size)
        o1 = float(indices(np.concatenate([chosen.jacobian, problem.before])).o1)
        yield DesignStep(size, predicted_accuracy(problem, chosen.joints, options.seed), o1)


def continuous_steps(
    options: DesignOptions,
    problem: PoseProblem,
    sizes: Sequence[int],
    pool: Array,
    design: Design,
    certificate: DesignCertificate,
) -> Iterator[DesignStep]:
    """Yield the predicted error and O1 of the certificate's continuous design, whose weights share out so many poses.

    At little cost: a design of whole poses comes near it where there are several times as many as the fewest.
    """
    support = np.flatnonzero(certificate.weights > _NO_WEIGHT)
    weights = certificate.weights[support] / certificate.weights[support].sum()
    inputs = np.concatenate([problem.inputs, design.joints[design.rows < 0]])[support]
    weighted = np.sqrt(weights)[:, None, None]
    per_pose, before = information(weighted * problem.whitened(inputs)), information(problem.whitened(problem.already))

    def predicted(total: Array) -> PredictedAccuracy:
        return predict(total, problem.test, rng_for(options.seed, "promise"))

    alone = None if before.any() else predicted(per_pose)
    for size in sizes:
        rows = np.concatenate([np.sqrt(size) * weighted * pool[support], problem.before])
        o1 = indices(rows * np.sqrt(len(rows) / (size + len(problem.before)))).o1
        prediction = predicted(size * per_pose + before) if alone is None else alone.repeated(size)
        yield DesignStep(size, prediction, float(o1))


_ROUNDS = 4  # uphill


def best_design(options: DesignOptions, problem: PoseProblem, count: int, progress: Stage = no_stage) -> Design:
    """Return the best of several starts, each exchanged among the candidates and then moved uphill.

    The best start is chosen after the first round uphill, which gains most; that one alone continues.
    """
    rng = rng_for(options.seed, "design")
    best: Design | None = None
    for start in range(options.starts):
        progress(f"2 of 5, design of {count} poses, start {start + 1} of {options.starts}", start, options.starts)
        design = _uphill(problem, _exchanged(problem, count, rng), 1)
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
    aim = OneCriterion(problem.sensitivity, problem.goal, information(problem.before))
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


def _exchanged(problem: PoseProblem, count: int, rng: np.random.Generator) -> Design:
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
