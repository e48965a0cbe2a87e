"""Document and scene of a plan: the predicted error, the tour, and the quality of the pose selection."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.core.number_text import fixed, sentence, short
from lab.core.se3 import Array
from lab.core.units import MICRONS
from lab.formats.programs.languages import PLAN, language_of, plan_or_refusal, refusal
from lab.formats.programs.protocol import PAUSE_S
from lab.kinematics.joints import JointSpec
from lab.library.design import DesignResult, visit_ids
from lab.library.plan_check import PlanCheckResult
from lab.library.session_duration import SessionDuration
from lab.planning.design_search import DesignStep
from lab.pose_selection.exchange import information
from lab.pose_selection.tour import rated, tour_trajectory
from lab.prediction.ellipsoids import ellipsoids
from lab.prediction.task_region import task_region
from lab.report import document as doc
from lab.report.charts.chart import axes_picture, log_ticks, shades
from lab.report.charts.marks import Axes
from lab.report.page_scene import ArmScene, Line, moments
from lab.report.scene import (
    MOST_POSES,
    Legs,
    MagnifiedEllipsoids,
    magnified,
    moved,
    reach_of,
    skeleton,
    world_legs,
)
from lab.report.style import (
    ARM,
    BOUND,
    GRID,
    ORDER_SCALE,
    REFERENCE,
    RMS,
    TICK,
    WORST,
    rgb,
)
from lab.simulation.meshes import Shell, body_poses, instrument_body, shells, station_body_poses

__all__ = [
    "PlanScene",
    "check_document",
    "design_document",
    "main_picture",
    "page_scene",
    "plan_scene",
]

_STEP_S = 0.1  # between two pictures of the moving arm
_POINTS_PER_PATH = 16  # points drawn of the path between two stops
_MOST_DRAWN = 1_500  # points of the whole path on a page


@dataclass(frozen=True)
class PlanScene:
    """The stops of a tour: home, poses and the poses passed on the way, home.

    Attributes:
        arrivals, departures: ``(s,)`` s, when the arm comes to each stop and leaves it, at its full speed.
        times: ``(t,)`` s while it moves, with ``moving_joints`` ``(t, joints)``, ``moving``, poses ``(t, 4, 4)`` of the
            bodies by name, ``moving_legs``, and ``moving_points`` ``(t, k, 3)``.
    """

    measured: NDArray[np.bool_]  # (s,), whether a stop is measured
    ids: tuple[str, ...]  # (n,) of the measured ones, as in plan.csv
    points: Array  # (s, k, 3) targets
    path: Array  # (p, 3), the first target's way through all stops
    Ts_world_station: Array  # (q, 4, 4), where the instrument measures from, with its names in stations
    stations: tuple[str, ...]
    station: NDArray[np.int_]  # (s,) from where it measures at each stop
    reach_m: float  # the largest distance of a target, or a leg's end, from frame 0
    shells: tuple[Shell, ...]  # of the drawn bodies
    bodies: dict[str, Array]  # world poses (s, 4, 4) by name
    origins: Array  # (s, f, 3) of the arm's frames
    legs: Legs  # in the world
    mapping: MagnifiedEllipsoids  # sensitivity of the position to the scaled parameters
    uncertainty: MagnifiedEllipsoids  # predicted 1 sigma of the first target after calibration
    arrivals: Array
    departures: Array
    times: Array
    moving_joints: Array
    moving: dict[str, Array]
    moving_legs: Legs
    moving_points: Array

    @property
    def heads(self) -> Array:
        """The tracker's at each stop ``(s, 3)``."""
        heads: Array = self.Ts_world_station[self.station, :3, 3]
        return heads


