"""Combine the effects that displace a true arm from its geometric model at its joint positions.

``TrueRobot.points`` applies those that are the same at every visit, ``track`` the others. Each effect is described in
``kinematics.effects``; deflection under load, in ``elastic``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TypeVar
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.effects.bending import ElasticLinks
from lab.kinematics.effects.compliance import HardeningSprings, JointSprings
from lab.kinematics.effects.effect import (
    BUMPED,
    PAYLOAD,
    REFERENCE_C,
    TEMPERATURE,
    TIME,
    ArmFacts,
    ChangesJointPositions,
    DisplacesReadings,
    MovesArm,
    MovesJoints,
    MovesTracker,
    PoseConditions,
    ScattersJoints,
    ShapesNoise,
    SimulatedEffect,
    approach_of,
    in_order,
)
from lab.kinematics.effects.registry import EFFECTS, EffectOptions
from lab.kinematics.joints import JointSpec

__all__ = ["NOTHING_SET", "Effects", "random_conditions", "random_effects", "true_parameters"]

NOTHING_SET: Mapping[str, Array] = MappingProxyType({})
_WARMING_K, _TIMES = 10.5, 3.0  # steady temperature rise of an arm, and time constants that a campaign lasts
_Part = TypeVar("_Part", bound=SimulatedEffect)


@dataclass(frozen=True)
class Effects:
    """The effects of one arm; ``Effects.none(n)`` has none.

    Attributes:
        joints: number of joints.
        parts: the effects, in the order of the registry; zero for an effect that is off.
    """

    joints: int
    parts: tuple[SimulatedEffect, ...]

    def __post_init__(self) -> None:
        for part in self.parts:
            for name, usual in vars(type(part).none(self.joints)).items():
                value = getattr(part, name)
                if isinstance(usual, np.ndarray) and (value.shape != usual.shape or not np.isfinite(value).all()):
                    raise LabError(
                        f"effects of {self.joints} joints: {name} is to be finite numbers of shape {usual.shape}"
                    )

    @classmethod
    def none(cls, joints: int) -> "Effects":
        """Return no effects, for an arm of so many joints."""
        return cls(joints, ())

    def part(self, kind: type[_Part]) -> _Part:
        """Return one of the effects; a null effect if the arm has none of this kind."""
        return next((part for part in self.parts if isinstance(part, kind)), kind.none(self.joints))

    def having(self, *parts: SimulatedEffect) -> "Effects":
        """Return these effects instead of those of their kind."""
        kinds = {type(part) for part in parts}
        return replace(self, parts=(*(part for part in self.parts if type(part) not in kinds), *parts))

    @property
    def is_elastic(self) -> bool:
        """Decide whether the arm deflects under its load."""
        springs, links = self.part(JointSprings), self.part(ElasticLinks)
        hard = self.part(HardeningSprings).cubic_rad_per_nm3
        return bool(springs.compliance_rad_per_nm.any() or links.compliances.any() or hard.any())

    @property
    def varies(self) -> bool:
        """Decide whether two visits to the same poses differ, noise aside."""
        return any(
            part.is_on for part in self.parts if isinstance(part, ScattersJoints | DisplacesReadings | ShapesNoise)
        )

    def columns(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the names of the conditions that these effects depend on."""
        return in_order([name for part in self.parts for name in part.conditions(joint_names)])

    def refuse_unfit(self, chain: JointSpec) -> None:
        """Refuse an arm with these joints that cannot have them, with a LabError."""
        if self.joints != chain.size:
            raise LabError(f"effects of {self.joints} joints: robot {chain.name} has {chain.size}")
        for part in self.parts:
            part.refuse_unfit(chain)

    def driven(self, joints: Array, conditions: PoseConditions) -> Array:
        """Return the joint positions ``(m, n)`` driven without a load, from measured ones ``(m, n)``."""
        moving = sorted((part for part in self.parts if isinstance(part, MovesJoints)), key=lambda p: p.addition_order)
        error: Array = np.zeros(joints.shape)
        for part in moving:
            error = error + part.joint_offsets(joints, conditions)
        return joints + error

    def moved(self, points: Array, base: Array, conditions: PoseConditions) -> Array:
        """Return points of the arm ``(m, k, 3)`` in the world after motions of the whole arm with base ``(3,)``."""
        for part in self.parts:
            if isinstance(part, MovesArm):
                points = part.moved(points, base, conditions)
        return points

    def seen_after(self, points: Array, conditions: PoseConditions) -> Array:
        """Return points ``(m, k, 3)`` of the tracker's first frame in its frame at each pose."""
        for part in self.parts:
            if isinstance(part, MovesTracker):
                points = part.seen_after(points, conditions)
        return points

    def shown(self, joints: Array) -> Array:
        """Return the measured joint positions ``(m, n)`` of where the joints settle, in the order visited."""
        for part in self.parts:
            if isinstance(part, ChangesJointPositions):
                joints = part.shown(joints)
        return joints

    def scatter(self, poses: int, rng: np.random.Generator) -> Array:
        """Draw the random errors of the joints, ``(poses, n)``."""
        parts = [part for part in self.parts if isinstance(part, ScattersJoints)]
        total: Array = np.zeros((poses, self.joints))
        for part, own in zip(parts, _streams(rng, len(parts)), strict=True):
            total = total + part.scatter(poses, own)
        return total

    def shaped_noise(self, noise: Array, rng: np.random.Generator) -> Array:
        """Return the instrument's noise ``(poses, k, 3)`` m, from independent noise of it."""
        for part in self.parts:
            if isinstance(part, ShapesNoise) and part.is_on:
                noise = part.shaped(noise, rng)
        return noise

    def displacements(self, poses: int, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """Draw outlier displacements of all points of a pose, ``(poses, 3)`` m, and the outlier mask ``(poses,)``."""
        parts = [part for part in self.parts if isinstance(part, DisplacesReadings)]
        total: Array = np.zeros((poses, 3))
        bad = np.zeros(poses, dtype=bool)
        for part, own in zip(parts, _streams(rng, len(parts)), strict=True):
            displaced, which = part.displacements(poses, own)
            total, bad = total + displaced, bad | which
        return total, bad


def _streams(rng: np.random.Generator, count: int) -> list[np.random.Generator]:
    """Return ``count`` streams, the first of which is ``rng`` itself."""
    return [rng, *rng.spawn(count - 1)][:count] if count else []


def random_effects(arm: ArmFacts, options: EffectOptions, rng: np.random.Generator) -> Effects:
    """Draw the effects of one arm, of the sizes that options give.

    Each effect has children of ``rng`` for itself, in the registry's order, so that turning one on or making it larger
    leaves the draws of the others as they were; ``rng``'s own numbers are not used up.

    Raises:
        LabError: an option asks for what the arm cannot have, or for an effect that no package adds.
    """
    streams = rng.spawn(sum(kind.draws for kind in EFFECTS))
    parts = []
    for effect in options.each():
        own, streams = streams[: effect.draws], streams[effect.draws :]
        if (part := effect.simulated(arm, own)) is not None:
            parts.append(part)
    for name, effect in options.added.items():
        if (part := effect.simulated(arm, _streams_of(name, effect.draws, rng))) is not None:
            parts.append(part)
    return Effects(arm.chain.size, tuple(parts))


def _streams_of(name: str, count: int, rng: np.random.Generator) -> list[np.random.Generator]:
    """Return ``count`` streams of an effect that a package adds: by its name, whichever others there are."""
    seed = rng.bit_generator.seed_seq
    assert isinstance(seed, np.random.SeedSequence)
    own = np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, crc32(name.encode())))
    return [np.random.default_rng(each) for each in own.spawn(count)]


