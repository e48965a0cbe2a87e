"""Sections 8.1 to 8.7: the VERSATRAN FA, its direct, inverse and differential models."""

from functools import cache

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.reproduction.answer import Answer, formula, number
from lab.extensions.reproduction.item import Item
from lab.extensions.reproduction.models import Sampled, matrix_formulas, sampled

__all__ = ["VERSATRAN_ITEMS"]

R7 = 0.15  # the course's tool, along the last axis, m: representative
_TABLE = {"α": ("0", "0", "-90", "0", "-90", "90"), "a": ("0",) * 6}
_LINKS = (
    "c1 | −s1 | 0 | 0; s1 | c1 | 0 | 0; 0 | 0 | 1 | 0; 0 | 0 | 0 | 1",
    "1 | 0 | 0 | 0; 0 | 1 | 0 | 0; 0 | 0 | 1 | q2; 0 | 0 | 0 | 1",
    "1 | 0 | 0 | 0; 0 | 0 | 1 | q3; 0 | −1 | 0 | 0; 0 | 0 | 0 | 1",
    "c4 | −s4 | 0 | 0; s4 | c4 | 0 | 0; 0 | 0 | 1 | 0; 0 | 0 | 0 | 1",
    "c5 | −s5 | 0 | 0; 0 | 0 | 1 | 0; −s5 | −c5 | 0 | 0; 0 | 0 | 0 | 1",
    "c6 | −s6 | 0 | 0; 0 | 0 | −1 | 0; s6 | c6 | 0 | 0; 0 | 0 | 0 | 1",
)
_T07 = (
    "c1 c4 c5 c6 − c1 s4 s6 + s1 s5 c6 | −c1 c4 c5 s6 − c1 s4 c6 + s1 s5 s6 | c1 c4 s5 − s1 c5 | −s1 q3 + r7 zx;"
    "s1 c4 c5 c6 − s1 s4 s6 − c1 s5 c6 | −s1 c4 c5 s6 − s1 s4 c6 − c1 s5 s6 | s1 c4 s5 + c1 c5 | c1 q3 + r7 zy;"
    "−s4 c5 c6 − c4 s6 | s4 c5 s6 − c4 c6 | −s4 s5 | q2 + r7 zz; 0 | 0 | 0 | 1"
)
_T07_RIGHT = {"(1,2)": "−c1 c4 c5 s6 − c1 s4 c6 − s1 s5 s6", "(2,2)": "−s1 c4 c5 s6 − s1 s4 c6 + c1 s5 s6"}
_J = (
    "−py | 0 | −s1 | 0 | 0 | 0; 0 | 1 | 0 | 0 | 0 | 0; 0 | 1 | 0 | 0 | 0 | 0;"
    "0 | 0 | 0 | −s1 | −c1 s4 | zx; 0 | 0 | 0 | −s1 | −c1 s4 | zx; 0 | 0 | 0 | 0 | −c4 | zz"
)
_J_RIGHT = {"(2,1)": "px", "(2,2)": "0", "(2,3)": "c1", "(5,4)": "c1", "(5,5)": "−s1 s4", "(5,6)": "zy", "(6,1)": "1"}


@cache
def _robot() -> tuple[Sampled, dict[str, Array], Array]:
    """The arm at random positions with both bends of the wrist, its letters, and T0,7."""
    robot = sampled("versatran")
    T = robot.between(0, 6)
    tool = np.eye(4)
    tool[2, 3] = R7
    hand = T @ tool
    p, x, y, z = T[:, :3, 3], T[:, :3, 0], T[:, :3, 1], T[:, :3, 2]
    names = {f"{letter}{axis}": column[:, i] for letter, column in (("p", p), ("x", x), ("y", y), ("z", z))
             for i, axis in enumerate("xyz")}  # fmt: skip
    place = {"px7": hand[:, 0, 3], "py7": hand[:, 1, 3], "pz7": hand[:, 2, 3]}
    return robot, {**robot.variables, **names, **place, "r7": np.full(len(T), R7)}, hand