@lru_cache(maxsize=1)
def plan_scene(plan: DesignResult) -> PlanScene:
    """The scene of a plan, of the nominal arm and the tracker where the model has it."""
    problem, waypoints = plan.problem, plan.tour.waypoints
    model, arm, values = problem.robot.model, problem.arm, problem.values
    tracker, frame0, names = model.T_world_tracker, model.T_world_frame0, model.stations or ("",)
    points = moved(tracker, arm.points(waypoints, values))
    share = np.linspace(0, 1, _POINTS_PER_PATH, endpoint=False)[None, :, None]
    between = waypoints[:-1, None] + share * (waypoints[1:] - waypoints[:-1])[:, None]  # (s - 1, points, joints)
    path = np.concatenate([between.reshape(-1, waypoints.shape[1]), waypoints[-1:]])
    mapping, uncertainty = _shapes(plan)
    waiting = np.where(plan.tour.measured >= 0, float(PAUSE_S), 0.0)
    day, arrivals = tour_trajectory(rated(problem.robot.chain)[0], waypoints, waiting)
    times = np.concatenate(
        [np.arange(left, came, _STEP_S)[1:] for left, came in zip(arrivals + waiting, arrivals[1:], strict=False)]
    )
    under_way = day.at(times)[0]
    visible, moving_poses = tuple(shells(model)), body_poses(model, arm, values, under_way)
    legs = world_legs(frame0, arm, values, waypoints)
    reach = reach_of(frame0, points, legs)
    return PlanScene(
        np.asarray(plan.tour.measured >= 0),
        visit_ids(plan.tour, plan.pose_ids),
        points,
        moved(tracker, arm.points(path, values))[:, 0],
        model.Ts_world_station,
        model.stations or ("tracker",),
        np.array([names.index(name) for name in plan.waypoints.stations or names[:1] * len(waypoints)]),
        reach,
        visible,
        body_poses(model, arm, values, waypoints),
        moved(frame0, skeleton(arm, values, waypoints).origins),
        legs,
        magnified(ellipsoids(mapping @ np.swapaxes(mapping, 1, 2)), points[:, 0], tracker, reach),
        magnified(ellipsoids(uncertainty @ np.swapaxes(uncertainty, 1, 2)), points[:, 0], tracker, reach),
        arrivals,
        arrivals + waiting,
        times,
        under_way,
        {shell.body: moving_poses[shell.body] for shell in visible},
        world_legs(frame0, arm, values, under_way),
        moved(tracker, arm.points(under_way, values)),
    )


def _shapes(plan: DesignResult) -> tuple[Array, Array]:
    """Compute factors F ``(s, 3, p)`` at every waypoint, of the squares F F' of mapping and uncertainty ellipsoids.

    The parameters of the mapping are scaled so that over all measured poses each moves the
    whitened points alike; the uncertainty is J C J', the inverse of the information being C.
    """
    problem = plan.problem
    _, jacobian = problem.arm.observe(plan.tour.waypoints, problem.values)
    seen = [
        i for i in problem.structure.identifiable if i < len(problem.arm.names)
    ]  # the places of stations move no point
    here = np.zeros((*jacobian.shape[:1], 3, len(problem.structure.identifiable)))
    here[..., : len(seen)] = jacobian[:, 0][..., seen]
    total = information(problem.whitened(np.concatenate([plan.design.joints, problem.already])))
    size = np.sqrt(np.diag(total))
    root = np.linalg.cholesky(total / np.outer(size, size))
    factor = np.linalg.inv(root).T / size[:, None]  # C = factor factor'
    return here / size, here @ factor


_HALF, _WIDE = (4.8, 2.9), (8.0, 2.6)  # inches
_ERROR_POWER = {"A": 0.5, "G": 0.5, "I": 0.5}  # from an efficiency, a ratio of variances, to a ratio of errors


def main_picture(plan: DesignResult) -> doc.Picture:
    """Return the predicted errors against the number of poses, with the plan's."""
    chosen = len(plan.joints), plan.prediction.coverage_radius
    return axes_picture(
        "curve", "Predicted error against the number of poses", _HALF,
        lambda axes: _draw_errors(axes, plan.curve, chosen), (0.65, 0.5, 0.15, 0.3),
    )  # fmt: skip


def _joints_picture(plan: DesignResult) -> doc.Picture:
    """Return the joint positions of the poses in their ranges."""
    return axes_picture(
        "joints", "The joint positions in their ranges", _WIDE,
        lambda axes: _joints(axes, plan.problem.robot.chain, plan.joints), (1.0, 0.15, 0.2, 0.3),
    )  # fmt: skip


