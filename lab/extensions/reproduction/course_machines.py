"""Compute the machines of Mallem 2011: the Versatran, carriers, parallel robots."""

from collections.abc import Callable
from functools import cache
from itertools import pairwise
from typing import TypeVar

import numpy as np

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.reproduction.answer import ComparedValue, formula, holds, number, unreadable, word
from lab.extensions.reproduction.item import Item
from lab.extensions.reproduction.source_models import (
    SAMPLES,
    Sampled,
    as_row,
    link_matrices,
    matrix_formulas,
    nominal_mechanism,
    sampled,
)
from lab.extensions.robotics.closed.classical_mechanisms import Delta, SharedPin, ThreeLegs, TwoLegs
from lab.extensions.robotics.closed.recognition import classical_model_of
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
from lab.kinematics.closed.closed_arm import ClosedArm
from lab.kinematics.closed.mobility import body_count

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
_J = (  # rows 2, 5 and 6 cannot be read
    "−py | 0 | −s1 | 0 | 0 | 0; | | | | | ; 0 | 1 | 0 | 0 | 0 | 0;0 | 0 | 0 | −s1 | −c1 s4 | zx; | | | | | ; | | | | | "
)
_J_RIGHT = (
    {"(2,1)": "px", "(2,2)": "0", "(2,3)": "c1", "(2,4)": "0", "(2,5)": "0", "(2,6)": "0"}
    | {"(5,1)": "0", "(5,2)": "0", "(5,3)": "0", "(5,4)": "c1", "(5,5)": "−s1 s4", "(5,6)": "zy"}
    | {"(6,1)": "1", "(6,2)": "0", "(6,3)": "0", "(6,4)": "0", "(6,5)": "−c4", "(6,6)": "zz"}
)
_CONVERTED = {
    2: "the converted text has row 3 twice, and no row 2",
    5: "the converted text has row 4 twice, and no row 5",
    6: "the converted text has five of the six entries of row 6",
}


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


def _general() -> tuple[ComparedValue, ...]:
    """Compare the matrix T_i-1,i of Craig's convention at random values."""
    alpha, a, theta, r = np.random.default_rng(0).uniform(-3, 3, (4, SAMPLES))
    printed = (
        "cos(θ) | −sin(θ) | 0 | a; cos(α) sin(θ) | cos(α) cos(θ) | −sin(α) | −r sin(α);"
        "sin(α) sin(θ) | sin(α) cos(θ) | cos(α) | r cos(α); 0 | 0 | 0 | 1"
    )
    exact = link_matrices("craig", theta, r, a, alpha)
    return matrix_formulas("T", printed, exact, {"α": alpha, "a": a, "θ": theta, "r": r})


def _table() -> tuple[ComparedValue, ...]:
    table = _robot()[0].arm.chain.table
    ours = {"α": np.rad2deg(table[:, 3]), "a": MM.of(table[:, 2])}
    return tuple(
        answer
        for name, row in _TABLE.items()
        for answer in as_row(f"{name}1 to {name}6", (
            number(f"{name}{i + 1}", text, float(ours[name][i]), "°" if name == "α" else "mm")
            for i, text in enumerate(row)
        ))
    )  # fmt: skip


def _links() -> tuple[ComparedValue, ...]:
    robot = _robot()[0]
    return tuple(
        answer
        for i, printed in enumerate(_LINKS)
        for answer in matrix_formulas(f"T{i},{i + 1}", printed, robot.between(i, i + 1), robot.variables)
    )


def _direct() -> tuple[ComparedValue, ...]:
    _, letters, hand = _robot()
    sign = "the sign of its last term: it is that of (1,1) with c6 turned into −s6"
    return matrix_formulas("T0,7", _T07, hand, letters, _T07_RIGHT, dict.fromkeys(_T07_RIGHT, sign))


def _jacobian() -> tuple[ComparedValue, ...]:
    robot, letters, _ = _robot()
    return tuple(
        unreadable(answer, _CONVERTED[answer.place[1]]) if answer.place and answer.place[1] in _CONVERTED else answer
        for answer in matrix_formulas("J", _J, robot.jacobian(), letters, _J_RIGHT)
    )


