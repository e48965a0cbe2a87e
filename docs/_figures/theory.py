"""Draw the figures of the theory pages while these are built: each function returns one."""

import matplotlib.pyplot as plt
import numpy as np
from drawing import BLUE, GREEN, INK, ORANGE, RED, WIDE, drawn, panels
from matplotlib.figure import Figure

import lab
from lab.extensions.cameras.geometry import projected


@drawn
def dh_frames() -> Figure:
    """Two axes in space, seen obliquely, with the four numbers between them."""
    figure = plt.figure(figsize=(WIDE, 4.2), layout="constrained")
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    d, a, alpha, theta = 1.2, 1.5, np.deg2rad(50), np.deg2rad(35)
    normal = np.array([np.cos(theta), np.sin(theta), 0.0])
    across = np.array([-np.sin(theta), np.cos(theta), 0.0])
    foot, corner = np.array([0, 0, d]), np.array([0, 0, d]) + a * normal
    second = np.cos(alpha) * np.array([0, 0, 1.0]) + np.sin(alpha) * across

    def line(start: np.ndarray, end: np.ndarray, colour: str, **how: object) -> None:
        axes.plot(*np.stack([start, end]).T, color=colour, **how)

    line(np.array([0, 0, -0.4]), np.array([0, 0, 2.2]), INK)
    line(corner - 0.9 * second, corner + 1.1 * second, INK)
    line(corner, corner + np.array([0, 0, 0.9]), INK, linewidth=1, linestyle=":")
    line(np.zeros(3), np.array([1.4, 0, 0]), INK, linewidth=1, linestyle=":")
    line(np.zeros(3), 1.4 * normal, INK, linewidth=1, linestyle=":")
    line(np.zeros(3), foot, BLUE, linewidth=4)
    line(foot, corner, ORANGE, linewidth=4)
    for first, last, at, radius, colour in (
        (np.array([1.0, 0, 0]), normal, np.zeros(3), 0.9, GREEN),
        (np.array([0, 0, 1.0]), second, corner, 0.7, RED),
    ):
        turn = np.linspace(0, np.arccos(first @ last), 30)[:, None]
        side = last - first * (first @ last)
        side /= np.linalg.norm(side)
        axes.plot(*(at + radius * (np.cos(turn) * first + np.sin(turn) * side)).T, color=colour, linewidth=2.5)
    for at, name, colour in (
        (np.array([-0.25, -0.1, 0.55]), "d", BLUE),
        (foot + 0.55 * a * normal + np.array([0, 0, 0.12]), "a", ORANGE),
        (np.array([0.95, 0.35, 0]), "θ", GREEN),
        (corner + np.array([0.0, 0.35, 0.72]), "α", RED),
        (np.array([0, 0, 2.3]), "axis of joint i", INK),
        (corner + 1.3 * second - np.array([0, 0.75, 0]), "axis of joint i + 1", INK),
    ):
        axes.text(*at, name, color=colour, fontsize=14 if len(name) == 1 else 12)
    axes.set_axis_off()
    axes.view_init(22, -12)
    axes.set_box_aspect((1.6, 1.5, 1.6), zoom=1.25)
    return figure


@drawn
def far_normal() -> Figure:
    """The D-H length of nearly parallel axes."""
    figure, (axes,) = panels()
    tilt = np.logspace(-8, -2, 100)
    axes.loglog(1e3 * tilt, 0.1 / np.tan(tilt), color=RED)
    axes.loglog(1e3 * tilt, 1e3 * tilt, color=BLUE)
    axes.text(3e-5, 4e4, "d, in mm", color=RED)
    axes.text(1e-3, 2e-5, "β, in mrad", color=BLUE)
    axes.set_xlabel("tilt of the second axis, mrad")
    axes.set_ylabel("value in the table")
    return figure


