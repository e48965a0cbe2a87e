"""Compute Benmisra 2007: T_flex, the corrected direct model, and the compensation (equations 3.21 to 3.40)."""

from collections.abc import Callable
from functools import cache

import numpy as np

from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.reproduction.answer import Answer, holds
from lab.extensions.reproduction.item import Item, Missing, Source
from lab.extensions.reproduction.models import SAMPLES, Sampled, matrix_formulas, sampled
from lab.extensions.robotics.trajectory.tracking import Correction, compensated, elastic_errors, greville
from lab.kinematics.gauge import base_set_of
from lab.kinematics.serial.walk import Torsors

__all__ = ["ELASTIC"]

_SAG = 1e-3  # m and rad: largest deflection of the ends of links 2 and 3
_X, _Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])

_TorsorsAt = Callable[[Array], Torsors]


@cache
def _robot() -> Sampled:
    return sampled("rx130")


def _torsors_at(scale: float) -> _TorsorsAt:
    """Return a model of deformations: the ends of links 2 and 3 sink as much as they are level."""

    def at(joints: Array) -> Torsors:
        level = np.cos(joints[:, 1]), np.cos(joints[:, 1] + joints[:, 2])
        shape = np.array([0.2, -1.0, 0.3, 0.4, 0.5, -0.8])
        return {link: scale * part[:, None] * shape for link, part in zip((1, 2), level, strict=True)}

    return at


def _rotations() -> tuple[Answer, ...]:
    """Compare 3.23 to 3.29, the matrices of each elementary motion."""
    angle, length = rng_for(0, "arm").uniform(-1.5, 1.5, (2, SAMPLES))
    v = {"r": angle, "L": length, "dx": length, "dy": angle, "dz": 2 * length}
    zero = np.zeros((SAMPLES, 3))
    shift = np.stack([v["dx"], v["dy"], v["dz"]], axis=1)
    one = np.tile(np.eye(3), (SAMPLES, 1, 1))
    about = {axis: se3.pose(se3.exp(angle[:, None] * np.eye(3)[i]), zero) for i, axis in enumerate("xyz")}
    printed = {
        "x": "1 | 0 | 0 | 0; 0 | cos(r) | −sin(r) | 0; 0 | sin(r) | cos(r) | 0; 0 | 0 | 0 | 1",
        "y": "cos(r) | 0 | sin(r) | 0; 0 | 1 | 0 | 0; −sin(r) | 0 | cos(r) | 0; 0 | 0 | 0 | 1",
        "z": "cos(r) | −sin(r) | 0 | 0; sin(r) | cos(r) | 0 | 0; 0 | 0 | 1 | 0; 0 | 0 | 0 | 1",
    }
    along = "1 | 0 | 0 | L; 0 | 1 | 0 | 0; 0 | 0 | 1 | 0; 0 | 0 | 0 | 1"
    pushed = "1 | 0 | 0 | dx; 0 | 1 | 0 | dy; 0 | 0 | 1 | dz; 0 | 0 | 0 | 1"
    return (
        *matrix_formulas("3.24 Trans(x, L)", along, se3.pose(one, length[:, None] * _X), v),
        *matrix_formulas("3.26 T_flex,t", pushed, se3.pose(one, shift), v),
        *(
            answer
            for axis, text in printed.items()
            for answer in matrix_formulas(f"Rot({axis}, r)", text, about[axis], v)
        ),
    )


def _small() -> tuple[Answer, ...]:
    """Check 3.30 to 3.34, the products of small turns and displacements, to first order at a thousandth."""
    torsor = 1e-3 * rng_for(0, "arm").uniform(-1, 1, (SAMPLES, 6))
    d, r = torsor[:, :3], torsor[:, 3:]
    linear = np.tile(np.eye(4), (SAMPLES, 1, 1))
    linear[:, :3, :3] += se3.skew(r)
    x, y, z = (se3.pose(se3.exp(r[:, i, None] * np.eye(3)[i]), np.zeros((SAMPLES, 3))) for i in range(3))
    orders = max(float(np.abs(product - linear).max()) for product in (x @ y @ z, z @ y @ x, y @ z @ x))
    both = linear.copy()
    both[:, :3, 3] = d
    moved = se3.pose(se3.exp(r), np.zeros((SAMPLES, 3))) @ se3.pose(np.tile(np.eye(3), (SAMPLES, 1, 1)), d)
    second = 3e-6  # twice the square of 1e-3, three terms
    return (
        holds("3.30 to 3.33: the product in any order, to first order", orders, within=second),
        holds("3.34: T_flex,r T_flex,t, to first order", float(np.abs(moved - both).max()), within=second),
    )


