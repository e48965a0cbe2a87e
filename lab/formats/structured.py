"""Read text, TOML and JSON files into typed objects, with errors that name file, line and key.

A value must be of its field's type: text is no number, a number no text, and a truth value neither; a whole number is a
number. cattrs walks the types and locates values; the messages are made here.
"""

import json
import os
import re
import stat
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, Union, cast, get_args, get_origin

from lab.core.errors import LabError
from lab.core.limits import DEPTH, NUMBER_SIZE, SEED, TEXT_BYTES, TOML_BYTES, VALUES, Limit
from lab.core.whole_folder import CHECKSUMS

if TYPE_CHECKING:
    from cattrs import Converter

__all__ = [
    "is_number",
    "read_bytes",
    "read_checksums",
    "read_json",
    "read_structured",
    "read_text",
    "read_toml",
    "refuse_unbounded",
    "structured",
    "unstructured",
]

_MARK = b"\xef\xbb\xbf"  # byte order mark of UTF-8


def read_bytes(path: Path, most: Limit, mend: str = "check the path") -> bytes:
    """Return the content of a regular file.

    Args:
        most: its largest size.
        mend: advice for the end of the message.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            kind = "a directory" if stat.S_ISDIR(status.st_mode) else "no regular file"
            raise LabError(f"{path}: cannot be read (it is {kind}); {mend}")
        most(path, status.st_size)
        with open(path, "rb", opener=_without_waiting) as file:
            content = file.read(most.most + 1) or b""
    except OSError as error:
        raise LabError(f"{path}: cannot be read ({error.strerror}); {mend}") from error
    except ValueError as error:
        if isinstance(error, LabError):
            raise
        raise LabError(f"{str(path)!r}: is not a path ({error}); {mend}") from error
    most(path, content)
    return content


def _without_waiting(path: str, flags: int) -> int:
    """Open a file without blocking: some system files claim to be regular and never end."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def read_text(path: Path, most: Limit, mend: str = "check the path") -> str:
    """Return the text of a file in UTF-8, without a byte order mark.

    Args:
        most: its largest size.
        mend: advice for the end of the message.
    """
    content = read_bytes(path, most, mend).removeprefix(_MARK)
    try:
        text, wrong = content.decode("utf-8"), content.find(b"\0")
    except UnicodeDecodeError as error:
        text, wrong = "", error.start
    if wrong >= 0:
        raise LabError(f"{path}: not a text file in UTF-8 (byte {wrong}); save it as UTF-8")
    return text


def read_checksums(folder: Path) -> str:
    """Return the lines of a folder's ``SHA256SUMS``; names of files may have bytes that are no text."""
    return read_bytes(folder / CHECKSUMS, TEXT_BYTES).decode("utf-8", "surrogateescape")


def refuse_unbounded(where: object, content: Any, *, finite: bool = True) -> None:
    """Refuse values of TOML or JSON that are nested too deeply, too many, not finite or too large.

    Args:
        finite: refuse numbers that are not finite, unless their reader does.
    """
    waiting, count = [("", content, 0)], 0
    while waiting:
        name, value, depth = waiting.pop()
        count += 1
        if isinstance(value, Mapping | list):
            DEPTH(f"{where}: {name}" if name else where, depth)
            named = value.items() if isinstance(value, Mapping) else ((name, each) for each in value)
            waiting.extend((str(key), each, depth + 1) for key, each in named)
            VALUES(where, count + len(waiting))
        elif finite and isinstance(value, float) and not isfinite(value):
            raise LabError(f"{where}: {name} is {value}; give a finite number")
        elif isinstance(value, int) and abs(value) > SEED.most:
            raise LabError(f"{where}: {name} has more than 63 bits; give a smaller integer")


_Kind = TypeVar("_Kind")
_PLAIN = {int: "a whole number", float: "a number", str: "a text", bool: "true or false", Path: "a path as text"}


class _InvalidError(ValueError):
    """A value that its type does not allow, and what it allows."""

    def __init__(self, value: object, valid: str) -> None:
        super().__init__(f"{value!r}: give {valid}")
        self.value, self.valid = value, valid


