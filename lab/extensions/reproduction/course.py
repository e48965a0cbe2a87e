"""Compute the examples of Mallem 2011 on serial robots: arms, rotations, motion, volumes; and define the source."""

from functools import cache

import numpy as np

from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.reproduction.answer import ComparedValue, formula, holds, number, word
from lab.extensions.reproduction.course_machines import CARRIER_ITEMS, PARALLEL_ITEMS, VERSATRAN_ITEMS
from lab.extensions.reproduction.item import Item, Missing, Source, in_chapter, with_exercises
from lab.extensions.reproduction.source_models import SAMPLES, as_row, matrix_formulas, nominal_chain, sampled, serial
from lab.extensions.robotics.workspace.boundary import carrier_volume
from lab.kinematics.closed.mobility import mobility_of
from lab.kinematics.differential import pseudo_inverse, rates
from lab.kinematics.inverse.closed_form import closed_form_of
from lab.kinematics.inverse.newton_inverse import PoseTarget, reach
from lab.kinematics.trajectory.profiles import Trajectory
from lab.kinematics.trajectory.trajectory import through
from lab.report.comparison_plots import bars_picture
from lab.report.document import Picture

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


def _matrices(name: str, links: tuple[str, ...]) -> tuple[ComparedValue, ...]:
    robot = sampled(name)
    return tuple(
        answer
        for i, text in enumerate(links)
        for answer in matrix_formulas(
            f"T{i},{i + 1}", "", robot.between(i, i + 1)[:, :3], robot.variables, _places(text)
        )
    )


_TABLES = {  # σ, α in °, a and r without the joint in mm, of each joint
    "scemi": ("0 0 0 0", "0 90 0 0", "0 0 500 0", "0 -90 0 500", "0 90 0 0", "0 -90 0 100"),
    "scara": ("0 0 0 0", "0 0 400 0", "1 0 250 0", "0 0 0 0"),
}


def _table(name: str) -> tuple[ComparedValue, ...]:
    """Compare σ, α, a and the constant part of r of each joint; θ or r is the joint's."""
    chain = serial(name)[0].chain
    answers: list[ComparedValue] = []
    for i, row in enumerate(_TABLES[name]):
        _, d, a, alpha, _ = chain.table[i]
        ours = (float(chain.prismatic[i]), float(np.rad2deg(alpha)), MM.of(float(a)), MM.of(float(d)))
        answers += as_row(f"joint {i + 1}: σ, α, a, r", (
            number(f"{letter}{i + 1}", "", value, unit, right=text)
            for (letter, unit), text, value in zip(_TABLE_COLUMNS, row.split(), ours, strict=True)
        ))  # fmt: skip
    return tuple(answers)


_TABLE_COLUMNS = (("σ", ""), ("α", "°"), ("a", "mm"), ("r", "mm"))


def _scemi() -> tuple[ComparedValue, ...]:
    return (*_table("scemi"), *_matrices("scemi", _SCEMI))


def _six_hinges() -> tuple[ComparedValue, ...]:
    """Compare the singularities of a 6R arm with a spherical wrist, by the Jacobian of the wrist's centre."""
    robot = sampled("scemi")
    form = closed_form_of(robot.arm.dh_chain(robot.values))
    centre = robot.arm.chain.table.copy()
    centre[5, 1] = 0.0
    arm = type(robot.arm)(robot.arm.chain.with_table(centre), ("p1",))
    J = arm.tool(robot.joints, arm.nominal({"p1": np.zeros(3)}))[1]
    right = "−0.5 · 0.5 c3 s5 (0.5 s23 − 0.5 c2)"
    factors = () if form is None else form.determinant.factors
    names = ", ".join(sorted(factor.name for factor in factors if factor.terms))
    return (
        formula("det J", "", np.linalg.det(J), robot.variables, right=right),
        word("the singularities", "", names, right="elbow, shoulder, wrist"),
    )


def _scara() -> tuple[ComparedValue, ...]:
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
        word(
            "type of its first three joints",
            "RRR",
            kinds,
            right="RRP",
            erratum="the third joint of the drawn arm is a slide",
        ),
        *_table("scara"),
        *_matrices("scara", _SCARA),
        *(formula(name, "", v[name], v, right=text) for name, text in direct.items()),
        formula(
            "q2 of x, y", "", v["q2"], elbow, right="w acos((x^2 + y^2 − 0.4^2 − 0.25^2)/(2 · 0.4 · 0.25))", angle=True
        ),
        formula("q1 of x, y, q2", "", q1, v, right=shoulder, angle=True),
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


_ARMS = ("versatran", "scemi", "scara", "planar3r", "panda")


def _rank(robot: str, joints_deg: tuple[float, ...]) -> int:
    arm, values = serial(robot)
    jacobian = arm.tool(np.deg2rad([joints_deg]), values)[1]
    return int(rates(jacobian, np.zeros((1, 6))).rank[0])


