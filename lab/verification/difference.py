"""Test whether two calibrations of one robot differ, and which parameters moved in between.

Two campaigns are independent, so the difference of their estimates has the sum of their covariances: d' (C1 + C2)^-1 d
is chi squared where the noise of both is given, else F (Seber & Lee 2003, section 4.3). Parameters are named by Holm's
procedure (1979), so that of an unchanged robot one is named in at most 1 % of the comparisons.
"""

from dataclasses import dataclass

import numpy as np

from lab.calibration.estimate import IdentifiedSubset
from lab.core.linear_model import half_width_95, p_value_of_squares
from lab.core.probability import t_sf
from lab.core.se3 import Array
from lab.core.significance import VERIFICATION

__all__ = ["Difference", "difference_of"]


@dataclass(frozen=True)
class Difference:
    """The second calibration less the first.

    Attributes:
        names: of the parameters ``(f,)``.
        changes, half_widths: ``(f,)`` differences with half of their 95 % intervals.
        p: the chance of differences as large, of all parameters together, if nothing has changed.
        moved: the parameters that have, the surest first.
    """

    names: tuple[str, ...]
    changes: Array
    half_widths: Array
    p: float
    moved: tuple[str, ...]

    @property
    def changed(self) -> bool:
        """Check whether the test of all parameters rejects at a level of 1 %."""
        return self.p < VERIFICATION


def difference_of(first: IdentifiedSubset, second: IdentifiedSubset) -> Difference:
    """Compare two calibrations that identified the same parameters."""
    assert first.names == second.names
    changes = second.values - first.values
    turns = np.array(first.is_angle)
    changes = np.where(turns, np.remainder(changes + np.pi, 2 * np.pi) - np.pi, changes)
    covariance = first.covariance + second.covariance
    known = [dof for dof in (first.dof, second.dof) if dof is not None]
    dof = min(known) if known else None
    std = np.sqrt(np.diag(covariance))
    z = changes / std
    square = float(z @ np.linalg.solve(covariance / np.outer(std, std), z))
    p = float(p_value_of_squares(square, len(z), dof))
    freedom = np.inf if dof is None else float(dof)
    moved = _holm(2 * t_sf(np.abs(z), freedom)) if p < VERIFICATION else []
    half_widths = half_width_95(freedom) * std
    return Difference(first.names, changes, half_widths, p, tuple(first.names[i] for i in moved))


def _holm(p_values: Array) -> list[int]:
    """Return the hypotheses that Holm's procedure rejects, the smallest p first."""
    order = np.argsort(p_values, kind="stable")
    rejected = []
    for rank, i in enumerate(order.tolist()):
        if p_values[i] >= VERIFICATION / (len(p_values) - rank):
            break
        rejected.append(i)
    return rejected
