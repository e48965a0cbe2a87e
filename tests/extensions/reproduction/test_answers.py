"""When a printed value agrees, and which answers of an exercise are right."""

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.extensions.reproduction.answer import at_least, drawn, formula, given, holds, number, unreadable, word

Q = {"q1": np.linspace(-2, 2, 9)}


@pytest.mark.parametrize(
    ("printed", "ours", "agrees"),
    [("27.12", 27.1261, True), ("27.12", 27.1399, False), ("-64.90", -64.895, True), ("374", 374.4, True),
     ("374", 375.0, False), ("0", 1.0, False), ("0.1376", 0.13763, True), ("0.1376", 0.1378, False)],
)  # fmt: skip
def test_a_number_agrees_within_its_last_digit(printed: str, ours: float, agrees: bool) -> None:
    assert number("x", printed, ours).agrees is agrees


def test_angles_are_the_same_after_whole_turns() -> None:
    assert number("q", "-190", 170.0, "°").agrees and not number("q", "-190", 170.0, "mm").agrees


def test_a_reader_may_write_commas_and_other_minus_signs() -> None:
    answer = number("x", "", -3.14159, digits=3)
    assert answer.agrees is None
    assert (
        answer.check("−3,142") and answer.check("-3.1416") and not answer.check("3.142") and not answer.check("-3.14")
    )
    for text in ("about 3", "nan", "inf"):
        with pytest.raises(LabError, match="number"):
            answer.check(text)


def test_a_formula_is_compared_by_its_values() -> None:
    answer = formula("T(1,2)", "s1", -np.sin(Q["q1"]), Q, right="−s1", erratum="the sign")
    assert answer.agrees is False and answer.check("-s1") and answer.check("cos(q1 + pi/2)") and not answer.check("s1")
    assert answer.state == "erratum" and answer.solution == "−s1"


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
    assert unreadable(formula("T(1,2)", "", exact, Q, right="s1"), "a blot").state == "unreadable"
    assert unreadable(formula("T(1,2)", "", exact, Q, right="c1"), "a blot").state == "differs"
    assert given("x", "0.21").state == "given"


def test_the_value_here_is_the_model_s_whatever_is_printed() -> None:
    exact = np.sin(Q["q1"])
    shown = [
        formula("T(1,2)", text, exact, Q, right=right).ours for text, right in (("s1", ""), ("c1", ""), ("", "c1"))
    ]
    assert {float(text.replace("−", "-")) for text in shown} == {float(f"{exact[0]:.4g}")}


def test_bare_zeros_and_ones_and_own_checks_are_kinds_of_their_own() -> None:
    one = np.ones(9)
    assert formula("x", "1", one, Q).kind == formula("x", "", 0 * one, Q, right="0").kind == "trivial"
    assert formula("x", "c1", one, Q).kind == "formula" and number("x", "2", 2.0).kind == "number"
    assert number("x", "-1", -1.0).kind == "trivial" and holds("x", 0.0).kind == "check"


def test_other_kinds_of_answers() -> None:
    draws = np.array([0.12, 0.14, 0.13])
    assert drawn("x", "0.135", draws).agrees and not drawn("x", "0.16", draws).agrees
    for better, worse in ((12.2501, 12.1), np.array([12.2501, 12.1])):  # NumPy's booleans are none of JSON
        assert at_least("O1", "12.2487", better).agrees is True and at_least("O1", "12.2487", worse).agrees is False
    assert at_least("O1", "12.2487", 12.2479).agrees is False and at_least("O1", "12.2487", 12.2487).agrees is True
    for small, large in ((1e-12, 1e-3), np.array([1e-12, 1e-3])):
        assert holds("x", small).agrees is True and holds("x", large).agrees is False
    kinds = word("singularities", "", "elbow, wrist")
    assert kinds.check("Wrist,  elbow") and not kinds.check("wrist")
