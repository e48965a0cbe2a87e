"""Draw the figures of the how-to pages on preparing and measuring while these are built."""

import re
import tempfile
from pathlib import Path

import numpy as np
from drawing import BLUE, GREEN, INK, ORANGE, RED, drawn, panels
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

import lab
from lab.extensions.cameras.geometry import projected
from lab.extensions.cameras.rig import PX, read_rig
from lab.formats.joint_log import read_joint_log
from lab.formats.loose_table import JointColumns
from lab.library.log_matching import settled_windows
from lab.robots.load_robot import load_virtual
from lab.simulation.candidate_poses import field_of_view
from lab.simulation.collisions import collides

PAGES = Path(__file__).parents[1] / "how_to"


def block(page: str, holds: str) -> str:
    """Return the TOML block of a page that holds a text."""
    text = (PAGES / f"{page}.md").read_text(encoding="utf-8")
    return next(each for each in re.findall(r"^```toml\n(.*?)^```$", text, re.DOTALL | re.MULTILINE) if holds in each)


def from_side(points: np.ndarray, turn_deg: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return what is right and what is up in a view along y, after a turn about z."""
    turn = np.deg2rad(turn_deg)
    return np.cos(turn) * points[..., 0] + np.sin(turn) * points[..., 1], points[..., 2]


def bare(axes: Axes) -> None:
    """Leave the lines alone, to scale."""
    axes.set_aspect("equal")
    axes.set_axis_off()


@drawn
def last_frame() -> Figure:
    """The frames of a UR5e that its description gives, and the point that is measured."""
    figure, (axes,) = panels(height=4.0)
    robot = lab.load_robot("ur5e")
    arm = robot.arm(("p1",))
    joints = np.deg2rad([[180.0, -120.0, 100.0, -80.0, -90.0, 60.0]])
    line = arm.skeleton(joints, arm.nominal(robot.tool)).lines[0][0]
    axes.plot(*from_side(line, 20), color=INK, linewidth=6, solid_joinstyle="round", alpha=0.35)
    pose, point = robot.poses(joints[0]), robot.points(joints[0])[0]
    last = point - pose[:3, :3] @ robot.tool["p1"]
    for at, rotation in ((line[0], np.eye(3)), (last, pose[:3, :3])):
        for axis, colour in zip(rotation.T, (RED, GREEN, BLUE), strict=True):
            axes.plot(*from_side(np.stack([at, at + 0.14 * axis]), 20), color=colour, linewidth=3)
    axes.plot(*from_side(point, 20), "o", color=ORANGE, markersize=13)
    for at, text, colour, shift in (
        (line[0], "frame 0", INK, (-60, -2)),
        (last, "last frame: tool0,\nflange, or --tip", INK, (14, 24)),
        (point, "p1: the measured point", ORANGE, (-70, -26)),
    ):
        axes.annotate(text, from_side(at, 20), xytext=shift, textcoords="offset points", color=colour)
    axes.margins(0.22, 0.16)
    bare(axes)
    return figure


@drawn
def driven_legs() -> Figure:
    """A 3-RPR from above, with the lengths that are driven and the joints that follow."""
    figure, (axes,) = panels(height=3.8)
    robot = lab.load_robot("rpr3")
    arm = robot.arm(tuple(robot.tool))
    joints = robot.chain.home[None] + np.array([[-0.06, 0.03, 0.05]])
    rods = arm.skeleton(joints, arm.nominal(robot.tool)).rods[0, :, :, :2]
    platform = np.vstack([rods[:, 1], rods[:1, 1]])
    axes.fill(*platform.T, color=INK, alpha=0.2)
    for rod in rods:
        axes.plot(*rod.T, color=BLUE, linewidth=5)
        axes.plot(*rod.T, "o", color=INK, markerfacecolor="none", markersize=14)
    for end, name, shift in ((rods[0], "ρ₁", (-2, 12)), (rods[1], "ρ₂", (-8, 14)), (rods[2], "ρ₃", (10, 0))):
        axes.annotate(name, end.mean(axis=0), shift, textcoords="offset points", color=BLUE, fontsize=14)
    axes.annotate(
        "driven: measured by\nits encoder", rods[2].mean(axis=0), (40, 10), textcoords="offset points", color=BLUE
    )
    axes.annotate("passive: solved\nby the lab", rods[2, 0], (-112, -12), textcoords="offset points")
    axes.margins(0.12)
    bare(axes)
    return figure


@drawn
def two_tips() -> Figure:
    """A torso of two arms from the front, each joint in the colour of the tips that show it."""
    figure, (axes,) = panels(height=3.6)
    robot = lab.load_robot("torso")
    arm = robot.arm(("left.p1", "right.p1"))
    joints = np.deg2rad([[0.0, 90, 10, 10, 0, 60, 0, -90, 10, 10, 0, 60, 0]])
    skeleton = arm.skeleton(joints, arm.nominal(robot.tool))
    ends = [from_side(line[0], 90) for line in skeleton.lines]
    for (right, up), colour, name in zip(ends, (BLUE, ORANGE), ("left", "right"), strict=True):
        axes.plot(right, up, "o-", color=colour, linewidth=4, markersize=7)
        axes.annotate(
            f"{name}.p1", (right[-1], up[-1]), (0, -22), textcoords="offset points", color=colour, ha="center"
        )
    shared = [a for a, b in zip(*(np.stack(each, axis=1) for each in ends), strict=False) if np.allclose(a, b)]
    axes.plot(*np.transpose(shared), "o-", color=INK, linewidth=6, markersize=9)
    axes.annotate("waist: both arms share it", shared[0], (14, 4), textcoords="offset points")
    axes.margins(0.16, 0.14)
    bare(axes)
    return figure


@drawn
def cell_from_above() -> Figure:
    """The cell of its page, with places of the reflector that are free, collide, or are out of sight."""
    figure, (axes,) = panels(height=4.4)
    text = block("cell", "[[obstacle]]")
    with tempfile.TemporaryDirectory() as folder:
        (file := Path(folder) / "cell.toml").write_text(text, encoding="utf-8")
        robot = load_virtual("irb120", file)
    joints = robot.chain.random_joints(400, np.random.default_rng(0))
    touches = collides(robot.model, joints)
    seen = field_of_view(robot.model, ("p1",), lab.instrument("leica-at960"))(joints)
    place = robot.cell.robot
    turn = np.deg2rad(place.rotation_deg[2])
    Rz = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    points = 1e3 * robot.points(joints)[:, 0, :2] @ Rz.T + np.array(place.position_mm[:2])
    for chosen, colour, name in (
        (touches, RED, "too near to something"),
        (~touches & ~seen, ORANGE, "free, but out of sight"),
        (~touches & seen, GREEN, "can be measured"),
    ):
        axes.plot(*points[chosen].T, ".", color=colour, markersize=6, label=f"{name}: {np.mean(chosen):.0%}")
    for each in robot.cell.obstacle:
        width, depth, _ = each.size_mm
        corner = np.array(each.position_mm[:2]) - np.array([width, depth]) / 2
        axes.add_patch(Rectangle(corner, width, depth, fill=False, edgecolor=INK, linewidth=2))
        axes.text(corner[0] + width + 40, corner[1] + 0.8 * depth, each.name)
    axes.add_patch(Circle(place.position_mm[:2], 90, color=INK))
    head = robot.cell.instrument_places[0].position_mm[:2]
    away = np.array(head) / np.linalg.norm(head)
    axes.annotate("", 1350 * away, 1000 * away, arrowprops={"arrowstyle": "-|>", "color": BLUE, "linewidth": 2.5})
    axes.text(*(960 * away), f"to the tracker, {np.linalg.norm(head) / 1e3:.1f} m", color=BLUE, va="top")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.02), fontsize=12, handletextpad=0.2)
    axes.set_xlim(-900, 1100)
    axes.set_ylim(-800, 1250)
    bare(axes)
    return figure


@drawn
def condition_by_target() -> Figure:
    """The condition number of an IRB 120 against the distance of its targets from axis 6."""
    figure, (axes,) = panels(height=3.4)
    robot = lab.load_robot("irb120")
    joints = robot.chain.random_joints(200, np.random.default_rng(0))
    distances = np.geomspace(0.5, 100, 12)
    for count, colour, name in ((1, BLUE, "one target"), (2, ORANGE, "with a second one")):
        targets = ("p1", "p2")[:count]
        found = []
        for distance in distances / 1e3:
            tool = {"p1": np.array([distance, 0, 0.1]), "p2": np.array([-0.05, 0, 0.1])}
            arm = robot.arm(targets)
            values = arm.nominal({each: tool[each] for each in targets})
            columns = arm.observe(joints, values)[1].reshape(-1, len(values))
            free = list(robot.identifiability(targets=targets).free)
            columns = columns[:, free] / np.linalg.norm(columns[:, free], axis=0)
            found.append(np.linalg.cond(columns))
        axes.loglog(distances, found, "o-", color=colour, markersize=4)
        axes.annotate(
            name, (distances[4], found[4]), (4, 10 if count == 1 else -18), textcoords="offset points", color=colour
        )
    axes.set_xlabel("distance of p1 from axis 6, mm")
    axes.set_ylabel("condition number")
    axes.set_xticks([1, 10, 100], ["1", "10", "100"])
    axes.set_yticks([10, 100, 1000], ["10", "100", "1000"])
    axes.minorticks_off()
    return figure


@drawn
def accuracy_by_poses() -> Figure:
    """The predicted error and O1 against the number of poses, random ones of an IRB 120."""
    figure, (axes,) = panels(height=3.4)
    robot, rng = lab.load_robot("irb120"), np.random.default_rng(0)
    pool, test = robot.chain.random_joints(400, rng), robot.chain.random_joints(100, rng)
    counts = (12, 15, 20, 26, 35, 50, 70, 100)
    errors, information = np.zeros((2, 6, len(counts)))
    for draw in range(6):
        for i, count in enumerate(counts):
            chosen = pool[rng.choice(len(pool), count, replace=False)]
            spread = robot.planned_covariance(chosen, test, sigma_m=4.6e-6, targets=("p1",))
            errors[draw, i] = 1e6 * np.sqrt(np.trace(spread, axis1=-2, axis2=-1).mean())
            information[draw, i] = robot.criteria(chosen, scaling="unit", targets=("p1",))["o1"]
    error, o1 = np.median(errors, axis=0), np.median(information, axis=0)
    axes.plot(counts, error, "o-", color=BLUE, markersize=4)
    axes.text(55, error[5] + 1, "predicted error", color=BLUE)
    axes.set_ylim(0, None)
    axes.set_xlabel("poses")
    axes.set_ylabel("error, µm", color=BLUE)
    other = axes.twinx()
    other.plot(counts, o1 / o1[-1], "o-", color=ORANGE, markersize=4)
    other.text(55, 1.02, "O1", color=ORANGE)
    other.set_ylim(0, 1.15)
    other.set_yticks([])
    return figure


@drawn
def rests_of_a_log() -> Figure:
    """A controller's log of two joints, the rests that an import finds, and the times of a tracker's points."""
    figure, (axes,) = panels(height=3.4)
    robot = lab.load_robot("irb120")
    times = np.arange(0, 20, 0.05)
    stops = np.array([[0, 0], [35, -20], [-25, 15], [10, 40]], dtype=float)
    phase = np.clip((times % 5 - 3) / 2, 0, 1)
    share = (phase**2 * (3 - 2 * phase))[:, None]
    stop = np.minimum((times // 5).astype(int), 3)
    moved = (1 - share) * stops[stop] + share * stops[np.minimum(stop + 1, 3)]
    rows = [f"{t:.3f},{a:.4f},{b:.4f},0,0,30,0" for t, (a, b) in zip(times, moved, strict=True)]
    with tempfile.TemporaryDirectory() as folder:
        (file := Path(folder) / "log.csv").write_text("time (s),q1,q2,q3,q4,q5,q6\n" + "\n".join(rows))
        log = read_joint_log(file, robot.chain.joint_names, robot.chain.prismatic, JointColumns(), "deg")
    windows = settled_windows(log, robot.chain.prismatic, 0.1, 0.5)
    for start, end in zip(windows.starts, windows.ends, strict=True):
        axes.axvspan(start, end, color=GREEN, alpha=0.2, linewidth=0)
    for joint, colour in ((0, BLUE), (1, ORANGE)):
        axes.plot(log.seconds, np.rad2deg(log.joints[:, joint]), color=colour)
        axes.text(20.2, np.rad2deg(log.joints[-1, joint]), f"q{joint + 1}", color=colour, va="center")
    measured = np.array([1.6, 6.4, 9.1, 11.9, 17.2])
    still = np.array([bool(((windows.starts <= t) & (t <= windows.ends)).any()) for t in measured])
    for chosen, colour, name in ((still, INK, "point of its rest"), (~still, RED, "left out: the arm moved")):
        axes.plot(measured[chosen], np.full(chosen.sum(), -32.0), "^", color=colour, markersize=10, label=name)
    axes.legend(loc="upper left", bbox_to_anchor=(0, 1.22), ncols=2, fontsize=12, handletextpad=0.1, columnspacing=1)
    axes.set_xlim(0, 22)
    axes.set_ylim(-38, 45)
    axes.set_xlabel("time, s (green: the arm stands still)")
    axes.set_ylabel("joints, °")
    return figure


def arm_line(robot: lab.Robot, joints: np.ndarray) -> np.ndarray:
    """Return the corners ``(c, 3)`` m of an arm's links."""
    arm = robot.arm(("p1",))
    return arm.skeleton(joints[None], arm.nominal(robot.tool)).lines[0][0]


def touching(robot: lab.Robot, point: np.ndarray, count: int) -> np.ndarray:
    """Return joint positions ``(n, joints)`` rad of ``count`` starts that put p1 on a point within the limits."""
    joints = robot.chain.random_joints(count, np.random.default_rng(0))
    for _ in range(15):
        left = point - robot.points(joints)[:, 0]
        joints = joints + (np.linalg.pinv(robot.jacobian(joints)[:, :3]) @ left[..., None])[..., 0]
    beyond = robot.chain.beyond_limits(joints, 0.0).reshape(count, -1).any(axis=1)
    return joints[(np.linalg.norm(left, axis=1) < 1e-9) & ~beyond]


@drawn
def touched_cube() -> Figure:
    """An IRB 120 that touches three faces of a cube with a ball, from the side."""
    figure, (axes,) = panels(height=3.9)
    robot = lab.load_robot("irb120")
    edge, radius, middle = 0.12, 0.012, np.array([0.4, 0.0, 0.06])
    axes.add_patch(Rectangle(middle[[0, 2]] - edge / 2, edge, edge, facecolor=INK, alpha=0.2))
    along = np.linspace(0, 1, 12)[:, None, None]
    for normal, shift, colour in (((-1, 0, 0), 0.03, BLUE), ((0, 0, 1), 0.0, ORANGE), ((1, 0, 0), 0.03, GREEN)):
        ball = middle + (edge / 2 + radius) * np.array(normal, dtype=float) + np.array([0, 0, shift])
        for joints in touching(robot, ball, 300):
            line = np.vstack([arm_line(robot, joints), ball])
            places = ((1 - along) * line[:-1] + along * line[1:]).reshape(-1, 3)
            off = np.abs(places - middle)[:, [0, 2]].max(axis=1)
            if off.min() > edge / 2 and places[:, 2].min() >= 0 and np.abs(line[:, 1]).max() < 0.12:
                break
        else:
            raise AssertionError("no configuration touches this face: move the cube")
        axes.plot(*from_side(line[:-1]), color=colour, linewidth=4, solid_joinstyle="round", alpha=0.85)
        axes.plot(*from_side(line[-2:]), color=colour, linewidth=2)
        axes.add_patch(Circle(ball[[0, 2]], radius, color=colour))
    axes.text(*middle[[0, 2]], "edge", ha="center", va="center")
    axes.axhline(0, color=INK, linewidth=1)
    axes.margins(0.1, 0.05)
    bare(axes)
    return figure


@drawn
def one_socket() -> Figure:
    """The four configurations of the daily check's file, from the side."""
    figure, (axes,) = panels(height=3.9)
    robot = lab.load_robot("irb120")
    text = (PAGES / "daily_check.md").read_text(encoding="utf-8")
    rows = re.findall(r"^2026-03-02,(.+)$", text, re.MULTILINE)
    for row, colour in zip(rows, (BLUE, ORANGE, GREEN, RED), strict=True):
        joints = np.deg2rad([float(each) for each in row.split(",")])
        line, ball = arm_line(robot, joints), robot.points(joints)[0]
        axes.plot(*from_side(line, 0), "-", color=colour, linewidth=4, solid_joinstyle="round", alpha=0.85)
        axes.plot(*from_side(np.stack([line[-1], ball])), color=colour, linewidth=2)
    axes.plot(*from_side(ball), "o", color=INK, markersize=13)
    axes.annotate("ball in its socket", from_side(ball), (14, -16), textcoords="offset points")
    axes.axhline(0, color=INK, linewidth=1)
    axes.margins(0.12, 0.08)
    bare(axes)
    return figure


@drawn
def ranks_by_kind() -> Figure:
    """What each kind of measurement identifies of an arm, as the program of the page on artefacts prints it."""
    figure, (axes,) = panels(height=4.4)
    text = (PAGES.parent / "reference" / "artefacts.md").read_text(encoding="utf-8")
    printed = re.search(r"^ +rank  of them .*\n((?:.+\n)+)```$", text, re.MULTILINE)
    for row, line in enumerate(printed[1].splitlines()):
        kind, own, size = line[:32].strip(), int(line[37:61]), line[61:].strip()
        colour = BLUE if size == "identified" else RED
        axes.barh(-row, own, color=colour, alpha=0.75, height=0.7)
        axes.text(0.4, -row, kind, va="center", color=INK)
        axes.text(own + 0.2, -row, f"{own}", va="center", color=colour)
    axes.set_yticks([])
    axes.set_xlim(0, 23)
    axes.set_xlabel("parameters of links and tool (red: without the size)")
    axes.spines["left"].set_visible(False)
    return figure


@drawn
def corners_in_a_picture() -> Figure:
    """What the camera of the page sees of its board from three poses of the hand."""
    figure, (axes,) = panels(height=4.0)
    with tempfile.TemporaryDirectory() as folder:
        (file := Path(folder) / "cameras.toml").write_text(block("cameras", "focal_px"), encoding="utf-8")
        rig = read_rig(file)
    camera, board = rig.cameras[0], rig.boards[0]
    corners = board.corners - board.corners.mean(axis=0)
    for tilt, turn, at, colour in (
        (0, 0, (-0.09, -0.05, 0.40), BLUE), (45, 20, (0.12, -0.04, 0.45), ORANGE), (-40, 70, (0.02, 0.10, 0.42), GREEN)
    ):  # fmt: skip
        a, b = np.deg2rad([tilt, turn])
        Ry = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
        Rz = np.array([[np.cos(b), -np.sin(b), 0], [np.sin(b), np.cos(b), 0], [0, 0, 1]])
        places = projected(corners @ (Ry @ Rz).T + np.array(at), camera.intrinsic_values)[0]
        seen = camera.sees(places)
        px = PX.of(places)
        axes.plot(*px[seen].T, ".", color=colour, markersize=7)
        axes.plot(*px[~seen].T, "x", color=colour, markersize=5, alpha=0.5)
        axes.annotate("0", px[0], (-11, 3), textcoords="offset points", color=colour)
    width, height = camera.size_px
    axes.add_patch(Rectangle((0, 0), width, height, fill=False, edgecolor=INK, linewidth=2))
    axes.set_xlim(-150, width + 150)
    axes.set_ylim(height + 130, -100)
    axes.set_xlabel("u, px (×: beside the picture, left out)")
    axes.set_ylabel("v, px")
    axes.set_aspect("equal")
    return figure
