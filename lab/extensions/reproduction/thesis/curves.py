"""Figures IV.1 and IV.2: the index O1 against the number of poses, and the convergence of its search."""

from functools import cache

import numpy as np

from lab.core.se3 import Array
from lab.extensions.reproduction.answer import Answer, at_least, number
from lab.extensions.reproduction.item import Item
from lab.extensions.reproduction.thesis_case import converging, searched
from lab.pose_selection.criteria import indices
from lab.render.charts.axes import Axes
from lab.render.document import Picture
from lab.render.style import AFTER, MUTED
from lab.render.svg import axes_picture

__all__ = ["CURVE_ITEMS"]

PRINTED_BEST = 12.2487
_COUNTS = (7, 8, 10, 12, 15, 20, 25, 30)
_CANDIDATES, _STARTS, _ROUNDS = 200, 4, 4


@cache
def _curve() -> Array:
    """The best O1 found with each number of poses."""
    found = [searched("O1", 0, _CANDIDATES, 1, poses=count) for count in _COUNTS]
    return np.array([float(indices(design.jacobian).o1) for design in found])


@cache
def _trace() -> Array:
    return converging(0, _CANDIDATES, _STARTS, _ROUNDS)


def _against_poses() -> tuple[Answer, ...]:
    last = _curve()[_COUNTS.index(20)]
    return (
        *(
            number(f"O1 with {count} poses", "", float(value), digits=2)
            for count, value in zip(_COUNTS, _curve(), strict=True)
        ),
        number("gain from 20 to 30 poses, %", "", 100 * float(_curve()[-1] / last - 1), digits=1),
    )


def _best() -> tuple[Answer, ...]:
    return (at_least("the best O1 of 20 poses", f"{PRINTED_BEST:.4f}", float(_trace().max())),)


def _curve_picture() -> tuple[Picture, ...]:
    def draw(axes: Axes) -> None:
        axes.plot(_COUNTS, _curve(), "o-", color=AFTER, markersize=4)
        axes.axvline(20, color=MUTED, linewidth=1, linestyle="--")
        axes.set(xlabel="number of poses", ylabel="O1 (mm, rad)")

    return (axes_picture("o1-poses", "O1 against the number of poses", (4.6, 3.2), draw),)


def _trace_picture() -> tuple[Picture, ...]:
    def draw(axes: Axes) -> None:
        for row in _trace():
            axes.plot(range(len(row)), row, "o-", color=AFTER, markersize=3, linewidth=1, alpha=0.7)
        axes.axhline(PRINTED_BEST, color=MUTED, linewidth=1, linestyle="--")
        axes.set(xlabel="rounds of the ascent after the exchange", ylabel="O1 of 20 poses")

    return (axes_picture("o1-search", "Convergence of the search for O1, each start", (4.6, 3.2), draw),)


CURVE_ITEMS = (
    Item("Figure IV.1", "O1 against the number of poses", _against_poses, "python scripts/best_o1.py --ignore-limits",
         "The curve is printed without numbers. It flattens because O1 is divided by √n: it measures information per "
         "pose, and does not say that more poses stop helping.", _curve_picture),
    Item("Figure IV.2", "Convergence of the search for O1", _best, "python scripts/best_o1.py --ignore-limits",
         f"{_STARTS} starts, without joint limits as in the thesis; the dashed line is the printed maximum.",
         _trace_picture),
)  # fmt: skip
