"""``lab reproduce``: a page, an exercise, and its marks."""

import csv
import json
import shlex
from pathlib import Path

import pytest
from helpers.robots import ROOT

from lab.cli import main
from lab.commands.command_line import parsed
from lab.commands.registry import command_named
from lab.core.errors import LabError
from lab.extensions.reproduction.item import marked, source_named, sources
from lab.extensions.reproduction.options import ReproduceOptions
from lab.extensions.reproduction.result import reproduce


@pytest.fixture(scope="module")
def exercise(tmp_path_factory) -> Path:
    """An exercise of a source, as it is written."""
    folder = tmp_path_factory.mktemp("exercise") / "run"
    assert main(["reproduce", "staubli", "--exercise", "--out", str(folder)]) == 0
    return folder / "exercise.csv"


def filled(exercise: Path, path: Path, wrong: str = "", blank: str = "") -> Path:
    """The exercise with every answer right but these."""
    result = reproduce(ReproduceOptions("staubli"))
    right = {f"{each.item.number}: {a.name}": a.solution for each in result.computed for a in each.answers}
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
    wrong, blank = "Table 1: d of link 3", "Equation 1.2: T(2,3)"
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
    mark = next(mark for mark in marked(path, result.computed) if mark.label == "Table 1: d of link 3")
    assert mark.state == "wrong" and "not a number" in mark.note
    path.write_text(
        'item,value\n"Table 1: d\n of link 3 ",about 600\n', encoding="utf-8"
    )  # as some editors break a line
    assert next(mark for mark in marked(path, result.computed) if mark.label == "Table 1: d of link 3") == mark


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
