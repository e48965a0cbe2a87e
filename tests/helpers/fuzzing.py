"""Valid files with something changed, by changes that know the structure of a file.

A line or a key is doubled, left out, moved or exchanged, a value becomes one that is hostile, bytes are cut or turned.
"""

import random
from typing import Protocol

from hypothesis import strategies as st

__all__ = ["HOSTILE", "RandomChance", "changed", "mutated"]

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


class Chance(Protocol):
    """What decides how a file is changed."""

    def integer(self, least: int, most: int) -> int: ...

    def text(self) -> str: ...

    def few_bytes(self) -> bytes: ...


class RandomChance:
    """Pseudorandom decisions: many a second."""

    def __init__(self, seed: object) -> None:
        self.random = random.Random(str(seed))
        self.integer = self.random.randint

    def text(self) -> str:
        ranges = ((32, 126), (0, 31), (160, 0xD7FF), (0x1F300, 0x1F5FF))
        return "".join(chr(self.integer(*self.random.choice(ranges))) for _ in range(self.integer(0, 20)))

    def few_bytes(self) -> bytes:
        return self.random.randbytes(self.integer(0, 4))


class HypothesisChance:
    """Decisions that hypothesis takes, and takes back to find the smallest change that fails."""

    def __init__(self, draw: st.DrawFn) -> None:
        self.draw = draw

    def integer(self, least: int, most: int) -> int:
        return self.draw(st.integers(least, most))

    def text(self) -> str:
        return self.draw(st.text(max_size=20))

    def few_bytes(self) -> bytes:
        return self.draw(st.binary(max_size=4))


@st.composite
def changed(draw: st.DrawFn, text: str) -> bytes:
    """A valid file with one to three things changed."""
    return mutated(text, HypothesisChance(draw))


def mutated(text: str, chance: Chance) -> bytes:
    """A valid file with one to three things changed."""
    for _ in range(chance.integer(1, 3)):
        pieces = _pieces(text) if chance.integer(0, 1) else text.splitlines(keepends=True)
        i, j = (chance.integer(0, max(len(pieces) - 1, 0)) for _ in range(2))
        match chance.integer(0, 5):
            case 0 if pieces:
                pieces[i] = _hostile(chance)
            case 1 if pieces:
                pieces[i:i] = [pieces[i]] * (1, 2, 60)[chance.integer(0, 2)]
            case 2:
                del pieces[i : i + chance.integer(1, 5)]
            case 3 if pieces:
                pieces[i], pieces[j] = pieces[j], pieces[i]
            case 4:
                pieces.insert(i, _hostile(chance) if chance.integer(0, 1) else chance.text())
            case 5:
                del pieces[i:]
        text = "".join(pieces)
    content = text.encode("utf-8", "surrogatepass")
    if chance.integer(0, 9) == 0 and content:
        at = chance.integer(0, len(content) - 1)
        content = content[:at] + chance.few_bytes() + content[at + 1 :]
    return content


def _hostile(chance: Chance) -> str:
    return HOSTILE[chance.integer(0, len(HOSTILE) - 1)]
