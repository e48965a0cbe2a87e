"""Targets, moves and frames in the text of controllers' programs, and the notation of poses.

A rotation has many forms: a quaternion and its negative, angles half a turn away, rotation vectors a whole turn away,
and at gimbal lock any two angles. The form nearest to the numbers of the text is written.

The posture of an arm is the sides of its wrist and its elbow. The wrist's centre is the point of axis 5 nearest to axis
4. In front is its side of axis 1 at zero joint positions; the upper elbow is above the line from axis 2 to a wrist in
front.
"""

import re
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError, option_name
from lab.core.limits import COORDINATE_SIZE, DIGITS, PROGRAM_FRAMES, PROGRAM_MOVES, ROUNDED_NORM
from lab.core.se3 import Array
from lab.kinematics.inverse.closed_form import ZeroAxes
from lab.kinematics.model import RigidArm
from lab.kinematics.serial.chain import Chain

__all__ = [
    "FIXED_XYZ",
    "MOVING_XYZ",
    "MOVING_ZYX",
    "NUMBER",
    "QUATERNION",
    "ROTATION_VECTOR",
    "Allowed",
    "ArmShape",
    "Motion",
    "Move",
    "Number",
    "Outside",
    "PoseSpelling",
    "Postures",
    "ProgramReader",
    "ProgramText",
    "TargetText",
    "Uncorrected",
    "line_of",
    "masked",
    "postures_of",
    "refuse_unknown_frames",
    "replaced",
    "values_of",
    "whole_number",
    "written",
]

_LOCKED = 1e-7  # cosine of the middle angle at gimbal lock
_TURN, _HALF = 360.0, 180.0


@dataclass(frozen=True)
class PoseSpelling:
    """Notation of a pose in a controller: three coordinates and three or four numbers of a rotation.

    Attributes:
        per_m: number of length units in a metre.
        parts: number of a rotation's numbers.
        rotation: from these numbers to ``(3, 3)``.
        near: from a rotation ``(3, 3)`` to its numbers nearest to others.
        description: units and meaning.
    """

    per_m: float
    parts: int
    rotation: Callable[[Array], Array]
    near: Callable[[Array, Array], Array]
    description: str

    def pose(self, values: Array) -> Array:
        """Return the pose ``(4, 4)`` (m) of numbers."""
        return se3.pose(self.rotation(values[3:]), values[:3] / self.per_m)

    def spelt(self, T: Array, was: Array) -> Array:
        """Return the numbers of a pose ``(4, 4)`` (m), nearest to those of a text.

        Changes are added to the text's numbers, so that a rounded quaternion keeps its length.
        """
        same = self.near(self.rotation(was[3:]), was[3:])
        length = float(np.linalg.norm(was[3:])) if self.parts == 4 else 1.0
        turned = was[3:] + length * (self.near(T[:3, :3], was[3:]) - same)
        return np.concatenate([self.per_m * T[:3, 3], turned])


def _quaternion_near(R: Array, was: Array) -> Array:
    quaternion = se3.quaternion_from_rotation(R)
    return quaternion if quaternion @ was >= 0 else -quaternion


def _vector_near(R: Array, was: Array) -> Array:
    """Return the rotation vector nearest to another one, by whole turns about its axis."""
    vector = se3.log(R)
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        axis = was / np.linalg.norm(was) if np.linalg.norm(was) > np.pi else np.zeros(3)
        return np.asarray(vector + axis * 2 * np.pi * np.round(np.linalg.norm(was) / (2 * np.pi)))
    axis = vector / angle
    return np.asarray(axis * (angle + 2 * np.pi * np.round((axis @ was - angle) / (2 * np.pi))))


def _fixed_matrix(values: Array) -> Array:
    return se3.rotation_from_roll_pitch_yaw(np.deg2rad(values))


