"""A robot as lines with its frames, seen from above at an angle: one picture for each of several placements."""

from collections.abc import Sequence

import numpy as np

from lab.core.se3 import Array
from lab.render.charts.axes import Axes
from lab.render.document import Picture
from lab.render.style import ARM, FRAME_AXES
from lab.render.svg import axes_picture, cube

__all__ = ["placement_picture"]

_SIZE = (3.0, 3.0)  # inches
_AXIS = 0.07  # of the picture: how long a frame's axes are drawn
_TURNED, _RAISED = np.deg2rad(30.0), np.deg2rad(25.0)  # from where it is seen


def placement_picture(which: int, title: str, lines: Sequence[Array], frames: Array) -> Picture:
    """One placement, to the scale of all.

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
