"""Universal Robots' own calibration: the controller's ``calibration.conf``, and the kinematics of ROS.

A controller stores the factory calibration as differences from the nominal Denavit-Hartenberg table (distal): the lists
``delta_theta``, ``delta_a``, ``delta_d`` and ``delta_alpha`` of the section ``[mounting]``, six numbers each, in rad
and m. The maker does not document the file; these keys are those of public programs and files
(forum.universal-robots.com, threads 538 and 18921; ros-industrial/universal_robot, issue 357). The corrected table has
its second and third links hundreds of metres along nearly parallel axes (Universal Robots, ur_calibration, "Calibration
correction algorithm"). After reading, the same axes are described with Hayati's beta; for writing, without.

``ur_description`` reads a YAML file with the origin of each joint, ``x y z roll pitch yaw`` in the frame of the joint
before it (config/ur5e/default_kinematics.yaml; the angles are those of a URDF). The frames are placed as there: z along
the axis of the joint, x along that of the base at zero joint positions.
"""

import ast
import configparser
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.limits import CORRECTION_A_M, CORRECTION_D_M, CORRECTION_RAD, TEXT_BYTES
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.description import DescriptionFormat, IdentifiedRobot
from lab.formats.link_tree import link_tree
from lab.formats.structured import read_text
from lab.kinematics.serial.serial_arm import SerialArm

__all__ = ["UR_CORRECTIONS", "UR_KINEMATICS", "read_corrections", "ur_frames"]