def _fixed_near(R: Array, was: Array) -> Array:
    """Return angles (deg) about the fixed axes x, y and z nearest to others."""
    middle = np.hypot(R[0, 0], R[1, 0])
    if middle < _LOCKED:
        last = np.deg2rad(was[2])
        back = se3.exp(np.array([0.0, 0.0, -last])) @ R
        pitch = np.arctan2(-back[2, 0], back[0, 0])
        first = np.arctan2(-back[1, 2], back[1, 1])
        angles = np.rad2deg([first, pitch, last])
    else:
        angles = np.rad2deg(se3.roll_pitch_yaw(R))
    choices = [angles, np.array([angles[0] + _HALF, _HALF - angles[1], angles[2] + _HALF])]
    near = [each + _TURN * np.round((was - each) / _TURN) for each in choices]
    best = np.asarray(min(near, key=lambda each: float(np.abs(each - was).sum())))
    usual = np.abs(was) <= _HALF  # numbers within half a turn stay so
    return np.where(usual & (np.abs(best) > _HALF), best - _TURN * np.sign(best), best)


QUATERNION = PoseSpelling(1e3, 4, se3.rotation_from_quaternion, _quaternion_near, "mm and a quaternion wxyz")
MOVING_ZYX = PoseSpelling(
    1e3,
    3,
    lambda values: _fixed_matrix(values[::-1]),
    lambda R, was: _fixed_near(R, was[::-1])[::-1],
    "mm and degrees, A about z, B new y, C new x",
)
FIXED_XYZ = PoseSpelling(1e3, 3, _fixed_matrix, _fixed_near, "mm and degrees about the fixed x, y and z")
MOVING_XYZ = PoseSpelling(
    1e3,
    3,
    lambda values: _fixed_matrix(-values).T,
    lambda R, was: -_fixed_near(R.T, -was),  # the inverse of turns about the fixed axes, by opposite angles
    "mm and degrees, Rx about x, Ry about the new y, Rz about the new z",
)
ROTATION_VECTOR = PoseSpelling(1.0, 3, se3.exp, _vector_near, "m and a rotation vector, rad")


NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_MOST_DIGITS = int(DIGITS.most)
_NOTHING = 1e-9  # m, mm, rad, degrees or pulses: no change
_ALIGNED = "  "  # before a number that is aligned to the right


class Number(NamedTuple):
    """A number in a text.

    Attributes:
        start: index of its first character.
        text: as written.
    """

    start: int
    text: str

    @property
    def value(self) -> float:
        """Value of the number."""
        return float(self.text)

    @property
    def digits(self) -> int:
        """Number of decimals, with the exponent."""
        mantissa, _, exponent = self.text.lower().partition("e")
        _, _, places = mantissa.partition(".")
        if not float(self.text):
            return len(places)
        return int(min(max(len(places) - float(exponent or 0), 0), _MOST_DIGITS))


def values_of(numbers: Sequence[Number]) -> Array:
    """Return the values of numbers."""
    values = [each.value for each in numbers]
    for each, value in zip(numbers, values, strict=True):
        if abs(value) not in COORDINATE_SIZE:
            odd = each.text if len(each.text) < 40 else each.text[:37] + "..."
            raise LabError(f"{odd} is too large for a position; mend the program")
    return np.array(values)


def written(number: Number, value: float, digits: int) -> str:
    """Return another value in the form of a number; unchanged if equal to its last digit.

    Args:
        digits: least number of decimals.
    """
    least = max(number.digits, digits)
    if abs(value - number.value) <= max(0.5 * 10.0**-least, _NOTHING):
        return number.text
    text = f"{round(value, least) + 0.0:.{least}f}"
    mantissa = number.text.lower().partition("e")[0]
    if mantissa.endswith(".") and least == 0:
        text += "."
    if re.match(r"[+-]?\.", mantissa):
        text = re.sub(r"^(-?)0\.", r"\1.", text)
    return f"+{text}" if mantissa[0] == "+" and value >= 0 else text


def whole_number(digits: str) -> str:
    """Return digits without leading zeros: 01 and 1 number the same tool."""
    return digits.lstrip("0") or "0"


def line_of(text: str, offset: int) -> int:
    """Return the line of a character, from 1."""
    return bisect_right(_ends_of_lines(text), offset) + 1


@lru_cache(maxsize=4)
def _ends_of_lines(text: str) -> list[int]:
    return [end.end() for end in re.finditer(r"\r\n|\n|\r", text)]


