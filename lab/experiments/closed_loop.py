"""The loop closed: targets corrected by what was identified, run on the virtual arm and measured there."""

from dataclasses import dataclass

import numpy as np

from lab.calibration.most_likely_parameters import most_likely_parameters
from lab.campaign.robot import Robot
from lab.commands.calibrate.result import CalibrationResult
from lab.compensation.compensator import CLEAR_RAD, Compensator
from lab.compensation.iso9283 import CYCLES, SIDES_M, circle_positions, cube_positions, line_positions
from lab.core import se3
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.differential import ROTATION_M
from lab.kinematics.effects.registry import CAMPAIGN_SPECIFIC
from lab.kinematics.inverse.branches import NominalInverse, ordered
from lab.kinematics.inverse.newton import PoseTarget
from lab.noise.instruments import Instrument
from lab.simulation.collisions import collides, random_poses
from lab.simulation.model import RobotModel
from lab.simulation.tracking import track
from lab.simulation.true_robot import TrueRobot

__all__ = ["PATH_POINTS", "ClosedLoop", "Cube", "VisitedPath", "close_loop", "compensator_of", "reachable_cube"]

PATH_POINTS = 100  # of the circle, and of the line
READINGS = 25  # that a measured point is the mean of: the tracker's noise is not to be taken for the robot's
CENTRES = 300  # places at which a cube is tried
MARGIN_RAD = np.deg2rad(5.0)  # from the joint limits


@dataclass(frozen=True)
class VisitedPath:
    """Targets that were run on the real arm, uncorrected and corrected.

    Attributes:
        wanted: those that could be corrected, ``(n, 3)`` m in the tracker's frame.
        failed: how many could not.
        uncorrected, corrected: joint positions ``(n, joints)``.
        before, after: places measured then ``(cycles, n, 3)`` m.
    """

    wanted: Array
    failed: int
    uncorrected: Array
    corrected: Array
    before: Array
    after: Array

    @property
    def errors(self) -> tuple[Array, Array]:
        """Lengths ``(cycles, n)`` m of the errors, before and after."""
        before, after = (np.linalg.norm(points - self.wanted, axis=2) for points in (self.before, self.after))
        return before, after


def compensator_of(outcome: CalibrationResult, target: str = "p1") -> Compensator:
    """The correction that a campaign's result makes, for one of its targets."""
    found = outcome.identification
    groups = [name for name in outcome.fit.groups if name not in CAMPAIGN_SPECIFIC]
    arm = outcome.robot.arm_with(outcome.fitted.targets, groups)
    likely = dict(
        zip(found.model.names, most_likely_parameters(found, outcome.nominal, outcome.tolerance), strict=True)
    )
    before = dict(zip(found.model.names, found.nominal_aligned, strict=True))
    rigid = arm.rigid
    nominal = NominalInverse(rigid, np.array([before[name] for name in rigid.names]), rigid.targets.index(target))
    return Compensator(nominal, arm, np.array([likely[name] for name in arm.names]))


@dataclass(frozen=True)
class Cube:
    """A test cube in the workspace, in frame 0.

    Attributes:
        centre: ``(3,)`` m; the edges are along the frame's axes.
        turn: rotation ``(3, 3)`` of the last frame in all its poses.
    """

    side_m: float
    centre: Array
    turn: Array

    def poses(self, positions: Array, nominal: NominalInverse) -> PoseTarget:
        """Places ``(n, 3)`` from the centre as targets in the tracker's frame, where the nominal base has it."""
        T_tracker_frame0 = nominal.arm.T_tracker_frame0(nominal.values)
        turns = np.broadcast_to(T_tracker_frame0[:3, :3] @ self.turn, (len(positions), 3, 3))
        return PoseTarget(se3.transform(T_tracker_frame0, self.centre + positions), turns)


@dataclass(frozen=True)
class ClosedLoop:
    """What was run on one arm.

    Attributes:
        poses: the five of the cube, 30 cycles.
        targets: poses all over the workspace.
    """

    cube: Cube
    poses: VisitedPath
    targets: VisitedPath
    circle: VisitedPath
    line: VisitedPath


