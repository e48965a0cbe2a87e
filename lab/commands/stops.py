"""Joint positions to move to one after the other, as a person, a table and a program take them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec

__all__ = ["VIA", "Stops", "joint_columns"]

VIA = "via"  # the purpose of a stop that is only passed
_BLOCK = 10_000  # stops that are made plain values at a time


@dataclass(frozen=True)
class Stops:
    """Stops of a robot's way, each reached in a straight line of all joints.

    Attributes:
        joints: ``(s, n)`` rad or m.
        which: ``(s,)`` which of the poses or targets ``ids`` each one is; -1 where it is none.
        ids: what these are called.
        purpose: what is done at them; every other stop is there for ``via``.
        stations: of the instrument that measures then, ``(s,)`` names; none where it has one alone.
    """

    joints: Array
    which: NDArray[np.int_]
    ids: Sequence[str]
    purpose: str
    stations: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """What each one is called: its pose's or target's id, ``home`` at the ends, or ``via`` and a number.

        Between two stations it is ``home_between`` and a number.
        """
        last, names, via, between = len(self.which) - 1, list[str](), 0, 0
        for i, pose in enumerate(self.which.tolist()):
            moved = bool(self.stations) and 0 < i < last and self.stations[i] != self.stations[i + 1]
            between += moved
            via += pose < 0 and i not in (0, last) and not moved
            passed = "home" if i == 0 else "home_again" if i == last else f"via{via:03d}"
            passed = f"home_between{between}" if moved else passed
            names.append(self.ids[pose] if pose >= 0 else passed)
        return tuple(names)

    @property
    def purposes(self) -> tuple[str, ...]:
        """What each one is for."""
        return tuple(self.purpose if pose >= 0 else VIA for pose in self.which)

    def columns(self, chain: JointSpec) -> Mapping[str, Sequence[Any] | Array]:
        """``id``, ``stop`` (what each is for), ``station`` where there are several, and joint positions.

        These are called ``<joint>_deg`` or ``<joint>_mm``.
        """
        stations = {"station": list(self.stations)} if self.stations else {}
        return {"id": list(self.names), "stop": list(self.purposes), **stations, **joint_columns(chain, self.joints)}

    def rows(self, chain: JointSpec) -> Iterator[dict[str, Any]]:
        """A mapping for each one, by the names of ``columns``, made as it is asked for."""
        columns = self.columns(chain)
        for first in range(0, len(self.which), _BLOCK):
            some = (values[first : first + _BLOCK] for values in columns.values())
            plain = [each.tolist() if isinstance(each, np.ndarray) else each for each in some]
            for row in zip(*plain, strict=True):
                yield dict(zip(columns, row, strict=True))


def joint_columns(chain: JointSpec, joints: Array) -> dict[str, Array]:
    """Joint positions ``(n, joints)`` (rad or m) by joint and unit, as people read them: ``<joint>_deg`` or ``_mm``."""
    return {
        f"{name}_{'mm' if slides else 'deg'}": 1e3 * values if slides else np.rad2deg(values)
        for name, slides, values in zip(chain.joint_names, chain.prismatic, joints.T, strict=True)
    }
