"""What is said of poses beyond the measured joint positions: nothing for rigid arms, enough for arms that bend."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.robots import IRB120

from lab.calibration.gauss_newton import Observations
from lab.calibration.identification import WEAK, Identification, identify
from lab.calibration.statistics.candidate_models import TELLING, largest_useful_std
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.kinematics.effects.arm_with_effects import Arm
from lab.kinematics.effects.coupling import gear
from lab.kinematics.effects.harmonics import harmonics
from lab.kinematics.parameter import BASE_PARAMETERS
from lab.prediction.estimate_files import (
    POSES_FILE,
    Extrapolation,
    measured_range_from_dict,
    measured_range_to_dict,
    read_cover,
    write_cover,
)
from lab.prediction.extrapolation import MeasuredRange, PoseCover, distinct_poses, measured_range
from lab.prediction.validation import Errors, Validation
from lab.verdict.fit_checks import check_validation_poses
from lab.verdict.verdict import verdict

SIGMA, POSES = 2e-5, 80
ARM = IRB120.arm(("p1",))
NOMINAL = ARM.nominal(IRB120.tool)


def campaign(seed: int, bend: float, *, narrow: float = 0.35) -> tuple[Measurements, Measurements]:
    """Poses within a share of joint 2's range, and others beyond; joints are off by +-``bend`` times position^3."""
    rng = np.random.default_rng(seed)
    joints = IRB120.chain.random_joints(POSES + 40, rng)
    limits = IRB120.chain.lower[1], IRB120.chain.upper[1]
    middle, half = np.mean(limits), narrow * (limits[1] - limits[0]) / 2
    joints[:POSES, 1] = middle + half * rng.uniform(-1, 1, POSES)
    joints[POSES:, 1] = middle + rng.choice([-1, 1], 40) * half * rng.uniform(1.1, 1.5, 40)
    away = joints - (IRB120.chain.lower + IRB120.chain.upper) / 2
    moved = joints + bend * rng.choice([-1, 1], 6) * np.clip(away, -1.0, 1.0) ** 3
    points = ARM.points(moved, NOMINAL) + SIGMA * rng.standard_normal((len(joints), 1, 3))
    data = measured(IRB120.chain.joint_names, joints, ("p1",), points)
    return data[np.arange(POSES)], data[np.arange(POSES, POSES + 40)]


def ranged(rows: Measurements) -> tuple[Identification, MeasuredRange]:
    found = identify(ARM, rows, NOMINAL)
    said = measured_range(found, Observations.unweighted(rows), IRB120.chain.prismatic)
    assert said is not None
    return found, said


def ranged_with(arm: Arm, rows: Measurements) -> MeasuredRange:
    found = identify(arm, rows, arm.nominal(IRB120.tool))
    said = measured_range(found, Observations.unweighted(rows), IRB120.chain.prismatic)
    assert said is not None
    return said


def squares(found: Identification, said: MeasuredRange | None, rows: Measurements) -> np.ndarray:
    """e' V^-1 e of each pose, with V of noise, parameters and, where asked for, what lies beyond."""
    predicted, jacobian = found.model.observe(rows.joints, found.values)
    slopes = jacobian[:, 0][:, :, list(found.fit.free)]
    spread = slopes @ found.covariance @ np.swapaxes(slopes, 1, 2) + found.sigma_m**2 * np.eye(3)
    if said is not None:
        unknown = said.unknown(found.model, rows.joints, found.values)[:, 0]
        spread = spread + unknown @ np.swapaxes(unknown, 1, 2)
    error = (rows.points - predicted)[:, 0]
    return np.einsum("ni,nij,nj->n", error, np.linalg.inv(spread), error)


def test_how_far_beyond_is_counted_from_the_nearer_edge_and_a_whole_turn_leads_away() -> None:
    said = MeasuredRange(np.array([-1.0, 0.1]), np.array([0.5, 0.3]), np.array([True, False]), *np.ones((2, 2)))
    beyond = said.beyond(np.array([[0.0, 0.2], [0.7, 0.0], [-1.25, 0.4], [-0.25 + 2 * np.pi, 0.3]]))
    np.testing.assert_allclose(beyond, [[0, 0], [0.2, 0.1], [0.25, 0.1], [2 * np.pi - 0.75, 0]], atol=1e-12)


def test_a_rigid_arm_has_no_slope_beyond() -> None:
    """Level 1 %: more than 1 of 8 have a chance of 0.3 %."""
    assert sum(ranged(campaign(seed, 0.0)[0])[1].is_worse_beyond for seed in range(8)) <= 1


def test_an_arm_that_bends_is_told_where_it_was_not_measured() -> None:
    """A cubic error that the measured third of a range hides: 95 % bounds hold beyond it with the slope alone."""
    held, plain = [], []
    for seed in range(8):
        rows, beyond = campaign(seed, 3e-3)
        found, said = ranged(rows)
        assert said.is_worse_beyond
        held.append(np.mean(squares(found, said, beyond) < 7.81))
        plain.append(np.mean(squares(found, None, beyond) < 7.81))
        inside = said.unknown(found.model, rows.joints, found.values)
        assert not inside.any()  # nothing is added where it was measured
    assert np.mean(held) > 0.85 > 0.75 > np.mean(plain)