def reachable_cube(robot: Robot, target: str) -> Cube:
    """The largest of the standard's cubes that the nominal model reaches with one tool rotation and without collision.

    Raises:
        LabError: there is none.
    """
    model = robot.model
    arm = robot.arm((target,))
    nominal = NominalInverse(arm, arm.nominal(robot.tool))
    centres = nominal.tool(random_poses(model, CENTRES, rng_for(0, "structure")))[0]
    aside = np.abs(centres[:, 1, 3]) + ROTATION_M * np.abs(centres[:, 1, 2])
    centres = centres[np.argsort(aside)]  # those straight ahead first
    for side in SIDES_M:
        for T in centres:
            cube = Cube(side, T[:3, 3], T[:3, :3])
            paths = cube_positions(side), circle_positions(side, PATH_POINTS), line_positions(side, PATH_POINTS)
            if all(_clear(model, nominal, cube.poses(positions, nominal)) for positions in paths):
                return cube
    raise LabError(f"robot {robot.name}: no test cube of {SIDES_M[-1]:g} m is within its reach")


def _clear(model: RobotModel, nominal: NominalInverse, wanted: PoseTarget) -> bool:
    """Whether the nominal model reaches all poses, clear of its limits, of singularities and of collisions."""
    chain, anywhere = nominal.arm.chain, np.full((len(wanted), nominal.arm.chain.size), np.nan)
    ways = nominal.ways(wanted, anywhere)
    joints = ordered(chain, ways, anywhere, np.zeros(ways.gap_m.shape, dtype=np.bool_))[0][:, 0]
    if ways.gap_m.min(axis=1).max() > 0 or chain.beyond_limits(joints, -MARGIN_RAD).any():
        return False
    distance, _ = nominal.arm.singular_distance(joints, nominal.values, nominal.target)
    return bool(distance.min() > CLEAR_RAD) and not collides(model, joints).any()


def close_loop(
    outcome: CalibrationResult,
    cube: Cube,
    instrument: Instrument,
    seed: int,
    payload_kg: float = 0.0,
    targets: int = 1000,
) -> ClosedLoop:
    """Correct targets by what a virtual campaign found, run them on its arm, and measure with its tracker.

    Args:
        payload_kg: at the flange all the time.
        targets: how many poses all over the workspace.
    """
    assert outcome.real is not None
    compensator = compensator_of(outcome)
    runner, nominal = _Runner(outcome.real, compensator, instrument, payload_kg, seed), compensator.nominal
    poses = nominal.tool(random_poses(outcome.real.robot, targets, rng_for(seed, "targets")))[0]
    return ClosedLoop(
        cube,
        runner.run(cube.poses(cube_positions(cube.side_m), nominal), CYCLES),
        runner.run(PoseTarget(poses[:, :3, 3], poses[:, :3, :3])),
        runner.run(cube.poses(circle_positions(cube.side_m, PATH_POINTS), nominal)),
        runner.run(cube.poses(line_positions(cube.side_m, PATH_POINTS), nominal)),
    )


@dataclass(frozen=True)
class _Runner:
    """The real arm, what is known of it, and what measures it."""

    real: TrueRobot
    compensator: Compensator
    instrument: Instrument
    payload_kg: float
    seed: int

    def run(self, wanted: PoseTarget, cycles: int = 1) -> VisitedPath:
        """Correct the targets, and visit them before and after."""
        count, conditions = len(wanted), self.compensator.arm.conditions
        setting = {name: self.payload_kg if name == "payload_kg" else 0.0 for name in conditions}
        asked = np.tile(np.array([setting[name] for name in conditions]), (count, 1))
        anywhere = np.full((count, self.real.robot.chain.size), np.nan)
        found = self.compensator(wanted, asked, anywhere)
        done = np.flatnonzero(found.converged)
        uncorrected, corrected = found.uncorrected[done], found.joints[done]
        before, after = (self._visited(joints, cycles) for joints in (uncorrected, corrected))
        return VisitedPath(wanted.positions[done], count - len(done), uncorrected, corrected, before, after)

    def _visited(self, joints: Array, cycles: int) -> Array:
        """Places ``(cycles, n, 3)`` that the tracker measures, one cycle after the other."""
        nominal, every = self.compensator.nominal, np.tile(joints, (cycles, 1))
        load = {"payload_kg": np.full(len(every), self.payload_kg)}
        name, rng = nominal.arm.targets[nominal.target], rng_for(self.seed, "visits")
        data = track(self.real, every, (name,), self.instrument, rng, READINGS, load)
        return data.points.reshape(cycles, len(joints), 3)
