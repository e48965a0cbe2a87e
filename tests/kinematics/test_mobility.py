"""Mobility index, degrees of freedom, redundancy, and what an arm cannot do."""

import numpy as np
import pytest
from helpers.robots import chain_of

from lab.kinematics.closed.mobility import mobility_of
from lab.robots.load_robot import load_robot

PLANAR = chain_of("planar", "craig", "RRR", [30, 0, 0], [0, 0.4, 0.3], [0] * 3, [0] * 3)
FOUR = chain_of("four", "craig", "RRRR", [0, 0, 0, 0], [0, 0.4, 0.3, 0.2], [0] * 4, [0] * 4)
SEVEN = chain_of(
    "seven", "craig", "RRRRRRR", [0, -90, 90, 90, -90, 90, 90], [0, 0, 0, 0.08, -0.08, 0, 0.09], [0] * 7,
    [0.3, 0, 0.3, 0, 0.4, 0, 0],
)  # fmt: skip


@pytest.mark.parametrize(
    ("chain", "index", "freedoms"),
    [(load_robot("irb120").chain, 6, 6), (load_robot("scara").chain, 4, 4), (SEVEN, 7, 6), (PLANAR, 3, 3),
     (FOUR, 4, 3)],
)  # fmt: skip
def test_joints_and_freedoms_are_counted(chain, index: int, freedoms: int) -> None:
    found = mobility_of(chain)
    assert (found.index, found.freedoms, found.redundancy) == (index, freedoms, index - freedoms)
    assert any(found.moving) == (index > freedoms)


def test_a_joint_that_takes_no_part_in_the_self_motion_is_not_free() -> None:
    """A slide across the plane of four parallel hinges has to stand still."""
    slide = chain_of("slide", "craig", "PRRRR", [0] * 5, [0, 0, 0.4, 0.3, 0.2], [0] * 5, [0] * 5)
    assert mobility_of(slide).moving == (False, True, True, True, True)


def test_a_planar_arm_is_told_with_its_normal() -> None:
    found = mobility_of(PLANAR)
    assert found.planar and not mobility_of(SEVEN).planar and not mobility_of(load_robot("scara").chain).planar
    normal = np.array([0.0, -np.sin(np.pi / 6), np.cos(np.pi / 6)])
    assert abs(found.fixed_directions[0] @ normal) == pytest.approx(1) and np.abs(found.still @ normal).max() < 1e-9
    scara = mobility_of(load_robot("scara").chain)
    assert len(scara.still) == 2 and len(scara.fixed_directions) == 0
