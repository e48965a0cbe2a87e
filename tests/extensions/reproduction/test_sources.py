"""Every item of every source: what is right of the printed values agrees, errata differ, nothing is left out."""

import re
from pathlib import Path

import numpy as np
import pytest

from lab.extensions.reproduction.course import COURSE
from lab.extensions.reproduction.elastic import ELASTIC
from lab.extensions.reproduction.item import Computed, Item, source_named, sources
from lab.extensions.reproduction.marking import marked, write_exercise
from lab.extensions.reproduction.staubli import STAUBLI
from lab.extensions.reproduction.thesis import ESTIMATES, THESIS
from lab.extensions.reproduction.thesis_case import HIDDEN, INTO, OFFSETS, errors, searched

SEARCHED = (  # designs, volumes, and virtual arms
    "Table IV.2", "Table IV.3", "Figure IV.1", "Figure IV.2", "Conclusion", "Section 6.1", "Figure I.4", "Table I.1",
    "Chapter I, section III.1", "Chapter I, section V.3",
)  # fmt: skip
QUICK = [
    (source.name, item)
    for source in (THESIS, ELASTIC, COURSE, STAUBLI)
    for item in source.items
    if item.number not in SEARCHED
]
LONG = [item for item in (*THESIS.items, *COURSE.items) if item.number in SEARCHED]


def check(item: Item) -> None:
    """A printed value agrees, or is an erratum with a reason and does not; the right answer is marked right.

    An item with an exercise asks for something.
    """
    answers = item.answers()
    assert item.exercise is None or any(answer.in_exercise for answer in answers), item.number
    assert len({answer.name for answer in answers}) == len(answers)
    for answer in answers:
        assert answer.state != "differs", f"{item.number} {answer.name}: {answer.ours}, {answer.difference}"
        assert (answer.state == "erratum") == bool(answer.erratum), f"{item.number} {answer.name}"
        if answer.in_exercise:
            assert answer.check(answer.solution), f"{item.number} {answer.name}: {answer.solution}"
            if answer.erratum:
                assert not answer.check(answer.printed)


@pytest.mark.parametrize(("source", "item"), QUICK, ids=lambda each: getattr(each, "number", each))
def test_every_printed_value_agrees_or_is_an_erratum(source: str, item: Item) -> None:
    check(item)


@pytest.mark.thorough
@pytest.mark.parametrize("item", LONG, ids=lambda each: each.number)
def test_every_value_that_a_search_gives_agrees_or_is_an_erratum(item: Item) -> None:
    check(item)


def test_the_three_rows_come_out_as_printed_with_what_is_hidden() -> None:
    """The errata of table IV.2 are what the dropped parameters make of them."""
    joints = np.random.default_rng(0).uniform(-np.pi, np.pi, (20, 6))
    off = errors(joints, 200, hidden=HIDDEN) + np.array(list(OFFSETS.values()))
    printed = dict(zip(OFFSETS, (row.split() for row in ESTIMATES.strip().splitlines()), strict=True))
    for name in INTO.values():
        column, digits = off[:, list(OFFSETS).index(name)], [float(text) for text in printed[name][1:]]
        assert np.abs(np.median(column) - np.mean(digits)) < (0.005 if name == "link3.d" else 2e-4)
        assert np.abs(np.median(column) - OFFSETS[name]) > 100 * column.std() / np.sqrt(len(column))


def test_an_exercise_comes_back_as_it_was_filled_in(tmp_path: Path) -> None:
    computed = [Computed(item, item.answers()) for item in COURSE.items[1:4]]
    write_exercise(tmp_path / "exercise.csv", computed)
    assert {mark.state for mark in marked(tmp_path / "exercise.csv", computed)} == {"blank"}


def test_sources_name_every_item_once() -> None:
    for name in sources():
        source = source_named(name)
        assert source in (THESIS, ELASTIC, COURSE, STAUBLI)
        numbers = [each.number for each in (*source.items, *source.missing)]
        assert source.name == name and len(set(numbers)) == len(numbers)
        assert all(each.reason for each in source.missing)
        assert all(each.command or each.note for each in source.items), name


