"""The nominal model of a serial arm: its Denavit-Hartenberg table, joint directions and limits.

Two conventions, each with Hayati's beta between nominally parallel axes (Hayati 1983):

* ``distal``: Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta) (Denavit & Hartenberg 1955);
* ``craig``: Rx(alpha) Tx(a) Ry(beta) Rz(theta) Tz(d), also called modified (Khalil & Kleinfinger 1986).

A joint's position, times its sign, adds to theta (revolute) or to d (prismatic).
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec

__all__ = ["COLUMNS", "PARALLEL_RAD", "Chain", "Convention", "parallel_links"]

Convention = Literal["distal", "craig"]
COLUMNS = ("theta", "d", "a", "alpha", "beta")
PARALLEL_RAD = 0.035  # neighbouring axes within 2 degrees are nominally parallel: a beta, no d


@dataclass(frozen=True, kw_only=True)
class Chain(JointSpec):
    """A serial chain of n joints, nominal.

    Attributes:
        table: ``(n, 5)``, a row a link: theta (rad), d (m), a (m), alpha (rad), beta (rad).
        parallel: links with a beta, because they join nominally parallel axes.
    """

    convention: Convention
    table: Array
    parallel: tuple[bool, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        assert self.table.shape == (self.size, 5) and len(self.parallel) == self.size
        for name, row in zip(self.joint_names, self.table, strict=True):
            if not np.isfinite(row).all():
                raise LabError(f"robot '{self.name}', joint {name}: a value is not finite")

    def with_table(self, table: Array) -> "Chain":
        """Return a chain with other link parameters ``(n, 5)``."""
        return replace(self, table=np.array(table, dtype=np.float64))

    def first(self, size: int) -> "Chain":
        """Return the first ``size`` joints; every link keeps its beta."""
        cut = slice(0, size)
        return Chain(
            name=self.name, convention=self.convention, joint_names=self.joint_names[cut],
            prismatic=self.prismatic[cut], table=self.table[cut], sign=self.sign[cut], lower=self.lower[cut],
            upper=self.upper[cut], speed=self.speed[cut], acceleration=self.acceleration[cut], parallel=(True,) * size,
        )  # fmt: skip

    def joins_parallel_axes(self, i: int) -> bool:
        """Check whether axes i and i + 1 (0-based joints) are nominally parallel."""
        link = i if self.convention == "distal" else i + 1
        return i + 1 < self.size and self.parallel[link]


def parallel_links(convention: Convention, alpha: Array) -> tuple[bool, ...]:
    """Flag links that join nominally parallel (or antiparallel) axes, from alpha ``(n,)``.

    A distal chain's last link and a Craig chain's first one join no two joints.
    """
    flags = np.abs(np.sin(alpha)) < PARALLEL_RAD
    flags[-1 if convention == "distal" else 0] = False
    return tuple(bool(flag) for flag in flags)
