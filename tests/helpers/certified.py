"""Virtual campaigns with a mistake, certified: how the stated uncertainty compares with the true errors."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import lab
from lab.certification.budget import propagated
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.library.certificate_result import Certificate
from lab.library.certify import certify
from lab.options.command_options import CertifyOptions

INSTRUMENT = "uniform-8um"
POSES, HELD = 60, 0.3
Points = Callable[[Array, int], Array]


@dataclass(frozen=True)
class Mistake:
    """What is wrong with a campaign.

    Attributes:
        points: what the file says of the measured points ``(n, k, 3)`` m, by the seed.
        options: of the virtual arm.
        stated: whether the instrument is stated.
        holdout: whether poses are held out; else the run is cross-validated.
        poses, targets: that are measured.
    """

    points: Points = lambda points, _: points
    options: tuple[tuple[str, float], ...] = ()
    stated: bool = False
    holdout: bool = True
    poses: int = POSES
    targets: tuple[str, ...] = ("p1",)


def step(size_m: float) -> Points:
    """Base or tracker moved half way, in a direction by chance."""
    return lambda points, seed: (
        points + size_m * (np.arange(len(points)) >= len(points) / 2)[:, None, None] * _way(seed)
    )


def drift(size_m: float) -> Points:
    """Base or tracker moved steadily, so far from first row to last, in a direction by chance."""
    return lambda points, seed: points + size_m * np.linspace(0, 1, len(points))[:, None, None] * _way(seed)


def _way(seed: int) -> Array:
    way = np.random.default_rng(seed).standard_normal(3)
    return np.asarray(way / np.linalg.norm(way))


MISTAKES = {
    "none": Mistake(),
    "none, stated": Mistake(stated=True),
    "none, cross-validated": Mistake(stated=True, holdout=False),
    "step of 3 mm": Mistake(step(3e-3)),
    "step of 0.1 mm": Mistake(step(1e-4)),
    "step of 0.03 mm, stated": Mistake(step(3e-5), stated=True),
    "drift of 1 mm": Mistake(drift(1e-3)),
    "drift of 0.05 mm, cross-validated": Mistake(drift(5e-5), stated=True, holdout=False),
    "harmonics": Mistake(options=(("harmonic_mrad", 0.2),)),
    "harmonics, stated": Mistake(options=(("harmonic_mrad", 0.2),), stated=True),
    "ripple": Mistake(options=(("ripple_mrad", 0.1),)),
    "coupling": Mistake(options=(("full_coupling_ppm", 300),), stated=True),
}


@dataclass(frozen=True)
class Outcome:
    """Of one campaign.

    Attributes:
        certificate: None where it was refused.
        covered: ``(h,)`` whether the true error at each pose that was not fitted is within U.
        over_today: U over what the quantities of a budget without stability and lack of fit make.
    """

    certificate: Certificate | None
    verdict: str
    covered: Array
    over_today: float


def outcome(mistake: Mistake, seed: int, folder: Path) -> Outcome:
    """Simulate, identify by geometry, and certify a campaign of an IRB 120."""
    day, exact = (
        lab.simulate(
            "irb120", poses=mistake.poses, targets=mistake.targets, seed=seed, instrument=name, **dict(mistake.options)
        ).measurements
        for name in (INSTRUMENT, "exact")
    )
    rows = replace(day, points=mistake.points(day.points, seed))
    options = {"instrument": INSTRUMENT} if mistake.stated else {}
    result = lab.identify(rows, seed=seed, **options, **({"holdout": HELD} if mistake.holdout else {}))
    folder.mkdir()
    result.write(folder)
    asked = CertifyOptions(folder, tolerance_mm=1e3, accept_edited=True)
    try:
        found = certify(asked)
    except LabError:
        return Outcome(None, result.verdict.word, np.ones(0), np.nan)
    fresh = _not_fitted(exact, result.fitted) if mistake.holdout else exact
    calibrated = found.calibrated
    predicted = calibrated.estimate.arm.points(
        fresh.inputs(calibrated.estimate.arm.conditions), calibrated.estimate.values
    )
    off = np.linalg.norm(predicted - fresh.points, axis=2)[:, 0]  # of the first target, which a certificate is of
    budget = found.budgets[0]
    kept = [line.quantity for line in budget.lines if line.quantity.name not in ("stability", "lack of fit")]
    positions = kept[0].columns[:, :, 0]  # of distances only
    today = propagated("position", kept, positions, rng_for(0, "null")).expanded_m
    return Outcome(found, result.verdict.word, off <= budget.expanded_m, budget.propagated_m / today)


def _not_fitted(rows: Measurements, fitted: Measurements) -> Measurements:
    return rows.without(fitted.ids)
