"""Correct the targets of a controller's program, and write its text with the corrected numbers.

A target places the tool of the text in the base. The identified base and that tool give the pose of the flange
(``program_reference``); the text gets the pose at which the controller's nominal arm then has the tool.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.compensation.compensator import Compensation
from lab.core import se3
from lab.core.errors import LabError
from lab.core.limits import PROGRAM_BYTES
from lab.core.number_text import short
from lab.core.se3 import Array
from lab.core.units import MM, MRAD
from lab.formats.programs.languages import read_program
from lab.formats.programs.program_text import Number, Outside, ProgramText, TargetText, Uncorrected, replaced, written
from lab.formats.programs.protocol import Language
from lab.formats.structured import read_bytes
from lab.formats.target_csv import Targets
from lab.kinematics.inverse.branches import NominalInverse
from lab.kinematics.inverse.newton_inverse import PoseTarget
from lab.library.load_run import CalibrationRun
from lab.library.program_reference import (
    ProgramReference,
    frames_of,
    program_reference,
    requested_solutions,
)
from lab.options.compensation import CompensateOptions

__all__ = [
    "CorrectedProgram", "OpenProgram", "UsedTool", "flange_note", "flange_values", "open_program",
    "stated_positions_note", "used_tools",
]  # fmt: skip

_BYTES = "latin-1"  # in which every byte is one character, whatever the file's encoding
_QUATERNION_DIGITS = 6
_LISTED = 10  # lines in a warning
_SHARE = 0.1  # of a target's correction: the most that rounding may take of it
_COARSE = np.array([0.01, 0.005])  # mm and degrees: digits are added until rounding takes less
_FINE = np.array([1e-4, 1e-4])  # mm and degrees: no digit is added where rounding takes less


@dataclass(frozen=True)
class CorrectedProgram:
    """A program with corrected targets.

    Attributes:
        rounding_mm, rounding_deg: how far the written numbers bring the controller's arm from the exact ones at most;
            None where no target is corrected.
        touching_paths: what the arm touches on its way from target to target, in words, by line.
    """

    name: str  # name of its file
    language: str  # what its users call it
    content: bytes
    rows: NDArray[np.int_]  # of the targets in the list of all, which target of the text each one is
    targets: tuple[TargetText, ...]  # of the text
    uncorrected: tuple[Uncorrected, ...]  # lines that stay as they are, and why, by line
    rounding_mm: float | None
    rounding_deg: float | None
    touching_paths: tuple[tuple[int, str], ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings for the reader."""
        messages = [f"line {line}: {text}" for line, text in self.touching_paths]
        rounding = np.array([self.rounding_mm or 0.0, self.rounding_deg or 0.0])
        if (rounding > _COARSE).any():
            messages.append(
                f"the digits of {self.name} round targets by up to {rounding[0]:.2g} mm and {rounding[1]:.2g}°, and "
                f"{self.language} takes no more"
            )
        if self.uncorrected:
            lines = ", ".join(str(each.line) for each in self.uncorrected[:_LISTED])
            more = ", …" if len(self.uncorrected) > _LISTED else ""
            messages.append(f"{self.name}: lines {lines}{more} are not corrected or are to be checked, see uncorrected")
        return tuple(messages)


