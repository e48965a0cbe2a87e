"""When is which model worth its poses? The error at held-out poses against the number of poses that were measured.

A share of the poses, whole configurations, is held out once for all. The others are taken in an order by chance, more
and more of them: each model is chosen and fitted on these alone.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from shared import Answer, Document, Flag, Section, Table, run_script, short

import lab
from lab.calibration.row_groups import configurations, split_by_label
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.formats.measurement_csv import read_measurements
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot


@dataclass(frozen=True)
class Options:
    """What to learn from."""

    file: Path
    """Measured points, a CSV file."""
    robot: str = "irb120"
    """The nominal robot: a model's name or a path."""
    models: tuple[str, ...] = ("geometric", "auto", "residual")
    """Models to identify, as ``--model`` names them."""
    poses: tuple[int, ...] = (100, 200, 400, 800)
    """How many poses to fit."""
    holdout: float = 0.3
    """Share of the poses that judge."""
    seed: int = 0
    """Of the split and the order."""
    json: Flag = False
    """Print one JSON object."""


def errors_by_poses(
    robot: Robot, data: Measurements, models: tuple[str, ...], poses: tuple[int, ...], share: float, seed: int
) -> dict[str, dict[str, float]]:
    """Mean error (mm) at the same held-out poses, by model and number of fitted poses.

    Args:
        share: of the poses that are held out.
        seed: of the split, and of the order in which the others are taken.

    Raises:
        LabError: more poses are asked for than there are.
    """
    fitted, held = split_by_label(configurations(data.joints), share, seed)
    if max(poses) > len(fitted):
        raise LabError(f"--poses {max(poses)}: {len(fitted)} poses are not held out; ask for no more")
    order = np.random.default_rng(seed).permutation(fitted)
    found: dict[str, dict[str, float]] = {}
    for model in models:
        found[model] = {}
        for count in poses:
            rows = data[np.sort(order[:count])]
            result = lab.identify(rows, robot, model=model, seed=seed, validate=data[held])
            assert result.validation.errors is not None
            found[model][str(count)] = float(1e3 * np.nanmean(result.validation.errors.after))
    return found


def answer(options: Options) -> Answer:
    """All models with all numbers of poses."""
    robot = load_robot(options.robot)
    data = read_measurements(options.file, robot.chain.joint_names, robot.chain.prismatic)
    found = errors_by_poses(robot, data, options.models, options.poses, options.holdout, options.seed)
    rows = tuple((model, *(short(error) for error in found[model].values())) for model in options.models)
    columns = ("model", *(f"{count} poses" for count in options.poses))
    table = Table(columns, rows, "mean error at the held-out poses, mm")
    return Answer(found, Document("When is which model worth its poses?", (Section("Learning curves", (table,)),)))


if __name__ == "__main__":
    run_script("learning_curve")
