"""Corrected targets: the schemes agree, every failure has its reason, and the file of targets is read strictly."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120, chain_of, perturbed, somewhere
from scipy import optimize

from lab.compensation import compensator as compensator_module
from lab.compensation.compensator import AGREED_M, Compensation, Compensator
from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.inverse.branches import NominalInverse
from lab.kinematics.inverse.newton_inverse import PoseTarget
from lab.kinematics.serial.serial_arm import SerialArm
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot

CROSSED = ("joint2.cross6", "link3.x_cross6", "link5.rx_cross4", "joint3.backlash")
CASES = {
    "rigid, positions": ((), False),
    "affected": (("compliance", "harmonics", "backlash"), True),
    "crossed": (CROSSED, True),
}


def compensator(groups: tuple[str, ...], seed: int, robot: Robot = IRB120) -> Compensator:
    """A drawing with its base somewhere, and an arm that is off in every parameter."""
    rng = np.random.default_rng(seed)
    arm = robot.arm_with(("p1",), groups)
    rigid = arm.rigid
    before = somewhere(rigid, rng)
    values = np.zeros(len(arm.names))
    values[: len(rigid.names)] = perturbed(rigid, before, rng, 0.5e-3, 1.5e-3)
    size = {"compliance": 1e-5, "sin1": 2e-4, "cos1": 2e-4, "backlash": 1e-4}
    for i, name in enumerate(arm.names[len(rigid.names) :], start=len(rigid.names)):
        values[i] = size.get(name.split(".")[1], 2e-4)
    return Compensator(NominalInverse(rigid, before), arm, values)


def inputs(of: Compensator, joints: Array) -> Array:
    conditions = [np.full((len(joints), 1), 3.0 if name == "payload_kg" else 1.0) for name in of.arm.conditions]
    return np.concatenate([joints, *conditions], axis=1)


def reachable(of: Compensator, count: int, seed: int) -> PoseTarget:
    """Poses that the identified arm takes at random joints within limits."""
    joints = of.nominal.arm.chain.random_joints(count, np.random.default_rng(seed))
    Ts, _ = of.arm.tool(inputs(of, joints), of.values)
    return PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3])


def corrected(of: Compensator, wanted: PoseTarget, reference: Array | None = None) -> Compensation:
    size = of.nominal.arm.chain.size
    anywhere = np.full((len(wanted), size), np.nan)
    conditions = inputs(of, np.zeros((len(wanted), size)))[:, size:]
    return of(wanted, conditions, anywhere if reference is None else reference)


@pytest.mark.parametrize(("groups", "turned"), CASES.values(), ids=CASES)
def test_the_three_schemes_end_at_the_same_place(groups: tuple[str, ...], turned: bool) -> None:
    """Within the joints' limits; targets that are not hit say why."""
    of = compensator(groups, 3)
    wanted = reachable(of, 60, 4)
    if not turned:
        wanted = PoseTarget(wanted.positions, np.full((60, 3, 3), np.nan))
    found = corrected(of, wanted)
    done = np.flatnonzero(found.converged)
    assert len(done) >= 58 and (found.steps <= 8).mean() > 0.96
    assert all(bool(reason) != hit for reason, hit in zip(found.reasons, found.converged, strict=True))
    assert not of.nominal.arm.chain.beyond_limits(found.joints[done], 1e-9).any()
    for joints in (found.joints, found.differential, found.cartesian):
        missing = wanted.take(done).errors(of.arm.tool(inputs(of, joints)[done], of.values)[0])
        assert np.abs(missing).max() <= 1e-6
    assert found.scheme_disagreement_m[done].max() <= AGREED_M
    closed = of.nominal.closed_form  # the controller itself, by another inverse than Newton's
    assert closed is not None
    aimed = PoseTarget(found.positions[done], found.rotations[done])
    ways = closed.solve(of.nominal.last_frames(aimed)).joints
    apart = np.abs((ways - found.cartesian[done][:, None] + np.pi) % (2 * np.pi) - np.pi).max(axis=2).min(axis=1)
    assert np.quantile(apart, 0.99) < 1e-6
    moved = np.linalg.norm(found.positions - wanted.positions, axis=1)[done]
    assert 0.3e-3 < moved.mean() < 10e-3


