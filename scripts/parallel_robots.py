"""Parallel robots calibrated: how many parameters show, how well positions come out, and what six true rods change.

Virtual robots in MuJoCo, every dimension off by 0.5 mm and 1 mrad (gains by 1e-3), measured with 5 µm a coordinate.
Where a tracker may stand anywhere, its frame is fitted too: six numbers of the rank. In the plane it stands in that of
the robot, and x, y, rz are fitted; where the frame is known, so are the targets' places, and neither is counted. With n
poses of k targets, positions at the poses are off by sigma sqrt(rank / (k n)), the floor; at fresh ones by a little
more, which linear propagation of the noise predicts.
"""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from scipy.stats import quantile_test
from shared import FIGURE_STYLE, Answer, Document, Flag, paragraphs, run_script, save_figure

from lab.calibration.gauss_newton import fit
from lab.calibration.identify import Identification, IdentifyOptions, identify
from lab.calibration.observation import observation_of
from lab.calibration.prior import Tolerance
from lab.calibration.statistics.goodness_of_fit import goodness_of_fit
from lab.calibration.weights import Noise, weigh
from lab.campaign.model_files import models_folder
from lab.campaign.option_groups import Effects
from lab.campaign.options import VirtualCampaign
from lab.campaign.robot import load_robot
from lab.campaign.virtual_robot import perturbed_arm
from lab.core import se3
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.robotics.closed.recognition import ClassicalModel, classical_model_of
from lab.kinematics.closed.arm import ClosedArm
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.effects.arm import Arm
from lab.kinematics.gauge import STRUCTURE_POSES, named
from lab.kinematics.joints import JointSpec
from lab.noise.instruments import Instrument, instrument
from lab.render.style import BEFORE, REFERENCE, TICK
from lab.simulation.closed_robot import ClosedModel, TrueMechanism, true_mechanism
from lab.simulation.collisions import random_poses
from lab.simulation.tracking import track
from lab.simulation.true_robot import TrueRobot
from lab.studies import executors

POSES, FRESH = 50, 1000
DEVICE = Instrument("gaussian-5um", "gaussian", radial_m=5e-6)
OFFSETS, OFF_SIX = (0.5, 1.0), (0.1, 0.1)  # mm and mrad
LONGER_M = 1e-4  # one rod than its twin
ROUNDING = 1e-10  # of the largest singular value
SAME = 1e-9  # m and rad
SMALL, SIX = (str(models_folder() / "delta" / name) for name in ("small.toml", "six_rods.toml"))
THREE, EVERYWHERE, ANCHORS = ("p1", "p2", "p3"), ("base.*", "tool.*"), ("A2.y", "A3.x", "A3.y")
EVERY = 8  # robots of which every parameter is fitted
Row = dict[str, Any]
robot_of = cache(load_robot)


@dataclass(frozen=True)
class Case:
    """A robot, what is measured of it, and what of it is held or freed; places of targets are not counted if held."""

    robot: str
    targets: tuple[str, ...] = ("p1",)
    groups: tuple[str, ...] = ()
    tracker: Literal["anywhere", "in the plane", "known"] = "anywhere"
    fix: tuple[str, ...] = ("tool.*",)
    free: tuple[str, ...] = ()


