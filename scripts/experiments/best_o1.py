"""The best O1 of the thesis' case (fig. IV.2): 20 poses, 19 parameters, the flange's origin, millimetres and radians.

Mahdadi & Bouafia (2020) found 12.2487 without joint limits; random poses within the limits have 9.87.
"""

import time
from dataclasses import dataclass

import numpy as np
from shared import Answer, Document, Flag, run_script

from lab.core.se3 import Array
from lab.extensions.reproduction.thesis_case import searched
from lab.pose_selection.criteria import indices

CANDIDATES, STARTS = 1000, 12


@dataclass(frozen=True)
class Options:
    """Which search."""

    ignore_limits: Flag = False
    """Let every joint turn freely, as the thesis does."""
    seed: int = 0
    """Of the candidates and the starts."""
    json: Flag = False
    """Print one JSON object."""


def best_o1(seed: int, *, limits: bool) -> tuple[Array, float]:
    """Joint angles ``(20, 6)`` and their O1, the best of several exchanges, each followed by an ascent."""
    best = searched("O1", seed, CANDIDATES, STARTS, limits=limits)
    return best.joints, float(indices(best.jacobian).o1)


def answer(options: Options) -> Answer:
    """The best O1 of a seed, with and without limits as asked."""
    began = time.perf_counter()
    joints, o1 = best_o1(options.seed, limits=not options.ignore_limits)
    seconds = time.perf_counter() - began
    where = "without limits (the thesis: 12.2487)" if options.ignore_limits else "within the limits (random: 9.87)"
    values = {"o1": o1, "seconds": seconds, "joints_deg": np.rad2deg(joints).tolist()}
    return Answer(values, Document(f"O1 = {o1:.4f} {where}, in {seconds:.1f} s", ()))


if __name__ == "__main__":
    run_script("best_o1")
