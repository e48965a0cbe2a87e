"""Define the grid of a study: factors, times robots, times draws of the noise; divide it into tasks."""

import itertools
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from math import prod
from pathlib import Path
from typing import Any, Final, Literal, get_args, get_type_hints

from lab.calibration.estimator import LEAST_SQUARES, estimator_named
from lab.core.errors import LabError, error_context
from lab.core.limits import CAMPAIGNS, CELLS, DRAWN_POINTS, DRAWS, NAME, POSES, ROBOTS, SEED, TARGETS, positive, whole
from lab.extension_points import named_parts
from lab.formats.structured import read_toml, structured
from lab.kinematics.effects.effect_registry import CAMPAIGN_SPECIFIC
from lab.options.option_groups import Effects, Fitting
from lab.options.option_types import PriorMode
from lab.sensors.sensor_registry import sensor_named
from lab.simulation.sampler import sampler_named

__all__ = [
    "ANY",
    "CAMPAIGNS_A_TASK",
    "FACTORS",
    "NONE",
    "OF_PLAN",
    "POINTS",
    "RANKED",
    "USUAL",
    "GridCell",
    "Study",
    "Task",
    "is_any",
    "read_study",
    "study_from",
]

ANY: Final = "any"  # scaling of a cell that is the same in all scalings
NONE = "none"  # the effects of a rigid arm; no plan
USUAL = "usual"  # the parameters that are identifiable
POINTS = "points"
RANKED = ("fresh_mean_mm", "fresh_p95_mm", "fresh_worst_mm", "length_rms_mm", "angle_rms_mrad", "link_length_rms_mm",
          "link_angle_rms_mrad", "mixed_rms", "before_mm", "steps")  # fmt: skip  # metrics of which less is better
OF_PLAN = 0  # poses of a cell whose plan says how many
CAMPAIGNS_A_TASK = 2000  # that are fitted together: about half a second
_ALONE_A_TASK = 20  # that are fitted one by one: about half a minute


@dataclass(frozen=True)
class GridCell:
    """A combination of the factors.

    Attributes:
        criterion: of the poses; ``random`` for random poses.
        scaling: of the criterion; O1 and random poses are independent of it.
        poses: their number.
        noise: factor of the instrument's noise; the poses are chosen with a factor of one.
        parameters, effects: names of sets that the study defines.
        model, robust, prior, estimator: of the fit, as ``lab identify`` takes them.
        observe: the sensor.
        plan: a plan's file, whose poses are measured instead of chosen ones; ``none`` without one.
        targets: their number on the flange.
        sampler: of the arms' errors of geometry.
        payload_kg: payloads, of which one is drawn for each pose; none given: those of the effects.
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
    model: str = "geometric"
    robust: bool = False
    prior: PriorMode = "off"
    observe: str = POINTS
    plan: str = NONE
    targets: int = 1
    payload_kg: tuple[float, ...] = ()
    estimator: str = LEAST_SQUARES
    sampler: str = "normal"

    @property
    def fitting(self) -> Fitting:
        """Options of the fit that the factors name."""
        return Fitting(model=self.model, robust=self.robust, prior=self.prior, estimator=self.estimator)

    @property
    def is_stacked(self) -> bool:
        """True if campaigns are fitted together by least squares; False if each is identified alone."""
        fitting = self.fitting
        plain = self.observe == POINTS and self.prior == "off" and not self.robust and self.estimator == LEAST_SQUARES
        searched = fitting.residual or fitting.searched
        return plain and not searched and not set(CAMPAIGN_SPECIFIC) & set(fitting.groups)

    def refuse_nonsense(self) -> None:
        """Refuse values that make no sense, with a LabError that names the factor."""
        if not isinstance(self.payload_kg, tuple):
            raise LabError(
                f"factor payload_kg: {self.payload_kg} is no tuple; give one for each level, e.g. (0.0, 3.0)"
            )
        if self.plan == NONE:
            whole("factor poses", self.poses, 1, POSES)
        positive("factor noise", self.noise)
        positive("factor position_sigma_mm", self.position_sigma_mm)
        positive("factor rotation_sigma_mrad", self.rotation_sigma_mrad)
        whole("factor targets", self.targets, 1, TARGETS)
        with error_context("factors"):
            self.fitting.check()
            estimator_named(self.estimator)
            sensor_named(self.observe)
            sampler_named(self.sampler)
            Effects(payload_kg=self.payload_kg or Effects().payload_kg).check()


def is_any(factor: str, level: object) -> bool:
    """Decide whether a cell's level stands for every level of a factor."""
    return level == ANY or (factor == "poses" and level == OF_PLAN)


