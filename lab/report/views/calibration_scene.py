"""Scene of a calibration in the world: the arm at its fitted poses, points, errors and ellipsoids, as arrays (m)."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.calibration.guess import in_first_frame, station_poses
from lab.calibration.identification import Identification
from lab.calibration.observation import observation_of
from lab.core.measurements import rows_called, seen_mask
from lab.core.se3 import Array
from lab.core.units import MM
from lab.kinematics.effects.sessions import at_first_station
from lab.kinematics.model import RigidArm
from lab.library.calibration_result import CalibrationResult
from lab.prediction.ellipsoids import ellipsoids, mapping_ellipsoids, position_covariance
from lab.report.page_scene import ArmScene, Arrows, posed_arm
from lab.report.scene import (
    Legs,
    MagnifiedEllipsoids,
    drawn_rows,
    error_factor,
    magnified,
    mean_lengths,
    moved,
    reach_of,
    skeleton,
    world_legs,
)
from lab.report.style import ARROW_AFTER, BEFORE, rgb
from lab.report.views.calibration_figures import world_of
from lab.simulation.meshes import Shell, body_poses, instrument_body, shells, station_body_poses

__all__ = ["CampaignScene", "page_scene", "scene"]

_MOST_OUTLIERS = 30  # marked
_ROUNDING_M = 1e-9  # a standard deviation below this is the arithmetic's


class _OutlierPose(NamedTuple):
    description: str
    measured: Array  # its farthest target in the world, (3,) m
    expected: Array


@dataclass(frozen=True)
class CampaignScene:
    """A campaign's fitted poses in the world (m).

    Attributes:
        Ts_world_station: ``(4, 4)``, identified, by the names of the stations from which was measured, the first first.
        measured, before, after: ``(m, k, 3)`` points as measured (NaN where not), and as predicted.
        error_before, error_after: ``(n,)`` m, mean over the targets measured at each fitted pose, NaN where none was.
        factor_before, factor_after: magnification of the error arrows.
    """

    rows: NDArray[np.int_]  # (m,) rows of the drawn poses among the fitted ones
    numbers: NDArray[np.int_]  # (n,) each fitted pose's row among all that were measured
    outliers: tuple[_OutlierPose, ...]  # the farthest first
    reach_m: float  # the largest distance of a measured point, or a leg's end, from frame 0; sizes of marks follow it
    Ts_world_station: Mapping[str, Array]
    heads: Array  # (m, 3), the instrument's in each drawn pose
    measured: Array
    before: Array
    after: Array
    all_measured: Array  # (q, 3) of every fitted pose
    error_before: Array
    error_after: Array
    factor_before: float
    factor_after: float
    mapping: MagnifiedEllipsoids
    uncertainty: MagnifiedEllipsoids | None  # None where the noise is not known, or there was none
    shells: tuple[Shell, ...]  # of the drawn bodies
    bodies: dict[str, Array]  # world poses (m, 4, 4) by name
    origins: Array  # (m, f, 3) of the arm's frames
    legs: Legs  # in the world

    @property
    def at(self) -> NDArray[np.int_]:
        """``(m,)`` the drawn poses' rows among all that were measured."""
        return self.numbers[self.rows]


@lru_cache(maxsize=1)  # a run's page and recording show the same
def scene(outcome: CalibrationResult) -> CampaignScene:
    """Return the scene of a campaign; an evenly spaced part of its poses where they are many."""
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
    errors = [mean_lengths(observed - predicted) for predicted in (before, after)]
    measured, before, after = (
        moved(T_world_instrument, in_first_frame(model, identification.values, inputs, points))
        for points in (observed, before, after)
    )
    inputs = at_first_station(model.conditions, inputs)  # in whose frame ellipsoids are
    there = seen_mask(observed)
    arm, values = outcome.rigid(identification.values)
    places = moved(outcome.robot.model.T_world_frame0, skeleton(arm, values, joints).origins)
    between = world_legs(outcome.robot.model.T_world_frame0, arm, values, joints)
    reach = reach_of(outcome.robot.model.T_world_frame0, measured[there], between)
    visible, bodies = _bodies(outcome, arm, values, joints, stations)
    everything = {name: i for i, name in enumerate(outcome.measurements.ids)}
    return CampaignScene(
        rows,
        np.array([everything[name] for name in fitted.ids]),
        _outlier_poses(outcome, T_world_instrument),
        reach,
        stations,
        np.array([stations.get(fitted.stations[row], T_world_instrument)[:3, 3] for row in rows]),
        measured[rows],
        before[rows],
        after[rows],
        measured[there],
        errors[0],
        errors[1],
        error_factor(errors[0], reach),
        error_factor(errors[1], reach),
        magnified(mapping_ellipsoids(identification, inputs[rows]), after[rows, 0], T_world_instrument, reach),
        _uncertainty_ellipsoids(identification, inputs[rows], after[rows, 0], T_world_instrument, reach),
        visible,
        bodies,
        places,
        between,
    )