def random_conditions(
    chain: JointSpec,
    effects: Effects,
    poses: int,
    rng: np.random.Generator,
    payload_kg: Sequence[float] = (0.0,),
    duration_s: float = 0.0,
    requested: Sequence[str] = (),
) -> dict[str, Array]:
    """Draw the conditions of a campaign's poses, ``(poses,)`` a column: those that affect the arm or are requested.

    A payload is one of ``payload_kg``, each as likely; a joint is approached from either side, as likely; the poses
    are evenly spaced in time, the last at ``duration_s``; meanwhile the arm warms up by 10 K, exponentially, in three
    time constants. Payloads and approaches are drawn from children of ``rng`` each, pose after pose, so that more poses
    keep the first ones' and no column depends on another.
    """
    loading, approaching = rng.spawn(2)
    sides = np.where(approaching.random((poses, chain.size)) < 0.5, -1.0, 1.0)
    columns = {approach_of(name): sides[:, i] for i, name in enumerate(chain.joint_names)}
    if any(payload_kg) or PAYLOAD in requested:
        columns[PAYLOAD] = np.array(payload_kg, dtype=np.float64)[loading.integers(len(payload_kg), size=poses)]
    columns[BUMPED] = np.where(np.arange(poses) < poses / 2, 0.0, 1.0)
    columns[TIME] = np.linspace(0.0, duration_s, poses)
    columns[TEMPERATURE] = REFERENCE_C + _WARMING_K * -np.expm1(-_TIMES * np.linspace(0.0, 1.0, poses))
    wanted = dict.fromkeys([*effects.columns(chain.joint_names), *requested])
    return {name: columns[name] for name in wanted if name in columns}


def true_parameters(effects: Effects) -> dict[str, float]:
    """Return the true values of identifiable parameters, by their names; joints count from 1.

    Shares of several effects in one parameter add up. ``drift.*`` is the hourly motion of measured points,
    ``p' = exp(w t) (p + v t)``: the tracker's motion reversed. Parameters that an effect obscures are left out.
    """
    truth: dict[str, float] = {}
    for part in effects.parts:
        for name, share in part.true_parameters().items():
            truth[name] = truth.get(name, 0.0) + share
    obscured = {name for part in effects.parts for name in part.obscured()}
    return {name: value for name, value in truth.items() if name not in obscured}
