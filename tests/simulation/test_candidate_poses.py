"""Candidate poses: what the tracker sees, what the arm touches, and how the draws are counted."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from helpers.robots import IRB120
from helpers.scenes import MODEL, small_arm

from lab.core import se3
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.noise.instruments import INSTRUMENTS, FieldOfView
from lab.simulation.candidate_poses import (
    MARGIN,
    draw_candidates,
    feasibility,
    field_of_view,
)
from lab.simulation.collisions import collides
from lab.simulation.free_path import path_check

EXACT, CORNER_CUBE = INSTRUMENTS["exact"], INSTRUMENTS["leica-at960"]
LEICA = replace(CORNER_CUBE, field_of_view=replace(CORNER_CUBE.field_of_view, acceptance_rad=np.deg2rad(75.0)))
TARGETS = ("p1", "p2", "p3")
ZERO = np.zeros((1, 2))


def visible(robot, joints, targets, device):
    return field_of_view(robot, targets, device)(joints)


def feasible(robot, joints, targets, device):
    return feasibility(robot, targets, device)(joints)


def path_is_free(robot, start, end):
    return path_check(robot)(start, end)


def sphere(place: np.ndarray, radius: float) -> str:
    pos = " ".join(f"{x:.9f}" for x in place)
    return f'<geom type="sphere" size="{radius}" pos="{pos}" contype="0" conaffinity="0"/>'


HEAD, TIP = np.array([2.0, 0, 1.0]), np.array([0.76, 0, 0.5])


@pytest.mark.parametrize(
    ("place", "radius", "seen"),
    [
        ((HEAD + TIP) / 2, 0.05, False),  # on the line
        ((HEAD + TIP) / 2 + [0, 0.06, 0], 0.05, True),  # 10 mm beside it
        ((HEAD + TIP) / 2 + [0, 0.04, 0], 0.05, False),  # 10 mm into it
        (TIP + 0.1 * (TIP - HEAD), 0.05, True),  # behind the target
        (TIP, 0.0063, True),  # the reflector's own ball
        (TIP, 0.05, False),  # a ball that buries it
    ],
)
def test_what_stands_in_the_line_hides_the_target(tmp_path, place, radius: float, seen: bool) -> None:
    robot = small_arm(tmp_path, sphere(np.array(place), radius))
    assert visible(robot, ZERO, ("p1",), EXACT).item() is seen


def test_the_trackers_own_body_and_what_moves_away_hide_nothing(tmp_path) -> None:
    around = '<geom type="sphere" size=".1" pos="0 0 1"/>'
    assert visible(small_arm(tmp_path, stand=around), ZERO, ("p1",), EXACT).all()
    # turned by 180 degrees the arm's own shoulder and post do not hide the raised target; the arm itself, pointing up
    # and back, does hide one that sits behind it
    robot = small_arm(tmp_path, on_hand='<site name="low" pos=".15 0 .06"/>')
    over, under = np.array([[0, 0.0]]), np.array([[0, np.deg2rad(100)]])  # +q2 turns the hand down: low faces the head
    assert visible(robot, over, ("low",), EXACT).all() and visible(robot, under, ("low",), EXACT).all()
    assert not visible(robot, np.deg2rad([[180.0, 100.0]]), ("low",), EXACT).any()
    assert not visible(robot, np.deg2rad([[180.0, 100.0]]), ("p1", "low"), EXACT).any()  # every one is wanted


def test_sight_limits_are_as_stated() -> None:
    """Range, elevation and cone, each just inside and just outside."""
    field_of_view = FieldOfView(1.0, 2.0, np.deg2rad(-30), np.deg2rad(40), np.deg2rad(75))

    def point(reach: float, elevation_deg: float) -> np.ndarray:
        e = np.deg2rad(elevation_deg)
        return reach * np.array([np.cos(e) * 0.6, np.cos(e) * 0.8, np.sin(e)])

    def seen(reach: float, elevation_deg: float, off_deg: float = 0.0) -> bool:
        at = point(reach, elevation_deg)
        back, across = -at / reach, se3.exp(np.array([0, 0, np.pi / 2])) @ (at * [1, 1, 0]) / np.hypot(*at[:2])
        axis = np.cos(np.deg2rad(off_deg)) * back + np.sin(np.deg2rad(off_deg)) * across
        return bool(field_of_view.admits(at, axis))

    assert seen(1.5, 0) and seen(1.001, 0) and seen(1.999, 0) and not seen(0.999, 0) and not seen(2.001, 0)
    assert seen(1.5, 39.9) and not seen(1.5, 40.1) and seen(1.5, -29.9) and not seen(1.5, -30.1)
    assert seen(1.5, 20, 74.9) and not seen(1.5, 20, 75.1) and not seen(1.5, 20, 180) and seen(1.5, 20, -74.9)
    everywhere = np.random.default_rng(0).normal(size=(2, 1000, 3))
    assert FieldOfView().admits(everywhere[0], everywhere[1] / np.linalg.norm(everywhere[1], axis=1)[:, None]).all()
    assert FieldOfView().admits(np.array([1.0, 0, 0]), np.array([1.0, 0, 0]))  # turned away, and still seen


def test_the_cone_follows_the_targets_axis_in_the_arm(tmp_path) -> None:
    """Turning joint 1 turns p1's axis: the angle to the head is that of plane geometry."""
    robot = small_arm(tmp_path)
    q1 = np.deg2rad(np.arange(-179, 180, 7.0))
    joints = np.column_stack([q1, np.zeros_like(q1)])
    tips = np.column_stack([0.76 * np.cos(q1), 0.76 * np.sin(q1), np.full_like(q1, 0.5)])
    axes = np.column_stack([np.cos(q1), np.sin(q1), np.zeros_like(q1)])
    to_head = (HEAD - tips) / np.linalg.norm(HEAD - tips, axis=1)[:, None]
    for half_angle in (30.0, 60.0):
        device = replace(EXACT, field_of_view=FieldOfView(acceptance_rad=np.deg2rad(half_angle)))
        expected = np.rad2deg(np.arccos((axes * to_head).sum(axis=1))) <= half_angle
        assert 3 < expected.sum() < len(expected) - 3
        np.testing.assert_array_equal(visible(robot, joints, ("p1",), device), expected)


