"""Exercises: every question stands alone, every solution is marked right and a changed one wrong, in many spellings."""

import csv
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.extensions.reproduction.answer import Answer, number
from lab.extensions.reproduction.item import Computed, Item, source_named, sources
from lab.extensions.reproduction.marking import Mark, Question, items_of, marked, questions, write_exercise
from lab.extensions.reproduction.options import ReproduceOptions
from lab.extensions.reproduction.quantities import quantity
from lab.extensions.reproduction.result import ReproductionResult, reproduce
from lab.render.terminal import to_text

SLOW = ("Section 6.1", "Conclusion")  # volumes, a search
ASKING = [(name, item) for name in sources() for item in source_named(name).items if item.exercise is not None]
QUICK = [each for each in ASKING if each[1].number not in SLOW]
SLOWER = [each for each in ASKING if each[1].number in SLOW]


def computed(source: str, item: str) -> list[Computed]:
    return [Computed(each, each.answers()) for each in source_named(source).chosen(item)]


def answered(folder: Path, items: Sequence[Computed], given: dict[str, str]) -> dict[str, Mark]:
    """The marks of a file with these answers, by the names of the questions."""
    path = folder / "exercise.csv"
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["item", "value", "unit"])
        writer.writerows([label, value, ""] for label, value in given.items())
    return {mark.question.name: mark for mark in marked(path, items)}


def one(folder: Path, source: str, item: str, name: str, text: str) -> Mark:
    """The mark of one answer."""
    items = computed(source, item)
    label = next(each.label for each in questions(items) if each.name == name)
    return answered(folder, items, {label: text})[name]


def changed(answer: Answer) -> str:
    """A wrong answer near to the solution."""
    solution = answer.solution
    if answer.kind == "word":
        return "something else"
    value = solution.replace("−", "-")
    if re.fullmatch(r"-?\d+(\.\d+)?", value):
        asked = answer.right or answer.printed  # whose last digit counts
        step = 10.0 ** -len(asked.partition(".")[2])
        return f"{float(value) + 3.4 * step:.6f}"
    return f"({solution}) + 0.01"


def check(folder: Path, item: Item) -> None:
    items = [Computed(item, item.answers())]
    asked = questions(items)
    right = {each.label: each.solution for each in asked}
    assert asked and all(mark.state == "right" for mark in answered(folder, items, right).values())
    for each in asked:
        for at, answer in enumerate(each.entries):
            parts = [other.solution for other in each.entries]
            parts[at] = changed(answer)
            wide = len(each.rows[0])
            rows = [parts[i : i + wide] for i in range(0, len(parts), wide)]
            wrong = "; ".join(", ".join(row) for row in rows)
            if answer.any_order:
                wrong = wrong.replace(parts[at], "12345")
            mark = answered(folder, items, {**right, each.label: wrong})[each.name]
            assert mark.state == "wrong", (each.label, wrong, mark.note)
            if answer.kind in ("formula", "number") and len(answer.solution) > 4:  # no hint gives the solution away
                assert answer.solution not in mark.note


@pytest.mark.parametrize(("source", "item"), QUICK, ids=lambda each: getattr(each, "number", each))
def test_solutions_are_marked_right_and_changed_ones_wrong(source: str, item: Item, tmp_path: Path) -> None:
    check(tmp_path, item)


@pytest.mark.thorough
@pytest.mark.parametrize(("source", "item"), SLOWER, ids=lambda each: getattr(each, "number", each))
def test_solutions_of_searches_are_marked_right_and_changed_ones_wrong(source: str, item: Item, tmp_path: Path) -> None:
    check(tmp_path, item)


