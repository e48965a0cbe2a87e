"""Compute the machines of Mallem 2011: the Versatran, carriers, parallel robots."""

from collections.abc import Callable
from functools import cache
from itertools import pairwise

import numpy as np

from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.reproduction.answer import Answer, formula, holds, number, word
from lab.extensions.reproduction.item import Item
from lab.extensions.reproduction.models import SAMPLES, Sampled, matrix_formulas, sampled
from lab.extensions.robotics.closed.models import Delta, SharedPin, ThreeLegs, TwoLegs
from lab.extensions.robotics.inverse.khalil_equations import (
    Roots,
    type_1,
    type_2,
    type_3,
    type_4,
    type_5,
    type_6,
    type_7,
    type_8,
    type_9,
    type_10,
)
from lab.kinematics.closed.mobility import mobility

__all__ = ["CARRIER_ITEMS", "PARALLEL_ITEMS", "VERSATRAN_ITEMS"]

_R7 = 0.15  # the course's tool, along the last axis, m: representative
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
    """Sample the arm at random positions with both bends of the wrist, its letters, and T0,7."""
    robot = sampled("versatran")
    T = robot.between(0, 6)
    tool = np.eye(4)
    tool[2, 3] = _R7
    hand = T @ tool
    p, x, y, z = T[:, :3, 3], T[:, :3, 0], T[:, :3, 1], T[:, :3, 2]
    names = {f"{letter}{axis}": column[:, i] for letter, column in (("p", p), ("x", x), ("y", y), ("z", z))
             for i, axis in enumerate("xyz")}  # fmt: skip
    place = {"px7": hand[:, 0, 3], "py7": hand[:, 1, 3], "pz7": hand[:, 2, 3]}
    return robot, {**robot.variables, **names, **place, "r7": np.full(len(T), _R7)}, hand


def _general() -> tuple[Answer, ...]:
    """Compare the matrix T_i-1,i of Craig's convention at random values."""
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
    """Compare dp and dφ of the wrist, then dx, dz and the point of the hand, at random rates."""
    robot, letters, _ = _robot()
    rates = np.random.default_rng(1).normal(size=robot.joints.shape)
    moved = np.einsum("nij,nj->ni", robot.jacobian(), rates)
    v = letters | {f"dq{i + 1}": rates[:, i] for i in range(6)}
    v |= {f"d{name}{axis}": moved[:, 3 * k + i] for k, name in enumerate("pφ") for i, axis in enumerate("xyz")}
    turning = np.cross(moved[:, 3:], robot.between(0, 6)[:, :3, 2])
    dx = np.cross(moved[:, 3:], robot.between(0, 6)[:, :3, 0])
    v |= {f"dz{axis}": turning[:, i] for i, axis in enumerate("xyz")}
    hand = moved[:, :3] + _R7 * turning
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
    """Compare the joints of a pose; w is the sign of sin q5, of the two roots."""
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
    """Compare the rates of a twist of the wrist's centre; with dq1 given, dφ less it is the wrist's."""
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


_COMMAND = "lab kinematics versatran"
VERSATRAN_ITEMS = (
    Item("Section 8.1", "The matrix of a link, Craig's convention", _general, f"{_COMMAND} --symbolic"),
    Item("Section 8.2, table", "Denavit-Hartenberg table of the VERSATRAN FA", _table, "lab inspect versatran"),
    Item("Section 8.2, matrices", "Its link matrices", _links, f"{_COMMAND} --symbolic"),
    Item("Section 8.4", "Its direct model T0,7", _direct, f"{_COMMAND} --symbolic --between 0 6",
         "r7 is 0.15 m here, a representative value."),
    Item("Section 8.5, J", "Its Jacobian", _jacobian, f"{_COMMAND} --joints 20,700,800,30,40,50"),
    Item("Section 8.5, rates", "Its differential model", _rates,
         f"{_COMMAND} --joints 20,700,800,30,40,50 --rates 1,2,3,4,5,6"),
    Item("Section 8.6", "Its inverse model", _inverse, f"{_COMMAND} --pose=-200,700,800,30,40,50",
         "The hand's point is px7, py7, pz7. q3 is taken above zero; its other sign, which turns q1 by half a turn, is "
         "beyond the limits. w is the sign of sin q5."),
    Item("Section 8.7", "Its inverse differential model", _inverse_rates,
         f"{_COMMAND} --joints 20,700,800,30,40,50 --twist 10,0,0,0,0,0", "dq1 is known where dq5 and dq6 are asked."),
    Item("Section 8.2, figure", "The drawn posture", _singular, f"{_COMMAND} --joints 0,600,600,-90,0,0",
         "The figure draws the arm with q5 = 0, where its wrist is singular."),
)  # fmt: skip