@pytest.mark.parametrize("name", ["exact", "leica-at960"])
def test_candidates_are_feasible_and_every_draw_is_accounted_for(name: str) -> None:
    device, chain = INSTRUMENTS[name], MODEL.chain
    told: list[tuple[int, int]] = []
    rng = rng_for(1, "candidates")
    found = draw_candidates(MODEL, TARGETS, device, 300, rng, progress=lambda done, of: told.append((done, of)))
    assert told[0] == (0, 300) and told == sorted(told) and told[-1][0] < 300
    reasons = ["limits", "singularity", "collision", "visibility"]
    assert found.joints.shape == (300, 6) and list(found.rejected) == reasons
    assert found.drawn == 300 + sum(found.rejected.values()) and found.rejected["singularity"] == 0
    assert sorted(found.rejected.values())[1] > 0
    keep_off = MARGIN * (chain.upper - chain.lower)
    assert ((found.joints >= chain.lower + keep_off) & (found.joints <= chain.upper - keep_off)).all()
    assert not collides(MODEL, found.joints).any()
    for target in TARGETS:
        assert visible(MODEL, found.joints, (target,), device).all()
    assert feasible(MODEL, found.joints, TARGETS, device).all()


def test_shares_are_what_they_must_be() -> None:
    """In the margin of one limit or more: 1 - 0.9^6. A sight that sees all rejects no more than a tracker's."""
    all_seen, tracked = (
        draw_candidates(MODEL, ("p1",), device, 1000, rng_for(0, "candidates")) for device in (EXACT, LEICA)
    )
    for found in (all_seen, tracked):
        assert found.rejected["limits"] / found.drawn == pytest.approx(1 - (1 - 2 * MARGIN) ** 6, abs=0.014)
    assert all_seen.drawn < tracked.drawn


def test_one_seed_gives_one_list_and_more_keeps_the_first() -> None:
    few, again, more, other = (
        draw_candidates(MODEL, ("p1",), LEICA, n, rng_for(seed, "candidates")).joints
        for n, seed in ((300, 0), (300, 0), (500, 0), (300, 1))
    )
    np.testing.assert_array_equal(few, again)
    np.testing.assert_array_equal(few, more[:300])
    assert np.abs(few - other).max() > 0.1


def test_the_trackers_stand_is_in_the_arms_way(tmp_path) -> None:
    """At 0.6 m the outstretched arm runs into the stand; the same pose is free where the tracker is further off."""
    near, far = small_arm(tmp_path, tracker=".6 0 0"), small_arm(tmp_path)
    assert collides(near, ZERO).all() and not collides(far, ZERO).any()
    left, right = np.deg2rad([90.0, 0]), np.deg2rad([-90.0, 0])
    assert path_is_free(far, left, right) and not path_is_free(near, left, right)
    assert not collides(near, np.array([left, right])).any()
    found = draw_candidates(near, ("p1",), EXACT, 200, rng_for(0, "candidates"))
    freely = draw_candidates(far, ("p1",), EXACT, 200, rng_for(0, "candidates"))
    assert found.rejected["collision"] / found.drawn > freely.rejected["collision"] / freely.drawn + 0.02


