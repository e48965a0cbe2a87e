"""The joints' offsets that no group explains: ``residual.csv`` of a run's folder, and sizes in ``result.json``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lab.calibration.residual.kernels import COMPONENTS
from lab.calibration.residual.process import GROUP, UPPER_QUARTILE, JointProcess
from lab.core.errors import LabError
from lab.core.ranges import NUMBER_SIZE
from lab.core.se3 import Array
from lab.formats.csv_table import CsvTable, write_columns
from lab.formats.structured import structured
from lab.kinematics.joints import JointSpec

__all__ = ["RESIDUAL_FILE", "ResidualSizes", "read_residual", "residual_columns", "residual_to_dict", "write_residual"]

RESIDUAL_FILE = "residual.csv"


@dataclass(frozen=True)
class ResidualSizes:
    """Sizes of the process as ``result.json`` holds them; its keys."""

    p: float
    variances: Mapping[str, float]
    upper_quartiles: Mapping[str, float]
    variance_errors: Sequence[Sequence[float]] | None = None
    bound_factor: float = 1.0

    def __post_init__(self) -> None:
        """Refuse what lacks a component, or has a variance below zero, with a LabError."""
        for name in ("variances", "upper_quartiles"):
            sizes = getattr(self, name)
            if missing := [each for each in self.components if each not in sizes]:
                raise LabError(f"residual.{name}: '{missing[0]}' is missing")
            if min(sizes.values()) < 0:
                raise LabError(f"residual.{name}: a variance is not below zero")
        if not self.bound_factor > 0:
            raise LabError("residual.bound_factor: a factor of variances is above zero")
        if self.variance_errors is not None and np.shape(self.variance_errors) != (len(COMPONENTS),) * 2:
            raise LabError(f"residual.variance_errors: not {len(COMPONENTS)} rows of {len(COMPONENTS)} numbers")

    @property
    def components(self) -> tuple[str, ...]:
        """Those that the run has: one of an older version has no smooth ones, and no covariance of its variances."""
        return COMPONENTS if self.variance_errors is not None else tuple(c for c in COMPONENTS if c[:6] != "smooth")

    @property
    def errors(self) -> Array:
        """``(c, c)`` covariance of the variances; of an older run as its upper quartiles say, fully correlated."""
        if self.variance_errors is not None:
            return np.array(self.variance_errors)
        apart = [self.upper_quartiles.get(c, 0.0) - self.variances.get(c, 0.0) for c in COMPONENTS]
        return np.outer(apart, apart) / UPPER_QUARTILE**2


def residual_to_dict(process: JointProcess | None) -> dict[str, Any] | None:
    """The sizes of the process, SI variances too; None where there is none."""
    if process is None:
        return None
    return {
        "poses": len(process.inputs),
        "p": process.p,
        "noise_mm": 1e3 * process.noise_m,
        "joint_scatter_mrad": 1e3 * process.scatter_rad,
        "variances": dict(zip(COMPONENTS, process.variances.tolist(), strict=True)),
        "upper_quartiles": dict(zip(COMPONENTS, process.upper.tolist(), strict=True)),
        "variance_errors": process.errors.tolist(),
        "bound_factor": process.factor,
    }


def write_residual(path: Path, process: JointProcess, columns: Sequence[str]) -> None:
    """A row a pose that the offsets come from: its inputs, which targets were seen, the joints' weights; SI.

    Args:
        columns: names of the inputs, then of the targets, then of the joints.
    """
    rows = np.concatenate([process.inputs, process.seen, process.weights], axis=1)
    write_columns(path, {name: list(map(repr, column.tolist())) for name, column in zip(columns, rows.T, strict=True)})


def residual_columns(chain: JointSpec, conditions: Sequence[str], targets: Sequence[str]) -> list[str]:
    """Names of the columns of ``residual.csv``."""
    joints = [f"position_{name}" for name in chain.joint_names]
    return [*joints, *conditions, *(f"seen_{name}" for name in targets), *(f"weight_{n}" for n in chain.joint_names)]


def read_residual(
    folder: Path,
    content: Mapping[str, Any] | ResidualSizes | None,
    chain: JointSpec,
    conditions: Sequence[str],
    targets: Sequence[str],
) -> JointProcess:
    """The process of a run.

    Args:
        content: of ``result.json``, what ``residual_to_dict`` made.
        conditions: that the arm's effects ask for.

    Raises:
        LabError: a file does not hold what a run writes.
    """
    path = folder / RESIDUAL_FILE
    try:
        if content is None:
            raise LabError(f"has no {GROUP}, which the model has")
        table = CsvTable(path)
        names = residual_columns(chain, conditions, targets)
        if tuple(table.header) != tuple(names):
            raise LabError(f"{RESIDUAL_FILE}: its columns are not {', '.join(names)}")
        rows = np.array([table.texts(name) for name in names], dtype=np.float64).T
        found = structured("residual", ResidualSizes, content, extra=True)
    except (LabError, ValueError) as error:
        raise LabError(f"{folder}: {error}; run lab calibrate or lab identify again") from error
    if not (np.abs(rows) <= NUMBER_SIZE.most).all():
        raise LabError(f"{path}: has numbers that cannot be; run lab calibrate or lab identify again")
    size, first = chain.size, chain.size + len(conditions)
    seen = rows[:, first : first + len(targets)] > 0
    turning = ~np.array(chain.prismatic, dtype=np.bool_)
    likely = np.array([found.variances.get(name, 0.0) for name in COMPONENTS])
    inputs, weights = map(np.ascontiguousarray, (rows[:, :first], rows[:, -size:]))  # as in memory: sums round alike
    return JointProcess(inputs, seen, likely, found.errors, weights, turning, found.p, found.bound_factor)
