"""Tracking errors of an identified arm along a trajectory, and the joint positions that make up for them.

Quasi-static (Benmisra 2007, figure 3.7): at each instant joints and links bear gravity, a payload and the inertia of
the arm as it moves rigidly by q, q', q''. Vibration is left out.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lab.compensation.elastic import Correction, compensated, elastic_errors, error_between
from lab.core.se3 import Array
from lab.kinematics.effects.arm import Arm, ArmWithEffects
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.walk import RIGID, Torsors

__all__ = ["Tracking", "tracking"]


@dataclass(frozen=True)
class Tracking:
    """An arm along a trajectory, at k times.

    Attributes:
        wanted: ``(k, 4, 4)`` where the tool is to be, in the tracker's frame.
        total: ``(k, 6)`` what it is off by (m; a rotation vector, rad) with the joints as they are commanded.
        parts: ``(k, 6)`` each, what of that is the geometry's, the joints' and each link's alone; they add up to first
            order. Parts that the arm does not have are left out.
        standing: ``(k, n)`` where the joints then are.
        torsors: how far the links' ends are displaced.
        corrected: the joint positions to command instead.
    """

    wanted: Array
    total: Array
    parts: Mapping[str, Array]
    standing: Array
    torsors: Torsors
    corrected: Correction


def tracking(arm: Arm, values: Array, wanted: tuple[Array, Array], joints: Array, rest: Array, target: int) -> Tracking:
    """Errors and correction along a trajectory.

    Args:
        arm: as identified, in motion (``Robot.arm_with``).
        values: its parameters ``(p,)``.
        wanted: where the controller's model brings the tool ``(k, 4, 4)``, and how its joints move it
            ``(k, 6, joints)``.
        joints: ``(k, joints)`` as commanded.
        rest: ``(k, c)`` what the arm's effects ask for, its ``conditions``.
        target: of the tool, which one is tracked.
    """

    def deformed(there: Array) -> tuple[Array, Array]:
        return arm.tool(np.concatenate([there, rest], axis=1), values, target)

    rigid, inputs = arm.rigid, np.concatenate([joints, rest], axis=1)
    own = values[: len(rigid.names)]
    standing, torsors = joints, RIGID
    if isinstance(arm, ArmWithEffects):
        standing, torsors = arm.standing(inputs, values), arm.torsors(inputs, values)
    exact, moved = (rigid.tool(each, own, target)[0] for each in (joints, standing))
    parts = {"geometry": error_between(wanted[0], exact), "joints": error_between(exact, moved)}
    if torsors and isinstance(rigid, SerialArm):
        each = elastic_errors(rigid, own, standing, torsors, target)
        parts |= {f"link {link + 1}": each.by_link[:, i] for i, link in enumerate(each.links)}
    total = error_between(wanted[0], deformed(joints)[0])
    kept = {name: part for name, part in parts.items() if part.any()}
    return Tracking(wanted[0], total, kept, standing, torsors, compensated(wanted, joints, deformed))