def _chain() -> tuple[Answer, ...]:
    """Compare 3.22 and 3.35 of the RX 130 by products of matrices with the lab's deformed direct model."""
    robot = _robot()
    torsors = _torsors_at(_SAG)(robot.joints)
    rigid = robot.arm.links(robot.joints, robot.values)
    table, T = robot.arm.chain.table, np.tile(np.eye(4), (SAMPLES, 1, 1))
    one, zero = np.tile(np.eye(3), (SAMPLES, 1, 1)), np.zeros((SAMPLES, 3))
    stiff = T
    for j in range(robot.arm.chain.size):
        theta, d, a, alpha, _ = table[j]
        turn = theta + robot.arm.chain.sign[j] * robot.joints[:, j]
        across = se3.pose(one, np.tile(a * _X, (SAMPLES, 1)))
        rest = se3.pose(np.tile(se3.exp(alpha * _X), (SAMPLES, 1, 1)), zero) @ se3.pose(
            se3.exp(turn[:, None] * _Z), np.tile(d * _Z, (SAMPLES, 1))
        )
        stiff = stiff @ across @ rest
        T = T @ across @ (_flex(torsors[j - 1]) if j - 1 == 1 else np.eye(4)) @ rest
    whole = np.linalg.multi_dot([rigid[0, j] for j in range(6)])
    ours = robot.arm.tool(robot.joints, robot.values, 0, {1: torsors[1]})[0]
    return (
        holds("3.22 without deformation is the link matrix", float(np.abs(stiff[0] - whole).max())),
        holds("3.35 with link 2 deformed is the lab's direct model", float(np.abs(T - ours).max())),
    )


def _flex(torsor: Array) -> Array:
    """Return T_flex = Rot Trans of 3.34 with a whole rotation ``(n, 4, 4)``."""
    zero, one = np.zeros((len(torsor), 3)), np.tile(np.eye(3), (len(torsor), 1, 1))
    return np.asarray(se3.pose(se3.exp(torsor[:, 3:]), zero) @ se3.pose(one, torsor[:, :3]))


def _errors() -> tuple[Answer, ...]:
    """Check that the parts of 3.21 by segment add up to first order."""
    robot = _robot()
    found = elastic_errors(robot.arm, robot.values, robot.joints, _torsors_at(_SAG)(robot.joints))
    apart = float(np.abs(found.by_link.sum(axis=1) - found.total).max())
    return (holds("the errors of all segments add up, to first order", apart, within=10 * _SAG**2),)


def _compensation() -> tuple[Answer, ...]:
    """Check 3.36 b to 3.38: one correction of small errors, iterations of large ones."""
    robot = _robot()
    away = robot.arm.singular_distance(robot.joints, robot.values)[0] > 0.2
    joints = robot.joints[away]
    small = 1e-4
    wanted, J = robot.arm.tool(joints, robot.values)
    error = elastic_errors(robot.arm, robot.values, joints, _torsors_at(small)(joints)).total
    moved = joints - (np.stack([greville(each) for each in J]) @ error[..., None])[..., 0]
    there = robot.arm.tool(moved, robot.values, 0, _torsors_at(small)(moved))[0]
    once = float(np.linalg.norm(there[:, :3, 3] - wanted[:, :3, 3], axis=1).max())
    before = float(np.linalg.norm(error[:, :3], axis=1).max())
    again = _corrected(robot, joints, _torsors_at(_SAG))
    apart = max(float(np.abs(greville(each) - np.linalg.pinv(each)).max()) for each in J)
    return (
        holds("3.36 b to 3.38: what one correction leaves, of the error", once / before, within=0.05),
        holds("the remark: iterations bring the tool there", float(np.abs(again.left).max()), within=1e-11),
        holds("figure 3.7: Greville's pseudo-inverse", apart, within=1e-8),
    )


