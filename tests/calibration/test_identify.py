"""The identifier: recovery, rank, start from anywhere, weights, and what it says when it cannot."""

import numpy as np
import pytest
from helpers.robots import IRB120, SCARA, VERSATRAN, chain_of, somewhere
from helpers.truths import truth_of
from scipy import stats

from lab.calibration.gauss_newton import Observations, fit
from lab.calibration.guess import initial_guess
from lab.calibration.identification import _canonical, identify
from lab.calibration.weights import Noise
from lab.core.errors import LabError
from lab.core.measurements import measured
from lab.kinematics.serial.serial_arm import SerialArm
from lab.noise.instruments import INSTRUMENTS
from lab.prediction.ellipsoids import ellipsoids, mapping_ellipsoids, position_covariance
from lab.prediction.validation import compare_with_truth, errors_at

ARM = SerialArm(IRB120.chain)
NAMES = IRB120.chain.joint_names


# Arms whose last joint slides: the tool then is fixed in part, at the drawing's place.
RRP = chain_of("rrp", "distal", "RRP", [-90, 90, 0], [0, 0, 0], [0, 0, 0], [0.3, 0.1, 0.2])
RRRP = chain_of("rrrp", "craig", "RRRP", [0, -90, 0, 90], [0, 0, 0.4, 0.1], [0, 0, 0, 0], [0, 0.1, 0, 0])


@pytest.mark.sampled(2)
@pytest.mark.parametrize("chain", [IRB120.chain, SCARA, VERSATRAN, RRP, RRRP], ids=lambda chain: chain.name)
def test_exact_measurements_give_the_truth(chain) -> None:
    """Every canonical parameter to 1e-11 m or rad, from a base turned and moved anyhow, in few steps."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        arm = SerialArm(chain)
        truth = truth_of(arm, rng)
        joints = chain.random_joints(50, rng)
        data = measured(chain.joint_names, joints, ("p1",), arm.points(joints, truth.values))
        found = identify(arm, data, arm.nominal())
        assert found.status == "converged" and found.fit.iterations <= 8
        assert found.base_set.identifiable == truth.base_set.identifiable
        assert np.abs(compare_with_truth(found, truth).error).max() < 1e-11
        fresh = chain.random_joints(500, rng)
        np.testing.assert_allclose(arm.points(fresh, found.values), arm.points(fresh, truth.values), atol=1e-12)


def test_what_no_pose_can_place_stays_nominal() -> None:
    """A SCARA's target can be as much higher as its base is lower: it stays where the drawing has it."""
    rng, arm = np.random.default_rng(4), SerialArm(SCARA)
    truth = truth_of(arm, rng)
    joints = SCARA.random_joints(30, rng)
    data = measured(SCARA.joint_names, joints, ("p1",), arm.points(joints, truth.values))
    nominal = arm.nominal({"p1": np.array([0.02, 0.01, -0.123])})
    placed = identify(arm, data, nominal).nominal_aligned
    assert placed[-1] == -0.123 and (placed[:6] != 0).all() and (placed[-3:-1] != nominal[-3:-1]).all()


