"""Identify a robot from measurements, by a list of named steps over one state.

``STEPS`` maps names to functions that take a ``Fitted`` and return it with more in it. A caller leaves a step out, puts
one of her own under its name, or runs a part of them and looks at the state::

    lab.identify(data, steps={**STEPS, "fit": my_fit})
    run_steps(start(robot, data, sensor), FITTING)
"""

from collections.abc import Callable, Collection, Mapping
from contextlib import nullcontext
from dataclasses import replace
from functools import partial, wraps

import numpy as np

from lab.calibration.fit_options import PLAIN, FitOptions
from lab.calibration.fitter import Fitter, NominalRobot
from lab.calibration.noise_search import outliers_among_held_out, tail_of
from lab.calibration.observation import ReadingsInWholes, observation_of, only_positions
from lab.calibration.residual.estimation import with_residual
from lab.calibration.residual.gaussian_process import GROUP
from lab.calibration.row_groups import hold_out, hold_out_last, rows_in_time
from lab.calibration.sensor import ArmSensor
from lab.calibration.statistics.goodness_of_fit import (
    adequacy_of,
    lack_of_fit_not_tested,
    repeats,
    with_intervals_between_poses,
    with_intervals_of_poses,
    with_own_intervals,
)
from lab.calibration.statistics.model_selection import Selection
from lab.calibration.weights import Noise, weigh
from lab.core.checks import Check
from lab.core.errors import LabError, error_context, option_name
from lab.core.measurements import Measurements
from lab.core.progress import Stage, no_progress, no_stage
from lab.core.units import MM
from lab.diagnosis.hypothesis import Finding
from lab.diagnosis.range_constant import range_findings
from lab.extension_points import own_errors
from lab.kinematics.effects.effect import SessionInfo
from lab.kinematics.effects.effect_registry import CAMPAIGN_SPECIFIC, describe_term
from lab.prediction.extrapolation import measured_range
from lab.prediction.regions import Region, measured_region, region_of_points, workspace_region
from lab.prediction.residual_spread import for_later_rows
from lab.prediction.validation import Validation, shared_rows, validate_file, validate_folds, validate_rows
from lab.prediction.workspace_prediction import bounds_at, check_prediction, own_tolerance
from lab.verdict.diagnosed import (
    accepted_of,
    checks_of,
    diagnosed,
    further_outliers,
    gross_of,
    read_by,
    rms_m,
    undone,
    with_fitted,
)
from lab.verdict.fit_checks import (
    FIT_CHECKS,
    check_excluded,
    check_geometry_alone,
    check_improvement,
    check_limits,
    check_outliers,
    check_residual,
    check_sessions,
    check_validation_poses,
    check_workspace,
    doubted,
    noise_in_another_unit,
    points_in_another_scale,
)
from lab.verdict.fitted import UNJUDGED, Fitted, JudgementOptions, named_poses
from lab.verdict.noise_findings import finding, shared_error_findings
from lab.verdict.verdict import verdict

__all__ = [
    "FITTING",
    "STEPS",
    "UNKNOWN",
    "Step",
    "chosen_steps",
    "identify_robot",
    "judged",
    "refuse_missing_steps",
    "run_steps",
    "start",
]

Step = Callable[[Fitted], Fitted]
_IN_TIME = ("drift", "growth")  # mistakes that no model of geometry contains
UNKNOWN = Noise()  # noise that is estimated
_CLEARLY = 0.5  # of the error as read: with a mistake undone it is smaller


def identify_robot(
    robot: NominalRobot,
    data: Measurements,
    sensor: ArmSensor,
    noise: Noise = UNKNOWN,
    fit: FitOptions = PLAIN,
    judging: JudgementOptions = UNJUDGED,
    *,
    seed: int = 0,
    steps: Mapping[str, Step] | None = None,
) -> Fitted:
    """Identify a robot from measurements, and validate and judge the fit.

    Args:
        data: the measurements: joint positions (rad or m), points (m) in any one frame.
        sensor: what was measured.
        noise: by which the measurements are weighted.
        seed: of the poses that are held out at random, and of the folds of a cross-validation.
        steps: in place of ``STEPS``, by their names.

    Raises:
        LabError: an option makes no sense for these measurements, or they are too few.
    """
    steps = STEPS if steps is None else steps
    refuse_missing_steps(steps, fit, judging)
    return run_steps(start(robot, data, sensor, noise, fit, judging, seed=seed), steps)


