"""Large errors of a verification are named by what they come from, and a change of the arm is not taken for that."""

import numpy as np
import pytest

from lab.calibration.gauss_newton import Observations
from lab.calibration.identification import identify
from lab.calibration.observation import observation_of
from lab.calibration.weights import Noise, weigh
from lab.core import se3
from lab.core.measurements import measured
from lab.core.se3 import Array
from lab.kinematics.serial.serial_arm import SerialArm
from lab.phrases.phrase import phrase
from lab.robots.load_robot import load_robot
from lab.verification.change_test import Verified, verify
from lab.verification.predicted_points import CalibrationPrediction

SIGMA = 1e-5
ROBOTS = ("irb120", "ur5", "panda")
CASES = ("setup", "tool", "setup and tool", "another arm", "points mirrored", "point unit", "joint unit")


class Cell:
    """A calibrated arm, and what measures it later."""

    def __init__(self, robot: str, seed: int, targets: tuple[str, ...] = ("p1",)) -> None:
        self.rng = np.random.default_rng(seed)
        self.robot = load_robot(robot)
        self.arm: SerialArm = self.robot.arm(targets)
        self.truth = self.another()
        joints = self.robot.chain.random_joints(50, self.rng)
        data = measured(self.robot.chain.joint_names, joints, targets, self.points(joints, self.truth))
        found = identify(self.arm, data, self.arm.nominal(), Noise(sigma_m=SIGMA))
        self.prediction = CalibrationPrediction(self.arm, found.values, found.fit.free, found.covariance)
        self.joints = self.robot.chain.random_joints(10, self.rng)

    def another(self) -> Array:
        """An arm as it is made: a millimetre and a milliradian off."""
        rng, tools = self.rng, 3 * len(self.arm.targets)
        truth = self.arm.nominal({target: rng.uniform(-0.1, 0.1, 3) for target in self.arm.targets})
        truth[:6] = [*rng.uniform(-3, 3, 3), *rng.uniform(-1, 1, 3)]
        truth[6:-tools] += 1e-3 * rng.standard_normal(len(truth) - 6 - tools)
        return truth

    def points(self, joints: Array, truth: Array) -> Array:
        points: Array = self.arm.points(joints, truth)
        return points + SIGMA * self.rng.standard_normal(points.shape)

    def seen(self, joints: Array, points: Array) -> Observations:
        data = measured(self.robot.chain.joint_names, joints, self.arm.targets, points)
        return weigh(observation_of(self.arm), data, Noise(sigma_m=SIGMA))[0]

    def verified(self, truth: Array | None = None, refit: tuple[str, ...] = ()) -> Verified:
        return verify(self.prediction, self.seen(self.joints, self.points(self.joints, self.truth_of(truth))), refit)

    def truth_of(self, truth: Array | None) -> Array:
        return self.truth if truth is None else truth

    def moved(self) -> Array:
        """Points in the frame of an instrument that stands elsewhere."""
        T = se3.pose(se3.exp(self.rng.uniform(-1, 1, 3)), self.rng.uniform(-2, 2, 3))
        points = self.points(self.joints, self.truth)
        return se3.transform(T, points.reshape(-1, 3)).reshape(points.shape)

    def tool(self) -> Array:
        truth = self.truth.copy()
        truth[-3 * len(self.arm.targets) :] += self.rng.choice([-1, 1], 3 * len(self.arm.targets)) * 0.02
        return truth

    def case(self, case: str) -> Observations:
        joints, points = self.joints, self.points(self.joints, self.truth)
        if case == "setup":
            points = self.moved()
        elif case == "tool":
            points = self.points(joints, self.tool())
        elif case == "setup and tool":
            truth = self.tool()
            truth[:6] = [*self.rng.uniform(-3, 3, 3), *self.rng.uniform(-1, 1, 3)]
            points = self.points(joints, truth)
        elif case == "another arm":
            points = self.points(joints, self.another())
        elif case == "points mirrored":
            points = points[..., [1, 0, 2]]
        elif case == "point unit":
            points = points * self.rng.choice([1e-3, 1 / 25.4, 1e3])
        elif case == "joint unit":
            joints = joints * self.rng.choice([np.pi / 180, 180 / np.pi])
        return self.seen(joints, points)


