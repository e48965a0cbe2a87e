"""A program's targets, as targets for the arm; and the program with the numbers of the corrected ones.

What a target says is where the tool of the text shall be in the base. So the flange is wanted where the identified base
and that tool put it (``program_reference``), and the controller is told where its nominal arm then has the tool.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.commands.calibrate.load_run import Calibrated
from lab.commands.compensate.options import CompensateOptions
from lab.commands.compensate.program_postures import asked_for
from lab.commands.compensate.program_reference import ProgramReference, frames_of, program_reference
from lab.compensation.compensator import Compensation
from lab.core import se3
from lab.core.errors import LabError
from lab.core.limits import PROGRAM_BYTES
from lab.core.se3 import Array
from lab.formats.programs.protocol import Language
from lab.formats.programs.reading.numbers import Number, replaced, written
from lab.formats.programs.reading.program_text import Outside, ProgramText, TargetText, Uncorrected
from lab.formats.programs.registry import read_program
from lab.formats.target_csv import Targets
from lab.formats.text_file import read_bytes
from lab.kinematics.inverse.branches import NominalInverse
from lab.kinematics.inverse.newton import PoseTarget

__all__ = ["CorrectedProgram", "OpenProgram", "open_program", "outside_of"]

_BYTES = "latin-1"  # in which every byte is one character, whatever the file's encoding
_QUATERNION_DIGITS = 6
_LISTED = 10  # lines in a warning
_COARSE_MM, _COARSE_DEG = 0.01, 0.005  # what rounding may take from a corrected target without being told


@dataclass(frozen=True)
class CorrectedProgram:
    """A program with corrected targets.

    Attributes:
        name: of its file.
        language: what its users call it.
        content: the file.
        rows: of the targets in the list of all, which target of the text each one is.
        targets: of the text.
        uncorrected: lines that stay as they are, and why, by line.
        rounding_mm, rounding_deg: what the printed digits take from a pose at most; None without poses.
        ways: what the arm touches on its way from target to target, in words, by line.
    """

    name: str
    language: str
    content: bytes
    rows: NDArray[np.int_]
    targets: tuple[TargetText, ...]
    uncorrected: tuple[Uncorrected, ...]
    rounding_mm: float | None
    rounding_deg: float | None
    ways: tuple[tuple[int, str], ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a reader should be told."""
        said = [f"line {line}: {words}" for line, words in self.ways]
        if self.rounding_mm is not None and self.rounding_deg is not None:
            coarse = self.rounding_mm > _COARSE_MM or self.rounding_deg > _COARSE_DEG
            if coarse:
                said.append(
                    f"the digits of {self.name} round places by up to {self.rounding_mm:.2g} mm and angles by "
                    f"{self.rounding_deg:.2g}°; --digits writes more"
                )
        if self.uncorrected:
            lines = ", ".join(str(each.line) for each in self.uncorrected[:_LISTED])
            more = ", …" if len(self.uncorrected) > _LISTED else ""
            said.append(f"{self.name}: what lines {lines}{more} say stays as it is or needs a look, see uncorrected")
        return tuple(said)