def test_without_an_error_nothing_is_corrected() -> None:
    of = compensator((), 5)
    of = Compensator(of.nominal, of.nominal.arm, of.nominal.values)
    wanted = reachable(of, 200, 6)
    found = corrected(of, wanted)
    assert found.converged.all()
    np.testing.assert_allclose(found.joints, found.uncorrected, atol=1e-9)
    np.testing.assert_allclose(found.positions, wanted.positions, atol=1e-9)


def test_at_the_end_of_a_joint_with_several_turns_all_schemes_go_a_turn_back() -> None:
    """There the arm is just beyond the limit where the nominal model is not: it is a whole turn away that both fit."""
    of = compensator((), 2)
    chain = of.nominal.arm.chain
    joints = np.array([0.3, 0.2, 0.1, 0.4, 0.9, 0.0]) + 0.1 * np.random.default_rng(2).uniform(-1, 1, (40, 6))
    joints[:, 5] = chain.lower[5] + np.linspace(-5e-3, 5e-3, 40)
    Ts, _ = of.arm.tool(inputs(of, joints), of.values)
    found = corrected(of, PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3]), np.clip(joints, chain.lower, chain.upper))
    kept = abs(found.uncorrected - joints)[:, 3] < 0.1  # beyond the nominal limit another solution is nearest
    assert found.converged[kept].all(), set(found.reasons)
    turns = np.round((found.joints - joints)[kept, 5] / (2 * np.pi))
    assert set(turns) == {0.0, 1.0}  # some are within the limit as they are
    for scheme in (found.differential, found.cartesian):
        np.testing.assert_allclose(scheme[kept], found.joints[kept], atol=1e-6)
    assert not chain.beyond_limits(found.uncorrected[kept], 1e-9).any()


def test_a_path_stays_in_the_branch_that_its_first_target_names() -> None:
    """Far from the readings zero, where another way would be nearer to them."""
    of = compensator((), 14)
    ends = np.deg2rad([[100.0, -60, -20, 150, -60, 250], [140.0, -30, 10, 120, -80, 300]])
    path = ends[0] + np.linspace(0, 1, 40)[:, None] * (ends[1] - ends[0])
    Ts, _ = of.arm.tool(path, of.values)
    reference = np.full(path.shape, np.nan)
    reference[0] = path[0]
    found = corrected(of, PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3]), reference)
    assert found.converged.all()
    np.testing.assert_allclose(found.joints, path, atol=1e-8)


