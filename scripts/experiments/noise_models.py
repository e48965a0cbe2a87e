"""Do intervals, outliers and verifications hold under other noise than the instrument's? Thousands of campaigns.

Joints that scatter, errors that are correlated in time, a drift, heavy tails, and independent noise.
The arms are taken to be linear in their parameters, which small errors cannot tell from the truth; noise models,
weights, intervals and tests are the ones that every command uses. Per case: how often 95 % intervals hold, NEES per
parameter, the error over the workspace against the predicted one, how often something is taken beside the instrument's
noise, how often a pose is named an outlier, and how often a verification of the unchanged arm finds it changed.
"""

from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from shared import Answer, Document, Flag, Section, named_values, paragraphs, run_script

from lab.calibration.gauss_newton import Observations, fit
from lab.calibration.noise_search import tail_dof
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.calibration.statistics.linearized import LinearizedFit, NoiseDistribution, linearized
from lab.calibration.statistics.outliers import find_outliers
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.effects.arm_with_effects import Arm
from lab.kinematics.gauge import base_set
from lab.kinematics.model import Model
from lab.noise.error_term import Components, ErrorShapes, correlation_of
from lab.noise.variance_components import (
    RestrictedProblem,
    SmallSample,
    VarianceEstimate,
    chosen_components,
    small_sample,
)
from lab.robots.load_robot import load_robot
from lab.studies import executors
from lab.verification.predicted_points import STEP, CalibrationPrediction, VerificationProblem, with_estimated_noise
from lab.verification.split_test import change_test

SIGMA_M, SCATTER_RAD, CARRY, DRIFT_M, TAIL_DOF = 8e-6, 30e-6, 0.9, 60e-6, 3.0
_ARMS = 5  # pose sets
_FRESH = 200
_CHECKED = (3, 13)  # poses of a verification


@dataclass(frozen=True)
class Case:
    """One kind of noise.

    Attributes:
        noise: ``independent``, ``scatter``, ``correlated``, ``drift`` or ``tails``.
        targets: how many.
        known: whether the instrument's noise is given.
    """

    noise: str
    targets: int
    poses: int
    known: bool = False


