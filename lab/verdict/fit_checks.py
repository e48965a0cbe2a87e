"""Check a fit and its measurements: outliers, weak parameters, priors, joint positions, scales."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lab.calibration.fitter import MOST_CHOSEN_BY, NominalRobot
from lab.calibration.gauss_newton import Observations
from lab.calibration.identifiability import WEAK_CONDITION, condition_of
from lab.calibration.identification import Identification
from lab.calibration.noise_search import NOTABLE
from lab.calibration.observation import UnsizedObservation, observation_of, only_positions
from lab.calibration.prior import Tolerance, prior_of
from lab.calibration.residual.gaussian_process import PredictedBy
from lab.calibration.sensor import ArmSensor
from lab.calibration.statistics.joint_rounding import counting, rounding
from lab.calibration.statistics.model_selection import Selection
from lab.calibration.statistics.outliers import Outliers, would_matter
from lab.core.checks import Check
from lab.core.errors import LabError, option_name
from lab.core.measurements import Measurements, evenly
from lab.core.se3 import Array
from lab.core.significance import MODEL_GROUPS
from lab.core.units import MM
from lab.kinematics.dynamics.gravity import link_ends
from lab.kinematics.effects.effect import NO_SESSIONS, SessionInfo, approach_of
from lab.kinematics.effects.sessions import at_first_station
from lab.kinematics.joints import Encoders, JointSpec
from lab.kinematics.parameter import SIZE, targets_of
from lab.kinematics.serial.chain import Chain
from lab.noise.instruments import Instrument, is_isotropic
from lab.prediction.extrapolation import MOST_UNCOVERED, MeasuredRange
from lab.prediction.validation import Validation
from lab.verdict.fitted import Fitted, Named, one_each
from lab.verdict.verdict import Answer, Verdict

__all__ = [
    "FIT_CHECKS",
    "changes",
    "check_alternatives",
    "check_approaches",
    "check_excluded",
    "check_extrapolated",
    "check_geometry_alone",
    "check_groups",
    "check_held_out",
    "check_improvement",
    "check_instrument",
    "check_joints",
    "check_limits",
    "check_outlier_search",
    "check_outliers",
    "check_prior",
    "check_residual",
    "check_sessions",
    "check_setup",
    "check_size",
    "check_still",
    "check_twist",
    "check_validation_poses",
    "check_workspace",
    "doubted",
    "noise_beyond",
    "noise_in_another_unit",
    "note",
    "points_in_another_scale",
]

_OFFSET_M = 0.05  # by which a target is moved along x of its frame, and a second one stands from the first


@dataclass(frozen=True)
class _SetupSuggestion:
    """A change of what is measured, and the condition number that the same poses would then have."""

    change: str
    condition: float


def changes(
    robot: NominalRobot,
    sensor: ArmSensor,
    targets: tuple[str, ...],
    groups: tuple[str, ...],
    values: Array,
    inputs: Array,
    session: SessionInfo = NO_SESSIONS,
) -> tuple[_SetupSuggestion, ...]:
    """Return changes of the set-up with the condition number of each, the best first.

    Args:
        values: ``(p,)`` of the arm with these targets and groups, measured by points.
        inputs: where it is measured, ``(n, joints + conditions)``.
    """
    arm = robot.arm_with(targets, groups, session)
    known = dict(zip(arm.names, values, strict=True))
    moved = known | {
        name: value + _OFFSET_M for name, value in known.items() if name.endswith(".x") and "tool." in name
    }
    away = np.array([moved[name] for name in arm.names])
    another = f"{targets[0].rpartition('.')[0]}.another".removeprefix(".")  # on the same tip, where tips have names
    more = robot.arm_with((*targets, another), groups, session)
    first = [known[f"tool.{targets[0]}.{axis}"] for axis in "xyz"]
    second = dict(zip("xyz", np.array(first) + np.array([_OFFSET_M, _OFFSET_M, 0.0]), strict=True))
    both = known | {f"tool.{another}.{axis}": value for axis, value in second.items()}
    found = [
        _SetupSuggestion(
            f"the target {MM.text(_OFFSET_M, 6)} elsewhere on what carries it", condition_of(arm, away, inputs)
        ),
        _SetupSuggestion("a second target", condition_of(more, np.array([both[name] for name in more.names]), inputs)),
    ]
    if (posed := sensor.with_orientation(arm, targets[0])) is not None:
        seen = np.concatenate([inputs, np.broadcast_to([1.0, 0.0, 0.0, 0.0], (len(inputs), 4))], axis=1)
        found.append(
            _SetupSuggestion("orientations measured too", condition_of(posed.model, posed.nominal(values), seen))
        )
    return tuple(sorted(found, key=lambda change: change.condition))


_WORTH = 0.8  # of the condition: a change that leaves more brings nothing
_SURPRISING = 5.0  # standard deviations of the prior
_CORRECTED = 0.7  # of an artefact's stated uncertainty: below, the arm's tolerances determine more than the artefact
_STILL = 1e-4  # rad or m: a joint that moved less stood still
_BEYOND = 0.02  # rad or m: a pose that is nearer to the measured range is at its edge
_MOST_POSES = 20_000  # by which joint positions are looked at
_MUCH_WORSE = 2.0  # times the predicted error where poses were measured
_UNEVEN = 10.0  # times as precise along one direction as along another


def _noted(name: str, **data: Any) -> Check:
    return Check(name, "noted", data=data)


def _failed(name: str, statistic: float = float("nan"), level: float = float("nan"), **data: Any) -> Check:
    return Check(name, "failed", statistic, level=level, data=data)


def note(text: str) -> Check:
    """Return a note that is worded already: of a robot's description, of a measurement file."""
    return _noted("note", text=text)


