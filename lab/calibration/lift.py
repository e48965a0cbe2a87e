"""The most likely arm among all that predict the same: what is exported.

The canonical gauge holds some parameters at nominal, and errors of these go into others. Among
all arms with the same predictions the drawing's tolerances make one most likely: its errors are
spread over each aliased group by their variances. It is the same whichever of a group was kept.
"""

import numpy as np

from lab.calibration.identify import Identification
from lab.calibration.locate import columns_of
from lab.calibration.prior import Tolerance, gather, standard_deviations
from lab.frames import Array
from lab.geometry.gauge import STRUCTURE_POSES
from lab.seeds import stream

STEPS = 8
SETTLED = 1e-12  # of the parameters' standard deviations


def lift(identification: Identification, nominal: Array, tolerance: Tolerance, placed: tuple[str, ...]) -> Array:
    """Parameters ``(p,)`` of least prior-weighted norm that predict what the identified ones do.

    They are x = x0 + S B' w, with S the prior's covariance and B the directions in which the drawing's
    predictions change (``prior.gather``): w is found by Gauss-Newton on the predictions themselves,
    so that these are equal to rounding, not to first order. With parameters held on request the
    arm is what was asked for, and stays as it is.

    Args:
        nominal: the drawing's parameters ``(p,)``.
        placed: groups that have no drawing.
    """
    model, structure = identification.model, identification.base_set
    if structure.held:
        return identification.values
    settings = model.structure_joints(STRUCTURE_POSES, stream(0, "structure"))
    wanted = model.points(settings, identification.values)
    sigma = standard_deviations(model, tolerance, placed)
    directions = sigma[:, None] ** 2 * gather(structure, len(model.names)).T
    directions /= np.linalg.norm(directions / sigma[:, None], axis=0)
    values = nominal.copy()
    apart = list(columns_of(model, placed))
    values[apart] = identification.values[apart]
    for _ in range(STEPS):
        points, jacobian = model.observe(settings, values)
        rows = jacobian.reshape(-1, len(values)) @ directions
        scale = np.linalg.norm(rows, axis=0)
        step = np.linalg.lstsq(rows / scale, (wanted - points).ravel(), rcond=1e-12)[0] / scale
        values += directions @ step
        if np.abs(directions @ step / sigma).max() < SETTLED:
            break
    return values
