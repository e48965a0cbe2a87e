"""Read a number with its unit as a student writes it: ``12 mm``, ``0,2 rad``, ``11.5°``, ``4/3 pi``."""

import re

import numpy as np

from lab.core.errors import LabError
from lab.extensions.reproduction.formulas import evaluated

__all__ = ["quantity"]

_DEGREE = float(np.rad2deg(1.0))
_UNITS = {  # kind of quantity, and size in its first unit
    "mm": ("length", 1.0), "cm": ("length", 10.0), "m": ("length", 1e3), "µm": ("length", 1e-3),
    "μm": ("length", 1e-3), "um": ("length", 1e-3),
    "°": ("angle", 1.0), "deg": ("angle", 1.0), "degree": ("angle", 1.0), "degrees": ("angle", 1.0),
    "rad": ("angle", _DEGREE), "mrad": ("angle", _DEGREE / 1e3), "turns": ("angle", 360.0), "turn": ("angle", 360.0),
    "s": ("time", 1.0), "ms": ("time", 1e-3),
    "kg": ("mass", 1.0), "g": ("mass", 1e-3),
    "°/s": ("speed of an angle", 1.0), "deg/s": ("speed of an angle", 1.0), "rad/s": ("speed of an angle", _DEGREE),
    "°/s²": ("acceleration of an angle", 1.0), "deg/s²": ("acceleration of an angle", 1.0),
    "rad/s²": ("acceleration of an angle", _DEGREE),
    "%": ("share", 1.0),
}  # fmt: skip
_PARTS = re.compile(r"(?P<value>.*?[\d.)πi])\s*(?P<unit>[a-zA-Zµμ°%][a-zA-Z°/%]*(?:\^?[2²])?)?")
_WORDS = frozenset({"pi", "π"})


def quantity(text: str, unit: str) -> float:
    """Return the number in the unit that is asked for.

    Args:
        text: a number, or arithmetic without letters, with or without a unit; a decimal comma is a point.
        unit: of the answer; also that of a number without one.

    Raises:
        LabError: the text is no number, or its unit is of another kind.
    """
    plain = text.strip().replace("−", "-").replace("–", "-")
    found = _PARTS.fullmatch(plain)
    given = ""
    if found is not None and (found["unit"] or "") not in _WORDS:
        plain, given = found["value"], (found["unit"] or "").replace("^", "").replace("s2", "s²")
    value = _number(plain, text)
    if not given or given == unit:
        return value
    if given not in _UNITS:
        raise LabError(f"'{text}': the unit '{given}' is unknown; write {unit or 'a number without a unit'}")
    if unit not in _UNITS:
        raise LabError(f"'{text}' has a unit; the answer is a number without one")
    (kind, size), (wanted, unit_size) = _UNITS[given], _UNITS[unit]
    if kind != wanted:
        raise LabError(f"'{text}' is the unit of another quantity; the answer is in {unit}")
    return value * size / unit_size


def _number(plain: str, text: str) -> float:
    """Return a number, or the value of arithmetic without letters."""
    try:
        value = float(re.sub(r"^(\s*[-+]?\d+),(\d+)\s*$", r"\1.\2", plain))
    except ValueError:
        try:
            value = float(evaluated(plain, {})[0])
        except LabError as error:
            raise LabError(f"'{text}' is not a number: write digits, such as 0, 12.5, √3/2 or 4/3 pi") from error
    if not np.isfinite(value):
        raise LabError(f"'{text}' is not a finite number")
    return value
