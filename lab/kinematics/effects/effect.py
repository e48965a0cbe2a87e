"""Effects: a fitted group of parameters, its simulated counterpart, and the options that select it.

A module of this folder describes one effect, or a small family: the fitted function with its derivative, what it does
to a virtual arm, how large that is drawn, and the options of ``lab calibrate`` that say so. ``registry`` lists them.

What is set at each pose beside the joints: payload, approach, time, temperature, sessions; columns of a file.

Along a trajectory also how the joints move.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.measurements import LAST_MOVE, PLACE, SESSION, STATION
from lab.core.se3 import Array
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import Parameter

__all__ = [
    "AXES",
    "BUMPED",
    "CHANGING_WITH_TIME",
    "HOUR_S",
    "LEVER_M",
    "NO_SESSIONS",
    "PAYLOAD",
    "REFERENCE_C",
    "TEMPERATURE",
    "TIME",
    "ArmFacts",
    "ChangesJointPositions",
    "DisplacesReadings",
    "Effect",
    "FittedGroup",
    "Moves",
    "MovesArm",
    "MovesJoints",
    "MovesTracker",
    "Offsets",
    "PlainTerms",
    "PoseConditions",
    "ScattersJoints",
    "SessionInfo",
    "ShapesNoise",
    "SimulatedEffect",
    "TermFamily",
    "TrackerMotion",
    "VirtualEffect",
    "absent",
    "approach_of",
    "by_joint",
    "in_order",
    "joint_terms",
    "last_move_of",
    "levers",
    "rates_in",
    "rates_of",
    "refuse_negative",
    "structure_values",
    "turning_joints",
]

PAYLOAD, TIME, TEMPERATURE = "payload_kg", "time_s", "temp_C"
CHANGING_WITH_TIME = (TIME, PLACE, TEMPERATURE)  # slowly, from pose to pose: what follows them looks like wandering
REFERENCE_C = 20.0  # at which lengths are stated (ISO 1:2022)
BUMPED = SESSION + "2"  # 1 of the rows after a bump
HOUR_S = 3600.0
LARGEST_PAYLOAD_KG, LARGEST_WARMING_C = 3.0, 20.0  # where the rank is decided
_APPROACH, _SPEED, _ACCELERATION = "approach_", "speed_", "acceleration_"


def approach_of(joint_name: str) -> str:
    """The condition that says from which side a joint came: +1 or -1."""
    return _APPROACH + joint_name


def last_move_of(joint_name: str) -> str:
    """The condition that says in which direction a joint moved last, by the order of the poses: +1 or -1."""
    return LAST_MOVE + joint_name


def absent(name: str, rows: int) -> Array:
    """A condition ``(rows,)`` where nothing is said of it: none, or as warm as where lengths are stated."""
    return np.full(rows, REFERENCE_C if name == TEMPERATURE else 0.0)


def rates_of(joint_names: Sequence[str]) -> tuple[str, ...]:
    """The conditions that say how the joints move: speeds, then accelerations, rad or m per s and per s^2."""
    return (*(_SPEED + name for name in joint_names), *(_ACCELERATION + name for name in joint_names))


def rates_in(conditions: Array, joints: int) -> tuple[Array, Array]:
    """Speeds and accelerations ``(n, joints)`` of conditions ``(n, c)`` that end with those of ``rates_of``."""
    return conditions[:, -2 * joints : -joints], conditions[:, -joints:]


def in_order(names: Sequence[str]) -> tuple[str, ...]:
    """Conditions, each once, in the order of a file's columns: payload, approaches, time, temperature, sessions."""
    ranks = {PAYLOAD: 0, TIME: 2, TEMPERATURE: 3}
    return tuple(sorted(dict.fromkeys(names), key=lambda name: ranks.get(name, 1 if name.startswith(_APPROACH) else 4)))


def structure_values(name: str, count: int, rng: np.random.Generator) -> Array:
    """Values ``(count,)`` of a condition at which the rank is decided."""
    if name == PAYLOAD:
        return rng.choice([0.0, LARGEST_PAYLOAD_KG], count)
    if name.startswith((_APPROACH, LAST_MOVE)):
        return rng.choice([-1.0, 1.0], count)
    if name == PLACE:
        return rng.uniform(0.0, 1.0, count)
    if name == TEMPERATURE:
        return rng.uniform(REFERENCE_C, REFERENCE_C + LARGEST_WARMING_C, count)
    if name.startswith((SESSION, STATION)):
        return rng.choice([0.0, 1.0], count)
    if name.startswith((_SPEED, _ACCELERATION)):
        return rng.normal(size=count)
    return rng.uniform(0.0, HOUR_S, count)


