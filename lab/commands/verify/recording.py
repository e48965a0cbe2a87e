"""A verification as a rerun recording: the arm at each new pose, and measured less predicted there."""

import hashlib
from pathlib import Path

import numpy as np

from lab.commands.verify.run import VerificationResult
from lab.render.error_recording import ErrorScene, PointErrors, record_errors
from lab.render.scene import drawn_rows
from lab.render.style import RGB_AFTER, RGB_BEFORE

__all__ = ["record_verification"]


def record_verification(path: Path, result: VerificationResult) -> None:
    """Write the recording of ``lab verify``; of many rows an evenly spaced part."""
    calibrated, found = result.calibrated, result.verified
    data = result.measurements.take(drawn_rows(len(result.measurements)))
    arm = calibrated.robot.arm_with(data.targets, calibrated.estimate.groups)
    predicted = np.where(data.seen[:, :, None], arm.points(data.inputs(arm.conditions), found.values), np.nan)
    colour, colour_name = (RGB_AFTER, "light blue") if found.good else (RGB_BEFORE, "vermilion")
    text = "measured less predicted"
    rigid = arm.rigid
    scene = ErrorScene(
        calibrated.robot.model,
        rigid,
        found.values[: len(rigid.names)],
        data.joints,
        data.ids,
        predicted,
        "where the calibrated arm is predicted to have its targets",
        [PointErrors("observed", text, colour, colour_name, data.points - predicted)],
        np.full(len(data), found.expected_m),
    )
    digest = hashlib.sha256(calibrated.robot.sha256.encode() + found.values.tobytes())
    digest.update(data.joints.tobytes() + data.points.tobytes())
    record_errors(path, calibrated.robot.name, digest.hexdigest()[:32], scene, result.document())