_SCALINGS = tuple(each for each in get_args(get_type_hints(GridCell)["scaling"]) if each != ANY)
FACTORS = tuple(each.name for each in fields(GridCell))


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
        targets: measured points of the tool; the factor ``targets`` takes the first ones, and then the robot's others.
        factors: values of the factors; the default for others.
        parameters: sets of parameters to identify, by name, beside ``usual``.
        effects: sets of effects of the arm, by name, beside ``none``.
        metric: by which terminal and page rank the cells.
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
    metric: str = RANKED[0]

    def __post_init__(self) -> None:
        if not self.name or Path(self.name).name != self.name or not self.name.isprintable():
            raise LabError(f"name '{self.name}': give a name without slashes")
        NAME("name", self.name)
        whole("seed", self.seed, 0, SEED)
        for name, limit in (("robots", ROBOTS), ("draws", DRAWS), ("fresh", POSES)):
            whole(name, getattr(self, name), 1, limit)
        TARGETS("targets", self.targets)
        if self.metric not in RANKED:
            raise LabError(f"metric '{self.metric}' is none of which less is better: give one of {', '.join(RANKED)}")
        self._refuse_wrong_factors()
        for kind, sets in (("parameters", self.parameters), ("effects", self.effects)):
            for name, each in sets.items():
                try:
                    each.check()
                except LabError as error:
                    raise LabError(f"{kind}.{name}: {error}") from error
        self._refuse_large()
        for cell in self.cells:
            cell.refuse_nonsense()
            self._refuse_undefined_sets(cell)

    def _refuse_wrong_factors(self) -> None:
        """Refuse factors that there are not, and levels that are given twice, with a LabError."""
        for kind, values in self.factors.items():
            if kind not in FACTORS:
                raise LabError(f"factor '{kind}' is unknown; there are {', '.join(FACTORS)}")
            if not values or len({_same(kind, each) for each in values}) < len(values):
                raise LabError(f"factor {kind}: give at least one value, and each once")
        if unknown := [each for each in self.factors.get("scaling", ()) if each not in _SCALINGS]:
            raise LabError(f"factor scaling: '{unknown[0]}' is unknown; there are {', '.join(_SCALINGS)}")

    def _refuse_undefined_sets(self, cell: GridCell) -> None:
        """Refuse sets of parameters and effects that the study does not define, and payloads of both."""
        for kind, name, usual, sets in (
            ("parameters", cell.parameters, USUAL, self.parameters),
            ("effects", cell.effects, NONE, self.effects),
        ):
            if name not in (usual, *sets):
                raise LabError(f"factor {kind}: '{name}' is not defined; add [{kind}.{name}]")
        if cell.payload_kg and self.effects_of(cell, alone=True).payload_kg != Effects().payload_kg:
            raise LabError(f"factor payload_kg: [effects.{cell.effects}] has payload_kg, too; keep one")

    def effects_of(self, cell: GridCell, *, alone: bool = False) -> Effects:
        """Return the effects of a cell's arms, with its payloads.

        Args:
            alone: without the payloads of the factor.
        """
        effects: Any = Effects() if cell.effects == NONE else self.effects[cell.effects]
        named: Effects = effects if alone or not cell.payload_kg else replace(effects, payload_kg=cell.payload_kg)
        return named

    def fitting_of(self, cell: GridCell) -> Fitting:
        """Return the options of a cell's fits: of its factors, and of its set of parameters.

        Raises:
            LabError: the set has an option that is a factor.
        """
        usual, chosen = Fitting(), cell.fitting
        named_set = usual if cell.parameters == USUAL else self.parameters[cell.parameters]
        mine = (named_set.model, named_set.robust, named_set.prior == "on", named_set.estimator)
        if mine != (usual.model, False, False, usual.estimator):
            raise LabError(f"parameters.{cell.parameters}: give model, robust, prior and estimator in [factors]")
        if named_set.load is not None or named_set.error_terms:
            raise LabError(f"parameters.{cell.parameters}: a study takes neither load nor error_terms; leave them out")
        named = {name: getattr(chosen, name) for name in ("model", "robust", "prior", "estimator")}
        return replace(named_set, **named)

    def _refuse_large(self) -> None:
        cells = prod(len(values) for values in self.factors.values())
        CELLS("factors", cells)
        CAMPAIGNS("robots, draws and factors", cells * self.robots * self.draws)
        poses = max((each for each in self.factors.get("poses", ()) if isinstance(each, int)), default=GridCell.poses)
        targets = max((each for each in self.factors.get("targets", ()) if isinstance(each, int)), default=0)
        points = self.draws * max(self.fresh, poses) * max(len(self.targets), targets)
        DRAWN_POINTS("draws, fresh, poses and targets", points)

    @property
    def cells(self) -> tuple[GridCell, ...]:
        """Combinations in the order of the factors, without duplicates."""
        usual = asdict(GridCell()) | {"targets": len(self.targets)}
        values = [self.factors.get(name, (usual[name],)) for name in FACTORS]
        combined = (GridCell(*combination) for combination in itertools.product(*values))
        return tuple(dict.fromkeys(_plain(cell) for cell in combined))

    @property
    def tasks(self) -> tuple[Task, ...]:
        """The whole study in pieces; results do not depend on the division."""
        found = list[Task]()
        for number, cell in enumerate(self.cells):
            step = max(1, (CAMPAIGNS_A_TASK if cell.is_stacked else _ALONE_A_TASK) // self.draws)
            found += [Task(number, at, min(at + step, self.robots)) for at in range(0, self.robots, step)]
        return tuple(found)

    @property
    def campaigns(self) -> int:
        """Number of campaigns."""
        return len(self.cells) * self.robots * self.draws


def _same(factor: str, level: Any) -> Any:
    """Return what equal levels of a factor have in common: groups, sensors and payloads count in any order."""
    if factor in ("model", "observe") and isinstance(level, str):
        return frozenset(level.split("+"))
    return frozenset(level) if isinstance(level, tuple) else level


def _plain(cell: GridCell) -> GridCell:
    """Return the cell with "any" where a level makes no difference: the scaling of random poses and of O1.

    A plan has its poses, whatever chooses others.
    """
    if cell.plan != NONE:
        return replace(cell, criterion=ANY, scaling=ANY, poses=OF_PLAN)
    return replace(cell, scaling=ANY) if cell.criterion in ("random", "O1") else cell


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
    """Build a study from plain values of TOML and JSON, and parts of one's own as objects.

    Raises:
        LabError: a name is unknown, or a value is invalid.
    """
    factors, sets = content.get("factors", {}), content.get("effects", {})
    if isinstance(factors, Mapping):
        factors = {name: _levels(name, levels) for name, levels in factors.items()}
    if isinstance(sets, Mapping):
        sets = {name: named_parts("effects", _as_mapping(each)) for name, each in sets.items()}
    return structured("", Study, {**content, "factors": factors, "effects": sets})


def _as_mapping(given: Any) -> Any:
    return asdict(given) if isinstance(given, Effects) else given


def _levels(factor: str, given: Any) -> tuple[Any, ...]:
    given = given if isinstance(given, list) else [given]
    with error_context("factors"):
        levels = [named_parts(factor, level) for level in given]
    if len(set(map(id, given))) == len(given) > len(set(map(repr, levels))) and levels != given:
        raise LabError(f"factor {factor}: two parts have one name ({', '.join(map(str, levels))}); name each otherwise")
    if factor not in FACTORS:
        return tuple(levels)  # the study refuses it
    if factor == "payload_kg":
        levels = [each if isinstance(each, list | tuple) else [each] for each in levels]
    return tuple(getattr(structured("factors", GridCell, {factor: level}), factor) for level in levels)
