"""An arm as lines: what pictures draw of it, and how far it is from somewhere."""

from dataclasses import dataclass

from lab.core.se3 import Array

__all__ = ["Skeleton"]


@dataclass(frozen=True)
class Skeleton:
    """An arm as lines at each of ``n`` rows of joint positions, in the frame of its base (m).

    Attributes:
        lines: ``(n, c, 3)`` each: one along a chain, with its corners; one along each leg of a mechanism.
        frame_lines: ``(n, f, 3)`` each: the same from frame to frame.
        frames: ``(n, f, 3)`` the frames on the lines, last the one that carries the targets.
        origins: ``(n, f, 3)`` all frames, from the base's own outward to the one that carries the targets.
        rods: ``(n, rods, 2, 3)`` the ends of a mechanism's rods, and of legs whose length is a joint position, the
            base's side first; the four sides where a rod stands for a parallelogram, the long ones first.
        measured: of each rod, whether its length is a joint position.
    """

    lines: list[Array]
    frame_lines: list[Array]
    frames: Array
    origins: Array
    rods: Array
    measured: tuple[bool, ...]