def test_four_points_place_a_base_with_the_nominal_tool() -> None:
    """Twelve numbers for the fifteen of the direct way: the shortest solution is of no use, the nominal tool's is."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        values, joints = ARM.nominal(), IRB120.chain.random_joints(4, rng)
        values[:6] = rng.normal(size=6)
        observed = Observations.unweighted(measured(NAMES, joints, ("p1",), ARM.points(joints, values)))
        guess = initial_guess(ARM, observed, ARM.nominal())
        np.testing.assert_allclose(ARM.points(joints, guess), observed.points, atol=1e-12)
        np.testing.assert_allclose(guess, values, atol=1e-9)


@pytest.mark.parametrize(("share", "told"), [(1.0, False), (0.03, True)])
def test_poses_that_are_nearly_alike_are_told(share: float, told: bool) -> None:
    rng = np.random.default_rng(2)
    truth = truth_of(ARM, rng)
    joints = share * IRB120.chain.random_joints(60, rng)
    data = measured(NAMES, joints, ("p1",), ARM.points(joints, truth.values))
    found = identify(ARM, data, ARM.nominal(), Noise(sigma_m=5e-6))
    assert found.fit.ill_conditioned == told
    assert any(each.name == "parameters.condition" for each in found.checks) == told


def test_at_the_statistical_floor() -> None:
    """50 poses, 8 microns uniform: fresh-pose errors at sqrt(27/50) sigma, and intervals that hold."""
    means, held, nees = [], [], []
    device = INSTRUMENTS["uniform-8um"]
    for seed in range(40):
        rng = np.random.default_rng(seed)
        truth = truth_of(ARM, rng)
        joints = IRB120.chain.random_joints(50, rng)
        points = device.sample(ARM.points(joints, truth.values), rng)
        found = identify(ARM, measured(NAMES, joints, ("p1",), points), ARM.nominal(), Noise(device))
        fresh = IRB120.chain.random_joints(300, rng)
        errors = errors_at(found, fresh, ARM.points(fresh, truth.values))
        comparison = compare_with_truth(found, truth)
        means.append(errors.after.mean())
        held.append(comparison.coverage_95)
        nees.append(comparison.nees_per_parameter)
        predicted = np.sqrt(np.trace(position_covariance(found, fresh), axis1=1, axis2=2).mean())
        assert predicted == pytest.approx(1.1 * np.sqrt(27 / 50) * 8e-6 / np.sqrt(3), rel=0.15)
    assert 3.3e-6 < np.mean(means) < 4.1e-6
    assert np.mean(held) == pytest.approx(0.95, abs=0.02)  # 1,080 intervals: 3 sigma is 0.02
    assert np.mean(nees) == pytest.approx(1.0, abs=0.13)  # 40 means of 27: 3 sigma is 0.13


def test_an_estimated_sigma_takes_students_t() -> None:
    """12 poses leave 9 degrees of freedom: normal intervals would hold too rarely."""
    held, narrow = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        truth = truth_of(ARM, rng)
        joints = IRB120.chain.random_joints(12, rng)
        points = ARM.points(joints, truth.values) + 5e-6 * rng.normal(size=(12, 1, 3))
        found = identify(ARM, measured(NAMES, joints, ("p1",), points), ARM.nominal())
        assert not found.sigma_given and found.dof == 9
        assert found.half_width_95 == pytest.approx(stats.t.ppf(0.975, 9))
        comparison = compare_with_truth(found, truth)
        held.append(comparison.coverage_95)
        narrow.append(np.mean(np.abs(comparison.z) < 1.96))
    assert np.mean(held) == pytest.approx(0.95, abs=0.035)  # campaigns spread by 0.09: 3 sigma of 60
    assert np.mean(narrow) < 0.93


def test_a_rows_own_sigma_counts() -> None:
    """Ten rows off by a millimetre, and said to be: the result is that of the other forty."""
    rng = np.random.default_rng(0)
    truth = truth_of(ARM, rng)
    joints = IRB120.chain.random_joints(50, rng)
    points = ARM.points(joints, truth.values) + 5e-6 * rng.normal(size=(50, 1, 3))
    points[:10] += 1e-3 * rng.normal(size=(10, 1, 3))
    sigma = np.where(np.arange(50) < 10, 1e-3, 5e-6)
    data = measured(NAMES, joints, ("p1",), points)
    data = type(data)(**{**data.__dict__, "sigma_m": sigma})
    good = data[10:50]
    all_rows, forty = identify(ARM, data, ARM.nominal()), identify(ARM, good, ARM.nominal())
    assert np.abs((all_rows.values - forty.values)[list(forty.fit.free)] / forty.std).max() < 0.05
    blind = identify(ARM, measured(NAMES, joints, ("p1",), points), ARM.nominal())
    assert np.abs((blind.values - forty.values)[list(forty.fit.free)] / forty.std).max() > 5


def test_three_targets_where_some_are_unseen() -> None:
    arm = SerialArm(IRB120.chain, ("p1", "p2", "p3"))
    rng = np.random.default_rng(1)
    truth = truth_of(arm, rng)
    joints = IRB120.chain.random_joints(40, rng)
    points = arm.points(joints, truth.values)
    points[rng.random((40, 3)) < 0.4] = np.nan
    found = identify(arm, measured(NAMES, joints, arm.targets, points), arm.nominal())
    assert len(found.fit.free) == 33 and found.status == "converged"
    assert np.abs(compare_with_truth(found, truth).error).max() < 1e-11


def test_an_unidentifiable_parameter_left_in_is_reported() -> None:
    """Freeing link2.d beside link3.d leaves the rank one short, the condition without bound, the step finite."""
    rng = np.random.default_rng(2)
    truth = truth_of(ARM, rng)
    joints = IRB120.chain.random_joints(50, rng)
    data = measured(NAMES, joints, ("p1",), ARM.points(joints, truth.values))
    start = truth.values.copy()
    start[list(truth.base_set.fixed)] = ARM.nominal()[list(truth.base_set.fixed)]
    rank_point = ARM.rank_point(somewhere(ARM, rng))
    seen = Observations.unweighted(measured(NAMES, joints, ("p1",), ARM.points(joints, rank_point)))
    free = sorted([*truth.base_set.identifiable, ARM.names.index("link2.d")])
    solution = fit(ARM, seen, free, rank_point)
    assert solution.rank == 27 < len(free)
    assert solution.condition > 1e9 and solution.ill_conditioned
    assert np.isfinite(solution.values).all()
    whole = fit(ARM, Observations.unweighted(data), truth.base_set.identifiable, start)
    assert whole.rank == 27 and whole.condition < 1e3 and not whole.ill_conditioned


def test_too_few_poses_say_how_many_are_needed() -> None:
    rng = np.random.default_rng(4)
    joints = IRB120.chain.random_joints(8, rng)
    with pytest.raises(LabError, match=r"8 poses, but the 27 .* at least 9"):
        identify(ARM, measured(NAMES, joints, ("p1",), ARM.points(joints, ARM.nominal())), ARM.nominal())
    joints = IRB120.chain.random_joints(9, rng)
    found = identify(ARM, measured(NAMES, joints, ("p1",), ARM.points(joints, somewhere(ARM, rng))), ARM.nominal())
    assert found.dof == 0 and np.isnan(found.sigma_m) and np.isnan(found.half_width_95).all()


def test_ellipsoids_are_the_images_of_the_unit_ball() -> None:
    rng = np.random.default_rng(7)
    truth = truth_of(ARM, rng)
    joints = IRB120.chain.random_joints(30, rng)
    points = ARM.points(joints, truth.values) + 5e-6 * rng.normal(size=(30, 1, 3))
    found = identify(ARM, measured(NAMES, joints, ("p1",), points), ARM.nominal())
    shape = mapping_ellipsoids(found, joints)
    _, jacobian = ARM.observe(joints, found.values)
    scaled = jacobian[:, 0][..., list(found.fit.free)] / found.fit.scale
    np.testing.assert_allclose(np.linalg.det(shape.axes), 1, atol=1e-12)
    np.testing.assert_allclose(shape.half_lengths, np.linalg.svd(scaled, compute_uv=False), rtol=1e-9)
    ball = rng.normal(size=(27, 2000))
    ball /= np.linalg.norm(ball, axis=0)
    for pose in range(30):
        image = shape.axes[pose].T @ scaled[pose] @ ball
        inside = ((image / shape.half_lengths[pose][:, None]) ** 2).sum(axis=0)
        assert inside.max() <= 1 + 1e-9
    flat = ellipsoids(np.diag([4.0, 0.0, 1.0])[None])
    np.testing.assert_allclose(flat.half_lengths, [[2, 1, 0]], atol=1e-15)


def test_another_rotation_vector_has_the_covariance_of_a_fit_from_there() -> None:
    """The long way round, by more than half a turn, and the short one are one rotation."""
    rng = np.random.default_rng(11)
    truth = truth_of(ARM, rng)
    short, long = truth.values.copy(), truth.values.copy()
    short[3:6] = -(np.pi - 0.4) * np.array([0.6, 0.0, 0.8])
    long[3:6] = (np.pi + 0.4) * np.array([0.6, 0.0, 0.8])
    joints = IRB120.chain.random_joints(40, rng)
    np.testing.assert_allclose(ARM.points(joints, short), ARM.points(joints, long), atol=1e-13)
    seen = Observations.unweighted(measured(NAMES, joints, ("p1",), ARM.points(joints, short)))
    there, here = (fit(ARM, seen, truth.base_set.identifiable, values) for values in (long, short))
    assert np.linalg.norm(there.values[3:6]) > np.pi
    canonical = _canonical(ARM, there)
    np.testing.assert_allclose(canonical.values, here.values, atol=1e-9)
    expected = here.unit_covariance()
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        canonical.unit_covariance() / np.outer(size, size), expected / np.outer(size, size), atol=1e-8
    )
