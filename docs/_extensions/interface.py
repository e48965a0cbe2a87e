"""What autodoc makes of the public interface: short names of types, and docstrings of properties as they are."""

from sphinx.application import Sphinx

SHORT = {
    "ndarray[tuple[Any, ...], dtype[float64]]": "ndarray",
    "ndarray[tuple[Any, ...], dtype[int64]]": "ndarray",
    "ndarray[tuple[Any, ...], dtype[bool]]": "ndarray",
}
_kept: dict[str, list[str]] = {}


def shorten(
    app: Sphinx, what: str, name: str, obj: object, options: object, signature: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """Write types of arrays as a person does."""
    for long, short in SHORT.items():
        signature, returned = (text and text.replace(long, short) for text in (signature, returned))
    return signature, returned


def keep(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Remember a property's docstring, before napoleon takes what precedes a colon for its type."""
    if what in ("property", "attribute"):
        _kept[name] = list(lines)


def bring_back(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Put the docstring of a property in place again."""
    if name in _kept:
        lines[:] = _kept.pop(name)


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect before and after napoleon."""
    app.connect("autodoc-process-signature", shorten)
    app.connect("autodoc-process-docstring", keep, priority=400)
    app.connect("autodoc-process-docstring", bring_back, priority=600)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