@pytest.mark.parametrize(("source", "item"), QUICK, ids=lambda each: getattr(each, "number", each))
def test_a_question_stands_alone(source: str, item: Item) -> None:
    """It is a sentence with what is asked; its text and hint do not hold the answers; the way there has steps."""
    exercise = item.exercise
    assert exercise is not None and exercise.hint and exercise.steps
    text = " ".join([exercise.question, *exercise.given, *(cell for row in exercise.table for cell in row)])
    assert exercise.question[0].isupper() and exercise.question.rstrip()[-1] in ".?:"
    assert not re.search(r"section \d|figure [IV\d]|equation [IV\d]", exercise.question)
    widths = {len(row) for row in exercise.table}
    assert len(widths) <= 1
    for each in questions([Computed(item, item.answers())]):
        for answer in each.entries:
            if answer.kind == "formula" and len(answer.solution) > 5:
                assert answer.solution not in exercise.hint, answer.name
                assert answer.solution not in text or len(answer.solution) < 9, answer.name


def test_the_list_of_exercises_begins_somewhere() -> None:
    for name in sources():
        source = source_named(name)
        first = source.chosen(source.begin)[0]
        assert first.exercise is not None and 1 <= len(questions([Computed(first, first.answers())])) <= 12


SPELLINGS = [
    ("course", "10.3, question 1", "x", "L2*cos(q2)*cos(q1)"),
    ("course", "10.3, question 1", "x", "L2 C2 C1"),
    ("course", "10.3, question 1", "x", "l2 cos θ1 cos θ2"),
    ("course", "10.3, question 1", "x", r"L_2 \cos(\theta_1) \cdot \cos \theta_{2}"),
    ("course", "10.3, question 1", "x", "L2·(cos(q1 + q2) + cos(q1 - q2))/2"),
    ("course", "10.3, question 1", "x", r"\frac{L2}{2} (c12 + cos(q2-q1))"),
    ("course", "10.3, question 1", "x", "1/2 L2 (cos(theta1+theta2) + cos(theta1-theta2))"),
    ("course", "10.3, question 1", "x", "L2 sin(90° - q2) sin(q1 + pi/2)"),
    ("course", "10.3, question 1", "q2 of x, y, z", "atan((z-L1)/sqrt(x**2+y**2))"),
    ("course", "10.3, question 1", "q2 of x, y, z", "arcsin((z − L1)/L2)"),
    ("course", "10.3, question 1", "q1 of x, y, z", "atan2(y, x) + 2 pi"),
    ("course", "8.1", "T", "cos θ, -sin θ, 0, a; sinθ cosα, cosθ cosα, -sinα, -r sinα; sθ sα, cθ sα, cα, r cα"),
    ("course", "8.1", "T", "[[cos(theta), -sin(theta), 0, a], [cos(alpha)*sin(theta), cos(alpha)*cos(theta), "
     "-sin(alpha), -r*sin(alpha)], [sin(alpha)*sin(theta), sin(alpha)*cos(theta), cos(alpha), r*cos(alpha)], "
     "[0,0,0,1]]"),
    ("course", "8.9", "x", "0.4 cos q1 + 0.25 cos(q12)"),
    ("course", "8.9", "x", "0.4 cos θ1 + 0.25 cos θ12"),
    ("course", "8.5", "dpz", r"\dot q_2"),
    ("course", "8.5", "dpz", r"$\dot{q}_2$"),
    ("course", "8.5", "dpz", "q\u03072"),
    ("course", "8.7", "dq4", r"-\sin q_1 \dot\varphi_x + c_1 \dot{\varphi}_y - c_5 \dot q_6"),
    ("course", "Section 8.2, matrices", "T0,1", r"\begin{bmatrix} \cos q_1 & -\sin q_1 & 0 & 0 \\ \sin q_1 & "
     r"\cos q_1 & 0 & 0 \\ 0 & 0 & 1 & 0 \\ 0 & 0 & 0 & 1 \end{bmatrix}"),
    ("course", "Section 8.2, matrices", "T0,1", r"\left[\begin{array}{cccc} c_1 & -s_1 & 0 & 0 \\[2pt] s_1 & c_1 & "
     r"0 & 0 \\ 0 & 0 & 1 & 0 \\ \end{array}\right]"),
    ("course", "8.8", "det J", "0.25 c3 s5 (0.5c2 - 0.5s23)"),
    ("course", "8.8", "det J", "a3 r4 cos(q3) sin(q5) (a3 cos(q2) - r4 sin(q2+q3))"),
    ("course", "8.8", "the singularities", "Wrist; elbow; Shoulder"),
    ("course", "8.9", "q2 of x, y", "±acos((x²+y²-a2²-a3²)/(2 a2 a3))"),
    ("course", "8.9", "q2 of x, y", "acos((x^2+y^2-0.2225)/0.2)"),
    ("course", "8.9", "q2 of x, y", "-acos((x^2+y^2-0.2225)/0.2)"),
    ("course", "8.6", "q3", "-sqrt((px7 - r7 zx)^2 + (py7 - r7 zy)^2)"),
    ("course", "8.6", "q5", "atan2(sqrt(1 - (c1 zy - s1 zx)^2), c1 zy - s1 zx)"),
    ("course", "11.3.1", "Y", "sqrt(rho1^2 - (rho1^2 - rho2^2 + L^2)^2/(4 L^2))"),
    ("course", "11.3.1", "serial singularity", "rho1=0, rho2=0"),
    ("course", "5.6", "J⁺", "(J'J)^-1 J'"),
    ("course", "5.6", "J⁺", "(J^T J)^-1 J^T"),
    ("course", "A3.2", "R", "cθy cθz | sθx sθy cθz - cθx sθz | cθx sθy cθz + sθx sθz; cθy sθz | "
     "sθx sθy sθz + cθx cθz | cθx sθy sθz − sθx cθz; -sθy | sθx cθy | cθx cθy"),
    ("course", "10.3, question 2", "total", "5,36656 s"),
    ("course", "10.3, question 2", "total", "4 √(9/5)"),
    ("course", "10.3, question 2", "q1 and q2 at P0", "0 rad, -pi/6 rad"),
    ("course", "10.3, approximation", "q1 where it turns back", "1.470629 rad"),
    ("staubli", "Figure 3", "r of the common normal", "-d cos(beta)/sin(beta)"),
    ("staubli", "Figure 3", "of the RX 130's 625 mm at 1 mrad", "625000 mm"),
    ("staubli", "Table 1", "link 3: α, d, θ − q, r", "0, 62.5 cm, 90°, 0"),
    ("thesis", "III.15", "left side", "T6,0 = T0,6^-1"),
    ("thesis", "Table IV.1", "left out", "dr2, dr5, dl5, dtheta6, dalpha6"),
    ("thesis", "III.30", "III.31 θ5", "acos(-az s23 + (c1 ax + s1 ay) c23)"),
]  # fmt: skip


