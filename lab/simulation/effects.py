"""Combine the effects that displace a true arm from its geometric model at its joint positions.

``TrueRobot.points`` applies those that are the same at every visit, ``track`` the others. Each effect is described in
``kinematics.effects``; deflection under load, in ``elastic``.
"""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, TypeVar
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extension_points import numbers
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
    is_usual,
)
from lab.kinematics.effects.effect_registry import EFFECTS, EffectOptions
from lab.kinematics.effects.own import own_function
from lab.kinematics.joints import JointSpec

__all__ = ["NOTHING_SET", "TrueEffects", "random_conditions", "random_effects", "true_parameters"]

NOTHING_SET: Mapping[str, Array] = MappingProxyType({})
_WARMING_K, _TIMES = 10.5, 3.0  # steady temperature rise of an arm, and time constants that a campaign lasts
_CHANGES = (
    MovesJoints, MovesArm, MovesTracker, ChangesJointPositions, ScattersJoints, DisplacesReadings, ShapesNoise,
)  # fmt: skip
_Part = TypeVar("_Part", bound=SimulatedEffect)


@dataclass(frozen=True)
class TrueEffects:
    """The effects of one arm; ``TrueEffects.none(n)`` has none.

    Attributes:
        joints: number of joints.
        parts: the effects, in the order of the registry; zero for an effect that is off.
        own: the names of the effects that are not the lab's, by their kinds: their errors are reported with these.
    """

    joints: int
    parts: tuple[SimulatedEffect, ...]
    own: Mapping[type[SimulatedEffect], str] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        for part in self.parts:
            none = self.call(part, "none", self.joints)
            if type(none) is not type(part):
                raise LabError(
                    f"effect '{self._name(part)}': none returns {type(none).__name__}; return the effect at zero"
                )
            for name, usual in vars(none).items():
                value = getattr(part, name)
                if isinstance(usual, np.ndarray) and (value.shape != usual.shape or not np.isfinite(value).all()):
                    raise LabError(
                        f"effects of {self.joints} joints: {name} is to be finite numbers of shape {usual.shape}"
                    )

    def _name(self, part: SimulatedEffect) -> str:
        return self.own.get(type(part), type(part).__name__)

    def call(self, part: SimulatedEffect, function: str, *arguments: Any) -> Any:
        """Call a function of an effect; an error in one that is not the lab's is a LabError that names it."""
        with self._reporting(part, function):
            return getattr(part, function)(*arguments)

    def _reporting(self, part: SimulatedEffect, function: str) -> AbstractContextManager[None]:
        if type(part) not in self.own:
            return nullcontext()
        return own_function(self._name(part), f"{type(part).__name__}.{function}")

    def _is_on(self, part: ScattersJoints | DisplacesReadings | ShapesNoise) -> bool:
        assert isinstance(part, SimulatedEffect)
        with self._reporting(part, "is_on"):
            return bool(part.is_on)

    def _array(self, part: SimulatedEffect, function: str, shape: tuple[int, ...], *arguments: Any) -> Array:
        """Return the array that a function of an effect returns; that of one that is not the lab's is checked.

        Points and joint positions of poses that cannot be assembled are not finite, nor is what comes of them.
        """
        returned: Array = self.call(part, function, *arguments)
        if type(part) in self.own and all(
            np.isfinite(each).all() for each in arguments if isinstance(each, np.ndarray)
        ):
            return numbers(f"effect '{self._name(part)}': {type(part).__name__}.{function}", returned, shape)
        return returned

    @classmethod
    def none(cls, joints: int) -> "TrueEffects":
        """Return no effects, for an arm of so many joints."""
        return cls(joints, ())

    def part(self, kind: type[_Part]) -> _Part:
        """Return one of the effects; a null effect if the arm has none of this kind."""
        return next((part for part in self.parts if isinstance(part, kind)), kind.none(self.joints))

    def having(self, *parts: SimulatedEffect) -> "TrueEffects":
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
            self._is_on(part)
            for part in self.parts
            if isinstance(part, ScattersJoints | DisplacesReadings | ShapesNoise)
        )

    def columns(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the names of the conditions that these effects depend on."""
        return in_order([name for part in self.parts for name in self.call(part, "conditions", joint_names)])

    def drawn_conditions(self, joint_names: tuple[str, ...], poses: int, rng: np.random.Generator) -> dict[str, Array]:
        """Draw the columns ``(poses,)`` of own effects that the lab does not make.

        Raises:
            LabError: an effect depends on such a column, and does not draw it.
        """
        checked = dict[str, Array]()
        for part in self.parts:
            if type(part) not in self.own:
                continue
            name, function = self._name(part), f"{type(part).__name__}.drawn_conditions"
            where = f"effect '{name}': {function}"
            (stream,) = _streams_of(name, 1, rng)
            drawn = self.call(part, "drawn_conditions", poses, stream)
            if not isinstance(drawn, Mapping):
                raise LabError(f"{where} returns {type(drawn).__name__}; return columns by name")
            for column in self.call(part, "conditions", joint_names):
                if is_usual(column):
                    continue
                if column not in drawn:
                    raise LabError(
                        f"effect '{name}': the lab makes no column {column}, which its conditions name; return it from "
                        f"{function}"
                    )
                checked[column] = numbers(where, drawn[column], (poses,), f"a column {column}")
        return checked

    def refuse_unfit(self, chain: JointSpec) -> None:
        """Refuse an arm with these joints that cannot have them, with a LabError."""
        if self.joints != chain.size:
            raise LabError(f"effects of {self.joints} joints: robot {chain.name} has {chain.size}")
        for part in self.parts:
            self.call(part, "refuse_unfit", chain)

    def driven(self, joints: Array, conditions: PoseConditions) -> Array:
        """Return the joint positions ``(m, n)`` driven without a load, from measured ones ``(m, n)``."""
        moving = sorted((part for part in self.parts if isinstance(part, MovesJoints)), key=lambda p: p.addition_order)
        error: Array = np.zeros(joints.shape)
        for part in moving:
            error = error + self._array(part, "joint_offsets", joints.shape, joints, conditions)
        return joints + error

    def moved(self, points: Array, base: Array, conditions: PoseConditions) -> Array:
        """Return points of the arm ``(m, k, 3)`` in the world after motions of the whole arm with base ``(3,)``."""
        for part in self.parts:
            if isinstance(part, MovesArm):
                points = self._array(part, "moved", points.shape, points, base, conditions)
        return points

    def seen_after(self, points: Array, conditions: PoseConditions) -> Array:
        """Return points ``(m, k, 3)`` of the tracker's first frame in its frame at each pose."""
        seeing = sorted((part for part in self.parts if isinstance(part, MovesTracker)), key=lambda p: p.seeing_order)
        for part in seeing:
            points = self._array(part, "seen_after", points.shape, points, conditions)
        return points

    def shown(self, joints: Array) -> Array:
        """Return the measured joint positions ``(m, n)`` of where the joints settle, in the order visited."""
        for part in self.parts:
            if isinstance(part, ChangesJointPositions):
                joints = self._array(part, "shown", joints.shape, joints)
        return joints

    def scatter(self, poses: int, rng: np.random.Generator) -> Array:
        """Draw the random errors of the joints, ``(poses, n)``."""
        parts = [part for part in self.parts if isinstance(part, ScattersJoints)]
        total: Array = np.zeros((poses, self.joints))
        for part, own in zip(parts, _streams(rng, len(parts)), strict=True):
            total = total + self._array(part, "scatter", total.shape, poses, own)
        return total

    def shaped_noise(self, noise: Array, rng: np.random.Generator) -> Array:
        """Return the instrument's noise ``(poses, k, 3)`` m, from independent noise of it."""
        for part in self.parts:
            if isinstance(part, ShapesNoise) and self._is_on(part):
                noise = self._array(part, "shaped", noise.shape, noise, rng)
        return noise

    def displacements(self, poses: int, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """Draw outlier displacements of all points of a pose, ``(poses, 3)`` m, and the outlier mask ``(poses,)``."""
        parts = [part for part in self.parts if isinstance(part, DisplacesReadings)]
        total: Array = np.zeros((poses, 3))
        bad = np.zeros(poses, dtype=bool)
        for part, own in zip(parts, _streams(rng, len(parts)), strict=True):
            returned = self.call(part, "displacements", poses, own)
            if type(part) in self.own:
                returned = self._checked_displacements(part, returned, poses)
            displaced, which = returned
            total, bad = total + displaced, bad | which
        return total, bad

    def _checked_displacements(
        self, part: SimulatedEffect, returned: Any, poses: int
    ) -> tuple[Array, NDArray[np.bool_]]:
        where = f"effect '{self._name(part)}': {type(part).__name__}.displacements"
        if not isinstance(returned, tuple) or len(returned) != 2:
            raise LabError(
                f"{where} returns {type(returned).__name__}; return the displacements {(poses, 3)} "
                f"and which poses are displaced {(poses,)}"
            )
        displaced = numbers(where, returned[0], (poses, 3), "displacements")
        return displaced, numbers(where, returned[1], (poses,), "flags").astype(bool)


def _streams(rng: np.random.Generator, count: int) -> list[np.random.Generator]:
    """Return ``count`` streams, the first of which is ``rng`` itself."""
    return [rng, *rng.spawn(count - 1)][:count] if count else []


def random_effects(arm: ArmFacts, options: EffectOptions, rng: np.random.Generator) -> TrueEffects:
    """Draw the effects of one arm, of the sizes that options give.

    Each effect has children of ``rng`` for itself, in the registry's order, so that turning one on or making it larger
    leaves the draws of the others as they were; ``rng``'s own numbers are not used up.

    Raises:
        LabError: an option asks for what the arm cannot have, or for an effect that no package adds.
    """
    streams = rng.spawn(sum(kind.draws for kind in EFFECTS))
    parts, own_kinds = [], dict[type[SimulatedEffect], str]()
    for effect in options.each():
        own, streams = streams[: effect.draws], streams[effect.draws :]
        if (part := effect.simulated(arm, own)) is not None:
            parts.append(part)
    for name, effect in options.added.items():
        with own_function(name, f"{type(effect).__name__}.simulated"):
            part = effect.simulated(arm, _streams_of(name, effect.draws, rng))
        if part is None:
            continue
        if not isinstance(part, SimulatedEffect):
            raise LabError(
                f"effect '{name}': {type(effect).__name__}.simulated returns {type(part).__name__}; return a "
                f"{SimulatedEffect.__module__}.SimulatedEffect, or None"
            )
        if not isinstance(part, _CHANGES):
            kinds = ", ".join(kind.__name__ for kind in _CHANGES)
            raise LabError(
                f"effect '{name}': {type(part).__name__} changes nothing; derive it also from one of {kinds}"
            )
        parts.append(part)
        own_kinds[type(part)] = name
    return TrueEffects(arm.chain.size, tuple(parts), own_kinds)


def _streams_of(name: str, count: int, rng: np.random.Generator) -> list[np.random.Generator]:
    """Return ``count`` streams of an effect that a package adds: by its name, whichever others there are."""
    seed = rng.bit_generator.seed_seq
    assert isinstance(seed, np.random.SeedSequence)
    own = np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, crc32(name.encode())))
    return [np.random.default_rng(each) for each in own.spawn(count)]


def random_conditions(
    chain: JointSpec,
    effects: TrueEffects,
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
    columns |= effects.drawn_conditions(chain.joint_names, poses, rng)
    wanted = dict.fromkeys([*effects.columns(chain.joint_names), *requested])
    return {name: columns[name] for name in wanted if name in columns}


def true_parameters(effects: TrueEffects) -> dict[str, float]:
    """Return the true values of identifiable parameters, by their names; joints count from 1.

    Shares of several effects in one parameter add up. ``drift.*`` is the hourly motion of measured points,
    ``p' = exp(w t) (p + v t)``: the tracker's motion reversed. Parameters that an effect obscures are left out.
    """
    truth: dict[str, float] = {}
    for part in effects.parts:
        for name, share in effects.call(part, "true_parameters").items():
            truth[name] = truth.get(name, 0.0) + share
    obscured = {name for part in effects.parts for name in effects.call(part, "obscured")}
    return {name: value for name, value in truth.items() if name not in obscured}
