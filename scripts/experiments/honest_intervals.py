"""Are the intervals honest? Thousands of virtual campaigns against the truth, for every kind of noise.

Robots with perturbed bodies, random poses, the default target; each robot is measured many times. Per case: how often
95 % intervals hold (every parameter of the canonical gauge), NEES a parameter, the estimator's variance against the
Cramér-Rao bound, and how often the test of adequacy rejects a true model, or one that lacks a compliance.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy import stats
from shared import Answer, Document, Flag, Section, named_values, paragraphs, run_script

from lab.calibration.identification import identify
from lab.calibration.observation import observation_of
from lab.calibration.statistics.goodness_of_fit import goodness_of_fit, isotropy, sandwich
from lab.calibration.statistics.linearized import NoiseDistribution, linearized
from lab.calibration.weights import Noise, weigh
from lab.core.random import rng_for
from lab.library.virtual_arm import perturbed_arm
from lab.noise.instruments import Instrument, instrument
from lab.options.option_groups import Effects
from lab.options.virtual_campaign import VirtualCampaign
from lab.prediction.validation import compare_with_truth, error_tangent
from lab.robots.load_robot import load_robot
from lab.simulation.collisions import random_poses
from lab.simulation.tracking import track
from lab.studies import executors

GAUSSIAN = Instrument("gaussian-8um", "gaussian", radial_m=8e-6 / np.sqrt(3))
NOISES = {
    "Gaussian, known": (GAUSSIAN, Noise(GAUSSIAN)),
    "Gaussian, estimated": (GAUSSIAN, Noise()),
    "uniform, known": (instrument("uniform-8um"), Noise(instrument("uniform-8um"))),
    "spherical, weighted": (instrument("leica-at960"), Noise(instrument("leica-at960"))),
    "spherical taken for isotropic": (instrument("leica-at960"), Noise()),
}
COMPLIANT = "compliance missing"


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    robots: int = 100
    """Perturbed arms, each before a tracker of its own."""
    draws: int = 100
    """Campaigns of each."""
    poses: int = 30
    """Random poses of a robot."""
    cases: tuple[str, ...] = field(default_factory=lambda: (*NOISES, COMPLIANT))
    """Which kinds of noise."""
    json: Flag = False
    """Print one JSON object."""


def of_one_robot(case: str, seed: int, options: Options) -> dict[str, np.ndarray]:
    """All campaigns of one robot: an array over the draws by what was found."""
    robot = load_robot("irb120")
    arm = robot.arm(("p1",))
    device, noise = NOISES.get(case, NOISES["Gaussian, known"])
    effects = Effects(stiffness_nm_per_rad=1e5) if case == COMPLIANT else Effects()
    real = perturbed_arm(robot, VirtualCampaign(seed=seed, effects=effects))
    truth, nominal = real.truth(arm.targets), arm.nominal(robot.tool)
    assert truth is not None
    poses = random_poses(real.robot, options.poses, rng_for(seed, "poses"))
    shape = NoiseDistribution("uniform") if device.kind == "uniform" else NoiseDistribution()
    exact = track(real, poses, arm.targets, instrument("exact"), rng_for(seed, "noise"))
    weights = weigh(observation_of(arm), exact, Noise(device))[0]
    bound = None
    rows = []
    for draw in rng_for(seed, "noise").spawn(options.draws):
        errors = device.errors.sample(exact.points, draw.spawn(1)[0])
        data = replace(exact, points=device.sample(exact.points, draw) + errors)
        found = identify(arm, data, nominal, noise)
        compared = compare_with_truth(found, truth)
        free = list(found.fit.free)
        if bound is None:
            rates = weights.apply(arm.observe(poses, truth.values)[1][..., free])
            local = error_tangent(arm, truth.values)[np.ix_(free, free)]
            bound = np.diag(local @ np.linalg.inv(rates.T @ rates) @ local.T)
        seen, known = weigh(observation_of(arm), data, noise)
        judged = goodness_of_fit(arm, seen, found.fit, sigma_given=known, shape=shape)
        row = {
            "covered": np.abs(compared.z) <= found.half_width_95,
            "nees": compared.nees_per_parameter,
            "square": compared.error**2 / bound,
            "rejected": judged.outcome == "failed",
            "freedom": found.dof,
        }
        if not known:
            wide = sandwich(linearized(arm, seen, found.values, found.fit.free))
            reach = stats.t.ppf(0.975, wide.dof) * np.sqrt(np.diag(wide.covariance))
            row |= {"covered by sandwich": np.abs(compared.error) <= reach}
            row |= {"said": isotropy(arm, seen, found.fit).outcome == "failed"}
        rows.append(row)
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}


def study(case: str, options: Options) -> dict[str, float]:
    """One case over all robots and draws."""
    with executors.local_executor() as pool:
        seeds = range(options.robots)
        parts = list(pool.map(of_one_robot, [case] * options.robots, seeds, [options] * options.robots))
    found = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    dof = float(found["freedom"][0])
    expected = 1.0 if NOISES.get(case, NOISES["Gaussian, known"])[1].instrument else dof / (dof - 2)
    covered, ratio = found["covered"].mean(axis=0), found["square"].mean(axis=0)
    result = {
        "campaigns": len(found["nees"]),
        "coverage_least": covered.min(),
        "coverage_mean": covered.mean(),
        "coverage_largest": covered.max(),
        "nees": found["nees"].mean() / expected,
        "variance_over_bound_least": ratio.min(),
        "variance_over_bound_mean": ratio.mean(),
        "variance_over_bound_largest": ratio.max(),
        "inadequate": found["rejected"].mean(),
    }
    if "said" in found:
        result["anisotropy_said"] = found["said"].mean()
        wide = found["covered by sandwich"].mean(axis=0)
        result |= {"sandwich_least": wide.min(), "sandwich_mean": wide.mean(), "sandwich_largest": wide.max()}
    return {key: float(value) for key, value in result.items()}


def answer(options: Options) -> Answer:
    """All cases, one after another."""
    results = {case: study(case, options) for case in options.cases}
    sections = (Section(case, paragraphs(named_values(result))) for case, result in results.items())
    return Answer(results, Document("Are the intervals honest?", tuple(sections)))


if __name__ == "__main__":
    run_script("honest_intervals")
