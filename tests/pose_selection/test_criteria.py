"""Observability indices: closed forms, identities, scaling, and slopes."""

from typing import Any

import numpy as np
import pytest
from helpers.robots import IRB120

import lab
from lab.core.errors import LabError
from lab.kinematics.gauge import base_set
from lab.kinematics.serial.serial_arm import SerialArm
from lab.pose_selection.criteria import CRITERIA, Criterion, Scaling, criterion, indices, prepared
from lab.pose_selection.exchange import exchange, information

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


def test_an_unknown_criterion_lists_those_there_are() -> None:
    with pytest.raises(LabError, match=r"'D'.*O1.*condition.*I"):
        criterion("D", 27)
    with pytest.raises(LabError, match=r"criterion 'o1' is unknown: write O1$"):
        criterion("o1", 27)


class Product(Criterion):
    """O1 again, as somebody would write it: by its score alone."""

    name = "product"

    def score(self, information: np.ndarray) -> np.ndarray:
        return np.linalg.slogdet(information)[1]


def test_a_criterion_of_one_s_own_needs_a_score_alone() -> None:
    """Its differences are the derivative."""
    rows = jacobian(9, 3).reshape(-1, len(KEPT))
    information = rows.T @ rows
    known = criterion("O1", len(information))
    own, exact = Product().slope(information), known.slope(information)
    np.testing.assert_allclose(own, exact, atol=1e-7 * np.abs(exact).max(), rtol=0)


@pytest.mark.parametrize("given", [3, Criterion, type("Nameless", (Product,), {"name": None})()])
def test_what_is_no_criterion_is_refused(given: object) -> None:
    with pytest.raises(lab.LabError, match=r"give (a name, or a|an object of a subclass of) lab\.Criterion"):
        lab.design("irb120", criterion=given)


class LinkLengths(Criterion):
    """The trace of the covariance of the links' lengths."""

    name = "lengths"

    def score(self, information: np.ndarray) -> np.ndarray:
        own = [name.startswith("link") and name.endswith((".a", ".d")) for name in self.names]
        return -np.log(self.covariance(information)[..., own, own].sum(axis=-1))


def test_a_criterion_knows_which_row_is_which_parameter() -> None:
    """Its design shows the lengths better than O1's."""
    own, joints = LinkLengths(), IRB120.chain.random_joints(60, np.random.default_rng(3))
    pool, goal = jacobian(60, 3), own.with_names(NAMES)
    mine, o1 = (
        exchange(joints, pool, 14, each, np.random.default_rng(0), starts=1) for each in (goal, criterion("O1", 27))
    )
    assert mine.score == goal.score(information(mine.jacobian)) > goal.score(information(o1.jacobian)) + 0.05
    assert own.names == ()
    lengths = [i for i, name in enumerate(NAMES) if name.startswith("link") and name.endswith((".a", ".d"))]
    rows = jacobian(15, 3).reshape(-1, len(NAMES))
    covariance = np.linalg.inv(rows.T @ rows)
    expected = -np.log(sum(covariance[i, i] for i in lengths))
    assert own.with_names(NAMES).score(rows.T @ rows) == pytest.approx(expected)


def test_the_covariance_of_singular_information_is_larger_than_any() -> None:
    rows = np.stack([jacobian(15, seed).reshape(-1, 27) for seed in range(2)])
    rows[1, :, 4] = 0.0
    whole, blind = Product().covariance(np.swapaxes(rows, 1, 2) @ rows)
    np.testing.assert_allclose(whole @ rows[0].T @ rows[0], np.eye(27), atol=1e-6)
    assert np.isfinite(blind).all() and (np.diag(blind) > 1e100).all()


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "raises": ({"score": lambda self, m: 1 / 0}, "raises ZeroDivisionError: division by zero; repair it"),
    "index": (
        {"score": lambda self, m: m[..., 99, 99]},
        r"raises IndexError: index 99 is out of bounds for axis 1 with size 27; repair it",
    ),
    "shape": (
        {"score": lambda self, m: np.zeros(3)},
        r"returns scores of shape \(3,\) for information of shape \(8, 27, 27\); return \(8,\)",
    ),
    "text": (
        {"score": lambda self, m: "high"},
        "raises ValueError: could not convert string to float: 'high'; repair it",
    ),
    "nan": ({"score": lambda self, m: np.full(m.shape[:-2], np.nan)}, "returns NaN; return a finite score"),
    "equal": (
        {"score": lambda self, m: -np.ones(m.shape[:-2])},
        "gives 8 random sets of 18 poses the same score, -1: it cannot choose",
    ),
    "sign": (
        {"score": lambda self, m: -LinkLengths.score(self, m)},
        "gives 18 poses .*, and .* if each is measured twice; larger is better: turn the sign of its score",
    ),
    "slope": ({"slope": lambda self, m: m["x"]}, "raises IndexError: .*; repair it"),
    "flat slope": ({"slope": lambda self, m: m[0]}, r"returns a slope of shape \(27,\); return \(27, 27\)"),
    "weight": ({"weight": np.eye(27)}, r"has a weight W, but its score is not -log tr\(W M\^-1\); set weight to None"),
    "narrow": ({"weight": np.eye(3)}, r"has a weight of shape \(3, 3\) for 27 parameters; give \(27, 27\)"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_criterion_is_refused_in_one_line(name: str) -> None:
    changed, said = WRONG[name]
    own = type("Wrong", (LinkLengths,), {"name": "wrong", **changed})()
    with pytest.raises(LabError, match=f"^criterion 'wrong' {said}") as raised:
        prepared(own, NAMES, jacobian(60, 3)).slope(np.eye(len(NAMES)))
    assert "\n" not in str(raised.value)