def test_nothing_thicker_than_a_step_is_stepped_over(tmp_path) -> None:
    """A probe 4.4 mm thick meets a post 6 mm thick, anywhere on its way: 10.4 mm in all, seen from either end."""
    probe = '<geom type="capsule" size=".0022" fromto=".3 0 0 .45 0 0"/>'
    free = path_check(small_arm(tmp_path, on_hand=probe))
    rng = np.random.default_rng(0)
    for _ in range(20):
        q1 = rng.uniform(-0.9, 0.9)
        at = 0.83 * np.array([np.cos(q1), np.sin(q1)])
        post = f'<geom type="cylinder" size=".003 .4" pos="{at[0]:.6f} {at[1]:.6f} .5"/>'
        blocked = path_check(small_arm(tmp_path, extra=post, on_hand=probe))
        ends = np.array([[-1.2, rng.uniform(-0.05, 0.05)], [1.2, rng.uniform(-0.05, 0.05)]])
        assert free(*ends) and not blocked(*ends) and not blocked(*ends[::-1])


def test_no_point_moves_further_than_the_reach_says() -> None:
    """Corners of every collision shape's box, over random moves of all joints: |dp| <= |dq| . reach."""
    model, data, rng = MODEL.model, mujoco.MjData(MODEL.model), np.random.default_rng(1)
    solid = np.flatnonzero(model.geom_contype & (model.geom_bodyid > 0))
    signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, 8).T
    corners = model.geom_aabb[solid, None, :3] + signs * model.geom_aabb[solid, None, 3:]

    def places(reading: np.ndarray) -> np.ndarray:
        data.qpos[:] = reading
        mujoco.mj_kinematics(model, data)
        turns = data.geom_xmat[solid].reshape(-1, 3, 3)
        return np.einsum("gij,gkj->gki", turns, corners) + data.geom_xpos[solid, None]

    reach, worst = MODEL.travel_per_joint(), 0.0
    for reading in IRB120.chain.random_joints(300, rng):
        move = rng.normal(0, 0.01, 6) * (rng.random(6) < 0.5)
        moved = np.linalg.norm(places(reading + move) - places(reading), axis=-1).max()
        bound = np.abs(move) @ reach
        assert moved <= bound + 1e-12
        worst = max(worst, moved / bound) if bound else worst
    assert worst > 0.5  # and the bound is no wild one


def test_infeasible_requests_are_answered_in_one_line(tmp_path) -> None:
    rng = np.random.default_rng(0)
    blind = replace(EXACT, field_of_view=FieldOfView(nearest_m=9.0))
    asks = [
        (MODEL, ("p9",), EXACT, 5, "target 'p9' is unknown: robot irb120 has p1, p2, p3"),
        (MODEL, ("p1",), EXACT, 0, "ask for 1 or more"),
        (MODEL, ("p1",), blind, 5, r"no feasible poses in 16384 draws, 5 wanted.*does not see p1; move the tracker"),
    ]
    for robot, targets, device, count, words in asks:
        with pytest.raises(LabError, match=words) as caught:
            draw_candidates(robot, targets, device, count, rng)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("tracker", "stand", "where"),
    [
        (".2 0 -.5", '<geom type="sphere" size="0.001" pos="0 0 2"/>', None),  # the head beside the turning arm: free
        ("0 0 -.5", '<geom type="sphere" size="0.01" pos="0 0 2"/>', "100%"),  # the head in link 1's shoulder
        ("0 0 0", "", "100%"),  # the stand on the arm's own axis
        (".1 0 0", '<geom type="cylinder" size=".05 .1" pos="0 0 .2"/>', "in its base"),  # MuJoCo sees no contact here
    ],
)
def test_a_tracker_inside_the_arm_is_refused(tmp_path, tracker: str, stand: str, where: str | None) -> None:
    robot = small_arm(tmp_path, tracker=tracker, stand=stand)
    if where is None:
        draw_candidates(robot, ("p1",), EXACT, 5, np.random.default_rng(0))
        return
    with pytest.raises(LabError, match=f"stands inside the arm, .*{where}.*; move it away"):
        draw_candidates(robot, ("p1",), EXACT, 5, np.random.default_rng(0))
