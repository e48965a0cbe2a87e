"""Sections 6.2 and 7.1, and the recalls of the annex: mobility and redundancy, coordinates, products."""

import numpy as np

from lab.campaign.robot import load_robot
from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.reproduction.answer import Answer, holds, word
from lab.extensions.reproduction.item import Item
from lab.extensions.reproduction.models import SAMPLES
from lab.kinematics.differential import rates
from lab.kinematics.mobility import mobility_of
from lab.kinematics.serial.arm import SerialArm

__all__ = ["BASIC_ITEMS"]

_ARMS = ("versatran", "scemi", "scara", "planar3r")


def _rank(robot: str, joints_deg: tuple[float, ...]) -> int:
    """Of an arm's Jacobian at joint positions."""
    chain = load_robot(robot).serial_model.chain
    arm = SerialArm(chain)
    jacobian = arm.tool(np.deg2rad([joints_deg]), arm.nominal())[1]
    return int(rates(jacobian, np.zeros((1, 6))).rank[0])


def _redundancy() -> tuple[Answer, ...]:
    """IL <= IM, an arm that is redundant everywhere, and one that is at singularities; the course draws its own."""
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
    """Polar and cylindrical coordinates of points, there and back."""
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
    """Consecutive transformations in current and in fixed frames, and the matrix of a vector product."""
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


BASIC_ITEMS = (
    Item("Section 6.2", "Mobility index, degrees of freedom, redundancy", _redundancy, "lab inspect scemi",
         "the course draws its examples without numbers; these are arms of the lab"),
    Item("Section 7.1", "Polar and cylindrical coordinates", _coordinates, "",
         "a library's arithmetic: no command converts coordinates"),
    Item("Annex, recalls 1 and 2", "Products of transformations and of vectors", _products,
         "lab kinematics irb120 --joints 0,0,0,0,0,0 --matrices", "the products are printed beside the link matrices"),
)  # fmt: skip
