"""The noise model of a set of measurements: which errors its numbers share, outliers aside."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from lab.calibration.identify import Identification
from lab.calibration.noise.search import NoiseSearch, in_stretches, search_noise
from lab.calibration.noise.shared_errors import SharedErrors, counted
from lab.calibration.noise.small_samples import ComponentErrors
from lab.calibration.observation import observation_of, only_positions
from lab.calibration.statistics.outliers import Outliers
from lab.calibration.weights import Noise, weighed
from lab.core.errors import LabError
from lab.core.measurements import Measurements, seen_mask
from lab.formats.structured import structured
from lab.kinematics.encoders import Encoders

__all__ = [
    "Fits",
    "NoiseModel",
    "component_errors_from_dict",
    "noise_model_from_dict",
    "noise_model_to_dict",
    "noise_of",
]

_ROUNDS = 3  # of outliers and the noise that they are judged by


class Fits(Protocol):
    """One model's fit of any rows, by the noise that it is given."""

    @property
    def noise(self) -> Noise:
        """Of the instrument."""

    @property
    def encoders(self) -> Encoders | None:
        """Whose whole counts the joint positions are; None for ideal ones."""

    def fitted(self, rows: Measurements, shared: SharedErrors | None) -> Identification:
        """The identification from all these rows."""

    def outliers(self, found: Identification, rows: Measurements, shared: SharedErrors | None) -> Outliers:
        """The poses that are off."""


@dataclass(frozen=True)
class _Explanation:
    """Errors that are shared, and poses that are off.

    Attributes:
        off: ``(o,)`` rows.
        deviance: minus twice the log-likelihood, with outliers anywhere among the residuals.
    """

    search: NoiseSearch
    off: frozenset[int]
    deviance: float


def noise_of(fits: Fits, rows: Measurements) -> NoiseSearch:
    """The errors that rows share, from those that are not off.

    Bad readings look like scatter, and scatter looks like bad readings. Both are tried first; where the explanations
    differ, that of the larger likelihood is taken, in which a bad reading is equally likely everywhere among the
    residuals. What whole counts of known encoders make is weighed before anything is looked for. Of a fit that ended
    in a valley nothing is: its parameters are not to be used, and what it leaves is not the noise. Of very many rows
    some stretches tell.
    """
    rows = in_stretches(rows)
    whole = fits.fitted(rows, None)
    if (counts := _counted(whole, rows, fits.encoders)) is not None:
        whole = fits.fitted(rows, counts)
    if whole.status == "in a valley":
        return NoiseSearch(counts, (), float("nan"))
    search = search_noise(whole, rows, replace(fits.noise, shared=counts))
    off = _rows(fits.outliers(whole, rows, counts))
    if not off and search.shared is counts:
        return search
    reach = _reach(whole, rows, fits.noise)
    explanations = []
    if search.shared is not counts:
        first = _Explanation(search, frozenset(), search.deviance)
        explanations.append(_settled(fits, rows, first, reach, counts))
    if off:
        explanations.append(_settled(fits, rows, _without(fits, rows, off, reach, counts), reach, counts))
    return min(explanations, key=lambda each: each.deviance).search


def _counted(whole: Identification, rows: Measurements, encoders: Encoders | None) -> SharedErrors | None:
    """What whole counts of the encoders make, where that is known and not little."""
    observation = observation_of(whole.model)
    if encoders is None or not only_positions(observation):
        return None
    dof = None if whole.sigma_known else whole.dof
    return counted(observation.model, rows, whole.values, encoders, whole.sigma_m, dof)


def noise_model_to_dict(shared: SharedErrors | None, errors: ComponentErrors | None = None) -> dict[str, Any] | None:
    """Shared errors as ``result.json`` holds them; None where there are none.

    Args:
        errors: how well their variances are known; None where these are not estimates.
    """
    if shared is None:
        return None
    return {
        "independent_mm": 1e3 * shared.independent_m,
        "independent_share": shared.independent_share,
        "joint_scatter_mrad": 1e3 * shared.scatter_rad,
        "wandering_mm": 1e3 * shared.wandering_m,
        "wandering_correlation": shared.carry,
        "drift_mm": 1e3 * shared.drift_m,
        "step_mm": 1e3 * shared.step_m,
        "moves": [{"before": move.before, "after": move.after, "size_mm": 1e3 * move.size_m} for move in shared.moves],
        "encoder_counts_rad": None if shared.counts_rad is None else shared.counts_rad.tolist(),
        "component_errors": None
        if errors is None
        else {
            "names": list(errors.names),
            "covariance": errors.covariance.tolist(),
            "slopes": errors.slopes.tolist(),
        },
        "words": list(shared.words),
    }


