"""A page of a result as a test reads it."""

import re
from html.parser import HTMLParser
from pathlib import Path

VOID = {"meta", "br", "link", "img", "hr", "input"}


class Page(HTMLParser):
    """A page's text, elements and tables; it refuses what is not closed, doubled or from elsewhere."""

    def __init__(self, path: Path) -> None:
        super().__init__(convert_charrefs=True)
        self.source = path.read_text(encoding="utf-8")
        self.open, self.tags, self.ids, self.links = [], [], [], []
        self.headings, self.figures, self.tables, self.items, self.text = [], {}, [], [], ""
        self.feed(self.source)
        self.close()
        assert self.source.startswith("<!DOCTYPE html>") and not self.open
        assert len(self.ids) == len(set(self.ids))
        assert self.tags.count("script") == 1 and set(self.links) <= {"", *self.ids}
        assert not {"link", "img", "iframe", "object", "foreignobject"} & set(self.tags)
        assert not re.search(r"https?://|@import|url\((?!#)|<!ENTITY", self.source)

    def handle_starttag(self, tag, attrs):
        self.handle_startendtag(tag, attrs)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        values = dict(attrs)
        assert len(values) == len(attrs) and not any(name.startswith("on") for name in values)
        for name in ("href", "xlink:href", "src", "action"):
            target = values.get(name, "#")
            assert target.startswith("data:image/png;base64,") or target[0] == "#"
            self.links += [] if target[0] != "#" else [target[1:]]
        if tag == "script":  # the page's own, which sorts tables, and data
            assert values in ({}, {"type": "application/json"})
        self.tags.append(tag if tag != "script" or not values else "data")
        if "id" in values:
            self.ids.append(values["id"])
        if tag in ("h1", "h2"):
            self.headings.append("")
        if tag == "figure":
            self.figures[values["id"]] = {"svg": 0, "caption": ""}
        if tag == "svg":
            assert values["role"] == "img" and values["aria-label"] and values["viewbox"]
            if "figure" in self.open:
                list(self.figures.values())[-1]["svg"] += 1
            else:  # as small as a word
                assert values["class"] == "spark" and "td" in self.open
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.tables[-1].append([])
        if tag in ("td", "th"):
            self.tables[-1][-1].append("")
        if tag == "li" and "nav" not in self.open:
            self.items.append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "script" in self.open or ("style" in self.open and "svg" not in self.open):
            return
        self.text += data
        if self.open and self.open[-1] in ("h1", "h2"):
            self.headings[-1] += data
        if "figcaption" in self.open:
            list(self.figures.values())[-1]["caption"] += data
        if {"td", "th"} & set(self.open):
            self.tables[-1][-1][-1] += data
        if "li" in self.open and "nav" not in self.open:
            self.items[-1] += data

    def number(self, cell: str) -> float:
        return float(cell.replace("−", "-").replace(",", "").lstrip("± "))

    def table(self, *header: str) -> list[list[str]]:
        """The rows of the table whose headings begin so."""
        (found,) = [rows for rows in self.tables if tuple(rows[0][: len(header)]) == header]
        return found[1:]
