"""Assembly and working modes are never swapped: every answer against a platform that other means solve and follow.

Of each virtual robot, off by 0.5 mm and 1 mrad: what its simulator measures, what the fit of these measurements
answers, where compensation sends it, and its direct and inverse kinematics along motions and at random poses.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import pytest
from helpers import platform_campaigns as script
from helpers.legged_platforms import Platform, platform_of

from lab.calibration.identify import IdentifyOptions
from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.closed.arm import ClosedArm
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.inverse.newton import PoseTarget, reach
from lab.simulation.closed_robot import TrueMechanism

ROBOTS = ("rrr3", "prr3", "hexapod")
SAME = 1e-9  # m, and of rotation matrices
OTHER = 1e-2  # by which a platform in another mode is off at least
WORST_UM = 100.0
AWAY = 0.02  # of the way home, from where a pose is sought again
CLEAR = 0.2  # of the largest: how much the slowest leg moves at the end of its way, away from serial singularities
SIDE = 0.02  # a leg that is farther from its serial singularity stays on its side with dimensions this far off
POSES, TOURS, CORNERS, STEPS = 60, 6, 6, 12


@dataclass(frozen=True)
class Case:
    """A virtual robot with its nominal model, and the platform of each from home on."""

    name: str
    seed: int

    @cached_property
    def robot(self):
        return script.robot_of(self.name)

    @property
    def chain(self) -> Mechanism:
        return self.robot.chain

    @cached_property
    def real(self) -> TrueMechanism:
        return script.drawn_real(self.name, self.seed, script.OFFSETS)

    @cached_property
    def nominal_home(self) -> tuple[Array, Array]:
        """The platform at home as the robot's file has it, near what closes the legs there."""
        home = self.chain.home[None]
        z = 0.6 if self.name == "hexapod" else 0.0
        found = self.platform(self.chain.nominal_values).newton(home, np.eye(3)[None], np.array([[0.0, 0.0, z]]))
        assert found[2].all() and np.linalg.norm(found[1][0] - [0, 0, z]) < 0.1
        return found[0], found[1]

    def platform(self, values: Array) -> Platform:
        return platform_of(self.chain, values)

    def home(self, values: Array) -> tuple[Array, Array]:
        """Of other dimensions, which are approached in steps so small that no other mode is near."""
        R, t = self.nominal_home
        for share in np.linspace(0, 1, 9)[1:]:
            before = R, t
            part = self.chain.nominal_values + share * (values[: len(self.chain.names)] - self.chain.nominal_values)
            R, t, shut = self.platform(part).newton(self.chain.home[None], R, t)
            assert shut.all() and max(np.abs(R - before[0]).max(), np.abs(t - before[1]).max()) < OTHER
        return R, t

    def followed(self, values: Array, joints: Array) -> Array:
        """The platform ``(n, 4, 4)`` in its base, each on a straight way of its own from home; NaN where that ends."""
        R, t = self.home(values)
        ways = np.stack([np.tile(self.chain.home, (len(joints), 1)), joints], axis=1)
        R, t, _ = self.platform(values).followed(ways, np.repeat(R, len(joints), 0), np.repeat(t, len(joints), 0))
        return se3.pose(R, t)

    def signs(self, values: Array, joints: Array, Ts: Array) -> Array:
        """Of the determinant, and of what tells the two ways of each leg apart, ``(n, 1 or 4)``."""
        platform = self.platform(values)
        found = np.sign(platform.determinant(joints, Ts[:, :3, :3], Ts[:, :3, 3]))[:, None]
        if not platform.planar:
            return found
        rods = se3.transform(Ts, platform.b) - platform.a(joints)
        moved = (platform.a(joints + 1e-6) - platform.a(joints - 1e-6)) / 2e-6
        return np.concatenate([found, np.sign((rods * moved).sum(axis=2))], axis=1)

    def turning(self, values: Array, joints: Array, Ts: Array) -> Array:
        """How well the worst leg's joint moves the platform ``(n,)``, 1 at best, 0 at a serial singularity."""
        platform = self.platform(values)
        if not platform.planar:
            return np.ones(len(joints))
        rods = se3.transform(Ts, platform.b) - platform.a(joints)
        moved = platform.a(joints + 1e-6) - platform.a(joints - 1e-6)
        along = (rods * moved).sum(axis=2) / np.linalg.norm(rods, axis=2) / np.linalg.norm(moved, axis=2)
        return np.abs(along).min(axis=1)

    def tours(self, rng: np.random.Generator) -> list[Array]:
        """Joint positions ``(TOURS, joints)`` step by step along closed polygons."""
        corners = self.chain.random_joints(TOURS * CORNERS, rng).reshape(TOURS, CORNERS, -1)
        return [
            corners[:, i] + share * (corners[:, (i + 1) % CORNERS] - corners[:, i])
            for i in range(CORNERS)
            for share in np.arange(STEPS) / STEPS
        ] + [corners[:, 0]]


