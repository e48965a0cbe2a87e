"""One document, three renderers: the same cells in each, nothing of a user's taken for markup."""

import re
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from lab.render.charts.chart import axes_picture
from lab.render.charts.marks import Axes
from lab.render.document import (
    EVERYWHERE,
    PAGE,
    RECORDING,
    TERMINAL,
    Badge,
    Bullets,
    Card,
    Code,
    Column,
    Command,
    Document,
    Figure,
    Matrices,
    Matrix,
    Paragraph,
    Section,
    Strong,
    Table,
    Warnings,
)
from lab.render.markdown import to_markdown
from lab.render.page import to_html
from lab.render.style import explained
from lab.render.terminal import to_text

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


def test_a_folded_table_shows_its_caption_first_and_all_rows_elsewhere() -> None:
    table = Table(("a",), (("first",), ("second",)), "what it is", folded=True)
    rendered = render(Document("t", (table,)))
    before, _, after = rendered["page"].partition("<summary>what it is (2 rows)</summary>")
    assert "<details" in before and "first" in after and "second" in after
    assert "first" in rendered["terminal"] and "second" in rendered["recording"]
    assert "<summary>" not in render(Document("t", (replace(table, folded=False),)))["page"]


def test_a_card_is_paragraphs_where_there_is_no_page() -> None:
    card = Card(("Verdict: ", Badge("bad", "bad")), (("error", "3 mm", ""), ("gate", "1 mm", "")), "about", "do it")
    rendered = render(Document("t", card.everywhere))
    assert "Verdict: bad\nError: 3 mm; gate: 1 mm.\nNext: do it" in rendered["terminal"]
    page = rendered["page"].split("</style>")[1]
    assert page.count("do it") == 1 and page.count("3 mm") == 1


def test_a_mark_is_across_the_page_alone() -> None:
    rendered = render(Document("t", (Paragraph("words"),), "EXAMPLE"))
    assert '<div class="mark" aria-hidden="true">EXAMPLE</div>' in rendered["page"]
    assert (
        "EXAMPLE" not in rendered["terminal"] and "EXAMPLE" not in render(Document("t", (Paragraph("words"),)))["page"]
    )


def test_numbers_are_aligned_at_the_right_and_words_are_not() -> None:
    table = Table(("", "", "", ""), (("1.5", "x", "", "± 3"), ("−2e−5", "1", "", "∞")))
    assert table.numeric == (True, False, False, True)


def test_what_has_nothing_to_show_is_left_out() -> None:
    empty = (Paragraph(""), Bullets(("",)), Warnings(()), Table(("a",), ()), Figure("f", (), "caption"), Command(""))
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
        Command(HOSTILE),
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


def test_no_line_of_a_page_breaks_in_a_date() -> None:
    said = (Paragraph("<i> since 2026-01-10,"), Bullets(("2026-01-11",)), Warnings(("2026-01-12",)))
    page = to_html(
        Document("t", (*said, Table(("a", "b"), (("2026-01-13", Code("2026-01-14")), ("12026-01-15", "1")))))
    )
    assert re.findall("<time>(.*?)</time>", page) == [f"2026-01-{day}" for day in (10, 11, 12, 13)]
    assert "&lt;i&gt; since <time>" in page and re.search(r"time \{ white-space: nowrap", page)


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


def test_warnings_that_were_told_are_not_told_again(capsys) -> None:
    from lab.render.terminal import print_document

    document = Document("t", (Warnings(("careful",)),))
    print_document(document, warnings=False)
    assert "careful" not in capsys.readouterr().out
    print_document(document)
    assert "warning: careful" in capsys.readouterr().out


def test_a_document_is_read_without_a_drawing_library() -> None:
    """Pictures are drawn when a page is made, not before, and those of one set of axes without matplotlib."""
    code = """
import sys
from lab.render.document import Document, Figure, Paragraph
from lab.render.markdown import to_markdown
from lab.render.charts.chart import axes_picture
from lab.render.terminal import to_text
picture = axes_picture("n", "l", (3, 2), lambda axes: axes.plot([0, 1], [1, 2]))
document = Document("t", (Paragraph("p"), Figure("f", (picture,), "c")))
assert "p" in to_text(document) and "p" in to_markdown(document)
assert not {"matplotlib", "jinja2", "rerun", "mujoco"} & set(sys.modules)
from lab.render.page import to_html
assert to_html(document).count("<svg") == 1 and not {"matplotlib", "rerun", "mujoco"} & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_long_page_has_contents_a_glossary_and_tables_that_fold() -> None:
    rows = tuple((str(i),) for i in range(20))
    sections = tuple(Section(f"part {i}", (Paragraph("aliased, with σ" if i else "plain"),)) for i in range(4))
    page = to_html(Document("t", (*sections, Section("last", (Table(("n",), rows, "many"), Table(("n",), rows[:3]))))))
    for i, title in enumerate(["part 0", "part 1", "part 2", "part 3", "last"], 1):
        assert f'<a href="#section-{i}">{title}</a>' in page and f'<section id="section-{i}">\n<h2>{title}</h2>' in page
    assert page.count("<details") == 1 and "many (20 rows)" in page
    assert re.findall(r"<dt>(.*?)</dt>", page) == ["aliased", "σ"]
    short_page = to_html(Document("t", sections[:2]))
    assert "<nav" not in short_page and "<dt>" not in short_page


def test_terms_are_found_as_words() -> None:
    assert [term for term, _ in explained(["The ps of RMSE, and gates"])] == ["gate", "p"]
    assert explained(["nothing here"]) == ()


def test_matrices_are_in_brackets_and_side_by_side() -> None:
    rows = (("c1", "−s1"), (Strong("s1"), "0"))
    one = Matrix("A <b>", (("printed", rows), ("here", (("1", "2"), ("3", "44")))), Badge("agrees", "good"))
    two = Matrix("B", (("", (("x",), ("y",), ("z",))),))
    shown_in = render(Document("Matrices", (Matrices((one, two)), Matrices(()))))
    lines = shown_in["terminal"].splitlines()
    assert "⎡ c1  −s1 ⎤  ⎡ 1  2  ⎤" in lines[3] and "⎣ s1  0   ⎦  ⎣ 3  44 ⎦" in lines[4]
    assert [line[-1] for line in lines[2:5]] == ["⎤", "⎥", "⎦"]  # the second beside the first
    narrow = to_text(Document("Matrices", (Matrices((one, two)),)), 30).splitlines()
    assert max(map(len, narrow)) <= 30 and sum("⎡" in line for line in narrow) == 2  # one below the other
    page = shown_in["page"]
    assert "A &lt;b&gt;" in page and page.count('<div class="matrix">') == 2 and page.count("<table>") == 3
    assert "| **s1** | 0 |" in shown_in["recording"] and "**agrees**" in shown_in["recording"]