def check_outliers(found: Identification, seen: Observations, outliers: Outliers, *, searched: bool) -> list[Check]:
    """Report outliers that are kept in the fit, and what it would change to exclude them.

    Args:
        searched: whether effects of the arm were searched, which may explain them.
    """
    if not len(outliers.rows):
        return []
    moved = would_matter(found.model, seen, found.values, outliers.fit.values)
    largest = float(outliers.sizes_m[0])
    single = int((outliers.wholes < 0).sum()) if len(outliers.wholes) else len(outliers.rows)
    pictures = len(np.unique(outliers.wholes[outliers.wholes >= 0]))
    data = {"count": single, "pictures": pictures, "in_pictures": bool(len(outliers.wholes))}
    return [_failed("outliers.kept", **data, largest_m=largest, moved_m=moved, searched=searched)]


def check_held_out(outliers: tuple[Named, ...]) -> list[Check]:
    """Count the outliers of the hold-out set."""
    held_out = one_each([pose for pose in outliers if pose.held_out])
    what = "picture" if any(pose.whole >= 0 for pose in held_out) else "pose"
    return [_failed("outliers.held_out", count=len(held_out), what=what)] if held_out else []


def check_excluded(outliers: Sequence[Named]) -> Check:
    """Note the outliers that are left out of the verdict, each with its size."""
    return _noted("outliers.excluded", sizes_m={pose.id: pose.size_m for pose in outliers})


def check_outlier_search(outliers: Outliers) -> list[Check]:
    """Check that the fit without outliers converged."""
    if outliers.fit.status == "converged":
        return []
    return [_failed("outliers.search", iterations=outliers.fit.iterations)]


def check_extrapolated(what: str, ids: Sequence[str], count: int) -> list[Check]:
    """Count the poses or targets that no fitted pose is near; nothing where there are none.

    Args:
        what: the plural of what they are.
    """
    return [_failed("extrapolated", what=what, extrapolated=len(ids), first=ids[0], count=count)] if len(ids) else []