CASES = {
    "2-RPR at P, in the plane": Case("rpr2", ("p1",), ("gear",), "in the plane", ("base.z", "base.r[xy]", "tool.*")),
    "2-RPR at P": Case("rpr2", groups=("gear",)),
    "3-RPR pose, frame known": Case("rpr3", THREE, (), "known", EVERYWHERE, ANCHORS),
    "3-RPR pose": Case("rpr3", THREE, fix=()),
    "3-RPR point p1, frame known": Case("rpr3", ("p1",), (), "known", EVERYWHERE, ANCHORS),
    "3-RPR point p1": Case("rpr3"),
    "3-RRR pose": Case("rrr3", THREE, fix=()),
    "3-PRR pose": Case("prr3", THREE, fix=()),
    "Hexapod pose": Case("hexapod", THREE, fix=()),
    "Delta": Case("delta"),
    "Delta of 800 mm": Case(SMALL),
    "IRB 120": Case("irb120", fix=()),
}
NOISELESS = ("2-RPR at P", "3-RPR point p1", "3-RRR pose", "3-PRR pose", "Hexapod pose", "Delta", "Delta of 800 mm")


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    robots: int = 24
    """Virtual robots of each kind."""
    readings: int = 10_000
    """Random ones at which drawings are assembled."""
    seed: int = 0
    """Of the first robot; the others follow."""
    out: Path = Path("runs/parallel-robots")
    """Folder of the figures and the picture."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Bench:
    """A virtual robot, poses to measure, and fresh ones with where its targets are there (m)."""

    real: TrueRobot
    targets: tuple[str, ...]
    joints: Array
    fresh: Array
    points: Array

    @classmethod
    def of(cls, real: TrueRobot, targets: tuple[str, ...], seed: int) -> "Bench":
        """Poses by their seed."""
        joints = random_poses(real.robot, POSES, rng_for(seed, "poses"))
        fresh = random_poses(real.robot, FRESH, rng_for(seed, "fresh"))
        return cls(real, targets, joints, fresh, real.points(fresh, targets))

    def identified(
        self, model: Arm, request: IdentifyOptions, device: Instrument, seed: int
    ) -> tuple[Identification, Row]:
        """With this model of the robot, and how good that is."""
        data = track(self.real, self.joints, self.targets, device, rng_for(seed, "noise"))
        found = identify(model, data, model.nominal(self.real.robot.tool), Noise(device), request)
        seen, known = weigh(observation_of(model), data, Noise(device))
        judged = goodness_of_fit(model, seen, found.fit, sigma_given=known, extra_residuals=found.extra_residuals)
        row = {"converged": found.status == "converged", "inadequate": judged.outcome == "failed"}
        return found, {**row, **self.errors(model, found.values)}

    def errors(self, model: Arm, values: Array) -> Row:
        """On validation poses, in µm, and at how many of these the model refuses to answer."""
        off = 1e6 * np.linalg.norm(model.points(self.fresh, values) - self.points, axis=2)
        return {
            "fresh_um": rms(off),
            "worst_um": float(np.nanmax(off)),
            "refused": int(np.isnan(off).any(axis=1).sum()),
        }


def rms(values: Array) -> float:
    """NaN are left out."""
    return float(np.sqrt(np.nanmean(values**2)))


def drawn_real(robot: str, seed: int, off: tuple[float, float], gear_ppm: float = 0.0) -> TrueRobot:
    """A virtual robot of this seed before its tracker."""
    effects = Effects(gear_ppm=gear_ppm)
    asked = VirtualCampaign(robot, seed=seed, position_sigma_mm=off[0], rotation_sigma_mrad=off[1], effects=effects)
    return perturbed_arm(robot_of(robot), asked)


def one_robot(name: str, seed: int, noiseless: bool = False) -> Row:
    """A case of the table."""
    case, device = CASES[name], instrument("exact") if noiseless else DEVICE
    robot, real = robot_of(case.robot), drawn_real(case.robot, seed, OFFSETS, 1e3 if case.groups else 0.0)
    if case.tracker != "anywhere":
        assert isinstance(real, TrueMechanism)
        x, y, turn = rng_for(seed, "tracker").uniform(-1, 1, 3) * (case.tracker == "in the plane")
        moved = se3.pose(se3.exp(np.array([0.0, 0.0, turn])), np.array([x, y, 0.0]))
        real = true_mechanism(real.robot, real.values, real.robot.T_world_frame0 @ moved).with_effects(real.effects)
    bench, model = Bench.of(real, case.targets, seed), robot.arm_with(case.targets, case.groups)
    found, row = bench.identified(model, IdentifyOptions(case.fix, case.free), device, seed)
    before = found.nominal_aligned if case.tracker != "known" else model.nominal(robot.tool)
    rates = model.observe(bench.fresh, found.values)[1][..., list(found.fit.free)]
    foreseen = np.einsum("...f,fg,...g->...", rates, found.covariance, rates).sum(axis=2)
    parameters = len(model.names) - len(named(model.names, "fix", case.fix))
    row |= {"parameters": parameters, "rank": found.fit.rank, "condition": found.fit.condition}
    row |= {"before_mm": bench.errors(model, before)["fresh_um"] / 1e3, "predicted_um": 1e6 * rms(np.sqrt(foreseen))}
    floor = 1e6 * DEVICE.radial_m * float(np.sqrt(found.fit.rank / (POSES * len(case.targets))))
    return row | {"floor_um": floor, "ratio": row["fresh_um"] / floor}


def six_rods(seed: int, every: bool = True) -> Row:
    """One Delta whose six rods are all off: its rank and fits of it, of every parameter only if asked."""
    robot, real = robot_of(SIX), drawn_real(SIX, seed, OFF_SIX)
    assert isinstance(real, TrueMechanism)
    bench, arm = Bench.of(real, ("p1",), seed), robot.arm(("p1",))
    nominal = arm.nominal(robot.tool)
    sizes = {}
    for kind, values in (("drawn", nominal), ("copy", np.concatenate([nominal[:6], real.values[6:], nominal[-3:]]))):
        rates = arm.observe(arm.structure_joints(STRUCTURE_POSES, rng_for(0, "structure")), values)[1]
        flat = rates.reshape(-1, len(values))
        sizes[kind] = np.linalg.svd(flat / np.linalg.norm(flat, axis=0), compute_uv=False)
    row: Row = {f"rank_{kind}": int((s > ROUNDING * s[0]).sum()) for kind, s in sizes.items()}
    row |= {"least_drawn": float(sizes["drawn"][row["rank_drawn"] - 1]), "rank": row["rank_drawn"]}
    row |= {"least_copy": float(sizes["copy"][row["rank_copy"] - 1]), "next_copy": float(sizes["copy"][row["rank"]])}
    tolerance = Tolerance(OFF_SIX[0] / 1e3, OFF_SIX[1] / 1e3)
    plain, row["plain"] = bench.identified(arm, IdentifyOptions(), DEVICE, seed)
    row["prior"] = bench.identified(arm, IdentifyOptions(tolerance=tolerance), DEVICE, seed)[1]
    row["exact"] = bench.identified(arm, IdentifyOptions(), instrument("exact"), seed)[1]
    if every:  # takes 12 s
        data = track(real, bench.joints, ("p1",), DEVICE, rng_for(seed, "noise"))
        seen = weigh(observation_of(arm), data, Noise(DEVICE))[0]
        done = fit(arm, seen, range(len(nominal)), plain.nominal_aligned)
        row["every"] = {"converged": done.status == "converged", **bench.errors(arm, done.values)}
    row["three rods"] = bench.identified(robot_of("delta").arm(("p1",)), IdentifyOptions(), DEVICE, seed)[1]
    return row


def longer_rod() -> Row:
    """A drawn Delta with one rod longer than its twin: how the platform tilts, and what three rods say of it."""
    robot, place = robot_of(SIX), robot_of(SIX).model.T_world_tracker
    assert isinstance(robot.chain, Mechanism) and isinstance(robot.model, ClosedModel)
    values = robot.chain.nominal_values + LONGER_M * (np.array(robot.chain.names) == "rod1a.length")
    bench = Bench.of(true_mechanism(robot.model, values, place), ("p1",), 0)
    Ts = ClosedArm(robot.chain).tool(bench.fresh, np.concatenate([values, np.zeros(3)]))[0]
    tilt = 1e3 * np.linalg.norm(se3.log(Ts[:, :3, :3]), axis=1)
    row = bench.identified(robot_of("delta").arm(("p1",)), IdentifyOptions(), instrument("exact"), 0)[1]
    return row | {"tilt_mrad": float(tilt.mean()), "worst_mrad": float(tilt.max())}


def course_of(robot: str) -> tuple[Mechanism, ClassicalModel]:
    """A robot's mechanism with its closed form."""
    chain = robot_of(robot).chain
    assert isinstance(chain, Mechanism)
    course = classical_model_of(chain)
    assert course is not None
    return chain, course