def _general() -> tuple[Answer, ...]:
    """The matrix T_i-1,i of Craig's convention at random values."""
    alpha, a, theta, r = np.random.default_rng(0).uniform(-3, 3, (4, 20))
    x, z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    tilted = se3.pose(se3.exp(alpha[:, None] * x), a[:, None] * x)
    exact = tilted @ se3.pose(se3.exp(theta[:, None] * z), r[:, None] * z)
    printed = (
        "cos(θ) | −sin(θ) | 0 | a; cos(α) sin(θ) | cos(α) cos(θ) | −sin(α) | −r sin(α);"
        "sin(α) sin(θ) | sin(α) cos(θ) | cos(α) | r cos(α); 0 | 0 | 0 | 1"
    )
    return matrix_formulas("T", printed, exact, {"α": alpha, "a": a, "θ": theta, "r": r})


def _table() -> tuple[Answer, ...]:
    table = _robot()[0].arm.chain.table
    return tuple(
        number(f"{name}{i + 1}", text, float(np.rad2deg(table[i, 3]) if name == "α" else table[i, 2]),
               "°" if name == "α" else "m")
        for name, row in _TABLE.items()
        for i, text in enumerate(row)
    )  # fmt: skip


def _links() -> tuple[Answer, ...]:
    robot = _robot()[0]
    return tuple(
        answer
        for i, printed in enumerate(_LINKS)
        for answer in matrix_formulas(f"T{i},{i + 1}", printed, robot.between(i, i + 1), robot.variables)
    )


def _direct() -> tuple[Answer, ...]:
    _, letters, hand = _robot()
    sign = "the sign of its last term: it is that of (1,1) with c6 turned into −s6"
    return matrix_formulas("T0,7", _T07, hand, letters, _T07_RIGHT, dict.fromkeys(_T07_RIGHT, sign))


def _jacobian() -> tuple[Answer, ...]:
    robot, letters, _ = _robot()
    row = {"2": "row 2 is printed as row 3", "5": "row 5 is printed as row 4", "6": "joint 1 turns the hand about z"}
    errata = {place: row[place[1]] for place in _J_RIGHT}
    return matrix_formulas("J", _J, robot.jacobian(), letters, _J_RIGHT, errata)


def _rates() -> tuple[Answer, ...]:
    """Dp and dφ of the wrist, then dx, dz and the point of the hand, at random rates."""
    robot, letters, _ = _robot()
    rates = np.random.default_rng(1).normal(size=robot.joints.shape)
    moved = np.einsum("nij,nj->ni", robot.jacobian(), rates)
    v = letters | {f"dq{i + 1}": rates[:, i] for i in range(6)}
    v |= {f"d{name}{axis}": moved[:, 3 * k + i] for k, name in enumerate("pφ") for i, axis in enumerate("xyz")}
    turning = np.cross(moved[:, 3:], robot.between(0, 6)[:, :3, 2])
    dx = np.cross(moved[:, 3:], robot.between(0, 6)[:, :3, 0])
    v |= {f"dz{axis}": turning[:, i] for i, axis in enumerate("xyz")}
    hand = moved[:, :3] + R7 * turning
    printed = (
        "−c1 q3 dq1 − s1 dq3", "−s1 q3 dq1 + c1 dq3", "dq2",
        "−s1 dq4 − c1 s4 dq5 + (c1 c4 s5 − s1 c5) dq6", "c1 dq4 − s1 s4 dq5 + (s1 c4 s5 + c1 c5) dq6",
        "dq1 − c4 dq5 − s4 s5 dq6",
    )  # fmt: skip
    crossed = ("dφy {0}z − dφz {0}y", "dφz {0}x − dφx {0}z", "dφx {0}y − dφy {0}x")
    names = ("dpx", "dpy", "dpz", "dφx", "dφy", "dφz")
    why = "the differential of p + r7 z is dp + r7 dz: z itself stands there"
    return (
        *(formula(name, text, moved[:, i], v) for i, (name, text) in enumerate(zip(names, printed, strict=True))),
        *(formula(f"dx{'xyz'[i]}", text.format("x"), dx[:, i], v) for i, text in enumerate(crossed)),
        *(formula(f"dz{'xyz'[i]}", text.format("z"), turning[:, i], v) for i, text in enumerate(crossed)),
        *(formula(f"d{axis} of the hand", f"dp{axis} + r7 z{axis}", hand[:, i], v, right=f"dp{axis} + r7 dz{axis}",
                  erratum=why) for i, axis in enumerate("xyz")),
    )  # fmt: skip


