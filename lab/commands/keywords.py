"""Keywords of a public call: the names of a command's options, those of its groups beside the others."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from difflib import get_close_matches
from functools import wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import Any, TypeVar, cast, get_type_hints

from threadpoolctl import threadpool_limits

from lab.core.errors import LabError
from lab.formats.structured import structured

__all__ = ["options_of", "takes"]

Options = TypeVar("Options")
Call = TypeVar("Call", bound=Callable[..., Any])


def options_of(call: str, kind: type[Options], given: Mapping[str, Any]) -> Options:
    """The options that keywords say; the others are at their defaults.

    Args:
        call: what an error calls it.

    Raises:
        LabError: there is no such option, one is missing, or a value is not of its type.
    """
    groups, nested = dict(_options(kind)), dict[str, Any]()
    for name, value in given.items():
        if name not in groups:
            meant = "".join(f": is {each} meant? There" for each in get_close_matches(name, groups, 1))
            raise LabError(f"{call}: '{name}' is no option{meant or '; there'} are {', '.join(groups)}")
        group = groups[name][0]
        if name == "instrument" and value is not None:
            value = _name_of_instrument(value)
        (nested.setdefault(group, {}) if group else nested)[name] = value
    return structured(call, kind, nested)


def takes(kind: type[Any], **called: str) -> Callable[[Call], Call]:
    """A public call whose ``**options`` are a command's: ``help`` and editors show them as its keywords.

    It runs on one BLAS thread: for small matrices more threads wait for each other, and the bits stay the same.

    Args:
        kind: of the command's options, which may also be given in one object, as the first argument and alone.
        called: options that are arguments of the call by another name: of each its argument's name.
    """

    def mark(function: Call) -> Call:
        shown = signature(function)

        @wraps(function)
        def call(*given: Any, **options: Any) -> Any:
            named = dict(zip(shown.parameters, given, strict=False)) | options
            _refuse_twice(f"lab.{function.__name__}", kind, called, named)
            with threadpool_limits(1):
                return function(*given, **options)

        own = [each for each in shown.parameters.values() if each.kind is not Parameter.VAR_KEYWORD]
        taken = {*called, *(each.name for each in own)}
        more = [
            Parameter(name, Parameter.KEYWORD_ONLY, default=_default(field), annotation=hint)
            for name, (_, field, hint) in _options(kind)
            if name not in taken
        ]
        call.__signature__ = shown.replace(parameters=[*own, *more])  # type: ignore[attr-defined]
        return cast(Call, call)

    return mark


def _name_of_instrument(given: Any) -> Any:
    """The name of an instrument given as an object or a path; anything else as it is."""
    from lab.campaign.instruments import name_of  # what most commands do without
    from lab.noise.instruments import Instrument

    return name_of(given) if isinstance(given, Path | Instrument) else given


def _refuse_twice(call: str, kind: type[Any], called: Mapping[str, str], given: Mapping[str, Any]) -> None:
    """Refuse what the call would pass over: an argument by another name, or one beside all options in one object."""
    if wrong := [name for name in given if name in called]:
        right = called[wrong[0]]
        twice = (
            f"{wrong[0]} and {right} are the same, given twice" if right in given else f"{wrong[0]} is no option here"
        )
        raise LabError(f"{call}: {twice}; give {right} alone")
    beside = [name for name, value in given.items() if not isinstance(value, kind)]
    if beside and len(beside) < len(given):
        raise LabError(f"{call}: {beside[0]} is given beside a {kind.__name__}, which holds all options; set it there")


def _options(kind: Any) -> Iterator[tuple[str, tuple[str, "Field[Any]", Any]]]:
    """Each option by its name: the group's name, "" where it is in none, its field and its type."""
    hints = get_type_hints(kind)
    for one in fields(kind):
        if is_dataclass(hints[one.name]):
            yield from ((name, (one.name, *each[1:])) for name, each in _options(hints[one.name]))
        else:
            yield one.name, ("", one, hints[one.name])


def _default(field: "Field[Any]") -> Any:
    return Parameter.empty if field.default is MISSING else field.default
