"""What an identification says beyond its numbers: every parameter in full, stiffness, what is weakly observable."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from lab.calibration.gauss_newton import Observations
from lab.calibration.identifiability import Direction, aliases, column_scale, weak_directions
from lab.calibration.identify import WEAK, Identification
from lab.commands.values import number
from lab.core.linear_model import triangle_of
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import Parameter

__all__ = [
    "CorrelatedPair",
    "EstimatedParameter",
    "JointStiffness",
    "correlated_pairs",
    "direction_to_dict",
    "estimated_parameters",
    "stiffnesses",
    "weak_directions_of",
]

_CORRELATED = 0.95  # the least correlation that is called strong
Status = Literal["identified", "held", "not seen", "fixed"]


@dataclass(frozen=True)
class EstimatedParameter:
    """A parameter as it was identified, or why it was not; values in the parameter's SI unit, NaN where unknown.

    Attributes:
        nominal: its value in the nominal model, with base and tool fitted.
        exported: its value in the most likely arm among those that predict the same.
        half_width_95: of its 95 % interval.
        status: ``held`` at nominal on request, ``fixed`` there because an error of it cannot be distinguished from
            others', ``not seen`` at these poses.
        aliased_with: of one that is fixed, the parameters that an error of it goes into, and how much of it.
    """

    parameter: Parameter
    nominal: float
    estimate: float
    exported: float
    std: float
    half_width_95: float
    status: Status
    aliased_with: tuple[tuple[str, float], ...]

    @property
    def name(self) -> str:
        """The parameter's name."""
        return self.parameter.name

    @property
    def identified(self) -> bool:
        """Whether it was."""
        return self.status == "identified"

    @property
    def weakly_observable(self) -> bool:
        """Whether it was identified, but is known no better than to a millimetre or milliradian."""
        return self.identified and self.parameter.unit in ("m", "rad") and not self.std <= WEAK

    @property
    def interval_95(self) -> tuple[float, float] | None:
        """None where it is not known."""
        low, high = self.estimate - self.half_width_95, self.estimate + self.half_width_95
        return (low, high) if np.isfinite(low) and np.isfinite(high) else None

    def to_dict(self) -> dict[str, Any]:
        """A row of ``parameters.json``."""
        interval = self.interval_95
        return {
            "name": self.name,
            "unit": self.parameter.unit,
            "nominal": self.nominal,
            "estimate": self.estimate,
            "exported": self.exported,
            "std": number(self.std),
            "interval_95": None if interval is None else list(interval),
            "status": self.status,
            "weakly_observable": self.weakly_observable,
            "aliases": dict(self.aliased_with),
        }


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


def estimated_parameters(identification: Identification, exported: Array) -> tuple[EstimatedParameter, ...]:
    """Every parameter of a model, in its order.

    Args:
        exported: ``(p,)`` values of the most likely arm.
    """
    model, free = identification.model, list(identification.fit.free)
    std, half = np.full(len(model.names), np.nan), np.full(len(model.names), np.nan)
    std[free], half[free] = identification.std, identification.half_width_95 * identification.std
    scale = column_scale(model, identification.nominal_aligned)
    aliased = {alias.name: alias.into for alias in aliases(model, identification.base_set, scale)}
    return tuple(
        EstimatedParameter(
            parameter,
            float(identification.nominal_aligned[i]),
            float(identification.values[i]),
            float(exported[i]),
            float(std[i]),
            float(half[i]),
            _status(identification, i),
            aliased.get(parameter.name, ()),
        )
        for i, parameter in enumerate(model.parameters)
    )


def _status(identification: Identification, parameter: int) -> Status:
    if parameter in identification.fit.free:
        return "identified"
    if parameter in identification.base_set.held:
        return "held"
    return "not seen" if parameter in identification.unobservable else "fixed"


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
