"""Criteria of a user: functions and classes, their slopes, their task, and what is refused."""

from functools import partial
from typing import Any

import numpy as np
import pytest
from helpers.robots import IRB120

import lab
from lab.core.errors import LabError
from lab.kinematics.gauge import base_set
from lab.kinematics.serial.serial_arm import SerialArm
from lab.pose_selection.criteria import Criterion, DesignTask, Scaling, criterion
from lab.pose_selection.exchange import OneCriterion, exchange, information
from lab.pose_selection.own_criterion import prepared

ARM = SerialArm(IRB120.chain)
KEPT = list(base_set(ARM, ARM.nominal()).identifiable)
PARAMETERS = tuple(ARM.parameters[i] for i in KEPT)
NAMES = [parameter.name for parameter in PARAMETERS]


def of_function(function: Any) -> Any:
    return Criterion._kind.of_function(function)


def jacobian(poses: int, seed: int) -> np.ndarray:
    joints = IRB120.chain.random_joints(poses, np.random.default_rng(seed))
    return ARM.observe(joints, ARM.nominal())[1][:, 0][..., KEPT]


UNITS = Scaling("whitened").tolerances(PARAMETERS)
TASK = DesignTask(PARAMETERS, UNITS, UNITS, jacobian(40, 9))


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
        own = [each.group == "link" and each.kind == "length" for each in self.task.parameters]
        return -np.log(self.covariance(information)[..., own, own].sum(axis=-1))