def _redundancy() -> tuple[ComparedValue, ...]:
    """Check IL <= IM, an arm that is redundant everywhere, and one at singularities; the course draws its own."""
    found = {name: mobility_of(nominal_chain(name)) for name in _ARMS}
    excess = max(each.freedoms - each.index for each in found.values())
    singular = _rank("scemi", (0, 30, 20, 10, 0, 0)) < found["scemi"].freedoms == found["scemi"].index
    return (
        holds("IL ≤ IM of every arm", float(max(excess, 0))),
        word("IL < IM in every configuration: the Panda", "redundant",
             "redundant" if found["panda"].redundancy > 0 else "not redundant"),
        word("IL < IM in some: the SCEMI, with q5 = 0", "locally redundant",
             "locally redundant" if singular else "neither"),
    )  # fmt: skip


def _coordinates() -> tuple[ComparedValue, ...]:
    """Compare the polar and cylindrical coordinates of a point with the joints of carriers that have them."""
    answers = []
    for title, name, formulas in (
        ("polar", "spherical", {"x": "R cos(θ2) cos(θ1)", "y": "R cos(θ2) sin(θ1)", "z": "R sin(θ2)"}),
        ("cylindrical", "cylindrical", {"x": "L cos(θ1)", "y": "L sin(θ1)", "z": "z"}),
    ):
        robot = sampled(f"carrier/{name}")
        q, at = robot.joints.T, robot.between(0, 3)[:, :3, 3]
        if name == "spherical":  # on a column of 1 m; joint 2 turns down from the vertical
            letters, at = {"θ1": q[0], "θ2": np.pi / 2 - q[1], "R": q[2]}, at - np.array([0.0, 0.0, 1.0])
        else:  # the boom begins across
            letters = {"θ1": q[0] + np.pi / 2, "z": q[1], "L": q[2]}
        answers += [formula(f"{title} {axis}", "", at[:, "xyz".index(axis)], letters, right=text)
                    for axis, text in formulas.items()]  # fmt: skip
    return tuple(answers)


def _blocks() -> tuple[ComparedValue, ...]:
    """Check the inverse by blocks of an arm with a spherical wrist, and J⁺ with fewer and more than six joints."""
    J = sampled("versatran").jacobian()
    A, zero, C, D = J[:, :3, :3], J[:, :3, 3:], J[:, 3:, :3], J[:, 3:, 3:]
    A_inverse, D_inverse = np.linalg.inv(A), np.linalg.inv(D)
    lower = np.concatenate([-D_inverse @ C @ A_inverse, D_inverse], axis=2)
    whole = np.concatenate([np.concatenate([A_inverse, np.zeros_like(A)], axis=2), lower], axis=1)
    few, many = sampled("scara").jacobian(), sampled("panda").jacobian()
    by_columns = np.linalg.inv(few.swapaxes(1, 2) @ few) @ few.swapaxes(1, 2)
    by_rows = many.swapaxes(1, 2) @ np.linalg.inv(many @ many.swapaxes(1, 2))
    misses = _gap(by_columns, pseudo_inverse(few, least=0.0))
    rank = int(np.linalg.matrix_rank(many.swapaxes(1, 2) @ many).max())
    right = "(JᵗJ)⁻¹Jᵗ"
    return (
        holds("the block at the upper right is 0", float(np.abs(zero).max())),
        holds("J⁻¹ by blocks", _gap(whole, pseudo_inverse(J, least=0.0))),
        word("J⁺", "(JᵗJ⁻)⁻¹Jᵗ", right if misses < 1e-9 else "another", right=right,
             erratum=f"J⁻ stands for J; and of a redundant arm J⁺ is Jᵗ(JJᵗ)⁻¹, since JᵗJ is singular (rank {rank} of "
             f"{many.shape[2]} for the Panda)"),
        holds("(JᵗJ)⁻¹Jᵗ of the SCARA's four joints", misses),
        holds("Jᵗ(JJᵗ)⁻¹ of the Panda's seven joints", _gap(by_rows, pseudo_inverse(many, least=0.0))),
    )  # fmt: skip


def _gap(first: Array, second: Array) -> float:
    return float(np.abs(first - second).max() / np.abs(second).max())


def _products() -> tuple[ComparedValue, ...]:
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


_REDUNDANCY_ITEM = Item(
    "Section 6.2", "Mobility index, degrees of freedom, redundancy", _redundancy, "lab inspect scemi",
    "The course draws its examples without numbers; these are arms of the lab.")  # fmt: skip
_COORDINATE_ITEM = Item(
    "Section 7.1", "Polar and cylindrical coordinates", _coordinates,
    "lab kinematics carrier/spherical --symbolic --between 0 3",
    "The course names the coordinates. Here they are the joints of two carriers: polar from the top of a column of "
    "1 m, with θ2 above the horizontal, and cylindrical with θ1 from the boom's side.")  # fmt: skip
