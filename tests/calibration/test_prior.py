"""The automatic prior: tolerances act only where the measurements say little, at a scale that the measurements tell."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from camera_truth import makers_table, true_table
from helpers.robots import IRB120, data_file, perturbed, somewhere

from lab.calibration.fit_options import FitOptions
from lab.calibration.identification import identify
from lab.calibration.noise_search import outliers_among_fitted
from lab.calibration.prior import Prior, PriorDirections, Tolerance, directions_of, standard_deviations
from lab.calibration.statistics.linearized import NoiseDistribution
from lab.calibration.weights import Noise
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.kinematics.serial.serial_arm import SerialArm
from lab.phrases.phrase import in_one_line
from lab.prediction.validation import Errors, Validation
from lab.robots.load_robot import load_robot
from lab.verdict.verdict import verdict

ARM = SerialArm(IRB120.chain)
NOMINAL = ARM.nominal(IRB120.tool)
FRESH = IRB120.chain.random_joints(200, np.random.default_rng(99))
AUTO = FitOptions()
NEAR_AXIS, AWAY = (1e-3, 0.0, 0.1), (0.05, 0.0, 0.1)  # m, of a target: weakly observable, or not


def campaign(
    seed: int, poses: int, sigma_m: float, target=NEAR_AXIS, times: float = 1.0, still: int | None = None
) -> tuple[Measurements, np.ndarray]:
    """Measured poses of an arm so many times its tolerances off nominal, with one joint that does not move."""
    rng = np.random.default_rng(seed)
    values = somewhere(ARM, rng)
    values[-3:] = target
    true = perturbed(ARM, values, rng, times * 0.5e-3, times * 1.5e-3)
    joints = IRB120.chain.random_joints(poses, rng)
    if still is not None:
        joints[:, still] = 0.3
    points = ARM.points(joints, true) + sigma_m * rng.normal(size=(poses, 1, 3))
    return measured(IRB120.chain.joint_names, joints, ("p1",), points), true


def factory_deviations() -> list[np.ndarray]:
    """How far the factory calibrations of 19 real arms are from their maker's tables: ``(6, 5)``, m and rad."""
    with data_file("ur_factory.csv").open(encoding="utf-8") as file:
        arms = list(csv.DictReader(line for line in file if not line.startswith("#")))
    return [true_table(makers_table(arm["model"]), arm) - makers_table(arm["model"]) for arm in arms]


def test_real_arms_are_as_far_from_their_tables_as_the_tolerances_say() -> None:
    """Deviations of 19 arms in standard deviations of the prior: none of it was fitted to one arm of them.

    Of lengths, of twists between parallel axes, and of both together; other twists are better than the tolerance.
    """
    arm = SerialArm(load_robot("ur5e").chain)
    sigma = arm.split(standard_deviations(arm, Tolerance()))[1]
    z = np.array([table / np.where(sigma > 0, sigma, np.inf) for table in factory_deviations()])
    assert len(z) == 19

    def rms(*cells: tuple[int, int]) -> float:
        return float(np.sqrt(np.mean([z[:, row, column] ** 2 for row, column in cells])))

    lengths = [(0, 1), (0, 2), (1, 2), (2, 2), (3, 1), (4, 1), (5, 1)]  # d1 a1 a2 a3 d4 d5 d6
    parallel, others = [(1, 3), (1, 4), (2, 3), (2, 4)], [(0, 3), (3, 3), (4, 3)]
    assert 0.7 < rms(*lengths) < 1.1
    assert 0.9 < rms(*parallel) < 1.2
    assert 0.4 < rms(*others) < 1.0
    assert 0.7 < rms(*lengths, *parallel, *others) < 1.1
    longest = z[:, [1, 2], 2].sum(axis=1) / np.sqrt(2)  # of both long links together: the size of an arm
    assert 0.7 < np.sqrt(np.mean(longest**2)) < 1.3


def test_a_given_tolerance_of_angles_widens_all_twists_by_one_share() -> None:
    arm = SerialArm(load_robot("ur5e").chain)
    usual, wide = (standard_deviations(arm, each) for each in (Tolerance(), Tolerance(0.5e-3, 3e-3)))
    angles = np.array([each.is_link and each.is_angle for each in arm.parameters])
    np.testing.assert_allclose(wide[angles], 2 * usual[angles])
    np.testing.assert_array_equal(wide[~angles], usual[~angles])
    assert sorted({round(1e3 * float(each), 9) for each in usual[angles]}) == [1.5, 3.5]
    betas = [usual[i] for i, each in enumerate(arm.parameters) if each.symbol == "beta"]
    assert betas == [3.5e-3, 3.5e-3]  # of links 2 and 3


