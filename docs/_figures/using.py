"""Draw the figures of the how-to pages on identifying, using and watching while these are built."""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from drawing import BLUE, GREEN, INK, ORANGE, RED, WIDE, drawn, panels
from matplotlib.figure import Figure

import lab
from lab.certification.characteristics import conformity_of
from lab.robots.load_robot import load_virtual

_POINTS = """id,x_mm,y_mm,z_mm,vx_mm_per_s,vy_mm_per_s,vz_mm_per_s
P0,866.0254037844386,0,0,,,
P1,0,1000,500,0,0,200
P2,866.0254037844386,0,1000,,,
"""


@drawn
def noise_kinds() -> Figure:
    """What is left of the first coordinate over the poses, for four kinds of error."""
    figure, rows = plt.subplots(4, 1, figsize=(WIDE, 5.6), layout="constrained", sharex=True, sharey=True)
    rng, poses = np.random.default_rng(4), np.arange(1, 61)
    robot = lab.load_robot("irb120")
    turning = robot.jacobian(rng.uniform(-1.5, 1.5, (60, 6)), target="p1")[:, 0]
    white = 8.0 * rng.standard_normal((2, 60))
    scatter = 1e6 * (turning @ rng.normal(0, 5e-5, (6, 60))).diagonal()
    wander = np.zeros(60)
    for i in range(1, 60):
        wander[i] = 0.93 * wander[i - 1] + 11.0 * rng.standard_normal()
    kinds = (
        ("the instrument alone", white, BLUE),
        ("joints scatter: targets of a pose move together", scatter + white, ORANGE),
        ("errors last from pose to pose", wander + 0.5 * white, GREEN),
        ("the tripod was bumped after pose 40", np.where(poses > 40, 50.0, 0.0) + white, RED),
    )
    for axes, (name, errors, colour) in zip(rows, kinds, strict=True):
        axes.axhline(0, color=INK, linewidth=0.8)
        axes.plot(poses, errors[0], "o", color=colour, markersize=4)
        axes.plot(poses, errors[1], "x", color=colour, markersize=5)
        axes.set_title(name, loc="left", fontsize=12, color=colour)
    rows[0].set_ylim(-90, 90)
    rows[-1].set_xlabel("pose, in the order of the session")
    figure.supylabel("error of two targets, µm", fontsize=12)
    return figure


@drawn
def payload_torques() -> Figure:
    """The weight that joints bear along a motion of a TX 40, with a payload and without."""
    figure, (axes,) = panels(height=3.6)
    loads = lab.load_robot("tx40").loads
    turn = np.linspace(0, 2 * np.pi, 120)
    joints = np.zeros((120, 6))
    joints[:, 1], joints[:, 2], joints[:, 4] = 0.9 * np.sin(turn), 0.8 + 0.7 * np.cos(2 * turn), 0.6 * np.sin(3 * turn)
    for joint, colour in ((1, BLUE), (2, ORANGE)):
        empty, loaded = (-loads.forces(joints, np.full(120, kg))[0][:, joint] for kg in (0.0, 1.5))
        axes.plot(empty, "--", color=colour)
        axes.plot(loaded, color=colour)
        axes.fill_between(range(120), empty, loaded, color=colour, alpha=0.25, linewidth=0)
        axes.text(90, loaded[90] + 2, f"q{joint + 1}", color=colour, ha="center")
    axes.set_xlabel("pose (dashed: without the payload)")
    axes.set_ylabel("torque of the joint, Nm")
    axes.set_xticks([])
    return figure


@drawn
def torque_parts() -> Figure:
    """What the torque of one joint consists of along a motion."""
    figure, (axes,) = panels(height=3.8)
    time = np.linspace(0, 4, 300)
    angle = 0.9 * np.sin(2 * np.pi * time / 2) + 0.4 * np.sin(2 * np.pi * time / 1.3)
    speed, pull = (np.gradient(angle, time), np.gradient(np.gradient(angle, time), time))
    loads = load_virtual("course2r").loads
    joints = np.column_stack([np.zeros(300), angle])
    weight = -loads.forces(joints, np.zeros(300))[0][:, 1]
    parts = (
        ("gravity", weight, BLUE),
        ("acceleration", 2.53 * pull, ORANGE),
        ("friction", 2.93 * np.tanh(20 * speed) + 0.976 * speed, GREEN),
    )
    axes.plot(time, sum(part for _, part, _ in parts), color=INK, linewidth=3)
    for name, part, colour in parts:
        axes.plot(time, part, color=colour, label=name)
    axes.set_xlabel("time, s (thick: their sum, the torque of q2)")
    axes.set_ylabel("torque, Nm")
    figure.legend(loc="outside upper left", ncols=3, fontsize=11, handlelength=1.0, columnspacing=1.0)
    return figure


