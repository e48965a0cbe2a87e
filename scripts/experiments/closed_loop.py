"""The loop closed: virtual arms are calibrated from designed poses, their targets corrected, run, and measured.

AP and RP are those of ISO 9283 (five poses of a cube, 30 cycles); beside them targets all over the workspace, a
circle and a line, before and after. With a stiffness the arms bend under a payload: then the same arms are also
calibrated without compliance, to say what that costs.
"""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from iso_cube import SIDES_M, circle_positions, cube_positions, line_positions
from shared import Answer, Document, Flag, Paragraph, paragraphs, run_script

import lab
from lab.calibration.most_likely import most_likely_parameters
from lab.compensation.compensator import CLEAR_RAD, Compensator
from lab.compensation.iso9283 import CYCLES, accuracy, repeatability
from lab.core import limits, se3
from lab.core.errors import LabError
from lab.core.limits import whole
from lab.core.measurements import measured
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.formats.measurement_csv import write_measurements
from lab.kinematics.differential import ROTATION_M
from lab.kinematics.effects.effect_registry import CAMPAIGN_SPECIFIC
from lab.kinematics.inverse.branches import NominalInverse, ordered
from lab.kinematics.inverse.newton_inverse import PoseTarget
from lab.noise.instruments import Instrument, instrument
from lab.options.option_groups import Effects, Fitting
from lab.options.virtual_campaign import DesignOptions, VirtualCampaign
from lab.planning.design_problem import pose_problem
from lab.planning.design_search import best_design
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot
from lab.simulation.collisions import collides, random_poses
from lab.simulation.robot_model import RobotModel
from lab.simulation.tracking import track
from lab.simulation.true_robot import TrueRobot

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