@pytest.mark.parametrize(("source", "item", "name", "text"), SPELLINGS)
def test_an_answer_may_be_spelled_in_many_ways(source: str, item: str, name: str, text: str, tmp_path: Path) -> None:
    number_of = {"10.3, question 1": "Section 10.3, question 1", "10.3, question 2": "Section 10.3, question 2",
                 "10.3, approximation": "Section 10.3, approximation"}.get(item, item)  # fmt: skip
    mark = one(tmp_path, source, number_of, name, text)
    assert mark.state == "right", mark.note


REMARKS = [
    ("course", "Section 10.3, question 1", "x", "-L2 c1 c2", "sign"),
    ("course", "Section 10.3, question 1", "x", "L2 s1 s2", "sine and cosine"),
    ("course", "Section 10.3, question 1", "z", "L1 - L2 s2", "sign of one term"),
    ("course", "Section 10.3, question 1", "x", "2 L2 c1 c2", "factor"),
    ("course", "Section 10.3, question 1", "q1 of x, y, z", "atan(y/x)", "quadrant"),
    ("course", "Section 10.3, question 1", "x", "L3 c1 c2", "its letters are"),
    ("course", "Section 10.3, question 1", "q1 of x, y, z", "q1", "q1 cannot be used in this answer"),
    ("course", "8.5", "dpz", "dpz", "dpz cannot be used in this answer"),
    ("course", "8.6", "q2", "pz", "pz cannot be used in this answer"),
    ("course", "Section 10.3, question 1", "x", "L2 c1 c1", "'c1': another joint"),
    ("course", "Section 10.3, question 1", "z", "L1 + L2 sin(q1)", "'q1': another joint"),
    ("course", "8.9", "x", "0.4 c1 + 0.25 cos θ2", "'θ2': another joint"),
    ("course", "8.8", "the singularities", "elbow, shoulder", "2 of 3 are right, and 1 too few"),
    ("course", "8.8", "the singularities", "elbow, shoulder, hip", "2 of 3 are right"),
    ("course", "Section 8.2, figure", "det J in the drawn posture, q5 = 0", "zero", "write digits, such as 0,"),
    ("course", "Section 8.2, table", "α1 to α6", "0 | 0 | -90 | 0 | -90", "put bars | between entries"),
    ("course", "Section 8.2, table", "α1 to α6", "0, 0, -90, 0, -90", "put commas between entries"),
    ("course", "Section 10.3, approximation", "q1 where it turns back", "1.470629", "radians"),
    ("course", "Section 10.3, approximation", "q1 where it turns back", "-84.261", "sign"),
    ("course", "Section 10.3, approximation", "q1 where it turns back", "84.2", "close"),
    ("course", "Section 10.3, approximation", "q1 where it turns back", "84.261 mm", "another quantity"),
    ("course", "Section 10.3, approximation", "q1 where it turns back", "84.261 furlongs", "unknown"),
    ("staubli", "Figure 3", "of the RX 130's 625 mm at 1 mrad", "625000", "mm and m"),
    ("staubli", "Table 1", "link 3: α, d, θ − q, r", "0, 625, 0, 0", "entry 3"),
    ("staubli", "Table 1", "link 3: α, d, θ − q, r", "0, 625, 90", "4 entries"),
    ("elastic", "3.22", "Rot(z, r)", "cos r, sin r, 0, 0; -sin r, cos r, 0, 0; 0, 0, 1, 0", "transposed"),
    ("elastic", "3.22", "Rot(z, r)", "cos r, sin r, 0; -sin r, cos r, 0; 0, 0, 1", "4 rows of 4"),
    ("course", "8.9", "q2 of x, y", "acos((x^2+y^2-0.2225)/0.1)", ""),
]  # fmt: skip


