"""Base and tool of a run in Khalil and Kleinfinger's parameters, as further rows of ``parameters.json``."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from lab.calibration.identify import Identification
from lab.commands.values import number
from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.parameter import targets_of
from lab.kinematics.serial.khalil_frames import ANGULAR, SYMBOLS, khalil_frame

__all__ = ["khalil_rows"]

_STEP = 1e-6  # m or rad, of central differences
_BASE = tuple(f"base.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz"))
_TURN = ("tool.rx", "tool.ry", "tool.rz")


def khalil_rows(found: Identification, nominal: Array, exported: Array) -> list[dict[str, Any]]:
    """Rows of Z (the base in the instrument's frame) and of E of each target (in the last frame); none without a base.

    Their intervals are those of the base and the tool, carried over by the derivatives. Where no orientation of the
    tool was measured, E's is that of the last frame, so that its axes are parallel; a ``note`` says it.

    Args:
        found: of any model.
        nominal, exported: ``(p,)`` as the other rows have them.
    """
    names = found.model.names
    if not set(_BASE) <= set(names):
        return []
    owners = {"Z": [names.index(name) for name in _BASE]}
    turn = [names.index(name) for name in _TURN if name in names]
    for target in targets_of(found.model.parameters):
        owners[f"E.{target}"] = [*(names.index(f"tool.{target}.{axis}") for axis in "xyz"), *turn]
    return [row for owner, index in owners.items() for row in _rows(owner, index, found, (nominal, exported))]


def _pose(values: Array) -> Array:
    """A pose of a position (m) and a rotation vector (rad), which may be left out."""
    return se3.pose(se3.exp(values[3:] if len(values) == 6 else np.zeros(3)), values[:3])


def _six(values: Array) -> Array:
    return khalil_frame(_pose(values)).values


def _rows(owner: str, index: Sequence[int], found: Identification, others: tuple[Array, Array]) -> list[dict[str, Any]]:
    values = found.values[list(index)]
    frame, nominal, exported = khalil_frame(_pose(values)), *(_six(each[list(index)]) for each in others)
    std, wide = _deviations(values, index, found), float(found.half_width_95.max())
    rows = []
    for i, symbol in enumerate(SYMBOLS):
        estimate, deviation = float(frame.values[i]), None if frame.note else number(float(std[i]))
        row: dict[str, Any] = {
            "name": f"{owner}.{symbol}",
            "unit": "rad" if ANGULAR[i] else "m",
            "nominal": float(nominal[i]),
            "estimate": estimate,
            "exported": float(exported[i]),
            "std": deviation,
            "interval_95": None if deviation is None else [estimate - wide * deviation, estimate + wide * deviation],
            "status": "converted",
            "weakly_observable": False,
            "aliases": {},
        }
        rows.append(row | ({"note": frame.note} if frame.note else {}))
    return rows


def _deviations(values: Array, index: Sequence[int], found: Identification) -> Array:
    """Standard deviations ``(6,)`` of the six, from those of the fitted ones among these parameters."""
    free = list(found.fit.free)
    fitted = [k for k, parameter in enumerate(index) if parameter in free]
    steps = _STEP * np.eye(len(index))[fitted]
    slopes = np.array([(_six(values + step) - _six(values - step)) / (2 * _STEP) for step in steps]).reshape(-1, 6)
    at = [free.index(index[k]) for k in fitted]
    return np.sqrt(np.maximum(np.diag(slopes.T @ found.covariance[np.ix_(at, at)] @ slopes), 0.0))