def _rates() -> tuple[ComparedValue, ...]:
    """Compare dp and dφ of the wrist, then dx, dz and a point of the hand at (a7, 0, r7), at random rates."""
    robot, letters, _ = _robot()
    reach = 0.05
    values = robot.values.copy()
    values[-3:] = reach, 0.0, _R7
    J_hand = robot.arm.tool(robot.joints, values)[1]
    rates = np.random.default_rng(1).normal(size=robot.joints.shape)
    moved = np.einsum("nij,nj->ni", robot.jacobian(), rates)
    v = letters | {f"dq{i + 1}": rates[:, i] for i in range(6)} | {"a7": np.full(len(rates), reach)}
    v |= {f"d{name}{axis}": moved[:, 3 * k + i] for k, name in enumerate("pφ") for i, axis in enumerate("xyz")}
    turning = np.cross(moved[:, 3:], robot.between(0, 6)[:, :3, 2])
    dx = np.cross(moved[:, 3:], robot.between(0, 6)[:, :3, 0])
    v |= {f"d{name}{axis}": part[:, i] for name, part in (("x", dx), ("z", turning)) for i, axis in enumerate("xyz")}
    hand = np.einsum("nij,nj->ni", J_hand[:, :3], rates)
    printed = (
        "−c1 q3 dq1 − s1 dq3", "−s1 q3 dq1 + c1 dq3", "dq2",
        "−s1 dq4 − c1 s4 dq5 + (c1 c4 s5 − s1 c5) dq6", "c1 dq4 − s1 s4 dq5 + (s1 c4 s5 + c1 c5) dq6",
        "dq1 − c4 dq5 − s4 s5 dq6",
    )  # fmt: skip
    crossed = ("dφy {0}z − dφz {0}y", "dφz {0}x − dφx {0}z", "dφx {0}y − dφy {0}x")
    names = ("dpx", "dpy", "dpz", "dφx", "dφy", "dφz")
    why = "the differential of p + a7 x + r7 z is dp + a7 dx + r7 dz: x and z themselves stand there"
    return (
        *(formula(name, text, moved[:, i], v) for i, (name, text) in enumerate(zip(names, printed, strict=True))),
        *(formula(f"dx{'xyz'[i]}", text.format("x"), dx[:, i], v) for i, text in enumerate(crossed)),
        *(formula(f"dz{'xyz'[i]}", text.format("z"), turning[:, i], v) for i, text in enumerate(crossed)),
        *(formula(f"d{axis} of the hand", f"dp{axis} + a7 x{axis} + r7 z{axis}", hand[:, i], v,
                  right=f"dp{axis} + a7 dx{axis} + r7 dz{axis}", erratum=why) for i, axis in enumerate("xyz")),
    )  # fmt: skip


def _inverse() -> tuple[ComparedValue, ...]:
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
    return tuple(
        formula(name, "", v[name], v, right=text, angle=name not in ("q2", "q3"))
        for name, text in right.items()
    )  # fmt: skip


def _inverse_rates() -> tuple[ComparedValue, ...]:
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


def _singular() -> tuple[ComparedValue, ...]:
    robot, letters, _ = _robot()
    drawn = np.deg2rad([[0.0, 0, 0, -90, 0, 0]])
    drawn[0, 1:3] = 0.6
    J = robot.arm.tool(drawn, robot.values)[1][0]
    return (
        formula("det J", "", np.linalg.det(robot.jacobian()), letters, right="−q3 s5"),
        number("det J in the drawn posture, q5 = 0", "", float(np.linalg.det(J)), right="0.000000"),
    )