CASES = {
    "independent, 1 target, 40 poses": Case("independent", 1, 40),
    "independent, 3 targets, 40 poses": Case("independent", 3, 40),
    "joint scatter, 3 targets, 40 poses": Case("scatter", 3, 40),
    "joint scatter, 3 targets, 40 poses, noise given": Case("scatter", 3, 40, known=True),
    "joint scatter, 1 target, 40 poses": Case("scatter", 1, 40),
    "AR(1) 0.9, 1 target, 80 poses": Case("correlated", 1, 80),
    "AR(1) 0.9, 1 target, 40 poses": Case("correlated", 1, 40),
    "drift 60 µm, 1 target, 80 poses": Case("drift", 1, 80),
    "Student t 3, 1 target, 80 poses": Case("tails", 1, 80),
}


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    campaigns: int = 1000
    """Campaigns of each case."""
    cases: tuple[str, ...] = field(default_factory=lambda: tuple(CASES))
    """Which kinds of noise."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class _LinearArm:
    """An arm whose points are linear in its parameters; its inputs are numbers of poses.

    Attributes:
        slopes: ``(n, k, 3, f)``.
        scatter: ``(n, 3 k, joints)`` by the joints' positions.
    """

    slopes: Array
    scatter: Array

    def observe(self, inputs: Array, values: Array) -> tuple[Array, Array]:
        """Points and derivatives of some poses."""
        slopes = self.slopes[inputs[:, 0].astype(int)]
        return slopes @ values, slopes

    def points(self, inputs: Array, values: Array) -> Array:
        """The points alone."""
        return np.asarray(self.slopes[inputs[:, 0].astype(int)] @ values)

    @property
    def parameters(self) -> int:
        """How many there are."""
        return int(self.slopes.shape[3])


def linear_arm(case: Case, seed: int, poses: int) -> _LinearArm:
    """The virtual robot at random poses, near its nominal parameters."""
    robot = load_robot("irb120")
    arm = robot.arm(("p1", "p2", "p3")[: case.targets])
    nominal = arm.nominal(robot.tool)
    free = list(base_set(arm, nominal).identifiable)
    inputs = arm.structure_joints(poses, rng_for(seed, "poses"))
    slopes = arm.observe(inputs, nominal)[1][..., free]
    scatter = by_joint_positions(arm, inputs, nominal, robot.chain.size)
    return _LinearArm(slopes, scatter.reshape(poses, -1, robot.chain.size))


def errors(case: Case, arm: _LinearArm, poses: NDArray[np.int_], rng: np.random.Generator) -> Array:
    """Errors ``(poses, 3 k)`` m of one campaign; the mean of a drift is zero."""
    size = (len(poses), 3 * case.targets)
    noise = SIGMA_M * rng.standard_normal(size)
    if case.noise == "tails":
        noise = SIGMA_M * rng.standard_t(TAIL_DOF, size) * np.sqrt((TAIL_DOF - 2) / TAIL_DOF)
    if case.noise == "correlated":
        for i in range(1, len(poses)):
            noise[i] = CARRY * noise[i - 1] + np.sqrt(1 - CARRY**2) * noise[i]
    if case.noise == "scatter":
        joints = SCATTER_RAD * rng.standard_normal((len(poses), arm.scatter.shape[2], 1))
        noise = noise + (arm.scatter[poses] @ joints)[..., 0]
    return noise


def of_one_campaign(case: Case, arm: _LinearArm, fresh: Array, rng: np.random.Generator) -> dict[str, Array]:
    """What one campaign says, of parameters that are all zero in truth.

    Args:
        fresh: ``(v, f)`` derivatives of validation points.
    """
    rows = np.arange(case.poses)
    made = errors(case, arm, rows, rng)
    if case.noise == "drift":
        direction = rng.standard_normal(3)
        steady: Array = np.linspace(-0.5, 0.5, case.poses) * DRIFT_M
        moved = (steady - steady.mean())[:, None] * direction / np.linalg.norm(direction)
        made = made + np.tile(moved, (1, case.targets))
    free = range(arm.parameters)
    alone = _observed(case, rows, made, None)
    plain = fit(cast(Model, arm), alone, free, np.zeros(arm.parameters))
    linear = linearized(cast(Model, arm), alone, plain.values, plain.free)
    shapes = _shapes(case, arm, rows)
    both = np.concatenate([linear.jacobian, linear.residual[..., None]], axis=2)
    problem = RestrictedProblem(both, linear.mask.size, shapes, case.known)
    estimate, _ = chosen_components(problem)
    problem = estimate.problem
    observed = _observed(case, rows, made, (estimate, problem.shapes))
    found = fit(cast(Model, arm), observed, free, plain.values)
    scale, dof = estimate.likelihood.scale, np.full(arm.parameters, float(problem.dof))
    if case.known and not estimate.kinds:
        scale, dof = 1.0, np.full(arm.parameters, np.inf)
    covariance = scale * found.unit_covariance()
    small = small_sample(problem, estimate) if estimate.kinds else None
    if small is not None:
        factor = small.factor / linear.scale[:, None] * linear.scale
        covariance, dof = factor @ covariance @ factor.T, small.dof
    std = np.sqrt(np.diag(covariance))
    z = found.values / std
    return {
        "covered": np.abs(z) <= stats.t.ppf(0.975, dof),
        "nees": np.array(z @ np.linalg.solve(covariance / np.outer(std, std), z) / len(z)),
        "realised": np.array(((fresh @ found.values) ** 2).mean()),
        "predicted": np.array(((fresh @ covariance) * fresh).sum(axis=1).mean()),
        "square": found.values**2,
        "plain square": plain.values**2,
        "taken": np.array(bool(estimate.kinds)),
        "named": np.array(len(_named(case, arm, observed, rng)) > 0),
        "alarmed": np.array(_alarmed(case, arm, found.values, covariance, (estimate, problem.dof, linear), small, rng)),
    }


def _observed(
    case: Case, rows: NDArray[np.int_], made: Array, shared: tuple[VarianceEstimate, ErrorShapes] | None
) -> Observations:
    """Errors as measurements, in units of the given noise, or of an order of magnitude."""
    if shared is None or not shared[0].kinds:
        points = made.reshape(len(rows), case.targets, 3)
        return Observations(rows[:, None].astype(float), points, np.full(points.shape[:2], 1 / SIGMA_M))
    return _weighed(case, rows, made, shared[0].components, 1.0, shared[1])


def _shapes(case: Case, arm: _LinearArm, rows: NDArray[np.int_]) -> ErrorShapes:
    times = np.arange(len(rows), dtype=float)
    shift = np.tile(np.eye(3), (len(rows), case.targets, 1)) / SIGMA_M
    along = (times - times.mean()) / max(np.abs(times - times.mean()).max(), 1.0)
    return ErrorShapes(arm.scatter[rows] / SIGMA_M, shift, along, times)


def _named(case: Case, arm: _LinearArm, observed: Observations, rng: np.random.Generator) -> NDArray[np.int_]:
    """Poses that the test of outliers names; the scale is estimated, as a shared error's is too."""
    single, model, free = observed.pose_by_pose(), cast(Model, arm), range(arm.parameters)
    known = case.known and observed.correlation is None
    start = np.zeros(arm.parameters)
    found = find_outliers(model, single, free, start, sigma_given=known, rng=rng)
    if not len(found.rows):
        return found.rows
    tail = tail_dof(linearized(model, single, found.fit.values, found.fit.free))
    if np.isinf(tail):
        return found.rows
    shape = NoiseDistribution("student", dof=tail)
    return find_outliers(model, single, free, start, sigma_given=known, rng=rng, shape=shape).rows


