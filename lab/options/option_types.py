"""Define types of options: flags, lists in one argument, and numbers with a plain refusal."""

from collections.abc import Callable
from typing import Annotated, Literal, TypeVar, get_args

import tyro

from lab.core.errors import LabError

__all__ = ["PRIOR_MODES", "Flag", "Names", "NoRecording", "Numbers", "PriorMode", "number", "whole_number"]

_Read = TypeVar("_Read", int, float)


def number(text: str) -> float:
    """Read a number.

    Raises:
        LabError: it is none.
    """
    return _read(float, text, "a number")


def whole_number(text: str) -> int:
    """Read a whole number.

    Raises:
        LabError: it is none.
    """
    return _read(int, text, "a whole number")


def _read(kind: Callable[[str], _Read], text: str, what: str) -> _Read:
    try:
        return kind(text)
    except ValueError as error:
        raise LabError(f"'{text}' is not {what}") from error


Names = Annotated[
    tuple[str, ...],
    tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="A,B,…",
        instance_from_str=lambda given: tuple(name.strip() for name in given[0].split(",") if name.strip()),
        is_instance=lambda instance: isinstance(instance, tuple) and all(isinstance(name, str) for name in instance),
        str_from_instance=lambda names: [",".join(names)],
    ),
]
Numbers = Annotated[
    tuple[float, ...],
    tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="X,Y,…",
        instance_from_str=lambda given: tuple(number(each) for each in given[0].split(",")),
        is_instance=lambda instance: isinstance(instance, tuple) and all(isinstance(x, float) for x in instance),
        str_from_instance=lambda numbers: [",".join(f"{each:g}" for each in numbers)],
    ),
]
Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]
NoRecording = Annotated[
    Flag, tyro.conf.arg(help="Write no recording.rrd, which takes most of the disk space of a run.")
]
PriorMode = Literal["auto", "on", "off"]
PRIOR_MODES: tuple[str, ...] = get_args(PriorMode)
