"""The loop closed: virtual arms are calibrated from designed poses, their targets corrected, run, and measured.

AP and RP are those of ISO 9283 (five poses of a cube, 30 cycles); beside them targets all over the workspace, a
circle and a line, before and after. With a stiffness the arms bend under a payload: then the same arms are also
calibrated without compliance, to say what that costs.
"""

import argparse
import json
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from lab.campaign.design_problem import pose_problem
from lab.campaign.design_search import best_design
from lab.campaign.option_groups import ArmEffects, Fitting
from lab.campaign.options import DesignOptions, VirtualCampaign
from lab.campaign.robot import load_robot
from lab.commands.calibrate.run import CalibrationResult, calibrate
from lab.compensation.iso9283 import accuracy, repeatability
from lab.core.errors import LabError
from lab.core.instruments import instrument
from lab.core.measurements import measured
from lab.experiments.closed_loop import ClosedLoop, Cube, close_loop, reachable_cube
from lab.formats.measurement_csv import write_measurements

POSES = 30
COURSES = ("targets", "circle", "line")


def positive(text: str) -> int:
    """A whole number of one or more."""
    if (number := int(text)) < 1:
        raise ValueError
    return number


def main() -> None:
    """Run some arms and print what came out."""
    flags = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    flags.add_argument("--arms", type=positive, default=50, help="how many virtual arms")
    flags.add_argument("--seed", type=int, default=0, help="of the first arm; the others follow")
    flags.add_argument("--targets", type=positive, default=1000, help="poses all over the workspace")
    flags.add_argument("--instrument", default="uniform-8um", help="of the calibration and of the test")
    flags.add_argument("--stiffness-nm-per-rad", type=float, help="of the joints that bear the weight; rigid without")
    flags.add_argument("--payload-kg", type=float, default=0.0, help="at the flange when the targets are run")
    flags.add_argument("--repeatability-mrad", type=float, default=0.005, help="of each joint, 1 sigma")
    flags.add_argument("--out", type=Path, help="write the first arm's recording to this file (.rrd)")
    flags.add_argument("--json", action="store_true", help="print one JSON object")
    given = flags.parse_args()
    if given.payload_kg and given.stiffness_nm_per_rad is None:
        flags.error("--payload-kg moves nothing on a rigid arm: give --stiffness-nm-per-rad too")
    try:
        with threadpool_limits(1):
            result = study(given)
    except LabError as error:
        flags.error(str(error))
    print(json.dumps(result) if given.json else table(result))


def study(given: argparse.Namespace) -> dict[str, Any]:
    """Every arm with the full model, and where they bend also with geometry alone."""
    robot = load_robot("irb120")
    cube = reachable_cube(robot, "p1")
    bends = given.stiffness_nm_per_rad is not None
    effects = ArmEffects(
        stiffness_nm_per_rad=given.stiffness_nm_per_rad,
        payload_kg=(0.0, given.payload_kg) if given.payload_kg else (0.0,),
        repeatability_mrad=given.repeatability_mrad,
    )
    loops: dict[str, list[ClosedLoop]] = {}
    with tempfile.TemporaryDirectory() as folder:
        plan = Path(folder) / "plan.csv"
        asked = DesignOptions(poses=POSES, instrument=given.instrument)
        joints = best_design(asked, pose_problem(asked), POSES).joints
        nothing = np.full((POSES, 1, 3), np.nan)
        write_measurements(plan, measured(robot.chain.joint_names, joints, ("p1",), nothing), robot.chain.prismatic)
        for seed in range(given.seed, given.seed + given.arms):
            campaign = VirtualCampaign(plan=plan, seed=seed, instrument=given.instrument, effects=effects)
            for model in ("compliance", "geometric") if bends else ("geometric",):
                outcome = calibrate(replace(campaign, fitting=Fitting(model)))
                loops.setdefault(model, []).append(closed(outcome, cube, seed, given))
    models = list(loops)
    found = {"arms": given.arms, "model": models[0], "cube_mm": 1e3 * cube.side_m, **figures(loops[models[0]])}
    if bends:
        without = figures(loops["geometric"])
        found |= {f"{key}_without_compliance": without[key] for key in ("ap_after_mm", "targets_after_mm")}
    return found


def closed(outcome: CalibrationResult, cube: Cube, seed: int, given: argparse.Namespace) -> ClosedLoop:
    """One arm's loop; the first one's is recorded."""
    loop = close_loop(outcome, cube, instrument(given.instrument), seed, given.payload_kg, given.targets)
    whole = bool(outcome.fit.groups) == (given.stiffness_nm_per_rad is not None)
    if given.out is not None and seed == given.seed and whole:
        from lab.experiments.closed_loop_recording import record_loop

        record_loop(given.out, outcome, loop)
    return loop


def figures(loops: list[ClosedLoop]) -> dict[str, Any]:
    """Over all arms, mm: of AP before the median, of everything else the mean, and the worst."""
    before, after, spread = (
        1e3 * np.array([measure(loop) for loop in loops])  # (arms, 5)
        for measure in (
            lambda loop: accuracy(loop.poses.before, loop.poses.wanted),
            lambda loop: accuracy(loop.poses.after, loop.poses.wanted),
            lambda loop: repeatability(loop.poses.after),
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


def table(result: dict[str, Any]) -> str:
    """The same as a few lines."""
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
    return "\n".join(lines)


if __name__ == "__main__":
    main()
