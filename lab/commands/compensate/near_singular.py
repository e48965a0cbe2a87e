"""The corrected targets that are close to a singularity, where joints move far for a little."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lab.compensation.compensator import Compensation
from lab.compensation.ik_results import NEAR_RAD
from lab.kinematics.joints import JointSpec

__all__ = ["NearSingular", "near_singular"]


@dataclass(frozen=True)
class NearSingular:
    """A target that is reached within 1 degree of a singularity.

    Attributes:
        joint: the one that would have to move most to get there.
        distance: how far (rad; m where that joint slides).
    """

    id: str
    joint: str
    distance: float
    slides: bool

    def to_dict(self) -> dict[str, Any]:
        """As plain values: degrees, or mm of a slide."""
        unit, scale = ("mm", 1e3) if self.slides else ("deg", 180 / np.pi)
        return {"id": self.id, "joint": self.joint, f"distance_{unit}": scale * self.distance}


def near_singular(found: Compensation, chain: JointSpec, ids: Sequence[str]) -> tuple[NearSingular, ...]:
    """The targets that are reached within 1 degree of a singularity.

    Args:
        ids: of all targets, ``(n,)``.
    """
    rows = np.flatnonzero(found.converged & (found.singular_rad < NEAR_RAD))
    return tuple(
        NearSingular(
            ids[i],
            chain.joint_names[found.singular_joint[i]],
            float(found.singular_rad[i]),
            chain.prismatic[found.singular_joint[i]],
        )
        for i in rows.tolist()
    )
