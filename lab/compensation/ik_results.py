"""What Newton's method found for a list of targets, and why what was not found is not there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec

__all__ = ["AGREED_M", "LIMIT_SLACK", "NEAR_RAD", "Attempts", "Texts"]

Texts = NDArray[np.object_]  # (n,) of str

NEAR_RAD = np.deg2rad(1.0)  # of a singularity (m for a slide)
AGREED_M = 1e-6  # what schemes of compensation may end apart, m or rad
_EDGE_M = 1e-3  # missed by less, a target is at the edge of the workspace
LIMIT_SLACK = 1e-9  # rad or m: rounding


@dataclass
class Attempts:
    """The best that was found so far.

    Attributes:
        start: ``(n, joints)`` the nominal model's joint positions, of its solutions ``branch`` ``(n,)``.
        joints: ``(n, joints)`` the identified arm's.
        errors: ``(n, 6)`` what is missing, m and rad.
        arrived: ``(n,)`` whether nothing is, or nothing that so many joints could make up for.
        excess: ``(n, joints)`` beyond limits.
        steps: ``(n,)``.
        refusals: one each: why the arm may not stand there, though it can; "" where it may.
        passed_over: one each: why the solution that was tried first was left for another one; "" where it was not.
    """

    start: Array
    branch: NDArray[np.int_]
    joints: Array
    errors: Array
    arrived: NDArray[np.bool_]
    excess: Array
    steps: NDArray[np.int_]
    refusals: Texts
    passed_over: Texts

    @property
    def possible(self) -> NDArray[np.bool_]:
        """``(n,)``: arrived, and within limits."""
        return np.asarray(self.arrived & (self.excess.max(axis=1) <= LIMIT_SLACK))

    @property
    def fits(self) -> NDArray[np.bool_]:
        """``(n,)``: arrived, within limits, and not refused."""
        return np.asarray(self.possible & (self.refusals == ""))

    @property
    def cost(self) -> Array:
        """``(n,)``: the smaller, the better: what is refused is better than what is beyond limits or not reached."""
        beyond = np.where(self.refusals == "", self.excess.max(axis=1), 2 * LIMIT_SLACK)
        return np.where(self.arrived, beyond, 1e3 + np.abs(self.errors).max(axis=1))

    def take_better(self, rows: NDArray[np.int_], other: "Attempts", chain: JointSpec) -> None:
        """Put what another way found for some rows in the place of what is worse, and say what was wrong with that."""
        better = other.cost < self.cost[rows]
        for i in rows[better].tolist():
            self.passed_over[i] = self.passed_over[i] or self.refusals[i] or self._not_within_limits(i, chain)
        for name in ("start", "branch", "joints", "errors", "arrived", "excess", "steps", "refusals"):
            getattr(self, name)[rows[better]] = getattr(other, name)[better]

    def _not_within_limits(self, i: int, chain: JointSpec) -> str:
        """That the solution is beyond a limit, or that none was found from there."""
        beyond = int(self.excess[i].argmax())
        return _beyond_limit(chain, self.joints[i], beyond) if self.arrived[i] else "no solution was found near it"

    def reason(self, i: int, chain: JointSpec, singular: tuple[float, int], scheme_disagreement_m: float) -> str:
        """Why a target is not reached; empty if it is.

        Args:
            singular: how far it is from a singularity (rad, m of a slide), and the joint that leads there.
            scheme_disagreement_m: how far apart the schemes of compensation end; NaN where they were not tried.
        """
        if scheme_disagreement_m <= AGREED_M:
            return ""
        if self.possible[i] and self.refusals[i]:
            return str(self.refusals[i])
        beyond = int(self.excess[i].argmax())
        if self.arrived[i] and self.excess[i, beyond] > LIMIT_SLACK:
            return f"joint limit: {_beyond_limit(chain, self.joints[i], beyond)}"
        distance, joint = singular
        far = f"{1e3 * distance:.2g} mm" if chain.prismatic[joint] else f"{np.rad2deg(distance):.2g}°"
        near = f"{far} from a singularity of the arm ({chain.joint_names[joint]})"
        if distance < NEAR_RAD:
            near = f"within 1° of a singularity: {near}"
        if self.arrived[i]:
            return f"{near}, where the schemes of compensation do not meet"
        short, turned = (float(np.linalg.norm(part)) for part in (self.errors[i, :3], self.errors[i, 3:]))
        missed = f"{_rounded(1e3 * short)} mm" if short > AGREED_M else f"{_rounded(np.rad2deg(turned))}°"
        edge = f", {near}" if distance < NEAR_RAD and short < _EDGE_M else ""
        return f"out of reach by {missed}{edge}"


def _beyond_limit(chain: JointSpec, joints: Array, joint: int) -> str:
    """Where a joint would be, and its limit, for a person."""
    at = joints[joint]
    limit = chain.upper[joint] if at > chain.upper[joint] else chain.lower[joint]
    factor, unit = (1e3, " mm") if chain.prismatic[joint] else (180 / np.pi, "°")
    return f"{chain.joint_names[joint]} would be at {factor * at:.5g}{unit}, beyond {factor * limit:.5g}{unit}"


def _rounded(number: float) -> str:
    """Three digits that count, without an exponent."""
    return np.format_float_positional(number, precision=3, fractional=False, trim="-")
