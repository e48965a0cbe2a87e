"""Effects and conditions drawn at random: how large they are is said, the rest is chance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec
from lab.simulation.effects import BUMPED, Effects

LEVER_M = 0.3  # a slide's sizes are those of a hinge at this distance: rad times this, Nm/rad over its square


@dataclass(frozen=True)
class EffectSizes:
    """How large the effects of an arm are; all off unless given.

    Attributes:
        stiffness_nm_per_rad: by joint, which count from 1; the others are stiff.
        harmonic_rad, second_harmonic_rad: amplitude of each hinge's runout once and twice a turn; the phase is drawn.
        gear_sigma: standard deviation of a joint's gear error, relative.
        coupling_sigma: of a joint's motion with its inner neighbour's, rad/rad, for the last two hinges.
        backlash_rad: mean full width; each joint's is drawn between half and one and a half of it.
        repeatability_rad: standard deviation, alike for all joints.
        lag: share of the last move that a reading still lacks.
        bending_rad_per_nm: alike for what carries each hinge.
        drift_m_per_h, drift_rad_per_h: the tracker's motion; the directions are drawn.
        bump_m, bump_rad: how far the tracker is moved in the middle; the directions are drawn.
        growth_per_h: thermal growth of the arm, relative.
        bad_share: how likely a pose's reading is bad.
        bad_range_m: least and largest displacement of a bad reading.
    """

    stiffness_nm_per_rad: Mapping[int, float] = field(default_factory=dict)
    harmonic_rad: float = 0.0
    second_harmonic_rad: float = 0.0
    gear_sigma: float = 0.0
    coupling_sigma: float = 0.0
    backlash_rad: float = 0.0
    repeatability_rad: float = 0.0
    lag: float = 0.0
    bending_rad_per_nm: float = 0.0
    drift_m_per_h: float = 0.0
    drift_rad_per_h: float = 0.0
    bump_m: float = 0.0
    bump_rad: float = 0.0
    growth_per_h: float = 0.0
    bad_share: float = 0.0
    bad_range_m: tuple[float, float] = (1e-3, 50e-3)


def random_effects(chain: JointSpec, sizes: EffectSizes, rng: np.random.Generator) -> Effects:
    """The effects of one arm.

    Each effect has a child of ``rng`` for itself, in an order that stays, so that turning one on or making it larger
    leaves the draws of the others as they were; ``rng``'s own numbers are not used up.

    Raises:
        LabError: a stiffness is of no joint, or not above zero.
    """
    n, hinge = chain.size, ~np.array(chain.prismatic)
    lever = np.where(hinge, 1.0, LEVER_M)
    first, second, gear, coupling, backlash, shift, turn, push, twist = rng.spawn(9)  # a new effect goes to the end
    phases = [child.uniform(0.0, 2 * np.pi, n) for child in (first, second)]
    waves = [
        (size * wave(phase)) * hinge
        for size, phase in zip((sizes.harmonic_rad, sizes.second_harmonic_rad), phases, strict=True)
        for wave in (np.cos, np.sin)
    ]
    motion = [sizes.drift_m_per_h * _direction(shift), sizes.drift_rad_per_h * _direction(turn)]
    return replace(
        Effects.none(n),
        compliance_rad_per_nm=lever**2 * _compliance(chain, sizes.stiffness_nm_per_rad),
        gear=sizes.gear_sigma * gear.standard_normal(n),
        harmonics_rad=np.stack(waves, axis=1),
        coupling=sizes.coupling_sigma * coupling.standard_normal((n, n)) * _coupled(chain),
        backlash_rad=lever * sizes.backlash_rad * backlash.uniform(0.5, 1.5, n),
        repeatability_rad=lever * sizes.repeatability_rad,
        lag=sizes.lag,
        bending_rad_per_nm=sizes.bending_rad_per_nm * hinge,
        drift_per_h=np.concatenate(motion),
        bump=np.concatenate([sizes.bump_m * _direction(push), sizes.bump_rad * _direction(twist)]),
        growth_per_h=sizes.growth_per_h,
        bad_share=sizes.bad_share,
        bad_range_m=sizes.bad_range_m,
    )


def random_conditions(
    chain: JointSpec,
    effects: Effects,
    poses: int,
    rng: np.random.Generator,
    payload_kg: Sequence[float] = (0.0,),
    duration_s: float = 0.0,
    asked: Sequence[str] = (),
) -> dict[str, Array]:
    """What is set at each pose of a campaign, ``(poses,)`` a column: what matters to the effects or is asked for.

    A payload is one of ``payload_kg``, each as likely; a joint is approached from either side, as likely; the poses
    are evenly spaced in time, the last at ``duration_s``. Payloads and approaches are drawn from children of ``rng``
    each, pose after pose, so that more poses keep the first ones' and no column depends on another.
    """
    loading, approaching = rng.spawn(2)
    sides = np.where(approaching.random((poses, chain.size)) < 0.5, -1.0, 1.0)
    columns = {f"approach_{name}": sides[:, i] for i, name in enumerate(chain.joint_names)}
    if any(payload_kg) or "payload_kg" in asked:
        columns["payload_kg"] = np.array(payload_kg, dtype=np.float64)[loading.integers(len(payload_kg), size=poses)]
    columns[BUMPED] = np.where(np.arange(poses) < poses / 2, 0.0, 1.0)
    columns["time_s"] = np.linspace(0.0, duration_s, poses)
    wanted = dict.fromkeys([*effects.columns(chain.joint_names), *asked])
    return {name: columns[name] for name in wanted if name in columns}


def _compliance(chain: JointSpec, stiffness: Mapping[int, float]) -> Array:
    """``(n,)`` rad/Nm, zero for a stiff joint."""
    compliance = np.zeros(chain.size)
    for joint, value in stiffness.items():
        if not 1 <= joint <= chain.size:
            raise LabError(f"a stiffness of joint {joint}: robot {chain.name} has joints 1 to {chain.size}")
        if not value > 0:
            raise LabError(f"joint {joint}: a stiffness of {value} Nm/rad; give one above zero, or none")
        compliance[joint - 1] = 1 / value
    return compliance


def _coupled(chain: JointSpec) -> Array:
    """``(n, n)``, 1 where the last two hinges go along with their inner neighbour, itself a hinge, else 0."""
    coupled = np.zeros((chain.size, chain.size))
    for i in range(max(1, chain.size - 2), chain.size):
        coupled[i, i - 1] = not (chain.prismatic[i] or chain.prismatic[i - 1])
    return coupled


def _direction(rng: np.random.Generator) -> Array:
    """A unit vector, any way as likely."""
    vector = rng.standard_normal(3)
    unit: Array = vector / np.linalg.norm(vector)
    return unit