@drawn
def lever() -> Figure:
    """The velocity of a point about an axis."""
    figure, (axes,) = panels(height=3.6)
    axis, point = np.array([0.0, 0.0]), np.array([2.0, 1.0])
    radius = np.linalg.norm(point)
    turn = np.linspace(-0.3, 1.4, 60)
    axes.plot(radius * np.cos(turn), radius * np.sin(turn), color=INK, linewidth=1, linestyle=":")
    axes.annotate("", point, axis, arrowprops={"arrowstyle": "-|>", "color": ORANGE, "linewidth": 2.5})
    speed = np.array([-point[1], point[0]]) * 0.55
    axes.annotate("", point + speed, point, arrowprops={"arrowstyle": "-|>", "color": BLUE, "linewidth": 2.5})
    axes.plot(*axis, "o", color=INK, markersize=11)
    axes.plot(*axis, "o", color=INK, markersize=3)
    axes.text(-0.1, -0.32, "axis z, towards you, through o", ha="left")
    axes.text(1.0, 0.25, "lever p − o", color=ORANGE)
    axes.text(*(point + speed + np.array([0.1, 0.0])), "∂p/∂q = z × (p − o)", color=BLUE)
    axes.text(*(point + np.array([0.12, -0.12])), "p")
    axes.set_xlim(-0.6, 4.4)
    axes.set_ylim(-0.6, 2.5)
    axes.set_aspect("equal")
    axes.set_axis_off()
    return figure


@drawn
def singular_values() -> Figure:
    """What one, two and three targets show of an IRB 120."""
    figure, (axes,) = panels()
    robot = lab.load_robot("irb120")
    joints = np.random.default_rng(0).uniform(-1.5, 1.5, (200, 6))
    for count, colour in ((1, BLUE), (2, ORANGE), (3, GREEN)):
        targets = [f"p{i + 1}" for i in range(count)]
        columns = robot.parameter_jacobian(joints, targets=targets)
        columns = columns.reshape(-1, columns.shape[-1])
        values = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), compute_uv=False)
        axes.semilogy(np.arange(1, len(values) + 1), values, "o", color=colour, markersize=5)
        rank = int((values > 1e-8).sum())
        axes.text(rank + 1, 10.0 ** (-1.5 - 2.2 * count), f"{count} target{'s' * (count > 1)}: {rank}", color=colour)
    axes.set_xlabel("number of the singular value")
    axes.set_ylabel("singular value")
    axes.set_xlim(0, 46)
    return figure


@drawn
def noise_floor() -> Figure:
    """Errors of simulated calibrations against the number of poses."""
    figure, (axes,) = panels()
    rng, sigma = np.random.default_rng(0), 4.6e-6
    robot = lab.load_robot("irb120")
    free = list(robot.identifiability(targets=["p1"]).free)
    columns = robot.parameter_jacobian(rng.uniform(-1.5, 1.5, (2000, 6)), targets=["p1"])[:, 0][..., free]
    test, pool = columns[:500].reshape(-1, len(free)), columns[500:]
    counts = np.array([12, 15, 20, 30, 50, 100, 200, 400])
    found = []
    for count in counts:
        rows = [pool[rng.choice(len(pool), count, replace=False)].reshape(-1, len(free)) for _ in range(30)]
        errors = [test @ np.linalg.lstsq(row, sigma * rng.standard_normal(len(row)), rcond=None)[0] for row in rows]
        found.append([np.sqrt((error**2).sum() / 500) for error in errors])
    found = 1e6 * np.array(found)
    axes.fill_between(counts, *np.quantile(found, [0.1, 0.9], axis=1), color=BLUE, alpha=0.25, linewidth=0)
    axes.loglog(counts, np.median(found, axis=1), "o-", color=BLUE)
    axes.loglog(counts, 1e6 * sigma * np.sqrt(len(free) / counts), "--", color=ORANGE)
    axes.text(26, 9, "random poses, middle 80 %", color=BLUE)
    axes.text(15, 1.6, "floor σ √(p/n)", color=ORANGE)
    axes.set_xlabel("poses")
    axes.set_ylabel("RMS error at new poses, µm")
    axes.set_xticks(counts, [str(count) for count in counts], minor=False)
    axes.minorticks_off()
    axes.set_yticks([1, 2, 5, 10, 20, 50], ["1", "2", "5", "10", "20", "50"])
    return figure