def test_targets_in_parts_are_corrected_as_all_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where a path goes on from one part to the next, far from joint positions zero; one is out of reach."""
    of = compensator((), 14)
    ends = np.deg2rad([[100.0, -60, -20, 150, -60, 250], [140.0, -30, 10, 120, -80, 300]])
    path = ends[0] + np.linspace(0, 1, 9)[:, None] * (ends[1] - ends[0])
    Ts, _ = of.arm.tool(path, of.values)
    Ts[5, :3, 3] += [3.0, 0, 0]
    reference = np.full(path.shape, np.nan)
    reference[0] = path[0]
    wanted = PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3])
    whole = corrected(of, wanted, reference)
    monkeypatch.setattr(compensator_module, "_BLOCK", 4)
    parts = corrected(of, wanted, reference)
    assert whole.converged.sum() == 8 and parts.reasons == whole.reasons and parts.passed_over == whole.passed_over
    for name in ("joints", "uncorrected", "positions", "rotations", "differential", "cartesian", "singular_rad"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), atol=1e-12)


def test_what_cannot_be_reached_says_why() -> None:
    of = compensator((), 9)
    chain = of.nominal.arm.chain
    inside = np.deg2rad([[10.0, 20, -20, 30, 40, 50]] * 4)
    far, limited, singular, fine = inside
    limited[2] = chain.upper[2] + 0.05
    singular[4] = 2e-4
    Ts, _ = of.arm.tool(np.array([far, limited, singular, fine]), of.values)
    Ts[0, :3, 3] += 3 * (Ts[0, :3, 3] - of.values[:3])
    found = corrected(of, PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3]), np.array([far, limited, singular, fine]))
    assert found.reasons[0].startswith("out of reach by ") and found.reasons[0].endswith("mm")
    assert found.reasons[1].startswith("joint limit: q3 would be at 72.86") and found.reasons[1].endswith("beyond 70°")
    assert found.reasons[3] == ""
    assert not np.isfinite(found.positions[:2]).any() and np.isfinite(found.joints).all()
    near = found.singular_rad[2]
    assert near < np.deg2rad(1) and chain.joint_names[found.singular_joint[2]] == "q5"
    assert found.reasons[2].startswith("within 1° of a singularity: 0.")


def other_compensator(name: str, seed: int) -> tuple[Compensator, Array]:
    """An arm off by 0.5 mm and 1 mrad in every parameter, and readings of its."""
    rng, chain = np.random.default_rng(seed), load_robot(name).chain
    arm = SerialArm(chain)
    before = somewhere(arm, rng)
    return Compensator(
        NominalInverse(arm, before), arm, perturbed(arm, before, rng, 0.5e-3, 1e-3)
    ), chain.random_joints(1000, rng)


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "drawn"), [("scara", True), ("versatran", False)])
def test_a_thousand_targets_of_arms_with_slides_converge(name: str, drawn: bool) -> None:
    """The SCARA's axes are tilted: it cannot take the drawing's rotations, but their places and their turn about z."""
    of, joints = other_compensator(name, 1)
    joints = np.clip(joints, of.nominal.arm.chain.lower + 0.02, of.nominal.arm.chain.upper - 0.02)
    if name == "scara":
        joints[:, 1] = np.where(np.abs(joints[:, 1]) < 0.25, 0.25, joints[:, 1])  # short of the outstretched arm
    Ts, _ = of.nominal.tool(joints) if drawn else of.arm.tool(joints, of.values)
    wanted = PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3])
    found = corrected(of, wanted)
    assert found.converged.mean() >= 0.995
    assert all("singularity" in reason or "joint limit" in reason for reason in found.reasons if reason)
    done = np.flatnonzero(found.converged)
    axis_z = of.nominal.arm.T_tracker_frame0(of.nominal.values)[:3, 2]
    for readings in (found.joints, found.differential, found.cartesian):
        missing = wanted.take(done).errors(of.arm.tool(readings[done], of.values)[0])
        assert np.linalg.norm(missing[:, :3], axis=1).max() < 1.5e-9
        if name == "versatran":
            assert np.linalg.norm(missing[:, 3:], axis=1).max() < 1.5e-9
        else:
            assert np.abs(missing[:, 3:] @ axis_z).max() < 5e-5  # of a tilt of some mrad, about axes that are askew
            apart = np.linalg.norm(missing[:, 3:], axis=1) - found.unturned_rad[done]
            assert np.abs(apart).max() < 1e-8
    assert found.scheme_disagreement_m[done].max() < 1e-8
    if name == "versatran":
        assert not found.unturned_rad.any()
    else:
        assert 1e-4 < found.unturned_rad[done].mean() < 10e-3
    drawn_there = of.nominal.tool(found.cartesian[done])[0]  # what the controller computes for the corrected targets
    np.testing.assert_allclose(drawn_there[:, :3, 3], found.positions[done], atol=1e-8)


def test_a_scara_s_turn_that_is_out_of_reach_is_told() -> None:
    """At the edge the tool's place can still be met, but not turned as well."""
    of, joints = other_compensator("scara", 3)
    joints[:, 1] = 1e-3
    Ts, _ = of.nominal.tool(joints[:30])
    Ts[:, :3, :3] = se3.exp(np.array([0, 0, 0.2])) @ Ts[:, :3, :3]
    found = corrected(of, PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3]))
    assert not found.converged.all() and np.isfinite(found.joints).all()
    assert any(reason.startswith("out of reach by ") and reason.split(",")[0].endswith("°") for reason in found.reasons)


