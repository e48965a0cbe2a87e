"""Compute Benmisra 2007: T_flex, the corrected direct model, and the compensation (equations 3.21 to 3.40)."""

from collections.abc import Callable
from functools import cache

import numpy as np

from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.reproduction.answer import ComparedValue, holds
from lab.extensions.reproduction.item import Item, Missing, Source, with_exercises
from lab.extensions.reproduction.source_models import SAMPLES, Sampled, link_matrices, matrix_formulas, sampled
from lab.extensions.reproduction.thesis_model import printed_links
from lab.extensions.robotics.trajectory.path_errors import Correction, compensated, elastic_errors, greville
from lab.kinematics.dynamics.beam import COMPLIANCES, MATERIALS, Beam, loads_on, tube
from lab.kinematics.effects.arm_with_effects import ArmWithEffects
from lab.kinematics.gauge import base_set_of
from lab.kinematics.serial.walk import Torsors
from lab.robots.load_robot import load_robot

__all__ = ["ELASTIC"]

_SAG = 1e-3  # m and rad: largest displacement of a link's end at the sampled positions, of the comparisons
_X, _Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
_TUBE_M = (0.08, 0.004)  # outer diameter and wall, aluminium
_DENSITY = 2700.0  # kg/m³
_ARM = "irb120"

_TorsorsAt = Callable[[Array], Torsors]


@cache
def _robot() -> Sampled:
    return sampled(_ARM)


@cache
def _beams() -> tuple[ArmWithEffects, Array]:
    """Return the lab's IRB 120 with its upper arm and forearm as tubes under gravity, and its parameters."""
    arm = load_robot(_ARM).arm_with(("p1",), ("bending", "torsion"))
    assert isinstance(arm, ArmWithEffects)
    values, section = arm.nominal({"p1": np.zeros(3)}), tube(*_TUBE_M, MATERIALS["aluminium"])
    for link in (2, 4):
        for symbol, compliance in zip(COMPLIANCES, section, strict=True):
            if f"link{link}.{symbol}" in arm.names:
                values[arm.names.index(f"link{link}.{symbol}")] = compliance
    return arm, values


def _torsors_at(largest: float | None = None) -> _TorsorsAt:
    """Return the deformations by the lab's beams, scaled so that the largest of the sampled positions is as given."""
    arm, values = _beams()

    def at(joints: Array) -> Torsors:
        found = arm.torsors(np.column_stack([joints, np.zeros(len(joints))]), values)
        return {link: torsor for link, torsor in found.items() if torsor.any()}

    if largest is None:
        return at
    scale = largest / max(float(np.abs(torsor).max()) for torsor in at(_robot().joints).values())
    return lambda joints: {link: scale * torsor for link, torsor in at(joints).items()}


def _rotations() -> tuple[ComparedValue, ...]:
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


def _small() -> tuple[ComparedValue, ...]:
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


def _chain() -> tuple[ComparedValue, ...]:
    """Compare 3.22 and 3.35 by products of matrices, of the IRB 120's printed table, with the lab's direct models."""
    robot, zero = _robot(), np.zeros(SAMPLES)
    torsors = _torsors_at(_SAG)(robot.joints)
    stiff = T = np.tile(np.eye(4), (SAMPLES, 1, 1))
    for j, (theta, d, a, alpha) in enumerate(printed_links(robot.joints)[1]):
        near = link_matrices("distal", theta + robot.joints[:, j], zero + d, zero + a, zero)
        turn = link_matrices("distal", zero, zero, zero, zero + alpha)
        stiff = stiff @ near @ turn
        T = T @ near @ (_flex(torsors[j]) if j in torsors else np.eye(4)) @ turn
    rigid = robot.arm.tool(robot.joints, robot.values)[0]
    deformed = robot.arm.tool(robot.joints, robot.values, 0, torsors)[0]
    return (
        holds("3.22 without deformation is the rigid direct model", float(np.abs(stiff - rigid).max())),
        holds("3.35 with deformed links is the lab's direct model", float(np.abs(T - deformed).max())),
    )


def _flex(torsor: Array) -> Array:
    """Return T_flex = Rot Trans of 3.34 with a whole rotation ``(n, 4, 4)``."""
    zero, one = np.zeros((len(torsor), 3)), np.tile(np.eye(3), (len(torsor), 1, 1))
    return np.asarray(se3.pose(se3.exp(torsor[:, 3:]), zero) @ se3.pose(one, torsor[:, :3]))


