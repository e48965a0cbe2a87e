"""Chapter II: the five observability indices and the ellipsoid of errors (equations II.1 to II.9, figure II.1)."""

from functools import cache

import numpy as np

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.reproduction.answer import Answer, holds
from lab.extensions.reproduction.item import Item
from lab.extensions.reproduction.thesis_case import OFF, thesis_case
from lab.pose_selection.criteria import indices
from lab.render.charts.axes import Axes
from lab.render.document import Picture
from lab.render.style import AFTER, INK, MUTED
from lab.render.svg import axes_picture

__all__ = ["INDEX_ITEMS"]


@cache
def _jacobian() -> Array:
    """Of 20 random poses ``(20, 3, 19)``, mm and rad."""
    case = thesis_case()
    joints = case.arm.chain.random_joints(20, rng_for(0, "structure"))
    return np.asarray(1e3 * case.arm.observe(joints, case.nominal)[1][:, 0][..., list(case.free)] / case.mm)


def _bounds() -> tuple[Answer, ...]:
    """II.1 to II.4 at random errors."""
    J = _jacobian().reshape(-1, len(OFF))
    u, s, vt = np.linalg.svd(J, full_matrices=False)
    errors = rng_for(0, "arm").normal(size=(len(OFF), 1000))
    ratio = np.linalg.norm(J @ errors, axis=0) / np.linalg.norm(errors, axis=0)
    beyond = max(float(s[-1] - ratio.min()), float(ratio.max() - s[0]), 0.0)
    return (
        holds("II.2 J = U Σ V'", float(np.abs(u * s @ vt - J).max() / s[0])),
        holds("II.4 the least σ ≤ |dX|/|Δ| ≤ the largest σ", beyond),
    )


def _indices() -> tuple[Answer, ...]:
    """II.5 to II.9 from the eigenvalues of J'J, beside the lab's from its singular values."""
    J = _jacobian()
    flat = J.reshape(-1, len(OFF))
    s = np.sqrt(np.linalg.eigvalsh(flat.T @ flat)[::-1])
    ours = indices(J)
    printed = {
        "II.5 O1": (np.prod(s) ** (1 / len(s)) / np.sqrt(len(J)), ours.o1), "II.6 O2": (s[-1] / s[0], ours.o2),
        "II.7 O3": (s[-1], ours.o3), "II.8 O4": (s[-1] ** 2 / s[0], ours.o4),
        "II.9 O5": (1 / (1 / s).sum(), ours.o5),
    }  # fmt: skip
    return tuple(
        holds(name, abs(float(mine) / float(theirs) - 1), within=1e-6) for name, (theirs, mine) in printed.items()
    )


def _ellipse() -> tuple[Picture, ...]:
    """What unit errors of two parameters do to one target: an ellipse whose half axes are singular values."""
    case = thesis_case()
    columns = [list(OFF).index(name) for name in ("link2.a", "link4.d")]
    J = _jacobian()[0][:, columns]
    u, s, _ = np.linalg.svd(J, full_matrices=False)
    turn = np.linspace(0, 2 * np.pi, 200)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    across = u.T @ J
    assert case.arm.chain.size == 6

    def draw(axes: Axes) -> None:
        axes.plot(*circle, "-", color=MUTED, linewidth=1.2)
        axes.plot(*(across @ circle), "-", color=AFTER, linewidth=1.6)
        for i, size in enumerate(s):
            axes.annotate(f"σ{i + 1} = {size:.3f}", 0.5 * size * np.eye(2)[i] + 0.05, color=INK, fontsize=8)
            axes.plot(*np.stack([np.zeros(2), size * np.eye(2)[i]], axis=1), "-", color=INK, linewidth=1)
        axes.set_aspect("equal")
        axes.set(xlabel="along the first left singular vector, mm", ylabel="along the second, mm")

    label = "A unit circle of errors of a2 and d4, and the ellipse of errors of the point"
    return (axes_picture("ellipse", label, (4.2, 3.6), draw),)


INDEX_ITEMS = (
    Item("Equations II.1 to II.4", "Singular values bound the errors", _bounds, "lab inspect irb120",
         "At 20 random poses and 1,000 random errors of the 19 parameters."),
    Item("Figure II.1", "The ellipsoid of errors", command="lab calibrate --robot irb120 --prior off --out ellipsoids",
         note="Two parameters of one pose: the circle of unit errors (a2, d4; mm) becomes an ellipse (mm). Every run's "
         "report and recording has the ellipsoids of its own poses.", pictures=_ellipse),
    Item("Equations II.5 to II.9", "The indices O1 to O5", _indices, "lab design --robot irb120 --criterion O1",
         "From the eigenvalues of J'J here, and from singular values in the lab."),
)  # fmt: skip
