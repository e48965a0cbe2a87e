"""Inverse kinematics in closed form: six hinges whose last three axes meet, and whose axes 2 and 3 are parallel.

The wrist's centre is moved by joints 1 to 3 alone: an equation of type 2 for joint 1, one of type 8 for joints 2
and 3; what is left of the rotation is the wrist's, types 2, 3 and 3 (Pieper 1968; Khalil & Dombre 2002, section
4.3). Everything is worked out from the joints' axes at zero readings, so that the table's convention, the joints'
signs and their zeros do not matter. A vector is an array of three rows, a pose in each column.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lab import frames
from lab.frames import Array
from lab.geometry.chain import Chain
from lab.geometry.equations import type_2, type_3, type_8
from lab.geometry.serial import SerialArm

Number = TypeVar("Number", np.float64, np.bool_)
BRANCHES = 8
CHUNK = 1024  # poses at a time: what fits the processor's cache
BEND = 0.03  # rad, from the straight elbow: a start for Newton's method where the drawing does not reach
EXACT = 1e-9  # m or rad: by how much a drawing may miss the shape that is asked for
TINY = 1e-13  # m, or of a unit vector: a lever that turns nothing


@dataclass(frozen=True)
class Solutions:
    """All ways to reach some poses.

    Attributes:
        joints: ``(n, k, joints)`` readings, a hinge's between -pi and pi.
        gap_m: ``(n, k)`` how far the pose is out of reach, zero where it is reached; else the readings are those that
            come nearest, but for a bend of the elbow (``BEND``).
        free: ``(n, k, joints)``, joints that could have any reading, because the arm is singular there.
    """

    joints: Array
    gap_m: Array
    free: NDArray[np.bool_]


@dataclass(frozen=True)
class SphericalWrist:
    """An arm whose inverse has a closed form, by its axes in frame 0 at zero readings.

    Attributes:
        sign: ``(6,)`` of the joints' readings.
        column: axis 1 ``(3,)``, through ``root``.
        plane: ``(3, 3)`` rows e, f and w: two unit vectors across axis 2, and one along it.
        elbow: 1 where axis 3 points as axis 2 does, else -1.
        shoulder, upper, fore: in the plane as complex numbers (m): axis 2 from the root, axis 3 from axis 2, and
            the wrist's centre from axis 3.
        offset: the wrist's centre from the root, along w (m).
        wrist: ``(3, 3)`` rows a, b and c: along axes 4 and 5, and across both.
        bend: axis 6 is a cos(bend) + c sin(bend).
        centre: the wrist's centre ``(3,)`` in the last frame (m).
        R_frame0_last: rotation ``(3, 3)`` of the last frame.
    """

    sign: Array
    column: Array
    root: Array
    plane: Array
    elbow: float
    shoulder: complex
    upper: complex
    fore: complex
    offset: float
    wrist: Array
    bend: float
    centre: Array
    R_frame0_last: Array

    @classmethod
    def of(cls, chain: Chain) -> "SphericalWrist | None":
        """The closed form of a drawing; None where its shape has none."""
        if chain.size != 6 or any(chain.prismatic):
            return None
        arm = SerialArm(chain)
        moving = [motion for motion in arm.motions(arm.nominal()) if motion.joint is not None]
        z = np.array([motion.axis[:3, 0] for motion in moving])
        o = np.array([motion.origin[:3, 0] for motion in moving if motion.origin is not None])
        centre, missed = _meeting_point(o[3:], z[3:])
        parallel = np.linalg.norm(np.cross(z[1], z[2]))
        square = max(abs(z[3] @ z[4]), abs(z[4] @ z[5]))
        if max(missed, parallel, square) > EXACT or np.linalg.norm(np.cross(z[0], z[1])) < EXACT:
            return None
        across = np.cross(z[1], np.eye(3)[np.argmin(np.abs(z[1]))])
        e = across / np.linalg.norm(across)
        plane = np.array([e, np.cross(z[1], e), z[1]])
        shoulder, upper, fore = (complex(*(plane[:2] @ v)) for v in (o[1] - o[0], o[2] - o[1], centre - o[2]))
        if min(abs(upper), abs(fore)) < EXACT:
            return None
        wrist = np.array([z[3], z[4], np.cross(z[3], z[4])])
        T_frame0_last = arm.flange(np.zeros((1, 6)), arm.nominal())[0]
        return cls(
            sign=chain.sign,
            column=z[0],
            root=o[0],
            plane=plane,
            elbow=float(np.sign(z[1] @ z[2])),
            shoulder=shoulder,
            upper=upper,
            fore=fore,
            offset=float(z[1] @ (centre - o[0])),
            wrist=wrist,
            bend=float(np.arctan2(wrist[2] @ z[5], wrist[0] @ z[5])),
            centre=frames.transform(frames.inverse(T_frame0_last), centre[None])[0],
            R_frame0_last=T_frame0_last[:3, :3],
        )

    def solve(self, Ts_frame0_last: Array, reference: Array | float = 0.0) -> Solutions:
        """All eight solutions for poses ``(n, 4, 4)`` of the last frame in frame 0.

        Args:
            reference: readings ``(n, 6)`` that a free joint takes.
        """
        count = len(Ts_frame0_last)
        liked = np.broadcast_to(reference, (count, 6)) * self.sign
        angles, gap = np.empty((6, 2, 2, 2, count)), np.empty((2, 2, 2, count))
        free = np.zeros((6, 2, 2, 2, count), dtype=np.bool_)
        for start in range(0, count, CHUNK):
            part = slice(start, start + CHUNK)
            self._solve(Ts_frame0_last[part], liked[part].T, angles[..., part], gap[..., part], free[..., part])
        angles -= 2 * np.pi * np.round(angles / (2 * np.pi))
        angles *= self.sign.reshape(6, 1, 1, 1, 1)
        return Solutions(_by_pose(angles), gap.reshape(BRANCHES, count).T, _by_pose(free))

    def _solve(self, Ts: Array, liked: Array, angles: Array, gap: Array, free: NDArray[np.bool_]) -> None:
        """Fill in the angles ``(6, 2, 2, 2, n)``: roots of the wrist's, the elbow's and the shoulder's equation."""
        R = Ts[:, :3, :3].transpose(1, 2, 0)  # (3, 3, n)
        place = _turned(R, self.centre) + Ts[:, :3, 3].T - self.root[:, None]
        along, perpendicular, quarter = self._about_column(place)
        angles[0], gap_1, free[0] = type_2(
            -quarter[2], perpendicular[2], self.offset - along[2], TINY, liked[0]
        )  # w . Rot(column, -q1) p = offset
        first = angles[0, 0, 0]  # (2, n), the same for all roots that follow
        cos_1, sin_1 = np.cos(first), np.sin(first)

        def before_first(vector: Array) -> list[Array]:
            """A vector turned back by joint 1, in the plane's coordinates."""
            parts = zip(*self._about_column(vector), strict=True)
            return [fixed + cos_1 * level - sin_1 * ahead for fixed, level, ahead in parts]

        ahead = before_first(place)
        shoulder, elbow, gap_8, free[1] = type_8(
            abs(self.upper),
            abs(self.fore),
            ahead[0] - self.shoulder.real,
            ahead[1] - self.shoulder.imag,
            TINY,
            liked[1] + np.angle(self.upper),
            BEND,
        )
        angles[1] = shoulder - np.angle(self.upper)
        angles[2] = self.elbow * (elbow + np.angle(self.upper) - np.angle(self.fore))
        gap[:] = np.maximum(gap_1, gap_8)
        lifted = shoulder + elbow - np.angle(self.fore)  # the turn about w of joints 2 and 3 together
        cos_w, sin_w = np.cos(lifted), np.sin(lifted)

        def in_wrist(direction: Array) -> list[Array]:
            """Where the hand takes a direction of the arm at zero, in the wrist's coordinates."""
            e, f, w = before_first(_turned(R, self.R_frame0_last.T @ direction))
            turned = (cos_w * e + sin_w * f, cos_w * f - sin_w * e, w)
            return [_sum(row, turned) for row in self.wrist @ self.plane.T]

        axis_6 = np.cos(self.bend) * self.wrist[0] + np.sin(self.bend) * self.wrist[2]
        a6, b6, c6 = in_wrist(axis_6)
        a5, b5, c5 = in_wrist(self.wrist[1])
        angles[3], _, free[3] = type_2(c6, b6, 0.0, TINY, liked[3])  # b . Rot(a, -q4) axis 6 = 0
        cos_4, sin_4 = np.cos(angles[3]), np.sin(angles[3])
        sin_5 = b6 * sin_4 - c6 * cos_4
        angles[4] = self.bend + type_3(sin_5, a6)
        angles[5] = type_3(sin_5 * a5 + a6 * (c5 * cos_4 - b5 * sin_4), b5 * cos_4 + c5 * sin_4)

    def _about_column(self, vector: Array) -> tuple[Array, Array, Array]:
        """Of a vector ``(3, n)`` the parts along and across axis 1, and the latter turned by 90°; in the plane."""
        along = np.outer(self.column, self.column)
        parts = (along, np.eye(3) - along, frames.skew(self.column))
        first, second, third = (self.plane @ part @ vector for part in parts)
        return first, second, third


def _by_pose(values: NDArray[Number]) -> NDArray[Number]:
    """Values ``(6, 2, 2, 2, n)`` as ``(n, 8, 6)``."""
    return values.reshape(len(values), BRANCHES, -1).transpose(2, 1, 0)


def _meeting_point(origins: Array, axes: Array) -> tuple[Array, float]:
    """The point ``(3,)`` nearest to some lines, and how far the farthest one misses it."""
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    point = np.linalg.lstsq(across.reshape(-1, 3), (across @ origins[:, :, None]).ravel(), rcond=None)[0]
    return np.asarray(point, dtype=np.float64), float(
        np.linalg.norm(across @ (point - origins)[:, :, None], axis=1).max()
    )


def _turned(R: Array, vector: Array) -> Array:
    """A vector ``(3,)`` turned by each of the rotations ``(3, 3, n)``."""
    return np.stack([_sum(vector, row) for row in R])


def _sum(weights: Array, rows: Sequence[Array]) -> Array:
    """A weighed sum, without what has no weight."""
    used = [weight * row for weight, row in zip(weights, rows, strict=True) if abs(weight) > TINY]
    total: Array = sum(used[1:], start=used[0]) if used else 0.0 * rows[0]
    return total