def _errors() -> tuple[ComparedValue, ...]:
    """Check that the parts of 3.21 by segment add up to first order."""
    robot = _robot()
    found = elastic_errors(robot.arm, robot.values, robot.joints, _torsors_at(_SAG)(robot.joints))
    apart = float(np.abs(found.by_link.sum(axis=1) - found.total).max())
    return (holds("the errors of all segments add up, to first order", apart, within=10 * _SAG**2),)


def _compensation() -> tuple[ComparedValue, ...]:
    """Check 3.36 b to 3.38: one correction of small errors, iterations of large ones."""
    robot = _robot()
    away = robot.arm.singular_distance(robot.joints, robot.values)[0] > 0.2
    joints = robot.joints[away]
    wanted, J = robot.arm.tool(joints, robot.values)
    error = elastic_errors(robot.arm, robot.values, joints, _torsors_at()(joints)).total
    moved = joints - (np.stack([greville(each) for each in J]) @ error[..., None])[..., 0]
    there = robot.arm.tool(moved, robot.values, 0, _torsors_at()(moved))[0]
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


def _planar() -> tuple[ComparedValue, ...]:
    """Check the remark on fewer than six joints, of an arm of two joints whose second link is a tube under gravity."""
    robot, material = sampled("course2r"), MATERIALS["aluminium"]
    length = float(robot.arm.chain.table[1, 2])
    outer, wall = _TUBE_M
    mass = _DENSITY * np.pi * wall * (outer - wall) * length
    beam = Beam(np.array([[0.0, 0, 0], [length, 0, 0]]), mass, np.array([length / 2, 0, 0]))

    def at(joints: Array) -> Torsors:
        pull = 9.81 * np.stack([-np.sin(joints[:, 1]), -np.cos(joints[:, 1]), np.zeros(len(joints))], axis=1)
        none = np.zeros_like(pull)
        return {1: beam.torsor(loads_on(none, none, pull), tube(outer, wall, material))}

    found = _corrected(robot, robot.joints, at)
    return (
        holds("the components that joints can make vanish", float(np.abs(found.missed).max()), within=1e-11),
        holds("the others stay", 0.0 if np.abs(found.left - found.missed).max() > 1e-6 else 1.0),
    )


def _calibrated() -> tuple[ComparedValue, ...]:
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
    with_exercises((
        Item("Equation 3.21", "The elastic error", _errors, "python scripts/experiments/elastic_error_absorbed.py",
             "Of the IRB 120 with its upper arm and forearm as tubes of aluminium under gravity, by the lab's beams, "
             "at random poses; the displacements are scaled to 1 mm and 1 mrad at most."),
        Item("Equations 3.22 to 3.29", "Elementary matrices", _rotations, "lab kinematics rx130 --symbolic",
             "The matrices of single motions; the link matrices of the command are their products."),
        Item("Equations 3.30 to 3.34", "Small displacements and turns", _small,
             note="The order of the turns matters by the square of their size: 1e-6 at 1 mrad."),
        Item("Equations 3.35, 3.36 a", "The corrected direct model", _chain,
             "python scripts/experiments/elastic_links_found.py",
             "Of the IRB 120's printed Denavit-Hartenberg table. T_flex stands at the segment's far end, with whole "
             "rotations in the lab."),
        Item("Equations 3.36 b to 3.38, figure 3.7", "Compensation", _compensation,
             "lab compensate TARGETS.csv --run RUN",
             "TARGETS.csv and RUN are targets and a calibration of your own. One correction leaves a few per cent "
             "of a small error, since the deformation is another one at the corrected joints; the lab iterates. Poses "
             "near a singularity are left out."),
        Item("Remark on fewer than six joints", "Components that no joint can make", _planar,
             "lab compensate TARGETS.csv --run RUN", "TARGETS.csv and RUN are targets and a calibration of your own."),
        Item("Equations 3.39, 3.40", "Calibration and deformations", _calibrated,
             "python scripts/experiments/elastic_error_absorbed.py"),
    ), "elastic"),
    (
        Missing("Figures 3.4, 3.5", "A segment rigid and deformed", "illustrations of the frames of 3.22"),
        Missing("Numbers", "Measured or computed examples", "the section prints no numbers"),
    ),
)  # fmt: skip
