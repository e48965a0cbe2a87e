"""Break each model and each function of the sources once: their rows differ, so no exercise has a wrong solution."""

import importlib
import pkgutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.computed_sources import ITEMS

import lab.extensions.reproduction as package
from lab.campaign.robot import load_robot
from lab.core import se3
from lab.extensions.reproduction import course, course_machines, models, staubli, thesis, thesis_model
from lab.extensions.reproduction.item import Item
from lab.kinematics.serial.chain import COLUMNS

MODULES = [
    importlib.import_module(f"{package.__name__}.{each.name}") for each in pkgutil.iter_modules(package.__path__)
]


@dataclass(frozen=True)
class Break:
    """One number of a model that is wrong, and the items that must show it.

    Attributes:
        place: row and column of a serial arm's table (row 0 is the first), or a mechanism's frame and step; the sign of
            a joint is the column "sign".
        change: added in mm or degrees; None turns the sign.
        differing: items by their numbers.
    """

    robot: str
    place: tuple[int | str, str | int]
    change: float | None
    differing: frozenset[str]

    def of(self, name: str) -> object:
        """The robot of this name, broken if it is this one."""
        robot = load_robot(name)
        if name != self.robot:
            return robot
        row, column = self.place
        if isinstance(column, int):
            frames = list(robot.chain.tree.frames)
            at = next(i for i, frame in enumerate(frames) if frame.name == row)
            step = frames[at].path[column]
            path = list(frames[at].path)
            path[column] = replace(step, value=self.changed(step.value, is_angle=step.is_turn))
            frames[at] = replace(frames[at], path=tuple(path))
            broken = replace(robot.chain, tree=replace(robot.chain.tree, frames=tuple(frames)))
            return SimpleNamespace(chain=broken, tool=robot.tool)
        chain = robot.serial_model.chain
        table, sign = chain.table.copy(), chain.sign.copy()
        if column == "sign":
            sign[row] *= -1
        else:
            at = (row, COLUMNS.index(column))
            table[at] = self.changed(table[at], is_angle=column not in "da")
        return SimpleNamespace(
            serial_model=SimpleNamespace(chain=replace(chain, table=table, sign=sign)), tool=robot.tool
        )

    def changed(self, value: float, *, is_angle: bool) -> float:
        """The wrong value, rad or m."""
        return -value if self.change is None else value + (np.deg2rad(self.change) if is_angle else self.change / 1e3)


def case(robot: str, place: tuple[int | str, str | int], change: float | None, differing: str) -> Break:
    """One break; the items are divided by ``;``."""
    return Break(robot, place, change, frozenset(each.strip() for each in differing.split(";")))


