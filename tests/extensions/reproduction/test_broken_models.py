"""Break each model and each function of the sources once: their rows differ, so no exercise has a wrong solution."""

import importlib
import pkgutil
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.computed_sources import ITEMS

import lab.extensions.reproduction as package
from lab.core import se3
from lab.extensions.reproduction import course, course_machines, staubli, thesis, thesis_model
from lab.extensions.reproduction import source_models as models
from lab.extensions.reproduction.item import Item

MODULES = [
    importlib.import_module(f"{package.__name__}.{each.name}") for each in pkgutil.iter_modules(package.__path__)
]


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
