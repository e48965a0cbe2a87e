"""Exercises: each has a text, an independent reference for each answer, and a solution on the page."""

import re

import pytest
from helpers.computed_sources import ITEMS, SEARCHED, computed, item_of, result_of

from lab.core.errors import LabError
from lab.extensions.reproduction.item import Item, with_exercises
from lab.extensions.reproduction.reproduction_result import solution_of
from lab.report.document import Matrices, Table
from lab.report.page import to_html
from lab.report.view import document_of

ASKING = [(source, item) for source, item in ITEMS if item.exercise is not None]
QUICK = [each for each in ASKING if each[1].number not in SEARCHED]
UNASKED = {"distance from singular with the platform in the middle"}  # computed beside what is asked


def test_every_source_asks() -> None:
    assert {source for source, _ in ASKING} == {"thesis", "elastic", "course", "staubli"}


@pytest.mark.parametrize(("source", "item"), ASKING, ids=lambda each: getattr(each, "number", each))
def test_a_question_stands_alone(source: str, item: Item) -> None:
    """It does not send its reader to the book, its table is whole, and there is a way to the solution."""
    exercise = item.exercise
    assert exercise.question and exercise.steps and all((*exercise.given, *exercise.steps))
    assert not re.search(r"section \d|figure [IV\d]|equation [IV\d]", exercise.question)
    assert len({len(row) for row in exercise.table}) <= 1


def check(source: str, item: Item) -> None:
    """The lab's solution of an exercise is that of a printed value, a closed form or a typed number."""
    answers = [answer for answer in computed(source, item.number).answers if answer.kind != "check"]
    assert answers
    for answer in answers:
        assert answer.printed or answer.right or answer.name in UNASKED, answer.name  # the reference
        assert answer.state in ("agrees", "erratum", "unreadable", "open") and answer.confirmed, answer.name
        assert answer.state == "agrees" or answer.right or answer.name in UNASKED, answer.name


@pytest.mark.parametrize(("source", "item"), QUICK, ids=lambda each: getattr(each, "number", each))
def test_the_lab_s_solution_is_that_of_an_independent_reference(source: str, item: Item) -> None:
    check(source, item)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "source_and_item", [each for each in ASKING if each not in QUICK], ids=lambda each: each[1].number
)
def test_the_lab_s_solution_by_a_search_is_that_of_an_independent_reference(source_and_item: tuple[str, Item]) -> None:
    check(*source_and_item)


def test_a_page_has_the_exercise_folded_with_its_solution() -> None:
    result = result_of("course", "Section 8.6")
    page = to_html(document_of(result))
    folded = page.partition('class="folded"')[2].partition("</details>")[0]
    exercise = item_of("course", "Section 8.6").exercise
    for text in (exercise.question, *exercise.given, *exercise.steps, "w acos(−s1 zx + c1 zy)"):
        assert text.replace("'", "&#39;") in folded
    assert exercise.question not in result.summary()


def test_a_solution_has_what_the_lab_computes() -> None:
    """Formulas that it confirms, the right ones of errata, its own numbers, and rows with the unit of each entry."""
    matrices, table = solution_of(computed("thesis", "Equation III.15").answers)
    assert isinstance(matrices, Matrices) and isinstance(table, Table)
    assert matrices.matrices[0].versions[0][1][3] == ("0", "0", "0", "1")
    assert ("left side", "T6,0 = T0,6⁻¹", "") in table.rows and ("T0,6(4,4)", "1", "") in table.rows
    rows = {row[0]: row[1:] for row in list(solution_of(computed("staubli", "Table 1").answers))[-1].rows}
    assert rows["link 3: α, d, θ − q, r"] == ("0, 625, 90, 0", "°, mm, °, mm")


def test_the_text_of_an_exercise_belongs_to_an_item() -> None:
    others = tuple(item for source, item in ITEMS if source == "staubli" and item.number != "Table 1")
    with pytest.raises(LabError, match="'Table 1' is no item"):
        with_exercises(others, "staubli")