_COMMAND = "lab kinematics versatran"
VERSATRAN_ITEMS = (
    Item("Section 8.1", "The matrix of a link, Craig's convention", _general, f"{_COMMAND} --symbolic"),
    Item("Section 8.2, table", "Denavit-Hartenberg table of the VERSATRAN FA", _table, "lab inspect versatran"),
    Item("Section 8.2, matrices", "Its link matrices", _links, f"{_COMMAND} --symbolic"),
    Item("Section 8.2, figure", "The drawn posture, by the J of section 8.5", _singular,
         f"{_COMMAND} --joints 0,600,600,-90,0,0",
         "The figure draws the arm with q5 = 0, where its wrist is singular."),
    Item("Section 8.4", "Its direct model T0,7", _direct, f"{_COMMAND} --symbolic --between 0 6",
         "r7 is 0.15 m here, a representative value."),
    Item("Section 8.5, J", "Its Jacobian", _jacobian, f"{_COMMAND} --joints 20,700,800,30,40,50",
         "Rows 2, 5 and 6 cannot be read in the converted text; the rates below, which follow from them, are right."),
    Item("Section 8.5, rates", "Its differential model", _rates,
         f"{_COMMAND} --joints 20,700,800,30,40,50 --rates 1,2,3,4,5,6"),
    Item("Section 8.6", "Its inverse model", _inverse, f"{_COMMAND} --pose=-200,700,800,30,40,50",
         "The hand's point is px7, py7, pz7. q3 is taken above zero; its other sign, which turns q1 by half a turn, is "
         "beyond the limits. w is the sign of sin q5."),
    Item("Section 8.7", "Its inverse differential model", _inverse_rates,
         f"{_COMMAND} --joints 20,700,800,30,40,50 --twist 10,0,0,0,0,0", "dq1 is given where dq5 and dq6 are asked."),
)  # fmt: skip


_QUADRANT = "arctg(y/x) has lost the quadrant: it is half a turn off where x < 0"


def _carrier(name: str, letters: tuple[str, ...], **lengths: float) -> tuple[dict[str, Array], Array, Array]:
    """Sample a carrier: its letters, its point ``(n, 3)`` and the point's Jacobian ``(n, 3, 3)``."""
    robot = sampled(f"carrier/{name}", at_tool=True)
    T, J = robot.arm.tool(robot.joints, robot.values)
    at = T[:, :3, 3]
    found = dict(zip(letters, robot.joints.T, strict=True))
    found |= {letter: np.full(SAMPLES, length) for letter, length in lengths.items()}
    return found | {axis: at[:, i] for i, axis in enumerate("xyz")}, at, J[:, :3]


def _prp_models() -> tuple[ComparedValue, ...]:
    v, at, J = _carrier("prp", ("T1", "q1", "T2"), L2=0.5)
    direct = ("(L2 + T2) c1", "(L2 + T2) s1", "T1")
    rows = {"(1,1)": "0", "(1,2)": "−(L2 + T2) s1", "(1,3)": "c1", "(2,1)": "0", "(2,2)": "(L2 + T2) c1",
            "(2,3)": "s1", "(3,1)": "1", "(3,2)": "0", "(3,3)": "0"}  # fmt: skip
    back = {"(1,1)": "0", "(1,2)": "0", "(1,3)": "1", "(2,1)": "−s1/(L2 + T2)", "(2,2)": "c1/(L2 + T2)",
            "(2,3)": "0", "(3,1)": "c1", "(3,2)": "s1", "(3,3)": "0"}  # fmt: skip
    return (
        *(formula("xyz"[i], text, at[:, i], v) for i, text in enumerate(direct)),
        formula("T1 of x, y, z", "z", v["T1"], v),
        formula("θ1 of x, y, z", "atan(y/x)", v["q1"], v, right="atan2(y, x)", angle=True, erratum=_QUADRANT),
        formula("T2 of x, y, z", "−L2 + y/s1", v["T2"], v),
        *matrix_formulas("J", "", J, v, rows),
        *matrix_formulas("J⁻¹", "", np.asarray(np.linalg.inv(J), dtype=float), v, back),
    )


def _rrr_models() -> tuple[ComparedValue, ...]:
    v, at, J = _carrier("rrr", ("q1", "q2", "q3"), l1=0.5, l2=0.4, l3=0.3)
    axes = np.stack([np.cos(v["q1"]), np.sin(v["q1"])], axis=1)
    v |= {"L": np.asarray((at[:, :2] * axes).sum(axis=1))}
    up = "l1 + l2 cos(π − q2) + l3 cos(2 π − q2 − q3)"
    along = "l2 cos(π/2 − q2) + l3 cos(q2 + q3 − 3 π/2)"
    q2 = np.arctan2(np.sin(v["q2"]), np.cos(v["q2"]))
    shoulder = "atan2((l2 − l3 c3) L − l3 s3 (z − l1), −l3 s3 L − (l2 − l3 c3) (z − l1))"
    return (
        formula("x", f"({along}) c1", at[:, 0], v),
        formula("y", f"({along}) s1", at[:, 1], v),
        formula("z", up, at[:, 2], v),
        formula("θ1 of x, y, z", "", v["q1"], v | {"w": np.sign(v["L"])}, right="atan2(w y, w x)", angle=True),
        formula("cos θ3 of L, z", "", np.cos(v["q3"]), v, right="(l2^2 + l3^2 − L^2 − (z − l1)^2)/(2 l2 l3)"),
        formula("θ2 of L, z, θ3", "", q2, v, right=shoulder, angle=True),
        formula("det J", "", np.linalg.det(J), v, right="l2 l3 s3 (l2 s2 − l3 s23)"),
    )


