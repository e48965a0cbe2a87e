"""Bad readings: how much a few poses that are off cost a calibration, and how often they are named.

Each campaign measures a virtual arm at random poses and moves 5 % of them in a random direction by a size
between 0.03 and 50 mm (log-uniform). It is identified without the poses that the test finds, judged on fresh
poses, and compared with the same campaign before anything was moved. Further campaigns with nothing but noise
tell the level of the test: how often it names anything there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shared import Answer, Document, Flag, Paragraph, paragraphs, run_script
from threadpoolctl import threadpool_limits

from lab.calibration.gauss_newton import Observations
from lab.calibration.identify import identify
from lab.calibration.statistics.linearized import NoiseDistribution
from lab.calibration.statistics.outliers import Outliers, find_outliers
from lab.calibration.weights import Noise
from lab.campaign.options import VirtualCampaign
from lab.campaign.robot import Robot, load_robot
from lab.campaign.virtual_robot import perturbed_arm
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.significance import CAMPAIGN_OUTLIERS
from lab.kinematics.serial.arm import SerialArm
from lab.noise.instruments import instrument
from lab.simulation.collisions import random_poses
from lab.simulation.tracking import track
from lab.simulation.true_robot import TrueRobot
from lab.studies import executors

INSTRUMENT = instrument("uniform-8um")
POSES, FRESH, BAD_SHARE = 60, 1000, 0.05
SMALLEST_M, SMALL_M, LARGEST_M = 0.03e-3, 0.05e-3, 50e-3
FIRST_CLEAN = 1_000_000  # seeds of the campaigns for the level, apart from the others


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    campaigns: int = 300
    """With bad readings."""
    clean: int = 3000
    """With nothing but noise."""
    estimated: Flag = False
    """Sigma is not known but estimated."""
    workers: int = 2
    """Processes."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Campaign:
    """What came out of one campaign; lengths in m.

    Attributes:
        sizes: ``(b,)`` of the rows that were moved; ``named`` says which of them were found.
        good_named: rows that were not moved and are named all the same.
        mean, clean, plain: fresh-pose means with the bad rows, without them, and with them but plain least squares.
    """

    sizes: Array
    named: NDArray[np.bool_]
    good_named: int
    mean: float
    clean: float
    plain: float


def answer(options: Options) -> Answer:
    """Both studies."""
    known = not options.estimated
    with executors.local_executor(options.workers) as pool:
        spoilt = list(pool.map(partial(bad_campaign, known=known), range(options.campaigns), chunksize=5))
        seeds = range(FIRST_CLEAN, FIRST_CLEAN + options.clean)
        clean = list(pool.map(partial(names_anything, known=known), seeds, chunksize=20))
    result = summary(spoilt, clean)
    return Answer(result, Document("How much do bad readings cost, and how often are they named?", table(result)))


def bad_campaign(seed: int, known: bool) -> Campaign:
    """One campaign with bad rows, and the same without."""
    with threadpool_limits(1):
        arm, real, data = measured(seed)
        rng = np.random.default_rng((seed, 1))
        bad = rng.choice(POSES, round(BAD_SHARE * POSES), replace=False)
        sizes = np.exp(rng.uniform(np.log(SMALLEST_M), np.log(LARGEST_M), len(bad)))
        away = rng.standard_normal((len(bad), 3))
        points = data.points.copy()
        points[bad, 0] += sizes[:, None] * away / np.linalg.norm(away, axis=1, keepdims=True)
        moved = replace(data, points=points)
        fresh = random_poses(real.robot, FRESH, rng_for(seed, "fresh"))
        exact = real.points(fresh, arm.targets)

        def mean(values: Array) -> float:
            return float(np.linalg.norm(arm.points(fresh, values) - exact, axis=2).mean())

        plain, found = outliers_of(arm, moved, known, seed)
        named = np.isin(bad, found.rows)
        clean, _ = outliers_of(arm, data, known, seed)
        return Campaign(
            sizes, named, len(found.rows) - int(named.sum()), mean(found.fit.values), mean(clean), mean(plain)
        )


