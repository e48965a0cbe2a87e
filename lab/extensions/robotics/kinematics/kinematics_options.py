"""Options of ``lab kinematics``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro

from lab.core import se3
from lab.core.errors import LabError
from lab.core.limits import OPTION_SIZE, QUATERNION_NORM
from lab.core.orientation import AngleConvention, Order
from lab.core.se3 import Array
from lab.core.units import MM, joints_to_si
from lab.formats.orientations import rotation_from_angles
from lab.kinematics.inverse.newton_inverse import PoseTarget
from lab.kinematics.joints import JointSpec
from lab.options.option_types import Flag, Names, Numbers

__all__ = ["KinematicsOptions", "tool_point"]


@dataclass(frozen=True)
class KinematicsOptions:
    """A robot, its joint positions or the poses of its tool, and the models to compute."""

    robot: tyro.conf.Positional[str] = "irb120"
    """A model's name, or a path to an MJCF, a URDF, or a TOML table or mechanism."""
    joints: Numbers = ()
    """Joint positions, ° (mm of a slide); with --pose where the robot is: the nearest solutions come first."""
    pose: Numbers = ()
    """Where the tool is to be, in the base: x,y,z in mm, then three angles in °, or a quaternion wxyz, or nothing."""
    coordinates: Literal["cartesian", "cylindrical", "polar"] = "cartesian"
    """Of the place of --pose: x,y,z; cylindrical θ,L,z; polar θ1,θ2,R, with θ2 the elevation; ° and mm."""
    file: Path | None = None
    """CSV: rows of joint positions, or rows of targets to be reached (x_mm, y_mm, z_mm, and an orientation)."""
    orientation: AngleConvention | None = None
    """What three angles mean; of --pose fixed-xyz by default."""
    of: Names = ()
    """Keep the solutions of this configuration alone, e.g. elbow+,wrist-."""
    tool_mm: Numbers = ()
    """The tool's point in the last frame, or the platform's: x,y,z; by default its origin."""
    rates: Numbers = ()
    """Rates of the joints, ° (mm of a slide) per s: the twist that they give."""
    twist: Numbers = ()
    """A twist of the tool: vx,vy,vz in mm/s, then wx,wy,wz in °/s: the rates that give it."""
    frame: str = "base"
    """The frame whose axes the Jacobian and the twist have: base, tool, or the number of a serial arm's frame."""
    inverse_jacobian: Flag = False
    """Print the inverse of the Jacobian, by blocks where it has them; where it has none, the pseudo-inverse J⁺."""
    matrices: Flag = False
    """Print the link matrices T_i-1,i and their products T_0,i at the first joint positions."""
    between: Annotated[tuple[int, int] | None, tyro.conf.arg(metavar="FIRST LAST")] = None
    """Print the pose of the second of these frames in the first (0 is the base's)."""
    symbolic: Flag = False
    """Print the matrices and the Jacobian also in letters (needs sympy)."""
    symbolic_inverse: Flag = False
    """Print the inverse in letters: its equations by their types, and how each gives a joint (needs sympy)."""
    angles: Numbers = ()
    """Convert a rotation, without a robot: three angles a,b,c in the order of --order."""
    order: Order = "zyx"
    """The axes of --angles in turn: zyx is R = Rz(a) Ry(b) Rx(c)."""
    fixed: Flag = False
    """Turn about fixed axes: zyx is first about z, then about y, then about x."""
    axis: Numbers = ()
    """Convert the rotation about an axis x,y,z, of any length; give --angle too."""
    angle: float | None = None
    """The angle about --axis."""
    quaternion: Numbers = ()
    """Convert a quaternion w,x,y,z."""
    matrix: Numbers = ()
    """Convert a rotation matrix, nine numbers: the rows, one after the other."""
    radians: Flag = False
    """The angles of a rotation are in rad, given and printed; in ° by default."""
    out: Path | None = None
    """A folder for the result, a report and a table; by default nothing is written."""
    overwrite: Flag = False
    """Replace an earlier run in that folder."""

    def check(self) -> None:
        """Refuse options that contradict each other, with a LabError that names them."""
        if self.of_a_rotation:
            self._check_rotation()
        elif self.fixed or self.order != "zyx" or self.radians:
            raise LabError("--order, --fixed and --radians say what the angles of a rotation mean: give --angles")
        if self.rates and self.twist:
            raise LabError("--rates and --twist are each other's answer; give one")
        self._check_pose()
        if self.frame not in ("base", "tool") and not (self.frame.isascii() and self.frame.isdigit()):
            raise LabError(f"--frame {self.frame}: give base, tool, or a frame's number, 0 for the base's")

    def _check_pose(self) -> None:
        if self.file is not None and self.pose:
            raise LabError("--pose and --file both set the tool's pose; give one")
        if self.coordinates != "cartesian" and not self.pose:
            raise LabError(f"--coordinates {self.coordinates} says what --pose means; give a --pose")
        if self.of and not (self.pose or self.file):
            raise LabError("--of chooses among solutions; give a --pose")

    @property
    def of_a_rotation(self) -> bool:
        """True where a rotation is to be converted, and there is no robot."""
        return bool(self.angles or self.axis or self.quaternion or self.matrix) or self.angle is not None

    def _check_rotation(self) -> None:
        forms = self._set("matrix", "quaternion", "angles", "axis")
        if len(forms) > 1:
            raise LabError(f"{' and '.join(forms)} each give a rotation: give one of them")
        if bool(self.axis) != (self.angle is not None):
            raise LabError("--axis and --angle belong together: give both; three angles in a row are --angles")
        if not self.angles and (self.fixed or self.order != "zyx"):
            raise LabError("--order and --fixed say what --angles mean: give --angles, or leave them out")
        if stray := self._set("joints", "pose", "file", "rates", "twist"):
            raise LabError(
                f"{stray[0]} is of a robot, and {forms[0]} converts a rotation without one; give one of them"
            )

    def _set(self, *names: str) -> list[str]:
        """Return which of some options are given."""
        return [f"--{name}" for name in names if getattr(self, name)]

    @property
    def axes(self) -> Literal["base", "tool"] | int:
        """Frame of ``--frame``."""
        return self.frame if self.frame in ("base", "tool") else int(self.frame)  # type: ignore[return-value]

    def joint_row(self, chain: JointSpec, flag: Literal["joints", "rates"]) -> Array:
        """Return ``--joints`` or ``--rates`` ``(joints,)`` in rad or m (per s).

        Raises:
            LabError: there are not as many as joints, or one is not finite.
        """
        given = getattr(self, flag)
        units = ", ".join(
            f"{name} in {'mm' if slides else '°'}"
            for name, slides in zip(chain.joint_names, chain.prismatic, strict=True)
        )
        return joints_to_si(
            _row(f"--{flag}", given, chain.size, f"one number for each joint: {units}"), chain.prismatic
        )

    @property
    def wanted(self) -> PoseTarget:
        """Pose of ``--pose``.

        Raises:
            LabError: it is none.
        """
        count = len(self.pose)
        if count not in (3, 6, 7):
            raise LabError(f"--pose has {count} numbers: give x,y,z, then three angles, or a quaternion, or nothing")
        row = _row("--pose", self.pose, count, "")
        rotation = np.full((3, 3), np.nan)
        if count == 6:
            rotation = rotation_from_angles(np.deg2rad(row[3:]), self.orientation or "fixed-xyz")
        elif count == 7:
            if float(np.linalg.norm(row[3:])) not in QUATERNION_NORM:
                raise LabError(f"--pose: the quaternion's norm is {np.linalg.norm(row[3:]):.6g}, not 1; mend it")
            rotation = se3.rotation_from_quaternion(row[3:])
        return PoseTarget(_place(row[:3], self.coordinates)[None] / 1e3, rotation[None])

    @property
    def tool_m(self) -> Array:
        """Tool point ``(3,)`` m in the last frame.

        Raises:
            LabError: it is no point.
        """
        return tool_point(self.tool_mm)

    @property
    def twist_si(self) -> Array:
        """Twist ``(6,)`` of ``--twist``, m/s and rad/s.

        Raises:
            LabError: it is none.
        """
        scale = np.repeat([1e-3, np.pi / 180], 3)
        twist = _row("--twist", self.twist, 6, "vx,vy,vz in mm/s, then wx,wy,wz in °/s")
        return np.asarray(twist * scale)