def test_the_thesis_is_complete() -> None:
    """Each table, figure and equation of the thesis is an item, or is listed with a reason."""
    said = {one for each in (*THESIS.items, *THESIS.missing) for one in _spelled(each.number)}
    wanted = [
        *(f"Figure I.{i}" for i in range(1, 8)), "Figure II.1", *(f"Figure III.{i}" for i in range(1, 11)),
        "Figure IV.1", "Figure IV.2", "Table I.1", *(f"Table III.{i}" for i in range(1, 4)),
        *(f"Table IV.{i}" for i in range(1, 4)), *(f"Equation II.{i}" for i in range(1, 10)),
        *(f"Equation III.{i}" for i in range(1, 32)), *(f"Equation IV.{i}" for i in range(1, 27)),
    ]  # fmt: skip
    assert [each for each in wanted if each not in said] == []


SECTIONS = {  # of each source: what it numbers
    "course": [
        *("1", "2", "3", "4", "5.1", "5.2", "5.3", "5.4", "5.5", "5.6", "6.1", "6.2", "7.1", "7.2", "7.3", "7.4"),
        *(f"8.{i}" for i in range(1, 10)), "9", "10.1", "10.2", "10.3",
        "11.1", "11.2", "11.3", "11.3.1", "11.3.2", "11.4.1", "11.4.2", "11.4.3", "11.4.4", "11.5", "11.6",
        *(f"A3.{i}" for i in range(1, 12)), "recalls 1", "recalls 2",
    ],
    "elastic": [*(f"3.{i}" for i in range(21, 41)), "figure 3.4", "figure 3.5", "figure 3.7"],
    "staubli": [
        *(f"1.{i}" for i in range(1, 7)), "figure 1", "figure 2", "figure 3", "table 1", "section 1.2", "section 1.3.5",
        "section 1.4",
    ],
}  # fmt: skip


@pytest.mark.parametrize("name", SECTIONS)
def test_every_numbered_item_of_the_other_sources_is_there_or_listed(name: str) -> None:
    """Sections of the course and its annex's equations; equations, figures and tables of the two articles."""
    source = source_named(name)
    said = {one for each in (*source.items, *source.missing) for one in _numbers(name, each.number)}
    assert [each for each in SECTIONS[name] if each not in said] == []


def _numbers(source: str, heading: str) -> set[str]:
    """What a heading like ``Sections 11.3, 11.3.2`` or ``Equations 3.36 b to 3.38, figure 3.7`` names, one by one."""
    out, kind = set[str](), ""
    for part in heading.split(", "):
        first, _, rest = part.partition(" ")
        if rest and not re.match(r"A?\d", first):
            kind = first.lower().rstrip("s")
            part = rest
        ends = re.findall(r"A?\d+(?:\.\d+)*", part)
        if " to " in part and len(ends) == 2:
            stem, _, low = ends[0].rpartition(".")
            dot = "." if stem else ""
            ends = [f"{stem}{dot}{i}" for i in range(int(low), int(ends[1].rpartition(".")[2]) + 1)]
        elif " and " in part:
            ends = [each.strip() for each in part.removeprefix("recalls ").split(" and ")]
        named = kind in ("figure", "table", "recall", "recalls") or (kind == "section" and source == "staubli")
        word = {"recall": "recalls"}.get(kind, kind)
        out |= {f"{word} {end}" if named else end for end in ends}
    return out


def _spelled(number: str) -> list[str]:
    """``Equations III.6 to III.8, III.10`` one by one."""
    kind, _, rest = number.partition(" ")
    kind, out = kind.rstrip("s"), []
    for part in rest.split(", "):
        ends = re.findall(r"([IV]+)\.(\d+)", part)
        if len(ends) == 2 and " to " in part:
            out += [f"{kind} {ends[0][0]}.{i}" for i in range(int(ends[0][1]), int(ends[1][1]) + 1)]
        else:
            out += [f"{kind} {chapter}.{i}" for chapter, i in ends]
    return out


@pytest.mark.thorough
def test_the_best_o1_of_each_number_of_poses_rises_little_after_twenty() -> None:
    best = [searched("O1", 0, 100, 1, poses=count).score for count in (8, 20)]
    assert all(np.isfinite(best))


@pytest.mark.thorough
@pytest.mark.figures
@pytest.mark.parametrize("number", ["Figure I.4", "Figure II.1", "Figure III.6", "Figure III.10"])
def test_figures_can_be_drawn(number: str) -> None:
    item = next(each for each in THESIS.items if each.number == number)
    pictures = item.pictures()
    assert pictures and all(picture.draw().axes for picture in pictures)
