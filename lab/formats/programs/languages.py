"""Find controllers' languages, which extensions register as ``lab.languages``, by choice or by the robot's maker."""

import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from lab.core.errors import LabError, error_context, option_name
from lab.core.limits import PROGRAM_TARGETS
from lab.extension_points import choice_of, load_all
from lab.formats.programs.program_text import Outside, ProgramText, refuse_unknown_frames, values_of
from lab.formats.programs.protocol import PLAN, PROGRAM, Language, MeasuringTour, PathMoves, TargetMoves
from lab.kinematics.joints import JointSpec

__all__ = [
    "PLAN",
    "PROGRAM",
    "Controller",
    "language_of",
    "language_of_maker",
    "languages",
    "path_file",
    "path_program",
    "plan_files",
    "plan_or_refusal",
    "read_program",
    "refusal",
    "target_files",
]

_GROUP = "lab.languages"  # of entry points

if TYPE_CHECKING:
    Controller = str
else:
    Controller = choice_of(_GROUP)  # the languages' names


@cache
def languages() -> tuple[Language, ...]:
    """Return the registered languages; those that cannot be imported are left out."""
    return tuple(kind() for kind in load_all(_GROUP).values())


def language_of(joints: JointSpec, controller: str | None) -> Language | None:
    """Return the chosen language, else that of the robot's maker by the robot's name, or None.

    A word of the name is one of a language's makers, or begins with one before a digit.
    """
    if controller is not None:
        found = next((language for language in languages() if language.name.lower() == controller), None)
        if found is None:
            raise LabError(f"'{controller}' is no controller's language; there are {_language_names()}")
        return found
    return language_of_maker(joints.name)


def language_of_maker(name: str) -> Language | None:
    """Return the language of the maker in a robot's name, or None."""
    words = re.findall(r"[a-z]+\d*|\d+", name.lower())
    for language in languages():
        for maker in language.makers:
            if any(word == maker or re.fullmatch(rf"{maker}(?<!\d)\d+", word) for word in words):
                return language
    return None


def refusal(joints: JointSpec, controller: str | None, targets: int = 0) -> str | None:
    """Return the reason why no program can be written to so many targets, or None."""
    if targets > PROGRAM_TARGETS.most:
        return f"no program is written: {targets:,} targets, and one has at most {PROGRAM_TARGETS.shown}"
    language = language_of(joints, controller)
    if language is None:
        unknown = f"the maker of robot {joints.name} is not known"
        return f"no program is written: {unknown}; choose {option_name('controller')} of {_language_names()}"
    return language.refusal(joints)


def plan_or_refusal(joints: JointSpec, controller: str | None, stations: Sequence[str] = ()) -> dict[str, str]:
    """Return the file of the tour, or the reason for none, for each language by its name in lower case.

    Each of several ``stations`` has a file; their names are joined by a comma.
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
    """Return the tour in the controller's language, by file name; empty without one."""
    language = _language(joints, controller)
    return {} if language is None else {tour.file_name + language.suffix: language.measuring_tour(tour)}


def target_files(joints: JointSpec, controller: str | None, moves: TargetMoves) -> dict[str, bytes]:
    """Return the moves to compensated targets in the controller's language, by file name."""
    language = _language(joints, controller)
    return {} if language is None else {PROGRAM + language.suffix: language.target_moves(moves)}


def path_file(joints: JointSpec, controller: str | None) -> str | None:
    """Return the file name of a trajectory's program, or None."""
    language = _language(joints, controller)
    return None if language is None else PROGRAM + language.suffix


def path_program(joints: JointSpec, controller: str | None, moves: PathMoves) -> bytes:
    """Return a trajectory's program in the controller's language, if ``path_file`` has one."""
    language = _language(joints, controller)
    assert language is not None
    return language.path_moves(moves)


def _plan_file(language: Language, station: str) -> str:
    return PLAN + (f"_{station}" if station else "") + language.suffix


def read_program(
    path: Path, text: str, joints: JointSpec, controller: str | None, outside: Outside
) -> tuple[Language, ProgramText]:
    """Read a program; its language is the chosen one, else by its file name, else that of the robot's maker."""
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
    language = language_of(joints, controller)
    return None if language is None or language.refusal(joints) is not None else language
