"""What Newton's method found for a list of targets, and why what was not found is not there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec

__all__ = ["AGREED_M", "LIMIT_SLACK", "NEAR_RAD", "Attempts"]

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
    """

    start: Array
    branch: NDArray[np.int_]
    joints: Array
    errors: Array
    arrived: NDArray[np.bool_]
    excess: Array
    steps: NDArray[np.int_]

    @property
    def fits(self) -> NDArray[np.bool_]:
        """``(n,)``: arrived, and within limits."""
        return np.asarray(self.arrived & (self.excess.max(axis=1) <= LIMIT_SLACK))

    def take_better(self, rows: NDArray[np.int_], other: "Attempts") -> None:
        """Put what another way found for some rows in the place of what is worse."""
        cost = [np.where(f.arrived, f.excess.max(axis=1), 1e3 + np.abs(f.errors).max(axis=1)) for f in (self, other)]
        better = cost[1] < cost[0][rows]
        for name in ("start", "branch", "joints", "errors", "arrived", "excess", "steps"):
            getattr(self, name)[rows[better]] = getattr(other, name)[better]

    def reason(self, i: int, chain: JointSpec, singular: tuple[float, int], scheme_disagreement_m: float) -> str:
        """Why a target is not reached; empty if it is.

        Args:
            singular: how far it is from a singularity (rad, m of a slide), and the joint that leads there.
            apart_m: how far apart the schemes of compensation end; NaN where they were not tried.
        """
        if scheme_disagreement_m <= AGREED_M:
            return ""
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