def assembled(robot: str, readings: int, seed: int) -> Row:
    """A drawing at readings anywhere within the limits: its mode against the closed form's, and what is refused."""
    chain, course = course_of(robot)
    joints = JointSpec.random_joints(chain, readings, rng_for(seed, "poses"))
    found, modes = chain.assembled(joints, chain.nominal_values), course.modes(joints)
    at_home = course.side(
        chain.home[None], chain.assembled(chain.home[None], chain.nominal_values).configuration.passive.T
    )
    ours = np.stack([course.side(joints, mode) == at_home for mode in modes.swapaxes(0, 1)], axis=1)  # (n, m)
    near = np.abs(modes - found.configuration.passive.T[:, None]).max(axis=2) < SAME
    closes, fits = ours.any(axis=1), found.fits
    row = {"readings": fits | True, "close": closes, "answered": fits, "right": (near & ours).any(axis=1) & fits}
    row |= {"the first mode": near[:, 0] & fits, "refused": closes & ~fits}
    return {name: int(rows.sum()) for name, rows in row.items()}


SINGULAR, ROBOT = BEFORE, TICK
PIXELS, LINES = 301, (0.1, 0.2, 0.4, 0.6, 0.8)  # of the picture
Range = tuple[float, float]
FITS = {
    "plain": "rank of the drawing",
    "prior": "the same, with a prior of tolerances",
    "every": f"every parameter, of {EVERY} robots at most",
    "three rods": "a model of three rods",
    "exact": "rank of the drawing, no noise",
}