def check_validation_poses(
    found: Identification, measured: MeasuredRange | None, rows: Measurements | None
) -> list[Check]:
    """Count the validation poses where nothing was measured, and where the prediction is less certain."""
    if measured is None or rows is None or not (measured.is_worse_beyond or found.process is not None):
        return []
    lone = np.flatnonzero(measured.uncovered(rows.joints))
    checks = check_extrapolated("validation poses", [rows.ids[i] for i in lone], len(rows))
    outside = np.flatnonzero(measured.beyond(rows.joints).max(axis=1) > _BEYOND)
    if not (len(outside) and measured.slope.any()):
        return checks
    part = rows[outside]
    unknown = measured.unknown(found.model, part.inputs(found.model.conditions), found.values)
    size_m = float(np.sqrt((unknown**2).sum(axis=(2, 3))).max())
    beyond = _failed("validation.beyond", outside=len(outside), count=len(rows), first=part.ids[0], size_m=size_m)
    return [*checks, beyond]


def check_workspace(judged: Verdict) -> list[Check]:
    """Check that most of the workspace is not extrapolated and predicted much worse than where poses were measured."""
    region, elsewhere = judged.region, judged.elsewhere
    if elsewhere is None or region.kind != "measured" or elsewhere.extrapolated_share <= MOST_UNCOVERED:
        return []
    if not elsewhere.p95_m > _MUCH_WORSE * region.p95_m:
        return []
    share = elsewhere.extrapolated_share
    return [_failed("workspace.extrapolated", share=share, measured_95_m=region.p95_m, elsewhere_95_m=elsewhere.p95_m)]


def check_residual(found: Identification) -> list[Check]:
    """Test whether the joints have offsets that no group explains, and note how many poses determine these."""
    assert isinstance(found.process, PredictedBy)
    process, checks = found.process.process, list[Check]()
    if process.p >= MODEL_GROUPS:
        checks.append(Check("residual.offsets", "failed", p=process.p, level=MODEL_GROUPS))
    if len(process.inputs) < len(found.residuals):
        checks.append(_noted("residual.thinned", count=len(found.residuals), used=len(process.inputs)))
    return checks


