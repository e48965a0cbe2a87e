"""Check measurements for mistakes: a noise in another unit, points in another scale, a joint of the other sign.

A joint that a controller counts in the other direction than the nominal model need not spoil the fit: with the fifth
joint of a wrist negated, the arm whose fourth and sixth zeros are half a turn away is the same arm. So each joint is
negated in turn, and the geometry identified again from the nominal one.
"""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lab.calibration.fitter import Fitter, NominalRobot
from lab.calibration.identify import Identification, spread
from lab.calibration.other_numbers import PLACED, in_other_numbers, trimmed_error
from lab.calibration.prior import Tolerance
from lab.calibration.verdict import CONSTANT_SPREAD, Answer, Verdict
from lab.calibration.workspace_prediction import distances_from_nominal
from lab.core.checks import Check
from lab.core.errors import LabError, option_name
from lab.core.measurements import Measurements, thinned
from lab.core.units import MM
from lab.kinematics.serial.arm import SerialArm

__all__ = [
    "check_joint_signs",
    "doubted",
    "in_other_numbers_or_poses",
    "noise_beyond",
    "noise_in_another_unit",
    "points_in_another_scale",
]

_LEAST_RESIDUAL_M = 1e-7  # below, residuals are rounding, and say nothing of the noise
_MIN_DOF = 10
MANY = 10.0  # times the residuals' noise: what is given hides errors
_UNIT = 100.0  # times the residuals' noise that a given one may be: a unit is a thousand
ANOTHER_INSTRUMENT = 500.0  # the same of an instrument that may be another one
LENGTH = re.compile(r"link\d+\.(a|d)")
_LONG_M = 0.05  # a link that tells a scale: of shorter ones tolerances are as large
_LEAST_LENGTHS = 3
SCALE = 0.005  # steel is so much longer at 400 K more
_MADE_M = 0.0015  # by which the longest link is to differ, too: three times what links are made to
FAR = 0.1  # of the points' spread: no robot is so far from its nominal model
MOST_ROWS = 200  # by which that is tested
ALIKE = 0.1  # of the squares of what lengths differ by that a common scale may leave
_SIGN_ROWS = 200  # by which signs are tried
_CLEARLY = 5.0  # times as small, the residuals or the distance from the nominal model
_NO_WORSE = 1.5  # times the residuals: the same arm in another pose of its wrist fits as well
_NEAR = 100.0  # tolerances from the nominal model: beyond, it is not that robot either


def noise_in_another_unit(noise_mm: float | None, rows: Measurements, found: Identification) -> list[Check]:
    """Refuse a noise that is far more than the residuals of the fit, and say it of one that is many times as much.

    Args:
        noise_mm: the option; None where it was not given.
        rows: that were fitted.

    Raises:
        LabError: it is; with the number that it would be in the right unit.
    """
    if found.dof < _MIN_DOF:
        return []
    return noise_beyond(noise_mm, rows, found.residual_sigma_m, "the residuals", _UNIT)


def noise_beyond(
    noise_mm: float | None, rows: Measurements, noise_m: float, whose: str, times: float = ANOTHER_INSTRUMENT
) -> list[Check]:
    """Refuse a noise that is far more than plausible for the robot and its instrument.

    Args:
        noise_mm: the option; None where it was not given, and the rows say it.
        rows: that it is of.
        noise_m: standard deviation per axis of residuals with such an instrument.
        whose: the residuals' name in the message.
        times: how many times as much it may be.

    Returns:
        The check of one that is so many times as much that it hides errors; nothing of others.

    Raises:
        LabError: it is; with the number that it would be in the right unit.
    """
    name, given_mm = option_name("noise_mm"), noise_mm
    if given_mm is None:
        name, known = "column sigma_mm", rows.sigma_m[np.isfinite(rows.sigma_m)]
        if known.size and known.max() > _UNIT * known.min():
            data = {"least_m": float(known.min()), "most_m": float(known.max())}
            return [Check("given.noises", "failed", data=data)]
        given_mm = MM.of(float(np.median(known))) if known.size else None
    if given_mm is None or noise_m <= _LEAST_RESIDUAL_M or MM.to_si(given_mm) <= MANY * noise_m:
        return []
    ratio = MM.to_si(given_mm) / noise_m
    text = f"{name} {given_mm:g}: {whose} are those of a noise of {MM.text(noise_m, 2)}, {ratio:.0f} times less"
    if ratio > times:
        raise LabError(f"{text}; is it in µm? That would be {MM.to_si(given_mm):g} mm")
    figures = {"given_m": MM.to_si(given_mm), "known_m": noise_m}
    return [Check("given.noise", "failed", ratio, data={"in_column": noise_mm is None, "whose": whose, **figures})]


