"""Read and write the files of ``lab payload`` and ``lab dynamics``: a CSV of runs, and TOML files beside it.

The TOML of a mounting: ``[base]`` with ``tilt_x_deg``, ``tilt_y_deg`` (zero) and ``gravity_m_per_s2`` (9.81), and
``[sensor]`` with ``sign`` (1 or -1, required) and ``rotation_vector_deg`` (zeros) from the last frame to the sensor.
"""

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError, error_context
from lab.core.limits import EARTH_GRAVITY
from lab.core.measurements import copied_rows, describe_copies
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.drives_toml import Drives
from lab.formats.measurement_csv import ObservedColumns, PoseReader
from lab.formats.structured import is_number, read_toml, structured
from lab.kinematics.dynamics.rigid_body import is_physical, load_of, symmetric

__all__ = [
    "WRENCH",
    "Mounting",
    "PayloadSamples",
    "read_load",
    "read_loads",
    "read_motion",
    "read_mounting",
    "write_loads",
    "write_mounting",
]

WRENCH = ("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")
_RUNS = ("loaded", "unloaded")
_GRAVITY = 9.81  # m/s^2, the default
_ORTHONORMAL = 1e-9  # largest error of a rotation
_EVEN = 0.01  # of a time step: largest difference of another one
_SLACK = 0.01  # rad or m that a joint reading may exceed its limits
_MIN_MOVING = 10  # rows of a run that is differentiated in time
_MIN_STATIC = {True: 2, False: 3}  # loaded poses, with torques or without: fewer determine too little
_OTHER_UNIT = {"rad": "deg", "deg": "rad", "m": "mm", "mm": "m"}

_Limits = tuple[Array, Array]


@dataclass(frozen=True)
class PayloadSamples:
    """Rows of a loaded and an unloaded run, in the order of the file.

    Attributes:
        time_s: ``(n,)``, evenly spaced within each run; None of static poses.
        joints: ``(n, J)`` readings, rad or m.
        torques: ``(n, J)`` of the joints, Nm (N of a slide), positive where they push the reading up; or None.
        wrench: ``(n, 6)`` as the sensor gives it, in its axes and about the last frame's origin, N and Nm; or None.
        loaded: ``(n,)`` True with the load at the hand.
        currents: whether ``torques`` are the motors' currents, A.
        lines: of the file, as an editor counts them, one a row; empty where there is no file.
        warnings: for the user.
    """

    time_s: Array | None
    joints: Array
    torques: Array | None
    wrench: Array | None
    loaded: NDArray[np.bool_]
    lines: tuple[int, ...] = ()
    warnings: tuple[str, ...] = ()
    currents: bool = False

    def __post_init__(self) -> None:
        n, size = self.joints.shape
        assert self.torques is not None or self.wrench is not None
        assert self.loaded.shape == (n,) and self.loaded.dtype == np.bool_ and len(self.lines) in (0, n)
        columns = (self.joints, (n, size)), (self.time_s, (n,)), (self.torques, (n, size)), (self.wrench, (n, 6))
        assert all(values is None or (values.shape == shape and np.isfinite(values).all()) for values, shape in columns)

    def __len__(self) -> int:
        return len(self.joints)

    @property
    def step_s(self) -> float | None:
        """Time step of the loaded run (of the other where it is missing); None of static poses."""
        if self.time_s is None:
            return None
        times = self.time_s[self.loaded] if self.loaded.any() else self.time_s
        return float((times[-1] - times[0]) / (len(times) - 1))

    def without_copies(self, source: object) -> "PayloadSamples":
        """Leave out static rows that repeat an earlier one to the last digit, with a warning.

        A copy would count as a measurement, and make intervals too narrow.
        """
        if self.time_s is not None:
            return self
        measured = [each for each in (self.torques, self.wrench) if each is not None]
        copies = copied_rows(np.column_stack([self.joints, *measured, self.loaded]))
        if not copies:
            return self
        lines = self.lines or tuple(range(len(self)))
        message = describe_copies(source, len(copies), *(f"line {lines[row]}" for row in copies[0]))
        retained = self.take(np.setdiff1d(np.arange(len(self)), [row for row, _ in copies]))
        return replace(retained, warnings=(*retained.warnings, f"{message}: left out"))

    def run(self, loaded: bool) -> "PayloadSamples":
        """Select the rows of one run."""
        return self.take(np.flatnonzero(self.loaded == loaded))

    def take(self, rows: NDArray[np.int_]) -> "PayloadSamples":
        """Select some rows."""
        return replace(
            self,
            time_s=None if self.time_s is None else self.time_s[rows],
            joints=self.joints[rows],
            torques=None if self.torques is None else self.torques[rows],
            wrench=None if self.wrench is None else self.wrench[rows],
            loaded=self.loaded[rows],
            lines=tuple(self.lines[i] for i in rows.tolist()) if self.lines else (),
        )