def _session(poses: int, seed: int) -> tuple[lab.Robot, np.ndarray, np.ndarray, np.ndarray]:
    """Return an IRB 120, a perturbed copy's values, joint positions and noise-free points of these."""
    robot, rng = lab.load_robot("irb120"), np.random.default_rng(seed)
    nominal = robot.parameter_values(targets=["p1"])
    real = nominal + 5e-4 * rng.standard_normal(len(nominal))
    joints = rng.uniform(-1.3, 1.3, (poses, 6))
    return robot, real, joints, robot.points(joints, real, targets=["p1"])


@drawn
def arrays_predicted() -> Figure:
    """Errors at new poses against what the estimate predicts of them."""
    figure, (axes,) = panels(height=3.6)
    robot, real, joints, points = _session(60, 7)
    noisy = points + 8e-6 * np.random.default_rng(1).standard_normal(points.shape)
    estimate = lab.identify(lab.measurements(joints, noisy, robot=robot), noise_mm=0.008, no_recording=True).estimate
    new = np.random.default_rng(2).uniform(-1.3, 1.3, (400, 6))
    there, really = (robot.points(new, values, targets=["p1"]) for values in (estimate.values, real))
    error = np.linalg.norm(there - really, axis=-1)
    spread = np.sqrt(np.trace(estimate.predicted_covariance(new)[:, 0], axis1=-2, axis2=-1))
    axes.plot(1e6 * spread, 1e6 * error[:, 0], "o", color=BLUE, alpha=0.5, markersize=4)
    ends = 1e6 * np.array([spread.min(), spread.max()])
    axes.plot(ends, ends, color=ORANGE)
    axes.text(ends[1], ends[1], " 1σ", color=ORANGE, va="center")
    axes.set_xlabel("predicted error of a new pose, µm")
    axes.set_ylabel("its true error, µm")
    axes.set_ylim(0, None)
    return figure


@drawn
def common_mistakes() -> Figure:
    """Points missed with nominal links, base and tool fitted, by files with one mistake each."""
    figure, (axes,) = panels(height=3.6)
    robot, _, joints, points = _session(40, 3)
    turned, swapped = joints.copy(), joints[:, [0, 2, 1, 3, 4, 5]]
    turned[:, 1] *= -1
    shifted = joints + np.deg2rad([0, 5, 0, 0, 0, 0])
    cases = (
        ("right file", joints, points, GREEN),
        ("one zero 5° off", shifted, points, ORANGE),
        ("points in inch", joints, points / 25.4, RED),
        ("joint 2 negated", turned, points, RED),
        ("joints 2, 3 exchanged", swapped, points, RED),
        ("rows shuffled", joints, points[::-1], RED),
    )
    free = [i for i, name in enumerate(robot.parameter_names(targets=["p1"])) if name.startswith(("base", "tool"))]
    for row, (_, inputs, measured, colour) in enumerate(cases):
        values = robot.parameter_values(targets=["p1"])
        for _ in range(60):
            found = robot.residuals(inputs, measured, values, targets=["p1"])
            slopes = found.jacobian[:, free]
            normal = slopes.T @ slopes
            values[free] -= np.linalg.solve(normal + 1e-3 * np.diag(normal.diagonal()), slopes.T @ found.values)
        left = found.values.reshape(-1, 3)
        missed = 1e3 * np.sqrt((left**2).sum() / len(left))
        axes.barh(row, missed, left=0.1, color=colour)
        axes.text(
            1.15 * (missed + 0.1),
            row,
            f"{missed:.2g} mm" if missed < 10 else f"{missed:.0f} mm",
            va="center",
            color=colour,
        )
    axes.set_xscale("log")
    axes.set_xlim(0.3, 3e3)
    axes.set_yticks(range(len(cases)), [case[0] for case in cases])
    axes.invert_yaxis()
    axes.set_xlabel("error left by base and tool, mm")
    return figure