def check_instrument(device: Instrument | None, points: Array) -> list[Check]:
    """Check that an instrument file is not so uneven that a nest's errors would dominate in its best direction.

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
    return [_failed("instrument.uneven", worst / best, _UNEVEN, source=device.source, best_m=best, worst_m=worst)]


def check_setup(
    robot: NominalRobot,
    sensor: ArmSensor,
    targets: tuple[str, ...],
    groups: tuple[str, ...],
    found: Identification,
    inputs: Array,
    session: SessionInfo,
) -> list[Check]:
    """Check that no parameters are weakly observable that another set-up would observe."""
    condition = found.fit.condition
    if condition <= WEAK_CONDITION or found.unobservable or "sessions" in groups:
        return []
    wanted = changes(robot, sensor, targets, groups, found.values, inputs, session)[0]
    if wanted.condition > _WORTH * condition:
        return []
    return [_failed("weak.setup", condition, WEAK_CONDITION, change=wanted.change, condition_then=wanted.condition)]


def check_prior(found: Identification, nominal: Array, tolerance: Tolerance) -> list[Check]:
    """Check that the tolerances as a prior do not hold back a parameter that the measurements show far away."""
    prior = prior_of(found.model, found.base_set, nominal, tolerance)
    off = np.abs(prior.surprise(found.values))
    if not len(off) or off.max() <= _SURPRISING:
        return []
    name = found.model.names[prior.of[int(off.argmax())]]
    return [_failed("prior.strained", float(off.max()), _SURPRISING, parameter=name)]


def check_size(found: Identification) -> list[Check]:
    """Note where readings show the arm's shape, but not its size: one length stays nominal; and artefacts' sizes."""
    model, notes = found.model, list[Check]()
    if found.lacks_size and isinstance(model, UnsizedObservation):
        notes.append(_noted("size.nominal", parameter=model.names[model.scale_link]))
        return notes
    for i, std, half_width in zip(found.fit.free, found.std, found.half_width_95, strict=True):
        parameter = model.parameters[i]
        if parameter.group == SIZE and np.isfinite(parameter.scale):
            half, corrected = float(std * half_width), bool(std < _CORRECTED * parameter.scale)
            sizes = {"share": float(found.values[i]), "half_width_95": half, "stated": parameter.scale}
            notes.append(_noted("size.artefact", artefact=parameter.owner, corrected=corrected, **sizes))
    return notes


def check_joints(found: Identification, rows: Measurements, encoders: Encoders | None) -> list[Check]:
    """Check the error that counted or rounded joint positions make.

    Args:
        encoders: those of the robot's table; None where it names none.
    """
    if (some := evenly(len(rows), _MOST_POSES)) is not None:  # more change nothing
        rows = rows[some]
    model, positions = found.model, observation_of(found.model).positions or None
    if encoders is not None:
        made_m = counting(model, rows, found.values, encoders, positions)
        return [_noted("joints.counts", rms_m=made_m)] if made_m > NOTABLE * found.sigma_m else []
    if (coarse := rounding(model, rows, found.values, positions)) is not None:
        return [_failed("joints.rounded", step_rad=coarse.step_rad, rms_m=coarse.rms_m)]
    return []


def check_groups(groups: tuple[str, ...], selection: Selection | None, data: Measurements) -> list[Check]:
    """Note an assumed payload, groups that were not tried because a column has gaps, and equivalent groups."""
    checks = []
    if {"compliance", "payload", "bending", "torsion", "tubes"} & set(groups) and "payload_kg" not in data.conditions:
        checks.append(_noted("payload.assumed"))
    if selection is not None:
        checks += [
            _noted("group.incomplete", group=group.name, why=group.infeasibility_reason)
            for group in selection.groups
            if group.incomplete_data
        ]
        checks += check_alternatives(selection, data)
    return checks


def check_alternatives(selection: Selection, data: Measurements) -> list[Check]:
    """Report groups that these poses do not distinguish from a chosen one, and where they would differ."""
    conditions, size = selection.identification.model.conditions, data.joints.shape[1]
    return [
        Check(
            "group.alternative",
            "failed",
            each.fit_rise,
            data={
                "chosen": each.chosen,
                "other": each.other,
                "can_be_told": each.is_distinguishable,
                "differ_m": each.differ_m,
                "joints": each.inputs[:size],
                "payload_kg": dict(zip(conditions, each.inputs[size:], strict=True)).get("payload_kg", 0.0)
                if each.is_distinguishable
                else 0.0,
            },
        )
        for each in selection.alternatives
    ]


def check_approaches(chain: JointSpec, data: Measurements, *, searched: bool) -> list[Check]:
    """Note the joints for which backlash is fitted or tested, where the file has approach columns of some alone."""
    columns = {name: approach_of(name) for name in chain.joint_names}
    known = [name for name, column in columns.items() if column in data.conditions]
    missing = [column for name, column in columns.items() if name not in known]
    return [_noted("backlash.some", searched=searched, joints=known, missing=missing)] if known and missing else []


def check_twist(chain: JointSpec, found: Identification) -> list[Check]:
    """Report twists of links along their own joint's axis, which are confounded with that joint's compliance."""
    free = {found.model.names[i] for i in found.fit.free}
    if not isinstance(chain, Chain):
        return []
    along = [link + 1 for link, end in enumerate(link_ends(chain)) if not end[:2].any()]
    return [_noted("twist.confounded", link=link) for link in along if f"link{link}.gj" in free]


def check_geometry_alone(
    robot: NominalRobot, found: Identification, groups: tuple[str, ...], inputs: Array
) -> list[Check]:
    """Note by how much geometry alone is off, which is all that an MJCF or a table holds."""
    positions = observation_of(found.model).positions
    if not groups or not positions:
        return []
    targets = targets_of(found.model.parameters)
    rigid = robot.arm(targets)
    inputs = at_first_station(found.model.conditions, inputs)
    whole = found.model.points(inputs, found.values)[:, :positions]
    alone = rigid.points(inputs[:, : robot.chain.size], found.values[: len(rigid.names)])
    off = float(np.sqrt(((whole - alone) ** 2).sum(axis=2).mean()))
    return [_noted("export.geometry", file=robot.stored_file, groups=groups, off_m=off)]


def check_sessions(rows: Measurements) -> list[Check]:
    """Note sessions that are fitted with one base and one tool."""
    sessions = list(dict.fromkeys(rows.sessions))
    return [_noted("sessions.one_setup", sessions=sessions)] if len(sessions) > 1 else []


def check_limits(chain: JointSpec, data: Measurements) -> list[Check]:
    """Count the poses beyond each joint's limits."""
    outside = chain.beyond_limits(data.joints, 1e-3)
    return [
        _failed("joints.limits", joint=name, outside=int(count), count=len(data))
        for name, count in zip(chain.joint_names, outside.sum(axis=0), strict=True)
        if count
    ]


