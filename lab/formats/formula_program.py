"""Write formulas as a program: a function in Python, C or Matlab, from arrays of numbers to an array of numbers.

Formulas are texts that all three languages read alike: names, decimal numbers, ``+ - * / ( )``, and the functions sin,
cos, sqrt, atan2 and sign. A text without a decimal point would be a whole number in C, so that 1/2 is to be 0.5.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

__all__ = ["FILE_ENDS", "FormulaProgram", "ProgramLanguage", "function_name", "programs_text"]

ProgramLanguage = Literal["python", "c", "matlab"]
FILE_ENDS: Mapping[ProgramLanguage, str] = {"python": "py", "c": "c", "matlab": "m"}
_COMMENT: Mapping[ProgramLanguage, str] = {"python": "#", "c": "//", "matlab": "%"}
_HEAD: Mapping[ProgramLanguage, tuple[str, ...]] = {
    "python": (
        "from math import atan2, cos, sin, sqrt",
        "",
        "",
        "def sign(x):",
        "    return float(x > 0.0) - float(x < 0.0)",
    ),
    "c": ("#include <math.h>", "", "static double sign(double x) { return (x > 0.0) - (x < 0.0); }"),
    "matlab": (),
}


@dataclass(frozen=True)
class FormulaProgram:
    """A function as a list of assignments.

    Attributes:
        name: of the function.
        comment: a line on its arguments, its units and its answer.
        arguments: the arrays given to it, each with the names of its elements.
        steps: names and formulas, each of arguments and of names before it.
        outputs: formulas of the answer's elements.
    """

    name: str
    comment: str
    arguments: Mapping[str, Sequence[str]]
    steps: Sequence[tuple[str, str]]
    outputs: Sequence[str]

    def lines(self, language: ProgramLanguage) -> list[str]:
        """Return the lines of the function."""
        matlab, end = language == "matlab", "" if language == "python" else ";"
        declared = "double " if language == "c" else ""
        first, (left, right) = int(matlab), "()" if matlab else "[]"
        taken = [
            (name, f"{array}{left}{i + first}{right}")
            for array, names in self.arguments.items()
            for i, name in enumerate(names)
        ]
        body = [f"{declared}{name} = {formula}{end}" for name, formula in (*taken, *self.steps)]
        arrays = list(self.arguments)
        about = f"{_COMMENT[language]} {self.comment}"
        if language == "python":
            body.append(f"return [{', '.join(self.outputs)}]")
            return [about, f"def {self.name}({', '.join(arrays)}):", *(f"    {line}" for line in body)]
        if language == "c":
            body += [f"out[{i}] = {formula};" for i, formula in enumerate(self.outputs)]
            parameters = ", ".join((*(f"const double *{array}" for array in arrays), "double *out"))
            return [about, f"void {self.name}({parameters})", "{", *(f"    {line}" for line in body), "}"]
        body.append(f"out = [{', '.join(self.outputs)}];")
        return [about, f"function out = {self.name}({', '.join(arrays)})", *(f"    {line}" for line in body), "end"]


def programs_text(programs: Sequence[FormulaProgram], language: ProgramLanguage) -> str:
    """Return the text of a file with some functions.

    Raises:
        ValueError: there is no such language.
    """
    if language not in get_args(ProgramLanguage):
        raise ValueError(f"language {language!r}: there are {', '.join(get_args(ProgramLanguage))}")
    blank = ["", ""] if language == "python" else [""]
    lines = list(_HEAD[language])
    for program in programs:
        lines += [*(blank if lines else []), *program.lines(language)]
    return "\n".join(lines) + "\n"


def function_name(text: str) -> str:
    """Return a text as the beginning of a function's name: letters and digits of ASCII, and underscores.

    Example:
        >>> function_name("RX 130")
        'rx_130'
    """
    name = "".join(c if c.isascii() and c.isalnum() else "_" for c in text.lower())
    return name if name[:1].isalpha() else f"robot_{name}"
