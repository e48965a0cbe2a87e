"""Derive the matrices of a serial chain in symbols by sympy: T_i-1,i, their products, and the Jacobian.

Joint positions are q1 ... qn in the order of the joints. Lengths that are not zero have the letters of the
Denavit-Hartenberg table with the number of their row (d1, a2), and so have angles that are no multiple of 90 degrees
(theta2, alpha3, beta3); all others are put in. Neighbouring axes that are parallel turn a vector by the sum of their
angles, so that a product comes out as it is printed in textbooks, without a search for identities (e.g. Khalil & Dombre
2002, section 3.4): cos(q2 + q3), not cos q2 cos q3 - sin q2 sin q3.

A column of the Jacobian is z x r and z of a hinge, z and 0 of a slide (Whitney 1969; Khalil & Dombre 2002, chapter
5). Axis z and lever r are multiplied in axes that turn about z with no joint of its group of parallel axes, and then
turned into the frame of the answer, so that it is tidy in any frame.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from lab.core.errors import LabError
from lab.core.extras import optional
from lab.kinematics.serial.chain import COLUMNS, Chain, Convention

__all__ = [
    "SymbolicChain",
    "Walked",
    "backwards",
    "formula_text",
    "program_formula",
    "symbolic_chain",
    "sympy_module",
    "terms_of",
    "textbook",
    "walked",
]

_Column = Literal["theta", "d", "a", "alpha", "beta"]
_Step = tuple[_Column, Any]
_WRITTEN_OUT = 3  # products in a sum
_EXPANDED = 60  # products at most of what is multiplied out to see how many are left
_EXACT = 1e-9  # rad or m: by how much an angle may miss a multiple of 90 degrees, or a length zero
_STEPS: dict[Convention, tuple[_Column, ...]] = {
    "distal": ("theta", "d", "a", "alpha", "beta"),
    "craig": ("alpha", "a", "beta", "theta", "d"),
}


@dataclass(frozen=True)
class SymbolicChain:
    """A chain in symbols.

    Attributes:
        joints: the symbols q1 ... qn.
        letters: value of each other symbol, by its name: m or rad.
        rows: each link's elementary motions in their order: a column of the table, and how much (a sympy expression).
    """

    joints: tuple[Any, ...]
    letters: dict[str, float]
    rows: tuple[tuple[_Step, ...], ...]

    def between(self, first: int, last: int) -> Any:
        """Return the pose of frame ``last`` in frame ``first`` (0 is the base's), a sympy matrix of 4 by 4.

        Raises:
            LabError: the chain has no such frames, or not in this order.
        """
        if not 0 <= first < last <= len(self.rows):
            raise LabError(
                f"frames {first} and {last}: give two frames of 0 to {len(self.rows)}, the one nearer to the base first"
            )
        return walked(step for row in self.rows[first:last] for step in row).pose

    @property
    def steps(self) -> tuple[_Step, ...]:
        """All elementary motions in their order."""
        return tuple(step for row in self.rows for step in row)

    def step_of(self, joint: int) -> int:
        """Return the index of a joint's own motion among ``steps``."""
        width = len(self.rows[joint])
        own = next(i for i, (_, amount) in enumerate(self.rows[joint]) if amount.has(self.joints[joint]))
        return width * joint + own

    def jacobian(self, frame: int = 0, point: Sequence[Any] = (0, 0, 0)) -> Any:
        """Return the geometric Jacobian, a sympy matrix of 6 by n: velocity of a point, then angular velocity.

        Args:
            frame: in whose axes it is; 0 is the base's.
            point: of the last frame.

        Raises:
            LabError: the chain has no such frame.
        """
        if not 0 <= frame <= len(self.rows):
            raise LabError(f"frame {frame}: give one of 0 to {len(self.rows)}")
        sympy, tool = sympy_module(), [*point, 1]
        steps, columns = self.steps, []
        here = frame * len(self.rows[0])
        for joint, symbol in enumerate(self.joints):
            own = self.step_of(joint)
            path = steps[here:own] if own >= here else backwards(steps[own + 1 : here])
            there = walked(path)
            start = here + there.start if own >= here else here - there.start
            axis_at = walked(path[there.start :]).position
            lever = (walked(steps[start:]).pose * sympy.Matrix(tool))[:3, :] - axis_at
            kind, amount = steps[own]
            size = there.flip * amount.diff(symbol)
            axis = there.rotation * sympy.Matrix([0, 0, size])
            if kind == "d":
                columns.append(axis.col_join(sympy.zeros(3, 1)))
                continue
            moved = there.rotation * sympy.Matrix([-size * lever[1], size * lever[0], 0])
            columns.append(moved.col_join(axis))
        return sympy.Matrix.hstack(*columns)


def backwards(steps: Sequence[_Step]) -> tuple[_Step, ...]:
    """Return the motions that undo some others, in their order."""
    return tuple((name, -amount) for name, amount in reversed(steps))


def symbolic_chain(chain: Chain) -> SymbolicChain:
    """Return a nominal chain in symbols.

    Raises:
        LabError: sympy is not installed.
    """
    sympy = sympy_module()
    joints = tuple(sympy.Symbol(f"q{i + 1}", real=True) for i in range(chain.size))
    letters: dict[str, float] = {}
    rows: list[tuple[_Step, ...]] = []
    for i, row in enumerate(chain.table):
        amounts = {
            name: _amount(sympy, letters, f"{name}{i + 1}", float(value), is_angle=name not in "da")
            for name, value in zip(COLUMNS, row, strict=True)
        }
        amounts["d" if chain.prismatic[i] else "theta"] += int(chain.sign[i]) * joints[i]
        rows.append(tuple((name, amounts[name]) for name in _STEPS[chain.convention]))
    return SymbolicChain(joints, letters, tuple(rows))


def textbook(expression: Any) -> str:
    """Format an entry of a matrix as textbooks do: c1 is cos q1, s23 is sin(q2 + q3), lengths by their letters.

    A sum of few products is written out, as the course does; a longer one keeps what its products have in common.
    """
    if terms_of(expression) > _EXPANDED:
        return formula_text(expression)
    expanded = expression.expand()
    return formula_text(expanded if len(expanded.as_ordered_terms()) <= _WRITTEN_OUT else expression)


def terms_of(expression: Any) -> int:
    """Return how many products an expression has at most when it is multiplied out."""
    if expression.is_Add:
        return sum(terms_of(each) for each in expression.args)
    return math.prod(terms_of(each) for each in expression.args) if expression.is_Mul else 1


def program_formula(expression: Any) -> str:
    """Format an expression as a formula of ``lab.formats.formula_program``."""
    sympy = sympy_module()
    if expression.is_Add:
        return _summed([program_formula(term) for term in expression.as_ordered_terms()], "-")
    if expression.is_Mul:
        return _program_product(expression)
    if expression.is_Number:
        return repr(float(expression))
    if _is_inverse(expression):
        return f"1.0/{_program_factor(expression.base)}"
    if expression.is_Pow and expression.exp == sympy.Rational(1, 2):
        return f"sqrt({program_formula(expression.base)})"
    return _program_factor(expression)


def _summed(terms: Sequence[str], minus: str) -> str:
    """Join terms by plus, or by the sign with which they begin."""
    signed = (f" {minus} {term[1:]}" if term.startswith(minus) else f" + {term}" for term in terms[1:])
    return terms[0] + "".join(signed)


def _program_product(expression: Any) -> str:
    number, rest = expression.as_coeff_Mul()
    parts = rest.args if rest.is_Mul else (rest,)
    under = [_program_factor(part.base) for part in parts if _is_inverse(part)]
    factors = [_program_factor(part) for part in parts if not _is_inverse(part)]
    numbers = [] if abs(number) == 1 and factors else [program_formula(abs(number))]
    return ("-" if number < 0 else "") + "*".join((*numbers, *factors)) + "".join(f"/{part}" for part in under)


def _is_inverse(factor: Any) -> bool:
    return bool(factor.is_Pow and factor.exp == -1)


def _program_factor(factor: Any) -> str:
    if factor.is_Pow and factor.exp.is_Integer and factor.exp > 1:
        return "*".join([_program_factor(factor.base)] * int(factor.exp))
    if _needs_brackets(factor):
        return f"({program_formula(factor)})"
    if factor.is_Pow or factor.is_Number:
        return program_formula(factor)
    if factor.is_Function:
        return f"{factor.func.__name__}({', '.join(program_formula(each) for each in factor.args)})"
    return str(factor)


def _needs_brackets(factor: Any) -> bool:
    return bool(factor.is_Add or factor.is_Mul or (factor.is_Number and factor < 0))


def formula_text(expression: Any) -> str:
    """Format an expression as ``textbook`` does, as it is."""
    sympy = sympy_module()
    if expression.is_Add:
        terms = [formula_text(term) for term in expression.args]
        return _summed(sorted(terms, key=lambda term: (term.startswith("−"), term)), "−")
    if expression.is_Mul:
        return _product_text(sympy, expression)
    if _divides(expression):
        return f"1 / {_factor(sympy, 1 / expression)}"
    return _factor(sympy, expression)


def _product_text(sympy: Any, expression: Any) -> str:
    number, rest = expression.as_coeff_Mul()
    factors = rest.args if rest.is_Mul else (rest,)
    under = [_factor(sympy, 1 / factor) for factor in factors if _divides(factor)]
    words = sorted((_factor(sympy, factor) for factor in factors if not _divides(factor)), key=_order)
    whole = " ".join([str(abs(number))] * (abs(number) != 1 or not words) + words)
    return ("−" if number < 0 else "") + whole + "".join(f" / {factor}" for factor in under)


def _divides(factor: Any) -> bool:
    return bool(factor.is_Pow and factor.exp.is_negative)


def _factor(sympy: Any, factor: Any) -> str:
    """Format a factor of a product, sums in brackets."""
    if factor.is_Add or factor.is_Mul:
        return f"({formula_text(factor)})"
    if factor.is_Pow and factor.exp == sympy.Rational(1, 2):
        return f"√({formula_text(factor.base)})"
    if factor.func is sympy.atan2:
        return f"atan2({', '.join(formula_text(each) for each in factor.args)})"
    if factor.is_Pow:
        return f"{_factor(sympy, factor.base)}^{factor.exp}"
    if factor.func in (sympy.cos, sympy.sin):
        return _short(sympy, factor)
    return _greek(str(factor).replace("-", "−"))


def _order(word: str) -> tuple[int, str, str]:
    """Sort lengths and slides first, then cosines and sines by their joints, sums last."""
    if word.startswith("("):
        return 2, word, ""
    return (1, word[1:], word[0]) if word[0] in "cs" else (0, word, "")


def _short(sympy: Any, function: Any) -> str:
    """Format the cos or sin of an angle in short form."""
    letter = "c" if function.func is sympy.cos else "s"
    terms = [(str(symbol), factor) for symbol, factor in function.args[0].as_coefficients_dict().items()]
    terms.sort(key=lambda term: (term[0][0] != "q", len(term[0]), term[0]))
    if all(name.startswith("q") and factor == 1 for name, factor in terms):
        numbers = [name[1:] for name, _ in terms]
        return letter + ("" if max(map(len, numbers)) == 1 else ",").join(numbers)
    signed = "".join(_signed(name, factor) for name, factor in terms)
    return f"{letter}({_greek(signed.removeprefix('+'))})"


def _signed(name: str, factor: Any) -> str:
    return ("+" if factor > 0 else "−") + (name if abs(factor) == 1 else f"{abs(factor)}{name}")


def _greek(text: str) -> str:
    return text.replace("theta", "θ").replace("alpha", "α").replace("beta", "β")


def _amount(sympy: Any, letters: dict[str, float], name: str, value: float, *, is_angle: bool) -> Any:
    """Return an entry of the table: exact for a multiple of 90 degrees or zero, else a letter, which is noted."""
    quarters = round(value / (np.pi / 2)) if is_angle else 0
    if abs(value - quarters * np.pi / 2) <= _EXACT:
        return quarters * sympy.pi / 2
    letters[name] = value
    return sympy.Symbol(name, real=True)


class Walked(NamedTuple):
    """A place that elementary motions lead to.

    The rotation is R Rz(angle) F, with F = I or Rx(pi): turns about one direction add up in the angle, and are
    multiplied out only where the direction changes.

    Attributes:
        rotation: R.
        flip: 1 where F = I, else -1.
        position: from where the motions start, in the axes there.
        start: number of motions to where the direction changed last, where the axes are R.
    """

    rotation: Any
    angle: Any
    flip: int
    position: Any
    start: int

    @property
    def pose(self) -> Any:
        """Return the pose, a matrix of 4 by 4."""
        sympy = sympy_module()
        rotation = self.rotation * _turned(sympy, self.angle, self.flip)
        return rotation.row_join(self.position).col_join(sympy.Matrix([[0, 0, 0, 1]]))


def walked(steps: Iterable[_Step]) -> Walked:
    """Multiply elementary motions."""
    sympy = sympy_module()
    rotation, angle, flip, position = sympy.eye(3), sympy.Integer(0), 1, sympy.zeros(3, 1)
    start = 0
    for i, (name, amount) in enumerate(steps):
        if name == "theta":
            angle += flip * amount
        elif name == "d":
            position += rotation * sympy.Matrix([0, 0, flip * amount])
        elif name == "a":
            position += rotation * sympy.Matrix([amount * sympy.cos(angle), amount * sympy.sin(angle), 0])
        elif amount == 0:
            continue
        elif name == "alpha" and sympy.sin(amount) == 0:
            flip *= int(sympy.cos(amount))
        else:
            rotation = rotation * _turned(sympy, angle, flip) * _turn(sympy, name, amount)
            angle, flip, start = sympy.Integer(0), 1, i + 1
    return Walked(rotation, angle, flip, position, start)


def _turned(sympy: Any, angle: Any, flip: int) -> Any:
    """Return Rz(angle) F."""
    c, s = sympy.cos(angle), sympy.sin(angle)
    return sympy.Matrix([[c, -flip * s, 0], [s, flip * c, 0], [0, 0, flip]])


def _turn(sympy: Any, name: str, amount: Any) -> Any:
    """Return Rx(alpha) or Ry(beta)."""
    c, s = sympy.cos(amount), sympy.sin(amount)
    if name == "alpha":
        return sympy.Matrix([[1, 0, 0], [0, c, -s], [0, s, c]])
    return sympy.Matrix([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def sympy_module() -> Any:
    """Import sympy when symbols are requested.

    Raises:
        LabError: sympy is not installed.
    """
    return optional("sympy", "a model in letters")