@dataclass(frozen=True)
class OpenProgram:
    """A program whose targets are to be corrected."""

    path: Path
    text: str
    language: Language
    read: ProgramText  # what was read of its text
    reference: ProgramReference  # the base, flange and tools that its numbers are relative to
    rows: NDArray[np.int_]  # which of the text's targets are to be corrected
    targets: Targets  # to be corrected, for the arm
    left: tuple[Uncorrected, ...]  # targets that are not corrected, and why

    @property
    def nominal(self) -> NominalInverse:
        """The controller's arm, which brings its flange somewhere."""
        return self.reference.nominal

    @property
    def points(self) -> NDArray[np.int_]:
        """``(n,)``: the target of the arm that stands for the tool of each target."""
        return np.array([self.reference.point_of(self.read, self.read.targets[i]) for i in self.rows], dtype=np.int_)

    def without(self, left: Mapping[int, str]) -> "OpenProgram":
        """The program with some of the targets, by their rows in ``targets``, left as they are, and why.

        Raises:
            LabError: none is left to be corrected.
        """
        more = [Uncorrected(self.read.targets[self.rows[i]].line, text) for i, text in left.items()]
        retained = np.array([i for i in range(len(self.rows)) if i not in left], dtype=np.int_)
        if not len(retained):
            raise LabError(f"{self.path}: no target can be corrected; line {more[0].line}: {more[0].reason}")
        return replace(self, rows=self.rows[retained], targets=self.targets.take(retained), left=(*self.left, *more))

    def rewritten(self, found: Compensation, digits: int | None) -> tuple[CorrectedProgram, Compensation]:
        """Write the corrected targets into the text; a target whose correction its digits would lose stays as it is.

        Args:
            digits: places behind the point, at least; None for those of the text.

        Returns:
            The program, and the compensation with the reasons of those targets that stay.
        """
        edits, reasons, worst = list[tuple[Number, str]](), list(found.reasons), list[Array]()
        places = self._digits(digits)
        for i in np.flatnonzero(found.converged).tolist():
            target = self.read.targets[self.rows[i]]
            if target.spelling is None:
                values = found.joints[i] * np.array(target.per_rad)
                exact = self._pose(target, values)
            else:
                T = se3.pose(found.rotations[i], found.positions[i])
                exact = self._of_text(T, target)
                values = target.spelling.spelt(exact, target.values)
            texts, lost, reasons[i] = self._rounded(target, values, exact, places)
            if not reasons[i]:
                edits += zip(target.numbers, texts, strict=True)
                worst.append(lost)
        stay = [
            Uncorrected(self.read.targets[row].line, f"{name}: {reason}")
            for row, name, reason in zip(self.rows.tolist(), self.targets.ids, reasons, strict=True)
            if reason
        ]
        mm, deg = np.max(worst, axis=0).tolist() if worst else (None, None)
        program = CorrectedProgram(
            self.path.name,
            self.language.name,
            replaced(self.text, edits).encode(_BYTES),
            self.rows,
            self.read.targets,
            tuple(sorted((*self.read.uncorrected, *self.left, *stay), key=lambda each: each.line)),
            mm,
            deg,
            (),
        )
        return program, replace(found, reasons=tuple(reasons))

    def _rounded(
        self, target: TargetText, values: Array, exact: Array, places: dict[str, int]
    ) -> tuple[list[str], Array, str]:
        """Write exact values of a target with as many digits as its correction takes.

        Args:
            values: its exact numbers, in the units of the text.
            exact: the pose ``(4, 4)`` (m) to which they bring the tool of the controller's arm.
            places: behind the point, of each kind of number.

        Returns:
            The numbers' texts, what rounding takes (mm, degrees), and why the target stays; "" where it does not.
        """
        correction = _apart(self._pose(target, target.values), exact)
        enough, places, parts = np.clip(_SHARE * correction, _FINE, _COARSE), dict(places), _parts(target)
        most = self._most_digits(target, places)
        # One digit more of each kind of number, until rounding takes a small share of the correction.
        while True:
            texts = _texts(target, values, places)
            lost = _apart(self._pose(target, np.array([float(each) for each in texts])), exact)
            coarse = {"place": lost[0] > enough[0], "rotation": lost[1] > enough[1]}
            wider = [part for part, _ in parts if coarse.get(part, any(coarse.values())) and places[part] < most[part]]
            if not wider:
                break
            places |= {part: places[part] + 1 for part in wider}
        kept = lost <= np.maximum(_SHARE * correction, _COARSE)
        return texts, lost, "" if kept.all() else _lost_in_rounding(target, correction, lost)

    def _most_digits(self, target: TargetText, places: Mapping[str, int]) -> dict[str, int]:
        """Return the most places behind the point of each kind of a target's numbers."""
        of_length, of_angle = (0, 0) if target.whole else self.language.most_digits
        return {part: max(of_length if part == "place" else of_angle, places[part]) for part, _ in _parts(target)}

    def _pose(self, target: TargetText, values: Array) -> Array:
        """The pose ``(4, 4)`` (m) of the tool of the controller's arm for numbers of a target.

        Of a pose it is in its base; of joint positions it is in the instrument's frame.
        """
        if target.spelling is not None:
            return target.spelling.pose(values)
        T = self.nominal.tool((values / np.array(target.per_rad))[None])[0][0]
        point = self.reference.offsets(np.array([self.reference.point_of(self.read, target)]))[0]
        return se3.pose(T[:3, :3], T[:3, 3] + T[:3, :3] @ point)

    def _of_text(self, T_instrument_last: Array, target: TargetText) -> Array:
        """The pose ``(4, 4)`` (m) of a target's tool in its base, as the text has it."""
        T_tool, T_base = frames_of(self.read, target.tool, target.base)
        T_frame0_last = se3.inverse(_T_instrument_frame0(self.nominal)) @ T_instrument_last
        return np.asarray(se3.inverse(T_base) @ T_frame0_last @ T_tool)

    def _digits(self, least: int | None) -> dict[str, int]:
        """Places behind the point of each kind of number: as many as the text has of it anywhere.

        A quaternion's numbers are exact and written without zeros at their end, so its digits are not known from them.
        """
        most = dict.fromkeys(("place", "rotation", "joints", "pulses"), 0)
        most["rotation"] = _QUATERNION_DIGITS if self.language.spelling.parts == 4 else 0
        for target in self.read.targets:
            for part, at in _parts(target):
                most[part] = max(most[part], *(each.digits for each in target.numbers[at]))
        return {part: digits if part == "pulses" else max(digits, least or 0) for part, digits in most.items()}