@dataclass(frozen=True)
class _ComponentErrors:
    """The uncertainty of the variances of a noise model."""

    names: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]
    slopes: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        """Refuse tables of other sizes than the names', and what is no covariance, with a LabError."""
        count, widths = len(self.names), {len(row) for row in self.slopes}
        if [len(row) for row in self.covariance] != [count] * count or len(self.slopes) != count or len(widths) > 1:
            raise LabError("component_errors: covariance and slopes have a row for each name")
        table = np.array(self.covariance).reshape(count, count)
        if not np.allclose(table, table.T) or (np.diag(table) < 0).any():
            raise LabError("component_errors.covariance: is no covariance")


@dataclass(frozen=True)
class _Move:
    """A move of the base or the instrument as ``result.json`` holds it; its keys."""

    before: str
    after: str
    size_mm: float

    def __post_init__(self) -> None:
        """Refuse what is no size, with a LabError."""
        if self.size_mm < 0:
            raise LabError("noise_model.moves: a size is not below zero")


@dataclass(frozen=True)
class NoiseModel:
    """Shared errors as ``result.json`` holds them; its keys."""

    independent_mm: float
    independent_share: float
    joint_scatter_mrad: float
    wandering_mm: float
    wandering_correlation: float
    drift_mm: float
    encoder_counts_rad: tuple[tuple[float, ...], ...] | None = None
    step_mm: float = 0.0
    component_errors: _ComponentErrors | None = None
    moves: tuple[_Move, ...] = ()

    def __post_init__(self) -> None:
        """Refuse what is no size, share or correlation, with a LabError."""
        sizes = (self.independent_mm, self.joint_scatter_mrad, self.wandering_mm, self.drift_mm, self.step_mm)
        if min(sizes) < 0:
            raise LabError("noise_model: a standard deviation is not below zero")
        if any(len(row) != len(self.encoder_counts_rad or ()) for row in self.encoder_counts_rad or ()):
            raise LabError("noise_model: encoder_counts_rad has a row and a column for each joint")
        if not (0 < self.independent_share <= 1 and 0 <= self.wandering_correlation < 1):
            raise LabError("noise_model: the share is above 0 and at most 1, the correlation at least 0 and below 1")


def component_errors_from_dict(content: NoiseModel | None) -> ComponentErrors | None:
    """How well the variances of a noise model are known, that ``noise_model_to_dict`` made; None where it is not said.

    Args:
        content: the noise model; None where there is none.
    """
    found = None if content is None else content.component_errors
    if found is None:
        return None
    return ComponentErrors(found.names, np.array(found.covariance), np.array(found.slopes))


def noise_model_from_dict(
    content: Mapping[str, Any] | NoiseModel | None, values: Mapping[str, float]
) -> SharedErrors | None:
    """Shared errors of a run, for measurements of another day.

    Args:
        content: what ``noise_model_to_dict`` made.
        values: the run's parameters by name.

    Raises:
        LabError: it lacks a number, or one is not possible.
    """
    if content is None:
        return None
    found = structured("noise_model", NoiseModel, content, extra=True)
    return SharedErrors(
        sigma_m=found.independent_mm / 1e3 / np.sqrt(found.independent_share),
        independent_share=found.independent_share,
        scatter_rad=found.joint_scatter_mrad / 1e3,
        wandering_m=found.wandering_mm / 1e3,
        carry=found.wandering_correlation,
        drift_m=found.drift_mm / 1e3,
        clock=None,
        values=values,
        counts_rad=None if found.encoder_counts_rad is None else np.array(found.encoder_counts_rad),
        step_m=found.step_mm / 1e3,
    )


def _settled(
    fits: Fits, rows: Measurements, first: _Explanation, reach: float, counts: SharedErrors | None
) -> _Explanation:
    """The explanation whose outliers are those of its own noise."""
    here = first
    for _ in range(_ROUNDS):
        shared = here.search.shared
        off = _rows(fits.outliers(fits.fitted(rows, shared), rows, shared))
        if off == here.off:
            break
        here = _without(fits, rows, off, reach, counts)
    return here


def _without(
    fits: Fits, rows: Measurements, off: frozenset[int], reach: float, counts: SharedErrors | None
) -> _Explanation:
    """The noise of the other rows; all rows' where these are too few."""
    clean = rows.take(np.setdiff1d(np.arange(len(rows)), sorted(off)))
    search = search_noise(fits.fitted(clean, counts), clean, replace(fits.noise, shared=counts))
    numbers = 3 * int(rows.seen[sorted(off)].sum())
    return _Explanation(search, off, search.deviance + numbers * (2 * np.log(2 * reach) - np.log(2 * np.pi)))


def _rows(found: Outliers) -> frozenset[int]:
    return frozenset(found.rows.tolist())


def _reach(found: Identification, rows: Measurements, noise: Noise) -> float:
    """The largest residual of a number, in units of the instrument's noise as it is assumed."""
    observed, _ = weighed(observation_of(found.model), rows, replace(noise, shared=None))
    residuals = observed.points - found.model.points(observed.inputs, found.values)
    white = observed.in_units_of_noise(np.where(seen_mask(observed.points)[..., None], residuals, 0.0))
    return float(max(np.abs(white).max(), 1e-300))