@drawn
def compensated_targets() -> Figure:
    """Where an arm brings its tool on a square, with nominal and with corrected joint positions."""
    figure, (axes,) = panels(height=4.0)
    robot, rng = lab.load_robot("irb120"), np.random.default_rng(5)
    nominal = robot.parameter_values(targets=["p1"])
    real = nominal + 6e-4 * rng.standard_normal(len(nominal))
    estimate = real + 4e-6 * rng.standard_normal(len(nominal))
    corners = np.array([[0.28, -0.1], [0.38, -0.1], [0.48, -0.1], [0.48, 0.0], [0.48, 0.1], [0.38, 0.1], [0.28, 0.1]])
    corners = np.vstack([corners, [[0.28, 0.0]]])
    wanted = np.column_stack([corners, np.full(8, 0.35)])
    joints = np.tile([0.0, 0.2, 0.1, 0.1, 0.6, 0.1], (8, 1))

    def solved(values: np.ndarray, start: np.ndarray) -> np.ndarray:
        found = start.copy()
        for _ in range(60):
            missed = wanted - robot.points(found, values, targets=["p1"])[:, 0]
            slopes = robot.jacobian(found, values, target="p1")[:, :3]
            found += 0.5 * (np.linalg.pinv(slopes, rcond=1e-2) @ missed[:, :, None])[:, :, 0]
        return found

    planned = solved(nominal, joints)
    missed = robot.points(planned, real, targets=["p1"])[:, 0] - wanted
    left = robot.points(solved(estimate, planned), real, targets=["p1"])[:, 0] - wanted
    axes.plot(*(1e3 * np.vstack([corners, corners[:1]]).T), color=INK, linewidth=1)
    for errors, colour, name in ((missed, RED, "nominal"), (left, GREEN, "corrected")):
        there = 1e3 * (corners + 20 * errors[:, :2])
        for start, end in zip(1e3 * corners, there, strict=True):
            axes.plot(*np.stack([start, end]).T, color=colour, linewidth=1)
        axes.plot(
            *there.T, "o", color=colour, label=f"{name}: {1e3 * np.linalg.norm(errors, axis=1).mean():.2g} mm off"
        )
    axes.set_aspect("equal")
    axes.set_xlabel("x, mm (errors magnified 20 times)")
    axes.set_ylabel("y, mm")
    figure.legend(loc="outside upper left", ncols=2)
    return figure


@drawn
def program_numbers() -> Figure:
    """Two lines of a program before and after: the numbers of the targets alone change."""
    figure, (axes,) = panels(height=2.6)
    lines = (
        ("pPick", "[50.00,40.00,60.00]", "[52.20,41.31,61.41]", "2.92 mm"),
        ("pPlace", "[50.00,-80.00,60.00]", "[52.34,-79.60,61.40]", "2.76 mm"),
    )
    for row, (name, before, after, moved) in enumerate(lines):
        height = 0.95 - 0.5 * row
        axes.text(0.0, height, f"{name}:=", family="monospace", fontsize=13)
        axes.text(0.08, height - 0.15, before, family="monospace", fontsize=13, color=RED)
        axes.text(0.08, height - 0.28, after, family="monospace", fontsize=13, color=GREEN)
        axes.text(0.66, height - 0.21, f"moved by {moved}", fontsize=12)
    axes.set_xlim(0, 1)
    axes.set_ylim(0, 1.05)
    axes.set_axis_off()
    return figure


