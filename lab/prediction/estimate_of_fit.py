"""Make the estimate of an identification: as far as it holds in other sessions."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from lab.calibration.identifiability import aliases, column_scale
from lab.calibration.identification import WEAK, Identification
from lab.calibration.residual.gaussian_process import GROUP, JointProcess, PredictedBy
from lab.core.se3 import Array
from lab.core.values import Deferred
from lab.kinematics.effects.effect_registry import CAMPAIGN_SPECIFIC
from lab.kinematics.parameter import targets_of
from lab.noise.error_model import ErrorModel
from lab.noise.variance_components import ComponentErrors
from lab.prediction.estimate import CarriedLoad, Estimate, EstimatedParameter, NominalArm
from lab.prediction.extrapolation import MeasuredRange

__all__ = ["estimate_of", "in_another_session"]


def estimate_of(
    fit: Identification,
    exported: Callable[[], Array],
    robot: NominalArm,
    groups: Sequence[str],
    *,
    adequate: bool | None,
    shared: ErrorModel | None = None,
    component_errors: ComponentErrors | None = None,
    tail_dof: float = float("inf"),
    measured: MeasuredRange | Deferred[MeasuredRange | None] | None = None,
    load: CarriedLoad | None = None,
) -> Estimate:
    """Make the estimate of an identification.

    Args:
        exported: returns ``(p,)`` values of the most likely arm; it is called when these are first read.
        adequate: whether the residuals are no more than the noise; None where that was not tested.
        shared: errors that the measurements share beside the instrument's.
        tail_dof: degrees of freedom of the noise's tails; infinite where it is Gaussian.
    """
    process = fit.process.process if isinstance(fit.process, PredictedBy) else None
    estimate = Estimate(
        rigid=robot.arm(targets_of(fit.model.parameters)),
        loads=robot.loads,
        effects=tuple(name for name in groups if name not in (*CAMPAIGN_SPECIFIC, GROUP)),
        left_out=tuple(name for name in groups if name in CAMPAIGN_SPECIFIC),
        rows=Deferred(partial(_estimated_parameters, fit, exported)),
        identified=tuple(fit.model.names[i] for i in fit.fit.free),
        covariance=fit.covariance,
        noise_m=float(np.nan_to_num(fit.sigma_m)),
        residual_m=float(np.nan_to_num(fit.residual_sigma_m)),
        noise_known=fit.sigma_given,
        dof=fit.dof,
        adequate=adequate,
        cluster_robust=fit.dof_each is not None and shared is None,
        tail_dof=tail_dof if np.isfinite(tail_dof) else None,
        component_errors=component_errors if shared is not None else None,
        process=process,
        measured=measured,
        load=load,
        prior_acts_in=0 if fit.prior is None else fit.prior.acts_in,
        checks=fit.checks,
    )
    return _in_other_sessions(estimate, fit, shared)


def _in_other_sessions(estimate: Estimate, fit: Identification, shared: ErrorModel | None) -> Estimate:
    """Return an estimate without what only its own session had: conditions of its effects, a drift of its errors."""
    if estimate.process is not None and estimate.left_out:
        process = _without_session(estimate.process, fit, estimate.arm.conditions)
        estimate = replace(estimate, process=process)
    return estimate if shared is None else replace(estimate, shared=in_another_session(shared, estimate))


def _without_session(process: JointProcess, fit: Identification, lasting: Sequence[str]) -> JointProcess:
    """Return a process without the conditions that only a session's effects ask for: its offsets are of the joints."""
    joints, conditions = len(process.turning), list(fit.model.conditions)
    columns = [*range(joints), *(joints + conditions.index(name) for name in lasting)]
    return replace(process, inputs=process.inputs[:, columns])


def in_another_session(shared: ErrorModel, estimate: Estimate) -> ErrorModel:
    """Return errors as they are in another session, after an unknown drift or step of the base."""
    values = dict(zip(estimate.arm.names, estimate.values.tolist(), strict=True))
    return replace(shared, clock=None, values=values)


def _estimated_parameters(fit: Identification, exported: Callable[[], Array]) -> tuple[EstimatedParameter, ...]:
    """Describe every parameter of an identification, in its model's order.

    Args:
        exported: returns ``(p,)`` values of the most likely arm.
    """
    model, free, most_likely = fit.model, list(fit.fit.free), exported()
    # standard deviations and half widths of the intervals, of the free ones
    std, half = np.full(len(model.names), np.nan), np.full(len(model.names), np.nan)
    std[free], half[free] = fit.std, fit.half_width_95 * fit.std
    # what the errors of the others go into
    scale = column_scale(model, fit.nominal_aligned)
    aliased = {alias.name: dict(alias.into) for alias in aliases(model, fit.base_set, scale)}
    return tuple(
        EstimatedParameter(
            name=parameter.name,
            unit=parameter.unit.si,
            nominal=float(fit.nominal_aligned[i]),
            estimate=float(fit.values[i]),
            exported=float(most_likely[i]),
            std=float(std[i]) if np.isfinite(std[i]) else None,
            interval_95=_interval(float(fit.values[i]), float(half[i])),
            status=_status(fit, i),
            weakly_observable=bool(i in free and parameter.unit.si in ("m", "rad") and not std[i] <= WEAK),
            aliases=aliased.get(parameter.name, {}),
        )
        for i, parameter in enumerate(model.parameters)
    )


def _interval(estimate: float, half: float) -> tuple[float, float] | None:
    """Return the interval about an estimate; None where its width is unknown."""
    low, high = estimate - half, estimate + half
    return (low, high) if np.isfinite(low) and np.isfinite(high) else None


def _status(fit: Identification, parameter: int) -> str:
    if parameter in fit.fit.free:
        return "identified"
    if parameter in fit.base_set.fixed_observable:
        return "held"
    return "not seen" if parameter in fit.unobservable else "fixed"
