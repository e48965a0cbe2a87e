"""What a study's numbers depend on beside its options, and whether two places have the same of it."""

import platform
from collections.abc import Mapping
from importlib import metadata
from typing import Any

from lab.campaign.robot import load_robot
from lab.core.version import __version__

__all__ = ["difference", "origin_of", "other_version"]

_LIBRARIES = ("mujoco", "numpy", "scipy", "pyarrow")


def origin_of(robot: str) -> dict[str, Any]:
    """What a study's numbers depend on beside its options: the robot's files, and versions."""
    versions = {name: metadata.version(name) for name in _LIBRARIES}
    versions |= {"python": platform.python_version(), "virtual-calibration-lab": __version__}
    return {"model_sha256": load_robot(robot).sha256, "versions": versions}


def difference(there: dict[str, Any], here: dict[str, Any]) -> str | None:
    """What of two origins is not the same, in words; None if all is."""
    files = there["model_sha256"] == here["model_sha256"]
    return other_version(there["versions"], here["versions"]) or (None if files else "other files of the robot")


def other_version(old: Mapping[str, str], new: Mapping[str, str]) -> str | None:
    """The first package that is not of the same version, in words; None if all are."""
    other = next((name for name in sorted({*old, *new}) if old.get(name) != new.get(name)), None)
    return None if other is None else f"{other} {old.get(other)}, not {new.get(other)}"
