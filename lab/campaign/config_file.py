"""The options of an earlier run, from its ``config.json``."""

import json
import types
import typing
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

from lab.core.errors import LabError

Options = TypeVar("Options")


def read_options(path: Path, command: str, kind: type[Options]) -> Options:
    """The options that a run of ``command`` was given; those that the file leaves out are as usual.

    Raises:
        LabError: the file cannot be read, is of another command, or holds what is no option.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise LabError(f"{path}: cannot be read ({error.strerror}); give a run's config.json") from error
    except ValueError as error:
        raise LabError(f"{path}: not JSON ({error}); give a run's config.json") from error
    if not isinstance(content, dict) or not isinstance(content.get("options"), dict):
        raise LabError(f"{path}: has no options; give a run's config.json")
    if content.get("command", command) != command:
        raise LabError(f"{path}: is of lab {content['command']}, not of lab {command}; run that")
    made: Options = options_from(path, kind, content["options"])
    return made


def options_from(path: object, kind: Any, values: dict[str, Any]) -> Any:
    """A dataclass of options from plain values.

    Args:
        path: where they are from, as an error says it.

    Raises:
        LabError: one is unknown, missing, or of another type.
    """
    hints, known = typing.get_type_hints(kind), [field.name for field in fields(kind)]
    if unknown := [name for name in values if name not in known]:
        raise LabError(f"{path}: '{unknown[0]}' is no option; there are {', '.join(known)}")
    given = {name: _value(path, name, hints[name], value) for name, value in values.items()}
    try:
        return kind(**given)
    except TypeError as error:
        raise LabError(f"{path}: an option is missing ({error}); give a whole config.json") from error


def _value(path: object, name: str, hint: Any, value: Any) -> Any:
    """One value as its option's type has it."""
    if is_dataclass(hint):
        if not isinstance(value, dict):
            raise LabError(f"{path}: '{name}' is to hold options of its own")
        return options_from(path, hint, value)
    kinds = (
        typing.get_args(hint) if isinstance(hint, types.UnionType) or typing.get_origin(hint) is typing.Union else ()
    )
    kinds = kinds or (hint,)
    if value is None and type(None) in kinds:
        return None
    for kind in kinds:
        origin = typing.get_origin(kind) or kind
        if kind is Path and isinstance(value, str):
            return Path(value)
        if origin is tuple and isinstance(value, list):
            part = typing.get_args(kind)[0]
            plain = (int, float) if part is float else part
            if all(isinstance(each, plain) and not isinstance(each, bool) for each in value):
                return tuple(part(each) for each in value)
        if origin is typing.Literal and value in typing.get_args(kind):
            return value
        if kind is bool and isinstance(value, bool):
            return value
        if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
            return float(value)
        if kind in (int, str) and isinstance(value, kind) and not isinstance(value, bool):
            return value
    raise LabError(f"{path}: {value!r} is no value of option '{name}'; mend it")