@dataclass(frozen=True)
class OpenProgram:
    """A program whose targets are to be corrected.

    Attributes:
        path: of its file.
        read: what was read of its text.
        reference: the base, flange and tools that its numbers are relative to.
        rows: which of the text's targets are to be corrected.
        targets: these, for the arm.
        left: those that are not, and why.
    """

    path: Path
    text: str
    language: Language
    read: ProgramText
    reference: ProgramReference
    rows: NDArray[np.int_]
    targets: Targets
    left: tuple[Uncorrected, ...]

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
        more = [Uncorrected(self.read.targets[self.rows[i]].line, words) for i, words in left.items()]
        kept = np.array([i for i in range(len(self.rows)) if i not in left], dtype=np.int_)
        if not len(kept):
            raise LabError(f"{self.path}: no target can be corrected; line {more[0].line}: {more[0].reason}")
        return replace(self, rows=self.rows[kept], targets=self.targets.take(kept), left=(*self.left, *more))

    def rewritten(self, found: Compensation, digits: int | None, ways: Sequence[tuple[int, str]]) -> CorrectedProgram:
        """The text with the numbers of what was found."""
        edits, worst = list[tuple[Number, str]](), [0.0, 0.0]
        places = self._digits(digits)
        poses = False
        for i in np.flatnonzero(found.converged).tolist():
            target = self.read.targets[self.rows[i]]
            parts = _parts(target)
            if target.spelling is None:
                values = found.joints[i] * np.array(target.per_rad)
            else:
                T = se3.pose(found.rotations[i], found.positions[i])
                values = target.spelling.spelt(self._of_text(T, target), target.values)
                poses = True
                least = [max(places[part], min(each.digits for each in target.numbers[at])) for part, at in parts]
                worst = [max(a, b) for a, b in zip(worst, _rounding(target, least), strict=True)]
            for part, at in parts:
                pairs = zip(target.numbers[at], values[at].tolist(), strict=True)
                edits += [(number, written(number, value, places[part])) for number, value in pairs]
        return CorrectedProgram(
            self.path.name,
            self.language.name,
            replaced(self.text, edits).encode(_BYTES),
            self.rows,
            self.read.targets,
            tuple(sorted((*self.read.uncorrected, *self.left), key=lambda each: each.line)),
            worst[0] if poses else None,
            worst[1] if poses else None,
            tuple(ways),
        )

    def _of_text(self, T_instrument_last: Array, target: TargetText) -> Array:
        """The pose ``(4, 4)`` (m) of a target's tool in its base, as the text has it."""
        T_tool, T_base = frames_of(self.read, target.tool, target.base)
        T_frame0_last = se3.inverse(_T_instrument_frame0(self.nominal)) @ T_instrument_last
        return np.asarray(se3.inverse(T_base) @ T_frame0_last @ T_tool)

    def _digits(self, least: int | None) -> dict[str, int]:
        """Places behind the point of each kind of number: as many as the text has of it anywhere.

        A quaternion's numbers are exact and written without zeros at their end, so they say nothing of its digits.
        """
        found = dict.fromkeys(("place", "rotation", "joints", "pulses"), 0)
        found["rotation"] = _QUATERNION_DIGITS if self.language.spelling.parts == 4 else 0
        for target in self.read.targets:
            for part, at in _parts(target):
                found[part] = max(found[part], *(each.digits for each in target.numbers[at]))
        return {part: most if part == "pulses" else max(most, least or 0) for part, most in found.items()}


def outside_of(options: CompensateOptions) -> Outside:
    """What is given beside the text.

    Raises:
        LabError: it cannot be read, or has not as many numbers as it takes.
    """
    frames: dict[str, tuple[float, ...] | str] = {}
    for given in filter(None, (each.strip() for each in options.frames.split(";"))):
        name, equals, value = (part.strip() for part in given.partition("="))
        if not (name and equals and value):
            raise LabError(f"--frames: '{given}' is no NAME=numbers; part several by ;")
        if name in frames:
            raise LabError(f"--frames: {name} is given twice")
        numbers = value.split(",")
        try:
            frames[name] = tuple(float(each) for each in numbers) if len(numbers) > 1 else value
        except ValueError as error:
            raise LabError(f"--frames: {name} has something that is no number: '{value}'") from error
        if not isinstance(frames[name], str) and not np.isfinite(np.array(frames[name], dtype=float)).all():
            raise LabError(f"--frames: {name} has a number that is not finite: '{value}'")
    pulses = options.pulses_per_deg
    if pulses and (len(pulses) != 6 or not all(np.isfinite(pulses)) or not all(pulses)):
        raise LabError("--pulses-per-deg takes six numbers that are not zero, of the joints S, L, U, R, B and T")
    return Outside(frames, pulses)


