"""Compute every item of a source again."""

from lab.extensions.reproduction.marking import Computed, marked
from lab.extensions.reproduction.options import ReproduceOptions
from lab.extensions.reproduction.registry import source_named
from lab.extensions.reproduction.result import ReproductionResult

__all__ = ["reproduce"]


def reproduce(options: ReproduceOptions) -> ReproductionResult:
    """The tables, figures and worked examples of a source, each beside what it prints.

    Raises:
        LabError: the file to be marked is no exercise of this source.
    """
    source = source_named(options.source)
    computed = tuple(Computed(item, item.answers()) for item in source.items)
    marks = None if options.mark is None else marked(options.mark, computed)
    return ReproductionResult(options, source, computed, marks)