def picture() -> Figure:
    """How far from singular each drawing is, over its plane or a section of its space."""
    panels: tuple[tuple[str, str, Range, Range, Range, Callable[[Any, Any], list[Any]]], ...] = (
        ("2-RPR", "rpr2", (-300, 900), (-150, 800), (300, 500), lambda x, y: [x, y]),
        ("3-RPR at φ = 0°", "rpr3", (-500, 500), (-480, 560), (0, 0), lambda x, y: [x, y, 0 * x]),
        ("3-RPR at φ = −45°", "rpr3", (-500, 500), (-480, 560), (0, 0), lambda x, y: [x, y, 0 * x - np.pi / 4]),
        ("Delta, section y = 0", "delta", (-1150, 1150), (-1800, 100), (300, -1200), lambda x, y: [x, 0 * x, y]),
    )
    with matplotlib.rc_context({**FIGURE_STYLE, "axes.grid": False}):
        figure = Figure(figsize=(11, 10), layout="constrained")
        for axes, (title, robot, across, up, stands, place) in zip(figure.subplots(2, 2).flat, panels, strict=True):
            chain, course = course_of(robot)
            x, y = np.meshgrid(np.linspace(*across, PIXELS), np.linspace(*up, PIXELS))
            passive = np.stack(place(x.ravel() / 1e3, y.ravel() / 1e3), axis=1)
            joints = course.inverse_solutions(passive)[:, 0]
            away = course.distances(joints, passive)
            far = (np.min(away, axis=0) if robot == "delta" else away.parallel).reshape(x.shape)
            side = course.side(joints, passive).reshape(x.shape)
            within = ((joints >= chain.lower) & (joints <= chain.upper)).all(axis=1).reshape(x.shape)
            shown = axes.pcolormesh(x, y, far, vmin=0, vmax=1, rasterized=True)
            axes.contourf(x, y, within, [-0.5, 0.5], colors="white", alpha=0.65)
            axes.contour(x, y, within, [0.5], colors=REFERENCE, linewidths=2)
            lines = axes.contour(x, y, np.where(within, far, np.nan), LINES, colors="white", linewidths=0.8)
            axes.clabel(lines, fontsize=9)
            axes.contour(x, y, side, [0], colors=SINGULAR, linewidths=3)
            at = course.inverse_solutions(np.array([place(*(np.array(stands) / 1e3))]))[:, 0]
            for leg in ClosedArm(chain).legs(at, ClosedArm(chain).nominal()):
                axes.plot(*1e3 * leg[0, :, [0, 2] if robot == "delta" else [0, 1]], "o-", color=ROBOT, markersize=4)
            axes.set(
                aspect="equal", xlim=across, ylim=up, xlabel="x, mm", ylabel=f"{'z' if robot == 'delta' else 'y'}, mm"
            )
            axes.set_title(f"{title}: {far[within].min():.2f} or more within limits")
        figure.colorbar(shown, ax=figure.axes, label="distance from a singularity: 0 singular, 1 best", shrink=0.7)
        figure.suptitle(
            "Within limits (black) the 2-RPR and the Delta stay clear of singularities; the 3-RPR, turned, does not\n"
            "red: parallel singularities; faded: beyond the joints' limits; of the Delta the worst of three distances"
        )
    return figure


def middle(rows: Sequence[Row], key: str) -> list[float]:
    """The median over robots, and an interval that holds it with 95 % or more, whatever the distribution."""
    known = np.array([row[key] for row in rows], dtype=float)
    ends = quantile_test(known).confidence_interval(0.95)
    return [float(np.median(known)), float(ends.low), float(ends.high)]


