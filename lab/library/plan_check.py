"""Check whether an earlier plan can still be run: limits, collisions, sight and paths of all its waypoints."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.limits import WAYPOINTS
from lab.core.measurements import Measurements
from lab.formats.measurement_csv import read_measurements
from lab.kinematics.trajectory.profiles import rest_to_rest_seconds
from lab.library.design import requested_design
from lab.library.result import Result
from lab.library.session_duration import SessionDuration
from lab.noise.instruments import Instrument, observing
from lab.options.call_options import takes
from lab.options.named_instruments import named_instrument
from lab.options.virtual_campaign import DesignOptions
from lab.pose_selection.tour import rated
from lab.robots.robot import Robot
from lab.simulation.candidate_poses import field_of_view, stations_in
from lab.simulation.collisions import describe_collisions
from lab.simulation.free_path import path_check, planning_model
from lab.simulation.robot_model import RobotModel

__all__ = ["PlanCheckResult", "check_plan"]

_SLACK = 1e-9  # rad or m
_USED = ("robot", "cell", "check", "targets", "instrument", "clearance_mm", "self_clearance_mm")
_OF_NEW_PLANS = tuple(each.name for each in fields(DesignOptions) if each.name not in _USED)


class _Fault(NamedTuple):
    waypoint: str  # that the arm may not take, or the path to it
    why: str


@dataclass(frozen=True, repr=False, eq=False)
class PlanCheckResult(Result):
    """Result of checking whether a plan can be run in a cell.

    Attributes:
        waypoints: the plan's rows, in order.
        faults: reasons why it cannot be run; empty where it can.
        duration: of the measurement session.
    """

    command = "design"
    robot_at = "robot"

    options: DesignOptions
    robot: Robot
    waypoints: Measurements
    faults: tuple[_Fault, ...]
    duration: SessionDuration
    warnings: tuple[str, ...]

    @property
    def exit_code(self) -> int:
        """1 where the plan cannot be run, else 0."""
        return 1 if self.faults else 0

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints."""
        return {
            "robot": self.robot.name,
            "plan": str(self.options.check),
            "stops": len(self.waypoints),
            "poses": self.duration.poses,
            "good": not self.faults,
            "faults": [{"stop": fault.waypoint, "why": fault.why} for fault in self.faults],
            **self.duration.to_dict(),
            "warnings": list(self.warnings),
        }

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """Return a row for each fault."""
        return {"stop": [fault.waypoint for fault in self.faults], "why": [fault.why for fault in self.faults]}


@takes(DesignOptions, unused=_OF_NEW_PLANS, check="plan")
def check_plan(
    plan: str | Path | DesignOptions, robot: str | Path | Robot = "irb120", **options: Any
) -> PlanCheckResult:
    """Check every waypoint of a plan, and every path between two, against the arm, its cell and its limits.

    Args:
        plan: the ``plan.csv`` of an earlier design; or all options of ``lab design`` in one object.
        robot: a model's name, a path, or a loaded robot.
        options: those of ``lab design --check``, by name: ``cell``, ``targets``, ``instrument`` and so on.

    Returns:
        The faults of the plan, none where it can be run, and the duration of the session.

    Raises:
        LabError: the plan, the robot or an option cannot be used.

    Example:
        >>> import lab
        >>> plan = lab.design("irb120", poses=14, candidates=100, starts=1)
        >>> folder = plan.save("plan")
        >>> lab.check_plan(folder / "plan.csv", "irb120").faults
        ()
    """
    if isinstance(plan, DesignOptions):
        requested, known = requested_design("lab.check_plan", plan, {})
    else:
        requested, known = requested_design("lab.check_plan", robot, {"check": plan, **options})
    assert requested.check is not None
    chain, warnings = rated(known.chain)
    waypoints = read_measurements(requested.check, chain.joint_names, chain.prismatic, points=False, most=WAYPOINTS)
    measured = np.array([use != "skip" for use in waypoints.use])
    if not measured.any():
        raise LabError(f"{requested.check}: no waypoint is to be measured; give the plan.csv of lab design")
    faults = _faults(requested, known, waypoints, measured)
    moving = rest_to_rest_seconds(np.diff(waypoints.joints, axis=0), chain.speed, chain.acceleration).sum()
    poses = len(np.unique(waypoints.joints[measured], axis=0))
    return PlanCheckResult(
        options=requested,
        robot=known,
        waypoints=waypoints,
        faults=tuple(_Fault(waypoints.ids[row], faults[row]) for row in sorted(faults)),
        duration=SessionDuration(poses, float(moving), int(measured.sum()) - poses),
        warnings=(*known.warnings, *waypoints.warnings, *warnings),
    )


def _faults(
    options: DesignOptions, robot: Robot, waypoints: Measurements, measured: NDArray[np.bool_]
) -> dict[int, str]:
    """Return the first reason against each faulty waypoint, or against the path to it, by its row."""
    robot.refuse_unknown(options.targets)
    device = observing(named_instrument(options.instrument), "points")
    model = planning_model(robot.model, options.targets, device, options.clearances)
    sights = _out_of_sight(options, robot, device, waypoints, measured)
    faults: dict[int, str] = {}
    for reasons in (_beyond_limits(robot, waypoints), _touching(model, waypoints), sights):
        for row, why in reasons:
            faults.setdefault(row, why)
    # Paths between two waypoints that are both without fault.
    free = path_check(model)
    for end in range(1, len(waypoints)):
        if not {end - 1, end} & faults.keys() and not free(waypoints.joints[end - 1], waypoints.joints[end]):
            faults[end] = f"the path to it from {waypoints.ids[end - 1]} does not keep the clearances"
    return faults


def _beyond_limits(robot: Robot, waypoints: Measurements) -> Iterator[tuple[int, str]]:
    for joint, beyond in enumerate(robot.chain.beyond_limits(waypoints.joints, _SLACK).T):
        for row in np.flatnonzero(beyond).tolist():
            yield row, robot.chain.limit_note(joint, waypoints.joints[row, joint])


def _touching(model: RobotModel, waypoints: Measurements) -> Iterator[tuple[int, str]]:
    for row, message in enumerate(describe_collisions(model, waypoints.joints)):
        if message:
            yield row, message


def _out_of_sight(
    options: DesignOptions, robot: Robot, device: Instrument, waypoints: Measurements, measured: NDArray[np.bool_]
) -> Iterator[tuple[int, str]]:
    assert options.check is not None
    at = stations_in(options.check, waypoints, robot.model)
    for station, name in enumerate(robot.model.stations or ("",)):
        rows = np.flatnonzero(measured & (at == station))
        sees = field_of_view(robot.model, options.targets, device, station)(waypoints.joints[rows])
        who = f"the instrument at station '{name}'" if name else "the instrument"
        for row in rows[~sees].tolist():
            yield row, f"{who} does not see {', '.join(options.targets)} there"
