"""Very many new measurements: worked out block by block, they say what they say all at once."""

import numpy as np
import pytest
from helpers.robots import IRB120, perturbed, somewhere
from scipy import stats

from lab.calibration import gauss_newton
from lab.calibration.gauss_newton import Observations
from lab.kinematics.gauge import base_set
from lab.kinematics.serial.serial_arm import SerialArm
from lab.phrases.phrase import phrase
from lab.verification import predicted_points as tails
from lab.verification.change_test import Verified, verify
from lab.verification.predicted_points import DRAWS, CalibrationPrediction, squares_of_tails

ARM, SIGMA, POSES = SerialArm(IRB120.chain, ("p1", "p2")), 5e-6, 90
FREE = base_set(ARM, ARM.nominal()).identifiable


def new_points(off: bool, poses: int = POSES) -> tuple[CalibrationPrediction, Observations]:
    """What a run said that knew its parameters to some 10 µm, and new measurements; of a moved base, and a bad one."""
    rng = np.random.default_rng(2)
    values = perturbed(ARM, somewhere(ARM, rng), rng, 0.5e-3, 1.5e-3)
    truth = values.copy()
    truth[list(FREE)] += 1e-5 * rng.standard_normal(len(FREE))
    truth[1] += 1e-3 * off
    joints = IRB120.chain.random_joints(poses, rng)
    points = ARM.points(joints, truth) + SIGMA * rng.standard_normal((poses, 2, 3))
    points[3, 1] = points[40, 0] = points[41] = np.nan
    points[70, 0] += [0, 2e-3 * off, 0]
    prediction = CalibrationPrediction(ARM, values, FREE, 1e-10 * np.eye(len(FREE)))
    return prediction, Observations(joints, points, np.full((poses, 2), 1 / SIGMA))


@pytest.mark.parametrize("off", [False, True], ids=["as it was", "moved"])
def test_a_verification_block_by_block_is_that_of_all_rows(off: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    prediction, seen = new_points(off)

    passed: list[tuple[int, int]] = []

    def told() -> Verified:
        passed.clear()
        return verify(prediction, seen, progress=lambda done, of: passed.append((done, of)))

    whole = told()
    monkeypatch.setattr(gauss_newton, "_BLOCK", 6 * 20)
    assert len(list(seen.blocks())) == 5
    parts = told()
    assert passed[:5] == [(done, POSES) for done in (20, 40, 60, 80, 90)]
    assert len(passed) == 10 or off  # all rows twice where nothing has changed
    assert whole.good is not off and phrase(parts.check) == phrase(whole.check)
    for name in ("statistic", "numbers", "expected_m", "p", "p_of_all"):
        assert getattr(parts, name) == pytest.approx(getattr(whole, name), rel=1e-9)
    np.testing.assert_allclose(parts.errors, whole.errors, rtol=1e-12)
    assert [phrase(each.check) for each in parts.hypotheses] == [phrase(each.check) for each in whole.hypotheses]
    for one, other in zip(parts.hypotheses, whole.hypotheses, strict=True):
        assert (one.chi2, one.bic) == pytest.approx((other.chi2, other.bic), rel=1e-9)
    if off:
        assert any("row 70" in phrase(each.check) for each in parts.hypotheses)


@pytest.mark.thorough
def test_a_moved_zero_is_found_among_many_rows_with_tails() -> None:
    """The sum of all squares of such noise scatters so widely that it hides the zero; its own direction does not."""
    rng, tail_dof = np.random.default_rng(5), 2.6
    values = perturbed(ARM, somewhere(ARM, rng), rng, 0.5e-3, 1.5e-3)
    joints = IRB120.chain.random_joints(1_000, rng)

    def told(off_rad: float) -> Verified:
        truth = values.copy()
        truth[ARM.names.index("link2.theta")] += off_rad
        noise = rng.standard_t(tail_dof, (len(joints), 2, 3)) * np.sqrt((tail_dof - 2) / tail_dof)
        points = ARM.points(joints, truth) + SIGMA * noise
        known = CalibrationPrediction(ARM, values, FREE, 1e-14 * np.eye(len(FREE)), tail_dof=tail_dof)
        return verify(known, Observations(joints, points, np.full((len(joints), 2), 1 / SIGMA)))

    as_it_was, moved = told(0.0), told(1e-5)
    assert as_it_was.good and as_it_was.test.along.numbers == len(FREE)
    assert moved.p_of_all > 0.05 and not moved.good and moved.test.along.p < 0.005 < moved.test.rest.p
    assert moved.moved == ("joint",) and "the zero of joint 2 (q2) has moved by 0.0103 ± 0.0003 mrad" in phrase(
        moved.check
    )
    assert dict(moved.would_notice)["joint2"] < 5e-6


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("tail_dof", "numbers"), [(3.0, 900), (6.0, 900), (6.0, 2_400)])
def test_sums_of_many_tails_are_distributed_as_draws_one_by_one(
    tail_dof: float, numbers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two samples of 1,999 differ by 0.052 in one of a hundred (Kolmogorov and Smirnov)."""
    one_by_one = squares_of_tails(tail_dof, numbers, None)
    monkeypatch.setattr(tails, "_MOST_DRAWN", numbers - 1)
    squares_of_tails.cache_clear()
    by_parts = squares_of_tails(tail_dof, numbers, None)
    squares_of_tails.cache_clear()
    assert one_by_one.shape == by_parts.shape == (DRAWS,)
    assert stats.ks_2samp(one_by_one, by_parts).statistic < 0.055
