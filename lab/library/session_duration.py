"""Estimate the duration of a measurement session: warm-up, moves, waiting, and repeated reference measurements."""

from dataclasses import dataclass
from typing import Self

from lab.formats.programs.protocol import PAUSE_S
from lab.pose_selection.tour import Tour

__all__ = ["SessionDuration"]

_WARM_UP_S = 1800.0  # ISO 9283:1998 asks for a warm-up, its length as the maker says; half an hour is common
_REFERENCE_EVERY = 10  # poses after which the reference pose is measured again


@dataclass(frozen=True)
class SessionDuration:
    """The time that a plan takes."""

    poses: int  # number of measured poses
    moving_s: float  # time of motion at full speed, s
    again: int = 0  # number of repeated measurements of the plan

    @classmethod
    def of(cls, tour: Tour) -> Self:
        """Return the measurement session of a tour."""
        poses = len(tour.order)
        return cls(poses, tour.seconds, int((tour.measured >= 0).sum()) - poses)

    @property
    def references(self) -> int:
        """Number of reference measurements: first, after every tenth pose, and last; or as planned."""
        return 1 + (self.again or 1 + (self.poses - 1) // _REFERENCE_EVERY)

    @property
    def seconds(self) -> float:
        """Total duration: warm-up, moves, waiting; paths to the reference pose last as long as others."""
        moving = _WARM_UP_S + self.moving_s + PAUSE_S * (self.poses + self.again)
        if self.again:
            return moving
        a_move = self.moving_s / (self.poses + 1)
        return moving + self.references * (2 * a_move + PAUSE_S)

    def to_dict(self) -> dict[str, float | int]:
        """The parts, in s."""
        return {
            "tour_seconds": float(self.moving_s),
            "warm_up_seconds": _WARM_UP_S,
            "reference_measurements": self.references,
            "day_seconds": round(self.seconds, 1),
        }

    @property
    def description(self) -> str:
        """Description of the measurement session's needs, in sentences."""
        reference = (
            "The plan measures its reference pose again (--reference-every)."
            if self.again
            else f"Choose one pose of the plan as reference; measure it first, after every {_REFERENCE_EVERY}th pose "
            f"and last (--reference-every {_REFERENCE_EVERY} plans this)."
        )
        return (
            f"The session takes about {self.seconds / 60:.0f} minutes: {_WARM_UP_S / 60:.0f} minutes of warm-up, in "
            f"which the arm runs the plan without measuring, {self.moving_s / 60:.1f} minutes of moving at full speed, "
            f"{PAUSE_S} s of waiting at each pose, and {self.references} measurements of a reference pose. {reference} "
            "Its scatter is the repeatability, and its drift shows whether tracker or arm have moved. Setup and "
            "warm-up of the tracker are not included."
        )