CHAIN = (
    "Equations 3.35, 3.36 a; Equations III.6 to III.11; Equation III.12; Equation III.13; Table III.3; "
    "Equations IV.7, IV.19 to IV.24"
)
ELBOW = "Equations III.18, III.19; Equations III.21 to III.28"
LINKS_8 = "Section 8.2, matrices; Section 8.4; Section 8.5, rates; Section 8.6; Section 8.7"
CASES = [
    case("irb120", (3, "d"), 1.0, f"{CHAIN}; {ELBOW}; Table III.2; Figure III.1"),
    case("versatran", (4, "alpha"), None,
         f"{LINKS_8}; Section 8.2, table; Section 8.5, J; Section 8.2, figure"),
    case("rx130", (3, "alpha"), 1.0, "Equation 1.1; Table 1"),
    case("rpr3/shared_pin", ("A1", 0), 1.0, "Section 11.5"),
    case("irb120", (4, "alpha"), 1.0, f"{CHAIN}; Table III.2; Equations III.30, III.31"),
    case("irb120", (2, "alpha"), None, f"{CHAIN}; {ELBOW}; Table III.2; Figure III.1; Equations III.30, III.31"),
    case("rx130", (2, "a"), 1.0, "Equation 1.1; Table 1; Figure 3"),
    case("rx130", (4, "alpha"), None, "Equation 1.1; Table 1"),
    case("versatran", (2, "a"), 1.0, f"{LINKS_8}; Section 8.2, table"),
    case("versatran", (2, "alpha"), 1.0,
         f"{LINKS_8}; Section 8.2, table; Section 8.5, J; Section 8.2, figure"),
    case("scemi", (2, "a"), 1.0, "Section 8.3; Section 8.8"),
    case("scemi", (4, "alpha"), 1.0, "Section 8.3; Section 8.8"),
    case("scemi", (3, "alpha"), None, "Section 8.3; Section 8.8"),
    case("scara", (1, "a"), 1.0, "Section 8.9"),
    case("scara", (1, "alpha"), 1.0, "Section 8.9"),
    case("scara", (1, "sign"), None, "Section 8.9"),
    case("course2r", (1, "a"), -1.0, "Section 10.3, question 1; Section 10.3, question 2"),
    case("course2r", (0, "alpha"), 1.0,
         "Section 10.3, question 1; Section 10.3, question 2; Section 10.3, approximation"),
    case("course2r", (0, "alpha"), None, "Section 10.3, question 1; Section 10.3, question 2"),
    case("carrier/prp", (2, "d"), 1.0, "Section 7.2"),
    case("carrier/prp", (1, "theta"), 1.0, "Section 7.2"),
    case("carrier/prp", (2, "alpha"), None, "Section 7.2"),
    case("carrier/rrr", (2, "a"), 1.0, "Section 7.3"),
    case("carrier/rrr", (1, "theta"), 1.0, "Section 7.3"),
    case("carrier/rrr", (1, "alpha"), None, "Section 7.3"),
    case("carrier/cylindrical", (2, "a"), 1.0, "Section 7.1"),
    case("carrier/spherical", (1, "alpha"), 1.0, "Section 7.1"),
    case("carrier/spherical", (1, "alpha"), None, "Section 7.1"),
    case("rpr2", ("A2", 0), 1.0, "Section 11.3.1"),
    case("rpr2", ("A2", 0), None, "Section 11.3.1"),
    case("rpr3", ("A2", 0), 1.0, "Sections 11.3, 11.3.2"),
    case("rpr3", ("B3", 0), None, "Sections 11.3, 11.3.2"),
    case("rpr3/shared_pin", ("A1", 0), None, "Section 11.5"),
    case("delta", ("elbow1", 0), 1.0, "Sections 11.4.4, 11.6"),
    case("delta/irb340", ("arm1", 0), 1.0, "Sections 11.4.4, 11.6"),
]  # fmt: skip


def forget() -> None:
    """Forget what the reproduction has computed of its models."""
    for module in MODULES:
        for value in vars(module).values():
            if hasattr(value, "cache_clear") and value.__module__.startswith(package.__name__):
                value.cache_clear()


@pytest.fixture
def breaking(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[object, str, object], None]]:
    """What replaces a function until the end of the test."""

    def broken(module: object, name: str, function: object) -> None:
        monkeypatch.setattr(module, name, function)
        forget()

    yield broken
    monkeypatch.undo()
    forget()


Breaking = Callable[[object, str, object], None]


def items_named(numbers: frozenset[str] | set[str]) -> list[Item]:
    return [item for _, item in ITEMS if item.number in numbers]


def differs(item: Item) -> bool:
    return any(answer.state == "differs" for answer in item.answers())


@pytest.mark.pages
@pytest.mark.thorough
@pytest.mark.parametrize(
    "wrong", CASES, ids=lambda wrong: f"{wrong.robot} {wrong.place[0]} {wrong.place[1]} {wrong.change or 'sign'}"
)
def test_a_broken_model_turns_its_rows_and_no_others(wrong: Break, breaking: Breaking) -> None:
    """No others of those that some number of this robot is in."""
    breaking(models, "load_robot", wrong.of)
    of_robot = frozenset[str]().union(*(case.differing for case in CASES if case.robot == wrong.robot))
    assert {item.number for item in items_named(of_robot) if differs(item)} == wrong.differing


ROWS = {  # of the table and the link matrices: what one number of a link is in
    (3, "d"): ("link 4 d", "T3,4(3,4)"),
    (2, "a"): ("link 3 a", "T2,3(1,4) T2,3(2,4)"),
    (4, "alpha"): ("link 5 α", "T4,5(1,2) T4,5(1,3) T4,5(2,2) T4,5(2,3) T4,5(3,2) T4,5(3,3)"),
    (1, "theta"): ("link 2 θ − q", "T1,2(1,1) T1,2(1,2) T1,2(1,4) T1,2(2,1) T1,2(2,2) T1,2(2,4)"),
}


@pytest.mark.parametrize("place", ROWS, ids=str)
def test_of_a_table_and_the_link_matrices_only_the_rows_of_that_link_differ(
    place: tuple[int, str], breaking: Breaking
) -> None:
    breaking(models, "load_robot", Break("irb120", place, 1.0, frozenset()).of)
    row, entries = ROWS[place]
    for number, names in (("Table III.2", {row}), ("Equations III.6 to III.11", {*entries.split()})):
        (item,) = items_named({number})
        assert {answer.name for answer in item.answers() if answer.state == "differs"} == names


