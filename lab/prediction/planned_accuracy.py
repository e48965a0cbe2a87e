"""Judge poses before they are measured: identifiability, criteria, and the covariance that they would leave."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from lab.calibration.identifiability import aliases, column_scale, enough_poses, scaled_condition
from lab.core.errors import LabError, counted
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.values import Value
from lab.kinematics.array_arm import ArrayArm, with_leading_axes
from lab.kinematics.gauge import STRUCTURE_POSES, base_set, named
from lab.pose_selection.criteria import Scaling, indices

__all__ = [
    "CriteriaScaling",
    "Identifiability",
    "criteria",
    "identifiability",
    "planned_covariance",
    "refuse_degrees",
]

CriteriaScaling = Literal["raw", "unit", "length", "whitened", "si"]
_IN_MM, _IN_M = 1e-3, 1.0  # noise that gives coordinates in mm, and in m
_MAX_TURNS = 2  # of a hinge, in most poses: beyond, degrees were given


@dataclass(frozen=True, eq=False, repr=False)
class Identifiability(Value):
    """Identifiable parameters of an arm, by the columns of its Jacobian.

    Attributes:
        parameters: names ``(p,)`` of all.
        free: indices ``(f,)`` of a base set of identifiable ones, as a calibration fits them.
        aliases: of each other parameter, the free ones that its error goes into, and how much of it (SI units).
        singular_values: ``(f,)`` of the free columns, scaled to unit norm.
        condition: the ratio of the largest to the smallest; infinite where the poses do not identify all.
    """

    parameters: tuple[str, ...]
    free: tuple[int, ...]
    aliases: Mapping[str, Mapping[str, float]]
    singular_values: Array
    condition: float

    @property
    def identifiable(self) -> tuple[str, ...]:
        """Names ``(f,)`` of the free parameters."""
        return tuple(self.parameters[i] for i in self.free)

    @property
    def rank(self) -> int:
        """The number of identifiable parameters."""
        return len(self.free)

    def _about(self) -> str:
        return f"{self.rank} of {len(self.parameters)} parameters, condition number {self.condition:.3g}"


def identifiability(compiled: ArrayArm, joints: ArrayLike | None = None) -> Identifiability:
    """Return which parameters points at ``joints`` identify; by default at random positions, enough for all."""
    arm, nominal = compiled.arm, compiled.nominal
    rows = None if joints is None else _some(compiled.rows(joints)[0])
    # which parameters are free
    structure = base_set(arm, nominal, rows)
    # how well the free ones are observed: their columns, scaled to unit norm
    columns = _structure_jacobian(compiled, rows).reshape(-1, len(arm.names))[:, list(structure.identifiable)]
    unit = columns / np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    # what the errors of the others go into
    into = aliases(arm, structure, column_scale(arm, nominal))
    return Identifiability(
        arm.names,
        structure.identifiable,
        {each.name: dict(each.into) for each in into},
        np.linalg.svd(unit, compute_uv=False),
        scaled_condition(columns),
    )


def criteria(
    compiled: ArrayArm,
    joints: ArrayLike,
    at: ArrayLike | None,
    sigma_m: float | None,
    scaling: CriteriaScaling,
    parameters: Sequence[str] | None,
) -> dict[str, float]:
    """Return the observability indices and variance criteria of a set of poses, by name."""
    if scaling not in get_args(CriteriaScaling):
        raise LabError(f"scaling is {scaling!r}; give {', '.join(get_args(CriteriaScaling)[:-1])} or si")
    sigma = (_IN_M if scaling == "si" else _IN_MM) if sigma_m is None else sigma_m
    free = _unknown(compiled, parameters)
    measured = _whitened(compiled, joints, free, sigma)
    _refuse_too_few(compiled, measured, free)
    predicted = None if at is None else _whitened(compiled, at, free, sigma, "at")
    factors = np.ones(len(free))
    if scaling != "si":
        unit = 1e3 if scaling in ("raw", "length") else 1.0  # lengths in mm, of which a coordinate moves 1e-3 m
        factors = Scaling(scaling).columns([compiled.arm.parameters[i] for i in free], measured) / unit
    values = indices(measured * factors, None if predicted is None else predicted * factors)
    return {name: float(value) for name, value in asdict(values).items()}


def planned_covariance(
    compiled: ArrayArm, joints: ArrayLike, at: ArrayLike, sigma_m: float, parameters: Sequence[str] | None
) -> Array:
    """Return the covariance ``(..., k, 3, 3)`` (m²) of points at ``at``, J C J', after a calibration at ``joints``."""
    free = _unknown(compiled, parameters)
    measured = _whitened(compiled, joints, free, sigma_m)
    _refuse_too_few(compiled, measured, free)
    # C = (R'R)^-1 with the triangular factor R of the whitened derivatives
    upper = np.asarray(np.linalg.qr(measured.reshape(-1, len(free)), mode="r"))
    # J C J' = S S' with S = J R^-1
    rows, leading = compiled.rows(at, "at")
    _refuse_degrees(compiled, rows, "at")
    J = compiled.arm.observe(rows, compiled.nominal)[1][..., free]
    S = np.linalg.solve(upper.T, J.reshape(-1, len(free)).T).T.reshape(J.shape)
    return with_leading_axes(leading, S @ np.swapaxes(S, -1, -2))


