"""Draw candidate poses: within limits, free of collisions, every requested target visible; assign stations to poses.

All checks use the nominal model, with the tracker at its nominal pose. A target is visible if the
instrument admits its range, its elevation and the angle at which the beam meets the reflector (whose
axis is the site's z), and if a ray from the tracker's head reaches it. The tracker's own body stops no
ray; every other visible geom does, so the collision shapes, a little larger than the shells, count too.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.measurements import STATION, Measurements
from lab.core.progress import Progress, no_progress
from lab.core.random import ScrambledSobol
from lab.core.se3 import Array
from lab.noise.instruments import FieldOfView, Instrument
from lab.simulation.collisions import LOWER_CLEARANCE, collision_flags, keeps_clearances, kinematics_at, most_frequent
from lab.simulation.robot_model import RobotModel

__all__ = [
    "LARGE_REFLECTOR_M",
    "MARGIN",
    "SMALL_REFLECTOR_M",
    "Candidates",
    "draw_candidates",
    "feasibility",
    "field_of_view",
    "incidence",
    "refuse_idle_stations",
    "refuse_unknown_targets",
    "seeing_station",
    "station_columns",
    "stations_in",
    "view_of",
]

MARGIN = 0.05  # of a joint's range, kept from each limit
_Feasible = Callable[[Array], NDArray[np.bool_]]
_REASONS = ("limits", "singularity", "collision", "visibility")
_BLOCK = 1024  # a power of two keeps Sobol's points even
_PATIENCE, _MIN_SHARE = 16 * _BLOCK, 1 / 200  # draws without any candidate; least share of candidates
SMALL_REFLECTOR_M, LARGE_REFLECTOR_M = 0.00635, 0.01905  # radius of a half-inch and of a 1.5-inch one
_RIM_M = 0.001
_MIN_SEEN = 1 / 2000  # least share of candidates where few poses are in sight
_MAX_DESCRIBED = 500  # colliding draws whose contacts a refusal counts
_SAME_NOISE = 6  # decimals to which variances are compared


@dataclass(frozen=True)
class Candidates:
    """Feasible poses, and counts of the rejected ones.

    Attributes:
        joints: ``(m, n)`` joint positions, rad or m.
        drawn: quasi-random draws over the full limits, up to the last candidate.
        rejected: draws by the first reason against them: ``limits`` (in the margin), ``singularity`` (loops that do
            not close, or are near another mode), ``collision``, ``visibility``; with the m candidates their sum is
            ``drawn``.
    """

    joints: Array
    drawn: int
    rejected: dict[str, int]


def draw_candidates(
    robot: RobotModel,
    targets: Sequence[str],
    instrument: Instrument,
    count: int,
    rng: np.random.Generator,
    progress: Progress = no_progress,
    sees: _Feasible | None = None,
) -> Candidates:
    """Draw ``count`` feasible poses from a scrambled Sobol sequence over the joints' limits.

    The same generator state gives the same poses, and asking for more keeps the first ones.

    Args:
        progress: called with the number found.
        sees: test of joint positions ``(n, joints)`` in place of the instrument's view, which few poses pass: it
            comes before that of collisions.

    Raises:
        LabError: a target is unknown, the tracker stands in the arm, or hardly any pose is feasible.
    """
    if count < 1:
        raise LabError(f"{count} candidate poses: ask for 1 or more")
    if sees is None:
        nearest = seeing_station(robot, targets, instrument)
        first_reason = _judge(robot, lambda joints: nearest(joints) >= 0)
        for station in range(len(robot.station_sites)):
            _refuse_station_in_arm(robot, station)
    else:
        first_reason = _judge(robot, sees, seen_first=True)
    sobol = ScrambledSobol(robot.chain.size, rng)
    draws, reasons = np.empty((0, robot.chain.size)), np.empty(0, dtype=int)
    while (accepted := int(np.count_nonzero(reasons < 0))) < count:
        progress(accepted, count)
        if sees is None:
            _refuse_hopeless(robot, targets, draws, reasons, count)
        else:
            _refuse_unseen(robot, reasons, count)
        block = robot.chain.lower + sobol.points(_BLOCK) * (robot.chain.upper - robot.chain.lower)
        draws, reasons = np.concatenate([draws, block]), np.concatenate([reasons, first_reason(block)])
    drawn = int(np.flatnonzero(reasons < 0)[count - 1]) + 1
    draws, reasons = draws[:drawn], reasons[:drawn]
    return Candidates(draws[reasons < 0], drawn, _counted(reasons))


def feasibility(robot: RobotModel, targets: Sequence[str], instrument: Instrument, station: int = 0) -> _Feasible:
    """Return a test of joint positions ``(n, joints)``: off the limits, without contact, every target visible.

    The test is quick to repeat, by one thread.

    Args:
        station: of the instrument, from 0, that measures the targets.
    """
    first_reason = _judge(robot, field_of_view(robot, targets, instrument, station))
    return lambda joints: first_reason(joints) < 0


def _judge(robot: RobotModel, sees: _Feasible, *, seen_first: bool = False) -> Callable[[Array], NDArray[np.int_]]:
    """Return a function of joint positions ``(n, joints)``: the first of ``_REASONS`` against each, -1 for none.

    Args:
        seen_first: whether visibility comes before collisions.
    """
    data = mujoco.MjData(robot.model)
    chain = robot.chain
    keep_off = MARGIN * (chain.upper - chain.lower)

    def touching(joints: Array) -> NDArray[np.bool_]:
        return np.fromiter(collision_flags(robot, joints, data), bool, len(joints))

    def first_reason(joints: Array) -> NDArray[np.int_]:
        reasons = np.where(chain.beyond_limits(joints, -keep_off).any(axis=1), 0, -1)
        left = np.flatnonzero(reasons < 0)
        reasons[left[~chain.is_assemblable(joints[left], well=True)]] = 1
        for reason in (3, 2) if seen_first else (2, 3):
            left = np.flatnonzero(reasons < 0)
            against = ~sees(joints[left]) if reason == 3 else touching(joints[left])
            reasons[left[against]] = reason
        return reasons

    return first_reason


def seeing_station(
    robot: RobotModel, targets: Sequence[str], instrument: Instrument
) -> Callable[[Array], NDArray[np.int_]]:
    """Return a function of joint positions ``(n, joints)``: the station, from 0, with the best view; -1 for none.

    The best of the stations that see every target has the least noise; at equal noise, the smallest incidence angle.

    Raises:
        LabError: the robot has no such target.
    """
    sees = [field_of_view(robot, targets, instrument, station) for station in range(len(robot.station_sites))]
    if len(sees) == 1:
        return lambda joints: sees[0](joints).astype(np.int_) - 1

    def best(joints: Array) -> NDArray[np.int_]:
        if not len(joints):
            return np.empty(0, dtype=np.int_)
        seen = np.stack([each(joints) for each in sees], axis=1)
        noise, angle = _noise_and_angle(robot, targets, instrument, joints)
        worse = np.round(noise / noise.min(axis=1, keepdims=True), _SAME_NOISE) + 10.0 ** -(_SAME_NOISE + 1) * angle
        station: NDArray[np.int_] = np.where(seen.any(axis=1), np.where(seen, worse, np.inf).argmin(axis=1), -1)
        return station

    return best


def _noise_and_angle(
    robot: RobotModel, targets: Sequence[str], instrument: Instrument, joints: Array
) -> tuple[Array, Array]:
    """Return per station ``(n, s)`` the targets' variance (m^2; one without noise), and the incidence angle (rad)."""
    sites, Ts_world_station = [robot.model.site(name).id for name in targets], robot.Ts_world_station
    points = np.stack([stand.site_xpos[sites] for stand in kinematics_at(robot, joints)])
    noise = np.ones((len(joints), len(Ts_world_station)))
    angle = np.empty_like(noise)
    for i, T in enumerate(Ts_world_station):
        if instrument.kind != "exact":
            seen = se3.transform(se3.inverse(T), points.reshape(-1, 3)).reshape(points.shape)
            noise[:, i] = np.trace(instrument.covariance(seen), axis1=2, axis2=3).sum(axis=1)
        angle[:, i] = incidence(robot, targets, joints, np.full(len(joints), i)).max(axis=1)
    return noise, angle


