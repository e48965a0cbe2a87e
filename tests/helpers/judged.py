"""Small calibrations whose quality is known, for the tests of the verdict."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from helpers.pose_data import off_by
from helpers.robots import IRB120
from lab.calibration.fit_options import PLAIN, FitOptions
from lab.calibration.gauss_newton import Observations
from lab.calibration.identification import Identification, identify
from lab.calibration.observation import observation_of
from lab.calibration.statistics.goodness_of_fit import goodness_of_fit
from lab.calibration.weights import Noise, weigh
from lab.core.checks import Check
from lab.core.measurements import measured
from lab.core.se3 import Array
from lab.kinematics.model import Model
from lab.kinematics.serial.serial_arm import SerialArm
from lab.prediction.regions import Region, measured_region
from lab.prediction.validation import Errors, Validation, errors_at

ARM = SerialArm(IRB120.chain)
SIGMA_M = 10e-6


@dataclass(frozen=True)
class Case:
    """A fit, the test of its goodness, its validation, and poses like the measured ones."""

    found: Identification
    goodness: Check
    validation: Validation
    poses: Region


def campaign(
    poses: int = 40,
    seed: int = 0,
    *,
    model: Model = ARM,
    range_share: float = 1.0,
    validated_share: float = 1.0,
    options: FitOptions = PLAIN,
    sigma_m: float = SIGMA_M,
    known: bool = True,
    joints_as: Callable[[Array], Array] = lambda joints: joints,
    moved_as: Callable[[Array], Array] = lambda joints: joints,
    points_as: Callable[[Array, np.random.Generator], Array] = lambda points, rng: points,
    change: dict[str, float] | None = None,
) -> Case:
    """An IRB 120 whose links are off by usual tolerances, measured in random poses, identified, and validated.

    Args:
        model: that is fitted; the measured arm is always an IRB 120.
        range_share, validated_share: of each joint's range in which it is measured and validated.
        options: what is asked of the identification.
        sigma_m: noise of a coordinate; without it 10 um are given to the fit where the noise is ``known``.
        joints_as: what the file says of the joint positions ``(n, joints)``.
        moved_as: where the arm was measured, of random joint positions.
        points_as: what it says of the points ``(n, 3)``.
        change: further errors of links, by name.
    """
    rng = np.random.default_rng(seed)
    true = off_by(ARM, ARM.nominal(), rng)
    true[:3] += (0.5, -0.3, 0.2)
    for name, size in (change or {}).items():
        true[ARM.names.index(name)] += size
    chain = IRB120.chain
    middle, joints = (chain.lower + chain.upper) / 2, chain.random_joints(poses, rng)
    joints = moved_as(middle + range_share * (joints - middle))
    points = ARM.points(joints, true) + sigma_m * rng.normal(size=(poses, 1, 3))
    points[:, 0] = points_as(points[:, 0], rng)
    data = measured(chain.joint_names, joints_as(joints), ARM.targets, points)
    noise = Noise(sigma_m=sigma_m or SIGMA_M) if known else Noise()
    found = identify(model, data, model.nominal(), noise, options)
    seen, weighted_by = weigh(observation_of(model), data, noise)
    goodness = goodness_of_fit(
        model, Observations(seen.inputs, seen.points, seen.whiten), found.fit, sigma_given=weighted_by
    )
    elsewhere = middle + validated_share * (chain.random_joints(200, rng) - middle)
    errors = errors_at(found, joints_as(elsewhere), ARM.points(elsewhere, true))
    turning = ~np.array(chain.prismatic, dtype=np.bool_)
    return Case(found, goodness, Validation("fresh", errors), measured_region(found, seen, turning))


def errors(before_mm: Array, after_mm: Array) -> Errors:
    """Errors of single points, given in mm."""
    return Errors(1e-3 * np.asarray(before_mm)[:, None], 1e-3 * np.asarray(after_mm)[:, None])
