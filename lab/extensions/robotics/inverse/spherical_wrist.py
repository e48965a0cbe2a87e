"""Arms of six joints whose last three axes meet at right angles, each to the next, whatever carries them.

The wrist's centre is moved by joints 1 to 3 alone (``carriers``); what is left of the rotation is the wrist's, by
equations of types 2, 3 and 3 (Pieper 1968; Khalil & Dombre 2002, section 4.3). Everything is worked out from the
joints' axes at zero joint positions, so that the table's convention, its signs and zeros do not matter. A vector
is an array of three rows, a pose in each column.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.robotics.inverse.first_joint import Carried, Carrier
from lab.extensions.robotics.inverse.first_three_joints import Elbow, Lift, Telescope
from lab.extensions.robotics.inverse.khalil_one_unknown import TINY, type_2
from lab.kinematics.compiled.kernels import machine_code
from lab.kinematics.inverse.closed_form import EXACT, Axes, Determinant, Solutions, Term, determinant, meeting_point
from lab.kinematics.serial.chain import Chain

__all__ = ["SphericalWrist"]

Number = TypeVar("Number", np.float64, np.bool_)
CHUNK = 1024  # poses at a time: what fits the processor's cache


@dataclass(frozen=True)
class SphericalWrist:
    """Such an arm, by its axes in frame 0 at zero joint positions.

    Attributes:
        carrier: joints 1 to 3.
        axes: ``(3, 3)`` rows a, b and c: along axes 4 and 5, and across both.
        bend: axis 6 is a cos(bend) + c sin(bend).
        centre: the wrist's centre ``(3,)`` in the last frame (m).
        R_frame0_last: rotation ``(3, 3)`` of the last frame.
    """

    chain: Chain
    carrier: Carrier
    axes: Array
    bend: float
    centre: Array
    R_frame0_last: Array
    by_point: bool = False
    exact_only: bool = False
    numbered: bool = True
    moved: str = "the displacements of the wrist's centre and all turns"

    @classmethod
    def of(cls, chain: Chain) -> "SphericalWrist | None":
        """The closed form of a nominal model; None where its shape has none."""
        if chain.size != 6 or any(chain.prismatic[3:]):
            return None
        joint_axes = Axes.of(chain)
        z = joint_axes.directions
        centre, missed = meeting_point(joint_axes.origins[3:], z[3:])
        if missed > EXACT or not joint_axes.square(3, 4) or not joint_axes.square(4, 5):
            return None
        carrier = Elbow.of(joint_axes, centre) or Telescope.of(joint_axes, centre) or Lift.of(joint_axes, centre)
        if carrier is None:
            return None
        axes = np.array([z[3], z[4], np.cross(z[3], z[4])])
        T = joint_axes.T_frame0_last
        return cls(
            chain=chain,
            carrier=carrier,
            axes=axes,
            bend=float(np.arctan2(axes[2] @ z[5], axes[0] @ z[5])),
            centre=se3.transform(se3.inverse(T), centre[None])[0],
            R_frame0_last=T[:3, :3],
        )

    @property
    def branches(self) -> int:
        """Roots of the wrist's, the elbow's and joint 1's equations."""
        return 2 * self.carrier.elbows * 2

    @property
    def determinant(self) -> Determinant:
        """Of the geometric Jacobian at the wrist's centre: the carrier's times that of the wrist's three axes."""
        sign, lengths, factors = self.carrier.factors(self.chain.sign)
        s5 = float(self.chain.sign[4])
        wrist = [
            Term(-s5 * float(np.cos(self.bend)), "sin", ((4, 1.0),)),  # sin(bend - angle 5)
            Term(float(np.sin(self.bend)), "cos", ((4, 1.0),)),
        ]
        product = [factors[0], ("wrist", wrist), *factors[1:]]
        return determinant(self.chain.joint_names, sign * float(np.prod(self.chain.sign)), lengths, product)

    def nearest_rotations(self, Rs_frame0_last: Array) -> Array:
        """See ``ClosedForm``: six joints take any rotation."""
        return Rs_frame0_last

    def solve(self, Ts_frame0_last: Array, reference: Array | float = 0.0) -> Solutions:
        """See ``ClosedForm``."""
        if self._numbers is not None and (code := machine_code()) is not None and Ts_frame0_last.dtype == np.float64:
            return self._compiled(code, self._numbers, Ts_frame0_last, reference)
        count, shape = len(Ts_frame0_last), (2, self.carrier.elbows, 2)
        liked = np.broadcast_to(reference, (count, 6)) * self.chain.sign
        angles, gap = np.empty((6, *shape, count)), np.empty((*shape, count))
        free = np.zeros((6, *shape, count), dtype=np.bool_)
        for start in range(0, count, CHUNK):
            part = slice(start, start + CHUNK)
            self._solve(Ts_frame0_last[part], liked[part].T, angles[..., part], gap[..., part], free[..., part])
        for i in np.flatnonzero(~np.array(self.chain.prismatic)):
            angles[i] -= 2 * np.pi * np.round(angles[i] / (2 * np.pi))
        angles *= self.chain.sign.reshape(6, 1, 1, 1, 1)
        tilt = np.zeros((count, self.branches))
        return Solutions(_by_pose(angles), gap.reshape(self.branches, count).T, tilt, _by_pose(free))

    @cached_property
    def _numbers(self) -> Array | None:
        """What the compiled solution asks of an arm with an elbow; None of another."""
        carrier = self.carrier
        if not isinstance(carrier, Elbow):
            return None
        column, back = carrier.column, self.R_frame0_last.T
        axis_6 = np.cos(self.bend) * self.axes[0] + np.sin(self.bend) * self.axes[2]
        links = [(abs(z), np.angle(z)) for z in (carrier.upper, carrier.fore)]
        parts = (
            self.chain.sign, self.centre, column.root, column.parts, self.axes @ column.plane.T, back @ self.axes[1],
            back @ axis_6, [self.bend, carrier.offset, carrier.shoulder.real, carrier.shoulder.imag],
            links, [carrier.turning],
        )  # fmt: skip
        return np.concatenate([np.ravel(part).astype(np.float64) for part in parts])

    def _compiled(self, code: ModuleType, numbers: Array, Ts: Array, reference: Array | float) -> Solutions:
        """``solve`` of an arm with an elbow, in machine code."""
        n = len(Ts)
        joints, gap, free = np.empty((n, 8, 6)), np.empty((n, 8)), np.empty((n, 8, 6), dtype=np.bool_)
        liked = None
        if not isinstance(reference, float) or reference != 0.0:
            liked = np.ascontiguousarray(np.broadcast_to(reference, (n, 6)), dtype=np.float64)
        code.inverse(numbers, np.ascontiguousarray(Ts), liked, joints, gap, free)
        return Solutions(joints, gap, np.zeros((n, 8)), free)

    def _solve(self, Ts: Array, liked: Array, angles: Array, gap: Array, free: NDArray[np.bool_]) -> None:
        """Fill in the angles ``(6, 2, elbows, 2, n)``: roots of the wrist's, the elbow's and joint 1's equation."""
        R = Ts[:, :3, :3].transpose(1, 2, 0)  # (3, 3, n)
        position = _turned(R, self.centre) + Ts[:, :3, 3].T
        carried = self.carrier.solve(position, liked[:3], angles[:3], gap, free[:3])
        self._turn(R, carried, liked[3:], angles[3:], free[3:])

    def _turn(self, R: Array, carried: Carried, liked: Array, angles: Array, free: NDArray[np.bool_]) -> None:
        """Fill in the wrist's angles ``(3, 2, elbows, 2, n)``."""
        rows = self.axes @ self.carrier.column.plane.T

        def in_wrist(direction: Array) -> list[Array]:
            """Where the hand takes a direction of the arm at zero, along a, b and c."""
            back = carried.back(_turned(R, self.R_frame0_last.T @ direction))
            return [_sum(row, back) for row in rows]

        axis_6 = np.cos(self.bend) * self.axes[0] + np.sin(self.bend) * self.axes[2]
        a6, b6, c6 = in_wrist(axis_6)
        a5, b5, c5 = in_wrist(self.axes[1])
        (angles[0],), _, (free[0],) = type_2(c6, b6, 0.0, TINY, liked[0])  # b . Rot(a, -q4) axis 6 = 0
        cos_4, sin_4 = np.cos(angles[0]), np.sin(angles[0])
        sin_5 = b6 * sin_4 - c6 * cos_4
        angles[1] = self.bend + np.arctan2(sin_5, a6)  # type 3, as is the next
        angles[2] = np.arctan2(sin_5 * a5 + a6 * (c5 * cos_4 - b5 * sin_4), b5 * cos_4 + c5 * sin_4)


def _by_pose(values: NDArray[Number]) -> NDArray[Number]:
    """Values ``(6, 2, elbows, 2, n)`` as ``(n, branches, 6)``."""
    return values.reshape(len(values), -1, values.shape[-1]).transpose(2, 1, 0)


def _turned(R: Array, vector: Array) -> Array:
    """A vector ``(3,)`` turned by each of the rotations ``(3, 3, n)``."""
    return np.stack([_sum(vector, row) for row in R])


def _sum(weights: Array, rows: Sequence[Array]) -> Array:
    """A weighed sum, without what has no weight."""
    used = [weight * row for weight, row in zip(weights, rows, strict=True) if abs(weight) > TINY]
    total: Array = sum(used[1:], start=used[0]) if used else 0.0 * rows[0]
    return total