def run_steps(state: Fitted, steps: Mapping[str, Step], stage: Stage = no_stage) -> Fitted:
    """Pass a state through steps, in their order.

    Args:
        stage: receives the name of each step as it begins; a step counts its parts by ``state.progress``.

    Raises:
        LabError: the measurements cannot be used, or a step returns no state; the message names the file or the step.
    """
    for name, step in steps.items():
        stage(name)
        where = state.source
        if name == "validate" and state.judging.other is not None:
            where = state.judging.other_source
        shown = replace(state, progress=partial(stage, name))
        with error_context(where) if where else nullcontext():
            added = _added(name, step, shown)
        if not isinstance(added, Fitted):
            raise LabError(
                f"step '{name}' returns {type(added).__name__}; return the state that it was given, with what it adds "
                "(dataclasses.replace)"
            )
        state = added
    return replace(state, progress=no_progress)


def _added(name: str, step: Step, state: Fitted) -> Fitted:
    """Return what a step returns.

    Raises:
        LabError: the measurements cannot be used; or a user's step raised an error, and the message names the step.
    """
    if str(getattr(step, "__module__", "")).partition(".")[0] == "lab":
        return step(state)
    with own_errors("step", name):
        return step(state)


def judged(state: Fitted) -> Fitted:
    """Return a state at the end of its steps.

    Raises:
        LabError: the steps neither fitted nor judged.
    """
    assert state.identification.values is not None and state.verdict.word
    return state


def chosen_steps(steps: object) -> Mapping[str, Step]:
    """Return the steps that a call was given; all where none were.

    Raises:
        LabError: they are no mapping of names to functions.
    """
    if steps is None:
        return STEPS
    if not isinstance(steps, Mapping):
        raise LabError(f"steps are a {type(steps).__name__}; give a mapping of names to functions, as STEPS is")
    for name, step in steps.items():
        if not callable(step):
            raise LabError(f"step '{name}' is {step!r}; give a function from state to state, or leave it out")
    return steps


def refuse_missing_steps(steps: Mapping[str, Step], fit: FitOptions, judging: JudgementOptions) -> None:
    """Refuse options that no step would read.

    Raises:
        LabError: the step that an option needs is left out.
    """
    needed = {
        "model": ("select model", fit.groups or fit.search),
        "error_terms": ("select model", fit.error_terms),
        "model residual": ("fit residual", fit.residual),
        "holdout": ("hold out", judging.holdout is not None),
        "holdout_last": ("hold out", judging.holdout_last is not None),
        "validate": ("validate", judging.other is not None),
    }
    for option, (step, is_given) in needed.items():
        if is_given and step not in steps:
            raise LabError(
                f"{option_name(option)} needs the step '{step}', which is left out; add the step, or drop the option"
            )


def start(
    robot: NominalRobot,
    data: Measurements,
    sensor: ArmSensor,
    noise: Noise = UNKNOWN,
    fit: FitOptions = PLAIN,
    judging: JudgementOptions = UNJUDGED,
    *,
    seed: int = 0,
) -> Fitted:
    """Return the state before the first step: the rows to fit, and those that the data hold for the validation.

    Args:
        data: the measurements: joint positions (rad or m), points (m) in any one frame.
        sensor: what was measured.
        noise: by which the measurements are weighted.

    Raises:
        LabError: no row has a measured point, or the noise of some rows is unknown.
    """
    if noise.instrument is not None:
        sensor = sensor.weighted_by(noise.instrument, data)
    targets = sensor.targets(data)
    arm = robot.arm(targets)
    data = sensor.with_sessions(arm, data, arm.nominal(robot.tool))
    noise = sensor.noise(replace(noise, error_terms=fit.error_terms))
    fitter = Fitter(robot, targets, data, sensor, noise, fit, seed)
    observed = fitter.observed()
    rows = observed.only("calibrate").with_points()
    test = observed.only("test").with_points() if "test" in data.use else None
    if not len(rows):
        raise LabError("no row with use = calibrate has a measured point; mark or measure some")
    if test is not None and not len(test):
        raise LabError("no row with use = test has a measured point; mark or measure some")
    _refuse_gaps_in_noise(rows, fitter.noise)
    fitter = fitter.with_credible_range(rows)
    judged_by: list[tuple[Measurements, tuple[str, ...]]] = [] if test is None else [(data.only("test"), ())]
    if judging.other is not None:
        judged_by.append((judging.other, CAMPAIGN_SPECIFIC))
    fitter = replace(fitter, judged_by=tuple(judged_by)) if judged_by else fitter
    return Fitted(fitter, rows, test, judging)


