"""Every item of every source: what is right of the printed values agrees, errata differ, nothing is left out."""

import numpy as np
import pytest
from helpers.computed_sources import ITEMS, SEARCHED, computed

from lab.extensions.reproduction.item import Item, labels, source_named, sources
from lab.extensions.reproduction.thesis import ESTIMATES, THESIS
from lab.extensions.reproduction.thesis_case import HIDDEN, INTO, OFFSETS, errors

QUICK = [each for each in ITEMS if each[1].number not in SEARCHED]
LONG = [each for each in ITEMS if each[1].number in SEARCHED]


def check(source: str, item: Item) -> None:
    """A printed value agrees, or is an erratum with a reason and does not."""
    answers = computed(source, item.number).answers
    assert len({answer.name for answer in answers}) == len(answers)
    for answer in answers:
        assert answer.state != "differs", f"{item.number} {answer.name}: {answer.ours}, {answer.difference}"
        assert (answer.state == "erratum") == bool(answer.erratum), f"{item.number} {answer.name}"


@pytest.mark.parametrize(("source", "item"), QUICK, ids=lambda each: getattr(each, "number", each))
def test_every_printed_value_agrees_or_is_an_erratum(source: str, item: Item) -> None:
    check(source, item)


@pytest.mark.thorough
@pytest.mark.parametrize("source_and_item", LONG, ids=lambda each: each[1].number)
def test_every_value_that_a_search_gives_agrees_or_is_an_erratum(source_and_item: tuple[str, Item]) -> None:
    check(*source_and_item)


def test_the_three_rows_come_out_as_printed_with_what_is_hidden() -> None:
    """The errata of table IV.2 are what the dropped parameters make of them."""
    joints = np.random.default_rng(0).uniform(-np.pi, np.pi, (20, 6))
    off = errors(joints, 200, hidden=HIDDEN) + np.array(list(OFFSETS.values()))
    printed = dict(zip(OFFSETS, (row.split() for row in ESTIMATES.strip().splitlines()), strict=True))
    for name in INTO.values():
        column, digits = off[:, list(OFFSETS).index(name)], [float(text) for text in printed[name][1:]]
        assert np.abs(np.median(column) - np.mean(digits)) < (0.005 if name == "link3.d" else 2e-4)
        assert np.abs(np.median(column) - OFFSETS[name]) > 100 * column.std() / np.sqrt(len(column))


def test_sources_name_every_item_once() -> None:
    for name in sources():
        source = source_named(name)
        numbers = [each.number for each in (*source.items, *source.missing)]
        assert source.name == name and len(set(numbers)) == len(numbers)
        assert all(each.reason for each in source.missing)
        assert all(each.command or each.note for each in source.items), name


def named(source: str, *, with_kind: bool = False) -> set[str]:
    """The numbers of all items, and of those that cannot be computed; with "Table" and the like before them."""
    found = source_named(source)
    headings = [each.number for each in (*found.items, *found.missing)]
    kind = {each: f"{each.partition(' ')[0].rstrip('s')} " if with_kind else "" for each in headings}
    return {kind[each] + label for each in headings for label in labels(each)}


def test_the_thesis_is_complete() -> None:
    """Each table, figure and equation of the thesis is an item, or is listed with a reason."""
    last = {
        "Figure I": 7, "Figure II": 1, "Figure III": 10, "Figure IV": 2, "Table I": 1, "Table III": 3, "Table IV": 3,
        "Equation II": 9, "Equation III": 31, "Equation IV": 26,
    }  # fmt: skip
    wanted = {f"{chapter}.{i}" for chapter, count in last.items() for i in range(1, count + 1)}
    assert wanted - named("thesis", with_kind=True) == set()


SECTIONS = {  # of each source: what it numbers, sections of the course, else equations and figures
    "course": {
        *("1", "2", "3", "4", "5.1", "5.2", "5.3", "5.4", "5.5", "5.6", "6.1", "6.2", "7.1", "7.2", "7.3", "7.4"),
        *(f"8.{i}" for i in range(1, 10)), "9", "10.1", "10.2", "10.3",
        "11.1", "11.2", "11.3", "11.3.1", "11.3.2", "11.4.1", "11.4.2", "11.4.3", "11.4.4", "11.5", "11.6",
        *(f"A3.{i}" for i in range(1, 12)),
    },
    "elastic": {*(f"3.{i}" for i in range(21, 41)), "3.4", "3.5", "3.7"},
    "staubli": {*(f"1.{i}" for i in range(1, 7)), "1", "2", "3", "1.3.5"},
}  # fmt: skip


@pytest.mark.parametrize("name", SECTIONS)
def test_every_numbered_item_of_the_other_sources_is_there_or_listed(name: str) -> None:
    assert SECTIONS[name] - named(name) == set()


@pytest.mark.thorough
@pytest.mark.figures
@pytest.mark.parametrize("number", ["Figure II.1", "Figure III.10"])
def test_figures_can_be_drawn(number: str) -> None:
    item = next(each for each in THESIS.items if each.number == number)
    pictures = item.pictures()
    assert pictures and all(picture.draw().axes for picture in pictures)