@dataclass(frozen=True)
class Mounting:
    """Mounting of the arm and the wrist sensor.

    Attributes:
        gravity: ``(3,)`` m/s^2 in frame 0.
        sign: +1 where the sensor reads what the hand does to the load, -1 where it reads what the load does to the
            hand, as most do.
        rotation: ``(3, 3)`` of the sensor's axes in the last frame; its origin is the last frame's.
    """

    gravity: Array
    sign: float = 1.0
    rotation: Array = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        size = float(np.linalg.norm(self.gravity))
        if self.gravity.shape != (3,) or size not in EARTH_GRAVITY:
            raise LabError(f"gravity is {size:.4g} m/s^2; give {EARTH_GRAVITY.shown} (not mm)")
        if self.sign not in (1.0, -1.0):
            raise LabError(f"the sensor's sign is {self.sign:g}; give 1 or -1")
        off = np.abs(self.rotation @ self.rotation.T - np.eye(3)).max() if self.rotation.shape == (3, 3) else np.inf
        if not off < _ORTHONORMAL or np.linalg.det(self.rotation) < 0:
            raise LabError("the sensor's mounting is no rotation; give an orthonormal (3, 3) matrix")

    @classmethod
    def tilted(
        cls, tilt_rad: Array, gravity: float = _GRAVITY, sign: float = 1.0, turn_rad: Array | None = None
    ) -> "Mounting":
        """Return the mounting of a tilted base and a turned sensor.

        Args:
            tilt_rad: ``(2,)``, angles about x and y of frame 0, together one rotation vector: turn of frame 0 out of
                the pose in which its z points up.
            gravity: m/s^2.
            turn_rad: ``(3,)``, a rotation vector from the last frame to the sensor.

        Raises:
            LabError: the gravity is not the Earth's.
        """
        if gravity < 0:
            raise LabError(f"gravity is {gravity:g} m/s^2; give its size, {EARTH_GRAVITY.shown}")
        down = np.array([0.0, 0.0, -gravity])
        leaning = se3.exp(np.append(tilt_rad, 0.0))
        return cls(leaning.T @ down, sign, np.eye(3) if turn_rad is None else se3.exp(turn_rad))

    @property
    def tilt_rad(self) -> Array:
        """Angles ``(2,)`` of ``tilted`` with this gravity."""
        x, y, z = -self.gravity / np.linalg.norm(self.gravity)  # upward direction in frame 0: R'z with R = exp(tilt)
        sine = np.hypot(x, y)
        if sine == 0.0:
            return np.array([0.0 if z > 0 else np.pi, 0.0])
        tilt: Array = np.arctan2(sine, z) * np.array([y, -x]) / sine
        return tilt


def write_loads(path: Path, records: PayloadSamples, joint_names: Sequence[str], prismatic: Sequence[bool]) -> None:
    """Write the CSV that ``read_loads`` reads back bit by bit."""
    joints = [f"{name}_{'m' if slides else 'rad'}" for name, slides in zip(joint_names, prismatic, strict=True)]
    torques = _current_columns(prismatic) if records.currents else _torque_columns(prismatic)
    columns: dict[str, list[str]] = {}
    for names, values in (
        (["time_s"], records.time_s), (joints, records.joints), (torques, records.torques), (WRENCH, records.wrench)
    ):  # fmt: skip
        if values is not None:
            rows = np.atleast_2d(values.T).tolist()
            columns |= {name: [*map(repr, row)] for name, row in zip(names, rows, strict=True)}
    columns["run"] = [_RUNS[0] if loaded else _RUNS[1] for loaded in records.loaded.tolist()]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def _torque_columns(prismatic: Sequence[bool]) -> list[str]:
    return [f"f{j}_n" if slides else f"tau{j}_nm" for j, slides in enumerate(prismatic, start=1)]


