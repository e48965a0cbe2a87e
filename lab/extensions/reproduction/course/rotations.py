"""The annex: direction cosines, roll, pitch and yaw, and the vector of rotation (A3.1 to A3.11)."""

from functools import cache

import numpy as np

from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.reproduction.answer import Answer, formula, holds, number
from lab.extensions.reproduction.item import Item
from lab.extensions.reproduction.models import SAMPLES, matrix_formulas

__all__ = ["ROTATION_ITEMS"]

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
    """How many of the nine cosines are independent: the rank of their derivatives by the rotation."""
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
    """Axes, angles in (0, π), rotations, and the letters of A3.4 to A3.11."""
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


ROTATION_ITEMS = (
    Item("Annex, A3.1", "Direction cosines", _cosines, note="lab.core.se3 has the rotations of the annex, each way."),
    Item("Annex, A3.2", "Roll, pitch and yaw", _roll_pitch_yaw, "lab kinematics irb120 --joints 0,0,0,0,0,0",
         "Poses are printed with these three angles."),
    Item("Annex, A3.3 to A3.6, figure A3.1", "Vector of rotation", _rotation_vector,
         note="The figure's two turns are A3.3 and A3.4."),
    Item("Annex, A3.7 to A3.11", "Axis and angle of a rotation", _inverse,
         note="The lab takes the quaternion with the largest pivot, which is right at every angle."),
)  # fmt: skip
