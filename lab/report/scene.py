"""Scene data of every recording, as arrays in the world: which poses are drawn, legs, magnified ellipsoids."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.model import RigidArm, Skeleton
from lab.prediction.ellipsoids import Ellipsoids
from lab.report.charts.chart import axes_picture, cube
from lab.report.charts.marks import Axes
from lab.report.document import Picture, Strong, Text
from lab.report.style import ARM, FRAME_AXES

__all__ = [
    "LARGEST_FACTOR", "MOST_POSES", "Legs", "MagnifiedEllipsoids", "drawn_rows", "error_factor", "legs_legend",
    "magnification", "magnified", "mean_lengths", "moved", "placement_picture", "reach_of", "skeleton", "world_legs",
]  # fmt: skip


@dataclass(frozen=True)
class Legs:
    """Lines of a mechanism that belong to no body: its rods, and legs whose length is a joint position."""

    ends: Array  # (n, legs, 2, 3) m, the base's side first; a serial arm has none
    measured: tuple[bool, ...]  # of each leg, whether its length is a joint position


def skeleton(arm: RigidArm, values: Array, joints: Array) -> Skeleton:
    """The arm with parameters ``values`` ``(p,)`` as lines at joint positions ``(n, joints)``."""
    return arm.skeleton(joints, np.concatenate([np.zeros(6), values[6:]]))


MOST_POSES = 300  # whose bodies, points and ellipsoids are drawn
LARGEST_FACTOR = 1e6  # of error arrows: what is still too short to be seen is nothing
_ARROW = 0.15  # of the reach: how long the mean error is drawn
_HALF_AXIS = 0.11  # of the reach: the longest half-axis of an ellipsoid as drawn, in the median over the poses


@dataclass(frozen=True)
class MagnifiedEllipsoids:
    """Ellipsoids in the world, one for each drawn pose, magnified."""

    centers: Array  # (m, 3) m
    axes: Array  # (m, 3, 3), columns unit and right-handed
    half_sizes: Array  # (m, 3), descending, times factor
    factor: float


def drawn_rows(count: int) -> NDArray[np.int_]:
    """Return all rows, or ``MOST_POSES`` of them evenly spaced from the first to the last."""
    if count <= MOST_POSES:
        return np.arange(count)
    return np.round(np.linspace(0, count - 1, MOST_POSES)).astype(np.int_)


def magnification(length: float, wanted: float) -> float:
    """The factor out of 1, 2, 5 times a power of ten that draws ``length`` nearest to ``wanted``; 1 for nothing."""
    if not (np.isfinite(length) and length > 0):
        return 1.0
    power = np.log10(wanted / length)
    steps = [(float(mantissa), int(np.floor(power)) + ten) for ten in (0, 1) for mantissa in (1, 2, 5)]
    mantissa, ten = min(steps, key=lambda step: abs(np.log10(step[0]) + step[1] - power))
    return float(f"{mantissa}e{ten}")


def error_factor(lengths: Array, reach_m: float) -> float:
    """Return the round factor, 1 or more, that draws arrows of a mean length (m, NaN left out) in view of the reach."""
    known = lengths[np.isfinite(lengths)]
    mean = float(known.mean()) if len(known) else 0.0
    return min(max(magnification(mean, _ARROW * reach_m), 1.0), LARGEST_FACTOR)


def magnified(shapes: Ellipsoids, centers: Array, T_world_instrument: Array, reach_m: float) -> MagnifiedEllipsoids:
    """Ellipsoids given in the instrument's frame, in the world, magnified by a round factor."""
    factor = magnification(float(np.median(shapes.half_lengths[:, 0])), _HALF_AXIS * reach_m)
    return MagnifiedEllipsoids(centers, T_world_instrument[:3, :3] @ shapes.axes, factor * shapes.half_lengths, factor)


def mean_lengths(vectors: Array) -> Array:
    """Mean length ``(m,)`` of those of the vectors ``(m, k, 3)`` that are not NaN; NaN where all are."""
    lengths = np.linalg.norm(vectors, axis=2)
    finite = np.isfinite(lengths)
    count = np.where(finite.any(axis=1), finite.sum(axis=1), np.nan)
    return np.asarray(np.where(finite, lengths, 0.0).sum(axis=1) / count)


def moved(T_a_b: Array, points: Array) -> Array:
    """Points ``(…, 3)`` given in b, in a."""
    return se3.transform(T_a_b, points.reshape(-1, 3)).reshape(points.shape)


def world_legs(T_world_frame0: Array, arm: RigidArm, values: Array, joints: Array) -> Legs:
    """The legs of an arm, in the world."""
    lines = skeleton(arm, values, joints)
    return Legs(moved(T_world_frame0, lines.rods), lines.measured)


def reach_of(T_world_frame0: Array, points: Array, between: Legs) -> float:
    """Return the largest distance (m) of points ``(…, 3)`` and legs' ends, in the world, from frame 0."""
    every = np.concatenate([points.reshape(-1, 3), between.ends.reshape(-1, 3)])
    return float(np.linalg.norm(every - T_world_frame0[:3, 3], axis=1).max())


def legs_legend(legs: Legs) -> Text:
    """Return the legend of a mechanism's lines; empty for an arm without legs."""
    kinds = {True: (Strong("orange"), ": legs whose length is a joint position"), False: (Strong("grey"), ": rods")}
    parts = [words for kind, words in kinds.items() if kind in legs.measured]
    joined = [part for words in parts for part in ("; ", *words)][1:]
    return ("lines of the robot, ", *joined) if joined else ""


_SIZE = (3.0, 3.0)  # inches
_AXIS = 0.07  # of the picture: how long a frame's axes are drawn
_TURNED, _RAISED = np.deg2rad(30.0), np.deg2rad(25.0)  # from where it is seen


def placement_picture(which: int, title: str, lines: Sequence[Array], frames: Array) -> Picture:
    """Draw a placement, at the scale common to all.

    Args:
        which: of the placements it is, from 0.
        title: above it.
        lines: ``(n, c, 3)`` m each.
        frames: ``(n, f, 4, 4)`` m, whose axes are drawn.
    """
    every = [_seen(line) for line in lines]
    middle, half = cube([np.pad(each, ((0, 0), (0, 0), (0, 1))) for each in (*every, _seen(frames[..., :3, 3]))], 0.16)

    def draw(axes: Axes) -> None:
        for line in every:
            axes.plot(*line[which].T, "-", color=ARM, linewidth=2.5, solid_capstyle="round", zorder=1)
        for T in frames[which]:
            origin = _seen(T[:3, 3])
            for axis, colour in zip(T[:3, :3].T, FRAME_AXES, strict=True):
                end = _seen(T[:3, 3] + 2 * _AXIS * half * axis)
                axes.plot(*np.stack([origin, end], axis=1), "-", color=colour, linewidth=1.1, zorder=2)
        axes.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half))
        axes.set_aspect("equal")
        axes.axis("off")
        axes.set(title=title)

    return axes_picture(f"placement-{which}", f"Placement {title}", _SIZE, draw, (0.05, 0.05, 0.05, 0.3))


def _seen(points: Array) -> Array:
    """Points ``(..., 3)`` on the picture's plane ``(..., 2)``, without perspective."""
    x, y, z = np.moveaxis(points, -1, 0)
    across = np.cos(_TURNED) * y - np.sin(_TURNED) * x
    along = np.cos(_TURNED) * x + np.sin(_TURNED) * y
    return np.stack([across, np.cos(_RAISED) * z - np.sin(_RAISED) * along], axis=-1)
