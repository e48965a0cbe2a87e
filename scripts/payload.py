"""Which method identifies a payload best? Torques along a path and a wrist sensor, both on a virtual TX 40 with 1.5 kg.

Differences of torques with and without the load along a D-optimal Fourier path, a wrist sensor at 20 D-optimal static
poses, and the sensor along the path: what is predicted, what scatters, whether the 95 % intervals hold, and what the
uncertainty costs where joints give way. Then what biases each, what cures it, and whether the adequacy test notices.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from shared import SERIES, Answer, Document, Flag, paragraphs, run_script, save_figure, write_rows

from lab.campaign.robot import load_virtual
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.dynamics.load_files import Mounting, PayloadSamples
from lab.extensions.dynamics.payload.estimate import LoadEstimate
from lab.extensions.dynamics.payload.excitation import (
    CHECKED,
    RATE_HZ,
    SECONDS,
    FourierPath,
    Limits,
    PredictedUncertainty,
    design_path,
    design_poses,
    predicted,
    random_path,
)
from lab.extensions.dynamics.payload.methods import from_torques, from_wrench
from lab.extensions.dynamics.simulation import CarryingArm, LoadBench, RigidLoad, RunErrors, peak_torques
from lab.kinematics.dynamics.rigid_body import (
    elements,
    hand_motion,
    inertia_about_centre,
    sag_uncertainty,
    torque_regressor,
    wrench_regressor,
)
from lab.pose_selection.exchange import information
from lab.render.style import AXIS, GRID, REFERENCE
from lab.render.terminal import bars
from lab.simulation.collisions import collides, random_poses

LOAD = RigidLoad(1.5, np.array([0.010, -0.005, 0.060]), np.diag([22.5e-4, 26e-4, 12.5e-4]))
MOUNTING = Mounting.tilted(np.zeros(2), sign=-1.0)
OFFSET = (1.0, -2.0, 0.5, 0.02, -0.01, 0.03)
NOISE = RunErrors(1e-6, torque_noise=0.005, force_noise_n=0.05, moment_noise_nm=0.002, wrench_offset=OFFSET)
POSES, COSTED = 20, 200  # static poses measured, and those over which a cost is averaged
STIFFNESS = (1e5, 2e4)  # Nm/rad, of every joint
METHODS = (TORQUES, RESTING, MOVING) = ("torques, path", "sensor, 20 poses", "sensor, path")
RANDOM = "torques, random path"
QUANTITIES = ("mass", "x", "y", "z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")  # centre, and inertia about it
UNITS = ("%", *("mm",) * 3, *("kg cm2",) * 6)
SCALE = np.array([100 / LOAD.mass_kg, *(1e3,) * 3, *(1e4,) * 6])
TRUTH = np.array([LOAD.mass_kg, *LOAD.centre_m, *elements(LOAD.inertia_kgm2)])
SENSOR = np.repeat([NOISE.force_noise_n, NOISE.moment_noise_nm], 3)
Row = dict[str, Any]
Run = list[LoadEstimate]  # by one method
# 1 deg, along no axis: the rows of an axis that stays right would be believed, and the rest discounted.
TILT, TURN = (np.deg2rad(1) / np.sqrt(2),) * 2, (np.deg2rad(1) / np.sqrt(3),) * 3
BIASES: tuple[tuple[str, dict[str, Any], dict[str, str]], ...] = (  # what is wrong, and its cure by method
    ("torques 1 ms late", {"lag_s": 1e-3}, {TORQUES: "delay"}),
    ("friction of 5 %", {"load_friction": 0.05}, {TORQUES: "friction", RANDOM: "friction"}),
    ("base tilted by 1°", {"tilt_rad": TILT}, {TORQUES: "gravity told", RESTING: "tilt", MOVING: "tilt"}),
    ("sensor turned by 1°", {"turn_rad": TURN}, {RESTING: "turn", MOVING: "turn"}),
)
ROBOT = load_virtual("tx40")
MODEL = ROBOT.serial_model
ARM = ROBOT.serial_arm(("p1",))
VALUES = ARM.nominal(ROBOT.tool)
PEAK = peak_torques(MODEL)
DIFFERENCE = np.sqrt(2) * NOISE.torque_noise * PEAK


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    runs: int = 40
    """Virtual measurements by each method, and with each bias."""
    starts: int = 2
    """Random paths from which the designed path is sought."""
    seed: int = 0
    """Of everything random."""
    out: Path = Path("runs/payload")
    """Folder of the tables and the picture."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Plan:
    """The path (for ``SECONDS`` at ``RATE_HZ``), one by chance, and the static poses ``(n, J)``."""

    path: FourierPath
    random: FourierPath
    poses: Array


def by_torques(joints: Array, speeds: Array, accelerations: Array) -> Array:
    """What the joints' torques show of the load, ``(n, J, 10)``."""
    return torque_regressor(ARM, VALUES, joints, speeds, accelerations, MOUNTING.gravity)


