"""The measured range of the joint positions, as ``result.json`` holds it."""

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from lab.calibration.extrapolation import MeasuredRange
from lab.core.errors import LabError
from lab.kinematics.joints import JointSpec

__all__ = ["measured_range_from_dict", "measured_range_to_dict"]

_KEYS = ("lower", "upper", "edge")


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


def measured_range_from_dict(content: Mapping[str, Any] | None, chain: JointSpec) -> MeasuredRange | None:
    """The range that ``measured_range_to_dict`` wrote; None where it wrote none.

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
    return MeasuredRange(lower, upper, ~np.array(chain.prismatic, dtype=np.bool_), edge, slope)


def _row(joint: str, content: object, unit: str, factor: float) -> list[float]:
    """Lower and upper limit, width of the edges (rad or m) and slope of one joint."""
    names = [*(f"{key}_{unit}" for key in _KEYS), "slope_beyond"]
    found = [content.get(name) if isinstance(content, Mapping) else None for name in names]
    for name, value in zip(names, found, strict=True):
        if isinstance(value, bool) or not isinstance(value, float | int):
            raise LabError(f"measured_range.{joint}.{name}: {value!r} is to be a number")
    lower, upper, edge, slope = (float(cast(float, value)) for value in found)
    if not (lower <= upper and edge >= 0 and slope >= 0):
        raise LabError(f"measured_range.{joint}: is no range with edges and a slope of zero or more")
    return [factor * lower, factor * upper, factor * edge, slope]


def _unit(slides: bool) -> tuple[str, float]:
    """A unit for a person, and how many rad or m it is."""
    return ("mm", 1e-3) if slides else ("deg", np.pi / 180)
