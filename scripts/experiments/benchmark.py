"""How fast the lab is: medians of processor time on one thread, and their ratios to a yardstick run in between."""

import json
import os
import platform
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from closed_loop import compensator_of
from scipy.optimize import least_squares
from shared import Answer, Document, Flag, paragraphs, processor, run_script

import lab
from lab.calibration.batched_fits import align, fit_points
from lab.calibration.fit_options import FitOptions
from lab.calibration.fitter import Fitter
from lab.calibration.gauss_newton import Observations, fit
from lab.calibration.identification import Identification, fit_base_and_tool, identify
from lab.calibration.observation import Points
from lab.calibration.statistics.linearized import NoiseDistribution
from lab.calibration.statistics.model_selection import select
from lab.calibration.statistics.outliers import find_outliers
from lab.calibration.weights import Noise, weigh
from lab.core.limits import PROGRAM_BYTES, PROGRAM_MOVES
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.dynamics.arm_simulation import LoadBench, RigidLoad, RunErrors, peak_torques
from lab.extensions.dynamics.load_files import Mounting
from lab.extensions.dynamics.payload.excitation import Limits, random_path
from lab.extensions.dynamics.payload.methods import from_torques
from lab.formats.cell_toml import read_cell
from lab.formats.joint_log import JointLog
from lab.formats.programs.languages import read_program
from lab.formats.programs.program_text import Outside
from lab.formats.tracker_export import TrackerPoints
from lab.kinematics.compiled.kernels import compiled
from lab.kinematics.effects.effect import HOUR_S
from lab.kinematics.gauge import base_set
from lab.kinematics.inverse.closed_form import closed_form_of
from lab.kinematics.inverse.newton_inverse import PoseTarget
from lab.kinematics.serial.serial_arm import SerialArm, StackedArm
from lab.library.log_matching import matched
from lab.library.virtual_arm import perturbed_arm
from lab.noise.instruments import instrument
from lab.options.command_options import ImportOptions
from lab.options.option_groups import Effects
from lab.options.virtual_campaign import DesignOptions, VirtualCampaign
from lab.planning.design_problem import pose_problem
from lab.planning.design_search import best_design
from lab.pose_selection.certificate import certify
from lab.robots.load_robot import load_robot, load_virtual
from lab.sensors.points import PointSensor
from lab.simulation.candidate_poses import draw_candidates
from lab.simulation.cell import in_cell
from lab.simulation.collisions import random_poses
from lab.simulation.effects import random_conditions
from lab.simulation.tracking import track

BUDGET_MS = {
    "identify 27 parameters, 50 poses": 5,
    "positions and derivatives, 50 poses": 0.5,
    "positions and derivatives, 100,000 poses": 150,
    "the same, 2,000 poses of a 2-RPR": 24,
    "the same, 2,000 poses of a 3-RPR": 70,
    "the same, 2,000 poses of a Delta": 200,
    "truth of a virtual arm": 5,
    "10,000 poses measured": 100,
    "10,000 feasible candidates": 5000,
    "bound over 2,000 candidates, gap 0.1 %": 5000,
    "30 poses from 10,000 candidates": 10_000,
    "model auto, 1,000 poses with 3 targets": 10_000,
    "robust fit of 1,000 poses": 500,
    "1,000 identifications from 30 poses, stacked": 333,
    "the same with a frozen Jacobian": 67,
    "all eight inverse solutions, 10,000 poses": 50,
    "10,000 targets corrected, by all three schemes": 2000,
    "payload from 2 x 10 s of torques at 1 kHz": 2000,
    "20,000 points matched to poses by time": 2000,
    "4 MiB of RAPID comments read": 5000,
    "20,000 RAPID moves read": 5000,
    "4 MiB of RAPID in one line read": 5000,
    "a cell of 2,000 obstacles read and built": 10_000,
    "lab --help": 500,
    "lab calibrate": 8000,
}


@dataclass(frozen=True)
class Options:
    """How to print, and where to keep."""

    json: Flag = False
    """Print one JSON object."""
    history: Path | None = None
    """Add a line with the figures, their ratios and the machine to this file of JSON lines."""


def median_ms(call: Callable[[], Any], repeats: int) -> float:
    """The median processor time of a call with the processes that it starts, after one call that does not count."""
    call()
    times = []
    for _ in range(repeats):
        started = _processor_s()
        call()
        times.append(_processor_s() - started)
    return 1e3 * float(np.median(times))


def _processor_s() -> float:
    spent = os.times()
    return time.process_time() + spent.children_user + spent.children_system