def _refuse_gaps_in_noise(rows: Measurements, noise: Noise) -> None:
    """Refuse rows of which some have a standard deviation, where neither noise nor instrument is given for the rest."""
    given = np.isfinite(rows.sigma_m)
    if noise.sigma_m is None and noise.instrument is None and given.any() and not given.all():
        raise LabError(
            f"{rows.where(int(np.argmin(given)))}, column sigma_mm: empty, but other rows "
            f"have it; fill it in, or give {option_name('noise_mm')} or {option_name('instrument')} for the empty ones"
        )


def _find_mistakes(state: Fitted) -> Fitted:
    """Find gross mistakes of reading, and undo those that the user accepts.

    Needs: the state before the first step. Adds: ``diagnosis``; with mistakes undone it is the state of those readings.
    """
    fitter, judging = state.fitter, state.judging
    gross = gross_of(state)
    findings = accepted_of(() if gross is None else gross.findings, fitter.options.accept)
    if any(each.accepted for each in findings):
        data, sensor = undone(fitter.data, findings), read_by(fitter.kind, findings)
        again = start(fitter.robot, data, sensor, fitter.noise, fitter.options, judging, seed=fitter.seed)
        state = replace(again, source=state.source, progress=state.progress, checks=state.checks)
    state = replace(state, diagnosis=findings, far={} if gross is None else gross.outliers)
    if gross is None or not state.misread:
        return state
    plain = replace(fitter.options, groups=(), search=False, residual=False, robust=False)
    state = replace(state, fitter=replace(state.fitter, options=plain))
    return replace(state, diagnosis=_with_errors(state, gross.outliers))


def _with_errors(state: Fitted, outliers: Collection[str]) -> tuple[Finding, ...]:
    """Return the mistakes with the errors of the fit before each is undone, and after it.

    Args:
        outliers: ids of rows that are far off also with all of them undone.
    """
    fitter, findings = state.fitter, list[Finding]()
    data, sensor = fitter.data, fitter.kind
    try:
        before_m = rms_m(fitter.identified_with(state.given, (), ()))
        if np.isnan(before_m):  # no positions: the misses of the nominal arm stay
            return state.diagnosis
        for finding in state.diagnosis:
            if finding.accepted:  # undone already
                findings.append(finding)
                continue
            alone = [finding.as_accepted()]
            data, sensor = undone(data, alone), read_by(sensor, alone)
            rest = data.without(outliers)  # once a mistake is undone, as it counts the rows of the file
            other = start(fitter.robot, rest, sensor, fitter.noise, fitter.options, seed=fitter.seed)
            after_m = rms_m(other.fitter.identified_with(other.given, (), ()))
            # zeros and frames take some mistakes: then only the nominal arm misses by more
            clearly = after_m < _CLEARLY * before_m
            findings.append(replace(finding, before_m=before_m, after_m=after_m) if clearly else finding)
            before_m = after_m
    except LabError:  # what the search found stays
        return state.diagnosis
    return tuple(findings)


def _of_sound_readings(step: Step) -> Step:
    """Return a step that searches nothing in misread measurements: what it found would follow from the mistake."""

    @wraps(step)
    def run(state: Fitted) -> Fitted:
        return state if state.misread else step(state)

    return run


