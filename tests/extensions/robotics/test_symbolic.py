"""Matrices in letters: they are the numeric ones, and are printed without a sum that one angle could say."""

import numpy as np
import pytest
import sympy
from helpers.any_chain import random_chain

from lab.core.errors import LabError
from lab.extensions.robotics.kinematics.symbolic import symbolic_chain, textbook
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm
from lab.robots.load_robot import load_robot

POINTS = 1000


def matrix_at(chain: Chain, first: int, last: int, joints: np.ndarray) -> np.ndarray:
    """The matrix in letters with numbers put in, (n, 4, 4)."""
    letters = symbolic_chain(chain)
    symbols = [*letters.joints, *(sympy.Symbol(name, real=True) for name in letters.letters)]
    entries = sympy.lambdify(symbols, list(letters.between(first, last)), "numpy")
    made = entries(*joints.T, *letters.letters.values())
    return np.stack([np.broadcast_to(entry, len(joints)) for entry in made], axis=1).reshape(-1, 4, 4)


@pytest.mark.parametrize("chain", [
    *(load_robot(name).chain for name in ("irb120", "versatran", "scemi", "scara")),
    random_chain("distal", np.random.default_rng(0)), random_chain("craig", np.random.default_rng(1)),
], ids=lambda chain: f"{chain.name}-{chain.convention}")  # fmt: skip
def test_letters_say_what_the_numbers_say(chain: Chain) -> None:
    joints, arm = chain.random_joints(POINTS, np.random.default_rng(2)), SerialArm(chain)
    links, product = arm.links(joints, arm.nominal()), np.eye(4)
    for i in range(chain.size):
        np.testing.assert_allclose(matrix_at(chain, i, i + 1, joints), links[:, i], rtol=0, atol=1e-12)
        product = product @ links[:, i]
    np.testing.assert_allclose(product, arm.flange(joints, arm.nominal()), rtol=0, atol=1e-12)
    np.testing.assert_allclose(matrix_at(chain, 0, chain.size, joints), product, rtol=0, atol=1e-12)
    middle = matrix_at(chain, 1, chain.size - 1, joints)
    np.testing.assert_allclose(links[:, 0] @ middle @ links[:, -1], product, rtol=0, atol=1e-12)


def test_parallel_axes_turn_by_the_sum_of_their_angles() -> None:
    scara = symbolic_chain(load_robot("scara").chain).between(0, 4)
    assert [textbook(entry) for entry in scara[0, :]] == ["c124", "−s124", "0", "a2 c1 + a3 c12"]
    opposite = symbolic_chain(random_chain("distal", np.random.default_rng(0))).between(0, 2)
    assert "c(q1−q2" not in textbook(opposite[0, 0]) and "q1" in textbook(opposite[0, 0])


def test_frames_that_are_not_there_are_refused() -> None:
    letters = symbolic_chain(load_robot("scara").chain)
    for first, last in ((0, 5), (2, 2), (3, 1), (-1, 2)):
        with pytest.raises(LabError, match="two frames of 0 to 4"):
            letters.between(first, last)
