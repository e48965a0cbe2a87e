"""What a reader is told of a program's base, flange and tools."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.render.format import short

if TYPE_CHECKING:
    from lab.commands.compensate.program_reference import ProgramReference
    from lab.commands.compensate.result import CompensationResult

__all__ = ["UsedTool", "flange_values", "flange_words", "stated_words", "used_tools"]

_SAME_M = 15e-3  # a tool nearer to a measured point is meant to be that point
_AGREES_M = 0.5e-3  # and disagrees with it where it is farther


@dataclass(frozen=True)
class UsedTool:
    """A tool that a program's targets are for.

    Attributes:
        name: in the text; empty for joint positions whose tool the text does not say.
        targets: how many.
        position_m: ``(3,)`` in the flange.
        point: the measured point that it is apparently meant to be; empty where none is near.
        distance_m: of that point, as measured.
    """

    name: str
    targets: int
    position_m: tuple[float, ...]
    point: str = ""
    distance_m: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        """As plain values: mm."""
        near = {"point": self.point, "distance_mm": 1e3 * self.distance_m} if self.point else None
        return {
            "name": self.name,
            "targets": self.targets,
            "position_mm": [1e3 * each for each in self.position_m],
            "measured": near,
        }

    @property
    def words(self) -> str:
        """Which tool was used for how many targets, and by how much a measured point disagrees with it."""
        place = ", ".join(short(1e3 * each) for each in self.position_m)
        if not self.name:
            return f"{_targets(self.targets)} by joint positions: the flange is brought where the nominal arm has it"
        used = f"{_targets(self.targets)} with tool {self.name}, at ({place}) mm in the flange as the program states it"
        if not self.disagrees:
            return used
        return (
            f"{used}; the measured point {self.point} is {short(1e3 * self.distance_m)} mm from there and was not used"
        )

    @property
    def disagrees(self) -> bool:
        """Whether it is apparently a measured point, which is elsewhere."""
        return bool(self.point) and self.distance_m > _AGREES_M


def used_tools(result: "CompensationResult") -> tuple[UsedTool, ...]:
    """The tools of a program's corrected targets, and which measured point each is near."""
    reference, points = result.reference, result.points
    if reference is None or points is None:
        return ()
    counts, names = Counter(points[result.reached].tolist()), {k: name for name, k in reference.points.items()}
    measured = reference.nominal.tools[: reference.target]
    found = []
    for k in sorted(counts):
        place = reference.nominal.tools[k]
        tool = UsedTool(names[k], counts[k], tuple(place.tolist()))
        apart = np.linalg.norm(measured - place, axis=1)
        if names[k] and apart.min() < _SAME_M:
            nearest, names_of = int(apart.argmin()), reference.run.estimate.arm.targets
            tool = UsedTool(tool.name, tool.targets, tool.position_m, names_of[nearest], float(apart[nearest]))
        found.append(tool)
    return tuple(found)


def flange_words(result: "CompensationResult") -> str:
    """That the flange's orientation is unknown, why, and what that makes at the tools; "" where it is known."""
    reference, expected = result.reference, result.expected
    if reference is None or expected is None or reference.flange.turned or not len(result.reached):
        return ""
    size = short(1e3 * float(expected.flange_95_m[result.reached].max()))
    return (
        f"the orientation of the flange is unknown{_why(reference)}: by the tolerances of the last link the tools may "
        f"be off by up to {size} mm (95 %), with the correction as without it"
    )


def stated_words(reference: "ProgramReference") -> str:
    """How far the measured points are from their stated places in the flange, and what was made of that."""
    off = [short(1e3 * each) for each in reference.flange.off_m.tolist()]
    if not reference.stated:
        return "No place of a measured point in the flange is stated."
    said = f"The measured points ({', '.join(reference.stated)}) are {', '.join(off)} mm from their stated places"
    if not reference.flange.believed:
        return f"{said}, more than the tolerances of the last link explain, so these places are not used."
    return (
        f"{said}. The tolerances of the last link explain that, so it is taken for the flange's own error; if the "
        "points sit on an adapter, it is not, and the expected errors by the flange are too small."
    )


def _why(reference: "ProgramReference") -> str:
    """Why the measured points do not show how the flange is turned."""
    measured = reference.measured_targets
    if not reference.flange.believed and reference.run.options.observe == "pose":
        return ", since the measured pose of the tool is not the one that is stated"
    if reference.flange.believed or len(measured) < 3:
        points = f"{len(measured)} measured point{'s do' if len(measured) > 1 else ' does'}"
        return f", since {points} not show it"
    if reference.stated:
        off = [short(1e3 * each) for each in reference.flange.off_m.tolist()]
        return (
            f", since the measured points are {', '.join(off)} mm from their stated places, more than the tolerances "
            "of the last link explain"
        )
    return ", since no places of the measured points in the flange are stated"


def flange_values(reference: "ProgramReference") -> Mapping[str, Any]:
    """What ``result.json`` holds of the flange."""
    flange = reference.flange
    return {
        "orientation_known": flange.turned,
        "stated_places_used": flange.believed,
        "off_stated_mm": dict(zip(reference.stated, (1e3 * flange.off_m).tolist(), strict=False)),
        "tolerance_mm": 1e3 * float(reference.sigma[0]),
        "tolerance_mrad": 1e3 * float(reference.sigma[3]),
    }


def _targets(count: int) -> str:
    return "1 target" if count == 1 else f"{count:,} targets"
