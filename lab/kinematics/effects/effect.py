"""Effects: a fitted group of parameters, its simulated counterpart, and the options that select it.

Each module of this folder has one effect or a small family; ``effect_registry`` lists them. Conditions are set or read
at each pose beside the joints: payload, approach, time, temperature, sessions; along a trajectory also rates of the
joints.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.measurements import BEFORE, LAST_MOVE, PLACE, SESSION, STATION
from lab.core.se3 import Array
from lab.extension_points import Part, PartKind
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import Parameter

__all__ = [
    "AXES",
    "BUMPED",
    "CHANGING_WITH_TIME",
    "FREE_RANGE",
    "HOUR_S",
    "LEVER_M",
    "NO_SESSIONS",
    "OWN_EFFECTS",
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
    "OnePerJoint",
    "PlainOffsets",
    "PlainTerms",
    "PoseConditions",
    "RangePrior",
    "ScattersJoints",
    "SessionInfo",
    "ShapesNoise",
    "SimulatedEffect",
    "Step",
    "TermFamily",
    "TrackerMotion",
    "VirtualEffect",
    "Wave",
    "absent",
    "approach_of",
    "from_signals",
    "in_order",
    "is_usual",
    "last_move_of",
    "levers",
    "rates_in",
    "rates_of",
    "refuse_negative",
    "structure_values",
    "turning_joints",
]

PAYLOAD, TIME, TEMPERATURE = "payload_kg", "time_s", "temp_C"
CHANGING_WITH_TIME = (TIME, PLACE, TEMPERATURE)  # slowly: their effects look like autocorrelated errors
REFERENCE_C = 20.0  # reference temperature of lengths (ISO 1:2022)
BUMPED = SESSION + "2"  # condition 1 after a bump
HOUR_S = 3600.0
LARGEST_PAYLOAD_KG, LARGEST_WARMING_C = 3.0, 20.0  # for decisions on rank
_APPROACH, _SPEED, _ACCELERATION = "approach_", "speed_", "acceleration_"


def approach_of(joint_name: str) -> str:
    """Return the condition of a joint's direction of approach: +1 or -1."""
    return _APPROACH + joint_name


def last_move_of(joint_name: str) -> str:
    """Return the condition of a joint's last direction of motion, by the order of the poses: +1 or -1."""
    return LAST_MOVE + joint_name


def absent(name: str, rows: int) -> Array:
    """Return the default ``(rows,)`` of a condition: zero, or the reference temperature."""
    return np.full(rows, REFERENCE_C if name == TEMPERATURE else 0.0)


def rates_of(joint_names: Sequence[str]) -> tuple[str, ...]:
    """Return the conditions of the joints' speeds, then accelerations, rad or m per s and per s^2."""
    return (*(_SPEED + name for name in joint_names), *(_ACCELERATION + name for name in joint_names))


def rates_in(conditions: Array, joints: int) -> tuple[Array, Array]:
    """Return speeds and accelerations ``(n, joints)`` at the end of conditions ``(n, c)``."""
    return conditions[:, -2 * joints : -joints], conditions[:, -joints:]


def is_usual(name: str) -> bool:
    """Check whether the lab knows a condition by its name; others are columns that own effects name."""
    return name in (PAYLOAD, TIME, TEMPERATURE, PLACE) or name.startswith(
        (_APPROACH, LAST_MOVE, SESSION, STATION, BEFORE, _SPEED, _ACCELERATION)
    )


def in_order(names: Sequence[str]) -> tuple[str, ...]:
    """Return unique conditions in the order of a file's columns: payload, approaches, time, temperature, sessions."""
    ranks = {PAYLOAD: 0, TIME: 2, TEMPERATURE: 3}
    return tuple(sorted(dict.fromkeys(names), key=lambda name: ranks.get(name, 1 if name.startswith(_APPROACH) else 4)))


def structure_values(name: str, count: int, rng: np.random.Generator) -> Array:
    """Draw values ``(count,)`` of a condition for decisions on rank."""
    if name == PAYLOAD:
        return rng.choice([0.0, LARGEST_PAYLOAD_KG], count)
    if name.startswith((_APPROACH, LAST_MOVE)):
        return rng.choice([-1.0, 1.0], count)
    if name == PLACE:
        return rng.uniform(0.0, 1.0, count)
    if name == TEMPERATURE:
        return rng.uniform(REFERENCE_C, REFERENCE_C + LARGEST_WARMING_C, count)
    if name.startswith((SESSION, STATION, BEFORE)):
        return rng.choice([0.0, 1.0], count)
    if name.startswith((_SPEED, _ACCELERATION)):
        return rng.normal(size=count)
    return rng.uniform(0.0, HOUR_S, count)


