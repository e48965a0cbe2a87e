"""Evaluate formulas as the sources print them, at sampled values of their letters.

Examples are ``c1 c4 s5 − s1 c5``, ``atan2(y, x)``, ``(L2 + T2) c1``. c and s with the numbers of joints are the cosine
and sine of the sum of these joints' positions: c1 of q1, s23 of q2 + q3. Factors stand side by side, ``^`` is a power
and ``√`` a root. A letter of the formula comes before a joint: c2 may be a length.
"""

import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array

__all__ = ["Variables", "evaluated"]

Variables = Mapping[str, Array]
"""The variables of a formula by their names: sampled values ``(n,)``."""
_FUNCTIONS: Mapping[str, Callable[..., Array]] = {  # of as many arguments as they have in a source
    "atan2": lambda y, x: np.arctan2(y, x), "atan": lambda x: np.arctan(x), "acos": lambda x: np.arccos(x),
    "cos": lambda x: np.cos(x), "sin": lambda x: np.sin(x), "tan": lambda x: np.tan(x), "abs": lambda x: np.abs(x),
    "√": lambda x: np.sqrt(x),
}  # fmt: skip
_SIGNS = {"−": "-", "·": "*", "^": "**"}
_TOKEN = re.compile(r"\s*(?P<number>\d+(?:\.\d+)?)|\s*(?P<word>[^\W\d]\w*|√)|\s*(?P<sign>[-−+·/^(),])")
_TURN = re.compile(r"([cs])(\d+)")


def evaluated(text: str, variables: Variables) -> Array:
    """Evaluate a formula at sampled values of its variables, ``(n,)``.

    Raises:
        LabError: the text is no formula of these variables.
    """
    names: dict[str, Any] = {}
    code, at, after_factor = [], 0, False
    while found := _TOKEN.match(text, at):
        at, token = found.end(), found[found.lastgroup or 0]
        if after_factor and token not in "-−+·/^),":
            code.append("*")  # factors stand side by side
        if found["word"]:
            token, value = f"_{len(names)}", _value(text, token, variables)
            names[token] = value
            after_factor = not callable(value)
        else:
            after_factor = token not in "-−+·/^(,"
        code.append(_SIGNS.get(token, token))
    try:
        if text[at:].strip():
            raise SyntaxError
        with np.errstate(all="ignore"):  # a root or a quotient may have no value at some positions
            value = eval(" ".join(code), {"__builtins__": {}}, names)
    except (SyntaxError, TypeError) as error:
        raise LabError(f"formula '{text}': cannot be read from '{text[at:]}' on") from error
    return np.asarray(value + np.zeros_like(next(iter(variables.values()), np.zeros(1))), dtype=np.float64)


def _value(text: str, word: str, variables: Variables) -> Any:
    """Return a letter's values, a function, or the sine or cosine of a sum of joints."""
    known: dict[str, Any] = {"π": np.pi, **_FUNCTIONS, **variables}
    if word in known:
        return known[word]
    turn = _TURN.fullmatch(word)
    if turn is None or not all(f"q{digit}" in variables for digit in turn[2]):
        raise LabError(f"formula '{text}': '{word}' is none of its letters, {', '.join(variables)}")
    return (np.cos if turn[1] == "c" else np.sin)(sum(variables[f"q{digit}"] for digit in turn[2]))