def _current_columns(prismatic: Sequence[bool]) -> list[str]:
    return [f"current{j}_a" for j in range(1, len(prismatic) + 1)]


def read_loads(
    path: Path, joint_names: Sequence[str], prismatic: Sequence[bool], limits: _Limits | None = None
) -> PayloadSamples:
    """Read a file of a loaded and an unloaded run.

    Args:
        joint_names: the robot's; the file may call them q1…qn instead.
        prismatic: which of them slide.
        limits: lower and upper ``(J,)`` of the joint positions, rad or m.

    Raises:
        LabError: with the file, the line as an editor counts it, and the column.
    """
    return _LoadReader(path, list(joint_names), list(prismatic), ObservedColumns()).read_records(limits)


def read_motion(
    path: Path,
    joint_names: Sequence[str],
    prismatic: Sequence[bool],
    limits: _Limits | None = None,
    drives: Drives | None = None,
) -> PayloadSamples:
    """Read a file of an arm in motion: times, positions of joints or motors, and torques or the motors' currents.

    A column ``run`` marks the rows with a load; without it there are none.

    Args:
        joint_names: the robot's; the file may call them q1…qn instead.
        prismatic: which of them slide.
        limits: lower and upper ``(J,)`` of the joint positions, rad or m.
        drives: needed for positions of motors.

    Raises:
        LabError: with the file, the line as an editor counts it, and the column.
    """
    return _LoadReader(path, list(joint_names), list(prismatic), ObservedColumns()).read_arm(limits, drives)


