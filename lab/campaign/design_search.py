"""The search for a design: exchange among the candidates, then uphill in all joint angles, from several starts."""

import numpy as np

from lab.campaign.design_problem import PoseProblem
from lab.campaign.options import DesignOptions
from lab.core.random import rng_for
from lab.pose_selection.exchange import Design, ascend, exchange
from lab.render.progress import Stage, no_stage
from lab.simulation.candidate_poses import MARGIN

__all__ = ["best_design", "exchanged"]


def best_design(options: DesignOptions, problem: PoseProblem, count: int, progress: Stage = no_stage) -> Design:
    """The best of several starts, each exchanged among the candidates and then moved uphill."""
    rng, chain, measured = rng_for(options.seed, "design"), problem.robot.chain, problem.measured
    keep_off = MARGIN * (chain.upper - chain.lower)
    best: Design | None = None
    for start in range(options.starts):
        progress(f"2 of 5, design of {count} poses, start {start + 1} of {options.starts}", start, options.starts)
        design = ascend(
            exchanged(problem, count, rng),
            problem.sensitivity,
            problem.goal,
            problem.access.feasible,
            chain.lower + keep_off,
            chain.upper - keep_off,
            measured=measured,
        )
        if best is None or design.score > best.score:
            best = design
    assert best is not None
    return best


def exchanged(problem: PoseProblem, count: int, rng: np.random.Generator) -> Design:
    """A design among the candidates to which a free way leads.

    Those without are left out as they are chosen; others take their places, and the exchange goes on from there.
    """
    left, first = np.arange(len(problem.pool)), None
    while True:
        design = exchange(
            problem.candidates.joints[left],
            problem.pool[left],
            count,
            problem.goal,
            rng,
            starts=1,
            measured=problem.measured,
            first=first,
        )
        cut_off = ~problem.access.reachable(design.joints)
        if not cut_off.any():
            return Design(left[design.rows], design.joints, design.jacobian, design.score)
        kept = left[design.rows[~cut_off]]
        left = np.delete(left, design.rows[cut_off])
        if len(left) < count:
            first = None  # which the exchange refuses
            continue
        others = rng.choice(np.setdiff1d(left, kept), int(cut_off.sum()), replace=False)
        first = np.searchsorted(left, np.concatenate([kept, others]))