_STEP = 1e-30  # of the complex step: its square is negligible
_QUADRANT = "arctg(y/x) has lost the quadrant: it is half a turn off where x < 0"


def _numeric_rates(point: Callable[[Array], Array], joints: Array) -> Array:
    """Return the Jacobian ``(n, 3, 3)`` of a point by a complex step in each joint."""
    moved = joints[:, None, :] + 1j * _STEP * np.eye(3)
    return np.asarray(np.imag(point(moved.reshape(-1, 3))).reshape(-1, 3, 3) / _STEP).swapaxes(1, 2)


@cache
def _prp() -> tuple[dict[str, Array], Array, Array]:
    """Sample the PRP arm: its letters, its point ``(n, 3)`` and Jacobian; L2 = 0.4."""
    rng, fixed = rng_for(0, "arm"), 0.4
    joints = rng.uniform([0.1, -3.0, 0.1], [1.0, 3.0, 1.0], (SAMPLES, 3))

    def point(q: Array) -> Array:
        reach = fixed + q[:, 2]
        return np.stack([reach * np.cos(q[:, 1]), reach * np.sin(q[:, 1]), q[:, 0]], axis=1)

    at = point(joints)
    letters = {
        "T1": joints[:, 0], "T2": joints[:, 2], "L2": np.full(SAMPLES, fixed), "q1": joints[:, 1],
        "x": at[:, 0], "y": at[:, 1], "z": at[:, 2],
    }  # fmt: skip
    return letters, at, _numeric_rates(point, joints)


def _prp_models() -> tuple[Answer, ...]:
    v, at, J = _prp()
    direct = ("(L2 + T2) c1", "(L2 + T2) s1", "T1")
    rows = {"(1,1)": "0", "(1,2)": "−(L2 + T2) s1", "(1,3)": "c1", "(2,1)": "0", "(2,2)": "(L2 + T2) c1",
            "(2,3)": "s1", "(3,1)": "1", "(3,2)": "0", "(3,3)": "0"}  # fmt: skip
    back = {"(1,1)": "0", "(1,2)": "0", "(1,3)": "1", "(2,1)": "−s1/(L2 + T2)", "(2,2)": "c1/(L2 + T2)",
            "(2,3)": "0", "(3,1)": "c1", "(3,2)": "s1", "(3,3)": "0"}  # fmt: skip
    return (
        *(formula("xyz"[i], text, at[:, i], v) for i, text in enumerate(direct)),
        formula("T1 of x, y, z", "z", v["T1"], v),
        formula("θ1 of x, y, z", "atan(y/x)", v["q1"], v, right="atan2(y, x)", erratum=_QUADRANT),
        formula("T2 of x, y, z", "−L2 + y/s1", v["T2"], v),
        *matrix_formulas("J", "", J, v, rows),
        *matrix_formulas("J⁻¹", "", np.asarray(np.linalg.inv(J), dtype=float), v, back),
    )


@cache
def _rrr() -> tuple[dict[str, Array], Array, Array]:
    """Sample the RRR arm: its letters, its point and Jacobian; l1, l2, l3 are 0.5, 0.4 and 0.3."""
    first, second, third = 0.5, 0.4, 0.3
    joints = rng_for(0, "arm").uniform([-3.0, 0.4, 0.4], [3.0, 1.6, 2.6], (SAMPLES, 3))

    def point(q: Array) -> Array:
        along = second * np.cos(np.pi / 2 - q[:, 1]) + third * np.cos(q[:, 1] + q[:, 2] - 3 * np.pi / 2)
        up = first + second * np.cos(np.pi - q[:, 1]) + third * np.cos(2 * np.pi - q[:, 1] - q[:, 2])
        return np.stack([along * np.cos(q[:, 0]), along * np.sin(q[:, 0]), up], axis=1)

    at, lengths = point(joints), (first, second, third)
    letters = {f"q{i + 1}": joints[:, i] for i in range(3)} | {
        f"l{i + 1}": np.full(SAMPLES, length) for i, length in enumerate(lengths)
    }
    distance = second * np.sin(joints[:, 1]) - third * np.sin(joints[:, 1] + joints[:, 2])
    letters |= {"x": at[:, 0], "y": at[:, 1], "z": at[:, 2], "L": distance}
    return letters, at, _numeric_rates(point, joints)


