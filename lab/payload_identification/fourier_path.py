"""Paths of the joints that are Fourier series, and the limits that they keep."""

from dataclasses import dataclass

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.serial.chain import Chain
from lab.pose_selection.tour import rated

__all__ = ["CHECKED", "HARMONICS", "PERIOD_S", "Box", "FourierPath", "Limits", "bases", "random_path", "rest_shapes"]

HARMONICS, PERIOD_S = 5, 5.0
_MARGIN = 0.02  # of a joint's range, kept from each limit
CHECKED = 1000  # times of a period at which limits, contacts and torques are looked at
_KEPT = 0.999  # of a limit of speed or acceleration: what may lie between those times


def bases(times: Array, period_s: float, harmonics: int) -> Array:
    """The functions of a Fourier series and their two derivatives by time, ``(3, n, 1 + 2 h)``."""
    rates = 2 * np.pi / period_s * np.arange(1, harmonics + 1)
    phase = np.outer(times, rates)
    one, cosine, sine = np.ones((len(times), 1)), np.cos(phase), np.sin(phase)
    return np.stack(
        [
            np.hstack([one, cosine, sine]),
            np.hstack([0 * one, -rates * sine, rates * cosine]),
            np.hstack([0 * one, -(rates**2) * cosine, -(rates**2) * sine]),
        ]
    )


def rest_shapes(harmonics: int) -> Array:
    """Orthonormal columns ``(1 + 2 h, 2 h - 1)`` of series that are at rest where a period begins and ends.

    A series whose speed and acceleration vanish there has coefficients with sum k s_k = 0 and sum k^2 c_k = 0 (e.g.
    Swevers, Verdonck & De Schutter 2007): what is orthogonal to those. The first column is the constant.
    """
    order = np.arange(1, harmonics + 1, dtype=np.float64)
    shapes = np.zeros((1 + 2 * harmonics, 2 * harmonics - 1))
    shapes[0, 0] = 1.0
    for i, moving in enumerate((order**2, order)):
        rows = slice(1 + i * harmonics, 1 + (i + 1) * harmonics)
        free = np.linalg.svd(moving[None])[2][1:].T
        shapes[rows, 1 + i * (harmonics - 1) : 1 + (i + 1) * (harmonics - 1)] = free
    return shapes


@dataclass(frozen=True)
class FourierPath:
    """A periodic path: each joint a constant and h harmonics.

    Attributes:
        coefficients: ``(1 + 2 h, J)`` rad or m: the middle, h cosines, h sines.
        period_s: of the first harmonic.
    """

    coefficients: Array
    period_s: float = PERIOD_S

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Readings, speeds and accelerations ``(n, J)`` at times ``(n,)`` s."""
        joints, speeds, accelerations = bases(times, self.period_s, len(self.coefficients) // 2) @ self.coefficients
        return joints, speeds, accelerations


@dataclass(frozen=True)
class Box:
    """Where a path may be: within ``half`` of ``middle``, ``(3, J)`` of readings, speeds and accelerations."""

    middle: Array
    half: Array

    def fitted(self, coefficients: Array, basis: Array) -> Array:
        """The path ``(1 + 2 h, J)``, each joint's motion as small and as shifted as the box demands."""
        motion = basis[:, :, 1:] @ coefficients[1:]  # (3, n, J)
        largest = np.abs(motion[1:]).max(axis=1) / (_KEPT * self.half[1:])
        span = np.ptp(motion[0], axis=0) / (2 * self.half[0])
        fitted = coefficients.copy()
        fitted[1:] /= np.maximum(1.0, np.maximum(span, largest.max(axis=0)))
        swing = basis[0][:, 1:] @ fitted[1:]
        least = self.middle[0] - self.half[0] - swing.min(axis=0)
        most = self.middle[0] + self.half[0] - swing.max(axis=0)
        fitted[0] = np.clip(fitted[0], least, np.maximum(least, most))
        return fitted


@dataclass(frozen=True)
class Limits:
    """What the joints may do, ``(J,)`` each in rad or m; infinite where there is no limit of a torque (Nm, N)."""

    lower: Array
    upper: Array
    speed: Array
    acceleration: Array
    torque: Array

    def __post_init__(self) -> None:
        for name in ("speed", "acceleration", "torque"):
            value = getattr(self, name)
            if not (value > 0).all() or (name != "torque" and not np.isfinite(value).all()):
                raise LabError(f"a path's largest {name} is {value}; give a number above zero for every joint")

    @property
    def box(self) -> Box:
        """The limits of readings, speeds and accelerations."""
        middle, still = (self.lower + self.upper) / 2, np.zeros_like(self.lower)
        half = np.array([(self.upper - self.lower) / 2, self.speed, self.acceleration])
        return Box(np.array([middle, still, still]), half)

    @classmethod
    def of(cls, chain: Chain, torque: Array | None = None, margin: float = _MARGIN) -> "Limits":
        """Those of a chain, a margin of each range kept; representative rates where it gives none (``tour.rated``)."""
        keep_off, known = margin * (chain.upper - chain.lower), rated(chain)[0]
        return cls(
            chain.lower + keep_off,
            chain.upper - keep_off,
            known.speed,
            known.acceleration,
            np.full(chain.size, np.inf) if torque is None else torque,
        )


def random_path(
    limits: Limits, rng: np.random.Generator, period_s: float = PERIOD_S, *, at_rest: bool = False
) -> FourierPath:
    """A path of random coefficients, each joint as fast and as far as its limits allow.

    Args:
        at_rest: whether each period begins and ends at rest.
    """
    order = np.arange(1, HARMONICS + 1)
    drawn = rng.standard_normal((1 + 2 * HARMONICS, len(limits.lower)))
    drawn[1:] *= 10 * limits.box.half[0] / np.concatenate([order, order])[:, None] ** rng.uniform(0.0, 2.0)
    drawn[0] = rng.uniform(limits.lower, limits.upper)
    if at_rest:
        shapes = rest_shapes(HARMONICS)
        drawn = shapes @ (shapes.T @ drawn)
    times = period_s * np.arange(CHECKED) / CHECKED
    return FourierPath(limits.box.fitted(drawn, bases(times, period_s, HARMONICS)), period_s)