def _corrected(robot: Sampled, joints: Array, torsors_at: _TorsorsAt) -> Correction:
    """Correct an arm whose links deform by a model."""
    return compensated(
        lambda there: robot.arm.tool(there, robot.values),
        joints,
        lambda there: robot.arm.tool(there, robot.values, 0, torsors_at(there)),
        robot.arm.chain,
    )


def _planar() -> tuple[Answer, ...]:
    """Check the remark on fewer than six joints, of an arm of two joints."""
    robot = sampled("course2r")

    def at(joints: Array) -> Torsors:
        return {1: 1e-4 * np.cos(joints[:, 1])[:, None] * np.array([0.0, -1.0, 0.5, 0.2, 0.3, -0.5])}

    found = _corrected(robot, robot.joints, at)
    return (
        holds("the components that joints can make vanish", float(np.abs(found.missed).max()), within=1e-11),
        holds("the others stay", 0.0 if np.abs(found.left - found.missed).max() > 1e-6 else 1.0),
    )


def _calibrated() -> tuple[Answer, ...]:
    """Check 3.39 and 3.40: a purely geometric fit absorbs a part of the elastic errors."""
    robot = _robot()
    arm, values = robot.arm, robot.values
    joints = arm.chain.random_joints(200, rng_for(1, "structure"))
    rigid, J = arm.observe(joints, values)
    bent = arm.points(joints, values, _torsors_at(_SAG)(joints))
    error, J = (bent - rigid).ravel(), J.reshape(-1, len(values))
    identifiable = list(base_set_of(J, range(len(values))).identifiable)
    left = error - J[:, identifiable] @ np.linalg.lstsq(J[:, identifiable], error, rcond=None)[0]
    share = float(np.linalg.norm(left) / np.linalg.norm(error))
    return (
        holds("3.40: the identified parameters take in a part of the deformations", share, within=0.999),
        holds("but not all of them", 0.0 if share > 0.01 else 1.0),
    )


ELASTIC = Source(
    "elastic",
    "Benmisra 2007, programming of industrial robots (Blida), section 3-2-3 on: elastic links",
    (
        Item("Equation 3.21", "The elastic error", _errors, "python scripts/elastic_error_absorbed.py",
             "Of an RX 130 whose links 2 and 3 give way by up to 1 mm and 1 mrad, at random poses."),
        Item("Equations 3.22 to 3.29", "Elementary matrices", _rotations, "lab kinematics rx130 --symbolic"),
        Item("Equations 3.30 to 3.34", "Small displacements and turns", _small,
             note="The order of the turns matters by the square of their size: 1e-6 at 1 mrad."),
        Item("Equations 3.35, 3.36 a", "The corrected direct model", _chain, "python scripts/elastic_links_found.py",
             "T_flex stands at the segment's far end, with whole rotations in the lab."),
        Item("Equations 3.36 b to 3.38, figure 3.7", "Compensation", _compensation,
             "lab compensate TARGETS.csv --run RUN",
             "TARGETS.csv and RUN are targets and a calibration of your own. One correction leaves a few per cent "
             "of a small error, since the deformation is another one at the corrected joints; the lab iterates. Poses "
             "near a singularity are left out."),
        Item("Remark on fewer than six joints", "Components that no joint can make", _planar,
             "lab compensate TARGETS.csv --run RUN", "TARGETS.csv and RUN are targets and a calibration of your own."),
        Item("Equations 3.39, 3.40", "Calibration and deformations", _calibrated,
             "python scripts/elastic_error_absorbed.py"),
    ),
    (
        Missing("Figures 3.4, 3.5", "A segment rigid and deformed", "illustrations of the frames of 3.22"),
        Missing("Numbers", "Measured or computed examples", "the section prints no numbers"),
    ),
)  # fmt: skip