def masked(text: str, hidden: str, retained: str = '"[^"\r\n]*"') -> str:
    """Replace matches of a pattern by blanks, in place and with line ends.

    Args:
        retained: pattern to skip, as a string that contains a comment's beginning.
    """

    def blank(found: re.Match[str]) -> str:
        if found["kept"] is not None:
            return found[0]
        return re.sub(r"[^\r\n]+", lambda line: " " * len(line[0]), found[0])

    return re.sub(f"(?P<kept>{retained})|(?:{hidden})", blank, text)


def replaced(text: str, edits: Sequence[tuple[Number, str]]) -> str:
    """Replace numbers of a text by others; alignment to the right is kept.

    Args:
        edits: numbers and their replacements, none twice.
    """
    parts, last = list[str](), 0
    for number, new in sorted(edits, key=lambda edit: edit[0].start):
        between = text[last : number.start]
        longer = len(new) - len(number.text)
        if longer > 0 and between.endswith(_ALIGNED):
            room = len(between) - len(between.rstrip(" ")) - 1
            between = between[: len(between) - min(longer, room)]
        elif longer < 0 and between.endswith(_ALIGNED):
            between += " " * -longer
        parts += [between, new]
        last = number.start + len(number.text)
    assert all(a[0].start != b[0].start for a, b in pairwise(sorted(edits, key=lambda edit: edit[0].start)))
    return "".join([*parts, text[last:]])


_PARALLEL = 1e-9  # cross product of parallel axes


@dataclass(frozen=True)
class ArmShape:
    """Nominal model of an arm with six revolute joints, for its postures.

    Attributes:
        chain: nominal.
        directions, origins: ``(6, 3)`` of the axes in frame 0 at zero joint positions (m).
        wrist: ``(3,)`` m, the wrist's centre there.
        forward: ``(3,)`` unit vector across axes 1 and 2, to its side of axis 1.
    """

    chain: Chain
    directions: Array
    origins: Array
    wrist: Array
    forward: Array

    @classmethod
    def of(cls, chain: Chain) -> "ArmShape":
        """Return the shape of a nominal model."""
        axes = ZeroAxes.of(chain)
        wrist = _nearest_point(axes.origins[4], axes.directions[4], axes.origins[3], axes.directions[3])
        forward = np.cross(axes.directions[1], axes.directions[0])
        length = np.linalg.norm(forward)
        forward = forward / length if length > _PARALLEL else np.array([1.0, 0.0, 0.0])
        if (wrist - axes.origins[0]) @ forward < 0:
            forward = -forward
        return cls(chain, axes.directions, axes.origins, wrist, forward)

    def in_front(self, joints: Array) -> NDArray[np.bool_]:
        """Flag joint positions ``(n, 6)`` rad with the wrist in front of axis 1."""
        return np.asarray((self._moved(self.wrist, joints, 1, 4) - self.origins[0]) @ self.forward >= 0)

    def elbow_up(self, joints: Array) -> NDArray[np.bool_]:
        """Flag joint positions ``(n, 6)`` rad with the upper elbow."""
        shoulder, across = self.origins[1], self.directions[1]
        elbow = self._moved(self.origins[2], joints, 1, 2) - shoulder
        wrist = self._moved(self.wrist, joints, 1, 4) - shoulder
        side = np.cross(elbow, wrist) @ across
        return np.asarray(side * (np.cross(self.directions[0], self.forward) @ across) >= 0)

    def _moved(self, point: Array, joints: Array, first: int, last: int) -> Array:
        """Move the point ``(3,)`` m given at zero by joints ``first`` up to before ``last``, to ``(n, 3)``."""
        moved = np.broadcast_to(point, (len(joints), 3))
        for i in reversed(range(first, last)):
            turns = se3.exp((self.chain.sign[i] * joints[:, i])[:, None] * self.directions[i])
            moved = self.origins[i] + np.einsum("nij,nj->ni", turns, moved - self.origins[i])
        return np.asarray(moved)


@dataclass(frozen=True)
class Postures:
    """Postures of the nominal arm at some joint positions.

    Attributes:
        Ts_frame0_last: ``(s, 4, 4)`` poses (m) of the table's last frame in its frame 0.
        in_front, elbow_up: ``(s,)`` of ``ArmShape``.
    """

    Ts_frame0_last: Array
    in_front: NDArray[np.bool_]
    elbow_up: NDArray[np.bool_]


