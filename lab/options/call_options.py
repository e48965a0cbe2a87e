"""Make a command's options of the keywords of a call, which takes the same ones."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from difflib import get_close_matches
from functools import lru_cache, wraps
from inspect import Parameter, Signature, signature
from pathlib import Path, PurePath
from typing import Any, TypeVar, cast, get_args, get_origin, get_type_hints

from lab.core.errors import LabError
from lab.core.progress import Listener, listening
from lab.core.threads import one_thread
from lab.extension_points import add, named_parts
from lab.formats.structured import structured
from lab.options.option_texts import options_section

__all__ = ["options_of", "takes"]

_Options = TypeVar("_Options")
_WHOLE = ("effects",)  # groups of options that a call takes as one object; older scripts give their options one by one
_PROGRESS = Parameter("progress", Parameter.KEYWORD_ONLY, default=None, annotation=Listener | None)
_PARTS = Parameter("parts", Parameter.KEYWORD_ONLY, default=(), annotation=Iterable[object])
_Call = TypeVar("_Call", bound=Callable[..., Any])


def options_of(call: str, kind: type[_Options], given: Mapping[str, Any], unused: Collection[str] = ()) -> _Options:
    """Return the options that keywords set; the others are at their defaults.

    Args:
        call: its name in errors.
        unused: options that the call has no use for.

    Raises:
        LabError: there is no such option, one is missing, or a value is not of its type.
    """
    groups, nested = dict(_options(cast(Any, kind))), dict[str, Any]()
    shown = [group if group in _WHOLE else name for name, (group, _, _) in groups.items() if name not in unused]
    _refuse_beside_whole(call, groups, given)
    for name, value in given.items():
        if name in groups:
            group, _, hint = groups[name]
            (nested.setdefault(group, {}) if group else nested)[name] = _plain_value(value, hint)
        elif name in shown:
            nested[name] = _plain(call, name, value) | nested.get(name, {})
        else:
            names = list(dict.fromkeys(shown))
            meant = "".join(f": is {each} meant? There" for each in get_close_matches(name, names, 1))
            raise LabError(f"{call}: '{name}' is no option{meant or '; there'} are {', '.join(names)}")
    return structured(call, kind, nested)


def _refuse_beside_whole(call: str, groups: Mapping[str, tuple[str, Any, Any]], given: Mapping[str, Any]) -> None:
    """Refuse an option that is given beside the object of its group."""
    for whole in (name for name in _WHOLE if given.get(name) is not None):
        if twice := [name for name in given if groups.get(name, ("",))[0] == whole]:
            raise LabError(f"{call}: {twice[0]} is given beside {whole}, which has it too; give it in one of them")


def _plain_value(value: Any, hint: Any) -> Any:
    """Return an option's value as a plain one: numbers and arrays of numpy, paths for texts, one text for several."""
    if callable(to_list := getattr(value, "tolist", None)):  # numpy's numbers and arrays, columns of tables
        return to_list()
    kinds = get_args(hint) or (hint,)
    if isinstance(value, PurePath) and str in kinds:
        return str(value)
    if isinstance(value, str) and get_origin(hint) is tuple and str in kinds:
        return tuple(part.strip() for part in value.split(",") if part.strip())
    return value


def _plain(call: str, name: str, value: Any) -> dict[str, Any]:
    """Return a group of options that was given as one object as a mapping; the empty one of None."""
    if value is None or isinstance(value, Mapping):
        return dict(value or {})
    if not is_dataclass(value) or isinstance(value, type):
        raise LabError(f"{call}: {name} is {value!r}; give {name}=lab.{name.capitalize()}(...)")
    return {each.name: getattr(value, each.name) for each in fields(value)}


