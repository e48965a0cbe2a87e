"""What a person should be told of a fit: outliers, weakly observable parameters, what was assumed or left out."""

from collections.abc import Callable, Sequence

import numpy as np

from lab.calibration.extrapolation import MeasuredRange
from lab.calibration.gauss_newton import Observations
from lab.calibration.identifiability import WEAK_CONDITION
from lab.calibration.identify import Identification
from lab.calibration.noise.search import NOTABLE
from lab.calibration.observation import observation_of
from lab.calibration.pose_cover import MOST_UNCOVERED
from lab.calibration.prior import Tolerance, prior_of
from lab.calibration.residual.process import PredictedBy
from lab.calibration.statistics.alternatives import Alternative
from lab.calibration.statistics.joint_lag import lagging
from lab.calibration.statistics.joint_rounding import by_joint_positions, counting, rounding
from lab.calibration.statistics.model_selection import Selection
from lab.calibration.statistics.outliers import Outliers, would_matter
from lab.calibration.verdict import Verdict
from lab.campaign.robot import Robot
from lab.commands.calibrate.advice import changes
from lab.commands.calibrate.fit_result import Named
from lab.commands.calibrate.model_words import listed
from lab.commands.calibrate.range_dict import said_of_extrapolated
from lab.core.measurements import Measurements, evenly, seen_mask
from lab.core.se3 import Array
from lab.core.significance import MODEL_GROUPS
from lab.core.wording import be, counted
from lab.kinematics.dynamics.link_loads import link_ends
from lab.kinematics.effects.conditions import approach_of
from lab.kinematics.effects.effect import SessionInfo
from lab.kinematics.effects.stations import at_first_station
from lab.kinematics.encoders import Encoders
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import targets_of
from lab.kinematics.serial.chain import Chain
from lab.noise.instruments import Instrument, is_isotropic
from lab.sensors.fixtures import Fixtures

__all__ = [
    "of_approaches",
    "of_elsewhere",
    "of_excluded",
    "of_export",
    "of_groups",
    "of_held_out",
    "of_instrument",
    "of_joints",
    "of_limits",
    "of_nominal",
    "of_outliers",
    "of_prior",
    "of_residual",
    "of_several_sessions",
    "of_size",
    "of_stuck_search",
    "of_twist",
    "of_validation_beyond",
    "of_weakness",
]

_WORTH = 0.8  # of the condition: a change that leaves more brings nothing
_STRANGE = 0.05  # m or rad from the nominal value
_SURPRISING = 5.0  # standard deviations of the prior
_BEYOND = 0.02  # rad or m: a pose that is nearer to the measured range is at its edge
_MOST_POSES = 20_000  # by which joint positions are looked at
_MUCH_WORSE = 2.0  # times the predicted error where poses were measured
_UNEVEN = 10.0  # times as precise along one direction as along another
_RELEVANT = 0.5  # of sigma: what a lag makes of the observations, root mean square


def of_outliers(found: Identification, seen: Observations, outliers: Outliers, model: str) -> list[str]:
    """That outliers are kept in the fit, and what it would change to exclude them.

    Before poses are blamed, the arm may be: where effects were not searched, that is said first.
    """
    if not len(outliers.rows):
        return []
    moved = would_matter(found.model, seen, found.values, outliers.fit.values)
    several = len(outliers.rows) > 1
    first = "" if model == "auto" else "--model auto tries first whether effects of the arm explain them; " * several
    count = f"{len(outliers.rows)} poses are outliers" if several else "1 pose is an outlier"
    return [
        f"{count}, with a residual of {'up to ' if several else ''}{1e3 * outliers.sizes_m[0]:.3g} mm, kept in the "
        f"fit: {first}--robust would exclude {'them' if several else 'it'}, and move the predicted points by "
        f"{1e3 * moved:.2g} mm"
    ]


def of_held_out(off: tuple[Named, ...]) -> list[str]:
    """That some of the poses that are off are of the hold-out set."""
    count = sum(pose.held_out for pose in off)
    return [f"{counted(count, 'pose')} of the hold-out set {be(count)} off: the error is with them"] if count else []


def of_excluded(off: Sequence[Named]) -> list[str]:
    """That the verdict is without the few outliers that --robust excludes, each with its size."""
    sizes = [1e3 * pose.size_m for pose in off]
    named = [f"pose {pose.id} ({size:,.0f} mm)" if size >= 100 else f"pose {pose.id} ({size:.3g} mm)"
             for pose, size in zip(off, sizes, strict=True)]  # fmt: skip
    return [f"--robust excludes {counted(len(off), 'outlier')} from fit and verdict: {', '.join(named)}"]