@drawn
def predicted_radius() -> Figure:
    """The predicted error over two joints, with the measured poses."""
    figure, (axes,) = panels(height=4.0)
    robot, rng = lab.load_robot("irb120"), np.random.default_rng(3)
    joints = rng.uniform(-0.7, 0.7, (30, 6))
    joints[:, 3:] = rng.uniform(-1.5, 1.5, (30, 3))
    second, third = np.meshgrid(np.linspace(-1.6, 1.6, 40), np.linspace(-1.6, 1.1, 40))
    asked = np.zeros((1600, 6))
    asked[:, 1], asked[:, 2], asked[:, 4] = second.ravel(), third.ravel(), 0.7
    covariance = robot.planned_covariance(joints, asked, sigma_m=8e-6)[:, 0]
    radius = 1e6 * 1.61 * np.sqrt(np.trace(covariance, axis1=-2, axis2=-1)).reshape(second.shape)
    degrees = np.rad2deg
    drawn_levels = axes.contour(
        degrees(second), degrees(third), radius, levels=[10, 15, 20, 30, 40], colors=BLUE, linewidths=1.5
    )
    axes.clabel(drawn_levels, fmt="%d µm", fontsize=11, colors=BLUE)
    axes.plot(degrees(joints[:, 1]), degrees(joints[:, 2]), "o", color=ORANGE, markersize=5)
    axes.text(-88, 50, "dots: measured poses", color=ORANGE)
    axes.set_xlabel("q2, °")
    axes.set_ylabel("q3, °")
    return figure


@drawn
def eight_solutions() -> Figure:
    """The solutions of one pose of an IRB 120, seen from the side."""
    figure, rows = plt.subplots(2, 2, figsize=(WIDE, 4.3), layout="constrained", sharex=True, sharey=True)
    found = lab.solve_kinematics("irb120", pose=(300, 80, 420, 180, 0, 0))
    robot, shapes = lab.load_robot("irb120"), {}
    for each in found.placements:
        words = {"+": "front", "-": "back"}[each.configuration["shoulder"]], each.configuration["elbow"]
        shapes.setdefault(words, []).append(each.joints)
    loads = robot.loads
    for axes, shape, colour in zip(rows.ravel(), sorted(shapes), (BLUE, ORANGE, GREEN, RED), strict=True):
        for joints, style in zip(shapes[shape], ("-", ":"), strict=True):
            anchors = loads.frames(joints[None]).anchors[0]
            line = np.vstack([[0, 0, 0], anchors[[0, 1, 2, 4]], found.placements[0].T_base_tool[:3, 3]])
            axes.plot(1e3 * line[:, 0], 1e3 * line[:, 2], style, marker="o", color=colour, linewidth=3, markersize=6)
        axes.set_title(f"{shape[0]}, elbow {shape[1]}".replace("-", "−"), fontsize=12, color=colour)
        axes.plot(300, 420, "x", color=INK, markersize=10)
        axes.set_aspect("equal")
        axes.set_xlim(-250, 600)
        axes.set_ylim(-20, 620)
    for axes in rows[:, 0]:
        axes.set_ylabel("z, mm")
    for axes in rows[1]:
        axes.set_xlabel("x, mm")
    return figure


@drawn
def two_joint_move() -> Figure:
    """The worked example: speeds of both joints, as shares of what limits them."""
    figure, rows = plt.subplots(2, 1, figsize=(WIDE, 4.2), layout="constrained", sharex=True)
    with tempfile.TemporaryDirectory() as folder:
        points = Path(folder) / "points.csv"
        points.write_text(_POINTS)
        columns = lab.trajectory(points, robot="course2r", no_recording=True).columns()
    for joint, colour in (("q1", BLUE), ("q2", ORANGE)):
        rows[0].plot(columns["time_s"], columns[f"{joint}_deg"], color=colour)
        rows[1].plot(columns["time_s"], columns[f"speed_{joint}_deg_per_s"], color=colour)
    rows[0].text(2.2, 74, "q1", color=BLUE)
    rows[0].text(5.0, 34, "q2", color=ORANGE)
    for axes in rows:
        axes.axvline(2.68328, color=INK, linewidth=1, linestyle=":")
    rows[0].text(2.75, -25, "P1 is passed at 2.68 s")
    rows[0].set_ylabel("position, °")
    rows[1].set_ylabel("speed, °/s")
    rows[1].set_xlabel("time, s")
    return figure


