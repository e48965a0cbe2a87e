"""Regions as an option names them."""

from pathlib import Path

import numpy as np
import pytest

from lab.core import se3
from lab.core.errors import LabError
from lab.prediction.task_region import task_region

NAMES, PRISMATIC = ("q1", "q2"), (False, False)


def test_words_have_no_points_of_their_own() -> None:
    for word in ("measured", "workspace"):
        named = task_region(word)
        assert named.kind == word and not len(named.points(np.eye(4), NAMES, PRISMATIC))


def test_a_box_is_filled_in_the_robot_s_frame() -> None:
    named = task_region("100,300,-50,50,0,10")
    T_instrument_frame0 = se3.pose(se3.exp(np.array([0, 0, np.pi / 2])), np.array([1.0, 2.0, 3.0]))
    points = named.points(T_instrument_frame0, NAMES, PRISMATIC)
    assert named.kind == "box" and points.shape == (200, 3)
    back = se3.transform(np.linalg.inv(T_instrument_frame0), points)
    assert (back > [0.1, -0.05, 0.0]).all() and (back < [0.3, 0.05, 0.01]).all()
    np.testing.assert_allclose(np.ptp(back, axis=0), [0.2, 0.1, 0.01], rtol=0.05)


def test_a_file_holds_targets_in_the_frame_of_the_measurements(tmp_path: Path) -> None:
    (tmp_path / "task.csv").write_text("x_mm,y_mm,z_mm\n100,200,300\n110,200,300\n")
    named = task_region(str(tmp_path / "task.csv"))
    np.testing.assert_allclose(named.points(np.eye(4), NAMES, PRISMATIC), [[0.1, 0.2, 0.3], [0.11, 0.2, 0.3]])
    with pytest.raises(LabError, match="--region"):
        task_region(str(tmp_path / "none.csv")).points(np.eye(4), NAMES, PRISMATIC)
