"""Stiffnesses, correlated parameters and weakly observable directions of an identification."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from lab.calibration.gauss_newton import Observations
from lab.calibration.identifiability import Direction, weak_directions
from lab.calibration.identify import Identification
from lab.core.linear_model import triangle_of
from lab.core.measurements import Measurements
from lab.kinematics.joints import JointSpec

__all__ = [
    "CorrelatedPair",
    "JointStiffness",
    "correlated_pairs",
    "direction_to_dict",
    "stiffnesses",
    "weak_directions_of",
]

_CORRELATED = 0.95  # the least correlation that is called strong


@dataclass(frozen=True)
class JointStiffness:
    """Stiffness of a joint and its standard deviation, Nm/rad; NaN where that is not known."""

    joint: str
    stiffness: float
    std: float


@dataclass(frozen=True)
class CorrelatedPair:
    """Two parameters whose errors are strongly correlated."""

    names: tuple[str, str]
    correlation: float

    def to_dict(self) -> dict[str, Any]:
        """An entry of ``correlated`` in ``result.json``."""
        return {"parameters": list(self.names), "correlation": self.correlation}


def stiffnesses(identification: Identification, chain: JointSpec) -> tuple[JointStiffness, ...]:
    """Stiffness of the hinges whose compliance was fitted and is above zero."""
    found = []
    for i, std in zip(identification.fit.free, identification.std, strict=True):
        parameter, compliance = identification.model.parameters[i], float(identification.values[i])
        joint = parameter.joint
        if parameter.kind == "compliance" and joint is not None and compliance > 0 and not chain.prismatic[joint]:
            found.append(JointStiffness(chain.joint_names[joint], 1 / compliance, float(std) / compliance**2))
    return tuple(found)


def correlated_pairs(identification: Identification) -> tuple[CorrelatedPair, ...]:
    """Pairs of identified parameters that are strongly correlated, the strongest first."""
    names, std = [identification.model.names[i] for i in identification.fit.free], identification.std
    if not (np.isfinite(std).all() and (std > 0).all()):
        return ()
    matrix = np.triu(identification.covariance / np.outer(std, std), 1)
    pairs = np.argwhere(np.abs(matrix) > _CORRELATED)
    order = sorted(pairs.tolist(), key=lambda pair: -abs(matrix[pair[0], pair[1]]))
    return tuple(CorrelatedPair((names[i], names[j]), round(float(matrix[i, j]), 4)) for i, j in order)


def weak_directions_of(identification: Identification, fitted: Measurements) -> tuple[Direction, ...]:
    """Directions of the identified parameters that the fitted measurements hardly observe."""
    model, free = identification.model, list(identification.fit.free)
    seen = Observations(fitted.inputs(model.conditions), fitted.points, np.ones(fitted.points.shape[:2]))
    triangle = triangle_of(
        each.apply(model.observe(each.inputs, identification.values)[1][..., free]) for each in seen.blocks()
    )
    return weak_directions(
        [model.names[i] for i in free], triangle, rows=int(fitted.seen.sum() * fitted.points.shape[2])
    )


def direction_to_dict(direction: Direction) -> dict[str, Any]:
    """A weak direction as plain values; ``parts`` in SI units."""
    return {
        "singular_value": direction.singular_value,
        "moved_mm": 1e3 * direction.moved,
        "parts": dict(direction.parts),
    }
