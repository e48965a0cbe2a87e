"""Plan a measurement session: which poses, in what order, how many, and how good the choice is."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.calibration.identifiability import enough_poses
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.core.progress import Stage, stages
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.measurement_csv import write_measurements
from lab.formats.programs.languages import plan_files, plan_or_refusal
from lab.formats.programs.program_text import postures_of
from lab.formats.programs.protocol import MeasuringTour
from lab.kinematics.effects.effect import PAYLOAD
from lab.kinematics.joints import JointSpec
from lab.library.result import Result, error_statistics, number
from lab.library.run_folder import VIA, Waypoints
from lab.library.session_duration import SessionDuration
from lab.options.call_options import options_of, takes
from lab.options.named_instruments import named_instrument
from lab.options.virtual_campaign import DesignOptions
from lab.planning.design_problem import PoseProblem, pose_problem
from lab.planning.design_search import (
    DesignStep,
    accurate_design,
    best_design,
    certified,
    continuous_steps,
    curve_sizes,
    designed_steps,
    designs_of_any_size,
    predicted_accuracy,
)
from lab.pose_selection.certificate import DesignCertificate, certify, d_value
from lab.pose_selection.criteria import (
    DesignTask,
    Indices,
    indices,
)
from lab.pose_selection.exchange import Design, information
from lab.pose_selection.predicted_accuracy import PredictedAccuracy
from lab.pose_selection.tour import Tour, one_after_another, plan_tour, rated, with_reference
from lab.robots.load_robot import load_virtual
from lab.robots.robot import Robot
from lab.simulation.candidate_poses import incidence, view_of

__all__ = ["DesignResult", "design", "requested_design", "visit_ids"]


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
    own_certificate: DesignCertificate | None
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
        values = {name: (getattr(self.indices, name), scaling) for name in _NUMBERED}
        values |= {"g": (variance.max(), _VARIANCE), "i": (variance.mean(), _VARIANCE)}
        return {name: {"value": number(float(value)), "scaling": what} for name, (value, what) in values.items()}

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


_POSES = 30  # where neither a number nor an accuracy is asked for


@takes(DesignOptions, unused=("check",))
def design(robot: str | Path | Robot | DesignOptions = "irb120", **options: Any) -> DesignResult:
    """Choose the poses to measure among feasible candidates, improve them, certify them, and order them.

    Args:
        robot: a model's name, a path, or a loaded robot; or all options in one object.
        options: those of ``lab design``, by name: ``poses`` or ``accuracy_mm``, ``criterion``, ``instrument`` and so
            on; ``criterion`` may be a function of the information matrix, or an object of a subclass of
            ``lab.Criterion``.

    Returns:
        Joint positions (rad or m) in the order of the tour, and what accuracy to expect of them.

    Raises:
        LabError: the request cannot be met.

    Example:
        >>> import lab
        >>> plan = lab.design("irb120", poses=14, candidates=100, starts=1)
        >>> plan.joints.shape
        (14, 6)
    """
    requested, known = requested_design("lab.design", robot, options)
    if requested.check is not None:
        raise LabError(f"lab.design: check = {requested.check} makes no plan; call lab.check_plan")
    with stages("planning") as progress:
        started = time.perf_counter()
        problem = pose_problem(requested, known, partial(progress, "1 of 5, candidates"))
        return _planned(requested, problem, started, progress)


def requested_design(
    call: str, robot: str | Path | Robot | DesignOptions, options: Mapping[str, Any]
) -> tuple[DesignOptions, Robot]:
    """Return the options of a call and its robot, in its cell.

    Raises:
        LabError: an option cannot be used.
    """
    if isinstance(robot, DesignOptions):
        requested, known = robot, load_virtual(robot.robot, robot.cell)
    else:
        known = load_virtual(robot)
        requested = options_of(call, DesignOptions, {"robot": known.source, **options})
        known = known.placed_in(requested.cell)
    requested = replace(requested, targets=known.on_tips(requested.targets))
    requested.refuse_nonsense()
    return requested, known


def _planned(options: DesignOptions, problem: PoseProblem, started: float, progress: Stage) -> DesignResult:
    # The poses: of the requested number, or the fewest within the requested accuracy.
    least = enough_poses(problem.pool, problem.before)
    quick = designs_of_any_size(options, problem)
    if options.accuracy_mm is not None:
        design = accurate_design(options, problem, least, quick, progress)
    else:
        count = _POSES if options.poses is None else options.poses
        if count < least:
            raise LabError(f"--poses {count}: {problem.pool.shape[2]} parameters need {least} poses or more")
        design = best_design(options, problem, count, progress)
    count = len(design.joints)

    # Bounds of the efficiency: of O1, and of the criterion if it is another.
    progress("3 of 5, certificate")
    pool = np.concatenate([problem.pool, design.jacobian[design.rows < 0]])
    n0 = len(problem.already)
    measured = None if problem.measured is None else problem.measured / n0
    certificate = certify(pool, measured=measured, share=count / (n0 + count))
    everything = np.concatenate([design.jacobian, problem.before])
    own, efficiency = certified(problem, design, certificate)

    progress("4 of 5, tour")
    chain, warnings = rated(problem.robot.chain)
    tour = _tour(options, problem, design.joints, chain)
    sizes = curve_sizes(problem, least, count)
    return DesignResult(
        options=options,
        problem=problem,
        joints=design.joints[list(tour.order), : chain.size],
        stations=problem.station(design.joints)[list(tour.order)],
        payloads=problem.payload(design.joints)[list(tour.order)],
        design=design,
        certificate=certificate,
        d_efficiency=certificate.efficiency(d_value(everything), len(everything)),
        own_certificate=own,
        efficiency=efficiency,
        indices=indices(everything),
        prediction=predicted_accuracy(problem, design.joints, options.seed),
        curve=tuple(
            designed_steps(options, problem, sizes, quick, progress)
            if options.curve
            else continuous_steps(options, problem, sizes, pool, design, certificate)
        ),
        tour=tour,
        seconds=time.perf_counter() - started,
        warnings=(*problem.warnings, *warnings),
    )


def _tour(options: DesignOptions, problem: PoseProblem, inputs: Array, chain: JointSpec) -> Tour:
    """Order the poses station by station, and at each payload by payload.

    Between two of them the arm waits at home for the instrument, or for the payload. The payloads alternate, so that
    no change is needed with the instrument's.
    """
    home, safe, rng = problem.access.hubs[0], problem.access.hubs[1:], rng_for(options.seed, "tour")
    joints, at, carried, parts = inputs[:, : chain.size], problem.station(inputs), problem.payload(inputs), []
    carried_last: float | None = None  # payload of the block before
    for station in np.unique(at):
        masses = np.unique(carried[at == station]).tolist()
        if carried_last in masses:
            masses = [carried_last, *(mass for mass in masses if mass != carried_last)]
        for mass in masses:
            rows = np.flatnonzero((at == station) & (carried == mass))
            part = plan_tour(joints[rows], chain.speed, chain.acceleration, problem.access.free, rng, home, safe)
            if options.reference_every is not None:
                part = with_reference(part, options.reference_every, problem.access.hubs, chain, problem.access.free)
            parts.append(part.among(rows))
            carried_last = mass
    return one_after_another(parts)