class _LoadReader(PoseReader):
    """Reader of a file of runs."""

    unknown_are = "passed over"

    def read_arm(self, limits: _Limits | None, drives: Drives | None) -> PayloadSamples:
        """Read the runs of an arm in motion."""
        joints = self._joints(limits) if (motors := self._motors(drives)) is None else motors
        if motors is not None:
            self._refuse_beyond(joints, limits)
        torques = self._all_or_none(_torque_columns(self.prismatic), "of every joint")
        currents = self._all_or_none(_current_columns(self.prismatic), "of every motor")
        self._refuse_unknown_loads()
        if (torques is None) == (currents is None):
            names = (
                f"{_torque_columns(self.prismatic)[0]} and so on, or {_current_columns(self.prismatic)[0]} and so on"
            )
            found = "neither torques nor motor currents" if torques is None else "torques and motor currents"
            raise self.wrong(f"{found}; give one of the two: {names}")
        if "time_s" not in self.header:
            raise self.wrong("no column time_s; an arm's dynamics show in a motion alone")
        loaded = self._runs() if "run" in self.header else np.zeros(len(joints), dtype=np.bool_)
        time_s = self.numbers("time_s")
        for run, name in ((True, _RUNS[0]), (False, _RUNS[1])):
            rows = np.flatnonzero(loaded == run)
            if 0 < len(rows) < _MIN_MOVING:
                raise LabError(f"{self.path}: {len(rows)} rows with run = {name}; give at least {_MIN_MOVING}")
            self._refuse_uneven(time_s, rows)
        self._rest([])
        measured, lines, warnings = torques if currents is None else currents, tuple(self.lines), tuple(self.warnings)
        return PayloadSamples(time_s, joints, measured, None, loaded, lines, warnings, currents is not None)

    def _motors(self, drives: Drives | None) -> Array | None:
        """Read joint positions from columns ``motor1_rad`` and so on; None where the file has joints."""
        motors = [column for column in self.header if re.fullmatch(r"motor\d*(_.*)?", column)]
        if not motors:
            return None
        if drives is None:
            raise self.wrong(f"{motors[0]}: motor positions need gear ratios; give --drives FILE.toml")
        factors: dict[str, Array | float] = {"rad": 1.0, "deg": np.pi / 180, "turns": 2 * np.pi}
        if drives.counts_per_turn is not None:
            factors["counts"] = 2 * np.pi / drives.counts_per_turn
        positions = np.empty((len(self), len(self.joint_names)))
        for j in range(len(self.joint_names)):
            column, factor = self._motor(j, factors)
            positions[:, j] = self.numbers(column) * np.broadcast_to(factor, len(self.joint_names))[j]
            motors.remove(column)
        if motors:
            raise self.wrong(f"column {motors[0]} is no motor of the robot; remove it")
        self._refuse_joints()
        return drives.joints(positions)

    def _refuse_joints(self) -> None:
        """Refuse joint positions beside the motors'."""
        if joints := [c for c in self.unread for n, name in enumerate(self.joint_names, 1)
                      if re.fullmatch(rf"({re.escape(name)}|q{n})_(rad|deg|mm|m)", c)]:  # fmt: skip
            raise self.wrong(f"{joints[0]}: the motors' positions say where the joints are; give one of both")

    def _motor(self, j: int, factors: Mapping[str, Array | float]) -> tuple[str, Array | float]:
        """Return the column of a motor, from 0, and the factor of its unit.

        Raises:
            LabError: there is none, or there are several.
        """
        names = {f"motor{j + 1}_{unit}": factor for unit, factor in factors.items()}
        columns = [name for name in names if name in self.header]
        if len(columns) != 1:
            what = f"{' and '.join(columns)} are the same motor" if columns else f"motor {j + 1} is missing"
            counts = "" if "counts" in factors else " (_counts where the drives have counts_per_turn)"
            raise self.wrong(f"{what}; give one of {', '.join(names)}{counts}")
        return columns[0], names[columns[0]]

    def _refuse_beyond(self, joints: Array, limits: _Limits | None) -> None:
        """Refuse joint positions that motors cannot have turned the joints to."""
        if limits is None:
            return
        beyond = np.argwhere((joints < limits[0] - _SLACK) | (joints > limits[1] + _SLACK))
        if beyond.size:
            row, j = beyond[0].tolist()
            factor, unit = (1e3, "mm") if self.prismatic[j] else (180 / np.pi, "°")
            low, high = (factor * each[j] for each in limits)
            raise LabError(
                f"{self.path}: {self.place(row)}: the motors turn joint {self.joint_names[j]} to "
                f"{factor * joints[row, j]:.6g} {unit}, beyond its limits of {low:.4g} to {high:.4g}; look at the "
                "signs of the gear ratios, at the couplings, and at motor_zero_deg"
            )

    def _joints(self, limits: _Limits | None) -> Array:
        joints = np.stack([self._joint(j) for j in range(len(self.joint_names))], axis=1)
        self._refuse_further_joints()
        self._refuse_degrees(joints, limits)
        return joints

    def read_records(self, limits: _Limits | None) -> PayloadSamples:
        """Read the runs with and without a payload, along a motion or in static poses."""
        joints = self._joints(limits)
        torques = self._all_or_none(_torque_columns(self.prismatic), "of every joint")
        wrench = self._all_or_none(WRENCH, "of all six")
        self._refuse_unknown_loads()
        if torques is None and wrench is None:
            raise self.wrong(
                f"no torques and no wrench; give {_torque_columns(self.prismatic)[0]} and so on, or {', '.join(WRENCH)}"
            )
        loaded = self._runs()
        time_s = self.numbers("time_s") if "time_s" in self.header else None
        self._refuse_few(loaded, time_s, torques)
        if time_s is not None:
            for run in (True, False):
                self._refuse_uneven(time_s, np.flatnonzero(loaded == run))
        self._rest([])
        return PayloadSamples(time_s, joints, torques, wrench, loaded, tuple(self.lines), tuple(self.warnings))

    def _number(self, row: int, column: str, cell: str, exponent: int) -> float:
        if not cell or cell.lower().lstrip("+-") in ("nan", "inf", "infinity"):
            found = f"'{cell}' is not a finite number" if cell else "the cell is empty"
            raise self.fail(row, column, f"{found}; give a number, or end the file before the gap")
        return super()._number(row, column, cell, exponent)

    def _refuse_degrees(self, joints: Array, limits: _Limits | None) -> None:
        """Refuse joint positions beyond the limits, or beyond a whole turn where there are none: another unit."""
        for j, slides in enumerate(self.prismatic):
            most = np.inf if slides else 2 * np.pi
            low, high = (-most, most) if limits is None else (limits[0][j], limits[1][j])
            beyond = np.flatnonzero((joints[:, j] < low - _SLACK) | (joints[:, j] > high + _SLACK))
            if not beyond.size:
                continue
            row, column = int(beyond[0]), self._joint_column(j)
            stem, unit = column.rsplit("_", 1)
            other, factor = _OTHER_UNIT[unit], {"deg": 180 / np.pi, "mm": 1e3}.get(unit, 1.0)
            span = f"{factor * low:.4g} to {factor * high:.4g}"
            looks = {"rad": ", probably degrees", "m": ", probably millimetres"}.get(unit, "")
            seems = looks if abs(joints[row, j]) > 2 * np.pi else ""
            raise self.fail(
                row,
                column,
                f"{factor * joints[row, j]:.6g} {unit} is beyond its limits of {span}{seems}; "
                f"rename the column to {stem}_{other} if it is so, or take the right --robot",
            )

    def _joint_column(self, j: int) -> str:
        stems = (self.joint_names[j], f"q{j + 1}")
        return next(c for stem in stems for unit in _OTHER_UNIT if (c := f"{stem}_{unit}") in self.header)

    def _all_or_none(self, names: Sequence[str], of: str) -> Array | None:
        given = [name for name in names if name in self.header]
        if not given:
            return None
        if missing := [name for name in names if name not in given]:
            raise self.wrong(f"{missing[0]} is missing beside {given[0]}; give the columns {of}")
        return np.stack([self.numbers(name) for name in names], axis=1)

    def _refuse_unknown_loads(self) -> None:
        expected = [*_torque_columns(self.prismatic), *WRENCH]
        for column in self.unread:
            if column not in expected and re.fullmatch(r"(tau\d*|f\d+|[fm][xyz])(_.*)?", column):
                raise self.wrong(
                    f"column {column}: unknown unit or axis; loads of this robot are given as {', '.join(expected)}"
                )
            if re.fullmatch(r"(time|t)(_.*)?", column) and column != "time_s":
                raise self.wrong(f"column {column}: unknown unit; give the time as time_s")

    def _runs(self) -> NDArray[np.bool_]:
        texts = self.texts("run")
        if texts is None:
            raise self.wrong(f"no column run; state in each row whether it is {' or '.join(_RUNS)}")
        for i, text in enumerate(texts):
            if text not in _RUNS:
                raise self.fail(i, "run", f"'{text}' is unknown; write {' or '.join(_RUNS)}")
        return np.array([text == _RUNS[0] for text in texts])

    def _refuse_few(self, loaded: NDArray[np.bool_], time_s: Array | None, torques: Array | None) -> None:
        least = _MIN_STATIC[torques is not None] if time_s is None else _MIN_MOVING
        counts = {_RUNS[0]: int(loaded.sum()), _RUNS[1]: int((~loaded).sum())}
        for run, count in counts.items():
            needed = run == _RUNS[0] or (count and torques is not None)
            if needed and count < least:
                kind = "static poses" if time_s is None else "samples of a motion"
                raise LabError(f"{self.path}: {count} rows with run = {run}; give at least {least} {kind}")

    def _refuse_uneven(self, time_s: Array, rows: NDArray[np.int_]) -> None:
        """Refuse a run whose time steps are not equal and forward."""
        if len(rows) < 2:
            return
        steps = np.diff(time_s[rows])
        usual = float(np.median(steps))
        if not usual > 0:
            raise self.fail(int(rows[1]), "time_s", "the time does not rise; give the rows of a run in their order")
        uneven = np.flatnonzero(np.abs(steps - usual) > _EVEN * usual)
        if uneven.size:
            i = int(uneven[0])
            raise self.fail(
                int(rows[i + 1]),
                "time_s",
                f"a step of {steps[i]:.6g} s where the others are {usual:.6g} s; give evenly timed rows, without gaps",
            )


