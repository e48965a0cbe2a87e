"""A study whose campaigns cost nothing, for what runs studies; worker processes import it."""

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np

from lab.core.errors import LabError
from lab.studies.campaigns import COLUMNS
from lab.studies.executors import local_executor
from lab.studies.grid import GridCell, Study, Task
from lab.studies.run_study import run_study

STUDY = Study(name="toy", robots=4, draws=2000, factors={"poses": (12, 15)})  # 8 tasks


def posing(study: Study, cell: GridCell) -> np.ndarray:
    return np.random.default_rng([study.seed, cell.poses]).normal(size=(cell.poses, 6))


def solving(study: Study, task: Task, joints: np.ndarray) -> dict[str, np.ndarray]:
    """Every row from the numbers of its robot and draw, and the cell's poses, alone."""
    robots, draws = (
        part.ravel() for part in np.meshgrid(range(task.first, task.last), range(study.draws), indexing="ij")
    )
    rows = {"cell": np.full(len(robots), task.cell), "robot": robots, "draw": draws}
    rows |= {"converged": draws % 7 > 0, "steps": 3 + draws % 2}
    rows |= {"failure": np.where(rows["converged"], "", "not converged")}
    reals = [name for name in COLUMNS if name not in rows]
    return rows | {name: np.sin(robots + 1e-3 * draws + joints.sum() + k) for k, name in enumerate(reals)}


def slow(study: Study, task: Task, joints: np.ndarray) -> dict[str, np.ndarray]:
    time.sleep(0.15)
    return solving(study, task, joints)


def deadly(died: Path, study: Study, task: Task, joints: np.ndarray) -> dict[str, np.ndarray]:
    """The third task of the second cell kills its worker, once."""
    if task.cell == 1 and task.first == 2 and not died.exists():
        died.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return slow(study, task, joints)


def refused(study: Study, cell: GridCell) -> np.ndarray:
    raise LabError(f"factor poses: {cell.poses} are too few; give 99 or more")


if __name__ == "__main__":
    import toy_study  # a worker imports this module by its name, not as the script

    with local_executor(2) as executor:
        run_study(STUDY, Path(sys.argv[1]), executor, posing=toy_study.posing, solving=toy_study.slow)
