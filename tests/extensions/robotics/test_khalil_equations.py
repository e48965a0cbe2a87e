"""Khalil's ten equation types: every root, nothing but roots, and what is said where there is none or too many."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from lab.core.se3 import Array
from lab.extensions.robotics.inverse.khalil_equations import (
    TINY,
    Roots,
    type_1,
    type_2,
    type_3,
    type_4,
    type_5,
    type_6,
    type_7,
    type_8,
    type_9,
    type_10,
)

DRAWS = 20_000
PI = np.pi


def difference(a: Array, b: Array) -> Array:
    """Of angles, without whole turns."""
    return (a - b + np.pi) % (2 * np.pi) - np.pi


@dataclass(frozen=True)
class Equation:
    """A type: ``sides`` are what chosen coefficients and unknowns come to, which ``solve`` takes after the former.

    ``kinds`` has a letter for each unknown: an angle, or r.
    """

    solve: Callable[..., Roots]
    chosen: int
    kinds: str
    roots: int
    sides: Callable[..., list[Array]]


def s(x: Array) -> Array:
    return np.sin(x)


def c(x: Array) -> Array:
    return np.cos(x)


EQUATIONS = {
    1: Equation(type_1, 1, "r", 1, lambda x, r: [x * r]),
    2: Equation(type_2, 2, "a", 2, lambda x, y, t: [x * s(t) + y * c(t)]),
    3: Equation(lambda x1, x2, y1, y2, **k: type_3(x1, y1, x2, y2, **k), 2, "a", 1,
                lambda x1, x2, t: [x1 * s(t), x2 * c(t)]),
    4: Equation(lambda x1, x2, y1, y2, **k: type_4(x1, y1, x2, y2, **k), 2, "ra", 2,
                lambda x1, x2, r, t: [x1 * r * s(t), x2 * r * c(t)]),
    5: Equation(lambda x1, x2, z1, z2, y1, y2, **k: type_5(x1, y1, z1, x2, y2, z2, **k), 4, "ra", 2,
                lambda x1, x2, z1, z2, r, t: [x1 * s(t) - z1 * r, x2 * c(t) - z2 * r]),
    6: Equation(type_6, 3, "aa", 2,
                lambda w, x, y, i, j: [w * s(j) - x * c(i) - y * s(i), w * c(j) - x * s(i) + y * c(i)]),
    7: Equation(type_7, 4, "aa", 2,
                lambda w1, w2, x, y, i, j: [w1 * c(j) + w2 * s(j) - x * c(i) - y * s(i),
                                            w1 * s(j) - w2 * c(j) - x * s(i) + y * c(i)]),
    8: Equation(type_8, 2, "aa", 2,
                lambda x, y, i, j: [x * c(i) + y * c(i + j), x * s(i) + y * s(i + j)]),
    9: Equation(type_9, 1, "a", 2, lambda x, t: [x * c(t)]),
    10: Equation(type_10, 1, "a", 2, lambda x, t: [x * s(t)]),
}  # fmt: skip


def drawn(number: int, count: int, rng: np.random.Generator) -> tuple[Equation, list, list[Array], list[Array]]:
    """Random chosen coefficients and unknowns, and the sides that they make."""
    equation = EQUATIONS[number]
    chosen = list(rng.normal(size=(equation.chosen, count)))
    if number == 8:  # two lengths for all
        chosen = [float(first[0]) for first in chosen]
    unknowns = [rng.uniform(-PI, PI, count) if kind == "a" else rng.normal(size=count) for kind in equation.kinds]
    return equation, chosen, unknowns, equation.sides(*chosen, *unknowns)


def residual(equation: Equation, chosen: list, sides: list[Array], unknowns: list[Array]) -> Array:
    """What the equations miss, the largest, ``(roots, n)``."""
    made = equation.sides(*chosen, *unknowns)
    return np.max([np.abs(a - b) for a, b in zip(made, sides, strict=True)], axis=0)


@pytest.mark.parametrize("number", EQUATIONS)
def test_every_root_solves_the_equations_and_the_drawn_one_is_among_them(number: int) -> None:
    for seed in range(8 if number == 8 else 1):
        equation, chosen, unknowns, sides = drawn(number, DRAWS, np.random.default_rng([number, seed]))
        found = equation.solve(*chosen, *sides)
        assert len(found.values) == len(found.free) == len(equation.kinds)
        assert all(value.shape == (equation.roots, DRAWS) for value in found.values)
        assert not found.gap.any() and not any(free.any() for free in found.free)
        scale = sum(np.abs(part) for part in (*chosen, *sides)) * (1 + sum(np.abs(value) for value in found.values))
        assert (residual(equation, chosen, sides, list(found.values)) / scale).max() < 4e-15
        missed = np.zeros((equation.roots, DRAWS))
        for kind, value, unknown in zip(equation.kinds, found.values, unknowns, strict=True):
            off = difference(value, unknown) if kind == "a" else (value - unknown) / (1 + np.abs(unknown))
            missed = np.maximum(missed, np.abs(off))
        nearest = missed.min(axis=0)
        assert np.median(nearest) < 1e-14 and np.quantile(nearest, 0.999) < 1e-10
        assert nearest.max() < 1e-5  # a double root is known to sqrt(eps)


# Where there are none: what is given comes nearest


@pytest.mark.parametrize(("number", "factor"), [(2, 1.0), (6, 1.0), (7, 1.0), (8, 1.0), (9, 1.0), (10, 1.0)])
def test_without_a_root_the_nearest_is_given_and_the_gap_says_how_near(number: int, factor: float) -> None:
    """Against a search over a grid of both angles."""
    rng, count = np.random.default_rng([number, 200]), 300
    equation, chosen, _, sides = drawn(number, count, rng)
    sides = [4 * side + 2 * np.sign(side) for side in sides]
    found = equation.solve(*chosen, *sides)
    none = found.gap > 0
    assert none.mean() > 0.2
    made = equation.sides(*chosen, *found.values)
    missed = np.sqrt(sum((a - b) ** 2 for a, b in zip(made, sides, strict=True)))
    np.testing.assert_allclose(missed[:, none], np.stack([found.gap[none]] * equation.roots), rtol=1e-9)
    grid = np.linspace(-PI, PI, 241)
    grids = np.meshgrid(*[grid] * len(equation.kinds))
    for n in np.flatnonzero(none)[:50]:
        here = [part[n] if np.ndim(part) else part for part in chosen]
        all_made = equation.sides(*here, *grids)
        best = np.sqrt(sum((a - b[n]) ** 2 for a, b in zip(all_made, sides, strict=True))).min()
        assert found.gap[n] <= best + 1e-9 and best - found.gap[n] < 2e-3 * (1 + best)


def test_two_equations_for_one_angle_may_contradict_each_other() -> None:
    found = type_3(np.ones(2), np.array([0.9, 0.6]), np.ones(2), np.array([0.8, 0.8]))
    np.testing.assert_allclose(found.values[0][0], np.arctan2([0.9, 0.6], 0.8))
    assert found.gap[0] == pytest.approx(np.hypot(0.9, 0.8) - 1) and found.gap[1] == 0
    (r, t), gap, _ = type_5(1.0, 2.0, 0.0, 1.0, 0.0, 1.0)  # sin t = 2, cos t = r
    assert gap == pytest.approx(1.0) and r == pytest.approx(0.0) and np.sin(t) == pytest.approx(1.0)


@pytest.mark.parametrize("missed", [1e-13, 1e-9])
def test_a_root_that_rounding_misses_is_a_double_root_and_one_that_is_missed_by_more_is_none(missed: float) -> None:
    more = 1 + missed
    hypotenuse = np.array([5e-7 * more])
    solved = {
        2: type_2(np.array([3e-7]), np.array([4e-7]), hypotenuse, 1e-20),
        3: type_3(1.0, more, 1.0, 0.0),
        5: type_5(1.0, more, 0.0, 1.0, 0.0, 1.0),
        6: type_6(1.0, 1.0, 0.0, 2.0 * more, 0.0),
        7: type_7(0.6, 0.8, 1.0, 0.0, 2.0 * more, 0.0),
        8: type_8(0.3, 0.4, np.array([0.7 * more]), np.zeros(1)),
        9: type_9(2.0, -2.0 * more),
        10: type_10(2.0, 2.0 * more),
    }
    for number, found in solved.items():
        assert np.all((found.gap > 0) == (missed > 1e-12)), number
        assert all(np.isfinite(value).all() for value in found.values)


# Where there are too many: the reference, and a flag


def eight(x: float, y: float, z2: float) -> Roots:
    return type_8(x, y, np.zeros(1), np.full(1, z2), reference=(0.7, 0.3))


THIRD, SIXTH, LIKED = PI / 3, PI / 6, {"reference": (5.0, 0.7)}
FREE = {
    "1: X = 0": (type_1(0.0, 0.0, reference=0.7), [True], 0.0, [0.7]),
    "1: 0 = 3": (type_1(0.0, 3.0, reference=0.7), [True], 3.0, [0.7]),
    "2: 0 = 0": (type_2(np.zeros(1), np.zeros(1), np.zeros(1), reference=0.7), [True], 0.0, [0.7]),
    "2: 0 = rounding": (type_2(np.zeros(1), np.zeros(1), np.full(1, 1e-16), reference=0.7), [True], 0.0, [0.7]),
    "2: 0 = 1": (type_2(np.zeros(1), np.zeros(1), np.ones(1), reference=0.7), [True], 1.0, [0.7]),
    "3: nothing said": (type_3(0.0, 0.0, 0.0, 0.0, reference=0.7), [True], 0.0, [0.7]),
    "3: cosine alone": (type_3(0.0, 0.0, 2.0, 1.0, reference=-0.7), [False], 0.0, [-PI / 3]),
    "3: sine alone": (type_3(2.0, 1.0, 0.0, 0.0, reference=3.0), [False], 0.0, [5 * PI / 6]),
    "3: sine alone, too large": (type_3(2.0, 3.0, 0.0, 0.0, reference=3.0), [False], 1.0, [PI / 2]),
    "3: 0 = 4": (type_3(0.0, 4.0, 2.0, 1.0, reference=-0.7), [False], 4.0, [-PI / 3]),
    "3: 0 = sin t = cos t": (type_3(2.0, 0.0, 2.0, 0.0, reference=0.7), [False], 2.0, [0.7]),
    "4: r = 0": (type_4(2.0, 0.0, 3.0, 0.0, reference=(5.0, 0.7)), [False, True], 0.0, [0.0, 0.7]),
    "4: sine alone": (type_4(2.0, 1.0, 0.0, 0.0, reference=(1.0, 0.0)), [True, True], 0.0, [1.25**0.5, np.arctan(0.5)]),
    "4: nothing said": (type_4(0.0, 0.0, 0.0, 0.0, reference=(5.0, 0.7)), [True, True], 0.0, [5.0, 0.7]),
    "4: 0 = 3": (type_4(0.0, 3.0, 1.0, 1.0), [True, True], 3.0, [1.0, 0.0]),
    "5: no r": (type_5(1.0, 0.6, 0.0, 1.0, 0.8, 0.0, **LIKED), [True, False], 0.0, [5.0, np.arctan2(3, 4)]),
    "5: no r, too long": (type_5(1.0, 6.0, 0.0, 1.0, 8.0, 0.0), [True, False], 9.0, [0.0, np.arctan2(3, 4)]),
    "5: r alone, then cosine": (type_5(0.0, 1.0, -1.0, 2.0, 0.0, 1.0), [False, False], 0.0, [1.0, THIRD]),
    "5: r alone, then sine": (type_5(2.0, 0.0, 1.0, 0.0, 1.0, -1.0), [False, False], 0.0, [1.0, SIXTH]),
    "5: cosine and r": (type_5(0.0, 0.0, 0.0, 2.0, 1.0, 4.0, reference=(0.0, THIRD)), [True, True], 0.0, [0.0, THIRD]),
    "5: sine and r": (type_5(2.0, 1.0, 4.0, 0.0, 0.0, 0.0, reference=(0.0, SIXTH)), [True, True], 0.0, [0.0, SIXTH]),
    "5: cosine alone": (type_5(0.0, 0.0, 0.0, 2.0, 1.0, 0.0, reference=(5.0, 0.0)), [True, False], 0.0, [5.0, THIRD]),
    "5: r alone": (type_5(0.0, 3.0, -1.0, 0.0, 6.0, -2.0, **LIKED), [False, True], 0.0, [3.0, 0.7]),
    "5: r alone, twice": (type_5(0.0, 5.0, -1.0, 0.0, 0.0, -2.0, **LIKED), [False, True], 20**0.5, [1.0, 0.7]),
    "5: nothing said": (type_5(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, **LIKED), [True, True], 0.0, [5.0, 0.7]),
    "5: 0 = 3": (type_5(0.0, 3.0, 0.0, 2.0, 1.0, 0.0), [True, False], 3.0, [0.0, THIRD]),
    "6: no i": (type_6(-2.0, 0.0, 0.0, 2.0, 0.0, reference=(0.7, 0.3)), [True, False], 0.0, [0.7, -PI / 2]),
    "6: no i, too long": (type_6(2.0, 0.0, 0.0, 3.0, 0.0, reference=(0.7, 0.3)), [True, False], 1.0, [0.7, PI / 2]),
    "6: no j": (type_6(0.0, 1.0, 0.0, 0.0, -1.0, reference=(0.7, 0.3)), [False, True], 0.0, [PI / 2, 0.3]),
    "6: no j, too long": (type_6(0.0, 1.0, 0.0, 0.0, -3.0, reference=(0.7, 0.3)), [False, True], 2.0, [PI / 2, 0.3]),
    "6: Z = 0": (type_6(1.0, 1.0, 0.0, 0.0, 0.0, reference=(0.7, 0.3)), [True, False], 0.0, [0.7, PI / 2 - 0.7]),
    "6: nothing said": (type_6(0.0, 0.0, 0.0, 0.0, 0.0, reference=(0.7, 0.3)), [True, True], 0.0, [0.7, 0.3]),
    "7: no i": (type_7(0.0, -2.0, 0.0, 0.0, 2.0, 0.0, reference=(0.7, 0.3)), [True, False], 0.0, [0.7, -PI / 2]),
    "7: no j": (type_7(0.0, 0.0, 1.0, 0.0, 0.0, -1.0, reference=(0.7, 0.3)), [False, True], 0.0, [PI / 2, 0.3]),
    "7: nothing said": (type_7(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, reference=(0.7, 0.3)), [True, True], 0.0, [0.7, 0.3]),
    "8: folded back": (eight(0.5, 0.5, 0.0), [True, False], 0.0, [0.7, PI]),
    "8: no second link": (eight(2.0, 0.0, 2.0), [False, True], 0.0, [PI / 2, 0.3]),
    "8: no first link": (eight(0.0, 2.0, 2.0), [True, False], 0.0, [0.7, PI / 2 - 0.7]),
    "8: no first link, and the second backwards": (eight(0.0, -2.0, 2.0), [True, False], 0.0, [0.7, -PI / 2 - 0.7]),
    "8: no link": (eight(0.0, 0.0, 0.0), [True, True], 0.0, [0.7, 0.3]),
    "8: no link, too far": (eight(0.0, 0.0, 1.0), [True, True], 1.0, [0.7, 0.3]),
    "9: X = 0": (type_9(0.0, 0.0, reference=0.7), [True], 0.0, [0.7]),
    "9: 0 = 3": (type_9(0.0, 3.0, reference=0.7), [True], 3.0, [0.7]),
    "9: too large": (type_9(-2.0, 3.0), [False], 1.0, [PI]),
    "10: X = 0": (type_10(0.0, 0.0, reference=0.7), [True], 0.0, [0.7]),
    "10: too large": (type_10(2.0, -3.0), [False], 1.0, [-PI / 2]),
}  # fmt: skip


@pytest.mark.parametrize("case", FREE)
def test_a_free_unknown_takes_its_reference_and_is_flagged(case: str) -> None:
    found, free, gap, first = FREE[case]
    assert [bool(np.ravel(each)[0]) for each in found.free] == free
    assert np.ravel(found.gap)[0] == pytest.approx(gap, abs=1e-15)
    for value, expected in zip(found.values, first, strict=True):
        assert np.isfinite(value).all()
        assert np.ravel(value[0])[0] == pytest.approx(expected, abs=1e-12)


def test_degenerate_cases_among_others_change_nothing_for_those() -> None:
    """All types' coefficients zero in some rows, in every combination, against the same rows alone."""
    rng = np.random.default_rng(300)
    for number, equation in EQUATIONS.items():
        if number == 8:
            continue
        width = equation.chosen + len(equation.sides(*rng.normal(size=equation.chosen + len(equation.kinds))))
        masks = (np.arange(2**width)[:, None] >> np.arange(width)) & 1
        rows = (rng.normal(size=masks.shape) * masks).T
        liked = {} if len(equation.kinds) == 1 else {"reference": (0.3, 0.7)}
        together = equation.solve(*rows, **liked)
        for n in range(len(masks)):
            alone = equation.solve(*rows[:, n : n + 1], **liked)
            assert alone.gap[0] == together.gap[n] and np.isfinite(alone.gap[0])
            for a, b in zip((*alone.values, *alone.free), (*together.values, *together.free), strict=True):
                np.testing.assert_array_equal(a[..., 0], b[..., n])
                assert np.isfinite(a).all()
        made = equation.sides(*rows[: equation.chosen], *together.values)
        missed = np.sqrt(sum((a - b) ** 2 for a, b in zip(made, rows[equation.chosen :], strict=True)))
        np.testing.assert_allclose(missed.max(axis=0), together.gap, atol=1e-14)


def test_an_elbow_out_of_reach_may_be_given_bent() -> None:
    (_, j), gap, _ = type_8(0.7, 0.2, np.array([1.0, 0.4]), np.zeros(2), bend=0.03)
    np.testing.assert_allclose(gap, [0.1, 0.1])
    np.testing.assert_allclose(np.abs(j), [[0.03, PI - 0.03]] * 2)


def test_a_tiny_coefficient_counts_as_none_only_below_the_limit() -> None:
    for size, free in ((0.9 * TINY, True), (1.1 * TINY, False)):
        assert type_2(np.full(1, size), np.zeros(1), np.zeros(1)).free[0][0] == free
        assert type_1(size, 0.0).free[0] == free and type_9(size, 0.0).free[0] == free
