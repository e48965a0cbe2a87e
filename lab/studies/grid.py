"""Define the grid of a study: factors, times robots, times draws of the noise; divide it into tasks."""

import itertools
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from math import prod
from pathlib import Path
from typing import Any, Final, Literal, get_args, get_type_hints

from lab.campaign.option_groups import Effects, Fitting
from lab.core.errors import LabError, error_context
from lab.core.limits import CAMPAIGNS, CELLS, DRAWN_POINTS, DRAWS, NAME, POSES, ROBOTS, SEED, TARGETS, positive, whole
from lab.formats.structured import read_toml, structured

__all__ = ["ANY", "CAMPAIGNS_A_TASK", "FACTORS", "NONE", "USUAL", "Cell", "Study", "Task", "read_study", "study_from"]

ANY: Final = "any"  # scaling of a cell that is the same in all scalings
NONE = "none"  # the effects of a rigid arm
USUAL = "usual"  # the parameters that are identifiable
CAMPAIGNS_A_TASK = 2000  # about half a second


@dataclass(frozen=True)
class Cell:
    """A combination of the factors.

    Attributes:
        criterion: of the poses; ``random`` for random poses.
        scaling: of the criterion; O1 and random poses are independent of it.
        poses: their number.
        noise: factor of the instrument's noise; the poses are chosen with a factor of one.
        parameters, effects: names of sets that the study defines.
    """

    criterion: str = "O1"
    scaling: Literal["raw", "unit", "length", "whitened", "any"] = "whitened"
    poses: int = 30
    instrument: str = "uniform-8um"
    noise: float = 1.0
    position_sigma_mm: float = 0.5
    rotation_sigma_mrad: float = 1.5
    parameters: str = USUAL
    effects: str = NONE


_SCALINGS = tuple(each for each in get_args(get_type_hints(Cell)["scaling"]) if each != ANY)
FACTORS = tuple(each.name for each in fields(Cell))


@dataclass(frozen=True)
class Task:
    """A task for a worker: some robots of one cell, solved together.

    Attributes:
        cell: its number.
        first, last: robots, the last one not included.
    """

    cell: int
    first: int
    last: int

    @property
    def name(self) -> str:
        """Name of the task's file."""
        return f"cell{self.cell:04d}-robots{self.first:05d}-{self.last:05d}"


@dataclass(frozen=True)
class Study:
    """A grid of campaigns.

    Attributes:
        robot: a model's name or path.
        robots: number of perturbed copies of it.
        draws: campaigns with each, which differ in the noise alone.
        fresh: number of validation poses of each.
        frozen: one Jacobian for all steps of a fit, instead of one for each.
        factors: values of the factors; the default for others.
        parameters: sets of parameters to identify, by name, beside ``usual``.
        effects: sets of effects of the arm, by name, beside ``none``.
    """

    name: str = "study"
    robot: str = "irb120"
    targets: tuple[str, ...] = ("p1",)
    seed: int = 0
    robots: int = 20
    draws: int = 50
    fresh: int = 250
    frozen: bool = False
    factors: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)
    parameters: Mapping[str, Fitting] = field(default_factory=dict)
    effects: Mapping[str, Effects] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.name or Path(self.name).name != self.name or not self.name.isprintable():
            raise LabError(f"name '{self.name}': give a name without slashes")
        NAME("name", self.name)
        whole("seed", self.seed, 0, SEED)
        for name, limit in (("robots", ROBOTS), ("draws", DRAWS), ("fresh", POSES)):
            whole(name, getattr(self, name), 1, limit)
        TARGETS("targets", self.targets)
        for kind, values in self.factors.items():
            if kind not in FACTORS:
                raise LabError(f"factor '{kind}' is unknown; there are {', '.join(FACTORS)}")
            if not values or len(set(values)) < len(values):
                raise LabError(f"factor {kind}: give at least one value, and each once")
        if unknown := [each for each in self.factors.get("scaling", ()) if each not in _SCALINGS]:
            raise LabError(f"factor scaling: '{unknown[0]}' is unknown; there are {', '.join(_SCALINGS)}")
        for kind, sets in (("parameters", self.parameters), ("effects", self.effects)):
            for name, each in sets.items():
                try:
                    each.check()
                except LabError as error:
                    raise LabError(f"{kind}.{name}: {error}") from error
        self._refuse_large()
        for cell in self.cells:
            whole("factor poses", cell.poses, 1, POSES)
            positive("factor noise", cell.noise)
            positive("factor position_sigma_mm", cell.position_sigma_mm)
            positive("factor rotation_sigma_mrad", cell.rotation_sigma_mrad)
            if cell.parameters != USUAL and cell.parameters not in self.parameters:
                raise LabError(
                    f"factor parameters: '{cell.parameters}' is not defined; add [parameters.{cell.parameters}]"
                )
            if cell.effects != NONE and cell.effects not in self.effects:
                raise LabError(f"factor effects: '{cell.effects}' is not defined; add [effects.{cell.effects}]")

    def _refuse_large(self) -> None:
        cells = prod(len(values) for values in self.factors.values())
        CELLS("factors", cells)
        CAMPAIGNS("robots, draws and factors", cells * self.robots * self.draws)
        poses = max((each for each in self.factors.get("poses", ()) if isinstance(each, int)), default=Cell.poses)
        DRAWN_POINTS("draws, fresh, poses and targets", self.draws * max(self.fresh, poses) * len(self.targets))

    @property
    def cells(self) -> tuple[Cell, ...]:
        """Combinations in the order of the factors, without duplicates."""
        usual = asdict(Cell())
        values = [self.factors.get(name, (usual[name],)) for name in FACTORS]
        found = (Cell(*combination) for combination in itertools.product(*values))
        return tuple(dict.fromkeys(_plain(cell) for cell in found))

    @property
    def tasks(self) -> tuple[Task, ...]:
        """The whole study in pieces; results do not depend on the division."""
        step = max(1, CAMPAIGNS_A_TASK // self.draws)
        starts = range(0, self.robots, step)
        return tuple(
            Task(cell, first, min(first + step, self.robots)) for cell in range(len(self.cells)) for first in starts
        )

    @property
    def campaigns(self) -> int:
        """Number of campaigns."""
        return len(self.cells) * self.robots * self.draws


def _plain(cell: Cell) -> Cell:
    """Return the cell with the scaling "any" where it makes no difference: of random poses, and of O1."""
    return Cell(**{**asdict(cell), "scaling": ANY}) if cell.criterion in ("random", "O1") else cell


def read_study(path: Path) -> Study:
    """Read a study from a TOML file.

    Raises:
        LabError: the file cannot be read, or has an invalid value.
    """
    content = read_toml(path)
    if not content:
        raise LabError(f"{path}: is empty; give the study at least a name, or [factors]")
    with error_context(path):
        return study_from(content)


def study_from(content: Mapping[str, Any]) -> Study:
    """Build a study from plain values of TOML and JSON.

    Raises:
        LabError: a name is unknown, or a value is invalid.
    """
    given = content.get("factors", {})
    factors = {name: _levels(name, levels) for name, levels in given.items()} if isinstance(given, Mapping) else given
    return structured("", Study, {**content, "factors": factors})


def _levels(factor: str, given: Any) -> tuple[Any, ...]:
    levels = given if isinstance(given, list) else [given]
    if factor not in FACTORS:
        return tuple(levels)  # the study refuses it
    return tuple(getattr(structured("factors", Cell, {factor: level}), factor) for level in levels)
