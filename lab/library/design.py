"""Plan a measurement session: which poses, in what order, how many, and how good the choice is."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from lab.calibration.identifiability import enough_poses
from lab.core.errors import LabError
from lab.core.limits import WAYPOINTS
from lab.core.measurements import Measurements, measured
from lab.core.progress import Stage, stages
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.measurement_csv import read_measurements, write_measurements
from lab.formats.programs.languages import plan_files, plan_or_refusal
from lab.formats.programs.program_text import postures_of
from lab.formats.programs.protocol import PAUSE_S, MeasuringTour
from lab.kinematics.effects.effect import PAYLOAD
from lab.kinematics.joints import JointSpec
from lab.kinematics.trajectory.profiles import rest_to_rest_seconds
from lab.library.result import Result, error_statistics, number
from lab.library.run_folder import VIA, Waypoints
from lab.noise.instruments import observing
from lab.options.call_options import options_of, takes
from lab.options.named_instruments import named_instrument
from lab.options.virtual_campaign import DesignOptions
from lab.planning.design_problem import PoseProblem, best_design, exchanged, pose_problem
from lab.pose_selection.certificate import CriterionCertificate, certify_criterion
from lab.pose_selection.criteria import (
    DesignTask,
    Indices,
    indices,
)
from lab.pose_selection.exchange import Design, DesignCertificate, certify, information
from lab.pose_selection.predicted_accuracy import PredictedAccuracy, predict, smallest_count
from lab.pose_selection.tour import Tour, one_after_another, plan_tour, rated, with_reference
from lab.robots.load_robot import load_virtual
from lab.robots.robot import Robot
from lab.simulation.candidate_poses import field_of_view, incidence, stations_in, view_of
from lab.simulation.collisions import describe_collisions
from lab.simulation.free_path import path_check, planning_model

__all__ = ["DesignResult", "DesignStep", "PlanCheckResult", "SessionDuration", "design", "planned_session", "visit_ids"]

_WARM_UP_S = 1800.0  # ISO 9283:1998 asks for a warm-up, its length as the maker says; half an hour is common
_REFERENCE_EVERY = 10  # poses after which the reference pose is measured again


@dataclass(frozen=True)
class SessionDuration:
    """The time that a plan takes."""

    poses: int  # number of measured poses
    moving_s: float  # time of motion at full speed, s
    again: int = 0  # number of repeated measurements of the plan

    @classmethod
    def of(cls, tour: Tour) -> Self:
        """Return the measurement session of a tour."""
        poses = len(tour.order)
        return cls(poses, tour.seconds, int((tour.measured >= 0).sum()) - poses)

    @property
    def references(self) -> int:
        """Number of reference measurements: first, after every tenth pose, and last; or as planned."""
        return 1 + (self.again or 1 + (self.poses - 1) // _REFERENCE_EVERY)

    @property
    def seconds(self) -> float:
        """Total duration: warm-up, moves, waiting; paths to the reference pose last as long as others."""
        moving = _WARM_UP_S + self.moving_s + PAUSE_S * (self.poses + self.again)
        if self.again:
            return moving
        a_move = self.moving_s / (self.poses + 1)
        return moving + self.references * (2 * a_move + PAUSE_S)

    def to_dict(self) -> dict[str, float | int]:
        """The parts, in s."""
        return {
            "tour_seconds": float(self.moving_s),
            "warm_up_seconds": _WARM_UP_S,
            "reference_measurements": self.references,
            "day_seconds": round(self.seconds, 1),
        }

    @property
    def description(self) -> str:
        """Description of the measurement session's needs, in sentences."""
        reference = (
            "The plan measures its reference pose again (--reference-every)."
            if self.again
            else f"Choose one pose of the plan as reference; measure it first, after every {_REFERENCE_EVERY}th pose "
            f"and last (--reference-every {_REFERENCE_EVERY} plans this)."
        )
        return (
            f"The session takes about {self.seconds / 60:.0f} minutes: {_WARM_UP_S / 60:.0f} minutes of warm-up, in "
            f"which the arm runs the plan without measuring, {self.moving_s / 60:.1f} minutes of moving at full speed, "
            f"{PAUSE_S} s of waiting at each pose, and {self.references} measurements of a reference pose. {reference} "
            "Its scatter is the repeatability, and its drift shows whether tracker or arm have moved. Setup and "
            "warm-up of the tracker are not included."
        )