def _hold_poses_out(state: Fitted) -> Fitted:
    """Hold out a share of the rows on request.

    Needs: ``given``. Adds: ``held``.
    """
    judging, model = state.judging, partial(state.fitter.model_with, ())
    if judging.holdout is not None:
        rows, held_out = hold_out(model(), state.given, judging.holdout, state.fitter.seed)
        return replace(state, given=rows, held_out=held_out)
    if judging.holdout_last is not None:
        rows, held_out = hold_out_last(model(), state.given, judging.holdout_last)
        return replace(state, given=rows, held_out=held_out)
    return state


def _select_model(state: Fitted) -> Fitted:
    """Select the groups of the model and the errors that measurements share, each with the other.

    Needs: ``given``. Adds: ``selection``, ``groups``, ``unshown``, ``noise``; ``fitter`` weights by that noise.
    """
    fitter, selection, search = state.fitter.selected_with_noise(state.given)
    groups, unshown = (selection.chosen, selection.fixed) if selection else ((), ())
    return replace(state, fitter=fitter, selection=selection, groups=groups, unshown=unshown, noise=search)


def _fit(state: Fitted) -> Fitted:
    """Fit the parameters, without outliers on request.

    Needs: ``groups``, ``unshown``. Adds: ``rows``, ``weighted``, ``observations``, ``identification``,
    ``outlier_search``.
    """
    found, clean, outliers = state.fitter.identified(state.given, state.groups, state.unshown)
    fitted = replace(state.with_fit(found, clean), outlier_search=outliers)
    return replace(fitted, checks=state.checks, adequacy=lack_of_fit_not_tested("misread")) if state.misread else fitted


def _find_outliers(state: Fitted) -> Fitted:
    """Find outliers among the rows that were given and among those held out, and the tails of the noise.

    Needs: ``weighted``. Adds: ``outlier_search``, ``outliers``, ``tail_dof``.
    """
    found, noise = state.weighted, state.fitter.noise
    search = state.outlier_search or state.fitter.outliers_of(found, state.given)
    outliers, tail = named_poses(state.given, search), tail_of(found, state.rows, noise)
    observation = observation_of(found.model)
    if state.held_out is not None and (observation.positions or isinstance(observation, ReadingsInWholes)):
        outliers += named_poses(
            state.held_out, outliers_among_held_out(found, state.rows, state.held_out, noise, tail), held_out=True
        )
    state = replace(state, outlier_search=search, outliers=outliers, tail_dof=tail)
    return state if state.misread else replace(state, diagnosis=(*state.diagnosis, *further_outliers(state)))


def _check_lack_of_fit(state: Fitted) -> Fitted:
    """Test lack of fit, by the best test that the data allow.

    Needs: ``weighted``; a robust fit leaves the ``outliers`` out of the rows held out. Adds: ``adequacy``.
    """
    held_out = state.held_out
    if held_out is not None and state.left_out:
        held_out = held_out.without([pose.id for pose in state.outliers])
    found = adequacy_of(state.weighted, state.rows, held_out, state.fitter.noise, state.fitter.noise_shape)
    state = replace(state, adequacy=found)
    if found.outcome == "failed" and not state.fitter.options.residual:
        state = state.with_checks([found])
    if state.left_out or state.outlier_search is None:
        return state
    searched = state.fitter.options.search
    return state.with_checks(
        check_outliers(state.weighted, state.observations, state.outlier_search, searched=searched)
    )


def _choose_intervals(state: Fitted) -> Fitted:
    """Choose the covariance: of the weights, with small-sample corrections, or of whole poses (cluster-robust).

    An estimator of one's own brings its covariance with it.

    Needs: ``weighted``, ``noise``. Changes: ``identification``.
    """
    if state.fitter.options.estimator is not None:
        return state
    found, fitter, searched = state.weighted, state.fitter, state.fitter.options.search
    observation, checks = observation_of(found.model), list[Check]()
    trusted = state.noise.corrected(found)
    if state.noise.undecided and found.prior is None and not fitter.options.residual:
        trusted, checks = with_intervals_of_poses(found, state.observations, searched=searched)
    elif only_positions(observation) and state.noise.shared is None:
        known = weigh(observation, state.rows, fitter.noise)[1]
        plausible = known or found.prior is not None
        trusted, checks = with_own_intervals(
            found, state.observations, fitter.noise, searched=searched, plausible=plausible
        )
    elif not observation.positions:
        trusted, checks = with_intervals_between_poses(trusted, state.observations)
    return replace(state, identification=trusted).with_checks(checks)


