"""Export an identified arm as plain Python, and describe what geometry-only files lack."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lab.core.errors import LabError, counted
from lab.core.measurements import evenly
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.calibrated_module import largest_difference, module_text, plain_model, refusing_text
from lab.kinematics.effects.effect import PAYLOAD
from lab.phrases.fit_phrases import listed, model_name
from lab.prediction.estimate import Estimate
from lab.robots.robot import Robot

__all__ = ["ArmExport", "GeometryFiles", "comment_on_missing_effects", "geometry_files"]

_CHECKED, _SAME_M = 3, 1e-9  # poses at which a module is compared with the lab's own arm, and how near it has to be


def comment_on_missing_effects(groups: Sequence[str], error_m: float | None, where: str, *, module: bool) -> str:
    """Write the comment of a geometry-only file on the effects it lacks; "" if it holds all identified effects."""
    if error_m is None:
        return ""
    text = f"Geometry alone: the file lacks {', '.join(listed(groups))}, an error of {MM.text(error_m, 2)} RMS {where}"
    return f"{text}; calibrated.py has all effects" if module else text


@dataclass(frozen=True)
class GeometryFiles:
    """Files that describe an identified arm's geometry.

    Attributes:
        texts: content by file name.
        left_out: by name of a file that cannot hold the arm, the reason.
    """

    texts: dict[str, str]
    left_out: dict[str, str]

    @property
    def messages(self) -> tuple[str, ...]:
        """A warning about each file that is not written."""
        return tuple(f"{name} is not written: {why}" for name, why in self.left_out.items())


def geometry_files(
    robot: Robot, names: Sequence[str], targets: tuple[str, ...], values: Array, comment: str
) -> GeometryFiles:
    """Describe an arm with parameters ``(p,)`` in the formats of these files; a bad fit's arm may not fit into some.

    Args:
        comment: at the head of each file.
    """
    texts, left_out = dict[str, str](), dict[str, str]()
    for name in names:
        try:
            with np.errstate(divide="raise", invalid="raise"):
                text = robot.description(name, targets, values, comment)
        except LabError as error:
            left_out[name] = str(error)
        except (ArithmeticError, np.linalg.LinAlgError):
            left_out[name] = "the identified axes determine no frames of this format"
        else:
            texts |= {name: text} if text else {}
    return GeometryFiles(texts, left_out)


@dataclass(frozen=True)
class ArmExport:
    """An identified arm, for ``calibrated.py``."""

    estimate: Estimate
    observed: str  # how the run was observed, where its positions are in no instrument's frame; "" else
    verdict: str  # of the run, in words
    inputs: Array  # (n, joints + conditions) at poses that were measured; the module is checked at some of them

    def module(self) -> tuple[str, str | None]:
        """The text of ``calibrated.py``, and why its functions refuse; None where they do not."""
        estimate, arm = self.estimate, self.estimate.arm
        name = " ".join(estimate.rigid.chain.name.split())
        title = f"{name}, calibrated: the identified arm as plain Python."
        about = f"The verdict of the run that identified it is {self.verdict}. Model: {model_name(arm.groups)}."
        if estimate.left_out:
            about += f" Left out, because valid for the run's session only: {', '.join(estimate.left_out)}."
        frame = "the frame in which the arm was measured"
        if self.observed:
            frame = f"a frame whose pose is unknown (the run was identified with --observe {self.observed})"
        try:
            usual = {PAYLOAD: 0.0 if estimate.load is None else estimate.load.mass_kg}
            model = plain_model(arm, estimate.values, estimate.loads, estimate.R_last_tool, usual)
            text = module_text(title, about, frame, model)
            some = evenly(len(self.inputs), _CHECKED)
            inputs = self.inputs if some is None else self.inputs[some]
            apart = largest_difference(text, arm, estimate.values, inputs)
            if not apart <= _SAME_M:
                raise LabError(f"its points at {counted(len(inputs), 'measured pose')} are {MM.text(apart, 2)} off")
        except (LabError, ArithmeticError, LookupError, TypeError) as error:
            cause = error if isinstance(error, LabError) else f"it fails with {type(error).__name__}: {error}"
            reason = f"robot {name} is not in this module: {cause}"
            return refusing_text(title, about, reason), reason
        return text, None

    def to_dict(self, reason: str | None) -> dict[str, Any]:
        """Return the entry for ``calibrated.py`` in ``result.json``: effects it has and lacks, and why it refuses."""
        whole = ["geometric", *self.estimate.groups]
        has, lacks = ([], whole) if reason else (whole, [])
        conditions = list(self.estimate.arm.conditions)
        return {"has": has, "lacks": [*lacks, *self.estimate.left_out], "conditions": conditions, "reason": reason}
