"""A document as Markdown: the text panel of a recording."""

import re
from collections.abc import Iterable

from lab.report import document as doc
from lab.report.document import inlines, plain, shown

__all__ = ["to_markdown"]

_SPECIAL = re.compile(r"[\\`*<>|\[\]]|(?<!\w)_|_(?!\w)")  # an underscore within a word emphasises nothing


def to_markdown(document: doc.Document) -> str:
    """The document; what a user named is escaped."""
    return "\n\n".join([f"# {_escaped(document.title)}", *_blocks(shown(document.blocks, "recording"), 2)]) + "\n"


def _blocks(blocks: Iterable[doc.Block], level: int) -> Iterable[str]:
    for block in blocks:
        match block:
            case doc.Section():
                yield f"{'#' * level} {_escaped(block.title)}"
                yield from _blocks(block.blocks, level + 1)
            case doc.Paragraph():
                yield _to_inline(block.text)
            case doc.CommandText():
                yield f"    {block.text}"
            case doc.Bullets():
                yield _list(map(_to_inline, block.items))
            case doc.Warnings():
                yield f"**{block.title}**\n\n{_list(map(_escaped, block.texts))}"
            case doc.Table():
                yield from _table(block)
            case doc.Matrices():
                yield from (text for matrix in block.matrices for text in _matrix(matrix))


def _list(items: Iterable[str]) -> str:
    return "\n".join(f"- {item}" for item in items)


def _matrix(matrix: doc.Matrix) -> Iterable[str]:
    yield f"**{_escaped(matrix.name)}** {_to_inline(matrix.badge)}".strip()
    for caption, rows in matrix.versions:
        yield from _table(doc.Table((caption, *[""] * (len(rows[0]) - 1)), rows))


def _table(block: doc.Table) -> Iterable[str]:
    if block.caption:
        yield _escaped(block.caption)
    lines = [map(_escaped, block.headings), ("--:" if number else ":--" for number in block.numeric)]
    lines += [map(_to_inline, cells) for _, cells in block.lines]
    yield "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _to_inline(text: doc.Text) -> str:
    parts = ((isinstance(part, doc.Strong | doc.Badge), _escaped(plain(part))) for part in inlines(text))
    return "".join(f"**{words}**" if strong else words for strong, words in parts)


def _escaped(text: str) -> str:
    """Text in one line, that Markdown shows as it is."""
    return _SPECIAL.sub(r"\\\g<0>", " ".join(text.splitlines()))