def _rrr_models() -> tuple[Answer, ...]:
    v, at, J = _rrr()
    up = "l1 + l2 cos(π − q2) + l3 cos(2 π − q2 − q3)"
    along = "l2 cos(π/2 − q2) + l3 cos(q2 + q3 − 3 π/2)"
    q2 = np.arctan2(np.sin(v["q2"]), np.cos(v["q2"]))
    shoulder = "atan2((l2 − l3 c3) L − l3 s3 (z − l1), −l3 s3 L − (l2 − l3 c3) (z − l1))"
    return (
        formula("x", f"({along}) c1", at[:, 0], v),
        formula("y", f"({along}) s1", at[:, 1], v),
        formula("z", up, at[:, 2], v),
        formula("θ1 of x, y, z", "", v["q1"], v | {"w": np.sign(v["L"])}, right="atan2(w y, w x)"),
        formula("cos θ3 of L, z", "", np.cos(v["q3"]), v, right="(l2^2 + l3^2 − L^2 − (z − l1)^2)/(2 l2 l3)"),
        formula("θ2 of L, z, θ3", "", q2, v, right=shoulder),
        formula("det J", "", np.linalg.det(J), v, right="l2 l3 s3 (l2 s2 − l3 s23)"),
    )


def _types() -> tuple[Answer, ...]:
    """Solve each equation type at random coefficients that have a solution: number of roots, and their residuals."""
    rng = rng_for(0, "arm")
    a, b, c, d, e, f = rng.uniform(0.3, 1.5, (6, 2000))
    t, u, r = rng.uniform(-3, 3, (3, 2000))
    s, k = np.sin, np.cos
    found: dict[int, tuple[Roots, Callable[..., Array]]] = {
        1: (type_1(a, a * r), lambda x: a * x - a * r),
        2: (type_2(a, b, a * s(t) + b * k(t)), lambda x: a * s(x) + b * k(x) - a * s(t) - b * k(t)),
        3: (type_3(a, a * s(t), b, b * k(t)), lambda x: a * s(x) - a * s(t) + 1j * (b * k(x) - b * k(t))),
        4: (type_4(a, a * r * s(t), b, b * r * k(t)),
            lambda y, x: a * y * s(x) - a * r * s(t) + 1j * (b * y * k(x) - b * r * k(t))),
        5: (type_5(a, a * s(t) - c * r, c, b, b * k(t) - d * r, d),
            lambda y, x: a * (s(x) - s(t)) - c * (y - r) + 1j * (b * (k(x) - k(t)) - d * (y - r))),
    }  # fmt: skip
    z1, z2 = e * s(u) - a * k(t) - b * s(t), e * k(u) - a * s(t) + b * k(t)
    found[6] = (type_6(e, a, b, z1, z2), lambda i, j: e * s(j) - a * k(i) - b * s(i) - z1
                + 1j * (e * k(j) - a * s(i) + b * k(i) - z2))  # fmt: skip
    y1, y2 = e * k(u) + f * s(u) - a * k(t) - b * s(t), e * s(u) - f * k(u) - a * s(t) + b * k(t)
    found[7] = (type_7(e, f, a, b, y1, y2), lambda i, j: e * k(j) + f * s(j) - a * k(i) - b * s(i) - y1
                + 1j * (e * s(j) - f * k(j) - a * s(i) + b * k(i) - y2))  # fmt: skip
    p, q = 0.7, 0.5
    w1, w2 = p * k(t) + q * k(t + u), p * s(t) + q * s(t + u)
    found[8] = (type_8(p, q, w1, w2), lambda i, j: p * k(i) + q * k(i + j) - w1
                + 1j * (p * s(i) + q * s(i + j) - w2))  # fmt: skip
    found[9] = (type_9(a, a * k(t)), lambda x: a * (k(x) - k(t)))
    found[10] = (type_10(a, a * s(t)), lambda x: a * (s(x) - s(t)))
    return tuple(answer for kind, (roots, miss) in found.items() for answer in _type(kind, roots, miss))


def _type(kind: int, roots: Roots, miss: Callable[..., Array]) -> tuple[Answer, Answer]:
    values = [
        np.broadcast_to(value, (max(len(each) for each in roots.values), value.shape[1])) for value in roots.values
    ]
    missed = max(float(np.abs(miss(*(value[i] for value in values))).max()) for i in range(len(values[0])))
    return number(f"type {kind}, roots", "", len(values[0]), digits=0), holds(f"type {kind}, every root", missed)


