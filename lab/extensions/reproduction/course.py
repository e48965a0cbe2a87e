"""Compute the examples of Mallem 2011 on serial robots: arms, rotations, motion, volumes; and define the source."""

from functools import cache

import numpy as np

from lab.campaign.robot import load_robot
from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.reproduction.answer import Answer, formula, holds, number, word
from lab.extensions.reproduction.course_machines import CARRIER_ITEMS, PARALLEL_ITEMS, VERSATRAN_ITEMS
from lab.extensions.reproduction.item import Item, Missing, Source
from lab.extensions.reproduction.models import SAMPLES, matrix_formulas, sampled, serial
from lab.extensions.robotics.workspace.boundary import carrier_volume
from lab.kinematics.closed.mobility import mobility_of
from lab.kinematics.differential import rates
from lab.kinematics.inverse.closed_form import closed_form_of
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.chain import Chain
from lab.kinematics.trajectory.profiles import Trajectory
from lab.kinematics.trajectory.trajectory import through
from lab.render.charts.chart import axes_picture
from lab.render.charts.marks import Axes
from lab.render.document import Picture
from lab.render.style import AFTER

__all__ = ["COURSE"]

_SCEMI = (  # link matrices, m
    "c1 | −s1 | 0 | 0; s1 | c1 | 0 | 0; 0 | 0 | 1 | 0", "c2 | −s2 | 0 | 0; 0 | 0 | −1 | 0; s2 | c2 | 0 | 0",
    "c3 | −s3 | 0 | 0.5; s3 | c3 | 0 | 0; 0 | 0 | 1 | 0", "c4 | −s4 | 0 | 0; 0 | 0 | 1 | 0.5; −s4 | −c4 | 0 | 0",
    "c5 | −s5 | 0 | 0; 0 | 0 | −1 | 0; s5 | c5 | 0 | 0", "c6 | −s6 | 0 | 0; 0 | 0 | 1 | 0.1; −s6 | −c6 | 0 | 0",
)  # fmt: skip
_SCARA = (
    "c1 | −s1 | 0 | 0; s1 | c1 | 0 | 0; 0 | 0 | 1 | 0", "c2 | −s2 | 0 | 0.4; s2 | c2 | 0 | 0; 0 | 0 | 1 | 0",
    "1 | 0 | 0 | 0.25; 0 | 1 | 0 | 0; 0 | 0 | 1 | q3", "c4 | −s4 | 0 | 0; s4 | c4 | 0 | 0; 0 | 0 | 1 | 0",
)  # fmt: skip


def _places(text: str) -> dict[str, str]:
    """Return the entries of a matrix by their places."""
    rows = [row.split("|") for row in text.split(";")]
    return {f"({i + 1},{j + 1})": entry.strip() for i, row in enumerate(rows) for j, entry in enumerate(row)}


def _matrices(name: str, links: tuple[str, ...]) -> tuple[Answer, ...]:
    robot = sampled(name)
    return tuple(
        answer
        for i, text in enumerate(links)
        for answer in matrix_formulas(
            f"T{i},{i + 1}", "", robot.between(i, i + 1)[:, :3], robot.variables, _places(text)
        )
    )


def _table(name: str) -> tuple[Answer, ...]:
    """Compare σ, α and a of each joint; θ or r is the joint's."""
    chain = serial(name)[0].chain
    return tuple(
        answer
        for i in range(chain.size)
        for answer in (
            number(f"σ{i + 1}", "", float(chain.prismatic[i]), digits=0),
            number(f"α{i + 1}", "", float(np.rad2deg(chain.table[i, 3])), "°", digits=0),
            number(f"a{i + 1}", "", MM.of(float(chain.table[i, 2])), "mm", digits=0),
        )
    )


def _scemi() -> tuple[Answer, ...]:
    return (*_table("scemi"), *_matrices("scemi", _SCEMI))


def _six_hinges() -> tuple[Answer, ...]:
    """Compare the singularities of a 6R arm with a spherical wrist, by the Jacobian of the wrist's centre."""
    robot = sampled("scemi")
    form = closed_form_of(robot.arm.dh_chain(robot.values))
    assert form is not None
    centre = robot.arm.chain.table.copy()
    centre[5, 1] = 0.0
    arm = type(robot.arm)(robot.arm.chain.with_table(centre), ("p1",))
    J = arm.tool(robot.joints, arm.nominal({"p1": np.zeros(3)}))[1]
    right = "−0.5 · 0.5 c3 s5 (0.5 s23 − 0.5 c2)"
    names = ", ".join(sorted(factor.name for factor in form.determinant.factors if factor.terms))
    return (
        formula("det J", "", np.linalg.det(J), robot.variables, right=right),
        word("the singularities", "", names),
    )


