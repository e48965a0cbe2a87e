"""What is set at each pose beside the joints: payload, approach, time, temperature, sessions; columns of a file.

Along a trajectory also how the joints move.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lab.core.errors import LabError
from lab.core.measurements import LAST_MOVE, PLACE, SESSION, STATION
from lab.core.se3 import Array

__all__ = [
    "BUMPED",
    "CHANGING_WITH_TIME",
    "HOUR_S",
    "PAYLOAD",
    "REFERENCE_C",
    "TEMPERATURE",
    "TIME",
    "PoseConditions",
    "absent",
    "approach_of",
    "in_order",
    "last_move_of",
    "rates_in",
    "rates_of",
    "structure_values",
]

PAYLOAD, TIME, TEMPERATURE = "payload_kg", "time_s", "temp_C"
CHANGING_WITH_TIME = (TIME, PLACE, TEMPERATURE)  # slowly, from pose to pose: what follows them looks like wandering
REFERENCE_C = 20.0  # at which lengths are stated (ISO 1:2022)
BUMPED = SESSION + "2"  # 1 of the rows after a bump
HOUR_S = 3600.0
LARGEST_PAYLOAD_KG, LARGEST_WARMING_C = 3.0, 20.0  # where the rank is decided
_APPROACH, _SPEED, _ACCELERATION = "approach_", "speed_", "acceleration_"


def approach_of(joint_name: str) -> str:
    """The condition that says from which side a joint came: +1 or -1."""
    return _APPROACH + joint_name


def last_move_of(joint_name: str) -> str:
    """The condition that says in which direction a joint moved last, by the order of the poses: +1 or -1."""
    return LAST_MOVE + joint_name


def absent(name: str, rows: int) -> Array:
    """A condition ``(rows,)`` where nothing is said of it: none, or as warm as where lengths are stated."""
    return np.full(rows, REFERENCE_C if name == TEMPERATURE else 0.0)


def rates_of(joint_names: Sequence[str]) -> tuple[str, ...]:
    """The conditions that say how the joints move: speeds, then accelerations, rad or m per s and per s^2."""
    return (*(_SPEED + name for name in joint_names), *(_ACCELERATION + name for name in joint_names))


def rates_in(conditions: Array, joints: int) -> tuple[Array, Array]:
    """Speeds and accelerations ``(n, joints)`` of conditions ``(n, c)`` that end with those of ``rates_of``."""
    return conditions[:, -2 * joints : -joints], conditions[:, -joints:]


def in_order(names: Sequence[str]) -> tuple[str, ...]:
    """Conditions, each once, in the order of a file's columns: payload, approaches, time, temperature, sessions."""
    ranks = {PAYLOAD: 0, TIME: 2, TEMPERATURE: 3}
    return tuple(sorted(dict.fromkeys(names), key=lambda name: ranks.get(name, 1 if name.startswith(_APPROACH) else 4)))


def structure_values(name: str, count: int, rng: np.random.Generator) -> Array:
    """Values ``(count,)`` of a condition at which the rank is decided."""
    if name == PAYLOAD:
        return rng.choice([0.0, LARGEST_PAYLOAD_KG], count)
    if name.startswith((_APPROACH, LAST_MOVE)):
        return rng.choice([-1.0, 1.0], count)
    if name == PLACE:
        return rng.uniform(0.0, 1.0, count)
    if name == TEMPERATURE:
        return rng.uniform(REFERENCE_C, REFERENCE_C + LARGEST_WARMING_C, count)
    if name.startswith((SESSION, STATION)):
        return rng.choice([0.0, 1.0], count)
    if name.startswith((_SPEED, _ACCELERATION)):
        return rng.normal(size=count)
    return rng.uniform(0.0, HOUR_S, count)


@dataclass(frozen=True)
class PoseConditions:
    """What is set at m poses of an arm.

    Attributes:
        columns: ``(m,)`` each, by name; where one is missing there is no payload, no approach, no time, no bump, and
            it is as warm as where lengths are stated.
    """

    columns: Mapping[str, Array]
    poses: int
    joint_names: tuple[str, ...]

    def __post_init__(self) -> None:
        for name in (PAYLOAD, TIME, TEMPERATURE, BUMPED, *map(approach_of, self.joint_names)):
            column = self.columns.get(name)
            if column is not None and (column.shape != (self.poses,) or not np.isfinite(column).all()):
                raise LabError(f"condition {name}: give one finite number for each of {self.poses} poses")

    def column(self, name: str) -> Array:
        """One of them ``(m,)``; what is usual where it is missing."""
        return self.columns.get(name, absent(name, self.poses))

    @property
    def warmer(self) -> Array:
        """How much warmer than where lengths are stated it is ``(m,)``, K."""
        return self.column(TEMPERATURE) - REFERENCE_C

    @property
    def approach(self) -> Array:
        """Each joint's direction of approach ``(m, n)``."""
        return np.stack([self.column(approach_of(name)) for name in self.joint_names], axis=1)