def names_anything(seed: int, known: bool) -> bool:
    """Whether a campaign with nothing but noise names a pose."""
    with threadpool_limits(1):
        arm, _, data = measured(seed)
        return len(outliers_of(arm, data, known, seed)[1].rows) > 0


@cache
def nominal_robot() -> Robot:
    """The nominal robot, loaded once."""
    return load_robot("irb120")


def measured(seed: int) -> tuple[SerialArm, TrueRobot, Measurements]:
    """A virtual arm and what the tracker reads of it."""
    robot = nominal_robot()
    real = perturbed_arm(robot, VirtualCampaign(seed=seed))
    arm = robot.serial_arm(("p1",))
    joints = random_poses(real.robot, POSES, rng_for(seed, "poses"))
    return arm, real, track(real, joints, arm.targets, INSTRUMENT, rng_for(seed, "noise"))


def outliers_of(arm: SerialArm, data: Measurements, known: bool, seed: int) -> tuple[Array, Outliers]:
    """Plain least squares' values, and what is off."""
    plain = identify(arm, data, arm.nominal(nominal_robot().tool), Noise(INSTRUMENT if known else None))
    weight = 1 / INSTRUMENT.radial_m if known else 1.0
    seen = Observations(data.joints, data.points, np.full(data.seen.shape, weight))
    rng, shape = np.random.default_rng((seed, 2)), NoiseDistribution("uniform")
    return plain.values, find_outliers(
        arm, seen, plain.fit.free, plain.nominal_aligned, sigma_given=known, rng=rng, shape=shape
    )


def summary(spoilt: Sequence[Campaign], named_clean: Sequence[bool]) -> dict[str, Any]:
    """The figures of both studies; lengths in mm."""
    sizes, named = (np.concatenate([getattr(c, name) for c in spoilt] or [[]]) for name in ("sizes", "named"))
    mean, clean, plain = (1e3 * np.array([getattr(c, name) for c in spoilt]) for name in ("mean", "clean", "plain"))
    large = sizes >= SMALL_M
    return {
        "campaigns": len(spoilt),
        "mean_mm": mean.mean(),
        "clean_mm": clean.mean(),
        "plain_mm": plain.mean(),
        "above_clean": mean.mean() / clean.mean() - 1,
        "mean_of_ratios": (mean / clean).mean() - 1,
        "large": int(large.sum()),
        "large_named": named[large].mean(),
        "small": int((~large).sum()),
        "small_named": named[~large].mean(),
        "good_named": sum(c.good_named for c in spoilt),
        "nothing_but_noise": len(named_clean),
        "named_there": float(np.mean(named_clean)),
    }


def table(result: dict[str, Any]) -> tuple[Paragraph, ...]:
    """The figures in a few lines."""
    return paragraphs(
        [
            f"{result['campaigns']} campaigns of {POSES} poses, {BAD_SHARE:.0%} of them off by 0.03 to 50 mm",
            f"fresh-pose mean: {result['mean_mm']:.5f} mm, {result['clean_mm']:.5f} without the bad rows "
            f"({result['above_clean']:+.1%}; campaign by campaign {result['mean_of_ratios']:+.1%}), "
            f"{result['plain_mm']:.3f} by plain least squares",
            f"named: {result['large_named']:.1%} of {result['large']} bad rows of 0.05 mm and more, "
            f"{result['small_named']:.1%} of {result['small']} smaller ones; {result['good_named']} good rows",
            f"nothing but noise: {result['named_there']:.2%} of {result['nothing_but_noise']} campaigns name a row "
            f"(level {CAMPAIGN_OUTLIERS:.0%})",
        ]
    )


if __name__ == "__main__":
    run_script("bad_readings")
