"""Derive the closed-form inverse of a serial chain in letters, by Paul's method and Khalil's types of equations.

The wanted pose U = [s n a p] of the last frame is a product of link matrices. Multiplied from the left by the inverses
of the first ones, it gives equations with fewer joints on each side (Paul 1981). Equations of one unknown, or pairs of
two, are recognized by their type (Khalil & Dombre 2002, table 4.1; Mallem 2011, section 7.4), solved, and make others
solvable. Motions after the last joint are first undone in U, so that its place is the wrist's centre where there is
one. The sum of the angles of parallel axes is an unknown of its own, like q234.

Types: 1 is X r = Y, and 2 is X S + Y C = Z, with 9 and 10 where an X or Y is missing. Type 3 is two equations of one
angle. Types 6, 7 and 8 are two equations in two angles, in each of which a vector turns: their squares add up to an
equation of type 2. Types 4 and 5 do not arise, as across a slide there is an equation without it. An equation that
another one implies has coefficients that are zero at any pose of the arm; a pose drawn at random shows which.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, combinations
from typing import Any, NamedTuple

import numpy as np

from lab.core.random import rng_for
from lab.extensions.robotics.kinematics.symbolic import SymbolicChain, backwards, sympy_module, terms_of, walked

__all__ = ["ELEMENTS", "Found", "SymbolicInverse", "symbolic_inverse"]

_COLUMNS = "snap"  # of U
ELEMENTS = tuple(f"{column}{axis}" for axis in "xyz" for column in _COLUMNS)
_PLACES = tuple((row, 3) for row in range(3))
_TURNS = tuple((row, column) for column in (2, 0, 1) for row in range(3))  # a is the simplest

_BY_PLACE = 3  # joints of an arm that may bring a point to any place in space
_EXPANDED = 400  # products of an equation; those of skew axes have more, and no such type
_ZERO = 1e-9  # of a coefficient at a random pose, lengths about 1: it is zero at any

_Form = tuple[int, ...]  # factors of the joint positions in an angle


@dataclass(frozen=True)
class Found:
    """Unknowns that some equations give.

    Attributes:
        unknowns: their names, like q1 or q234.
        type: of the equations, after Khalil.
        equations: left and right side of each, sympy expressions, with where they are in the matrices.
        steps: names and expressions by which the unknowns are computed, the unknowns among them.
        sign: name of the sign, +1 or -1, that chooses the root; empty for one root.
    """

    unknowns: tuple[str, ...]
    type: int
    equations: tuple[tuple[str, Any, Any], ...]
    steps: tuple[tuple[str, Any], ...]
    sign: str = ""


@dataclass(frozen=True)
class SymbolicInverse:
    """The inverse of a chain in letters.

    Attributes:
        wanted: names of the elements of U that it uses, in the order of the matrix's rows.
        undone: entries of U without the motions after the last joint, by name, where they differ from U's.
        found: the unknowns in the order in which they are solved.
        joints: position of each joint by the unknowns, in order.
        by_place: true if the place alone is met, as of arms of three joints in space.
    """

    wanted: tuple[str, ...]
    undone: tuple[tuple[str, Any], ...]
    found: tuple[Found, ...]
    joints: tuple[Any, ...]
    by_place: bool

    @property
    def signs(self) -> tuple[str, ...]:
        """Names of the signs; each choice of them is a solution."""
        return tuple(each.sign for each in self.found if each.sign)

    @property
    def steps(self) -> tuple[tuple[str, Any], ...]:
        """All assignments from U to the unknowns."""
        return (*self.undone, *(step for each in self.found for step in each.steps))


def symbolic_inverse(letters: SymbolicChain) -> SymbolicInverse | None:
    """Return the inverse of a chain in letters; None where equations of these types do not give every joint."""
    for by_place in (True, False) if len(letters.joints) <= _BY_PLACE else (False,):
        solver = _Solver(letters, by_place)
        if solver.solved():
            return solver.answer()
    return None


class _Equation(NamedTuple):
    """An element of a matrix equation.

    Attributes:
        where: it is in the matrices.
        angles: cosines and sines in it that turn with joints, each with its angle's form and the rest of the angle.
        slides: joints whose slides are in it.
    """

    where: str
    left: Any
    right: Any
    angles: tuple[tuple[Any, _Form, Any], ...]
    slides: frozenset[int]


class _Linear(NamedTuple):
    """An equation in at most two unknown angles or a slide: 0 = constant + sum of parts.

    Attributes:
        angles: factors of cos and sin of each unknown angle, by the angle's form.
        slides: factor of each unknown slide, by the joint.
        constant: the rest.
        at: the factors of the angles at the random pose.
        size: number of operations.
    """

    equation: _Equation
    angles: Mapping[_Form, tuple[Any, Any]]
    slides: Mapping[int, Any]
    constant: Any
    at: Mapping[_Form, tuple[float, float]]
    size: int

    @property
    def printed(self) -> tuple[str, Any, Any]:
        """Place in the matrices, left and right side."""
        return self.equation.where, self.equation.left, self.equation.right


def _symbols_of(formulas: Iterable[Any]) -> set[str]:
    return {str(symbol) for formula in formulas for symbol in formula.free_symbols}


class _Solver:
    """The state of a search: equations, and the unknowns found so far."""

    def __init__(self, letters: SymbolicChain, by_place: bool) -> None:
        self.sympy, self.joints, self.by_place = sympy_module(), letters.joints, by_place
        steps = letters.steps
        last = len(steps) - 1 if by_place else letters.step_of(len(self.joints) - 1)
        U = self.sympy.Matrix(4, 4, lambda i, j: self._symbol(f"{_COLUMNS[j]}{'xyz'[i]}") if i < 3 else int(j == 3))
        W = U * walked(backwards(steps[last + 1 :])).pose
        self.undone: list[tuple[str, Any]] = []
        for i, j in ((i, j) for i in range(3) for j in range(4)):
            if W[i, j] != U[i, j]:
                self.undone.append((f"w{_COLUMNS[j]}{'xyz'[i]}", W[i, j]))
                W[i, j] = self._symbol(self.undone[-1][0])
        self.places, self.turns = list[_Equation](), list[_Equation]()
        for j in range(len(self.joints) + 1):
            self._cut(letters, W, j, last)
        self.known: dict[_Form, Any] = {}  # the symbol of each angle that was found, by its form
        self.slid: set[int] = set()
        self.found: list[Found] = []
        self.prismatic = {i for i in range(len(self.joints)) if steps[letters.step_of(i)][0] == "d"}
        self.pose = self._random_pose(letters, steps)

    def _cut(self, letters: SymbolicChain, W: Any, j: int, last: int) -> None:
        """Add the equations of (T_0,j)^-1 W = T_j,n (Paul 1981)."""
        cut, steps = letters.step_of(j - 1) + 1 if j else 0, letters.steps
        left, right = walked(backwards(steps[:cut])).pose * W, walked(steps[cut : last + 1]).pose
        after = f" after joint {j}" if j else ""
        for equations, entries in ((self.places, _PLACES), (self.turns, () if self.by_place else _TURNS)):
            equations += [self._read(f"({i + 1},{k + 1}){after}", left[i, k], right[i, k]) for i, k in entries]

    def solved(self) -> bool:
        """Solve until every joint is found, or nothing more is; return whether every one is."""
        while not self._complete():
            step = None
            for solve, count in ((self._single, 1), (self._pair, 2)):
                for equations in (self.places, self.turns):
                    step = step or solve([each for each in map(self._linear_in(count), equations) if each is not None])
            if step is None:
                return False
            self.found.append(step)
        return True

    def answer(self) -> SymbolicInverse:
        """Return what was found."""
        joints = tuple(map(self._by_unknowns, range(len(self.joints))))
        steps = [step for solution in self.found for step in solution.steps]
        made, used = {name for name, _ in steps}, _symbols_of(formula for _, formula in steps)
        undone = tuple(entry for entry in self.undone if entry[0] in used)
        used |= _symbols_of(formula for _, formula in undone)
        wanted = tuple(name for name in ELEMENTS if name in used - made)
        return SymbolicInverse(wanted, undone, tuple(self.found), joints, self.by_place)

    def _by_unknowns(self, joint: int) -> Any:
        """Return the position of a joint by the unknowns."""
        unit = tuple(int(i == joint) for i in range(len(self.joints)))
        return self.joints[joint] if joint in self.slid else self._as_known(unit)

    def _symbol(self, name: str) -> Any:
        return self.sympy.Symbol(name, real=True)

    def _read(self, where: str, left: Any, right: Any) -> _Equation:
        whole, angles = left - right, []
        for function in sorted(whole.atoms(self.sympy.cos, self.sympy.sin), key=str):
            angle = function.args[0].as_coefficients_dict()
            form = tuple(int(angle.get(joint, 0)) for joint in self.joints)
            rest = function.args[0] - sum(factor * joint for factor, joint in zip(form, self.joints, strict=True))
            angles += [(function, form, rest)] if any(form) else []
        outside = whole.xreplace({function: self.sympy.Integer(1) for function, _, _ in angles})
        slides = frozenset(i for i, joint in enumerate(self.joints) if joint in outside.free_symbols)
        return _Equation(where, left, right, tuple(angles), slides)

    def _random_pose(self, letters: SymbolicChain, steps: Sequence[Any]) -> dict[Any, Any]:
        """Return values of all symbols at joint positions and lengths drawn at random."""
        rng, sympy = rng_for(0, "structure"), self.sympy
        names = [*self.joints, *(self._symbol(name) for name in letters.letters)]
        values = {
            symbol: sympy.Float(value) for symbol, value in zip(names, rng.uniform(0.4, 1.4, len(names)), strict=True)
        }
        T = np.array(walked(steps).pose.xreplace(values).evalf().tolist(), dtype=np.float64)
        values |= {self._symbol(f"{_COLUMNS[j]}{'xyz'[i]}"): sympy.Float(T[i, j]) for i in range(3) for j in range(4)}
        return values | {self._symbol(name): formula.xreplace(values).evalf() for name, formula in self.undone}

    def _at_pose(self, expression: Any) -> float:
        return float(self.sympy.sympify(expression).xreplace(self.pose).evalf())

    def _complete(self) -> bool:
        return self.slid == self.prismatic and len(self.known) == len(self.joints) - len(self.prismatic)

    def _as_known(self, form: _Form) -> Any | None:
        """Return an angle as a sum of those that were found; None if they do not give it."""
        if not self.known:
            return None
        weights = np.linalg.lstsq(np.array(list(self.known), dtype=np.float64).T, np.array(form, dtype=np.float64))[0]
        whole = np.round(weights).astype(int)
        if (np.array(list(self.known)).T @ whole != form).any():
            return None
        return sum(weight * symbol for weight, symbol in zip(whole.tolist(), self.known.values(), strict=True))

    def _linear_in(self, count: int) -> Any:
        return lambda equation: self._linear(equation, count)

    def _linear(self, equation: _Equation, count: int) -> _Linear | None:
        """Return an equation by so many unknowns, in which it is linear; None if it is not."""
        slides = equation.slides - self.slid
        # angles as sums of angles that are found, or of an unknown one and found ones
        known, unknown = self._angles_of(equation)
        keys = sorted({key for _, key, _ in unknown.values()})
        if len(keys) + len(slides) != count or (slides and count > 1):
            return None
        if terms_of(equation.left) + terms_of(equation.right) > _EXPANDED:
            return None
        # coefficients of the unknowns' cosines and sines, and of slides
        pairs = {key: (self._symbol(f"C_{i}"), self._symbol(f"S_{i}")) for i, key in enumerate(keys)}
        symbols = {*chain.from_iterable(pairs.values()), *(self.joints[i] for i in slides)}
        difference = (equation.left - equation.right).xreplace(self._separated(equation, known, unknown, pairs))
        sums = self._coefficients(difference, symbols)
        if sums is None:
            return None
        return self._with_effect(equation, pairs, slides, sums)

    def _with_effect(
        self,
        equation: _Equation,
        pairs: Mapping[_Form, tuple[Any, Any]],
        slides: Iterable[int],
        sums: Mapping[Any, Any],
    ) -> _Linear | None:
        """Return an equation by the coefficients of its unknowns; None where one of them is zero at any pose."""
        angles = {form: (sums[c], sums[s]) for form, (c, s) in pairs.items()}
        slid = {i: sums[self.joints[i]] for i in slides}
        # at a random pose none of the unknowns is without effect
        at = {form: (self._at_pose(c), self._at_pose(s)) for form, (c, s) in angles.items()}
        effects = [*at.values(), *((self._at_pose(factor),) for factor in slid.values())]
        if any(max(map(abs, effect)) < _ZERO for effect in effects):
            return None
        size = sum(int(self.sympy.count_ops(part)) for part in (*chain.from_iterable(angles.values()), sums[1]))
        return _Linear(equation, angles, slid, sums[1], at, size)

    def _angles_of(self, equation: _Equation) -> tuple[dict[_Form, Any], dict[_Form, tuple[int, _Form, Any]]]:
        """Return the angles of an equation: those that are known, and the others with sign, unknown and known part."""
        known, unknown = dict[_Form, Any](), dict[_Form, tuple[int, _Form, Any]]()
        for form in {form for _, form, _ in equation.angles}:
            if (value := self._as_known(form)) is not None:
                known[form] = value
                continue
            unknown[form] = self._unknown_part(form)
        return known, unknown

    def _unknown_part(self, form: _Form) -> tuple[int, _Form, Any]:
        """Return the sign and the form of an angle's unknown part, which begins with +, and the sum of known joints."""
        units = np.eye(len(form), dtype=int).tolist()
        solved = {i: self.known[tuple(unit)] for i, unit in enumerate(units) if form[i] and tuple(unit) in self.known}
        left_over = tuple(0 if i in solved else factor for i, factor in enumerate(form))
        sign = next(filter(None, left_over))
        turned = sum((form[i] * symbol for i, symbol in solved.items()), start=self.sympy.Integer(0))
        return sign, tuple(sign * factor for factor in left_over), turned

    def _separated(
        self,
        equation: _Equation,
        known: Mapping[_Form, Any],
        unknown: Mapping[_Form, tuple[int, _Form, Any]],
        pairs: Mapping[_Form, tuple[Any, Any]],
    ) -> dict[Any, Any]:
        """Return each cosine and sine by those of the unknown angles, ``pairs``: cos(a + b) = cos a cos b - ..."""
        sympy, parts = self.sympy, dict[Any, Any]()
        for function, form, rest in equation.angles:
            if form in known:
                parts[function] = function.func(known[form] + rest)
                continue
            sign, key, turned = unknown[form]
            cosine, sine = pairs[key]
            c, s, sine = sympy.cos(turned + rest), sympy.sin(turned + rest), sign * sine
            parts[function] = cosine * c - sine * s if function.func is sympy.cos else sine * c + cosine * s
        return parts

    def _coefficients(self, expression: Any, symbols: set[Any]) -> dict[Any, Any] | None:
        """Return the coefficient of each symbol, and of 1; None where the expression is not linear in them."""
        factors: dict[Any, list[Any]] = {symbol: [] for symbol in (*symbols, 1)}
        for term in self.sympy.Add.make_args(self.sympy.expand(expression)):
            inside = term.free_symbols & symbols
            symbol = next(iter(inside), 1)
            factor = term / symbol
            if len(inside) > 1 or factor.free_symbols & symbols:
                return None
            factors[symbol].append(factor)
        return {symbol: self.sympy.Add(*terms) for symbol, terms in factors.items()}

    def _angle_name(self, form: _Form) -> str:
        """Return the numbers of the joints in an angle, like 234."""
        numbers = [("m" if factor < 0 else "") + str(i + 1) for i, factor in enumerate(form) if factor]
        return ("_" if any(len(each) > 1 for each in numbers) else "").join(numbers)

    def _single(self, equations: Sequence[_Linear]) -> Found | None:
        """Solve equations of one unknown: a slide, then an angle by two equations, then one by one."""
        along = [(len(factor.free_symbols), each.size, i) for i, each in enumerate(equations)
                 for factor in each.slides.values()]  # fmt: skip
        if along:
            each = equations[min(along)[2]]
            return self._slide(each, *next(iter(each.slides.items())))
        pairs = [
            (self._cost(first, second), i, first, second)
            for i, (first, second) in enumerate(combinations(equations, 2))
            if first.angles.keys() == second.angles.keys() and not self._dependent(first, second)
        ]
        if pairs:
            return self._two_equations(*min(pairs)[2:])
        if not equations:
            return None
        return self._one_equation(min(equations, key=lambda each: (each.constant != 0, each.size)))

    def _dependent(self, first: _Linear, second: _Linear) -> bool:
        """Check that two equations of one angle do not determine it."""
        (c1, s1), (c2, s2) = (*first.at.values(), *second.at.values())
        return abs(c1 * s2 - s1 * c2) < _ZERO

    def _cost(self, first: _Linear, second: _Linear) -> tuple[int, int, int]:
        """Return how long the solution of two equations is; one that divides by no other joint is best."""
        parts = [part for pair in (*first.angles.values(), *second.angles.values()) for part in pair]
        divisors = sum(bool(part.atoms(self.sympy.sin, self.sympy.cos)) for part in parts)
        return sum(part != 0 for part in parts), divisors, first.size + second.size

    def _name_angle(self, form: _Form) -> str:
        name = f"q{self._angle_name(form)}"
        self.known[form] = self._symbol(name)
        turn = sum(factor * self.pose[joint] for factor, joint in zip(form, self.joints, strict=True))
        self.pose[self.known[form]] = turn
        return name

    def _slide(self, each: _Linear, joint: int, factor: Any) -> Found:
        name = str(self.joints[joint])
        self.slid.add(joint)
        return Found((name,), 1, (each.printed,), ((name, -each.constant / factor),))

    def _two_equations(self, first: _Linear, second: _Linear) -> Found:
        (form, (c1, s1)), (c2, s2) = next(iter(first.angles.items())), next(iter(second.angles.values()))
        angle = self._angle_of(c1, s1, -first.constant, c2, s2, -second.constant)
        name = self._name_angle(form)
        return Found((name,), 3, (first.printed, second.printed), ((name, angle),))

    def _angle_of(self, c1: Any, s1: Any, z1: Any, c2: Any, s2: Any, z2: Any) -> Any:
        """Return the angle t of c1 C + s1 S = z1 and c2 C + s2 S = z2."""
        if c1 == 0 and s2 == 0:
            return self.sympy.atan2(z1 / s1, z2 / c2)
        if s1 == 0 and c2 == 0:
            return self.sympy.atan2(z2 / s2, z1 / c1)
        whole = c1 * s2 - s1 * c2
        return self.sympy.atan2((c1 * z2 - c2 * z1) / whole, (z1 * s2 - z2 * s1) / whole)

    def _root(self, form: _Form, x: Any, y: Any, z: Any) -> tuple[str, str, tuple[tuple[str, Any], ...]]:
        """Return the angle's name, its sign's, and the steps that solve X S + Y C = Z."""
        sympy, name = self.sympy, self._name_angle(form)
        number = name.removeprefix("q")
        e, X, Y, Z, R = (self._symbol(f"{letter}{number}") for letter in ("e", "X_", "Y_", "Z_", "R_"))
        if z == 0:
            return name, str(e), ((name, sympy.atan2(e * y, -e * x)),)
        root = sympy.sqrt(X * X + Y * Y - Z * Z)
        steps = (str(X), x), (str(Y), y), (str(Z), z), (str(R), root)
        return name, str(e), (*steps, (name, sympy.atan2(X * Z + e * Y * R, Y * Z - e * X * R)))

    def _one_equation(self, each: _Linear) -> Found:
        form, (c, s) = next(iter(each.angles.items()))
        kind = 10 if c == 0 else 9 if s == 0 else 2
        name, sign, steps = self._root(form, s, c, -each.constant)
        return Found((name,), kind, (each.printed,), steps, sign)

    def _pair(self, equations: Sequence[_Linear]) -> Found | None:
        """Solve two equations of two angles, in each of which a vector turns."""
        pair = self._cheapest_pair(equations)
        if pair is None:
            return None
        first, second = pair
        # first and second: 0 = M + a1 (C, S) of one + b1 (C, S) of the other, and the same with N, a2 and b2
        one, other = sorted(first.angles, key=lambda form: (sum(map(abs, form)), [-abs(factor) for factor in form]))
        (a1c, a1s), (a2c, a2s) = first.angles[one], second.angles[one]
        (b1c, b1s), (b2c, b2s) = first.angles[other], second.angles[other]
        number = f"{self._angle_name(one)}_{self._angle_name(other)}"
        M, N = (self._symbol(f"{letter}_{number}") for letter in "MN")
        # the vectors keep their lengths: their squares give an equation of type 2 in the one angle
        a_square, b_square = (sum(self.sympy.expand(part**2) for part in parts) for parts in ((a1c, a2c), (b1c, b2c)))
        squares = a_square - b_square
        x, y = 2 * (M * a1s + N * a2s), 2 * (M * a1c + N * a2c)
        name, sign, steps = self._root(one, x, y, -(M * M + N * N + squares))
        # then two equations of type 3 in the other
        c, s = self.sympy.cos(self.known[one]), self.sympy.sin(self.known[one])
        rest = [-(constant + cosine * c + sine * s) for constant, cosine, sine in ((M, a1c, a1s), (N, a2c, a2s))]
        angle = self._angle_of(b1c, b1s, rest[0], b2c, b2s, rest[1])
        kind = _type_of_pair(one, other, first)
        return Found(
            (name, self._name_angle(other)), kind, (first.printed, second.printed),
            ((str(M), first.constant), (str(N), second.constant), *steps, (f"q{self._angle_name(other)}", angle)), sign,
        )  # fmt: skip

    def _cheapest_pair(self, equations: Sequence[_Linear]) -> tuple[_Linear, _Linear] | None:
        """Return the two equations of the same two turning vectors with the shortest solution."""
        pairs = [
            (*self._cost(first, second), tuple(first.angles), i, first, second)
            for i, (first, second) in enumerate(combinations(equations, 2))
            if first.angles.keys() == second.angles.keys() and self._turning(first, second)
        ]
        return min(pairs)[5:] if pairs else None

    def _turning(self, first: _Linear, second: _Linear) -> bool:
        """Check that the vectors of both angles keep their lengths, and that the equations' constants turn them."""
        for form in first.angles:
            (c1, s1), (c2, s2) = first.at[form], second.at[form]
            if not any(max(abs(c2 + sign * s1), abs(s2 - sign * c1)) < _ZERO for sign in (1, -1)):
                return False
        return max(abs(self._at_pose(each.constant)) for each in (first, second)) >= _ZERO


def _type_of_pair(one: _Form, other: _Form, equation: _Linear) -> int:
    """Return Khalil's type of two equations of two angles, by the first of them: 6, 7 or 8."""
    shares = all(other[i] == factor for i, factor in enumerate(one) if factor)
    if shares and 0 in equation.angles[one] and 0 in equation.angles[other]:
        return 8
    return 6 if 0 in equation.angles[other] else 7
