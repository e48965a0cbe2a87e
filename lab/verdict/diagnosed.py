"""Diagnose the measurements of an identification: gross mistakes before the fit, fine ones beside it."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from lab.calibration.fitter import NominalRobot
from lab.calibration.identification import Identification
from lab.calibration.observation import observation_of
from lab.calibration.sensor import ArmSensor
from lab.calibration.weights import weigh
from lab.core.checks import Check
from lab.core.errors import LabError, option_name
from lab.core.measurements import Measurements
from lab.diagnosis.continuous import FITTED_ANYWAY, moves_before
from lab.diagnosis.fine import Fine, fine_mistakes
from lab.diagnosis.gross import Gross, gross_mistakes
from lab.diagnosis.hypothesis import Diagnosable, Finding, Hypothesis
from lab.kinematics.effects.effect import Step
from lab.kinematics.effects.steps import STEPS
from lab.kinematics.model import RigidArm
from lab.robots.load_robot import load_robot
from lab.robots.robot_files import own_models
from lab.verdict.fitted import Fitted

__all__ = [
    "accepted_of", "checks_of", "diagnosed",
    "further_outliers", "gross_of", "misread_points", "read_as_accepted", "read_by", "rms_m",
    "undone", "with_fitted",
]  # fmt: skip

_MISTAKES = ("gear", "coupling", "drift", "growth")  # effects that are hypotheses of mistakes, too
_GROUP_OF = {"drift": "drift", "joint_coupling": "coupling"}  # that fits a mistake
_MOSTLY = 0.5  # of a mean square error
_MOVED_M = 1e-6  # range of points that move
_LEAST_ROWS = 3  # given ones, on either side of a step
_LEAST_DOF = 20  # of a fit beside which anything is searched


def gross_of(state: Fitted) -> Gross | None:
    """Return the gross mistakes of a file's readings; None of readings whose misses nobody knows."""
    fitter = state.fitter
    kind, data = fitter.kind, fitter.data
    if not (isinstance(kind, Diagnosable) or (kind.in_instrument_frame and data.points.shape[2] == 3)):
        return None
    if data.targets and data.points.shape[2] == 3 and not _moves(data):
        return None  # points that are the same in every pose can be read in any way
    if len(fitter.session.stations) > 1:
        return None  # one placement is not of points in several frames
    return _gross(kind, fitter.robot.arm(fitter.targets), data, fitter.seed)


def _gross(sensor: ArmSensor | None, arm: RigidArm, data: Measurements, seed: int) -> Gross:
    """Return the gross mistakes by a nominal arm, compared with the lab's other robots."""
    nominal = arm.nominal({target: np.zeros(3) for target in arm.targets})
    return gross_mistakes(sensor, arm, data, nominal, _others(arm), seed)


def _moves(data: Measurements) -> bool:
    """Check whether any target moves from pose to pose."""
    seen = [data.points[rows, k] for k, rows in enumerate(data.seen.T) if rows.any()]
    return any(float(np.ptp(each, axis=0).max()) > _MOVED_M for each in seen)


def misread_points(robot: NominalRobot, data: Measurements, seed: int = 0) -> tuple[Finding, ...]:
    """Return the gross mistakes of measured points, by a robot's nominal arm."""
    return _gross(None, robot.arm(data.targets), data, seed).findings


def _others(arm: RigidArm) -> Iterator[tuple[str, Callable[[], RigidArm]]]:
    """Yield the lab's other robots with as many joints of the same kinds, each once."""
    for name in sorted(own_models()):
        robot = load_robot(name)
        alike = robot.chain.prismatic == arm.chain.prismatic and robot.name != arm.chain.name
        if alike and not robot.chain.has_loops:
            yield name, partial(robot.arm, arm.targets)


def accepted_of(findings: Sequence[Finding], accept: Sequence[str]) -> tuple[Finding, ...]:
    """Return findings, those accepted that a user names by kind or key.

    Raises:
        LabError: a name is of no finding.
    """
    names = {each.name for each in findings} | {each.hypothesis.key for each in findings}
    if unknown := [name for name in accept if name not in names]:
        keys = ", ".join(each.hypothesis.key for each in findings)
        raise LabError(
            f"{option_name('accept')} {unknown[0]}: no such mistake was found; "
            + (f"found: {keys}" if keys else "leave it out")
        )
    return tuple(each.as_accepted() if {each.name, each.hypothesis.key} & set(accept) else each for each in findings)


def read_as_accepted(data: Measurements, gross: Gross, accept: Sequence[str]) -> tuple[Measurements, Gross]:
    """Return measurements with the mistakes undone that a user accepts by name, and those that are left.

    Raises:
        LabError: a name is of no mistake.
    """
    findings = accepted_of(gross.findings, accept)
    left = tuple(each for each in findings if not each.accepted)
    return undone(data, findings), replace(gross, findings=left)


def undone(data: Measurements, findings: Sequence[Finding]) -> Measurements:
    """Return measurements with the accepted mistakes undone."""
    for finding in findings:
        correct = finding.hypothesis.corrected
        if finding.accepted and correct is not None:
            data = correct(data)
    return data


def read_by(sensor: ArmSensor, findings: Sequence[Finding]) -> ArmSensor:
    """Return the sensor that reads measurements with the accepted mistakes undone: it may be another one."""
    for finding in findings:
        if finding.accepted and finding.hypothesis.sensor is not None:
            sensor = finding.hypothesis.sensor
    return sensor