def refuse_unknown_targets(robot: RobotModel, targets: Sequence[str]) -> None:
    """Refuse targets that the robot does not have, with a LabError."""
    for target in targets:
        if target not in robot.tool:
            raise LabError(f"target '{target}' is unknown: robot {robot.chain.name} has {', '.join(robot.tool)}")


def field_of_view(robot: RobotModel, targets: Sequence[str], instrument: Instrument, station: int = 0) -> _Feasible:
    """Return a test of joint positions ``(n, joints)``: whether the tracker sees every target.

    Args:
        station: of the tracker, from 0.

    Raises:
        LabError: the robot has no such target.
    """
    refuse_unknown_targets(robot, targets)
    model, data = robot.model, mujoco.MjData(robot.model)
    sites = [model.site(name).id for name in targets]
    ball = np.clip(model.site_size[sites, 0], SMALL_REFLECTOR_M, LARGE_REFLECTOR_M) + _RIM_M
    T_world_tracker = robot.Ts_world_station[station]
    head, turn = T_world_tracker[:3, 3].copy(), T_world_tracker[:3, :3]
    view = view_of(robot, instrument)
    own = _tracker_body(robot, station) or -1  # a tracker fixed in the world leaves nothing out

    def reached(stand: mujoco.MjData) -> bool:
        for site, radius in zip(sites, ball, strict=True):
            line = stand.site_xpos[site] - head
            reached_share = mujoco.mj_ray(model, stand, head, line, None, True, own, None)
            if 0 <= reached_share < 1 - radius / np.linalg.norm(line):
                return False
        return True

    def sees(joints: Array) -> NDArray[np.bool_]:
        points, axes = np.empty((2, len(joints), len(sites), 3))
        for i, stand in enumerate(kinematics_at(robot, joints, data)):
            points[i], axes[i] = stand.site_xpos[sites], stand.site_xmat[sites, 2::3]
        admitted = view.admits((points - head) @ turn, axes @ turn)
        visible: NDArray[np.bool_] = np.all(admitted, axis=1)
        rays = (reached(stand) for stand in kinematics_at(robot, joints[visible], data))
        visible[visible] = np.fromiter(rays, bool, int(visible.sum()))
        return visible

    return sees


