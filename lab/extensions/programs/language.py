"""Parts that the languages of controllers share: positions of a read program, steps and comments of a written one."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.programs.program_text import Motion
from lab.formats.programs.protocol import ANY_DIGITS, PAUSE_S, MeasuringTour, MoveKind, PathMoves, TargetMoves
from lab.kinematics.joints import JointSpec

__all__ = [
    "COMPARE_ONE_POSE",
    "Destination",
    "ProgramStep",
    "SixAxisLanguage",
    "ascii_text",
    "check_comment",
    "move_notes",
    "move_steps",
    "numbers",
    "path_notes",
    "path_steps",
    "place_and_turns",
    "program_name",
    "tour_notes",
    "tour_steps",
]  # fmt: skip

_CHECKED = "Checked free of collisions in the lab's model only: run it slowly first."
_UNCHECKED = "NOT CHECKED FOR COLLISIONS: run it slowly first."
_AXES = 6
COMPARE_ONE_POSE = "Joint zeros and signs are the model's: compare one pose with the pendant before the first run."


@dataclass
class Destination:
    """A position in a program's text, and the moves to it.

    Attributes:
        name: of the position, or its line.
        frames: tools and bases of the moves.
        moves: line and motion of each.
    """

    name: str
    frames: set[tuple[str, str]] = field(default_factory=set, kw_only=True)
    moves: list[tuple[int, Motion]] = field(default_factory=list, kw_only=True)

    def reach(self, frames: tuple[str, str], line: int, motion: Motion) -> None:
        """Record a move with a tool and a base."""
        self.frames.add(frames)
        self.moves.append((line, motion))

    @cached_property
    def conflict(self) -> str:
        """Reason why it is not corrected, once all moves are known: its moves have several tools or bases."""
        frames = " as well as ".join(" and ".join(pair) for pair in sorted(self.frames))
        return f"{self.name} is moved to with {frames}"


@dataclass(frozen=True)
class _Pace:
    """Duration and speed of a planned move.

    Attributes:
        seconds: duration.
        per_cent: 1 to 100, the largest joint speed, relative to its limit.
        mm_s: the largest speed of the tool; 0 of joint moves.
    """

    seconds: float
    per_cent: int
    mm_s: float


@dataclass(frozen=True)
class ProgramStep:
    """A move to a waypoint, by default of all joints in a straight line.

    Attributes:
        joints: ``(n,)`` rad, m of a slide.
        comment: describes the waypoint in letters, digits and blanks.
        wait_s: pause there.
        kind: of the move; a ``via`` lies on the circle to the next waypoint.
        pace: of the move; None for the language's own, careful speed.
        T: pose ``(4, 4)`` (m) of the tool there; None where joint positions suffice.
    """

    joints: Array
    comment: str
    wait_s: float
    kind: MoveKind = "joint"
    pace: _Pace | None = None
    T: Array | None = None


def tour_steps(tour: MeasuringTour) -> list[ProgramStep]:
    """Return the steps of a measuring tour, from home to home, with a wait at each measured pose."""
    steps, pose = list[ProgramStep](), 0
    for i, (joints, measured) in enumerate(zip(tour.waypoints, tour.measured.tolist(), strict=True)):
        at_end = i in (0, len(tour.waypoints) - 1)
        comment = "home" if at_end else "via" if measured < 0 else f"pose {ascii_text(tour.ids[pose])}"
        pose += measured >= 0
        steps.append(ProgramStep(joints, comment, PAUSE_S if measured >= 0 else 0.0))
    return steps


def move_steps(moves: TargetMoves) -> list[ProgramStep]:
    """Return the steps to compensated targets, with the waypoints between."""
    return [
        ProgramStep(joints, f"target {ascii_text(moves.ids[i])}" if i >= 0 else "via", 0.0)
        for i, joints in zip(moves.which.tolist(), moves.waypoints, strict=True)
    ]


def path_steps(moves: PathMoves) -> list[ProgramStep]:
    """Return the steps of a trajectory: to its start at the language's own speed, then at the planned ones."""
    steps = list[ProgramStep]()
    for i, kind in enumerate(moves.kinds):
        pace = None
        if np.isfinite(moves.seconds[i]):
            per_cent = min(max(int(np.ceil(100 * moves.shares[i] - 1e-6)), 1), 100)
            pace = _Pace(float(moves.seconds[i]), per_cent, float(np.nan_to_num(MM.of(moves.speeds_m_s[i]))))
        comment = f"{'via' if kind == 'via' else 'point'} {ascii_text(moves.ids[i])}"
        steps.append(ProgramStep(moves.waypoints[i], comment, 0.0, kind, pace, moves.Ts_base_tool[i]))
    return steps


