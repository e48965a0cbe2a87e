"""What a perturbed arm is, in the canonical gauge."""

import numpy as np

from helpers.robots import perturbed, somewhere
from lab.core import se3
from lab.kinematics.gauge import base_set
from lab.kinematics.serial.axes_to_dh import Truth
from lab.kinematics.serial.serial_arm import SerialArm


def truth_of(arm: SerialArm, rng: np.random.Generator, base: bool = True):
    """A true vector in the gauge of the arm, with the base anywhere."""
    start = somewhere(arm, rng)
    if base:
        start[:3] = 3 * rng.normal(size=3)
        start[3:6] = se3.log(se3.exp(3 * rng.normal(size=3)))
    structure = base_set(arm, arm.nominal())
    true = start.copy()
    kept = list(structure.identifiable)
    true[kept] = perturbed(arm, start, rng, 0.5e-3, 1.5e-3)[kept]
    return Truth(arm, true, structure)
