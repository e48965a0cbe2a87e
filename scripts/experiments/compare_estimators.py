"""Which estimator? Least squares, a Kalman filter, an M-estimator and a learned corrector on identical campaigns.

All estimators see the same measurements: of each arm some campaigns, which differ in the noise alone. Errors are those
of positions on validation poses, without noise. A ratio is the geometric mean over the campaigns of an estimator's
error over that of the lab's least squares; its 95 % interval is Student's over the arms, on the log scale.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from shared import Answer, Document, Flag, Paragraph, Row, Table, example, run_script, short

import lab
from lab.calibration.fit_options import FitOptions
from lab.calibration.identification import identify
from lab.calibration.weights import Noise
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.probability import t_ppf
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.model import Model
from lab.library.virtual_arm import perturbed_arm
from lab.noise.instruments import instrument
from lab.options.option_groups import Effects
from lab.options.virtual_campaign import VirtualCampaign
from lab.robots.load_robot import load_virtual
from lab.simulation.collisions import random_poses
from lab.simulation.tracking import VirtualMeasurement, track_with_errors
from lab.studies import executors

NEEDS = ("sklearn",)
ROBOT, INSTRUMENT, TARGET = "irb120", "uniform-8um", ("p1",)
LEAST_SQUARES, LEARNED = "least squares", "learned corrector"
_KALMAN, _TUKEY = example("own_kalman").KalmanFilter, example("own_robust").Tukey
ESTIMATORS = {"Kalman, textbook": _KALMAN(0), "Kalman, iterated": _KALMAN(), "Tukey": _TUKEY()}
CONDITIONS: Mapping[str, Effects] = {
    "noise alone": Effects(),
    "5 % outliers": Effects(bad_share=0.05),
    "gears that run out": Effects(harmonic_mrad=0.3),
}


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    campaigns: int = 10_000
    """Campaigns of each condition."""
    draws: int = 10
    """Campaigns of one arm, which differ in the noise alone."""
    poses: int = 50
    """Measured poses of each campaign."""
    fresh: int = 100
    """Poses on which it is validated."""
    conditions: tuple[str, ...] = field(default_factory=lambda: tuple(CONDITIONS))
    """Conditions, by name."""
    seed: int = 0
    """Of everything random."""
    workers: int = 1
    """Processes."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Predictor:
    """What a corrector needs of an estimate: predictions of its arm."""

    arm: Model
    values: Array

    def predict(self, joints: Array) -> "Predicted":
        """Return the points ``(n, k, 3)`` m."""
        return Predicted(self.arm.points(joints, self.values))


@dataclass(frozen=True)
class Predicted:
    """Predicted points."""

    points: Array


class Together(lab.Estimator):
    """Run several estimators on one problem, and keep the values of each."""

    name = "together"

    def __init__(self) -> None:
        self.found = dict[str, Array]()

    def estimate(self, problem: lab.EstimationProblem) -> tuple[Array, Array]:
        """Return the last estimate."""
        for name, each in ESTIMATORS.items():
            values, covariance = each.estimate(problem)
            self.found[name] = values
        return values, covariance


def of_arm(options: Options, condition: str, number: int) -> dict[str, Array]:
    """Return the mean errors ``(draws,)`` mm of each estimator, in the campaigns with one arm."""
    LearnedCorrector = example("own_corrector").LearnedCorrector
    robot, device = load_virtual(ROBOT), instrument(INSTRUMENT)
    arm, nominal = robot.arm(TARGET), robot.arm(TARGET).nominal(robot.tool)
    seed = options.seed + number
    real = perturbed_arm(robot, VirtualCampaign(robot=ROBOT, seed=seed, effects=CONDITIONS[condition]))
    joints = random_poses(robot.model, options.poses, rng_for(seed, "poses"))
    fresh = random_poses(robot.model, options.fresh, rng_for(seed, "fresh"))
    truth, kernel = real.points(fresh, TARGET)[:, 0], None
    errors: dict[str, list[float]] = {name: [] for name in (LEAST_SQUARES, *ESTIMATORS, LEARNED)}

    def judge(name: str, points: Array) -> None:
        errors[name].append(1e3 * float(np.linalg.norm(points - truth, axis=1).mean()))

    for draw in range(options.draws):
        data = measured(VirtualMeasurement(real, joints, TARGET, device, rng_for(seed, "noise", draw)))
        together = Together()
        found = identify(arm, data, nominal, Noise(device), FitOptions(estimator=together, prior="off"))
        judge(LEAST_SQUARES, arm.points(fresh, found.fit.least_squares)[:, 0])
        for name, values in together.found.items():
            whole = found.values.copy()
            whole[list(found.fit.free)] = values
            judge(name, arm.points(fresh, whole)[:, 0])
        corrector = LearnedCorrector(Predictor(arm, found.fit.least_squares), data, kernel)
        kernel = corrector.process.kernel_  # fitted to the first draw, and the same for the others
        judge(LEARNED, corrector.predict(fresh))
    return {name: np.array(values) for name, values in errors.items()}


