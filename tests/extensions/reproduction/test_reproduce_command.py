"""``lab reproduce``: its page, its files, and what it says where a value differs."""

import json
import re
import shlex
from dataclasses import replace
from pathlib import Path

import pytest
from helpers.computed_sources import ITEMS, computed, result_of
from helpers.robots import ROOT

from lab.cli.command_line import parsed
from lab.cli.commands import command_named
from lab.cli.main import main
from lab.core.errors import LabError
from lab.extensions.reproduction.item import Computed, labels, source_named
from lab.extensions.reproduction.reproduction_options import ReproduceOptions
from lab.extensions.reproduction.reproduction_result import ReproductionResult
from lab.report.page import to_html
from lab.report.view import document_of


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
    source = source_named("staubli")
    assert all(f"{item.number}: {item.title}" in page for item in source.items)
    assert all(missing.number in page for missing in source.missing)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [(["thesys"], "thesis"), (["course", "--item", "77"], "--item"), (["course", "--mark"], "")],
)
def test_bad_arguments_are_refused(arguments: list[str], reason: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", *arguments]) == 2
    assert reason in capsys.readouterr().err


LINES = sorted({item.command for _, item in ITEMS if item.command})
LAB_LINES = [line for line in LINES if line.startswith("lab ")]


@pytest.mark.parametrize("line", LAB_LINES)
def test_each_item_names_a_command_that_there_is(line: str) -> None:
    _, name, *arguments = shlex.split(line)
    parsed(command_named(name), arguments)


def test_scripts_of_items_are_there() -> None:
    scripts = {line.split()[1] for line in LINES if line not in LAB_LINES}
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


def card_of(result: ReproductionResult) -> str:
    return to_html(document_of(result)).partition('<section class="card"')[2].partition("</section>")[0]


def test_a_value_that_differs_is_a_warning_and_the_exit_code() -> None:
    found = computed("staubli", "Table 1")
    wrong = replace(found.answers[4], confirmed=False)
    items = (Computed(found.item, (*found.answers[:4], wrong, *found.answers[5:])),)
    result = ReproductionResult(ReproduceOptions("staubli"), source_named("staubli"), items)
    assert result.exit_code == 1 and result.wrong == (f"Table 1: {wrong.name}",)
    assert result.to_dict()["differ"] == len(result.warnings) == 1
    assert wrong.name in card_of(result) and ">differs</span>" in card_of(result)


def test_entries_that_are_not_right_are_marked_in_the_matrix() -> None:
    page = to_html(document_of(result_of("course", "8.4")))
    marked_entries = re.findall(r"<td><strong>([^<]+)</strong>", page)
    assert marked_entries == [
        "−c1 c4 c5 s6 − c1 s4 c6 + s1 s5 s6",
        "−s1 c4 c5 s6 − s1 s4 c6 − c1 s5 s6",
    ]
    assert "T0,7(2,2), right is −s1 c4 c5 s6 − s1 s4 c6 + c1 s5 s6" in page


def test_what_cannot_be_read_is_no_erratum() -> None:
    result = result_of("course", "Section 8.5, J")
    told = result.to_dict()
    assert told["unreadable"] == 18 and told["errata"] == told["differ"] == 0 and result.exit_code == 0
    assert {a.place[1] for a in result.answers if a.state == "unreadable"} == {2, 5, 6}
