"""Limits and speeds of a model's joints."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from lab.errors import LabError
from lab.frames import Array

SPEED_KEY = "joint_speed_deg_per_s"  # an MJCF's <custom><numeric>, in joint order; mm/s for a slide


def joint_limits(path: Path, model: mujoco.MjModel, names: Sequence[str]) -> tuple[Array, Array, Array]:
    """Lower and upper limits and speeds ``(n,)`` in rad or m (a second); speeds are NaN where not given.

    Raises:
        LabError: a range is crossed, a slide has none, or the speeds are not one for each joint.
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
    keys = [i for i in range(model.nnumeric) if model.numeric(i).name == SPEED_KEY]
    if not keys:
        return lower, upper, _urdf_speeds(path, names)
    speed = np.array(model.numeric(keys[0]).data, dtype=np.float64)
    if speed.shape != lower.shape:
        raise LabError(f"{path}: {SPEED_KEY} has {speed.size} values for {len(names)} joints; give one each")
    return lower, upper, speed * scale


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
