"""A plan that was made before, against a cell that has changed: stop by stop, and way by way."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.campaign.instruments import named_instrument
from lab.campaign.options import DesignOptions
from lab.campaign.robot import Robot
from lab.campaign.stations import stations_in
from lab.commands.design.day import MeasuringDayLength
from lab.commands.result import Result
from lab.core.errors import LabError
from lab.core.limits import STOPS
from lab.core.measurements import Measurements
from lab.formats.measurement_csv import read_measurements
from lab.kinematics.trajectory.profiles import rest_to_rest_seconds
from lab.noise.instruments import observing
from lab.pose_selection.tour import rated
from lab.simulation.candidate_poses import field_of_view
from lab.simulation.clearances import planning_model
from lab.simulation.collisions import collisions_in_words
from lab.simulation.free_path import path_check

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.figure import Figure

    from lab.render.document import Document

__all__ = ["Fault", "PlanCheckResult", "check_plan"]

_SLACK = 1e-9  # rad or m


@dataclass(frozen=True)
class Fault:
    """A stop that the arm may not take, or a way to one that is not free: its id, and why."""

    stop: str
    why: str


@dataclass(frozen=True, repr=False, eq=False)
class PlanCheckResult(Result):
    """Whether a plan can be run in a cell.

    Attributes:
        options: what was asked.
        stops: the plan's rows, in order.
        faults: what is wrong with it; none where it can be run.
        day: how long it takes.
    """

    options: DesignOptions
    robot: Robot
    stops: Measurements
    faults: tuple[Fault, ...]
    day: MeasuringDayLength
    warnings: tuple[str, ...]

    @property
    def exit_code(self) -> int:
        """1 where the plan cannot be run, else 0."""
        return 1 if self.faults else 0

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints."""
        return {
            "robot": self.robot.name,
            "plan": str(self.options.check),
            "stops": len(self.stops),
            "poses": self.day.poses,
            "good": not self.faults,
            "faults": [{"stop": fault.stop, "why": fault.why} for fault in self.faults],
            **self.day.to_dict(),
            "warnings": list(self.warnings),
        }

    def document(self) -> "Document":
        """What a person reads: whether the plan can be run, what is wrong with it, how long it takes."""
        from lab.commands.design.check_document import check_document

        return check_document(self)

    def columns(self) -> "Mapping[str, Sequence[Any]]":
        """A row for each fault."""
        return {"stop": [fault.stop for fault in self.faults], "why": [fault.why for fault in self.faults]}

    def plot(self) -> "Figure":
        """There is nothing to draw.

        Raises:
            LabError: always.
        """
        raise LabError("a check of a plan has no figure; lab inspect --cell shows the cell")

    def write(self, folder: Path) -> None:
        """Write ``config.json``, ``result.json`` and ``report.html``."""
        from lab.commands.run_folder import write_config, write_json

        write_config(folder, "design", self.options, self.robot.sha256)
        write_json(folder / "result.json", self.to_dict())
        self.report(folder / "report.html")


def check_plan(options: DesignOptions, robot: Robot) -> PlanCheckResult:
    """Check every stop of a plan, and every way between two stops, against the arm, its cell and its limits.

    Args:
        options: whose ``check`` is the plan's file, with every stop in order.
        robot: in its cell.

    Raises:
        LabError: the file cannot be read, or has no stop to measure.
    """
    assert options.check is not None
    chain, warnings = rated(robot.chain)
    stops = read_measurements(options.check, chain.joint_names, chain.prismatic, points=False, most=STOPS)
    measured = np.array([use != "skip" for use in stops.use])
    if not measured.any():
        raise LabError(f"{options.check}: no stop is to be measured; give the plan.csv of lab design")
    device = observing(named_instrument(options.instrument), "points")
    faults: dict[str, str] = {}
    for j, beyond in enumerate(chain.beyond_limits(stops.joints, _SLACK).T):
        for i in np.flatnonzero(beyond):
            faults.setdefault(stops.ids[i], chain.said_beyond(j, stops.joints[i, j]))
    robot.refuse_unknown(options.targets)
    model = planning_model(robot.model, options.targets, device, options.clearances)
    for name, words in zip(stops.ids, collisions_in_words(model, stops.joints), strict=True):
        if words:
            faults.setdefault(name, words)
    at = stations_in(options.check, stops, robot.model)
    for station, name in enumerate(robot.model.stations or ("",)):
        here = np.flatnonzero(measured & (at == station))
        sees = field_of_view(robot.model, options.targets, device, station)(stops.joints[here])
        who = f"the instrument at station '{name}'" if name else "the instrument"
        for i in here[~sees]:
            faults.setdefault(stops.ids[i], f"{who} does not see {', '.join(options.targets)} there")
    free = path_check(model)
    for end in range(1, len(stops)):
        ends = {stops.ids[end - 1], stops.ids[end]}
        if not ends & set(faults) and not free(stops.joints[end - 1], stops.joints[end]):
            faults.setdefault(stops.ids[end], f"the path to it from {stops.ids[end - 1]} does not keep the clearances")
    order = {name: i for i, name in enumerate(stops.ids)}
    found = tuple(Fault(name, faults[name]) for name in sorted(faults, key=lambda name: order[name]))
    moving = rest_to_rest_seconds(np.diff(stops.joints, axis=0), chain.speed, chain.acceleration).sum()
    poses = len(np.unique(stops.joints[measured], axis=0))
    day = MeasuringDayLength(poses, float(moving), int(measured.sum()) - poses)
    return PlanCheckResult(options, robot, stops, found, day, (*robot.warnings, *stops.warnings, *warnings))
