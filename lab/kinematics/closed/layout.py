"""Layout graph of a mechanism: which joints lie between which bodies, and the legs from the base to the platform.

Joints have a textbook's letters: R a hinge, P a slide, S a ball; a leg is named by them in order, like 3-RPS (Merlet
2006; Mallem 2011, section 11.4.4). Bodies and joints are those of Gruebler's count (``mobility.body_count``).
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

from lab.kinematics.closed.loop_closure import BASE, Frame, Tree
from lab.kinematics.closed.mobility import is_planar

__all__ = ["Layout", "LayoutJoint", "layout_of"]

_MOST_LEGS = 60  # paths that are followed; a mechanism with more is no set of legs
_BY_FREEDOMS = {False: {1: "R", 3: "S"}, True: {1: "R"}}  # of a pin, by planar


@dataclass(frozen=True)
class LayoutJoint:
    """A joint between two bodies, by their numbers; 0 is the base.

    Attributes:
        kind: R, P or S; of another pin the number of its freedoms.
        actuated: true if it is measured and driven.
    """

    kind: str
    actuated: bool
    bodies: tuple[int, int]

    @property
    def text(self) -> str:
        """Letter, underlined if the joint is actuated."""
        return f"{self.kind}\u0332" if self.actuated else self.kind


@dataclass(frozen=True)
class Layout:
    """Joints of a mechanism, and its platform's number among the bodies."""

    joints: tuple[LayoutJoint, ...]
    platform: int

    @property
    def legs(self) -> tuple[tuple[int, ...], ...]:
        """Paths from the base to the platform that meet no body twice, as indices of joints."""
        at = defaultdict[int, list[int]](list)
        for i, joint in enumerate(self.joints):
            for body in joint.bodies:
                at[body].append(i)

        def onward(body: int, passed: frozenset[int], path: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
            if body == self.platform:
                yield path
                return
            for i in at[body]:
                first, second = self.joints[i].bodies
                other = second if body == first else first
                if other not in passed:
                    yield from onward(other, passed | {other}, (*path, i))

        found = []
        for path in onward(0, frozenset({0}), ()):
            found.append(path)
            if len(found) == _MOST_LEGS:
                break
        return tuple(found)


def layout_of(tree: Tree) -> Layout:
    """Return the bodies and joints of a mechanism.

    A platform with all passive degrees of freedom is a free body; else the slides and hinges of its passive steps guide
    it, in place of parallelograms or of the plane of a point.
    """
    planar = is_planar(tree)
    most, bodies = 3 if planar else 6, _Bodies([], [])
    # frames: a body after each moving step
    for frame in tree.frames:
        bodies.add_frame(frame, most)
    # rods: a body between two balls, or two with a slide between them
    ball = "R" if planar else "S"
    for rod in tree.rods:
        first, second = (bodies.of_frame[end] for end in rod.ends)
        body = bodies.joined(ball, False, second)
        body = body if rod.joint is None else bodies.joined("P", True, body)
        bodies.joints.append(LayoutJoint(ball, False, (body, first)))
    # pins: a joint between two bodies
    for pin in tree.pins:
        freedoms = most - len(pin.axes)
        kind = _BY_FREEDOMS[planar].get(freedoms, str(freedoms))
        bodies.joints.append(LayoutJoint(kind, False, (bodies.of_frame[pin.ends[0]], bodies.of_frame[pin.ends[1]])))
    return Layout(tuple(bodies.joints), bodies.of_frame[tree.platform])


@dataclass
class _Bodies:
    """The bodies of a mechanism as they are counted: that of each frame, and the joints between them."""

    of_frame: list[int]
    joints: list[LayoutJoint]
    count: int = 0

    def joined(self, kind: str, actuated: bool, to: int) -> int:
        """Add a body after another one, and the joint between them."""
        self.count += 1
        self.joints.append(LayoutJoint(kind, actuated, (to, self.count)))
        return self.count

    def add_frame(self, frame: Frame, most: int) -> None:
        """Add the bodies of a frame: one after each moving step, or a free one with all passive freedoms."""
        body = 0 if frame.on == BASE else self.of_frame[frame.on]
        moving = [step for step in frame.path if step.moves]
        if frame.on == BASE and len(moving) == most and all(step.passive for step in moving):
            self.count += 1
            body = self.count
        else:
            for step in moving:
                body = self.joined("R" if step.is_turn else "P", step.joint is not None, body)
        self.of_frame.append(body)
