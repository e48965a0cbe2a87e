"""Every item of every source: what is right of the printed values agrees, errata differ, nothing is left out."""

import numpy as np
import pytest
from helpers.computed_sources import ITEMS, SEARCHED, computed

from lab.extensions.reproduction.item import Item, source_named, sources
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


@pytest.mark.thorough
@pytest.mark.figures
@pytest.mark.parametrize("number", ["Figure II.1", "Figure III.10"])
def test_figures_can_be_drawn(number: str) -> None:
    item = next(each for each in THESIS.items if each.number == number)
    pictures = item.pictures()
    assert pictures and all(picture.draw().axes for picture in pictures)
