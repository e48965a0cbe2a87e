"""Build a document so that a part that cannot be made is left out, with a warning, and the others stay."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from types import FunctionType, UnionType
from typing import Any, get_args, get_origin

from lab.core.gaps import attempted
from lab.render.document import Block, Document, Paragraph, Picture, Warnings

__all__ = ["block_of", "document_of"]

_NO_TEXT = "–"


def document_of(make: Callable[..., Document], *given: Any) -> Document:
    """Return the document that a function makes of a result, with warnings of what is left out at its top.

    Where a function that it calls by name fails, it is run again with nothing in that one's place. What fails in the
    function itself is raised.
    """
    instead = dict[str, Callable[..., Any]]()
    warnings, first = list[str](), None
    while True:
        try:
            made = _replacing(make, instead)(*given) if instead else make(*given)
            return replace(made, blocks=(Warnings(tuple(warnings)), *made.blocks)) if warnings else made
        except Exception as error:
            name, called = _called(make, error)
            first = first or error
            if called is None or name in instead:
                raise first from None
            kind = called.__annotations__.get("return")
            if kind is Document:
                instead[name] = partial(document_of, called)
                continue
            nothing = _nothing(kind, error)
            what = f"the part '{name.strip('_').replace('_', ' ')}'"
            attempted(what, partial(_fail, error), warnings.append)
            instead[name] = partial(_always, nothing)


def block_of(what: str, make: Callable[[], Any]) -> Block:
    """Return the block that a function makes; a warning if it fails, or makes something else."""

    def made() -> Block:
        block = make()
        if not isinstance(block, Block):
            raise TypeError(f"it is a {type(block).__name__}, not a Section")
        return block

    return attempted(what, made, lambda missing: Warnings((missing,)))


def _fail(error: Exception, *_: Any) -> Any:
    raise error


def _always(value: Any, *_: Any, **__: Any) -> Any:
    return value


def _nothing(kind: Any, error: Exception) -> Any:
    """Return what a function of this type returns that has nothing to show; raise the error where there is none."""
    origin, parts = get_origin(kind) or kind, get_args(kind)
    if kind is str or (origin is UnionType and str in parts):
        return _NO_TEXT
    if origin is Picture:
        return Picture("left-out", "left out", partial(_fail, error), partial(_fail, error))
    if isinstance(origin, type) and issubclass(origin, Block):
        return Paragraph("")
    if origin is tuple and parts[-1:] == (...,):
        return ()
    if origin in (list, dict):
        return origin()
    raise error


def _replacing(make: Callable[..., Document], others: dict[str, Callable[..., Any]]) -> Callable[..., Document]:
    """Return a copy of a function that calls others in place of those of its module."""
    assert isinstance(make, FunctionType)
    return FunctionType(make.__code__, make.__globals__ | others, make.__name__, make.__defaults__, make.__closure__)


def _called(make: Callable[..., Document], error: Exception) -> tuple[str, FunctionType | None]:
    """Return the first function that was called below ``make`` when an error was raised, and its name there."""
    codes, trace = [], error.__traceback__
    while trace is not None:
        codes.append(trace.tb_frame.f_code)
        trace = trace.tb_next
    if isinstance(make, FunctionType) and make.__code__ in codes:
        known = {each.__code__: (name, each) for name, each in make.__globals__.items() if type(each) is FunctionType}
        below = codes[codes.index(make.__code__) + 1 :]
        return next((known[code] for code in below if code in known), ("", None))
    return "", None