def _scara() -> tuple[Answer, ...]:
    robot = sampled("scara")
    T, J = robot.between(0, 4), robot.jacobian()
    v = robot.variables | {"x": T[:, 0, 3], "y": T[:, 1, 3], "z": T[:, 2, 3]}
    kinds = "".join("P" if slides else "R" for slides in robot.arm.chain.prismatic[:3])
    direct = {"x": "0.4 c1 + 0.25 c12", "y": "0.4 s1 + 0.25 s12", "z": "q3"}
    reduced = J[:, [0, 1, 2, 5]]
    rows = {f"({i},{j})": "0" for i in range(1, 5) for j in range(1, 5)} | {
        "(1,1)": "−y", "(1,2)": "−0.25 s12", "(2,1)": "x", "(2,2)": "0.25 c12", "(3,3)": "1", "(4,1)": "1",
        "(4,2)": "1", "(4,4)": "1",
    }  # fmt: skip
    elbow = v | {"w": np.sign(np.sin(v["q2"]))}
    shoulder = "atan2(y (0.4 + 0.25 c2) − x 0.25 s2, x (0.4 + 0.25 c2) + y 0.25 s2)"
    q1 = np.arctan2(np.sin(v["q1"]), np.cos(v["q1"]))
    return (
        word("type of its first three joints", "RRR", kinds, erratum="the third joint of the drawn arm is a slide"),
        *_table("scara"),
        *_matrices("scara", _SCARA),
        *(formula(name, "", v[name], v, right=text) for name, text in direct.items()),
        formula("q2 of x, y", "", v["q2"], elbow, right="w acos((x^2 + y^2 − 0.4^2 − 0.25^2)/(2 · 0.4 · 0.25))"),
        formula("q1 of x, y, q2", "", q1, v, right=shoulder),
        *matrix_formulas("J of x, y, z and the turn", "", reduced, v, rows),
        formula("det of that J, by which the arm is singular", "", np.linalg.det(reduced), v, right="0.4 · 0.25 s2"),
    )


_ARM_ITEMS = (
    Item("Section 8.3", "Table and link matrices of the SCEMI", _scemi, "lab kinematics scemi --symbolic",
         "The course leaves both blank. Lengths are representative: a3 = r4 = 0.5 m and r6 = 0.1 m."),
    Item("Section 8.8", "Singular positions of a 6R arm", _six_hinges, "lab inspect scemi",
         "Of the SCEMI, at the wrist's centre: the factors are zero at the elbow, the wrist and the shoulder."),
    Item("Section 8.9", "The SCARA with four joints", _scara, "lab kinematics scara --symbolic",
         "Lengths are representative: 0.4 and 0.25 m. w is the sign of sin q2, of the two roots."),
)  # fmt: skip


_ARMS = ("versatran", "scemi", "scara", "planar3r")


def _rank(robot: str, joints_deg: tuple[float, ...]) -> int:
    chain = load_robot(robot).serial_model.chain
    arm = SerialArm(chain)
    jacobian = arm.tool(np.deg2rad([joints_deg]), arm.nominal())[1]
    return int(rates(jacobian, np.zeros((1, 6))).rank[0])


def _redundancy() -> tuple[Answer, ...]:
    """Check IL <= IM, an arm that is redundant everywhere, and one at singularities; the course draws its own."""
    found = {name: mobility_of(load_robot(name).serial_model.chain) for name in _ARMS}
    excess = max(each.freedoms - each.index for each in found.values())
    lengths, angles = np.array([0.4, 0.3, 0.2, 0.1]), rng_for(0, "arm").uniform(-3, 3, (SAMPLES, 4))
    ends = np.cumsum((lengths * np.exp(1j * np.cumsum(angles, axis=1)))[:, ::-1], axis=1)[:, ::-1]  # from each axis
    planar = np.stack([-ends.imag, ends.real, np.ones_like(ends.real)], axis=1)
    most = int(np.linalg.matrix_rank(planar).max())
    return (
        holds("IL ≤ IM of every arm", float(max(excess, 0))),
        word("IL < IM in every configuration: planar RRRR", "redundant", "redundant" if most < 4 else "not redundant"),
        word(
            "IL < IM in some: the SCEMI, with q5 = 0", "locally redundant",
            "locally redundant" if _rank("scemi", (0, 30, 20, 10, 0, 0)) < found["scemi"].freedoms == 6 else "neither",
        ),
    )  # fmt: skip


