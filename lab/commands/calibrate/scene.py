"""Arrays of a campaign for its recording, in the model's world, magnified to be visible."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.calibration.identify import Identification, ellipsoids, mapping_ellipsoids, position_covariance
from lab.calibration.observation import observation_of
from lab.calibration.stations import in_first_frame, station_poses
from lab.commands.calibrate.result import CalibrationResult
from lab.core import se3
from lab.core.measurements import rows_called, seen_mask
from lab.core.se3 import Array
from lab.core.units import MM
from lab.kinematics.effects.sessions import at_first_station
from lab.kinematics.model import RigidArm
from lab.render.scene import (
    LARGEST_FACTOR,
    Legs,
    MagnifiedEllipsoids,
    drawn_rows,
    magnification,
    magnified,
    moved,
    reach_of,
    skeleton,
    world_legs,
)
from lab.simulation.meshes import Shell, body_poses, instrument_body, shells, station_body_poses

__all__ = ["Scene", "scene", "world_of"]

_MOST_OUTLIERS = 30  # marked
_ARROW = 0.15  # of the reach: how long the mean error arrow is to be drawn
_ROUNDING_M = 1e-9  # a standard deviation below this is the arithmetic's


@dataclass(frozen=True)
class _OutlierPose:
    """An outlier: where its farthest target was measured and where it should be, in the world ``(3,)`` m."""

    description: str
    measured: Array
    expected: Array


@dataclass(frozen=True)
class Scene:
    """A campaign's fitted poses in the world (m).

    Attributes:
        rows: ``(m,)`` which of the fitted poses are drawn.
        numbers: ``(n,)`` each fitted pose's row among all that were measured.
        outliers: the farthest first.
        Ts_world_station: ``(4, 4)``, identified, by the names of the stations from which was measured, the first first.
        heads: ``(m, 3)``, the instrument's in each drawn pose.
        reach_m: the largest distance of a measured point, or a leg's end, from frame 0; sizes of marks follow it.
        measured, before, after: ``(m, k, 3)`` points as measured (NaN where not), and as predicted.
        all_measured: ``(q, 3)`` of every fitted pose.
        error_before, error_after: ``(n,)`` m, mean over the targets measured at each fitted pose, NaN where none was.
        factor_before, factor_after: magnification of the error arrows.
        uncertainty: None where the noise is not known, or there was none.
        shells: of the bodies in ``bodies``.
        bodies: world poses ``(m, 4, 4)`` by name.
        origins: ``(m, f, 3)`` of the arm's frames.
        legs: in the world.
    """

    rows: NDArray[np.int_]
    numbers: NDArray[np.int_]
    outliers: tuple[_OutlierPose, ...]
    reach_m: float
    Ts_world_station: Mapping[str, Array]
    heads: Array
    measured: Array
    before: Array
    after: Array
    all_measured: Array
    error_before: Array
    error_after: Array
    factor_before: float
    factor_after: float
    mapping: MagnifiedEllipsoids
    uncertainty: MagnifiedEllipsoids | None
    shells: tuple[Shell, ...]
    bodies: dict[str, Array]
    origins: Array
    legs: Legs

    @property
    def at(self) -> NDArray[np.int_]:
        """``(m,)`` the drawn poses' rows among all that were measured."""
        return self.numbers[self.rows]


def scene(outcome: CalibrationResult) -> Scene:
    """The scene of a campaign; an evenly spaced part of its poses where they are many."""
    fitted, identification = outcome.fitted, outcome.identification
    model = identification.model
    observed = fitted.points[:, : observation_of(model).positions]
    rows, inputs = drawn_rows(len(fitted)), fitted.inputs(model.conditions)
    joints = fitted.joints[rows]
    T_world_instrument = world_of(outcome)
    poses = station_poses(model, identification.values, fitted)
    stations = {name: T_world_instrument @ T for name, T in poses.items()}
    both = (identification.nominal_aligned, identification.values)
    before, after = (model.points(inputs, v)[:, : observed.shape[1]] for v in both)
    errors = [_mean_length(observed - predicted) for predicted in (before, after)]
    measured, before, after = (
        moved(T_world_instrument, in_first_frame(model, identification.values, inputs, points))
        for points in (observed, before, after)
    )
    inputs = at_first_station(model.conditions, inputs)  # in whose frame ellipsoids are
    there = seen_mask(observed)
    arm, values = outcome.rigid(identification.values)
    places = moved(_world_frame0(outcome), skeleton(arm, values, joints).origins)
    between = world_legs(_world_frame0(outcome), arm, values, joints)
    reach = reach_of(_world_frame0(outcome), measured[there], between)
    visible, bodies = _bodies(outcome, arm, values, joints, stations)
    everything = {name: i for i, name in enumerate(outcome.measurements.ids)}
    return Scene(
        rows,
        np.array([everything[name] for name in fitted.ids]),
        _outliers(outcome, T_world_instrument),
        reach,
        stations,
        np.array([stations.get(fitted.stations[row], T_world_instrument)[:3, 3] for row in rows]),
        measured[rows],
        before[rows],
        after[rows],
        measured[there],
        errors[0],
        errors[1],
        _error_factor(errors[0], _ARROW * reach),
        _error_factor(errors[1], _ARROW * reach),
        magnified(mapping_ellipsoids(identification, inputs[rows]), after[rows, 0], T_world_instrument, reach),
        _uncertainty(identification, inputs[rows], after[rows, 0], T_world_instrument, reach),
        visible,
        bodies,
        places,
        between,
    )


