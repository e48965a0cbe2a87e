"""The state of one arm on a day, from its calibrations and verifications."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date, timedelta
from functools import cached_property

import numpy as np

from lab.commands.status.history import Check
from lab.commands.trend.result import TrendResult
from lab.core.linear_model import half_width_95
from lab.core.serials import called

__all__ = ["FEWEST_CHECKS", "STATES", "ArmStatus", "Slope"]

STATES = ("good", "due", "unknown", "never calibrated", "doubtful", "bad")  # by severity; the number is the metric's
FEWEST_CHECKS = 4  # verifications from which a slope is estimated
_YEAR = 365.25  # days


@dataclass(frozen=True)
class Slope:
    """The slope of the mean error over the verifications of the current calibration, mm per year.

    Attributes:
        half_width: of its 95 % interval, by the scatter about the line.
        count: of the verifications.
    """

    per_year: float
    half_width: float
    count: int


@dataclass(frozen=True)
class ArmStatus:
    """An arm on a day.

    Attributes:
        serial: its serial number; None where its runs name none.
        checks: its calibrations and verifications up to the day, in order; those without a day first.
        on: the day.
        every_days: after how many days without a check it is due.
        trend: of its calibrations; None where fewer than two can be compared.
    """

    robot: str
    serial: str | None
    checks: tuple[Check, ...]
    on: date
    every_days: int
    trend: TrendResult | None = None

    @property
    def called(self) -> str:
        """The arm as a person names it."""
        return called(self.robot, self.serial)

    @cached_property
    def calibration(self) -> Check | None:
        """The last calibration of a known day."""
        return next((each for each in reversed(self.checks) if each.calibrates and each.on is not None), None)

    @cached_property
    def verifications(self) -> tuple[Check, ...]:
        """The verifications of the last calibration, in order: by its digest, else those of later days."""
        last = self.calibration
        if last is None or last.on is None:
            return ()
        known = {each.of for each in self.checks if each.calibrates}
        own = [each for each in self.checks if not each.calibrates and each.on is not None]
        return tuple(
            each for each in own if each.of == last.of or (each.of not in known and each.on and each.on > last.on)
        )

    @property
    def verification(self) -> Check | None:
        """The last verification of any calibration."""
        return next((each for each in reversed(self.checks) if not each.calibrates and each.on is not None), None)

    @property
    def latest(self) -> Check | None:
        """The check that the state rests on: the last verification of the last calibration, or that itself."""
        return self.verifications[-1] if self.verifications else self.calibration

    @property
    def due(self) -> date | None:
        """The last day for the next check, of a bad arm that on which it was found; None where there was none."""
        if self.latest is None or self.latest.on is None:
            return None
        return self.latest.on + timedelta(0 if self.latest.verdict == "bad" else self.every_days)

    @property
    def state(self) -> str:
        """One of ``STATES``."""
        if not any(each.calibrates for each in self.checks):
            return "never calibrated"
        if self.latest is None or self.latest.verdict == "not judged":
            return "unknown"
        if self.latest.verdict != "good":
            return self.latest.verdict
        return "due" if self.due is not None and self.on > self.due else "good"

    @property
    def error_then_mm(self) -> float | None:
        """The mean error of the last calibration at poses that were not fitted."""
        return None if self.calibration is None else self.calibration.error_mm

    @property
    def error_now_mm(self) -> float | None:
        """The mean error of the last verification of that calibration."""
        return self.verifications[-1].error_mm if self.verifications else None

    @cached_property
    def slope(self) -> Slope | None:
        """The slope of the error since the last calibration; None of fewer than four verifications."""
        points = [(each.on.toordinal() / _YEAR, each.error_mm) for each in self.verifications if each.on is not None]
        return _slope([(at, error) for at, error in points if error is not None])


def _slope(points: Sequence[tuple[float, float]]) -> Slope | None:
    """Fit a line by least squares to errors (mm) over time (years)."""
    if len(points) < FEWEST_CHECKS:
        return None
    at, errors = np.array(points).T
    apart = at - at.mean()
    square = float(apart @ apart)
    if square == 0:
        return None
    slope = float(apart @ errors) / square
    left = errors - errors.mean() - slope * apart
    freedom = len(points) - 2
    std = float(np.sqrt(left @ left / freedom / square))
    return Slope(slope, float(half_width_95(float(freedom))) * std, len(points))
