"""Write an arm's inverse dynamics in letters: Newton and Euler's recursion with the base parameters alone.

The recursion is that of Luh, Walker & Paul (1980), linear in the parameters about the links' frames (Khalil & Dombre
2002, chapter 9). It is customized as SYMORO+ does it (Khalil & Creusot 1997): every element that is more than a
letter gets a name, zeros and ones are put in, standard parameters that are grouped or have no effect are zero, and what
no torque needs is removed.

With w the angular velocity of link j, v' its frame's acceleration less gravity and U = [w']x + [w]x [w]x:

    w_j  = R' w_i + z qd            v'_j = R' (v'_i + U_i P) + s (z qdd + 2 (R' w_i) x z qd)
    F_j  = M v' + U MS              N_j  = J w' + w x (J w) + MS x v'

and from the last link back, f_j = F_j + R f_k and n_j = N_j + R n_k + P x R f_k. A drive's torque is the part of n (of
f, for a slide) along its axis, with the motor's inertia, friction and offset.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lab.core.se3 import Array
from lab.extensions.dynamics.arm.base_parameters import BaseParameters
from lab.formats.formula_program import FormulaProgram
from lab.kinematics.dynamics.rigid_body import ArmDynamics
from lab.kinematics.serial.chain import COLUMNS

__all__ = ["NewtonEuler", "newton_euler"]

_EXACT = 1e-9  # rad or m: by how much an angle may miss a multiple of 90 degrees, or a length zero
_AXES = "xyz"


class _Sum:
    """A sum of products of names, with factors."""

    def __init__(self, terms: Mapping[tuple[str, ...], float] | float | str = 0.0) -> None:
        if isinstance(terms, str):
            terms = {(terms,): 1.0}
        elif isinstance(terms, (int, float)):
            terms = {(): float(terms)}
        self.terms = {names: factor for names, factor in terms.items() if factor != 0.0}

    def __add__(self, other: "_Sum") -> "_Sum":
        terms = dict(self.terms)
        for names, factor in other.terms.items():
            terms[names] = terms.get(names, 0.0) + factor
        return _Sum(terms)

    def __neg__(self) -> "_Sum":
        return _Sum({names: -factor for names, factor in self.terms.items()})

    def __sub__(self, other: "_Sum") -> "_Sum":
        return self + -other

    def __mul__(self, other: "_Sum") -> "_Sum":
        product = _Sum()
        for names, factor in self.terms.items():
            for others, times in other.terms.items():
                product = product + _Sum({tuple(sorted((*names, *others))): factor * times})
        return product

    @property
    def names(self) -> set[str]:
        """Names in it."""
        return {name for names in self.terms for name in names}

    @property
    def is_plain(self) -> bool:
        """True for a number, or a name or its negative."""
        if len(self.terms) != 1:
            return not self.terms
        names, factor = next(iter(self.terms.items()))
        return not names or (len(names) == 1 and abs(factor) == 1)

    @property
    def operations(self) -> tuple[int, int]:
        """Number of multiplications and of additions."""
        products = (len(names) - 1 + (abs(factor) != 1) for names, factor in self.terms.items() if names)
        return sum(products), max(len(self.terms) - 1, 0)

    def text(self) -> str:
        """Return it as a formula of ``lab.formats.formula_program``."""
        words = []
        for names, factor in sorted(self.terms.items(), key=lambda term: term[1] < 0):
            number = [] if names and abs(factor) == 1 else [repr(abs(factor))]
            words.append(("-" if factor < 0 else "+", "*".join((*number, *names))))
        if not words:
            return "0.0"
        (sign, first), *rest = words
        return "".join(("-" if sign == "-" else "", first, *(f" {sign} {word}" for sign, word in rest)))


_Vector = tuple[_Sum, _Sum, _Sum]
_Matrix = tuple[_Vector, _Vector, _Vector]  # rows
_ZERO, _ONE = _Sum(), _Sum(1.0)
_NOTHING: _Vector = (_ZERO, _ZERO, _ZERO)


def _added(a: _Vector, b: _Vector) -> _Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _cross(a: _Vector, b: _Vector) -> _Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _times(matrix: _Matrix, vector: _Vector) -> _Vector:
    first, second, third = (row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2] for row in matrix)
    return first, second, third


def _transposed(matrix: _Matrix) -> _Matrix:
    first, second, third = ((matrix[0][i], matrix[1][i], matrix[2][i]) for i in range(3))
    return first, second, third


def _product(a: _Matrix, b: _Matrix) -> _Matrix:
    columns = [_times(a, column) for column in _transposed(b)]
    return _transposed((columns[0], columns[1], columns[2]))


@dataclass(frozen=True)
class NewtonEuler:
    """An arm's inverse dynamics in letters.

    Attributes:
        letters: value of each length (m), angle's cosine and sine, and gravity's part (m/s^2), by its name.
        steps: names and formulas, in order, of ``q1``, ``qd1``, ``qdd1``, the letters and the base parameters.
        torques: the formula of each drive's torque (Nm; N of a slide).
        parameters: names of the base parameters.
        multiplications, additions: of all formulas.
    """

    letters: Mapping[str, float]
    steps: tuple[tuple[str, str], ...]
    torques: tuple[str, ...]
    parameters: tuple[str, ...]
    multiplications: int
    additions: int

    def program(self, name: str) -> FormulaProgram:
        """Return it as a function of joint positions, speeds and accelerations, and the base parameters."""
        numbers = range(1, len(self.torques) + 1)
        joints = {array: [f"{array}{j}" for j in numbers] for array in ("q", "qd", "qdd")}
        return FormulaProgram(
            f"{name}_inverse_dynamics",
            f"q, qd, qdd: rad and m, per s and s^2; X: {', '.join(self.parameters)} (SI). Answer: Nm, N of a slide.",
            joints | {"X": self.parameters},
            (*((letter, repr(value)) for letter, value in self.letters.items()), *self.steps),
            self.torques,
        )

    def to_dict(self) -> dict[str, object]:
        """Return it as plain values."""
        return {
            "letters": dict(self.letters),
            "steps": [list(step) for step in self.steps],
            "torques": list(self.torques),
            "multiplications": self.multiplications,
            "additions": self.additions,
        }


class _Link(NamedTuple):
    """A link's frame in the one before it: rotation and place, and what moves it."""

    rotation: _Matrix
    place: _Vector
    slides: bool
    sign: _Sum