def _draw_errors(axes: Axes, curve: Sequence[DesignStep], chosen: tuple[int, float]) -> None:
    """Draw predicted errors on validation poses (µm, logarithmic) against the number of poses."""
    poses = [step.poses for step in curve]
    drawn = [MICRONS.of(np.array([_rms(s.prediction.rms) for s in curve]))]
    for label, values, tint, style in (
        ("95 %/95 % tolerance bound", [s.prediction.coverage_radius for s in curve], BOUND, "o-"),
        ("worst pose, RMS", [s.prediction.rms.max() for s in curve], WORST, "^:"),
        ("all poses, RMS", [_rms(s.prediction.rms) for s in curve], RMS, "s:"),
    ):
        drawn.append(MICRONS.of(np.array(values)))
        axes.plot(poses, drawn[-1], style, color=tint, label=label, markersize=5)
    text = f"this plan: {chosen[0]} poses, {short(MICRONS.of(chosen[1]))} µm"
    drawn.append(np.array([MICRONS.of(chosen[1])]))
    axes.axvline(chosen[0], color=REFERENCE, linewidth=1)
    axes.plot([chosen[0]], drawn[-1], "D", color=REFERENCE, markersize=8, label=text, zorder=4)
    every = np.concatenate(drawn)
    low, high = float(every.min()) / 1.2, float(every.max()) * 1.2
    log_ticks(axes, "y", low, high)
    axes.set(xlabel="poses", ylabel="predicted position error, µm (logarithmic)", title="Error on validation poses")
    axes.legend(loc="upper right")


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _in_order(rows: NDArray[np.int_], count: int) -> Array:
    """The colours ``(n, 3)`` of rows ``(n,)`` of so many: dark for the first, light for the last."""
    return shades(rows / max(count - 1, 1), ORDER_SCALE)


def _joints(axes: Axes, chain: JointSpec, joints: Array) -> None:
    share = (joints - chain.lower) / (chain.upper - chain.lower)
    rows = np.arange(chain.size)[::-1]
    axes.hlines(rows, 0, 1, color=GRID, linewidth=9)
    for k, row in enumerate(rows):
        tints = _in_order(np.arange(len(share)), len(share))
        axes.scatter(share[:, k], np.full(len(share), row), c=tints, s=45, edgecolors="white", linewidths=1, zorder=3)
        unit = chain.unit(k)
        for x, value, side in ((-0.01, chain.lower[k], "right"), (1.01, chain.upper[k], "left")):
            axes.annotate(
                f"{unit.of(value):.0f} {unit.name}".replace("-", "−"), (x, row), ha=side, va="center", color=TICK
            )
    axes.set_yticks(rows, chain.joint_names)
    axes.tick_params(axis="y", length=0)
    axes.set(xlim=(-0.09, 1.09), ylim=(-0.6, chain.size - 0.4), xticks=[], title="Joint positions between the limits")
    axes.grid(visible=False)


_INDICES = {
    "o1": "O1, information per pose",
    "o2": "O2, smallest over largest σ",
    "o3": "O3, smallest σ",
    "o4": "O4, noise amplification",
    "o5": "O5, 1 / Σ 1/σ",
    "condition": "condition number",
    "a": "A, Σ 1/σ²",
    "g": "G, worst predicted variance",
    "i": "I, mean predicted variance",
}
_JOINTS = (
    "The position of each joint in its range at each pose, in the order of the tour from first (dark) to last (light)."
)
_CURVE = "Predicted error against the number of poses. The line marks this plan."
_OF = {
    "designs": "Each row is a design with that number of poses.",
    "continuous design": "The rows scale the certificate's continuous design, which distributes any number of poses "
    "over the candidates. Designs of whole poses have larger errors, near the fewest poses more than twice as large; "
    "--curve designs each.",
}
_PLAN = (
    "The tour at full speed, without the waits at the poses. Points are the poses to measure; ellipsoids show the "
    "predicted uncertainty of the first target after calibration."
)
_BOUND = "With 95 % confidence, 95 % of the validation poses have an error below the 95 %/95 % tolerance bound."


