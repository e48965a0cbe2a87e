"""Views of results: found by type, and a result without one is complete."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import lab
from lab.cli.commands import all_commands
from lab.core.errors import LabError
from lab.core.gaps import GapWarning
from lab.extension_points import load_reference
from lab.library.result import Result
from lab.report.view import View, document_of, view_of


@dataclass(frozen=True)
class Mass:
    """Options of the result below."""

    kg: float = 2.0


@dataclass(frozen=True, repr=False, eq=False)
class Weights(Result):
    """A result that no view is registered for."""

    command = "inspect"
    options: Any = Mass()
    warnings: tuple[str, ...] = ("<b>scale</b> not levelled",)
    rows: int = 3

    def to_dict(self) -> dict[str, Any]:
        return {"newton": 9.81 * self.options.kg}

    def columns(self) -> Mapping[str, Sequence[Any]]:
        return {"part": [f"part {i}" for i in range(self.rows)], "newton": [9.81 * (i + 1) for i in range(self.rows)]}


class Heavy(Weights):
    """A result whose base has a view of its own, below."""


def test_a_result_without_a_view_is_shown_as_its_table() -> None:
    text = Weights(rows=30).summary()
    assert "part 19" in text and "part 20" not in text and "and 10 more" in text
    assert "19.6" in text and "not levelled" in text
    assert view_of(Weights) == View()


@pytest.mark.pages
def test_a_result_without_a_view_is_saved_whole(tmp_path: Path) -> None:
    folder = Weights().save(tmp_path / "run")
    assert json.loads((folder / "result.json").read_text()) == {"newton": pytest.approx(19.62)}
    assert "part 2" in (folder / "report.html").read_text() and not (folder / "recording.rrd").exists()


@pytest.mark.parametrize("call", [Weights.plot, Weights.recording])
def test_what_a_view_does_not_have_is_refused_in_one_line(call: Any) -> None:
    with pytest.raises(LabError, match=r"report\(path\) writes its page"):
        call(Weights())


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Register entries of ``lab.views`` by the name of a class."""

    def register(**entries: object) -> None:
        monkeypatch.setattr("lab.report.view.registered", lambda group: tuple(entries))
        monkeypatch.setattr("lab.report.view.load", lambda group, name: entries[name])
        view_of.cache_clear()

    yield register
    view_of.cache_clear()


@pytest.mark.figures
@pytest.mark.thorough
def test_every_result_of_the_lab_has_a_view_whose_functions_are_there() -> None:
    for command in all_commands():
        import_module(command.run.partition(":")[0])
    results = [kind for kind in Result.__subclasses__() if kind.__module__.startswith("lab.")]
    assert len(results) > 15
    for kind in results:
        view = view_of(kind)
        assert view.document != View().document, kind
        for reference in filter(None, (view.document, view.picture, view.record, view.figures, view.provenance)):
            assert callable(load_reference(reference)), reference


def test_a_view_is_that_of_the_nearest_base(registered: Any) -> None:
    own = View(document="a:b")
    registered(Weights=View(), Heavy=own)
    assert view_of(Heavy) is own
    registered(Weights=own)
    assert view_of(Heavy) is own
    assert view_of(lab.PredictionResult).document.startswith("lab.report.views.")


def test_an_entry_that_is_no_view_leaves_the_table(registered: Any) -> None:
    registered(Weights="a text")
    with pytest.warns(GapWarning, match="the view of Weights is left out: the entry point 'Weights' of lab.views"):
        assert "part 2" in Weights().summary()


def test_a_cell_of_a_notebook_is_small_and_escaped() -> None:
    cell = Weights(warnings=("<b>scale</b>" * 10_000,) * 50)._repr_html_()
    assert len(cell) < 30_000 and "<b>" not in cell and "&lt;b&gt;" in cell and "47 more" in cell
    inspected = lab.inspect("scara")._repr_html_()
    assert len(inspected) < 30_000 and document_of(lab.inspect("scara")).title in inspected
