"""Keywords of a public call: the names of a command's options, those of its groups beside the others."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import wraps
from inspect import Parameter, signature
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
            raise LabError(f"{call}: '{name}' is no option; there are {', '.join(groups)}")
        group = groups[name][0]
        (nested.setdefault(group, {}) if group else nested)[name] = value
    return structured(call, kind, nested)


def takes(kind: type[Any]) -> Callable[[Call], Call]:
    """A public call whose ``**options`` are a command's: ``help`` and editors show them as its keywords.

    It runs on one BLAS thread: for small matrices more threads wait for each other, and the bits stay the same.
    """

    def mark(function: Call) -> Call:
        @wraps(function)
        def call(*given: Any, **options: Any) -> Any:
            with threadpool_limits(1):
                return function(*given, **options)

        shown = signature(function)
        own = [each for each in shown.parameters.values() if each.kind is not Parameter.VAR_KEYWORD]
        taken = {each.name for each in own}
        more = [
            Parameter(name, Parameter.KEYWORD_ONLY, default=_default(field), annotation=hint)
            for name, (_, field, hint) in _options(kind)
            if name not in taken
        ]
        call.__signature__ = shown.replace(parameters=[*own, *more])  # type: ignore[attr-defined]
        return cast(Call, call)

    return mark


def _options(kind: Any) -> Iterator[tuple[str, tuple[str, "Field[Any]", Any]]]:
    """Each option by its name: the group's name, "" where it is in none, its field and its type."""
    hints = get_type_hints(kind)
    for field in fields(kind):
        if is_dataclass(hints[field.name]):
            yield from ((name, (field.name, *each[1:])) for name, each in _options(hints[field.name]))
        else:
            yield field.name, ("", field, hints[field.name])


def _default(field: "Field[Any]") -> Any:
    return Parameter.empty if field.default is MISSING else field.default
