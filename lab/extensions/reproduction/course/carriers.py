"""Sections 7.2 to 7.4: the models of the first three joints, PRP and RRR, and Khalil's ten types of equations."""

from collections.abc import Callable
from functools import cache

import numpy as np

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.reproduction.answer import Answer, formula, holds, number
from lab.extensions.reproduction.item import Item
from lab.extensions.reproduction.models import SAMPLES, matrix_formulas
from lab.extensions.robotics.inverse.khalil_one_unknown import Roots, type_1, type_2, type_3, type_9, type_10
from lab.extensions.robotics.inverse.khalil_two_unknowns import type_4, type_5, type_6, type_7, type_8

__all__ = ["CARRIER_ITEMS"]

_STEP = 1e-30  # of the complex step: its square is nothing
_QUADRANT = "arctg(y/x) has lost the quadrant: it is half a turn off where x < 0"


def _rates(point: Callable[[Array], Array], joints: Array) -> Array:
    """The Jacobian ``(n, 3, 3)`` of a point by a complex step in each joint."""
    moved = joints[:, None, :] + 1j * _STEP * np.eye(3)
    return np.asarray(np.imag(point(moved.reshape(-1, 3))).reshape(-1, 3, 3) / _STEP).swapaxes(1, 2)


@cache
def _prp() -> tuple[dict[str, Array], Array, Array]:
    """Letters of the PRP arm at random positions, its point ``(n, 3)`` and Jacobian; L2 = 0.4."""
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
    return letters, at, _rates(point, joints)


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
    """Letters of the RRR arm at random positions, its point and Jacobian; l1, l2, l3 are 0.5, 0.4 and 0.3."""
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
    way = second * np.sin(joints[:, 1]) - third * np.sin(joints[:, 1] + joints[:, 2])
    letters |= {"x": at[:, 0], "y": at[:, 1], "z": at[:, 2], "L": way}
    return letters, at, _rates(point, joints)


def _rrr_models() -> tuple[Answer, ...]:
    v, at, J = _rrr()
    up = "l1 + l2 cos(π − q2) + l3 cos(2 π − q2 − q3)"
    along = "l2 cos(π/2 − q2) + l3 cos(q2 + q3 − 3 π/2)"
    q2 = np.arctan2(np.sin(v["q2"]), np.cos(v["q2"]))
    way = np.sign(v["L"])
    shoulder = "atan2((l2 − l3 c3) L − l3 s3 (z − l1), −l3 s3 L − (l2 − l3 c3) (z − l1))"
    return (
        formula("x", f"({along}) c1", at[:, 0], v),
        formula("y", f"({along}) s1", at[:, 1], v),
        formula("z", up, at[:, 2], v),
        formula("θ1 of x, y, z", "", v["q1"], v | {"w": way}, right="atan2(w y, w x)"),
        formula("cos θ3 of L, z", "", np.cos(v["q3"]), v, right="(l2^2 + l3^2 − L^2 − (z − l1)^2)/(2 l2 l3)"),
        formula("θ2 of L, z, θ3", "", q2, v, right=shoulder),
        formula("det J", "", np.linalg.det(J), v, right="l2 l3 s3 (l2 s2 − l3 s23)"),
    )


def _types() -> tuple[Answer, ...]:
    """Each type at random coefficients that have a solution: how many roots there are, and what they miss."""
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