def test_a_criterion_knows_which_row_is_which_parameter() -> None:
    """Its design shows the lengths better than O1's."""
    own, joints = LinkLengths(), IRB120.chain.random_joints(60, np.random.default_rng(3))
    pool, goal = jacobian(60, 3), own.for_task(TASK)
    mine, o1 = (
        exchange(joints, pool, 14, each, np.random.default_rng(0), starts=1) for each in (goal, criterion("O1", 27))
    )
    assert mine.score == goal.score(information(mine.jacobian)) > goal.score(information(o1.jacobian)) + 0.05
    assert own.task is None and own.names == ()
    lengths = [i for i, name in enumerate(NAMES) if name.startswith("link") and name.endswith((".a", ".d"))]
    rows = jacobian(15, 3).reshape(-1, len(NAMES))
    covariance = np.linalg.inv(rows.T @ rows)
    expected = -np.log(sum(covariance[i, i] for i in lengths))
    assert own.for_task(TASK).score(rows.T @ rows) == pytest.approx(expected)


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
    "inf": ({"score": lambda self, m: np.full(m.shape[:-2], np.inf)}, "returns inf; return a finite score"),
    "complex": ({"score": lambda self, m: np.linalg.slogdet(m)[1] + 0j}, "its scores are complex numbers"),
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
    "wrong slope": (
        {"slope": lambda self, m: 1.01 * Criterion.slope(self, m)},
        r"has a slope that is not its score's: \S+ along a pose where differences of the score give \S+; correct it",
    ),
    "weight": ({"weight": np.eye(27)}, r"has a weight W, but its score is not -log tr\(W M\^-1\); set weight to None"),
    "narrow": ({"weight": np.eye(3)}, r"has a weight of shape \(3, 3\) for 27 parameters; give \(27, 27\)"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_criterion_is_refused_in_one_line(name: str) -> None:
    changed, said = WRONG[name]
    own = type("Wrong", (LinkLengths,), {"name": "wrong", **changed})()
    with pytest.raises(LabError, match=f"^criterion 'wrong':? {said}") as raised:
        prepared(own, TASK, jacobian(60, 3)).slope(np.eye(len(NAMES)))
    assert "\n" not in str(raised.value)


def worst(information: np.ndarray) -> np.ndarray:
    """Return the smallest eigenvalue."""
    return np.linalg.eigvalsh(information)[..., 0]


def near_the_task(information: np.ndarray, task: DesignTask) -> np.ndarray:
    """Return the mean predicted variance at the task's poses, as criterion I: for one matrix alone."""
    return -np.log(np.mean([np.trace(each @ np.linalg.solve(information, each.T)) for each in task.jacobians]))


FUNCTIONS: dict[str, tuple[Any, str, str]] = {
    "a lambda": (lambda m: np.linalg.slogdet(m)[1], "lambda", "O1"),
    "a function": (worst, "worst", "O3"),
    "one matrix alone": (lambda m: -np.log(np.trace(np.linalg.inv(m))), "lambda", "A"),
    "with the task": (near_the_task, "near_the_task", "I"),
    "a partial": (partial(worst), "function", "O3"),
}


@pytest.mark.parametrize("which", FUNCTIONS)
def test_a_function_is_a_criterion(which: str) -> None:
    """It ranks designs as the criterion of the lab that it repeats."""
    function, name, index = FUNCTIONS[which]
    goal = prepared(of_function(function), TASK, jacobian(60, 3))
    assert goal.name == name
    rows = np.stack([jacobian(15, seed) for seed in range(20)]).reshape(20, -1, 27)
    matrices = np.swapaxes(rows, 1, 2) @ rows
    known = criterion(index, 27, TASK.jacobians).score(matrices)
    np.testing.assert_array_equal(np.argsort(goal.score(matrices)), np.argsort(known))
    assert goal.score(matrices[0]) == pytest.approx(goal.score(matrices)[0])


def test_a_matrix_without_an_inverse_is_worse_than_any() -> None:
    goal = prepared(of_function(lambda m: -np.trace(np.linalg.inv(m))), TASK, jacobian(60, 3))
    rows = jacobian(15, 0).reshape(-1, 27)
    whole = rows.T @ rows
    assert goal.score(np.zeros((27, 27))) == -np.inf
    assert goal.score(np.stack([whole, np.zeros((27, 27))])).tolist() == [goal.score(whole), -np.inf]


@pytest.mark.parametrize("name", ["O1", "O2", "O3", "O4", "O5"])
def test_the_slope_of_a_function_of_singular_values_is_exact(name: str) -> None:
    known = criterion(name, 27)
    own = prepared(of_function(lambda m: known.score(m)), TASK, jacobian(60, 3))
    rows = jacobian(15, 4).reshape(-1, 27)
    slope = known.slope(rows.T @ rows)
    np.testing.assert_allclose(own.slope(rows.T @ rows), slope, atol=1e-9 * np.abs(slope).max(), rtol=0)


def test_the_slope_of_a_weight_is_exact() -> None:
    known = criterion("I", 27, TASK.jacobians)
    own = type("Own", (Criterion,), {"name": "own", "weight": known.weight, "score": lambda self, m: known.score(m)})()
    rows = jacobian(15, 4).reshape(-1, 27)
    goal = prepared(own, TASK, jacobian(60, 3))
    np.testing.assert_allclose(goal.slope(rows.T @ rows), known.slope(rows.T @ rows), rtol=1e-12)


def test_a_right_slope_of_one_s_own_is_taken() -> None:
    """A triangular derivative counts entries once; only its symmetric part matters."""
    product = criterion("O1", 27)

    def triangular(self: Criterion, matrix: np.ndarray) -> np.ndarray:
        slope = product.slope(matrix)
        return np.tril(slope) + np.tril(slope, -1)

    own = type("Own", (Product,), {"slope": triangular})()
    rows = jacobian(15, 4).reshape(-1, 27)
    goal = prepared(own, TASK, jacobian(60, 3))
    slope = product.slope(rows.T @ rows)
    np.testing.assert_allclose(goal.slope(rows.T @ rows), slope, atol=1e-12 * np.abs(slope).max(), rtol=0)


def test_a_score_alone_chooses_the_poses_of_o1() -> None:
    pool, joints = jacobian(400, 3), IRB120.chain.random_joints(400, np.random.default_rng(3))
    own = prepared(Product(), TASK, pool)
    mine, known = (
        exchange(joints, pool, 20, goal, np.random.default_rng(5), starts=2) for goal in (own, criterion("O1", 27))
    )
    np.testing.assert_array_equal(mine.rows, known.rows)


@pytest.mark.parametrize("score", [Product.score, LinkLengths.score])
def test_the_ascent_by_scores_is_that_by_slopes(score: Any) -> None:
    """A score of singular values has a cheap slope; of another, differences by the inputs are fewer."""

    def sensitivity(joints: np.ndarray) -> np.ndarray:
        return ARM.observe(joints, ARM.nominal())[1][:, 0][..., KEPT] * TASK.units

    joints = IRB120.chain.random_joints(14, np.random.default_rng(3))
    own = type("Own", (Criterion,), {"name": "own", "score": score})()
    goal = prepared(own, TASK, sensitivity(IRB120.chain.random_joints(60, np.random.default_rng(4))))
    uphill = OneCriterion(sensitivity, goal).uphill(joints)[1]
    exact = OneCriterion(sensitivity, own.for_task(TASK)).uphill(joints)[1]
    np.testing.assert_allclose(uphill, exact, atol=1e-5 * np.abs(exact).max(), rtol=0)


def test_a_design_hands_its_criterion_the_task() -> None:
    """Its units turn the covariance of the information into that of the parameters, in SI."""
    seen: list[DesignTask] = []

    def lengths_mm(information: np.ndarray, task: DesignTask) -> np.ndarray:
        seen.append(task)
        which = [each.group == "link" and each.kind == "length" for each in task.parameters]
        return -np.log(np.trace((np.linalg.inv(information) * np.outer(task.units, task.units))[which][:, which]))

    plan = lab.design("irb120", poses=12, candidates=60, starts=1, criterion=lengths_mm, no_check=True)
    assert plan.to_dict()["criterion"] == "lengths_mm" and seen[0] is plan.task
    si = np.linalg.inv(information(plan.problem.whitened(plan.joints)))
    np.testing.assert_allclose(
        np.linalg.inv(plan.information) * np.outer(plan.task.units, plan.task.units), si, rtol=1e-6, atol=1e-18
    )
