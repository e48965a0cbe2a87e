"""Layout graph of a mechanism: which joints lie between which bodies, and the legs from the base to the platform.

Joints have a textbook's letters: R a hinge, P a slide, S a ball; a leg is named by them in order, like 3-RPS (Merlet
2006; Mallem 2011, section 11.4.4). Bodies and joints are those of Gruebler's count (``mobility.body_count``).
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

from lab.kinematics.closed.loop_closure import BASE, Tree
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
    most, count, body_of, joints = 3 if planar else 6, 0, list[int](), list[LayoutJoint]()

    def joined(kind: str, actuated: bool, to: int) -> int:
        """Add a body after another one, and the joint between them."""
        nonlocal count
        count += 1
        joints.append(LayoutJoint(kind, actuated, (to, count)))
        return count

    for frame in tree.frames:
        here = 0 if frame.on == BASE else body_of[frame.on]
        moving = [step for step in frame.path if step.passive or step.joint is not None]
        if frame.on == BASE and len(moving) == most and all(step.passive for step in moving):
            count += 1
            here = count
        else:
            for step in moving:
                here = joined("R" if step.is_turn else "P", step.joint is not None, here)
        body_of.append(here)
    ball = "R" if planar else "S"
    for rod in tree.rods:
        first, second = (body_of[end] for end in rod.ends)
        here = joined(ball, False, second)
        here = here if rod.joint is None else joined("P", True, here)
        joints.append(LayoutJoint(ball, False, (here, first)))
    for pin in tree.pins:
        freedoms = most - len(pin.axes)
        kind = _BY_FREEDOMS[planar].get(freedoms, str(freedoms))
        joints.append(LayoutJoint(kind, False, (body_of[pin.ends[0]], body_of[pin.ends[1]])))
    return Layout(tuple(joints), body_of[tree.platform])