def said(rows: Sequence[Row]) -> str:
    """Errors on validation poses over robots, in µm, how many fits converged, and how many were found not adequate."""
    size, worst = "{:.2f} ({:.2f} to {:.2f})".format(*middle(rows, "fresh_um")), max(row["worst_um"] for row in rows)
    text = f"{size:22} {max(row['fresh_um'] for row in rows):6.2f} {worst:6.0f}  "
    shares = [f"{np.mean([row[key] for row in rows]):4.0%}" for key in ("converged", "inadequate") if key in rows[0]]
    return text + " ".join(shares)


def report(found: Row) -> list[str]:
    """The tables, line by line."""
    head = "fresh µm rms: median, worst robot, worst pose; fits converged; found not adequate"
    lines = [f"parameters -> rank, condition; before, mm; floor, µm; fresh over floor; predicted, µm; {head}"]
    shown = {"parameters": ".0f", "rank": ".0f", "condition": "4.0f", "before_mm": ".2f", "floor_um": ".2f"}
    for name, rows in found["table"].items():
        cells = [f"{middle(rows, key)[0]:{form}}" for key, form in shown.items()]
        ratio = "{:.2f} ({:.2f} to {:.2f})".format(*middle(rows, "ratio"))
        size = f"{cells[0]} -> {'  '.join(cells[1:])}  {ratio}  {middle(rows, 'predicted_um')[0]:.2f}"
        lines.append(f"{name:28}{size}   {said(rows)}")
    six, rod = found["six rods"], found["longer rod"]
    ranks = ", ".join(str(rank) for rank in sorted({row["rank_copy"] for row in six}))
    sizes = [f"{middle(six, key)[0]:.1e}" for key in ("least_drawn", "next_copy", "least_copy")]
    lines.append(
        f"Delta with six rods, off by 0.1 mm and 0.1 mrad: rank {six[0]['rank_drawn']} as drawn, {ranks} of imperfect "
        f"copies; the last singular value drawn is {sizes[0]}, in copies the next {sizes[1]} and the last {sizes[2]}"
    )
    lines += [f"  {words:38}{said([row[key] for row in six if key in row])}" for key, words in FITS.items()]
    tilts = f"tilts the platform by {rod['tilt_mrad']:.2f} mrad, {rod['worst_mrad']:.2f} at most"
    left = f"three rods leave {rod['fresh_um']:.1f} µm rms, {rod['worst_um']:.0f} at most"
    lines.append(f"one rod {1e3 * LONGER_M:g} mm longer than its twin, no noise: {tilts}; {left}")
    lines += [
        f"no noise, {name}: {worst:.1e} m on validation poses at most" for name, worst in found["exact_m"].items()
    ]
    for name, row in found["modes"].items():
        lines.append(f"modes of {name} drawn: {', '.join(f'{key} {count}' for key, count in row.items())}")
    return lines


def answer(options: Options) -> Answer:
    """Simulate and draw.

    Raises:
        LabError: fewer than two robots.
    """
    began = time.perf_counter()
    if options.robots < 2:
        raise LabError("give two --robots or more: a median with its interval is asked for")
    seeds = range(options.seed, options.seed + options.robots)
    with executors.local_executor() as pool:
        waiting = {name: [pool.submit(one_robot, name, seed) for seed in seeds] for name in CASES}
        six = [pool.submit(six_rods, seed, i < EVERY) for i, seed in enumerate(seeds)]
        exact = {name: [pool.submit(one_robot, name, seed, True) for seed in seeds[:5]] for name in NOISELESS}
        found: Row = {
            "longer rod": longer_rod(),
            "modes": {name: assembled(name, options.readings, options.seed) for name in ("rpr2", "rpr3", "delta")},
            "table": {name: [each.result() for each in futures] for name, futures in waiting.items()},
            "six rods": [each.result() for each in six],
            "exact_m": {name: max(each.result()["worst_um"] for each in f) / 1e6 for name, f in exact.items()},
        }
    options.out.mkdir(parents=True, exist_ok=True)
    save_figure(options.out, "singularities", picture())
    found["seconds"] = time.perf_counter() - began
    (options.out / "parallel_robots.json").write_text(json.dumps(found), encoding="utf-8")
    lines = [*report(found), f"{found['seconds']:.0f} s; figures and picture: {options.out}"]
    return Answer(found, Document("Parallel robots calibrated", paragraphs(lines)))


if __name__ == "__main__":
    run_script("parallel_robots")
