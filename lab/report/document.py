"""Document for a reader of a result, as plain data: paragraphs, tables, figures, without any markup.

A command builds one ``Document``; ``terminal``, ``page`` and ``markdown`` render it. Each block has the media that
show it. Blocks that have nothing to show (no text, no rows, no pictures) are left out, as are sections of only such.
"""

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial, wraps
from typing import TYPE_CHECKING, Any, ClassVar, Final, Literal, ParamSpec, TypeVar, cast, get_origin

from lab.core.errors import counted
from lab.core.gaps import attempted
from lab.core.number_text import sentence

if TYPE_CHECKING:
    import matplotlib.figure

__all__ = [
    "EVERYWHERE",
    "NARROW",
    "PAGE",
    "RECORDING",
    "TERMINAL",
    "Badge",
    "Block",
    "Bullets",
    "Card",
    "Code",
    "Column",
    "CommandText",
    "Document",
    "Figure",
    "Inline",
    "Matrices",
    "Matrix",
    "Paragraph",
    "Picture",
    "Row",
    "Scene",
    "Section",
    "Strong",
    "Table",
    "Text",
    "Warnings",
    "guarded",
    "inlines",
    "plain",
    "shown",
]

_P = ParamSpec("_P")
_R = TypeVar("_R")
_Medium = Literal["terminal", "page", "recording"]
_Media = frozenset[_Medium]
TERMINAL: Final[_Media] = frozenset({"terminal"})
PAGE: Final[_Media] = frozenset({"page"})
RECORDING: Final[_Media] = frozenset({"recording"})
NARROW: Final[_Media] = TERMINAL | RECORDING
EVERYWHERE: Final[_Media] = NARROW | PAGE
_NUMBER = re.compile(r"[+−±<>≈]? ?(\d[\d.,]*)(e[+−-]?\d+)?( (%|σ|mm|mrad|°))?|∞|–|")


@dataclass(frozen=True)
class Code:
    """A name or a file, letter by letter."""

    text: str


@dataclass(frozen=True)
class Strong:
    """Emphasised words."""

    text: str


@dataclass(frozen=True)
class Badge:
    """A verdict in a word or two: green where good, amber where doubtful, red where bad, else grey."""

    text: str
    kind: Literal["good", "doubtful", "bad", "open"] = "open"


Inline = str | Code | Strong | Badge
Text = Inline | tuple[Inline, ...]


def inlines(text: Text) -> tuple[Inline, ...]:
    """The parts of a text that are not empty."""
    return tuple(part for part in (text if isinstance(text, tuple) else (text,)) if plain(part))


def plain(text: Text) -> str:
    """A text without emphasis; its parts are joined as they are."""
    if isinstance(text, tuple):
        return "".join(plain(part) for part in text)
    return text if isinstance(text, str) else text.text


@dataclass(frozen=True)
class Block:
    """A part of a document."""

    kind: ClassVar[str] = ""
    shown_in: _Media = field(default=EVERYWHERE, kw_only=True)  # the media that show it

    @property
    def everywhere(self) -> "tuple[Block, ...]":
        """The block, and others that show the same in other media."""
        return (self,)

    def _reduced(self, medium: _Medium) -> "Iterable[Block]":
        """Return the parts of the block that a medium shows; none if there is nothing to show."""
        raise NotImplementedError


@dataclass(frozen=True)
class Paragraph(Block):
    """A text; as a ``lead`` it is larger, as a ``note`` smaller. Spaces between its parts are part of them."""

    kind: ClassVar[str] = "paragraph"
    text: Text
    role: Literal["", "lead", "note"] = ""

    def _reduced(self, medium: _Medium) -> Iterable[Block]:
        return (self,) if plain(self.text) else ()


