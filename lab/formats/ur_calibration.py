"""Universal Robots' own calibration: the controller's ``calibration.conf``, and the kinematics that ROS reads.

A controller keeps what the factory measured as differences from the nominal Denavit-Hartenberg table (distal): the
lists ``delta_theta``, ``delta_a``, ``delta_d`` and ``delta_alpha`` of the section ``[mounting]``, six numbers each, in
rad and m. The maker does not document the file; these keys are those that public programs read. The table with these
differences has its second and third links hundreds of metres along nearly parallel axes (Universal Robots,
ur_calibration, "Calibration correction algorithm"), so that the same axes are described anew, with Hayati's beta.

``ur_description`` reads a YAML file with the origin of each joint, ``x y z roll pitch yaw`` in the frame of the joint
before it (config/ur5e/default_kinematics.yaml; the angles are those of a URDF). The frames are placed as there: z along
the axis of the joint, x along that of the base where all joints are at zero.
"""

import ast
import configparser
from pathlib import Path

import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.limits import TEXT_BYTES
from lab.core.ranges import CORRECTION_A_M, CORRECTION_D_M, CORRECTION_RAD
from lab.core.se3 import Array
from lab.formats.description import DescriptionFormat, IdentifiedRobot
from lab.formats.link_tree import link_tree
from lab.formats.text_file import read_text
from lab.kinematics.serial.arm import SerialArm

__all__ = ["UR_KINEMATICS", "read_corrections"]

_KEYS = ("delta_theta", "delta_d", "delta_a", "delta_alpha")
_RANGES = (CORRECTION_RAD, CORRECTION_D_M, CORRECTION_A_M, CORRECTION_RAD)  # of the keys
_LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_AXES = np.array([[0, 0, 1], [0, -1, 0], [0, -1, 0], [0, -1, 0], [0, 0, -1], [0, -1, 0]], dtype=np.float64)
_NEAR = 0.05  # by which directions of axes may differ from these, and offsets from zero be told from lengths, m
_HEAD = """\
# The identified geometry of {name}, as ur_description reads it:
#   xacro ur.urdf.xacro ur_type:=TYPE kinematics_params:=ur_kinematics.yaml name:=NAME > calibrated.urdf
# Angles are those of a URDF (fixed axes). The hash names no controller's calibration: the driver says that the
# two differ. The base is where the measurements place it; the tool is not in this file.
"""


def read_corrections(path: Path) -> Array:
    """What a controller's ``calibration.conf`` adds to the nominal table: ``(6, 4)`` of theta, d, a, alpha (rad, m).

    Raises:
        LabError: it cannot be read, or its lists are not six finite numbers each of a size that they can have.
    """
    parser = configparser.ConfigParser(strict=False, interpolation=None, inline_comment_prefixes=("#",))
    try:
        parser.read_string(read_text(path, TEXT_BYTES), str(path))
    except configparser.Error as error:
        said = " ".join(str(error).split())
        raise LabError(f"{path}: is no calibration.conf of a Universal Robots controller ({said})") from error
    if not parser.has_section("mounting"):
        raise LabError(f"{path}: has no section [mounting]; give the controller's calibration.conf")
    columns = [_list(path, key, parser.get("mounting", key, fallback="")) for key in _KEYS]
    found = np.stack(columns, axis=1)
    for key, column, sizes in zip(_KEYS, found.T, _RANGES, strict=True):
        if (largest := np.abs(column).max()) not in sizes:
            raise LabError(f"{path}: {key} reaches {largest:.3g} {sizes.unit}; give the controller's own file")
    return found


def _list(path: Path, key: str, text: str) -> Array:
    if not text:
        raise LabError(f"{path}: [mounting] has no {key}; give the controller's calibration.conf")
    try:
        values = np.array(ast.literal_eval(text), dtype=np.float64)
    except (ValueError, SyntaxError, TypeError, OverflowError, RecursionError, MemoryError) as error:
        said = " ".join(text.split())[:40]
        raise LabError(f"{path}: {key} = {said} is no list of numbers; fix it") from error
    if values.shape != (6,) or not np.isfinite(values).all():
        raise LabError(f"{path}: {key} is to be a list of six finite numbers; fix it")
    return values


def _kinematics(identified: IdentifiedRobot[SerialArm, object]) -> str:
    """The YAML of an identified arm; "" where it is none of this maker's."""
    frames = _frames(identified.arm, identified.values)
    if frames is None:
        return ""
    lines = [_HEAD.format(name=identified.name).rstrip(), "kinematics:"]
    before = np.eye(4)
    for name, frame in zip(_LINKS, frames, strict=True):
        origin = se3.inverse(before) @ frame
        angles = se3.roll_pitch_yaw(origin[:3, :3])
        values = dict(zip(("x", "y", "z"), origin[:3, 3].tolist(), strict=True))
        values |= dict(zip(("roll", "pitch", "yaw"), angles.tolist(), strict=True))
        lines.append(f"  {name}:")
        lines += [f"    {key}: {value + 0.0!r}" for key, value in values.items()]
        before = frame
    return "\n".join([*lines, "  hash: calib_identified_by_measurement"]) + "\n"


UR_KINEMATICS = DescriptionFormat("ur_kinematics.yaml", _kinematics)


def _frames(arm: SerialArm, values: Array) -> list[Array] | None:
    """Frames ``(4, 4)`` (m) of the six joints at zero, placed as ``ur_description`` does; None of another arm."""
    chain = arm.chain
    if chain.size != len(_LINKS) or any(chain.prismatic):
        return None
    tree = link_tree(arm, values)
    poses = [np.eye(4)]
    for link in tree.moving:
        poses.append(poses[-1] @ link.T_parent_link)
    last = poses[-1] @ tree.moving[-1].T_link_frame
    z = np.array([pose[:3, 2] * link.sign for pose, link in zip(poses[1:], tree.moving, strict=True)])
    points = np.array([pose[:3, 3] for pose in poses[1:]])
    turn = np.diag([-1.0, -1.0, 1.0]) if z[1, 1] > 0 else np.eye(3)  # base_link is turned against the base
    z, points, last = z @ turn, points @ turn, se3.pose(turn @ last[:3, :3], turn @ last[:3, 3])
    if np.abs(z - _AXES).max() > _NEAR:
        return None
    shoulder = _foot(points[0], z[0], points[1], z[1])
    upper = _foot(points[1], z[1], points[0], z[0])
    elbow = points[2] + z[2] * np.dot(upper - points[2], z[2])
    wrist = _foot(points[3], z[3], points[4], z[4])
    roll = _foot(points[4], z[4], points[5], z[5])
    if np.linalg.norm(upper - shoulder) > _NEAR or abs(np.dot(last[:3, 2], z[5])) < 1 - 1e-9:
        return None
    tip = points[5] + z[5] * np.dot(last[:3, 3] - points[5], z[5])
    return [_frame(at, axis) for at, axis in zip((shoulder, upper, elbow, wrist, roll, tip), z, strict=True)]


def _frame(origin: Array, z: Array) -> Array:
    """A frame with z along an axis, and x as near as can be to the base's."""
    x = np.array([1.0, 0.0, 0.0]) - z * z[0]
    x /= np.linalg.norm(x)
    return se3.pose(np.stack([x, np.cross(z, x), z], axis=1), origin)


def _foot(p: Array, u: Array, q: Array, v: Array) -> Array:
    """The point of the line p + s u that is nearest to the line q + t v."""
    normal = np.cross(u, v)
    foot: Array = p + u * (np.dot(np.cross(q - p, v), normal) / np.dot(normal, normal))
    return foot
