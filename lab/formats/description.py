"""An identified robot, and the protocol of a file format for it."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from lab.core.se3 import Array
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.model import RigidArm

__all__ = ["DescriptionFormat", "IdentifiedRobot", "with_comment"]

_ArmT_co = TypeVar("_ArmT_co", bound=RigidArm, covariant=True)
_ModelT_co = TypeVar("_ModelT_co", covariant=True)
_ArmT_contra = TypeVar("_ArmT_contra", bound=RigidArm, contravariant=True)
_ModelT_contra = TypeVar("_ModelT_contra", contravariant=True)


@dataclass(frozen=True)
class IdentifiedRobot(Generic[_ArmT_co, _ModelT_co]):
    """A robot with identified parameters.

    Attributes:
        arm: its model, with the measured targets.
        values: ``(p,)`` parameters of the arm (m, rad); the base is in the instrument's frame.
        loads: nominal masses of its links, or None.
        model: its nominal MuJoCo model, for the formats of ``lab.simulation``.
    """

    name: str
    arm: _ArmT_co
    values: Array
    loads: Loads | None
    model: _ModelT_co


def with_comment(file: str, text: str, comment: str) -> str:
    """Return the content of a file with a comment at its head, in the format's own way."""
    if not comment or not text:
        return text
    if not file.endswith((".xml", ".urdf", ".xacro")):
        return f"# {comment}\n{text}"
    head = re.match(r"<\?xml[^>]*\?>\s*", text)
    at = head.end() if head else 0
    return f"{text[:at]}<!-- {comment.replace('--', '- -')} -->\n{text[at:]}"


@dataclass(frozen=True)
class DescriptionFormat(Generic[_ArmT_contra, _ModelT_contra]):
    """A file format for a kind of robot.

    Attributes:
        file: name of its file in a run's folder.
        text: returns the content for an identified robot; "" if there is none. It raises a LabError with the reason
            if the format cannot hold these parameters.
    """

    file: str
    text: Callable[[IdentifiedRobot[_ArmT_contra, _ModelT_contra]], str]
