"""The measured range of the joint positions, as ``result.json`` holds it."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from lab.calibration.extrapolation import MeasuredRange
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
    """The range that ``measured_range_to_dict`` wrote; None where it wrote none."""
    if content is None:
        return None
    rows = []
    for name, slides in zip(chain.joint_names, chain.prismatic, strict=True):
        unit, factor = _unit(slides)
        rows.append([*(factor * content[name][f"{key}_{unit}"] for key in _KEYS), content[name]["slope_beyond"]])
    lower, upper, edge, slope = np.array(rows).T
    return MeasuredRange(lower, upper, ~np.array(chain.prismatic, dtype=np.bool_), edge, slope)


def _unit(slides: bool) -> tuple[str, float]:
    """A unit for a person, and how many rad or m it is."""
    return ("mm", 1e-3) if slides else ("deg", np.pi / 180)
