"""What the group residual would gain: leave-one-out by a formula against leaving out, and who is told."""

import numpy as np
import pytest
from helpers.robots import IRB120

import lab
from lab.calibration.identification import identify
from lab.calibration.residual.estimation import _left_out, expected_gain, with_residual
from lab.core.errors import LabError
from lab.core.measurements import measured
from lab.report.view import document_of


def test_the_errors_of_poses_left_out_are_those_of_leaving_them_out() -> None:
    rng, n = np.random.default_rng(0), 30
    columns, made = rng.standard_normal((n, 4)), rng.standard_normal((n, n))
    labels = np.repeat(np.arange(n // 6), 6)  # two points of a repeated pose go together
    residual, whole = rng.standard_normal(n), made @ made.T + np.eye(n)
    beside = np.linalg.svd(columns)[0][:, 4:]
    sizes, axes = np.linalg.eigh(beside.T @ whole @ beside)
    root = beside @ axes
    found = _left_out(root / sizes, root, root.T @ residual, labels)
    errors = np.empty(n)
    for label in range(n // 6):
        own, rest = labels == label, labels != label
        inverse = np.linalg.inv(whole[np.ix_(rest, rest)])
        fitted = np.linalg.solve(columns[rest].T @ inverse @ columns[rest], columns[rest].T @ inverse @ residual[rest])
        left = residual - columns @ fitted
        errors[own] = left[own] - whole[np.ix_(own, rest)] @ inverse @ left[rest]
    assert found == pytest.approx(np.linalg.norm(errors.reshape(-1, 3), axis=1).mean())


@pytest.mark.thorough
def test_who_has_waves_is_told_what_it_would_gain_and_a_rigid_arm_nothing() -> None:
    day = lab.simulate("irb120", seed=3, poses=100, effects=lab.Effects(harmonic_mrad=0.1))
    found = lab.identify(day.measurements, robot="irb120")
    gain = found.state.gain
    assert gain is not None and gain.poses == 100 and gain.after_m < 0.6 * gain.before_m
    assert found.to_dict()["remaining_error"]["with_residual"]["after_mm"] == pytest.approx(1e3 * gain.after_m)
    assert gain.description.endswith("poses): add it to --model, e.g. auto+residual.") and gain.description in repr(
        document_of(found)
    )
    rigid = lab.identify(lab.simulate("irb120", seed=3, poses=100).measurements, robot="irb120")
    assert rigid.state.gain is None
    assert expected_gain(rigid.identification, rigid.state.rows) is None  # neither were it asked for


def test_a_few_poses_visited_often_tell_no_offsets_of_the_joints() -> None:
    """Repeats have the same offsets: parameters that follow every pose leave nothing to tell these by."""
    rng = np.random.default_rng(0)
    arm, joints = IRB120.arm(("p1",)), np.repeat(IRB120.chain.random_joints(9, rng), 8, axis=0)
    points = arm.points(joints, arm.nominal(IRB120.tool)) + 1e-5 * rng.standard_normal((72, 1, 3))
    rows = measured(IRB120.chain.joint_names, joints, ("p1",), points)
    found = identify(arm, rows, arm.nominal(IRB120.tool))
    with pytest.raises(LabError, match=r"^9 distinct poses are too few for the group residual"):
        with_residual(found, rows)