def named(cell: Cell, case: str) -> str:
    """The kind of situation that is named, in the first sentence."""
    seen = cell.case(case)
    found = verify(cell.prediction, seen).situation
    if found is None:
        return "nothing"
    refit, kind = found.data.get("refit", ()), found.name.partition(".")[2].replace("_", " ")
    assert refit == {"setup": ("base",), "tool": ("tool",), "setup and tool": ("base", "tool")}.get(case, ())
    if refit:
        again = verify(cell.prediction, seen, refit)
        assert f"--refit {','.join(refit)}." in phrase(found) and again.situation is None
        assert np.sqrt(np.nanmean(again.errors**2)) < 2 * again.expected_m
    return kind


def test_each_situation_is_named() -> None:
    cell = Cell("irb120", 0)
    for case in ("setup", "another arm", "point unit"):
        assert named(cell, case) == case, case


@pytest.mark.parametrize(
    ("robot", "seeds"),
    [
        *(pytest.param(robot, 5, marks=pytest.mark.slow) for robot in ROBOTS),
        *(pytest.param(robot, 1, marks=pytest.mark.thorough) for robot in ROBOTS),
    ],
)
def test_situations_are_named_over_robots_and_seeds(robot: str, seeds: int) -> None:
    for seed in range(seeds):
        cell = Cell(robot, 100 + seed)
        for case in CASES:
            assert named(cell, case) == case, (seed, case)


def changed(cell: Cell, which: int) -> Array:
    """The truth with nothing changed, or by as little as an arm in use changes."""
    truth, names = cell.truth.copy(), cell.arm.names
    if which == 1:
        truth[:3] += 1e-4 * cell.rng.standard_normal(3)
    elif which == 2:
        truth[-3:] += 1e-4 * cell.rng.standard_normal(3)
    elif which == 3:
        truth[names.index("link2.theta")] += 3e-4
        truth[names.index("link4.theta")] += 2e-4
    return truth


@pytest.mark.parametrize(
    ("robot", "count"), [("irb120", 4), *(pytest.param(robot, 8, marks=pytest.mark.thorough) for robot in ROBOTS)]
)
def test_a_small_change_is_no_situation(robot: str, count: int) -> None:
    """Nothing changed, or base, tool or joints by tenths of a millimetre."""
    cell = Cell(robot, 7)
    for which in range(count):
        found = cell.verified(changed(cell, which % 4))
        assert found.situation is None and "--refit" not in phrase(found.check), (which, phrase(found.check))
        assert found.good or which % 4


def test_bad_readings_are_no_situation() -> None:
    """One, or two, of ten that are metres off: neither another arm nor another setup."""
    cell = Cell("irb120", 3)
    for bad in ([4], [4, 7]):
        points = cell.points(cell.joints, cell.truth)
        points[bad, 0] += [10.0, 0.0, 3.0]
        assert verify(cell.prediction, cell.seen(cell.joints, points)).situation is None
    moved = cell.moved()
    moved[2, 0] += 5.0
    found = verify(cell.prediction, cell.seen(cell.joints, moved)).situation
    assert found is not None and found.name == "situation.setup"
    assert phrase(found).startswith("the robot or the instrument was set up anew: use --refit base.")


def test_a_zero_that_is_far_off_is_a_joint() -> None:
    cell = Cell("irb120", 4)
    truth = cell.truth.copy()
    truth[cell.arm.names.index("link3.theta")] += 0.02
    found = cell.verified(truth)
    assert found.situation is None and found.moved == ("joint",)