def visit_ids(tour: Tour, pose_ids: Sequence[str]) -> tuple[str, ...]:
    """Name each measured waypoint of a tour: its pose's id, with the number of the visit if it is repeated."""
    names = dict(zip(tour.order.tolist(), pose_ids, strict=True))
    visits, ids = dict.fromkeys(names, 0), list[str]()
    for pose in tour.measured[tour.measured >= 0].tolist():
        visits[pose] += 1
        ids.append(names[pose] + (f"_{visits[pose]}" if visits[pose] > 1 else ""))
    return tuple(ids)


_NEAR_ACCEPTANCE_DEG = 5.0  # nearer to the largest angle of a reflector, a waypoint is counted
_NUMBERED = ("o1", "o2", "o3", "o4", "o5", "condition", "a")
_VARIANCE = "mm², variance of the position at test poses; independent of the parameters' units"


@dataclass(frozen=True)
class DesignStep:
    """A point of the curve against the number of poses: predicted error and O1 of a design of that size."""

    poses: int
    prediction: PredictedAccuracy
    o1: float

    def to_dict(self) -> dict[str, float | int]:
        """The step with its lengths in mm."""
        rms: Array = MM.of(self.prediction.rms)
        return {
            "poses": self.poses,
            "rms_mm": float(np.sqrt(np.mean(rms**2))),
            "worst_mm": float(rms.max()),
            "promise_mm": MM.of(self.prediction.coverage_radius),
            "o1": self.o1,
        }


class _Block(NamedTuple):
    """A part of a tour from home to home, from one station and with one payload; None if no payloads are given."""

    station: str
    payload_kg: float | None
    part: slice

    @property
    def name(self) -> str:
        """Name of the block in file names; "" for a whole tour."""
        return "_".join(each for each in (self.station, _mass(self.payload_kg)) if each)


def _mass(payload_kg: float | None) -> str:
    return "" if payload_kg is None else f"{payload_kg:g}kg"