def _coordinates() -> tuple[Answer, ...]:
    """Convert points to polar and cylindrical coordinates and back."""
    points = rng_for(0, "poses").normal(size=(SAMPLES, 3))
    x, y, z = points.T
    first, level, far = np.arctan2(y, x), np.hypot(x, y), np.linalg.norm(points, axis=1)
    second = np.arctan2(z, level)
    polar = far * np.array([np.cos(second) * np.cos(first), np.cos(second) * np.sin(first), np.sin(second)])
    cylindrical = np.array([level * np.cos(first), level * np.sin(first), z])
    return (
        holds("x, y, z of θ1, θ2, R", float(np.abs(polar.T - points).max())),
        holds("x, y, z of θ1, L, z", float(np.abs(cylindrical.T - points).max())),
    )


def _products() -> tuple[Answer, ...]:
    """Check consecutive transformations in current and fixed frames, and the matrix of a vector product."""
    rng = rng_for(0, "arm")

    def drawn() -> Array:
        return np.asarray(se3.pose(se3.exp(rng.normal(size=3)), rng.normal(size=3)))

    first, second = drawn(), drawn()
    as_fixed = first @ second @ se3.inverse(first)  # the second motion, in the frame at the origin
    u, v = rng.normal(size=(2, 3))
    return (
        holds("current frames: T12 T23", float(np.abs(as_fixed @ first - first @ second).max())),
        holds("X(u) v", float(np.abs(se3.skew(u) @ v - np.cross(u, v)).max())),
    )


_BASIC_ITEMS = (
    Item("Section 6.2", "Mobility index, degrees of freedom, redundancy", _redundancy, "lab inspect scemi",
         "the course draws its examples without numbers; these are arms of the lab"),
    Item("Section 7.1", "Polar and cylindrical coordinates", _coordinates, "",
         "a library's arithmetic: no command converts coordinates"),
    Item("Annex, recalls 1 and 2", "Products of transformations and of vectors", _products,
         "lab kinematics irb120 --joints 0,0,0,0,0,0 --matrices", "the products are printed beside the link matrices"),
)  # fmt: skip


_RPY = (
    "cos(θy) cos(θz) | sin(θx) sin(θy) cos(θz) − cos(θx) sin(θz) | cos(θx) sin(θy) cos(θz) + sin(θx) sin(θz);"
    "cos(θy) sin(θz) | sin(θx) sin(θy) sin(θz) + cos(θx) cos(θz) | cos(θx) sin(θy) sin(θz) − sin(θx) cos(θz);"
    "−sin(θy) | sin(θx) cos(θy) | cos(θx) cos(θy)"
)
_AXIS = (
    "ux^2 (1 − C) + C | ux uy (1 − C) − uz S | ux uz (1 − C) + uy S;"
    "ux uy (1 − C) + uz S | uy^2 (1 − C) + C | uy uz (1 − C) − ux S;"
    "ux uz (1 − C) − uy S | uy uz (1 − C) + ux S | uz^2 (1 − C) + C"
)


def _cosines() -> tuple[Answer, ...]:
    """Count the independent ones of the nine direction cosines: the rank of their derivatives by the rotation."""
    R = se3.exp(rng_for(0, "arm").normal(size=3))
    moved = np.stack([(se3.skew(axis) @ R).ravel() for axis in np.eye(3)], axis=1)
    third = float(np.abs(np.cross(R[:, 0], R[:, 1]) - R[:, 2]).max())
    return (
        number("independent direction cosines", "2", int(np.linalg.matrix_rank(moved)),
               erratum="nine cosines under six conditions leave three: the rank of their rates is 3"),
        holds("k = i × j", third),
    )  # fmt: skip