_BLOCK_ITEM = Item(
    "Section 5.6", "The inverse of the Jacobian by blocks, and J⁺", _blocks,
    "lab kinematics versatran --joints 20,700,800,30,40,50 --twist 10,0,0,0,0,0",
    "Of the VERSATRAN at its wrist's centre, the SCARA and the Panda; the lab's inverses are by singular values.",
)  # fmt: skip
_PRODUCT_ITEM = Item(
    "Annex, recalls 1 and 2", "Products of transformations and of vectors", _products,
    "lab kinematics irb120 --joints 0,0,0,0,0,0 --matrices",
    "The products are printed beside the link matrices.",
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


def _cosines() -> tuple[ComparedValue, ...]:
    """Count the independent ones of the nine direction cosines: the rank of their derivatives by the rotation."""
    R = se3.exp(rng_for(0, "arm").normal(size=3))
    moved = np.stack([(se3.skew(axis) @ R).ravel() for axis in np.eye(3)], axis=1)
    third = float(np.abs(np.cross(R[:, 0], R[:, 1]) - R[:, 2]).max())
    return (
        number("independent direction cosines", "2", int(np.linalg.matrix_rank(moved)), right="3",
               erratum="nine cosines under six conditions leave three: the rank of their rates is 3"),
        holds("k = i × j", third),
    )  # fmt: skip


def _roll_pitch_yaw() -> tuple[ComparedValue, ...]:
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


def _rotation_vector() -> tuple[ComparedValue, ...]:
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


def _inverse() -> tuple[ComparedValue, ...]:
    u, _, R, v = _axis()
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
        formula("A3.10 tan θ, for 0 ≤ θ ≤ π", "S/C", np.tan(np.linalg.norm(se3.log(R), axis=1)), v),
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
_MIDDLE = (0.0, 1.0, 0.5)  # P1, m


def _joints(points: Array) -> Array:
    """Return joint positions ``(n, 2)`` for points ``(n, 3)``, by Newton's method from the course's formulas."""
    arm, values = serial("course2r")
    x, y, z = points.T
    start = np.stack([np.arctan2(y, x), np.arcsin((z - _FIRST) / _SECOND)], axis=1)
    free = np.full((len(points), 3, 3), np.nan)
    return reach(arm, values, PoseTarget(points, free), start, np.zeros((len(points), 0))).joints


def _moved(middle: tuple[float, float, float], speed: Array) -> tuple[Array, Trajectory]:
    """Return the joints' via points and the move through them."""
    side = np.sqrt(3) / 2
    points = _joints(np.array([[side, 0, 0], middle, [side, 0, 1]]))
    return points, through(serial("course2r")[0].chain, points, np.array([[0.0, 0], speed, [0.0, 0]]))


def _speed_at_middle() -> Array:
    """Return the joints' speeds ``(2,)`` that move the point up by 0.2 m/s at P1."""
    arm, values = serial("course2r")
    J = arm.tool(_joints(np.array([_MIDDLE])), values)[1]
    return np.asarray(pseudo_inverse(J[:, :3])[0] @ np.array([0.0, 0.0, 0.2]))


def _models() -> tuple[ComparedValue, ...]:
    robot = sampled("course2r")
    p, J = robot.between(0, 2)[:, :3, 3], robot.jacobian()[:, :3]
    v = robot.variables | {"L1": np.full(len(p), _FIRST), "L2": np.full(len(p), _SECOND)}
    v |= {name: p[:, i] for i, name in enumerate("xyz")}
    direct = ("L2 c2 c1", "L2 c2 s1", "L1 + L2 s2")
    rates = (("−L2 c2 s1", "−L2 s2 c1"), ("L2 c2 c1", "−L2 s2 s1"), ("0", "L2 c2"))
    return (
        *(formula("xyz"[i], "", p[:, i], v, right=text) for i, text in enumerate(direct)),
        formula("q1 of x, y, z", "", v["q1"], v, right="atan2(y, x)", angle=True),
        formula("q2 of x, y, z", "", v["q2"], v, right="atan2(z − L1, √(x^2 + y^2))"),
        *matrix_formulas("J", "", J, v, {f"({i + 1},{j + 1})": text for i, row in enumerate(rates)
                                         for j, text in enumerate(row)}),
    )  # fmt: skip


def _exact() -> tuple[ComparedValue, ...]:
    speed = _speed_at_middle()
    points, found = _moved(_MIDDLE, speed)
    degrees, side = np.rad2deg(points), float(np.sqrt(3) / 2)
    accelerations = np.rad2deg(found.accelerations)
    peak = float(np.rad2deg(np.abs(np.cumsum(found.accelerations * found.durations[:, None], axis=0)).max()))
    drawn, phase = (("0", "-30"), ("90", "0"), ("0", "30")), "1.34164"
    rates = ("50", "12.396"), ("-50", "-3.855"), ("-50", "3.855"), ("50", "-12.396")
    return (
        number("X of P2", "0.86", side, "m"),
        *(answer for i in range(3) for answer in as_row(f"q1 and q2 at P{i}", (
            number(f"q{j + 1} at P{i}", "", float(degrees[i, j]), "°", right=f"{drawn[i][j]}.000") for j in range(2)))),
        *as_row("speeds of q1 and q2 at P1", (
            number(f"speed of q{j + 1} at P1", "", float(np.rad2deg(speed[j])), "°/s", right=text)
            for j, text in enumerate(("0.000", "11.459")))),
        *as_row("phases 1 to 4", (number(f"phase {i + 1}", "", float(seconds), "s", right=phase)
                                  for i, seconds in enumerate(found.durations))),
        number("total", "", float(found.seconds), "s", right="5.36656"),
        *(answer for j in range(2) for answer in as_row(f"accelerations of q{j + 1} in phases 1 to 4", (
            number(f"acceleration of q{j + 1} in phase {i + 1}", "", float(accelerations[i, j]), "°/s²",
                   right=rates[i][j]) for i in range(len(accelerations))))),
        number("largest speed", "", peak, "°/s", right="67.08"),
    )  # fmt: skip


def _past() -> tuple[ComparedValue, ...]:
    """Pass P1 at the allowed distance dX = 0.1 m, on the shortest arc of q1."""
    points, found = _moved((0.1, float(np.sqrt(0.99)), 0.5), _speed_at_middle())
    return (
        number("q1 where it turns back", "", float(np.rad2deg(points[1, 0])), "°", right="84.261"),
        number("total past P1", "", float(found.seconds), "s", right="5.1926"),
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
        found[title] = carrier_volume(nominal_chain(f"carrier/{name}"), np.zeros(3), 3.5)
    return found


def _answers() -> tuple[ComparedValue, ...]:
    found = _volumes()
    apart = max(abs(found[name] / closed - 1) for name, closed in _CLOSED.items())
    return (
        *(number(f"volume / L³, {name}", "", value, right=f"{_CLOSED[name]:.2f}") for name, value in found.items()),
        holds("π, 32 π/3, 1, 4 π/3 and 4 π, relative", apart, within=1e-3),
    )


def _picture() -> tuple[Picture, ...]:
    volumes = _volumes()
    texts = [f"{value:.2f}" for value in volumes.values()]
    label = "Volumes of the five carriers"
    return (bars_picture("carriers", label, list(volumes), list(volumes.values()), texts, "volume / L³"),)


_VOLUME_ITEMS = (
    Item("Section 6.1", "Volumes of the five carriers", _answers, "lab workspace carriers",
         "Hinges turn by 360°, slides move from 0 to L, and "
         "a link is as long as L if it bears a hinge, else nothing. By exact sections of what the closed-form inverse "
         "reaches within the limits; L = 1 m.", _picture),
)  # fmt: skip


COURSE = Source(
    "course",
    "Mallem 2011, geometric and kinematic models of robots (ENSIIE)",
    with_exercises((
        *in_chapter("5 Models", (_BLOCK_ITEM,)),
        *in_chapter("6 Structures", (*_VOLUME_ITEMS, _REDUNDANCY_ITEM)),
        *in_chapter("7 Carriers", (_COORDINATE_ITEM, *CARRIER_ITEMS)),
        *in_chapter("8 Serial robots", (*VERSATRAN_ITEMS, *_ARM_ITEMS)),
        *in_chapter("10 Trajectories", _MOTION_ITEMS),
        *in_chapter("11 Parallel robots", PARALLEL_ITEMS),
        *in_chapter("Annex", (_PRODUCT_ITEM, *_ROTATION_ITEMS)),
    ), "course"),
    (
        Missing("Sections 1 to 4", "Robotics, its disciplines, parts and functions", "words and illustrations"),
        Missing("Sections 5.1 to 5.5", "Definitions of the models",
                "no example: the models are computed in sections 7 and 8"),
        Missing("Sections 6.1, 6.2, figures", "Structures drawn",
                "photographs and drawings of makers' arms; their volumes are section 6.1"),
        Missing("Section 9", "Use of the models", "a diagram"),
        Missing("Sections 10.1, 10.2", "Principle and algorithm", "steps in words; section 10.3 is their example"),
        Missing("Sections 11.1, 11.2, 11.4.1 to 11.4.3", "Kinds of joints and robots",
                "tables of symbols and drawings; lab inspect delta, hexapod, rpr3, prr3 and rrr3 have such robots"),
    ),
)  # fmt: skip
