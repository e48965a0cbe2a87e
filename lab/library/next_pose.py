"""Propose the pose to measure next, once or as a measurement file grows."""

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from lab.core.errors import LabError, counted, option_name
from lab.core.limits import TABLE_BYTES, WAYPOINTS
from lab.core.measurements import Measurements
from lab.core.number_text import fixed
from lab.core.progress import keep_line, stages
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.csv_table import write_columns
from lab.formats.measurement_csv import read_measurements
from lab.formats.structured import read_text
from lab.kinematics.joints import JointSpec
from lab.library.design import DesignResult
from lab.library.load_run import CALIBRATIONS, MEASUREMENTS_FILE
from lab.library.log_clocks import LEAST_POSES
from lab.library.pose_planner import PosePlanner, Proposal
from lab.library.result import Result, joint_values, number
from lab.library.run_folder import VIA, joint_columns
from lab.options.call_options import options_of, takes
from lab.options.command_options import NextOptions
from lab.options.virtual_campaign import DesignOptions
from lab.phrases.phrase import phrase
from lab.robots.config_file import CONFIG_FILE, SCHEMA, RunConfig, read_config, read_options
from lab.robots.load_robot import load_virtual
from lab.robots.robot import Robot
from lab.verdict.diagnosed import misread_points

__all__ = ["NEXT_FILE", "NextPoseResult", "length_mm", "next_pose", "proposal_text"]

_POLL_S = 0.2
_UNREADABLE_S = 5.0  # a file that cannot be read for so long is not just being written
_OF_PLAN = (
    "robot", "cell", "accuracy_mm", "targets", "instrument", "home", "clearance_mm", "self_clearance_mm", "no_check",
)  # fmt: skip
NEXT_FILE = "next.csv"
_MEND = "give the folder of a run of lab design, lab identify or lab calibrate"


@dataclass(frozen=True, repr=False, eq=False)
class NextPoseResult(Result):
    """The pose to measure next, and the accuracy so far.

    Attributes:
        options: of the command.
        planner: the robot with its candidates.
        data: the measurements so far, of the last proposal.
        proposals: one, or one after each new row of a file that was followed; the last one counts.
        doubts: mistakes of reading in the measurements so far, and measurements that tell apart what the run left open.
    """

    command = "next"
    robot_at = "planner.problem.robot"

    options: NextOptions
    planner: PosePlanner
    data: Measurements
    proposals: tuple[Proposal, ...]
    doubts: tuple[str, ...] = ()

    @property
    def proposal(self) -> Proposal:
        """The last proposal."""
        return self.proposals[-1]

    @property
    def joints(self) -> Array | None:
        """``(joints,)`` rad or m of the pose to measure next; None where the accuracy is reached."""
        return self.proposal.joints

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings for the reader."""
        noise, warnings = self.proposal.noise, [*self.doubts, *self.planner.problem.warnings]
        if self.proposal.from_home:
            warnings.append(
                "no free way leads on from the last pose, as the nominal model has it: move the arm home first; the "
                "way there is not checked"
            )
        if noise is not None and noise.larger and not self.doubts:
            warnings.append(
                f"the residuals are {noise.ratio:.2g} times the stated noise: check the instrument and its setup; "
                "predicted errors count with the larger noise"
            )
        return tuple(warnings)

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints and ``result.json`` holds: lengths in mm, angles in degrees."""
        last, wanted = self.proposal, self.planner.accuracy_m
        return {
            "robot": self.planner.problem.robot.name,
            "wanted_mm": None if wanted is None else MM.of(wanted),
            **self._values(last),
            "proposals": [self._values(each) for each in self.proposals],
            "warnings": list(self.warnings),
        }

    def _values(self, proposal: Proposal) -> dict[str, Any]:
        chain, noise = self.planner.problem.robot.chain, proposal.noise
        rows = None if proposal.waypoints is None else joint_columns(chain, proposal.waypoints)
        return {
            "measured": proposal.measured,
            "reached": proposal.reached,
            "accuracy_mm": length_mm(proposal.accuracy_m),
            "after_next_mm": length_mm(proposal.next_m),
            "remaining": proposal.remaining,
            "next": None if rows is None else {name: number(values[-1]) for name, values in rows.items()},
            "via": [] if rows is None else _rows({name: values[1:-1] for name, values in rows.items()}),
            "noise_ratio": None if noise is None else number(noise.ratio),
            "noise_larger_than_stated": None if noise is None else noise.larger,
        }

    def columns(self) -> Mapping[str, Sequence[Any] | Array]:
        """Return a row for each proposal: poses measured, predicted errors (mm), joint positions of the next pose."""
        size = self.planner.problem.robot.chain.size
        joints = [np.full(size, np.nan) if each.joints is None else each.joints for each in self.proposals]
        return {
            "measured": [each.measured for each in self.proposals],
            "accuracy_mm": [length_mm(each.accuracy_m) for each in self.proposals],
            "after_next_mm": [length_mm(each.next_m) for each in self.proposals],
            "remaining": [each.remaining for each in self.proposals],
            **joint_columns(self.planner.problem.robot.chain, np.array(joints)),
        }

    def write_files(self, folder: Path) -> None:
        """Write ``next.csv``: the way to the next pose, without a row where the accuracy is reached."""
        chain, way = self.planner.problem.robot.chain, self.proposal.waypoints
        joints = np.empty((0, chain.size)) if way is None else way[1:]
        purposes = [VIA] * (len(joints) - 1) + ["measure"] * (len(joints) > 0)
        write_columns(folder / NEXT_FILE, {"stop": purposes, **joint_columns(chain, joints)})


