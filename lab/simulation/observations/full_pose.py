"""Full poses of a virtual arm: points of its targets, and the orientation of the first one's frame."""

import copy
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.instruments import Instrument, PoseInstrument
from lab.core.se3 import Array
from lab.formats.orientations import orientation_texts
from lab.simulation.effects import NOTHING_SET
from lab.simulation.model import update_constants
from lab.simulation.observations.points import scattered_points, seen_by
from lab.simulation.observations.protocol import Setup, SimulatedDay
from lab.simulation.true_robot import TrueRobot

__all__ = ["observe_poses", "target_rotations"]


def observe_poses(
    real: TrueRobot,
    joints: Array,
    targets: tuple[str, ...],
    instrument: Instrument,
    rng: np.random.Generator,
    readings: int,
    conditions: Mapping[str, Array],
    setup: Setup,
) -> SimulatedDay:
    """Points as ``points`` has them, and orientations of the first target, some of which may be missing.

    The points are those of ``--observe points`` with the same numbers drawn; orientations draw from a child.
    """
    assert isinstance(instrument, PoseInstrument)  # else it does not observe poses
    data, bad, scatter = scattered_points(real, joints, targets, instrument, rng, readings, conditions)
    turning = rng.spawn(1)[0]
    exact = target_rotations(real, joints, targets[0], conditions, scatter)
    rotations = instrument.sample_rotations(exact, turning, readings)
    visible = np.ones((len(joints), len(targets)), dtype=np.bool_)
    if setup.occlusion:
        visible = seen_by(real, joints, targets, instrument, conditions)
    oriented = visible[:, 0] & _share(len(joints), setup.orientation_share, turning)
    points = np.where(visible[..., None], data.points, np.nan)
    columns = orientation_texts(targets[0], rotations, oriented, setup.orientation)
    return SimulatedDay(replace(data, points=points, other={**data.other, **columns}), bad)


def target_rotations(
    real: TrueRobot,
    joints: Array,
    target: str,
    conditions: Mapping[str, Array] = NOTHING_SET,
    scatter: Array | float = 0.0,
) -> Array:
    """Exact rotations ``(m, 3, 3)`` of a target's frame in the instrument's frame, with all effects.

    The frame's axes are read off points that lie a metre along them, as ``TrueRobot.points`` moves them.

    Args:
        joints: ``(m, joints)`` rad or m.
        conditions: what is set at each pose, ``(m,)`` each.
        scatter: ``(m, joints)`` how far the joints stand off by chance.
    """
    origin = real.points(joints, (target,), conditions, scatter)[:, 0]
    ends = [_moved(real, target, axis).points(joints, (target,), conditions, scatter)[:, 0] for axis in np.eye(3)]
    return se3.nearest_rotation(np.stack([end - origin for end in ends], axis=-1))


def _moved(real: TrueRobot, target: str, offset_m: Array) -> TrueRobot:
    """The arm with a target moved by ``(3,)`` m along the axes of its own frame."""
    model = copy.deepcopy(real.model)
    site = model.site(target)
    site.pos[:] += se3.rotation_from_quaternion(site.quat) @ offset_m
    update_constants(model)
    return replace(real, model=model)


def _share(poses: int, share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """``(poses,)``: which poses are of this share, as near as whole poses can be."""
    chosen = np.zeros(poses, dtype=np.bool_)
    chosen[rng.permutation(poses)[: max(1, round(share * poses))]] = True
    return chosen
