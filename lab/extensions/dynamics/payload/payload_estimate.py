"""Identified payload: parameters with intervals, derived quantities, and advice on unidentified parameters."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lab.core.checks import Check
from lab.core.se3 import Array
from lab.extensions.dynamics.regression import ChannelSolution
from lab.kinematics.dynamics.rigid_body import (
    LOAD,
    elements,
    hand_jacobian,
    inertia_about_centre,
    is_physical,
    symmetric,
)
from lab.kinematics.serial.serial_arm import SerialArm
from lab.library.hand_load import HandLoad

__all__ = ["LoadEstimate", "Nuisance", "equivalent_ellipsoid", "estimate_of", "excitation_advice"]

_BALL_KG_M3 = 7850.0  # steel, where the inertia is not known


@dataclass(frozen=True)
class Nuisance:
    """A nuisance parameter, estimated together with the payload.

    Attributes:
        name: ``offset.fx``, ``friction.q1`` (of the torque), ``delay``, ``tilt.x``, ``turn.z`` and so on.
        unit: N, Nm, s, rad, or "" of a fraction.
        half_width: of its 95 % interval.
    """

    name: str
    value: float
    half_width: float
    unit: str


@dataclass(frozen=True)
class LoadEstimate:
    """The load at the hand, about the origin and in the axes of ``frame``, with 95 % intervals.

    Unidentified parameters, and quantities derived from them, are NaN.

    Attributes:
        method: ``torques``, ``wrench`` or ``sag``, and whether of static poses or a motion.
        phi: ``(10,)`` as ``LOAD``: kg, kg m and kg m^2.
        covariance: ``(10, 10)``.
        half_width: ``(10,)`` of phi.
        com_half_width, inertia_com_half_width: ``(3,)`` m and ``(3, 3)`` kg m^2, to first order.
        rank, columns: of the regressor, with the nuisances; equal where all parameters are identified.
        rows: number of fitted readings, each of which counts as independent.
        sigma: ``(d,)`` noise of one reading: each joint's torque (Nm, N of a slide), sensor's axis, or coordinate (m).
        measured, residual: ``(n, d)`` measurements and residuals, in the channels' units.
        unidentified: sentences on unidentified parameters, and the motion that would show them.
        verdict: the test of the residuals.
        moved: whether ``physical_consistency`` moved the parameters to physical ones.
        time_s: ``(n,)`` of the rows, from the beginning of each run on; None of static poses.
    """

    method: str
    frame: str
    phi: Array
    covariance: Array
    half_width: Array
    com_half_width: Array
    inertia_com_half_width: Array
    rank: int
    columns: int
    rows: int
    sigma: Array
    measured: Array
    residual: Array
    unidentified: tuple[str, ...]
    nuisance: tuple[Nuisance, ...]
    verdict: Check
    moved: bool = False
    time_s: Array | None = None

    @property
    def identified(self) -> tuple[str, ...]:
        """Names of the identified parameters, of ``LOAD``."""
        return tuple(name for name, value in zip(LOAD, self.phi, strict=True) if np.isfinite(value))

    @property
    def mass_kg(self) -> float:
        """Mass, kg."""
        return float(self.phi[0])

    @property
    def hand_load(self) -> HandLoad:
        """Mass and centre of mass; NaN where they are not identified."""
        return HandLoad(self.mass_kg, self.com_m, self.covariance[:4, :4])

    @property
    def mass_half_width_kg(self) -> float:
        """Half-width of the mass's 95 % interval, kg."""
        return float(self.half_width[0])

    @property
    def com_m(self) -> Array:
        """Centre of mass ``(3,)``, m."""
        centre: Array = self.phi[1:4] / self.phi[0]
        return centre

    @property
    def inertia_kgm2(self) -> Array:
        """Inertia ``(3, 3)`` about the frame's origin."""
        return symmetric(self.phi[4:])

    @property
    def inertia_half_width_kgm2(self) -> Array:
        """Half-widths ``(3, 3)`` of ``inertia_kgm2``."""
        return symmetric(self.half_width[4:])

    @property
    def inertia_com_kgm2(self) -> Array:
        """Inertia ``(3, 3)`` about the centre of mass."""
        return inertia_about_centre(self.phi)

    @cached_property
    def physical(self) -> bool | None:
        """Physical consistency: the pseudo-inertia is positive definite, or without an inertia the mass is positive."""
        if not np.isfinite(self.phi[0]):
            return None
        if not np.isfinite(self.phi).all():
            return bool(self.phi[0] > 0)
        return is_physical(self.phi)

    @property
    def adequate(self) -> bool | None:
        """True if noise explains the residuals; None where there are too few to test."""
        return None if self.verdict.outcome == "not tested" else self.verdict.outcome == "passed"


