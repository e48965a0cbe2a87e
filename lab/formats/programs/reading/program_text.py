"""A program as it is read: the targets that it holds as numbers, the moves to them, and what could not be read."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.limits import PROGRAM_FRAMES, PROGRAM_MOVES
from lab.core.ranges import ROUNDED_NORM
from lab.core.se3 import Array
from lab.formats.programs.postures import ArmShape
from lab.formats.programs.reading.numbers import Number, line_of, values_of
from lab.formats.programs.reading.spelling import PoseSpelling

__all__ = [
    "Allowed",
    "Motion",
    "Move",
    "Outside",
    "ProgramReader",
    "ProgramText",
    "TargetText",
    "Uncorrected",
    "refuse_unknown_frames",
]

Allowed = Callable[[ArmShape, Array], NDArray[np.bool_]]  # joint positions (k, 6) rad: which are of a configuration
Motion = Literal["joints", "line"]
_REASON = 300  # characters of a reason
_NAMED = 10  # frames in a message


@dataclass(frozen=True)
class TargetText:
    """A target that a text holds as numbers.

    Attributes:
        name: of the constant, or by its line.
        line: where it is written, as an editor counts.
        numbers: a pose's as ``spelling`` says; six joint positions where that is None.
        spelling: of a pose.
        tool, base: its frames' names; of joint positions they are empty.
        per_rad: of joint positions, ``(6,)``: of the unit in which each is written.
        whole: whether its numbers have no places behind the point, as motor pulses.
        allowed: which joint positions have the configuration that the text asks for; None where it asks for none.
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
        """What its numbers say."""
        return values_of(self.numbers)

    @property
    def joints(self) -> Array:
        """Joint positions ``(6,)`` rad; NaN where it is a pose."""
        return np.full(6, np.nan) if self.spelling is not None else self.values / np.array(self.per_rad)


@dataclass(frozen=True)
class Move:
    """A move to a target.

    Attributes:
        target: which one.
        motion: whether all joints move in a straight line, or the tool.
    """

    line: int
    target: int
    motion: Motion


@dataclass(frozen=True)
class Uncorrected:
    """A line of a program that stays as it is, and why, in one line."""

    line: int
    reason: str

    def __post_init__(self) -> None:
        """Parts of a text that are in the reason may have line ends, and be long."""
        reason = " ".join(self.reason.split())
        object.__setattr__(self, "reason", reason if len(reason) <= _REASON else f"{reason[:_REASON]}…")


@dataclass(frozen=True)
class ProgramText:
    """What was read of a program.

    Attributes:
        targets: in the order of the text.
        moves: in the order of the text, whatever the program's loops and branches do.
        frames: poses ``(4, 4)`` (m) by name, of tools in the flange and of bases in the controller's base frame.
        uncorrected: lines that move the arm, or say where it is to be, and stay as they are.
        computed: the lines of frames, by name, that get their values only while the program runs.
    """

    targets: tuple[TargetText, ...]
    moves: tuple[Move, ...]
    frames: Mapping[str, Array]
    uncorrected: tuple[Uncorrected, ...]
    computed: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Outside:
    """What a text does not hold: from the controller's memory, as somebody gave it.

    Attributes:
        frames: numbers by name, as the controller shows them; or another frame's name.
        pulses_per_deg: of the six joints' motors; empty where they are not known.
    """

    frames: Mapping[str, tuple[float, ...] | str] = field(default_factory=dict)
    pulses_per_deg: tuple[float, ...] = ()

    def posed(self, spelling: PoseSpelling) -> dict[str, Array]:
        """Poses ``(4, 4)`` (m) of those that are numbers.

        Raises:
            LabError: one has not as many numbers as the controller writes.
        """
        found = {}
        for name, values in self.frames.items():
            if isinstance(values, str):
                continue
            if len(values) != 3 + spelling.parts:
                raise LabError(
                    f"--frames: {name} has {len(values)} numbers; this controller writes {3 + spelling.parts}: "
                    f"{spelling.words}"
                )
            if spelling.parts == 4 and float(np.linalg.norm(values[3:])) not in ROUNDED_NORM:
                raise LabError(f"--frames: the quaternion of {name} has the length {np.linalg.norm(values[3:]):.3g}")
            found[name] = spelling.pose(np.array(values))
        return found

    def alias(self, name: str) -> str:
        """The frame that is meant by a name: another one where that is given, else itself."""
        meant = self.frames.get(name)
        return meant if isinstance(meant, str) else name