def write_mounting(path: Path, mounting: Mounting) -> None:
    """Write the TOML that ``read_mounting`` reads back, up to rounding."""
    x, y = np.rad2deg(mounting.tilt_rad).tolist()
    turn = ", ".join(repr(angle) for angle in np.rad2deg(se3.log(mounting.rotation)).tolist())
    path.write_text(
        f"[base]\ntilt_x_deg = {x!r}\ntilt_y_deg = {y!r}\n"
        f"gravity_m_per_s2 = {float(np.linalg.norm(mounting.gravity))!r}\n\n"
        f"[sensor]\nsign = {int(mounting.sign)}  # 1: the hand's force on the load; -1: the load's on the hand\n"
        f"rotation_vector_deg = [{turn}]  # from the last frame to the sensor's axes\n",
        encoding="utf-8",
    )


@dataclass(frozen=True)
class _BaseSection:
    tilt_x_deg: float = 0.0
    tilt_y_deg: float = 0.0
    gravity_m_per_s2: float = _GRAVITY


@dataclass(frozen=True)
class _SensorSection:
    sign: float | None = None
    rotation_vector_deg: tuple[float, ...] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class _MountingFile:
    base: _BaseSection = field(default_factory=_BaseSection)
    sensor: _SensorSection = field(default_factory=_SensorSection)


