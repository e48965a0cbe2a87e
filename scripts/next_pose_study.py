"""Does `lab next` keep its predicted accuracy although it stops by the data, and how many poses does it save?

Virtual IRB 120s, each measured pose by pose as proposed, until the wanted accuracy is predicted. The arm is then
identified from these poses alone, and its error at 500 random poses compared with the wanted one: the prediction is
kept where 95 % of them are within it. Beside it: how many poses a design made beforehand takes to the same prediction,
and how many random ones.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from shared import Answer, Document, Flag, Section, Table, paragraphs, run_script, short

import lab
from lab.calibration.identify import identify
from lab.campaign.robot import load_robot
from lab.commands.next.planner import PosePlanner
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.core.probability import beta_ppf
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.simulation.collisions import random_poses

HALF_WIDTH_M = 8e-6  # of the uniform noise
_VALIDATION_POSES = 500
_MOST_POSES = 300


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    campaigns: int = 1000
    """Virtual arms, measured one pose after the other."""
    accuracy_mm: float = 0.01
    """The wanted error of 95 % of the poses in 95 % of the campaigns."""
    criterion: str = "I"
    """Of the proposals and of the design made beforehand."""
    noise_times: float = 1.0
    """True noise, as a multiple of the stated noise."""
    random_sets: int = 20
    """Random sets of poses, for comparison."""
    seed: int = 0
    """Of all draws."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Campaign:
    """A campaign that was measured until the prediction reached the wanted accuracy.

    Attributes:
        poses: that were measured.
        error_m: that 95 % of the validation poses keep.
        larger: whether the noise was found to be larger than stated.
        seconds: of each proposal.
    """

    poses: int
    error_m: float
    larger: bool
    seconds: tuple[float, ...]


def rows_of(planner: PosePlanner, joints: list[Array], points: list[Array]) -> Measurements:
    """The measurements so far."""
    chain, targets = planner.problem.robot.chain, planner.options.targets
    shape = (len(joints), len(targets), 3)
    return measured(chain.joint_names, np.reshape(joints, (-1, chain.size)), targets, np.reshape(points, shape))


def campaigns(planner: PosePlanner, seeds: range, noise_times: float) -> Iterator[Campaign]:
    """Measure one virtual arm for each seed as the planner proposes, and judge the calibration.

    Raises:
        LabError: the wanted accuracy is out of reach.
    """
    robot, targets = planner.problem.robot, planner.options.targets
    for seed in seeds:
        real = lab.simulate(robot, poses=1, targets=targets, seed=seed).true_robot
        rng = rng_for(seed, "noise")
        joints, points, seconds = list[Array](), list[Array](), list[float]()
        while True:
            started, data = time.perf_counter(), rows_of(planner, joints, points)
            proposal = planner.propose(data)
            seconds.append(time.perf_counter() - started)
            if proposal.joints is None:
                break
            if len(joints) == _MOST_POSES:
                raise LabError(f"--accuracy-mm: not reached by {_MOST_POSES} poses")
            noise = noise_times * rng.uniform(-HALF_WIDTH_M, HALF_WIDTH_M, (len(targets), 3))
            joints.append(proposal.joints)
            points.append(real.points(proposal.joints[None], targets)[0] + noise)
        arm, fresh = planner.problem.arm, random_poses(robot.model, _VALIDATION_POSES, rng_for(seed, "fresh"))
        found = identify(arm, data, planner.problem.values)
        errors = np.linalg.norm(arm.points(fresh, found.values) - real.points(fresh, targets), axis=2)
        assert proposal.noise is not None
        yield Campaign(len(joints), float(np.quantile(errors, 0.95)), proposal.noise.larger, tuple(seconds))


def random_counts(planner: PosePlanner, sets: int, seed: int) -> list[int]:
    """How many random candidates reach the wanted accuracy, in each of some random orders."""
    rng, found, inputs = rng_for(seed, "split"), [], planner.problem.inputs
    for _ in range(sets):
        order = rng.permutation(len(inputs))
        low, high = 1, min(_MOST_POSES, len(order))
        while low < high:  # the prediction only improves with further poses
            middle = (low + high) // 2
            accuracy = planner.accuracy_of(inputs[order[:middle]])
            within = accuracy is not None and accuracy <= (planner.accuracy_m or 0.0)
            low, high = (low, middle) if within else (middle + 1, high)
        found.append(low)
    return found


def answer(options: Options) -> Answer:
    """All campaigns, beside a design made beforehand and random poses."""
    robot = load_robot("irb120")
    planner = PosePlanner(robot, accuracy_mm=options.accuracy_mm, criterion=options.criterion)
    seeds = range(options.seed, options.seed + options.campaigns)
    found = list(campaigns(planner, seeds, options.noise_times))
    kept = sum(each.error_m <= 1e-3 * options.accuracy_mm for each in found)
    beforehand = lab.design(robot, accuracy_mm=options.accuracy_mm, criterion=options.criterion)
    assert isinstance(beforehand, lab.DesignResult)
    poses, seconds = [each.poses for each in found], np.concatenate([each.seconds for each in found])
    by_chance = random_counts(planner, options.random_sets, options.seed)
    n = len(found)
    values = {
        "campaigns": n,
        "kept": kept / n,
        "kept_lower_95": float(beta_ppf(0.05, kept, n - kept + 1)) if kept else 0.0,
        "noise_found_larger": sum(each.larger for each in found),
        "poses": {"median": float(np.median(poses)), "least": min(poses), "most": max(poses)},
        "poses_designed_beforehand": len(beforehand.joints),
        "poses_by_chance": {"median": float(np.median(by_chance)), "least": min(by_chance), "most": max(by_chance)},
        "seconds": {"median": float(np.median(seconds)), "p95": float(np.quantile(seconds, 0.95))},
    }
    rows = (
        ("one after the other", str(min(poses)), short(float(np.median(poses))), str(max(poses))),
        ("designed beforehand", *(str(len(beforehand.joints)),) * 3),
        ("by chance", str(min(by_chance)), short(float(np.median(by_chance))), str(max(by_chance))),
    )
    text = (
        f"The wanted accuracy of {options.accuracy_mm:g} mm was kept in {kept} of {n} campaigns (lower 95 % limit "
        f"{100 * values['kept_lower_95']:.1f} %). The noise was found to be larger than stated in "  # type: ignore[operator]
        f"{values['noise_found_larger']}. A proposal took {np.median(seconds):.2f} s (median)."
    )
    table = Table(("poses", "least", "median", "most"), rows, "poses until the accuracy is predicted")
    return Answer(values, Document("Poses proposed while measuring", (*paragraphs([text]), Section("Poses", (table,)))))


if __name__ == "__main__":
    run_script("next_pose_study")