CARRIER_ITEMS = (
    Item("Section 7.2", "The PRP arm: direct, inverse and differential models", _prp_models,
         note="lab kinematics TABLE.toml --pose X,Y,Z has all solutions of such an arm, given as a table."),
    Item("Section 7.3", "The RRR arm: direct and inverse models", _rrr_models,
         note="L is the distance of the point from axis 1, with a sign; w is that sign. θ3 has two roots."),
    Item("Section 7.4", "The ten types of equations", _types,
         note="How many roots each type has, and what they miss at 2,000 random coefficients. The solutions are those "
         "of Khalil and Dombre 2002, table 4.1, which the lab's closed forms are made of."),
)  # fmt: skip


_SPAN = 0.8  # L of the 2-RPR, m


@cache
def _two() -> tuple[TwoLegs, Array, dict[str, Array]]:
    legs, points = TwoLegs(_SPAN), rng_for(0, "arm").uniform([-0.5, 0.1], [1.3, 1.0], (SAMPLES, 2))
    rho = legs.inverse(points)
    letters = {"x": points[:, 0], "y": points[:, 1], "ρ1": rho[:, 0], "ρ2": rho[:, 1], "L": np.full(SAMPLES, _SPAN)}
    return legs, points, letters


def _two_legs() -> tuple[Answer, ...]:
    legs, points, v = _two()
    A, B = legs.matrices(points)
    J = -np.linalg.solve(A, B)
    step = 1e-6
    numeric = np.stack([(legs.direct(legs.inverse(points) + step * unit)[:, 0]
                         - legs.direct(legs.inverse(points) - step * unit)[:, 0]) / (2 * step)
                        for unit in np.eye(2)], axis=2)  # fmt: skip
    one_leg = np.array([[1e-9, 0.0]])
    serial = float(np.abs(np.prod(legs.inverse(one_leg), axis=1))[0])
    return (
        formula("ρ1²", "x^2 + y^2", v["ρ1"] ** 2, v),
        formula("ρ2²", "(x − L)^2 + y^2", v["ρ2"] ** 2, v),
        formula("X", "(ρ1^2 − ρ2^2 + L^2)/(2 L)", v["x"], v),
        formula("Y", "√(ρ1^2 − ((ρ1^2 − ρ2^2 + L^2)/(2 L))^2)", v["y"], v),
        *matrix_formulas("A", "2 x | 2 y; 2 x − 2 L | 2 y", A, v),
        *matrix_formulas("B", "−2 ρ1 | 0; 0 | −2 ρ2", B, v),
        holds("dX = A⁻¹ B dq", float(np.abs(np.linalg.solve(A, B) - numeric).max()), within=1e-6,
              erratum="the minus is lost: A dX + B dq = 0 gives dX = −A⁻¹ B dq"),
        formula("det J", "ρ1 ρ2/(L y)", np.linalg.det(J), v),
        word("serial singularity", "ρ1 = ρ2 = 0", "ρ1 = 0 or ρ2 = 0",
             erratum=f"one leg is enough: at ρ1 = 0, ρ2 = L det J is {serial / _SPAN:.1g} m / y; both cannot be zero"),
    )  # fmt: skip


def _three_legs() -> tuple[Answer, ...]:
    """Compare the inverse model in the course's frame, and poses with the legs' lines in a point or parallel."""
    c2, c3, d3, l2, l3, theta = 1.0, 0.3, 0.9, 0.25, 0.3, 0.9
    base = np.array([[0.0, 0], [c2, 0], [c3, d3]])
    platform = np.array([[0.0, 0], [l2, 0], [l3 * np.cos(theta), l3 * np.sin(theta)]])
    robot = ThreeLegs(base, platform)
    poses = rng_for(0, "arm").uniform([0.2, 0.2, -1.0], [0.6, 0.6, 1.0], (SAMPLES, 3))
    x, y, phi = poses.T
    fixed = {"c2": c2, "c3": c3, "d3": d3, "l2": l2, "l3": l3, "θ": theta}
    v = {"x": x, "y": y, "φ": phi} | {name: np.full(SAMPLES, value) for name, value in fixed.items()}
    squared = robot.inverse(poses) ** 2
    meeting = robot.distances(_meeting(robot)).parallel
    parallel = robot.distances(np.array([[0.4, 0.4, 0.0]])).parallel
    return (
        formula("ρ1²", "x^2 + y^2", squared[:, 0], v),
        formula("ρ2²", "(x + l2 cos(φ) − c2)^2 + (y + l2 sin(φ))^2", squared[:, 1], v),
        formula("ρ3²", "(x + l3 cos(φ + θ) − c3)^2 + (y + l3 sin(φ + θ) − d3)^2", squared[:, 2], v),
        holds("the legs' lines in one point: singular", float(np.abs(meeting).max()), within=1e-6),
        number("distance from singular at a usual pose", "", float(parallel[0]), digits=4),
        *(
            number(f"mobility of the {name}", "3", mobility(8, [1] * 9, planar=True))
            for name in ("3-RPR", "3-PRR", "3-RRR")
        ),
    )