_KEYS = ("delta_theta", "delta_d", "delta_a", "delta_alpha")
_RANGES = (CORRECTION_RAD, CORRECTION_D_M, CORRECTION_A_M, CORRECTION_RAD)  # of the keys
_LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_AXES = np.array([[0, 0, 1], [0, -1, 0], [0, -1, 0], [0, -1, 0], [0, 0, -1], [0, -1, 0]], dtype=np.float64)
_NEAR = 0.05  # tolerance of nominal directions, and of offsets (m)
_LENGTHS: Mapping[str, tuple[float, ...]] = {  # d1, a2, a3, d4, d5, d6 in m (Universal Robots, "DH parameters")
    "UR3": (0.1519, -0.24365, -0.21325, 0.11235, 0.08535, 0.0819),
    "UR5": (0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823),
    "UR10": (0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922),
    "UR3e": (0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921),
    "UR5e": (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    "UR10e": (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
    "UR16e": (0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655),
    "UR20": (0.2363, -0.862, -0.7287, 0.201, 0.1593, 0.1543),
    "UR30": (0.2363, -0.637, -0.5037, 0.201, 0.1593, 0.1543),
}
_ALPHAS = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
_ANOTHER_M = 0.01  # tolerance of nominal lengths
_EXACTLY_PARALLEL = 1e-10
_YAML_HEAD = """\
# The identified geometry of {name}, as ur_description reads it:
#   xacro ur.urdf.xacro ur_type:=TYPE kinematics_params:=ur_kinematics.yaml name:=NAME > calibrated.urdf
# Angles are those of a URDF (fixed axes). The hash names no controller's calibration: the driver says that the
# two differ. Neither base nor tool is in this file. tool0 is that of calibrated.urdf.
{places}
"""
_CONF_HEAD = """\
# The identified geometry of {name} as differences from the maker's table of the {model} (rad, m). Only these four
# lists are of this file: put them in the place of those in the controller's own calibration.conf, and keep its other
# lines. The maker does not document the file, and no controller was tried: keep a copy, and move slowly first.
{places}
"""


@dataclass(frozen=True)
class _UrFrames:
    """Frames of a Universal Robots arm at zero joint positions.

    Attributes:
        T_instrument_base: pose ``(4, 4)`` (m) of the controller's base, with z on axis 1, in the instrument's frame.
        joints: poses ``(4, 4)`` (m) of the six joints' frames in that base, z on each axis; the last one is tool0.
        points: the measured points ``(k, 3)`` (m) in tool0.
    """

    T_instrument_base: Array
    joints: tuple[Array, ...]
    points: Array


def read_corrections(path: Path) -> Array:
    """Read a controller's ``calibration.conf``: corrections ``(6, 4)`` to the nominal theta, d, a, alpha (rad, m)."""
    parser = configparser.ConfigParser(strict=False, interpolation=None, inline_comment_prefixes=("#",))
    try:
        parser.read_string(read_text(path, TEXT_BYTES), str(path))
    except configparser.Error as error:
        text = " ".join(str(error).split())
        raise LabError(f"{path}: is not a calibration.conf of a Universal Robots controller ({text})") from error
    if not parser.has_section("mounting"):
        raise LabError(f"{path}: has no section [mounting]; give the controller's calibration.conf")
    columns = [_list(path, key, parser.get("mounting", key, fallback="")) for key in _KEYS]
    corrections = np.stack(columns, axis=1)
    for key, column, sizes in zip(_KEYS, corrections.T, _RANGES, strict=True):
        if (largest := np.abs(column).max()) not in sizes:
            raise LabError(f"{path}: {key} reaches {largest:.3g} {sizes.unit}; give the controller's own file")
    return corrections


def _list(path: Path, key: str, text: str) -> Array:
    if not text:
        raise LabError(f"{path}: [mounting] has no {key}; give the controller's calibration.conf")
    try:
        values = np.array(ast.literal_eval(text), dtype=np.float64)
    except (ValueError, SyntaxError, TypeError, OverflowError, RecursionError, MemoryError) as error:
        said = " ".join(text.split())[:40]
        raise LabError(f"{path}: {key} = {said} is not a list of numbers; fix it") from error
    if values.shape != (6,) or not np.isfinite(values).all():
        raise LabError(f"{path}: {key} is to be a list of six finite numbers; fix it")
    return values


def _kinematics(identified: IdentifiedRobot[SerialArm, object]) -> str:
    """Return the YAML of an identified arm; "" for another maker."""
    identified_frames = ur_frames(identified.arm, identified.values)
    if identified_frames is None:
        return ""
    places = _places(identified.arm.targets, identified_frames, "base_link_inertia")
    lines = [_YAML_HEAD.format(name=" ".join(identified.name.split()), places=places).rstrip(), "kinematics:"]
    before = np.eye(4)
    for name, frame in zip(_LINKS, identified_frames.joints, strict=True):
        values = dict(zip(("x", "y", "z", "roll", "pitch", "yaw"), _six(se3.inverse(before) @ frame), strict=True))
        lines.append(f"  {name}:")
        lines += [f"    {key}: {value!r}" for key, value in values.items()]
        before = frame
    return "\n".join([*lines, "  hash: calib_identified_by_measurement"]) + "\n"


def _corrections(identified: IdentifiedRobot[SerialArm, object]) -> str:
    """Return the controller's lists of an identified arm; "" for an unknown table."""
    identified_frames, nominal = (ur_frames(identified.arm, v) for v in (identified.values, identified.arm.nominal()))
    if identified_frames is None or nominal is None:
        return ""
    lengths = _lengths(nominal.joints)
    apart = {model: np.abs(lengths - np.array(own)).max() for model, own in _LENGTHS.items()}
    if apart[model := min(apart, key=lambda each: apart[each])] > _ANOTHER_M:
        return ""
    d1, a2, a3, d4, d5, d6 = _LENGTHS[model]
    table = np.array([np.zeros(6), [d1, 0, 0, d4, d5, d6], [0, a2, a3, 0, 0, 0], _ALPHAS]).T
    delta = _distal_table(identified_frames.joints) - table
    places = _places(identified.arm.targets, identified_frames, "the controller's base")
    lines = [_CONF_HEAD.format(name=" ".join(identified.name.split()), model=model, places=places).rstrip()]
    lines.append("[mounting]")
    lines += [
        f"{key} = {[value + 0.0 for value in column]!r}" for key, column in zip(_KEYS, delta.T.tolist(), strict=True)
    ]
    return "\n".join(lines) + "\n"


UR_KINEMATICS = DescriptionFormat("ur_kinematics.yaml", _kinematics)
UR_CORRECTIONS = DescriptionFormat("calibration.conf", _corrections)


def _places(targets: Sequence[str], found: _UrFrames, base: str) -> str:
    """Return comments with the positions of the base and of the measured points."""
    six = " ".join(repr(each) for each in _six(found.T_instrument_base))
    lines = [f"# {base} in the frame of the measurements, x y z roll pitch yaw (m, rad): {six}"]
    for target, point in zip(targets, found.points.tolist(), strict=True):
        lines.append(f"# measured point {' '.join(target.split())} in tool0, x y z (m): {' '.join(map(repr, point))}")
    return "\n".join(lines)


def _six(T: Array) -> list[float]:
    """Return position (m), and roll, pitch and yaw (rad), of a pose ``(4, 4)``; zeros without a sign."""
    return [value + 0.0 for value in [*T[:3, 3].tolist(), *se3.roll_pitch_yaw(T[:3, :3]).tolist()]]


def ur_frames(arm: SerialArm, values: Array) -> _UrFrames | None:
    """Return the frames of an arm with parameters ``values`` ``(p,)``, as the maker places them; None for another arm.

    The nominal axes identify the maker. Displacements of an identified last link beyond its joint's axis are in the
    points, as of a tool: tool0 stays on the axis in both formats.

    Raises:
        LabError: the identified axes are too far from the nominal ones to be placed in this way.
    """
    chain = arm.chain
    if chain.size != len(_LINKS) or any(chain.prismatic):
        return None
    nominal = _axis_frames(arm, arm.nominal())
    z = np.array([T[:3, 2] for T in nominal])
    turn = np.diag([-1.0, -1.0, 1.0, 1.0]) if z[1, 1] > 0 else np.eye(4)  # base_link is turned against the base
    if np.abs(z @ turn[:3, :3] - _AXES).max() > _NEAR or abs(chain.table[0, 3] * (chain.convention == "craig")) > _NEAR:
        return None
    placed = _placed(tuple(turn @ T for T in nominal))
    if placed is None:
        return None
    last_tool0 = se3.inverse(turn @ nominal[-1]) @ placed[-1]  # mostly one
    frames = [turn @ T for T in _axis_frames(arm, values)]
    identified = _placed(tuple(frames))
    if identified is None:
        apart = _shoulder_apart(frames)
        raise LabError(
            f"the identified axes of joints 1 and 2 are {MM.text(apart, 2)} apart, but the format is of arms whose "
            "axes meet; find what is wrong with the fit first"
        )
    tool0 = frames[-1] @ last_tool0
    _, table, points = arm.split(values)
    before, after = np.eye(4), np.diag([1.0, chain.sign[-1], chain.sign[-1], 1.0])
    if chain.convention == "craig":
        before = _across(table[0])
    else:
        after = after @ _across(table[-1])
    points = se3.transform(se3.inverse(last_tool0) @ after, points)
    return _UrFrames(arm.T_tracker_frame0(values) @ before @ turn, (*identified[:-1], tool0), points)


def _across(row: Array) -> Array:
    _, _, a, alpha, beta = row
    turn = se3.exp(np.array([alpha, 0.0, 0.0])) @ se3.exp(np.array([0.0, beta, 0.0]))
    return se3.pose(turn, np.array([a, 0.0, 0.0]))


def _axis_frames(arm: SerialArm, values: Array) -> list[Array]:
    """Return frames ``(4, 4)`` (m) on the joints' signed axes at zero, in a base with z on axis 1."""
    tree = link_tree(arm, values)
    _, table, _ = arm.split(values)
    pose = se3.inverse(_across(table[0])) if arm.chain.convention == "craig" else np.eye(4)
    frames = []
    for link in tree.moving:
        pose = pose @ link.T_parent_link
        flip = np.diag([1.0, link.sign, link.sign, 1.0])
        frames.append(pose @ flip)
    return frames


def _placed(frames: tuple[Array, ...]) -> tuple[Array, ...] | None:
    """Place frames along and about their axes as ``ur_description``; None if the shoulders are apart."""
    z = [T[:3, 2] for T in frames]
    points = [T[:3, 3] for T in frames]
    shoulder, upper = _shoulder(frames)
    if np.linalg.norm(upper - shoulder) > _NEAR:
        return None
    elbow = points[2] + z[2] * np.dot(upper - points[2], z[2])
    wrist = _foot(points[3], z[3], points[4], z[4])
    roll = _foot(points[4], z[4], points[5], z[5])
    origins = (shoulder, upper, elbow, wrist, roll, points[5])
    return tuple(_frame(at, axis) for at, axis in zip(origins, z, strict=True))


def _shoulder(frames: Sequence[Array]) -> tuple[Array, Array]:
    """Return the nearest points ``(3,)`` (m) of the first two axes."""
    (p, u), (q, v) = ((T[:3, 3], T[:3, 2]) for T in frames[:2])
    return _foot(p, u, q, v), _foot(q, v, p, u)


def _shoulder_apart(frames: Sequence[Array]) -> float:
    shoulder, upper = _shoulder(frames)
    return float(np.linalg.norm(upper - shoulder))


def _lengths(frames: tuple[Array, ...]) -> Array:
    """Return d1, a2, a3, d4, d5 and d6 ``(6,)`` (m) of nominal frames."""
    shoulder, _, elbow, wrist, roll, tip = (T[:3, 3] for T in frames)
    d4 = -(wrist - elbow)[1]
    return np.array([shoulder[2], elbow[0], (wrist - elbow)[0], d4, -(roll - wrist)[2], -(tip - roll)[1]])


def _distal_table(frames: tuple[Array, ...]) -> Array:
    """Return theta, d, a and alpha ``(6, 4)`` of Denavit and Hartenberg, without a beta, of axes and tool0 in the base.

    Of two common normals the one with the smaller turn is used. Nearly parallel axes have large d; beyond the limit of
    the file they count as parallel.
    """
    x, z, origin = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.zeros(3)
    table = np.zeros((6, 4))
    for i in range(5):
        next_z, point = frames[i + 1][:3, 2], frames[i + 1][:3, 3]
        normal, sine = np.cross(z, next_z), np.linalg.norm(np.cross(z, next_z))
        parallel = sine < _EXACTLY_PARALLEL
        if not parallel:
            next_x = normal / sine * (np.sign(np.dot(normal, x)) or 1.0)
            foot, next_origin = _foot(origin, z, point, next_z), _foot(point, next_z, origin, z)
            parallel = abs(np.dot(foot - origin, z)) > CORRECTION_D_M.most
        if parallel:
            next_origin = point + next_z * np.dot(origin - point, z) / np.dot(next_z, z)
            next_x, foot = next_origin - origin, origin
            next_x = next_x / np.linalg.norm(next_x) * (np.sign(np.dot(next_x, x)) or 1.0)
        table[i] = _angle(x, next_x, z), np.dot(foot - origin, z), np.dot(next_origin - foot, next_x), 0.0
        table[i, 3] = 0.0 if parallel else _angle(z, next_z, next_x)
        x, z, origin = next_x, next_z, next_origin
    tool0 = frames[5]
    table[5, :2] = _angle(x, tool0[:3, 0], z), np.dot(tool0[:3, 3] - origin, z)
    return table


def _angle(u: Array, v: Array, about: Array) -> float:
    return float(np.arctan2(np.dot(np.cross(u, v), about), np.dot(u, v)))


def _frame(origin: Array, z: Array) -> Array:
    """Return a frame with z along an axis, and x nearest to the base's."""
    x = np.array([1.0, 0.0, 0.0]) - z * z[0]
    x /= np.linalg.norm(x)
    return se3.pose(np.stack([x, np.cross(z, x), z], axis=1), origin)


def _foot(p: Array, u: Array, q: Array, v: Array) -> Array:
    """Return the point of the line p + s u nearest to the line q + t v."""
    normal = np.cross(u, v)
    return np.asarray(p + u * (np.dot(np.cross(q - p, v), normal) / np.dot(normal, normal)))
