"""Tracking errors of an arm with elastic links along a trajectory, and the trajectory that makes up for them.

Quasi-static (Benmisra 2007, figure 3.7): at each instant the links bear gravity, a payload and the inertia of the arm
as it moves rigidly by q, q', q''. Vibration is left out.
"""

from dataclasses import dataclass

import numpy as np

from lab.compensation.elastic import Correction, ElasticErrors, compensated, elastic_errors
from lab.core.se3 import Array
from lab.kinematics.dynamics.link_loads import LinkLoads
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.walk import Torsors
from lab.kinematics.trajectory.trajectory import Trajectory

__all__ = ["Tracking", "tracking"]


@dataclass(frozen=True)
class Tracking:
    """An arm along a trajectory, at k times.

    Attributes:
        joints, speeds, accelerations: ``(k, n)`` as commanded.
        errors: what it misses the rigid arm's path by, by link and in all.
        corrected: the joint positions to command instead.
    """

    joints: Array
    speeds: Array
    accelerations: Array
    errors: ElasticErrors
    corrected: Correction


def tracking(
    arm: SerialArm,
    values: Array,
    links: LinkLoads,
    sections: Array,
    trajectory: Trajectory,
    times: Array,
    payload_kg: float = 0.0,
    target: int = 0,
) -> Tracking:
    """Errors and correction along a trajectory.

    Args:
        values: parameters ``(p,)`` of the arm.
        links: its links with their loads.
        sections: ``(n, 4)`` compliances of each link (``beam.COMPLIANCES``); zeros of a stiff link.
        times: ``(k,)`` s since the start.
        payload_kg: carried all the way.
    """
    joints, speeds, accelerations = trajectory.at(times)
    payload = np.full(len(joints), payload_kg)
    elastic = [link for link in links.beams if sections[link].any()]

    def torsors_at(stands: Array) -> Torsors:
        loads = links.moving(stands, speeds, accelerations, payload)
        return {link: links.beams[link].torsor(loads[:, link], sections[link]) for link in elastic}

    errors = elastic_errors(arm, values, joints, torsors_at(joints), target)
    return Tracking(joints, speeds, accelerations, errors, compensated(arm, values, joints, torsors_at, target))
