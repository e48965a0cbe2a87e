"""Read and write a noise model of ``result.json``."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lab.core.errors import LabError
from lab.core.units import MM
from lab.formats.structured import structured
from lab.noise.error_model import ErrorModel
from lab.noise.error_term import TERMS
from lab.noise.variance_components import ComponentErrors

__all__ = ["NoiseModel", "component_errors_of", "noise_model_from_dict", "noise_model_to_dict"]


def noise_model_to_dict(shared: ErrorModel | None, errors: ComponentErrors | None = None) -> dict[str, Any] | None:
    """Return shared errors, and the uncertainty of their variances if estimated, for ``result.json``."""
    if shared is None:
        return None
    uncertainty = None if errors is None else errors.to_dict()
    return {**shared.to_dict(), "component_errors": uncertainty, "words": list(shared.descriptions)}


@dataclass(frozen=True)
class _ComponentErrors:
    """Uncertainty of the variances of a noise model."""

    names: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]
    slopes: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        count, widths = len(self.names), {len(row) for row in self.slopes}
        if [len(row) for row in self.covariance] != [count] * count or len(self.slopes) != count or len(widths) > 1:
            raise LabError("component_errors: covariance and slopes have a row for each name")
        table = np.array(self.covariance).reshape(count, count)
        if not np.allclose(table, table.T) or (np.diag(table) < 0).any():
            raise LabError("component_errors.covariance: is not a covariance matrix")


@dataclass(frozen=True)
class NoiseModel:
    """Shared errors in ``result.json``."""

    independent_mm: float
    independent_share: float
    joint_scatter_mrad: float
    wandering_mm: float
    wandering_correlation: float
    drift_mm: float
    encoder_counts_rad: tuple[tuple[float, ...], ...] | None = None
    component_errors: _ComponentErrors | None = None
    further: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if min(self.independent_mm, *self.sizes.values()) < 0:
            raise LabError("noise_model: a standard deviation is below zero; it must not be")
        if any(len(row) != len(self.encoder_counts_rad or ()) for row in self.encoder_counts_rad or ()):
            raise LabError("noise_model: encoder_counts_rad has a row and a column for each joint")
        if not (0 < self.independent_share <= 1 and 0 <= self.wandering_correlation < 1):
            raise LabError("noise_model: the share is above 0 and at most 1, the correlation at least 0 and below 1")

    @property
    def sizes(self) -> dict[str, float]:
        """Standard deviations of the terms in SI units, by name."""
        return {term.name: term.unit.to_si(getattr(self, term.key)) for term in TERMS if term.key} | dict(self.further)


def component_errors_of(content: NoiseModel | None) -> ComponentErrors | None:
    """Return the uncertainty of a noise model's variances, or None."""
    errors = None if content is None else content.component_errors
    if errors is None:
        return None
    return ComponentErrors(errors.names, np.array(errors.covariance), np.array(errors.slopes))


def noise_model_from_dict(
    content: Mapping[str, Any] | NoiseModel | None, values: Mapping[str, float]
) -> ErrorModel | None:
    """Return the shared errors of a run, for measurements of another session.

    Args:
        content: made by ``noise_model_to_dict``.
        values: the run's parameters by name.
    """
    if content is None:
        return None
    model = structured("noise_model", NoiseModel, content, extra=True)
    return ErrorModel(
        sigma_m=MM.to_si(model.independent_mm) / np.sqrt(model.independent_share),
        independent_share=model.independent_share,
        sizes=model.sizes,
        carry=model.wandering_correlation,
        clock=None,
        values=values,
        counts_rad=None if model.encoder_counts_rad is None else np.array(model.encoder_counts_rad),
    )