class Yardstick:
    """A load that no change of the lab touches, measured before and after every figure: what it takes says how fast the
    machine is just then, and a figure over it compares from hour to hour, and roughly from machine to machine.

    Half of it are numpy's calls on short arrays, as a walk along a chain of 50 poses makes them; half a matrix product.
    """

    def __init__(self) -> None:
        rng = np.random.default_rng(0)
        self._axes, self._angles = rng.standard_normal((3, 5, 50)), rng.standard_normal((150, 50))
        self._matrix = rng.standard_normal((300, 300))

    def __call__(self) -> None:
        """The load, about two milliseconds."""
        x, y, z = self._axes
        for angle in self._angles:
            c, s = np.cos(angle), np.sin(angle)
            x, y, z = c * y + s * z, c * z - s * y, x
        self._matrix @ self._matrix

    def ms(self) -> float:
        """What it takes now."""
        return median_ms(self, 15)


def over_yardstick(parts: Sequence[Callable[[], dict[str, float]]]) -> tuple[dict[str, float], dict[str, float]]:
    """The figures of all parts, and what each is over the yardstick, measured before and after its part."""
    yardstick, figures, ratios = Yardstick(), dict[str, float](), dict[str, float]()
    before = yardstick.ms()
    for part in parts:
        found = part()
        after = yardstick.ms()
        figures |= found
        ratios |= {name: 2 * ms / (before + after) for name, ms in found.items() if not name.startswith("MB")}
        before = after
    return figures, ratios


def machine() -> str:
    """The processor's name and how many of them, Python and numpy, and whether the kernels are compiled."""
    kernels = "compiled kernels" if compiled() else "no compiled kernels"
    return f"{processor()}, Python {platform.python_version()}, numpy {np.__version__}, {kernels}"


def peak_beyond_result_mb(call: Callable[[], tuple[np.ndarray, np.ndarray]]) -> float:
    """The most memory that a call needs beyond the arrays that it returns."""
    tracemalloc.start()
    returned = call()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return (peak - sum(array.nbytes for array in returned)) / 1e6


def by_the_lab(arm: SerialArm, data: Measurements, start: Identification) -> None:
    """The fit alone, from located base and tool."""
    solved = fit(arm, Observations.unweighted(data), start.fit.free, start.nominal_aligned)
    assert np.abs(solved.values - start.values).max() < 1e-9


def by_scipy(arm: SerialArm, data: Measurements, start: Identification) -> None:
    """The same from the same start, by scipy's least squares with finite differences."""
    free, values = list(start.fit.free), start.nominal_aligned.copy()
    scale = start.fit.scale / start.fit.scale.max()

    def residual(x: np.ndarray) -> np.ndarray:
        values[free] = x / scale
        return 1e6 * (arm.points(data.joints, values) - data.points).ravel()

    solved = least_squares(residual, start.nominal_aligned[free] * scale, x_scale="jac")
    assert np.abs(solved.x / scale - start.values[free]).max() < 1e-6


def kernels() -> dict[str, float]:
    """Milliseconds of the parts, and megabytes of the large batch."""
    robot, options = load_robot("irb120"), VirtualCampaign(seed=7)
    model, arm, tracker = robot.model, robot.serial_arm(("p1",)), instrument("uniform-8um")
    real, nominal = perturbed_arm(robot, options), arm.nominal(robot.tool)
    data = track(real, random_poses(model, 50, rng_for(7, "poses")), ("p1",), tracker, rng_for(7, "noise"))
    many = robot.chain.random_joints(100_000, rng_for(7, "fresh"))
    found = identify(arm, data, nominal, Noise(tracker))
    rng = rng_for(7, "noise")
    results = {
        "identify 27 parameters, 50 poses": median_ms(lambda: identify(arm, data, nominal, Noise(tracker)), 100),
        "its fit alone": median_ms(lambda: by_the_lab(arm, data, found), 100),
        "that fit by scipy, finite differences": median_ms(lambda: by_scipy(arm, data, found), 10),
        "positions and derivatives, 50 poses": median_ms(lambda: arm.observe(data.joints, nominal), 200),
        "positions and derivatives, 100,000 poses": median_ms(lambda: arm.observe(many, nominal), 10),
        "truth of a virtual arm": median_ms(lambda: real.truth(arm.targets), 100),
        "10,000 poses measured": median_ms(lambda: track(real, many[:10_000], ("p1",), tracker, rng), 10),
    }
    results["MB beyond the result, 100,000 poses"] = peak_beyond_result_mb(lambda: arm.observe(many, nominal))
    return results


def mechanisms() -> dict[str, float]:
    """Milliseconds of mechanisms with loops, closed anew at poses that they were never at."""
    results = {}
    for name, path in (("2-RPR", "rpr2"), ("3-RPR", "rpr3"), ("Delta", "delta")):
        robot = load_robot(path)
        arm, joints = robot.arm(("p1",)), robot.chain.random_joints(2000, rng_for(7, "poses"))
        values = arm.nominal(robot.tool) + 1e-4 * rng_for(7, "arm").standard_normal(len(arm.names))
        results[f"the same, 2,000 poses of a {name}"] = median_ms(partial(arm.observe, joints, values), 20)
    return results