def check_improvement(validation: Validation) -> list[Check]:
    """Check that the mean error at the validation poses became smaller."""
    if validation.errors is None:
        return []
    before, after = (float(np.nanmean(errors)) for errors in (validation.errors.before, validation.errors.after))
    return [_failed("validation.improvement", before_m=before, after_m=after)] if after >= before else []


_LEAST_RESIDUAL_M = 1e-7  # below, residuals are rounding
_MIN_DOF = 10
_MANY = 10.0  # times the residuals' noise: what is given hides errors
_UNIT = 100.0  # times the residuals' noise that a given one may be: a unit is a thousand
_ANOTHER_INSTRUMENT = 500.0  # the same of an instrument that may be another one
_LINK_LENGTH = re.compile(r"link\d+\.(a|d)")
_LONG_M = 0.05  # links by which a scale is tested: of shorter ones tolerances are as large
_LEAST_LENGTHS = 3
_LEAST_SCALE = 0.005  # steel is so much longer at 400 K more
_MADE_M = 0.0015  # by which the longest link is to differ, too: three times what links are made to
_ALIKE = 0.1  # of the squares of what lengths differ by that a common scale may leave


def noise_in_another_unit(noise_mm: float | None, rows: Measurements, found: Identification) -> list[Check]:
    """Refuse a given noise far above the residuals of the fit, and check one that is many times as large.

    Args:
        noise_mm: the option; None where it was not given.

    Raises:
        LabError: it is; with the number that it would be in the right unit.
    """
    if found.dof < _MIN_DOF:
        return []
    return noise_beyond(noise_mm, rows, found.residual_sigma_m, "the residuals", _UNIT)


def noise_beyond(
    noise_mm: float | None, rows: Measurements, noise_m: float, whose: str, times: float = _ANOTHER_INSTRUMENT
) -> list[Check]:
    """Refuse a noise that is far more than plausible for the robot and its instrument.

    Args:
        noise_mm: the option; None where the rows give it.
        noise_m: standard deviation per axis of residuals with such an instrument.
        whose: the residuals' name in the message.

    Returns:
        The check of one that is so many times as much that it hides errors; nothing of others.

    Raises:
        LabError: it is; with the number that it would be in the right unit.
    """
    name, given_mm = option_name("noise_mm"), noise_mm
    if given_mm is None:
        name, known = "column sigma_mm", rows.sigma_m[np.isfinite(rows.sigma_m)]
        if known.size and known.max() > _UNIT * known.min():
            data = {"least_m": float(known.min()), "most_m": float(known.max())}
            return [Check("given.noises", "failed", data=data)]
        given_mm = MM.of(float(np.median(known))) if known.size else None
    if given_mm is None or noise_m <= _LEAST_RESIDUAL_M or MM.to_si(given_mm) <= _MANY * noise_m:
        return []
    ratio = MM.to_si(given_mm) / noise_m
    text = f"{name} {given_mm:g}: {whose} are those of a noise of {MM.text(noise_m, 2)}, {ratio:.0f} times less"
    if ratio > times:
        raise LabError(f"{text}; is it in µm? That would be {MM.to_si(given_mm):g} mm")
    figures = {"given_m": MM.to_si(given_mm), "known_m": noise_m}
    return [Check("given.noise", "failed", ratio, data={"in_column": noise_mm is None, "whose": whose, **figures})]