@pytest.mark.parametrize(("source", "item", "name", "text", "said"), REMARKS)
def test_a_nearly_right_answer_gets_a_hint(
    source: str, item: str, name: str, text: str, said: str, tmp_path: Path
) -> None:
    mark = one(tmp_path, source, item, name, text)
    assert mark.state == "wrong" and said in mark.note, mark.note
    assert "\n" not in mark.note


def test_another_root_is_right_and_is_told(tmp_path: Path) -> None:
    mark = one(tmp_path, "course", "8.9", "q2 of x, y", "-acos((x^2+y^2-0.2225)/0.2)")
    assert mark.state == "right" and "other root" in mark.note
    mark = one(tmp_path, "course", "11.3.1", "Y", "-√(ρ1^2 − ((ρ1^2 − ρ2^2 + L^2)/(2 L))^2)")
    assert mark.state == "right" and "other root" in mark.note


def test_solutions_of_a_pose_may_come_in_any_order(tmp_path: Path) -> None:
    items = computed("thesis", "Table III.3")
    asked = questions(items)
    turned = {each.label: asked[(i + 3) % 8].solution for i, each in enumerate(asked)}
    assert {mark.state for mark in answered(tmp_path, items, turned).values()} == {"right"}
    twice = {**turned, asked[0].label: asked[1].solution}  # one of them twice, another one never
    states = [mark.state for mark in answered(tmp_path, items, twice).values()]
    assert states.count("wrong") == 1


def test_entries_of_a_matrix_may_have_rows_of_the_file_each(tmp_path: Path) -> None:
    items = computed("elastic", "3.22")
    question = next(each for each in questions(items) if each.name == "Rot(z, r)")
    rows = {f"{question.item.number}: {answer.name}": answer.solution for answer in question.entries}
    assert answered(tmp_path, items, rows)["Rot(z, r)"].state == "right"
    rows[f"{question.item.number}: Rot(z, r)(1,2)"] = "sin r"
    mark = answered(tmp_path, items, rows)["Rot(z, r)"]
    assert mark.state == "wrong" and "(1,2)" in mark.note


