"""Explanations of the load's effect that these poses cannot tell apart: joint springs, bending links, twisting links.

A chosen group is put aside for another one that bears loads as well, and the arm is identified anew. If that fits as
well, the result is one explanation of two, and what would tell them apart is the pose and payload at which the two arms
differ most. What is compared is the likelihood alone: that one explanation has more parameters says nothing against it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lab.calibration.identify import Identification
from lab.calibration.statistics.candidate_models import SelectionTask
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.effects.effect import absent
from lab.kinematics.effects.sessions import at_first_station

__all__ = ["LOADED_GROUPS", "Alternative", "alternatives"]

LOADED_GROUPS = ("compliance", "bending", "torsion")
_STRONG = 10.0  # of twice the log likelihood: very strong evidence (Kass & Raftery 1995, section 3.2)
_POSES = 400


@dataclass(frozen=True)
class Alternative:
    """Another explanation that fits as well.

    Attributes:
        chosen, other: the groups.
        fit_rise: by how much twice the negative log likelihood rises with the other one instead; negative where that
            fits better.
        inputs: ``(joints + conditions,)`` the pose, of random ones, at which the two arms differ most.
        differ_m: by how much they differ there (m).
        sigma_m: noise of a coordinate.
    """

    chosen: str
    other: str
    fit_rise: float
    inputs: Array
    differ_m: float
    sigma_m: float

    @property
    def is_distinguishable(self) -> bool:
        """Check whether a measurement at that pose would distinguish the two models."""
        return self.differ_m > 3 * self.sigma_m


def alternatives(
    task: SelectionTask, taken: Sequence[str], found: Identification, candidates: Sequence[str], fixed: Sequence[str]
) -> tuple[Alternative, ...]:
    """For each chosen group that bears loads, the others that would do as well in its place.

    Args:
        fixed: parameters that are not fitted.
    """
    messages = []
    for chosen in (name for name in taken if name in LOADED_GROUPS):
        for other in (name for name in LOADED_GROUPS if name in candidates and name not in taken):
            groups = [other if name == chosen else name for name in taken]
            known = set(task.parameters(other)) | set(found.model.names)
            swapped = task.identified(groups, [name for name in fixed if name in known - task.parameters(chosen)])
            rise = _misfit(swapped) - _misfit(found)
            if swapped.status == "converged" and rise < _STRONG:
                messages.append(_compared(chosen, other, rise, found, swapped))
    return tuple(messages)


def _misfit(found: Identification) -> float:
    """Return twice the negative log likelihood, but for the terms common to all models of the same measurements."""
    squares, rows = 2 * found.fit.cost_trace[-1], found.dof + len(found.fit.free)
    return float(squares if found.sigma_given else rows * np.log(max(squares, 1e-300)))


def _compared(chosen: str, other: str, rise: float, found: Identification, swapped: Identification) -> Alternative:
    """Compare two models at the pose where their points differ most."""
    model = found.model
    inputs = at_first_station(model.conditions, model.structure_joints(_POSES, rng_for(0, "structure")))
    size = inputs.shape[1] - len(found.model.conditions)
    column = {name: inputs[:, size + i] for i, name in enumerate(found.model.conditions)}
    others = [column.get(name, absent(name, _POSES)) for name in swapped.model.conditions]
    there = np.column_stack([inputs[:, :size], *others])
    apart = np.linalg.norm(
        found.model.points(inputs, found.values) - swapped.model.points(there, swapped.values), axis=2
    )
    worst = int(apart.max(axis=1).argmax())
    return Alternative(chosen, other, float(rise), inputs[worst], float(apart[worst].max()), found.sigma_m)
