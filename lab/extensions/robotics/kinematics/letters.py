"""Show the models of a serial arm in letters: matrices, Jacobian, its inverse, and the inverse; also as programs."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from lab.core.se3 import Array
from lab.extensions.robotics.kinematics.symbolic import (
    SymbolicChain,
    formula_text,
    program_formula,
    symbolic_chain,
    sympy_module,
    textbook,
)
from lab.extensions.robotics.kinematics.symbolic_inverse import ELEMENTS, Found, SymbolicInverse, symbolic_inverse
from lab.formats.formula_program import FormulaProgram
from lab.kinematics.serial.chain import Chain
from lab.report.document import Block, Bullets, Paragraph, Table, guarded

__all__ = ["ModelsInLetters", "inverse_in_letters"]

_SAME_M = 1e-12  # a point's coordinate and a length of the table
_TWIST = ("vx", "vy", "vz", "ωx", "ωy", "ωz")
_SHORT_ENTRY = 14  # characters, of which four stand side by side on a terminal and on a phone
_NONE = 1e-9  # of an element at a random position
_FREEDOMS, _BLOCK, _MIDDLE = 6, 3, 3


@dataclass(frozen=True)
class ModelsInLetters:
    """The models of a nominal arm in letters.

    Attributes:
        chain: the arm in letters, those of the tool's point among them.
        frame: the number of the frame of the Jacobian's axes.
        point: of the last frame, whose velocity the Jacobian gives.
        between: two frames whose product is requested.
        shows_matrices: true for matrices and Jacobian.
        shows_inverse_jacobian: true for the Jacobian's inverse.
        shows_inverse: true for the equations of the inverse.
    """

    chain: SymbolicChain
    frame: int
    point: tuple[Any, ...]
    between: tuple[int, int] | None
    shows_matrices: bool
    shows_inverse_jacobian: bool
    shows_inverse: bool

    @classmethod
    def of(
        cls,
        chain: Chain,
        frame: int,
        tool_m: Array,
        between: tuple[int, int] | None,
        *,
        matrices: bool,
        inverse_jacobian: bool,
        inverse: bool,
    ) -> "ModelsInLetters":
        """Put a nominal arm in letters.

        Args:
            tool_m: ``(3,)`` the tool's point. A coordinate as long as a length of the table has that letter.
        """
        letters = symbolic_chain(chain)
        point = tuple(
            _coordinate(letters.letters, f"t{axis}", float(value)) for axis, value in zip("xyz", tool_m, strict=True)
        )
        return cls(letters, frame, point, between, matrices, inverse_jacobian and matrices, inverse)

    @cached_property
    def jacobian(self) -> Any:
        """The Jacobian, 6 by n."""
        return self.chain.jacobian(self.frame, self.point)

    @cached_property
    def inverse_jacobian(self) -> Any | None:
        """The Jacobian's inverse by its independent rows; None where the letters give none.

        Of six joints it is found in the axes of frame 3, where it is short, and turned from the frame's axes to those.
        """
        if len(self.chain.joints) != _FREEDOMS:
            return inverse_in_letters(self.jacobian)
        found = inverse_in_letters(self.chain.jacobian(_MIDDLE, self.point))
        if found is None or self.frame == _MIDDLE:
            return found
        ends = sorted((self.frame, _MIDDLE))
        turn = self.chain.between(ends[0], ends[1])[:3, :3]
        turn = turn.T if self.frame < _MIDDLE else turn
        return (found[:, :3] * turn).row_join(found[:, 3:] * turn)

    @cached_property
    def inverse(self) -> SymbolicInverse | None:
        """The inverse; None where equations of Khalil's types do not give every joint."""
        return symbolic_inverse(self.chain)

    def matrices(self) -> dict[str, Any]:
        """Return T_i-1,i, T_0,n and the requested product."""
        size = len(self.chain.rows)
        pairs = [*((i, i + 1) for i in range(size)), (0, size)]
        if self.between is not None and self.between not in pairs:
            pairs.append(self.between)
        return {f"T{first},{last}": self.chain.between(first, last) for first, last in pairs}

    def letter_values(self) -> dict[str, float]:
        """Return values of the letters: lengths ``<letter>_mm``, angles ``<letter>_deg``."""
        letters = self.chain.letters
        lengths = {name for name in letters if name.rstrip("0123456789xyz") in ("d", "a", "t")}
        return {
            f"{name}_mm" if name in lengths else f"{name}_deg": _tidy(value * (1e3 if name in lengths else 180 / np.pi))
            for name, value in letters.items()
        }

    def to_dict(self) -> dict[str, Any]:
        """Return what is shown, as texts."""
        values: dict[str, Any] = {"letters": self.letter_values()}
        if self.shows_matrices:
            values |= {name: _rows(matrix) for name, matrix in self.matrices().items()}
            values["jacobian"] = _rows(self.jacobian)
        if self.shows_inverse_jacobian:
            found = self.inverse_jacobian
            values["inverse_jacobian"] = None if found is None else _rows(found, formula_text)
        if self.shows_inverse:
            values["inverse"] = None if self.inverse is None else _inverse_to_dict(self.inverse, self.chain)
        return values

    def blocks(self, names: Sequence[str]) -> tuple[Block, ...]:
        """Return what a person reads, for joints of these names."""
        blocks: list[Block] = [self._legend(names)]
        if self.shows_matrices:
            blocks += [_matrix(name, _rows(matrix)) for name, matrix in self.matrices().items()]
            axes = "the base" if self.frame == 0 else f"frame {self.frame}"
            blocks.append(_long(_rows(self.jacobian), _TWIST, names, f"Jacobian in the axes of {axes}"))
        if self.shows_inverse_jacobian:
            inverse = self.inverse_jacobian
            blocks.append(
                Paragraph("The Jacobian has no blocks of three rows and columns, and no inverse in few letters.")
                if inverse is None
                else _long(_rows(inverse, formula_text), names, _TWIST, "Inverse of the Jacobian")
            )
        return (*blocks, *(_inverse_blocks(self.inverse, self.chain) if self.shows_inverse else ()))

    def _legend(self, names: Sequence[str]) -> Paragraph:
        """Explain the letters."""
        letters = ", ".join(
            f"{name.rpartition('_')[0]} = {value:.6g} {'mm' if name.endswith('mm') else '°'}".replace("-", "−")
            for name, value in self.letter_values().items()
        )
        called = ", ".join(f"q{i + 1} is {name}" for i, name in enumerate(names) if name != f"q{i + 1}")
        text = f"Here c1 is cos q1, s23 is sin(q2 + q3){f'; {called}' if called else ''}"
        return Paragraph(f"{text}. {letters}." if letters else f"{text}.")

    def programs(self, name: str) -> tuple[FormulaProgram, ...]:
        """Return the models as functions of joint positions ``q`` (rad, m), their names after that of the robot."""
        constants = [(letter, repr(float(value))) for letter, value in self.chain.letters.items()]
        joints = [str(joint) for joint in self.chain.joints]
        programs = []
        if self.shows_matrices:
            models = (
                ("pose", self.chain.between(0, len(joints))[:3, :], "12 elements of T0,n, three rows of four"),
                ("jacobian", self.jacobian, f"six rows of {len(joints)}, in frame {self.frame}"),
            )
            for kind, matrix, answer in models:
                steps, formulas = _shared(list(matrix))
                programs.append(
                    FormulaProgram(
                        f"{name}_{kind}", f"q in rad and m. Answer: {answer}.", {"q": joints}, (*constants, *steps),
                        formulas,
                    )
                )  # fmt: skip
        if self.shows_inverse and self.inverse is not None:
            programs.append(_inverse_program(f"{name}_inverse", self.inverse, constants))
        return tuple(programs)