class _Writer:
    """The formulas written so far, and the letters in them."""

    def __init__(self, arm: ArmDynamics, base: BaseParameters) -> None:
        self.arm, self.letters = arm, dict[str, float]()
        self.steps: list[tuple[str, _Sum | str]] = []
        labels = zip((base.names[i] for i in base.independent.tolist()), base.labels, strict=True)
        self.parameters = dict(labels)

    def named(self, name: str, whole: _Sum) -> _Sum:
        """Give a sum a name, unless it is a name or a number."""
        if whole.is_plain:
            return whole
        self.steps.append((name, whole))
        return _Sum(name)

    def vector(self, name: str, whole: _Vector) -> _Vector:
        """Give the elements of a vector names."""
        x, y, z = (self.named(f"{name}{axis}", each) for axis, each in zip(_AXES, whole, strict=True))
        return x, y, z

    def letter(self, name: str, value: float) -> _Sum:
        """Return a length or a part of gravity as a letter, or nothing."""
        if abs(value) <= _EXACT:
            return _ZERO
        self.letters[name] = value
        return _Sum(name)

    def parameter(self, kind: str, j: int) -> _Sum:
        """Return a standard parameter: by its base parameter's name, or zero where it is grouped or has no effect."""
        label = self.parameters.get(f"{kind}{j}")
        return _ZERO if label is None else _Sum(label)

    def turn(self, name: str, angle: float) -> tuple[_Sum, _Sum]:
        """Return the cosine and sine of a fixed angle: numbers, or letters."""
        quarters = round(angle / (np.pi / 2))
        if abs(angle - quarters * np.pi / 2) <= _EXACT:
            return _Sum((1.0, 0.0, -1.0, 0.0)[quarters % 4]), _Sum((0.0, 1.0, 0.0, -1.0)[quarters % 4])
        return self.letter(f"C{name}", float(np.cos(angle))), self.letter(f"S{name}", float(np.sin(angle)))

    def link(self, j: int) -> _Link:
        """Return link j (from 1)."""
        chain = self.arm.chain
        row = dict(zip(COLUMNS, chain.table[j - 1].tolist(), strict=True))
        sign, slides = _Sum(float(chain.sign[j - 1])), chain.prismatic[j - 1]
        c, s = self.turn(f"theta{j}", row["theta"])
        if not slides:
            self.steps += [(f"c{j}", f"cos(q{j})"), (f"s{j}", f"sin(q{j})")]
            cosine, sine = _Sum(f"c{j}"), sign * _Sum(f"s{j}")
            c, s = self.named(f"ct{j}", c * cosine - s * sine), self.named(f"st{j}", s * cosine + c * sine)
        spun: _Matrix = ((c, -s, _ZERO), (s, c, _ZERO), (_ZERO, _ZERO, _ONE))
        ca, sa = self.turn(self.arm.letter("alpha", j), row["alpha"])
        cb, sb = self.turn(self.arm.letter("beta", j), row["beta"])
        tilted = _product(
            ((_ONE, _ZERO, _ZERO), (_ZERO, ca, -sa), (_ZERO, sa, ca)),
            ((cb, _ZERO, sb), (_ZERO, _ONE, _ZERO), (-sb, _ZERO, cb)),
        )
        along = self.letter(f"d{j}", row["d"]) + (sign * _Sum(f"q{j}") if slides else _ZERO)
        along = self.named(f"r{j}", along)
        place = _added(
            (self.letter(self.arm.letter("a", j), row["a"]), _ZERO, _ZERO), _times(tilted, (_ZERO, _ZERO, along))
        )
        rotation = _product(tilted, spun)
        rows = [self.vector(f"R{j}{axis}", line) for axis, line in zip(_AXES, rotation, strict=True)]
        return _Link((rows[0], rows[1], rows[2]), self.vector(f"P{j}", place), slides, sign)