def of_validation_beyond(found: Identification, measured: MeasuredRange | None, rows: Measurements | None) -> list[str]:
    """That validation poses are where nothing was measured, and the model knows less."""
    if measured is None or rows is None or not (measured.is_worse_beyond or found.process is not None):
        return []
    lone = np.flatnonzero(measured.uncovered(rows.joints))
    said = said_of_extrapolated("validation poses", [rows.ids[i] for i in lone], len(rows))
    outside = np.flatnonzero(measured.beyond(rows.joints).max(axis=1) > _BEYOND)
    if not (len(outside) and measured.slope.any()):
        return said
    part = rows.take(outside)
    unknown = measured.unknown(found.model, part.inputs(found.model.conditions), found.values)
    size = float(np.sqrt((unknown**2).sum(axis=(2, 3))).max())
    return [
        *said,
        f"{len(outside)} of {counted(len(rows), 'validation pose')} {be(len(outside))} beyond the fitted joint "
        f"positions ({part.ids[0]} the first): there the model may be off by up to {1e3 * size:.2g} mm more "
        "(1σ), as the edges of the measured range say",
    ]


def of_elsewhere(judged: Verdict) -> list[str]:
    """Warn that most of the workspace is extrapolated, and is predicted much worse than where poses were measured."""
    region, elsewhere = judged.region, judged.elsewhere
    if elsewhere is None or region.kind != "measured" or elsewhere.extrapolated_share <= MOST_UNCOVERED:
        return []
    if not elsewhere.p95_m > _MUCH_WORSE * region.p95_m:
        return []
    return [
        f"{100 * elsewhere.extrapolated_share:.0f} % of the workspace is extrapolated: the verdict holds where poses "
        f"were measured (95 % error {1e3 * region.p95_m:.3g} mm), elsewhere {1e3 * elsewhere.p95_m:.3g} mm is "
        "predicted; --region names where the task is"
    ]


def of_residual(found: Identification) -> list[str]:
    """What the joints' offsets that no group explains say of the arm."""
    assert isinstance(found.process, PredictedBy)
    process = found.process.process
    said = []
    if process.p >= MODEL_GROUPS:
        said.append(
            f"residual: nothing in these measurements shows offsets of the joints (p = {process.p:.2g}); "
            "leave the group out"
        )
    if len(process.inputs) < len(found.residuals):
        said.append(
            f"residual: of {len(found.residuals)} poses {len(process.inputs)}, evenly spaced, say the joints' offsets"
        )
    return said


def of_instrument(device: Instrument | None, points: Array) -> list[str]:
    """Warn of a file whose instrument is so much better in one direction that a nest's errors would dominate there.

    Args:
        device: as the noise of the fit was stated; None where it was not.
        points: ``(n, k, 3)`` m in its frame, NaN where none was seen.
    """
    if device is None or not device.source or device.errors.nest.standard or device.errors.lock_on.standard:
        return []
    seen = points[np.isfinite(points).all(axis=-1)]
    if is_isotropic(device) or not len(seen):
        return []
    best, _, worst = np.sqrt(np.median(np.linalg.eigvalsh(device.covariance(seen)), axis=0)).tolist()
    if worst <= _UNEVEN * best:
        return []
    return [
        f"{device.source} states {1e6 * best:.2g} µm in one direction and {1e6 * worst:.2g} µm in another, so errors "
        "of the reflector's nest weigh too much: state nest_um and lock_on_um in [systematic]"
    ]


def of_stuck_search(outliers: Outliers) -> list[str]:
    """That the fit of the poses that are no outliers did not converge."""
    if outliers.fit.status == "converged":
        return []
    return [
        f"the fit without outliers did not converge in {outliers.fit.iterations} steps: which poses are off is not "
        "sure; --prior on helps where the measurements say too little"
    ]


def of_weakness(
    robot: Robot,
    targets: tuple[str, ...],
    groups: tuple[str, ...],
    found: Identification,
    inputs: Array,
    course: SessionInfo,
) -> list[str]:
    """That parameters are weakly observable, and what would change that."""
    if found.fit.condition <= WEAK_CONDITION or found.unobservable or "sessions" in groups:
        return []
    wanted = changes(robot, targets, groups, found.values, inputs, course)[0]
    if wanted.condition > _WORTH * found.fit.condition:
        return []
    return [
        f"some parameters are weakly observable (weak_directions in result.json): with {wanted.words} the "
        f"same poses would have a condition number of {wanted.condition:.0f} instead of {found.fit.condition:.0f}"
    ]


