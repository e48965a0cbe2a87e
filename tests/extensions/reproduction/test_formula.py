"""Formulas as textbooks print them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from lab.core.errors import LabError
from lab.extensions.reproduction.formulas import evaluated
from lab.extensions.reproduction.item import source_named
from lab.extensions.reproduction.models import sampled

V = {name: np.linspace(0.2, 1.1, 7) * (i + 1) for i, name in enumerate(("q1", "q2", "q3", "L2", "px", "a"))}
Q1, Q2, Q3, L2, PX, A = V.values()


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("c1 s2 − s1 c2", np.sin(Q2 - Q1)),
        ("c1s2-s1c2", np.sin(Q2 - Q1)),
        ("L2 c23 + L2c123", L2 * np.cos(Q2 + Q3) + L2 * np.cos(Q1 + Q2 + Q3)),
        ("−px^2/2 · 3", -1.5 * PX**2),
        ("−(px + a) (px − a)", A**2 - PX**2),
        ("atan2(−px, a) + √(px² + a²)", np.arctan2(-PX, A) + np.hypot(PX, A)),
        ("a cos(q1)", A * np.cos(Q1)),
        ("2 π − 0.5", np.full(7, 2 * np.pi - 0.5)),
        ("- c1 - - s1", np.sin(Q1) - np.cos(Q1)),
        ("C1 S2 − S1 C2", np.sin(Q2 - Q1)),
        ("cθ1 sθ2 − sθ1 cθ2", np.sin(Q2 - Q1)),
        ("cos θ1 sin θ2 − sin(θ1) cos(theta2)", np.sin(Q2 - Q1)),
        ("c₁ s₂ − s₁ c₂ + L2 c₁₂₃", np.sin(Q2 - Q1) + L2 * np.cos(Q1 + Q2 + Q3)),
        ("arctg(px/a) + arctan2(px, a)", np.arctan(PX / A) + np.arctan2(PX, A)),
        ("θ1 + q2", Q1 + Q2),
    ],
)
def test_a_formula_has_the_value_that_it_says(text: str, value: np.ndarray) -> None:
    assert_allclose(evaluated(text, V), value, atol=1e-14)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "c1 +",
        "c4",
        "θ4",
        "cθ4",
        "C4",
        "c",
        "θ",
        "(c1",
        "c1)",
        "atan2(a)",
        "cos(a, a)",
        "b",
        "px^a",
        "(" * 60,
    ],
)
def test_what_is_no_formula_is_told_with_the_letters(text: str) -> None:
    with pytest.raises(LabError, match="formula"):
        evaluated(text, V)


def test_a_letter_of_the_source_is_its_own_and_not_a_joints() -> None:
    """C and S of the annex are a cosine and a sine; θ1 of a carrier is counted otherwise than q1."""
    v = {"C": np.array([0.3]), "S": np.array([0.4]), "q1": np.array([1.0]), "θ1": np.array([2.0])}
    assert_allclose(evaluated("C^2 + S", v), 0.49)
    assert_allclose(evaluated("θ1 − q1", v), 1.0)


@pytest.mark.parametrize(
    ("robot", "unit", "text", "place"),
    [("scemi", 1.0, "c1 (a3 c2 − r4 s23) + r6 (c1 (c23 c4 s5 + s23 c5)) * 0", None), ("irb120", 1e3, "d4", 302.0),
     ("irb120", 1e3, "a2 + a3 + d6", 412.0), ("scara", 1.0, "a2 + d3", 0.65), ("rx130", 1e3, "r4 + d3", 1250.0)],
)  # fmt: skip
def test_lengths_have_the_letters_of_the_sources_table(robot: str, unit: float, text: str, place: float | None) -> None:
    arm = sampled(robot, unit)
    value = evaluated(text, arm.variables)
    assert_allclose(value, arm.between(0, 4)[:, 0, 3] if place is None else place, atol=1e-9)


def test_an_exercise_takes_letters_where_the_lab_has_numbers() -> None:
    (item,) = source_named("course").chosen("8.3")
    answers = {answer.name: answer for answer in item.answers()}
    for name, right, wrong in (("T2,3(1,4)", "a3", "r6"), ("T3,4(2,4)", "r4", "r6"), ("T0,1(1,1)", "cos θ1", "sin θ1")):
        assert answers[name].check(right) and not answers[name].check(wrong)