def newton_euler(arm: ArmDynamics, base: BaseParameters) -> NewtonEuler:
    """Write the inverse dynamics of an arm with its base parameters."""
    writer = _Writer(arm, base)
    links = [writer.link(j) for j in range(1, arm.chain.size + 1)]
    # outward: velocities and accelerations, the base accelerating by -g, and the forces that move each link
    minus_g = [-writer.letter(f"G{axis}", float(g)) for axis, g in zip(_AXES, arm.gravity, strict=True)]
    forces = _outward(writer, links, (minus_g[0], minus_g[1], minus_g[2]))
    # inward: the joints' torques, and from them the drives'
    drives = _drives(writer, _inward(writer, links, forces))
    # without what no torque needs
    steps = _needed(writer.steps, drives)
    sums = [*(formula for _, formula in steps if isinstance(formula, _Sum)), *drives]
    used = set[str]().union(*(formula.names for formula in sums))
    multiplications, additions = np.sum([formula.operations for formula in sums], axis=0).tolist()
    return NewtonEuler(
        letters={name: value for name, value in writer.letters.items() if name in used},
        steps=tuple((name, _text(formula)) for name, formula in steps),
        torques=tuple(map(_text, drives)),
        parameters=base.labels,
        multiplications=multiplications,
        additions=additions,
    )


def _text(formula: _Sum | str) -> str:
    return formula if isinstance(formula, str) else formula.text()


def _outward(writer: _Writer, links: Sequence[_Link], felt: _Vector) -> list[tuple[_Vector, _Vector]]:
    """Write the motion of the links from the base on, and the force and moment that each needs."""
    turning, spinning, moved = _NOTHING, _NOTHING, felt
    carried: _Matrix = (_NOTHING, _NOTHING, _NOTHING)
    forces = []
    for j, link in enumerate(links, 1):
        back, rate, change = _transposed(link.rotation), link.sign * _Sum(f"qd{j}"), link.sign * _Sum(f"qdd{j}")
        before = writer.vector(f"WI{j}", _times(back, turning))
        across = (before[1] * rate, -(before[0] * rate), _ZERO)
        shifted = writer.vector(f"VS{j}", _added(moved, _times(carried, link.place)))
        moved, spinning = _times(back, shifted), _times(back, spinning)
        if link.slides:
            turning, twice = before, _Sum(2.0)
            moved = _added(moved, (twice * across[0], twice * across[1], change))
        else:
            turning = (before[0], before[1], writer.named(f"W{j}z", before[2] + rate))
            spinning = _added(spinning, (across[0], across[1], change))
        moved, spinning = writer.vector(f"VP{j}", moved), writer.vector(f"WP{j}", spinning)
        carried = _carried(writer, j, turning, spinning)
        forces.append(_needs(writer, j, turning, spinning, moved, carried))
    return forces


def _carried(writer: _Writer, j: int, turning: _Vector, spinning: _Vector) -> _Matrix:
    """Write U = [w']x + [w]x [w]x."""
    squares = {
        (i, k): writer.named(f"DV{j}{_AXES[i]}{_AXES[k]}", turning[i] * turning[k])
        for i in range(3)
        for k in range(i, 3)
    }
    rows = []
    for i in range(3):
        row = []
        for k in range(3):
            if i == k:
                first, second = (n for n in range(3) if n != i)
                each = -(squares[first, first] + squares[second, second])
            else:
                third = 3 - i - k
                turned = spinning[third] if (i, k) in ((1, 0), (2, 1), (0, 2)) else -spinning[third]
                each = squares[min(i, k), max(i, k)] + turned
            row.append(writer.named(f"U{j}{_AXES[i]}{_AXES[k]}", each))
        rows.append((row[0], row[1], row[2]))
    return rows[0], rows[1], rows[2]