def incidence(
    robot: RobotModel, targets: Sequence[str], joints: Array, station: NDArray[np.int_] | None = None
) -> Array:
    """Return angles ``(n, k)`` (rad) from each reflector's axis to the line to the head, at ``joints`` ``(n, joints)``.

    Args:
        targets: of the robot's model.
        station: ``(n,)`` that measures each pose, from 0; the first for all, if not given.
    """
    sites, heads = [robot.model.site(name).id for name in targets], robot.Ts_world_station[:, :3, 3]
    at = np.zeros(len(joints), dtype=np.int_) if station is None else station
    cosines = np.empty((len(joints), len(sites)))
    for i, stand in enumerate(kinematics_at(robot, joints)):
        line = heads[at[i]] - stand.site_xpos[sites]
        cosines[i] = np.sum(line * stand.site_xmat[sites, 2::3], axis=1) / np.linalg.norm(line, axis=1)
    return np.arccos(np.clip(cosines, -1, 1))


def view_of(robot: RobotModel, instrument: Instrument) -> FieldOfView:
    """Return the view of the robot's reflectors: their acceptance if a cell gives it, else the instrument's."""
    if robot.acceptance_rad is None:
        return instrument.field_of_view
    return replace(instrument.field_of_view, acceptance_rad=robot.acceptance_rad)


def _tracker_body(robot: RobotModel, station: int = 0) -> int:
    return int(robot.model.site(robot.station_sites[station]).bodyid[0])


def _refuse_station_in_arm(robot: RobotModel, station: int) -> None:
    """Refuse a tracker whose stand or head is in the arm in more than half of the poses."""
    body, head = _tracker_body(robot, station), robot.Ts_world_station[station, :3, 3].copy()
    share = _share_of_hits(robot, body, head)
    if share > 0.5 or _touches_base(robot, body):
        where = "in its base" if share <= 0.5 else f"in the way in {share:.0%} of its poses"
        place = ", ".join(f"{x:.3g}" for x in head)
        mend = "move it away" if body else "move it away, or draw its shapes in a body of its own"
        named = f" at station '{robot.stations[station]}'" if robot.stations else ""
        raise LabError(f"{robot.path}: the tracker{named}, head at ({place}) m, stands inside the arm, {where}; {mend}")


def _share_of_hits(robot: RobotModel, body: int, head: Array) -> float:
    """Return the share of random poses in which the arm touches the tracker's body, or its head ``(3,)`` m is in it."""
    model, up = robot.model, np.array([0.0, 0.0, 1.0])
    joints, data = robot.chain.random_joints(256, np.random.default_rng(0)), mujoco.MjData(model)
    hits = 0
    for _ in collision_flags(robot, joints, data):
        touches = body > 0 and bool((model.geom_bodyid[data.contact.geom] == body).any())
        normal = np.zeros(3)  # outward: along the ray where it leaves a shape that it began in
        mujoco.mj_ray(model, data, head, up, None, True, body or -1, None, normal)
        hits += touches or bool(normal @ up > 0)
    return hits / len(joints)


