"""How long a measuring day takes, and what it needs besides its poses: warm-up, and a pose that is measured again."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from lab.formats.programs.protocol import PAUSE_S
from lab.pose_selection.tour import Tour

__all__ = ["MeasuringDayLength", "visit_ids"]

WARM_UP_S = 1800.0  # ISO 9283:1998 asks for a warm-up, its length as the maker says; half an hour is common
REFERENCE_EVERY = 10  # poses after which the reference pose is measured again


@dataclass(frozen=True)
class MeasuringDayLength:
    """The time that a plan takes.

    Attributes:
        poses: how many are measured.
        moving_s: on the move at full speed, s.
        again: how many stops of the plan are poses that are measured again; none where the plan leaves that out.
    """

    poses: int
    moving_s: float
    again: int = 0

    @classmethod
    def of(cls, tour: Tour) -> Self:
        """That of a tour."""
        poses = len(tour.order)
        return cls(poses, tour.seconds, int((tour.measured >= 0).sum()) - poses)

    @property
    def references(self) -> int:
        """How often the reference pose is measured: first, after every tenth pose, and last; or as the plan has it."""
        return 1 + (self.again or 1 + (self.poses - 1) // REFERENCE_EVERY)

    @property
    def seconds(self) -> float:
        """All of it: warm-up, moves, waiting; ways to the reference pose are taken to last as long as others."""
        moving = WARM_UP_S + self.moving_s + PAUSE_S * (self.poses + self.again)
        if self.again:
            return moving
        a_move = self.moving_s / (self.poses + 1)
        return moving + self.references * (2 * a_move + PAUSE_S)

    def to_dict(self) -> dict[str, float | int]:
        """The parts, in s."""
        return {
            "tour_seconds": float(self.moving_s),
            "warm_up_seconds": WARM_UP_S,
            "reference_measurements": self.references,
            "day_seconds": round(self.seconds, 1),
        }

    @property
    def words(self) -> str:
        """What the day needs, in sentences."""
        reference = (
            "The plan measures its reference pose again (--reference-every)."
            if self.again
            else f"Choose one pose of the plan for that; measure it first, after every {REFERENCE_EVERY}th pose and "
            f"last (--reference-every {REFERENCE_EVERY} plans it so)."
        )
        return (
            f"The day takes about {self.seconds / 60:.0f} minutes: {WARM_UP_S / 60:.0f} minutes of warm-up, in which "
            f"the arm goes through the plan unmeasured, {self.moving_s / 60:.1f} minutes of moving at full speed, "
            f"{PAUSE_S} s of waiting at each pose, and {self.references} measurements of a reference pose. {reference} "
            "Its scatter is the repeatability, and its drift shows whether tracker or arm have moved. Setting up the "
            "tracker and its own warm-up are not counted."
        )


def visit_ids(tour: Tour, pose_ids: Sequence[str]) -> tuple[str, ...]:
    """What each measured stop of a tour is called: its pose's id, and which time it is where it is measured again.

    Args:
        tour: of the poses.
        pose_ids: of the poses, in the order in which they are first measured.
    """
    names = dict(zip(tour.order.tolist(), pose_ids, strict=True))
    visits, ids = dict.fromkeys(names, 0), list[str]()
    for pose in tour.measured[tour.measured >= 0].tolist():
        visits[pose] += 1
        ids.append(names[pose] + (f"_{visits[pose]}" if visits[pose] > 1 else ""))
    return tuple(ids)
