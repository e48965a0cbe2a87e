"""Are poses that are chosen for the worst of many arms better for arms that the design never saw?

Designs of an IRB 120 by the mean predicted error (criterion I), for arms whose geometry is off and whose joints comply:
for the nominal rigid arm, for the nominal arm with compliance and payloads, and for the worst of perturbed arms and
both models; and random poses with random payloads. All are judged on other perturbed and compliant arms by the error
that is predicted after an identification of geometry and compliance.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from shared import Answer, Document, Flag, Paragraph, Table, run_script

from lab.campaign.design_problem import PoseProblem, best_design, pose_problem
from lab.campaign.options import DesignOptions
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.pose_selection.criteria import is_singular
from lab.pose_selection.exchange import information

COMPLIANT = "geometric+compliance"
BOTH = f"geometric,{COMPLIANT}"
_FRESH_SEED, _RANDOM_SEED, _FEW = 1000, 2000, 100  # of the arms that judge, and of random poses; candidates of these


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    robot: str = "irb120"
    """The arm."""
    arms: int = 200
    """Perturbed and compliant arms that judge the designs; none of them was seen by a design."""
    worst_of: int = 20
    """Perturbed arms of the robust design."""
    poses: int = 20
    """Poses of each design."""
    candidates: int = 1000
    """Candidates of each design."""
    starts: int = 1
    """Starts of each search."""
    payload_kg: float = 3.0
    """Each pose is measured without a payload or with this one."""
    sets: int = 20
    """Sets of random poses, whose median is shown."""
    position_sigma_mm: float = 0.5
    """Position error of the arms, per axis (1σ)."""
    rotation_sigma_mrad: float = 1.5
    """Rotation error of the arms, per axis (1σ)."""
    seed: int = 0
    """Random seed."""
    json: Flag = False
    """Print one JSON object."""


def answer(options: Options) -> Answer:
    """All designs, on all arms."""
    payloads = (0.0, options.payload_kg)
    judge = pose_problem(
        DesignOptions(
            options.robot, model=COMPLIANT, criterion="I", payload_kg=payloads, worst_of=options.arms,
            candidates=_FEW, seed=options.seed + _FRESH_SEED, position_sigma_mm=options.position_sigma_mm,
            rotation_sigma_mrad=options.rotation_sigma_mrad,
        )
    )  # fmt: skip
    designs: Mapping[str, Mapping[str, Any]] = {
        "nominal, geometry alone": {},
        "nominal, with compliance and payloads": {"model": COMPLIANT, "payload_kg": payloads},
        f"worst of {options.worst_of} arms and both models": {
            "model": BOTH,
            "payload_kg": payloads,
            "worst_of": options.worst_of,
            "position_sigma_mm": options.position_sigma_mm,
            "rotation_sigma_mrad": options.rotation_sigma_mrad,
        },
    }
    rows: list[dict[str, Any]] = [
        {"poses_by": "random poses and payloads, median of sets", **_random(options, judge)},
        *({"poses_by": name, **_designed(options, judge, own)} for name, own in designs.items()),
    ]
    table = Table(
        ("poses by", "mean, µm", "worst arm, µm", "worst pose of any arm, µm", "poses with payload", "design, s"),
        tuple(
            (
                row["poses_by"],
                *(f"{1e3 * row[name]:.2f}" for name in ("mean_mm", "worst_mm", "worst_pose_mm")),
                str(row["loaded"]),
                f"{row['seconds']:.0f}",
            )
            for row in rows
        ),
    )
    text = (
        f"{options.poses} poses of {options.robot}, judged on {options.arms} perturbed and compliant arms "
        f"({options.position_sigma_mm:g} mm, {options.rotation_sigma_mrad:g} mrad): RMS predicted error over the "
        "workspace, after identifying geometry and compliance."
    )
    return Answer({"rows": rows}, Document("Robust design", (Paragraph(text), table)))


def _designed(options: Options, judge: PoseProblem, own: Mapping[str, Any]) -> dict[str, float]:
    """Design poses by criterion I, and judge them."""
    started = time.perf_counter()
    asked = DesignOptions(
        options.robot,
        poses=options.poses,
        criterion="I",
        candidates=options.candidates,
        starts=options.starts,
        seed=options.seed,
        **own,
    )
    problem = pose_problem(asked)
    chosen = best_design(asked, problem, options.poses).joints
    seconds = time.perf_counter() - started
    size = problem.robot.chain.size
    inputs = np.column_stack([chosen[:, :size], problem.payload(chosen)])
    return {**judged(judge, inputs), "seconds": seconds}


def _random(options: Options, judge: PoseProblem) -> dict[str, float]:
    """Judge sets of feasible random poses with random payloads; return the median of each figure."""
    asked = DesignOptions(options.robot, candidates=options.poses * options.sets, seed=options.seed + _RANDOM_SEED)
    joints, rng = pose_problem(asked).candidates.joints, rng_for(options.seed, "poses")
    found = []
    for part in np.split(rng.permutation(joints), options.sets):
        loads = rng.choice([0.0, options.payload_kg], len(part))
        found.append(judged(judge, np.column_stack([part, loads])))
    return {**{name: float(np.median([each[name] for each in found])) for name in found[0]}, "seconds": 0.0}


def judged(judge: PoseProblem, inputs: Array) -> dict[str, float]:
    """Return predicted errors (mm) of the perturbed arms after measuring at inputs ``(n, joints + 1)``."""
    squares = np.array([_squares(judge, inputs, case) for case in range(1, len(judge.cases))])
    rms = MM.of(np.sqrt(squares.mean(axis=1)))
    return {
        "mean_mm": float(rms.mean()),
        "worst_mm": float(rms.max()),
        "worst_pose_mm": float(MM.of(np.sqrt(squares.max()))),
        "loaded": int((inputs[:, -1] > 0).sum()),
    }


def _squares(judge: PoseProblem, inputs: Array, number: int) -> Array:
    """Return the predicted squared errors ``(t,)`` m² of an arm at the test poses."""
    case = judge.cases[number]
    total = information(case.whitened(inputs))
    if is_singular(total):
        return np.full(len(case.test), np.inf)
    size = np.sqrt(np.diag(total))
    spread = case.test @ (np.linalg.inv(np.linalg.cholesky(total / np.outer(size, size))) / size).T
    return np.asarray((spread**2).sum(axis=(1, 2)))


if __name__ == "__main__":
    run_script("robust_design_study")