@drawn
def ellipsoids() -> Figure:
    """Errors of two parameters with a good and with a poor plan."""
    figure, axes = panels(2, height=3.2)
    rng = np.random.default_rng(0)
    for panel, name, spread in ((axes[0], "poses all around", 180.0), (axes[1], "poses close together", 14.0)):
        angle = np.deg2rad(np.linspace(-spread, spread, 8, endpoint=False))
        bend = np.deg2rad(60 + 0.2 * np.linspace(-spread, spread, 8))
        columns = np.empty((8, 2, 2))
        columns[:, :, 0] = np.column_stack([np.cos(angle), np.sin(angle)])
        columns[:, :, 1] = np.column_stack([np.cos(angle + bend), np.sin(angle + bend)])
        if spread < 90:
            columns[:, :, 1] = 0.25 * columns[:, :, 1] + 0.75 * columns[:, :, 0]
        flat = columns.reshape(-1, 2)
        errors = np.stack([np.linalg.lstsq(flat, 5.0 * rng.standard_normal(16), rcond=None)[0] for _ in range(300)])
        panel.plot(*errors.T, ".", color=BLUE, alpha=0.4, markersize=5)
        _, s, vt = np.linalg.svd(flat, full_matrices=False)
        turn = np.linspace(0, 2 * np.pi, 100)
        ring = (np.sqrt(5.99) * 5.0 / s)[:, None] * np.stack([np.cos(turn), np.sin(turn)])
        panel.plot(*(vt.T @ ring), color=ORANGE)
        o1 = np.sqrt(np.prod(s)) / np.sqrt(8)
        panel.set_title(f"{name}\n$O_1$ = {o1:.2f}, $O_2$ = {s[-1] / s[0]:.2f}", fontsize=12)
        panel.set_xlim(-40, 40)
        panel.set_ylim(-40, 40)
        panel.set_aspect("equal")
        panel.set_xlabel("first length, µm")
    axes[0].set_ylabel("second length, µm")
    axes[1].set_yticklabels([])
    return figure


@drawn
def autocorrelation() -> Figure:
    """Independent and correlated readings."""
    figure, rows = plt.subplots(2, 2, figsize=(WIDE, 4.0), layout="constrained", width_ratios=(2, 1))
    rng = np.random.default_rng(3)
    white = rng.standard_normal(100)
    red = white.copy()
    for i in range(1, 100):
        red[i] = 0.8 * red[i - 1] + 0.6 * white[i]
    for (left, right), series, name, colour in zip(
        rows, (white, red), ("independent", "ρ = 0.8"), (BLUE, RED), strict=True
    ):
        left.plot(series, color=colour)
        left.set_title(name, loc="left", fontsize=12, color=colour)
        left.set_ylabel("error, σ")
        lags = np.arange(11)
        right.bar(lags, [np.corrcoef(series[: 100 - lag], series[lag:])[0, 1] for lag in lags], color=colour)
        right.set_ylim(-0.4, 1)
        right.set_ylabel("correlation")
    rows[1][0].set_xlabel("reading")
    rows[1][1].set_xlabel("lag")
    return figure


@drawn
def effect_shapes() -> Figure:
    """What effects do to one joint over its range."""
    figure, (axes,) = panels(height=3.8)
    q = np.linspace(-180, 180, 400)
    turn = np.deg2rad(q)
    curves = (
        ("compliance", -100 * np.cos(turn - 0.5), BLUE),
        ("harmonic k = 2", 45 * np.sin(2 * turn) + 130, ORANGE),
        ("ratio", 60 * turn / np.pi - 210, GREEN),
    )
    for name, curve, colour in curves:
        axes.plot(q, curve, color=colour)
        axes.text(184, curve[-1], name, color=colour, va="center")
    axes.plot(q[:200], np.full(200, 225.0), color=RED)
    axes.plot(q[200:], np.full(200, 265.0), color=RED)
    axes.annotate("", (100, 280), (20, 280), arrowprops={"arrowstyle": "->", "color": RED})
    axes.annotate("", (-100, 240), (-20, 240), arrowprops={"arrowstyle": "->", "color": RED})
    axes.text(184, 265, "backlash", color=RED, va="center")
    axes.set_xlabel("joint position, °")
    axes.set_ylabel("error of the joint, µrad (shifted)")
    axes.set_xlim(-180, 270)
    axes.set_xticks(range(-180, 181, 90))
    axes.set_yticks([])
    return figure