@dataclass
class ProgramReader:
    """A program being read; each language has its own. Its work grows with the length of the text, not faster.

    Attributes:
        text: as it is written.
        outside: what it does not hold.
        targets: in the order of the text.
        moves: to them.
        frames: poses ``(4, 4)`` (m) of tools and bases by name.
        computed: the lines of frames, by name, that get their values only while the program runs.
        uncorrected: lines that stay as they are.
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
        """Count a move when it is read, so that a program with too many is refused before the rest is read.

        Raises:
            LabError: the program has too many moves.
        """
        self._reached += 1
        PROGRAM_MOVES("the program", self._reached)

    def _add(self, target: TargetText, made: Sequence[tuple[int, Motion]]) -> None:
        """Add a target, and the moves to it by their lines.

        Raises:
            LabError: the program has too many moves.
        """
        PROGRAM_MOVES("the program", len(self.moves) + len(made))
        self.moves += [Move(line, len(self.targets), motion) for line, motion in made]
        self.targets.append(target)

    def _describe(self, name: str, T: Array) -> None:
        """Add a tool or a base that the text describes.

        Raises:
            LabError: the program has too many of them.
        """
        self.frames[name] = T
        PROGRAM_FRAMES("the program", self.frames)

    def _read(self) -> ProgramText:
        """What was read.

        Raises:
            LabError: the program has too many moves.
        """
        PROGRAM_MOVES("the program", self.moves)
        self.moves.sort(key=lambda move: move.line)
        return ProgramText(tuple(self.targets), tuple(self.moves), self.frames, tuple(self.uncorrected), self.computed)

    def _leave(self, offset: int, reason: str) -> None:
        """The line at an offset of the text stays as it is."""
        self.uncorrected.append(Uncorrected(line_of(self.text, offset), reason))


def refuse_unknown_frames(read: ProgramText, spelling: PoseSpelling) -> None:
    """Refuse a program with targets whose frames are neither in the text nor given.

    Raises:
        LabError: with the names of all of them, and how to give them.
    """
    asked = (name for each in read.targets for name in (each.tool, each.base) if name and name not in read.frames)
    names = dict.fromkeys(" ".join(name.split()) for name in asked)
    if not names:
        return
    missing, made = [name for name in names if name not in read.computed], [n for n in names if n in read.computed]
    said = [f"{_listed(missing)} {_is(missing)} not in the text"] if missing else []
    if made:
        listed = _listed([f"{name} (line {read.computed[name]})" for name in made])
        said.append(f"{listed} {_is(made)} given a value only while the program runs")
    example = ",".join("xyz") + "," + ",".join(("q1", "q2", "q3", "q4") if spelling.parts == 4 else ("a", "b", "c"))
    given = _listed([f"{name}={example}" for name in names], "; ")
    raise LabError(
        f"{', and '.join(said)}; give --frames '{given}' ({spelling.words}"
        f"{', as the controller shows it when that line has run' if made else ''})"
    )


def _listed(names: Sequence[str], comma: str = ", ") -> str:
    """Names, of very many the first."""
    return comma.join(names if len(names) <= _NAMED else [*names[:_NAMED], f"… ({len(names):,} in all)"])


def _is(names: Sequence[str]) -> str:
    return "is" if len(names) == 1 else "are"