@dataclass(frozen=True, repr=False, eq=False)
class DesignResult(Result):
    """Poses to measure, in the order of the tour.

    Attributes:
        problem: the robot, its feasible candidates, and what the poses are to identify.
        joints: ``(n, joints)``, rad or m.
        stations: ``(n,)`` the station of the instrument that measures each, from 0.
        design: the chosen poses before ordering.
        certificate: the best continuous D-optimal design over the candidates and the poses that the ascent moved.
        d_efficiency: certified, of the chosen poses with those measured already.
        payloads: ``(n,)`` kg that the arm carries at each pose; zero if none are given.
        own_certificate: of the criterion, if it is another one than O1; else None.
        efficiency: certified by it, of the chosen poses with those measured already.
        indices: the observability indices, in the units of the scaling.
        prediction: the predicted errors on validation poses.
        curve: against the number of poses.
        tour: the order of the poses, and the stops on the way.
        seconds: that the search took.
    """

    command = "design"
    robot_at = "problem.robot"

    options: DesignOptions
    problem: PoseProblem
    joints: Array
    stations: NDArray[np.int_]
    design: Design
    payloads: Array
    certificate: DesignCertificate
    d_efficiency: float
    own_certificate: CriterionCertificate | None
    efficiency: float | None
    indices: Indices
    prediction: PredictedAccuracy
    curve: tuple[DesignStep, ...]
    tour: Tour
    seconds: float = field(compare=False)
    warnings: tuple[str, ...]

    @property
    def _pool_description(self) -> str:
        candidates = len(self.problem.candidates.joints)
        moved = len(self.certificate.weights) - len(self.problem.inputs)
        text = f"any {len(self.joints)} of {candidates} feasible candidates"
        if len(self.problem.payloads):
            text += f", each with one of {len(self.problem.payloads)} payloads,"
        if len(self.problem.already):
            text += f" added to the {len(self.problem.already)} measured already"
        return text + (f" and the {moved} poses that the ascent moved away from candidates" if moved else "")

    @property
    def task(self) -> DesignTask:
        """What the rows and columns of ``information`` are, and where accuracy counts; as criteria get it."""
        return self.problem.task

    @property
    def information(self) -> Array:
        """Information matrix ``(p, p)`` of the poses with those measured before, in the units of ``task``."""
        return information(np.concatenate([self.design.jacobian, self.problem.before]))

    @property
    def pose_ids(self) -> tuple[str, ...]:
        """Numbers from 1 in the order of the tour, after those of the poses measured already."""
        first = len(self.problem.already) + 1
        return tuple(str(first + i) for i in range(len(self.joints)))

    @cached_property
    def _reflector(self) -> dict[str, float | int] | None:
        """Closeness of the waypoints to the reflectors' acceptance angle; None if they take any angle, or are none."""
        if self.problem.planned is not None:
            return None
        robot, targets = self.problem.robot.model, self.options.targets
        acceptance = view_of(robot, named_instrument(self.options.instrument)).acceptance_rad
        if acceptance >= np.pi:
            return None
        angles = np.rad2deg(incidence(robot, targets, self.joints, self.stations)).max(axis=1)
        return {
            "acceptance_deg": float(np.rad2deg(acceptance)),
            "largest_deg": float(angles.max()),
            "near_deg": _NEAR_ACCEPTANCE_DEG,
            "near": int((angles > np.rad2deg(acceptance) - _NEAR_ACCEPTANCE_DEG).sum()),
        }

    @cached_property
    def corners(self) -> tuple[int, ...] | None:
        """Number of corners that the pictures at each pose show, in the order of the tour; None for measured points."""
        planned = self.problem.planned
        return None if planned is None else tuple(planned.counts(self.joints).tolist())

    @property
    def waypoints(self) -> Waypoints:
        """Waypoints of the tour: home, poses to measure, via poses, and home."""
        which = np.where(self.tour.measured >= 0, np.cumsum(self.tour.measured >= 0) - 1, -1)
        ids = visit_ids(self.tour, self.pose_ids)
        loads = tuple(each.payload_kg for each in self._blocks_of_waypoints if each.payload_kg is not None)
        return Waypoints(self.tour.waypoints, which, ids, "measure", self._stations_of_waypoints, loads)

    @property
    def _blocks(self) -> tuple[_Block, ...]:
        """Parts of the tour from home to home: one for each station, and there for each payload."""
        ends = [0, *self.tour.breaks, len(self.tour.waypoints) - 1]
        measuring = dict.fromkeys(zip(self.stations.tolist(), self.payloads.tolist(), strict=True))
        names = self.problem.robot.model.stations or ("",)
        return tuple(
            _Block(names[station], payload if len(self.problem.payloads) else None, slice(a, b + 1))
            for (station, payload), (a, b) in zip(measuring, pairwise(ends), strict=True)
        )

    @property
    def _blocks_of_waypoints(self) -> tuple[_Block, ...]:
        """The block of each waypoint."""
        counts = [(each, each.part.stop - each.part.start - (each.part.start > 0)) for each in self._blocks]
        return tuple(each for each, count in counts for _ in range(count))

    @property
    def _stations_of_waypoints(self) -> tuple[str, ...]:
        """The station in whose part each stop is; none where there is one alone."""
        if not self.problem.robot.model.stations:
            return ()
        return tuple(each.station for each in self._blocks_of_waypoints)

    @property
    def payload_changes(self) -> int:
        """Number of times that the payload is changed between the first pose and the last."""
        return sum(a.payload_kg != b.payload_kg for a, b in pairwise(self._blocks))

    @property
    def table(self) -> Measurements:
        """Table of all waypoints in tour order, with nothing measured yet; via poses are not for use."""
        names, waypoints, n = self.problem.robot.chain.joint_names, self.waypoints, len(self.tour.waypoints)
        points = np.full((n, len(self.options.targets), 3), np.nan)
        data = measured(names, waypoints.joints, self.options.targets, points)
        use = tuple("skip" if purpose == VIA else "calibrate" for purpose in waypoints.purposes)
        marks = {"stop": waypoints.purposes} | ({"station": waypoints.stations} if waypoints.stations else {})
        marks |= {"checked": ("no",) * n} if self.options.no_check else {}
        conditions = {PAYLOAD: np.array(waypoints.payloads_kg)} if waypoints.payloads_kg else {}
        return replace(data, ids=waypoints.names, use=use, other=marks, conditions=conditions)

    @property
    def _scaled_indices(self) -> dict[str, dict[str, Any]]:
        """Design indices with their scaling; G and I are the worst and the mean predicted variance."""
        scaling, variance = self.problem.scaling.describe(), MM.of(self.prediction.rms) ** 2
        found = {name: (getattr(self.indices, name), scaling) for name in _NUMBERED}
        found |= {"g": (variance.max(), _VARIANCE), "i": (variance.mean(), _VARIANCE)}
        return {name: {"value": number(float(value)), "scaling": what} for name, (value, what) in found.items()}

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints and ``result.json`` holds: lengths in mm."""
        options, candidates, tour, model = self.options, self.problem.candidates, self.tour, self.problem.robot.model
        return {
            "robot": self.problem.robot.name,
            "poses": len(self.joints),
            "measured_already": len(self.problem.already),
            "targets": list(options.targets),
            "observe": options.observe,
            "instrument": options.instrument if self.problem.planned is None else self.problem.planned.noise,
            "corners": None if self.corners is None else list(self.corners),
            "parameters": len(self.problem.structure.identifiable),
            "criterion": options.criterion,
            "model": [options.model],
            "region": options.region,
            "indices": self._scaled_indices,
            "d_efficiency": self.d_efficiency,
            "bound_gap": self.certificate.gap,
            "pool": {"poses": len(self.certificate.weights), "what": self._pool_description},
            "predicted_mm": error_statistics(self.prediction.rms).to_dict(),
            "promise_mm": MM.of(self.prediction.coverage_radius),
            "certificate": self._own_certificate,
            "payloads": [
                {"payload_kg": float(mass), "poses": int((self.payloads == mass).sum())}
                for mass in self.problem.payloads
            ],
            "payload_changes": self.payload_changes,
            "candidates": {
                "drawn": candidates.drawn,
                "feasible": len(candidates.joints),
                "rejected": {reason: int(count) for reason, count in candidates.rejected.items()},
            },
            **SessionDuration.of(tour).to_dict(),
            "moves": len(tour.waypoints) - 1,
            "via": self.tour.via,
            "reflector": self._reflector,
            "stations": [
                {"name": name, "poses": int((self.stations == i).sum()), "head_mm": MM.of(T[:3, 3]).round(6).tolist()}
                for i, (name, T) in enumerate(zip(model.stations, model.Ts_world_station, strict=False))
            ],
            "checked": not self.options.no_check,
            "stops": list(self.waypoints.rows(self.problem.robot.chain)),
            "curve_of": "designs" if self.options.curve else "continuous design",
            "curve": [step.to_dict() for step in self.curve],
            **plan_or_refusal(self.problem.robot.chain, self.options.controller, [each.name for each in self._blocks]),
            "seconds": round(self.seconds, 4),
            "warnings": list(self.warnings),
        }

    @property
    def _own_certificate(self) -> dict[str, Any] | None:
        """The certificate of the criterion itself."""
        if self.own_certificate is None or self.efficiency is None:
            return None
        return {
            "criterion": self.options.criterion,
            "efficiency": self.efficiency,
            "bound_gap": self.own_certificate.gap,
        }

    def columns(self) -> Mapping[str, Sequence[Any] | Array]:
        """Return waypoint columns: ``id``, ``stop`` (measure, via), and joint positions in ``_deg`` or ``_mm``."""
        return self.waypoints.columns(self.problem.robot.chain)

    def write_files(self, folder: Path) -> None:
        """Write the plan and the programs that drive it.

        ``plan.csv`` is what ``lab calibrate --plan`` measures, and, once its empty points are filled in, what ``lab
        identify`` reads.
        """
        robot = self.problem.robot
        write_measurements(folder / "plan.csv", self.table, robot.chain.prismatic)
        arm = robot.arm(tuple(robot.tool))
        nominal, ids, done = arm.nominal(robot.tool), visit_ids(self.tour, self.pose_ids), 0
        for block in self._blocks:
            waypoints, measured = self.tour.waypoints[block.part], self.tour.measured[block.part]
            count = int((measured >= 0).sum())
            tour = MeasuringTour(
                robot.name,
                waypoints,
                measured,
                ids[done : done + count],
                not self.options.no_check,
                postures_of(arm, nominal, waypoints),
                block.name,
            )
            done += count
            for name, content in plan_files(robot.chain, self.options.controller, tour).items():
                (folder / name).write_bytes(content)


_SLACK = 1e-9  # rad or m


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
        """A row for each fault."""
        return {"stop": [fault.waypoint for fault in self.faults], "why": [fault.why for fault in self.faults]}


def _check_plan(options: DesignOptions, robot: Robot) -> PlanCheckResult:
    """Check every waypoint of a plan, and every path between two, against the arm, its cell and its limits."""
    assert options.check is not None
    chain, warnings = rated(robot.chain)
    waypoints = read_measurements(options.check, chain.joint_names, chain.prismatic, points=False, most=WAYPOINTS)
    measured = np.array([use != "skip" for use in waypoints.use])
    if not measured.any():
        raise LabError(f"{options.check}: no waypoint is to be measured; give the plan.csv of lab design")
    device = observing(named_instrument(options.instrument), "points")
    faults: dict[str, str] = {}
    for j, beyond in enumerate(chain.beyond_limits(waypoints.joints, _SLACK).T):
        for i in np.flatnonzero(beyond):
            faults.setdefault(waypoints.ids[i], chain.limit_note(j, waypoints.joints[i, j]))
    robot.refuse_unknown(options.targets)
    model = planning_model(robot.model, options.targets, device, options.clearances)
    for name, message in zip(waypoints.ids, describe_collisions(model, waypoints.joints), strict=True):
        if message:
            faults.setdefault(name, message)
    at = stations_in(options.check, waypoints, robot.model)
    for station, name in enumerate(robot.model.stations or ("",)):
        here = np.flatnonzero(measured & (at == station))
        sees = field_of_view(robot.model, options.targets, device, station)(waypoints.joints[here])
        who = f"the instrument at station '{name}'" if name else "the instrument"
        for i in here[~sees]:
            faults.setdefault(waypoints.ids[i], f"{who} does not see {', '.join(options.targets)} there")
    free = path_check(model)
    for end in range(1, len(waypoints)):
        ends = {waypoints.ids[end - 1], waypoints.ids[end]}
        if not ends & set(faults) and not free(waypoints.joints[end - 1], waypoints.joints[end]):
            faults.setdefault(
                waypoints.ids[end], f"the path to it from {waypoints.ids[end - 1]} does not keep the clearances"
            )
    order = {name: i for i, name in enumerate(waypoints.ids)}
    found = tuple(_Fault(name, faults[name]) for name in sorted(faults, key=lambda name: order[name]))
    moving = rest_to_rest_seconds(np.diff(waypoints.joints, axis=0), chain.speed, chain.acceleration).sum()
    poses = len(np.unique(waypoints.joints[measured], axis=0))
    day = SessionDuration(poses, float(moving), int(measured.sum()) - poses)
    return PlanCheckResult(options, robot, waypoints, found, day, (*robot.warnings, *waypoints.warnings, *warnings))


_POSES = 30  # where neither a number nor an accuracy is asked for
_CURVE_STEPS = 10
_NO_WEIGHT = 1e-6  # of the continuous design: a pose with less is left out
_MOST_POSES = 200  # where an accuracy is asked for


@takes(DesignOptions)
def design(robot: str | Path | Robot | DesignOptions = "irb120", **options: Any) -> DesignResult | PlanCheckResult:
    """Choose the poses to measure among feasible candidates, improve them, certify them, and order them.

    Args:
        robot: a model's name, a path, or a loaded robot; or all options in one object.
        options: those of ``lab design``, by name: ``poses`` or ``accuracy_mm``, ``criterion``, ``instrument`` and so
            on; ``criterion`` may be a function of the information matrix, or an object of a subclass of
            ``lab.Criterion``.

    Returns:
        Joint positions (rad or m) in the order of the tour, and what accuracy to expect of them; with ``check`` whether
        an earlier plan can be run.

    Raises:
        LabError: the request cannot be met.

    Example:
        >>> import lab
        >>> plan = lab.design("irb120", poses=14, candidates=100, starts=1)
        >>> plan.joints.shape
        (14, 6)
    """
    if isinstance(robot, DesignOptions):
        requested, known = robot, load_virtual(robot.robot, robot.cell)
    else:
        known = load_virtual(robot)
        requested = options_of("lab.design", DesignOptions, {"robot": known.source, **options})
        known = known.placed_in(requested.cell)
    requested = replace(requested, targets=known.on_tips(requested.targets))
    requested.refuse_nonsense()
    return _check_plan(requested, known) if requested.check is not None else planned_session(requested, known)


def planned_session(options: DesignOptions, robot: Robot | None = None) -> DesignResult:
    """Choose poses and order them, for the options' robot unless one is given.

    Raises:
        LabError: the request cannot be met.
    """
    with stages("planning") as progress:
        loaded = load_virtual(options.robot, options.cell) if robot is None else robot
        started = time.perf_counter()
        options = replace(options, targets=loaded.on_tips(options.targets))
        problem = pose_problem(options, loaded, partial(progress, "1 of 5, candidates"))
        return _planned(options, problem, started, progress)


def _planned(options: DesignOptions, problem: PoseProblem, started: float, progress: Stage) -> DesignResult:
    least = enough_poses(problem.pool, problem.before)
    quick = _of_any_size(options, problem)
    if options.accuracy_mm is not None:
        design = _accurate_design(options, problem, least, quick, progress)
    else:
        count = _POSES if options.poses is None else options.poses
        if count < least:
            raise LabError(f"--poses {count}: {problem.pool.shape[2]} parameters need {least} poses or more")
        design = best_design(options, problem, count, progress)
    count = len(design.joints)

    progress("3 of 5, certificate")
    pool = np.concatenate([problem.pool, design.jacobian[design.rows < 0]])
    n0 = len(problem.already)
    measured = None if problem.measured is None else problem.measured / n0
    certificate = certify(pool, measured=measured, share=count / (n0 + count))
    everything = np.concatenate([design.jacobian, problem.before])
    own, efficiency = _own_certificate(problem, design, certificate)
    most = max(least, min(max(2 * count, least + 10), len(problem.pool) // 2, max(_MOST_POSES, count)))
    sizes = np.unique(np.geomspace(least, most, _CURVE_STEPS).round().astype(int)).tolist()
    progress("4 of 5, tour")
    chain, warnings = rated(problem.robot.chain)
    tour = _tour(options, problem, design.joints, chain)
    return DesignResult(
        options=options,
        problem=problem,
        joints=design.joints[list(tour.order), : chain.size],
        stations=problem.station(design.joints)[list(tour.order)],
        payloads=problem.payload(design.joints)[list(tour.order)],
        design=design,
        certificate=certificate,
        d_efficiency=certificate.efficiency(everything),
        own_certificate=own,
        efficiency=efficiency,
        indices=indices(everything),
        prediction=_prediction(problem, design.joints, options.seed),
        curve=tuple(
            _designed_steps(options, problem, sizes, quick, progress)
            if options.curve
            else _continuous_steps(options, problem, sizes, pool, design, certificate)
        ),
        tour=tour,
        seconds=time.perf_counter() - started,
        warnings=(*problem.warnings, *warnings),
    )


def _tour(options: DesignOptions, problem: PoseProblem, inputs: Array, chain: JointSpec) -> Tour:
    """The order of the poses, station by station, and there payload by payload.

    Between two of them the arm waits at home for the instrument, or for the payload. The payloads alternate, so that
    no change is needed with the instrument's.
    """
    home, safe, rng = problem.access.hubs[0], problem.access.hubs[1:], rng_for(options.seed, "tour")
    joints, at, carried, parts = inputs[:, : chain.size], problem.station(inputs), problem.payload(inputs), []
    there: float | None = None  # payload at the end of the last block
    for station in np.unique(at):
        masses = np.unique(carried[at == station]).tolist()
        if there in masses:
            masses = [there, *(mass for mass in masses if mass != there)]
        for mass in masses:
            rows = np.flatnonzero((at == station) & (carried == mass))
            part = plan_tour(joints[rows], chain.speed, chain.acceleration, problem.access.free, rng, home, safe)
            if options.reference_every is not None:
                part = with_reference(part, options.reference_every, problem.access.hubs, chain, problem.access.free)
            parts.append(part.among(rows))
            there = mass
    return one_after_another(parts)


def _prediction(problem: PoseProblem, inputs: Array, seed: int) -> PredictedAccuracy:
    """Return the predicted errors."""
    every = np.concatenate([inputs, problem.already])
    return predict(information(problem.whitened(every)), problem.test, rng_for(seed, "promise"))


def _own_certificate(
    problem: PoseProblem, design: Design, certificate: DesignCertificate
) -> tuple[CriterionCertificate | None, float | None]:
    """Return the certificate of the criterion and the efficiency by it, if it is not O1.

    Args:
        certificate: of O1, from whose weights the search starts.
    """
    goal, moved = problem.goal, design.joints[design.rows < 0]
    if goal.name == "O1" or goal.growth is None:
        return None, None
    n0, n = len(problem.already), len(design.joints)
    pool = np.concatenate([problem.pool, problem.sensitivity(moved)])
    found = certify_criterion(goal, pool, problem.before, start=certificate.weights, share=n / (n0 + n))
    if found is None:
        return None, None
    total = information(problem.sensitivity(design.joints)) + information(problem.before)
    return found, found.efficiency(float(goal.score(total)) / goal.growth, n + n0)


def _of_any_size(options: DesignOptions, problem: PoseProblem) -> Callable[[int], Design]:
    """Designs by exchange alone, each made once."""
    made: dict[int, Design] = {}

    def design(count: int) -> Design:
        if count not in made:
            made[count] = exchanged(problem, count, rng_for(options.seed, "design"))
        return made[count]

    return design


def _accurate_design(
    options: DesignOptions, problem: PoseProblem, least: int, quick: Callable[[int], Design], progress: Stage
) -> Design:
    """The smallest design whose predicted error is within the accuracy asked for.

    Exchanged designs find about how many poses; from there ascended ones, whose predicted error is smaller, decide.
    """
    assert options.accuracy_mm is not None
    wanted = MM.to_si(options.accuracy_mm)
    most = max(least, min(_MOST_POSES, len(problem.pool) // 2))

    def bound(design: Design) -> float:
        return _prediction(problem, design.joints, options.seed).coverage_radius

    count = smallest_count(lambda size: bound(quick(size)), wanted, least, most)
    design = best_design(options, problem, count, progress)
    while bound(design) > wanted:  # uphill on another criterion may cost accuracy
        count += 1
        if count > most:
            raise LabError(f"{options.accuracy_mm:g} mm is out of reach by criterion {options.criterion}: try O1 or I")
        design = best_design(options, problem, count, progress)
    while count > least:
        fewer = best_design(options, problem, count - 1, progress)
        if bound(fewer) > wanted:
            break
        count, design = count - 1, fewer
    return design


def _designed_steps(
    options: DesignOptions, problem: PoseProblem, sizes: Sequence[int], quick: Callable[[int], Design], progress: Stage
) -> Iterator[DesignStep]:
    """Predicted error and O1 of exchanged designs of these sizes."""
    for done, size in enumerate(sizes):
        progress(f"5 of 5, curve, {size} poses", done, len(sizes))
        chosen = quick(size)
        o1 = float(indices(np.concatenate([chosen.jacobian, problem.before])).o1)
        everything = information(problem.whitened(np.concatenate([chosen.joints, problem.already])))
        yield DesignStep(size, predict(everything, problem.test, rng_for(options.seed, "promise")), o1)


def _continuous_steps(
    options: DesignOptions,
    problem: PoseProblem,
    sizes: Sequence[int],
    pool: Array,
    design: Design,
    certificate: DesignCertificate,
) -> Iterator[DesignStep]:
    """Predicted error and O1 of the certificate's continuous design, as if so many poses could be shared out by it.

    At little cost: a design of whole poses comes near it where there are several times as many as the fewest.
    """
    support = np.flatnonzero(certificate.weights > _NO_WEIGHT)
    weights = certificate.weights[support] / certificate.weights[support].sum()
    inputs = np.concatenate([problem.inputs, design.joints[design.rows < 0]])[support]
    weighted = np.sqrt(weights)[:, None, None]
    per_pose, before = information(weighted * problem.whitened(inputs)), information(problem.whitened(problem.already))

    def predicted(information: Array) -> PredictedAccuracy:
        return predict(information, problem.test, rng_for(options.seed, "promise"))

    alone = None if before.any() else predicted(per_pose)
    for size in sizes:
        rows = np.concatenate([np.sqrt(size) * weighted * pool[support], problem.before])
        o1 = indices(rows * np.sqrt(len(rows) / (size + len(problem.before)))).o1
        prediction = predicted(size * per_pose + before) if alone is None else alone.repeated(size)
        yield DesignStep(size, prediction, float(o1))
