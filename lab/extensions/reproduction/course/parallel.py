"""Section 11: planar and spatial parallel robots."""

from functools import cache

import numpy as np

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.reproduction.answer import Answer, formula, holds, number, word
from lab.extensions.reproduction.item import Item
from lab.extensions.reproduction.models import SAMPLES, matrix_formulas
from lab.extensions.robotics.closed.delta import Delta
from lab.extensions.robotics.closed.rpr2 import TwoLegs
from lab.extensions.robotics.closed.rpr3 import ThreeLegs
from lab.extensions.robotics.closed.shared_pin import SharedPin
from lab.kinematics.closed.mobility import mobility

__all__ = ["PARALLEL_ITEMS"]

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
    """Inverse model in the course's frame, and where the three legs' lines meet in a point or are parallel."""
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
    """A pose ``(1, 3)`` where the lines of the legs meet, by bisection over the platform's turn."""
    low, high = -2.0, 2.0

    def twisted(phi: float) -> float:
        return float(np.linalg.det(robot.matrices(np.array([[0.4, 0.4, phi]]))[0])[0])

    signs = [(a, b) for a, b in zip(*_steps(low, high), strict=True) if twisted(a) * twisted(b) < 0]
    low, high = signs[0]
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if twisted(low) * twisted(middle) > 0 else (low, middle)
    return np.array([[0.4, 0.4, (low + high) / 2]])


def _steps(low: float, high: float) -> tuple[list[float], list[float]]:
    at = np.linspace(low, high, 81).tolist()
    return at[:-1], at[1:]


def _delta() -> tuple[Answer, ...]:
    """Grübler's count, then the closed forms against each other for the IRB 340's four axes."""
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
    """Exercise 11.5 with anchors at random, the figure being unreadable: E is the end of the bar A1 A2 of length L."""
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
