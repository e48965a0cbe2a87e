"""Valid files with something changed, by changes that know the structure of a file.

A line or a key is doubled, left out, moved or exchanged, a value becomes one that is hostile, bytes are cut or turned.
"""

from hypothesis import strategies as st

__all__ = ["HOSTILE", "changed"]

HOSTILE = (
    "", "nan", "-inf", "1e999", "-0", "9" * 400, "1e-320", "0x10", "true", "null", '""', "[]", "{}", "[[[[]]]]",
    "=cmd|' /C calc'!A0", "../../x", "p.1", "\x00", "\ud7ff", "٣", "a" * 5000, "1;2", "'", '"', "#", "1_000",
    ".".join("a" * 40), "[" * 2000, "\N{BYTE ORDER MARK}", "\r", "2026-01-01", "12:00:00", "%s%n", "<!--", "]]>",
)  # fmt: skip
_MARKS = ",=;\n\t \"'[]{}<>:/"


def _pieces(text: str) -> list[str]:
    """Words and what separates them."""
    pieces, word = [], ""
    for c in text:
        if c in _MARKS:
            pieces += [word, c] if word else [c]
            word = ""
        else:
            word += c
    return [*pieces, word]


@st.composite
def changed(draw: st.DrawFn, text: str) -> bytes:
    """A valid file with one to three things changed."""
    for _ in range(draw(st.integers(1, 3))):
        pieces = _pieces(text) if draw(st.booleans()) else text.splitlines(keepends=True)
        i, j = (draw(st.integers(0, max(len(pieces) - 1, 0))) for _ in range(2))
        match draw(st.sampled_from(["value", "double", "drop", "swap", "insert", "cut"])):
            case "value" if pieces:
                pieces[i] = draw(st.sampled_from(HOSTILE))
            case "double" if pieces:
                pieces[i:i] = [pieces[i]] * draw(st.sampled_from([1, 2, 60]))
            case "drop":
                del pieces[i : i + draw(st.integers(1, 5))]
            case "swap" if pieces:
                pieces[i], pieces[j] = pieces[j], pieces[i]
            case "insert":
                pieces.insert(i, draw(st.one_of(st.text(max_size=20), st.sampled_from(HOSTILE))))
            case "cut":
                del pieces[i:]
        text = "".join(pieces)
    content = text.encode("utf-8", "surrogatepass")
    if draw(st.integers(0, 9)) == 0 and content:
        at = draw(st.integers(0, len(content) - 1))
        content = content[:at] + draw(st.binary(max_size=4)) + content[at + 1 :]
    return content