def _types() -> tuple[ComparedValue, ...]:
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


def _type(kind: int, roots: Roots, miss: Callable[..., Array]) -> tuple[ComparedValue, ...]:
    values = [
        np.broadcast_to(value, (max(len(each) for each in roots.values), value.shape[1])) for value in roots.values
    ]
    missed = max(float(np.abs(miss(*(value[i] for value in values))).max()) for i in range(len(values[0])))
    count = number(f"type {kind}, roots", "", len(values[0]), right="1" if kind in (1, 3) else "2")
    return as_row(f"type {kind}: roots, each holds", (count, holds(f"type {kind}, every root", missed)))


CARRIER_ITEMS = (
    Item("Section 7.2", "The PRP arm: direct, inverse and differential models", _prp_models,
         "lab kinematics carrier/prp --symbolic --between 0 3", "L2 is 0.5 m, a representative value."),
    Item("Section 7.3", "The RRR arm: direct and inverse models", _rrr_models,
         "lab kinematics carrier/rrr --symbolic --between 0 3",
         "L is the distance of the point from axis 1, with a sign; w is that sign. θ3 has two roots."),
    Item("Section 7.4", "The ten types of equations", _types,
         note="How many roots each type has, and what they miss at 2,000 random coefficients. The solutions are those "
         "of Khalil and Dombre 2002, table 4.1, which the lab's closed forms are made of."),
)  # fmt: skip


@cache
def _assembled(name: str) -> tuple[Array, Array]:
    """Sample a mechanism: joint positions, and poses ``(n, 4, 4)`` of its platform that close its loops."""
    arm = ClosedArm(nominal_mechanism(name), ("p1",))
    joints = arm.chain.random_joints(SAMPLES, rng_for(0, "structure"))
    return joints, arm.platforms(joints, arm.nominal())


_Closed = TypeVar("_Closed", TwoLegs, ThreeLegs, Delta)


def _classical(name: str, kind: type[_Closed]) -> _Closed | None:
    """Return the closed form that the lab recognises in a mechanism; None if it is of another kind."""
    found = classical_model_of(nominal_mechanism(name))
    return found.model if found is not None and isinstance(found.model, kind) else None


def _two_legs() -> tuple[ComparedValue, ...]:
    rho, Ts = _assembled("rpr2")
    legs, points = _classical("rpr2", TwoLegs), Ts[:, :2, 3]
    v = {"x": points[:, 0], "y": points[:, 1], "ρ1": rho[:, 0], "ρ2": rho[:, 1], "L": np.full(SAMPLES, 0.6)}
    A, B, numeric, product = np.nan * np.ones((4, SAMPLES, 2, 2))
    if legs is not None:
        A, B = legs.matrices(points)
        numeric = np.stack([(legs.direct(legs.inverse(points) + step)[:, 0]
                             - legs.direct(legs.inverse(points) - step)[:, 0]) / 2e-6
                            for step in 1e-6 * np.eye(2)], axis=2)  # fmt: skip
        product = np.prod(legs.inverse(np.array([[1e-9, 0.0]])), axis=1)
    J, serial = -np.linalg.solve(A, B), float(np.abs(product).max())
    either = "ρ1 = 0 or ρ2 = 0"
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
        word("serial singularity", "ρ1 = ρ2 = 0", either if serial < 1e-6 else "neither", right=either,
             erratum=f"one leg is enough: at ρ1 = 0, ρ2 = L det J is {serial / 0.6:.1g} m / y; both cannot be zero"),
    )  # fmt: skip