@dataclass(frozen=True)
class PoseConditions:
    """Conditions at m poses of an arm.

    Attributes:
        columns: ``(m,)`` each, by name; where one is missing there is no payload, no approach, no time, no bump, and
            it is as warm as where lengths are stated.
    """

    columns: Mapping[str, Array]
    poses: int
    joint_names: tuple[str, ...]

    def __post_init__(self) -> None:
        for name in (PAYLOAD, TIME, TEMPERATURE, BUMPED, *map(approach_of, self.joint_names)):
            column = self.columns.get(name)
            if column is not None and (column.shape != (self.poses,) or not np.isfinite(column).all()):
                raise LabError(f"condition {name}: give one finite number for each of {self.poses} poses")

    def column(self, name: str) -> Array:
        """Return one condition ``(m,)``; its default if it is missing."""
        return self.columns.get(name, absent(name, self.poses))

    @property
    def warmer(self) -> Array:
        """Temperature above the reference temperature of lengths ``(m,)``, K."""
        return self.column(TEMPERATURE) - REFERENCE_C

    @property
    def approach(self) -> Array:
        """Direction of approach of each joint ``(m, n)``."""
        return np.stack([self.column(approach_of(name)) for name in self.joint_names], axis=1)


Offsets = Callable[[Array, Array, Array], tuple[Array, Array]]
PlainTerms = Callable[[Array], Sequence[Mapping[str, Any]]]
Moves = Literal["joints", "frame", "links", "size", "station"]
AXES = ("x", "y", "z", "rx", "ry", "rz")
LEVER_M = 0.3  # a slide's sizes are those of a hinge at this distance: rad times this, Nm/rad over its square


@dataclass(frozen=True)
class SessionInfo:
    """Session metadata of a campaign.

    Attributes:
        sessions: in their order.
        start_s: when its clock was started.
        timed: whether it had one.
        stations: of its instrument, the one first in whose frame the arm's base is; one alone needs no name.
    """

    sessions: tuple[str, ...] = ()
    start_s: float = 0.0
    timed: bool = True
    stations: tuple[str, ...] = ()


NO_SESSIONS = SessionInfo()


@dataclass(frozen=True)
class ArmFacts:
    """Facts about the arm that are given to an effect.

    Attributes:
        chain: the nominal joints.
        loads: the masses.
        sessions: how the campaign went.
        moving: whether its groups are to know how the joints move (``rates_of``): inertia loads it too.
        sections: ``(n, 4)`` the links' compliances (``beam.COMPLIANCES``) by the robot's description, if it has them.
    """

    chain: JointSpec
    loads: Loads | None = None
    sessions: SessionInfo = NO_SESSIONS
    sections: Array | None = None
    moving: bool = False


@dataclass(frozen=True)
class Effect:
    """A fitted group of parameters, all zero in the nominal model.

    Functions like these cannot be pickled, so that it is pickled as the call that makes it, ``made_by``.

    Attributes:
        name: of the group, e.g. ``compliance``.
        parameters: what they are, e.g. ``joint2.compliance``.
        offsets: joint positions ``(n, joints)``, conditions ``(n, c)`` and parameters ``(p,)`` to how far the
            joints are from their measured positions ``(n, joints)`` (rad, m of a slide), and the derivatives
            ``(n, joints, p)``. An effect that moves the frame gives seven numbers instead: by which
            the measured points p are shifted v, turned r and stretched s: (1 + s) exp(r) (p + v). So does one that
            says where the instrument stands (``station``), on the points as the frame has moved. One that moves
            links gives six for each of ``links``: the torsor of its far end (``serial.walk.Torsors``). One that
            changes the arm's size gives one: the share by which all its lengths grow.
        conditions: columns of ``Measurements.conditions`` that it asks for.
        moves: the joints, the frame in which points are measured, the far ends of links, the size of the arm, or the
            whole instrument.
        typical: values at which the rank is decided, where zeros would hide a parameter.
        links: those whose far ends it moves, from 0; none unless it moves links.
        plain: parameters ``(p,)`` to the terms of ``formats.plain_arm`` that say the same, by which ``calibrated.py``
            has the effect; None where it cannot.
        made_by: the call that makes it again, in another process too; None of an effect that cannot be pickled.
    """

    name: str
    parameters: tuple[Parameter, ...]
    offsets: Offsets = field(compare=False)
    conditions: tuple[str, ...] = ()
    moves: Moves = "joints"
    typical: tuple[float, ...] = ()
    links: tuple[int, ...] = ()
    plain: PlainTerms | None = field(default=None, compare=False)
    made_by: "Callable[[], Effect] | None" = None

    def __reduce__(self) -> "tuple[Callable[..., Effect], tuple[Any, ...]]":
        if self.made_by is None:
            raise TypeError(f"effect {self.name}: it does not say what makes it (made_by), so it cannot be pickled")
        return _made, (self.made_by,)


def _made(made_by: "Callable[[], Effect]") -> Effect:
    return made_by()


