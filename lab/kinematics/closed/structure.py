"""The structure of a mechanism with loops: a tree of elementary slides and hinges, closed by rods and pins.

Every value in the tree is a constant plus, where a joint moves it, the joint's position; or it is passive:
what the closures make it. A parameter is a joint that stands still during the campaign, so that constants,
joint positions and passive values have the same kind of derivative, an axis or an axis x lever.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

__all__ = ["BASE", "Frame", "Kind", "Pin", "Rod", "Step", "Tree"]

Kind = Literal["x", "y", "z", "rx", "ry", "rz"]
BASE = -1  # the frame that the tree stands on


@dataclass(frozen=True)
class Step:
    """One elementary motion: a slide along, or a turn about, an axis of the frame as the steps before have left it.

    Attributes:
        value: its constant (m, rad); of a passive step, where it stands in the nominal position.
        exact: whether the constant is taken for granted, and no parameter.
        joint: the one (from 0) whose position, times its sign, adds to the constant, its offset.
    """

    kind: Kind
    value: float
    exact: bool = False
    joint: int | None = None
    passive: bool = False

    @property
    def is_turn(self) -> bool:
        """Whether it turns."""
        return len(self.kind) == 2

    @property
    def axis(self) -> int:
        """0, 1 or 2 for x, y or z."""
        return "xyz".index(self.kind[-1])


@dataclass(frozen=True)
class Frame:
    """A frame that stands ``on`` another (its index, or ``BASE``), at the end of a path of steps."""

    name: str
    on: int
    path: tuple[Step, ...]


@dataclass(frozen=True)
class Rod:
    """A distance between the origins of two frames: a rod with ball ends, or a leg whose length a joint sets.

    Attributes:
        length_m: its constant; the offset of a joint's position, where a joint sets the length.
    """

    name: str
    ends: tuple[int, int]
    length_m: float
    exact: bool = False
    joint: int | None = None


@dataclass(frozen=True)
class Pin:
    """Two frames whose origins meet, along some of the base's axes (0, 1, 2): of a planar mechanism along two."""

    name: str
    ends: tuple[int, int]
    axes: tuple[int, ...]


class Opening(NamedTuple):
    """That a step (its frame, and where in the path) moves an end of a closure, the first (sign +1) or the second."""

    step: tuple[int, int]
    end: int
    sign: float


@dataclass(frozen=True)
class Tree:
    """Frames, each on an earlier one, what closes their loops, and the frame that carries the targets."""

    frames: tuple[Frame, ...]
    rods: tuple[Rod, ...]
    pins: tuple[Pin, ...]
    platform: int

    def __post_init__(self) -> None:
        assert 0 <= self.platform < len(self.frames)
        assert all(frame.on < i for i, frame in enumerate(self.frames))

    def step(self, frame: int, step: int) -> Step:
        """A step of a frame's path."""
        return self.frames[frame].path[step]

    @cached_property
    def passive(self) -> tuple[tuple[int, int], ...]:
        """Frame and step of each passive value."""
        return tuple((f, s) for f, frame in enumerate(self.frames) for s, step in enumerate(frame.path) if step.passive)

    @cached_property
    def column(self) -> dict[tuple[int, int], int]:
        """Which passive value a frame's step is."""
        return {step: i for i, step in enumerate(self.passive)}

    @property
    def equations(self) -> int:
        """How many numbers the closures make zero."""
        return len(self.rods) + sum(len(pin.axes) for pin in self.pins)

    @cached_property
    def constants(self) -> tuple[tuple[int, int], ...]:
        """Frame and step of each constant that is a parameter."""
        every = [(f, s) for f, frame in enumerate(self.frames) for s in range(len(frame.path))]
        return tuple((f, s) for f, s in every if not (self.step(f, s).exact or self.step(f, s).passive))

    @cached_property
    def lengths(self) -> tuple[int, ...]:
        """The rods whose length, or its offset, is a parameter."""
        return tuple(i for i, rod in enumerate(self.rods) if not rod.exact)

    def name_of(self, frame: int, step: int) -> str:
        """The name of a step's constant."""
        return f"{self.frames[frame].name}.{self.step(frame, step).kind}"

    def ancestry(self, frame: int) -> tuple[tuple[int, int], ...]:
        """Frame and step of every motion that moves a frame, the base's side first."""
        if frame == BASE:
            return ()
        own = tuple((frame, s) for s in range(len(self.frames[frame].path)))
        return (*self.ancestry(self.frames[frame].on), *own)

    @cached_property
    def loose(self) -> tuple[bool, ...]:
        """Of each frame, whether passive values move it."""
        return tuple(any(self.step(f, s).passive for f, s in self.ancestry(frame)) for frame in range(len(self.frames)))

    @cached_property
    def openings(self) -> tuple[tuple[Opening, ...], ...]:
        """What opens each closure: rods as they come, then the pins' axes.

        What moves both ends of a closure alike does not open it.
        """
        ends = [rod.ends for rod in self.rods] + [pin.ends for pin in self.pins for _ in pin.axes]
        found = []
        for a, b in ends:
            of_a, of_b = self.ancestry(a), self.ancestry(b)
            found.append(
                (
                    *(Opening(step, a, 1.0) for step in of_a if step not in of_b),
                    *(Opening(step, b, -1.0) for step in of_b if step not in of_a),
                )
            )
        return tuple(found)
