"""Fine mistakes: steps, gains, couplings and scales are named with sizes that cover, beside effects and scatter."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import lab
from lab.core.measurements import Measurements
from lab.diagnosis.hypothesis import Finding

Spoil = Callable[[Measurements], Measurements]
EFFECTS = {"stiffness_nm_per_rad": 3e4, "repeatability_mrad": 0.03, "harmonic_mrad": 0.1}


@pytest.fixture(scope="module")
def rows() -> Measurements:
    """An arm with effects that geometry lacks, measured at three targets."""
    return lab.simulate("irb120", poses=60, targets=("p1", "p2", "p3"), seed=21, **EFFECTS).measurements


def found_in(rows: Measurements) -> tuple[Finding, ...]:
    return lab.identify(rows, robot="irb120").diagnosis


def after(row: int, change: np.ndarray) -> np.ndarray:
    """Return a change from a row on ``(60, 1, ...)``."""
    return (np.arange(60) >= row)[:, None] * change


MISTAKES: dict[str, tuple[Spoil, tuple[str, ...], float]] = {
    "joint_step": (lambda m: replace(m, joints=m.joints + after(35, np.eye(6)[1] * 4e-4)), ("q2", "34", "35"), -4e-4),
    "base_step": (
        lambda m: replace(m, points=m.points + after(20, np.array([3e-4, 0, 0]))[:, None]),
        ("19", "20"),
        3e-4,
    ),
    "joint_gain": (lambda m: replace(m, joints=m.joints * [1, 1, 1.002, 1, 1, 1]), ("q3",), -2e-3),
    "joint_coupling": (
        lambda m: replace(m, joints=m.joints + 1e-3 * m.joints[:, [1]] * np.eye(6)[2]),
        ("q3", "q2"),
        -1e-3,
    ),
    "shear": (lambda m: replace(m, points=m.points @ np.array([[1, 6e-4, 0], [0, 1, 0], [0, 0, 1]])), (), 3e-4),
    "scale": (lambda m: replace(m, points=1.01 * m.points), (), 1e-2),
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named_with_its_size(name: str, rows: Measurements) -> None:
    spoil, of, size = MISTAKES[name]
    first = found_in(spoil(rows))[0]
    assert (first.name, first.hypothesis.of) == (name, of)
    largest = int(np.argmax(np.abs(first.sizes)))
    assert abs(first.sizes[largest] - size) < 5 * first.stds[largest] + 0.1 * abs(size)


def test_effects_and_scatter_are_no_mistakes(rows: Measurements) -> None:
    assert not found_in(rows)


def test_a_joint_zero_that_a_fit_corrects_is_a_note(rows: Measurements) -> None:
    (finding,) = found_in(replace(rows, joints=rows.joints + np.eye(6)[2] * 0.02))
    assert (finding.name, finding.hypothesis.of) == ("joint_zero", ("q3",))
    assert finding.accepted
    assert abs(finding.sizes[0] + 0.02) < 3 * finding.stds[0] + 2e-3  # of the zero that the arm has already


def test_a_tool_that_moved_is_told_from_one_target_that_moved(rows: Measurements) -> None:
    arm = lab.load_robot("irb120").arm(rows.targets)
    values = arm.nominal({target: np.zeros(3) for target in rows.targets})
    _, jacobian = arm.observe(rows.joints, values)
    shift = {k: jacobian[:, k][..., [arm.names.index(f"tool.{name}.x")]] for k, name in enumerate(rows.targets)}
    turned = replace(rows, points=rows.points.copy())
    T_base = rotation_of_base(rows)
    for k, column in shift.items():
        turned.points[40:, k] += 4e-4 * (column[40:, :, 0] @ T_base.T)
    first = found_in(turned)[0]
    assert (first.name, first.hypothesis.of) == ("tool_step", ("39", "40"))
    alone = replace(rows, points=rows.points.copy())
    alone.points[40:, 1] += 4e-4 * (shift[1][40:, :, 0] @ T_base.T)
    first = found_in(alone)[0]
    assert (first.name, first.hypothesis.of) == ("target_step", ("p2", "39", "40"))


def rotation_of_base(rows: Measurements) -> np.ndarray:
    """The base's rotation in the frame of the measurements, as a fit finds it."""
    result = lab.identify(rows, robot="irb120")
    rotation: np.ndarray = result.state.fitter.robot.arm(rows.targets).T_tracker_frame0(
        result.state.identification.values
    )[:3, :3]
    return rotation


def test_a_step_is_in_the_fit_and_the_arm_is_the_one_after_it() -> None:
    rows = lab.simulate("irb120", poses=60, seed=22).measurements
    sound = lab.identify(rows, robot="irb120")
    stepped = replace(rows, joints=rows.joints + after(30, np.eye(6)[1] * 6e-4))
    result = lab.identify(stepped, robot="irb120")
    names = result.names
    assert "joint2.step1" in names
    step = result.values[names.index("joint2.step1")]
    assert step == pytest.approx(6e-4, abs=1e-5)  # before it, the readings were less by that
    sigma, least = (each.state.weighted.residual_sigma_m for each in (result, sound))
    assert sigma < 1.1 * least
    theta = [each.values[each.names.index("link2.theta")] for each in (result, sound)]
    assert theta[0] - theta[1] == pytest.approx(-6e-4, abs=2e-5)


def test_nothing_is_left_of_a_finding_in_another_order(rows: Measurements) -> None:
    stepped = replace(rows, joints=rows.joints + after(30, np.eye(6)[1] * 3e-4))
    order = np.random.default_rng(3).permutation(60)
    shuffled = replace(stepped[order], ids=stepped.ids, lines=(), visits=None)
    assert not [each for each in found_in(shuffled) if each.name.endswith("_step")]


def test_a_pose_far_off_is_an_outlier_and_nothing_else(rows: Measurements) -> None:
    moved = rows.points.copy()
    moved[33] += [0.002, -0.001, 0.0]
    result = lab.identify(replace(rows, points=moved), robot="irb120")
    named = {pose.id for pose in result.state.outliers}
    assert named | {name for each in result.diagnosis for name in each.hypothesis.of} == {"33"}
    assert {each.name for each in result.diagnosis} <= {"outliers"}
