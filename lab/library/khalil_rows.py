"""Base and tool of an estimate as the parameters of Khalil and Kleinfinger (1986), with intervals."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.serial.khalil_frames import ANGULAR, SYMBOLS, khalil_frame
from lab.library.result import number
from lab.prediction.estimate import Estimate

__all__ = ["khalil_rows"]

_STEP = 1e-6  # m or rad, of central differences
_BASE = tuple(f"base.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz"))
_TURN = ("tool.rx", "tool.ry", "tool.rz")


def khalil_rows(estimate: Estimate, width_95: float) -> list[dict[str, Any]]:
    """Return rows of Z (the base in the instrument's frame) and of E of each target (in the last frame), if any.

    Their intervals are those of the base and the tool, carried over by the derivatives. Where no orientation of the
    tool was measured, E's is that of the last frame, so that its axes are parallel; a ``note`` explains it. Without a
    base there are none.

    Args:
        estimate: of any model.
        width_95: half of the widest 95 % interval of a parameter, in standard deviations.
    """
    names = list(estimate.params)
    if not set(_BASE) <= set(names):
        return []
    owners = {"Z": list(_BASE)}
    turn = [name for name in _TURN if name in names]
    for target in estimate.rigid.targets:
        owners[f"E.{target}"] = [*(f"tool.{target}.{axis}" for axis in "xyz"), *turn]
    return [row for owner, index in owners.items() for row in _rows(owner, index, estimate, width_95)]


def _pose(values: Array) -> Array:
    """A pose of a position (m) and a rotation vector (rad), which may be left out."""
    return se3.pose(se3.exp(values[3:] if len(values) == 6 else np.zeros(3)), values[:3])


def _six(values: Array) -> Array:
    return khalil_frame(_pose(values)).values


def _rows(owner: str, names: Sequence[str], estimate: Estimate, wide: float) -> list[dict[str, Any]]:
    given = [estimate.params[name] for name in names]
    values = np.array([each.estimate for each in given])
    frame = khalil_frame(_pose(values))
    nominal, exported = (_six(np.array([getattr(row, key) for row in given])) for key in ("nominal", "exported"))
    std = _deviations(values, names, estimate)
    rows = []
    for i, symbol in enumerate(SYMBOLS):
        value, deviation = float(frame.values[i]), None if frame.note else number(float(std[i]))
        row: dict[str, Any] = {
            "name": f"{owner}.{symbol}",
            "unit": "rad" if ANGULAR[i] else "m",
            "nominal": float(nominal[i]),
            "estimate": value,
            "exported": float(exported[i]),
            "std": deviation,
            "interval_95": None if deviation is None else [value - wide * deviation, value + wide * deviation],
            "status": "converted",
            "weakly_observable": False,
            "aliases": {},
        }
        rows.append(row | ({"note": frame.note} if frame.note else {}))
    return rows


def _deviations(values: Array, names: Sequence[str], estimate: Estimate) -> Array:
    """Standard deviations ``(6,)`` of the six, from those of the fitted ones among these parameters."""
    fitted = [k for k, name in enumerate(names) if name in estimate.identified]
    steps = _STEP * np.eye(len(names))[fitted]
    slopes = np.array([(_six(values + step) - _six(values - step)) / (2 * _STEP) for step in steps]).reshape(-1, 6)
    at = [estimate.identified.index(names[k]) for k in fitted]
    return np.sqrt(np.maximum(np.diag(slopes.T @ estimate.covariance[np.ix_(at, at)] @ slopes), 0.0))
