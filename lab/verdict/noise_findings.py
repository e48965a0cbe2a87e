"""Check whether the errors of a campaign are plausible for an instrument and a robot.

A noise model explains any residuals: a tracker that was moved becomes a step, a joint whose zero was shifted becomes
scatter. So what it explains is a finding. A finding is supported where repeated poses, or an instrument whose stated
noise is as large, show it too. A verdict cannot be good with an unsupported finding, nor with errors larger than
common instruments and industrial arms have. Steps, drift and growth are found before, by the diagnosis.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.calibration.identification import Identification
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.core.checks import Check
from lab.core.measurements import Measurements
from lab.noise.error_model import ErrorModel, row_times, session_of

__all__ = ["COMMON_NOISE_M", "COMMON_SCATTER_M", "finding", "shared_error_findings"]

COMMON_NOISE_M = 0.15e-3
"""Largest white noise (1σ per axis) of instruments in common use: photogrammetry and optical systems of a cell."""
COMMON_SCATTER_M = 0.1e-3
"""Largest scatter (RMS at the tool) of where an industrial arm stops: ISO 9283 repeatabilities are 0.01 to 0.1 mm."""
_COMMON_DRIFT_M = 0.1e-3
"""Largest drift or wandering (1σ per axis) of a set-up that was left alone."""

_TIME_SPAN_OF_REPEATS = 0.5  # of the campaign, between visits of one pose that show what changes with time
_FLOOR_M = 1e-7  # residuals below are rounding


def finding(kind: str, size_m: float, *, supported: bool = False, **data: Any) -> Check:
    """Return a finding about the errors of a campaign beyond the instrument's independent noise.

    Args:
        kind: ``drift``, ``correlated`` in time, ``scatter`` of joints, ``noise`` larger than common instruments',
            ``missing`` effects of the arm.
        size_m: how large it is at the measured points (m).
        supported: whether repeated poses or the stated instrument show it, and its size is common.
        data: what its phrase needs.

    Returns:
        A check that failed where nothing supports the finding.
    """
    return Check(f"finding.{kind}", "noted" if supported else "failed", data={"size_m": size_m, **data})


def shared_error_findings(
    found: Identification,
    rows: Measurements,
    shared: ErrorModel | None,
    adequacy: Check,
    labels: NDArray[np.int_],
) -> list[Check]:
    """Findings from estimated shared errors and from the estimated size of the noise.

    Args:
        shared: errors beside the instrument's that were estimated from the residuals; None where none were.
        labels: ``(n,)`` one a configuration; rows that share one are repeats.
    """
    if found.residual_sigma_m < _FLOOR_M:
        return []
    repeated = adequacy.name == "lack_of_fit.repeats" and adequacy.outcome == "passed"
    findings = list[Check]()
    if shared is not None:
        findings += _findings_over_time(shared, revisited=repeated and _revisited(rows, labels))
        if shared.scatter_rad:  # what the stated noise covers is the instrument's
            stated = found.sigma_given and adequacy.outcome != "failed"
            findings.append(_scatter(found, rows, shared.scatter_rad, covered=repeated or stated))
    sigma = found.sigma_m if shared is None else shared.independent_m
    if not found.sigma_given and sigma > COMMON_NOISE_M and not repeated:
        findings.append(finding("noise", sigma))
    return findings


def _findings_over_time(shared: ErrorModel, *, revisited: bool) -> list[Check]:
    """Findings of drift and of correlated errors; the white noise that was stated covers neither.

    Args:
        revisited: whether repeats show what time does, and passed the test of lack of fit.
    """
    findings = list[Check]()
    if shared.drift_m:
        fine = revisited and shared.drift_m < _COMMON_DRIFT_M
        whole_m = 2 * float(np.sqrt(3)) * shared.drift_m  # from its beginning to its end, of all three axes
        findings.append(finding("drift", whole_m, supported=fine))
    if shared.autocorrelated_m:
        fine = revisited and shared.autocorrelated_m < _COMMON_DRIFT_M
        findings.append(finding("correlated", shared.autocorrelated_m, supported=fine, correlation=shared.carry))
    return findings


def _scatter(found: Identification, rows: Measurements, scatter_rad: float, *, covered: bool) -> Check:
    """Finding of joint scatter, with the error that it makes of a point (m, root mean square)."""
    inputs = rows.inputs(found.model.conditions)
    slopes = by_joint_positions(found.model, inputs, found.values, rows.joints.shape[1])
    size_m = scatter_rad * float(np.sqrt(np.nanmean((slopes**2).sum(axis=(2, 3)))))
    return finding("scatter", size_m, supported=covered and size_m < COMMON_SCATTER_M, scatter_rad=scatter_rad)


def _revisited(rows: Measurements, labels: NDArray[np.int_]) -> bool:
    """Find a pose that was measured again after half of the campaign, so that its repeats show what time does."""
    times = row_times(rows)
    session = session_of(times)
    for each in np.unique(session):
        here = session == each
        span = np.ptp(times[here])
        for label in np.unique(labels[here]):
            if np.ptp(times[here & (labels == label)]) >= _TIME_SPAN_OF_REPEATS * span > 0:
                return True
    return False