@dataclass(frozen=True)
class Card(Block):
    """First block of a page: is it good, how good, and what to do next.

    Attributes:
        verdict: the badge, with what it was judged by.
        numbers: caption, number and kind of each large number; a kind is that of a table's row, or empty.
        about: what the numbers are, in a sentence.
        next_step: what to do now.
        figures: at most one, small; one without pictures is left out.
    """

    kind: ClassVar[str] = "card"
    verdict: Text
    numbers: tuple[tuple[str, str, str], ...]
    about: str
    next_step: Text
    figures: "tuple[Figure, ...]" = ()

    @property
    def everywhere(self) -> "tuple[Block, ...]":
        """The card for a page, and the same as paragraphs for the other media."""
        numbers = "; ".join(f"{caption}: {number}" for caption, number, _ in self.numbers)
        return (
            self,
            Paragraph(self.verdict, shown_in=NARROW),
            Paragraph(sentence(numbers) if numbers else "", shown_in=NARROW),
            Paragraph((Strong("Next: "), *inlines(self.next_step)), shown_in=NARROW),
        )

    def _reduced(self, medium: _Medium) -> Iterable[Block]:
        figures = tuple(each for each in self.figures if each.pictures)
        return (replace(self, figures=figures),) if medium == "page" else ()


@dataclass(frozen=True)
class CommandText(Block):
    """Command as the user typed it."""

    kind: ClassVar[str] = "command"
    text: str

    def _reduced(self, medium: _Medium) -> Iterable[Block]:
        return (self,) if self.text else ()


@dataclass(frozen=True)
class Bullets(Block):
    """A list; empty items are left out."""

    kind: ClassVar[str] = "bullets"
    items: tuple[Text, ...]

    def _reduced(self, medium: _Medium) -> Iterable[Block]:
        items = tuple(item for item in self.items if plain(item))
        return (replace(self, items=items),) if items else ()


@dataclass(frozen=True)
class Warnings(Block):
    """Warnings, so that they are not overlooked."""

    kind: ClassVar[str] = "warnings"
    texts: tuple[str, ...]

    @property
    def title(self) -> str:
        """Title with the number of warnings."""
        return counted(len(self.texts), "warning")

    def _reduced(self, medium: _Medium) -> Iterable[Block]:
        return (self,) if self.texts else ()


@dataclass(frozen=True)
class Column:
    """The heading of a table's column, and the media that show the column."""

    heading: str = ""
    shown_in: _Media = EVERYWHERE


Row = tuple[Text, ...]


@dataclass(frozen=True)
class Table(Block):
    """A table; columns of numbers are aligned at the right.

    Attributes:
        columns: their headings, or columns; no line of headings where all are empty.
        rows: a cell for each column.
        caption: shown above.
        row_kinds: of each row ``before``, ``after``, ``quiet`` or nothing; empty for none.
        most_rows: the rows beyond these are only counted, in a note.
        rest_in: where those are to be found.
        count: how many rows there are, where only the first of them are given.
        folded: whether a page shows the caption alone until a reader opens it.
    """

    kind: ClassVar[str] = "table"
    columns: tuple[str | Column, ...]
    rows: tuple[Row, ...]
    caption: str = ""
    row_kinds: tuple[str, ...] = ()
    most_rows: int | None = None
    rest_in: str = "result.json"
    count: int | None = None
    folded: bool = False

    def __post_init__(self) -> None:
        if wrong := [row for row in self.rows if len(row) != len(self.columns)]:
            raise ValueError(f"a row has {len(wrong[0])} cells, the table {len(self.columns)} columns: {wrong[0]}")
        if self.row_kinds and len(self.row_kinds) != len(self.rows):
            raise ValueError(f"{len(self.row_kinds)} kinds of rows for {len(self.rows)} rows")

    @property
    def headings(self) -> tuple[str, ...]:
        """Headings of the columns."""
        return tuple(each if isinstance(each, str) else each.heading for each in self.columns)

    @property
    def numeric(self) -> tuple[bool, ...]:
        """Flags of the columns that hold only numbers."""
        cells = [[plain(row[i]) for row in self.rows] for i in range(len(self.columns))]
        return tuple(any(column) and all(map(_NUMBER.fullmatch, column)) for column in cells)

    @property
    def lines(self) -> tuple[tuple[str, Row], ...]:
        """The rows, each after its kind."""
        return tuple(zip(self.row_kinds or ("",) * len(self.rows), self.rows, strict=True))

    def _reduced(self, medium: _Medium) -> Iterable[Block]:
        if not self.rows:
            return ()
        retained = [i for i, each in enumerate(self.columns) if medium in getattr(each, "shown_in", EVERYWHERE)]
        count = len(self.rows) if self.most_rows is None else self.most_rows
        part = replace(
            self,
            columns=tuple(self.columns[i] for i in retained),
            rows=tuple(tuple(row[i] for i in retained) for row in self.rows[:count]),
            row_kinds=self.row_kinds[:count],
        )
        more = (len(self.rows) if self.count is None else self.count) - count
        return (part, Paragraph(f"and {more:,} more, in {self.rest_in}", "note")) if more > 0 else (part,)