def test_a_kink_at_the_edges_of_one_joint_is_that_joints_slope() -> None:
    """Joint 2 leaves the model by 5 mrad per rad in its outer tenths; of the other joints as many edges say nothing."""
    rng, kink = np.random.default_rng(5), 5e-3
    joints = IRB120.chain.random_joints(200, rng)
    low, high = np.quantile(joints[:, 1], [0.1, 0.9])
    moved = joints.copy()
    moved[:, 1] += kink * (np.maximum(joints[:, 1] - high, 0) - np.maximum(low - joints[:, 1], 0))
    points = ARM.points(moved, NOMINAL) + 2e-6 * rng.standard_normal((200, 1, 3))
    slope = ranged(measured(IRB120.chain.joint_names, joints, ("p1",), points))[1].slope
    assert 0.98 * kink < slope[1] < 1.15 * kink and (np.delete(slope, 1) < 0.6 * kink).all()


def test_the_range_is_written_and_read(tmp_path: Path) -> None:
    said = replace(ranged(campaign(0, 3e-3)[0])[1], growth=2e-3, unsure=1e-3)
    assert said.cover is not None
    content = measured_range_to_dict(said, IRB120.chain)
    more = Extrapolation(1e3 * said.growth, 1e3 * said.unsure)
    write_cover(tmp_path / POSES_FILE, said.cover, IRB120.chain)
    again = measured_range_from_dict(content, more, IRB120.chain, read_cover(tmp_path, IRB120.chain))
    assert again is not None and said.is_worse_beyond
    for name in ("lower", "upper", "edge", "slope", "turning", "growth", "unsure"):
        np.testing.assert_allclose(getattr(again, name), getattr(said, name), rtol=1e-12)
    assert again.cover is not None
    np.testing.assert_allclose(again.cover.poses, said.cover.poses, atol=1e-7)
    assert measured_range_from_dict(None, None, IRB120.chain) is None
    assert measured_range_to_dict(None, IRB120.chain) is None
    assert read_cover(tmp_path / "older", IRB120.chain) is None
    with pytest.raises(LabError, match="growth_mrad"):
        Extrapolation(growth_mrad=-1)
    (tmp_path / POSES_FILE).write_text("q1_deg\n3\n", "utf-8")
    with pytest.raises(LabError, match="has no column"):
        read_cover(tmp_path, IRB120.chain)


def test_a_wave_is_useful_where_half_of_it_was_measured_and_a_ratio_where_it_is_well_known() -> None:
    waves = [*harmonics("slow", (0, 1), 1).parameters, *harmonics("fast", (1,), 3).parameters]
    joints = np.array([[-np.pi, -0.5], [np.pi, 0.6]])  # joint 2 moves over 1.1 rad: a sixth of a turn
    ratios = gear(IRB120.chain).parameters[:2]
    found = largest_useful_std([*waves, BASE_PARAMETERS[0], *ratios], joints)
    assert found.tolist() == [WEAK, WEAK, TELLING, TELLING, WEAK, WEAK, WEAK, TELLING, TELLING]


def test_a_gap_between_measured_regions_is_not_covered_although_it_is_within_the_range() -> None:
    rng = np.random.default_rng(0)
    two = np.concatenate([rng.uniform(-1.0, -0.6, (60, 2)), rng.uniform(0.6, 1.0, (60, 2))])
    low, high, edge, turning = two.min(axis=0), two.max(axis=0), np.full(2, 0.1), np.array([True, False])
    said = MeasuredRange(low, high, turning, edge, edge, cover=PoseCover(two, turning))
    like = np.concatenate([rng.uniform(-1.0, -0.6, (500, 2)), rng.uniform(0.6, 1.0, (500, 2))])
    gap = rng.uniform(-0.2, 0.2, (100, 2))
    assert not said.beyond(gap).any() and said.uncovered(gap).all()
    assert said.uncovered(like).mean() < 0.12  # poses like those measured: 5 % and what few poses scatter
    turned = like + np.array([2 * np.pi, 0.0])
    assert (said.uncovered(turned) == said.uncovered(like)).all()  # a whole turn leads back
    assert not replace(said, cover=None).uncovered(gap).any()


def test_poses_that_nothing_covers_are_told_and_never_good() -> None:
    """The same calibration with its measured poses where they are, and in one corner of the workspace."""
    rows, far = campaign(0, 3e-3)
    found, said = ranged(rows)
    away = rows.joints.mean(axis=0) + 0.05 * np.random.default_rng(0).standard_normal((80, 6))
    corner = replace(said, cover=PoseCover(away, said.turning))
    first = check_validation_poses(found, corner, far)[0]
    assert first.name == "extrapolated" and first.data["extrapolated"] == first.data["count"] == 40
    assert first.data["first"] == far.ids[0]
    assert said.uncovered(rows.joints).mean() < 0.06
    rigid = replace(corner, slope=np.zeros(6), growth=0.0)
    assert check_validation_poses(found, rigid, far) == []  # a model that lacks nothing knows poses far away too
    fits = Validation("holdout", Errors(np.zeros((1, 1)), np.zeros((1, 1))))
    judged = verdict(found, fits, 10.0, measured=corner)
    assert judged.word == "doubtful"
    assert verdict(found, fits, 10.0, measured=rigid).word == "good"


