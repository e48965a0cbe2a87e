"""Pieces of a page: what is no markup is escaped."""

from lab.render.html import element, safe, together


def test_text_is_escaped_once_and_markup_is_kept() -> None:
    made = element("p", safe("a < b & c"))
    assert made == "<p>a &lt; b &amp; c</p>"
    assert together([made, made]).count("&lt;") == 2