def _three_legs() -> tuple[ComparedValue, ...]:
    """Compare the inverse model in the course's frame, and poses with the legs' lines in a point or parallel."""
    rho, Ts = _assembled("rpr3")
    robot, turn = _classical("rpr3", ThreeLegs), np.arctan2(Ts[:, 1, 0], Ts[:, 0, 0])
    base = np.array([[-0.433013, -0.25], [0.433013, -0.25], [0.0, 0.5]])
    first, second, third = np.array([[0.0, -0.12], [0.103923, 0.06], [-0.103923, 0.06]])
    tilt = float(np.arctan2(*(second - first)[::-1]))  # of the side B1 B2, from which the course counts φ
    pin = Ts[:, :2, 3] + np.stack([-first[1] * np.sin(turn), first[1] * np.cos(turn)], axis=1)
    x, y = (pin - base[0]).T
    fixed = {
        "c2": base[1, 0] - base[0, 0], "c3": base[2, 0] - base[0, 0], "d3": base[2, 1] - base[0, 1],
        "l2": np.linalg.norm(second - first), "l3": np.linalg.norm(third - first),
        "θ": np.arctan2(*(third - first)[::-1]) - tilt,
    }  # fmt: skip
    v = {"x": x, "y": y, "φ": turn + tilt} | {name: np.full(SAMPLES, value) for name, value in fixed.items()}
    meeting = middle = np.full(1, np.nan)
    if robot is not None:
        meeting = robot.distances(_meeting(robot)).parallel
        middle = robot.distances(np.zeros((1, 3))).parallel
    return (
        formula("ρ1²", "x^2 + y^2", rho[:, 0] ** 2, v),
        formula("ρ2²", "(x + l2 cos(φ) − c2)^2 + (y + l2 sin(φ))^2", rho[:, 1] ** 2, v),
        formula("ρ3²", "(x + l3 cos(φ + θ) − c3)^2 + (y + l3 sin(φ + θ) − d3)^2", rho[:, 2] ** 2, v),
        holds("the legs' lines in one point: singular", float(np.abs(meeting).max()), within=1e-6),
        number("distance from singular with the platform in the middle", "", float(middle[0]), digits=4),
        *(
            number(f"mobility of the {kind}", "3", body_count(nominal_mechanism(name).tree).mobility)
            for kind, name in (("3-RPR", "rpr3"), ("3-PRR", "prr3"), ("3-RRR", "rrr3"))
        ),
    )  # fmt: skip


def _meeting(robot: ThreeLegs) -> Array:
    """Return a pose ``(1, 3)`` where the lines of the legs meet, by bisection over the platform's turn."""

    def twisted(phi: float) -> float:
        return float(np.linalg.det(robot.matrices(np.array([[0.05, 0.02, phi]]))[0])[0])

    turns = np.linspace(-2.0, 2.0, 81).tolist()
    low, high = next(((a, b) for a, b in pairwise(turns) if twisted(a) * twisted(b) < 0), (0.0, 0.0))
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if twisted(low) * twisted(middle) > 0 else (low, middle)
    return np.array([[0.05, 0.02, (low + high) / 2]])


_PUBLISHED = {  # Williams 2016, of the model delta: the joints of a place, °
    (0.0, 0.0, -0.9): ("-20.547", "-20.547", "-20.547"),
    (0.3, 0.5, -1.1): ("47.504", "-11.569", "21.378"),
}


def _delta() -> tuple[ComparedValue, ...]:
    """Compare the count of the Delta with six rods, and the closed form of the IRB 340 with its solved closures."""
    count, fourth = (body_count(nominal_mechanism(f"delta/{name}").tree) for name in ("six_rods", "irb340"))
    joints, Ts = _assembled("delta/irb340")
    places = Ts[:, :3, 3]
    robot, published = _classical("delta/irb340", Delta), _classical("delta", Delta)
    back = forth = np.nan
    if robot is not None:
        back = float(np.abs(robot.direct(joints[:, :3])[:, 0] - places).max())
        forth = float(np.abs(robot.inverse(places) - joints[:, None, :3]).max(axis=2).min(axis=1).max())
    ours = np.full((len(_PUBLISHED), 3), np.nan)
    if published is not None:
        ours = np.rad2deg(published.inverse(np.array(list(_PUBLISHED)))[:, 0])
    return (
        number("bodies that move", "10", count.bodies),
        number("joints", "15", len(count.freedoms)),
        number("freedoms of the joints", "39", sum(count.freedoms)),
        number("internal freedoms, rods about themselves", "6", count.internal),
        number("mobility", "3", count.mobility),
        number("mobility with the fourth axis (section 11.6)", "4", fourth.mobility),
        holds("section 11.6: the direct model places the platform as its closures do", back),
        holds("section 11.6: the inverse model returns the joints", forth),
        *(
            answer
            for place, row, found in zip(_PUBLISHED, _PUBLISHED.values(), ours, strict=True)
            for answer in _angles(", ".join(f"{part:g}" for part in place), row, found)
        ),
    )  # fmt: skip