@dataclass(frozen=True)
class PoseConditions:
    """Conditions at m poses of an arm.

    Attributes:
        columns: ``(m,)`` each, by name; missing ones have the default of ``absent``.
        poses: their number.
        joint_names: of the arm.
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
        """Return one condition ``(m,)``, or its default.

        Raises:
            LabError: it is missing, and no condition of the lab that has a default.
        """
        if name not in self.columns and not is_usual(name):
            raise LabError(f"condition {name} is missing: give it for each of {self.poses} poses")
        return self.columns.get(name, absent(name, self.poses))

    @property
    def warmer(self) -> Array:
        """Temperature above the reference temperature ``(m,)``, K."""
        return self.column(TEMPERATURE) - REFERENCE_C

    @property
    def approach(self) -> Array:
        """Direction of approach of each joint ``(m, n)``."""
        return np.stack([self.column(approach_of(name)) for name in self.joint_names], axis=1)


Offsets = Callable[[Array, Array, Array], tuple[Array, Array]]
PlainTerms = Callable[[Array], Sequence[Mapping[str, Any]]]
PlainOffsets = Callable[[list[float], list[float], list[float]], Sequence[float]]
Moves = Literal["joints", "frame", "links", "size", "station", "range"]
AXES = ("x", "y", "z", "rx", "ry", "rz")
LEVER_M = 0.3  # a slide's effects are those of a hinge at this distance: rad times this, Nm/rad over its square


@dataclass(frozen=True)
class Step:
    """Something that moved between two rows of a campaign.

    Attributes:
        kind: ``base_step``, ``tool_step`` or ``joint_step``.
        place: progress of the campaign (``PLACE``) at which it happened.
        joint: its joint, from 0; -1 where it is none.
    """

    kind: str
    place: float
    joint: int = -1


@dataclass(frozen=True)
class RangePrior:
    """Standard deviations of a tracker's range errors, whose best estimate is zero.

    Attributes:
        constant_m: of the constant.
        scale: of the scale, relative.
    """

    constant_m: float
    scale: float

    @property
    def is_stated(self) -> bool:
        """Check whether the instrument's file states the constant."""
        return self.constant_m < FREE_RANGE.constant_m

    @property
    def freed(self) -> Self:
        """The prior with a constant of any size."""
        return replace(self, constant_m=FREE_RANGE.constant_m)


FREE_RANGE = RangePrior(1e-2, 8.5e-4)
"""Of an instrument that states nothing: radii of reflectors differ by as much as its constant, and the two long links
of 19 UR arms by as much as its scale, by their factory calibrations (1 sigma)."""


@dataclass(frozen=True)
class SessionInfo:
    """Session metadata of a campaign.

    Attributes:
        sessions: in their order.
        start_s: start of its clock.
        timed: True if it had a clock.
        stations: of its instrument, the first one defining the frame.
        steps: that were found in its rows.
        range_prior: of the range errors of an instrument whose head is the frame's origin; None where it is unknown.
    """

    sessions: tuple[str, ...] = ()
    start_s: float = 0.0
    timed: bool = True
    stations: tuple[str, ...] = ()
    steps: tuple[Step, ...] = ()
    range_prior: RangePrior | None = None


NO_SESSIONS = SessionInfo()


@dataclass(frozen=True)
class ArmFacts:
    """Properties of the arm for an effect.

    Attributes:
        chain: the nominal joints.
        loads: the masses.
        sessions: the sessions and stations of the measurements.
        moving: effects depend on the joints' rates (``rates_of``): inertia is a load, too.
        sections: ``(n, 4)`` the links' compliances (``beam.COMPLIANCES``) of the robot's description.
    """

    chain: JointSpec
    loads: Loads | None = None
    sessions: SessionInfo = NO_SESSIONS
    sections: Array | None = None
    moving: bool = False


@dataclass(frozen=True)
class Wave:
    """Sine and cosine of a joint's position, times an order, as the two functions of a group that moves one thing.

    Attributes:
        turning: the joint, from 0.
        component: the joint that is moved, or, of a link's far end, one of its six motions.
    """

    order: int
    turning: int
    component: int

    @staticmethod
    def together(waves: "Sequence[Wave]", joints: Array) -> Array:
        """Return the functions ``(n, w, 2)`` of w waves at joint positions ``(n, joints)``."""
        angles = joints[:, [wave.turning for wave in waves]] * np.array([wave.order for wave in waves])
        return np.stack([np.sin(angles), np.cos(angles)], axis=2)