def of_prior(found: Identification, nominal: Array, tolerance: Tolerance) -> list[str]:
    """That the tolerances hold back what the measurements say."""
    prior = prior_of(found.model, found.base_set, nominal, tolerance)
    off = np.abs(prior.surprise(found.values))
    if not len(off) or off.max() <= _SURPRISING:
        return []
    name = found.model.names[prior.of[int(off.argmax())]]
    return [
        f"{name} is {off.max():.0f} tolerances from its nominal value: --prior on holds it back; give larger "
        "--tolerance-mm and --tolerance-mrad, or --prior auto"
    ]


def of_nominal(found: Identification, nominal: Array) -> list[str]:
    """That the estimate is far from the nominal value, and surely so: the model may be another robot's."""
    parameters, free = found.model.parameters, list(found.fit.free)
    off = np.abs(found.values - nominal)[free]
    sure = np.array([parameters[i].is_link for i in free]) & (off > _STRANGE) & (off > _SURPRISING * found.std)
    if not sure.any():
        return []
    worst = parameters[free[int(np.argmax(np.where(sure, off, 0.0)))]]
    size = float(np.max(off[sure]))
    far = f"{np.rad2deg(size):.3g}°" if worst.is_angle else f"{1e3 * size:.3g} mm"
    return [f"{worst.name} is estimated {far} from its nominal value: is the nominal model that of this robot?"]


def of_size(found: Identification) -> list[str]:
    """That contacts tell the arm's shape, but not its size: one length stays nominal, and all go with it."""
    model = found.model
    if not isinstance(model, Fixtures) or not model.contact or model.scale_link in found.base_set.kept:
        return []
    return [
        f"contacts do not tell the arm's size: {model.names[model.scale_link]} stays nominal, and all lengths are in "
        "proportion to it; a known distance between sockets (--socket-distance-mm) or a length of cable tells it"
    ]


def of_joints(
    found: Identification,
    seen: Observations,
    rows: Measurements,
    moves: Array,
    encoders: Encoders | None,
    omitted: Callable[[Measurements], Sequence[Array]],
) -> list[str]:
    """Joint positions that are rounded, or that do not follow the arm.

    Args:
        omitted: derivatives of what rows observe by the parameters of each group that the model lacks.
        moves: ``(n, joints)`` from the pose measured before each row, whether that was fitted or not.
        encoders: those of the robot's table; None where it names none.
    """
    if (some := evenly(len(rows), _MOST_POSES)) is not None:  # very many say no more
        seen, rows, moves = seen.take(some), rows.take(some), moves[some]
    model, said = found.model, []
    if encoders is not None:
        made_m = counting(model, rows, found.values, encoders, observation_of(model).positions or None)
        if made_m > NOTABLE * found.sigma_m:
            said.append(
                f"whole counts of the encoders alone make errors of {1e3 * made_m:.3g} mm (RMS); more poses average "
                "them, more readings do not"
            )
    elif (coarse := rounding(model, rows, found.values, observation_of(model).positions or None)) is not None:
        said.append(
            f"joint positions are rounded to {np.rad2deg(coarse.step_rad):g}°, which alone makes errors of "
            f"{1e3 * coarse.rms_m:.3g} mm (RMS)"
        )
    derivative = by_joint_positions(model, seen.inputs, found.values, moves.shape[1])
    for lag in lagging(model, seen, found.fit, moves, derivative, rows.sessions, lambda: omitted(rows)):
        here = np.array([session == lag.session for session in rows.sessions])
        made = (derivative @ (moves * np.where(lag.significant, lag.fractions, 0.0))[:, None, :, None])[..., 0]
        if np.sqrt(np.mean(made[here][seen_mask(seen.points)[here]] ** 2)) < _RELEVANT * found.sigma_m:
            continue
        behind = lag.fractions[lag.significant].sum() > 0
        shares = ", ".join(
            f"{name} {abs(share):.2g}"
            for name, share, sure in zip(rows.joint_names, lag.fractions, lag.significant, strict=True)
            if sure
        )
        where = f"session {lag.session}: " if lag.session else ""
        which = "they lag behind it" if behind else "it lags behind them"
        said.append(
            f"{where}the recorded joint positions do not follow the arm: {which} by shares of the last move "
            f"of {shares} (F test, p = {lag.p:.1g}); read the joints when the arm has settled"
        )
    return said


