"""Items of the four sources with what the lab computes of them, once a process; nobody changes them."""

from functools import cache

from lab.extensions.reproduction.item import Computed, Item, source_named, sources
from lab.extensions.reproduction.reproduction_options import ReproduceOptions
from lab.extensions.reproduction.reproduction_result import ReproductionResult

__all__ = ["ITEMS", "SEARCHED", "computed", "item_of", "result_of"]

ITEMS: tuple[tuple[str, Item], ...] = tuple((name, item) for name in sources() for item in source_named(name).items)
"""Every item with the name of its source."""
SEARCHED = frozenset({  # designs, volumes, and virtual arms: seconds
    "Table IV.2", "Table IV.3", "Figure IV.1", "Figure IV.2", "Conclusion", "Section 6.1", "Figure I.4", "Table I.1",
    "Chapter I, section III.1", "Chapter I, section V.3",
})  # fmt: skip


def item_of(source: str, number: str) -> Item:
    """Return an item by its whole number."""
    return next(item for name, item in ITEMS if (name, item.number) == (source, number))


@cache
def computed(source: str, number: str) -> Computed:
    """Return an item with its answers."""
    item = item_of(source, number)
    return Computed(item, item.answers())


def result_of(source: str, chosen: str) -> ReproductionResult:
    """Return what ``lab.reproduce(source, item=chosen)`` does, of items that are computed once."""
    found = source_named(source)
    items = tuple(computed(source, item.number) for item in found.chosen(chosen))
    return ReproductionResult(ReproduceOptions(source, chosen), found, items)