def test_two_joints_leave_out_what_they_cannot_make() -> None:
    """The course's 2R comes as near to each place as its surface does, by a search that knows no Jacobian."""
    arm, rng = load_robot("course2r").arm(("p1",)), np.random.default_rng(18)
    drawn = arm.nominal()
    values = drawn + np.r_[np.zeros(6), 3e-4 * rng.normal(size=len(drawn) - 6)]
    of, joints = Compensator(NominalInverse(arm, drawn), arm, values), arm.chain.random_joints(5, rng)
    Ts = of.nominal.tool(joints)[0]
    wanted = PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3])
    found = corrected(of, wanted)
    assert found.converged.all() and found.scheme_disagreement_m.max() < 1e-8
    for i in range(5):
        away = lambda q, i=i: float(np.sum((arm.points(q[None], values)[0, 0] - wanted.positions[i]) ** 2))  # noqa: E731
        least = optimize.minimize(away, joints[i], method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-18}).fun
        assert found.unplaced_m[i] == pytest.approx(np.sqrt(least), rel=1e-6)
        assert found.unplaced_m[i] < np.sqrt(away(joints[i]))
    np.testing.assert_allclose(of.nominal.tool(found.cartesian)[0][:, :3, 3], found.positions, atol=1e-8)
    far = PoseTarget(1.02 * wanted.positions, wanted.rotations)
    assert all(reason.startswith("out of reach by") for reason in corrected(of, far).reasons)


def test_a_chain_that_moves_in_too_few_directions_is_refused_in_one_line() -> None:
    chain = chain_of("flat", "distal", "RRR", [0, 0, 0], [0.4, 0.3, 0.2], [0, 0, 0], [0, 0, 0])
    arm = SerialArm(chain)
    with pytest.raises(LabError, match=r"robot 'flat': its joints \(q1, q2, q3\) move p1 in 2 of three") as told:
        Compensator(NominalInverse(arm, arm.nominal()), arm, arm.nominal())
    assert "\n" not in str(told.value)


def test_another_solution_is_taken_before_a_target_is_refused_and_it_is_said_why() -> None:
    """Where an arm may not stand with its elbow as the nearest solution has it."""
    free = compensator((), 3)
    wanted = reachable(free, 60, 5)
    nearest = corrected(free, wanted)
    forbidden = nearest.joints[:, 2] > np.median(nearest.joints[:, 2])

    def refused(joints: Array) -> list[str]:
        near = np.abs(joints[:, None] - nearest.joints[forbidden]).max(axis=2).min(axis=1) < 1e-3
        return ["collision: elbow in table" if each else "" for each in near]

    found = corrected(replace(free, refusals=refused), wanted)
    assert found.converged[~forbidden].all() and all(
        found.passed_over[i] == nearest.passed_over[i] for i in np.flatnonzero(~forbidden)
    )
    other = found.converged & forbidden
    assert other.sum() >= 10
    assert all(found.passed_over[i] == "collision: elbow in table" for i in np.flatnonzero(other))
    missing = wanted.errors(free.arm.tool(inputs(free, found.joints), free.values)[0])
    assert np.abs(missing[other]).max() < 1e-8
    assert np.abs(found.joints - nearest.joints)[other].max(axis=1).min() > 1e-2
    for i in np.flatnonzero(~found.converged & forbidden):
        assert found.reasons[i].startswith("collision: elbow in table; no other solution")
    requested_solutions = corrected(replace(free, refusals=refused), wanted, nearest.joints)
    assert not requested_solutions.converged[forbidden].any()
    assert "leave them empty" in requested_solutions.reasons[int(np.argmax(forbidden))]