def _inverse() -> tuple[Answer, ...]:
    """The joints of a pose; w is the sign of sin q5, of the two roots."""
    v = _robot()[1]
    v = v | {"w": np.sign(np.sin(v["q5"]))}
    right = {
        "q2": "pz7 − r7 zz",
        "q3": "√((px7 − r7 zx)^2 + (py7 − r7 zy)^2)",
        "q1": "atan2(−(px7 − r7 zx), py7 − r7 zy)",
        "q5": "w acos(−s1 zx + c1 zy)",
        "q4": "atan2(−w zz, w (c1 zx + s1 zy))",
        "q6": "atan2(w (c1 yy − s1 yx), w (s1 xx − c1 xy))",
    }
    return tuple(formula(name, "", v[name], v, right=text) for name, text in right.items())


def _inverse_rates() -> tuple[Answer, ...]:
    """The rates of a twist of the wrist's centre; with dq1 known, dφ less it is the wrist's."""
    robot, letters, _ = _robot()
    twist = np.random.default_rng(2).normal(size=(len(robot.joints), 6))
    rates = np.asarray(np.linalg.solve(robot.jacobian(), twist[..., None])[..., 0], dtype=float)
    v = letters | {f"d{name}{axis}": twist[:, 3 * k + i] for k, name in enumerate("pφ") for i, axis in enumerate("xyz")}
    v |= {f"dq{i + 1}": rates[:, i] for i in range(6)}
    across, along = "(c1 dφx + s1 dφy)", "(dφz − dq1)"
    right = {
        "dq2": "dpz", "dq3": "−s1 dpx + c1 dpy", "dq1": "−(c1 dpx + s1 dpy)/q3",
        "dq5": f"−s4 {across} − c4 {along}", "dq6": f"(c4 {across} − s4 {along})/s5",
        "dq4": "−s1 dφx + c1 dφy − c5 dq6",
    }  # fmt: skip
    return tuple(formula(name, "", v[name], v, right=text) for name, text in right.items())


def _singular() -> tuple[Answer, ...]:
    robot, letters, _ = _robot()
    drawn = np.deg2rad([[0.0, 0, 0, -90, 0, 0]])
    drawn[0, 1:3] = 0.6
    J = robot.arm.tool(drawn, robot.values)[1][0]
    return (
        formula("det J", "", np.linalg.det(robot.jacobian()), letters, right="−q3 s5"),
        number("det J in the drawn posture, q5 = 0", "", float(np.linalg.det(J)), digits=6),
    )


_ASK = "lab kinematics versatran"
VERSATRAN_ITEMS = (
    Item("Section 8.1", "The matrix of a link, Craig's convention", _general, f"{_ASK} --symbolic"),
    Item("Section 8.2, table", "Denavit-Hartenberg table of the VERSATRAN FA", _table, "lab inspect versatran"),
    Item("Section 8.2, matrices", "Its link matrices", _links, f"{_ASK} --symbolic"),
    Item("Section 8.4", "Its direct model T0,7", _direct, f"{_ASK} --symbolic --between 0 6",
         "r7 is 0.15 m here, a representative value."),
    Item("Section 8.5, J", "Its Jacobian", _jacobian, f"{_ASK} --joints 20,700,800,30,40,50"),
    Item("Section 8.5, rates", "Its differential model", _rates,
         f"{_ASK} --joints 20,700,800,30,40,50 --rates 1,2,3,4,5,6"),
    Item("Section 8.6", "Its inverse model", _inverse, f"{_ASK} --pose=-200,700,800,30,40,50",
         "The hand's point is px7, py7, pz7. q3 is taken above zero; its other sign, which turns q1 by half a turn, is "
         "beyond the limits. w is the sign of sin q5."),
    Item("Section 8.7", "Its inverse differential model", _inverse_rates,
         f"{_ASK} --joints 20,700,800,30,40,50 --twist 10,0,0,0,0,0", "dq1 is known where dq5 and dq6 are asked."),
    Item("Section 8.2, figure", "The drawn posture", _singular, f"{_ASK} --joints 0,600,600,-90,0,0",
         "The figure draws the arm with q5 = 0, where its wrist is singular."),
)  # fmt: skip
