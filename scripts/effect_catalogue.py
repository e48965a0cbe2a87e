"""Are effects found that virtual arms have, alone and in pairs, and nothing in rigid arms, whatever their noise?

Each arm has its geometry off and carries 0 or 3 kg at 80 random poses, one target seen with 8 µm of uniform noise,
whose size is estimated. The rows have payload, temperature and approach, and no time: a drift is told by the order of
rows. ``--model auto`` is what chooses, noise model and all. What it makes of fresh poses is compared with the fit that
is told which effects there are: the floor. Rigid arms have five kinds of noise, as in ``scripts/noise_models.py``.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
from shared import Answer, Document, Flag, paragraphs, run_script
from threadpoolctl import threadpool_limits

from lab.calibration.fitted import Fitted
from lab.calibration.fitter import FitOptions, Fitter
from lab.calibration.identify import Identification
from lab.calibration.pipeline import FITTING, run_steps
from lab.calibration.weights import Noise
from lab.campaign.option_groups import Effects
from lab.campaign.options import VirtualCampaign
from lab.campaign.robot import SerialRobot, load_virtual
from lab.campaign.virtual_robot import draw_conditions, perturbed_arm
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.effects.effect import PAYLOAD, TEMPERATURE, approach_of
from lab.kinematics.effects.registry import CAMPAIGN_SPECIFIC
from lab.noise.instruments import instrument
from lab.sensors.points import PointSensor
from lab.simulation.collisions import random_poses
from lab.simulation.tracking import recorded, track
from lab.simulation.true_robot import TrueRobot
from lab.studies import executors

POSES, FRESH, PAYLOADS_KG, DEVICE = 80, 300, (0.0, 3.0), "uniform-8um"
GEAR_RATIO = np.array([-121.0, 121.0, 101.0, -100.0, 80.0, 50.0])  # assumed
EFFECTS: dict[str, dict[str, Any]] = {  # by the group that is to be found: the options that make it
    "hysteresis": {"hysteresis_mrad": 0.2},
    "compensator": {"compensator_mrad": 0.3},
    "hardening": {"hardening_mrad": 0.3},
    "drift": {"drift_mm_per_h": 0.1, "drift_mrad_per_h": 0.05},
    "expansion": {"expansion_ppm_per_k": 20.0},
    "thermal_zeros": {"thermal_zero_mrad_per_k": 0.02},
    "waves": {"ripple_mrad": 0.2},
}
NOISES: dict[str, tuple[dict[str, Any], tuple[str, ...], int]] = {  # options, targets, poses
    "independent": ({}, ("p1",), 80),
    "joint scatter": ({"repeatability_mrad": 0.03}, ("p1", "p2", "p3"), 40),
    "AR(1) 0.9": ({"noise_correlation": 0.9}, ("p1",), 80),
    "drift 60 µm": ({"drift_mm_per_h": 0.06}, ("p1",), 80),
    "Student t 3": ({"noise_tail_dof": 3.0}, ("p1",), 80),
}


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    arms: int = 100
    """Arms with each effect, and with each pair of them."""
    rigid: int = 1000
    """Rigid arms under each kind of noise."""
    effects: tuple[str, ...] = field(default_factory=lambda: tuple(EFFECTS))
    """Which effects."""
    noises: tuple[str, ...] = field(default_factory=lambda: tuple(NOISES))
    """Which kinds of noise."""
    no_pairs: Flag = False
    """Leave out the pairs of effects."""
    workers: int = 2
    """Processes."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Found:
    """What came out for one arm; lengths in m.

    Attributes:
        missing: groups that it has and that were not taken.
        extras: groups that were taken and that it has not.
        after, floor: mean error at fresh poses of what was chosen, and of the fit that knows the groups.
    """

    missing: tuple[str, ...]
    extras: tuple[str, ...]
    after: float
    floor: float


@cache
def geared_robot() -> SerialRobot:
    """The nominal robot, with gear ratios in its table."""
    robot = load_virtual("irb120")
    assert isinstance(robot, SerialRobot)
    chain = replace(robot.model.chain, gear_ratio=GEAR_RATIO)
    return replace(robot, model=replace(robot.model, chain=chain))


def groups_of(effect: str) -> tuple[str, ...]:
    """The groups that fit an effect."""
    if effect != "waves":
        return (effect,)
    return tuple(f"joint{i}.harmonic{abs(ratio):.0f}" for i, ratio in enumerate(GEAR_RATIO.tolist(), start=1))


def flexible_arm(effects: Sequence[str], seed: int) -> Found:
    """One arm with some effects."""
    with threadpool_limits(1):
        options = {name: size for effect in effects for name, size in EFFECTS[effect].items()}
        campaign, real, data = _measured(options, ("p1",), POSES, seed)
        fitter, wanted = _fitter(data, ("p1",), seed), [group for effect in effects for group in groups_of(effect)]
        chosen = run_steps(Fitted(fitter, data), FITTING)
        told = fitter.identified(data, wanted)[0]
        fresh = _fresh(real, campaign)
        return Found(
            tuple(group for group in wanted if group not in chosen.groups),
            tuple(group for group in chosen.groups if group not in wanted),
            _error(chosen.identification, chosen.groups, fresh),
            _error(told, wanted, fresh),
        )


