"""Compliance and runout of the joints, found in a virtual arm by ``--model auto``; and how often it finds what is not.

Each arm has its bodies off, axes 2 and 3 that give way to gravity by 1e-5 rad/Nm (in MuJoCo, by its own torques)
and a first harmonic of 0.2 mrad and random phase on each joint. 60 poses, each with a payload of 0 or 3 kg, are
designed for all parameters of both groups. Rigid arms at the same poses, with every condition that a group could ask
for, say how often a group is taken that is not there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from lab.calibration.identify import identify
from lab.calibration.statistics.model_selection import Selection, select
from lab.calibration.weights import Noise
from lab.campaign.option_groups import Flag
from lab.campaign.options import VirtualCampaign
from lab.campaign.robot import Robot, load_robot
from lab.campaign.virtual_robot import perturbed_arm
from lab.core.instruments import instrument
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.experiments.script import Answer, paragraphs
from lab.kinematics.effects.arm import ArmWithEffects
from lab.kinematics.effects.conditions import HOUR_S
from lab.kinematics.effects.effect import ArmFacts
from lab.kinematics.effects.registry import EffectOptions
from lab.kinematics.gauge import base_set
from lab.kinematics.model import Model
from lab.kinematics.serial.arm import SerialArm
from lab.pose_selection.criteria import criterion
from lab.pose_selection.exchange import exchange
from lab.render.document import Document, Paragraph
from lab.simulation.candidate_poses import draw_candidates
from lab.simulation.collisions import random_poses
from lab.simulation.effects import random_effects
from lab.simulation.observations.points import track
from lab.simulation.true_robot import TrueRobot
from lab.studies import executors

__all__ = ["Options", "answer"]

POSES, CANDIDATES, FRESH = 60, 1000, 1000
TARGETS, PAYLOADS_KG = ("p1",), (0.0, 3.0)
GROUPS = ("compliance", "harmonics")
STIFFNESS_NM_PER_RAD = 1e5
SIZES = EffectOptions(stiffness_nm_per_rad=STIFFNESS_NM_PER_RAD, harmonic_mrad=0.2)
STIFF = ("joint2.compliance", "joint3.compliance")
DEVICE = instrument("uniform-8um")


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    arms: int = 30
    """Arms with effects."""
    rigid: int = 50
    """Arms without."""
    workers: int = 2
    """Processes."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Found:
    """What came out for one arm; lengths in m.

    Attributes:
        chosen: the groups taken.
        alone, after: mean error on validation poses of geometry alone, and of what was chosen.
        compliance, std: ``(2,)`` of axes 2 and 3 (rad/Nm); NaN where not identified.
        half: of a 95 % interval, in standard deviations.
    """

    chosen: tuple[str, ...]
    alone: float
    after: float
    compliance: Array
    std: Array
    half: float


def answer(options: Options) -> Answer:
    """Both studies."""
    with executors.local_executor(options.workers) as pool:
        found = list(pool.map(flexible_arm, range(options.arms)))
        rigid = list(pool.map(rigid_arm, range(options.rigid)))
    result = summary(found, rigid)
    return Answer(result, Document("Are compliance and harmonics found, and only where they are?", table(result)))


@cache
def nominal_robot() -> Robot:
    """The nominal robot, loaded once."""
    return load_robot("irb120")


@cache
def designed() -> tuple[Array, Array]:
    """Readings ``(60, joints)`` and payloads ``(60,)`` kg, D-optimal for geometry and both groups."""
    robot = nominal_robot()
    model, arm = robot.model, robot.arm_with(TARGETS, GROUPS)
    drawn = draw_candidates(model, TARGETS, DEVICE, CANDIDATES, rng_for(0, "candidates")).joints
    inputs = np.concatenate([np.insert(drawn, drawn.shape[1], mass, axis=1) for mass in PAYLOADS_KG])
    rigid = model.values_before(robot.arm(TARGETS), model.T_world_tracker)
    values = np.concatenate([rigid, np.zeros(len(arm.names) - len(rigid))])
    kept = list(base_set(arm, values).kept)
    jacobian = arm.observe(inputs, values)[1][..., kept].reshape(len(inputs), -1, len(kept))
    pool = jacobian / np.linalg.norm(jacobian, axis=(0, 1))
    design = exchange(inputs, pool, POSES, criterion("O1", len(kept)), rng_for(0, "design"), starts=1)
    return design.joints[:, :-1], design.joints[:, -1]


def measured(real: TrueRobot, seed: int) -> Measurements:
    """The designed poses, with every condition that a group could ask for."""
    joints, payload = designed()
    rng = rng_for(seed, "conditions")
    names = real.robot.chain.joint_names
    sides = rng.choice([-1.0, 1.0], joints.shape)
    conditions = {f"approach_{name}": sides[:, i] for i, name in enumerate(names)}
    conditions |= {"payload_kg": payload, "time_s": np.linspace(0.0, HOUR_S, len(joints))}
    return track(real, joints, TARGETS, DEVICE, rng_for(seed, "noise"), conditions=conditions)