def _inverse_program(name: str, inverse: SymbolicInverse, constants: list[tuple[str, str]]) -> FormulaProgram:
    """Return the inverse as a function of the wanted pose, and of the signs that choose its roots."""
    comment = "U has 12 elements, three rows of [s n a p]; e chooses each root by +1 or -1. Answer: q in rad and m."
    inputs = {"U": list(ELEMENTS), **({"e": list(inverse.signs)} if inverse.signs else {})}
    steps = [(unknown, program_formula(formula)) for unknown, formula in inverse.steps]
    formulas = [program_formula(sympy_module().sympify(joint)) for joint in inverse.joints]
    return FormulaProgram(name, comment, inputs, (*constants, *steps), formulas)


def inverse_in_letters(jacobian: Any) -> Any | None:
    """Invert a Jacobian in letters: by blocks of 3 by 3 where the last three joints only turn the tool, else whole.

    An arm of fewer joints than six has the inverse by its first independent rows; other columns are zero (Mallem 2011,
    section 5.6).
    """
    sympy, size = sympy_module(), jacobian.shape[1]
    point = {symbol: sympy.Float(0.3 + 0.37 * i) for i, symbol in enumerate(sorted(jacobian.free_symbols, key=str))}
    at = np.array(jacobian.xreplace(point).evalf().tolist(), dtype=np.float64)
    if size == _FREEDOMS:
        return None if np.abs(at[:3, 3:]).max() > _NONE else _inverse_by_blocks(jacobian)
    return None if size > _BLOCK else _inverse_by_rows(jacobian, at)