def postures_of(arm: RigidArm, values: Array, joints: Array) -> Postures | None:
    """Return the postures at joint positions ``(s, 6)`` rad of an arm with these parameters; None without a table."""
    chain = arm.dh_chain(values)
    if chain is None or chain.size != 6:
        return None
    shape = ArmShape.of(chain)
    Ts_tracker_tool = arm.tool(joints, values)[0]
    T_last_tool = np.eye(4)
    T_last_tool[:3, 3] = values[-3 * len(arm.targets) :][:3]
    Ts = se3.inverse(arm.T_tracker_frame0(values)) @ Ts_tracker_tool @ se3.inverse(T_last_tool)
    return Postures(Ts, shape.in_front(joints), shape.elbow_up(joints))


def _nearest_point(on: Array, along: Array, other: Array, other_along: Array) -> Array:
    """Return the point ``(3,)`` of a line nearest to another line; ``on`` for parallel lines."""
    normal = np.cross(along, other_along)
    square = float(normal @ normal)
    if square < _PARALLEL:
        return on
    return np.asarray(on + along * (np.cross(other - on, other_along) @ normal) / square)


Allowed = Callable[[ArmShape, Array], NDArray[np.bool_]]  # flags joint positions (k, 6) rad of a configuration
Motion = Literal["joints", "line"]
_REASON = 300  # characters of a reason
_NAMED = 10  # frames in a message


@dataclass(frozen=True)
class TargetText:
    """A target in a text as numbers.

    Attributes:
        name: of the constant, or by its line.
        line: in the text, from 1.
        numbers: of a pose in ``spelling``, or six joint positions.
        spelling: of a pose, or None.
        tool, base: names of its frames; empty for joint positions.
        per_rad: units of each joint position in a radian, ``(6,)``.
        whole: True for whole numbers, as motor pulses.
        allowed: flags joint positions with the text's configuration; None for any.
    """

    name: str
    line: int
    numbers: tuple[Number, ...]
    spelling: PoseSpelling | None = None
    tool: str = ""
    base: str = ""
    per_rad: tuple[float, ...] = (180 / np.pi,) * 6
    whole: bool = False
    allowed: Allowed | None = field(default=None, repr=False)

    @property
    def values(self) -> Array:
        """Values of the target's numbers."""
        return values_of(self.numbers)

    @property
    def joints(self) -> Array:
        """Joint positions ``(6,)`` rad; NaN for a pose."""
        return np.full(6, np.nan) if self.spelling is not None else self.values / np.array(self.per_rad)


@dataclass(frozen=True)
class Move:
    """A move to a target.

    Attributes:
        target: its index.
        motion: straight in the joints, or of the tool.
    """

    line: int
    target: int
    motion: Motion


@dataclass(frozen=True)
class Uncorrected:
    """A line of a program that stays unchanged, with the reason."""

    line: int
    reason: str

    def __post_init__(self) -> None:
        reason = " ".join(self.reason.split())
        object.__setattr__(self, "reason", reason if len(reason) <= _REASON else f"{reason[:_REASON]}…")


@dataclass(frozen=True)
class ProgramText:
    """Content of a program.

    Attributes:
        targets: in the order of the text.
        moves: in the order of the text, regardless of loops and branches.
        frames: poses ``(4, 4)`` (m) by name, of tools in the flange and of bases in the controller's base frame.
        uncorrected: unchanged lines that move the arm, or set its position.
        computed: lines of frames, by name, that are computed while the program runs.
    """

    targets: tuple[TargetText, ...]
    moves: tuple[Move, ...]
    frames: Mapping[str, Array]
    uncorrected: tuple[Uncorrected, ...]
    computed: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Outside:
    """Values from the controller's memory, given by the user.

    Attributes:
        frames: numbers by name, as the controller shows them; or another frame's name.
        pulses_per_deg: of the six joints' motors; empty if not given.
    """

    frames: Mapping[str, tuple[float, ...] | str] = field(default_factory=dict)
    pulses_per_deg: tuple[float, ...] = ()

    def posed(self, spelling: PoseSpelling) -> dict[str, Array]:
        """Return poses ``(4, 4)`` (m) of the frames with numbers."""
        frames = {}
        for name, values in self.frames.items():
            if isinstance(values, str):
                continue
            if len(values) != 3 + spelling.parts:
                raise LabError(
                    f"{option_name('frames')}: {name} has {len(values)} numbers; this controller writes "
                    f"{3 + spelling.parts}: "
                    f"{spelling.description}"
                )
            if spelling.parts == 4 and float(np.linalg.norm(values[3:])) not in ROUNDED_NORM:
                raise LabError(
                    f"{option_name('frames')}: the quaternion of {name} has the length {np.linalg.norm(values[3:]):.3g}"
                )
            frames[name] = spelling.pose(np.array(values))
        return frames

    def alias(self, name: str) -> str:
        """Return the frame of a name: another one if given, else itself."""
        meant = self.frames.get(name)
        return meant if isinstance(meant, str) else name


