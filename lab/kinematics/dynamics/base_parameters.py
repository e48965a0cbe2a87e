"""The base dynamic parameters of an arm: what its torques determine, and which parameters are grouped into which.

The regressor at random states has columns that depend on others, whatever the motion. By an orthogonal factorization
of its columns, in an order that prefers what SYMORO+ keeps (XX XY XZ YZ ZZ MX MY, then Ia; Khalil & Creusot 1997), a
column whose diagonal of R vanishes depends on those before it (Gautier 1991): W2 = W1 K, and the base parameters are
X1 + K X2. Those of a column of zeros affect no torque.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.kinematics.dynamics.arm_dynamics import ArmDynamics

__all__ = ["BaseParameters", "base_parameters", "random_states"]

_STATES = 24  # random ones, each with a row a joint: half as many rows again as six joints have parameters
_DEPENDS = 1e-8  # of a column's norm: what others leave of it
_LATE = ("Ia", "M", "MZ", "YY")  # kinds that are grouped into the others where they can be


@dataclass(frozen=True)
class BaseParameters:
    """A base set of the standard parameters.

    Attributes:
        names: of the standard parameters, p of them.
        kept: ``(b,)`` indices of the columns that stay; ``grouped`` ``(g,)`` of those that depend on them.
        without_effect: indices of those that no torque depends on.
        regrouping: K ``(b, g)``.
    """

    names: tuple[str, ...]
    kept: NDArray[np.int_]
    grouped: NDArray[np.int_]
    without_effect: NDArray[np.int_]
    regrouping: Array

    @property
    def size(self) -> int:
        """How many base parameters there are."""
        return len(self.kept)

    @property
    def labels(self) -> tuple[str, ...]:
        """Their names: of the standard parameter that each is named after, with R where others are grouped into it."""
        with_others = np.abs(self.regrouping).max(axis=1, initial=0.0) > 0
        return tuple(
            _regrouped(self.names[i]) if grouped else self.names[i]
            for i, grouped in zip(self.kept.tolist(), with_others.tolist(), strict=True)
        )

    @property
    def inertial(self) -> int:
        """How many of them are of links and motors, not of friction and offsets."""
        return sum(self.names[i][0] not in "Fo" for i in self.kept.tolist())

    @property
    def projection(self) -> Array:
        """``(b, p)``: base parameters of standard ones."""
        matrix = np.zeros((self.size, len(self.names)))
        matrix[np.arange(self.size), self.kept] = 1.0
        matrix[:, self.grouped] = self.regrouping
        return matrix


def random_states(arm: ArmDynamics, count: int, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Joint positions over a whole turn (1 m of slides), speeds and accelerations ``(count, J)``."""
    shape = (count, arm.chain.size)
    joints = rng.uniform(-1.0, 1.0, shape) * np.where(arm.chain.prismatic, 1.0, np.pi)
    return joints, rng.uniform(-2.0, 2.0, shape), rng.uniform(-5.0, 5.0, shape)


def base_parameters(arm: ArmDynamics, rng: np.random.Generator) -> BaseParameters:
    """The base set of an arm, decided at random states."""
    columns = arm.regressor(*random_states(arm, _STATES, rng)).reshape(-1, len(arm.names))
    size = np.linalg.norm(columns, axis=0)
    effect = size > _DEPENDS * size.max()
    order = np.array([i for i in _preferred(arm.names) if effect[i]])
    triangle = np.linalg.qr(columns[:, order] / size[order], mode="r")
    kept = np.abs(np.diag(triangle)) > _DEPENDS
    chosen, rest = np.sort(order[kept]), np.sort(order[~kept])
    regrouping = np.linalg.lstsq(columns[:, chosen] / size[chosen], columns[:, rest], rcond=None)[0]
    regrouping = regrouping / size[chosen][:, None]
    regrouping[np.abs(regrouping) < _DEPENDS] = 0.0
    return BaseParameters(arm.names, chosen, rest, np.flatnonzero(~effect), regrouping)


def _preferred(names: tuple[str, ...]) -> list[int]:
    """Indices of the standard parameters, first those that stay if they can, each kind from the base outward."""
    kinds = [name.rstrip("0123456789") for name in names]
    rank = [_LATE.index(kind) + 1 if kind in _LATE else 0 for kind in kinds]
    numbers = [int(name[len(kind) :]) for name, kind in zip(names, kinds, strict=True)]
    return sorted(range(len(names)), key=lambda i: (rank[i], numbers[i]))


def _regrouped(name: str) -> str:
    kind = name.rstrip("0123456789")
    return f"{kind}R{name[len(kind) :]}"