def _needs(
    writer: _Writer, j: int, turning: _Vector, spinning: _Vector, moved: _Vector, carried: _Matrix
) -> tuple[_Vector, _Vector]:
    """Write the force and the moment about its frame's origin that a link needs."""
    first = tuple(writer.parameter(kind, j) for kind in ("MX", "MY", "MZ"))
    moment: _Vector = (first[0], first[1], first[2])
    xx, yy, zz, xy, xz, yz = (writer.parameter(kind, j) for kind in ("XX", "YY", "ZZ", "XY", "XZ", "YZ"))
    inertia: _Matrix = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    mass = writer.parameter("M", j)
    force = writer.vector(f"F{j}", _added((mass * moved[0], mass * moved[1], mass * moved[2]), _times(carried, moment)))
    spin = writer.vector(f"H{j}", _times(inertia, turning))
    about = _added(_times(inertia, spinning), _cross(turning, spin))
    return force, writer.vector(f"N{j}", _added(about, _cross(moment, moved)))


def _inward(writer: _Writer, links: Sequence[_Link], forces: Sequence[tuple[_Vector, _Vector]]) -> list[_Sum]:
    """Write the joints' torques of links, from the last one back."""
    torques, pushed, twisted = list[_Sum](), _NOTHING, _NOTHING
    for j in range(len(links), 0, -1):
        link, (force, moment) = links[j - 1], forces[j - 1]
        pushed = writer.vector(f"E{j}", _added(force, pushed))
        twisted = writer.vector(f"T{j}", _added(moment, twisted))
        torques.append(link.sign * (pushed if link.slides else twisted)[2])
        pushed = writer.vector(f"EI{j}", _times(link.rotation, pushed))
        twisted = _added(_times(link.rotation, twisted), _cross(link.place, pushed))
    return torques[::-1]


def _drives(writer: _Writer, torques: Sequence[_Sum]) -> list[_Sum]:
    """Write the drives' torques: of links and the joints' friction through the couplings, then the drives' own."""
    arm, size = writer.arm, len(torques)
    # joints: of the links, with friction Fc sign(q') + Fv q'
    joints = list(torques)
    for j in range(1, size + 1):
        joints[j - 1] = joints[j - 1] + _friction(writer, j, "", _Sum(f"qd{j}"))
    if arm.coupled:
        joints = [writer.named(f"tau{j}", torque) for j, torque in enumerate(joints, 1)]
    # drives: C^-T tau, with the inertia, offset and friction of each
    through = np.linalg.inv(arm.couplings.T) if arm.coupled else np.eye(size)
    return [_weighted(through[j - 1], joints) + _own_torque(writer, j, size) for j in range(1, size + 1)]


def _own_torque(writer: _Writer, j: int, size: int) -> _Sum:
    """Write the torque of drive j itself: Ia qm'' + offset + Fcm sign(qm') + Fvm qm'."""
    rate, change = (_weighted(writer.arm.couplings[j - 1], [_Sum(f"{name}{i}") for i in range(1, size + 1)])
                    for name in ("qd", "qdd"))  # fmt: skip
    own = writer.parameter("Ia", j) * change + writer.parameter("off", j)
    if writer.parameter("Fcm", j).terms or writer.parameter("Fvm", j).terms:
        own = own + _friction(writer, j, "m", writer.named(f"qdm{j}", rate))
    return own


def _friction(writer: _Writer, j: int, of: str, speed: _Sum) -> _Sum:
    """Write the dry and viscous friction of a joint, or of a drive (m), at a speed."""
    dry, viscous = writer.parameter(f"Fc{of}", j), writer.parameter(f"Fv{of}", j)
    if dry.terms or of:
        writer.steps.append((f"sign{of}{j}", f"sign({speed.text()})"))
    return dry * _Sum(f"sign{of}{j}") + viscous * speed


def _weighted(row: Array, sums: Sequence[_Sum]) -> _Sum:
    whole = _Sum()
    for weight, each in zip(row.tolist(), sums, strict=True):
        whole = whole + _Sum(weight) * each
    return whole


def _needed(steps: Sequence[tuple[str, _Sum | str]], outputs: Iterable[_Sum]) -> list[tuple[str, _Sum | str]]:
    """Remove what no output needs."""
    needed, kept = {name for each in outputs for name in each.names}, []
    for name, formula in reversed(steps):
        if name in needed:
            kept.append((name, formula))
            needed |= formula.names if isinstance(formula, _Sum) else _arguments(formula)
    return kept[::-1]


def _arguments(formula: str) -> set[str]:
    """Return the name in a function's brackets."""
    return {formula[formula.index("(") + 1 : -1].lstrip("-")}