def measured(poses: VirtualMeasurement) -> Measurements:
    """Return the measurements of a virtual session."""
    return track_with_errors(poses)[0]


def ratio(errors: Array, known: Array) -> dict[str, float]:
    """Return the ratio of errors ``(arms, draws)``, with the ends of its interval and the spread of the campaigns."""
    logs = np.log(errors / known)
    by_arm = logs.mean(axis=1)
    half = float(t_ppf(0.975, len(by_arm) - 1)) * by_arm.std(ddof=1) / np.sqrt(len(by_arm))
    low, high = np.exp(np.quantile(logs, (0.05, 0.95)))
    middle = float(by_arm.mean())
    return {
        "mean_mm": float(errors.mean()),
        "ratio": float(np.exp(middle)),
        "from": float(np.exp(middle - half)),
        "to": float(np.exp(middle + half)),
        "p5": float(low),
        "p95": float(high),
    }


def answer(options: Options) -> Answer:
    """Run all campaigns, and compare each estimator with least squares.

    Raises:
        LabError: there are fewer than two arms, or a condition is unknown.
    """
    if unknown := [name for name in options.conditions if name not in CONDITIONS]:
        raise LabError(f"--conditions: '{unknown[0]}' is none; there are {', '.join(CONDITIONS)}")
    arms = options.campaigns // max(options.draws, 1)
    if arms < 2 or options.draws < 1:
        raise LabError(f"--campaigns {options.campaigns}: give at least two arms of --draws {options.draws} each")
    results, rows = dict[str, dict[str, dict[str, float]]](), list[Row]()
    with executors.local_executor(options.workers) as executor:
        jobs = {
            name: [executor.submit(of_arm, options, name, number) for number in range(arms)]
            for name in options.conditions
        }
        for condition, running in jobs.items():
            parts = [each.result() for each in running]
            errors = {name: np.stack([part[name] for part in parts]) for name in parts[0]}
            results[condition] = {name: ratio(each, errors[LEAST_SQUARES]) for name, each in errors.items()}
            rows += [_row(condition, name, each) for name, each in results[condition].items()]
    note = (
        f"{arms * options.draws:,} campaigns of each condition: {arms:,} arms with {options.draws} draws of the noise, "
        f"{options.poses} poses, robot {ROBOT}, instrument {INSTRUMENT}."
    )
    columns = (
        "campaigns",
        "estimator",
        "mean error, mm",
        "ratio to least squares",
        "95 % interval",
        "90 % of campaigns",
    )
    document = Document("Estimators on identical campaigns", (Table(columns, tuple(rows)), Paragraph(note)))
    return Answer({"campaigns": arms * options.draws, "conditions": results}, document)


def _row(condition: str, name: str, found: Mapping[str, float]) -> Row:
    known = name == LEAST_SQUARES
    interval, spread = (f"{found[a]:.4f} to {found[b]:.4f}" for a, b in (("from", "to"), ("p5", "p95")))
    return (
        condition,
        name,
        short(found["mean_mm"]),
        "1" if known else f"{found['ratio']:.4f}",
        "" if known else interval,
        "" if known else spread,
    )


if __name__ == "__main__":
    run_script("compare_estimators")
