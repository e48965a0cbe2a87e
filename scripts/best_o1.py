"""The best O1 of the thesis' case (fig. IV.2): 20 poses, 19 parameters, the flange's origin, millimetres and radians.

Mahdadi & Bouafia (2020) found 12.2487 without joint limits; random poses within the limits have 9.87.
"""

import argparse
import json
import time

import numpy as np

from lab.experiments.thesis_mahdadi_2020 import searched
from lab.pose_selection.criteria import indices

CANDIDATES, STARTS = 1000, 12


def best_o1(seed: int, *, limits: bool) -> tuple[np.ndarray, float]:
    """Joint angles ``(20, 6)`` and their O1, the best of several exchanges, each followed by an ascent."""
    best = searched("O1", seed, CANDIDATES, STARTS, limits=limits)
    return best.joints, float(indices(best.jacobian).o1)


def main() -> None:
    """Print the best O1 of a seed, with and without limits as asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ignore-limits", action="store_true", help="let every joint turn freely, as the thesis does")
    parser.add_argument("--seed", type=int, default=0, help="of the candidates and the starts")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    started = time.perf_counter()
    joints, o1 = best_o1(arguments.seed, limits=not arguments.ignore_limits)
    seconds = time.perf_counter() - started
    if arguments.json:
        print(json.dumps({"o1": o1, "seconds": seconds, "joints_deg": np.rad2deg(joints).tolist()}))
        return
    where = "without limits (the thesis: 12.2487)" if arguments.ignore_limits else "within the limits (random: 9.87)"
    print(f"O1 = {o1:.4f} {where}, in {seconds:.1f} s")


if __name__ == "__main__":
    main()