def _check_fit(state: Fitted) -> Fitted:
    """Check outliers, groups, prior, nominal values, weak parameters, joint positions and the instrument's range.

    Needs: ``weighted``, ``identification``, ``adequacy``, ``outliers``, ``selection``. Adds: ``checks``, ``diagnosis``.
    """
    if not state.misread:
        ranges = range_findings(state.identification, adequate=state.adequacy.outcome != "failed")
        state = replace(state, diagnosis=(*state.diagnosis, *ranges))
    return state.with_checks([check for test in FIT_CHECKS for check in test(state)])


def _measure_range(state: Fitted) -> Fitted:
    """Measure the range of the joint positions, and estimate the model discrepancy beyond it.

    Needs: ``weighted``. Adds: ``measured``.
    """
    slopes = not state.fitter.options.residual  # whose process has its own uncertainty beyond an end
    prismatic = state.fitter.robot.chain.prismatic
    return replace(state, measured=measured_range(state.weighted, state.observations, prismatic, slopes=slopes))


def _fit_residual(state: Fitted) -> Fitted:
    """Fit residual joint offsets on request: a process with its own noise.

    Needs: ``weighted``. Changes: ``identification``, ``adequacy``, ``noise``, ``tail_dof``, ``fitter``.
    """
    checks, residual, inputs = list[Check](), state.fitter.options.residual, state.observations.inputs
    if residual:
        fitter = state.fitter.knowing(None)
        state = replace(
            state,
            identification=with_residual(state.weighted, state.rows),
            observations=weigh(observation_of(state.weighted.model), state.rows, fitter.noise)[0],
            adequacy=lack_of_fit_not_tested("residual"),
            noise=replace(state.noise, shared=None),
            fitter=fitter,
            tail_dof=float("inf"),
        )
        checks = check_residual(state.identification)
    groups = (*state.groups, *[GROUP] * residual)
    checks += check_geometry_alone(state.fitter.robot, state.identification, groups, inputs)
    return state.with_checks(checks)


def _check_noise(state: Fitted) -> Fitted:
    """Check the errors that the noise model explains, and test for effects that the model does not have.

    Needs: ``weighted``, ``adequacy``, ``noise``. Adds: ``findings``.
    """
    found, rows, fitter, adequacy = state.weighted, state.rows, state.fitter, state.adequacy
    if fitter.options.residual or not only_positions(observation_of(found.model)) or found.status != "converged":
        return state
    findings = shared_error_findings(found, rows, state.noise.shared, adequacy, repeats(rows))
    tested = fitter.options.search or (adequacy.name == "lack_of_fit.chi2" and adequacy.outcome == "passed")
    tested = tested or any(each.name in _IN_TIME for each in state.diagnosis)  # effects would explain it by chance
    beside = None if tested else fitter.with_missing_effects(rows, state.selection)
    missing = [] if beside is None else [_missing(beside)]
    return replace(state, findings=(*missing, *findings))


def _missing(beside: Selection) -> Check:
    before, after = beside.groups[0].holdout_m, beside.groups[len(beside.chosen)].holdout_m
    named = [describe_term(name) or name for name in beside.chosen]
    size_m = float(np.sqrt(max(before**2 - after**2, 0.0)))
    return finding("missing", size_m, effects=named, before_m=before, after_m=after)