def points_in_another_scale(found: Identification) -> list[Check]:
    """Detect a wrong scale of the points: all long links longer, or shorter, by about one share, as no arm is made."""
    names, free = found.model.names, [i for i in found.fit.free if _LINK_LENGTH.fullmatch(found.model.names[i])]
    long = [i for i in free if abs(found.nominal_aligned[i]) >= _LONG_M]
    if len(long) < _LEAST_LENGTHS:
        return []
    nominal = found.nominal_aligned[long]
    more = found.values[long] - nominal
    scale = float(more @ nominal / (nominal @ nominal))
    if abs(scale) < max(_LEAST_SCALE, _MADE_M / np.abs(nominal).max()):
        return []
    if ((more - scale * nominal) ** 2).sum() > _ALIKE * (more @ more):
        return []
    return [Check("given.scale", "failed", data={"links": [names[i] for i in long], "scale": scale})]


def doubted(word: Verdict, checks: Sequence[Check]) -> Verdict:
    """Return the verdict where the given noise or scale is impossible: it is not good."""
    if not checks:
        return word
    doubtful = "doubtful" if word.word == "good" else word.word
    return replace(word, word=doubtful, fit=Answer("doubtful", (checks[0],)), reasons=(*word.reasons, *checks))


def _outlier_checks(state: Fitted) -> list[Check]:
    search = state.outlier_search
    return check_held_out(state.outliers) + ([] if search is None else check_outlier_search(search))


def _group_checks(state: Fitted) -> list[Check]:
    fitter, options = state.fitter, state.fitter.options
    checks = check_groups(state.groups, state.selection, fitter.data)
    if options.search or "backlash" in options.groups:
        checks += check_approaches(fitter.robot.chain, fitter.data, searched=options.search)
    return checks


def _search_checks(state: Fitted) -> list[Check]:
    """Note the groups that the validation could not answer, and a search on some of the rows alone."""
    fitter = state.fitter
    if not fitter.options.search:
        return []
    refused = {name: fitter.unanswerable(name) for name in fitter.approached(fitter.options.candidates)}
    checks = [_noted("group.not_in_validation", group=name, why=why) for name, why in refused.items() if why]
    if (count := len(state.given)) > MOST_CHOSEN_BY:
        checks.append(_noted("selection.thinned", used=MOST_CHOSEN_BY, count=count))
    return checks


def _value_checks(state: Fitted) -> list[Check]:
    fit, options, nominal = state.weighted, state.fitter.options, state.fitter.nominal(state.weighted.model)
    prior = check_prior(fit, nominal, options.tolerance) if options.prior == "on" else []
    return prior + check_size(fit)


def _point_checks(state: Fitted) -> list[Check]:
    """Check what is measured, and with what, where points are measured."""
    fitter, fit, inputs = state.fitter, state.weighted, state.observations.inputs
    if not only_positions(observation_of(fit.model)):
        return []
    setup = check_setup(fitter.robot, fitter.kind, fitter.targets, state.groups, fit, inputs, fitter.session)
    return check_instrument(fitter.noise.instrument, state.rows.points) + setup


def _joint_checks(state: Fitted) -> list[Check]:
    chain = state.fitter.robot.chain
    checks = check_joints(state.weighted, state.rows, chain.encoders) + check_twist(chain, state.weighted)
    return checks + check_still(state.given)


def check_still(rows: Measurements) -> list[Check]:
    """Name the joints that never moved: poses do not tell their errors from those of the links around them."""
    span = np.ptp(rows.joints, axis=0)
    still = [name for name, moved in zip(rows.joint_names, span, strict=True) if moved < _STILL]
    return [_noted("joints.still", joints=still)] if still and len(rows) > 1 else []


# What the step "check fit" of the pipeline tests, in this order: from the state of a fit to checks.
FIT_CHECKS: tuple[Callable[[Fitted], list[Check]], ...] = (
    _outlier_checks,
    _group_checks,
    _search_checks,
    _value_checks,
    _point_checks,
    _joint_checks,
)