def largest(difference: Array) -> float:
    return float(np.abs(difference).max())


def check_measurements(case: Case) -> None:
    """What the simulator measures at random poses is of the mode followed from home, one of all there are."""
    real, nominal = case.real.values, case.chain.nominal_values
    joints = case.chain.random_joints(POSES, np.random.default_rng(case.seed))
    Ts = case.followed(real, joints)
    T_tracker_base = se3.inverse(case.real.T_world_tracker) @ case.real.robot.T_world_frame0
    tool = np.stack(list(case.real.robot.tool.values()))
    measured = case.real.points(joints, tuple(case.real.robot.tool))
    assert largest(measured - se3.transform(T_tracker_base @ Ts, tool)) < SAME
    same = case.signs(real, joints, Ts) == case.signs(nominal, joints, case.followed(nominal, joints))
    assert same[:, 0].all() and same[case.turning(real, joints, Ts) > SIDE].all()
    platform = case.platform(real)
    for i in range(2 if platform.planar else 1):
        modes = platform.all_modes(joints[i], np.random.default_rng(i))
        off = sorted(max(largest(R - Ts[i, :3, :3]), largest(t - Ts[i, :3, 3])) for R, t in modes)
        assert off[0] < SAME and len(off) > 1 and off[1] > OTHER


def check_identified(case: Case) -> None:
    """The model that was identified with noise, at poses that were not measured; and brought to its own poses again."""
    bench, arm = script.Bench.of(case.real, script.THREE, case.seed), case.robot.arm(script.THREE)
    found, row = bench.identified(arm, IdentifyOptions(), script.DEVICE, case.seed)
    assert row["converged"] and not row["refused"] and row["worst_um"] < WORST_UM
    values, joints = found.values, bench.fresh[:POSES]
    expected = case.followed(values, joints)
    T_tracker_base = arm.T_tracker_frame0(values)
    assert largest(arm.platforms(joints, values) - T_tracker_base @ expected) < SAME
    Ts = T_tracker_base @ expected
    tips = se3.transform(Ts, arm.tool_positions(values)["p1"][None])[:, 0]
    wanted, start = PoseTarget(tips, Ts[:, :3, :3]), joints + AWAY * (case.chain.home - joints)
    done = reach(arm, values, wanted, start, np.empty((POSES, 0)), 0)
    clear = done.arrived & (case.turning(values, joints, expected) > CLEAR)
    assert clear.sum() > POSES / 2 and largest(done.joints[clear] - joints[clear]) < 1e-6


def check_motions(case: Case) -> None:
    """Direct kinematics step by step along closed motions, which end where they began.

    Straight ways between poses may lead where no leg can follow: what is followed ends there, and the lab answers
    nothing.
    """
    arm = ClosedArm(case.chain)
    full = np.concatenate([case.real.values, arm.nominal(case.robot.tool)[-3:]])
    at, on = case.tours(np.random.default_rng([case.seed, 1])), np.arange(TOURS)
    first = case.followed(case.real.values, at[0])
    platform, R, t = case.platform(case.real.values), first[:, :3, :3], first[:, :3, 3]
    for before, joints in pairwise(at):
        R, t, done = platform.followed(np.stack([before, joints], axis=1)[on], R, t)
        answer = arm.platforms(joints[on], full)
        assert np.isnan(answer[done < 1]).any(axis=(1, 2)).all()
        on, R, t, answer = on[done == 1], R[done == 1], t[done == 1], answer[done == 1]
        assert largest(answer - se3.pose(R, t)) < SAME
    assert len(on) > TOURS / 2 and largest(se3.pose(R, t) - first[on]) < SAME


CHECKS = (check_measurements, check_identified, check_motions)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ROBOTS)
def test_one_robot_never_swaps_modes(name: str) -> None:
    for check in CHECKS:
        check(Case(name, 0))