def _meeting(robot: ThreeLegs) -> Array:
    """Return a pose ``(1, 3)`` where the lines of the legs meet, by bisection over the platform's turn."""

    def twisted(phi: float) -> float:
        return float(np.linalg.det(robot.matrices(np.array([[0.4, 0.4, phi]]))[0])[0])

    low, high = next((a, b) for a, b in pairwise(np.linspace(-2.0, 2.0, 81).tolist()) if twisted(a) * twisted(b) < 0)
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if twisted(low) * twisted(middle) > 0 else (low, middle)
    return np.array([[0.4, 0.4, (low + high) / 2]])


def _delta() -> tuple[Answer, ...]:
    """Compare Grübler's count, and the closed forms against each other for the IRB 340's four axes."""
    joints = [1] * 3 + [3] * 12
    robot = Delta.of_triangles(0.567, 0.076, 0.524, 1.244)
    points = rng_for(0, "arm").uniform([-0.3, -0.3, -1.2], [0.3, 0.3, -0.8], (SAMPLES, 3))
    q = robot.inverse(points)[:, 0]
    back = float(np.abs(robot.direct(q)[:, 0] - points).max())
    return (
        number("bodies that move", "10", 3 + 6 + 1, digits=0),
        number("joints", "15", len(joints)),
        number("freedoms of the joints", "39", sum(joints)),
        number("internal freedoms, rods about themselves", "6", 6),
        number("mobility", "3", mobility(11, joints) - 6),
        number("mobility with the fourth axis (section 11.6)", "4", mobility(11, joints) - 6 + 1),
        holds("section 11.6: the direct model of the inverse one", back),
    )


def _shared_pin() -> tuple[Answer, ...]:
    """Compare exercise 11.5 with random anchors, as the figure is unreadable: E ends the bar A1 A2 of length L."""
    bar, base = 0.4, np.array([[0.0, 0.0], [1.2, 0.1], [0.2, 0.9]])
    robot = SharedPin(base, bar)
    poses = rng_for(0, "arm").uniform([0.2, 0.2, 0.1], [0.8, 0.7, 1.4], (SAMPLES, 3))
    x, y, theta = poses.T
    lengths = robot.legs.inverse(poses)
    ends = {"X": x + bar * np.cos(theta), "Y": y + bar * np.sin(theta), "θ": theta, "L": np.full(SAMPLES, bar)}
    v = ends | {f"{name}{i + 1}": np.full(SAMPLES, base[i, k]) for i in range(3) for k, name in enumerate("ab")}
    A, _ = robot.legs.matrices(poses)
    modes = np.isfinite(robot.direct(lengths)[..., 0]).sum(axis=1)
    found = np.nanmin(np.abs(robot.direct(lengths) - poses[:, None]).max(axis=2), axis=1)
    near, far = "(X − L cos(θ) − a{0})^2 + (Y − L sin(θ) − b{0})^2", "(X − a2)^2 + (Y − b2)^2"
    return (
        formula("q1²", "", lengths[:, 0] ** 2, v, right=near.format(1)),
        formula("q2²", "", lengths[:, 1] ** 2, v, right=far),
        formula("q3²", "", lengths[:, 2] ** 2, v, right=near.format(3)),
        number("assembly modes at most", "", int(modes.max()), digits=0),
        holds("the direct model finds the pose among its modes", float(found.max()), within=1e-8),
        holds("det A = −L (u1 × u3)(e × u2)", float(np.abs(robot.determinant(poses) - np.linalg.det(A)).max())),
    )


PARALLEL_ITEMS = (
    Item("Section 11.3.1", "The 2-RPR", _two_legs, "lab inspect rpr2", "L is 0.8 m."),
    Item("Sections 11.3, 11.3.2", "The 3-RPR and its like", _three_legs, "lab inspect rpr3"),
    Item("Sections 11.4.4, 11.6", "The Delta: mobility, and the IRB 340's four axes", _delta, "lab inspect delta",
         "Each rod turns about itself between two ball joints, which moves nothing else."),
    Item("Section 11.5", "A 3-RPR whose legs 1 and 3 share a pin", _shared_pin,
         note="The lab has this robot's closed form as a library (SharedPin), and no model of it that a command reads. "
         "The anchors B1, B2, B3 are (a1, b1), (a2, b2), (a3, b3)."),
)  # fmt: skip
