"""``lab reproduce``: a page, an exercise, and its marks."""

import csv
import json
import re
import shlex
from pathlib import Path

import pytest
from helpers.pages import PAGES
from helpers.robots import ROOT

from lab.cli import main
from lab.commands.command_line import parsed
from lab.commands.registry import command_named
from lab.core.errors import LabError
from lab.extensions.reproduction.item import labels, source_named, sources
from lab.extensions.reproduction.marking import marked, questions
from lab.extensions.reproduction.options import ReproduceOptions
from lab.extensions.reproduction.result import ReproductionResult, reproduce


@pytest.fixture(scope="module")
def exercise(tmp_path_factory) -> Path:
    """An exercise of a chapter, as it is written."""
    folder = tmp_path_factory.mktemp("exercise") / "run"
    assert main(["reproduce", "staubli", "--exercise", "--item", "1", "--out", str(folder)]) == 0
    return folder / "exercise.csv"


def filled(exercise: Path, path: Path, wrong: str = "", blank: str = "") -> Path:
    """The exercise with every answer right but these."""
    right = {each.label: each.solution for each in questions(reproduce(ReproduceOptions("staubli")).computed)}
    with exercise.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert rows and all(row["value"] == "" for row in rows)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, ["item", "value", "unit"])
        writer.writeheader()
        for row in rows:
            value = "" if row["item"] == blank else "17.5" if row["item"] == wrong else right[row["item"]]
            writer.writerow(row | {"value": value})
    return path


