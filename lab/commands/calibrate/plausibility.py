"""Whether measurements are what they are taken for: copies, a noise in another unit, points in another scale."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lab.calibration.identify import Identification, spread
from lab.calibration.other_numbers import PLACED, in_other_numbers, trimmed_error
from lab.calibration.verdict import CONSTANT_SPREAD, Answer, Verdict
from lab.campaign.robot import Robot
from lab.core.checks import Check
from lab.core.copies import copied_rows, said_of_copies
from lab.core.errors import LabError
from lab.core.measurements import Measurements, thinned
from lab.core.wording import be, counted

__all__ = [
    "doubted",
    "in_other_numbers_or_poses",
    "noise_beyond",
    "noise_in_another_unit",
    "points_in_another_scale",
    "without_copies",
]

LEAST_RESIDUAL_M = 1e-7  # below, residuals are rounding, and say nothing of the noise
LEAST_FREEDOM = 10
LEAST_ROWS = 5  # of fewer the fit says what they lack
MANY = 10.0  # times the residuals' noise: what is given hides errors
UNIT = 100.0  # times the residuals' noise that a given one may be: a unit is a thousand
ANOTHER_DAY = 500.0  # the same of an instrument that may be another one
LENGTH = re.compile(r"link\d+\.(a|d)")
LONG_M = 0.05  # a link that tells a scale: of shorter ones tolerances are as large
LEAST_LENGTHS = 3
SCALE = 0.005  # steel is so much longer at 400 K more
MADE_M = 0.0015  # by which the longest link is to differ, too: three times what links are made to
FAR = 0.1  # of the points' spread: no robot is so far from its nominal model
MOST_ROWS = 200  # by which that is tested
ALIKE = 0.1  # of the squares of what lengths differ by that a common scale may leave


def without_copies(path: Path, data: Measurements) -> Measurements:
    """The rows that do not repeat an earlier one to the last digit, with a warning of the others.

    Nothing is measured twice alike: a copy would count as a measurement of its own, and make intervals too narrow.

    Raises:
        LabError: next to nothing but copies is left.
    """
    conditions = [column for _, column in sorted(data.conditions.items())]
    names = {name: float(i) for i, name in enumerate(dict.fromkeys(data.sessions))}
    numbers = np.column_stack(
        [data.joints, data.points.reshape(len(data), -1), *conditions, [names[name] for name in data.sessions]]
    )
    seen = np.flatnonzero(data.seen.any(axis=1))
    copies = [(int(seen[row]), int(seen[same])) for row, same in copied_rows(numbers[seen])]
    if not copies:
        return data
    said, left = said_of_copies(path, len(copies), *map(data.where, copies[0])), len(data) - len(copies)
    if left < LEAST_ROWS:
        raise LabError(f"{said}: {counted(left, 'row')} {be(left)} left; measure more poses")
    gone = {row for row, _ in copies}
    kept = data.take([row for row in range(len(data)) if row not in gone])
    return replace(kept, warnings=(*kept.warnings, f"{said}: left out"))


def noise_in_another_unit(noise_mm: float | None, rows: Measurements, found: Identification) -> list[Check]:
    """Refuse a noise that is far more than the residuals of the fit, and say it of one that is many times as much.

    Args:
        noise_mm: the option; None where it was not given.
        rows: that were fitted.

    Raises:
        LabError: it is; with the number that it would be in the right unit.
    """
    if found.dof < LEAST_FREEDOM:
        return []
    return noise_beyond(noise_mm, rows, found.residual_sigma_m, "the residuals", UNIT)


def noise_beyond(
    noise_mm: float | None, rows: Measurements, known_m: float, whose: str, times: float = ANOTHER_DAY
) -> list[Check]:
    """Refuse a noise that is far more than what is known of the robot and its instrument.

    Args:
        noise_mm: the option; None where it was not given, and the rows say it.
        rows: that it is of.
        known_m: standard deviation per axis of residuals with such an instrument.
        whose: the residuals' name in the message.
        times: how many times as much it may be.

    Returns:
        The check of one that is so many times as much that it hides errors; nothing of others.

    Raises:
        LabError: it is; with the number that it would be in the right unit.
    """
    name, given_mm = "--noise-mm", noise_mm
    if given_mm is None:
        name, known = "column sigma_mm", rows.sigma_m[np.isfinite(rows.sigma_m)]
        if known.size and known.max() > UNIT * known.min():
            data = {"least_m": float(known.min()), "most_m": float(known.max())}
            return [Check("given.noises", "failed", data=data)]
        given_mm = 1e3 * float(np.median(known)) if known.size else None
    if given_mm is None or known_m <= LEAST_RESIDUAL_M or given_mm / 1e3 <= MANY * known_m:
        return []
    ratio = given_mm / 1e3 / known_m
    said = f"{name} {given_mm:g}: {whose} are those of a noise of {1e3 * known_m:.2g} mm, {ratio:.0f} times less"
    if ratio > times:
        raise LabError(f"{said}; is it in µm? That would be {given_mm / 1e3:g} mm")
    figures = {"given_m": given_mm / 1e3, "known_m": known_m}
    return [Check("given.noise", "failed", ratio, data={"in_column": noise_mm is None, "whose": whose, **figures})]


def points_in_another_scale(found: Identification) -> list[Check]:
    """Where all long links are longer, or shorter, by about one share: no arm is made so, but points are written so."""
    names, free = found.model.names, [i for i in found.fit.free if LENGTH.fullmatch(found.model.names[i])]
    long = [i for i in free if abs(found.nominal_aligned[i]) >= LONG_M]
    if len(long) < LEAST_LENGTHS:
        return []
    nominal = found.nominal_aligned[long]
    more = found.values[long] - nominal
    scale = float(more @ nominal / (nominal @ nominal))
    if abs(scale) < max(SCALE, MADE_M / np.abs(nominal).max()):
        return []
    if ((more - scale * nominal) ** 2).sum() > ALIKE * (more @ more):
        return []
    return [Check("given.scale", "failed", data={"links": [names[i] for i in long], "scale": scale})]


def in_other_numbers_or_poses(robot: Robot, rows: Measurements) -> list[Check]:
    """Why points are far from the nominal arm wherever its base and tool are; mostly nothing.

    Args:
        robot: whose they are to be.
        rows: of points that one instrument measured from one place.
    """
    rows = thinned(rows.take(np.flatnonzero(rows.seen.any(axis=1))), MOST_ROWS)
    arm, slides = robot.arm(rows.targets), robot.chain.prismatic
    nominal = arm.nominal({target: np.zeros(3) for target in rows.targets})
    if found := in_other_numbers(arm, slides, rows.joints, rows.points, nominal):
        return [found]
    left, size = trimmed_error(arm, rows.joints, rows.points, nominal, PLACED), spread(rows.points)
    if not FAR * size < left < size / CONSTANT_SPREAD:  # points that do not move say nothing of poses
        return []
    return [Check("given.poses", "failed", data={"off_m": left})]


def doubted(word: Verdict, said: Sequence[Check]) -> Verdict:
    """The verdict where the noise or the scale cannot be what was given: it is not good."""
    if not said:
        return word
    doubtful = "doubtful" if word.word == "good" else word.word
    return replace(word, word=doubtful, fit=Answer("doubtful", (said[0],)), reasons=(*word.reasons, *said))