@dataclass(frozen=True)
class FittedGroup:
    """A group that ``--model`` can name.

    Attributes:
        fitted: the group for an arm; it raises a LabError where the arm cannot have it.
        meaning: what its name does not say, for the help.
        of_one_campaign: it says nothing of another day.
        is_candidate: ``--model auto`` tries it.
    """

    name: str
    fitted: Callable[[ArmFacts], Effect]
    meaning: str = ""
    of_one_campaign: bool = False
    is_candidate: bool = True


@dataclass(frozen=True)
class TermFamily:
    """Groups of one joint or link each, with that and a number in their names: ``joint2.harmonic20``.

    There are too many to try each by an exact fit: ``--model auto`` searches all of them at once.

    Attributes:
        symbol: what stands between the two numbers.
        number: what the second one counts, for the help; empty where a name has none (``joint2.backlash``).
        fitted: the group of a joint, from 0, and a number (0 where a name has none); a LabError where the arm has no
            such.
        searched: the pairs of a joint, from 0, and a number that are searched for an arm.
        words: what such a group says of the arm, from the two numbers of its name.
        expected: those of the pairs that the robot's description leads one to expect: the search begins with them.
        owner: what the first number counts, ``joint`` or ``link``.
    """

    symbol: str
    number: str
    fitted: Callable[[ArmFacts, int, int], Effect]
    searched: Callable[[ArmFacts], Sequence[tuple[int, int]]]
    describe: Callable[[int, int], str]
    expected: Callable[[ArmFacts], Sequence[tuple[int, int]]] = lambda _: ()
    owner: Literal["joint", "link"] = "joint"

    def name(self, joint: int, number: int = 0) -> str:
        """Return the name of the group of a joint or link, from 0, and a number."""
        return f"{self.owner}{joint + 1}.{self.symbol}{number or ''}"


@dataclass(frozen=True)
class SimulatedEffect(ABC):
    """An effect of one virtual arm with n joints, in SI units; it is off at zero.

    What it does is said by the classes that it also derives from: ``MovesJoints``, ``MovesArm``, ``MovesTracker``,
    ``ChangesJointPositions``, ``ScattersJoints``, ``DisplacesReadings``, ``ShapesNoise``.
    """

    @classmethod
    @abstractmethod
    def none(cls, joints: int) -> Self:
        """Return the effect at zero, on an arm of so many joints."""

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """Names of the conditions that matter to it."""
        return ()

    def true_parameters(self) -> dict[str, float]:
        """Its share of what an identifier should find, by the parameters' names; shares of several effects add up."""
        return {}

    def obscured(self) -> tuple[str, ...]:
        """Names of parameters that have no true value while it is on."""
        return ()

    def refuse_unfit(self, chain: JointSpec) -> None:  # noqa: B027 (most fit every arm)
        """A LabError where an arm with these joints cannot have it."""


class MovesJoints(ABC):
    """An effect that offsets the joints from their measured positions, equally at every visit."""

    addition_order: ClassVar[int] = 0  # lower ones are added first, so that sums keep their rounding

    @abstractmethod
    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """``(m, n)`` rad or m, at measured joint positions ``(m, n)``."""


class MovesArm(ABC):
    """An effect that moves the arm's points in the world."""

    @abstractmethod
    def moved(self, points: Array, base: Array, conditions: PoseConditions) -> Array:
        """Points of the arm ``(m, k, 3)`` after it moved, its foot ``(3,)`` in the same frame."""


class MovesTracker(ABC):
    """An effect that moves the tracker."""

    @abstractmethod
    def seen_after(self, points: Array, conditions: PoseConditions) -> Array:
        """Points ``(m, k, 3)`` of the tracker's first frame in its frame at each pose."""


@dataclass(frozen=True)
class TrackerMotion(SimulatedEffect, MovesTracker):
    """The tracker moves in one way, more or less of it at a pose.

    Attributes:
        motion: ``(6,)`` in its own frame, m and rad, where the share is one.
        condition: the column of a pose's conditions that the share is read from.
        whole: what that column holds where the share is one.
    """

    motion: Array
    condition: ClassVar[str]
    whole: ClassVar[float] = 1.0

    @classmethod
    def none(cls, joints: int) -> Self:
        """A tracker that stays."""
        return cls(np.zeros(6))

    @classmethod
    def random(cls, size_m: float, size_rad: float, rngs: Sequence[np.random.Generator]) -> Self:
        """A shift and a turn of these sizes, in and about random directions."""
        sizes = size_m, size_rad
        return cls(np.concatenate([size * _random_direction(rng) for size, rng in zip(sizes, rngs, strict=True)]))

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the condition on which its share depends, if the tracker moves."""
        return (self.condition,) if self.motion.any() else ()

    def seen_after(self, points: Array, conditions: PoseConditions) -> Array:
        """Return the points in the tracker's frame at each pose."""
        if not self.motion.any():
            return points
        return _in_moved_frame(points, self.motion * (conditions.column(self.condition) / self.whole)[:, None])