def error_mm(found, true: np.ndarray) -> float:
    difference = ARM.points(FRESH, found.values) - ARM.points(FRESH, true)
    return 1e3 * float(np.linalg.norm(difference, axis=2).mean())


def test_directions_have_closed_forms() -> None:
    """Two links and a parameter without a prior: what the latter explains says nothing of the former."""
    prior = Prior(np.array([0.0, 1.0, 2.0]), (1, 2), np.diag([1 / 2.0, 1 / 4.0]))
    rows = np.array([[1.0, 0.0, 0.0], [0.0, 10.0, 0.0], [7.0, 0.0, 0.5]])
    values = np.array([5.0, 1.2, 3.0])
    found = directions_of(prior, rows, np.zeros(3), (0, 1, 2), values)
    left = 0.5 * np.sqrt(1 / 50)  # of the last column, beside the first
    np.testing.assert_allclose(found.stds, [1 / (10 * 2), 1 / (left * 4)])
    np.testing.assert_allclose(np.abs(found.values), [0.1, 0.25])
    np.testing.assert_allclose(found.weak(0.04), [True, True])
    np.testing.assert_allclose(found.weak(1.0), [False, True])
    far = directions_of(prior, rows, rows @ [0.0, 0.3, 0.8], (0, 1, 2), values - [0.0, 0.3, 0.8])
    np.testing.assert_allclose(np.abs(far.values), [0.1, 0.25])  # the measurements' own, wherever the fit stands
    blind = directions_of(prior, rows[:2], np.zeros(2), (0, 1, 2), values)
    assert np.isinf(blind.stds[1]) and blind.left_by_prior(1.0) == 1.0


def test_the_scale_is_the_most_likely_one_and_never_below_one() -> None:
    rng = np.random.default_rng(0)
    nothing = np.zeros((400, 0))
    stds = rng.uniform(0.01, 3, 400)
    for scale in (0.2, 1.0, 5.0):
        values = scale * rng.normal(size=400) + stds * rng.normal(size=400)
        assert PriorDirections(nothing, stds, values).scale()[0] == pytest.approx(max(scale, 1.0), rel=0.15)
    far = np.append(rng.normal(size=20), 2_000.0), np.append(np.full(20, 0.1), 1_000.0)
    assert (
        PriorDirections(nothing, far[1], far[0]).scale()[0] < 1.5
    )  # what is hardly measured says nothing of the scale


def test_a_fit_that_is_measured_well_stays_exactly_as_it_is() -> None:
    data, _ = campaign(0, 50, 8e-6, AWAY)
    for noise in (None, Noise(sigma_m=8e-6)):
        plain, found = identify(ARM, data, NOMINAL, noise), identify(ARM, data, NOMINAL, noise, AUTO)
        assert found.prior is None
        np.testing.assert_array_equal(plain.values, found.values)
        np.testing.assert_array_equal(plain.covariance, found.covariance)
        np.testing.assert_array_equal(plain.fit.singular_values, found.fit.singular_values)


@pytest.mark.parametrize("target", [NEAR_AXIS, AWAY])
def test_without_noise_the_arm_is_found_exactly(target) -> None:
    data, true = campaign(1, 40, 0.0, target, 3.0)
    found = identify(ARM, data, NOMINAL, None, AUTO)
    assert found.prior is None and error_mm(found, true) < 1e-6


def test_what_positions_hardly_show_stays_near_nominal() -> None:
    """Along other directions the fit is the same, to a part of what noise makes of it."""
    data, true = campaign(2, 40, 1e-4)
    noise = Noise(sigma_m=1e-4)
    plain, found = identify(ARM, data, NOMINAL, noise), identify(ARM, data, NOMINAL, noise, AUTO)
    assert found.prior is not None and 1 <= found.prior.acts_in <= 3 and found.status == "converged"
    assert found.fit.condition < 0.5 * plain.fit.condition
    assert found.plain_condition == pytest.approx(plain.fit.condition, rel=0.3)
    free = list(found.fit.free)
    assert free == list(plain.fit.free)
    i = free.index(ARM.names.index("link5.theta"))
    assert found.std[i] < 0.7 * plain.std[i] and found.std[i] < 2.5e-3
    rows = ARM.observe(data.joints, found.values)[1].reshape(-1, len(ARM.names))[:, free] / 1e-4
    moved = rows @ (found.values - plain.values)[free]
    assert np.sqrt(moved @ moved) < 3.0  # chi squared of as few directions, not of 27
    assert error_mm(found, true) < 1.1 * error_mm(plain, true)


