"""Find the languages in which programs are written and read, which extensions register as ``lab.languages``.

Which of them a program is written in is chosen, or that of the robot's maker.
"""

import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from lab.core.errors import LabError, error_context, option_name
from lab.core.limits import PROGRAM_TARGETS
from lab.extension_points import choice_of, load_all
from lab.formats.programs.program_text import Outside, ProgramText, refuse_unknown_frames, values_of
from lab.formats.programs.protocol import Language, MeasuringTour, PathMoves, TargetMoves
from lab.kinematics.joints import JointSpec

__all__ = [
    "PLAN",
    "PROGRAM",
    "Controller",
    "is_program_file",
    "language_of",
    "language_of_maker",
    "languages",
    "path_file",
    "path_program",
    "plan_files",
    "plan_or_refusal",
    "program_file_names",
    "read_program",
    "refusal",
    "target_files",
]

_GROUP = "lab.languages"  # of entry points

if TYPE_CHECKING:
    Controller = str
else:
    Controller = choice_of(_GROUP)  # the languages' names
PLAN, PROGRAM = "plan", "program"  # names of the files, before their suffix


@cache
def languages() -> tuple[Language, ...]:
    """Return the registered languages; those that cannot be imported are left out."""
    return tuple(kind() for kind in load_all(_GROUP).values())


def language_of(joints: JointSpec, controller: str | None) -> Language | None:
    """The language that is asked for, else that of the robot's maker where the robot's name tells it; None if neither.

    A maker is told by a word of the robot's name that is one of a language's, or begins with one before a digit.
    """
    if controller is not None:
        found = next((language for language in languages() if language.name.lower() == controller), None)
        if found is None:
            raise LabError(f"'{controller}' is no controller's language; there are {_language_names()}")
        return found
    return language_of_maker(joints.name)


def language_of_maker(name: str) -> Language | None:
    """The language of the maker that a robot's name tells; None where it tells none."""
    words = re.findall(r"[a-z]+\d*|\d+", name.lower())
    for language in languages():
        for maker in language.makers:
            if any(word == maker or re.fullmatch(rf"{maker}(?<!\d)\d+", word) for word in words):
                return language
    return None


def refusal(joints: JointSpec, controller: str | None, targets: int = 0) -> str | None:
    """Return the reason why no program can be written to so many targets; None if one can."""
    if targets > PROGRAM_TARGETS.most:
        return f"no program is written: {targets:,} targets, and one has at most {PROGRAM_TARGETS.shown}"
    language = language_of(joints, controller)
    if language is None:
        unknown = f"the maker of robot {joints.name} is not known"
        return f"no program is written: {unknown}; choose {option_name('controller')} of {_language_names()}"
    return language.refusal(joints)


def plan_or_refusal(joints: JointSpec, controller: str | None, stations: Sequence[str] = ()) -> dict[str, str]:
    """For each language, by its name in lower case: the file that holds the tour, or why there is none.

    With several ``stations`` there is a file for each of them, and their names are joined by a comma.
    """
    written = _language(joints, controller)
    why = refusal(joints, controller)
    other = "" if written is None else f"no program in it: {written.name} is the controller's language"
    return {
        each.name.lower(): ", ".join(_plan_file(each, name) for name in stations or ("",))
        if each is written
        else why or other
        for each in languages()
    }


def plan_files(joints: JointSpec, controller: str | None, tour: MeasuringTour) -> dict[str, bytes]:
    """The tour in the controller's language, by the file's name; empty where it cannot move these joints."""
    language = _language(joints, controller)
    return {} if language is None else {_plan_file(language, tour.station): language.measuring_tour(tour)}


def target_files(joints: JointSpec, controller: str | None, moves: TargetMoves) -> dict[str, bytes]:
    """The moves to compensated targets in the controller's language, by the file's name."""
    language = _language(joints, controller)
    return {} if language is None else {PROGRAM + language.suffix: language.target_moves(moves)}


def path_file(joints: JointSpec, controller: str | None) -> str | None:
    """The name of the file of a trajectory's program; None where there is none."""
    language = _language(joints, controller)
    return None if language is None else PROGRAM + language.suffix


def path_program(joints: JointSpec, controller: str | None, moves: PathMoves) -> bytes:
    """A trajectory's program in the controller's language, which ``path_file`` has found."""
    language = _language(joints, controller)
    assert language is not None
    return language.path_moves(moves)


def _plan_file(language: Language, station: str) -> str:
    return PLAN + (f"_{station}" if station else "") + language.suffix


def is_program_file(name: str) -> bool:
    """Decide whether a program's file in a run's folder can have this name."""
    return name in program_file_names() or (
        name.startswith(f"{PLAN}_") and any(name.endswith(language.suffix) for language in languages())
    )


def program_file_names() -> tuple[str, ...]:
    """The names that a program's file can have in a run's folder, but for those of a plan's stations."""
    return tuple(stem + language.suffix for stem in (PLAN, PROGRAM) for language in languages())


def read_program(
    path: Path, text: str, joints: JointSpec, controller: str | None, outside: Outside
) -> tuple[Language, ProgramText]:
    """A program and its language: the one that is asked for, else that of its name's end, else of the robot's maker."""
    by_name = [each for each in languages() if path.suffix.lower() in each.reads]
    language = by_name[0] if by_name and controller is None else language_of(joints, controller)
    if language is None:
        raise LabError(
            f"{path}: its language is not known by its name; choose {option_name('controller')} of {_language_names()}"
        )
    if why := language.refusal(joints):
        raise LabError(f"{path}: {why}")
    with error_context(path):
        read = language.read(text, outside)
        if not read.targets:
            said = (
                f"line {read.uncorrected[0].line}: {read.uncorrected[0].reason}"
                if read.uncorrected
                else "none is there"
            )
            raise LabError(f"no target of this {language.name} program can be read ({said})")
        for each in read.targets:
            with error_context(f"line {each.line}: {each.name}"):
                values_of(each.numbers)
        refuse_unknown_frames(read, language.spelling)
    return language, read


def _language_names() -> str:
    return ", ".join(each.name.lower() for each in languages()) or "none: no package that brings one is installed"


def _language(joints: JointSpec, controller: str | None) -> Language | None:
    """The language in which there is a program."""
    language = language_of(joints, controller)
    return None if language is None or language.refusal(joints) is not None else language