def estimate_of(
    method: str,
    solution: ChannelSolution,
    nuisance: dict[str, tuple[float, str]],
    unidentified: tuple[str, ...],
    verdict: Check,
    gain: float,
    time_s: Array | None = None,
) -> LoadEstimate:
    """Return the load whose ten parameters come first in a solution.

    Args:
        nuisance: values and units of the other parameters, by name, of which the solution may hold steps only.
        gain: standard deviation of the solution's rows where that of one reading is one.
        time_s: ``(n,)`` of the solution's rows; None of static poses.
    """
    identifiable = solution.identifiable[:10]
    phi = np.where(identifiable, solution.values[:10], np.nan)
    slopes = np.eye(len(solution.values))
    widths = np.where(solution.identifiable, solution.half_widths(slopes), np.nan)
    covariance = np.where(np.outer(identifiable, identifiable), solution.covariance[:10, :10], np.nan)
    found = [
        Nuisance(name, value if solution.identifiable[i] else np.nan, float(widths[i]), unit)
        for name, (value, unit) in nuisance.items()
        for i in [solution.names.index(name)]
    ]
    centre = _widths_of(solution, _centre_slopes(phi)) if identifiable[:4].all() else np.full(3, np.nan)
    inner = _widths_of(solution, _inner_slopes(phi)) if identifiable.all() else np.full(6, np.nan)
    return LoadEstimate(
        method=method,
        frame="flange",
        phi=phi,
        covariance=covariance,
        half_width=widths[:10],
        com_half_width=centre,
        inertia_com_half_width=symmetric(inner),
        rank=solution.model.rank,
        columns=len(solution.names),
        rows=solution.residual.size,
        sigma=solution.sigma / gain,
        measured=solution.measured,
        residual=solution.residual * solution.sigma,
        unidentified=unidentified,
        nuisance=tuple(found),
        verdict=verdict,
        time_s=time_s,
    )


def equivalent_ellipsoid(mass_kg: float, inertia_kgm2: Array) -> tuple[Array, Array]:
    """Return half-axes ``(3,)`` m and directions ``(3, 3)`` of the solid ellipsoid with this mass and inertia.

    I_x = m (b^2 + c^2) / 5, and so on; a ball of steel where the inertia is not known or no body has it.
    """
    if np.isfinite(inertia_kgm2).all():
        moments, axes = np.linalg.eigh(inertia_kgm2)
        squares = 2.5 * (moments.sum() - 2 * moments) / mass_kg
        if (squares > 0).all():
            axes[:, 0] *= np.linalg.det(axes)
            return np.sqrt(squares), axes
    radius = (0.75 * abs(mass_kg) / np.pi / _BALL_KG_M3) ** (1 / 3)
    return np.full(3, radius), np.eye(3)


def _widths_of(solution: ChannelSolution, slopes: Array) -> Array:
    """Return half-widths ``(k,)`` of quantities with derivatives ``(k, 10)`` by the load's parameters."""
    padded = np.zeros((len(slopes), len(solution.names)))
    padded[:, :10] = slopes
    return solution.half_widths(padded)


def _centre_slopes(phi: Array) -> Array:
    """Return the derivatives ``(3, 10)`` of the centre of mass."""
    slopes = np.zeros((3, 10))
    slopes[:, 0] = -phi[1:4] / phi[0] ** 2
    slopes[:, 1:4] = np.eye(3) / phi[0]
    return slopes


def _inner_slopes(phi: Array) -> Array:
    """Return the derivatives ``(6, 10)`` of the inertia about the centre of mass, I - (s's 1 - s s') / m, s = m c."""
    mass, moment = phi[0], phi[1:4]
    slopes = np.zeros((6, 10))
    slopes[:, 0] = elements(moment @ moment * np.eye(3) - np.outer(moment, moment)) / mass**2
    for axis, unit in enumerate(np.eye(3)):
        mixed = np.outer(unit, moment)
        slopes[:, 1 + axis] = -elements(2 * moment[axis] * np.eye(3) - mixed - mixed.T) / mass
    slopes[:, 4:] = np.eye(6)
    return slopes


_AXES = "xyz"
_MAX_SAMPLES = 200  # over which the joints that turn the hand are found


def excitation_advice(
    solution: ChannelSolution, moving: bool, arm: SerialArm, values: Array, joints: Array
) -> tuple[str, ...]:
    """Return a sentence for each group of parameters that is not identified, or only to more than its own size."""
    identifiable, found = solution.identifiable[:10], []
    joints = joints[:: max(1, len(joints) // _MAX_SAMPLES)]
    if not identifiable[:4].all():
        names = ", ".join(np.array(LOAD[:4])[~identifiable[:4]])
        found.append(f"{names}: not identifiable one by one; add poses that turn the hand about other horizontal axes")
    if not moving:
        found.append(
            "the inertia: static poses show mass and centre of mass alone; move the hand along a quick path that "
            f"turns it about all its axes ({_turned_by(arm, values, joints, range(3))})"
        )
        return tuple(found)
    vague = solution.half_widths(np.eye(len(solution.names)))[4:10] > np.abs(solution.values[4:7]).max()
    for k in range(4, 10):
        if identifiable[k] and not vague[k - 4]:
            continue
        axes = sorted({_AXES.index(letter) for letter in LOAD[k][1:]})
        why = "shown only to more than the load's whole inertia" if identifiable[k] else "not shown by this path"
        about = " and ".join(_AXES[axis] for axis in axes)
        found.append(
            f"{LOAD[k]}: {why}; turn the hand faster about its {about} ({_turned_by(arm, values, joints, axes)}): "
            "the interval falls with the square of the speed"
        )
    return tuple(found)


def _turned_by(arm: SerialArm, values: Array, joints: Array, axes: Iterable[int]) -> str:
    """Name the joints that turn the hand most about these of its axes, at the measured poses."""
    turning = np.abs(hand_jacobian(arm, values, joints)[:, 3:]).mean(axis=0)  # (3, J)
    if not turning.any():
        return "no joint turns it"
    best = sorted({int(np.argmax(turning[axis])) for axis in axes if turning[axis].any()})
    return "joints " + ", ".join(arm.chain.joint_names[j] for j in best)
