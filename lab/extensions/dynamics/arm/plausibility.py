"""Check whether identified arm dynamics are plausible: weight, torques and load.

Least squares fits any data: torques in another unit give links of tons whose residuals are noise. The gravity
torques identified are compared with those of the nominal masses, which a wrong unit changes by a thousand and
another arm of its kind by a few times.
"""

from collections.abc import Iterator

import numpy as np

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.significance import UNSOLICITED_WARNING
from lab.extensions.dynamics.arm.base_parameters import random_states
from lab.extensions.dynamics.arm.identify import DynamicModel, DynamicsEstimate, PhysicalFit
from lab.extensions.dynamics.payload.plausibility import ArmSize, Implausibility, implausibilities

__all__ = ["implausible_dynamics"]

_STATES = 200
_OTHER_UNIT = 30.0  # times what the nominal masses ask for: no arm of its kind
_WEAK = 5.0  # times less than the nominal masses need along random states
_STRONG = 10.0  # times the largest torque that they need: no friction and no motor adds so much
_UNEXPLAINED = 0.5  # of what torques change by
_CHANGES = 1e-9  # of their size: torques that change by less are constant
_SHOWS = 1e-6  # Nm or N: less gravity is none


def implausible_dynamics(
    found: DynamicsEstimate, model: DynamicModel, arm: ArmSize, nominal: Array | None, nearest: PhysicalFit | None
) -> tuple[Implausibility, ...]:
    """Return the reasons why identified parameters of an arm or of its load are implausible.

    Args:
        arm: what bounds the load.
        nominal: ``(b,)`` base parameters by the links' nominal masses; None where these are not given.
        nearest: the nearest physically consistent parameters; None where not every base parameter was identified.
    """
    with np.errstate(all="ignore"):  # what cannot be may overflow
        messages = [
            Implausibility(text)
            for text in (
                *_of_fit(found),
                *_of_weight(found, model, nominal),
                *_of_drives(found, model, nominal),
                *_of_bodies(nearest),
            )
        ]
        return (*messages, *(() if found.load is None else implausibilities(found.load, arm)))


def _of_fit(found: DynamicsEstimate) -> Iterator[str]:
    """Torques that do not follow the motion."""
    changes = float(np.sqrt(((found.measured - found.measured.mean(axis=0)) ** 2).sum()))
    left = float(np.sqrt((found.residual**2).sum()))
    if changes <= _CHANGES * float(np.sqrt((found.measured**2).sum())):
        yield "the torques do not change along the motion: are they of another record, or of drives that were off?"
    elif left > _UNEXPLAINED * changes:
        yield (
            f"the motion does not explain {100 * left / changes:.2g} % of what the torques change by: are torques and "
            "positions of the same motion, of the same joints, in the units of their columns?"
        )


def _of_weight(found: DynamicsEstimate, model: DynamicModel, nominal: Array | None) -> Iterator[str]:
    """Compare the identified gravity torques with those of the nominal masses, unless these are negligible."""
    if nominal is None:
        return
    seen, expected = (
        _gravity(model, np.where(found.identified, each, 0.0)) for each in (np.nan_to_num(found.values), nominal)
    )
    if expected < _SHOWS or 1 / _OTHER_UNIT < seen / expected < _OTHER_UNIT:
        return
    times = seen / expected
    cause = "are torques in another unit, or is gravity taken out of them?"
    if 1 / _OTHER_UNIT < times / 1e3 < _OTHER_UNIT:
        cause = "are torques in Nmm?"
    yield f"gravity asks {times:.3g} times what it asks of the arm's nominal masses: {cause}"


def _of_drives(found: DynamicsEstimate, model: DynamicModel, nominal: Array | None) -> Iterator[str]:
    """Drives whose torques are far less than their links need, or far more than any link does."""
    if nominal is None or not found.identified.all():
        return
    states = random_states(model.arm, _STATES, rng_for(0, "structure", 3))
    seen, expected = (np.sqrt((model.torques(each, states) ** 2).mean(axis=0)) for each in (found.values, nominal))
    for name, some, least in zip(model.chain.joint_names, seen, expected, strict=True):
        cause = "is its torque in another unit, a current, or without the gear ratio?"
        if some < least / _WEAK and least > _SHOWS:
            yield f"the drive of {name} gives {some / least:.2g} times the torque that the nominal masses need: {cause}"
        elif some > _STRONG * expected.max() > _SHOWS:
            times = some / expected.max()
            yield f"the drive of {name} gives {times:.2g} times the largest torque that nominal masses need: {cause}"


def _of_bodies(nearest: PhysicalFit | None) -> Iterator[str]:
    """Parameters that are further from those of an arm than the noise carries them."""
    if nearest is not None and nearest.p < UNSOLICITED_WARNING:
        yield (
            f"the parameters are {nearest.distance:,.4g} standard deviations from those of any arm, whose masses, "
            f"inertias and friction are positive (p = {nearest.p:.2g}): are the signs, the order and the units of the "
            "torques right, and does each drive turn its joint?"
        )


def _gravity(model: DynamicModel, values: Array) -> float:
    """Root mean square of the drives' torques at rest about their means, which hold the offsets."""
    joints, _, _ = random_states(model.arm, _STATES, rng_for(0, "structure", 3))
    still = np.zeros_like(joints)
    torques = model.torques(values, (joints, still, still))
    return float(np.sqrt(((torques - torques.mean(axis=0)) ** 2).mean()))