def structured(where: object, kind: type[_Kind], values: object, *, extra: bool = False) -> _Kind:
    """Return a dataclass from plain values.

    Args:
        where: source of the values in messages, or "".
        values: a mapping from the fields' names.
        extra: the lab wrote the file: unknown names are ignored, numbers are bounded, and errors name the place in a
            list.
    """
    from cattrs import BaseValidationError

    try:
        return _converter(extra).structure(values, kind)
    except BaseValidationError as error:
        message = _first(error, ())
    except _InvalidError as error:
        message = f"{error.value!r} is to be {error.valid}"
    raise LabError(f"{where}: {message}" if where else message)


def unstructured(value: object) -> Any:
    """Return a dataclass as plain values, for ``structured``."""
    return _converter(True).unstructure(value)


def read_json(path: Path, mend: str) -> Any:
    """Return the content of a JSON file; ``mend`` is advice for the end of messages."""
    text = read_text(path, TEXT_BYTES, mend)
    try:
        content = json.loads(text)
    except RecursionError as error:
        raise LabError(f"{path}: more than {DEPTH.most} {DEPTH.what}; {mend}") from error
    except ValueError as error:
        raise LabError(f"{path}: not JSON ({error}); {mend}") from error
    refuse_unbounded(path, content)
    return content


def read_structured(path: Path, kind: type[_Kind], mend: str) -> _Kind:
    """Return a typed object from a JSON file of the lab; other keys are ignored.

    Args:
        kind: a dataclass, or a tuple of one.
        mend: advice for the end of messages.
    """
    content = read_json(path, mend)
    try:
        return structured("", kind, content, extra=True)
    except LabError as error:
        raise LabError(f"{path}: is not in the lab's format: {error}; {mend}") from error


@cache
def _converter(extra: bool) -> "Converter":
    from cattrs import Converter

    converter = Converter(forbid_extra_keys=not extra)
    for plain in _PLAIN:
        converter.register_structure_hook(plain, _bounded if extra and plain is float else _plain)
    converter.register_structure_hook_func(lambda kind: bool(_allowed(kind)), _choice)
    converter.register_structure_hook_factory(_is_tuple, _tuple_hook)
    converter.register_structure_hook_factory(_is_mapping, _mapping_hook)
    converter.register_structure_hook_factory(is_dataclass, _dataclass_hook)
    return converter


def _plain(value: object, kind: type) -> Any:
    accepted = {float: (int, float), Path: (str, Path)}.get(kind, (kind,))
    if not isinstance(value, accepted) or (isinstance(value, bool) and kind is not bool):
        raise _InvalidError(value, _PLAIN[kind])
    return kind(value)


def _bounded(value: object, kind: type) -> float:
    """Return a number whose square does not overflow."""
    number: float = _plain(value, kind)
    if abs(number) not in NUMBER_SIZE:
        raise _InvalidError(value, f"a number of at most {NUMBER_SIZE.most:g}")
    return number


def _allowed(kind: Any) -> tuple[object, ...]:
    """Return the values of a literal type, or of one that may be None; empty for any other type."""
    parts = get_args(kind) if get_origin(kind) is Union else (kind,)
    literals = [part for part in parts if get_origin(part) is Literal]
    return tuple(value for part in literals for value in get_args(part))


def _choice(value: object, kind: Any) -> object:
    if value is None and type(None) in get_args(kind):
        return None
    allowed = _allowed(kind)
    if isinstance(value, bool) and {"on", "off"} <= set(allowed):  # an option that was a flag in an older version
        return "on" if value else "off"
    if not isinstance(value, str) or value not in allowed:
        raise _InvalidError(value, f"one of {', '.join(map(str, allowed))}")
    return value


def _is_tuple(kind: Any) -> bool:
    return get_origin(kind) is tuple


def _is_mapping(kind: Any) -> bool:
    return get_origin(kind) is Mapping