@dataclass(frozen=True)
class Matrix:
    """A matrix with its name, in one or several versions.

    Attributes:
        name: above it.
        versions: of each its caption, or nothing, and its entries by rows, which are equally long.
        badge: a word or two beside the name.
    """

    name: str
    versions: tuple[tuple[str, tuple[Row, ...]], ...]
    badge: Text = ""


@dataclass(frozen=True)
class Matrices(Block):
    """Matrices in brackets, side by side where there is room."""

    kind: ClassVar[str] = "matrices"
    matrices: tuple[Matrix, ...]

    def _reduced(self, medium: _Medium) -> Iterable[Block]:
        return (self,) if self.matrices else ()


@dataclass(frozen=True)
class Picture:
    """A picture that is drawn when it is shown.

    Attributes:
        name: letters, digits and hyphens; no other picture of the document may have it.
        label: what it shows, for those who do not see it.
        draw: makes the matplotlib figure.
        chart: makes the same as a ``Chart`` for a page, in a hundredth of the time.
    """

    name: str
    label: str
    draw: "Callable[[], matplotlib.figure.Figure]"
    chart: Callable[[], Any]


@dataclass(frozen=True)
class Figure(Block):
    """Pictures side by side, with what they show; a page alone shows them. ``name`` is its place there.

    Attributes:
        wide: whether it takes the whole width of a page; several pictures always do.
    """

    kind: ClassVar[str] = "figure"
    name: str
    pictures: tuple[Picture, ...]
    caption: str
    wide: bool = False

    def _reduced(self, medium: _Medium) -> Iterable[Block]:
        return (self,) if self.pictures and medium == "page" else ()


@dataclass(frozen=True)
class Scene(Block):
    """An arm that a reader of a page turns and zooms.

    Attributes:
        name: letters, digits and hyphens, unlike those of the document's pictures.
        make: makes the ``lab.report.page_scene.ArmScene`` when it is shown.
        caption: what it shows.
    """

    kind: ClassVar[str] = "scene"
    name: str
    make: Callable[[], Any]
    caption: str

    def _reduced(self, medium: _Medium) -> Iterable[Block]:
        return (self,) if medium == "page" else ()


@dataclass(frozen=True)
class Section(Block):
    """Blocks under a heading; where ``folded``, a page shows the heading alone until a reader opens it."""

    kind: ClassVar[str] = "section"
    title: str
    blocks: tuple[Block, ...]
    folded: bool = False

    def _reduced(self, medium: _Medium) -> Iterable[Block]:
        blocks = tuple(shown(self.blocks, medium))
        return (replace(self, blocks=blocks),) if blocks else ()


@dataclass(frozen=True)
class Document:
    """Document for a reader of a result: a title in one line, and the blocks under it.

    Attributes:
        mark: a word across every screen and sheet of the page, as of an example.
    """

    title: str
    blocks: tuple[Block, ...]
    mark: str = ""

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """Pictures of the document, in order."""
        return tuple(_pictures(self.blocks))


def _pictures(blocks: Iterable[Block]) -> Iterable[Picture]:
    for block in blocks:
        if isinstance(block, Figure):
            yield from block.pictures
        elif isinstance(block, Card):
            yield from _pictures(block.figures)
        elif isinstance(block, Section):
            yield from _pictures(block.blocks)


def shown(blocks: Iterable[Block], medium: _Medium) -> Iterable[Block]:
    """The blocks that a medium shows, without what it does not show of them."""
    for block in blocks:
        if medium in block.shown_in:
            yield from block._reduced(medium)


def guarded(make: Callable[_P, _R]) -> Callable[_P, _R]:
    """Let a function of blocks leave a warning in their place where it fails, so that the rest of a page stays.

    Its return type says whether that is one block or a tuple of blocks.
    """
    what = f"the part '{make.__name__.strip('_').replace('_', ' ')}'"
    returned: Any = make.__annotations__["return"]
    several = get_origin(returned) is tuple

    def gap(missing: str) -> _R:
        warning = Warnings((missing,))
        return cast(_R, (warning,) if several else warning)

    @wraps(make)
    def made(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        return attempted(what, partial(make, *args, **kwargs), gap)

    return made