VOLUMES = {"cylindrical": "alpha", "anthropomorphic": "a", "cartesian": "alpha", "spherical": "alpha", "scara": "a"}


@pytest.mark.thorough
@pytest.mark.parametrize("name", VOLUMES)
def test_a_broken_carrier_has_another_volume(name: str, breaking: Breaking) -> None:
    place = (1 if VOLUMES[name] == "a" else 2, VOLUMES[name])
    breaking(models, "load_robot", Break(f"carrier/{name}", place, 20.0, frozenset()).of)
    (item,) = items_named({"Section 6.1"})
    assert len([answer for answer in item.answers() if answer.state == "differs"]) == 2  # its volume, and the formulas


def _other_convention(convention: str, *table: np.ndarray) -> np.ndarray:
    return models.link_matrices("distal" if convention == "craig" else "craig", *table)


def _one_less(right: Callable[..., Any]) -> Callable[..., Any]:
    return lambda J, order: SimpleNamespace(identifiable=right(J, order).identifiable[:-1])


TURNED = {"Annex, A3.3 to A3.6, figure A3.1", "Annex, A3.7 to A3.11", "Equations 3.22 to 3.29"}
FUNCTIONS: list[tuple[Any, str, Callable[..., Any], set[str]]] = [  # the broken one as a function of the right one
    (course, "pseudo_inverse", lambda right: lambda J, **options: 1.001 * right(J, **options),
     {"Section 5.6", "Section 10.3, question 2"}),
    (course, "rates", lambda right: lambda J, twists: SimpleNamespace(rank=np.array([6])), {"Section 6.2"}),
    (course_machines, "type_2", lambda right: lambda *x: right(*x)._replace(values=(right(*x).values[0][:1],)),
     {"Section 7.4"}),
    (course_machines, "link_matrices", lambda right: _other_convention, {"Section 8.1"}),
    (staubli, "link_matrices", lambda right: _other_convention, {"Equation 1.2"}),
    (thesis_model, "link_matrices", lambda right: _other_convention, {"Equations III.1, III.2, III.5, IV.10"}),
    (thesis, "link_matrices", lambda right: _other_convention, {"Equation IV.12", "Equations IV.13 to IV.18"}),
    (se3, "exp", lambda right: lambda r: right(-r), TURNED),
    (se3, "rotation_from_roll_pitch_yaw", lambda right: lambda angles: right(angles[..., ::-1]),
     {"Annex, A3.2", "Table III.3"}),
    (se3, "skew", lambda right: lambda r: right(r * np.array([1, 1, 0])),
     {"Annex, A3.1", "Equations IV.5 to IV.9, IV.25, IV.26"}),
    (np.linalg, "inv", lambda right: lambda T: np.swapaxes(T, -1, -2), {"Equation III.15"}),
    (thesis, "base_set_of", _one_less, {"Table IV.1"}),
    (thesis, "_campaigns", lambda right: lambda name: 2 * [np.full((1000, 19), 1.0 + len(name))], {"Conclusion"}),
    (staubli, "pose_of", lambda right: lambda row: right(row * np.array([1, 0, 1, 1, 1, 1])),
     {"Equations 1.3, 1.5", "Equations 1.4, 1.6"}),
    (staubli, "base_set_of", _one_less, {"Section 1.3.5"}),
    (staubli, "khalil_frame", lambda right: lambda T: SimpleNamespace(values=-right(T).values), {"Figure 3"}),
]  # fmt: skip


@pytest.mark.parametrize(
    ("module", "name", "broken", "numbers"), FUNCTIONS, ids=[f"{each[0].__name__}.{each[1]}" for each in FUNCTIONS]
)
def test_a_broken_function_turns_the_exercises_that_it_solves(
    module: Any, name: str, broken: Callable[..., Any], numbers: set[str], breaking: Breaking
) -> None:
    breaking(module, name, broken(getattr(module, name)))
    assert {item.number for item in items_named(numbers) if differs(item)} == numbers


def test_every_exercise_is_turned_by_a_broken_model_or_function() -> None:
    turned = frozenset[str]({"Section 6.1"}).union(
        *(case.differing for case in CASES), *(each[3] for each in FUNCTIONS)
    )
    assert {item.number for _, item in ITEMS if item.exercise is not None} - turned == set()