def _inverse_by_blocks(jacobian: Any) -> Any | None:
    """Invert J = [A 0; C D]: [A^-1 0; -D^-1 C A^-1 D^-1]."""
    A_back, D_back = _inverted(jacobian[:3, :3]), _inverted(jacobian[3:, 3:])
    if A_back is None or D_back is None:
        return None
    lower = (-D_back * jacobian[3:, :3] * A_back).applyfunc(_ratio)
    return A_back.row_join(sympy_module().zeros(3, 3)).col_join(lower.row_join(D_back))


def _inverse_by_rows(jacobian: Any, at: Array) -> Any | None:
    """Invert the first independent rows of a Jacobian, whose values ``at`` some position show which they are."""
    size, rows = jacobian.shape[1], list[int]()
    for i in range(_FREEDOMS):
        if np.linalg.matrix_rank(at[[*rows, i]], tol=_NONE) > len(rows):
            rows.append(i)
    back = _inverted(jacobian[rows, :]) if len(rows) == size else None
    if back is None:
        return None
    whole = sympy_module().zeros(size, _FREEDOMS)
    for column, row in enumerate(rows):
        whole[:, row] = back[:, column]
    return whole


def _inverted(matrix: Any) -> Any | None:
    """Invert a small matrix by its cofactors; None where its determinant is zero."""
    whole = _small(matrix.det(method="berkowitz"))
    if whole == 0:
        return None
    return matrix.adjugate().applyfunc(lambda cofactor: sympy_module().factor(_small(cofactor) / whole))


def _ratio(expression: Any) -> Any:
    sympy = sympy_module()
    above, below = sympy.fraction(sympy.together(expression))
    return sympy.factor(_small(above) / _small(below))


def _small(expression: Any) -> Any:
    """Remove squares of sines or of cosines, whichever leaves fewer terms, and factor."""
    sympy = sympy_module()
    expanded = sympy.expand(expression)
    angles = {function.args[0] for function in expanded.atoms(sympy.sin, sympy.cos)}
    if not angles:
        return sympy.factor(expanded)
    pairs = {angle: (sympy.Dummy(f"s{i}"), sympy.Dummy(f"c{i}")) for i, angle in enumerate(sorted(angles, key=str))}
    there = {sympy.sin(angle): s for angle, (s, _) in pairs.items()} | {
        sympy.cos(angle): c for angle, (_, c) in pairs.items()
    }
    back = {symbol: function for function, symbol in there.items()}
    best = expanded
    for first in (0, 1):
        reduced = expanded.xreplace(there)
        for pair in pairs.values():
            out, other = pair[first], pair[1 - first]
            reduced = sympy.expand(sympy.rem(reduced, out**2 + other**2 - 1, out)) if reduced.has(out) else reduced
        found = sympy.factor(reduced).xreplace(back)
        best = min(best, found, key=sympy.count_ops)
    return best


def _coordinate(letters: dict[str, float], name: str, value: float) -> Any:
    """Return a coordinate in letters: zero, a length of the table with its sign, or a letter of its own."""
    sympy = sympy_module()
    if abs(value) <= _SAME_M:
        return sympy.Integer(0)
    for letter in reversed(letters):
        if letter[0] in "da" and abs(abs(letters[letter]) - abs(value)) <= _SAME_M:
            return int(np.sign(value * letters[letter])) * sympy.Symbol(letter, real=True)
    letters[name] = value
    return sympy.Symbol(name, real=True)


def _tidy(value: float) -> float:
    return float(f"{value:.12g}")


def _rows(matrix: Any, text: Callable[[Any], str] = textbook) -> list[list[str]]:
    return [[text(matrix[i, j]) for j in range(matrix.shape[1])] for i in range(matrix.shape[0])]


def _matrix(name: str, rows: Sequence[Sequence[str]]) -> Table:
    """Tabulate a matrix; one with long entries as a list of these."""
    if max(len(entry) for row in rows for entry in row) <= _SHORT_ENTRY:
        return Table(("", "", "", ""), tuple(tuple(row) for row in rows), name)
    entries = tuple((f"{name}({i + 1},{j + 1})", rows[i][j]) for i in range(3) for j in range(4))
    return Table(("", ""), entries, name)


