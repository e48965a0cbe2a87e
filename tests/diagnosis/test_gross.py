"""Gross mistakes: each is named by the nominal arm's misses, undone exactly, and nothing is said of sound readings."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import lab
from lab.core.measurements import Measurements
from lab.diagnosis.gross import Gross, gross_mistakes
from lab.diagnosis.placement import placed, refined, row_misses
from lab.robots.load_robot import load_robot

Spoil = Callable[[Measurements], Measurements]


@pytest.fixture(scope="module", params=[("irb120", 3), ("ur5e", 1)], ids=["irb120", "ur5e"])
def campaign(request: pytest.FixtureRequest) -> tuple[str, Measurements]:
    """A robot with measurements of it."""
    robot, targets = request.param
    names = ("p1", "p2", "p3")[:targets]
    return robot, lab.simulate(robot, poses=40, targets=names, seed=11).measurements


def diagnosed(robot: str, rows: Measurements) -> Gross:
    arm = load_robot(robot).arm(rows.targets)
    return gross_mistakes(None, arm, rows, arm.nominal({target: np.zeros(3) for target in rows.targets}))


def joints(change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    return lambda rows: replace(rows, joints=change(rows.joints.copy()))


def points(change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    return lambda rows: replace(rows, points=change(rows.points.copy()))


def columns(*order: int) -> Callable[[np.ndarray], np.ndarray]:
    return lambda q: q[:, list(order)]


def mixed(q: np.ndarray) -> np.ndarray:
    q[:, 2] += q[:, 1]
    return q


def with_two_rows_exchanged(q: np.ndarray) -> np.ndarray:
    q[[7, 31]] = q[[31, 7]]
    return q


MISTAKES = {
    "joint_unit": (joints(np.degrees), ("degrees",)),
    "joint_sign": (joints(lambda q: q * [1, 1, -1, 1, 1, 1]), ("q3",)),
    "joints_exchanged": (joints(columns(0, 1, 2, 5, 4, 3)), ("q4", "q6")),
    "joints_coupled": (joints(mixed), ("q3", "q2", "+")),
    "joints_reversed": (joints(columns(5, 4, 3, 2, 1, 0)), ()),
    "joint_zero": (joints(lambda q: q + np.eye(6)[2] * np.pi / 2), ("q3",)),
    "rows_shifted": (joints(lambda q: np.roll(q, 1, axis=0)), ("+1",)),
    "rows_reversed": (joints(lambda q: q[::-1]), ()),
    "rows_exchanged": (joints(with_two_rows_exchanged), ("7", "31")),
    "point_unit": (points(lambda p: 1000 * p), ("mm",)),
    "points_mirrored": (points(lambda p: p[..., [1, 0, 2]]), ()),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named_and_undone(name: str, campaign: tuple[str, Measurements]) -> None:
    robot, rows = campaign
    spoil, of = MISTAKES[name]
    gross = diagnosed(robot, spoil(rows))
    (finding,) = gross.findings
    assert (finding.name, set(finding.hypothesis.of)) == (name, set(of))
    assert finding.after_m < 1e-3 < finding.before_m or name == "rows_exchanged"
    clear = [use != "skip" for use in gross.corrected.use]
    if name != "points_mirrored":  # of a mirrored frame any mirror is as good
        np.testing.assert_allclose(gross.corrected.joints[clear], rows.joints[clear], atol=1e-12)
        np.testing.assert_allclose(gross.corrected.points[clear], rows.points[clear], atol=1e-12)


def test_sound_readings_are_not_accused(campaign: tuple[str, Measurements]) -> None:
    robot, rows = campaign
    gross = diagnosed(robot, rows)
    assert not gross.findings
    assert not gross.outliers
    assert gross.corrected is rows


def test_one_wrong_pose_is_an_outlier_and_no_mistake_of_all(campaign: tuple[str, Measurements]) -> None:
    robot, rows = campaign
    moved = rows.points.copy()
    moved[12] += [0.05, -0.02, 0.03]
    gross = diagnosed(robot, replace(rows, points=moved))
    assert not gross.findings
    assert list(gross.outliers) == [rows.ids[12]]


def test_three_targets_that_are_exchanged_name_their_rows() -> None:
    rows = lab.simulate("irb120", poses=40, targets=("p1", "p2", "p3"), seed=3).measurements
    swapped = rows.points.copy()
    swapped[29:, [0, 2]] = swapped[29:, [2, 0]]
    (from_a_row,) = diagnosed("irb120", replace(rows, points=swapped)).findings
    assert from_a_row.name == "targets_exchanged"
    assert from_a_row.hypothesis.of == ("p1", "p3", "29", "39")
    once = rows.points.copy()
    once[5, [1, 2]] = once[5, [2, 1]]
    (in_one,) = diagnosed("irb120", replace(rows, points=once)).findings
    assert in_one.name == "targets_exchanged_once"
    assert in_one.hypothesis.of == ("p2", "p3", "5")


def test_a_missing_row_shifts_those_behind_it() -> None:
    rows = lab.simulate("ur5e", poses=40, seed=5).measurements
    shifted = np.concatenate([rows.joints[:25], rows.joints[26:], rows.joints[-1:]])
    (finding,) = diagnosed("ur5e", replace(rows, joints=shifted)).findings
    assert finding.name == "rows_shifted"
    assert finding.hypothesis.of == ("-1", "26", "39")


def test_two_mistakes_are_undone_one_after_the_other() -> None:
    rows = lab.simulate("ur5e", poses=40, seed=5).measurements
    spoilt = replace(rows, joints=rows.joints * [1, 1, 1, -1, 1, 1], points=1000 * rows.points)
    gross = diagnosed("ur5e", spoilt)
    assert {each.name for each in gross.findings} == {"joint_sign", "point_unit"}
    np.testing.assert_allclose(gross.corrected.points, rows.points)


def test_another_robot_is_named_where_it_fits() -> None:
    rows = lab.simulate("ur5e", poses=40, seed=5).measurements
    arm = load_robot("ur5").arm(rows.targets)
    nominal = arm.nominal({target: np.zeros(3) for target in rows.targets})
    others = [(name, lambda name=name: load_robot(name).arm(rows.targets)) for name in ("ur5e", "ur10e", "irb120")]
    (finding,) = gross_mistakes(None, arm, rows, nominal, others).findings
    assert (finding.name, finding.hypothesis.of) == ("other_robot", ("ur5e",))


def test_a_placement_survives_a_third_of_wrong_rows() -> None:
    rows = lab.simulate("irb120", poses=45, seed=9).measurements
    rng = np.random.default_rng(1)
    wrong = rows.points.copy()
    wrong[::3] += rng.normal(0, 0.2, wrong[::3].shape)
    arm = load_robot("irb120").arm(rows.targets)
    nominal = arm.nominal({target: np.zeros(3) for target in rows.targets})
    start = placed(arm, rows.joints, wrong, nominal, np.random.default_rng(0))
    at = refined(arm, rows.joints, wrong, nominal, start)
    sound = np.arange(45) % 3 != 0
    assert np.median(row_misses(rows.points, at.predicted)[sound]) < 0.3e-3
    assert (at.misses[~sound] > 0.02).mean() > 0.9


@pytest.mark.thorough
def test_two_rows_of_many_are_named() -> None:
    rows = lab.simulate("ur5e", poses=400, seed=5).measurements
    order = np.arange(400)
    order[[111, 302]] = 302, 111
    (finding,) = diagnosed("ur5e", replace(rows, joints=rows.joints[order])).findings
    assert (finding.name, set(finding.hypothesis.of)) == ("rows_exchanged", {"111", "302"})
