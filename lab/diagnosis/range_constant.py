"""Range errors of a tracker as a fit found them: their size, what they do to the arm, and when they are a finding."""

from dataclasses import dataclass

import numpy as np

from lab.calibration.identification import Identification
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.diagnosis.hypothesis import Finding, Hypothesis
from lab.kinematics.effects.effect import FREE_RANGE
from lab.kinematics.effects.range_errors import CONSTANT, SCALE

__all__ = ["FittedRange", "fitted_range", "range_findings"]

_POSES = 200  # at which displacements are compared
_LEAST_M, _LEAST_SIGMAS = 1e-4, 3.0  # a constant beyond both is a finding
_LACKING_SIGMAS = 5.0  # beside a model that lacks effects, which look like a constant in part


@dataclass(frozen=True)
class FittedRange:
    """Range errors of a fit.

    Attributes:
        constant_m, std_m: of the range, with its standard deviation.
        half_width_95_m: half of its 95 % interval.
        prior_m: standard deviation that was stated of it; None where it was free.
        scale_std: standard deviation of the scale, relative: lengths have it, too, as nothing else tells them apart.
        in_frame: how far an error of one in the constant moves the arm's points in the instrument's frame.
        in_shape: how far it moves them relative to the base.
    """

    constant_m: float
    std_m: float
    half_width_95_m: float
    prior_m: float | None
    scale_std: float
    in_frame: float
    in_shape: float


def fitted_range(found: Identification) -> FittedRange | None:
    """Return the range errors of a fit; None where it has no constant, or the noise is unknown."""
    names = [found.model.names[i] for i in found.fit.free]
    if CONSTANT not in names or not np.isfinite(found.covariance).all():
        return None
    at, stds = names.index(CONSTANT), found.std
    constant = found.model.parameters[found.fit.free[at]]
    in_frame, in_shape = _moved_by_constant(found, names)
    return FittedRange(
        constant_m=float(found.values[found.fit.free[at]]),
        std_m=float(stds[at]),
        half_width_95_m=float(found.half_width_95[at] * stds[at]),
        prior_m=constant.scale if constant.scale < FREE_RANGE.constant_m else None,
        scale_std=float(stds[names.index(SCALE)]) if SCALE in names else 0.0,
        in_frame=in_frame,
        in_shape=in_shape,
    )


def _moved_by_constant(found: Identification, names: list[str]) -> tuple[float, float]:
    """Return the root mean square displacement of the arm's points by an error of one in the constant.

    The other parameters err with it by C_ic / C_cc, of their covariance C.

    Returns:
        It in the instrument's frame, and relative to the base: without the base's own part.
    """
    model, of_range = found.model, (CONSTANT, SCALE)
    shared = found.covariance[:, names.index(CONSTANT)]
    moves: Array = shared / shared[names.index(CONSTANT)]
    moves[[i for i, name in enumerate(names) if name in of_range]] = 0.0
    # the arm itself, without what its instrument measures wrongly
    true = found.values.copy()
    true[[i for i, name in enumerate(model.names) if name in of_range]] = 0.0
    inputs = model.structure_joints(_POSES, rng_for(0, "structure"))
    slopes = model.observe(inputs, true)[1][..., list(found.fit.free)]
    without_base = moves * [model.parameters[i].group != "base" for i in found.fit.free]
    frame, shape = (np.sqrt(np.nanmean(((slopes @ each) ** 2).sum(axis=-1))) for each in (moves, without_base))
    return float(frame), float(shape)


def range_findings(identification: Identification, *, adequate: bool = True) -> list[Finding]:
    """Return the range constant as a finding, where it is beyond 0.1 mm and three standard deviations; else nothing.

    It is in the fit already: the finding says so, with what the fit would miss without it.

    Args:
        adequate: whether no lack of fit was found; beside one a constant is a finding beyond five standard deviations.
    """
    found, sigmas = fitted_range(identification), _LEAST_SIGMAS if adequate else _LACKING_SIGMAS
    if found is None:
        return []
    # where the residuals are more than the stated noise, they are the measure
    larger = max(float(np.nan_to_num(identification.residual_sigma_m / identification.sigma_m, nan=1.0)), 1.0)
    std_m = larger * found.std_m
    if abs(found.constant_m) <= max(_LEAST_M, sigmas * std_m):
        return []
    evidence = (found.constant_m / std_m) ** 2
    points = int(np.isfinite(identification.residuals).all(axis=-1).sum())
    hypothesis = Hypothesis(
        "range_constant",
        of=("instrument",),
        units=("m",),
        data=(("in_frame", found.in_frame), ("in_shape", found.in_shape)),
    )
    explains_m = float(larger * identification.sigma_m * np.sqrt(evidence / points))
    return [Finding(hypothesis, evidence, (found.constant_m,), (std_m,), explains_m, accepted=True)]