class ChangesJointPositions(ABC):
    """An effect that makes the measured joint positions differ from the true ones."""

    @abstractmethod
    def shown(self, joints: Array) -> Array:
        """The measured joint positions ``(m, n)`` of where the joints settle, in the order visited."""


class ScattersJoints(ABC):
    """An effect that scatters the joints at each visit, at random."""

    @property
    @abstractmethod
    def is_on(self) -> bool:
        """True if it has an effect."""

    @abstractmethod
    def scatter(self, poses: int, rng: np.random.Generator) -> Array:
        """``(poses, n)`` rad or m."""


class DisplacesReadings(ABC):
    """An effect that displaces some of the measured points, at random."""

    @property
    @abstractmethod
    def is_on(self) -> bool:
        """True if it has an effect."""

    @abstractmethod
    def displacements(self, poses: int, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """Draw the displacement of all points of a pose, ``(poses, 3)`` m, and flag displaced poses ``(poses,)``."""


class ShapesNoise(ABC):
    """An effect that gives the instrument's noise another distribution."""

    @property
    @abstractmethod
    def is_on(self) -> bool:
        """True if it has an effect."""

    @property
    def is_of_a_tracker(self) -> bool:
        """True if it moves the tracker, which not every kind of measurement has."""
        return False

    @abstractmethod
    def shaped(self, noise: Array, rng: np.random.Generator) -> Array:
        """Noise ``(poses, k, 3)`` m from independent noise of the instrument, in the order of the poses."""


@dataclass(frozen=True)
class VirtualEffect(ABC):
    """The options of ``lab calibrate`` for one effect of a virtual arm, which are the fields of a subclass.

    A field's default means that the effect is off; the text below it is the option's help.

    Attributes:
        draws: how many random substreams it takes. Each is its own, so that one effect leaves the draws of the others
            as they are.
        groups: what of it is fitted.
        terms: what of it is fitted joint by joint.
    """

    draws: ClassVar[int] = 0
    groups: ClassVar[tuple[FittedGroup, ...]] = ()
    terms: ClassVar[tuple[TermFamily, ...]] = ()

    def check(self) -> None:  # noqa: B027 (most have nothing to add)
        """Refuse numbers that make no sense together, with a LabError that names the option.

        That each is finite and not negative is checked beforehand.
        """

    @abstractmethod
    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """The effect of one arm, as large as the options say; None of options that describe no effect.

        Args:
            rngs: ``draws`` of them.
        """


def _in_moved_frame(points: Array, moved: Array) -> Array:
    """Points ``(m, k, 3)`` in a frame that has moved by ``(m, 6)``, m and rad, in itself."""
    Ts_first_now = se3.pose(se3.exp(moved[:, 3:]), moved[:, :3])
    return se3.transform(se3.inverse(Ts_first_now), points)


def turning_joints(chain: JointSpec) -> tuple[int, ...]:
    """The hinges, from 0."""
    return tuple(i for i in range(chain.size) if not chain.prismatic[i])


def by_joint(signals: Array, values: Array) -> tuple[Array, Array]:
    """Offsets ``(n, joints)``, each a signal times the joint's own parameter, and derivatives ``(n, joints, joints)``.

    Args:
        signals: ``(n, joints)``, or ``(n, 1)`` where one is of all joints.
        values: ``(joints,)``.
    """
    joints = np.arange(len(values))
    derivative = np.zeros((len(signals), len(values), len(values)))
    derivative[:, joints, joints] = signals
    return signals * values, derivative


def joint_terms(values: Array, *where: tuple[int, Sequence[Any]], times: float = 1.0) -> list[dict[str, Any]]:
    """Terms of ``formats.plain_arm``: each parameter times a signal is an offset of a joint.

    Args:
        values: ``(p,)``.
        where: of each parameter its joint, from 0, and the signal.
        times: a factor of all of them.
    """
    pairs = zip(where, values.tolist(), strict=True)
    return [{"joint": i, "times": times * value, "of": list(signal)} for (i, signal), value in pairs]


def levers(chain: JointSpec) -> Array:
    """``(n,)``, 1 of a hinge, and of a slide how many m are like one rad."""
    return np.where(chain.prismatic, LEVER_M, 1.0)


def _random_direction(rng: np.random.Generator) -> Array:
    """A unit vector ``(3,)``, any direction as likely."""
    vector = rng.standard_normal(3)
    unit: Array = vector / np.linalg.norm(vector)
    return unit


def refuse_negative(name: str, values: Array) -> None:
    """A LabError where an entry is below zero."""
    if (values < 0).any():
        raise LabError(f"effects: {name} has a negative entry; give zero or more")