@drawn
def verified_errors() -> Figure:
    """Errors of twelve new poses over the predicted ones, of an arm as it was and of two that changed."""
    figure, (axes,) = panels(height=3.4)
    robot, real, joints, points = _session(12, 11)
    rng = np.random.default_rng(0)
    off = joints + np.array([0, 1e-4, 0, 0, 0, 0])
    cases = (
        ("unchanged", points, GREEN),
        ("zero of q2 off by 0.1 mrad", robot.points(off, real, targets=["p1"]), ORANGE),
        ("base moved by 0.1 mm", points + np.array([1e-4, 0, 0]), RED),
    )
    predicted = np.sqrt(3 * (8e-6**2 + 3e-6**2))
    for row, (name, now, colour) in enumerate(cases):
        errors = now - points + 8.5e-6 * rng.standard_normal(points.shape)
        ratio = np.linalg.norm(errors[:, 0], axis=1) / predicted
        axes.plot(ratio, np.full(12, row) + rng.uniform(-0.12, 0.12, 12), "o", color=colour)
        axes.text(0.05, row - 0.3, name, color=colour)
    axes.axvline(1, color=INK, linewidth=1, linestyle="--")
    axes.set_xlabel("error over the predicted error (dashed: as predicted)")
    axes.set_xlim(0, None)
    axes.set_ylim(2.5, -0.65)
    axes.set_yticks([])
    return figure


@drawn
def worn_joint() -> Figure:
    """A year of monthly checks of two arms, one with a zero that wears."""
    figure, (axes,) = panels(height=3.6)
    robot, real, joints, points = _session(10, 2)
    rng, months = np.random.default_rng(6), np.arange(1, 13)
    for name, wear, colour in (("A-17", 0.0, GREEN), ("A-18: joint 2 wears", 2e-5, RED)):
        errors = []
        for month in months:
            now = robot.points(joints + np.array([0, wear * month, 0, 0, 0, 0]), real, targets=["p1"])
            now = now + 8e-6 * rng.standard_normal(now.shape)
            errors.append(1e3 * np.linalg.norm(now - points, axis=-1).mean())
        axes.plot(months, errors, "o-", color=colour)
        axes.text(12.2, errors[-1], name.partition(":")[0], color=colour, va="center")
    axes.axhline(0.05, color=INK, linewidth=1, linestyle="--")
    axes.text(1, 0.052, "gate")
    axes.set_xlabel("month")
    axes.set_ylabel("mean error, mm")
    axes.set_xticks(months)
    axes.set_ylim(0, None)
    return figure


@drawn
def conformity() -> Figure:
    """Three errors with their uncertainty beside a tolerance."""
    figure, (axes,) = panels(height=2.9)
    tolerance = 0.1
    for row, (value, expanded) in enumerate(((0.04, 0.026), (0.09, 0.026), (0.15, 0.026))):
        stated = conformity_of(1e-3 * value, 1e-3 * tolerance, 1e-3 * expanded, "guard-band").decision
        colour = {"conforms": GREEN, "not decided": ORANGE, "does not conform": RED}[stated]
        axes.plot([value - expanded, value + expanded], [row, row], color=colour, linewidth=5, alpha=0.4)
        axes.plot(value, row, "o", color=colour, markersize=9)
        axes.text(value, row - 0.28, stated, color=colour, ha="center")
    axes.axvline(tolerance, color=INK, linestyle="--", linewidth=1.5)
    axes.text(tolerance, -0.75, " tolerance")
    axes.set_xlim(0, 0.2)
    axes.set_ylim(2.4, -0.9)
    axes.set_yticks([])
    axes.set_xlabel("mean error ± U, mm")
    return figure


@drawn
def draws_of_a_study() -> Figure:
    """Errors of single simulated calibrations, and their means with intervals over robots."""
    figure, (axes,) = panels(height=3.6)
    robot, rng = lab.load_robot("irb120"), np.random.default_rng(0)
    free = list(robot.identifiability(targets=["p1"]).free)
    columns = robot.parameter_jacobian(rng.uniform(-1.5, 1.5, (1500, 6)), targets=["p1"])[:, 0][..., free]
    test, pool = columns[:300].reshape(-1, len(free)), columns[300:]
    for place, count in enumerate((12, 20, 40)):
        robots = []
        for _ in range(10):
            rows = pool[rng.choice(len(pool), count, replace=False)].reshape(-1, len(free))
            noise = 4.6e-6 * rng.standard_normal((len(rows), 8))
            errors = (test @ np.linalg.lstsq(rows, noise, rcond=None)[0]).reshape(300, 3, 8)
            robots.append(1e6 * np.linalg.norm(errors, axis=1).mean(axis=0))
        draws = np.array(robots)
        axes.plot(place + rng.uniform(-0.25, 0.25, draws.size), draws.ravel(), ".", color=BLUE, alpha=0.5)
        means = draws.mean(axis=1)
        half = 2.26 * means.std(ddof=1) / np.sqrt(10)
        axes.errorbar(place, means.mean(), half, color=ORANGE, capsize=8, marker="o", linewidth=2.5)
    axes.set_yscale("log")
    axes.set_xticks(range(3), ["12 poses", "20 poses", "40 poses"])
    axes.set_yticks([3, 10, 30, 100], ["3", "10", "30", "100"])
    axes.minorticks_off()
    axes.set_ylabel("mean error, µm")
    return figure