def _validate(state: Fitted) -> Fitted:
    """Validate on further measurements, else on the rows held out, else by folds of all rows.

    Needs: ``identification``, ``groups``. Adds: ``validation``.
    """
    if state.identification.collapsed:  # its errors are small for any readings
        return state
    if state.judging.other is not None:
        found, checks = _by_other(state, state.judging.other)
    elif state.held_out is not None:
        found, checks = _by_held_out(state, state.held_out)
    elif state.misread:  # as the parts of the rows would be
        return state
    else:
        fitter = state.fitter.weighted_as(state.identification)  # weights of all rows, in place of those of each fold
        again = partial(fitter.predicting, groups=state.groups, fixed=state.unshown, process=state.process)
        found = validate_folds(again, state.identification, state.given, state.fitter.seed, state.progress)
        found, checks = found.naming([pose.id for pose in state.outliers]), []
    return replace(state, validation=found).with_checks([*found.checks, *checks])


def _by_held_out(state: Fitted, held_out: Measurements) -> tuple[Validation, list[Check]]:
    """Validate on rows held out, of which outliers are errors like the others: also where they are not fitted."""
    session, placed = state.fitter.session, []
    if session.stations:
        placed.append(("station", held_out.stations, session.stations))
    if "sessions" in state.groups:
        placed.append(("session", held_out.sessions, session.sessions))
    judged, unplaced = np.ones(len(held_out), dtype=bool), list[tuple[str, str]]()
    for what, names, known in placed:
        judged &= [name in known for name in names]
        unplaced += [(what, name) for name in set(names) - set(known)]
    checks = [Check("validation.unplaced", "noted", data={"what": w, "name": name}) for w, name in sorted(unplaced)]
    if not judged.any():
        return Validation(None, None), checks
    found = validate_rows(state.identification, held_out[judged])
    return found.naming([pose.id for pose in state.outliers if pose.held_out]), checks


def _by_other(state: Fitted, other: Measurements) -> tuple[Validation, list[Check]]:
    """Validate on measurements of another file, by the groups that last from one campaign to another."""
    session, refit = _stations_of(other, state), state.judging.refit
    lasting = [group for group in state.groups if group not in CAMPAIGN_SPECIFIC]
    arm = state.fitter.robot.arm_with(other.targets, lasting, session)
    model = arm if state.process is None else state.process.added_to(arm)
    found = validate_file(state.identification, model, other, refit)
    found, checks = replace(found, fitted_share=shared_rows(other, state.rows)), list[Check]()
    if set(CAMPAIGN_SPECIFIC) & set(state.groups) and "base" not in refit:
        checks.append(Check("validation.frame", "noted"))
    if (
        "payload_kg" in model.conditions
        and "payload_kg" in state.rows.conditions
        and "payload_kg" not in other.conditions
    ):
        checks.append(Check("validation.payload", "noted"))
    return found, checks


def _stations_of(other: Measurements, state: Fitted) -> SessionInfo:
    """Return the stations whose places a fit found, where the rows of another file are validated from these.

    The instrument of that file has the range errors of the fitted one.

    Raises:
        LabError: a station of the file was not fitted, and no base is placed anew for it.
    """
    known, named = state.fitter.session.stations, set(other.stations)
    of_instrument = SessionInfo(range_prior=state.fitter.session.range_prior)
    if "base" in state.judging.refit or (len(known) < 2 and len(named) < 2):
        return of_instrument
    if unplaced := sorted(named - set(known)):
        raise LabError(
            f"station '{unplaced[0]}' was not fitted, so its place is unknown; {option_name('refit')} base "
            f"places every station anew"
        )
    return replace(of_instrument, stations=known)


