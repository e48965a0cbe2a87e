"""Values in brackets, ``[[1, 2], TRUE, "a"]``, as RAPID writes them and URScript its lists."""

import re
from typing import TypeAlias

from lab.formats.programs.reading.numbers import NUMBER, Number

__all__ = ["Value", "arguments", "numbers_in", "read_value"]

Value: TypeAlias = "Number | str | list[Value]"
_TOKEN = re.compile(rf'\s*(?:(?P<number>{NUMBER})|(?P<word>"[^"]*"|[A-Za-z_]\w*)|(?P<mark>[\[\],]))')


def read_value(text: str, start: int) -> tuple[Value, int] | None:
    """The value that begins at a character, and where it ends; None where anything else than values is in it."""
    found = _TOKEN.match(text, start)
    if not found:
        return None
    if found["number"]:
        return Number(found.start("number"), found["number"]), found.end()
    if found["word"]:
        return found["word"], found.end()
    if found["mark"] != "[":
        return None
    values, at = list[Value](), found.end()
    while True:
        part = read_value(text, at)
        if part is None:
            return None
        values.append(part[0])
        mark = _TOKEN.match(text, part[1])
        if not mark or mark["mark"] not in ("]", ","):
            return None
        at = mark.end()
        if mark["mark"] == "]":
            return values, at


def numbers_in(value: Value, count: int) -> tuple[Number, ...] | None:
    """The numbers of a list of so many numbers; None where it is anything else."""
    if not isinstance(value, list) or len(value) != count:
        return None
    found = tuple(each for each in value if isinstance(each, Number))
    return found if len(found) == count else None


def arguments(text: str, start: int, end: int) -> list[tuple[int, str]]:
    """What is between two characters, parted at the commas that are in no brackets: where each begins, and its text."""
    parts, depth, begun = list[tuple[int, str]](), 0, start
    for at in range(start, end):
        depth += (text[at] in "[({") - (text[at] in "])}")
        if text[at] == "," and not depth:
            parts.append((begun, text[begun:at]))
            begun = at + 1
    parts.append((begun, text[begun:end]))
    return [(at + len(part) - len(part.lstrip()), part.strip()) for at, part in parts]