def _outside_of(options: CompensateOptions) -> Outside:
    """Read the values that the options give beside the program's text."""
    frames: dict[str, tuple[float, ...] | str] = {}
    for text in filter(None, (each.strip() for each in options.frames.split(";"))):
        name, value = _frame_in(text)
        if name in frames:
            raise LabError(f"--frames: {name} is given twice")
        frames[name] = value
    pulses = options.pulses_per_deg
    if pulses and (len(pulses) != 6 or not all(np.isfinite(pulses)) or not all(pulses)):
        raise LabError("--pulses-per-deg takes six numbers that are not zero, of the joints S, L, U, R, B and T")
    return Outside(frames, pulses)


def _frame_in(text: str) -> tuple[str, tuple[float, ...] | str]:
    """Return name and value of a frame in ``--frames``: numbers, or the name of another."""
    name, equals, value = (part.strip() for part in text.partition("="))
    if not (name and equals and value):
        raise LabError(f"--frames: '{text}' is no NAME=numbers; part several by ;")
    numbers = value.split(",")
    if len(numbers) == 1:
        return name, value
    try:
        frame = tuple(float(each) for each in numbers)
    except ValueError as error:
        raise LabError(f"--frames: {name} has a value that is not a number: '{value}'") from error
    if not np.isfinite(frame).all():
        raise LabError(f"--frames: {name} has a number that is not finite: '{value}'")
    return name, frame


def open_program(options: CompensateOptions, run: CalibrationRun) -> OpenProgram:
    """Read the requested program, and convert its targets for the arm.

    Raises:
        LabError: it cannot be read, or holds no target that can be corrected.
    """
    path = options.program
    assert path is not None
    text, language, read = _read(options, path, run)
    reference = program_reference(run, read)
    nominal = reference.nominal
    # Targets beyond the limits stay as they are.
    joints = np.array([each.joints for each in read.targets])
    within = ~run.robot.chain.beyond_limits(joints, 1e-9).any(axis=1)
    message = "its joint positions are beyond the limits of the robot's model"
    left = [_left(read.targets[i], message) for i in np.flatnonzero(~within)]
    # The others, as poses of the flange, with the requested solutions of the controller's arm.
    rows = np.flatnonzero(within)
    Ts = np.array([_T_instrument_last(nominal, read, read.targets[i]) for i in rows]).reshape(-1, 4, 4)
    wanted = PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3])
    joints, refused = requested_solutions(nominal, wanted, [read.targets[i] for i in rows])
    left += [Uncorrected(read.targets[rows[i]].line, reason) for i, reason in refused.items()]
    retained = np.setdiff1d(np.arange(len(rows)), list(refused)).astype(np.int_)
    if not len(retained):
        raise LabError(f"{path}: no target can be corrected; line {left[0].line}: {left[0].reason}")
    targets = Targets(
        reference.run.estimate.arm.targets[reference.target],
        _unique_names(read.targets, rows[retained]),
        wanted.positions[retained],
        wanted.rotations[retained],
        joints[retained],
        lines=tuple(read.targets[i].line for i in rows[retained]),
    )
    return OpenProgram(path, text, language, read, reference, rows[retained], targets, tuple(left))


