"""Arms of four joints with parallel axes, three of them hinges: x, y, z and the turn about z.

The slide may stand anywhere among the hinges, since it moves along their axes: it is what the height says (type 1).
The first two hinges are a planar arm (type 8), and the last one is what is left of the turn.
"""

from dataclasses import dataclass

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.robotics.inverse.first_three_joints import BEND
from lab.extensions.robotics.inverse.khalil_one_unknown import TINY, type_1
from lab.extensions.robotics.inverse.khalil_two_unknowns import type_8
from lab.kinematics.inverse.closed_form import (
    EXACT,
    Axes,
    Determinant,
    Solutions,
    determinant,
    in_plane,
    plane_across,
    real_part,
)
from lab.kinematics.serial.chain import Chain

__all__ = ["Scara"]


@dataclass(frozen=True)
class Scara:
    """Such an arm, by its axes in frame 0 at zero joint positions.

    Attributes:
        hinges, slide: which joints they are.
        up: ``(4,)`` 1 where an axis points as that of the first hinge does, else -1, times the joint position's sign.
        plane: ``(3, 3)`` rows e and f, across the axes, and w, along that of the first hinge.
        root: on it ``(3,)`` m.
        upper, fore: in the plane (m): the second hinge from the first one, and the third from the second.
        height: of the wrist over the root, along w (m), the slide drawn in.
        wrist: where the third hinge is ``(3,)`` in the last frame (m).
        R_frame0_last: rotation ``(3, 3)`` of the last frame.
    """

    chain: Chain
    hinges: tuple[int, ...]
    slide: int
    up: Array
    plane: Array
    root: Array
    upper: complex
    fore: complex
    height: float
    wrist: Array
    R_frame0_last: Array
    branches: int = 2
    by_point: bool = False
    exact_only: bool = False
    numbered: bool = True
    moved: str = "all displacements and the turn about the axes"

    @classmethod
    def of(cls, chain: Chain) -> "Scara | None":
        """The closed form of a nominal model; None where its shape is another."""
        if chain.size != 4 or sum(chain.prismatic) != 1:
            return None
        axes, slide = Axes.of(chain), chain.prismatic.index(True)
        hinges = tuple(i for i in range(4) if i != slide)
        if not all(axes.parallel(0, i) for i in range(1, 4)):
            return None
        root, elbow, wrist = axes.origins[list(hinges)]
        w = axes.directions[hinges[0]]
        plane = plane_across(w)
        upper, fore = in_plane(plane, elbow - root), in_plane(plane, wrist - elbow)
        if min(abs(upper), abs(fore)) < EXACT:
            return None
        return cls(
            chain=chain,
            hinges=hinges,
            slide=slide,
            up=np.sign(axes.directions @ w) * chain.sign,
            plane=plane,
            root=root,
            upper=upper,
            fore=fore,
            height=float(w @ (wrist - root)),
            wrist=se3.transform(se3.inverse(axes.T_frame0_last), wrist[None])[0],
            R_frame0_last=axes.T_frame0_last[:3, :3],
        )

    @property
    def determinant(self) -> Determinant:
        """Of x, y, z of the last hinge and the turn about w, in a right-handed frame whose z is w."""
        across = np.conj(self.upper) * self.fore / abs(self.upper)
        elbow = real_part(-1j * across, [(self.hinges[1], float(self.up[self.hinges[1]]))])
        sign = float(np.prod(self.up)) * (-1.0) ** self.slide  # the slide's column moved to the third place
        return determinant(self.chain.joint_names, sign, [abs(self.upper)], [("elbow", elbow)])

    def nearest_rotations(self, Rs_frame0_last: Array) -> Array:
        """See ``ClosedForm``: turned about w alone."""
        return self._at(self._turn(Rs_frame0_last)[0])

    def solve(self, Ts_frame0_last: Array, reference: Array | float = 0.0) -> Solutions:
        """See ``ClosedForm``. Where a pose is tilted its place is met, turned as near to it as can be."""
        count = len(Ts_frame0_last)
        yaw, tilt = self._turn(Ts_frame0_last[:, :3, :3])
        liked = np.broadcast_to(reference, (count, 4)) * self.up
        e, f, w = self.plane @ (Ts_frame0_last[:, :3, 3] + self._at(yaw) @ self.wrist - self.root).T
        bent = float(np.angle(self.upper))
        first, second, third = self.hinges
        (shoulder, elbow), gap, (free, _) = type_8(
            abs(self.upper), abs(self.fore), e, f, TINY, (liked[:, first] + bent, 0.0), BEND
        )
        joints = np.empty((count, 2, 4))
        joints[:, :, first] = (shoulder - bent).T
        joints[:, :, second] = (elbow + bent - np.angle(self.fore)).T
        joints[:, :, third] = yaw[:, None] - joints[:, :, first] - joints[:, :, second]
        hinges = list(self.hinges)
        joints[:, :, hinges] -= 2 * np.pi * np.round(joints[:, :, hinges] / (2 * np.pi))
        joints[:, :, self.slide] = type_1(1.0, w - self.height).values[0].T
        frees = np.zeros(joints.shape, dtype=np.bool_)
        frees[:, :, first] = free[:, None]
        shape = (count, 2)
        return Solutions(
            joints * self.up,
            np.broadcast_to(gap[:, None], shape).copy(),
            np.broadcast_to(tilt[:, None], shape).copy(),
            frees,
        )

    def _turn(self, Rs: Array) -> tuple[Array, Array]:
        """How far ``(n,)`` rad rotations are turned about w, and how far they are tilted then."""
        M = self.plane @ Rs @ self.R_frame0_last.T @ self.plane.T
        tilt = np.arctan2(np.hypot(M[:, 2, 0], M[:, 2, 1]), M[:, 2, 2])
        yaw = np.arctan2(M[:, 1, 0] - M[:, 0, 1], M[:, 0, 0] + M[:, 1, 1])
        return yaw, np.where(tilt <= EXACT, 0.0, tilt)

    def _at(self, yaw: Array) -> Array:
        """Rotations ``(n, 3, 3)`` of the last frame, turned about w."""
        return np.asarray(se3.exp(yaw[:, None] * self.plane[2]) @ self.R_frame0_last)