def design_document(result: DesignResult) -> doc.Document:
    """The predicted error, the tour, the certificate and the indices of the choice."""
    values = result.to_dict()
    session = SessionDuration.of(result.tour)
    lead = doc.Paragraph(f"{_chosen(values)} {_predicted(values)}", "lead", shown_in=doc.NARROW)
    return doc.Document(
        f"{values['robot']}: {values['poses']} poses to measure",
        (
            _card(result, values, session),
            lead,
            doc.Warnings(result.warnings),
            doc.Section(
                "Poses and tour",
                (
                    doc.Scene("plan-scene", lambda: page_scene(result), _PLAN),
                    doc.Paragraph(f"{_chosen(values)} {_predicted(values)}", shown_in=doc.PAGE),
                    doc.Paragraph(_tour(result)),
                    *_files(result),
                    *_corners(result),
                    *_reflector(values),
                    *_stations(values),
                    *_payloads(values),
                    doc.Section(
                        "The session, and what was checked",
                        (
                            doc.Paragraph(session.description),
                            doc.Paragraph(_checked(result)),
                            doc.Paragraph(_candidates(values)),
                        ),
                        folded=True,
                    ),
                    doc.Figure("poses-figure", (_joints_picture(result),), _JOINTS),
                ),
            ),
            doc.Section(
                "Number of poses",
                (
                    _steps(values),
                    doc.Paragraph(f"{_BOUND} {_OF[values['curve_of']]}", "note"),
                ),
            ),
            doc.Section(
                "Quality of the choice",
                (doc.Paragraph(_certificate(values)), *_own_certificate(values), *_indices(values)),
            ),
        ),
    )


@doc.guarded
def _card(result: DesignResult, values: dict[str, Any], session: SessionDuration) -> doc.Card:
    """Summarise the plan: whether it can be run, how many poses, what error to expect, and the next step."""
    predicted, options, chain = values["predicted_mm"], result.options, result.problem.robot.chain
    badge = doc.Badge("free of collisions", "good")
    if options.no_check:
        badge = doc.Badge("not checked for collisions", "doubtful")
    asked = "" if options.accuracy_mm is None else f", within the {short(options.accuracy_mm)} mm asked for"
    names = plan_or_refusal(chain, options.controller, result.problem.robot.model.stations).values()
    programs = " and ".join(name for name in names if name.startswith((f"{PLAN}.", f"{PLAN}_")))
    how = f"slowly at first: {programs} moves the arm" if programs else "pose by pose"
    measure: tuple[str | doc.Code, ...] = ("; measure at each pose into ", doc.Code("plan.csv"))
    if result.corners:
        measure = ("; take a picture at each pose; write its corners, or its path, into a row of the measurement file",)
    return doc.Card(
        ("Plan: ", badge, asked),
        (
            ("poses", f"{values['poses']}", ""),
            ("predicted error", short(predicted["rms"], "mm"), "after"),
            ("95 % are below", short(values["promise_mm"], "mm"), ""),
            ("session", f"{session.seconds / 60:.0f} min", ""),
        ),
        f"Predicted after calibration: root mean square over {_region_text(result)}, by the noise of "
        f"{values['instrument']} alone; the bound that 95 % are below holds in 95 % of such calibrations.",
        ("Run the plan ", how, *measure, "; then give it to lab identify."),
        (doc.Figure("curve-figure", (main_picture(result),), _CURVE),),
    )


def _region_text(result: DesignResult) -> str:
    """Name the poses at which the error is predicted, and the frame of their coordinates."""
    if result.corners:
        return "validation poses, with base and tool placed anew"
    region = task_region(result.options.region)
    return {
        "workspace": "validation poses",
        "box": "poses in the box of --region, given in the robot's frame 0,",
        "targets": f"poses at the targets of {region.file}, given in the instrument's frame,",
    }[region.kind]