def planning() -> dict[str, float]:
    """Milliseconds of the parts of a plan."""
    options = DesignOptions(poses=30, candidates=10_000)
    problem, tracker = pose_problem(options), instrument(options.instrument)
    model = problem.robot.model

    def candidates() -> Any:
        return draw_candidates(model, options.targets, tracker, options.candidates, rng_for(0, "candidates"))

    return {
        "10,000 feasible candidates": median_ms(candidates, 3),
        "bound over 2,000 candidates, gap 0.1 %": median_ms(lambda: certify(problem.pool[:2000]), 3),
        "30 poses from 10,000 candidates": median_ms(lambda: best_design(options, problem, 30), 3),
    }


def effects() -> dict[str, float]:
    """Milliseconds of choosing a model, and of finding bad readings, among 1,000 poses."""
    soft = Effects(1e5, (0.0, 3.0), harmonic_mrad=0.2, backlash_mrad=0.05, drift_mm_per_h=0.05)
    robot, targets, tracker = load_robot("irb120"), ("p1", "p2", "p3"), instrument("uniform-8um")
    real = perturbed_arm(robot, VirtualCampaign(seed=7, effects=soft))
    poses, rng = random_poses(robot.model, 1000, rng_for(7, "poses")), rng_for(7, "noise")
    there = random_conditions(robot.chain, real.effects, 1000, rng_for(7, "conditions"), soft.payload_kg, HOUR_S)
    data = track(real, poses, targets, tracker, rng, conditions=there)
    fitter = Fitter(robot, targets, data, PointSensor(), Noise(tracker), FitOptions(search=True), 7)

    one = robot.serial_arm(("p1",))
    rigid = perturbed_arm(robot, VirtualCampaign(seed=7, effects=Effects(bad_share=0.05)))
    seen, _ = weigh(Points(one), track(rigid, poses, ("p1",), tracker, rng), Noise(tracker))
    free, start = base_set(one, one.nominal(robot.tool)).identifiable, one.nominal(robot.tool)

    def robust() -> None:
        before = fit_base_and_tool(Points(one), seen, start)
        find_outliers(one, seen, free, before, sigma_given=True, rng=rng, shape=NoiseDistribution("uniform"))

    def auto() -> None:
        chosen = select(fitter.model_with, data, fitter.nominal, Noise(tracker)).chosen
        assert {"compliance", "harmonics", "backlash", "drift"} <= set(chosen), chosen

    return {
        "model auto, 1,000 poses with 3 targets": median_ms(auto, 3),
        "robust fit of 1,000 poses": median_ms(robust, 5),
    }


def stacked() -> dict[str, float]:
    """Milliseconds of many identifications of 27 parameters at once, from no guess of the base."""
    robot = load_robot("irb120")
    arm, tracker = robot.serial_arm(("p1",)), instrument("uniform-8um")
    nominal, many = arm.nominal(robot.tool), StackedArm(arm)
    free, joints = base_set(arm, nominal).identifiable, robot.chain.random_joints(30, rng_for(7, "poses"))
    exact = perturbed_arm(robot, VirtualCampaign(seed=7)).points(joints, ("p1",))
    points = np.array([tracker.sample(exact, rng_for(7, "noise", draw)) for draw in range(1000)])

    def solve(frozen: bool) -> None:
        found = fit_points(align(many, joints, points, nominal), nominal, free, frozen=frozen)
        assert found.converged.all()

    return {
        "1,000 identifications from 30 poses, stacked": median_ms(lambda: solve(False), 7),
        "the same with a frozen Jacobian": median_ms(lambda: solve(True), 7),
    }


def compensation() -> dict[str, float]:
    """Milliseconds of the inverse of the nominal model and of a calibrated arm."""
    outcome = lab.calibrate(seed=7)
    chain, compensator = outcome.robot.serial_model.chain, compensator_of(outcome)
    closed_form = closed_form_of(chain)
    assert closed_form is not None
    joints, nothing = chain.random_joints(10_000, rng_for(7, "targets")), np.empty((10_000, 0))
    Ts, _ = compensator.arm.tool(joints, compensator.values)
    wanted, anywhere = PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3]), np.full(joints.shape, np.nan)
    flanges = compensator.nominal.last_frames(wanted)
    return {
        "all eight inverse solutions, 10,000 poses": median_ms(lambda: closed_form.solve(flanges), 10),
        "10,000 targets corrected, by all three schemes": median_ms(lambda: compensator(wanted, nothing, anywhere), 3),
    }


