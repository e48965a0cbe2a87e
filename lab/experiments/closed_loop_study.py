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

from lab.campaign.design_problem import pose_problem
from lab.campaign.design_search import best_design
from lab.campaign.option_groups import ArmEffects, Fitting
from lab.campaign.option_types import Flag
from lab.campaign.options import DesignOptions, VirtualCampaign
from lab.campaign.robot import load_robot
from lab.commands.calibrate.run import CalibrationResult, calibrate
from lab.compensation.iso9283 import accuracy, repeatability
from lab.core import limits
from lab.core.errors import LabError
from lab.core.measurements import measured
from lab.core.numbers import whole
from lab.experiments.closed_loop import ClosedLoop, Cube, close_loop, reachable_cube
from lab.experiments.script import Answer, paragraphs
from lab.formats.measurement_csv import write_measurements
from lab.noise.instruments import instrument
from lab.render.document import Document, Paragraph

__all__ = ["Options", "answer"]

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
    out: Path | None = None
    """Write the first arm's recording to this file (.rrd)."""
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
    effects = ArmEffects(
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
                outcome = calibrate(replace(campaign, fitting=Fitting(model)))
                loops.setdefault(model, []).append(closed(outcome, cube, seed, options))
    models = list(loops)
    found = {"arms": options.arms, "model": models[0], "cube_mm": 1e3 * cube.side_m, **figures(loops[models[0]])}
    if bends:
        without = figures(loops["geometric"])
        found |= {f"{key}_without_compliance": without[key] for key in ("ap_after_mm", "targets_after_mm")}
    return found


def closed(outcome: CalibrationResult, cube: Cube, seed: int, options: Options) -> ClosedLoop:
    """One arm's loop; the first one's is recorded."""
    loop = close_loop(outcome, cube, instrument(options.instrument), seed, options.payload_kg, options.targets)
    whole = bool(outcome.fit.groups) == (options.stiffness_nm_per_rad is not None)
    if options.out is not None and seed == options.seed and whole:
        from lab.experiments.closed_loop_recording import record_loop

        record_loop(options.out, outcome, loop)
    return loop


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
