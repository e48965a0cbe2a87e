"""Make known mistakes in measurements: what a diagnosis is measured with, and nothing that a diagnosis is made of.

A mistake takes a session that has none, a size and a generator of random numbers. It returns the session's measurements
with the mistake in them, the name that a diagnosis should give it, what it applies to, and how large it is at the
points. A discrete mistake is as large as the share or the number of rows that it spoils, a continuous one as large as
a multiple of the accuracy that a calibration without it reaches. The script lists the kinds, each made once.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from shared import Answer, Document, Flag, Section, Table, run_script

import lab
from lab.core.measurements import Measurements
from lab.core.se3 import Array, exp
from lab.kinematics.serial.serial_arm import SerialArm

__all__ = ["KINDS", "Kind", "Mistaken", "Session", "kinds_for", "session_of", "visible_m"]


@dataclass(frozen=True)
class Options:
    """Which campaign the mistakes are made in."""

    robot: str = "irb120"
    """The arm that is measured."""
    poses: int = 60
    """Poses of the campaign."""
    targets: int = 3
    """Measured points of the tool."""
    accuracy_mm: float = 0.05
    """Mean error that a calibration without mistakes reaches."""
    seed: int = 0
    """Of the campaign and of all draws."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Session:
    """Sound measurements, and where the arm is in them.

    Attributes:
        data: as a file has them.
        arm: with the measured targets.
        values: ``(p,)`` its parameters, base and tool among them, to a few millimetres.
        accuracy_m: mean error that a calibration of such measurements reaches.
    """

    data: Measurements
    arm: SerialArm
    values: Array
    accuracy_m: float

    @property
    def base(self) -> Array:
        """Origin ``(3,)`` of frame 0 in the instrument's frame (m)."""
        return self.arm.T_tracker_frame0(self.values)[:3, 3]

    def frames(self, size: int) -> Array:
        """Poses ``(n, 4, 4)`` of a link's frame, numbered from 1, in the instrument's frame."""
        found: Array = self.arm.T_tracker_frame0(self.values) @ self.arm.frame(self.data.joints, self.values, size)
        return found

    def moved_by(self, joints: Array) -> Array:
        """Displacements ``(n, k, 3)`` (m) of the targets where joints ``(n, joints)`` are added to the readings."""
        before = self.arm.points(self.data.joints, self.values)
        return np.asarray(self.arm.points(self.data.joints + joints, self.values) - before)


@dataclass(frozen=True)
class Mistaken:
    """Measurements with a mistake.

    Attributes:
        data: as they are read.
        name: of the mistake.
        of: what it applies to: joints, targets, ids of rows.
        rms_m: root mean square displacement of the points that it spoils (m); NaN where there are no points.
        number: length of its numbers in SI units: a shift (m), an angle (rad), a ratio; NaN where it has none, or of
            several kinds.
        robot: the name of the robot that is given instead of the true one, if it is the mistake.
        options: of ``lab.identify``, if they are the mistake; ``cameras`` is the text of a file.
    """

    data: Measurements
    name: str
    of: tuple[str, ...] = ()
    rms_m: float = float("nan")
    number: float = float("nan")
    robot: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)


Make = Callable[[Session, float, np.random.Generator], Mistaken]


@dataclass(frozen=True)
class Kind:
    """A kind of mistake.

    Attributes:
        make: makes it, of a size.
        sizes: three of them, small to large.
        unit: of the sizes: ``times`` the reached accuracy, ``share`` of the rows, or what they count.
        targets: least number of targets that it needs.
        observe: what has to be measured.
    """

    make: Make
    sizes: tuple[float, ...]
    unit: str = "times"
    targets: int = 1
    observe: tuple[str, ...] = ("points",)


def session_of(day: Any, accuracy_m: float) -> Session:
    """Return a simulated session as one that mistakes are made in, with the true arm and one target at least."""
    truth = day.true_robot.truth(day.measurements.targets or ("p1",))
    return Session(day.measurements, truth.arm, truth.values, accuracy_m)