def test_links_of_a_joint_that_did_not_move_stay_near_nominal() -> None:
    """Without a prior they are held there, as if they were known exactly."""
    data, true = campaign(4, 40, 1e-5, AWAY, still=1)
    plain = identify(ARM, data, NOMINAL)
    found = identify(ARM, data, NOMINAL, None, AUTO)
    named = {ARM.names[i] for i in plain.unobservable}
    assert named and not {ARM.names[i] for i in found.unobservable} & {n for n in named if n.startswith("link")}
    assert found.prior is not None and np.isinf(found.plain_condition) and found.fit.condition < 1e6
    fresh = FRESH.copy()
    for stood, least in ((0.3, 0.0), (1.3, 1e-4)):  # where it was, and where it was not
        fresh[:, 1] = stood
        rows = ARM.observe(fresh, found.values)[1][:, 0][..., list(found.fit.free)]
        std = np.sqrt(np.diagonal(rows @ found.covariance @ rows.swapaxes(1, 2), axis1=1, axis2=2))
        error = np.abs(ARM.points(fresh, found.values) - ARM.points(fresh, true))[:, 0]
        assert np.median(std) > least and np.sqrt(np.mean((error / std) ** 2)) < 2
    few, _ = campaign(4, 6, 1e-5)
    with pytest.raises(LabError, match="6 poses, but the 27 identifiable parameters need"):
        identify(ARM, few, NOMINAL, Noise(sigma_m=1e-5), AUTO)


@pytest.mark.parametrize("noise", [Noise(), Noise(sigma_m=8e-6)])
def test_outliers_are_found_beside_it(noise: Noise) -> None:
    """They inflate the residuals, by which the fit weighs the prior; the search for them weighs it by the others."""
    data, _ = campaign(5, 50, 8e-6, AWAY)
    rng = np.random.default_rng(1)
    off = [4, 11, 17, 23, 29, 35, 41]
    data.points[off] += rng.uniform(5e-3, 50e-3, (7, 1, 1)) * rng.normal(size=(7, 1, 3))
    found = identify(ARM, data, NOMINAL, noise, AUTO)
    assert found.prior is not None and found.prior.acts_in > 3
    assert sorted(outliers_among_fitted(found, data, noise, NoiseDistribution(), 0).rows) == off
    without = identify(ARM, data[np.setdiff1d(np.arange(50), off)], NOMINAL, noise, AUTO)
    assert without.prior is None


@pytest.mark.thorough
@pytest.mark.parametrize(("times", "target", "sigma_m", "poses"), [
    (1.0, NEAR_AXIS, 5e-5, 30), (3.0, AWAY, 2e-4, 14),
])  # fmt: skip
def test_intervals_hold_and_accuracy_is_never_the_price(times, target, sigma_m, poses) -> None:
    """Intervals at fresh poses of 60 arms within, or three times beyond, their tolerances; errors beside no prior's."""
    inside, errors = [], []
    for seed in range(60):
        data, true = campaign(seed, poses, sigma_m, target, times)
        noise = Noise(sigma_m=sigma_m)
        plain, found = identify(ARM, data, NOMINAL, noise), identify(ARM, data, NOMINAL, noise, AUTO)
        errors.append((error_mm(found, true), error_mm(plain, true)))
        rows = ARM.observe(FRESH, found.values)[1][:, 0][..., list(found.fit.free)]
        std = np.sqrt(np.diagonal(rows @ found.covariance @ rows.swapaxes(1, 2), axis1=1, axis2=2))
        off = np.abs(ARM.points(FRESH, found.values) - ARM.points(FRESH, true))[:, 0]
        inside.append((off <= 1.96 * std).mean())
    assert 0.93 <= np.mean(inside) <= 0.98
    mine, plain_errors = np.mean(errors, axis=0)
    assert mine < (0.97 if times == 1 else 1.005) * plain_errors


@pytest.mark.parametrize(
    ("link", "before_mm", "bad"),
    [("link5.theta", 500.0, False), ("link2.theta", 500.0, True), ("link2.theta", 0.5, False)],
)
def test_a_link_far_from_nominal_is_bad_only_where_positions_show_it(link: str, before_mm: float, bad: bool) -> None:
    """Half a radian, and sure: near the last axis no point shows it; nor is it so where nominal links fit."""
    data, _ = campaign(6, 50, 1e-5)
    found = identify(ARM, data, NOMINAL, Noise(sigma_m=1e-5))
    values = found.nominal_aligned.copy()
    values[ARM.names.index(link)] += 0.5
    surely = replace(found, values=values, covariance=1e-12 * np.eye(len(found.fit.free)))
    errors = Errors(np.full((20, 1), 1e-3 * before_mm), np.full((20, 1), 2e-5))
    judged = verdict(surely, Validation("holdout", errors), None)
    assert judged.farthest is not None and judged.farthest.name == link
    assert (judged.word == "bad") is bad and link in in_one_line(judged.reasons)
