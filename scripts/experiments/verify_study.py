"""Does a verification notice what has moved, and name it? Virtual arms, each calibrated, then measured at new poses.

Cases: nothing has changed; the base shifted in a random direction; the tool point moved in a random direction; the
zero of axis 2 off. Each arm has bodies of its own, 30 to 50 random poses to be calibrated by, and a few new ones. A
second part asks many more files of unchanged arms whether the test has its level: by Gaussian noise, known and
estimated, and by the uniform noise of the usual tracker.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from shared import Answer, Document, Flag, Section, named_values, paragraphs, run_script

from lab.calibration.identify import Identification, identify
from lab.calibration.observation import observation_of
from lab.calibration.weights import Noise, weigh
from lab.campaign.options import VirtualCampaign
from lab.campaign.robot import load_robot
from lab.campaign.virtual_robot import perturbed_arm
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.significance import VERIFICATION
from lab.kinematics.serial.arm import SerialArm
from lab.noise.instruments import Instrument, instrument
from lab.simulation.collisions import random_poses
from lab.simulation.tracking import track
from lab.simulation.true_robot import TrueRobot, TrueSerialRobot
from lab.studies import executors
from lab.verification.prediction import CalibrationPrediction
from lab.verification.test import Verified, verify

TARGETS = ("p1",)
UNIFORM = instrument("uniform-8um")
GAUSSIAN = Instrument("gaussian-8um", "gaussian", radial_m=UNIFORM.radial_m)
LEVELS = {"Gaussian, known": (GAUSSIAN, True), "Gaussian, estimated": (GAUSSIAN, False), "uniform": (UNIFORM, True)}
MOVED = {"unchanged": None, "base": "base", "tool": "tool", "axis 2": "joint"}


@dataclass(frozen=True)
class Options:
    """How much to simulate, and how far things move."""

    arms: int = 300
    """Perturbed arms, each before a tracker of its own."""
    poses: int = 8
    """New poses of each."""
    base_mm: float = 0.1
    """How far the base shifts."""
    tool_mm: float = 0.2
    """How far the tool point moves."""
    offset_mrad: float = 0.1
    """How far the zero of axis 2 is off."""
    files: int = 30
    """Files of each arm, of 3 to 12 poses, to learn the level by."""
    json: Flag = False
    """Print one JSON object."""


def prediction_of(found: Identification) -> CalibrationPrediction:
    """The predicted errors after an identification by points."""
    dof = None if found.sigma_given else found.dof
    assert isinstance(found.model, SerialArm)
    return CalibrationPrediction(found.model, found.values, found.fit.free, found.covariance, dof)


def calibrated(real: TrueRobot, seed: int, device: Instrument, known: bool) -> Identification:
    """The arm, identified at 30 to 50 random poses."""
    robot, rng = load_robot("irb120"), rng_for(seed, "noise")
    arm = robot.arm(TARGETS)
    poses = random_poses(real.robot, 30 + 5 * (seed % 5), rng_for(seed, "poses"))
    data = track(real, poses, TARGETS, device, rng)
    return identify(arm, data, arm.nominal(robot.tool), Noise(device) if known else Noise())


def checked(
    found: Identification, real: TrueRobot, poses: Array, device: Instrument, rng: np.random.Generator
) -> Verified:
    """A verification by what the tracker sees of the arm at some new poses."""
    data = track(real, poses, TARGETS, device, rng)
    noise = Noise(device) if found.sigma_given else Noise(sigma_m=found.sigma_m)
    return verify(prediction_of(found), weigh(observation_of(found.model), data, noise)[0])


def changed(real: TrueRobot, case: str, options: Options, rng: np.random.Generator) -> TrueRobot:
    """The arm after something has moved."""
    assert isinstance(real, TrueSerialRobot)
    direction = rng.standard_normal(3)
    direction /= np.linalg.norm(direction)
    if case == "axis 2":
        off = np.eye(len(real.joint_offset))[1] * options.offset_mrad / 1e3
        return replace(real, joint_offset=real.joint_offset + off)
    model = copy.deepcopy(real.model)
    if case == "tool":
        model.site(TARGETS[0]).pos[:] += direction * options.tool_mm / 1e3
    if case == "base":
        return replace(real, T_world_tracker=_shifted(real.T_world_tracker, direction * options.base_mm / 1e3))
    return replace(real, model=model)


def _shifted(T_world_tracker: Array, shift: Array) -> Array:
    """The tracker moved against the base, which is the same as the base against the tracker."""
    moved = T_world_tracker.copy()
    moved[:3, 3] += shift
    return moved


def of_one_arm(seed: int, options: Options) -> dict[str, Verified]:
    """All cases of one arm."""
    real = perturbed_arm(load_robot("irb120"), VirtualCampaign(seed=seed))
    found, rng = calibrated(real, seed, UNIFORM, True), rng_for(seed, "fresh")
    poses = random_poses(real.robot, options.poses, rng)
    return {case: checked(found, changed(real, case, options, rng), poses, UNIFORM, rng) for case in MOVED}


def rejected(seed: int, options: Options) -> dict[str, int]:
    """How many files of an unchanged arm are not called good, by the noise."""
    real = perturbed_arm(load_robot("irb120"), VirtualCampaign(seed=seed))
    rng, counts = rng_for(seed, "fresh"), {}
    for name, (device, known) in LEVELS.items():
        found = calibrated(real, seed, device, known)
        sizes = rng.integers(3, 13, options.files)
        files = (checked(found, real, random_poses(real.robot, int(n), rng), device, rng) for n in sizes)
        counts[name] = sum(not each.good for each in files)
    return counts


def summary(case: str, found: Sequence[Verified]) -> dict[str, float]:
    """Shares of the arms."""
    right = MOVED[case]
    if right is None:
        return {"good": float(np.mean([each.good for each in found]))}
    named = [each.moved == (right,) for each in found]
    unsure = [len(each.moved) > 1 and right in each.moved for each in found]
    wrong = [bool(each.moved) and right not in each.moved for each in found]
    return {
        "noticed": float(np.mean([not each.good for each in found])),
        "named": float(np.mean(named)),
        "cannot_tell": float(np.mean(unsure)),
        "wrong": float(np.mean(wrong)),
        "nothing_explains": float(np.mean([not each.good and not each.moved for each in found])),
    }


def answer(options: Options) -> Answer:
    """All cases over all arms, and the level."""
    with executors.local_executor() as pool:
        each = [options] * options.arms
        arms = list(pool.map(of_one_arm, range(options.arms), each, chunksize=8))
        counts = list(pool.map(rejected, range(options.arms), each, chunksize=8)) if options.files else []
    results = {case: summary(case, [arm[case] for arm in arms]) for case in MOVED}
    total = options.arms * options.files
    if counts:
        results["level"] = {"meant": VERIFICATION, "files": total}
        results["level"] |= {name: sum(count[name] for count in counts) / total for name in LEVELS}
    sections = (Section(case, paragraphs(named_values(result))) for case, result in results.items())
    return Answer(results, Document("Does a verification notice what has moved, and name it?", tuple(sections)))


if __name__ == "__main__":
    run_script("verify_study")
