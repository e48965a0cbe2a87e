"""Pictures of placements: all to one scale, and what is drawn keeps its lengths across the line of sight."""

import numpy as np
import pytest

from lab.core import se3
from lab.render.scene import placement_picture

pytestmark = pytest.mark.figures


@pytest.mark.thorough
def test_two_placements_have_one_scale_and_their_lines_are_drawn() -> None:
    pytest.importorskip("matplotlib")
    lines = np.array([[[0, 0, 0], [0, 0, 1.0], [1, 0, 1]], [[0, 0, 0], [0, 0, 1.0], [0, 2, 1]]])
    frames = np.stack([np.eye(4), se3.pose(np.eye(3), np.array([0.0, 0.0, 1.0]))])
    figures = [placement_picture(i, f"{i}", [lines], np.stack([frames, frames])).draw() for i in range(2)]
    axes = [figure.axes[0] for figure in figures]
    assert axes[0].get_xlim() == axes[1].get_xlim() and axes[0].get_ylim() == axes[1].get_ylim()
    drawn = [each.get_lines() for each in axes]
    assert [len(each) for each in drawn] == [7, 7]  # the arm, and three axes of each of two frames
    column = drawn[0][0].get_xydata()[:2]
    assert column[0, 0] == pytest.approx(column[1, 0]) and column[1, 1] > column[0, 1]  # z is up