def by_sensor(joints: Array, speeds: Array, accelerations: Array) -> Array:
    """What the wrench shows of the load and of six offsets, ``(n, 6, 16)``."""
    shown = wrench_regressor(hand_motion(ARM, VALUES, joints, speeds, accelerations), MOUNTING.gravity)
    return np.concatenate([shown, np.broadcast_to(np.eye(6), (len(shown), 6, 6))], axis=2)


def by_resting_sensor(joints: Array, speeds: Array, accelerations: Array) -> Array:
    """The same at rest, where the inertia does not show: ``(n, 6, 10)``."""
    return np.delete(by_sensor(joints, speeds, accelerations), np.arange(4, 10), axis=2)


def planned(options: Options) -> Plan:
    """The torques' D-optimal path and one by chance, the sensor's D-optimal poses, within limits with the load.

    Raises:
        LabError: fewer than two runs.
    """
    if options.runs < 2:
        raise LabError("give two --runs or more: a scatter is asked for")
    limits, strain = Limits.of(MODEL.chain, torque=PEAK), CarryingArm(MODEL, MOUNTING.gravity, LOAD).torques
    ours, theirs = rng_for(options.seed, "design"), rng_for(options.seed, "candidates")

    def touches_nothing(joints: Array) -> NDArray[np.bool_]:
        return ~collides(MODEL, joints)

    with bars() as shown:
        best = design_path(
            by_torques, DIFFERENCE, limits, touches_nothing, ours, torque=strain, starts=options.starts,
            progress=lambda done, of: shown("D-optimal path", done, of),
        )  # fmt: skip
    poses = design_poses(by_resting_sensor, SENSOR, POSES, limits, touches_nothing, theirs, torque=strain)
    while True:
        chance = random_path(limits, theirs)
        motion = chance.at(np.linspace(0, chance.period_s, CHECKED))
        if touches_nothing(motion[0]).all() and (np.abs(strain(*motion)) <= PEAK).all():
            return Plan(best.path, chance, poses.joints)


def foreseen(plan: Plan) -> dict[str, Array]:
    """Covariance of phi ``(10, 10)`` by method; NaN where a method does not show it."""
    covariance, still = np.full((10, 10), np.nan), 0 * plan.poses
    resting = PredictedUncertainty.of(information(by_resting_sensor(plan.poses, still, still) / SENSOR[:, None]))
    covariance[:4, :4] = resting.covariance[:4, :4]
    torques, moving = predicted(plan.path, by_torques, DIFFERENCE), predicted(plan.path, by_sensor, SENSOR)
    return {TORQUES: torques.covariance, RESTING: covariance, MOVING: moving.covariance[:10, :10]}


def quantities(phi: Array) -> Array:
    """Mass, centre, and inertia about it, ``(10,)`` in SI, of phi ``(10,)``."""
    return np.array([phi[0], *(phi[1:4] / phi[0]), *elements(inertia_about_centre(phi))])


def propagated(covariance: Array) -> Array:
    """Standard deviations ``(10,)`` of the quantities from the covariance of phi, to first order; in their units."""
    steps = 1e-6 * np.eye(10)  # kg, kg m, kg m^2: the quantities are smooth
    slopes = np.stack([(quantities(LOAD.phi + h) - quantities(LOAD.phi - h)) / 2e-6 for h in steps], axis=1)
    first, whole = slopes[:4, :4] @ covariance[:4, :4] @ slopes[:4, :4].T, slopes @ covariance @ slopes.T
    return SCALE * np.sqrt(np.append(np.diag(first), np.diag(whole)[4:]))


def errors_of(estimates: Run) -> Array:
    """Of the quantities ``(runs, 10)``, in their units."""
    return np.array([SCALE * (quantities(e.phi) - TRUTH) for e in estimates])


def measured(plan: Plan, errors: RunErrors, method: str, cures: Sequence[str], runs: int, *seed: int) -> list[Run]:
    """So many virtual measurements, each evaluated with every cure; "" is none."""
    bench = LoadBench(MODEL, LOAD, MOUNTING, errors)
    kept: list[Run] = [[] for _ in cures]
    for run in range(runs):
        rng, path = rng_for(seed[0], "noise", *seed[1:], run), plan.random if method == RANDOM else plan.path
        resting = method == RESTING
        records = bench.resting(plan.poses, rng) if resting else bench.moving(path.at, SECONDS, RATE_HZ, rng)
        for estimates, cure in zip(kept, cures, strict=True):
            estimates.append(estimated(method, records, cure))
    return kept


