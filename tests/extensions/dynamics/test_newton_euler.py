"""Inverse dynamics in letters: a textbook's 2R by hand, and Lagrange's equations of bodies by differences of energy."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lab.core.random import rng_for
from lab.extensions.dynamics.arm.base_parameters import base_parameters, regrouping_formulas
from lab.extensions.dynamics.arm.newton_euler import newton_euler
from lab.extensions.robotics.kinematics.symbolic import symbolic_chain
from lab.formats.formula_program import programs_text
from lab.kinematics.dynamics.rigid_body import ArmDynamics
from lab.robots.load_robot import load_robot

G = np.array([0.0, 0.0, -9.81])


def executed(arm: ArmDynamics) -> tuple[Callable[..., list[float]], Any]:
    base = base_parameters(arm, rng_for(0, "structure"))
    space: dict[str, Any] = {}
    exec(programs_text((newton_euler(arm, base).program("arm"),), "python"), space)
    return space["arm_inverse_dynamics"], base


def test_two_hinges_are_the_textbook_s() -> None:
    """A planar arm that gravity does not load: Khalil & Dombre 2002, chapter 9, in its four base parameters."""
    chain = load_robot("planar3r").chain.first(2)
    arm = replace(ArmDynamics.of(chain, G), motor_inertia=False, friction=False, offsets=False)
    torque, base = executed(arm)
    (q1, q2), (v1, v2), (w1, w2) = (0.4, 0.9), (1.3, -0.7), (2.1, 0.6)
    zz1, zz2, mx2, my2 = 0.9, 0.4, 0.3, -0.2
    length = float(chain.table[0, 2])
    bent, across = length * (mx2 * np.cos(q2) - my2 * np.sin(q2)), length * (mx2 * np.sin(q2) + my2 * np.cos(q2))
    hand = [
        (zz1 + zz2 + 2 * bent) * w1 + (zz2 + bent) * w2 - across * (2 * v1 * v2 + v2**2),
        (zz2 + bent) * w1 + zz2 * w2 + across * v1**2,
    ]
    values = {"ZZR1": zz1, "ZZ2": zz2, "MX2": mx2, "MY2": my2}
    assert sorted(base.labels) == sorted(values)
    found = torque((q1, q2), (v1, v2), (w1, w2), [values[label] for label in base.labels])
    np.testing.assert_allclose(found, hand, rtol=0, atol=1e-12)


def turned(axis: int, angle: float) -> np.ndarray:
    R, (i, j) = np.eye(3), [k for k in range(3) if k != axis]
    R[i, i] = R[j, j] = np.cos(angle)
    R[i, j], R[j, i] = -np.sin(angle), np.sin(angle)
    return R if axis != 1 else R.T


def poses(arm: ArmDynamics, q: np.ndarray) -> list[np.ndarray]:
    """Rotation and place (3, 4) of every link's frame, by Craig's table."""
    found, R, p = [], np.eye(3), np.zeros(3)
    for i, (theta, d, a, alpha, _) in enumerate(arm.chain.table):
        moved = arm.chain.sign[i] * q[i]
        theta, d = (theta, d + moved) if arm.chain.prismatic[i] else (theta + moved, d)
        p = p + R @ (np.array([a, 0, 0]) + turned(0, alpha) @ [0, 0, d])
        R = R @ turned(0, alpha) @ turned(2, theta)
        found.append(np.column_stack([R, p]))
    return found


def lagrangian(arm: ArmDynamics, bodies: np.ndarray, q: np.ndarray, v: np.ndarray) -> float:
    """Kinetic less potential energy of links with parameters M, MS and J about their frames."""
    step, energy = 1e-6, 0.0
    ahead, here, back = (poses(arm, q + sign * step * v) for sign in (1, 0, -1))
    for T, now, before, (m, *rest) in zip(ahead, here, back, bodies, strict=True):
        rate = (T - before) / (2 * step)
        moment, J = np.array(rest[:3]), np.array(rest[3:])
        tensor = np.array([[J[0], J[3], J[4]], [J[3], J[1], J[5]], [J[4], J[5], J[2]]])
        second = np.trace(tensor) / 2 * np.eye(3) - tensor  # integral of r r' dm
        turn, move = rate[:, :3], rate[:, 3]
        energy += 0.5 * (m * move @ move + 2 * move @ turn @ moment + np.trace(turn @ second @ turn.T))
        energy += G @ (m * now[:, 3] + now[:, :3] @ moment)
    return energy


def lagrange(arm: ArmDynamics, bodies: np.ndarray, q: np.ndarray, v: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Torques by d/dt dL/dv - dL/dq, by central differences."""
    step, unit = 1e-3, np.eye(len(q))

    def difference(place: np.ndarray, speed: np.ndarray, e: np.ndarray) -> float:
        ahead, back = (lagrangian(arm, bodies, place, speed + sign * step * e) for sign in (1, -1))
        return (ahead - back) / (2 * step)

    def momentum(t: float) -> np.ndarray:
        return np.array([difference(q + v * t + w * t * t / 2, v + w * t, e) for e in unit])

    slope = [
        (lagrangian(arm, bodies, q + step * e, v) - lagrangian(arm, bodies, q - step * e, v)) / (2 * step) for e in unit
    ]
    return (momentum(step) - momentum(-step)) / (2 * step) - np.array(slope)


