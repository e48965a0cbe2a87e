"""One campaign: plan, measure, identify, assess; on a virtual arm, or on measurements of a real one."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lab.calibration.assess import (
    Judgement,
    TruthComparison,
    Verdict,
    compare_with_truth,
    errors_at,
    judge_file,
    judge_folds,
    judge_holdout,
    judge_rows,
    verdict,
)
from lab.calibration.identify import Identification, Noise, identify
from lab.errors import LabError
from lab.frames import Array
from lab.geometry.axes import Truth
from lab.instruments import instrument
from lab.measurement_file import read_measurements
from lab.measurements import Measurements
from lab.seeds import stream
from lab.study.options import MeasuredCampaign, VirtualCampaign
from lab.study.robots import Robot, load_robot
from lab.virtual.feasible import collides, random_poses
from lab.virtual.real import (
    RealArm,
    random_perturbation,
    random_table,
    random_tracker,
    real_arm,
    real_arm_from_table,
    track,
)

FRESH_POSES = 1000


@dataclass(frozen=True)
class Outcome:
    """What a campaign ended with.

    Attributes:
        measurements: all rows that were read or measured.
        fitted: the rows that the delivered parameters come from.
        truth, comparison, real: of a virtual arm only.
        seconds: of the identification and its assessment.
    """

    robot: Robot
    measurements: Measurements
    fitted: Measurements
    identification: Identification
    judgement: Judgement
    verdict: Verdict
    seconds: float
    warnings: tuple[str, ...]
    real: RealArm | None = None
    truth: Truth | None = None
    comparison: TruthComparison | None = None


def run_virtual(options: VirtualCampaign) -> Outcome:
    """A campaign on a virtual arm: perturbed, measured by a tracker, identified, judged on fresh poses."""
    options.check()
    robot = load_robot(options.robot)
    robot.needed_model()
    robot.refuse_unknown(options.targets)
    device, arm = instrument(options.instrument), robot.arm(options.targets)
    real = perturbed_arm(robot, options)
    joints, notes = _plan(robot, options)
    data = track(real, joints, options.targets, device, stream(options.seed, "noise"), options.readings)
    data = replace(data, warnings=notes)

    started = time.perf_counter()
    noise = (
        Noise(device, readings=options.readings) if options.noise_mm is None else Noise(None, options.noise_mm / 1e3)
    )
    with _naming(options.plan or f"--poses {options.poses}"):
        identification = identify(arm, data, arm.nominal(robot.tool), noise)
    fresh = random_poses(real.robot, FRESH_POSES, stream(options.seed, "fresh"))
    judgement = Judgement("fresh", errors_at(identification, fresh, real.points(fresh, options.targets)))
    truth = real.truth(arm)
    seconds = time.perf_counter() - started
    return _outcome(robot, data, data, identification, judgement, options.gate_mm, seconds, real, truth)


def run_measured(options: MeasuredCampaign) -> Outcome:
    """The same from a measurement file, judged by a hold-out, another file, or cross-validation."""
    options.check()
    noise = Noise(
        instrument(options.instrument) if options.instrument is not None else None,
        None if options.noise_mm is None else options.noise_mm / 1e3,
    )
    robot = load_robot(options.robot)
    data = _read(robot, options.file)
    other = None if options.validate is None else _seen(_read(robot, options.validate))
    rows, test = _seen(data.only("calibrate")), _seen(data.only("test"))
    if not len(rows):
        raise LabError(f"{options.file}: no row with use = calibrate has a measured point; mark or measure some")
    if "test" in data.use and not len(test):
        raise LabError(f"{options.file}: no row with use = test has a measured point; mark or measure some")
    _refuse_gaps(options, rows)
    arm = robot.arm(data.targets)
    nominal = arm.nominal(robot.tool)

    def fitted(part: Measurements) -> Identification:
        with _naming(options.file):
            return identify(arm, part, nominal, noise)

    started = time.perf_counter()
    if options.holdout is not None:
        identification, judgement = judge_holdout(fitted, rows, options.holdout, options.seed)
    else:
        identification = fitted(rows)
        if other is not None:
            with _naming(options.validate):
                judgement = judge_file(identification, robot.arm(other.targets), other, options.refit)
        elif len(test):
            judgement = judge_rows(identification, test)
        else:
            judgement = judge_folds(fitted, identification, rows, options.seed)
    seconds = time.perf_counter() - started
    return _outcome(robot, data, rows, identification, judgement, options.gate_mm, seconds)


def _read(robot: Robot, path: Path) -> Measurements:
    return read_measurements(path, robot.chain.joint_names, robot.chain.prismatic)


def _seen(data: Measurements) -> Measurements:
    """The rows where a target was seen."""
    return data.take(np.flatnonzero(data.seen.any(axis=1)))


@contextmanager
def _naming(place: object) -> Iterator[None]:
    """Say in what happens here which file or option it comes from."""
    try:
        yield
    except LabError as error:
        raise LabError(f"{place}: {error}") from error


def perturbed_arm(robot: Robot, options: VirtualCampaign) -> RealArm:
    """The virtual arm of these options, before its tracker."""
    model = robot.needed_model()
    place = random_tracker(model, stream(options.seed, "tracker"))
    rng = stream(options.seed, "arm")
    sigmas = options.position_sigma_mm / 1e3, options.rotation_sigma_mrad / 1e3
    if options.dh_only:
        arm = robot.arm(tuple(robot.tool))
        base, table, _ = arm.split(random_table(arm, *sigmas, rng))
        tool = arm.split(arm.nominal(robot.tool))[2]
        return real_arm_from_table(model, arm, arm.assemble(base, table, tool), place)
    off = random_perturbation(model, *sigmas, rng, options.offset_sigma_mrad / 1e3)
    return real_arm(model, off, place)


def _refuse_gaps(options: MeasuredCampaign, rows: Measurements) -> None:
    """The rows to fit give sigma_mm all or none, unless an option says what the others' is."""
    given = np.isfinite(rows.sigma_m)
    if options.noise_mm is None and options.instrument is None and given.any() and not given.all():
        raise LabError(
            f"{options.file}: line {rows.lines[int(np.argmin(given))]}, column sigma_mm: empty, but other rows "
            "have it; fill it in, or say --noise-mm or --instrument for the empty ones"
        )