@dataclass(frozen=True)
class Effect:
    """A fitted group of parameters, all zero in the nominal model.

    Its functions cannot be pickled: it is pickled as the call that makes it, ``made_by``.

    Attributes:
        name: of the group, e.g. ``compliance``.
        parameters: e.g. ``joint2.compliance``.
        offsets: from joint positions ``(n, joints)``, conditions ``(n, c)`` and parameters ``(p,)`` to offsets of the
            joints ``(n, joints)`` (rad, m of a slide), and derivatives ``(n, joints, p)``. An effect on the frame has
            seven numbers instead: measured points p are shifted v, turned r and stretched s: (1 + s) exp(r) (p + v); so
            has ``station``, after the frame's motion. One on links has six for each of ``links``: the torsor of its far
            end (``serial.walk.Torsors``). One on the size has one: the relative growth of all lengths. One on the range
            has two, after all others: constant and scale of the instrument's range (``range_errors``).
        conditions: required columns of ``Measurements.conditions``.
        moves: the joints, the frame of the measured points, the links' far ends, the arm's size, the instrument, or
            its range.
        typical: values for decisions on rank, if zeros would hide a parameter.
        links: links with displaced far ends, from 0.
        terms: of the lab's own, from parameters ``(p,)`` to terms of ``formats.plain_arm``, for ``calibrated.py``.
        plain: in place of terms ``offsets`` at one pose in plain Python: from lists of joint positions, conditions and
            parameters to a list of the numbers. ``calibrated.py`` holds its text, so it uses its arguments and ``math``
            alone. Without both the module refuses.
        stacks: whether ``offsets`` takes parameters ``(b, 1, p)`` of b arms, too: offsets ``(b, n, joints)``, and
            derivatives ``(b, n, joints, p)`` or, where all arms have the same, ``(n, joints, p)``.
        wave: what ``offsets`` is, where it is one wave; None where it is something else.
        made_by: the call that makes it again; None if it cannot be pickled.
    """

    name: str
    parameters: tuple[Parameter, ...]
    offsets: Offsets = field(compare=False)
    conditions: tuple[str, ...] = ()
    moves: Moves = "joints"
    typical: tuple[float, ...] = ()
    links: tuple[int, ...] = ()
    terms: PlainTerms | None = field(default=None, compare=False)
    plain: PlainOffsets | None = field(default=None, compare=False)
    stacks: bool = field(default=False, compare=False)
    wave: Wave | None = None
    made_by: "Callable[[], Effect] | None" = None

    def __reduce__(self) -> "tuple[Callable[..., Effect], tuple[Any, ...]]":
        if self.made_by is None:
            raise TypeError(f"effect {self.name}: it does not say what makes it (made_by), so it cannot be pickled")
        return self.made_by, ()


@dataclass(frozen=True)
class FittedGroup:
    """A group for ``--model``.

    Attributes:
        name: of the group, and of its effect.
        fitted: makes the group for an arm, or raises a LabError.
        meaning: addition to the name in the help.
        of_one_campaign: not valid for another session.
        is_candidate: tried by ``--model auto``. A package's group is tried only where it is named: ``auto+NAME``.
    """

    name: str
    fitted: Callable[[ArmFacts], Effect]
    meaning: str = ""
    of_one_campaign: bool = False
    is_candidate: bool = True