class SixAxisLanguage:
    """A language with joint positions of six revolute axes."""

    name: str
    most_digits: tuple[int, int] = ANY_DIGITS
    _refused = "no {} program: its joint positions have six revolute axes"

    def refusal(self, joints: JointSpec) -> str | None:
        """Return None for six revolute joints; else the reason why there is no program in this language."""
        if joints.size == _AXES and not any(joints.prismatic):
            return None
        kinds = "".join("P" if slides else "R" for slides in joints.prismatic)
        return f"{self._refused.format(self.name)}, robot {joints.name} has {kinds}"


def tour_notes(tour: MeasuringTour) -> list[str]:
    """Return comments that describe a measuring tour and whether it was checked."""
    station = f", from station {ascii_text(tour.station)}" if tour.station else ""
    return [
        f"{len(tour.ids)} poses to measure, ids as in plan.csv, of {ascii_text(tour.robot)}{station}.",
        check_comment(tour.checked),
        COMPARE_ONE_POSE,
    ]


def move_notes(moves: TargetMoves, positions: str = "joints") -> list[str]:
    """Return comments that describe moves to corrected targets and whether they were checked.

    Args:
        positions: the language's term for joint positions.
    """
    return [
        f"{len(moves.ids)} corrected targets of {ascii_text(moves.robot)}. The correction is in the {positions}.",
        check_comment(moves.checked),
    ]


def path_notes(moves: PathMoves) -> list[str]:
    """Return comments that describe a trajectory and whether it was checked."""
    took = f"{float(np.nansum(moves.seconds)):.3f} s planned"
    return [
        f"A path of {ascii_text(moves.robot)} through {len(moves.ids)} points, {took} from its first point.",
        *(["The correction is in the joint positions at the points."] if moves.corrected else []),
        check_comment(moves.checked),
        COMPARE_ONE_POSE,
    ]


def check_comment(checked: bool) -> str:
    """Return a comment on whether waypoints and the paths between them were checked."""
    return _CHECKED if checked else _UNCHECKED


def numbers(values: Array | Sequence[float], digits: int) -> list[str]:
    """Write numbers in plain digits, zero without a sign."""
    return [f"{value + 0.0:.{digits}f}" for value in np.round(np.asarray(values), digits)]


def place_and_turns(T: Array, digits: int, digits_deg: int | None = None) -> list[str]:
    """Write a pose ``(4, 4)`` (m) as x, y and z in mm, and turns about the fixed x, y and z in degrees."""
    turns = np.rad2deg(se3.roll_pitch_yaw(T[:3, :3]))
    return [*numbers(MM.of(T[:3, 3]), digits), *numbers(turns, digits if digits_deg is None else digits_deg)]


def program_name(file: str) -> str:
    """Return the name of a program in a file of this name without its suffix: letters, digits and underscores."""
    return re.sub(r"[^A-Za-z0-9_]", "_", file)


def ascii_text(text: str) -> str:
    """Reduce a text to letters, digits and blanks of ASCII, for comments and messages of any language."""
    return re.sub(r"[^A-Za-z0-9 ._-]", "_", text)[:32]
