"""Base and tool placed anew by poses that determine only a part of them: along a line, on a plane, about one axis."""

import numpy as np
import pytest
from helpers.robots import IRB120, perturbed, somewhere

from lab.calibration.identification import identify
from lab.core import se3
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.core.se3 import Array
from lab.kinematics.serial.serial_arm import SerialArm
from lab.phrases.phrase import phrases
from lab.prediction.validation import DETERMINED, dependent_columns, placed_anew, validate_file

ARM = SerialArm(IRB120.chain)
NAMES = IRB120.chain.joint_names
NOISE = 5e-6


def kept_upright(values: Array, offsets: Array) -> Array:
    """Joints ``(n, 6)`` that move the flange by offsets ``(n, 3)`` m and keep its orientation, by Newton's method."""
    home = np.array([0.2, 0.1, -0.1, 0.3, 0.8, 0.2])
    start = ARM.flange(home[None], values)[0]
    joints = np.tile(home, (len(offsets), 1))

    def errors(q: Array) -> Array:
        T = ARM.flange(q, values)
        turns = np.array([se3.log(start[:3, :3] @ R.T) for R in T[:, :3, :3]])
        return np.concatenate([start[:3, 3] + offsets - T[:, :3, 3], turns], axis=1)

    for _ in range(8):
        here = errors(joints)
        slopes = np.stack([(here - errors(joints + 1e-6 * e)) / 1e-6 for e in np.eye(6)], axis=2)
        joints = joints + np.linalg.solve(slopes, here[..., None])[..., 0]
    assert np.abs(here).max() < 1e-9
    return joints


def line_and_plane(kind: str, rng: np.random.Generator) -> Array:
    u, v = rng.uniform(-0.08, 0.08, 30), rng.uniform(-0.08, 0.08, 30)
    return np.outer(u, [0.6, 0.8, 0.0]) + (np.outer(v, [0, 0, 1.0]) if kind == "plane" else 0.0)


@pytest.fixture(scope="module")
def arm() -> tuple:
    """An identified arm, and its truth."""
    rng = np.random.default_rng(3)
    truth = perturbed(ARM, somewhere(ARM, rng), rng, 0.5e-3, 1.5e-3)
    joints = IRB120.chain.random_joints(60, rng)
    points = ARM.points(joints, truth) + NOISE * rng.normal(size=(60, 1, 3))
    return identify(ARM, measured(NAMES, joints, ("p1",), points), ARM.nominal()), truth


def session(truth: Array, joints: Array, rng: np.random.Generator) -> Measurements:
    """The arm measured after tracker and target were set up anew."""
    moved = truth.copy()
    moved[:6] = somewhere(ARM, rng)[:6]
    moved[-3:] = 0.1 * rng.normal(size=3)
    points = ARM.points(joints, moved) + NOISE * rng.normal(size=(len(joints), 1, 3))
    return measured(NAMES, joints, ("p1",), points)


@pytest.mark.parametrize(("kind", "links"), [("line", "identified"), ("plane", "true")])
def test_points_of_a_line_or_plane_are_judged(arm: tuple, kind: str, links: str) -> None:
    found, truth = arm
    rng = np.random.default_rng(8)
    joints = kept_upright(found.values if links == "identified" else truth, line_and_plane(kind, rng))
    validation = validate_file(found, ARM, session(truth, joints, rng), ["base", "tool"])
    assert validation.errors is not None
    assert validation.errors.after.mean() < 20e-6 < validation.errors.before.mean()
    if links == "identified":  # the orientation is the same to rounding, so nothing tells base from tool
        assert any("do not determine" in said and "tool.p1." in said for said in phrases(validation.checks))


def test_what_the_poses_do_not_determine_stays(arm: tuple) -> None:
    found, truth = arm
    rng = np.random.default_rng(9)
    joints = kept_upright(found.values, line_and_plane("plane", rng))
    data = session(truth, joints, rng)
    placed = placed_anew(ARM, data[:15], data[15:30], found.values, ("base", "tool"), "here")
    assert placed.fixed == ("tool.p1.x", "tool.p1.y", "tool.p1.z")
    np.testing.assert_array_equal(placed.values[-3:], found.values[-3:])


def test_poses_that_need_what_is_undetermined_are_refused(arm: tuple) -> None:
    found, truth = arm
    rng = np.random.default_rng(10)
    line = session(truth, kept_upright(found.values, line_and_plane("line", rng)), rng)
    elsewhere = measured(NAMES, IRB120.chain.random_joints(20, rng), ("p1",), np.zeros((20, 1, 3)))
    with pytest.raises(LabError, match="here: 30 reference rows cannot place base, tool"):
        placed_anew(ARM, line, elsewhere, found.values, ("base", "tool"), "here")


def test_columns_that_others_explain() -> None:
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(9, 3))
    more = np.column_stack([columns, columns @ [1.0, -2.0, 0.5], rng.normal(size=9), np.zeros(9)])
    assert dependent_columns(more, DETERMINED) == (3, 5)
