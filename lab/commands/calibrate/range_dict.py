"""The measured range of the joint positions, as ``result.json`` and ``fitted_poses.csv`` of a run hold it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lab.calibration.extrapolation import MeasuredRange
from lab.calibration.pose_cover import PoseCover
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.csv_table import CsvTable, write_columns
from lab.formats.structured import structured
from lab.kinematics.joints import JointSpec

__all__ = [
    "POSES_FILE",
    "Extrapolation",
    "extrapolation_to_dict",
    "measured_range_from_dict",
    "measured_range_to_dict",
    "read_cover",
    "write_cover",
]

POSES_FILE = "fitted_poses.csv"
_KEYS = ("lower", "upper", "edge")


@dataclass(frozen=True)
class Extrapolation:
    """What the model may lack where nothing was measured, as ``result.json`` holds it; its keys.

    Attributes:
        growth_mrad, unsure_mrad: None in a run that knows neither.
    """

    growth_mrad: float | None = None
    unsure_mrad: float | None = None

    def __post_init__(self) -> None:
        """Refuse a size below zero, with a LabError."""
        if min(self.growth_mrad or 0.0, self.unsure_mrad or 0.0) < 0:
            raise LabError("extrapolation: growth_mrad and unsure_mrad are to be numbers of zero or more")


def measured_range_to_dict(measured: MeasuredRange | None, chain: JointSpec) -> dict[str, Any] | None:
    """By joint: limits and the width of the edges, deg (mm of a slide), and the slope; None where nothing is known."""
    if measured is None:
        return None
    found = {}
    for i, name in enumerate(chain.joint_names):
        unit, factor = _unit(chain.prismatic[i])
        sizes = zip(_KEYS, (measured.lower[i], measured.upper[i], measured.edge[i]), strict=True)
        found[name] = {f"{key}_{unit}": float(size / factor) for key, size in sizes} | {
            "slope_beyond": float(measured.slope[i])
        }
    return found


def extrapolation_to_dict(
    measured: MeasuredRange | None, workspace: tuple[float, float], validation: Array | None, *, process: bool
) -> dict[str, Any] | None:
    """What the model may lack where nothing was measured, and how much of workspace and validation lies there.

    Args:
        workspace: the shares of it that are beyond the measured range, and that no measured pose covers.
        validation: joint positions ``(n, joints)`` of the validation poses; None without any.
        process: whether what no group explains is predicted, too: then something is lacking in any case.
    """
    if measured is None:
        return None
    lacks = process or measured.is_worse_beyond
    lone = None if validation is None else int((measured.uncovered(validation) & lacks).sum())
    return {
        "growth_mrad": 1e3 * measured.growth,
        "unsure_mrad": 1e3 * measured.unsure,
        "workspace_beyond_share": workspace[0],
        "workspace_extrapolated_share": workspace[1],
        "validation_extrapolated": lone,
    }


def measured_range_from_dict(
    content: Mapping[str, Mapping[str, float]] | None,
    extrapolation: Mapping[str, Any] | Extrapolation | None,
    chain: JointSpec,
    cover: PoseCover | None = None,
) -> MeasuredRange | None:
    """The range that ``measured_range_to_dict`` and ``extrapolation_to_dict`` wrote; None where they wrote none.

    Args:
        cover: the fitted poses; None where the run keeps none, as those of older versions.

    Raises:
        LabError: it lacks a joint or a number, or limits are the wrong way round.
    """
    if content is None:
        return None
    rows = [
        _row(name, content.get(name), *_unit(slides))
        for name, slides in zip(chain.joint_names, chain.prismatic, strict=True)
    ]
    lower, upper, edge, slope = np.array(rows).T
    lacking = structured("extrapolation", Extrapolation, {} if extrapolation is None else extrapolation, extra=True)
    growth, unsure = (size / 1e3 for size in (lacking.growth_mrad or 0.0, lacking.unsure_mrad or 0.0))
    turning = ~np.array(chain.prismatic, dtype=np.bool_)
    return MeasuredRange(lower, upper, turning, edge, slope, growth, unsure, cover)


def write_cover(path: Path, cover: PoseCover, chain: JointSpec) -> None:
    """A row a distinct fitted pose, of very many some: joint positions, deg (mm of a slide)."""
    columns = {}
    for name, slides, positions in zip(chain.joint_names, chain.prismatic, cover.poses.T, strict=True):
        unit, factor = _unit(slides)
        columns[f"{name}_{unit}"] = [f"{value:.9g}" for value in (positions / factor).tolist()]
    write_columns(path, columns)


def read_cover(folder: Path, chain: JointSpec) -> PoseCover | None:
    """The poses that a run fitted; None of a run that keeps none.

    Raises:
        LabError: the file does not hold what a run writes.
    """
    path = folder / POSES_FILE
    if not path.is_file():
        return None
    table, columns = CsvTable(path), []
    for name, slides in zip(chain.joint_names, chain.prismatic, strict=True):
        unit, factor = _unit(slides)
        if table.texts(column := f"{name}_{unit}") is None:
            raise LabError(f"{path}: has no column {column}; run lab calibrate or lab identify again")
        columns.append(factor * table.numbers(column))
    return PoseCover.of(np.stack(columns, axis=1), ~np.array(chain.prismatic, dtype=np.bool_))


def _row(joint: str, content: Mapping[str, float] | None, unit: str, factor: float) -> list[float]:
    """Lower and upper limit, width of the edges (rad or m) and slope of one joint."""
    names = [*(f"{key}_{unit}" for key in _KEYS), "slope_beyond"]
    if missing := [name for name in names if name not in (content or {})]:
        raise LabError(f"measured_range: '{joint}.{missing[0]}' is missing")
    assert content is not None
    lower, upper, edge, slope = (content[name] for name in names)
    if not (lower <= upper and edge >= 0 and slope >= 0):
        raise LabError(f"measured_range.{joint}: is no range with edges and a slope of zero or more")
    return [factor * lower, factor * upper, factor * edge, slope]


def _unit(slides: bool) -> tuple[str, float]:
    """A unit for a person, and how many rad or m it is."""
    return ("mm", 1e-3) if slides else ("deg", np.pi / 180)
