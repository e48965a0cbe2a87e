"""The truth in the gauge of an observation: an arm that predicts the same, whatever the frame and the scale are."""

import numpy as np
import pytest

import lab
from lab.library.virtual_arm import truth_of
from lab.sensors.socket import SocketSensor

DAY = {"poses": 24, "fixtures": 3, "seed": 5, "instrument": "exact"}


@pytest.fixture(scope="module")
def result() -> lab.CalibrationResult:
    return lab.calibrate("irb120", observe="socket", **{**DAY, "poses": 40})


@pytest.mark.thorough
def test_a_scaled_arm_touches_the_scaled_sockets(result: lab.CalibrationResult) -> None:
    """The truth that contacts show keeps one length nominal; its points are the true ones, all in proportion."""
    assert result.truth.robot is not None
    truth = truth_of(result.truth.robot, result.robot.arm(("p1",)))
    assert truth is not None
    model = result.identification.model
    placed = {f"socket.{label}": np.zeros(3) for label in model.labels}
    seen = SocketSensor().observed_truth(truth, result.identification, result.truth.robot, placed)
    assert seen is not None
    link = model.names[model.scale_link]
    nominal = dict(zip(model.names, result.nominal, strict=True))[link]
    scale = nominal / truth.of([link])[0]
    assert seen.of([link])[0] == pytest.approx(nominal, abs=1e-15) and abs(scale - 1) > 1e-5
    arm, joints = truth.arm, result.measurements.joints
    apart = [np.diff(arm.points(joints, values)[:, 0], axis=0) for values in (truth.values, seen.values)]
    lengths = [np.linalg.norm(each, axis=1) for each in apart]
    np.testing.assert_allclose(lengths[1], scale * lengths[0], rtol=1e-12)
