"""The drawing of a serial arm: its Denavit-Hartenberg table, joint directions and limits.

Two conventions, each with Hayati's beta between nominally parallel axes (Hayati 1983):

* ``distal``: Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta) (Denavit & Hartenberg 1955);
* ``craig``: Rx(alpha) Tx(a) Ry(beta) Rz(theta) Tz(d), also called modified (Khalil & Kleinfinger 1986).

A joint's reading, times its sign, adds to theta (revolute) or to d (prismatic).
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.errors import LabError
from lab.frames import Array

Convention = Literal["distal", "craig"]
COLUMNS = ("theta", "d", "a", "alpha", "beta")
PARALLEL_RAD = 0.035  # neighbouring axes within 2 degrees are nominally parallel: a beta, no d


@dataclass(frozen=True)
class Chain:
    """A serial chain of n joints, as drawn.

    Attributes:
        table: ``(n, 5)``, a row a link: theta (rad), d (m), a (m), alpha (rad), beta (rad).
        sign: ``(n,)``, +1 or -1, how a joint's reading counts.
        lower, upper: ``(n,)`` limits of the readings, rad or m.
        speed, acceleration: ``(n,)`` largest ones of the joints, rad or m per s or s^2; NaN where unknown.
        parallel: links with a beta, because they join nominally parallel axes.
    """

    name: str
    convention: Convention
    joint_names: tuple[str, ...]
    prismatic: tuple[bool, ...]
    table: Array
    sign: Array
    lower: Array
    upper: Array
    speed: Array
    acceleration: Array
    parallel: tuple[bool, ...]

    def __post_init__(self) -> None:
        n = len(self.joint_names)
        if n == 0:
            raise LabError(f"robot '{self.name}' has no joint: give it at least one")
        if len(set(self.joint_names)) < n:
            raise LabError(f"robot '{self.name}': two joints share a name; rename one of {', '.join(self.joint_names)}")
        vectors = (self.sign, self.lower, self.upper, self.speed, self.acceleration)
        assert self.table.shape == (n, 5) and all(vector.shape == (n,) for vector in vectors)
        assert len(self.prismatic) == len(self.parallel) == n
        for name, row, lower, upper in zip(self.joint_names, self.table, self.lower, self.upper, strict=True):
            if not np.isfinite([*row, lower, upper]).all():
                raise LabError(f"robot '{self.name}', joint {name}: a value is not finite")
            if not lower < upper:
                raise LabError(f"robot '{self.name}', joint {name}: its lower limit is not below the upper one")

    @property
    def size(self) -> int:
        """The number of joints."""
        return len(self.joint_names)

    def with_table(self, table: Array) -> "Chain":
        """The same joints with other link parameters ``(n, 5)``."""
        return replace(self, table=np.array(table, dtype=np.float64))

    def first(self, size: int) -> "Chain":
        """The chain cut off after so many joints; every link keeps its beta."""
        cut = slice(0, size)
        return Chain(
            self.name, self.convention, self.joint_names[cut], self.prismatic[cut], self.table[cut],
            self.sign[cut], self.lower[cut], self.upper[cut], self.speed[cut], self.acceleration[cut], (True,) * size,
        )  # fmt: skip

    def random_joints(self, count: int, rng: np.random.Generator) -> Array:
        """Readings ``(count, n)`` uniform within the limits."""
        return rng.uniform(self.lower, self.upper, (count, self.size))

    def beyond_limits(self, joints: Array, slack: float | Array) -> NDArray[np.bool_]:
        """Which readings ``(m, n)`` are beyond the limits by more than ``slack``, a number or ``(n,)``, in rad or m."""
        return (joints < self.lower - slack) | (joints > self.upper + slack)

    def shown(self, joint: int, value: float) -> str:
        """A reading (rad or m) of a joint (from 0), or its speed, in the unit in which people read it."""
        return f"{1e3 * value:.6g} mm" if self.prismatic[joint] else f"{np.rad2deg(value):.6g}°"

    def said_beyond(self, joint: int, reading: float) -> str:
        """That a joint (from 0) stands beyond its limits, in words."""
        low, high = (self.shown(joint, limit[joint]) for limit in (self.lower, self.upper))
        return (
            f"joint {self.joint_names[joint]} is at {self.shown(joint, reading)}, beyond its limits of {low} to {high}"
        )

    def excess(self, joints: Array) -> Array:
        """How far each of the readings ``(..., n)`` is beyond its limit, zero where it is within, in rad or m."""
        return np.maximum(np.maximum(self.lower - joints, joints - self.upper), 0.0)

    def joins_parallel_axes(self, i: int) -> bool:
        """Whether axes i and i + 1 (0-based joints) are parallel on the drawing."""
        link = i if self.convention == "distal" else i + 1
        return i + 1 < self.size and self.parallel[link]


def parallel_links(convention: Convention, alpha: Array) -> tuple[bool, ...]:
    """Which links join nominally parallel (or antiparallel) axes, from alpha ``(n,)``.

    A distal chain's last link and a Craig chain's first one join no two joints.
    """
    flags = np.abs(np.sin(alpha)) < PARALLEL_RAD
    flags[-1 if convention == "distal" else 0] = False
    return tuple(bool(flag) for flag in flags)