def tool_point(tool_mm: tuple[float, ...]) -> Array:
    """Return the tool's point ``(3,)`` m in the last frame, by default its origin.

    Raises:
        LabError: it is no point.
    """
    if not tool_mm:
        return np.zeros(3)
    return MM.to_si(_row("--tool-mm", tool_mm, 3, "x,y,z of the tool's point in the last frame, e.g. 0,0,100"))


def _place(row: Array, coordinates: str) -> Array:
    """Return x, y, z of a place in other coordinates (Mallem 2011, section 7.1)."""
    if coordinates == "cartesian":
        return row
    first = np.deg2rad(row[0])
    level, height = row[1:]
    if coordinates == "polar":
        second = np.deg2rad(row[1])
        level, height = row[2] * np.cos(second), row[2] * np.sin(second)
    return np.array([level * np.cos(first), level * np.sin(first), height])


def _row(flag: str, given: tuple[float, ...], count: int, what: str) -> Array:
    """Return an option's numbers ``(count,)``, which must be finite."""
    if len(given) != count:
        raise LabError(f"{flag} has {len(given)} numbers, not {count}; give {what}")
    if bad := [each for each in given if abs(each) not in OPTION_SIZE]:
        raise LabError(f"{flag} {bad[0]:g}: give finite numbers of at most {OPTION_SIZE.most:g}")
    return np.array(given)
