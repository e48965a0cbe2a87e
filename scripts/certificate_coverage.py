"""Does a certificate's 95 % cover the true error? Virtual campaigns with every error that its budget states.

Each campaign draws the tracker's systematic errors, how the reflector is placed, its noise, the robot's scatter and its
temperature from the distributions of the budget, is fitted by least squares, and is asked for a position, and for a
distance between two, at poses of the workspace that were not measured. The noise is known to the fit, or estimated from
few poses: then each campaign has an expanded uncertainty of its own. A budget that leaves the systematic errors out
shows what they are worth.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from shared import Answer, Document, Flag, Section, named_values, paragraphs, run_script

from lab.calibration.gauss_newton import Observations, fit
from lab.calibration.observation import observation_of
from lab.campaign.options import VirtualCampaign
from lab.campaign.robot import load_robot
from lab.campaign.virtual_robot import perturbed_arm
from lab.certification.budget import (
    MEASURANDS,
    InputQuantity,
    Propagation,
    RandomErrors,
    RandomScatter,
    propagated,
    quantities_of,
    temperature_of,
)
from lab.core.linear_model import whitening
from lab.core.probability import Uncertain
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.gauge import base_set
from lab.kinematics.serial.arm import SerialArm
from lab.noise.instruments import Instrument, TrackerErrors
from lab.render.terminal import status
from lab.simulation.collisions import random_poses

Case = Literal["known noise", "estimated noise", "systematic errors left out"]
CASES: tuple[Case, ...] = ("known noise", "estimated noise", "systematic errors left out")
MICRON = 1e-6
ERRORS = TrackerErrors(
    transit_offset=Uncertain(5 * MICRON),
    transit_tilt=Uncertain(5 * MICRON, dof=8),
    collimation=Uncertain(5 * MICRON),
    beam_offset=Uncertain.within(5 * MICRON),
    elevation_index=Uncertain(5 * MICRON),
    azimuth_eccentricity=Uncertain.within(8 * MICRON, "arcsine"),
    elevation_eccentricity=Uncertain.within(8 * MICRON, "arcsine"),
    range_offset=Uncertain.within(10 * MICRON, "triangular"),
    range_scale=Uncertain(1 * MICRON),
    air_temperature=Uncertain.within(1.0),
    temperature_gradient=Uncertain.within(1.0),
    centring_depth=Uncertain.within(6 * MICRON),
    centring_lateral=Uncertain.within(4 * MICRON),
    nest=Uncertain(3 * MICRON),
)
PLACED = TrackerErrors(centring_lateral=ERRORS.centring_lateral, nest=ERRORS.nest)
_TRACKER = Instrument("tracker", "spherical", 2e-6, 0.5e-6, 7.5e-6, 3e-6, errors=ERRORS)
TRACKERS = {
    "known noise": _TRACKER,
    "estimated noise": Instrument("tracker", "spherical", 15e-6, 0.0, 15e-6, 0.0, errors=ERRORS),
    "systematic errors left out": _TRACKER,
}
POSES = {"known noise": 40, "estimated noise": 14, "systematic errors left out": 40}
SCATTER_M = 2e-6  # of the robot, per axis
KELVIN, EXPANSION_PER_K = Uncertain.within(1.0), 12e-6
ASKED = 10  # positions of each campaign
_SPEC = "spec"


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    robots: int = 20
    """Perturbed arms, each before a tracker of its own."""
    draws: int = 500
    """Campaigns of each."""
    cases: tuple[Case, ...] = field(default_factory=lambda: CASES)
    """Whether the noise is known to the fit, and what the budget states."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class _Bench:
    """A perturbed arm before a tracker, measured in some poses.

    Attributes:
        truth: ``(p,)`` its parameters; ``free`` of them are identified.
        poses, asked: joint positions ``(n, joints)`` that are measured, ``(m, joints)`` that are asked for.
    """

    arm: SerialArm
    truth: Array
    free: tuple[int, ...]
    poses: Array
    asked: Array
    case: Case

    @property
    def foot(self) -> Array:
        """``(3,)`` m."""
        return self.truth[[self.arm.names.index(f"base.{axis}") for axis in "xyz"]]

    def measured(self, rng: np.random.Generator) -> Array:
        """Points ``(n, k, 3)`` m of one campaign."""
        device = TRACKERS[self.case]
        exact = self.arm.points(self.poses, self.truth)
        standing = exact + SCATTER_M * rng.standard_normal(exact.shape)
        return np.asarray(device.sample(standing, rng) + device.errors.sample(standing, rng))

    def observations(self, points: Array) -> Observations:
        """Weighed by the tracker's noise, or all alike."""
        if self.case == "estimated noise":
            return Observations(self.poses, points, np.ones(points.shape[:2]))
        return Observations(self.poses, points, whitening(TRACKERS[self.case].covariance(points)))

    def quantities(
        self, observed: Observations, values: Array, residual: float
    ) -> tuple[Propagation, list[InputQuantity]]:
        """The budget's, as a certificate has them.

        Args:
            residual: root of the mean square of the whitened residuals.
        """
        found = Propagation.of(observation_of(self.arm), observed, values, self.free)
        covariance = found.gain @ found.gain.T
        robot = RandomScatter(SCATTER_M, np.inf, _SPEC)
        if self.case != "estimated noise":
            sigma = float(np.sqrt(np.mean(np.linalg.inv(observed.whiten) ** 2) * 3))
            chance = RandomErrors(covariance, RandomScatter(sigma, np.inf, _SPEC), "in the noise", robot, False, None)
        else:
            dof = observed.points.size - len(self.free)
            noise = RandomScatter(residual, dof, _SPEC)
            chance = RandomErrors(residual**2 * covariance, noise, "in the residuals", robot, True, None)
        stated = PLACED if self.case == "systematic errors left out" else TRACKERS[self.case].errors
        known = quantities_of(found, stated, _SPEC, chance)
        return found, [*known, temperature_of(found, self.foot, KELVIN, EXPANSION_PER_K)]