@pytest.mark.parametrize("name", ["scara", "versatran", pytest.param("irb120", marks=pytest.mark.thorough)])
def test_torques_are_lagrange_s(name: str) -> None:
    """The base parameters of random bodies, with a tilted base, against energies that share no code with the lab."""
    rng = np.random.default_rng(6)
    arm = replace(ArmDynamics.of(load_robot(name).chain, G), motor_inertia=False, friction=False, offsets=False)
    torque, base = executed(arm)
    size = arm.chain.size
    bodies = rng.uniform(-0.3, 0.3, (size, 10)) + np.array([2.0, *np.zeros(3), *np.ones(3), *np.zeros(3)])
    grouped = base.projection @ arm.standard(bodies, {})
    for _ in range(2):
        q, v, w = rng.uniform(0.2, 1.0, (3, size))
        found = torque(q, v, w, grouped)
        np.testing.assert_allclose(found, lagrange(arm, bodies, q, v, w), rtol=0, atol=2e-4 * np.abs(found).max())
    assert np.abs(np.array(torque(q, -v, w, 1.1 * grouped)) - found).max() > 1e-2  # the comparison would see a change


def test_drives_friction_and_couplings_are_the_model_s() -> None:
    """A coupled wrist, motors and friction: f = W X of the regressor, whose links Lagrange's test above covers."""
    couplings = np.eye(6)
    couplings[5, 4] = 0.7
    chain, rng = load_robot("tx40").chain, np.random.default_rng(7)
    arm = ArmDynamics.of(chain, np.array([0.5, -0.3, -9.7]), couplings)
    torque, base = executed(arm)
    values = rng.normal(size=base.size)
    q, v, w = rng.uniform(-1.0, 1.0, (3, 6))
    W = arm.regressor(q[None], v[None], w[None])[0][:, base.independent]
    np.testing.assert_allclose(torque(q, v, w, values), W @ values, rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", ["irb120", "tx40"])
def test_a_length_has_the_letter_of_the_robots_own_table(name: str) -> None:
    """As in ``lab kinematics --symbolic``: an arm has one set of letters, whatever frames the equations stand in."""
    pytest.importorskip("sympy")
    chain = load_robot(name).serial_model.chain
    arm = ArmDynamics.of(chain, G)
    base = base_parameters(arm, rng_for(0, "structure"))
    of_table = {letter: float(value) for letter, value in symbolic_chain(chain).letters.items()}
    found = {letter: value for letter, value in newton_euler(arm, base).letters.items() if letter[0] in "ad"}
    assert found and found == {letter: pytest.approx(of_table[letter]) for letter in found}
    words = {letter for each in regrouping_formulas(arm, base, rng_for(1, "structure")) for term in each.terms
             for word, _ in term.coefficient for letter in word}  # fmt: skip
    assert words and words <= {*of_table}