def selected(data: Measurements) -> Selection:
    """As ``--model auto`` does."""
    robot = nominal_robot()

    def nominal(model: Model) -> Array:
        assert isinstance(model, SerialArm | ArmWithEffects)
        return model.nominal(robot.tool)

    return select(lambda groups: robot.arm_with(TARGETS, groups), data, nominal, Noise(DEVICE))


def flexible_arm(seed: int) -> Found:
    """One arm with effects."""
    with threadpool_limits(1):
        robot = nominal_robot()
        real = perturbed_arm(robot, VirtualCampaign(seed=seed))
        real = real.with_effects(random_effects(ArmFacts(robot.chain, robot.loads), SIZES, rng_for(seed, "effects")))
        data = measured(real, seed)
        chosen = selected(data)
        arm = robot.arm(TARGETS)
        alone = identify(arm, data, arm.nominal(robot.tool), Noise(DEVICE))
        joints = random_poses(real.robot, FRESH, rng_for(seed, "fresh"))
        payload = rng_for(seed, "conditions").spawn(1)[0].choice(PAYLOADS_KG, FRESH)
        exact = real.points(joints, TARGETS, {"payload_kg": payload})
        known = {"payload_kg": payload} | {f"approach_{n}": np.zeros(FRESH) for n in robot.chain.joint_names}
        columns = (known.get(name, np.zeros(FRESH))[:, None] for name in chosen.identification.model.conditions)
        inputs = np.concatenate([joints, *columns], axis=1)
        found = chosen.identification
        free = [found.model.names[i] for i in found.fit.free]
        spread = dict(zip(free, zip(found.values[list(found.fit.free)], found.std, strict=True), strict=True))
        stiff = np.array([spread.get(name, (np.nan, np.nan)) for name in STIFF])
        return Found(
            chosen.chosen,
            float(np.linalg.norm(arm.points(joints, alone.values) - exact, axis=2).mean()),
            float(np.linalg.norm(found.model.points(inputs, found.values) - exact, axis=2).mean()),
            stiff[:, 0],
            stiff[:, 1],
            float(found.half_width_95[0]),
        )


def rigid_arm(seed: int) -> tuple[str, ...]:
    """The groups taken for an arm without effects."""
    with threadpool_limits(1):
        return selected(measured(perturbed_arm(nominal_robot(), VirtualCampaign(seed=seed)), seed)).chosen


def summary(found: Sequence[Found], rigid: Sequence[tuple[str, ...]]) -> dict[str, Any]:
    """The figures of both studies; lengths in mm."""
    alone, after = (1e3 * np.array([getattr(f, name) for f in found]) for name in ("alone", "after"))
    true = np.full(2, 1 / STIFFNESS_NM_PER_RAD)  # of axes 2 and 3
    error, std = (np.array([f.compliance for f in found]) - true) / true, np.array([f.std for f in found]) / true
    z = error / std
    return {
        "arms": len(found),
        "alone_mm": {"least": alone.min(), "median": np.median(alone), "largest": alone.max()},
        "after_mm": {"median": np.median(after), "largest": after.max()},
        "both_chosen": sum(set(GROUPS) <= set(f.chosen) for f in found),
        "only_these": sum(set(GROUPS) == set(f.chosen) for f in found),
        "stiffness_error": np.sqrt((error**2).mean(axis=0)).tolist(),
        "worst_stiffness_error": np.abs(error).max(axis=0).tolist(),
        "predicted_error": np.sqrt((std**2).mean(axis=0)).tolist(),
        "to_predicted": np.sqrt((z**2).mean(axis=0)).tolist(),
        "coverage_95": (np.abs(z) <= np.array([[f.half] for f in found])).mean(axis=0).tolist(),
        "rigid": len(rigid),
        "rigid_with_groups": [list(groups) for groups in rigid if groups],
    }


def table(result: dict[str, Any]) -> tuple[Paragraph, ...]:
    """The figures in a few lines."""
    alone, after = result["alone_mm"], result["after_mm"]
    lines = [
        f"{result['arms']} arms with {' and '.join(GROUPS)}, {POSES} designed poses, mean error on validation poses:",
        f"  geometry alone {alone['least']:.4f} to {alone['largest']:.4f} mm, median {alone['median']:.4f}",
        f"  --model auto median {after['median']:.4f} mm, worst {after['largest']:.4f}",
        f"  both groups taken {result['both_chosen']} times, these and no other {result['only_these']} times",
    ]
    for i, axis in enumerate((2, 3)):
        lines.append(
            f"  stiffness of axis {axis}: RMS error {result['stiffness_error'][i]:.2%}, "
            f"predicted {result['predicted_error'][i]:.2%} ({result['to_predicted'][i]:.2f} times), "
            f"worst {result['worst_stiffness_error'][i]:.1%}; 95 % intervals hold {result['coverage_95'][i]:.1%}"
        )
    taken = [" ".join(groups) for groups in result["rigid_with_groups"]]
    lines.append(
        f"{result['rigid']} rigid arms: {len(taken)} with a group taken{': ' if taken else ''}{', '.join(taken)}"
    )
    return paragraphs(lines)
