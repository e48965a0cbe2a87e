"""Read values in brackets, ``[[1, 2], TRUE, "a"]``, of RAPID and of URScript's lists."""

import re
from collections.abc import Iterator
from typing import TypeAlias

from lab.core.errors import LabError
from lab.core.limits import DEPTH
from lab.formats.programs.program_text import NUMBER, Number

__all__ = ["Value", "arguments", "closing", "numbers_in", "read_value"]

Value: TypeAlias = "Number | str | list[Value]"
_LIST = rf"\[\s*{NUMBER}(?:\s*,\s*{NUMBER})*\s*\]"
_TOKEN = re.compile(rf'\s*(?:(?P<number>{NUMBER})|(?P<word>"[^"]*"|[A-Za-z_]\w*)|(?P<list>{_LIST})|(?P<open>\[))')
_MARK = re.compile(r"\s*([\],])")
_BRACKET = re.compile(r"[\[({\])}]")
_BRACKET_OR_COMMA = re.compile(r"[\[({][^\[({\])}]*[\])}]|[\[({\])},]")  # or a pair with no other in it


def read_value(text: str, start: int) -> tuple[Value, int] | None:
    """Return the value that begins at a character, and its end; None if it contains anything but values.

    Raises:
        LabError: its brackets nest too deeply.
    """
    lists, at = list[list[Value]](), start
    while match := _TOKEN.match(text, at):
        kind, at = match.lastgroup, match.end()
        if kind == "open":
            lists.append([])
            _refuse_deep(len(lists))
            continue
        value: Value
        if kind == "list":
            value = list(_parted(text, match.start("list") + 1, at - 1))
        else:
            value = match["word"] if kind == "word" else Number(match.start("number"), match["number"])
        while lists:
            lists[-1].append(value)
            mark = _MARK.match(text, at)
            if not mark:
                return None
            at = mark.end()
            if mark[1] == ",":
                break
            value = lists.pop()
        else:
            return value, at
    return None


def _parted(text: str, start: int, end: int) -> Iterator[Number]:
    """Yield the numbers between two characters, separated by commas."""
    for part in text[start:end].split(","):
        yield Number(start + len(part) - len(part.lstrip()), part.strip())
        start += len(part) + 1


def numbers_in(value: Value, count: int) -> tuple[Number, ...] | None:
    """Return the numbers of a list of so many numbers; None for anything else."""
    if not isinstance(value, list) or len(value) != count:
        return None
    numbers = tuple(entry for entry in value if isinstance(entry, Number))
    return numbers if len(numbers) == count else None


def arguments(text: str, start: int, end: int) -> list[tuple[int, str]]:
    """Split the text between two characters at top-level commas: the start of each part, and its text."""
    parts, depth, begun = list[tuple[int, str]](), 0, start
    for match in _BRACKET_OR_COMMA.finditer(text, start, end):
        if match[0] in "[({":
            depth += 1
        elif match[0] in "])}":
            depth -= 1
        elif match[0] == "," and not depth:
            parts.append((begun, text[begun : match.start()]))
            begun = match.end()
    parts.append((begun, text[begun:end]))
    return [(at + len(part) - len(part.lstrip()), part.strip()) for at, part in parts]


def closing(text: str, start: int) -> int | None:
    """Return the position of the bracket that closes one open at a character; None if there is none.

    Raises:
        LabError: brackets nest too deeply in it.
    """
    depth = 1
    for match in _BRACKET.finditer(text, start):
        depth += 1 if match[0] in "[({" else -1
        if not depth:
            return match.start()
        _refuse_deep(depth)
    return None


def _refuse_deep(depth: int) -> None:
    if depth > DEPTH.most:
        raise LabError(f"brackets nest deeper than any program's ({DEPTH.shown} levels); mend the text")