def hidden_region(seed: int, lack: float) -> tuple[Measurements, Measurements]:
    """Poses in twelve patches of joint space, those of two apart, of an arm with slow errors between its joints."""
    rng = np.random.default_rng(seed)
    middle, half = (IRB120.chain.lower + IRB120.chain.upper) / 2, (IRB120.chain.upper - IRB120.chain.lower) / 2
    patches = middle + np.minimum(half, 2.0) * rng.uniform(-0.8, 0.8, (12, 6))
    joints = np.repeat(patches, 20, axis=0) + rng.uniform(-0.3, 0.3, (240, 6))
    moved = joints.copy()
    for joint, (first, second), phase in zip(
        (0, 1, 2), ((1, 2), (0, 2), (0, 1)), rng.uniform(0, 6, (3, 2)), strict=True
    ):
        moved[:, joint] += lack * np.sin(2 * joints[:, first] + phase[0]) * np.sin(1.5 * joints[:, second] + phase[1])
    points = ARM.points(moved, NOMINAL) + SIGMA * rng.standard_normal((240, 1, 3))
    data = measured(IRB120.chain.joint_names, joints, ("p1",), points)
    return data[np.arange(200)], data[np.arange(200, 240)]


def test_a_region_that_was_not_measured_has_bounds_that_hold() -> None:
    """Errors between joints that no group explains: regions left out tell what may be lacking in another."""
    held, plain = [], []
    for seed in range(5):
        rows, apart = hidden_region(seed, 1e-3)
        found, said = ranged(rows)
        assert said.growth > 0 and said.unsure == 0.0
        assert said.uncovered(apart.joints).all() and said.uncovered(rows.joints).mean() < 0.1
        held.append(np.mean(squares(found, replace(said, slope=0 * said.slope), apart) < 7.81))
        plain.append(np.mean(squares(found, None, apart) < 7.81))
    assert np.mean(held) > 0.85 > 0.6 > np.mean(plain)


def test_regions_of_a_rigid_arm_lack_nothing() -> None:
    """Level 1 %: one of 300 had some; of six, two have a chance of 0.2 %."""
    assert sum(ranged(hidden_region(seed, 0.0)[0])[1].growth > 0 for seed in range(6)) <= 1


def test_effects_that_fail_in_left_out_regions_count_as_unknown_elsewhere() -> None:
    """Waves of one turn, fitted to what is none: what they explain is not believed beyond an end and in other regions.

    An arm that has just these waves is believed everywhere.
    """
    rows, apart = hidden_region(2, 1e-3)
    arm = IRB120.arm_with(("p1",), ("harmonics",))
    said = ranged_with(arm, rows)
    rigid = ranged(rows)[1]
    assert said.unsure > 1e-4 and said.growth >= rigid.growth > 0
    there = said.unknown(arm, apart.joints, arm.nominal(IRB120.tool))
    size = np.sqrt((there**2).sum(axis=3).mean())
    assert size > np.sqrt((rigid.unknown(ARM, apart.joints, NOMINAL) ** 2).sum(axis=3).mean()) * 0.5
    truth = arm.nominal(IRB120.tool)
    truth[[i for i, each in enumerate(arm.parameters) if each.wave]] = 5e-4
    points = arm.points(rows.joints, truth) + SIGMA * np.random.default_rng(1).standard_normal(rows.points.shape)
    own = ranged_with(arm, measured(IRB120.chain.joint_names, rows.joints, ("p1",), points))
    assert own.growth == 0.0 and own.unsure == 0.0


def test_repeats_of_poses_cover_nothing_more() -> None:
    """Twelve visits of each pose cover what one visit covers, with or without what the encoders read beside it."""
    rng, turning = np.random.default_rng(3), np.ones(6, dtype=bool)
    joints, apart = np.split(IRB120.chain.random_joints(120, rng), 2)
    once, away = PoseCover.of(joints, turning), PoseCover.of(joints, turning).beyond(apart)
    assert (once.poses == joints).all() and (away > 0).any()
    visits = np.tile(joints, (12, 1))
    np.testing.assert_array_equal(PoseCover.of(visits, turning).beyond(apart), away)
    turned = visits + 2 * np.pi * rng.integers(-1, 2, visits.shape)  # a whole turn leads back to where it was
    np.testing.assert_allclose(PoseCover.of(turned, turning).beyond(apart), away, atol=1e-9)
    read = PoseCover.of(visits + 1e-5 * rng.standard_normal(visits.shape), turning)
    np.testing.assert_allclose(read.beyond(apart), away, atol=1e-4)
    rows, which = distinct_poses(visits, turning)
    assert (rows == np.arange(60)).all() and (which == np.tile(np.arange(60), 12)).all()
