"""One document, three renderers: the same cells in each, nothing of a user's taken for markup."""

import re
from html.parser import HTMLParser

import pytest

from lab.report.charts.chart import axes_picture
from lab.report.charts.marks import Axes
from lab.report.document import (
    EVERYWHERE,
    PAGE,
    RECORDING,
    TERMINAL,
    Badge,
    Bullets,
    Code,
    Column,
    CommandText,
    Document,
    Figure,
    Paragraph,
    Section,
    Strong,
    Table,
    Warnings,
)
from lab.report.markdown import to_markdown
from lab.report.page import to_html
from lab.report.terminal import to_text

HOSTILE = """<script>alert("$x_1$")</script>&'<b>*_|`[a](b)"""
CELLS = (("link1.d", "1.25", "−3"), ("a|b", "", "∞"), ("joint_2 <x>", "0.5", "7"))


def render(document: Document) -> dict[str, str]:
    return {"terminal": to_text(document, 200), "page": to_html(document), "recording": to_markdown(document)}


def picture(name: str = "line", label: str = "a line"):
    def draw(axes: Axes) -> None:
        axes.plot([0, 1], [0, 1], label=label)
        axes.legend()

    return axes_picture(name, label, (3, 2), draw)


class Rows(HTMLParser):
    """The cells of a page's tables."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.inside = False
        self.feed(source)

    def handle_starttag(self, tag, attrs):
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
            self.inside = True

    def handle_endtag(self, tag):
        self.inside = self.inside and tag not in ("td", "th")

    def handle_data(self, data):
        if self.inside:
            self.rows[-1][-1] += data


def cells_of(rendered: dict[str, str]) -> dict[str, list[list[str]]]:
    """The table's cells, headings first, as each medium has them."""
    lines = [re.split("[│┃]", line)[1:-1] for line in rendered["terminal"].splitlines() if line[:1] in ("│", "┃")]
    marked = [
        line for line in rendered["recording"].splitlines() if line.startswith("|") and not set(line) <= set("|:- ")
    ]
    split = [[re.sub(r"\\(.)", r"\1", cell) for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in marked]
    found = {"terminal": lines, "page": Rows(rendered["page"]).rows, "recording": split}
    return {medium: [[cell.strip() for cell in row] for row in rows] for medium, rows in found.items()}


def test_a_table_has_the_same_cells_in_every_medium() -> None:
    table = Table(("parameter", "value", "correction"), CELLS, row_kinds=("before", "", "quiet"))
    expected = [["parameter", "value", "correction"], *map(list, CELLS)]
    assert cells_of(render(Document("t", (table,)))) == dict.fromkeys(("terminal", "page", "recording"), expected)


def test_columns_and_blocks_are_shown_where_they_say() -> None:
    table = Table((Column("name"), Column("wide", PAGE), Column("narrow", TERMINAL | RECORDING)), (("a", "b", "c"),))
    words = {"terminal": TERMINAL, "page": PAGE, "recording": RECORDING, "every": EVERYWHERE}
    blocks = [Paragraph(f"only-{name}", shown_in=media) for name, media in words.items()]
    rendered = render(Document("t", (table, Section("s", tuple(blocks)))))
    narrow, wide = [["name", "narrow"], ["a", "c"]], [["name", "wide"], ["a", "b"]]
    assert cells_of(rendered) == {"terminal": narrow, "page": wide, "recording": narrow}
    for medium, text in rendered.items():
        assert {name for name in words if f"only-{name}" in text} == {medium, "every"}


def test_numbers_are_aligned_at_the_right_and_words_are_not() -> None:
    table = Table(("", "", "", ""), (("1.5", "x", "", "± 3"), ("−2e−5", "1", "", "∞")))
    assert table.numeric == (True, False, False, True)


def test_what_has_nothing_to_show_is_left_out() -> None:
    empty = (
        Paragraph(""),
        Bullets(("",)),
        Warnings(()),
        Table(("a",), ()),
        Figure("f", (), "caption"),
        CommandText(""),
    )
    for medium, text in render(Document("title", (*empty, Section("heading", empty)))).items():
        assert "heading" not in text and "caption" not in text.split("</style>")[-1], medium


def test_rows_beyond_the_most_are_counted() -> None:
    rendered = render(Document("t", (Table(("n",), tuple((str(i),) for i in range(1500)), most_rows=3),)))
    assert {medium: rows for medium, rows in cells_of(rendered).items() if len(rows) != 4} == {}
    assert all("and 1,497 more, in result.json" in text for text in rendered.values())


def test_a_row_has_a_cell_for_each_column() -> None:
    with pytest.raises(ValueError, match="1 cells, the table 2 columns"):
        Table(("a", "b"), (("1",),))
    with pytest.raises(ValueError, match="2 kinds of rows for 1 rows"):
        Table(("a",), (("1",),), row_kinds=("", ""))


def test_what_a_user_named_is_text_everywhere() -> None:
    blocks = (
        Paragraph((HOSTILE, Strong(HOSTILE), Code(HOSTILE), Badge(HOSTILE, "bad"))),
        CommandText(HOSTILE),
        Bullets((HOSTILE,)),
        Warnings((HOSTILE,)),
        Table((HOSTILE,), ((HOSTILE,), (Code(HOSTILE),)), HOSTILE),
        Section(HOSTILE, (Paragraph(HOSTILE),)),
        Figure("f", (picture(label=HOSTILE),), HOSTILE),
    )
    rendered = render(Document(HOSTILE, blocks))
    page = rendered["page"]
    assert page.count("<script") == 1 and "<b>" not in page and page.count("alert(") >= 14
    assert rendered["terminal"].count(HOSTILE) >= 10
    for line in rendered["recording"].splitlines():
        code = line.startswith("    ")
        assert code or re.search(r"(?<!\\)[<*`\[\]]", line.replace("**", "")) is None, line


@pytest.mark.figures
def test_a_page_needs_nothing_but_itself_and_has_the_same_bytes() -> None:
    document = Document("t", (Paragraph("p", "lead"), Figure("f", (picture(), picture("other")), "two lines")))
    page = to_html(document)
    assert page == to_html(document)
    assert page.count("<script>") == page.count("<script") == 1
    assert not re.search(r"<link|<img|https?://|@import|url\((?!#)|<!ENTITY", page)
    ids = re.findall(r'\bid="([^"]*)"', page)
    assert len(ids) == len(set(ids)) and page.count("<svg") == 2
    assert "prefers-color-scheme: dark" in page and "@media print" in page and 'name="viewport"' in page
