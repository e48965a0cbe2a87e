"""Runs with and without a payload, and how arm and sensor are set up."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.core.errors import LabError
from lab.extensions.dynamics.load_files import Mounting, PayloadSamples

ANGLES = st.floats(-3.0, 3.0)


@given(ANGLES, ANGLES)
def test_the_tilt_is_read_back_from_gravity(x: float, y: float) -> None:
    tilt = np.array([x, y])
    if np.linalg.norm(tilt) > 3.1:  # a rotation vector is short of half a turn
        tilt *= 3.1 / np.linalg.norm(tilt)
    mounting = Mounting.tilted(tilt)
    assert np.linalg.norm(mounting.gravity) == pytest.approx(9.81)
    np.testing.assert_allclose(mounting.tilt_rad, tilt, atol=1e-9)


@pytest.mark.parametrize("gravity", [0.0, 981.0, -9.81])
def test_gravity_in_other_units_is_refused(gravity: float) -> None:
    with pytest.raises(LabError, match="gravity"):
        Mounting.tilted(np.zeros(2), gravity)


def test_a_sign_and_a_mounting_that_are_none() -> None:
    down = np.array([0.0, 0.0, -9.81])
    with pytest.raises(LabError, match="sign"):
        Mounting(down, 2.0)
    with pytest.raises(LabError, match="no rotation"):
        Mounting(down, 1.0, np.diag([1.0, 1.0, -1.0]))


def test_a_run_has_its_rows_and_its_step() -> None:
    loaded = np.array([True, True, True, False, False])
    times = np.array([0.0, 0.1, 0.2, 5.0, 5.5])
    samples = PayloadSamples(times, np.arange(10.0).reshape(5, 2), np.ones((5, 2)), None, loaded, (2, 3, 4, 5, 6))
    assert samples.step_s == pytest.approx(0.1) and samples.run(False).step_s == pytest.approx(0.5)
    assert samples.run(True).lines == (2, 3, 4) and len(samples.run(False)) == 2


def test_a_row_at_rest_that_is_a_copy_counts_once() -> None:
    rng = np.random.default_rng(0)
    joints, wrench, loaded = rng.normal(size=(4, 2)), rng.normal(size=(4, 6)), np.array([True, False, True, False])
    plain = PayloadSamples(None, joints, None, wrench, loaded, lines=(2, 3, 4, 5))
    rows = np.array([0, 1, 2, 3, 1, 2])
    again = replace(plain.take(rows), lines=(2, 3, 4, 5, 6, 7)).without_copies("runs.csv")
    assert plain.without_copies("runs.csv") is plain and again.lines == plain.lines
    np.testing.assert_array_equal(again.joints, joints)
    assert again.warnings == (
        "runs.csv: 2 rows are copies of an earlier one to the last digit (the first: line 6, of line 3), which "
        "measurements never are: left out",
    )
    other = replace(plain.take(rows), loaded=np.array([True, False, True, False, True, True]))
    assert len(other.without_copies("a")) == 5  # the same numbers, once with a load and once without
    moving = replace(plain, time_s=np.arange(4.0)).take(rows)
    assert moving.without_copies("a") is moving
