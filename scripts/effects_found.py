"""Compliance and runout of the joints, found in a virtual arm by ``--model auto``; and how often it finds what is not.

Each arm has its bodies off, axes 2 and 3 that give way to gravity by 1e-5 rad/Nm (in MuJoCo, by its own torques)
and a first harmonic of 0.2 mrad and random phase on each joint. 60 poses, each with a payload of 0 or 3 kg, are
designed for all parameters of both groups. Rigid arms at the same poses, with every condition that a group could ask
for, say how often a group is taken that is not there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from designed_campaign import POSES, DesignedCampaign
from shared import Answer, Document, Flag, Paragraph, paragraphs, run_script
from threadpoolctl import threadpool_limits

from lab.campaign.options import VirtualCampaign
from lab.campaign.virtual_robot import perturbed_arm
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.effects.effect import ArmFacts
from lab.kinematics.effects.registry import EffectOptions
from lab.simulation.effects import random_effects
from lab.studies import executors

GROUPS = ("compliance", "harmonics")
STIFFNESS_NM_PER_RAD = 1e5
SIZES = EffectOptions(stiffness_nm_per_rad=STIFFNESS_NM_PER_RAD, harmonic_mrad=0.2)
STIFF = ("joint2.compliance", "joint3.compliance")
DAY = DesignedCampaign("irb120", ("p1",), GROUPS)


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


def flexible_arm(seed: int) -> Found:
    """One arm with effects."""
    with threadpool_limits(1):
        real = perturbed_arm(DAY.robot, VirtualCampaign(seed=seed))
        arm = ArmFacts(DAY.robot.chain, DAY.robot.loads)
        real = real.with_effects(random_effects(arm, SIZES, rng_for(seed, "effects")))
        data = DAY.measured(real, seed)
        chosen = DAY.selected(data)
        found = chosen.identification
        free = [found.model.names[i] for i in found.fit.free]
        spread = dict(zip(free, zip(found.values[list(found.fit.free)], found.std, strict=True), strict=True))
        stiff = np.array([spread.get(name, (np.nan, np.nan)) for name in STIFF])
        return Found(
            chosen.chosen,
            float(DAY.fresh_errors(real, DAY.identified(data, ()), seed).mean()),
            float(DAY.fresh_errors(real, found, seed).mean()),
            stiff[:, 0],
            stiff[:, 1],
            float(found.half_width_95[0]),
        )


def rigid_arm(seed: int) -> tuple[str, ...]:
    """The groups taken for an arm without effects."""
    with threadpool_limits(1):
        return DAY.selected(DAY.measured(perturbed_arm(DAY.robot, VirtualCampaign(seed=seed)), seed)).chosen


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


if __name__ == "__main__":
    run_script("effects_found")
