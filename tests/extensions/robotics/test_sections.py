"""Volumes of three-joint arms by exact sections, against closed formulas."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import chain_of

from lab.core.errors import LabError
from lab.extensions.robotics.workspace.boundary import carrier_volume
from lab.kinematics.serial.chain import Chain

SPHERICAL = chain_of("spherical", "craig", "RRP", [0, -90, 90], [0] * 3, [0] * 3, [0] * 3)
CARTESIAN = chain_of("cartesian", "craig", "PPP", [0, -90, -90], [0] * 3, [0, 90, 0], [0] * 3)


def limited(chain: Chain, lower: list[float], upper: list[float]) -> Chain:
    return replace(chain, lower=np.array(lower), upper=np.array(upper))


def test_a_hollow_ball_has_its_void_and_a_cone_its_edges() -> None:
    """A slide from 0.3 to 1 m leaves a void; a hinge of ±60° about the level leaves out two cones."""
    hollow = limited(SPHERICAL, [-np.pi, -np.pi, 0.3], [np.pi, np.pi, 1.0])
    assert carrier_volume(hollow, np.zeros(3), 1.3) == pytest.approx(4 * np.pi / 3 * (1 - 0.3**3), rel=1e-3)
    low, high = -np.pi / 2 - np.pi / 3, -np.pi / 2 + np.pi / 3
    wedge = limited(SPHERICAL, [-np.pi, low, 0.3], [np.pi, high, 1.0])
    whole = 4 * np.pi / 3 * (1 - 0.3**3) * np.sin(np.pi / 3)
    assert carrier_volume(wedge, np.zeros(3), 1.3) == pytest.approx(whole, rel=1e-3)


def test_three_slides_reach_a_box() -> None:
    assert carrier_volume(limited(CARTESIAN, [0, 0, 0.1], [0.5, 0.4, 0.4]), np.zeros(3), 1.0) == pytest.approx(0.06)


def test_other_arms_are_refused() -> None:
    with pytest.raises(LabError, match="solid of revolution"):
        carrier_volume(limited(SPHERICAL, [-1.0, -np.pi, 0], [1.0, np.pi, 1.0]), np.zeros(3), 1.0)
    planar = chain_of("planar", "craig", "RRR", [0, 0, 0], [0, 0.4, 0.3], [0] * 3, [0] * 3)
    with pytest.raises(LabError, match="not an arm of three joints"):
        carrier_volume(planar, np.array([0.2, 0, 0]), 1.0)