def rigid_arm(noise: str, seed: int) -> tuple[str, ...]:
    """The groups taken for a rigid arm under one kind of noise; a base that drifts may be called so."""
    with threadpool_limits(1):
        options, targets, poses = NOISES[noise]
        _, _, data = _measured(options, targets, poses, seed)
        allowed = ("drift",) if "drift_mm_per_h" in options else ()
        fitted = run_steps(Fitted(_fitter(data, targets, seed), data), FITTING)
        return tuple(group for group in fitted.groups if group not in allowed)


def _measured(
    options: dict[str, Any], targets: tuple[str, ...], poses: int, seed: int
) -> tuple[VirtualCampaign, TrueRobot, Measurements]:
    robot = geared_robot()
    effects = Effects(**{"payload_kg": PAYLOADS_KG, **options})
    campaign = VirtualCampaign(seed=seed, poses=poses, effects=effects)
    real = perturbed_arm(robot, campaign)
    joints = random_poses(robot.model, poses, rng_for(seed, "poses"))
    asked = (PAYLOAD, TEMPERATURE, *map(approach_of, robot.chain.joint_names))
    conditions = draw_conditions(real, campaign, poses, rng_for(seed, "conditions"), asked)
    data = track(real, joints, targets, instrument(DEVICE), rng_for(seed, "noise"), conditions=conditions)
    kept = {name: column for name, column in data.conditions.items() if name in asked}
    return campaign, real, replace(data, conditions=kept)


def _fitter(data: Measurements, targets: tuple[str, ...], seed: int) -> Fitter:
    return Fitter(geared_robot(), targets, data, PointSensor(), Noise(), FitOptions(search=True), seed)


def _fresh(real: TrueRobot, campaign: VirtualCampaign) -> Measurements:
    """Where the arm's target is at fresh poses, on another day: what drifted has come to rest where it began."""
    joints = random_poses(real.robot, FRESH, rng_for(campaign.seed, "fresh"))
    rng = rng_for(campaign.seed, "fresh").spawn(1)[0]
    there = draw_conditions(real, campaign, FRESH, rng, (PAYLOAD, TEMPERATURE))
    there = {name: column for name, column in there.items() if name in (PAYLOAD, TEMPERATURE)}
    there |= {approach_of(name): np.zeros(FRESH) for name in real.robot.chain.joint_names}
    return recorded(real, joints, ("p1",), real.points(joints, ("p1",), there), there)


def _error(found: Identification, groups: Sequence[str], fresh: Measurements) -> float:
    """Mean error (m) at fresh poses."""
    lasting = [group for group in groups if group not in CAMPAIGN_SPECIFIC]
    arm = geared_robot().arm_with(("p1",), lasting)
    known = dict(zip(found.model.names, found.values, strict=True))
    values: Array = np.array([known[name] for name in arm.names])
    return float(np.linalg.norm(arm.points(fresh.inputs(arm.conditions), values) - fresh.points, axis=2).mean())


def summary(found: Sequence[Found]) -> dict[str, Any]:
    """The figures of one row."""
    extras = [name for one in found for name in one.extras]
    return {
        "arms": len(found),
        "found": sum(not one.missing for one in found),
        "with_extras": sum(bool(one.extras) for one in found),
        "extras": {name: extras.count(name) for name in dict.fromkeys(extras)},
        "missing": sorted({name for one in found for name in one.missing}),
        "error_over_floor": float(np.mean([one.after for one in found]) / np.mean([one.floor for one in found])),
    }


def answer(options: Options) -> Answer:
    """All rows, one after another."""
    rows: dict[str, Any] = {}
    names: list[tuple[str, ...]] = [(name,) for name in options.effects]
    if not options.no_pairs:
        names += list(itertools.combinations(options.effects, 2))
    with executors.local_executor(options.workers) as pool:
        for effects in names if options.arms else ():
            found = pool.map(flexible_arm, [effects] * options.arms, range(options.arms))
            rows[" + ".join(effects)] = summary(list(found))
        for noise in options.noises if options.rigid else ():
            taken = list(pool.map(rigid_arm, [noise] * options.rigid, range(options.rigid)))
            given = [list(groups) for groups in taken if groups]
            rows[f"rigid, {noise}"] = {"arms": len(taken), "given_anything": len(given), "groups": given}
    lines = [f"{name}: {', '.join(f'{key} {value}' for key, value in row.items())}" for name, row in rows.items()]
    return Answer(rows, Document("Are effects found where they are, and only there?", paragraphs(lines)))


if __name__ == "__main__":
    run_script("effect_catalogue")