def of_one_robot(case: Case, seed: int, draws: int) -> dict[str, Array]:
    """Whether each campaign's 95 % covered, ``(draws, ASKED)`` of each measurand, and expanded over true error."""
    bench = _bench(case, seed)
    rows: list[dict[str, Array]] = []
    expanded: dict[str, float] = {}
    for i, rng in enumerate(rng_for(seed, "noise").spawn(draws)):
        observed = bench.observations(bench.measured(rng))
        solved = fit(bench.arm, observed, bench.free, bench.truth, tolerance_m=1e-8)
        if case == "estimated noise" or not i:
            left = observed.apply(observed.points - bench.arm.points(bench.poses, solved.values))
            residual = float(np.sqrt((left**2).sum() / (left.size - len(bench.free))))
            found, quantities = bench.quantities(observed, solved.values, residual)
            expanded = {
                each: propagated(each, quantities, found.positions, rng_for(0, "null")).expanded_m
                for each in MEASURANDS
            }
        rows.append(_covered(bench, solved.values, expanded, rng))
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}


def _bench(case: Case, seed: int) -> _Bench:
    robot = load_robot("irb120")
    real = perturbed_arm(robot, VirtualCampaign(seed=seed))
    arm = robot.serial_arm(("p1", "p2", "p3"))
    truth = real.truth(arm.targets)
    assert truth is not None
    poses = random_poses(real.robot, POSES[case], rng_for(seed, "poses"))
    asked = arm.structure_joints(2 * ASKED, rng_for(seed, "fresh"))
    return _Bench(arm, truth.values, base_set(arm, truth.values).identifiable, poses, asked, case)


def _covered(bench: _Bench, values: Array, expanded: dict[str, float], rng: np.random.Generator) -> dict[str, Array]:
    """At positions, and at distances between pairs of them: is the true error within the expanded uncertainty?"""
    exact = bench.arm.points(bench.asked, bench.truth)[:, 0]
    grown = exact + EXPANSION_PER_K * KELVIN.sample(rng, 1) * (exact - bench.foot)
    there = grown + SCATTER_M * rng.standard_normal(grown.shape)
    said = bench.arm.points(bench.asked, values)[:, 0]
    off = np.linalg.norm(said - there, axis=1)[:ASKED]
    apart = [np.linalg.norm(points[:ASKED] - points[ASKED:], axis=1) for points in (said, there)]
    errors = {"position": off, "distance": np.abs(apart[0] - apart[1])}
    return {name: error <= expanded[name] for name, error in errors.items()}


def study(case: Case, options: Options) -> dict[str, float]:
    """One case over all robots and draws: how often the error is covered, of one position or distance of a campaign."""
    parts = []
    with status(case) as stage:
        for seed in range(options.robots):
            stage(f"robot {seed + 1} of {options.robots}")
            parts.append(of_one_robot(case, seed, options.draws))
    result: dict[str, float] = {"campaigns": options.robots * options.draws}
    for name in MEASURANDS:
        covered = np.concatenate([part[name] for part in parts])
        one = covered[np.arange(len(covered)), np.arange(len(covered)) % ASKED]
        result[f"{name}_covered"] = float(one.mean())
        result[f"{name}_standard_error"] = float(np.sqrt(one.mean() * (1 - one.mean()) / len(one)))
        result[f"{name}_covered_of_all_{ASKED}"] = float(covered.mean())
    return result


def answer(options: Options) -> Answer:
    """All cases, one after another."""
    results: dict[str, dict[str, float]] = {case: study(case, options) for case in options.cases}
    sections = (Section(case, paragraphs(named_values(result))) for case, result in results.items())
    return Answer(results, Document("Does a certificate's 95 % cover the true error?", tuple(sections)))


if __name__ == "__main__":
    run_script("certificate_coverage")