def takes(kind: type[Any], unused: Collection[str] = (), **called: str) -> Callable[[_Call], _Call]:
    """Mark a public call whose ``**options`` are a command's: ``help`` and editors show them, with their texts.

    It runs on one BLAS thread: small matrices gain nothing from more, and results stay the same to the last bit. Its
    argument ``progress`` is called with each ``Event`` of the work; what it raises ends the call.
    Options take parts of one's own as objects; ``parts`` are further ones, which options name.

    Args:
        kind: class of the command's options; an object of it may be the only argument.
        unused: options of that class that the call refuses, as it has no use for them.
        called: options that are arguments of the call by another name.
    """

    def mark(function: _Call) -> _Call:
        shown = signature(function)

        @wraps(function)
        def call(*given: Any, parts: Iterable[Any] = (), progress: Listener | None = None, **options: Any) -> Any:
            for part in parts:
                add(part)
            options = {option: _without_parts(option, value) for option, value in options.items()}
            name, named = f"lab.{function.__name__}", dict(zip(shown.parameters, given, strict=False)) | options
            _refuse_no_listener(name, progress)
            _refuse_twice(name, kind, called, named)
            _refuse_unused(name, unused, named)
            with one_thread(), listening(progress):
                return function(*given, **options)

        _document(call, function.__doc__ or "", shown, kind, {*called, *unused})
        return cast(_Call, call)

    return mark


def _document(call: Callable[..., Any], text: str, shown: Signature, kind: type[Any], taken: Collection[str]) -> None:
    """Give a call the signature and the docstring of its function, with an option each of a kind that is not taken."""
    own = [each for each in shown.parameters.values() if each.kind is not Parameter.VAR_KEYWORD]
    taken = {*taken, *(each.name for each in own)}
    more = [*(each for each in _parameters(kind) if each.name not in taken), _PARTS, _PROGRESS]
    call.__signature__ = shown.replace(parameters=[*own, *more])  # type: ignore[attr-defined]
    call.option_class = kind  # type: ignore[attr-defined]
    call.__doc__ = f"{text.rstrip()}\n\n{options_section(kind, more)}\n    "


def _refuse_no_listener(call: str, progress: object) -> None:
    if not (progress is None or callable(progress)):
        raise LabError(f"{call}: progress is {progress!r}; give a function of a lab.Event, or leave it out")


def _parameters(kind: type[Any]) -> Iterator[Parameter]:
    """Yield a call's parameter for each option, and one for each group that it takes as one object."""
    hints = get_type_hints(kind)
    for one in fields(kind):
        if one.name in _WHOLE:
            yield Parameter(one.name, Parameter.KEYWORD_ONLY, default=None, annotation=hints[one.name] | None)
            continue
        inner = _options(hints[one.name]) if is_dataclass(hints[one.name]) else [(one.name, ("", one, hints[one.name]))]
        for name, (_, each, hint) in inner:
            default = Parameter.empty if each.default is MISSING else each.default
            yield Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=hint)


def _without_parts(option: str, value: Any) -> Any:
    """The value of an option, with names in the place of the parts in it."""
    if option == "instrument" and value is not None:
        from lab.noise.instruments import Instrument
        from lab.options.named_instruments import name_of  # what most commands do without

        value = name_of(value) if isinstance(value, Path | Instrument) else value
    return named_parts(option, value)


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


def _refuse_unused(call: str, unused: Collection[str], given: Mapping[str, Any]) -> None:
    if stray := [name for name in given if name in unused]:
        raise LabError(f"{call}: {stray[0]} changes nothing here; leave it out")


@lru_cache(maxsize=64)
def _options(kind: Any) -> tuple[tuple[str, tuple[str, "Field[Any]", Any]], ...]:
    """Return each option by name: its group's name ("" if it is in none), its field and its type."""
    hints, found = get_type_hints(kind), list[tuple[str, tuple[str, "Field[Any]", Any]]]()
    for one in fields(kind):
        if is_dataclass(hints[one.name]):
            found += ((name, (one.name, *each[1:])) for name, each in _options(hints[one.name]))
        else:
            found.append((one.name, ("", one, hints[one.name])))
    return tuple(found)