def compensator_of(outcome: lab.CalibrationResult, target: str = "p1") -> Compensator:
    """The correction that a campaign's result makes, for one of its targets."""
    found = outcome.identification
    groups = [name for name in outcome.state.groups if name not in CAMPAIGN_SPECIFIC]
    arm = outcome.robot.arm_with(outcome.fitted.targets, groups)
    likely = dict(
        zip(
            found.model.names,
            most_likely_parameters(found, outcome.nominal, outcome.state.fitter.options.tolerance),
            strict=True,
        )
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
    ways = nominal.solutions(wanted, anywhere)
    joints = ordered(chain, ways, anywhere, np.zeros(ways.gap_m.shape, dtype=np.bool_))[0][:, 0]
    if ways.gap_m.min(axis=1).max() > 0 or chain.beyond_limits(joints, -MARGIN_RAD).any():
        return False
    distance, _ = nominal.arm.singular_distance(joints, nominal.values, nominal.target)
    return bool(distance.min() > CLEAR_RAD) and not collides(model, joints).any()


def close_loop(
    outcome: lab.CalibrationResult,
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
    assert outcome.truth is not None
    compensator = compensator_of(outcome)
    runner, nominal = _Runner(outcome.truth.robot, compensator, instrument, payload_kg, seed), compensator.nominal
    poses = nominal.tool(random_poses(outcome.truth.robot.robot, targets, rng_for(seed, "targets")))[0]
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


POSES = 30
COURSES = ("targets", "circle", "line")


@dataclass(frozen=True)
class Options:
    """How much to simulate, and what the arms are like."""

    arms: int = 50
    """Virtual arms."""
    seed: int = 0
    """Of the first arm; the others follow."""
    targets: int = 1000
    """Poses all over the workspace."""
    instrument: str = "uniform-8um"
    """Of the calibration and of the test."""
    stiffness_nm_per_rad: float | None = None
    """Of the joints that bear the weight; rigid without."""
    payload_kg: float = 0.0
    """At the flange when the targets are run."""
    repeatability_mrad: float = 0.005
    """Of each joint, 1 sigma."""
    json: Flag = False
    """Print one JSON object."""


def answer(options: Options) -> Answer:
    """Run some arms.

    Raises:
        LabError: an option is out of range, or a payload would move nothing.
    """
    whole("--arms", options.arms, 1, limits.ROBOTS)
    whole("--targets", options.targets, 1, limits.POSES)
    if options.payload_kg and options.stiffness_nm_per_rad is None:
        raise LabError("--payload-kg moves nothing on a rigid arm: give --stiffness-nm-per-rad too")
    result = study(options)
    return Answer(result, Document("The closed loop: calibrated, corrected, run and measured", table(result)))


def study(options: Options) -> dict[str, Any]:
    """Every arm with the full model, and where they bend also with geometry alone."""
    robot = load_robot("irb120")
    cube = reachable_cube(robot, "p1")
    bends = options.stiffness_nm_per_rad is not None
    effects = Effects(
        stiffness_nm_per_rad=options.stiffness_nm_per_rad,
        payload_kg=(0.0, options.payload_kg) if options.payload_kg else (0.0,),
        repeatability_mrad=options.repeatability_mrad,
    )
    loops: dict[str, list[ClosedLoop]] = {}
    with tempfile.TemporaryDirectory() as folder:
        plan = Path(folder) / "plan.csv"
        asked = DesignOptions(poses=POSES, instrument=options.instrument)
        joints = best_design(asked, pose_problem(asked), POSES).joints
        nothing = np.full((POSES, 1, 3), np.nan)
        write_measurements(plan, measured(robot.chain.joint_names, joints, ("p1",), nothing), robot.chain.prismatic)
        for seed in range(options.seed, options.seed + options.arms):
            campaign = VirtualCampaign(plan=plan, seed=seed, instrument=options.instrument, effects=effects)
            for model in ("compliance", "geometric") if bends else ("geometric",):
                outcome = lab.calibrate(replace(campaign, fitting=Fitting(model)))
                loops.setdefault(model, []).append(closed(outcome, cube, seed, options))
    models = list(loops)
    found = {"arms": options.arms, "model": models[0], "cube_mm": 1e3 * cube.side_m, **figures(loops[models[0]])}
    if bends:
        without = figures(loops["geometric"])
        found |= {f"{key}_without_compliance": without[key] for key in ("ap_after_mm", "targets_after_mm")}
    return found


def closed(outcome: lab.CalibrationResult, cube: Cube, seed: int, options: Options) -> ClosedLoop:
    """One arm's loop."""
    return close_loop(outcome, cube, instrument(options.instrument), seed, options.payload_kg, options.targets)


def figures(loops: list[ClosedLoop]) -> dict[str, Any]:
    """Over all arms, mm: of AP before the median, of everything else the mean, and the worst."""
    before, after, spread = (
        1e3 * np.array(each)  # (arms, 5)
        for each in (
            [accuracy(loop.poses.before, loop.poses.wanted) for loop in loops],
            [accuracy(loop.poses.after, loop.poses.wanted) for loop in loops],
            [repeatability(loop.poses.after) for loop in loops],
        )
    )
    found = {
        "ap_before_mm": float(np.median(before.mean(axis=1))),
        "ap_after_mm": float(after.mean()),
        "ap_after_worst_mm": float(after.mean(axis=1).max()),
        "rp_mm": float(spread.mean()),
    }
    for name in COURSES:
        courses = [getattr(loop, name) for loop in loops]
        errors = [[1e3 * part.ravel() for part in course.errors] for course in courses]
        for k, when in enumerate(("before", "after")):
            found[f"{name}_{when}_mm"] = float(np.mean([each[k].mean() for each in errors]))
            found[f"{name}_{when}_worst_mm"] = float(max(each[k].max() for each in errors))
        found[f"{name}_not_reached"] = sum(course.failed for course in courses)
    return found


def table(result: dict[str, Any]) -> tuple[Paragraph, ...]:
    """The figures in a few lines."""
    after, worst = result["ap_after_mm"], result["ap_after_worst_mm"]
    lines = [
        f"{result['arms']} arms calibrated from {POSES} designed poses ({result['model']}), mm:",
        f"  ISO 9283, cube of {result['cube_mm']:g} mm: AP {result['ap_before_mm']:.3f} before (median), "
        f"{after:.4f} after (mean; worst arm {worst:.4f}); RP {result['rp_mm']:.4f}",
    ]
    for name in COURSES:
        before, after, worst = (result[f"{name}_{key}_mm"] for key in ("before", "after", "after_worst"))
        missed = f"; {result[f'{name}_not_reached']} not reached" if result[f"{name}_not_reached"] else ""
        lines.append(f"  {name}: {before:.3f} before, {after:.4f} after (worst {worst:.4f}){missed}")
    if "ap_after_mm_without_compliance" in result:
        worse = result["ap_after_mm_without_compliance"] - result["ap_after_mm"]
        lines.append(
            f"  without compliance in the model: AP {result['ap_after_mm_without_compliance']:.4f}, {worse:.4f} worse; "
            f"targets {result['targets_after_mm_without_compliance']:.4f}"
        )
    return paragraphs(lines)


if __name__ == "__main__":
    run_script("closed_loop")