def _long(rows: Sequence[Sequence[str]], names: Sequence[str], columns: Sequence[str], caption: str) -> Table:
    """Tabulate a matrix with names of its rows and columns; one with long entries as a list of those not zero."""
    if max(len(entry) for row in rows for entry in row) <= _SHORT_ENTRY:
        body = tuple((name, *row) for name, row in zip(names, rows, strict=True))
        return Table(("", *columns), body, caption)
    entries = tuple(
        (f"{name}, {column}", entry)
        for name, row in zip(names, rows, strict=True)
        for column, entry in zip(columns, row, strict=True)
        if entry != "0"
    )
    return Table(("", ""), entries, f"{caption}; what is not listed is zero")


def _shared(expressions: Sequence[Any]) -> tuple[list[tuple[str, str]], list[str]]:
    """Return assignments of what expressions share, and the formulas."""
    sympy = sympy_module()
    steps, formulas = sympy.cse(list(expressions), symbols=sympy.numbered_symbols("v", start=1))
    return [(str(name), program_formula(each)) for name, each in steps], [program_formula(each) for each in formulas]


def _inverse_to_dict(found: SymbolicInverse, chain: SymbolicChain) -> dict[str, Any]:
    return {
        "by_place": found.by_place,
        "wanted": list(found.wanted),
        "undone": {name: textbook(formula) for name, formula in found.undone},
        "equations": [
            {
                "unknowns": list(each.unknowns),
                "type": each.type,
                "of": [where for where, _, _ in each.equations],
                "equations": [_equation(left, right) for _, left, right in each.equations],
                "solution": {name: textbook(formula) for name, formula in each.steps},
                "sign": each.sign or None,
            }
            for each in found.found
        ],
        "joints": dict(_joints(found, chain)),
    }


def _joints(found: SymbolicInverse, chain: SymbolicChain) -> Iterator[tuple[str, str]]:
    """Yield how each joint that is not an unknown itself follows from those."""
    for joint, formula in zip(chain.joints, found.joints, strict=True):
        if str(joint) != str(formula):
            yield str(joint), textbook(sympy_module().sympify(formula))


def _equation(left: Any, right: Any) -> str:
    """Format an equation, the side without joints to the right."""
    return f"{textbook(left)} = {textbook(right)}"


_TYPES: Mapping[int, str] = {
    1: "X r = Y", 2: "X S + Y C = Z", 3: "two equations of one angle", 6: "W Sj = X Ci + Y Si + Z1 and so on",
    7: "W1 Cj + W2 Sj = X Ci + Y Si + Z1 and so on", 8: "X Ci + Y C(i+j) = Z1, X Si + Y S(i+j) = Z2", 9: "X C = Y",
    10: "X S = Y",
}  # fmt: skip


@guarded
def _inverse_blocks(found: SymbolicInverse | None, chain: SymbolicChain) -> tuple[Block, ...]:
    if found is None:
        return (Paragraph("Inverse: equations of Khalil's types 1 to 10 do not give every joint of this arm."),)
    wanted = "the place p of the last frame alone" if found.by_place else "the pose U = [s n a p] of the last frame"
    if not found.by_place and len(chain.joints) < _FREEDOMS:
        wanted += " that the arm can take"
    roots = 2 ** len(found.signs)
    choice = f"each sign e is +1 or −1: {roots} solutions" if found.signs else "one solution"
    undone = tuple(f"{name} = {textbook(formula)}" for name, formula in found.undone)
    rows = tuple(f"{name} = {text}" for name, text in _joints(found, chain))
    return (
        Paragraph(f"Inverse, for {wanted}; {choice}. (1,4) after joint 1 is an element of T1,0 U = T1,n."),
        Bullets(undone),
        *(block for each in found.found for block in _found_blocks(each)),
        Bullets(rows),
    )


@guarded
def _found_blocks(each: Found) -> tuple[Block, ...]:
    equations = (f"{where}: {_equation(left, right)}" for where, left, right in each.equations)
    steps = (f"{name} = {textbook(formula)}" for name, formula in each.steps)
    text = f"{' and '.join(each.unknowns)} by type {each.type} ({_TYPES[each.type]}):"
    return Paragraph(text), Bullets((*equations, *steps))