def _plan(robot: Robot, options: VirtualCampaign) -> tuple[Array, tuple[str, ...]]:
    """The poses to measure, of the plan or random ones that collide with nothing, and the plan's warnings."""
    model = robot.needed_model()
    if options.plan is None:
        return random_poses(model, options.poses, stream(options.seed, "poses")), ()
    plan = read_measurements(options.plan, robot.chain.joint_names, robot.chain.prismatic, points=False)
    plan = plan.only("calibrate")
    if not len(plan):
        raise LabError(f"{options.plan}: no row has use = calibrate; mark some")
    joints = plan.joints
    slack = 1e-9
    outside = (joints < robot.chain.lower - slack) | (joints > robot.chain.upper + slack)
    if outside.any():
        row, joint = np.argwhere(outside)[0]
        chain, unit = robot.chain, "m" if robot.chain.prismatic[joint] else "rad"
        raise LabError(
            f"{options.plan}: line {plan.lines[row]}, joint {chain.joint_names[joint]}: "
            f"{joints[row, joint]:.4g} {unit} is beyond its limits, "
            f"{chain.lower[joint]:.4g} to {chain.upper[joint]:.4g}; "
            "mend the pose, or the column's unit"
        )
    hit = collides(model, joints)
    if hit.any():
        line = plan.lines[int(np.argmax(hit))]
        raise LabError(f"{options.plan}: line {line}: the arm collides in this pose; take it out of the plan")
    return joints, plan.warnings


def _outcome(
    robot: Robot,
    data: Measurements,
    rows: Measurements,
    identification: Identification,
    judgement: Judgement,
    gate_mm: float,
    seconds: float,
    real: RealArm | None = None,
    truth: Truth | None = None,
) -> Outcome:
    word = verdict(identification, judgement, gate_mm / 1e3)
    warnings = [*robot.warnings, *identification.warnings, *judgement.warnings]
    if blank := int((~data.seen.any(axis=1)).sum()):
        warnings.append(f"{blank} of {len(data)} rows have no measured point and are left out")
    warnings += _outside_limits(robot, data) + _several_sessions(rows)
    if judgement.errors is not None:
        before, after = (float(np.nanmean(e)) for e in (judgement.errors.before, judgement.errors.after))
        if after >= before:
            warnings.append(f"no improvement: {1e3 * after:.3g} mm after, {1e3 * before:.3g} mm before")
    comparison = None if truth is None else compare_with_truth(identification, truth)
    return Outcome(
        robot,
        data,
        rows,
        identification,
        judgement,
        word,
        seconds,
        tuple(dict.fromkeys(warnings)),
        real,
        truth,
        comparison,
    )


def _several_sessions(rows: Measurements) -> list[str]:
    sessions = list(dict.fromkeys(rows.sessions))
    if len(sessions) < 2:
        return []
    return [f"sessions {', '.join(sessions)} are fitted with one base and one tool: fit each alone if either was moved"]


def _outside_limits(robot: Robot, data: Measurements) -> list[str]:
    slack = 1e-3
    outside = (data.joints < robot.chain.lower - slack) | (data.joints > robot.chain.upper + slack)
    return [
        f"joint {name}: {int(count)} of {len(data)} poses are beyond its limits; check units, signs and offsets"
        for name, count in zip(robot.chain.joint_names, outside.sum(axis=0), strict=True)
        if count
    ]
