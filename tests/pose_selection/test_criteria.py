"""Observability indices: closed forms, identities, scaling, and slopes."""

from typing import Any

import numpy as np
import pytest
from helpers.robots import IRB120

from lab.core.errors import LabError
from lab.kinematics.gauge import base_set
from lab.kinematics.serial.serial_arm import SerialArm
from lab.pose_selection.criteria import CRITERIA, Scaling, criterion, indices

ARM = SerialArm(IRB120.chain)
KEPT = list(base_set(ARM, ARM.nominal()).identifiable)
PARAMETERS = [ARM.parameters[i] for i in KEPT]
NAMES = [parameter.name for parameter in PARAMETERS]


def jacobian(poses: int, seed: int) -> np.ndarray:
    joints = IRB120.chain.random_joints(poses, np.random.default_rng(seed))
    return ARM.observe(joints, ARM.nominal())[1][:, 0][..., KEPT]


def test_closed_forms() -> None:
    """Two poses whose stacked Jacobian has the singular values 4, 2, 1."""
    rng = np.random.default_rng(0)
    u, v = np.linalg.qr(rng.normal(size=(6, 3)))[0], np.linalg.qr(rng.normal(size=(3, 3)))[0]
    found = indices((u * [4.0, 2, 1] @ v).reshape(2, 3, 3), test=np.eye(3)[None])
    expected = {"o1": 2 / np.sqrt(2), "o2": 1 / 4, "o3": 1, "o4": 1 / 4, "o5": 4 / 7, "condition": 4, "a": 21 / 16}
    for name, value in expected.items():
        assert getattr(found, name) == pytest.approx(value), name
    assert found.g == found.i == pytest.approx(found.a)  # one test pose with J = 1: the trace of the covariance


def test_a_design_that_misses_a_parameter_is_worth_nothing() -> None:
    blind = jacobian(15, 0)
    blind[..., 3] = 0.0
    found = indices(blind)
    assert found.o1 == found.o2 == found.o3 == found.o4 == found.o5 == 0
    assert found.condition == found.a == np.inf
    test = jacobian(40, 1)
    seen = indices(blind, test)
    assert seen.g == seen.i == np.inf
    goal = criterion("G", 27, test)
    flat, whole = blind.reshape(-1, 27), jacobian(15, 0).reshape(-1, 27)
    assert goal.score(flat.T @ flat) < goal.score(whole.T @ whole) - 10


def test_scalings_are_what_they_say() -> None:
    pool = jacobian(300, 0)
    raw = pool * Scaling("raw").columns(PARAMETERS, pool)
    alpha, length = NAMES.index("link3.alpha"), NAMES.index("link3.a")
    np.testing.assert_allclose(raw[..., length], pool[..., length])  # mm per mm
    np.testing.assert_allclose(raw[..., alpha], 1e3 * pool[..., alpha])  # mm per rad
    unit = pool * Scaling("unit").columns(PARAMETERS, pool)
    np.testing.assert_allclose((unit**2).sum(axis=(0, 1)) / len(pool), 1)
    tolerances = Scaling("whitened", tolerance_m=2e-3, tolerance_rad=1e-3).columns(PARAMETERS, pool)
    assert tolerances[length] == 2e-3 and tolerances[alpha] == 1e-3


@pytest.mark.parametrize(("kind", "reading_m"), [("raw", 1e-3), ("length", 1e-3), ("unit", 1.0), ("whitened", 1.0)])
def test_units_are_the_size_of_one_of_each_scaled_parameter(kind: Any, reading_m: float) -> None:
    """A step of one unit moves a point by the scaled Jacobian, in units of the reading."""
    scaling, pool = Scaling(kind), jacobian(300, 0)
    units, scaled = scaling.units(PARAMETERS, pool), pool * scaling.columns(PARAMETERS, pool)
    np.testing.assert_allclose(pool * units, scaled * reading_m, rtol=1e-12)
    assert set(scaling.tolerances(PARAMETERS)) == {scaling.tolerance_m, scaling.tolerance_rad}


@pytest.mark.parametrize("name", CRITERIA)
def test_every_slope_is_the_derivative_of_its_score(name: str) -> None:
    rng = np.random.default_rng(1)
    test = jacobian(40, 1)
    scale = Scaling("length").columns(PARAMETERS, test)
    flat = (jacobian(20, 2) * scale).reshape(-1, 27)
    information = flat.T @ flat
    goal = criterion(name, 27, test * scale)
    slope = goal.slope(information)
    np.testing.assert_allclose(slope, slope.T, atol=1e-9 * np.abs(slope).max())
    for _ in range(5):
        direction = rng.normal(size=(27, 27))
        direction = direction @ direction.T * np.trace(information) / 27**3
        ahead, back = goal.score(information + 1e-5 * direction), goal.score(information - 1e-5 * direction)
        assert (ahead - back) / 2e-5 == pytest.approx((slope * direction).sum(), rel=1e-4)


@pytest.mark.parametrize("name", CRITERIA)
def test_every_score_ranks_as_its_index(name: str) -> None:
    """Larger is better: for condition, A, G and I that is the smaller index."""
    designs = np.stack([jacobian(15, seed) for seed in range(60)])
    test = jacobian(50, 99)
    goal = criterion(name, 27, test)
    index = getattr(indices(designs, test), name.lower())
    flat = designs.reshape(60, -1, 27)
    score = goal.score(np.swapaxes(flat, 1, 2) @ flat)
    smaller_is_better = name in ("condition", "A", "G", "I")
    np.testing.assert_array_equal(np.argsort(score), np.argsort(-index if smaller_is_better else index))


def test_the_worst_variance_of_one_design_is_that_of_the_design_in_a_stack() -> None:
    test, designs = jacobian(50, 99), np.stack([jacobian(15, seed) for seed in range(3)])
    designs[1, ..., 3] = designs[1, ..., 4]  # it does not part two parameters, and the next one hardly does
    designs[2, ..., 3] = designs[2, ..., 4] + 1e-6 * designs[2, ..., 3]
    flat = designs.reshape(3, -1, 27)
    information = np.swapaxes(flat, 1, 2) @ flat
    goal = criterion("G", 27, test)
    assert [float(goal.score(each)) for each in information] == pytest.approx(goal.score(information))


def test_an_unknown_criterion_lists_those_there_are() -> None:
    with pytest.raises(LabError, match=r"'D'.*O1.*condition.*I"):
        criterion("D", 27)
    with pytest.raises(LabError, match=r"criterion 'o1' is unknown: write O1$"):
        criterion("o1", 27)
