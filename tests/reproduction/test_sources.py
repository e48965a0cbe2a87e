"""Every item of every source: what is right of the printed values agrees, errata differ, nothing is left out."""

import re
from pathlib import Path

import numpy as np
import pytest

from lab.reproduction.course.source import COURSE
from lab.reproduction.elastic.source import ELASTIC
from lab.reproduction.item import Item
from lab.reproduction.marking import Computed, marked, write_exercise
from lab.reproduction.registry import SOURCES, source_named
from lab.reproduction.staubli.source import STAUBLI
from lab.reproduction.thesis.calibration import ESTIMATES
from lab.reproduction.thesis.source import THESIS
from lab.reproduction.thesis_case import HIDDEN, INTO, OFF, errors, searched

SEARCHED = ("Table IV.2", "Figure IV.1", "Figure IV.2", "Conclusion", "Section 6.1")  # designs, and volumes
QUICK = [
    (source.name, item)
    for source in (THESIS, ELASTIC, COURSE, STAUBLI)
    for item in source.items
    if item.number not in SEARCHED
]
LONG = [item for item in (*THESIS.items, *COURSE.items) if item.number in SEARCHED]


def check(item: Item) -> None:
    """A printed value agrees, or is an erratum with a reason and does not; the right answer is marked right."""
    answers = item.answers()
    assert len({answer.name for answer in answers}) == len(answers)
    for answer in answers:
        assert (answer.agrees is False) == bool(answer.erratum), f"{item.number} {answer.name}: {answer.difference}"
        if answer.asked:
            assert answer.check(answer.ours), f"{item.number} {answer.name}: {answer.ours}"
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
    off = errors(joints, 200, hidden=HIDDEN) + np.array(list(OFF.values()))
    printed = dict(zip(OFF, (row.split() for row in ESTIMATES.strip().splitlines()), strict=True))
    for name in INTO.values():
        column, digits = off[:, list(OFF).index(name)], [float(text) for text in printed[name][1:]]
        assert np.abs(np.median(column) - np.mean(digits)) < (0.005 if name == "link3.d" else 2e-4)
        assert np.abs(np.median(column) - OFF[name]) > 100 * column.std() / np.sqrt(len(column))


def test_an_exercise_comes_back_as_it_was_filled_in(tmp_path: Path) -> None:
    computed = [Computed(item, item.answers()) for item in COURSE.items[1:4]]
    write_exercise(tmp_path / "exercise.csv", computed)
    assert {mark.state for mark in marked(tmp_path / "exercise.csv", computed)} == {"blank"}


def test_sources_name_every_item_once() -> None:
    for name in SOURCES:
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
@pytest.mark.parametrize("number", ["Figure II.1", "Figure III.6", "Figure III.10"])
def test_figures_can_be_drawn(number: str) -> None:
    item = next(each for each in THESIS.items if each.number == number)
    pictures = item.pictures()
    assert pictures and all(picture.draw().axes for picture in pictures)