def _outliers(outcome: CalibrationResult, T_world_instrument: Array) -> tuple[_OutlierPose, ...]:
    """The outliers that the test names; none where the file's points are not all that is observed."""
    model, data = outcome.identification.model, outcome.measurements
    named = outcome.fit.outliers[:_MOST_OUTLIERS]
    observation = observation_of(model)
    if not named or observation.positions < len(observation.units):
        return ()
    part = data.take(rows_called(data, [pose.id for pose in named]))
    expected = model.points(part.inputs(model.conditions), outcome.identification.values)
    worst = np.nanargmax(np.linalg.norm(part.points - expected, axis=2), axis=1)
    inputs, values = part.inputs(model.conditions), outcome.identification.values
    both = (in_first_frame(model, values, inputs, points) for points in (part.points, expected))
    ends = (moved(T_world_instrument, points)[np.arange(len(named)), worst] for points in both)
    return tuple(
        _OutlierPose(f"{pose.id}: {MM.text(pose.size_m)}", measured, should)
        for pose, measured, should in zip(named, *ends, strict=True)
    )


def _error_factor(errors: Array, shown: float) -> float:
    return min(max(magnification(float(np.nanmean(errors)), shown), 1.0), LARGEST_FACTOR)


def _mean_length(vectors: Array) -> Array:
    """Mean length ``(n,)`` of those of the vectors ``(n, k, 3)`` that are not NaN; NaN where all are."""
    lengths = np.linalg.norm(vectors, axis=2)
    known = np.isfinite(lengths)
    mean: Array = np.where(known, lengths, 0.0).sum(axis=1) / np.where(known.any(axis=1), known.sum(axis=1), np.nan)
    return mean


def world_of(outcome: CalibrationResult) -> Array:
    """Pose ``(4, 4)`` of the instrument in the world: where the identified base has it."""
    arm, values = outcome.rigid(outcome.identification.values)
    return _world_frame0(outcome) @ se3.inverse(arm.T_tracker_frame0(values))


def _world_frame0(outcome: CalibrationResult) -> Array:
    return outcome.robot.model.T_world_frame0


def _bodies(
    outcome: CalibrationResult, arm: RigidArm, values: Array, joints: Array, stations: Mapping[str, Array]
) -> tuple[tuple[Shell, ...], dict[str, Array]]:
    """The bodies that are drawn; the instrument's only where it is known: a virtual one."""
    robot = outcome.robot.model
    stands = station_body_poses(robot, stations)
    hidden = set() if outcome.real is not None else {instrument_body(robot), *stands}
    visible = tuple(shell for shell in shells(robot) if shell.body not in hidden)
    poses = body_poses(robot, arm, values, joints)
    poses |= {body: np.broadcast_to(T, (len(joints), 4, 4)) for body, T in stands.items()}
    return visible, {shell.body: poses[shell.body] for shell in visible}


def _uncertainty(
    identification: Identification, inputs: Array, centers: Array, T_world_instrument: Array, reach_m: float
) -> MagnifiedEllipsoids | None:
    """Compute the ellipsoids of the position covariance; None where it is unknown, or only rounding."""
    covariance = position_covariance(identification, inputs)
    if not np.isfinite(covariance).all():
        return None
    shapes = ellipsoids(covariance)
    return magnified(shapes, centers, T_world_instrument, reach_m) if shapes.half_lengths.max() > _ROUNDING_M else None