def estimated(method: str, records: PayloadSamples, cure: str) -> LoadEstimate:
    """By one method; the sensor from the loaded run alone. A tilt is not fitted to torques: it is to be told."""
    if method in (TORQUES, RANDOM):
        gravity = (Mounting.tilted(np.array(TILT)) if cure == "gravity told" else MOUNTING).gravity
        return from_torques(ARM, VALUES, records, gravity, delay=cure == "delay", friction=cure == "friction")
    return from_wrench(ARM, VALUES, records.run(True), MOUNTING, tilt=cure == "tilt", turn=cure == "turn")


def cost_um(covariance: Array, stiffness: float) -> float:
    """RMS over random poses of how far a corrected point is off, by a covariance ``(4, 4)`` of mass and moment."""
    joints, compliance = (
        random_poses(MODEL, COSTED, rng_for(0, "fresh")),
        np.full(MODEL.chain.size, 1 / stiffness),
    )
    off = sag_uncertainty(ARM, VALUES, compliance, joints, MOUNTING.gravity, covariance)
    return float(1e6 * np.sqrt((off**2).mean()))


def precision(found: dict[str, Run], covariances: dict[str, Array]) -> list[Row]:
    """A row for each method and quantity; for the cost in µm at each stiffness too."""
    rows = []
    for method, estimates in found.items():
        covariance, errors = covariances[method], errors_of(estimates)
        spoilt = np.cov(np.array([e.phi[:4] for e in estimates]).T)
        widths = [[e.mass_half_width_kg, *e.com_half_width, *elements(e.inertia_com_half_width)] for e in estimates]
        fired = float(np.mean([e.adequate is False for e in estimates]))
        covered = (np.abs(errors) <= SCALE * widths).mean(axis=0).tolist()
        for i in range(10 if np.isfinite(covariance).all() else 4):
            row: Row = {"method": method, "quantity": QUANTITIES[i], "unit": UNITS[i]}
            row |= {"predicted": float(propagated(covariance)[i]), "scatter": float(errors[:, i].std(ddof=1))}
            rows.append(row | {"mean_error": float(errors[:, i].mean()), "covered": covered[i], "fired": fired})
        for k in STIFFNESS:
            row = {"method": method, "quantity": f"cost at {k:g} Nm/rad", "unit": "um"}
            rows.append(row | {"predicted": cost_um(covariance[:4, :4], k), "scatter": cost_um(spoilt, k)})
    return rows


def biased(plan: Plan, noise: RunErrors, runs: int, seed: int) -> list[Row]:
    """A row for each bias and method: means over runs without the cure, and with it (``_cured``)."""
    rows = []
    ways = [(what, wrong, *way) for what, wrong, by in BIASES for way in by.items()]
    for i, (what, wrong, method, cure) in enumerate(ways):
        row: Row = {"what": what, "method": method, "cure": cure}
        both = measured(plan, replace(noise, **wrong), method, ("", cure), runs, seed, 1 + i)
        for end, estimates in zip(("", "_cured"), both, strict=True):
            errors, off = errors_of(estimates), np.mean([e.phi[:4] for e in estimates], axis=0) - LOAD.phi[:4]
            mean, spread = errors.mean(axis=0), errors.std(axis=0) / np.sqrt(max(1, runs - 1))
            row |= {f"{name}{end}": float(mean[k]) for k, name in enumerate(("mass_percent", "x_mm", "y_mm", "z_mm"))}
            row |= {f"centre_mm{end}": float(np.linalg.norm(mean[1:4])), f"mass_error{end}": float(spread[0])}
            row |= {f"centre_error{end}": float(np.linalg.norm(spread[1:4]))}
            row |= {f"cost_um{end}": cost_um(np.outer(off, off), STIFFNESS[0])}
            row |= {f"fired{end}": float(np.mean([e.adequate is False for e in estimates]))}
        rows.append(row)
    return rows


def write_motion(folder: Path, plan: Plan) -> None:
    """The designed path, at 1 kHz, and the poses, to be run on an arm."""
    times = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    joints = [f"{name}_rad" for name in MODEL.chain.joint_names]
    for name, header, table in (
        ("path", ["time_s", *joints], np.column_stack([times, plan.path.at(times)[0]])),
        ("poses", joints, plan.poses),
    ):
        np.savetxt(folder / f"{name}.csv", table, "%.9g", ",", header=",".join(header), comments="")


FLOOR = 1e-3  # % and mm: smaller biases are drawn there
COLOURS = dict(zip((TORQUES, RESTING, MOVING, RANDOM), (SERIES[i][0] for i in (1, 2, 3, 4)), strict=True))


