"""Pages that need nothing but themselves: texts, tables and pictures in one HTML file, for screen, phone and paper.

Whatever is not ``Html`` already is escaped: names of robots, targets, files and poses are a user's.
"""

import io
import re
from collections.abc import Callable, Iterable, Sequence
from html import escape
from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lab.render.format import capital, fixed, short
from lab.render.style import FIGURE_STYLE

__all__ = ["capital", "fixed", "short"]
INK, QUIET = "#1f2937", "#6b7280"

BEFORE, AFTER, MEASURED, OFF = "#c0392b", "#1e8449", "#b7791f", "#c2185b"  # the same meaning as in recordings
_NUMBER = re.compile(r"[+−±<>≈]? ?(\d[\d.,]*)(e[+−-]?\d+)?( (%|σ|mm|mrad|°))?|∞|")
_STYLE = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 62rem; padding: 1.5rem 1.25rem 4rem; background: #fff; color: #1f2937;
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.75rem; line-height: 1.25; margin: 0 0 .6rem; overflow-wrap: anywhere; }
h2 { font-size: 1.25rem; margin: 2.4rem 0 .6rem; padding-bottom: .25rem; border-bottom: 1px solid #d1d5db; }
h3 { font-size: 1rem; margin: 1.4rem 0 .4rem; }
p { margin: .5rem 0; overflow-wrap: anywhere; }
p.lead { font-size: 1.1rem; }
p.note { color: #4b5563; font-size: .9rem; }
code { font: .85em/1.45 ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono", monospace; }
pre { background: #f3f4f6; border-radius: 6px; padding: .6rem .8rem; margin: .6rem 0; white-space: pre-wrap;
  overflow-wrap: anywhere; }
.badge { display: inline-block; padding: .1em .6em; border-radius: 999px; color: #fff; font-weight: 600; }
.badge.good { background: #1e8449; } .badge.bad { background: #c0392b; } .badge.open { background: #6b7280; }
.warnings { background: #fffbeb; border: 1px solid #f0c36d; border-left: 6px solid #d97706; border-radius: 6px;
  padding: .5rem 1rem; margin: 1rem 0; }
.warnings h2 { border: 0; margin: .2rem 0; font-size: 1rem; }
.warnings ul { margin: .3rem 0; padding-left: 1.2rem; }
.warnings li { margin: .3rem 0; overflow-wrap: anywhere; }
.table { overflow-x: auto; margin: .8rem 0; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { padding: .22rem .7rem; text-align: left; border-bottom: 1px solid #e5e7eb; vertical-align: top; }
th { border-bottom: 2px solid #9ca3af; font-weight: 600; }
td.number, th.number { text-align: right; white-space: nowrap; }
tr.before td:first-child { color: #c0392b; font-weight: 600; }
tr.after td:first-child { color: #1e8449; font-weight: 600; }
tr.quiet td { color: #6b7280; }
figure { margin: 1rem 0; }
.panels { display: flex; flex-wrap: wrap; gap: .5rem 1rem; justify-content: flex-start; align-items: flex-start; }
.panels svg { flex: 0 1 auto; width: 100%; height: auto; }
figcaption { color: #4b5563; font-size: .9rem; margin-top: .3rem; }
@media screen and (max-width: 44rem) {
  .panels { overflow-x: auto; }
  .panels svg.wide { min-width: 36rem; }
}
@page { size: A4; margin: 14mm 13mm; }
@media print {
  html { font-size: 12.5px; }
  body { max-width: none; padding: 0; font-size: 1rem; }
  .panels svg.half { width: 48%; }
  h2, h3 { break-after: avoid; }
  h2 { margin-top: 1.4rem; }
  figure, .warnings, tr, pre { break-inside: avoid; }
  p { orphans: 3; widows: 3; }
  thead { display: table-header-group; }
  .table { overflow: visible; }
  th, td { padding: .12rem .45rem; }
  .badge, .warnings, pre { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
"""


class Html(str):
    """A text that is markup already; any other is escaped where it enters a page."""

    __slots__ = ()


def safe(text: str) -> Html:
    """The text as markup."""
    return text if isinstance(text, Html) else Html(escape(text, quote=True))


def together(parts: Iterable[str]) -> Html:
    """Parts one after the other."""
    return Html("\n".join(safe(part) for part in parts if part))


def element(name: str, content: str, kind: str = "") -> Html:
    """One element, of a class where that is given."""
    of = f' class="{escape(kind)}"' if kind else ""
    return Html(f"<{name}{of}>{safe(content)}</{name}>")


def paragraph(text: str, kind: str = "") -> Html:
    """A paragraph; ``lead`` is larger, ``note`` smaller. Nothing for no text."""
    return element("p", text, kind) if text else Html("")


def section(title: str, parts: Iterable[str]) -> Html:
    """Parts under a heading; nothing where there are none."""
    content = together(parts)
    return Html(f"<section>\n{element('h2', title)}\n{content}\n</section>") if content else Html("")


def command(text: str) -> Html:
    """What was typed."""
    return Html(f"<pre><code>{safe(text)}</code></pre>")


def badge(words: str, kind: str = "") -> Html:
    """A verdict, green for ``good``, red for ``bad``; any other is grey unless its kind is given."""
    kind = kind or words
    return element("span", words, f"badge {kind if kind in ('good', 'bad') else 'open'}")


def warnings_box(warnings: Sequence[str]) -> Html:
    """Warnings as a list that is not overlooked; nothing where there are none."""
    if not warnings:
        return Html("")
    title = "1 warning" if len(warnings) == 1 else f"{len(warnings)} warnings"
    listed = "".join(element("li", warning) for warning in warnings)
    return Html(f'<section class="warnings">\n{element("h2", title)}\n<ul>{listed}</ul>\n</section>')


def table(
    header: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "", kinds: Sequence[str] | None = None
) -> Html:
    """A table; columns of numbers (and of empty cells) are aligned at the right.

    Args:
        header: of each column; no line of them where all are empty.
        kinds: the class of each row: ``before``, ``after``, ``quiet`` or none.
    """
    numeric = [bool(rows) and all(_NUMBER.fullmatch(row[i]) for row in rows) for i in range(len(header))]
    styles = ["number" if number and any(row[i] for row in rows) else "" for i, number in enumerate(numeric)]
    titles = "".join(element("th", text, style) for text, style in zip(header, styles, strict=True))
    head = f"<thead><tr>{titles}</tr></thead>" if any(header) else ""
    lines = [
        element("tr", Html("".join(element("td", cell, style) for cell, style in zip(row, styles, strict=True))), kind)
        for row, kind in zip(rows, kinds or [""] * len(rows), strict=True)
    ]
    above = paragraph(caption, "note")
    body = "\n".join(lines)
    return Html(f'{above}\n<div class="table"><table>{head}\n<tbody>\n{body}\n</tbody></table></div>')


def figure(name: str, panels: Sequence[Html], caption: str) -> Html:
    """Pictures side by side as far as there is room, with what they show. ``name`` is its place in the page."""
    drawn = "\n".join(panels)
    return Html(
        f'<figure id="{escape(name)}">\n<div class="panels">\n{drawn}\n</div>\n'
        f"{element('figcaption', caption)}\n</figure>"
    )


def page(title: str, parts: Iterable[str]) -> str:
    """The whole page; its heading is its title."""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"{element('title', title)}\n<style>{_STYLE}</style>\n</head>\n<body>\n{element('h1', title)}\n"
        f"{together(parts)}\n</body>\n</html>\n"
    )


def write_page(path: Path, title: str, parts: Iterable[str]) -> None:
    """Write a page."""
    path.write_text(page(title, parts), encoding="utf-8")


_PROLOGUE = re.compile(r"^.*?(?=<svg\b)|<metadata>.*?</metadata>", re.DOTALL)
_NAMESPACES = re.compile(r' (xmlns(:xlink)?|version|width|height)="[^"]*"')
_NAMES = re.compile(r'(\bid="|url\(#|href="#)')
_POINTS_PER_INCH, _PX_PER_INCH = 72, 96
_HALF_PX = 480  # a picture no wider than this has room for another beside it


def panel(
    name: str,
    label: str,
    size: tuple[float, float],
    draw: Callable[[Axes], None],
    margins: tuple[float, float, float, float] = (0.7, 0.5, 0.15, 0.3),
) -> Html:
    """One set of axes as inline SVG.

    Args:
        name: of the picture in its page; no other may have it.
        label: what it shows, for those who do not see it.
        size: width and height, inches.
        margins: left, bottom, right and top of the axes, inches.
    """
    (width, height), (left, bottom, right, top) = size, margins
    with matplotlib.rc_context(FIGURE_STYLE):
        figure = Figure(figsize=size)
        place = (left / width, bottom / height, 1 - (left + right) / width, 1 - (bottom + top) / height)
        draw(figure.add_axes(place))
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None})
    return inline(text.getvalue(), name, label)


def inline(svg: str, name: str, label: str) -> Html:
    """An SVG file as a part of a page: without prologue and metadata, its names its own, with a title."""
    svg = _NAMES.sub(rf"\g<1>{name}-", _PROLOGUE.sub("", svg))
    opening, rest = svg.split(">", 1)
    width = re.search(r'width="([\d.]+)pt"', opening)
    assert width is not None
    pixels = round(float(width[1]) * _PX_PER_INCH / _POINTS_PER_INCH)
    opening = _NAMESPACES.sub("", opening)
    words = escape(label, quote=True)
    kind = "half" if pixels <= _HALF_PX else "wide"
    told = f'class="{kind}" role="img" aria-label="{words}" style="max-width: {pixels}px"'
    return Html(f"{opening} {told}><title>{words}</title>{rest}")