@drawn
def chi_square() -> Figure:
    """Sums of squares of right fits, and of a wrong model."""
    figure, (axes,) = panels()
    rng = np.random.default_rng(0)
    robot = lab.load_robot("irb120")
    free = list(robot.identifiability(targets=["p1"]).free)
    joints = rng.uniform(-1.5, 1.5, (60, 6))
    columns = robot.parameter_jacobian(joints, targets=["p1"])[:, 0][..., free].reshape(180, -1)
    basis = np.linalg.qr(columns)[0]
    noise = rng.standard_normal((400, 180))
    sums = ((noise - noise @ basis @ basis.T) ** 2).sum(axis=1)
    gears = robot.jacobian(joints, target="p1")[:, :3] @ (12e-6 * np.sin(3 * joints))[..., None] / 4.6e-6
    wrong = noise[0] + gears.ravel()
    wrong_sum = float(((wrong - basis @ (basis.T @ wrong)) ** 2).sum())
    dof = 180 - len(free)
    x = np.linspace(90, 260, 300)
    log_density = (dof / 2 - 1) * np.log(x) - x / 2
    density = np.exp(log_density - log_density.max())
    density /= np.sum(density) * (x[1] - x[0])
    axes.hist(sums, bins=25, density=True, color=BLUE, alpha=0.4)
    axes.plot(x, density, color=BLUE)
    axes.axvline(wrong_sum, color=RED)
    axes.text(wrong_sum + 3, 0.012, f"uneven\ngears: {wrong_sum:.0f}", color=RED)
    axes.text(172, 0.018, "right model", color=BLUE)
    axes.set_xlim(90, 275)
    axes.set_xlabel(f"sum of squares in units of σ² ({dof} degrees of freedom)")
    axes.set_yticks([])
    return figure


@drawn
def compensation_steps() -> Figure:
    """Newton's steps towards twenty targets."""
    figure, (axes,) = panels()
    rng = np.random.default_rng(2)
    robot = lab.load_robot("irb120")
    nominal = robot.parameter_values(targets=["p1"])
    real = nominal + 5e-4 * rng.standard_normal(len(nominal))
    for planned in rng.uniform(0.3, 1.2, (20, 6)) * rng.choice([-1, 1], (20, 6)):
        wanted, joints, left = robot.poses(planned, target="p1"), planned.copy(), []
        for _ in range(4):
            there = robot.poses(joints, real, target="p1")
            turn = wanted[:3, :3] @ there[:3, :3].T
            angle = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
            missed = np.concatenate([wanted[:3, 3] - there[:3, 3], angle])
            left.append(1e3 * np.linalg.norm(missed[:3]))
            joints = joints + np.linalg.solve(robot.jacobian(joints, target="p1"), missed)
        axes.semilogy(range(4), np.maximum(left, 1e-12), "o-", color=BLUE, alpha=0.5, linewidth=1)
    axes.set_xticks(range(4))
    axes.set_xlabel("Newton steps")
    axes.set_ylabel("position error, mm")
    return figure


@drawn
def assembly_modes() -> Figure:
    """A 2-RPR above and below its base line."""
    figure, (axes,) = panels(height=3.6)
    x, y = 0.7, 0.8
    for side, colour, name in ((1, BLUE, "one mode"), (-1, ORANGE, "the other")):
        axes.plot([0, x, 2], [0, side * y, 0], "o-", color=colour, markersize=8, linewidth=3)
        axes.text(x + 0.1, side * y, name, color=colour, va="center")
    axes.plot([-0.3, 2.3], [0, 0], color=INK, linewidth=1, linestyle=":")
    axes.text(0.2, 0.52, "ρ₁")
    axes.text(1.42, 0.45, "ρ₂")
    axes.text(1.0, -0.13, "L")
    axes.set_aspect("equal")
    axes.set_axis_off()
    return figure


@drawn
def beam() -> Figure:
    """A clamped beam and its replacement by springs."""
    figure, (axes,) = panels()
    x = np.linspace(0, 1, 200)
    axes.plot(x, -(3 * x**2 - x**3) / 2, color=INK, linewidth=3)
    for pieces, colour in ((1, RED), (2, ORANGE), (4, GREEN)):
        joints = (np.arange(pieces) + 0.5) / pieces
        corners = np.concatenate([[0.0], joints, [1.0]])
        slopes = np.concatenate([[0.0], np.cumsum(3 * (1 - joints) / pieces)])
        heights = -np.concatenate([[0.0], np.cumsum(slopes * np.diff(corners))])
        axes.plot(corners, heights, "o-", color=colour, markersize=4, linewidth=1.5)
        lift = 0.05 if pieces < 4 else 0.0
        axes.text(1.02, heights[-1] + lift, f"{pieces} spring{'s' * (pieces > 1)}", color=colour, va="center")
    axes.text(1.02, -1.07, "beam", va="center")
    axes.set_xlim(0, 1.2)
    axes.set_xlabel("along the beam")
    axes.set_ylabel("deflection")
    axes.set_xticks([0, 0.5, 1], ["0", "L/2", "L"])
    axes.set_yticks([0, -1], ["0", "FL³/3EI"])
    return figure