def _tuple_hook(kind: Any, converter: "Converter") -> Any:
    from cattrs import AttributeValidationNote, BaseValidationError

    part = get_args(kind)[0]

    def hook(value: object, _: Any) -> tuple[Any, ...]:
        valid = f"a list, each {_PLAIN.get(part, 'of its type')}"
        if not isinstance(value, Sequence) or isinstance(value, str):
            raise _InvalidError(value, valid)
        parts = list[Any]()
        for i, each in enumerate(value):
            try:
                parts.append(converter.structure(each, part))
            except _InvalidError as error:
                raise _InvalidError(value, valid) from error
            except BaseValidationError as error:
                if not converter.forbid_extra_keys:
                    error.add_note(AttributeValidationNote(f"in {i}", str(i), part))
                raise
        return tuple(parts)

    return hook


def _mapping_hook(kind: Any, converter: "Converter") -> Any:
    from cattrs import AttributeValidationNote, BaseValidationError

    part = get_args(kind)[1]

    def hook(value: object, _: Any) -> dict[str, Any]:
        if not isinstance(value, Mapping):
            raise _InvalidError(value, "a group of named values")
        parts = {}
        for name, each in value.items():
            try:
                parts[name] = converter.structure(each, part)
            except (BaseValidationError, ValueError) as error:
                error.add_note(AttributeValidationNote(f"in {name}", name, part))
                raise
        return parts

    return hook


def _dataclass_hook(kind: Any, converter: "Converter") -> Any:
    from cattrs.gen import make_dict_structure_fn

    structure = make_dict_structure_fn(
        kind, converter, _cattrs_forbid_extra_keys=converter.forbid_extra_keys, _cattrs_detailed_validation=True
    )

    def hook(value: object, _: Any) -> Any:
        if isinstance(value, kind):
            return value
        if not isinstance(value, Mapping):
            names = ", ".join(field.name for field in fields(kind))
            raise _InvalidError(value, f"a group of options: any of {names}")
        return structure(value, kind)

    return hook


def _first(error: BaseException, path: tuple[str, ...]) -> str:
    """Describe the first invalid value, and its place among nested groups."""
    from cattrs import AttributeValidationNote, BaseValidationError, ForbiddenExtraKeysError

    notes = [note for note in getattr(error, "__notes__", ()) if isinstance(note, AttributeValidationNote)]
    path = (*path, *(note.name for note in reversed(notes)))
    name = ".".join(path)
    if isinstance(error, ForbiddenExtraKeysError):
        known = ", ".join(field.name for field in fields(cast(Any, error.cl)))
        return f"{f'{name}: ' if name else ''}'{min(error.extra_fields)}' is no option; there are {known}"
    if isinstance(error, BaseValidationError):
        unknown = [each for each in error.exceptions if isinstance(each, ForbiddenExtraKeysError)]
        return _first((unknown or error.exceptions)[0], path)
    if isinstance(error, _InvalidError):
        return f"{error.value!r} is not a value of option '{name}'; give {error.valid}"
    if isinstance(error, KeyError):
        return f"'{name}' is missing"
    return str(error)  # a dataclass's own refusal


_PART = r"""(?:(?<![\w-])[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_DEEP = re.compile(rf"(?:{_PART}[ \t]*+\.[ \t]*+){{{DEPTH.most}}}")  # dotted names: the parser's memory is their square


def read_toml(path: Path) -> dict[str, Any]:
    """Return the content of a TOML file."""
    text = read_text(path, TOML_BYTES)
    if deep := _DEEP.search(text):
        line = text.count("\n", 0, deep.start()) + 1
        raise LabError(f"{path}: line {line}: a name of more than {DEPTH.most} {DEPTH.what}; give it fewer")
    try:
        content = tomllib.loads(text)
    except RecursionError as error:
        raise LabError(f"{path}: more than {DEPTH.most} {DEPTH.what}; give it fewer") from error
    except ValueError as error:  # TOMLDecodeError, and Python's own of a number of too many digits
        raise LabError(f"{path}: not a TOML file: {' '.join(str(error).split())}; fix it there") from error
    if not content:
        raise LabError(f"{path}: is empty; write its sections, or leave it out")
    refuse_unbounded(path, content, finite=False)
    return content


def is_number(value: Any) -> bool:
    """Check for a number of a robot's description."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) in NUMBER_SIZE
