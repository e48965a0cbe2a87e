"""How printed formulas are evaluated, and when a printed value agrees."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from lab.core.errors import LabError
from lab.extensions.reproduction.answer import at_least, drawn, formula, given, holds, number, unreadable, word
from lab.extensions.reproduction.formulas import evaluated

Q = {"q1": np.linspace(-2, 2, 9)}
V = {name: np.linspace(0.2, 1.1, 7) * (i + 1) for i, name in enumerate(("q1", "q2", "q3", "L2", "px", "a", "θ1"))}
Q1, Q2, Q3, L2, PX, A, THETA = V.values()


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("c1 s2 − s1 c2", np.sin(Q2 - Q1)),
        ("L2 c23 + L2 c123", L2 * np.cos(Q2 + Q3) + L2 * np.cos(Q1 + Q2 + Q3)),
        ("−px^2/2 · 3", -1.5 * PX**2),
        ("−(px + a) (px − a)", A**2 - PX**2),
        ("atan2(−px, a) + √(px^2 + a^2)", np.arctan2(-PX, A) + np.hypot(PX, A)),
        ("a cos(q1) + cos(θ1)", A * np.cos(Q1) + np.cos(THETA)),
        ("2 π − 0.5", np.full(7, 2 * np.pi - 0.5)),
        ("px/(2 a L2)", PX / (2 * A * L2)),
    ],
)
def test_a_formula_has_its_value(text: str, value: np.ndarray) -> None:
    assert_allclose(evaluated(text, V), value, atol=1e-14)


@pytest.mark.parametrize("text", ["", "c1 +", "c4", "c", "(c1", "c1)", "cos(a, a)", "b", "a # 1", "a cos", "3 cos a"])
def test_what_is_no_formula_of_its_letters_is_refused(text: str) -> None:
    with pytest.raises(LabError, match=r"^formula '"):
        evaluated(text, V)


def test_a_letter_comes_before_a_joint() -> None:
    """c2 is a length of the 3-RPR; C and S of the annex are a cosine and a sine."""
    v = {"C": np.array([0.3]), "c2": np.array([0.4]), "q2": np.array([1.0])}
    assert_allclose(evaluated("C^2 + c2 + s2", v), 0.49 + np.sin(1.0))


@pytest.mark.parametrize(
    ("printed", "ours", "agrees"),
    [("27.12", 27.1261, True), ("27.12", 27.1399, False), ("-64.90", -64.895, True), ("374", 374.4, True),
     ("374", 375.0, False), ("0", 1.0, False), ("0.1376", 0.13763, True), ("0.1376", 0.1378, False)],
)  # fmt: skip
def test_a_number_agrees_within_its_last_digit(printed: str, ours: float, agrees: bool) -> None:
    assert number("x", printed, ours).agrees is agrees


def test_angles_are_the_same_after_whole_turns() -> None:
    assert number("q", "-190", 170.0, "°").agrees and not number("q", "-190", 170.0, "mm").agrees
    assert (
        formula("q", "q1", Q["q1"] + 2 * np.pi, Q, angle=True).agrees and not formula("q", "q1", Q["q1"] + 6, Q).agrees
    )


def test_a_value_that_the_model_does_not_give_differs() -> None:
    """Printed or not, and listed as an erratum or not."""
    exact = np.sin(Q["q1"])
    assert formula("T(1,2)", "s1", exact, Q).state == "agrees"
    assert formula("T(1,2)", "c1", exact, Q).state == "differs"
    assert formula("T(1,2)", "", exact, Q, right="s1").state == "open"
    assert formula("T(1,2)", "", exact, Q, right="c1").state == "differs"
    assert formula("T(1,2)", "c1", exact, Q, right="s1", erratum="the joint").state == "erratum"
    assert formula("T(1,2)", "c1", exact, Q, right="2 s1", erratum="the joint").state == "differs"
    assert formula("T(1,2)", "s1", exact, Q, erratum="none: it is right").state == "differs"
    assert number("x", "8", 7.0, right="7", erratum="one too many").state == "erratum"
    assert number("x", "8", 6.0, right="7", erratum="one too many").state == "differs"
    assert number("x", "", 7.0, right="7").state == "open" and number("x", "", 7.6, right="7").state == "differs"
    assert number("x", "8", float("nan")).state == "differs"
    assert word("x", "RRR", "RRP", right="RRP", erratum="a slide").state == "erratum"
    assert word("x", "RRR", "RPP", right="RRP", erratum="a slide").state == "differs"
    assert word("x", "wrist, elbow", "elbow, wrist").state == "agrees" != word("x", "wrist", "elbow, wrist").state
    assert unreadable(formula("T(1,2)", "", exact, Q, right="s1"), "a blot").state == "unreadable"
    assert unreadable(formula("T(1,2)", "", exact, Q, right="c1"), "a blot").state == "differs"
    assert given("x", "0.21").state == "given"


def test_the_value_here_is_the_model_s_whatever_is_printed() -> None:
    exact = np.sin(Q["q1"])
    shown = [formula("T(1,2)", text, exact, Q, right=right) for text, right in (("s1", ""), ("c1", ""), ("", "c1"))]
    assert {float(each.ours.replace("−", "-")) for each in shown} == {float(f"{exact[0]:.4g}")}
    assert [each.solution for each in shown] == ["s1", shown[1].ours, shown[2].ours]  # only what is confirmed


def test_bare_zeros_and_ones_and_own_checks_are_kinds_of_their_own() -> None:
    one = np.ones(9)
    assert formula("x", "1", one, Q).kind == formula("x", "", 0 * one, Q, right="0").kind == "trivial"
    assert formula("x", "c1", one, Q).kind == "formula" and number("x", "2", 2.0).kind == "number"
    assert number("x", "-1", -1.0).kind == "trivial" and holds("x", 0.0).kind == "check"


def test_draws_searches_and_identities() -> None:
    draws = np.array([0.12, 0.14, 0.13])
    assert drawn("x", "0.135", draws).agrees and not drawn("x", "0.16", draws).agrees
    for better, worse in ((12.2501, 12.1), np.array([12.2501, 12.1])):  # NumPy's booleans are none of JSON
        assert at_least("O1", "12.2487", better).agrees is True and at_least("O1", "12.2487", worse).agrees is False
    assert at_least("O1", "12.2487", 12.2479).agrees is False and at_least("O1", "12.2487", 12.2487).agrees is True
    for small, large in ((1e-12, 1e-3), np.array([1e-12, 1e-3])):
        assert holds("x", small).agrees is True and holds("x", large).agrees is False
