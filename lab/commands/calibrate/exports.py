"""The calibrated arm as files for other programs: which effects each of them has, and how far it is off without."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lab.calibration.residual.process import GROUP, JointProcess
from lab.campaign.robot import Robot
from lab.core.errors import LabError
from lab.core.measurements import evenly
from lab.core.se3 import Array
from lab.core.wording import counted
from lab.formats.calibrated_module import largest_difference, module_text, plain_model, refusing_text
from lab.kinematics.effects.arm import Arm
from lab.kinematics.effects.conditions import PAYLOAD
from lab.kinematics.effects.registry import CAMPAIGN_SPECIFIC
from lab.render.phrases.models import listed, model_name

__all__ = ["ArmExport", "comment_of_lacking", "lasting_arm", "without_effects"]

_CHECKED, _SAME_M = 3, 1e-9  # poses at which a module is compared with the lab's own arm, and how near it has to be


def lasting_arm(
    robot: Robot, targets: tuple[str, ...], groups: Sequence[str], process: JointProcess | None
) -> tuple[Arm, tuple[str, ...]]:
    """The arm with those of its groups that hold on another day, and the names of the others.

    Args:
        groups: all that were identified, without geometry; that of ``process`` may be among them.
    """
    left_out = tuple(name for name in groups if name in CAMPAIGN_SPECIFIC)
    arm = robot.arm_with(targets, [name for name in groups if name not in (*left_out, GROUP)])
    return (arm if process is None else process.added_to(arm)), left_out


def without_effects(arm: Arm, values: Array, inputs: Array, target: int | None = None) -> float | None:
    """How far geometry alone is off (m, root mean square over poses and points); None where there is nothing else.

    Args:
        target: the one point of the arm that counts; all where not given.
    """
    if not arm.groups or not len(inputs):
        return None
    rigid = arm.rigid
    alone = rigid.points(inputs[:, : rigid.chain.size], values[: len(rigid.names)])
    off = ((arm.points(inputs, values) - alone) ** 2).sum(axis=2)[:, slice(None) if target is None else target]
    return float(np.sqrt(np.nanmean(off)))


def comment_of_lacking(groups: Sequence[str], off_m: float | None, where: str, *, module: bool) -> str:
    """What a file of geometry alone says of itself; "" where it has all that was identified.

    Args:
        module: whether ``calibrated.py`` has the arm.
    """
    if off_m is None:
        return ""
    said = f"Geometry alone: lacks {', '.join(listed(groups))}; off by {1e3 * off_m:.2g} mm rms {where}"
    return f"{said}; calibrated.py has all effects" if module else said


@dataclass(frozen=True)
class ArmExport:
    """An identified arm, for ``calibrated.py``.

    Attributes:
        robot: whose arm it is, with its masses.
        arm, values: what holds on another day; parameters ``(p,)`` as exported.
        left_out: groups of effects of the run's own day.
        R_last_tool: rotation ``(3, 3)`` of the measured tool in the last frame.
        payload_kg: what is carried where nothing is said of it.
        observed: how the run was observed, where its positions are in no instrument's frame; "" else.
        verdict: of the run, in words.
        inputs: ``(n, joints + conditions)`` at poses that were measured; the module is checked at some of them.
    """

    robot: Robot
    arm: Arm
    values: Array
    left_out: tuple[str, ...]
    R_last_tool: Array
    payload_kg: float
    observed: str
    verdict: str
    inputs: Array

    def module(self) -> tuple[str, str | None]:
        """The text of ``calibrated.py``, and why its functions refuse; None where they do not."""
        name = " ".join(self.robot.name.split())
        title = f"{name}, calibrated: the identified arm as plain Python."
        about = f"The verdict of the run that identified it is {self.verdict}. Model: {model_name(self.arm.groups)}."
        if self.left_out:
            about += f" Left out, as of the run's own day: {', '.join(self.left_out)}."
        frame = "the frame in which the arm was measured"
        if self.observed:
            frame = f"a frame that the run does not place (it was identified with --observe {self.observed})"
        try:
            usual = {PAYLOAD: self.payload_kg}
            model = plain_model(self.arm, self.values, self.robot.loads, self.R_last_tool, usual)
            text = module_text(title, about, frame, model)
            some = evenly(len(self.inputs), _CHECKED)
            inputs = self.inputs if some is None else self.inputs[some]
            apart = largest_difference(text, self.arm, self.values, inputs)
            if not apart <= _SAME_M:
                raise LabError(f"its points at {counted(len(inputs), 'measured pose')} are {1e3 * apart:.2g} mm off")
        except LabError as error:
            reason = f"robot {name} is not in this module: {error}"
            return refusing_text(title, about, reason), reason
        return text, None

    def to_dict(self, reason: str | None) -> dict[str, Any]:
        """What ``result.json`` says of ``calibrated.py``: effects that it has and lacks, and why it refuses."""
        has = [] if reason else ["geometric", *self.arm.groups]
        lacks = [*(["geometric", *self.arm.groups] if reason else []), *self.left_out]
        return {"has": has, "lacks": lacks, "conditions": list(self.arm.conditions), "reason": reason}
