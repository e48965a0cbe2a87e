"""Base class of dataclasses that compare arrays by content, and print in one line."""

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import partial
from html import escape
from types import BuiltinFunctionType, FunctionType, MethodType
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from lab.core.extras import optional

__all__ = ["ArrowTable", "Deferred", "DeferredField", "Value", "arrow_columns", "arrow_stream", "data_frame", "same"]


class Value:
    """Base of frozen dataclasses (``eq=False, repr=False``) that hold arrays.

    Two are equal if they have the same class and equal fields: arrays with equal shapes, types and entries, NaN equal
    to NaN. The representation is one line, ``<Class: about>``; a notebook shows a small table.
    """

    def _about(self) -> str:
        """Return the text of the representation beside the class."""
        return ""

    def _facts(self) -> Mapping[str, str]:
        """Return the table for a notebook."""
        return {type(self).__name__: self._about()}

    def __repr__(self) -> str:
        about = self._about()
        return f"<{type(self).__name__}{': ' if about else ''}{about}>"

    def _repr_html_(self) -> str:
        cells = (f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in self._facts().items())
        return f"<table>{''.join(cells)}</table>"

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if type(self) is not type(other):
            return NotImplemented
        return _same_fields(self, other)

    def __hash__(self) -> int:
        return hash(type(self))  # equal objects must have equal hashes, and arrays have none


_T = TypeVar("_T")


@dataclass(frozen=True)
class Deferred(Generic[_T]):
    """A value of a ``DeferredField`` that is made when it is first read."""

    make: Callable[[], _T]


class DeferredField(Generic[_T]):
    """A field of a frozen dataclass that takes a value or a ``Deferred`` one, and reads as the value."""

    def __init__(self, *default: _T) -> None:
        """Take the field's default, if it has one."""
        self._default, self._name = default, ""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, instance: Any, owner: type) -> _T:
        if instance is None:
            if not self._default:
                raise AttributeError(self._name)
            return self._default[0]
        value = instance.__dict__[self._name]
        if isinstance(value, Deferred):
            value = instance.__dict__[self._name] = value.make()
        read: _T = value
        return read

    def __set__(self, instance: Any, value: _T | Deferred[_T]) -> None:
        instance.__dict__[self._name] = value


def same(first: Any, second: Any) -> bool:
    """Compare two nested objects of dataclasses, mappings, sequences, arrays and numbers; NaN equals NaN."""
    if first is second:
        return True
    if type(first) is not type(second):
        return False
    for kind, alike in _COMPARED:
        if isinstance(first, kind):
            return bool(alike(first, second))
    if is_dataclass(first):
        return _same_fields(first, second)
    own: Any = type(first).__eq__
    if own is object.__eq__:
        return same(first.__reduce_ex__(4)[1:], second.__reduce_ex__(4)[1:])  # their state when pickled
    return bool(first == second)


def _same_partials(first: partial[Any], second: partial[Any]) -> bool:
    return same((first.func, first.args, first.keywords), (second.func, second.args, second.keywords))


def _same_methods(first: MethodType, second: MethodType) -> bool:
    return first.__func__ is second.__func__ and same(first.__self__, second.__self__)


def _same_mappings(first: Mapping[Any, Any], second: Mapping[Any, Any]) -> bool:
    return first.keys() == second.keys() and all(same(value, second[key]) for key, value in first.items())


def _same_sequences(first: Sequence[Any], second: Sequence[Any]) -> bool:
    return len(first) == len(second) and all(map(same, first, second))


def _same_floats(first: float, second: float) -> bool:
    return first == second or (first != first and second != second)


def data_frame(columns: Mapping[str, Any]) -> Any:
    """Return a ``pandas.DataFrame``; raise a LabError if pandas is not installed."""
    return optional("pandas", "to_frame").DataFrame(dict(columns))


def arrow_stream(columns: Mapping[str, Any], requested_schema: object = None) -> object:
    """Return columns as a stream of the Arrow C interface, for ``__arrow_c_stream__``."""
    import pyarrow

    return pyarrow.table(dict(columns)).__arrow_c_stream__(requested_schema)


@runtime_checkable
class ArrowTable(Protocol):
    """A table with the Arrow C interface: of pandas, polars, pyarrow, DuckDB or the lab."""

    def __arrow_c_stream__(self, requested_schema: object = None) -> object: ...


def arrow_columns(table: ArrowTable) -> dict[str, NDArray[Any]]:
    """Return the columns of a table; empty cells of numbers are NaN, those of texts None."""
    import pyarrow

    read = pyarrow.table(table)
    return {name: read[name].to_numpy() for name in read.column_names}


def _same_arrays(first: np.ndarray[Any, Any], second: np.ndarray[Any, Any]) -> bool:
    if first.dtype != second.dtype or first.shape != second.shape:
        return False
    if first.dtype == object:
        return all(map(same, first.ravel().tolist(), second.ravel().tolist()))
    return bool(np.array_equal(first, second, equal_nan=first.dtype.kind in "fc"))


def _same_fields(first: Any, second: Any) -> bool:
    names = (each.name for each in fields(first) if each.compare)
    return all(same(getattr(first, name), getattr(second, name)) for name in names)


_COMPARED: tuple[tuple[Any, Callable[[Any, Any], bool]], ...] = (
    (partial, _same_partials),
    (MethodType, _same_methods),
    (FunctionType | BuiltinFunctionType | type, operator.eq),
    (np.ndarray, _same_arrays),
    (Mapping, _same_mappings),
    (list | tuple, _same_sequences),
    (float, _same_floats),
)