def length_mm(length: float | None) -> float | None:
    """Return a length in mm; None where it is unknown or not finite."""
    return None if length is None else number(MM.of(length))


def _rows(columns: Mapping[str, Array]) -> list[dict[str, float]]:
    return [dict(zip(columns, map(float, row), strict=True)) for row in zip(*columns.values(), strict=True)]


@takes(NextOptions, file="measurements")
def next_pose(
    plan: str | Path | DesignResult | NextOptions, measurements: str | Path | Measurements | None = None, **options: Any
) -> NextPoseResult:
    """Propose the pose to measure next, given all measured so far, and predict the accuracy.

    Args:
        plan: the folder of a run of ``lab design`` or ``lab identify``, or a plan in memory; or all options in one
            object.
        measurements: what is measured so far: a CSV file, or measurements in memory (rad or m, points in m).
        options: those of ``lab next``, by name: ``accuracy_mm``, ``criterion``, ``instrument`` and so on.

    Returns:
        Joint positions of the pose to measure next, a free way there, and predicted errors before and after it.

    Raises:
        LabError: the run or the file cannot be used, or no pose can be reached; the message says why.

    Example:
        >>> import lab
        >>> plan = lab.design("irb120", poses=14, candidates=100, starts=1)
        >>> lab.next_pose(plan, candidates=100).joints.shape
        (6,)
    """
    in_memory = measurements if isinstance(measurements, Measurements) else None
    if isinstance(plan, NextOptions):
        requested = plan
    else:
        file = None if in_memory is not None else measurements
        folder = "plan in memory" if isinstance(plan, DesignResult) else plan
        requested = options_of("lab.next_pose", NextOptions, {"plan": folder, "file": file, **options})
    requested.check()
    with stages("next pose") as stage:
        plan_options = plan.options if isinstance(plan, DesignResult) else None
        arguments, file = _planner_arguments(requested, in_memory, plan_options)
        planner = PosePlanner(**arguments, progress=partial(stage, "candidates"))
        stage("proposal")
        proposals = list[Proposal]()
        for data in (in_memory,) if in_memory is not None else _growing(requested, file, planner):
            proposals.append(_proposed(planner, data, file))
            if requested.follow:
                keep_line("next pose", proposal_text(planner.problem.robot.chain, proposals[-1]))
            if proposals[-1].reached:
                break
        doubts = (*_mistakes(planner, data), *(() if isinstance(plan, DesignResult) else _left_open(requested.plan)))
    return NextPoseResult(requested, planner, data, tuple(proposals), doubts)


def _mistakes(planner: PosePlanner, data: Measurements) -> list[str]:
    """Return the mistakes of reading in the measurements so far."""
    seen = data.with_points()
    if len(seen) < LEAST_POSES:
        return []
    return [phrase(each.check) for each in misread_points(planner.problem.robot, seen)]


def _left_open(run: Path) -> list[str]:
    """Return the measurements that tell mistakes apart which a run found, but could not tell from others."""
    path = run / "result.json"
    findings = json.loads(read_text(path, TABLE_BYTES)).get("findings", ()) if path.is_file() else ()
    return [
        f"measure {each['deciding_measurement']}: that tells {each['key']} from {', '.join(each['rivals'])}"
        for each in findings
        if each["deciding_measurement"]
    ]


def _proposed(planner: PosePlanner, data: Measurements, file: Path | None) -> Proposal:
    """Return the proposal after these measurements, which are of the planner's robot and targets."""
    _refuse_other_robot(data, planner.problem.robot)
    _refuse_other_targets(file or "measurements", data, planner.options.targets)
    seen = data.with_points()
    return planner.propose(seen.only("calibrate"), at=seen.joints[-1] if len(seen) else None)


def _planner_arguments(
    requested: NextOptions, in_memory: Measurements | None, plan: DesignOptions | None
) -> tuple[dict[str, Any], Path | None]:
    """Return the arguments of a planner, by a run or a plan in memory, and the measurement file."""
    folder, file = requested.plan, requested.file
    config = RunConfig({}, "design", schema=SCHEMA) if plan is not None else read_config(folder, _MEND)
    if config.command == "design":
        arguments = _of_plan(folder, plan or read_options(folder / CONFIG_FILE, "design", DesignOptions))
    elif config.command in CALIBRATIONS:
        file = requested.file or folder / MEASUREMENTS_FILE
        arguments = _of_calibration(requested, config.command, in_memory, file)
    else:
        raise LabError(f"{folder}: is a run of lab {config.command}; {_MEND}")
    for name in ("accuracy_mm", "instrument"):
        if (value := getattr(requested, name)) is not None:
            arguments[name] = value
    return arguments | {name: getattr(requested, name) for name in ("criterion", "candidates", "seed")}, file