def _left(target: TargetText, reason: str) -> Uncorrected:
    return Uncorrected(target.line, f"{target.name}: {reason}")


def _read(options: CompensateOptions, path: Path, run: CalibrationRun) -> tuple[str, Language, ProgramText]:
    content = read_bytes(path, PROGRAM_BYTES)
    if b"\0" in content:
        raise LabError(f"{path}: is not a text file; save the program as text, not in UTF-16")
    text = content.decode(_BYTES)
    language, read = read_program(path, text, run.robot.chain, options.controller, _outside_of(options))
    if options.pulses_per_deg and language.name != "JBI":
        raise LabError(f"--pulses-per-deg is for JBI; {path} is in {language.name}")
    return text, language, read


def _unique_names(targets: Sequence[TargetText], rows: NDArray[np.int_]) -> tuple[str, ...]:
    names, counts = dict[str, None](), Counter[str]()
    for i in rows.tolist():
        name = targets[i].name
        counts[name] += 1
        while (text := name if counts[name] == 1 else f"{name} ({counts[name]})") in names:
            counts[name] += 1
        names[text] = None
    return tuple(names)


def _T_instrument_frame0(nominal: NominalInverse) -> Array:
    return nominal.arm.T_tracker_frame0(nominal.values)


def _T_instrument_last(nominal: NominalInverse, read: ProgramText, target: TargetText) -> Array:
    """Compute the pose ``(4, 4)`` m of the nominal last frame at a target, in the instrument's frame."""
    if target.spelling is None:
        return np.asarray(nominal.tool(target.joints[None])[0][0])
    T_tool, T_base = frames_of(read, target.tool, target.base)
    T_frame0_last = T_base @ target.spelling.pose(target.values) @ se3.inverse(T_tool)
    return np.asarray(_T_instrument_frame0(nominal) @ T_frame0_last)


def _parts(target: TargetText) -> tuple[tuple[str, slice], ...]:
    if target.spelling is None:
        return (("pulses" if target.whole else "joints", slice(0, 6)),)
    return ("place", slice(0, 3)), ("rotation", slice(3, 3 + target.spelling.parts))


def _texts(target: TargetText, values: Array, places: Mapping[str, int]) -> list[str]:
    """Return the texts of a target's numbers, with so many places of each kind behind the point."""
    return [
        written(number, value, places[part])
        for part, at in _parts(target)
        for number, value in zip(target.numbers[at], values[at].tolist(), strict=True)
    ]


def _apart(T_a: Array, T_b: Array) -> Array:
    """The distance and the angle ``(2,)`` between two poses ``(4, 4)`` (m): mm and degrees."""
    turn = np.linalg.norm(se3.log(T_a[:3, :3].T @ T_b[:3, :3]))
    return np.array([MM.of(float(np.linalg.norm(T_a[:3, 3] - T_b[:3, 3]))), np.rad2deg(turn)])


def _lost_in_rounding(target: TargetText, correction: Array, lost: Array) -> str:
    """Explain why a target stays whose correction would be lost in its digits; mm and degrees."""
    digits = "whole pulses" if target.whole else "the digits of its language"
    more = "" if target.whole else "; --digits writes more, where the controller reads them"
    return (
        f"{digits} lose {lost[0]:.2g} mm and {lost[1]:.2g}° of its correction by {correction[0]:.2g} mm and "
        f"{correction[1]:.2g}°{more}"
    )


_SAME_M = 15e-3  # a tool nearer to a measured point is meant to be that point
_AGREES_M = 0.5e-3  # and disagrees with it where it is farther


