"""Very many rows: worked out block by block, they say what they say all at once, and nothing grows with their pairs."""

import numpy as np
import pytest
from helpers.robots import IRB120, perturbed, somewhere

from lab.calibration import gauss_newton
from lab.calibration import identification as identify
from lab.calibration import noise_search as search
from lab.calibration.gauss_newton import Observations, fit
from lab.calibration.statistics import linearized as linear_problem
from lab.calibration.statistics import outliers
from lab.calibration.statistics.goodness_of_fit import sandwich
from lab.calibration.statistics.linearized import linearized
from lab.calibration.statistics.outliers import find_outliers
from lab.calibration.weights import Noise
from lab.core.measurements import measured
from lab.core.se3 import Array
from lab.kinematics.gauge import base_set
from lab.kinematics.serial.serial_arm import SerialArm

ARM = SerialArm(IRB120.chain)
FREE = base_set(ARM, ARM.nominal()).identifiable
POSES, SIGMA = 240, 8e-6


def seen(poses: int = POSES, far: float = 1.0) -> tuple[Observations, Array]:
    rng = np.random.default_rng(3)
    start = somewhere(ARM, rng)
    truth = perturbed(ARM, start, rng, far * 0.5e-3, far * 1.5e-3)
    joints = IRB120.chain.random_joints(poses, rng)
    points = ARM.points(joints, truth) + SIGMA * rng.standard_normal((poses, 1, 3))
    points[5] = np.nan
    return Observations(joints, points, np.full((poses, 1), 1 / SIGMA)), start


@pytest.fixture
def blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few rows are many."""
    monkeypatch.setattr(gauss_newton, "_BLOCK", 3 * 70)
    monkeypatch.setattr(gauss_newton, "_FIRST_POSES", 60)
    monkeypatch.setattr(identify, "_FIRST_POSES", 60)
    monkeypatch.setattr(outliers, "_FIRST_POSES", 60)
    monkeypatch.setattr(linear_problem, "_BLOCK", 5_000)


@pytest.mark.parametrize("far", [1.0, 300.0], ids=["near", "damped"])
def test_a_fit_block_by_block_is_that_of_all_rows(request: pytest.FixtureRequest, far: float) -> None:
    observed, start = seen(far=far)
    whole = fit(ARM, observed, FREE, start)
    request.getfixturevalue("blocks")
    assert len(list(observed.blocks())) == 4
    parts = fit(ARM, observed, FREE, start)
    assert parts.status == whole.status == "converged"
    std = np.sqrt(np.diag(whole.unit_covariance()))
    assert np.abs((parts.values - whole.values)[list(FREE)] / std).max() < 1e-6
    np.testing.assert_allclose(parts.unit_covariance(), whole.unit_covariance(), rtol=1e-6, atol=1e-20)


def test_statistics_block_by_block_are_those_of_all_rows(request: pytest.FixtureRequest) -> None:
    observed, start = seen()
    found = fit(ARM, observed, FREE, start)
    errors = np.random.default_rng(1).standard_normal((2, POSES, 3))

    def told() -> list[Array]:
        linear = linearized(ARM, observed, found.values, FREE)
        within = linear.within(np.arange(POSES) % 3 > 0)
        return [linear.jacobian, within.left(), within.root, within.residuals(errors), sandwich(linear).covariance]

    whole = told()
    request.getfixturevalue("blocks")
    for one, other in zip(whole, told(), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-9 * np.abs(one).max())


def test_the_sandwich_s_freedom_is_that_of_the_products_of_all_pairs() -> None:
    observed, start = seen(60)
    found = fit(ARM, observed, FREE, start)
    linear = linearized(ARM, observed, found.values, FREE)
    within, given = linear.everywhere(), sandwich(linear)
    basis = np.concatenate([part for _, part in within.basis()])
    bent = within.root @ basis
    for j, row in enumerate(within.back):
        pulls = bent @ row
        shared = np.einsum("nmf,nm->nf", basis, pulls)
        products = np.diag((pulls**2).sum(axis=1)) - shared @ shared.T
        assert given.dof[j] == pytest.approx(np.trace(products) ** 2 / (products**2).sum(), rel=1e-9)


@pytest.mark.usefixtures("blocks")
def test_outliers_among_many_are_found() -> None:
    observed, start = seen()
    observed.points[[20, 150, 230], 0, 0] += [1e-3, -2e-4, 5e-4]
    found = find_outliers(ARM, observed, FREE, start, sigma_given=True, rng=np.random.default_rng(0))
    assert found.rows.tolist() == [20, 230, 150]


def test_the_noise_of_many_rows_is_that_of_stretches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "_MOST_POSES", 80)
    observed, _ = seen()
    data = measured(IRB120.chain.joint_names, observed.inputs, ("p1",), observed.points)
    rows = search.in_stretches(data)
    numbers = np.array([int(name) for name in rows.ids])
    assert len(rows) == 80 and numbers[0] == 0 and numbers[-1] == POSES - 1
    assert (np.diff(numbers) == 1).sum() == 72
    data = data[data.seen.any(axis=1)]
    found = identify.identify(ARM, data, ARM.nominal(), Noise(sigma_m=SIGMA))
    assert search.search_noise(found, data, Noise(sigma_m=SIGMA)).shared is None