@drawn
def two_link_gravity() -> Figure:
    """Gravity torques of a two-link arm."""
    figure, (axes,) = panels()
    shoulder = np.linspace(-180, 180, 300)
    q1, q2 = np.deg2rad(shoulder), np.deg2rad(40)
    first, second = 9.81 * 1.2 * np.cos(q1), 9.81 * 0.5 * np.cos(q1 + q2)
    for curve, name, colour, width in (
        (first + second, "torque of the shoulder", INK, 2.5),
        (first, "part of m₁c₁ + m₂l₁", BLUE, 1.5),
        (second, "torque of the elbow: m₂c₂", ORANGE, 1.5),
    ):
        axes.plot(shoulder, curve, color=colour, linewidth=width)
        axes.text(184, curve[-1], name, color=colour, va="center")
    axes.set_xlim(-180, 360)
    axes.set_xticks(range(-180, 181, 90))
    axes.set_xlabel("shoulder, ° (elbow at 40°)")
    axes.set_ylabel("torque, Nm")
    return figure


@drawn
def camera_model() -> Figure:
    """A pinhole from the side, and a board's corners with and without distortion."""
    figure, (side, picture) = plt.subplots(2, 1, figsize=(WIDE, 6.2), layout="constrained", height_ratios=(2, 3))
    depth, focal, heights = 2.0, 0.7, np.linspace(-0.6, 0.6, 5)
    side.plot([depth, depth], [-0.75, 0.75], color=INK, linewidth=3)
    side.plot([-focal, -focal], [-0.45, 0.45], color=BLUE, linewidth=3)
    for height in heights:
        side.plot([depth, -focal], [height, -focal * height / depth], color=ORANGE, linewidth=1)
        side.plot(depth, height, "o", color=INK, markersize=5)
        side.plot(-focal, -focal * height / depth, "o", color=BLUE, markersize=4)
    side.plot(0, 0, "o", color=INK, markersize=7)
    side.annotate("", (-focal, 0.62), (0, 0.62), arrowprops={"arrowstyle": "<->", "color": INK})
    side.text(-focal / 2, 0.68, "f", ha="center")
    side.text(depth, 0.82, "board", ha="center")
    side.text(-focal, -0.68, "picture", ha="center", color=BLUE)
    side.text(0.05, -0.22, "pinhole", ha="center")
    side.set(xlim=(-1.1, 2.4), ylim=(-0.9, 1.0), aspect="equal")
    side.set_axis_off()
    lens = np.array([1200.0, 1200.0, 640.0, 480.0, -0.2, 0.0, 0.0, 0.0, 0.0])
    straight = lens.copy()
    straight[4:] = 0.0
    corners = np.array([[x, y, 1.0] for y in np.linspace(-0.4, 0.4, 6) for x in np.linspace(-0.53, 0.53, 9)])
    for intrinsics, colour, name, mark in ((straight, ORANGE, "pinhole", "x"), (lens, BLUE, "with k₁ = −0.2", "o")):
        places = projected(corners, intrinsics)[0].reshape(6, 9, 2)
        for line in (*places, *places.swapaxes(0, 1)):
            picture.plot(*line.T, color=colour, linewidth=0.8)
        picture.plot(*places.reshape(-1, 2).T, mark, color=colour, markersize=3.5, label=name)
    picture.legend(loc="upper center", bbox_to_anchor=(0.5, 1.22), ncols=2, fontsize=10, handletextpad=0.2)
    picture.set(xlim=(-20, 1300), ylim=(980, -20), aspect="equal", xlabel="u, px", ylabel="v, px")
    return figure


@drawn
def drawn_budget() -> Figure:
    """The length of an error: by formula, and drawn."""
    figure, (axes,) = panels()
    rng = np.random.default_rng(0)
    drawn_lengths = np.linalg.norm(np.array([5.0, 0, 0]) + 4.0 * rng.standard_normal((100_000, 3)), axis=1)
    axes.hist(drawn_lengths, bins=80, range=(-4, 22), density=True, color=BLUE, alpha=0.4)
    axes.axvline(0, color=INK, linewidth=1)
    low, high = np.quantile(drawn_lengths, [0.025, 0.975])
    for left, right, height, name, colour in (
        (low, high, -0.012, "drawn", BLUE),
        (5 - 1.96 * 4, 5 + 1.96 * 4, -0.03, "formula", ORANGE),
    ):
        axes.plot([left, right], [height, height], color=colour, linewidth=4)
        axes.text(right + 0.4, height, name, color=colour, va="center")
    axes.set_xlabel("length of the error, µm")
    axes.set_yticks([])
    axes.set_xlim(-4, 22)
    return figure