def read_mounting(path: Path, *, sensor: bool = True) -> Mounting:
    """Read the TOML beside a file of runs.

    Args:
        sensor: require the sensor's sign, for a wrench.

    Raises:
        LabError: the file is missing or malformed, has no sign, or its gravity is not the Earth's.
    """
    found = structured(path, _MountingFile, read_toml(path))
    base, wrist = found.base, found.sensor
    if sensor and wrist.sign is None:
        raise LabError(
            f"{path}: [sensor] sign is missing; write 1 if it reads what the hand does to the load (at rest, fz is "
            "positive where the sensor's z points up), -1 for the opposite"
        )
    numbers = {"base": (base.tilt_x_deg, base.tilt_y_deg, base.gravity_m_per_s2), "sensor": wrist.rotation_vector_deg}
    for section, values in numbers.items():
        if wrong := [value for value in values if not is_number(value)]:
            raise LabError(f"{path}: [{section}] {wrong[0]} is no finite number; give one")
    if len(wrist.rotation_vector_deg) != 3:
        turn = list(wrist.rotation_vector_deg)
        raise LabError(f"{path}: [sensor] rotation_vector_deg is {turn}; give three angles, [x, y, z]")
    tilt = np.deg2rad([base.tilt_x_deg, base.tilt_y_deg])
    if (np.abs(tilt) > np.pi).any():
        raise LabError(f"{path}: [base] the tilt is more than half a turn; give degrees, -180 to 180")
    with error_context(path):
        sign = 1.0 if wrist.sign is None else wrist.sign
        return Mounting.tilted(tilt, base.gravity_m_per_s2, sign, np.deg2rad(wrist.rotation_vector_deg))


@dataclass(frozen=True)
class _LoadSection:
    mass_kg: float
    com_mm: tuple[float, ...]
    inertia_kgcm2: tuple[float, ...]


@dataclass(frozen=True)
class _LoadFile:
    load: _LoadSection


def read_load(path: Path) -> Array:
    """Read phi ``(10,)`` of a load about the last frame's origin, as ``rigid_body.LOAD``.

    ``com_mm`` is x y z, ``inertia_kgcm2`` is Ixx Iyy Izz Ixy Ixz Iyz about the centre of mass.

    Raises:
        LabError: the file is missing or malformed, or no body has these parameters.
    """
    found = structured(path, _LoadFile, read_toml(path)).load
    for name, values, count in (("com_mm", found.com_mm, 3), ("inertia_kgcm2", found.inertia_kgcm2, 6)):
        if len(values) != count or not np.isfinite(values).all():
            raise LabError(f"{path}: [load] {name} is {list(values)}; give {count} finite numbers")
    phi = load_of(found.mass_kg, MM.to_si(np.array(found.com_mm)), symmetric(np.array(found.inertia_kgcm2) / 1e4))
    if not is_physical(phi):
        raise LabError(f"{path}: [load] no body has this mass and inertia; give mass_kg above zero, and kg cm²")
    return phi
