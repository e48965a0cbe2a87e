"""Whole counts of encoders behind gears and couplings."""

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.kinematics.joints import Encoders

RNG = np.random.default_rng(0)


def test_counts_are_whole_and_nothing_else_is_lost() -> None:
    """A wrist whose drive 6 turns with joint 5 too: its counts are whole, which joint 6 alone is not."""
    couplings = np.eye(3)
    couplings[2, 1] = 0.5
    encoders = Encoders(np.array([100.0, -48.0, 32.0]), couplings, np.array([4096.0, 2048.0, 1000.0]))
    joints = RNG.uniform(-3, 3, (4000, 3))
    rounded = encoders.rounded(joints)
    motors = rounded @ encoders.counts.T
    np.testing.assert_allclose(motors, np.round(motors), atol=1e-6)
    step = 2 * np.pi / np.array([100 * 4096, 48 * 2048, 32 * 1000])  # rad of a joint for a count of its own drive
    off = rounded - joints
    assert np.abs(off[:, :2]).max(axis=0) == pytest.approx(step[:2] / 2, rel=0.01)
    assert np.abs(off[:, 2]).max() == pytest.approx(step[2] / 2 + 0.5 * step[1] / 2, rel=0.05)  # both drives' halves
    np.testing.assert_allclose(np.cov(off.T), encoders.covariance, atol=0.06 * encoders.covariance.max())
    np.testing.assert_allclose(encoders.rounded(rounded), rounded, atol=1e-12)
    own = rounded[:, 2] / step[2]
    assert np.abs(own - np.round(own)).max() > 0.1


def test_drives_that_turn_alike_are_refused() -> None:
    with pytest.raises(LabError, match="cannot be told apart"):
        Encoders(np.ones(2), np.ones((2, 2)), np.ones(2))