@drawn
def own_weights() -> Figure:
    """The weight that two estimators give a reading, by its residual."""
    figure, (axes,) = panels(height=3.4)
    size = np.linspace(0, 8, 200)
    axes.plot(size, np.ones(200), color=BLUE)
    axes.plot(size, np.maximum(1 - (size / 5) ** 2, 0) ** 2, color=ORANGE)
    axes.text(8, 0.93, "least squares", color=BLUE, ha="right")
    axes.text(3.9, 0.35, "Tukey: an estimator\nof your own", color=ORANGE)
    axes.set_xlabel("residual of a pose, standard deviations")
    axes.set_ylabel("weight in the fit")
    axes.set_xlim(0, 8.05)
    axes.set_ylim(0, 1.05)
    return figure


@drawn
def effects_added() -> Figure:
    """The error at held-out poses as effects of an arm join the model."""
    figure, (axes,) = panels(height=2.8)
    robot, rng = lab.load_robot("irb120"), np.random.default_rng(1)
    free = list(robot.identifiability(targets=["p1"]).free)
    joints, payload = rng.uniform(-1.5, 1.5, (80, 6)), np.tile([0.0, 3.0], 40)
    torques, turning = robot.loads.forces(joints, payload)[0], robot.jacobian(joints, target="p1")[:, :3]
    waves = np.stack([np.sin(joints), np.cos(joints)], axis=-1)
    sags = np.einsum("nij,nj->nij", turning, torques)[:, :, 1:3]
    runout = np.einsum("nij,njw->nijw", turning, waves).reshape(80, 3, 12)
    errors = sags @ np.full(2, 1e-5) + runout @ (2e-4 * rng.standard_normal(12)) + 4.6e-6 * rng.standard_normal((80, 3))
    columns = [robot.parameter_jacobian(joints, targets=["p1"])[:, 0][..., free], sags, runout]
    for row, colour in enumerate((RED, ORANGE, GREEN)):
        model, missed = np.concatenate(columns[: row + 1], axis=-1), []
        for held in np.arange(80).reshape(8, 10):
            others = np.setdiff1d(np.arange(80), held)
            values = np.linalg.lstsq(model[others].reshape(-1, model.shape[-1]), errors[others].ravel(), rcond=1e-9)[0]
            missed.append(errors[held] - model[held] @ values)
        mean = 1e3 * np.linalg.norm(np.concatenate(missed), axis=-1).mean()
        axes.barh(row, mean, color=colour)
        axes.text(mean + 0.002, row, f"{mean:.2g} mm", va="center", color=colour)
    axes.set_yticks(range(3), ["geometry", "+ compliance", "+ harmonics"])
    axes.invert_yaxis()
    axes.set_xlim(0, 0.13)
    axes.set_xlabel("mean error at held-out poses, mm")
    return figure


@drawn
def carrier_volumes() -> Figure:
    """The workspaces of the five classical carriers."""
    figure, (axes,) = panels(height=3.0)
    found = lab.workspace(["carriers"], places=100, orientations=1).to_dict()["workspaces"]
    for row, each in enumerate(found):
        axes.barh(row, each["volume_m3"], color=BLUE)
        axes.text(each["volume_m3"] + 0.5, row, f"{each['volume_m3']:.4g} m³", va="center", color=BLUE)
    axes.set_yticks(range(5), [each["robot"].removeprefix("carrier-") for each in found])
    axes.invert_yaxis()
    axes.set_xlim(0, 43)
    axes.set_xlabel("volume that is reached, m³")
    return figure
