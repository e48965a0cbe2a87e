"""A torso with two arms on virtual campaigns: rank, error at new poses, and coverage of the intervals, by observation.

Every campaign has an arm of its own, whose bodies in MuJoCo are displaced, poses and noise of its own, and a whole
fit. Measured points, points together with contacts between the two hands, and contacts alone are compared: the error
at new poses with the noise floor, sigma sqrt(rank / numbers) of each coordinate, and with what the covariance predicts;
and how many of the 95 % intervals hold the true value.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from shared import Answer, Document, Flag, Paragraph, Section, Table, run_script

from lab.calibration.identify import Identification, identify
from lab.calibration.weights import Noise
from lab.campaign.options import VirtualCampaign
from lab.campaign.robot import load_virtual
from lab.campaign.virtual_robot import truth_of
from lab.commands.calibrate.run import measurement_session
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.serial.axes_to_dh import Truth
from lab.noise.instruments import INSTRUMENTS

CASES: Mapping[str, str] = {"points": "points", "points and contacts": "self-contact", "contacts alone": "self-contact"}
_TARGETS = ("left.p1", "right.p1")
_INSTRUMENT = "uniform-8um"
_FRESH = 300
_REACH = 1.959963984540054


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    robots: int = 200
    """Virtual robots of each case."""
    poses: int = 100
    """Poses of each campaign; of points and contacts, half of them touch."""
    cases: tuple[str, ...] = tuple(CASES)
    """What is observed."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class _Campaign:
    """One campaign: its fit and its truth, in the same gauge."""

    found: Identification
    truth: Truth
    numbers: int  # observed coordinates


def _campaign(case: str, poses: int, seed: int) -> _Campaign:
    alone = case == "contacts alone"
    options = VirtualCampaign(
        "torso", observe=CASES[case], poses=2 * poses if alone else poses, targets=_TARGETS, seed=seed
    )
    robot = load_virtual(options.robot)
    session, placed = measurement_session(options, robot)
    data = session.measurements
    if alone:
        touching = np.array([bool(cell) for cell in data.other["contact"]])
        data = replace(data.take(np.flatnonzero(touching)), targets=(), points=np.empty((int(touching.sum()), 0, 3)))
    arm, kind = robot.arm(_TARGETS), options.kind()
    nominal = arm.nominal(robot.tool)
    model, rows = kind.observation(arm, data, nominal)
    sigma_m = INSTRUMENTS[_INSTRUMENT].isotropic_sigma(1)
    found = identify(model, rows, nominal, Noise(None, sigma_m))
    known = truth_of(session.true_robot, arm)
    truth = None if known is None else kind.observed_truth(known, found, session.true_robot, placed)
    if truth is None:
        raise LabError(f"seed {seed}: the robot's parameters have no single truth")
    return _Campaign(found, truth, int(np.isfinite(rows.points).sum()))


def _errors(case: str, run: _Campaign, seed: int) -> tuple[Array, Array]:
    """Errors ``(n, d)`` m of coordinates at new poses, and their predicted variances: of the points, or of what is
    between them.
    """
    arm = load_virtual("torso").arm(_TARGETS)
    joints = arm.chain.random_joints(_FRESH, rng_for(seed, "fresh"))
    points, jacobian = arm.observe(joints, run.found.values)
    errors, slopes = points - arm.points(joints, run.truth.values), jacobian[..., list(run.found.fit.free)]
    if case == "contacts alone":
        errors, slopes = errors[:, :1] - errors[:, 1:], slopes[:, :1] - slopes[:, 1:]
    variances = np.einsum("nkdf,fg,nkdg->nkd", slopes, run.found.covariance, slopes)
    return errors.reshape(len(joints), -1), variances.reshape(len(joints), -1)


def _summary(case: str, options: Options) -> dict[str, float]:
    sigma_m = INSTRUMENTS[_INSTRUMENT].isotropic_sigma(1)
    held, squares, predicted, floors, nees = list[float](), list[float](), list[float](), list[float](), list[float]()
    rank = numbers = 0
    for seed in range(options.robots):
        run = _campaign(case, options.poses, seed)
        free = list(run.found.fit.free)
        rank, numbers = len(free), run.numbers
        off = run.found.values[free] - run.truth.values[free]
        held.append(float((np.abs(off) <= _REACH * run.found.std).mean()))
        nees.append(float(off @ np.linalg.solve(run.found.covariance, off)) / rank)
        errors, variances = _errors(case, run, seed)
        squares.append(float((errors**2).mean()))
        predicted.append(float(variances.mean()))
        floors.append(sigma_m**2 * rank / numbers)
    count = np.sqrt(options.robots)
    return {
        "robots": options.robots,
        "rank": rank,
        "numbers": numbers,
        "coverage_95": float(np.mean(held)),
        "coverage_error": float(np.std(held) / count),
        "nees_per_parameter": float(np.mean(nees)),
        "rms_um": 1e6 * float(np.sqrt(np.mean(squares))),
        "floor_um": 1e6 * float(np.sqrt(np.mean(floors))),
        "rms_over_floor": float(np.sqrt(np.mean(squares) / np.mean(floors))),
        "rms_over_predicted": float(np.sqrt(np.mean(squares) / np.mean(predicted))),
    }


def answer(options: Options) -> Answer:
    """Simulate and fit the campaigns of each case."""
    if unknown := [case for case in options.cases if case not in CASES]:
        raise LabError(f"--cases {unknown[0]}: unknown; give some of {', '.join(CASES)}")
    values = {case: _summary(case, options) for case in options.cases}
    rows = tuple(
        (
            case,
            str(each["rank"]),
            str(each["numbers"]),
            f"{each['rms_um']:.2f}",
            f"{each['floor_um']:.2f}",
            f"{each['rms_over_floor']:.3f}",
            f"{each['rms_over_predicted']:.3f}",
            f"{100 * each['coverage_95']:.1f} ± {100 * each['coverage_error']:.1f}",
        )
        for case, each in values.items()
    )
    heads = ("observed", "rank", "numbers", "RMS, µm", "floor, µm", "RMS/floor", "RMS/predicted", "coverage, %")
    text = f"{options.robots} virtual torsos each, {options.poses} poses; RMS of a coordinate at new poses"
    return Answer(values, Document(text, (Section("Campaigns", (Table(heads, rows), Paragraph(""))),)))


if __name__ == "__main__":
    run_script("several_tips")
