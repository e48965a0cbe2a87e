"""The direct model of the 3-RPR: a polynomial of degree six.

With z = exp(i phi) in place of t = tan(phi / 2) it needs no case for phi = pi: the modes are its roots on the unit
circle, and it loses degree only where two legs share a pin (Gosselin, Sefrioui & Richard 1992 have it in t).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.core.newton import newton
from lab.core.se3 import Array
from lab.extensions.robotics.closed.plane import as_sorted, cross, left, turned, wrapped

__all__ = ["Sextic"]

_MODES = 6  # at most
_SAMPLES = 8  # of a closure with harmonics up to the third
_NO_DEGREE = 1e-11  # of the largest coefficient: a leading one below it is none
_NEAR = 1e-3  # of | log |z| |, and of squared lengths: what misses by more is no mode
_CLOSED = 1e-14  # what a mode's squared lengths may miss
_SAME = 1e-6  # modes nearer to each other, also in rad, are one
_STEPS = 5  # of Newton; each leaves _DAMPING / (smallest singular value)^2 of what was missing
_DAMPING = 1e-13


class Sextic(NamedTuple):
    """Of n sets of lengths, what has to close. All lengths are divided by the robot's size.

    With q the leg 1, the others are q + v_i, v_i = R b_i - a_i. So q^2 = rho1^2 and q . v_i = c_i =
    (rho_i^2 - rho1^2 - v_i^2) / 2. By the latter q = N / D with N = left(c_2 v_3 - c_3 v_2) and D = v_2 x v_3, hence
    N^2 - rho1^2 D^2 = 0: in tan(phi / 2) of degree eight, less an exact factor 1 + t^2, as harmonics end at the third.

    Attributes:
        base: anchors a_i ``(n, 3, 2)`` from the first.
        platform: attachments b_i ``(n, 3, 2)`` from the first, in its frame.
        lengths: ``(n, 3)``.
    """

    base: Array
    platform: Array
    lengths: Array

    def modes(self) -> Array:
        """All q and phi ``(n, 6, 3)`` with these lengths, by rising phi between -pi and pi, then NaN."""
        angles = self.roots()
        both = np.empty((len(angles), _MODES, 2, 3))
        both[..., :2], both[..., 2] = self.points(angles), angles[..., None]
        starts = both.reshape(len(angles), 2 * _MODES, 3)
        found = np.full_like(starts, np.nan)
        row, place = np.nonzero(np.isfinite(starts).all(axis=2))
        found[row, place] = Sextic(*(each[row] for each in self)).polished(starts[row, place])
        return as_sorted(_without_repeats(as_sorted(found)))[:, :_MODES]

    def roots(self) -> Array:
        """Angles ``(n, 6)`` at which the legs close, or nearly; else NaN."""
        v, c = self.lines(np.broadcast_to(np.arange(_SAMPLES) * 2 * np.pi / _SAMPLES, (len(self.lengths), _SAMPLES)))
        N = c[..., :1] * v[..., 1, :] - c[..., 1:] * v[..., 0, :]
        D = cross(v[..., 0, :], v[..., 1, :])
        upper = np.fft.rfft((N**2).sum(axis=-1) - self.lengths[:, :1] ** 2 * D**2)[:, : _MODES // 2 + 1]
        coefficients = np.concatenate([upper[:, :0:-1].conj(), upper], axis=1)  # (n, 7) of z^0 to z^6
        size = np.abs(upper)
        present = np.isfinite(size) & (size > _NO_DEGREE * size.max(axis=1, keepdims=True))
        degree = np.where(present, np.arange(4), 0).max(axis=1)
        found = np.full((len(upper), _MODES), np.nan)
        for half in range(1, _MODES // 2 + 1):
            rows = np.flatnonzero(degree == half)
            p = coefficients[rows, _MODES // 2 - half : _MODES // 2 + half + 1]
            companion = np.zeros((len(rows), 2 * half, 2 * half), dtype=np.complex128)
            companion[:, 1:, :-1] = np.eye(2 * half - 1)
            companion[:, :, -1] = -p[:, :-1] / p[:, -1:]
            z = np.linalg.eigvals(companion)
            found[rows, : 2 * half] = np.where(np.abs(np.abs(z) - 1) < _NEAR, np.angle(z), np.nan)
        return found

    def lines(self, angles: Array) -> tuple[Array, Array]:
        """v_i ``(n, k, 2, 2)`` and c_i ``(n, k, 2)`` of legs 2 and 3 at angles ``(n, k)``."""
        v = turned(angles[..., None], self.platform[:, None, 1:]) - self.base[:, None, 1:]
        squares = self.lengths[:, None] ** 2
        return v, (squares[..., 1:] - squares[..., :1] - (v**2).sum(axis=-1)) / 2

    def points(self, angles: Array) -> Array:
        """Both q ``(n, k, 2, 2)`` at angles ``(n, k)``: on the circle and on the line of the longer v, so for all D."""
        v, c = self.lines(angles)
        squares = (v**2).sum(axis=-1)
        longer = np.where(squares[..., :1] >= squares[..., 1:], 0, 1)  # (n, k, 1)
        v = np.take_along_axis(v, longer[..., None], axis=2)[..., 0, :]
        c, square = (np.take_along_axis(each, longer, axis=2) for each in (c, squares))
        square = np.where(square == 0, 1.0, square)
        height = np.sqrt(np.maximum(self.lengths[:, None, :1] ** 2 / square - (c / square) ** 2, 0.0))
        foot, rise = c / square * v, height * left(v)
        return np.stack([foot + rise, foot - rise], axis=2)

    def polished(self, starts: Array) -> Array:
        """Each q and phi ``(n, 3)`` after damped Newton on (leg^2 - rho^2) / 2 = 0; NaN where that is not met."""

        def legs_at(found: Array) -> tuple[Array, Array, Array]:
            arms = turned(found[:, None, 2], self.platform)
            legs = found[:, None, :2] + arms - self.base
            return arms, legs, ((legs**2).sum(axis=2) - self.lengths**2) / 2

        def step(found: Array, rows: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
            arms, legs, missing = legs_at(found)
            slopes = np.concatenate([legs, cross(arms, legs)[..., None]], axis=2)
            across = slopes.swapaxes(1, 2)
            change = np.linalg.solve(across @ slopes + _DAMPING * np.eye(3), across @ missing[..., None])[..., 0]
            return -np.clip(change, -1.0, 1.0), np.zeros_like(rows)

        near = (np.abs(legs_at(starts)[2]) < _NEAR).all(axis=1, keepdims=True)
        found = newton(step, starts, _STEPS).values
        met = near & (np.abs(legs_at(found)[2]) < _CLOSED).all(axis=1, keepdims=True)
        found[:, 2] = wrapped(found[:, 2])
        return np.where(met, found, np.nan)


def _without_repeats(modes: Array) -> Array:
    """Modes ``(n, m, 3)``, NaN where one nearly is an earlier one."""
    apart = np.abs(modes[:, :, None] - modes[:, None])  # (n, m, m, 3)
    apart[..., 2] = np.abs(wrapped(apart[..., 2]))
    repeated = np.tril(np.all(apart < _SAME, axis=-1), -1).any(axis=2, keepdims=True)
    return np.where(repeated, np.nan, modes)
