"""Virtual campaigns and runs that many tests read, each made once in a process.

- ``session(robot, **options)`` is ``lab.simulate``: measurements, the nominal robot and the true one.
- ``calibration(robot, **options)`` is ``lab.calibrate``: the result of a whole campaign.
- ``identification(rows, **options)`` is ``lab.identify`` of measurements in memory.
- ``run_of(robot, **options)`` is the folder of that calibration, without figures and recording.
- ``own_copy(run, folder)`` is a copy of such a folder, for a test that changes it or writes beside it.

The same options give the same object, so nothing of it may be changed: arrays refuse to be written, and a test of what
a run writes or draws makes its own. Ask for what others ask for: ``calibration(seed=7)`` where any calibration serves,
targets p1 and p2 where two are needed (``TWO``), and few poses only where they are the subject.
"""

import atexit
import shutil
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import lab
from helpers.drawing import nothing_drawn
from lab.core.measurements import Measurements

__all__ = ["TWO", "calibration", "identification", "own_copy", "run_of", "session"]

TWO = ("p1", "p2")


@cache
def session(robot: str = "irb120", **options: Any) -> lab.MeasurementSession:
    """The simulated session of these options of ``lab.simulate``."""
    simulated = lab.simulate(robot, **options)
    _freeze(simulated.measurements)
    return simulated


@cache
def calibration(robot: str = "irb120", **options: Any) -> lab.CalibrationResult:
    """The calibration of these options of ``lab.calibrate``."""
    result = lab.calibrate(robot, **options)
    _freeze(result.fitted)
    return result


@cache
def identification(rows: Measurements, robot: str | None = None, **options: Any) -> lab.CalibrationResult:
    """The identification of these measurements, which are told by their identity, with these options."""
    return lab.identify(rows, robot, **options)


@cache
def run_of(robot: str = "irb120", **options: Any) -> Path:
    """The folder of that calibration as ``lab calibrate`` writes it, but for figures and recording."""
    with nothing_drawn():
        return calibration(robot, **options).save(_folder() / str(len(list(_folder().iterdir()))))


def own_copy(run: Path, folder: Path) -> Path:
    """A copy of a run that a test may change, in a new folder."""
    return Path(shutil.copytree(run, folder))


@cache
def _folder() -> Path:
    folder = tempfile.mkdtemp(prefix="lab-tests-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def _freeze(data: Measurements) -> None:
    for each in vars(data).values():
        if isinstance(each, np.ndarray):
            each.flags.writeable = False
