"""The search for a design: exchange among the candidates, then uphill in all joint angles, from several starts."""

import json
from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from lab.campaign.design_problem import PoseProblem
from lab.campaign.options import DesignOptions
from lab.core.kept_pieces import Columns, current_keep
from lab.core.random import rng_for
from lab.pose_selection.exchange import Design, ascend, exchange
from lab.render.progress import Stage, no_stage
from lab.simulation.candidate_poses import MARGIN

__all__ = ["best_design", "exchanged"]

_ROUNDS = 4  # uphill


def best_design(options: DesignOptions, problem: PoseProblem, count: int, progress: Stage = no_stage) -> Design:
    """The best of several starts, each exchanged among the candidates and then moved uphill.

    The first round uphill gains most, and tells which start is the best: that one alone goes on.
    """
    rng = rng_for(options.seed, "design")
    best: Design | None = None
    for start in range(options.starts):
        progress(f"2 of 5, design of {count} poses, start {start + 1} of {options.starts}", start, options.starts)
        design = _begun(problem, count, rng)
        if best is None or design.score > best.score:
            best = design
    assert best is not None
    return _uphill(problem, best, _ROUNDS - 1)


def _begun(problem: PoseProblem, count: int, rng: np.random.Generator) -> Design:
    """One start, exchanged and moved uphill once: kept with the state in which it leaves the generator."""

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
    further = problem.inputs.shape[1] - chain.size  # columns of stations, which stay as they are: nothing slopes there
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
    """A design among the candidates to which a free way leads."""
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