def _alarmed(
    case: Case,
    arm: _LinearArm,
    values: Array,
    covariance: Array,
    found: tuple[VarianceEstimate, int, LinearizedFit],
    small: SmallSample | None,
    rng: np.random.Generator,
) -> bool:
    """Whether a few new measurements of the unchanged arm are said to be of a changed one."""
    estimate, dof, linear = found
    rows = rng.permutation(case.poses)[: rng.integers(*_CHECKED)]
    made = errors(case, arm, rows, rng)
    shapes = _shapes(case, arm, rows)
    another_session = replace(shapes, along=np.ones(len(rows)))
    scale = 1.0 if case.known and not estimate.kinds else estimate.likelihood.scale
    observed = _weighed(case, rows, made, estimate.components, scale, another_session)
    tail = tail_dof(linear)
    prediction = CalibrationPrediction(
        cast(Arm, arm),
        values,
        tuple(range(arm.parameters)),
        covariance,
        None if case.known and not estimate.kinds else dof,
        tail_dof=None if np.isinf(tail) else tail,
    )
    if small is not None:
        moved = [
            tuple(
                _weighed(case, rows, made, *_moved(estimate.components, scale, name, sign * STEP), another_session)
                for sign in (1, -1)
            )
            for name in small.components.names
        ]
        pairs = cast(list[tuple[Observations, Observations]], moved)
        prediction, observed = with_estimated_noise(prediction, observed, small.components, pairs)
    held = VerificationProblem(prediction, observed).fitted(values, np.zeros((arm.parameters, 0)))
    return change_test(prediction, held).changed


def _weighed(
    case: Case,
    rows: NDArray[np.int_],
    made: Array,
    parts: Components,
    scale: float,
    shapes: ErrorShapes,
) -> Observations:
    """Errors as measurements weighed by some variances, ``scale`` that of the instrument."""
    points = made.reshape(len(rows), case.targets, 3)
    weight = np.full(points.shape[:2], 1 / (SIGMA_M * np.sqrt(scale)))
    return Observations(rows[:, None].astype(float), points, weight, correlation_of(shapes, parts))


def _moved(parts: Components, scale: float, name: str, step: float) -> tuple[Components, float]:
    """Components in units of the instrument's variance, and that variance, with one of them larger by e^step."""
    factor = float(np.exp(step))
    if name == "scale":
        return parts.times(1 / factor), scale * factor
    if name == "carry":
        odds = parts.carry / (1 - parts.carry) * factor
        return replace(parts, carry=odds / (1 + odds)), scale
    return parts.times(factor, (name,)), scale


def of_one_arm(name: str, seed: int, campaigns: int) -> dict[str, Array]:
    """Campaigns at one set of poses: an array over them by what was found."""
    case = CASES[name]
    arm = linear_arm(case, seed, case.poses)
    fresh = linear_arm(case, 1000 + seed, _FRESH).slopes.reshape(-1, arm.parameters)
    rows = [of_one_campaign(case, arm, fresh, rng) for rng in rng_for(seed, "noise").spawn(campaigns)]
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}


def study(name: str, campaigns: int) -> dict[str, float]:
    """One case over all pose sets."""
    case, each = CASES[name], -(-campaigns // _ARMS)
    with executors.local_executor() as pool:
        parts = list(pool.map(of_one_arm, [name] * _ARMS, range(_ARMS), [each] * _ARMS))
    found = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    covered = found["covered"].mean(axis=0)
    dof = 3 * case.targets * case.poses - len(covered)
    expected = 1.0 if case.known and not found["taken"].any() else dof / (dof - 2)
    result = {
        "campaigns": len(found["nees"]),
        "coverage_mean": covered.mean(),
        "coverage_least": covered.min(),
        "nees": found["nees"].mean() / expected,
        "realised_over_predicted": np.sqrt(found["realised"].mean() / found["predicted"].mean()),
        "variance_over_independent": float(np.mean(found["square"].mean(axis=0) / found["plain square"].mean(axis=0))),
        "beside_the_instrument": found["taken"].mean(),
        "outliers_named": found["named"].mean(),
        "verification_alarms": found["alarmed"].mean(),
    }
    return {key: float(value) for key, value in result.items()}


def answer(options: Options) -> Answer:
    """All cases, one after another."""
    results = {name: study(name, options.campaigns) for name in options.cases}
    sections = (Section(name, paragraphs(named_values(result))) for name, result in results.items())
    return Answer(results, Document("Do intervals and tests hold under other noise?", tuple(sections)))


if __name__ == "__main__":
    run_script("noise_models")
