"""What other searches would have chosen: the poses of a study's cells by other seeds, and their predicted errors.

A study's intervals are for the poses that it has. Another search by the same criterion ends at other poses; how much
that matters is predicted to first order, for the nominal arm.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lab.campaign.robot import load_virtual
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.gauge import base_set
from lab.simulation.collisions import random_poses
from lab.studies.grid import Cell, Study
from lab.studies.store import read_store

__all__ = ["other_searches", "predicted_rms"]


def predicted_rms(study: Study, designs: Sequence[Array]) -> Array:
    """RMS position error (m, per m of noise) at the study's validation poses, of designs ``(n, joints)``."""
    robot = load_virtual(study.robot)
    model, arm = robot.model, robot.arm(study.targets)
    values = model.values_before(arm, model.T_world_tracker)
    kept = list(base_set(arm, values).kept)

    def rates(joints: Array) -> Array:
        return arm.observe(joints, values)[1][..., kept].reshape(-1, len(kept))

    fresh = random_poses(model, study.fresh, rng_for(study.seed, "fresh"))
    flat, places = rates(fresh), len(fresh) * len(study.targets)
    spread = flat.T @ flat / places
    seen = [rates(joints) for joints in designs]
    return np.sqrt([np.trace(np.linalg.solve(each.T @ each, spread)) for each in seen])


def other_searches(
    study: Study, seeds: Sequence[int], folder: Path, run: Callable[[Study, Path], object], reference: str
) -> dict[Cell, tuple[float, ...]]:
    """By cell, and for each seed, the predicted error over that of the reference criterion's poses of the same seed.

    Args:
        run: makes the poses of a study, into a folder.
    """
    ratios: dict[Cell, tuple[float, ...]] = dict.fromkeys(study.cells, ())
    for seed in seeds:
        another = replace(study, seed=seed, robots=1, draws=1)
        run(another, folder / f"search{seed}")
        store = read_store(folder / f"search{seed}")
        designs = [store.read_poses(number) for number in range(len(study.cells))]
        found = predicted_rms(study, [joints for joints in designs if joints is not None])
        best = {cell.poses: rms for cell, rms in zip(study.cells, found, strict=True) if cell.criterion == reference}
        for cell, rms in zip(study.cells, found, strict=True):
            ratios[cell] += (float(rms / best[cell.poses]),)
    return ratios
