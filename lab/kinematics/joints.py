"""Joint specifications of serial chains and mechanisms with loops: names, kinds, directions, limits.

Encoders at the motors: whole counts, through gears and a coupled wrist, of which joint positions are made.

A drive turns G (C q) where the joints are at q: gear ratios G on the diagonal, couplings C with ones there (of a wrist
whose joints 5 and 6 share their drives, Khalil & Dombre 2002, section 2.4). A controller that counts a drive's turns
reports the joint positions q' = (N G C)^-1 round(N G C q), N counts for each radian of the motors. Its couplings and
gains are nominal: what the arm truly has beside them is an error of the arm (``effects.coupling``, ``Gear``).
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
    """Those of one arm with n joints.

    Attributes:
        gear_ratio: ``(n,)`` turns of each motor for one of its joint (rad per m of a slide), with their signs.
        couplings: ``(n, n)`` what each drive turns by the joints' positions, as its own joint feels it: ones on the
            diagonal.
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
        """``(n, n)`` counts of each encoder for a radian (or metre) of each joint."""
        return (self.counts_per_turn * self.gear_ratio / (2 * np.pi))[:, None] * self.couplings

    def rounded(self, joints: Array) -> Array:
        """The joint positions ``(m, n)`` that whole counts make of joint positions ``(m, n)``."""
        counts = self.counts
        whole: Array = np.round(joints @ counts.T) @ np.linalg.inv(counts).T
        return whole

    @property
    def covariance(self) -> Array:
        """``(n, n)`` of the joint positions' errors (rad, m): each count is off by half of one at most, uniformly."""
        per_count = np.linalg.inv(self.counts)
        return np.asarray(per_count @ per_count.T / 12)


@dataclass(frozen=True, kw_only=True)
class JointSpec:
    """The n measured joints of a robot, nominal.

    Attributes:
        sign: ``(n,)``, +1 or -1, how a joint's position counts.
        lower, upper: ``(n,)`` limits of the joint positions, rad or m.
        speed, acceleration: ``(n,)`` largest ones of the joints, rad or m per s or s^2; NaN where unknown.
        given_home: ``(n,)`` joint positions to start from, where somebody has said them.
        encoders: whose whole counts the joint positions are; None for ideal ones.
        jerk: ``(n,)`` largest ones of the joints, rad or m per s^3, infinite where not limited; None where none is.
        gear_ratio: ``(n,)`` turns of each motor for a turn of its joint (rad per m of a slide); None where unknown.
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
    jerk: Array | None = None

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
        """The number of joints."""
        return len(self.joint_names)

    @property
    def home(self) -> Array:
        """Joint positions ``(n,)`` to start from: those that are said, else nominal ones."""
        return self.nominal_home if self.given_home is None else self.given_home

    @property
    def nominal_home(self) -> Array:
        """Joint positions ``(n,)`` zero, or the limits nearest to it."""
        return np.clip(np.zeros(self.size), self.lower, self.upper)

    @property
    def has_loops(self) -> bool:
        """True for a mechanism with loops."""
        return False

    @property
    def offset_lengths(self) -> tuple[str, ...]:
        """The parameters that are lengths of a mechanism's legs and add to joint positions; a chain has none."""
        return ()

    def random_joints(self, count: int, rng: np.random.Generator) -> Array:
        """Joint positions ``(count, n)`` uniform within the limits."""
        return rng.uniform(self.lower, self.upper, (count, self.size))

    def is_assemblable(self, joints: Array, *, well: bool = False) -> NDArray[np.bool_]:
        """``(m,)`` whether the nominal model can stand at joint positions ``(m, n)``, limits aside; a chain always can.

        Args:
            well: away from parallel singularities, too.
        """
        return np.ones(len(joints), dtype=bool)

    def infeasibility_reason(self, joints: Array) -> str:
        """Describe why joint positions ``(n,)`` are infeasible; empty if they are feasible."""
        return ""

    def beyond_limits(self, joints: Array, slack: float | Array) -> NDArray[np.bool_]:
        """Flag joint positions ``(m, n)`` beyond the limits by more than ``slack``, ``(n,)`` or one, rad or m."""
        beyond: NDArray[np.bool_] = (joints < self.lower - slack) | (joints > self.upper + slack)
        return beyond

    def unit(self, joint: int) -> Unit:
        """Unit in which people read the positions of a joint (from 0)."""
        return MM if self.prismatic[joint] else DEGREES

    @property
    def column_names(self) -> tuple[str, ...]:
        """Names of the columns of joint positions, with the unit in which people read them: ``q1_deg``."""
        return tuple(f"{name}_{self.unit(i).key}" for i, name in enumerate(self.joint_names))

    def shown(self, joint: int, value: float) -> str:
        """A joint position (rad or m) of a joint (from 0), or its speed, in the unit in which people read it."""
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