def _outlier_poses(outcome: CalibrationResult, T_world_instrument: Array) -> tuple[_OutlierPose, ...]:
    """The outliers that the test names; none where the file's points are not all that is observed."""
    model, data = outcome.identification.model, outcome.measurements
    named = outcome.state.outliers[:_MOST_OUTLIERS]
    observation = observation_of(model)
    if not named or observation.positions < len(observation.units):
        return ()
    part = data[rows_called(data, [pose.id for pose in named])]
    expected = model.points(part.inputs(model.conditions), outcome.identification.values)
    worst = np.nanargmax(np.linalg.norm(part.points - expected, axis=2), axis=1)
    inputs, values = part.inputs(model.conditions), outcome.identification.values
    both = (in_first_frame(model, values, inputs, points) for points in (part.points, expected))
    ends = (moved(T_world_instrument, points)[np.arange(len(named)), worst] for points in both)
    return tuple(
        _OutlierPose(f"{pose.id}: {MM.text(pose.size_m)}", measured, should)
        for pose, measured, should in zip(named, *ends, strict=True)
    )


def _bodies(
    outcome: CalibrationResult, arm: RigidArm, values: Array, joints: Array, stations: Mapping[str, Array]
) -> tuple[tuple[Shell, ...], dict[str, Array]]:
    """The bodies that are drawn; the instrument's only where it is known: a virtual one."""
    robot = outcome.robot.model
    stands = station_body_poses(robot, stations)
    hidden = set() if outcome.truth is not None else {instrument_body(robot), *stands}
    visible = tuple(shell for shell in shells(robot) if shell.body not in hidden)
    poses = body_poses(robot, arm, values, joints)
    poses |= {body: np.broadcast_to(T, (len(joints), 4, 4)) for body, T in stands.items()}
    return visible, {shell.body: poses[shell.body] for shell in visible}


def _uncertainty_ellipsoids(
    identification: Identification, inputs: Array, centers: Array, T_world_instrument: Array, reach_m: float
) -> MagnifiedEllipsoids | None:
    """Compute the ellipsoids of the position covariance; None where it is unknown, or only rounding."""
    covariance = position_covariance(identification, inputs)
    if not np.isfinite(covariance).all():
        return None
    shapes = ellipsoids(covariance)
    return magnified(shapes, centers, T_world_instrument, reach_m) if shapes.half_lengths.max() > _ROUNDING_M else None


def page_scene(outcome: CalibrationResult) -> ArmScene:
    """Return the scene for a page: the first target's errors and the uncertainty of its position.

    Of a fit to other measurements than points, it is the arm alone.
    """
    if not observation_of(outcome.identification.model).positions:
        arm, values = outcome.rigid(outcome.identification.values)
        rows = drawn_rows(len(outcome.fitted))
        names = [outcome.fitted.ids[row] for row in rows]
        return posed_arm(outcome.robot.model, arm, values, outcome.fitted.joints[rows], names)
    shown = scene(outcome)
    vectors = [(shown.measured - points)[:, 0] for points in (shown.before, shown.after)]
    arrows = (
        Arrows("before", vectors[0], shown.factor_before, rgb(BEFORE)),
        Arrows("after", vectors[1], shown.factor_before, rgb(ARROW_AFTER)),
        Arrows("after", vectors[1], shown.factor_after, rgb(ARROW_AFTER), at_first=False),
    )
    instruments = {
        instrument_body(outcome.robot.model),
        *station_body_poses(outcome.robot.model, shown.Ts_world_station),
    }
    columns = {"before": shown.error_before[shown.rows], "after": shown.error_after[shown.rows]}
    return ArmScene(
        [outcome.fitted.ids[row] for row in shown.rows],
        [shell for shell in shown.shells if shell.body not in instruments],
        shown.bodies,
        shown.after[:, 0],
        shown.legs,
        arrows,
        columns,
        shown.uncertainty,
        "uncertainty (1σ half-axes)",
    )