@dataclass(frozen=True)
class UsedTool:
    """A tool that a program's targets are for."""

    name: str  # in the text; empty for joint positions whose tool the text does not name
    targets: int  # number of targets
    position_m: tuple[float, ...]  # (3,) in the flange
    point: str = ""  # the measured point that it is apparently meant to be; empty where none is near
    distance_m: float = 0.0  # distance of that point, as measured

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, in mm."""
        near = {"point": self.point, "distance_mm": MM.of(self.distance_m)} if self.point else None
        return {
            "name": self.name,
            "targets": self.targets,
            "position_mm": [MM.of(each) for each in self.position_m],
            "measured": near,
        }

    @property
    def description(self) -> str:
        """Description of the tool, its number of targets, and its distance from a measured point."""
        place = ", ".join(short(MM.of(each)) for each in self.position_m)
        if not self.name:
            return f"{_targets(self.targets)} by joint positions: the flange moves to its pose on the nominal arm"
        used = f"{_targets(self.targets)} with tool {self.name}, at ({place}) mm in the flange as the program states it"
        if not self.disagrees:
            return used
        return (
            f"{used}; the measured point {self.point} is {short(MM.of(self.distance_m))} mm from there and was not used"
        )

    @property
    def disagrees(self) -> bool:
        """True where the tool is apparently a measured point that is elsewhere."""
        return bool(self.point) and self.distance_m > _AGREES_M


def used_tools(reference: ProgramReference, points: NDArray[np.int_]) -> tuple[UsedTool, ...]:
    """Return the tools of a program's corrected targets, and which measured point each is near.

    Args:
        points: of each corrected target, the point that is aimed.
    """
    counts, names = Counter(points.tolist()), {k: name for name, k in reference.points.items()}
    measured = reference.nominal.tools[: reference.target]
    tools = []
    for k in sorted(counts):
        place = reference.nominal.tools[k]
        tool = UsedTool(names[k], counts[k], tuple(place.tolist()))
        apart = np.linalg.norm(measured - place, axis=1)
        if names[k] and apart.min() < _SAME_M:
            nearest, names_of = int(apart.argmin()), reference.run.estimate.arm.targets
            tool = UsedTool(tool.name, tool.targets, tool.position_m, names_of[nearest], float(apart[nearest]))
        tools.append(tool)
    return tuple(tools)


def flange_note(reference: ProgramReference, flange_95_m: Array) -> str:
    """Explain why the flange's orientation is unknown and the resulting tool error; "" where it is identified.

    Args:
        flange_95_m: of each corrected target, the error by the flange.
    """
    if reference.flange.turned or not len(flange_95_m):
        return ""
    size = short(MM.of(float(flange_95_m.max())))
    return (
        f"the orientation of the flange is unknown{_why(reference)}: the tolerances of the last link may displace "
        f"the tools by up to {size} mm (95 %), with or without the correction"
    )


def stated_positions_note(reference: ProgramReference) -> str:
    """Describe how far the measured points are from their stated positions in the flange, and the consequence."""
    off = [short(MM.of(each)) for each in reference.flange.deviation_m.tolist()]
    if not reference.stated:
        return "No position of a measured point in the flange is given."
    text = f"The measured points ({', '.join(reference.stated)}) are {', '.join(off)} mm from their stated places"
    if not reference.flange.uses_stated:
        return f"{text}, more than the tolerances of the last link explain, so these positions are not used."
    return (
        f"{text}. The tolerances of the last link explain that, so it is treated as an error of the flange. If the "
        "points are on an adapter, the expected errors by the flange are too small."
    )


def _why(reference: ProgramReference) -> str:
    measured = reference.measured_targets
    if not reference.flange.uses_stated and reference.run.options.observe == "pose":
        return ", since the measured pose of the tool is not the one that is stated"
    if reference.flange.uses_stated or len(measured) < 3:
        points = f"{len(measured)} measured point{'s do' if len(measured) > 1 else ' does'}"
        return f", since {points} not show it"
    if reference.stated:
        off = [short(MM.of(each)) for each in reference.flange.deviation_m.tolist()]
        return (
            f", since the measured points are {', '.join(off)} mm from their stated places, more than the tolerances "
            "of the last link explain"
        )
    return ", since no places of the measured points in the flange are stated"


def flange_values(reference: ProgramReference) -> Mapping[str, Any]:
    """Return the values that ``result.json`` holds of the flange."""
    flange = reference.flange
    return {
        "orientation_known": flange.turned,
        "stated_places_used": flange.uses_stated,
        "off_stated_mm": dict(zip(reference.stated, MM.of(flange.deviation_m).tolist(), strict=False)),
        "tolerance_mm": MM.of(float(reference.sigma[0])),
        "tolerance_mrad": MRAD.of(float(reference.sigma[3])),
    }


def _targets(count: int) -> str:
    return "1 target" if count == 1 else f"{count:,} targets"