@dataclass(frozen=True)
class TermFamily:
    """Groups of one joint or link each, with that and a number in their names: ``joint2.harmonic20``.

    They are too many for an exact fit of each: ``--model auto`` searches all at once.

    Attributes:
        symbol: text between the two numbers.
        number: meaning of the second number, for the help; empty without one (``joint2.backlash``).
        fitted: makes the group of a joint, from 0, and a number (0 without one), or raises a LabError.
        searched: pairs of a joint, from 0, and a number that are searched for an arm.
        describe: describes a group by the two numbers of its name.
        expected: pairs that the robot's description suggests: the search begins with them.
        owner: kind of the first number, ``joint`` or ``link``.
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
    """An effect of one virtual arm with n joints, in SI units; zero is off.

    Subclasses derive from the classes of what it changes, too: ``MovesJoints``, ``MovesArm``, ``MovesTracker``,
    ``ChangesJointPositions``, ``ScattersJoints``, ``DisplacesReadings``, ``ShapesNoise``.
    """

    @classmethod
    @abstractmethod
    def none(cls, joints: int) -> Self:
        """Return the effect at zero."""

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the conditions that it depends on."""
        return ()

    def drawn_conditions(self, poses: int, rng: np.random.Generator) -> Mapping[str, Array]:
        """Draw the conditions ``(poses,)`` that the lab does not make, by name, at poses in their order."""
        return {}

    def true_parameters(self) -> dict[str, float]:
        """Return its contribution to the true parameters, by name."""
        return {}

    def obscured(self) -> tuple[str, ...]:
        """Return the parameters without a true value while it is on."""
        return ()

    def refuse_unfit(self, chain: JointSpec) -> None:  # noqa: B027 (most fit every arm)
        """Raise a LabError if an arm with these joints cannot have it."""


@dataclass(frozen=True)
class OnePerJoint(SimulatedEffect, ABC):
    """An effect of one number for each joint: its first field.

    Attributes:
        symbol: of the joints' parameters that hold these numbers; "" where they are no parameters.
    """

    symbol: ClassVar[str] = ""

    @classmethod
    def none(cls, joints: int) -> Self:
        """Return zeros."""
        return cls(np.zeros(joints))  # type: ignore[call-arg]

    def true_parameters(self) -> dict[str, float]:
        """Return the numbers by their parameters."""
        values = getattr(self, fields(self)[0].name) if self.symbol else ()
        return {f"joint{i + 1}.{self.symbol}": float(value) for i, value in enumerate(values)}


class MovesJoints(ABC):
    """An effect that offsets the joints from their measured positions, equally at every visit."""

    addition_order: ClassVar[int] = 0  # lower ones are added first, so that sums keep their rounding

    @abstractmethod
    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """Return offsets ``(m, n)`` rad or m, at measured joint positions ``(m, n)``."""


class MovesArm(ABC):
    """An effect that moves the arm's points in the world."""

    @abstractmethod
    def moved(self, points: Array, base: Array, conditions: PoseConditions) -> Array:
        """Return points of the arm ``(m, k, 3)`` after its motion; its base is at ``(3,)`` in their frame."""


class MovesTracker(ABC):
    """An effect that moves the tracker, or changes what it measures."""

    seeing_order: ClassVar[int] = 0  # lower ones come first: what the head measures is after all motions

    @abstractmethod
    def seen_after(self, points: Array, conditions: PoseConditions) -> Array:
        """Return points ``(m, k, 3)`` of the tracker's first frame in its frame at each pose."""


@dataclass(frozen=True)
class TrackerMotion(SimulatedEffect, MovesTracker):
    """A motion of the tracker, in proportion to a condition.

    Attributes:
        motion: ``(6,)`` in its own frame, m and rad, for a share of one.
        condition: the condition of the share.
        whole: value of the condition for a share of one.
    """

    motion: Array
    condition: ClassVar[str]
    whole: ClassVar[float] = 1.0

    @classmethod
    def none(cls, joints: int) -> Self:
        """Return a tracker at rest."""
        return cls(np.zeros(6))

    @classmethod
    def random(cls, size_m: float, size_rad: float, rngs: Sequence[np.random.Generator]) -> Self:
        """Draw the directions of a shift and a turn of these sizes."""
        sizes = size_m, size_rad
        return cls(np.concatenate([size * _random_direction(rng) for size, rng in zip(sizes, rngs, strict=True)]))

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the condition on which its share depends, if the tracker moves."""
        return (self.condition,) if self.motion.any() else ()

    def seen_after(self, points: Array, conditions: PoseConditions) -> Array:
        """Return the points in the tracker's frame at each pose."""
        if not self.motion.any():
            return points
        moved = self.motion * (conditions.column(self.condition) / self.whole)[:, None]
        Ts_first_now = se3.pose(se3.exp(moved[:, 3:]), moved[:, :3])
        return se3.transform(se3.inverse(Ts_first_now), points)


class ChangesJointPositions(ABC):
    """An effect on the measured joint positions."""

    @abstractmethod
    def shown(self, joints: Array) -> Array:
        """Return the measured positions ``(m, n)`` of settled joints, in the order visited."""


