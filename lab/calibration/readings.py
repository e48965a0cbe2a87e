"""What observations owe to the joint readings."""

import numpy as np

from lab.frames import Array
from lab.geometry.model import Model

STEP = 1e-6  # rad or m, of central differences: exact to about 1e-10 of a lever


def by_readings(model: Model, settings: Array, values: Array, joints: int) -> Array:
    """Derivatives ``(n, k, d, joints)`` of observations by the readings, the first columns of ``settings``."""
    columns = []
    for joint in range(joints):
        step = np.zeros(settings.shape[1])
        step[joint] = STEP
        ahead, behind = (model.points(settings + sign * step, values) for sign in (1, -1))
        columns.append((ahead - behind) / (2 * STEP))
    return np.stack(columns, axis=-1)
