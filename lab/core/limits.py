"""How large an input may be: what is more is refused where it enters, before any work begins.

The limits are far above what a calibration needs, and small enough that the work ends and fits into memory. Each is
listed in docs/reference/limits.md.
"""

from collections.abc import Sized
from dataclasses import dataclass
from typing import Final

from lab.core.errors import LabError

__all__ = [
    "BRACKETS",
    "CAMPAIGNS",
    "CANDIDATES",
    "CANDIDATE_POINTS",
    "CELLS",
    "COLUMNS",
    "COPIES",
    "DAYS",
    "DEPTH",
    "DRAWN_POINTS",
    "DRAWS",
    "FIXTURES",
    "FRAMES",
    "JOINTS",
    "LIMITS",
    "LINE",
    "LINE_OF_TEXT",
    "MESH_BYTES",
    "MOMENTS",
    "NAME",
    "NESTED_ELEMENTS",
    "ORIENTATIONS",
    "PASSED",
    "PIXELS",
    "PLACED",
    "PLACES",
    "POSES",
    "PROGRAM_BYTES",
    "PROGRAM_FRAMES",
    "PROGRAM_MOVES",
    "PROGRAM_TARGETS",
    "READINGS",
    "ROBOTS",
    "ROUNDS",
    "ROWS",
    "SEED",
    "STARTS",
    "STOPS",
    "TABLE_BYTES",
    "TARGETS",
    "TEXT_BYTES",
    "TOML_BYTES",
    "VALUES",
    "WORKERS",
    "Limit",
    "checked_name",
]

_MIB: Final = 1 << 20


@dataclass(frozen=True)
class Limit:
    """The most of something.

    Attributes:
        what: in the plural, as an error and the documentation say it.
        most: how many.
        why: what it protects from, or what a larger one could not mean.
    """

    what: str
    most: int
    why: str

    @property
    def shown(self) -> str:
        """The number as a person reads it."""
        if self.most % _MIB == 0 and self.what.startswith("bytes"):
            return f"{self.most // _MIB} MiB"
        return f"{self.most:,}"

    def __call__(self, where: object, given: int | Sized) -> None:
        """Refuse more.

        Args:
            where: the option or the file, as an error begins.
            given: how many, or what has so many.

        Raises:
            LabError: it is more than the limit.
        """
        count = given if isinstance(given, int) else len(given)
        if count > self.most:
            told = f"{count:,}" if count < 10**15 else f"{float(min(count, 10**300)):.0e}"
            raise LabError(f"{where}: {told} {self.what} are too many; give at most {self.shown}")