def kinds_for(targets: int, observe: str = "points") -> dict[str, Kind]:
    """Return the kinds of mistakes that so many targets can have."""
    return {name: kind for name, kind in KINDS.items() if kind.targets <= targets and observe in kind.observe}


def visible_m(session: Session, wrong: Mistaken) -> float:
    """Return the root mean square error (m) that a calibration of the geometry leaves of a mistake, to first order."""
    if wrong.data.points.shape != session.data.points.shape or wrong.robot:
        return float("nan")
    shown = wrong.data.points - session.data.points
    shown = shown - session.moved_by(wrong.data.joints - session.data.joints)
    columns = session.arm.observe(session.data.joints, session.values)[1]
    seen = np.isfinite(shown)
    left = shown[seen] - columns[seen] @ np.linalg.lstsq(columns[seen], shown[seen], rcond=1e-9)[0]
    return float(np.sqrt(3 * np.mean(left**2)))


# -- rows, joints and directions that are drawn ------------------------------------------------------------------------


def _rms(displacement: Array) -> float:
    """Root mean square length of displacements ``(..., 3)`` that are not zero."""
    squares = (displacement**2).sum(axis=-1)
    return float(np.sqrt(np.mean(squares[squares > 0]))) if (squares > 0).any() else 0.0


def _direction(rng: np.random.Generator) -> Array:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def _joint(session: Session, rng: np.random.Generator) -> int:
    """A joint between the first and the last: zeros of these are base and tool."""
    return int(rng.integers(1, session.data.joints.shape[1] - 1))


def _after(session: Session, rng: np.random.Generator) -> Array:
    """``(n,)``: 1 from a row on, in the middle three fifths of the campaign."""
    n = len(session.data)
    return np.asarray(np.arange(n) >= round(rng.uniform(0.2, 0.8) * n), dtype=float)


def _last(session: Session, share: float) -> slice:
    n = len(session.data)
    return slice(n - max(round(share * n), 1), n)


def _some(session: Session, count: float, rng: np.random.Generator) -> Array:
    return np.sort(rng.choice(np.arange(1, len(session.data)), int(count), replace=False))


def _at(session: Session, first: int) -> tuple[str, ...]:
    """Ids of the two rows that a step is between."""
    return session.data.ids[first - 1], session.data.ids[first]


# -- readings of joints ------------------------------------------------------------------------------------------------


def _read(session: Session, joints: Array, name: str, *of: str) -> Mistaken:
    """Measurements with other joint readings."""
    rms_m = _rms(session.moved_by(joints - session.data.joints))
    return Mistaken(replace(session.data, joints=joints), name, of, rms_m)


