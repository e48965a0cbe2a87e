"""Break each model of the sources once: its rows differ, and those computed from them, and no others."""

import importlib
import pkgutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

import lab.extensions.reproduction as package
from lab.campaign.robot import load_robot
from lab.extensions.reproduction import models
from lab.extensions.reproduction.item import Computed, source_named, sources
from lab.extensions.reproduction.options import ReproduceOptions
from lab.extensions.reproduction.result import ReproductionResult
from lab.kinematics.serial.chain import COLUMNS

SLOW = ("Table IV.2", "Table IV.3", "Figure IV.1", "Figure IV.2", "Conclusion", "Section 6.1")  # searches, volumes
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
def breaking(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Break], None]]:
    """What breaks a model until the end of the test."""

    def broken(wrong: Break) -> None:
        monkeypatch.setattr(models, "load_robot", wrong.of)
        forget()

    yield broken
    monkeypatch.undo()
    forget()


@pytest.fixture(scope="session")
def loaded_by() -> dict[tuple[str, str], set[str]]:
    """The robots whose models each item loads, by source and number: no other model can change an item."""
    found: dict[tuple[str, str], set[str]] = {}
    with pytest.MonkeyPatch.context() as patch:
        for source in sources():
            for item in source_named(source).items:
                if item.number not in SLOW:
                    names = found.setdefault((source, item.number), set())
                    patch.setattr(models, "load_robot", lambda name, names=names: names.add(name) or load_robot(name))
                    forget()
                    assert all(answer.state != "differs" for answer in item.answers())
    forget()
    return found


def differing(robot: str, loaded_by: dict[tuple[str, str], set[str]]) -> dict[str, list[Computed]]:
    """The items with rows that differ among those that load a robot's model, by source."""
    found: dict[str, list[Computed]] = {}
    for name in sources():
        items = [each for each in source_named(name).items if robot in loaded_by.get((name, each.number), ())]
        computed = (Computed(item, item.answers()) for item in items)
        rows = [each for each in computed if any(answer.state == "differs" for answer in each.answers)]
        if rows:
            found[name] = rows
    return found


@pytest.mark.pages
@pytest.mark.thorough
@pytest.mark.parametrize(
    "wrong",
    CASES,
    ids=lambda wrong: f"{wrong.robot} {wrong.place[0]} {wrong.place[1]} {wrong.change or 'sign'}",
)
def test_a_broken_model_turns_its_rows_and_no_others(
    wrong: Break, breaking: Callable[[Break], None], loaded_by: dict[tuple[str, str], set[str]], tmp_path
) -> None:
    breaking(wrong)
    found = differing(wrong.robot, loaded_by)
    assert {each.item.number for rows in found.values() for each in rows} == wrong.differing
    for name, rows in found.items():
        result = ReproductionResult(ReproduceOptions(name), source_named(name), tuple(rows), None)
        assert result.exit_code == 1 and result.to_dict()["differ"] == len(result.wrong) == len(result.warnings)
        page = result.report(tmp_path / "page.html").read_text(encoding="utf-8")
        assert all(words.split("'")[0] in page for words in result.warnings) and "differs" in page


ROWS = {  # of the table and the link matrices: what one number of a link is in
    (3, "d"): ("link 4 d", "T3,4(3,4)"),
    (2, "a"): ("link 3 a", "T2,3(1,4) T2,3(2,4)"),
    (4, "alpha"): ("link 5 α", "T4,5(1,2) T4,5(1,3) T4,5(2,2) T4,5(2,3) T4,5(3,2) T4,5(3,3)"),
    (1, "theta"): ("link 2 θ − q", "T1,2(1,1) T1,2(1,2) T1,2(1,4) T1,2(2,1) T1,2(2,2) T1,2(2,4)"),
}


@pytest.mark.parametrize("place", ROWS, ids=str)
def test_of_a_table_and_the_link_matrices_only_the_rows_of_that_link_differ(
    place: tuple[int, str], breaking: Callable[[Break], None]
) -> None:
    breaking(Break("irb120", place, 1.0, frozenset()))
    row, entries = ROWS[place]
    for number, names in (("Table III.2", {row}), ("Equations III.6 to III.11", {*entries.split()})):
        (item,) = (each for each in source_named("thesis").items if each.number == number)
        assert {answer.name for answer in item.answers() if answer.state == "differs"} == names


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["cylindrical", "anthropomorphic", "cartesian", "spherical", "scara"])
def test_a_broken_carrier_has_another_volume(name: str, breaking: Callable[[Break], None]) -> None:
    place = (2, "alpha") if name in ("cartesian", "cylindrical", "spherical") else (1, "a")
    breaking(Break(f"carrier/{name}", place, 20.0, frozenset()))
    (item,) = (each for each in source_named("course").items if each.number == "Section 6.1")
    assert len([answer for answer in item.answers() if answer.state == "differs"]) == 2  # its volume, and the formulas
