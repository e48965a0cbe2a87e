"""Protocol of a controller's language, and the parts from which a program in it is made."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core.limits import DIGITS
from lab.core.se3 import Array
from lab.formats.programs.program_text import Outside, PoseSpelling, Postures, ProgramText
from lab.kinematics.joints import JointSpec

__all__ = [
    "ANY_DIGITS", "PAUSE_S", "PLAN", "PROGRAM", "Language", "MeasuringTour", "MoveKind", "PathMoves", "TargetMoves",
]  # fmt: skip

MoveKind = Literal["joint", "line", "via", "circle"]

ANY_DIGITS = (int(DIGITS.most), int(DIGITS.most))  # for controllers that read any floating point number
PAUSE_S = 3  # at each measured pose
PLAN, PROGRAM = "plan", "program"  # names of the files, before their suffix


@dataclass(frozen=True)
class MeasuringTour:
    """A tour through the poses to measure, from home to home.

    Attributes:
        robot: the robot's name.
        waypoints: ``(s, n)`` joint positions (rad, m of a slide), home first and last.
        measured: ``(s,)``, negative for waypoints that are only passed.
        ids: of the measured poses in ``plan.csv``, in the order of the tour.
        checked: True if waypoints and paths were checked for collisions.
        postures: of the nominal arm, or None.
        station: of the instrument; "" for the only one.
    """

    robot: str
    waypoints: Array
    measured: NDArray[np.int_]
    ids: Sequence[str]
    checked: bool = True
    postures: Postures | None = None
    station: str = ""

    @property
    def file_name(self) -> str:
        """Name of the tour's file, before its suffix: many controllers want the program to have the same name."""
        return PLAN + (f"_{self.station}" if self.station else "")


@dataclass(frozen=True)
class TargetMoves:
    """Moves to compensated targets, with the two frames that suit the controller's nominal links best.

    Between waypoints all joints move in a straight line.

    Attributes:
        robot: the robot's name.
        ids: of the targets, ``(t,)``.
        waypoints: ``(s, n)`` joint positions (rad, m of a slide) at which the calibrated arm reaches the targets, and
            others.
        which: ``(s,)`` target of each waypoint; negative for others.
        T_last_tool: pose ``(4, 4)`` (m) of the tool in the table's last frame, of the nominal arm that fits best.
        T_frame0_instrument: pose ``(4, 4)`` (m) of the instrument's frame in that arm's frame 0.
        checked: True if waypoints and paths were checked for collisions.
        postures: of the nominal arm, or None.
    """

    robot: str
    ids: Sequence[str]
    waypoints: Array
    which: NDArray[np.int_]
    T_last_tool: Array
    T_frame0_instrument: Array
    checked: bool = True
    postures: Postures | None = None


@dataclass(frozen=True)
class PathMoves:
    """A trajectory as a controller's moves between waypoints.

    Attributes:
        robot: the robot's name.
        ids: of the waypoints, ``(s,)``.
        kinds: kind of the move to each, ``(s,)``: the first a joint move; a circle passes the ``via`` before it.
        waypoints: ``(s, n)`` joint positions (rad, m of a slide).
        Ts_base_tool: ``(s, 4, 4)`` poses (m) of the tool there, of the nominal arm, in the base of the points.
        seconds: ``(s,)`` duration of the planned move to each; NaN for the first and for ``via``.
        shares: ``(s,)`` largest speed of a joint on the path, relative to the robot's table.
        speeds_m_s: ``(s,)`` largest speed of the tool on the path; NaN for joint moves.
        T_last_tool: pose ``(4, 4)`` (m) of the tool in the table's last frame.
        T_frame0_base: pose ``(4, 4)`` (m) of that base in frame 0.
        checked: True if the motion was checked for collisions.
        corrected: True if the joint positions are compensated.
        postures: of the nominal arm, or None.
    """

    robot: str
    ids: Sequence[str]
    kinds: Sequence[MoveKind]
    waypoints: Array
    Ts_base_tool: Array
    seconds: Array
    shares: Array
    speeds_m_s: Array
    T_last_tool: Array
    T_frame0_base: Array
    checked: bool
    corrected: bool
    postures: Postures | None = None


class Language(Protocol):
    """Language of a controller."""

    @property
    def name(self) -> str:
        """Name of the language among its users; in lower case the key of ``result.json``."""

    @property
    def suffix(self) -> str:
        """File name suffix of its programs, with the dot."""

    @property
    def reads(self) -> tuple[str, ...]:
        """File name suffixes, in lower case, of files that hold its targets."""

    @property
    def spelling(self) -> PoseSpelling:
        """Notation of poses."""

    @property
    def most_digits(self) -> tuple[int, int]:
        """Decimals that its controllers read of a length, and of an angle or a rotation."""

    @property
    def makers(self) -> tuple[str, ...]:
        """Words in the names of its robots, in lower case: "irb" of an irb120."""

    @property
    def speed(self) -> str:
        """Speed of its programs, in the language's own notation."""

    def refusal(self, joints: JointSpec) -> str | None:
        """Return the reason why a program cannot move a robot with these joints, or None."""

    def measuring_tour(self, tour: MeasuringTour) -> bytes:
        """Return a program that visits the poses to measure and waits ``PAUSE_S`` at each."""

    def target_moves(self, moves: TargetMoves) -> bytes:
        """Return a program that visits the compensated targets."""

    def path_moves(self, moves: PathMoves) -> bytes:
        """Return a program along a trajectory: by joints, on lines and on circles of the tool."""

    def read(self, text: str, outside: Outside) -> ProgramText:
        """Return the targets and moves of a program."""
