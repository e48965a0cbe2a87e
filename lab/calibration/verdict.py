"""The verdict on a calibration: good, bad and why, or not judged."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from lab.calibration.identify import Identification
from lab.calibration.observations.protocol import observation_of
from lab.calibration.validation import Validation

CONSTANT_SPREAD = 1e-6  # of what was measured, to the drawing's: below, it does not change from pose to pose
LARGEST_CHANGE_M = 20e-3  # of a link where only places hold the arm: no drawing is that wrong, but arm and place shrink
LARGEST_ROTATION_RAD = 50e-3  # left of measured orientations: no probe is that bad, and no calibration needs it


@dataclass(frozen=True)
class Verdict:
    """``good``, ``bad`` or ``not judged``, with the reason where it is bad."""

    word: Literal["good", "bad", "not judged"]
    reason: str = ""


def verdict(identification: Identification, validation: Validation, gate_m: float) -> Verdict:
    """Bad: what cannot be of this arm, not converged, rank short of the base set, or a mean error above the gate."""
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
        names = ", ".join(identification.model.names[i] for i in identification.unobservable)
        return Verdict("bad", f"these poses do not tell {names} apart from the others")
    if validation.errors is None:
        return Verdict("not judged")
    mean = float(np.nanmean(validation.errors.after))
    if mean > gate_m:
        guess = "" if np.isnan(rotation_noise_rad(identification)) else "; wrong --orientation?"
        reason = f"does not fit: {1e3 * mean:.3g} mm on poses not fitted, above the gate of {1e3 * gate_m:g} mm{guess}"
        return Verdict("bad", reason)
    return Verdict("good")


def rotation_noise_rad(identification: Identification) -> float:
    """Noise of a measured rotation beside ``sigma_m``, that of a position; NaN where no orientation is observed."""
    observation = observation_of(identification.model)
    turning = observation.units[observation.positions :] if observation.positions else np.empty(0)
    return float(identification.sigma_m * turning[0]) if len(turning) else float("nan")


def _implausible(identification: Identification) -> str:
    """What a fit gives that is of nothing measured, though it converged; empty if nothing does."""
    model, observation = identification.model, observation_of(identification.model)
    if observation.positions:
        turned = identification.residuals[:, observation.positions :]
        off = float(np.sqrt(np.nanmean(turned**2))) if np.isfinite(turned).any() else 0.0
        words = f"measured orientations do not fit ({1e3 * off:.3g} mrad): wrong --orientation or columns?"
        return words if off > LARGEST_ROTATION_RAD else ""
    lengths = [i for i, each in enumerate(model.parameters) if each.is_link and each.kind == "length"]
    off = float(np.abs(identification.values - identification.nominal_aligned)[lengths].max())
    words = f"the links came out {1e3 * off:.3g} mm from the drawing: these places do not hold the arm"
    return f"{words}; wrong columns or rows, or is --prior needed?" if off > LARGEST_CHANGE_M else ""
