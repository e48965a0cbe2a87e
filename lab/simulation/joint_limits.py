"""Limits, speeds and accelerations of a model's joints."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array

__all__ = ["joint_limits"]

# an MJCF's <custom><numeric>, in joint order; mm for a slide
_SPEED_KEY, _ACCELERATION_KEY = "joint_speed_deg_per_s", "joint_acceleration_deg_per_s2"


def joint_limits(path: Path, model: mujoco.MjModel, names: Sequence[str]) -> tuple[Array, Array, Array, Array]:
    """Lower and upper limits, speeds and accelerations ``(n,)``, rad or m (per s, s^2); NaN where these are not given.

    Raises:
        LabError: a range is crossed, a slide has none, or the speeds are not one for each joint and above zero.
    """
    lower, upper, scale = np.empty(len(names)), np.empty(len(names)), np.empty(len(names))
    for i, name in enumerate(names):
        joint = model.joint(name)
        slides = joint.type[0] == mujoco.mjtJoint.mjJNT_SLIDE
        scale[i] = 1e-3 if slides else np.pi / 180
        if joint.range[0] > joint.range[1]:
            raise LabError(f"{path}: joint {name}: the range's lower limit is above the upper one; swap them")
        if joint.limited[0]:
            lower[i], upper[i] = joint.range
        elif slides:
            raise LabError(f"{path}: slide {name} has no range; give it one")
        else:
            lower[i], upper[i] = -np.pi, np.pi
    speed, acceleration = (_each(path, model, key, names, scale) for key in (_SPEED_KEY, _ACCELERATION_KEY))
    return (
        lower,
        upper,
        _urdf_speeds(path, names) if speed is None else speed,
        (np.full(len(names), np.nan) if acceleration is None else acceleration),
    )


def _each(path: Path, model: mujoco.MjModel, key: str, names: Sequence[str], scale: Array) -> Array | None:
    """A number of the model for each joint ``(n,)``, in rad or m; None where it has none."""
    found = [i for i in range(model.nnumeric) if model.numeric(i).name == key]
    if not found:
        return None
    numbers = np.array(model.numeric(found[0]).data, dtype=np.float64)
    if numbers.shape != scale.shape:
        raise LabError(f"{path}: {key} has {numbers.size} values for {len(names)} joints; give one each")
    if (still := np.flatnonzero(~(numbers > 0))).size:
        raise LabError(f"{path}: {key} of joint {names[still[0]]} is {numbers[still[0]]:g}; give more than zero")
    return np.asarray(numbers * scale)


def _urdf_speeds(path: Path, names: Sequence[str]) -> Array:
    """Speeds ``(n,)`` of a URDF's ``<limit velocity>``, which MuJoCo does not keep; NaN where there are none."""
    text = path.read_bytes()
    if b"<robot" not in text or b"<!" in text.replace(b"<!--", b""):  # no entities: they can be made to explode
        return np.full(len(names), np.nan)
    limits = {joint.get("name"): joint.find("limit") for joint in ET.fromstring(text).iter("joint")}
    speeds = np.full(len(names), np.nan)
    for i, name in enumerate(names):
        limit = limits.get(name)
        given = None if limit is None else limit.get("velocity")
        try:
            speeds[i] = float(given) if given else np.nan
        except ValueError as error:
            raise LabError(f"{path}: joint {name}: velocity is {given!r}; give a number") from error
    return np.where(speeds > 0, speeds, np.nan)