def _of_plan(folder: Path, plan: DesignOptions) -> dict[str, Any]:
    if plan.observe != "points":
        raise LabError(f"{folder}: is a plan for {plan.observe}; lab next is for measured points alone; measure it")
    if plan.payload_kg or plan.model != "geometric":
        raise LabError(f"{folder}: is a plan for model {plan.model}; lab next is for geometry alone; measure it")
    return {name: getattr(plan, name) for name in _OF_PLAN}


def _of_calibration(requested: NextOptions, command: str, in_memory: Measurements | None, file: Path) -> dict[str, Any]:
    campaign = read_options(requested.plan / CONFIG_FILE, command, CALIBRATIONS[command])
    if campaign.instrument is None and requested.instrument is None:
        raise LabError(f"{requested.plan}: names no instrument; give {option_name('instrument')}")
    chain = load_virtual(campaign.robot or "irb120", campaign.cell).chain
    data = in_memory if in_memory is not None else _read(file, chain)
    targets = () if data is None else data.targets
    return {name: getattr(campaign, name) for name in ("robot", "cell", "instrument")} | {"targets": targets}


def _refuse_other_robot(data: Measurements, planned: Robot) -> None:
    if data.robot and data.robot not in (planned.name, str(planned.source)):
        raise LabError(
            f"the measurements are of {data.robot}, but the plan is for {planned.name}; give those of this robot"
        )


def _refuse_other_targets(what: str | Path, data: Measurements, planned: tuple[str, ...]) -> None:
    if len(data) and data.targets != planned:
        raise LabError(
            f"{what}: has the targets {', '.join(data.targets)}, but the plan is for {', '.join(planned)}; give the "
            "measurements of this plan"
        )


def _read(file: Path, chain: JointSpec) -> Measurements | None:
    """Return the rows of a file; None where a session has not begun, and the file has a header alone."""
    if file.is_file() and len(read_text(file, TABLE_BYTES).strip().splitlines()) < 2:
        return None
    return read_measurements(file, chain.joint_names, chain.prismatic, points=False, most=WAYPOINTS)


def _growing(requested: NextOptions, file: Path | None, planner: PosePlanner) -> Iterator[Measurements]:
    """Yield the measurements of a file, and again after each change of what is measured where it is followed."""
    if file is None:
        yield planner.nothing_measured
        return
    chain, state = planner.problem.robot.chain, _state(file)
    data = _read(file, chain) or planner.nothing_measured
    yield data
    for rows in _followed(file, chain, state, requested.patience_s) if requested.follow else ():
        latest = rows or planner.nothing_measured
        if latest.seen.sum() != data.seen.sum():
            data = latest
            yield data


def _followed(
    file: Path, chain: JointSpec, state: tuple[int, int] | None, patience_s: float
) -> Iterator[Measurements | None]:
    """Yield the rows of a file after each change of its state, until it stays as it is for so long."""
    since, unreadable = time.monotonic(), None
    while time.monotonic() - since < patience_s:
        try:
            time.sleep(_POLL_S)
        except KeyboardInterrupt:  # the user has seen enough: the run is written with what there is
            return
        if (latest := _state(file)) == state:
            continue
        try:
            rows = _read(file, chain)
        except LabError:  # a row is being written
            unreadable = unreadable or time.monotonic()
            if time.monotonic() - unreadable > _UNREADABLE_S:
                raise
            continue
        state, since, unreadable = latest, time.monotonic(), None
        yield rows


def _state(file: Path) -> tuple[int, int] | None:
    """Return the size and the time of the last change; None while the file is being replaced."""
    try:
        status = file.stat()
    except OSError:
        return None
    return status.st_size, status.st_mtime_ns


def proposal_text(chain: JointSpec, proposal: Proposal) -> str:
    """Describe a proposal in one line."""
    so_far = f"{counted(proposal.measured, 'pose')} measured"
    if proposal.accuracy_m is not None:
        so_far += f", {MM.text(proposal.accuracy_m)} predicted"
    if proposal.joints is None:
        return f"{so_far}: the wanted accuracy is reached"
    values = joint_values(chain.prismatic, proposal.joints)
    pose = ", ".join(f"{name} {fixed(value, 3)}" for name, value in zip(chain.joint_names, values, strict=True))
    more = "" if proposal.remaining is None else f"; about {counted(proposal.remaining, 'further pose')} to go"
    why = ", for the cross-validation alone" if more and proposal.for_validation else ""
    return f"{so_far}; next: {pose}{more}{why}"
