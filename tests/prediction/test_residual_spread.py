"""What a fit leaves: readings of one configuration share what the model lacks there."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120

from lab.calibration.gauss_newton import Observations
from lab.calibration.identification import Identification, identify
from lab.calibration.weights import Noise
from lab.core.measurements import measured
from lab.prediction.residual_spread import for_later_rows, residual_spread

CHAIN, ARM = IRB120.chain, IRB120.arm(("p1",))
NOMINAL = ARM.nominal(IRB120.tool)
NOISE, LACK = 1e-5, 1e-4


def fitted(lack: float, noise: Noise | None = None, *, visits: int = 10, seed: int = 0) -> Identification:
    """Sixty configurations, each measured so often, of an arm that is off by ``lack`` anew at each (m)."""
    rng = np.random.default_rng(seed)
    joints = CHAIN.random_joints(60, rng)
    points = ARM.points(joints, NOMINAL) + lack * rng.normal(size=(60, 1, 3))
    points = np.repeat(points, visits, axis=0) + NOISE * rng.normal(size=(60 * visits, 1, 3))
    rows = measured(CHAIN.joint_names, np.repeat(joints, visits, axis=0), ("p1",), points)
    return identify(ARM, rows, NOMINAL, noise)


LABELS = np.repeat(np.arange(60), 10)


def test_readings_of_one_configuration_are_one_draw_of_what_the_model_lacks() -> None:
    """The variance of a new reading is lack and noise; ten readings that share it widen the covariance tenfold."""
    found = [residual_spread(fitted(LACK, seed=seed), LABELS) for seed in range(8)]
    sizes = [each.total_m for each in found]
    assert np.mean(sizes) == pytest.approx(np.hypot(LACK, NOISE), rel=0.05)
    assert np.mean([each.widened for each in found]) == pytest.approx(10 * 180 / (180 - 27), rel=0.1)
    assert {each.dof for each in found} == {180 - 27}
    by_rows = [residual_spread(fitted(LACK, seed=seed)) for seed in range(8)]
    assert {each.widened for each in by_rows} == {1.0}
    assert np.mean([each.total_m for each in by_rows]) < 0.95 * LACK  # 27 parameters follow 180 numbers, not 1,800


def test_repeats_of_a_model_that_lacks_nothing_are_independent() -> None:
    """Level 5 %: of 16 campaigns at most 4 with a chance of 99.3 %."""
    found = [residual_spread(fitted(0.0, seed=seed), LABELS) for seed in range(16)]
    assert np.mean([each.total_m for each in found]) == pytest.approx(NOISE, rel=0.05)
    assert sum(each.widened > 1 for each in found) <= 4


def test_the_instrument_s_part_is_not_the_arm_s_where_the_noise_is_given() -> None:
    clean, lacking = (fitted(lack, Noise(sigma_m=NOISE), visits=1) for lack in (0.0, LACK))
    well = residual_spread(clean)
    assert well.of_arm_m == 0.0 and well.dof is None and well.total_m >= NOISE
    badly = residual_spread(lacking, lack_of_fit=True)
    assert badly.of_arm_m == pytest.approx(np.sqrt(badly.total_m**2 - NOISE**2))
    assert badly.widened == pytest.approx((badly.total_m / NOISE) ** 2)
    shared = residual_spread(lacking, lack_of_fit=True, independent_m=NOISE)
    assert shared.widened == 1.0 and shared.of_arm_m == badly.of_arm_m  # the fit weighs what is shared already
    unknown = residual_spread(fitted(0.0, visits=1))
    assert unknown.of_arm_m == unknown.total_m


def test_no_position_is_observed_and_nothing_is_known() -> None:
    found = fitted(0.0, visits=1)
    with_nothing = replace(found, residuals=np.full_like(found.residuals, np.nan))
    assert not np.isfinite(residual_spread(with_nothing).total_m)


@pytest.mark.parametrize(("apart", "wider"), [(0.0, False), (1.0, True)])
def test_later_rows_are_missed_as_blocks_of_earlier_ones_are(apart: float, wider: bool) -> None:
    """Nine blocks of an arm whose error is the same within a block: the last is in the bounds of the first eight."""
    inside = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        joints = CHAIN.random_joints(270, rng)
        shift = apart * np.repeat(rng.normal(size=(9, 1, 3)), 30, axis=0) + (1 - apart) * rng.normal(size=(270, 1, 3))
        points = ARM.points(joints, NOMINAL) + LACK * shift + NOISE * rng.normal(size=(270, 1, 3))
        rows = measured(CHAIN.joint_names, joints, ("p1",), points)[np.arange(240)]
        found = identify(ARM, rows, NOMINAL)
        alone = residual_spread(found)
        later = for_later_rows(alone, found, Observations.unweighted(rows), np.arange(240), 1.0)
        assert later.total_m >= alone.total_m and (not wider or later.total_m > 1.1 * alone.total_m)
        off = np.linalg.norm(points - ARM.points(joints, found.values), axis=2)[240:]
        inside.append((off < np.sqrt(7.81) * later.total_m).mean())
        assert for_later_rows(alone, found, Observations.unweighted(rows), np.arange(240), 0.0).total_m == alone.total_m
    assert np.mean(inside) > 0.9


def test_few_rows_tell_nothing_of_later_ones() -> None:
    found = fitted(LACK, visits=1)
    few = np.arange(39)
    rows = measured(CHAIN.joint_names, np.zeros((39, 6)), ("p1",), np.zeros((39, 1, 3)))
    left = residual_spread(found)
    assert for_later_rows(left, found, Observations.unweighted(rows), few, 1.0) is left
