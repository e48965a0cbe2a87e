"""How long a measuring day takes, and what it needs besides its poses: warm-up, and a pose that is measured again."""

from dataclasses import dataclass

from lab.formats.programs.protocol import PAUSE_S

__all__ = ["MeasuringDayLength"]

WARM_UP_S = 1800.0  # ISO 9283:1998 asks for a warm-up, its length as the maker says; half an hour is common
REFERENCE_EVERY = 10  # poses after which the reference pose is measured again


@dataclass(frozen=True)
class MeasuringDayLength:
    """The time that a plan takes.

    Attributes:
        poses: how many are measured.
        moving_s: on the move at full speed, s.
    """

    poses: int
    moving_s: float

    @property
    def references(self) -> int:
        """How often the reference pose is measured: first, after every tenth pose, and last."""
        return 2 + (self.poses - 1) // REFERENCE_EVERY

    @property
    def seconds(self) -> float:
        """All of it: warm-up, moves, waiting; ways to the reference pose are taken to last as long as others."""
        a_move = self.moving_s / (self.poses + 1)
        return WARM_UP_S + self.moving_s + PAUSE_S * self.poses + self.references * (2 * a_move + PAUSE_S)

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
        return (
            f"The day takes about {self.seconds / 60:.0f} minutes: {WARM_UP_S / 60:.0f} minutes of warm-up, in which "
            f"the arm goes through the plan unmeasured, {self.moving_s / 60:.1f} minutes of moving at full speed, "
            f"{PAUSE_S} s of waiting at each pose, and {self.references} measurements of a reference pose. Choose one "
            f"pose of the plan for that; measure it first, after every {REFERENCE_EVERY}th pose and last. Its scatter "
            "is the repeatability, and its drift shows whether tracker or arm have moved. Setting up the tracker and "
            "its own warm-up are not counted."
        )