def _angles(place: str, row: tuple[str, ...], found: Array) -> tuple[ComparedValue, ...]:
    """Compare the motors' angles of one place (m)."""
    return as_row(f"θ1, θ2, θ3 at ({place}) m", (
        number(f"section 11.6: θ{k + 1} of ({place}) m, the larger Delta", "", float(found[k]), "°",
               right=text.replace("-", "−"))
        for k, text in enumerate(row)
    ))  # fmt: skip


def _shared_pin() -> tuple[ComparedValue, ...]:
    """Compare exercise 11.5 with representative anchors, as the figure cannot be read: E ends the bar A1 A2."""
    bar, base = 0.4, np.array([[0.0, 0.0], [1.2, 0.1], [0.2, 0.9]])
    lengths, Ts = _assembled("rpr3/shared_pin")
    theta = np.arctan2(Ts[:, 1, 0], Ts[:, 0, 0])
    poses = np.column_stack([Ts[:, :2, 3] - bar * np.stack([np.cos(theta), np.sin(theta)], axis=1), theta])
    robot = SharedPin(base, bar)
    ends = {"X": Ts[:, 0, 3], "Y": Ts[:, 1, 3], "θ": theta, "L": np.full(SAMPLES, bar)}
    v = ends | {f"{name}{i + 1}": np.full(SAMPLES, base[i, k]) for i in range(3) for k, name in enumerate("ab")}
    A, _ = robot.legs.matrices(poses)
    modes = np.isfinite(robot.direct(lengths)[..., 0]).sum(axis=1)
    found = np.nanmin(np.abs(robot.direct(lengths) - poses[:, None]).max(axis=2), axis=1)
    near, far = "(X − L cos(θ) − a{0})^2 + (Y − L sin(θ) − b{0})^2", "(X − a2)^2 + (Y − b2)^2"
    return (
        formula("q1²", "", lengths[:, 0] ** 2, v, right=near.format(1)),
        formula("q2²", "", lengths[:, 1] ** 2, v, right=far),
        formula("q3²", "", lengths[:, 2] ** 2, v, right=near.format(3)),
        number("assembly modes at most", "", int(modes.max()), right="4"),
        holds("the direct model finds the pose among its modes", float(found.max()), within=1e-8),
        holds("det A = −L (u1 × u3)(e × u2)", float(np.abs(robot.determinant(poses) - np.linalg.det(A)).max())),
        *matrix_formulas("T0,E", "", Ts[:, :3], v, {"(1,1)": "cos(θ)", "(1,2)": "−sin(θ)", "(1,3)": "0", "(1,4)": "X",
                                                    "(2,1)": "sin(θ)", "(2,2)": "cos(θ)", "(2,3)": "0", "(2,4)": "Y",
                                                    "(3,1)": "0", "(3,2)": "0", "(3,3)": "1", "(3,4)": "0"}),
    )  # fmt: skip


PARALLEL_ITEMS = (
    Item("Section 11.3.1", "The 2-RPR", _two_legs, "lab inspect rpr2", "L is 0.6 m."),
    Item("Sections 11.3, 11.3.2", "The 3-RPR and its like", _three_legs, "lab inspect rpr3",
         "φ counts from the side B1 B2 of the platform."),
    Item("Sections 11.4.4, 11.6", "The Delta: mobility, and the IRB 340's four axes", _delta,
         "lab inspect delta/irb340",
         "Counted is the model delta/six_rods. Each rod turns about itself between two ball joints, which moves no "
         "other body."),
    Item("Section 11.5", "A 3-RPR whose legs 1 and 3 share a pin", _shared_pin,
         "lab kinematics rpr3/shared_pin --pose 750,600,0,0,0,40",
         "The anchors B1, B2, B3 are (a1, b1), (a2, b2), (a3, b3); their values are representative."),
)  # fmt: skip