def measuring() -> dict[str, float]:
    """Milliseconds of a payload from a run's torques, and of finding the pose of each of many points."""
    robot, gravity = load_virtual("tx40").serial_model, np.array([0.0, 0.0, -9.81])
    path = random_path(Limits.of(robot.chain, torque=peak_torques(robot)), rng_for(7, "design"))
    load = RigidLoad(1.5, np.array([0.010, -0.005, 0.060]), np.diag([22.5e-4, 26e-4, 12.5e-4]))
    bench = LoadBench(robot, load, Mounting(gravity), RunErrors(1e-6, torque_noise=0.005))
    arm, records = SerialArm(robot.chain), bench.moving(path.at, 10.0, 1e3, rng_for(7, "noise"))

    number, file = 20_000, Path("clock")
    at: Array = np.arange(0.0, 10.0 * number, 10.0)
    none: Array = np.full(number, np.nan)
    lines, names = tuple(range(number)), ("",) * number
    points = TrackerPoints(
        file, names, names, lines, np.ones((number, 3)), none, at + 1, "seconds", none, none, none, {}, (), (), ()
    )
    log = JointLog(file, names, lines, np.zeros((number, 6)), at, "seconds", {}, ())
    asked, hinges = ImportOptions(file, file, by="time"), (False,) * 6
    return {
        "payload from 2 x 10 s of torques at 1 kHz": median_ms(
            lambda: from_torques(arm, arm.nominal(), records, gravity), 3
        ),
        "20,000 points matched to poses by time": median_ms(lambda: matched(asked, points, log, hinges), 3),
    }


def inputs() -> dict[str, float]:
    """Milliseconds of reading programs as long as they may be, and a cell with very many obstacles."""
    robot, place = load_robot("irb120"), "[[100,0,500],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    move = f"MoveJ {place},v100,fine,tool0;\n"

    def read(line: str) -> None:
        lines = min(
            (PROGRAM_BYTES.most - len(move)) // len(line),
            PROGRAM_MOVES.most - 1 if line == move else PROGRAM_BYTES.most,
        )
        text = line * lines + f"\n{move}"
        read_program(Path("a.mod"), text, robot.chain, None, Outside())

    def build(path: Path) -> None:
        in_cell(robot.model, read_cell(path))

    texts = {
        "4 MiB of RAPID comments": "! a comment\n",
        "20,000 RAPID moves": move,
        "4 MiB of RAPID in one line": "a b,",
    }
    found = {f"{name} read": median_ms(partial(read, line), 1) for name, line in texts.items()}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cell.toml"
        box = '[[obstacle]]\nname = "o{}"\nshape = "box"\nsize_mm = [20, 20, 20]\nposition_mm = [{}, {}, 0]\n'
        path.write_text("".join(box.format(i, 1500 + 40 * (i % 40), 40 * (i // 40)) for i in range(2000)))
        return found | {"a cell of 2,000 obstacles read and built": median_ms(partial(build, path), 1)}


def processes() -> dict[str, float]:
    """Milliseconds of whole commands."""
    with tempfile.TemporaryDirectory() as folder:
        calibrate = [sys.executable, "-m", "lab", "calibrate", "--seed", "7", "--json", "--out", f"{folder}/run"]
        calibrate.append("--overwrite")

        def run(command: list[str]) -> None:
            subprocess.run(command, check=True, capture_output=True)

        return {
            "lab --help": median_ms(lambda: run([sys.executable, "-m", "lab", "--help"]), 5),
            "lab calibrate": median_ms(lambda: run(calibrate), 5),
        }


def answer(options: Options) -> Answer:
    """Measure everything, and set it beside its budget and the yardstick."""
    parts = (kernels, mechanisms, planning, effects, stacked, compensation, measuring, inputs, processes)
    results, ratios = over_yardstick(parts)
    ratio = results["that fit by scipy, finite differences"] / results["its fit alone"]
    lines = [f"{machine()}; processor time of medians, and how many yardsticks that is"]
    for name, value in results.items():
        unit = "MB" if name.startswith("MB") else "ms"
        budget = 50 if unit == "MB" else BUDGET_MS.get(name)
        beside = f"{ratios[name]:10.3f} x" if name in ratios else " " * 12
        lines.append(f"{name:46} {value:10.3f} {unit} {beside}" + (f"   (budget {budget:g} ms)" if budget else ""))
    lines.append(f"the fit is {ratio:.1f} times faster than scipy's least_squares from the same start")
    if options.history is not None:
        kept = {"date": time.strftime("%Y-%m-%dT%H:%M:%S"), "machine": machine(), "ms": results, "yardsticks": ratios}
        with options.history.open("a", encoding="utf-8") as file:
            file.write(json.dumps(kept) + "\n")
        lines.append(f"added to {options.history}")
    figures = results | {"times faster than scipy": ratio} | {f"{name}, yardsticks": x for name, x in ratios.items()}
    return Answer(figures, Document("How fast is the lab?", paragraphs(lines)))


if __name__ == "__main__":
    run_script("benchmark")
