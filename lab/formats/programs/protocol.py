"""Protocol of a controller's language, and the parts from which a program in it is made."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core.limits import DIGITS
from lab.core.se3 import Array
from lab.formats.programs.postures import Postures
from lab.formats.programs.program_text import Outside, PoseSpelling, ProgramText
from lab.kinematics.joints import JointSpec

__all__ = ["ANY_DIGITS", "PAUSE_S", "Language", "MeasuringTour", "MoveKind", "PathMoves", "TargetMoves"]

MoveKind = Literal["joint", "line", "via", "circle"]

ANY_DIGITS = (int(DIGITS.most), int(DIGITS.most))  # of a language whose controllers read any floating point number
PAUSE_S = 3  # how long a program waits at each pose that is measured


@dataclass(frozen=True)
class MeasuringTour:
    """A tour through the poses to measure, from home to home.

    Attributes:
        robot: the robot's name.
        waypoints: ``(s, n)`` joint positions (rad, m of a slide), home first and last.
        measured: ``(s,)``, negative where a stop is only passed.
        ids: what ``plan.csv`` calls the measured poses, in the order of the tour.
        checked: whether stops and the ways between them were checked for collisions.
        postures: the nominal arm's at the stops, for languages that name stops by their places; None where it has no
            table.
        station: of the instrument that measures on this tour; "" where it has one alone.
    """

    robot: str
    waypoints: Array
    measured: NDArray[np.int_]
    ids: Sequence[str]
    checked: bool = True
    postures: Postures | None = None
    station: str = ""


@dataclass(frozen=True)
class TargetMoves:
    """Moves to compensated targets, with the two frames that suit the controller's nominal links best.

    From stop to stop all joints move in a straight line.

    Attributes:
        robot: the robot's name.
        ids: what the targets' file calls them, ``(t,)``.
        waypoints: ``(s, n)`` joint positions (rad, m of a slide) at which the calibrated arm reaches the targets, and
            those that it passes.
        which: ``(s,)`` the target of each stop; negative where it is only passed.
        T_last_tool: pose ``(4, 4)`` (m) of the tool in the table's last frame, of the nominal arm that fits best.
        T_frame0_instrument: pose ``(4, 4)`` (m) of the instrument's frame in that arm's frame 0.
        checked: whether stops and the ways between them were checked for collisions.
        postures: the nominal arm's at the stops, for languages that name stops by their places; None where it has no
            table.
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
    """A trajectory as a controller's moves, each from stop to stop: the controller works out what is between.

    Attributes:
        robot: the robot's name.
        ids: what the points' file calls the stops, ``(s,)``.
        kinds: how each is reached, ``(s,)``: the first by a joint move; a circle passes the ``via`` before it.
        waypoints: ``(s, n)`` joint positions (rad, m of a slide).
        Ts_base_tool: ``(s, 4, 4)`` poses (m) of the tool there, of the nominal arm, in the base of the points.
        seconds: ``(s,)`` how long the planned move to each takes; NaN of the first and of ``via``.
        shares: ``(s,)`` the largest speed of a joint on the way, as a share of what the robot's table has.
        speeds_m_s: ``(s,)`` the largest speed of the tool on the way; NaN of joint moves.
        T_last_tool: pose ``(4, 4)`` (m) of the tool in the table's last frame.
        T_frame0_base: pose ``(4, 4)`` (m) of that base in frame 0.
        checked: whether the motion was checked for collisions.
        corrected: whether a calibration's correction is in the joint positions.
        postures: the nominal arm's at the stops; None where it has no table.
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
    """The language of a controller."""

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
        """Number of decimal places that its controllers read of a length, and of an angle or a rotation."""

    @property
    def makers(self) -> tuple[str, ...]:
        """Words by which the names of its robots are told, in small letters: "irb" of an irb120."""

    @property
    def speed(self) -> str:
        """Speed of its programs, in the language's own notation."""

    def refusal(self, joints: JointSpec) -> str | None:
        """Return the reason why a program in it cannot move a robot with these joints; None if it can."""

    def measuring_tour(self, tour: MeasuringTour) -> bytes:
        """The file of a program that goes through the poses to measure and waits ``PAUSE_S`` at each."""

    def target_moves(self, moves: TargetMoves) -> bytes:
        """The file of a program that goes to the compensated targets."""

    def path_moves(self, moves: PathMoves) -> bytes:
        """The file of a program that moves along a trajectory: by its joints, on lines and on circles of the tool."""

    def read(self, text: str, outside: Outside) -> ProgramText:
        """The targets and moves of a program in it."""