def _structure_jacobian(compiled: ArrayArm, rows: Array | None = None) -> Array:
    """Return derivatives ``(n, k, 3, p)`` for decisions on rank, by default at random positions."""
    arm = compiled.arm
    if rows is None:
        rows = arm.structure_joints(STRUCTURE_POSES, rng_for(0, "structure"))
    return arm.observe(rows, arm.rank_point(compiled.nominal))[1]


def _unknown(compiled: ArrayArm, parameters: Sequence[str] | None) -> list[int]:
    """Return the indices of the parameters that are named, or of all identifiable ones."""
    if parameters is None:
        return list(identifiability(compiled).free)
    if not parameters:
        raise LabError("parameters: none is named; name one or more, or leave parameters out for all identifiable")
    return list(named(compiled.arm.names, "parameters", parameters))


def _refuse_too_few(compiled: ArrayArm, measured: Array, free: list[int]) -> None:
    """Refuse poses that do not identify every parameter, with the number that does.

    Args:
        measured: derivatives ``(n, r, f)`` at the poses.
    """
    if np.isfinite(scaled_condition(measured.reshape(-1, len(free)))):
        return
    many = _structure_jacobian(compiled)[..., free]
    many = many.reshape(len(many), -1, len(free))
    if not np.isfinite(scaled_condition(many.reshape(-1, len(free)))):
        names = [compiled.arm.names[i] for i in free]
        raise LabError(
            f"parameters: no poses identify all of {', '.join(names)}: some of them have the same effect, or none; "
            "identifiability().aliases lists them"
        )
    least = enough_poses(many)
    what = counted(len(free), "parameter")
    if len(measured) < least:
        raise LabError(
            f"joints: {counted(len(measured), 'pose')} do not identify {what}, which need {least} poses or more"
        )
    raise LabError(
        f"joints: these {counted(len(measured), 'pose')} do not identify {what}: they are too alike; vary every joint"
    )


def _whitened(
    compiled: ArrayArm, joints: ArrayLike, free: list[int], sigma_m: float, argument: str = "joints"
) -> Array:
    """Return derivatives ``(n, 3 k, f)`` by the free parameters, in units of the noise."""
    if not 0 < sigma_m < np.inf:
        raise LabError(f"sigma_m is {sigma_m:g}; give the noise of a coordinate in m, above zero")
    rows = _some(compiled.rows(joints, argument)[0], argument)
    _refuse_degrees(compiled, rows, argument)
    jacobian = _structure_jacobian(compiled, rows)[..., free] / sigma_m
    return np.asarray(jacobian.reshape(len(rows), -1, len(free)))


def _refuse_degrees(compiled: ArrayArm, rows: Array, argument: str) -> None:
    hinges = ~np.asarray(compiled.arm.rigid.chain.prismatic, dtype=bool)
    refuse_degrees(rows[:, : len(hinges)][:, hinges], argument, "give joints in rad, such as np.deg2rad(joints),")


def refuse_degrees(hinges: Array, where: str, remedy: str) -> None:
    """Refuse positions ``(n, hinges)`` in rad that no hinge takes: degrees that were called radians."""
    most = float(np.median(np.abs(hinges).max(axis=1))) if hinges.size else 0.0
    if most > 2 * np.pi * _MAX_TURNS:
        raise LabError(
            f"{where}: in half of the poses a joint is at {most:.0f} rad or more; {remedy} if joints are in degrees"
        )


def _some(rows: Array, argument: str = "joints") -> Array:
    if not len(rows):
        raise LabError(f"{argument} hold no configuration; give at least one")
    return rows
