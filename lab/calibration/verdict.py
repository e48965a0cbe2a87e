"""The verdict on a calibration: good, bad and why, or not judged."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from lab.calibration.identify import Identification
from lab.calibration.observations.protocol import observation_of
from lab.calibration.validation import Validation

__all__ = ["Verdict", "rotation_noise_rad", "verdict"]

CONSTANT_SPREAD = 1e-6  # of what was measured, to the nominal model's: below, it does not change from pose to pose
LARGEST_CHANGE_M = 20e-3  # of a link where only fixtures hold the arm: no larger error is real, but both may shrink
LARGEST_ROTATION_RAD = 50e-3  # of measured orientations' residuals: no probe is that bad, and no calibration needs it


@dataclass(frozen=True)
class Verdict:
    """``good``, ``bad`` or ``not judged``, with the reason where it is bad."""

    word: Literal["good", "bad", "not judged"]
    reason: str = ""


def verdict(identification: Identification, validation: Validation, gate_m: float) -> Verdict:
    """Bad: what cannot be of this arm, not converged, rank short of the base set, or a mean error above the gate.

    Args:
        identification: the fit.
        validation: its errors on poses that were not fitted.
        gate_m: a larger mean error there is bad.
    """
    if identification.spread < CONSTANT_SPREAD:
        return Verdict("bad", "what was measured is the same in every pose: wrong column?")
    if not identification.plausible:
        times = f"{identification.spread:.3g} times as far as the robot's do in these poses"
        return Verdict("bad", f"the measured points spread {times}: wrong unit, or another robot")
    if identification.status != "converged":
        return Verdict(
            "bad",
            "Gauss-Newton did not converge: wrong robot, signs or axes, or too little measured for these (--prior)?",
        )
    if reason := _implausible(identification):
        return Verdict("bad", reason)
    if identification.unobservable:
        names = [identification.model.names[i] for i in identification.unobservable]
        return Verdict(
            "bad", f"{', '.join(names)} {'are' if len(names) > 1 else 'is'} not identifiable from these poses"
        )
    if validation.errors is None:
        return Verdict("not judged")
    mean = float(np.nanmean(validation.errors.after))
    if mean > gate_m:
        guess = "" if np.isnan(rotation_noise_rad(identification)) else "; wrong --orientation?"
        reason = f"does not fit: {1e3 * mean:.3g} mm on poses not fitted, above the gate of {1e3 * gate_m:g} mm{guess}"
        return Verdict("bad", reason)
    return Verdict("good")


def rotation_noise_rad(identification: Identification) -> float:
    """Noise (rad) of a measured rotation where ``sigma_m`` is a position's; NaN where no orientation is observed."""
    observation = observation_of(identification.model)
    rotations = observation.units[observation.positions :] if observation.positions else np.empty(0)
    return float(identification.sigma_m * rotations[0]) if len(rotations) else float("nan")


def _implausible(identification: Identification) -> str:
    """Why a fit that converged cannot be of this arm; empty if it can."""
    model, observation = identification.model, observation_of(identification.model)
    if observation.positions:
        rotations = identification.residuals[:, observation.positions :]
        off = float(np.sqrt(np.nanmean(rotations**2))) if np.isfinite(rotations).any() else 0.0
        words = f"measured orientations do not fit ({1e3 * off:.3g} mrad): wrong --orientation or columns?"
        return words if off > LARGEST_ROTATION_RAD else ""
    lengths = [i for i, each in enumerate(model.parameters) if each.is_link and each.kind == "length"]
    off = float(np.abs(identification.values - identification.nominal_aligned)[lengths].max())
    words = f"a link is estimated {1e3 * off:.3g} mm from its nominal length: these fixtures do not constrain the arm"
    return f"{words}; wrong columns or rows, or is --prior needed?" if off > LARGEST_CHANGE_M else ""