def of_groups(groups: tuple[str, ...], selection: Selection | None, data: Measurements) -> list[str]:
    """What was assumed of the payload, and which groups were not tried because a column of the file has gaps."""
    said = []
    if {"compliance", "payload", "bending", "torsion", "tubes"} & set(groups) and "payload_kg" not in data.conditions:
        said.append("no column payload_kg: the flange is assumed to carry nothing in any pose")
    if selection is not None:
        said += [
            f"{group.name} is not tried: {group.infeasibility_reason}"
            for group in selection.groups
            if group.incomplete_data
        ]
        said += [_told_apart(each, selection.identification, data) for each in selection.alternatives]
    return said


def of_approaches(chain: JointSpec, data: Measurements, *, searched: bool) -> list[str]:
    """Name the joints for which backlash is fitted or tested, where the file has approach columns of some alone.

    Args:
        searched: whether groups are searched for, or were given.
    """
    columns = {name: approach_of(name) for name in chain.joint_names}
    known = [name for name, column in columns.items() if column in data.conditions]
    missing = [column for name, column in columns.items() if name not in known]
    if not (known and missing):
        return []
    of, are = ("joint" if len(known) == 1 else "joints"), be(len(missing))
    return [
        f"backlash is {'tested' if searched else 'fitted'} for {of} {', '.join(known)} only: "
        f"{'column' if len(missing) == 1 else 'columns'} {', '.join(missing)} {are} missing"
    ]


def of_twist(robot: Robot, found: Identification) -> list[str]:
    """Twists of links along their own joint's axis, which no pose and no load tells from that joint's compliance."""
    chain, free = robot.chain, {found.model.names[i] for i in found.fit.free}
    if not isinstance(chain, Chain):
        return []
    along = [link + 1 for link, end in enumerate(link_ends(chain)) if not end[:2].any()]
    return [
        f"link{link}.gj, the twist of a link along its own joint's axis, is the compliance of joint {link} as well: no "
        "pose and no payload tells them apart"
        for link in along
        if f"link{link}.gj" in free
    ]


def _told_apart(each: Alternative, found: Identification, data: Measurements) -> str:
    """One explanation of two, and what would tell."""
    said = (
        f"{each.chosen} and {each.other} cannot be told apart by these poses (with {each.other} instead chi2 changes "
        f"by {each.fit_rise:+.1f}): one is as good an explanation as the other; "
    )
    if not each.can_be_told:
        return said + f"no pose and payload would tell: they differ by at most {1e3 * each.differ_m:.2g} mm"
    joints = ", ".join(f"{value:.3g}" for value in each.inputs[: data.joints.shape[1]])
    payload = dict(zip(found.model.conditions, each.inputs[data.joints.shape[1] :], strict=True)).get("payload_kg", 0.0)
    return said + (
        f"measure near joints {joints} (rad, m) with {payload:.3g} kg: there they differ by "
        f"{1e3 * each.differ_m:.2g} mm"
    )


def of_export(robot: Robot, found: Identification, groups: tuple[str, ...], inputs: Array) -> list[str]:
    """By how much geometry alone is off, which is all that an MJCF or a table holds."""
    positions = observation_of(found.model).positions
    if not groups or not positions:
        return []
    targets = targets_of(found.model.parameters)
    rigid = robot.arm(targets)
    inputs = at_first_station(found.model.conditions, inputs)
    whole = found.model.points(inputs, found.values)[:, :positions]
    alone = rigid.points(inputs[:, : robot.chain.size], found.values[: len(rigid.names)])
    off = np.sqrt(((whole - alone) ** 2).sum(axis=2).mean())
    file = robot.kept_file
    lacking = ", ".join(listed(groups))
    return [f"{file} holds geometry alone: without {lacking} it is off by {1e3 * off:.2g} mm at these poses"]


def of_several_sessions(rows: Measurements) -> list[str]:
    """That sessions are taken for one setup."""
    sessions = list(dict.fromkeys(rows.sessions))
    if len(sessions) < 2:
        return []
    return [
        f"sessions {', '.join(sessions)} are fitted with one base and one tool: --model sessions if the tracker or the "
        "arm was bumped between them; fit each alone if one was set up anew"
    ]


def of_limits(robot: Robot, data: Measurements) -> list[str]:
    """That poses are beyond the joints' limits."""
    outside = robot.chain.beyond_limits(data.joints, 1e-3)
    return [
        f"joint {name}: {int(count)} of {counted(len(data), 'pose')} {be(int(count))} beyond its limits; "
        "check units, signs and offsets"
        for name, count in zip(robot.chain.joint_names, outside.sum(axis=0), strict=True)
        if count
    ]
