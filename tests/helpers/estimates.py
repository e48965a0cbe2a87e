"""Estimates that no fit made, or with other numbers than those of a fit."""

from dataclasses import replace

import numpy as np

from lab.core.se3 import Array
from lab.prediction.estimate import Estimate, EstimatedParameter, NominalArm

__all__ = ["nominal_estimate", "with_values"]


def with_values(estimate: Estimate, values: Array) -> Estimate:
    """Return the estimate with other exported parameters ``(p,)`` of its arm."""
    named = dict(zip(estimate.arm.names, values.tolist(), strict=True))
    rows = tuple(replace(row, exported=named.get(row.name, row.exported)) for row in estimate.rows)
    return replace(estimate, rows=rows)


def nominal_estimate(robot: NominalArm, targets: tuple[str, ...], groups: tuple[str, ...]) -> Estimate:
    """Return an estimate with effects of zero size, of which nothing was identified."""
    empty = Estimate(
        rigid=robot.arm(targets), loads=robot.loads, effects=groups, left_out=(), rows=(), identified=(),
        covariance=np.zeros((0, 0)), noise_m=0.0, residual_m=0.0, noise_known=True, dof=0, adequate=None,
    )  # fmt: skip
    values = empty.arm.nominal(None).tolist()
    rows = (
        EstimatedParameter(name=name, nominal=value, estimate=value, exported=value)
        for name, value in zip(empty.arm.names, values, strict=True)
    )
    return replace(empty, rows=tuple(rows))