def page_scene(result: DesignResult) -> ArmScene:
    """The tour: its moves, the poses to measure, and the predicted uncertainty of the first target there."""
    shown = plan_scene(result)
    stops = np.flatnonzero(shown.measured)[:MOST_POSES]
    end = stops[-1] + 1 if len(stops) < shown.measured.sum() else len(shown.arrivals)
    waits = shown.departures - shown.arrivals
    moving = shown.times[shown.times < shown.arrivals[end - 1]]
    arrived = shown.arrivals[:end] - np.append(0.0, np.cumsum(waits[: end - 1]))
    passed = np.searchsorted(shown.departures[:end], moving, side="right")
    times = np.concatenate([arrived, moving - np.cumsum(waits)[passed - 1]])
    order = np.argsort(times, kind="stable")
    at = np.argsort(order, kind="stable")[stops]  # moments of the stops
    kept = moments(len(order), at)
    rows = order[kept]

    def joined(standing: Array, under_way: Array) -> Array:
        return np.concatenate([standing[:end], under_way[: len(moving)]])[rows]

    drawn = shown.uncertainty
    uncertainty = MagnifiedEllipsoids(drawn.centers[stops], drawn.axes[stops], drawn.half_sizes[stops], drawn.factor)
    path = shown.path[: (end - 1) * _POINTS_PER_PATH + 1]
    path = path[:: -(-len(path) // _MOST_DRAWN)]
    model = result.problem.robot.model
    instruments = {
        instrument_body(model),
        *station_body_poses(model, dict(zip(shown.stations, shown.Ts_world_station, strict=True))),
    }
    return ArmScene(
        shown.ids[: len(stops)],
        [shell for shell in shown.shells if shell.body not in instruments],
        {body: joined(shown.bodies[body], moving_body) for body, moving_body in shown.moving.items()},
        shown.points[stops, 0],
        Legs(joined(shown.legs.ends, shown.moving_legs.ends), shown.legs.measured),
        columns={"predicted 1σ": uncertainty.half_sizes[:, 0] / drawn.factor},
        ellipsoids=uncertainty,
        ellipsoid_text="predicted uncertainty (1σ half-axes)",
        times=times[order][kept],
        stops=np.searchsorted(kept, at),
        lines=(Line("path", path, rgb(ARM)),),
    )


def _chosen(values: dict[str, Any]) -> str:
    already = f", added to {values['measured_already']} measured already" if values["measured_already"] else ""
    targets = "" if values["corners"] else f"targets {', '.join(values['targets'])}, "
    what = f"{targets}{values['instrument']}"
    return (
        f"{values['poses']} poses{already}, {what}: {values['parameters']} parameters, criterion {values['criterion']}."
    )


def _predicted(values: dict[str, Any]) -> str:
    predicted = values["predicted_mm"]
    where = "validation poses" if values["region"] == "workspace" else "the poses of the task's region"
    noise = "the instrument's noise"
    if values["corners"]:
        where, noise = "validation poses, with base and tool placed anew,", "the corners' noise"
    assumes = "a rigid robot" if values["model"][0] == "geometric" else f"the model {values['model'][0]}"
    return (
        f"The predicted error on {where} is {predicted['rms']:.4f} mm RMS over all poses and "
        f"{predicted['max']:.4f} mm RMS at the worst pose; its 95 %/95 % tolerance bound is "
        f"{values['promise_mm']:.4f} mm. It includes only {noise}, and assumes {assumes}."
    )


def _steps(values: dict[str, Any]) -> doc.Table:
    """The curve as a table, with O1 where each number was designed: else it is the same for any."""
    designed = values["curve_of"] == "designs"
    rows = tuple(
        (
            str(step["poses"]),
            *(short(step[key]) for key in ("rms_mm", "worst_mm", "promise_mm")),
            *((fixed(step["o1"], 2),) if designed else ()),
        )
        for step in values["curve"]
    )
    columns = ("poses", "RMS, mm", "worst pose, mm", "95 %/95 % bound, mm", *(("O1",) if designed else ()))
    return doc.Table(columns, rows, "Predicted error on validation poses")


def _tour(result: DesignResult) -> str:
    tour = result.tour
    via = f", {result.tour.via} of them through waypoints that are not measured" if result.tour.via else ""
    chain, controller = result.problem.robot.chain, result.options.controller
    language = None if refusal(chain, controller) else language_of(chain, controller)
    moving = f" {PLAN}{language.suffix} moves at {language.speed}, which takes longer." if language else ""
    return (
        f"The tour has {len(tour.waypoints) - 1} moves{via}. It takes {float(tour.seconds):.1f} s from home to home at "
        f"full speed and acceleration, plus {PAUSE_S} s of waiting at each pose.{moving}"
    )


def _checked(result: DesignResult) -> str:
    if result.options.no_check:
        return "Nothing was checked for collisions."
    options = result.options
    with_what = "without cameras and boards" if result.corners else "including reflectors and nests"
    return (
        "Every waypoint and every move (a straight line in joint space) was checked for collisions of the arm with "
        f"itself and with the surroundings in the robot's model, {with_what}. The clearance to the "
        f"surroundings is {options.clearance_mm:g} mm unless an obstacle states another. Links that are not neighbours "
        f"keep {options.self_clearance_mm:g} mm, or their distance at home."
    )


def _candidates(values: dict[str, Any]) -> str:
    candidates, lost = values["candidates"], values["candidates"]["rejected"]
    singular = f"{lost['singularity']:,} near a parallel singularity, " if lost["singularity"] else ""
    collided = f"{lost['collision']:,} in collision, " if values["checked"] else ""
    unseen = "without enough corners in a picture" if values["corners"] else "not visible to the tracker"
    return (
        f"{candidates['feasible']:,} feasible candidates of {candidates['drawn']:,} drawn; rejected: "
        f"{lost['limits']:,} near a "
        f"joint limit, {singular}{collided}{lost['visibility']:,} {unseen}."
    )


@doc.guarded
def _corners(result: DesignResult) -> tuple[doc.Block, ...]:
    """Return how many corners the pictures at each pose show; nothing for measured points."""
    if not result.corners:
        return ()
    least, most = min(result.corners), max(result.corners)
    rows = tuple((name, str(count)) for name, count in zip(result.pose_ids, result.corners, strict=True))
    return (
        doc.Paragraph(f"The pictures at a pose show {least} to {most} corners."),
        doc.Section("Corners at each pose", (doc.Table(("pose", "corners"), rows),), folded=True),
    )


@doc.guarded
def _reflector(values: dict[str, Any]) -> tuple[doc.Block, ...]:
    reflector = values["reflector"]
    if reflector is None:
        return ()
    return (
        doc.Paragraph(
            f"The reflector takes beams up to {reflector['acceptance_deg']:.0f}° off its axis. At these poses "
            "they are up "
            f"to {reflector['largest_deg']:.0f}° off; {reflector['near']} of {values['poses']} poses are within "
            f"{reflector['near_deg']:.0f}° of the limit."
        ),
    )


@doc.guarded
def _stations(values: dict[str, Any]) -> tuple[doc.Block, ...]:
    stations = values["stations"]
    if not stations:
        return ()
    listed = ", then ".join(f"{each['poses']} from {each['name']}" for each in stations if each["poses"])
    rows = ((each["name"], str(each["poses"]), ", ".join(f"{x:.0f}" for x in each["head_mm"])) for each in stations)
    return (
        doc.Paragraph(
            f"Each pose is measured from the station that sees it best: {listed}. Between two stations the arm waits "
            "at home until the instrument has been moved. Every point stays in the frame of its own station; the "
            "stations' poses are identified with the robot."
        ),
        doc.Table(("station", "poses", "head, mm, in the robot's frame"), tuple(rows)),
    )


@doc.guarded
def _payloads(values: dict[str, Any]) -> tuple[doc.Block, ...]:
    if not values["payloads"]:
        return ()
    listed = ", ".join(f"{each['poses']} poses with {each['payload_kg']:g} kg" for each in values["payloads"])
    changes = values["payload_changes"]
    times = "once" if changes == 1 else f"{changes} times"
    changed = f"The arm waits at home while it is changed, {times}" if changes else "It is never changed"
    return (
        doc.Paragraph(f"The payload of each pose is chosen with it: {listed}. {changed}. See payload_kg in plan.csv."),
    )


@doc.guarded
def _files(result: DesignResult) -> tuple[doc.Block, ...]:
    chain = result.problem.robot.chain
    why = refusal(chain, result.options.controller)
    files = plan_or_refusal(chain, result.options.controller, result.problem.robot.model.stations).values()
    programs = "".join(f", {file} for the controller" for file in files if file.startswith((f"{PLAN}.", f"{PLAN}_")))
    return (
        doc.Paragraph(
            f"Files: plan.csv with every waypoint, measured or via{programs}.", shown_in=doc.PAGE | doc.TERMINAL
        ),
        *((doc.Paragraph(sentence(why), shown_in=doc.PAGE | doc.TERMINAL),) if why else ()),
    )


def _certificate(values: dict[str, Any]) -> str:
    return (
        f"The certified D-efficiency is {values['d_efficiency']:.3f}, against {values['pool']['what']} "
        f"(gap of the bound {100 * values['bound_gap']:.2f} %)."
    )


@doc.guarded
def _own_certificate(values: dict[str, Any]) -> tuple[doc.Block, ...]:
    """The certificate of the criterion itself."""
    certificate = values["certificate"]
    if certificate is None:
        return ()
    less = 100 * (1 - certificate["efficiency"] ** _ERROR_POWER.get(certificate["criterion"], 1.0))
    quantity = {"A": "RMS parameter error", "G": "worst predicted RMS error", "I": "predicted RMS error"}
    least = (
        f"no choice has a {quantity[certificate['criterion']]} more than {less:.1f} % smaller"
        if certificate["criterion"] in quantity
        else "1 would be the best possible"
    )
    text = (
        f"By the criterion {certificate['criterion']} itself, the certified efficiency is "
        f"{certificate['efficiency']:.3f}: "
        f"{least} (gap of the bound {100 * certificate['bound_gap']:.2f} %)."
    )
    return (doc.Paragraph(text),)


@doc.guarded
def _indices(values: dict[str, Any]) -> tuple[doc.Block, ...]:
    """The observability indices, with what they are scaled by; in one line where there is little room."""
    indices = values["indices"]
    line = ", ".join(
        f"{_INDICES[name].split(',')[0]} {_value(indices[name])}"
        for name in ("o1", "o2", "o3", "o4", "o5", "condition")
    )
    rows = tuple((_INDICES[name], _value(index), index["scaling"]) for name, index in indices.items())
    return (
        doc.Paragraph(f"{line} ({indices['o1']['scaling']}).", shown_in=doc.NARROW),
        doc.Table(("index", "value", "scaling"), rows, shown_in=doc.PAGE),
        doc.Paragraph("σ: the singular values of the scaled Jacobian of all poses.", "note", shown_in=doc.PAGE),
    )


def _value(index: dict[str, Any]) -> str:
    return "∞" if index["value"] is None else short(index["value"])


def check_document(result: PlanCheckResult) -> doc.Document:
    """Build the document of a plan check: the answer, the faults, and the session's duration."""
    count = len(result.faults)
    cell = f" in {result.options.cell}" if result.options.cell else ""
    badge = doc.Badge("the plan can be run", "good") if not count else doc.Badge("the plan cannot be run", "bad")
    text = (
        f" All {len(result.waypoints)} waypoints and the paths between them pass the check{cell}."
        if not count
        else f" {count} of {len(result.waypoints)} waypoints{cell}, or the paths to them, fail the check; plan anew."
    )
    rows = tuple((fault.waypoint, fault.why) for fault in result.faults)
    return doc.Document(
        f"{result.robot.name}: {badge.text}",
        (
            doc.Paragraph((badge, f".{text}"), "lead"),
            doc.Warnings(result.warnings),
            doc.Section("Faults", (doc.Table(("waypoint", "fault"), rows),)),
            doc.Section("Duration of the session", (doc.Paragraph(result.duration.description),)),
        ),
    )
