"""The languages in which programs are written: a line adds one."""

from collections.abc import Mapping
from typing import Any

from lab.formats.programs.protocol import Language, MeasuringTour, TargetMoves
from lab.formats.programs.rapid import Rapid
from lab.kinematics.joints import JointSpec

__all__ = [
    "LANGUAGES",
    "PLAN",
    "PROGRAM",
    "languages_of",
    "plan_files",
    "plan_or_refusal",
    "planned_in",
    "program_file_names",
    "refusals",
    "target_files",
]

LANGUAGES: tuple[Language, ...] = (Rapid(),)
PLAN, PROGRAM = "plan", "program"  # names of the files, before their suffix


def languages_of(joints: JointSpec) -> tuple[Language, ...]:
    """The languages whose programs can move these joints."""
    return tuple(language for language in LANGUAGES if language.refusal(joints) is None)


def refusals(joints: JointSpec) -> tuple[str, ...]:
    """Why there are no programs in the other languages, in words."""
    return tuple(why for language in LANGUAGES if (why := language.refusal(joints)) is not None)


def plan_or_refusal(joints: JointSpec) -> dict[str, str]:
    """For each language, by its name in lower case: the file that holds the tour, or why there is none."""
    return {language.name.lower(): language.refusal(joints) or PLAN + language.suffix for language in LANGUAGES}


def planned_in(result: Mapping[str, Any]) -> tuple[list[Language], list[str]]:
    """The languages that a plan was written in, and why not in the others, from what ``plan_or_refusal`` gave."""
    written = {language.name.lower(): PLAN + language.suffix for language in LANGUAGES}
    languages = [each for each in LANGUAGES if result[each.name.lower()] == written[each.name.lower()]]
    return languages, [result[key] for key, file in written.items() if result[key] != file]


def plan_files(joints: JointSpec, tour: MeasuringTour) -> dict[str, bytes]:
    """The tour in every language that can move these joints, by the files' names."""
    return {PLAN + language.suffix: language.measuring_tour(tour) for language in languages_of(joints)}


def target_files(joints: JointSpec, moves: TargetMoves) -> dict[str, bytes]:
    """The moves to compensated targets in every language that can move these joints, by the files' names."""
    return {PROGRAM + language.suffix: language.target_moves(moves) for language in languages_of(joints)}


def program_file_names() -> tuple[str, ...]:
    """The names that a program's file can have in a run's folder."""
    return tuple(stem + language.suffix for stem in (PLAN, PROGRAM) for language in LANGUAGES)