class ScattersJoints(ABC):
    """An effect that scatters the joints at each visit."""

    @property
    @abstractmethod
    def is_on(self) -> bool:
        """True if it has an effect."""

    @abstractmethod
    def scatter(self, poses: int, rng: np.random.Generator) -> Array:
        """Draw scatter ``(poses, n)`` rad or m."""


class DisplacesReadings(ABC):
    """An effect that displaces some of the measured points."""

    @property
    @abstractmethod
    def is_on(self) -> bool:
        """True if it has an effect."""

    @abstractmethod
    def displacements(self, poses: int, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """Draw the displacement of all points of a pose, ``(poses, 3)`` m, and flag displaced poses ``(poses,)``."""


class ShapesNoise(ABC):
    """An effect on the distribution of the instrument's noise."""

    @property
    @abstractmethod
    def is_on(self) -> bool:
        """True if it has an effect."""

    @property
    def is_of_a_tracker(self) -> bool:
        """True if it moves the tracker, which some kinds of measurement do not have."""
        return False

    @abstractmethod
    def shaped(self, noise: Array, rng: np.random.Generator) -> Array:
        """Return noise ``(poses, k, 3)`` m made from independent noise, in the order of the poses."""


OWN_EFFECTS = PartKind("lab.effects", "effect", "own_effects", is_made=False)


@dataclass(frozen=True)
class VirtualEffect(Part, ABC, kind=OWN_EFFECTS):
    """Options of a virtual arm for one effect, the fields of a subclass: flags of ``lab calibrate``.

    The default of a field is no effect; the text below it is the option's help.

    Attributes:
        name: of an effect that is not the lab's: that of the group that it fits, if any.
        draws: number of its random substreams. Each is its own, so that effects do not change each other's draws.
        groups: its fitted groups.
        terms: its fitted groups of single joints.
    """

    name: ClassVar[str] = ""
    draws: ClassVar[int] = 0
    groups: ClassVar[tuple[FittedGroup, ...]] = ()
    terms: ClassVar[tuple[TermFamily, ...]] = ()

    def check(self) -> None:
        """Refuse inconsistent numbers with a LabError about the option; each is finite and not negative."""

    @abstractmethod
    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Return the effect of one arm by the options and ``draws`` generators; None for options without one."""


def turning_joints(chain: JointSpec) -> tuple[int, ...]:
    """Return the hinges, from 0."""
    return tuple(i for i in range(chain.size) if not chain.prismatic[i])


def from_signals(
    group: str,
    parameters: tuple[Parameter, ...],
    joints: Sequence[int],
    signals: Callable[[Array, Array], Array],
    plain: Sequence[Sequence[Any]],
    conditions: tuple[str, ...] = (),
    times: float = 1.0,
    wave: Wave | None = None,
) -> Effect:
    """Return a fitted group of joint offsets, each a parameter times a signal.

    Args:
        joints: joint of each parameter, from 0.
        signals: from joint positions and conditions to signals ``(n, p)``.
        plain: the signals in ``formats.plain_arm``.
        times: a common factor.
        wave: what the signals are, where they are one wave.
    """
    where = list(zip(joints, plain, strict=True))

    def offsets(positions: Array, given: Array, values: Array) -> tuple[Array, Array]:
        columns = times * signals(positions, given)
        derivative = np.zeros((*positions.shape, len(parameters)), dtype=columns.dtype)
        derivative[:, joints, range(len(parameters))] = columns
        if values.ndim == 1:
            return derivative @ values, derivative
        moved = values[:, 0] @ derivative.reshape(-1, len(parameters)).T
        return moved.reshape(len(values), *positions.shape), derivative

    def terms(values: Array) -> list[dict[str, Any]]:
        pairs = zip(where, values.tolist(), strict=True)
        return [{"joint": joint, "times": times * value, "of": list(signal)} for (joint, signal), value in pairs]

    return Effect(group, parameters, offsets, conditions, terms=terms, stacks=True, wave=wave)


def levers(chain: JointSpec) -> Array:
    """Return ``(n,)``, 1 for a hinge, and for a slide the m equivalent to one rad."""
    return np.where(chain.prismatic, LEVER_M, 1.0)


def _random_direction(rng: np.random.Generator) -> Array:
    vector = rng.standard_normal(3)
    return np.asarray(vector / np.linalg.norm(vector))


def refuse_negative(name: str, values: Array) -> None:
    """Raise a LabError if an entry is below zero."""
    if (values < 0).any():
        raise LabError(f"effects: {name} has a negative entry; give zero or more")