def open_program(options: CompensateOptions, run: Calibrated) -> OpenProgram:
    """Read the program that is asked for, and say its targets for the arm.

    Raises:
        LabError: it cannot be read, or holds no target that can be corrected.
    """
    path = options.program
    assert path is not None
    content = read_bytes(path, PROGRAM_BYTES)
    if b"\0" in content:
        raise LabError(f"{path}: is no text; save the program as text (in UTF-16 it cannot be read)")
    text, outside = content.decode(_BYTES), outside_of(options)
    language, read = read_program(path, text, run.robot.chain, options.controller, outside)
    if options.pulses_per_deg and language.name != "JBI":
        raise LabError(f"--pulses-per-deg is for JBI; {path} is in {language.name}")
    reference = program_reference(run, read)
    nominal = reference.nominal
    given = np.array([each.joints for each in read.targets])
    beyond = np.asarray(run.robot.chain.beyond_limits(given, 1e-9).any(axis=1))
    left = [
        Uncorrected(each.line, f"{each.name}: its joint positions are beyond the limits of the robot's model")
        for each, out in zip(read.targets, beyond, strict=True)
        if out
    ]
    rows = np.flatnonzero(~beyond)
    Ts = np.array([_T_instrument_last(nominal, read, read.targets[i]) for i in rows]).reshape(-1, 4, 4)
    wanted = PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3])
    joints, refused = asked_for(nominal, wanted, [read.targets[i] for i in rows])
    left += [Uncorrected(read.targets[rows[i]].line, words) for i, words in refused.items()]
    kept = np.array([i for i in range(len(rows)) if i not in refused], dtype=np.int_)
    if not len(kept):
        raise LabError(f"{path}: no target can be corrected; line {left[0].line}: {left[0].reason}")
    targets = Targets(
        reference.run.arm.targets[reference.target],
        _names(read.targets, rows[kept]),
        wanted.positions[kept],
        wanted.rotations[kept],
        joints[kept],
        lines=tuple(read.targets[i].line for i in rows[kept]),
    )
    return OpenProgram(path, text, language, read, reference, rows[kept], targets, tuple(left))


def _names(targets: Sequence[TargetText], rows: NDArray[np.int_]) -> tuple[str, ...]:
    """What the targets are called, each once."""
    names, counts = dict[str, None](), Counter[str]()
    for i in rows.tolist():
        name = targets[i].name
        counts[name] += 1
        while (said := name if counts[name] == 1 else f"{name} ({counts[name]})") in names:
            counts[name] += 1
        names[said] = None
    return tuple(names)


def _T_instrument_frame0(nominal: NominalInverse) -> Array:
    return nominal.arm.T_tracker_frame0(nominal.values)


def _T_instrument_last(nominal: NominalInverse, read: ProgramText, target: TargetText) -> Array:
    """Where the controller's arm has its last frame ``(4, 4)`` m at a target, in the instrument's frame."""
    if target.spelling is None:
        return np.asarray(nominal.tool(target.joints[None])[0][0])
    T_tool, T_base = frames_of(read, target.tool, target.base)
    T_frame0_last = T_base @ target.spelling.pose(target.values) @ se3.inverse(T_tool)
    return np.asarray(_T_instrument_frame0(nominal) @ T_frame0_last)


def _parts(target: TargetText) -> tuple[tuple[str, slice], ...]:
    """The kinds of a target's numbers, and where they are."""
    if target.spelling is None:
        return (("pulses" if max(map(abs, target.per_rad)) > 1e3 else "joints", slice(0, 6)),)
    return ("place", slice(0, 3)), ("rotation", slice(3, 3 + target.spelling.parts))


def _rounding(target: TargetText, digits: Sequence[int]) -> tuple[float, float]:
    """What so many digits take from a place (mm) and a rotation (deg), about."""
    assert target.spelling is not None
    place = 0.5 * 10.0 ** -digits[0] * 1e3 / target.spelling.per_m * np.sqrt(3)
    unit = {4: np.rad2deg(2.0), 3: 1.0 if target.spelling.per_m > 1 else np.rad2deg(1.0)}[target.spelling.parts]
    return float(place), float(0.5 * 10.0 ** -digits[1] * unit)