TABLE_BYTES = Limit("bytes of a CSV file", 512 * _MIB, "a million rows of three targets have 300 MiB")
TOML_BYTES = Limit("bytes of a TOML file", _MIB, "descriptions and studies have some KiB")
TEXT_BYTES = Limit("bytes of a JSON, MJCF or URDF file", 16 * _MIB, "runs and models have less than 1 MiB")
PROGRAM_BYTES = Limit("bytes of a controller's program", 4 * _MIB, "ten thousand targets have 2 MiB")
PROGRAM_FRAMES = Limit("tools and bases of a program", 10_000, "a controller keeps some hundred")
PROGRAM_MOVES = Limit("moves of a program that is read", 20_000, "the way of each is checked")
PROGRAM_TARGETS = Limit("targets of a program that is written", 10_000, "a controller loads no larger file")
MESH_BYTES = Limit("bytes of all meshes and pictures of a robot", 512 * _MIB, "they are held in memory")
ROWS = Limit("rows of a CSV file", 1_000_000, "a day of measuring has some hundred")
COLUMNS = Limit("columns of a CSV file", 2_000, "joints, targets and conditions have some ten")
LINE = Limit("characters of a line of a CSV file", 1_000_000, "2,000 columns of numbers have 50,000")
DEPTH = Limit("levels of nested values", 30, "no description nests more than five")
VALUES = Limit("values of a TOML or JSON file", 200_000, "a run of many parameters has some thousand")
PIXELS = Limit("pixels of a texture, or points of a height field", 1 << 26, "they are held in memory")
COPIES = Limit("copies of a part in an MJCF", 10_000, "they are held in memory")
NESTED_ELEMENTS = Limit("levels of elements in an MJCF or URDF", 500, "a body is inside the one that carries it")
NAME = Limit("characters of a name", 100, "names are columns, titles and labels")
JOINTS = Limit("joints of a robot", 40, "the work grows with their cube")
FRAMES = Limit("frames, rods or pins of a mechanism", 100, "six legs have some twenty; the work grows with their cube")
TARGETS = Limit("targets of a tool", 100, "the work grows with their square")
POSES = Limit("poses", 100_000, "a robot measures some hundred in a day")
STOPS = Limit("stops of a plan", 10_000, "every way between them is checked")
PASSED = Limit("points of a motion", 2_000, "what lies between them is planned and drawn")
MOMENTS = Limit("times of a motion", 100_000, "each is a row; --step-ms sets how far they are apart")
PLACED = Limit("poses of a robot's models", 10_000, "each is told in full, with every solution")
FIXTURES = Limit("anchors, locations or planes", 100, "each takes some poses of its own")
READINGS = Limit("readings of a point", 1_000_000, "their mean has no noise left")
CANDIDATES = Limit("candidates of a plan", 100_000, "2,000 are as good")
CANDIDATE_POINTS = Limit("points of all candidates of a plan", 170_000, "their derivatives are held in memory")
STARTS = Limit("starts of a plan's search", 1_000, "4 are as good")
ROBOTS = Limit("robots of a study", 100_000, "files are numbered with five digits")
DRAWS = Limit("draws of a study", 100_000, "those of one robot are worked out together")
CELLS = Limit("cells of a study", 10_000, "files are numbered with four digits")
CAMPAIGNS = Limit("simulated calibrations of a study", 1_000_000_000, "they take days on a hundred cores")
DRAWN_POINTS = Limit("points of all draws of a study's robot", 20_000_000, "they are held in memory")
PLACES = Limit("places of a workspace", 2_000_000, "200,000 know a volume to a thousandth")
ORIENTATIONS = Limit("orientations at a place", 10_000, "60 cover the sphere to 30°")
ROUNDS = Limit("rounds of a path's search", 100, "one is nearly as good")
BRACKETS = Limit("brackets of a formula in each other", 50, "no source nests more than five")
LINE_OF_TEXT = Limit("characters of a text in a certificate", 200, "it is one line of a page")
DAYS = Limit("days between checks", 3_660, "an arm that is checked once in ten years is not followed")
WORKERS = Limit("worker processes", 1_024, "each has an interpreter of its own")
SEED = Limit("as a seed", (1 << 63) - 1, "a seed is a whole number of 63 bits")

LIMITS: Final = tuple(value for value in list(globals().values()) if isinstance(value, Limit))

_NOT_IN_NAMES = frozenset("./\\,;")  # of parameters, folders and lists of names
_NOT_FIRST = frozenset("=+-@")  # a spreadsheet takes for a formula what begins so


def checked_name(where: object, name: str) -> str:
    """A name of a joint or a target that every file format and folder can hold.

    Raises:
        LabError: it is empty, too long, or has a character with a meaning of its own.
    """
    if not name.strip():
        raise LabError(f"{where}: an empty name; name it")
    NAME(f"{where}: the name {name[:20]}…", name)
    if wrong := next((c for c in name if c in _NOT_IN_NAMES or not c.isprintable()), None):
        raise LabError(f"{where}: the name {name!r} has a {wrong!r}; use letters, digits and '_'")
    if name[0] in _NOT_FIRST:
        raise LabError(f"{where}: the name {name!r} begins with {name[0]!r}; begin it with a letter")
    return name
