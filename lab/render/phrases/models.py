"""How the groups of a model are named to a person: one by one, or, where they are many, by how many they are."""

from collections.abc import Sequence

from lab.calibration.statistics.model_selection import GroupTrial
from lab.kinematics.effects.registry import said_of_term

__all__ = ["listed", "model_name", "standing"]

_MOST_LISTED = 6  # groups of single joints in a sentence


def listed(groups: Sequence[str]) -> tuple[str, ...]:
    """The names of groups; many groups of single joints as one."""
    terms = [name for name in groups if said_of_term(name)]
    if len(terms) <= _MOST_LISTED:
        return tuple(groups)
    return (*(name for name in groups if name not in terms), f"{len(terms)} groups of single joints")


def model_name(groups: Sequence[str]) -> str:
    """Geometry and the groups."""
    return " + ".join(("geometric", *listed(groups)))


def standing(group: GroupTrial) -> str:
    """Whether a group is in the model, what it says of the robot, and what speaks against it."""
    said = said_of_term(group.name)
    chosen = (f"chosen: {said}" if said else "chosen") if group.chosen else ""
    return ", but ".join(part for part in (chosen, group.infeasibility_reason) if part)