def diagnosed(state: Fitted) -> Fitted:
    """Find continuous mistakes beside a fit of the geometry, and put steps into every model.

    Rows held out count, too: they show between which poses something moved. Sizes are fitted to the others.

    Needs: ``given``. Adds: ``diagnosis``, ``far``; ``fitter`` has the steps.
    """
    if (fine := _fine(state)) is None:
        return state
    steps = {each.hypothesis: step for each in fine.findings if (step := _step(each, state)) is not None}
    findings = tuple(
        each.as_accepted() if each.hypothesis in steps or each.name in FITTED_ANYWAY else each for each in fine.findings
    )
    state = replace(state, far={**state.far, **fine.outliers})
    fitter = state.fitter.with_steps(tuple(steps.values())) if steps else state.fitter
    try:
        before, after = (each.identified_with(state.given, (), ()) for each in (state.fitter, fitter))
    except LabError:  # too few rows for the steps' parameters: they are found, but not fitted
        return replace(state, diagnosis=(*state.diagnosis, *fine.findings))
    if set(after.unobservable) - set(before.unobservable):  # what the rows cannot show did not move
        fitter, findings = state.fitter, tuple(each for each in findings if each.name not in STEPS)
    findings = _with_residuals(findings, before, after)
    return replace(state, fitter=fitter, diagnosis=(*state.diagnosis, *findings))


def _fine(state: Fitted) -> Fine | None:
    """Return the continuous mistakes beside a fit of the geometry; None where the rows determine none."""
    fitter, rows = state.fitter, _all_rows(state).without(state.far)
    try:
        found = fitter.identified_with(rows, (), ())
    except LabError:  # the fit itself says why
        return None
    if found.status != "converged" or not np.isfinite(found.residual_sigma_m) or found.dof < _LEAST_DOF:
        return None
    observed, _ = weigh(observation_of(found.model), rows, fitter.noise.independent)
    effects = fitter.derivatives_by_others(found, (), rows, _MISTAKES)
    several = fitter.kind.several_a_pose
    moves = moves_before(fitter.data, rows.ids, several_a_pose=several)
    try:
        return fine_mistakes(found, observed, rows, effects, moves=moves, several_a_pose=several)
    except np.linalg.LinAlgError:  # variances that the residuals do not determine
        return None


def further_outliers(state: Fitted) -> list[Finding]:
    """Return the poses far off that the test of outliers does not name, as one finding; nothing where there are none.

    Needs: ``far``, ``outliers``.
    """
    named = {pose.id for pose in state.outliers}
    sizes = {name: size for name, size in state.far.items() if name not in named}
    if not sizes:
        return []
    explains_m = float(np.sqrt(sum(size**2 for size in sizes.values()) / len(state.given)))
    hypothesis = Hypothesis("outliers", tuple(sizes), data=(("size_m", max(sizes.values())),))
    return [Finding(hypothesis, float("nan"), explains_m=explains_m)]


def _with_residuals(findings: Sequence[Finding], found: Identification, beside: Identification) -> tuple[Finding, ...]:
    """Return the findings, the steps among them with the error of the fit without all steps and with them."""
    before_m, after_m = rms_m(found), rms_m(beside)
    return tuple(replace(each, before_m=before_m, after_m=after_m) if each.name in STEPS else each for each in findings)


def rms_m(found: Identification) -> float:
    """Return the root mean square error of a fit's points (m); NaN where no positions were observed."""
    left = found.residuals[:, : observation_of(found.model).positions]
    return float(np.sqrt(3 * np.nanmean(left**2))) if np.isfinite(left).any() else float("nan")


def with_fitted(findings: Sequence[Finding], left_m: float, groups: Sequence[str] = ()) -> tuple[Finding, ...]:
    """Return the findings, those accepted that groups of effects explain, also others: what is left is less.

    Args:
        left_m: root mean square error that the fit leaves; NaN where unknown.
        groups: of the model.
    """

    def is_fitted(each: Finding) -> bool:
        if each.name == "scale":  # links that absorb it are wrong themselves
            return False
        return _GROUP_OF.get(each.name) in groups or each.explains_m**2 * _MOSTLY > left_m**2

    return tuple(
        each.as_accepted() if not each.is_discrete and each.name not in STEPS and is_fitted(each) else each
        for each in findings
    )


def checks_of(findings: Sequence[Finding], left_m: float) -> list[Check]:
    """Return the findings as checks: failed where readings are wrong, or where most of the error left is a mistake.

    Args:
        left_m: root mean square error that the fit leaves; NaN where unknown.
    """
    return [
        check if each.is_discrete or each.explains_m**2 >= _MOSTLY * left_m**2 else replace(check, outcome="noted")
        for each, check in ((each, each.check) for each in findings)
    ]


def _all_rows(state: Fitted) -> Measurements:
    """Return the rows that were given with those held out, in their order."""
    if state.held_out is None:
        return state.given
    names = {*state.given.ids, *state.held_out.ids}
    rows = state.fitter.observed()
    return rows[[name in names for name in rows.ids]]


def _step(finding: Finding, state: Fitted) -> Step | None:
    """Return the step of a finding, at its place in the campaign; None of other findings.

    A step that too few of the given rows are before, or after, cannot be fitted: rows held out are beyond it.
    """
    if finding.name not in STEPS:
        return None
    rows, given = _all_rows(state), state.given
    last, first = finding.hypothesis.of[-2:]
    places = dict(zip(rows.ids, rows.places.tolist(), strict=True))
    place = (places[last] + places[first]) / 2
    after = int(sum(places[name] > place for name in given.ids))
    if min(after, len(given) - after) < _LEAST_ROWS:
        return None
    joint = rows.joint_names.index(finding.hypothesis.of[0]) if finding.name == "joint_step" else -1
    return Step(finding.name, place, joint)
