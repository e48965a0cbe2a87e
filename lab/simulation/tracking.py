"""Track a virtual arm: points and orientations of its targets, with the instrument's noise and outliers."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError, option_name
from lab.core.measurements import STATION, Measurements, measured
from lab.core.se3 import Array
from lab.kinematics.effects.effect import BUMPED
from lab.noise.instruments import Instrument
from lab.simulation.candidate_poses import field_of_view
from lab.simulation.effects import NOTHING_SET
from lab.simulation.robot_model import update_constants
from lab.simulation.true_robot import TrueRobot

__all__ = [
    "VirtualMeasurement",
    "misalignments",
    "recorded",
    "target_rotations",
    "track",
    "track_with_errors",
    "visible_targets",
]

_STREAMS = 4  # of scatter, outliers, shape of the noise, and systematic errors of the instrument


@dataclass(frozen=True)
class VirtualMeasurement:
    """Settled poses of a virtual arm, and how they are measured.

    Attributes:
        robot: the true arm, before its instrument.
        joints: ``(m, n)`` rad or m.
        targets: of the tool.
        instrument: whose noise and systematic errors the readings have.
        rng: of the noise, the scatter, the outliers, the systematic errors and the fixtures.
        readings: number of readings that each measurement is the mean of.
        conditions: set at each pose, ``(m,)`` each.
        planned: whether ``joints`` are those of a plan: then they are measured as they are.
    """

    robot: TrueRobot
    joints: Array
    targets: tuple[str, ...]
    instrument: Instrument
    rng: np.random.Generator
    readings: int = 1
    conditions: Mapping[str, Array] = field(default_factory=dict)
    planned: bool = False


def visible_targets(poses: VirtualMeasurement) -> NDArray[np.bool_]:
    """Return ``(m, k)``: whether each target is in the instrument's sight, and nothing of the arm in between.

    Raises:
        LabError: the instrument sees none of them in any pose.
    """
    real, joints, instrument = poses.robot, poses.joints, poses.instrument
    robot = replace(real.robot, model=real.model)
    station = _stations(real, poses.conditions, len(joints))
    visible = np.zeros((len(joints), len(poses.targets)), dtype=np.bool_)
    for which in np.unique(station):
        here = station == which
        views = [field_of_view(robot, (target,), instrument, int(which))(joints[here]) for target in poses.targets]
        visible[here] = np.stack(views, axis=1)
    if not visible.any():
        raise LabError(
            f"{option_name('occlusion')}: {instrument.name} sees none of {', '.join(poses.targets)} in any pose; "
            f"place it by a {option_name('cell')}, turn "
            "the targets to it, or choose the poses with lab design"
        )
    return visible


def track(
    real: TrueRobot,
    joints: Array,
    targets: tuple[str, ...],
    instrument: Instrument,
    rng: np.random.Generator,
    readings: int = 1,
    conditions: Mapping[str, Array] = NOTHING_SET,
) -> Measurements:
    """Simulate tracker readings, as ``track_with_errors`` does."""
    return track_with_errors(VirtualMeasurement(real, joints, targets, instrument, rng, readings, conditions))[0]


def track_with_errors(poses: VirtualMeasurement) -> tuple[Measurements, NDArray[np.bool_], Array]:
    """Simulate tracker readings at settled joint positions, each point the mean of some readings.

    Scatter and outliers are drawn from children of the generator each: the instrument's noise is the same without.

    Returns:
        The measurements, points in the tracker's frame; ``(m,)`` which poses' readings are outliers, for the
        assessment alone; and the random joint errors ``(m, n)``.
    """
    real, joints, instrument, conditions = poses.robot, poses.joints, poses.instrument, poses.conditions
    effects, (scattering, failing, shaping, misaligned) = real.effects, poses.rng.spawn(_STREAMS)
    scatter = effects.scatter(len(joints), scattering)
    exact = real.points(joints, poses.targets, conditions, scatter)
    displaced, bad = effects.displacements(len(joints), failing)
    noise = effects.shaped_noise(instrument.sample(exact, poses.rng, poses.readings) - exact, shaping)
    points = exact + instrument.errors.sample(exact, misaligned) + noise + displaced[:, None]
    return recorded(real, effects.shown(joints), poses.targets, points, conditions), bad, scatter


def misalignments(rng: np.random.Generator) -> np.random.Generator:
    """Return the stream of the instrument's systematic errors in ``track_with_errors``, from one not yet spawned."""
    return rng.spawn(_STREAMS)[-1]


def recorded(
    real: TrueRobot, joints: Array, targets: tuple[str, ...], points: Array, conditions: Mapping[str, Array]
) -> Measurements:
    """Return measurements of points ``(m, k, 3)`` m under these conditions, with a session of its own after a bump.

    If the instrument has several stations, each row names its station.
    """
    data = measured(real.robot.chain.joint_names, joints, targets, points)
    rest = {name: column for name, column in conditions.items() if name != BUMPED and not name.startswith(STATION)}
    if len(rest) + (BUMPED in conditions) < len(conditions):
        names = np.array(real.robot.stations)[_stations(real, conditions, len(joints))]
        data = replace(data, other={"station": tuple(names.tolist())})
    if BUMPED not in conditions:
        return replace(data, conditions=rest)
    sessions = tuple("2" if after else "1" for after in conditions[BUMPED])
    return replace(data, conditions=rest, sessions=sessions)


def _stations(real: TrueRobot, conditions: Mapping[str, Array], poses: int) -> NDArray[np.int_]:
    """Return the station ``(poses,)``, from 0, that measures each pose."""
    station = np.zeros(poses, dtype=np.int_)
    for i, name in enumerate(real.robot.stations[1:], start=1):
        station[conditions.get(STATION + name, np.zeros(poses)) > 0] = i
    return station


def target_rotations(
    real: TrueRobot,
    joints: Array,
    target: str,
    conditions: Mapping[str, Array] = NOTHING_SET,
    scatter: Array | float = 0.0,
) -> Array:
    """Return the exact rotations ``(m, 3, 3)`` of a target's frame in the instrument's frame, with all effects.

    The frame's axes are read off points that lie a metre along them, as ``TrueRobot.points`` moves them.

    Args:
        joints: ``(m, joints)`` rad or m.
        conditions: what is set at each pose, ``(m,)`` each.
        scatter: ``(m, joints)`` random joint errors.
    """
    origin = real.points(joints, (target,), conditions, scatter)[:, 0]
    ends = [_moved(real, target, axis).points(joints, (target,), conditions, scatter)[:, 0] for axis in np.eye(3)]
    return se3.nearest_rotation(np.stack([end - origin for end in ends], axis=-1))


def _moved(real: TrueRobot, target: str, offset_m: Array) -> TrueRobot:
    """Return the arm with a target moved by ``(3,)`` m along the axes of its own frame."""
    model = copy.deepcopy(real.model)
    site = model.site(target)
    site.pos[:] += se3.rotation_from_quaternion(site.quat) @ offset_m
    update_constants(model)
    return replace(real, model=model)
