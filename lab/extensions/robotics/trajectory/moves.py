"""A motion as the moves of a controller's program: its stops, how each is reached, and how fast."""

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.robotics.trajectory.result import TrajectoryResult
from lab.extensions.robotics.trajectory.tracked import tracking_along
from lab.formats.programs.postures import postures_of
from lab.formats.programs.protocol import MoveKind, PathMoves

__all__ = ["path_moves"]


def path_moves(result: TrajectoryResult) -> PathMoves:
    """The stops of all moves of a motion, and of circles the points that they pass.

    With a run these are the joint positions at which the calibrated arm, at rest, is where the nominal one would be.
    """
    first = result.legs[0]
    ids, kinds = [first.points[0]], list[MoveKind](["joint"])
    stops, seconds, shares, speeds = [first.stops[0]], [np.nan], [0.0], [np.nan]
    for leg in result.legs:
        share = float((leg.move.peaks[0] / _rated(result)).max())
        count = len(leg.points) - 1
        reached: list[MoveKind] = ["via", "circle"] if leg.kind == "circle" else [leg.kind] * count
        for name, kind, stop in zip(leg.points[1:], reached, leg.stops[1:], strict=True):
            ids.append(name)
            kinds.append(kind)
            stops.append(stop)
            seconds.append(np.nan if kind == "via" else leg.move.seconds / (1 if kind == "circle" else count))
            shares.append(share)
            speeds.append(leg.speed_m_s)
    return _moves(result, ids, kinds, np.array(stops), np.array([seconds, shares, speeds]))


def _rated(result: TrajectoryResult) -> Array:
    """The largest speeds ``(n,)`` of the robot's table; of joints without one those that are kept here."""
    known = result.robot.chain.speed
    return np.where(np.isfinite(known), known, result.chain.speed)


def _moves(result: TrajectoryResult, ids: list[str], kinds: list[MoveKind], stops: Array, rates: Array) -> PathMoves:
    tracked, options = result.tracked, result.options
    if tracked is None:
        arm, corrected = result.robot.arm(("p1",)), stops
        values = arm.nominal({"p1": options.tool_m})
    else:
        arm, values, still = tracked.arm.rigid, tracked.nominal, np.zeros_like(stops)
        corrected = tracking_along(tracked, stops, still, still, np.arange(float(len(stops)))).corrected.joints
    T_last_tool = se3.pose(np.eye(3), values[-3 * len(arm.targets) :][:3])
    return PathMoves(
        robot=result.robot.name,
        ids=ids,
        kinds=kinds,
        stops=corrected,
        Ts_base_tool=arm.tool(corrected, values)[0],
        seconds=rates[0],
        shares=rates[1],
        speeds_m_s=rates[2],
        T_last_tool=T_last_tool,
        T_frame0_base=se3.inverse(arm.T_tracker_frame0(values)),
        checked=result.checked,
        corrected=tracked is not None,
        postures=postures_of(arm, values, corrected),
    )