def _joint_unit(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """One joint in gon for degrees, the last rows, or all: degrees and radians taken for each other."""
    joints, names = session.data.joints.copy(), session.data.joint_names
    if size == 0:
        of = _joint(session, rng)
        joints[:, of] *= 400 / 360
        return _read(session, joints, "joint_unit", names[of])
    joints[_last(session, size)] *= rng.choice([180 / np.pi, np.pi / 180])
    return _read(session, joints, "joint_unit", *names)


def _joint_sign(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    of = np.sort(rng.choice(session.data.joints.shape[1], int(size), replace=False))
    joints = session.data.joints.copy()
    joints[:, of] *= -1
    return _read(session, joints, "joint_sign", *(session.data.joint_names[i] for i in of))


def _pair(session: Session, size: float, rng: np.random.Generator) -> tuple[int, int]:
    """Two joints: of the wrist (0), neighbours (1), or any (2)."""
    n = session.data.joints.shape[1]
    if size == 2:
        first, second = rng.choice(n, 2, replace=False)
        return int(first), int(second)
    first = n - 2 if size == 0 else int(rng.integers(0, n - 2))
    return first, first + 1


def _joints_exchanged(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    first, second = _pair(session, size, rng)
    joints, names = session.data.joints.copy(), session.data.joint_names
    joints[:, [first, second]] = joints[:, [second, first]]
    return _read(session, joints, "joints_exchanged", *sorted((names[first], names[second])))


def _joints_coupled(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    other, of = _pair(session, size, rng)
    joints, names = session.data.joints.copy(), session.data.joint_names
    joints[:, of] += rng.choice([-1, 1]) * joints[:, other]
    return _read(session, joints, "joints_coupled", names[of], names[other])


def _joint_zero(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """Off by 1 degree, by any angle from 5 to 80, or by right angles."""
    of, joints = _joint(session, rng), session.data.joints.copy()
    angle = {0: 1.0, 1: rng.uniform(5, 80), 2: rng.choice([90.0, 180.0])}[int(size)]
    joints[:, of] += np.deg2rad(angle) * rng.choice([-1, 1])
    return _read(session, joints, "joint_zero", session.data.joint_names[of])


def _joint_step(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    after, of = _after(session, rng), _joint(session, rng)
    shape = after[:, None] * (np.arange(session.data.joints.shape[1]) == of)
    of_rows = _at(session, int(np.argmax(after)))
    return _scaled(session, shape, size, "joint_step", session.data.joint_names[of], *of_rows)


def _joint_gain(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    of = _joint(session, rng)
    shape = session.data.joints * (np.arange(session.data.joints.shape[1]) == of)
    return _scaled(session, shape, size, "joint_gain", session.data.joint_names[of])


def _joint_coupling(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    of = _joint(session, rng)  # not the last: a target on its axis would not show it
    other = int(rng.choice(np.delete(np.arange(1, session.data.joints.shape[1]), of - 1)))
    shape = session.data.joints[:, [other]] * (np.arange(session.data.joints.shape[1]) == of)
    names = session.data.joint_names
    return _scaled(session, shape, size, "joint_coupling", names[of], names[other])


def _scaled(session: Session, shape: Array, size: float, name: str, *of: str) -> Mistaken:
    """Readings off in proportion to ``shape (n, joints)``, so that the points are off by a size."""
    tiny = 1e-6
    number = size * session.accuracy_m * tiny / _rms(session.moved_by(tiny * shape))
    return replace(_read(session, session.data.joints + number * shape, name, *of), number=number)


def _joint_stuck(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """A reading that is constant in the last rows while the joint moves."""
    of, rows, joints = _joint(session, rng), _last(session, size), session.data.joints.copy()
    joints[rows, of] = joints[rows.start, of]
    return _read(session, joints, "joint_stuck", session.data.joint_names[of])


# -- rows --------------------------------------------------------------------------------------------------------------


def _rows_shifted(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """Joints one row late in the last rows, or one or three late in all: rows without a partner are left out."""
    data, late = session.data, 3 if size == 3 else 1
    first = len(data) - round(0.4 * len(data)) if size == 0 else 0
    kept = np.setdiff1d(np.arange(len(data)), np.arange(first, first + late))
    joints = np.concatenate([data.joints[:first], data.joints[first : len(data) - late]])
    spoilt = replace(data[kept], joints=joints)
    wrong = session.arm.points(joints, session.values) - session.arm.points(data.joints[kept], session.values)
    return Mistaken(spoilt, "rows_shifted", (str(late),), _rms(wrong))


def _rows_exchanged(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    rows = rng.choice(len(session.data), 2 * int(size), replace=False).reshape(2, -1)
    joints = session.data.joints.copy()
    joints[rows.ravel()] = joints[rows[::-1].ravel()]
    return _read(session, joints, "rows_exchanged", *(session.data.ids[i] for i in rows.T.ravel()))


def _rows_reversed(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    joints, rows = session.data.joints.copy(), _last(session, size)
    joints[rows] = joints[rows][::-1]
    return _read(session, joints, "rows_reversed")


def _joints_reversed(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    return _read(session, session.data.joints[:, ::-1].copy(), "joints_reversed")


def _row_repeated(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    rows, joints = _some(session, size, rng), session.data.joints.copy()
    joints[rows] = session.data.joints[rows - 1]
    return _read(session, joints, "row_repeated", *(session.data.ids[i] for i in rows))


def _outliers(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """Whole poses off, one in twenty-five: all targets by the same vector."""
    rows = _some(session, max(round(len(session.data) / 25), 1), rng)
    shape = np.zeros_like(session.data.points)
    for row in rows:
        shape[row] = _direction(rng)
    return _moved(session, shape, size, "outliers", *(session.data.ids[i] for i in rows))


# -- readings of points ------------------------------------------------------------------------------------------------


def _pointed(session: Session, points: Array, name: str, *of: str) -> Mistaken:
    """Measurements with other points."""
    return Mistaken(replace(session.data, points=points), name, of, _rms(points - session.data.points))


def _moved(session: Session, shape: Array, size: float, name: str, *of: str) -> Mistaken:
    """Points displaced in proportion to ``shape (n, k, 3)``, those that it moves by a size."""
    number = size * session.accuracy_m / _rms(shape)
    return replace(_pointed(session, session.data.points + number * shape, name, *of), number=number)


def _point_unit(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """The last rows or one target in inches for millimetres, or all points in another unit."""
    points, ratio = session.data.points.copy(), 1 / 25.4
    if size == 1:
        points *= rng.choice([1000.0, 0.001, 0.1, 25.4])
    else:
        points[_last(session, size)] *= ratio
    return _pointed(session, points, "point_unit")


def _points_mirrored(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """An axis negated, or two axes exchanged; in the last rows, or in all."""
    points, rows, axis = session.data.points.copy(), _last(session, size), int(rng.integers(3))
    if rng.random() < 0.5:
        points[rows, :, axis] *= -1
    else:
        order = np.delete(np.arange(3), axis)[::-1]
        points[rows] = points[rows][..., np.insert(order, axis, axis)]
    return _pointed(session, points, "points_mirrored")


def _targets_swapped(session: Session, rows: Any, name: str, rng: np.random.Generator) -> Mistaken:
    first, second = np.sort(rng.choice(len(session.data.targets), 2, replace=False))
    points = session.data.points.copy()
    points[rows, first], points[rows, second] = session.data.points[rows, second], session.data.points[rows, first]
    of = (session.data.targets[first], session.data.targets[second])
    ids = np.array(session.data.ids)[rows]
    return _pointed(session, points, name, *of, *ids.tolist())


def _targets_exchanged(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    return _targets_swapped(session, _last(session, size), "targets_exchanged", rng)


def _targets_exchanged_once(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    return _targets_swapped(session, _some(session, size, rng), "targets_exchanged_once", rng)


_OTHERS = {
    "irb120": ("lrmate200id", "irb140", "kr6_r700"),
    "ur5e": ("ur5", "ur3e", "ur10e"),
    "panda": ("fr3", "iiwa7", "gen3"),
}


def _other_robot(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """Another robot is named, the more unlike the larger."""
    true = session.data.robot
    given = next(others for name, others in _OTHERS.items() if name in true)[int(size)]
    return Mistaken(replace(session.data, robot=given), "other_robot", (true,), robot=given)


# -- the instrument, base, tool and links ------------------------------------------------------------------------------


def _range_constant(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    points = session.data.points
    beam = points / np.linalg.norm(points, axis=-1, keepdims=True)
    return _moved(session, rng.choice([-1, 1]) * beam, size, "range_constant")


def _scale(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """All points this share too far from the instrument."""
    points = session.data.points * (1 + rng.choice([-1, 1]) * size)
    return replace(_pointed(session, points, "scale"), number=size)


def _shear(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    points, strain = session.data.points, rng.normal(size=(3, 3))
    strain = strain + strain.T - np.eye(3) * np.trace(strain) * 2 / 3
    return replace(_moved(session, (points - session.base) @ strain, size, "shear"), number=float("nan"))


def _twist(session: Session, rng: np.random.Generator) -> Array:
    """Displacements ``(n, k, 3)`` by a base that is shifted, and turned by as much at a reach of half a metre."""
    return np.asarray(_direction(rng) + np.cross(2 * _direction(rng), session.data.points - session.base))


def _base_step(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    after = _after(session, rng)
    shape = after[:, None, None] * _twist(session, rng)
    step = _moved(session, shape, size, "base_step", *_at(session, int(np.argmax(after))))
    return replace(step, number=float("nan"))


def _drift(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    progress = np.linspace(0, 1, len(session.data))[:, None, None]
    return replace(_moved(session, progress * _twist(session, rng), size, "drift"), number=float("nan"))


def _growth(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    progress = np.linspace(0, 1, len(session.data))[:, None, None]
    return _moved(session, progress * (session.data.points - session.base), size, "growth")


def _on_tool(session: Session, rng: np.random.Generator) -> tuple[Array, Array]:
    """A direction ``(n, 1, 3)`` that is fixed in the tool, from a row on, and from which rows."""
    after = _after(session, rng)
    axes = session.frames(session.data.joints.shape[1])[:, :3, :3] @ _direction(rng)
    return (after[:, None] * axes)[:, None], after


def _target_step(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    shape, after = _on_tool(session, rng)
    of = int(rng.integers(len(session.data.targets)))
    mask = (np.arange(len(session.data.targets)) == of)[:, None]
    target = session.data.targets[of]
    return _moved(session, shape * mask, size, "target_step", target, *_at(session, int(np.argmax(after))))


def _tool_step(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    shape, after = _on_tool(session, rng)
    every = np.ones((len(session.data.targets), 1))
    return _moved(session, shape * every, size, "tool_step", *_at(session, int(np.argmax(after))))


def _link(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """A length along a link's x, or its twist about it, off by so many mm or twice as many mrad."""
    of, twisted = _joint(session, rng) + 1, rng.random() < 0.3
    frame = session.frames(of - 1 if session.arm.chain.convention == "craig" else of)[:, None]
    x, reach = frame[..., :3, 0], session.data.points - frame[..., :3, 3]
    number, name = 1e-3 * size * rng.choice([-1, 1]) * (2 if twisted else 1), "alpha" if twisted else "a"
    turned = np.cross(x, reach) * np.sin(number) + np.cross(x, np.cross(x, reach)) * (1 - np.cos(number))
    points = session.data.points + (turned if twisted else number * x)
    return replace(_pointed(session, points, "link", f"link{of}.{name}"), number=abs(number))


# -- orientations ------------------------------------------------------------------------------------------------------


def _orientation_convention(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """Quaternions with w last, of the inverse rotation, or in another fixed frame than the positions."""
    target, parts = session.data.targets[0], "wxyz"
    names = [f"{target}_q{part}" for part in parts]
    numbers = np.array([[float(text) for text in session.data.other[name]] for name in names])
    if size == 0:
        numbers = np.roll(numbers, -1, axis=0)
    elif size == 1:
        numbers[1:] *= -1
    else:
        numbers = _turned(numbers, exp(np.pi / 2 * np.eye(3)[rng.integers(3)]))
    texts = {name: tuple(repr(float(number)) for number in row) for name, row in zip(names, numbers, strict=True)}
    data = replace(session.data, other={**session.data.other, **texts})
    return Mistaken(data, "orientation_convention", (target,), 0.0)


def _turned(quaternions: Array, rotation: Array) -> Array:
    """Quaternions ``(4, n)`` wxyz of ``rotation @ R``."""
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_matrix(rotation) * Rotation.from_quat(quaternions.T, scalar_first=True)
    return np.asarray(turned.as_quat(scalar_first=True).T)


# -- pictures ----------------------------------------------------------------------------------------------------------

_CAMERA = """[[camera]]
name = "camera"
size_px = [1280, 960]
focal_px = [{focal}, {focal}]
centre_px = [639.5, 479.5]
fixed_to = "{camera}"

[[board]]
name = "board"
columns = 9
rows = 6
square_mm = {square}
fixed_to = "{board}"
"""
_FOCAL_PX, _SQUARE_MM, _CORNERS = 1200.0, 20.0, 54  # of the camera and the board of a simulation


def _of_pictures(session: Session) -> tuple[Array, Array]:
    """Joints ``(m, joints)`` of each picture, and the picture ``(n,)`` of each corner: a picture has its own joints."""
    joints = session.data.joints
    picture = np.concatenate([[0], np.cumsum((np.diff(joints, axis=0) != 0).any(axis=1))])
    return joints[np.unique(picture, return_index=True)[1]], picture


def _board_turned(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """Corners of some pictures are counted from the other end of the board."""
    joints, picture = _of_pictures(session)
    some = np.sort(rng.choice(len(joints), max(round(size * len(joints)), 1), replace=False))
    turned, before = np.isin(picture, some), session.data.other["corner"]
    corners = [str(_CORNERS - 1 - int(corner)) if end else corner for corner, end in zip(before, turned, strict=True)]
    data = replace(session.data, other={**session.data.other, "corner": tuple(corners)})
    return Mistaken(data, "board_turned", tuple(map(str, some)), 1e-3 * _SQUARE_MM * float(np.hypot(8, 5)))


def _pictures_shifted(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """Joints one picture late in the last pictures, or one or three late in all."""
    joints, picture = _of_pictures(session)
    late, first = 3 if size == 3 else 1, round(0.6 * len(joints)) if size == 0 else 0
    other = np.concatenate([joints[:first], joints[first : first + late], joints[first : len(joints) - late]])
    return _read(session, other[picture], "pictures_shifted", str(late))


def _pictures_exchanged(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    joints, picture = _of_pictures(session)
    pairs = rng.choice(len(joints), 2 * int(size), replace=False).reshape(2, -1)
    joints[pairs.ravel()] = joints[pairs[::-1].ravel()]
    return _read(session, joints[picture], "pictures_exchanged", *map(str, pairs.T.ravel()))


def _described(session: Session, name: str, **given: Any) -> Mistaken:
    """Measurements that are read by another description of the camera and the board."""
    usual = {"focal": _FOCAL_PX, "square": _SQUARE_MM, "camera": "hand", "board": "world"}
    return Mistaken(session.data, name, options={"cameras": _CAMERA.format(**usual | given)})


def _camera_mount(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    return _described(session, "camera_mount", camera="world", board="hand")


def _focal_length(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    return _described(session, "focal_length", focal=_FOCAL_PX * (1 + rng.choice([-1, 1]) * size))


def _square_size(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    return _described(session, "square_size", square=_SQUARE_MM * (1 + rng.choice([-1, 1]) * size))


# -- sockets and cables ------------------------------------------------------------------------------------------------


def _socket_exchanged(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """Some rows name the other socket of their location."""
    rows, other = _some(session, size, rng), {"a": "b", "b": "a"}
    sockets = [other[each] if i in rows else each for i, each in enumerate(session.data.other["socket"])]
    data = replace(session.data, other={**session.data.other, "socket": tuple(sockets)})
    return Mistaken(data, "socket_exchanged", tuple(session.data.ids[i] for i in rows), 0.1)


def _socket_unit(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """The distance of the sockets, which is 100 mm, is given in another unit."""
    return Mistaken(session.data, "socket_unit", options={"socket_distance_mm": 100.0 * size})


def _socket_moved(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """Both sockets of a location move from a row on: the arm follows with the least motion of its joints."""
    where = np.array(session.data.other["location"])
    of = str(rng.choice(np.unique(where)))
    rows = (_after(session, rng) > 0) & (where == of)
    rates = session.arm.joint_jacobian(session.data.joints, session.values)[:, 0]
    shift = size * session.accuracy_m * _direction(rng)
    joints = session.data.joints + rows[:, None] * (np.linalg.pinv(rates) @ shift)
    return _read(session, joints, "socket_moved", of)


def _pulled(session: Session, lengths: Array, name: str, *of: str) -> Mistaken:
    """Measurements with other lengths of the cable (mm)."""
    change = 1e-3 * (lengths - session.data.conditions["cable_mm"])
    data = replace(session.data, conditions={**session.data.conditions, "cable_mm": lengths})
    return Mistaken(data, name, of, float(np.sqrt(np.mean(change[change != 0] ** 2))))


def _cable_offset(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """The cable's zero moves from a row on."""
    after = _after(session, rng)
    lengths = session.data.conditions["cable_mm"] + 1e3 * size * session.accuracy_m * after
    return _pulled(session, lengths, "cable_offset", *_at(session, int(np.argmax(after))))


def _cable_scale(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    return _pulled(session, session.data.conditions["cable_mm"] * (1 + rng.choice([-1, 1]) * size), "cable_scale")


def _cable_unit(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """Inches for millimetres in the last rows, or metres or centimetres in all."""
    ratio = np.ones(len(session.data))
    ratio[_last(session, size)] = 1 / 25.4 if size < 1 else rng.choice([1e-3, 0.1])
    return _pulled(session, ratio * session.data.conditions["cable_mm"], "cable_unit")


def _anchor_moved(session: Session, size: float, rng: np.random.Generator) -> Mistaken:
    """An anchor moves within what the file calls one session."""
    names = np.array(session.data.sessions)
    of = str(rng.choice(np.unique(names)))
    rows = np.flatnonzero(names == of)
    late = rows[round(rng.uniform(0.3, 0.7) * len(rows)) :]
    # The lengths change by the part of the motion that lies along the cable, whose anchor is taken 1.5 m away.
    points = session.arm.points(session.data.joints, session.values)[late, 0]
    sight = points - points.mean(axis=0) + 1.5 * _direction(rng)
    along = sight @ _direction(rng) / np.linalg.norm(sight, axis=1)
    lengths = session.data.conditions["cable_mm"].copy()
    lengths[late] += 1e3 * size * session.accuracy_m * along / float(np.sqrt(np.mean(along**2)))
    return _pulled(session, lengths, "anchor_moved", of, *_at(session, int(late[0])))


_POINTED = ("points", "pose")
_ROWS = ("points", "pose", "socket", "cable")
_ALL = (*_ROWS, "pixels")
KINDS: Mapping[str, Kind] = {
    "joint_unit": Kind(_joint_unit, (0, 0.4, 1), "share", observe=_ROWS),
    "joint_sign": Kind(_joint_sign, (1, 2, 6), "joints", observe=_ALL),
    "joints_exchanged": Kind(_joints_exchanged, (0, 1, 2), "pair", observe=_ALL),
    "joints_coupled": Kind(_joints_coupled, (0, 1, 2), "pair", observe=_ROWS),
    "joint_zero": Kind(_joint_zero, (0, 1, 2), "angle", observe=_ALL),
    "rows_shifted": Kind(_rows_shifted, (0, 1, 3), "rows", observe=_ROWS),
    "rows_exchanged": Kind(_rows_exchanged, (1, 2, 4), "pairs", observe=_ROWS),
    "rows_reversed": Kind(_rows_reversed, (0.3, 0.6, 1), "share", observe=_POINTED),
    "joints_reversed": Kind(_joints_reversed, (1,), "all", observe=_POINTED),
    "row_repeated": Kind(_row_repeated, (1, 3, 6), "rows", observe=_ROWS),
    "point_unit": Kind(_point_unit, (0.2, 0.5, 1), "share"),
    "points_mirrored": Kind(_points_mirrored, (0.2, 0.5, 1), "share"),
    "targets_exchanged": Kind(_targets_exchanged, (0.1, 0.25, 0.5), "share", 2),
    "targets_exchanged_once": Kind(_targets_exchanged_once, (1, 2, 4), "poses", 2),
    "other_robot": Kind(_other_robot, (0, 1, 2), "unlikeness", observe=_ALL),
    "orientation_convention": Kind(_orientation_convention, (0, 1, 2), "kind", observe=("pose",)),
    "board_turned": Kind(_board_turned, (0.12, 0.25, 0.5), "share", observe=("pixels",)),
    "pictures_shifted": Kind(_pictures_shifted, (0, 1, 3), "pictures", observe=("pixels",)),
    "pictures_exchanged": Kind(_pictures_exchanged, (1, 2, 4), "pairs", observe=("pixels",)),
    "camera_mount": Kind(_camera_mount, (1,), "all", observe=("pixels",)),
    "focal_length": Kind(_focal_length, (0.01, 0.03, 0.1), "ratio", observe=("pixels",)),
    "square_size": Kind(_square_size, (0.01, 0.03, 0.1), "ratio", observe=("pixels",)),
    "socket_exchanged": Kind(_socket_exchanged, (1, 3, 6), "rows", observe=("socket",)),
    "socket_unit": Kind(_socket_unit, (1 / 25.4, 0.1, 10), "ratio", observe=("socket",)),
    "socket_moved": Kind(_socket_moved, (3, 10, 30), observe=("socket",)),
    "cable_offset": Kind(_cable_offset, (1, 3, 10), observe=("cable",)),
    "cable_scale": Kind(_cable_scale, (0.001, 0.003, 0.01), "ratio", observe=("cable",)),
    "cable_unit": Kind(_cable_unit, (0.2, 0.5, 1), "share", observe=("cable",)),
    "anchor_moved": Kind(_anchor_moved, (3, 10, 30), observe=("cable",)),
    "range_constant": Kind(_range_constant, (1, 3, 10)),
    "scale": Kind(_scale, (0.001, 0.003, 0.01), "ratio"),
    "shear": Kind(_shear, (1, 3, 10)),
    "base_step": Kind(_base_step, (1, 3, 10)),
    "target_step": Kind(_target_step, (1, 3, 10)),
    "tool_step": Kind(_tool_step, (1, 3, 10), targets=2),
    "joint_step": Kind(_joint_step, (1, 3, 10)),
    "joint_gain": Kind(_joint_gain, (1, 3, 10)),
    "joint_coupling": Kind(_joint_coupling, (1, 3, 10)),
    "link": Kind(_link, (3, 10, 50), "mm"),
    "drift": Kind(_drift, (1, 3, 10)),
    "growth": Kind(_growth, (1, 3, 10)),
    "outliers": Kind(_outliers, (3, 10, 30)),
    "joint_stuck": Kind(_joint_stuck, (0.2, 0.5, 1), "share", observe=_ROWS),
}


def answer(options: Options) -> Answer:
    """Each kind, made once at each of its sizes."""
    targets = ("p1", "p2", "p3")[: options.targets]
    day = lab.simulate(options.robot, poses=options.poses, seed=options.seed, targets=targets, instrument="leica-at960")
    session = session_of(day, 1e-3 * options.accuracy_mm)
    rows, values = [], {}
    for number, (name, kind) in enumerate(kinds_for(options.targets).items()):
        made = [kind.make(session, size, np.random.default_rng([options.seed, number])) for size in kind.sizes]
        values[name] = [
            {"size": size, "of": wrong.of, "rms_mm": 1e3 * wrong.rms_m, "visible_mm": 1e3 * visible_m(session, wrong)}
            for size, wrong in zip(kind.sizes, made, strict=True)
        ]
        cells = [f"{each['rms_mm']:.3g} ({each['visible_mm']:.3g})" for each in values[name]]
        rows.append((name, kind.unit, " ".join(made[0].of[:4]), *cells, *[""] * (3 - len(cells))))
    table = Table(("kind", "size is", "of", "small, mm", "medium, mm", "large, mm"), tuple(rows))
    title = "Root mean square displacement of the points, and what a calibration of the geometry would leave of it"
    return Answer(values, Document("Mistakes", (Section(title, (table,)),)))


if __name__ == "__main__":
    run_script("mistakes")
