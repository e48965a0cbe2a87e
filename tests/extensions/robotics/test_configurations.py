"""Configurations: every solution of a pose has its own, and a path keeps it as long as it passes no singularity."""

import numpy as np
import pytest

from lab.extensions.robotics.kinematics.nominal_models import configurations
from lab.kinematics.inverse.closed_form import closed_form_of
from lab.kinematics.serial.serial_arm import SerialArm
from lab.robots.load_robot import load_robot


@pytest.mark.parametrize("name", ["irb120", "rx130", "tx40", "scemi", "versatran", "scara"])
def test_every_solution_has_a_configuration_of_its_own(name: str) -> None:
    chain = load_robot(name).chain
    form, arm = closed_form_of(chain), SerialArm(chain)
    Ts = arm.flange(chain.random_joints(200, np.random.default_rng(0)), arm.nominal())
    for joints in form.solve(Ts).joints:
        sides = configurations(form.determinant, joints)
        assert len({tuple(each.items()) for each in sides}) == form.branches
        assert all(set(each.values()) <= {"+", "-"} for each in sides)


def test_the_product_of_the_sides_is_the_sign_of_the_determinant_and_a_singularity_has_none() -> None:
    chain = load_robot("irb120").chain
    form, arm = closed_form_of(chain), SerialArm(chain)
    joints = chain.random_joints(500, np.random.default_rng(1))
    signs = np.sign(np.linalg.det(arm.tool(joints, arm.nominal())[1]))
    sides = [np.prod([1 if side == "+" else -1 for side in each.values()])
             for each in configurations(form.determinant, joints)]  # fmt: skip
    assert np.array_equal(signs, form.determinant.sign * np.array(sides))
    (straight,) = configurations(form.determinant, np.zeros((1, 6)))
    assert straight == {"elbow": "+", "wrist": "0", "shoulder": "+"}