def _touches_base(robot: RobotModel, body: int) -> bool:
    """Decide whether a body touches the base: MuJoCo reports no contact between two bodies fixed in the world."""
    model = robot.model
    if not (robot.base_body and body):
        return False
    data = next(kinematics_at(robot, robot.chain.home[None]))
    solid = (model.geom_contype | model.geom_conaffinity) != 0
    of = [np.flatnonzero(solid & (model.geom_bodyid == b)) for b in (body, model.body(robot.base_body).id)]
    return any(mujoco.mj_geomDistance(model, data, a, b, 0.01, None) < 0 for a in of[0] for b in of[1])


def _counted(reasons: NDArray[np.int_]) -> dict[str, int]:
    return {name: int(np.count_nonzero(reasons == i)) for i, name in enumerate(_REASONS)}


def _refuse_hopeless(
    robot: RobotModel, targets: Sequence[str], draws: Array, reasons: NDArray[np.int_], count: int
) -> None:
    drawn, have = len(reasons), int(np.count_nonzero(reasons < 0))
    if drawn < _PATIENCE or (have and drawn < count / _MIN_SHARE):
        return
    n = _counted(reasons)
    place = " or ".join("(" + ", ".join(f"{x:.3g}" for x in head) + ")" for head in robot.Ts_world_station[:, :3, 3])
    touching = draws[reasons == 2][:_MAX_DESCRIBED]
    pairs = f" (of {len(touching)} of them, {most_frequent(robot, touching)})" if len(touching) else ""
    mend = "move the tracker, turn the targets towards it, or ask for fewer targets"
    if 2 * n["collision"] > drawn:
        mend = "give these shapes room, or exclude their contact in the model"
        if keeps_clearances(robot.model):
            mend = f"{LOWER_CLEARANCE}, or {mend}"
    raise LabError(
        f"{robot.path}: {have or 'no'} feasible poses in {drawn} draws, {count} wanted: {n['limits']} too close to a "
        f"limit, {n['singularity']} to a parallel singularity, {n['collision']} collide{pairs}, in {n['visibility']} "
        f"the tracker at {place} m does not see {', '.join(targets)}; {mend}"
    )


def _refuse_unseen(robot: RobotModel, reasons: NDArray[np.int_], count: int) -> None:
    drawn, have = len(reasons), int(np.count_nonzero(reasons < 0))
    if drawn < _PATIENCE or (have and drawn < count / _MIN_SEEN):
        return
    n = _counted(reasons)
    raise LabError(
        f"{robot.path}: {have or 'no'} feasible poses in {drawn} draws, {count} wanted: in {n['visibility']} no "
        f"picture shows enough of a board, {n['collision']} of the others collide; place cameras and boards otherwise"
    )


def stations_in(path: Path, rows: Measurements, model: RobotModel) -> NDArray[np.int_]:
    """Return the station ``(n,)``, from 0, of each row of a plan.

    Args:
        path: of the plan, for errors.
        rows: of the plan.
        model: in its cell.

    Raises:
        LabError: a row of a cell with several stations names none of them.
    """
    if len(model.stations) < 2:
        return np.zeros(len(rows), dtype=np.int_)
    valid = {name: i for i, name in enumerate(model.stations)}
    for i, name in enumerate(rows.stations):
        if name not in valid:
            text = f"station '{name}' is none of the cell's" if name else "the station is missing"
            raise LabError(f"{path}: {rows.where(i)}: {text}; write one of {', '.join(valid)} into the column station")
    return np.array([valid[name] for name in rows.stations], dtype=np.int_)


def station_columns(model: RobotModel, stations: NDArray[np.int_]) -> dict[str, Array]:
    """Return the conditions ``(n,)`` of each pose's station, from 0; none for a single station."""
    return {STATION + name: (stations == k).astype(np.float64) for k, name in enumerate(model.stations) if k}


def refuse_idle_stations(model: RobotModel, stations: NDArray[np.int_], least: int) -> None:
    """Refuse an assignment of poses to stations ``(n,)`` that gives one fewer than ``least``.

    Raises:
        LabError: a station measures too few poses.
    """
    counts = np.bincount(stations, minlength=max(len(model.stations), 1))
    if len(model.stations) > 1 and counts.min() < least:
        raise LabError(
            f"{model.path}: station '{model.stations[int(counts.argmin())]}' measures {counts.min()} of "
            f"{len(stations)} poses, because others see the rest better, and needs {least} at least to be placed; "
            "leave it out, move it, or ask for more poses"
        )