@dataclass
class ProgramReader:
    """Reader of a program, a base class for each language, in linear time.

    Attributes:
        text: of the program.
        outside: values that it lacks.
        targets: in the order of the text.
        moves: to them.
        frames: poses ``(4, 4)`` (m) of tools and bases by name.
        computed: lines of frames, by name, that are computed while the program runs.
        uncorrected: unchanged lines.
    """

    text: str
    outside: Outside
    targets: list[TargetText] = field(default_factory=list, init=False)
    moves: list[Move] = field(default_factory=list, init=False)
    frames: dict[str, Array] = field(default_factory=dict, init=False)
    computed: dict[str, int] = field(default_factory=dict, init=False)
    uncorrected: list[Uncorrected] = field(default_factory=list, init=False)
    _reached: int = field(default=0, init=False)

    def _count_move(self) -> None:
        """Count a move when it is read, so that a program with too many is refused early."""
        self._reached += 1
        PROGRAM_MOVES("the program", self._reached)

    def _add(self, target: TargetText, made: Sequence[tuple[int, Motion]]) -> None:
        PROGRAM_MOVES("the program", len(self.moves) + len(made))
        self.moves += [Move(line, len(self.targets), motion) for line, motion in made]
        self.targets.append(target)

    def _describe(self, name: str, T: Array) -> None:
        self.frames[name] = T
        PROGRAM_FRAMES("the program", self.frames)

    def _read(self) -> ProgramText:
        PROGRAM_MOVES("the program", self.moves)
        self.moves.sort(key=lambda move: move.line)
        return ProgramText(tuple(self.targets), tuple(self.moves), self.frames, tuple(self.uncorrected), self.computed)

    def _leave(self, offset: int, reason: str) -> None:
        self.uncorrected.append(Uncorrected(line_of(self.text, offset), reason))


def refuse_unknown_frames(read: ProgramText, spelling: PoseSpelling) -> None:
    """Refuse a program with targets whose frames are neither in the text nor given."""
    named = (name for each in read.targets for name in (each.tool, each.base) if name and name not in read.frames)
    names = dict.fromkeys(" ".join(name.split()) for name in named)
    if not names:
        return
    made = [name for name in names if name in read.computed]
    example = "x,y,z,q1,q2,q3,q4" if spelling.parts == 4 else "x,y,z,a,b,c"
    given = _listed([f"{name}={example}" for name in names], "; ")
    raise LabError(
        f"{_where_frames_are(read, [*names], made)}; give {option_name('frames')} '{given}' ({spelling.description}"
        f"{', as the controller shows it when that line has run' if made else ''})"
    )


def _where_frames_are(read: ProgramText, names: Sequence[str], made: Sequence[str]) -> str:
    """Describe which frames are not in the text, and which are made while the program runs."""
    missing, messages = [name for name in names if name not in made], list[str]()
    if missing:
        messages.append(f"{_listed(missing)} {_is(missing)} not in the text")
    if made:
        listed = _listed([f"{name} (line {read.computed[name]})" for name in made])
        messages.append(f"{listed} {_is(made)} given a value only while the program runs")
    return ", and ".join(messages)


def _listed(names: Sequence[str], comma: str = ", ") -> str:
    return comma.join(names if len(names) <= _NAMED else [*names[:_NAMED], f"… ({len(names):,} in all)"])


def _is(names: Sequence[str]) -> str:
    return "is" if len(names) == 1 else "are"