@pytest.mark.pages
def test_a_source_is_written_as_a_page_with_values(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", "staubli", "--json", "--out", str(tmp_path / "run")]) == 0
    told = json.loads(capsys.readouterr().out)
    answers = [answer for item in told["items"] for answer in item["answers"]]
    counted = [answer for answer in answers if answer["kind"] in ("number", "formula", "word")]
    assert told["errata"] == told["differ"] == 0 and len(counted) < len(answers) == told["answers"]
    assert told["agree"] == sum(answer["agrees"] is True for answer in counted)
    for kind, states in told["counts"].items():
        for state, count in states.items():
            assert count == sum(answer["kind"] == kind and answer["state"] == state for answer in answers)
    assert {path.name for path in (tmp_path / "run").iterdir()} >= {"result.json", "values.csv", "report.html"}
    page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    for item in source_named("staubli").items:
        assert f"{item.number}: {item.title}" in page
    for missing in source_named("staubli").missing:
        assert missing.number in page


@pytest.mark.pages
def test_an_exercise_has_no_answers(exercise: Path) -> None:
    told = json.loads((exercise.parent / "result.json").read_text(encoding="utf-8"))
    assert all(set(answer) == {"name", "unit"} for item in told["items"] for answer in item["answers"])
    assert "−d/tan(β)" not in (exercise.parent / "report.html").read_text(encoding="utf-8")
    assert not (exercise.parent / "values.csv").exists()


def test_right_answers_are_right(exercise: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = filled(exercise, tmp_path / "filled.csv")
    assert main(["reproduce", "staubli", "--mark", str(file), "--json", "--out", str(tmp_path / "run")]) == 0
    marks = json.loads(capsys.readouterr().out)["marks"]
    assert marks and {mark["state"] for mark in marks} == {"right"}


def test_wrong_and_blank_answers_are_told_one_by_one(exercise: Path, tmp_path: Path) -> None:
    wrong, blank = "Table 1: link 3: α, d, θ − q, r", "Equation 1.2: T"
    result = reproduce(ReproduceOptions("staubli", mark=filled(exercise, tmp_path / "filled.csv", wrong, blank)))
    assert result.exit_code == 1
    states = {mark.label: mark.state for mark in result.marks if mark.state != "right"}
    assert states == {wrong: "wrong", blank: "blank"}
    assert "625" in result.summary()


@pytest.mark.parametrize(
    ("text", "said"),
    [("value,unit\n1,mm\n", "no columns item and value"), ("item,value\nTable 9: x,1\n", "no answer of this source"),
     ("item,value\nTable 1: d of link 3,1\nTable 1: d of link 3,2\n", "twice")],
)  # fmt: skip
def test_other_files_are_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "other.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(LabError, match=said):
        reproduce(ReproduceOptions("staubli", mark=path))


def test_unreadable_answers_are_wrong_with_a_reason(tmp_path: Path) -> None:
    path = tmp_path / "other.csv"
    path.write_text("item,value\nTable 1: d of link 3,about 600\n", encoding="utf-8")
    result = reproduce(ReproduceOptions("staubli", mark=path))
    mark = next(mark for mark in marked(path, result.computed) if mark.label == "Table 1: link 3: α, d, θ − q, r")
    assert mark.state == "wrong" and "not a number" in mark.note
    path.write_text(
        'item,value\n"Table 1: d\n of link 3 ",about 600\n', encoding="utf-8"
    )  # as some editors break a line
    assert mark in marked(path, result.computed)


def test_an_exercise_is_not_marked_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", "course", "--exercise", "--mark", "x.csv"]) == 2
    assert "give one of them" in capsys.readouterr().err
    assert main(["reproduce", "thesys"]) == 2
    assert "thesis" in capsys.readouterr().err and command_named("reproduce").folder


LAB_COMMANDS = sorted(
    {item.command for name in sources() for item in source_named(name).items if item.command.startswith("lab ")}
)


@pytest.mark.parametrize("line", LAB_COMMANDS)
def test_each_item_names_a_command_that_there_is(line: str) -> None:
    _, name, *arguments = shlex.split(line)
    parsed(command_named(name), arguments)


@pytest.mark.thorough
@pytest.mark.parametrize("line", [line for line in LAB_COMMANDS if not {"POINTS.csv", "TARGETS.csv"} & {*line.split()}])
def test_each_item_names_a_command_that_works(line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(line)[1:]) == 0


def test_scripts_of_items_are_there() -> None:
    lines = [item.command for name in sources() for item in source_named(name).items if item.command]
    scripts = {line.split()[1] for line in lines if not line.startswith("lab ")}
    assert scripts and all((ROOT / script).is_file() for script in scripts)


def test_an_item_or_a_chapter_is_chosen_by_its_number() -> None:
    course, thesis = source_named("course"), source_named("thesis")
    assert [item.number for item in course.chosen("8.6")] == ["Section 8.6"]
    assert len(course.chosen("8.2")) == 3  # its table, matrices and figure
    assert {item.chapter for item in course.chosen("8")} == {"8 Serial robots"}
    assert [item.number for item in thesis.chosen("III.24")] == ["Equations III.21 to III.28"]
    assert [item.number for item in thesis.chosen("table iv.2")] == ["Table IV.2"]
    assert {item.chapter for item in thesis.chosen("III")} >= {"Chapter III, model of the IRB 120"}
    for text in ("8.66", "9", "", "Section"):
        with pytest.raises(LabError, match="no item"):
            course.chosen(text)


def test_ranges_of_numbers_are_spelled_out() -> None:
    assert labels("Annex, A3.7 to A3.9, A3.11") == ("A3.7", "A3.8", "A3.9", "A3.11")
    assert labels("Equations IV.7, IV.19 to IV.21") == ("IV.7", "IV.19", "IV.20", "IV.21")
    assert labels("Remark on fewer than six joints") == ()


@pytest.mark.pages
def test_an_exercise_of_one_item_asks_hints_and_is_solved_on_request(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["reproduce", "course", "--exercise", "--item", "8.6"]
    assert main([*asked, "--out", str(tmp_path / "asked")]) == 0
    shown = capsys.readouterr().out
    assert "Find q2, q3, q1" in shown and "Hint: Go back" in shown and "acos" not in shown
    (item,) = source_named("course").chosen("8.6")
    page = (tmp_path / "asked" / "report.html").read_text(encoding="utf-8")
    assert "Find q2, q3, q1" in page and item.exercise.hint.replace("'", "&#39;") in page
    assert (
        page.index('<details class="hint">') < page.index(item.exercise.hint[:20])
        and '<details class="hint" open' not in page
    )
    assert item.command not in shown and item.command not in page  # it prints the solution
    solution = next(answer.right for answer in item.answers() if answer.name == "q5")
    assert solution == "w acos(−s1 zx + c1 zy)" and solution not in page
    with (tmp_path / "asked" / "exercise.csv").open(encoding="utf-8") as file:
        assert {row["item"].partition(":")[0] for row in csv.DictReader(file)} == {"Section 8.6"}
    assert main([*asked, "--solution", "--json", "--out", str(tmp_path / "solved")]) == 0
    assert solution in (tmp_path / "solved" / "report.html").read_text(encoding="utf-8")
    told = json.loads(capsys.readouterr().out.strip().splitlines()[-1])
    assert solution in [answer["solution"] for item in told["items"] for answer in item["answers"]]


def test_without_an_item_the_exercises_are_listed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A student is never handed hundreds of blanks."""
    assert main(["reproduce", "staubli", "--exercise", "--out", str(tmp_path / "run")]) == 0
    shown = capsys.readouterr().out
    assert "begin with lab reproduce staubli --exercise --item 1.2" in shown and "choose one" in shown
    assert not (tmp_path / "run" / "exercise.csv").exists() and "Hint" not in shown
    assert main(["reproduce", "staubli", "--exercise", "--item", "1.1"]) == 2
    assert "asks nothing" in capsys.readouterr().err
    assert main(["reproduce", "staubli", "--exercise", "--solution"]) == 2
    assert "give --item too" in capsys.readouterr().err


def test_marks_hide_the_solution_until_asked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "exercise.csv"
    path.write_text("item,value\nFigure 3: r of the common normal,d/tan(β)\n", encoding="utf-8")
    asked = ["reproduce", "staubli", "--mark", str(path)]
    assert main([*asked, "--out", str(tmp_path / "hidden")]) == 1
    shown = capsys.readouterr().out
    assert "the sign is the other one" in shown and "−d/tan(β)" not in shown and "0 of 2" in shown
    for name in ("report.html", "result.json"):
        assert "−d/tan(β)" not in (tmp_path / "hidden" / name).read_text(encoding="utf-8")
    assert not (tmp_path / "hidden" / "values.csv").exists()
    assert main([*asked, "--solution", "--out", str(tmp_path / "solved")]) == 1
    shown = capsys.readouterr().out
    assert "−d/tan(β)" in shown and "right triangle" in shown


def test_a_solution_is_one_of_an_exercise(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", "course", "--solution"]) == 2
    assert "give --exercise too" in capsys.readouterr().err
    assert main(["reproduce", "course", "--item", "77"]) == 2
    assert "no item '77'" in capsys.readouterr().err


@pytest.mark.pages
def test_a_page_shows_a_matrix_as_a_matrix(tmp_path: Path) -> None:
    """Rows of a matrix are rows of its table, with the lab's values beside it, and one state for the matrix."""
    result = reproduce("thesis", item="Equations III.6 to III.11")
    page = result.report(tmp_path / "page.html").read_text(encoding="utf-8")
    matrices = page.split('<div class="matrix">')[1:]
    assert len(matrices) == 6
    for matrix in matrices:
        printed, ours = (part.split("</table>")[0] for part in matrix.split("<table>")[1:3])
        assert printed.count("<tr>") == ours.count("<tr>") == 4 and printed.count("<td>") == ours.count("<td>") == 16
    assert page.count(">agrees</span>") == 6
    text = result.summary()
    assert text.count("⎡") == text.count("⎦") == 12 and "⎣ 0    0    0  1  ⎦  ⎣ 0" in text


def test_an_exercise_asks_for_matrices_and_counts_what_it_asks(exercise: Path) -> None:
    result = reproduce("staubli", exercise=True, item="1")
    with exercise.open(encoding="utf-8") as file:
        asked = len(list(csv.DictReader(file)))
    assert f"an exercise of {asked} questions" in result.document().title
    text = result.summary()
    rows = [line.split("│") for line in text.partition("Equation 1.2: ")[0].splitlines()]
    counts = [int(row[-2]) for row in rows if len(row) > 4 and row[-2].strip().isdigit()]
    assert sum(counts) == asked and "Equation 1.1: The direct model" not in text  # which asks nothing
    whole = reproduce("staubli", item="1.2", exercise=True).summary()
    assert "⎡ …  …  …  … ⎤" in whole and whole.count("…  …  …  …") == 3


@pytest.mark.parametrize(
    ("item", "title"),
    [("1.1", "staubli: the lab's own check holds"), ("1.2", "staubli: 12 values, none of them to compare"),
     ("1.3", "staubli: 1 of 1 numbers, formulas and words agree")],
)  # fmt: skip
def test_a_title_never_counts_nothing(item: str, title: str) -> None:
    assert reproduce("staubli", item=item).document().title == title


@pytest.mark.pages
def test_the_card_counts_what_agrees_and_names_a_next_step(tmp_path: Path) -> None:
    def card(result: ReproductionResult) -> str:
        page = result.report(tmp_path / "page.html").read_text(encoding="utf-8")
        return page.partition('<section class="card"')[2].partition("</section>")[0]

    whole = reproduce("course", item="8.4")
    shown = card(whole)
    for word, state in (("agree", "agrees"), ("errata", "erratum"), ("differ", "differs")):
        assert re.search(rf"<span>{word}</span> <b>{whole.count(state)}</b>", shown), word
    assert "lab reproduce course --exercise --item" in shown
    assert "--mark exercise.csv" in card(reproduce("course", item="8.4", exercise=True))
    marked_file = tmp_path / "exercise.csv"
    lines = [
        "item,value",
        "Section 1.3.5: identifiable without β3,26",
        "Section 1.3.5: neighbouring axes with a β: of joint,2",
    ]
    marked_file.write_text("\n".join(lines), encoding="utf-8")
    shown = card(reproduce("staubli", mark=marked_file))
    assert "<span>right</span> <b>1</b>" in shown and "<span>wrong</span> <b>1</b>" in shown and "try " in shown


@pytest.mark.pages
def test_entries_that_are_not_right_are_marked_in_the_matrix(tmp_path: Path) -> None:
    page = reproduce("course", item="8.4").report(tmp_path / "page.html").read_text(encoding="utf-8")
    marked_entries = re.findall(r"<td><strong>([^<]+)</strong>", page)
    assert marked_entries == [
        "−c1 c4 c5 s6 − c1 s4 c6 + s1 s5 s6",
        "−s1 c4 c5 s6 − s1 s4 c6 − c1 s5 s6",
    ]
    assert "T0,7(2,2), right is −s1 c4 c5 s6 − s1 s4 c6 + c1 s5 s6" in page


def test_what_cannot_be_read_is_no_erratum() -> None:
    result = reproduce("course", item="Section 8.5, J")
    told = result.to_dict()
    assert told["unreadable"] == 18 and told["errata"] == told["differ"] == 0 and result.exit_code == 0
    rows = {int(a.place[1]) for a in result.answers if a.state == "unreadable"}
    assert rows == {2, 5, 6} and all(a.check(a.right) for a in result.answers if a.state == "unreadable")


@pytest.mark.pages
def test_the_page_s_commands_work_in_their_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The list is no run: so the first exercise is where the page, and the printed next step, look for it."""
    monkeypatch.chdir(tmp_path)
    page = next(page for page in PAGES if page.name == "docs/tutorials/exercises.md")
    lines = [line for body in (*page.of("sh"), *page.of("text")) for line in body.splitlines()]
    asked, chosen, mark = (
        next(line for line in lines if line.startswith("lab reproduce") and word in line and other not in line)
        for word, other in (("--exercise", "--item"), ("--item", "--solution"), ("--mark", "--item"))
    )
    assert main(shlex.split(asked)[1:]) == 0 and not Path("runs").exists()
    assert main(shlex.split(chosen)[1:]) == 0
    assert mark in " ".join(capsys.readouterr().out.split())
    assert main(shlex.split(mark)[1:]) == 1  # all blank
    assert ", 6 blank" in capsys.readouterr().out


def test_a_file_that_is_not_there_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Even where it is in the folder that the run would have."""
    monkeypatch.chdir(tmp_path)
    assert main(["reproduce", "course", "--mark", "runs/reproduce-course/exercise.csv"]) == 2
    assert "exercise.csv: cannot be read (no such file); give the exercise.csv" in capsys.readouterr().err
    assert not Path("runs").exists()


@pytest.mark.pages
def test_the_next_step_names_the_file_of_the_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "my run"
    assert main(["reproduce", "course", "--exercise", "--item", "7.1", "--out", str(folder)]) == 0
    step = f"--mark {shlex.quote(str(folder / 'exercise.csv'))}"
    assert step in " ".join(capsys.readouterr().out.split())
    saved = reproduce("course", exercise=True, item="7.1").save(tmp_path / "saved") / "report.html"
    assert f"--mark {tmp_path / 'saved' / 'exercise.csv'}" in saved.read_text(encoding="utf-8")


def test_the_title_of_marks_counts_right_wrong_and_blank(exercise: Path, tmp_path: Path) -> None:
    path = filled(
        exercise, tmp_path / "filled.csv", "Section 1.3.5: identifiable without β3", "Table 1: link 1: α, d, θ − q, r"
    )
    result = reproduce("staubli", mark=path)
    states = [mark.state for mark in result.marks or ()]
    right = states.count("right")
    assert result.document().title == f"staubli: {right} of {len(states)} answers right, 1 wrong, 1 blank"