def points_in_another_scale(found: Identification) -> list[Check]:
    """Detect a wrong scale of the points: all long links longer, or shorter, by about one share, as no arm is made."""
    names, free = found.model.names, [i for i in found.fit.free if LENGTH.fullmatch(found.model.names[i])]
    long = [i for i in free if abs(found.nominal_aligned[i]) >= _LONG_M]
    if len(long) < _LEAST_LENGTHS:
        return []
    nominal = found.nominal_aligned[long]
    more = found.values[long] - nominal
    scale = float(more @ nominal / (nominal @ nominal))
    if abs(scale) < max(SCALE, _MADE_M / np.abs(nominal).max()):
        return []
    if ((more - scale * nominal) ** 2).sum() > ALIKE * (more @ more):
        return []
    return [Check("given.scale", "failed", data={"links": [names[i] for i in long], "scale": scale})]


def in_other_numbers_or_poses(robot: NominalRobot, rows: Measurements) -> list[Check]:
    """Find why points are far from the nominal arm for any base and tool; mostly empty.

    Args:
        robot: the nominal robot of the measurements.
        rows: points that one instrument measured from one station.
    """
    rows = thinned(rows.with_points(), MOST_ROWS)
    arm, slides = robot.arm(rows.targets), robot.chain.prismatic
    nominal = arm.nominal({target: np.zeros(3) for target in rows.targets})
    if found := in_other_numbers(arm, slides, rows.joints, rows.points, nominal):
        return [found]
    left, size = trimmed_error(arm, rows.joints, rows.points, nominal, PLACED), spread(rows.points)
    if not FAR * size < left < size / CONSTANT_SPREAD:  # points that do not move say nothing of poses
        return []
    return [Check("given.poses", "failed", data={"off_m": left})]


def doubted(word: Verdict, checks: Sequence[Check]) -> Verdict:
    """Return the verdict where the given noise or scale is impossible: it is not good."""
    if not checks:
        return word
    doubtful = "doubtful" if word.word == "good" else word.word
    return replace(word, word=doubtful, fit=Answer("doubtful", (checks[0],)), reasons=(*word.reasons, *checks))


def check_joint_signs(fitter: Fitter, rows: Measurements) -> list[Check]:
    """Report the joint with which negated the geometry fits near the nominal model, as it does not as it is.

    Args:
        fitter: of a calibration that is bad.
        rows: that were fitted.
    """
    if not fitter.kind.in_instrument_frame or not isinstance(fitter.robot.arm(fitter.targets), SerialArm):
        return []
    rows = thinned(rows, _SIGN_ROWS)
    tolerance, given = fitter.tolerance, _identified(fitter, rows)
    tried = []
    for j, name in enumerate(rows.joint_names):
        signs = np.where(np.arange(rows.joints.shape[1]) == j, -1.0, 1.0)
        found = _identified(fitter, replace(rows, joints=rows.joints * signs))
        if found is not None and _explains(found, given, tolerance):
            tried.append((found.residual_sigma_m, name))
    if not tried:
        return []
    sigma_m, name = min(tried)
    return [Check("mistake.joint_sign", "failed", data={"joint": name, "sigma_m": sigma_m})]


def _identified(fitter: Fitter, rows: Measurements) -> Identification | None:
    """The geometry from these rows; None where they do not identify it."""
    try:
        return fitter.identified_with(rows, (), ())
    except LabError:
        return None


def _explains(found: Identification, given: Identification | None, tolerance: Tolerance) -> bool:
    """Decide whether one fit is of the nominal robot and the other, of the rows as given, is not."""
    if found.status != "converged" or not found.plausible or _tolerances(found, tolerance) > _NEAR:
        return False
    if given is None or given.status != "converged" or not given.plausible:
        return given is None or found.residual_sigma_m * _CLEARLY < given.residual_sigma_m
    if found.residual_sigma_m * _CLEARLY < given.residual_sigma_m:
        return True
    nearer = _tolerances(found, tolerance) * _CLEARLY < _tolerances(given, tolerance)
    return nearer and found.residual_sigma_m < _NO_WORSE * given.residual_sigma_m


def _tolerances(found: Identification, tolerance: Tolerance) -> float:
    """Return the largest distance of a link from its nominal value, in tolerances."""
    return max((each.tolerances for each in distances_from_nominal(found, tolerance)), default=0.0)