def picture(found: dict[str, Run], rows: Sequence[Row], biases: Sequence[Row]) -> Figure:
    """Left: errors of the mass, run by run. Right: biases of mass and centre without and with their cure."""
    figure = Figure(figsize=(14, 5.8), layout="constrained")
    left, *right = figure.subplots(1, 3, width_ratios=[1.25, 1, 1])
    ticks, style = [], {"fmt": "_", "capsize": 8, "linewidth": 2}
    for i, (method, estimates) in enumerate(found.items()):
        row, errors = next(row for row in rows if row["method"] == method), errors_of(estimates)[:, 0]
        left.plot(i + np.linspace(0.15, 0.35, len(errors)), errors, "o", color=COLOURS[method], alpha=0.6)
        left.errorbar(i - 0.2, 0, row["predicted"], color=REFERENCE, **style)
        left.errorbar(i, row["mean_error"], row["scatter"], color=COLOURS[method], **style)
        ticks.append(f"{method}\npredicted {row['predicted']:.2g} %\nscatter {row['scatter']:.2g} %")
    left.grid(color=GRID)
    left.set_xticks(range(len(found)), ticks)
    left.set(xlim=(-0.5, 2.5), ylabel="error of the mass, %", title="1.5 kg weighed: predicted ±1 σ (black), found")
    names = ("mass", "mass_percent", "mass, % (dotted: 0.3)"), ("centre", "centre_mm", "centre of mass, mm")
    for axes, (error, name, words) in zip(right, names, strict=True):
        for y, row in enumerate(biases):
            ends, colour = [max(FLOOR, abs(row[f"{name}{end}"])) for end in ("", "_cured")], COLOURS[row["method"]]
            axes.plot(ends, [y, y], "-", color=AXIS, linewidth=1)
            for end, x, fill in zip(("", "_cured"), ends, ("full", "none"), strict=True):
                bar = [[0], [2 * row[f"{error}_error{end}"]]]
                axes.errorbar(x, y, xerr=bar, fmt="o", color=colour, fillstyle=fill, markersize=9)
        axes.set(xscale="log", xlabel=f"size of the mean error of the {words}", ylim=(len(biases) - 0.5, -0.5))
        axes.set_yticks(range(len(biases)), [f"{row['what']}\n{row['method']}" for row in biases])
        axes.grid(color=GRID)
        axes.set_xticks([FLOOR, 0.01, 0.1, 1], [f"≤ {FLOOR:g}", "0.01", "0.1", "1"])
    right[1].tick_params(labelleft=False)
    right[0].axvline(0.3, color=REFERENCE, linestyle=":")
    right[0].set_title("filled: unnoticed; hollow: cured")
    right[1].set_title("bars: up to 2 standard errors more")
    return figure


def report(rows: Sequence[Row], biases: Sequence[Row]) -> list[str]:
    """The tables, line by line."""
    lines = [
        f"{'':48}{'predicted 1 σ':>13}{'scatter':>10}{'mean error':>12}  95 % intervals cover; adequacy test fires"
    ]
    for row in rows:
        line = f"{row['method']:18}{row['quantity']:23}{row['unit']:7}{row['predicted']:13.3g}{row['scatter']:10.3g}"
        ends = f"{row['mean_error']:12.2g}  {row['covered']:.0%}; {row['fired']:.0%}" if "covered" in row else ""
        lines.append(line + ends)
    lines.append(f"mean errors of mass and centre, µm at {STIFFNESS[0]:g} Nm/rad, test fires: without -> with the cure")
    shown = (("mass_percent", ".3f", "%"), ("centre_mm", ".3f", "mm"), ("cost_um", ".3f", "µm"), ("fired", ".0%", ""))
    for row in biases:
        cells = [f"{row[name]:{form}} -> {row[name + '_cured']:{form}} {unit}" for name, form, unit in shown]
        lines.append("  ".join([f"{row['what']:20}{row['method']:22}{row['cure']:13}", *cells]))
    return lines


def answer(options: Options) -> Answer:
    """Plan, measure, identify, and draw."""
    began, plan = time.perf_counter(), planned(options)
    found = {way: measured(plan, NOISE, way, ("",), options.runs, options.seed, 0)[0] for way in METHODS}
    rows, biases = precision(found, foreseen(plan)), biased(plan, NOISE, options.runs, options.seed)
    options.out.mkdir(parents=True, exist_ok=True)
    save_figure(options.out, "payload", picture(found, rows, biases))
    write_motion(options.out, plan)
    for name, table in (("payload", rows), ("payload_biases", biases)):
        write_rows(options.out / f"{name}.csv", table)
    seconds = time.perf_counter() - began
    condition, by_chance = (predicted(path, by_torques, DIFFERENCE).condition for path in (plan.path, plan.random))
    lines = [
        *report(rows, biases),
        f"condition number of the torques' information: D-optimal path {condition:.3g}, random path {by_chance:.3g}",
        f"{seconds:.0f} s; tables and picture: {options.out}",
    ]
    values = {"rows": rows, "biases": biases, "seconds": seconds}
    return Answer(values, Document("How is a payload identified best?", paragraphs(lines)))


if __name__ == "__main__":
    run_script("payload")