def _judge(state: Fitted) -> Fitted:
    """Predict the errors where the arm is used, compare them with the validation's, and decide the verdict.

    Needs: ``identification``, ``adequacy``, ``measured``, ``findings``, ``validation``. Adds: ``prediction``,
    ``bounds``, ``verdict``.
    """
    found, fitter, judging, validation = state.identification, state.fitter, state.judging, state.validation
    given_m = fitter.noise.sigma_m
    doubts = noise_in_another_unit(None if given_m is None else MM.of(given_m), state.rows, found)
    doubts += points_in_another_scale(found)
    judged = _judged(state)
    prediction = None
    if not state.misread:
        prediction = check_prediction(found, judged, fitter.noise, state.measured, seed=fitter.seed)
    left_m = rms_m(found)
    state = replace(state, diagnosis=with_fitted(state.diagnosis, left_m, state.groups))
    poses, region = _regions(state)
    left = state.residual_spread
    word = verdict(
        found,
        judged,
        judging.gate_m,
        goodness=state.adequacy,
        tolerance=fitter.options.tolerance,
        measured=state.measured,
        findings=(*checks_of(state.diagnosis, left_m), *state.findings),
        prediction=prediction,
        poses=poses,
        region=region,
        left=left,
    )
    if state.misread:
        return replace(state, verdict=word)
    if judging.holdout_last is not None:
        order, most_m = rows_in_time(state.rows), word.region.uncalibrated_rms_m / np.sqrt(3)
        left = for_later_rows(left, found, state.observations, order, most_m)
    bounds = bounds_at(found, left, validation, state.measured, own_tolerance(found, fitter.options.tolerance, poses))
    return replace(state, prediction=prediction, bounds=bounds, verdict=doubted(word, doubts))


def _judged(state: Fitted) -> Validation:
    """Return the validation that the verdict is decided by: without few outliers, where the fit leaves them out."""
    if not state.left_out:
        return state.validation
    return state.validation.without_few([pose.id for pose in state.outliers])


def _regions(state: Fitted) -> tuple[Region, Region]:
    """Return poses like the measured ones, and those of the region of the task.

    Raises:
        LabError: the region's file cannot be read, or the arm reaches none of its points.
    """
    found, robot, task = state.identification, state.fitter.robot, state.judging.region
    model, values = found.model, found.values
    turning = ~np.array(robot.chain.prismatic, dtype=np.bool_)
    poses = measured_region(found, state.observations, turning)
    if task is None or task.kind == "measured":
        return poses, poses
    if task.kind == "workspace":
        return poses, workspace_region(model, values, state.rows.joints, turning)
    arm = robot.arm(state.fitter.targets)
    T_instrument_frame0 = arm.T_tracker_frame0(values[: len(arm.names)])
    points = task.points(T_instrument_frame0, robot.chain.joint_names, robot.chain.prismatic)
    region = region_of_points(
        task.kind,
        points,
        model=model,
        values=values,
        inputs=state.rows.inputs(model.conditions),
        joints=robot.chain,
        name=state.judging.region_name,
    )
    return poses, region


def _check_validation(state: Fitted) -> Fitted:
    """Check what the validation covers, and the rows that were not used.

    Needs: ``verdict``, ``validation``. Adds: ``checks``.
    """
    fitter, kind, validation = state.fitter, state.fitter.kind, state.validation
    checks, blank = list[Check](), int((~kind.rows(fitter.data)).sum())
    if blank:
        data = {"blank": blank, "count": len(fitter.data), "reading": kind.terms.reading}
        checks.append(Check("rows.blank", "noted", data=data))
    checks += check_limits(fitter.robot.chain, fitter.data)
    checks += check_validation_poses(state.identification, state.measured, validation.rows)
    checks += check_workspace(state.verdict)
    if _judged(state) is not validation:
        checks.append(check_excluded(state.outliers))
    if kind.in_instrument_frame and "sessions" not in state.groups:
        checks += check_sessions(state.rows)
    return state.with_checks(checks + check_improvement(validation))


FITTING: Mapping[str, Step] = {
    "find mistakes": _find_mistakes,
    "diagnose": _of_sound_readings(diagnosed),
    "select model": _of_sound_readings(_select_model),
    "fit": _fit,
    "find outliers": _of_sound_readings(_find_outliers),
    "check lack of fit": _of_sound_readings(_check_lack_of_fit),
    "choose intervals": _of_sound_readings(_choose_intervals),
    "check fit": _of_sound_readings(_check_fit),
    "measure range": _of_sound_readings(_measure_range),
    "fit residual": _of_sound_readings(_fit_residual),
    "check noise": _of_sound_readings(_check_noise),
}
STEPS: Mapping[str, Step] = {
    "find mistakes": _find_mistakes,
    "hold out": _hold_poses_out,
    **FITTING,
    "validate": _validate,
    "judge": _judge,
    "check validation": _of_sound_readings(_check_validation),
}