def test_only_the_items_of_the_file_are_marked(tmp_path: Path) -> None:
    items = computed("course", "8.1")
    write_exercise(tmp_path / "exercise.csv", items)
    assert [item.number for item in items_of(tmp_path / "exercise.csv", source_named("course"))] == ["Section 8.1"]


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [("12 mm", "mm", 12.0), ("12mm", "m", 0.012), ("1,5 cm", "mm", 15.0), ("0.2 rad", "°", np.rad2deg(0.2)),
     ("11.5°", "°", 11.5), ("−11.5 deg", "°", -11.5), ("pi/2 rad", "°", 90.0), ("π/6 rad", "°", 30.0),
     ("4/3 pi", "", 4 / 3 * np.pi), ("√3/2", "m", np.sqrt(3) / 2), ("0.2 rad/s", "°/s", np.rad2deg(0.2)),
     ("50 deg/s^2", "°/s²", 50.0), ("1e-3", "m", 1e-3), ("2 500 g".replace(" ", "", 1), "kg", 2.5)],
)  # fmt: skip
def test_a_number_may_have_a_unit(text: str, unit: str, value: float) -> None:
    assert quantity(text, unit) == pytest.approx(value)


@pytest.mark.parametrize("text", ["12 kg", "1 200", "twelve", "q1", "", "12 mm mm", "nan", "1/0", "__import__('os')"])
def test_what_is_no_number_is_refused(text: str) -> None:
    with pytest.raises(LabError):
        quantity(text, "mm")


def test_a_rounded_number_is_told_how_many_digits_are_asked() -> None:
    answer = number("x", "", 3.14159, digits=3)
    assert "3 decimals" in answer.advice("3.1") and not answer.advice("3.142") and not answer.advice("77")


def test_a_row_s_units_are_named() -> None:
    question = questions(computed("staubli", "Table 1"))[0]
    assert isinstance(question, Question) and question.unit == "°, mm, °, mm"


def test_an_unread_letter_is_answered_with_those_of_the_question(tmp_path: Path) -> None:
    """Other names that the source has for a length, and values of other items, are not listed."""
    note = one(tmp_path, "course", "8.9", "x", "k").note
    assert note.endswith("its letters are q1 to q4, x, y, z, and a2 and a3 or 0.4 and 0.25")
    note = one(tmp_path, "course", "8.3", "T0,1", "c1, -s1, 0, k; s1, c1, 0, 0; 0, 0, 1, 0").note
    assert "a3, r4, r6, c1" in note and "d3" not in note


CHAPTERS = [(name, chapter) for name in sources() for chapter in dict.fromkeys(
    item.chapter for item in source_named(name).items if item.exercise is not None and item.number not in SLOW
)]  # fmt: skip


@pytest.mark.parametrize(("name", "chapter"), CHAPTERS)
def test_no_item_of_a_chapter_gives_another_one_s_answer_away(name: str, chapter: str) -> None:
    items = [item for item in source_named(name).items if item.chapter == chapter and item.number not in SLOW]
    asking = tuple(Computed(item, item.answers()) for item in items if item.exercise is not None)
    options = ReproduceOptions(name, item=chapter, exercise=True)
    shown = to_text(ReproductionResult(options, source_named(name), asking, None).document(), width=2000)
    for question in questions(asking):
        for answer in question.entries:
            long = answer.kind == "formula" and len(answer.solution) > 9
            assert not long or answer.solution not in shown, question.label


def test_a_table_is_given_unless_its_item_is_asked_along() -> None:
    row = "−90 │ 0 │ q5 │"
    alone, along = (reproduce("course", item=item, exercise=True).summary() for item in ("Section 8.4", "8"))
    assert row in alone and "q3 q5" not in alone and row not in along
    assert 'Use your answer to Section 8.2, table. Asked alone, with --item "Section 8.4", it is given' in " ".join(
        along.split()
    )
    assert "J has the columns" in reproduce("course", item="Section 8.5, rates", exercise=True).summary()
    assert "J has the columns" not in along and "The differential model: dpx" not in along