def _roll_pitch_yaw() -> tuple[Answer, ...]:
    angles = rng_for(0, "arm").uniform(-1.5, 1.5, (SAMPLES, 3))
    R = se3.rotation_from_roll_pitch_yaw(angles)
    letters = {f"θ{axis}": angles[:, i] for i, axis in enumerate("xyz")}
    level = se3.roll_pitch_yaw(se3.rotation_from_roll_pitch_yaw(np.array([0.3, np.pi / 2, 0.4])))
    again = se3.rotation_from_roll_pitch_yaw(level) - se3.rotation_from_roll_pitch_yaw(np.array([0.3, np.pi / 2, 0.4]))
    return (
        *matrix_formulas("R", _RPY, R, letters),
        holds("the angles of R", float(np.abs(se3.roll_pitch_yaw(R) - angles).max())),
        holds("and at a pitch of 90°, where yaw is free", float(np.abs(again).max())),
    )


@cache
def _axis() -> tuple[Array, Array, Array, dict[str, Array]]:
    """Sample axes, angles in (0, π), rotations, and the letters of A3.4 to A3.11."""
    rng = rng_for(0, "arm")
    u = rng.normal(size=(SAMPLES, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    theta = rng.uniform(0.1, 3.0, SAMPLES)
    R = se3.exp(theta[:, None] * u)
    letters = {f"u{axis}": u[:, i] for i, axis in enumerate("xyz")} | {"C": np.cos(theta), "S": np.sin(theta)}
    letters |= {f"{name}{axis}": R[:, i, j] for j, name in enumerate("ijk") for i, axis in enumerate("xyz")}
    return u, theta, R, letters


def _rotation_vector() -> tuple[Answer, ...]:
    u, theta, R, v = _axis()
    beta, alpha = np.arccos(u[:, 2]), np.arctan2(u[:, 0], -u[:, 1])
    turned = {"α": alpha, "β": beta}
    X, one = se3.skew(u), np.eye(3)
    S, C = np.sin(theta)[:, None, None], np.cos(theta)[:, None, None]
    first = C * one + S * X + (1 - C) * u[:, :, None] * u[:, None]
    return (
        *(formula(f"A3.4 u{'xyz'[i]}", text, u[:, i], turned)
          for i, text in enumerate(("sin(α) sin(β)", "−cos(α) sin(β)", "cos(β)"))),
        *matrix_formulas("A3.5 R", _AXIS, R, v),
        holds("A3.6 a", float(np.abs(first - R).max())),
        holds("A3.6 b", float(np.abs(one + S * X + (1 - C) * (X @ X) - R).max())),
    )  # fmt: skip


def _inverse() -> tuple[Answer, ...]:
    u, theta, _, v = _axis()
    signs = ("(jz − ky)/abs(jz − ky)", "(kx − iz)/abs(kx − iz)", "(iy − jx)/abs(iy − jx)")
    half = se3.exp(np.pi * np.array([0.6, 0.0, -0.8]))
    printed = np.sqrt((np.diag(half) + 1) / 2)
    best = se3.log(half) / np.pi
    tiny = np.array([[3e-9, 0, 0]])
    answers = [
        formula("A3.7 C", "(ix + jy + kz − 1)/2", v["C"], v),
        *(formula(f"A3.8 2 u{axis} S", text, 2 * u[:, i] * v["S"], v)
          for i, (axis, text) in enumerate(zip("xyz", ("jz − ky", "kx − iz", "iy − jx"), strict=True))),
        formula("A3.9 S", "√((jz − ky)^2 + (kx − iz)^2 + (iy − jx)^2)/2", v["S"], v),
        formula("A3.10 θ", "atan(S/C)", theta, v, right="atan2(S, C)",
                erratum="Arctan(S/C) lies within ±90°, so that every angle above 90° is missed by 180°"),
        *(formula(f"A3.11 u{axis}", f"{sign} √(({name} − C)/(1 − C))", u[:, i], v)
          for i, (axis, sign, name) in enumerate(zip("xyz", signs, ("ix", "jy", "kz"), strict=True))),
        holds("A3.11 at θ = 180°", float(np.abs(np.abs(best @ np.array([0.6, 0.0, -0.8])) - 1))
              + float(np.abs(np.outer(printed, printed) - np.outer(best, best)).max()),
              erratum="the signs of zeros: the axis (0.6, 0, −0.8) comes out as (0.6, 0, 0.8)"),
        holds("the logarithm at θ = 3e-9", float(np.abs(se3.log(se3.exp(tiny)) - tiny).max() / 3e-9)),
    ]  # fmt: skip
    return tuple(answers)


_ROTATION_ITEMS = (
    Item("Annex, A3.1", "Direction cosines", _cosines, note="lab.core.se3 has the rotations of the annex, each way."),
    Item("Annex, A3.2", "Roll, pitch and yaw", _roll_pitch_yaw, "lab kinematics irb120 --joints 0,0,0,0,0,0",
         "Poses are printed with these three angles."),
    Item("Annex, A3.3 to A3.6, figure A3.1", "Vector of rotation", _rotation_vector,
         note="The figure's two turns are A3.3 and A3.4."),
    Item("Annex, A3.7 to A3.11", "Axis and angle of a rotation", _inverse,
         note="The lab takes the quaternion with the largest pivot, which is right at every angle."),
)  # fmt: skip


_FIRST, _SECOND = 0.5, 1.0  # m


def _joints(x: float, y: float, z: float) -> Array:
    return np.array([np.arctan2(y, x), np.arcsin((z - _FIRST) / _SECOND)])


def _moved(middle: tuple[float, float, float], speed: Array) -> tuple[Array, Trajectory]:
    """Return the joints' via points and the move through them."""
    side = np.sqrt(3) / 2
    points = np.array([_joints(side, 0, 0), _joints(*middle), _joints(side, 0, 1)])
    return points, through(serial("course2r")[0].chain, points, np.array([[0.0, 0], speed, [0.0, 0]]))


def _models() -> tuple[Answer, ...]:
    robot = sampled("course2r")
    p, J = robot.between(0, 2)[:, :3, 3], robot.jacobian()[:, :3]
    v = robot.variables | {"L1": np.full(len(p), _FIRST), "L2": np.full(len(p), _SECOND)}
    v |= {name: p[:, i] for i, name in enumerate("xyz")}
    direct = ("L2 c2 c1", "L2 c2 s1", "L1 + L2 s2")
    rates = (("−L2 c2 s1", "−L2 s2 c1"), ("L2 c2 c1", "−L2 s2 s1"), ("0", "L2 c2"))
    return (
        *(formula("xyz"[i], "", p[:, i], v, right=text) for i, text in enumerate(direct)),
        formula("q1 of x, y, z", "", v["q1"], v, right="atan2(y, x)"),
        formula("q2 of x, y, z", "", v["q2"], v, right="atan2(z − L1, √(x^2 + y^2))"),
        *(formula(f"J({i + 1},{j + 1})", "", J[:, i, j], v, right=text)
          for i, row in enumerate(rates) for j, text in enumerate(row)),
    )  # fmt: skip


def _exact() -> tuple[Answer, ...]:
    speed = np.array([0.0, 0.2])
    points, found = _moved((0.0, 1.0, 0.5), speed)
    degrees, side = np.rad2deg(points), float(np.sqrt(3) / 2)
    accelerations = np.rad2deg(found.accelerations)
    peak = float(np.rad2deg(np.abs(np.cumsum(found.accelerations * found.durations[:, None], axis=0)).max()))
    return (
        number("X of P2", "0.86", side, "m"),
        *(number(f"q{j + 1} at P{i}", "", float(degrees[i, j]), "°", digits=2) for i in range(3) for j in range(2)),
        number("speed of q2 at P1", "", float(np.rad2deg(speed[1])), "°/s", digits=3),
        *(number(f"phase {i + 1}", "", float(seconds), "s", digits=4) for i, seconds in enumerate(found.durations)),
        number("total", "", float(found.seconds), "s", digits=4),
        *(number(f"acceleration of q{j + 1} in phase {i + 1}", "", float(accelerations[i, j]), "°/s²", digits=3)
          for i in range(4) for j in range(2)),
        number("largest speed", "", peak, "°/s", digits=2),
    )  # fmt: skip


def _past() -> tuple[Answer, ...]:
    """Pass P1 at the allowed distance dX = 0.1 m, on the shortest arc of q1."""
    points, found = _moved((0.1, float(np.sqrt(0.99)), 0.5), np.array([0.0, 0.2]))
    return (
        number("q1 where it turns back", "", float(np.rad2deg(points[1, 0])), "°", digits=3),
        number("total past P1", "", float(found.seconds), "s", digits=4),
    )


_MOTION_ITEMS = (
    Item("Section 10.3, question 1", "Models of the robot of two hinges", _models,
         "lab kinematics course2r --symbolic"),
    Item("Section 10.3, question 2", "Its trajectory through P1", _exact,
         "lab trajectory POINTS.csv --robot course2r --accelerations 50 --speeds 171.9",
         "POINTS.csv holds the joints of P0, P1 and P2 and the speed of 11.459 °/s at P1, as docs/how_to/trajectories "
         "shows. X2 = 0.86 is √3/2 with its last digits left out. The largest speed, 171.88 °/s, is not reached."),
    Item("Section 10.3, approximation", "The trajectory past P1 with dX = 0.1 m", _past,
         "lab trajectory POINTS.csv --robot course2r --accelerations 50 --speeds 171.9"),
)  # fmt: skip


_CLOSED = {  # L = 1 m: closed formulas
    "RPP, cylindrical (6.1.1)": np.pi,
    "RRR, anthropomorphic (6.1.2)": 32 * np.pi / 3,
    "PPP, Cartesian (6.1.3)": 1.0,
    "RRP, spherical (6.1.4)": 4 * np.pi / 3,
    "RRP, toric (6.1.5)": 4 * np.pi,
}


@cache
def _volumes() -> dict[str, float]:
    names = ("cylindrical", "anthropomorphic", "cartesian", "spherical", "scara")
    found = {}
    for title, name in zip(_CLOSED, names, strict=True):
        chain = load_robot(f"carrier/{name}").chain
        assert isinstance(chain, Chain)
        found[title] = carrier_volume(chain, np.zeros(3), 3.5)
    return found


def _answers() -> tuple[Answer, ...]:
    found = _volumes()
    apart = max(abs(found[name] / closed - 1) for name, closed in _CLOSED.items())
    return (
        *(number(f"volume / L³, {name}", "", value, digits=2) for name, value in found.items()),
        holds("π, 32 π/3, 1, 4 π/3 and 4 π, relative", apart, within=1e-3),
    )


def _picture() -> tuple[Picture, ...]:
    found = _volumes()

    def draw(axes: Axes) -> None:
        at = np.arange(len(found))[::-1]
        axes.barh(at, list(found.values()), color=AFTER, height=0.6)
        for place, value in zip(at, found.values(), strict=True):
            axes.annotate(f"{value:.2f}", (value + 0.4, place), va="center", fontsize=8)
        axes.set_yticks(at, list(found))
        axes.set(xlabel="volume / L³", xlim=(0, 40))

    return (axes_picture("carriers", "Volumes of the five carriers", (5.6, 2.6), draw, (2.2, 0.5, 0.15, 0.15)),)


_VOLUME_ITEMS = (
    Item("Section 6.1", "Volumes of the five carriers", _answers, "lab workspace carriers",
         "Hinges turn by 360°, slides move from 0 to L, and "
         "a link is as long as L if it bears a hinge, else nothing. By exact sections of what the closed-form inverse "
         "reaches within the limits; L = 1 m.", _picture),
)  # fmt: skip


COURSE = Source(
    "course",
    "Mallem 2011, geometric and kinematic models of robots (ENSIIE)",
    (
        *_VOLUME_ITEMS, *_BASIC_ITEMS[:2], *CARRIER_ITEMS, *VERSATRAN_ITEMS, *_ARM_ITEMS, *_MOTION_ITEMS,
        *PARALLEL_ITEMS, *_BASIC_ITEMS[2:], *_ROTATION_ITEMS,
    ),
    (
        Missing("Sections 1 to 4", "Robotics, its disciplines, parts and functions", "words and illustrations"),
        Missing("Sections 5.1 to 5.6", "Definitions of the models",
                "no example: the models are computed in sections 7 and 8"),
        Missing("Sections 6.1, 6.2, figures", "Structures drawn",
                "photographs and drawings of makers' arms; their volumes are section 6.1"),
        Missing("Section 9", "Use of the models", "a diagram"),
        Missing("Sections 10.1, 10.2", "Principle and algorithm", "steps in words; section 10.3 is their example"),
        Missing("Sections 11.1, 11.2, 11.4.1 to 11.4.3", "Kinds of joints and robots",
                "tables of symbols and drawings; lab inspect delta, hexapod, rpr3, prr3 and rrr3 have such robots"),
    ),
)  # fmt: skip
