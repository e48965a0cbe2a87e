"""Joints of serial chains and mechanisms: names, kinds, directions, limits, encoders.

A drive turns G (C q) at joint positions q: gear ratios G on the diagonal, couplings C with unit diagonal (a wrist whose
joints 5 and 6 share their drives, Khalil & Dombre 2002, section 2.4). A controller that counts a drive's turns reports
q' = (N G C)^-1 round(N G C q), N counts per radian of the motors. Couplings and gains are nominal; errors of the arm
are effects (``effects.coupling``, ``Gear``).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.limits import JOINT_SPAN
from lab.core.se3 import Array
from lab.core.units import DEGREES, MM, Unit

__all__ = ["Encoders", "JointSpec"]


@dataclass(frozen=True)
class Encoders:
    """Encoders at the motors of n joints.

    Attributes:
        gear_ratio: ``(n,)`` signed turns of each motor per turn of its joint (rad per m of a slide).
        couplings: ``(n, n)`` turns of each drive by the joints' positions, as its own joint feels them: unit diagonal.
        counts_per_turn: ``(n,)`` of the motors.
    """

    gear_ratio: Array
    couplings: Array
    counts_per_turn: Array

    def __post_init__(self) -> None:
        if not (np.isfinite(self.counts).all() and np.linalg.matrix_rank(self.couplings) == len(self.couplings)):
            raise LabError("encoders: the couplings of the drives cannot be told apart: give ratios of another motor")

    @property
    def counts(self) -> Array:
        """Counts ``(n, n)`` of each encoder per radian (or metre) of each joint."""
        return (self.counts_per_turn * self.gear_ratio / (2 * np.pi))[:, None] * self.couplings

    def rounded(self, joints: Array) -> Array:
        """Return joint positions ``(m, n)`` rounded to whole counts."""
        counts = self.counts
        return np.asarray(np.round(joints @ counts.T) @ np.linalg.inv(counts).T)

    @property
    def covariance(self) -> Array:
        """Covariance ``(n, n)`` of rounded joint positions (rad, m): uniform errors of up to half a count."""
        per_count = np.linalg.inv(self.counts)
        return np.asarray(per_count @ per_count.T / 12)


@dataclass(frozen=True, kw_only=True)
class JointSpec:
    """Nominal joints of a robot.

    Attributes:
        sign: ``(n,)``, +1 or -1, direction of each joint's position.
        lower, upper: ``(n,)`` limits of the joint positions, rad or m.
        speed, acceleration: ``(n,)`` limits, rad or m per s or s^2; NaN if unknown.
        given_home: ``(n,)`` home joint positions, if given.
        encoders: None for ideal ones.
        gear_ratio: ``(n,)`` turns of each motor per turn of its joint (rad per m of a slide), or None.
    """

    name: str
    joint_names: tuple[str, ...]
    prismatic: tuple[bool, ...]
    sign: Array
    lower: Array
    upper: Array
    speed: Array
    acceleration: Array
    given_home: Array | None = None
    encoders: Encoders | None = None
    gear_ratio: Array | None = None

    def __post_init__(self) -> None:
        n = len(self.joint_names)
        if n == 0:
            raise LabError(f"robot '{self.name}' has no joint: give it at least one")
        if len(set(self.joint_names)) < n:
            raise LabError(f"robot '{self.name}': two joints share a name; rename one of {', '.join(self.joint_names)}")
        vectors = (self.sign, self.lower, self.upper, self.speed, self.acceleration)
        assert len(self.prismatic) == n and all(vector.shape == (n,) for vector in vectors)
        for name, lower, upper in zip(self.joint_names, self.lower, self.upper, strict=True):
            if not np.isfinite([lower, upper]).all():
                raise LabError(f"robot '{self.name}', joint {name}: a limit is not finite")
            if upper - lower not in JOINT_SPAN:
                raise LabError(f"robot '{self.name}', joint {name}: its lower limit is not below the upper one")

    @property
    def size(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def home(self) -> Array:
        """Given or nominal home joint positions ``(n,)``."""
        return self.nominal_home if self.given_home is None else self.given_home

    @property
    def nominal_home(self) -> Array:
        """Joint positions ``(n,)`` zero, or the nearest limits."""
        return np.clip(np.zeros(self.size), self.lower, self.upper)

    @property
    def has_loops(self) -> bool:
        """True for a mechanism with loops."""
        return False

    @property
    def beside_serial(self) -> str:
        """What a robot has that a serial arm has not, by which nothing bends it here; "" for a serial arm."""
        return "loops" if self.has_loops else ""

    @property
    def offset_lengths(self) -> tuple[str, ...]:
        """Lengths of legs that add to joint positions; none for a chain."""
        return ()

    def random_joints(self, count: int, rng: np.random.Generator) -> Array:
        """Draw joint positions ``(count, n)`` uniform within the limits."""
        return rng.uniform(self.lower, self.upper, (count, self.size))

    def is_assemblable(self, joints: Array, *, well: bool = False) -> NDArray[np.bool_]:
        """Flag joint positions ``(m, n)`` at which the nominal model's loops close; ``well`` away from parallel
        singularities.
        """
        return np.ones(len(joints), dtype=bool)

    def infeasibility_reason(self, joints: Array) -> str:
        """Describe why joint positions ``(n,)`` are infeasible; empty if they are feasible."""
        return ""

    def beyond_limits(self, joints: Array, slack: float | Array) -> NDArray[np.bool_]:
        """Flag joint positions ``(m, n)`` beyond the limits by more than ``slack``, ``(n,)`` or one, rad or m."""
        return np.asarray((joints < self.lower - slack) | (joints > self.upper + slack))

    def unit(self, joint: int) -> Unit:
        """Return the display unit of a joint (from 0)."""
        return MM if self.prismatic[joint] else DEGREES

    @property
    def column_names(self) -> tuple[str, ...]:
        """Names of the columns of joint positions, with units: ``q1_deg``."""
        return tuple(f"{name}_{self.unit(i).key}" for i, name in enumerate(self.joint_names))

    def shown(self, joint: int, value: float) -> str:
        """Write a position (rad or m) or speed of a joint (from 0) in its display unit."""
        return self.unit(joint).text(value, 6).replace("-", "−")

    def limit_note(self, joint: int, reading: float) -> str:
        """Describe a joint (from 0) that is beyond its limits."""
        low, high = (self.shown(joint, limit[joint]) for limit in (self.lower, self.upper))
        return (
            f"joint {self.joint_names[joint]} is at {self.shown(joint, reading)}, beyond its limits of {low} to {high}"
        )

    def excess(self, joints: Array) -> Array:
        """Return the distance of joint positions ``(..., n)`` beyond their limits (rad or m), zero within them."""
        return np.maximum(np.maximum(self.lower - joints, joints - self.upper), 0.0)
