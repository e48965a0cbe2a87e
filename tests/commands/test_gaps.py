"""A drawing never destroys a result: with each drawing function broken in turn, numbers and exit code stay."""

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from helpers.bad_input import run
from helpers.drawing import nothing_drawn
from helpers.writing_commands import COMMANDS, inputs_of_commands

from lab.commands.result import Result
from lab.core.gaps import GapWarning
from lab.extension_points import load_reference
from lab.render import document as doc
from lab.render import page

pytestmark = [pytest.mark.figures, pytest.mark.filterwarnings("always::lab.core.gaps.GapWarning")]

ALONE = {"calibrate", "design", "dynamics", "kinematics", "inspect", "reproduce", "workspace"}  # need no files
QUICK = {"calibrate", "kinematics"}


@dataclass
class Written:
    """What a command wrote while nothing of it could be drawn."""

    result: Result
    folder: Path
    code: int
    warned: str


def broken(*_: Any, **__: Any) -> Any:
    """Stand for any function that draws."""
    raise RuntimeError("broken on purpose")


def like(function: Any) -> Any:
    """A broken function that says of itself what that one returns."""

    def fails(*_: Any, **__: Any) -> Any:
        return broken()

    fails.__annotations__ = function.__annotations__
    return fails


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of all files that the commands read."""
    folder = tmp_path_factory.mktemp("inputs")
    with pytest.MonkeyPatch.context() as patch, nothing_drawn():
        patch.chdir(folder)
        return inputs_of_commands(folder)


@pytest.fixture(
    scope="module",
    params=[name if name in QUICK else pytest.param(name, marks=pytest.mark.thorough) for name in COMMANDS],
)
def written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Written:
    """A command that ran while its document, its recording and its page were broken."""
    name, results = request.param, list[Result]()
    folder = tmp_path_factory.mktemp("gaps") / "run"
    draw = Result.draw

    def kept(self: Result, place: Path) -> None:
        results.append(self)
        draw(self, place)

    with pytest.MonkeyPatch.context() as patch, pytest.warns(GapWarning) as warned:
        patch.chdir(folder.parent if name in ALONE else request.getfixturevalue("inputs"))
        patch.setattr(Result, "draw", kept)
        patch.setattr("lab.commands.result.load_reference", lambda _: broken)
        patch.setattr("lab.render.page.to_html", broken)
        patch.setattr("lab.render.terminal.print_document", broken)
        code = run(f"{COMMANDS[name]} --out {folder}")
    (result,) = results
    return Written(result, folder, code, "\n".join(str(each.message) for each in warned))


def test_numbers_and_exit_code_are_those_without_a_drawing(written: Written) -> None:
    assert written.code == written.result.exit_code
    assert json.loads((written.folder / "result.json").read_text())
    names = {path.name for path in written.folder.iterdir()}
    assert "SHA256SUMS" in names and not {"report.html", "recording.rrd"} & names
    for missing in ("report.html", "the summary", *(["recording.rrd"] * written.result.is_recorded)):
        assert f"{missing} is left out: RuntimeError: broken on purpose" in written.warned


def parts_of(result: Result) -> list[str]:
    """The functions that the document's own function calls, by their names there."""
    make = load_reference(result.shown_by)
    names = {each.__code__: name for name, each in vars(sys.modules[make.__module__]).items() if callable_here(each)}
    found = list[str]()

    def called(frame: Any, event: str, _: Any) -> None:
        if event == "call" and frame.f_code in names:
            above = frame.f_back
            while above is not None and above.f_code.co_name.startswith("<"):
                above = above.f_back
            if above is not None and above.f_code is make.__code__:
                found.append(names[frame.f_code])

    sys.setprofile(called)
    try:
        make(result)
    finally:
        sys.setprofile(None)
    return list(dict.fromkeys(found))


def callable_here(each: Any) -> bool:
    """Whether it is a plain function."""
    return type(each) is type(broken)


def test_each_part_of_a_document_that_fails_leaves_a_gap(written: Written, monkeypatch: pytest.MonkeyPatch) -> None:
    result = written.result
    monkeypatch.setattr("lab.render.charts.chart.inline_svg", lambda picture: "")
    module = sys.modules[load_reference(result.shown_by).__module__]
    lost = list[bool]()
    for name in parts_of(result):
        with monkeypatch.context() as patch, pytest.warns(GapWarning, match="broken on purpose"):
            patch.setattr(module, name, like(getattr(module, name)))
            shown, printed = page.to_html(result.document()), result.summary()
        assert "broken on purpose" in shown and "broken on purpose" in printed, name
        lost += ["the text is left out" in printed]
    assert 2 * sum(lost) <= len(lost)  # of most parts nothing else is lost with them


def scenes(blocks: Any) -> list[doc.Scene]:
    """The scenes of blocks, in order."""
    inner = [scenes(each.blocks) for each in blocks if isinstance(each, doc.Section)]
    return [each for each in blocks if isinstance(each, doc.Scene)] + [scene for each in inner for scene in each]


def test_each_figure_and_scene_that_fails_leaves_a_gap(written: Written) -> None:
    document = written.result.document()
    for picture in document.pictures:
        with pytest.warns(GapWarning, match=f"the figure '{picture.name}' is left out: RuntimeError"):
            assert "broken on purpose" in page._svg(replace(picture, draw=broken, chart=picture.chart and broken))
    for scene in scenes(document.blocks):
        alone = doc.Document("a scene", (replace(scene, make=broken),))
        with pytest.warns(GapWarning, match=f"the scene '{scene.name}' is left out: RuntimeError"):
            assert "broken on purpose" in page.to_html(alone)


@pytest.mark.parametrize("made", [lambda _: "a text", lambda _: None, broken], ids=["text", "nothing", "error"])
def test_a_section_of_an_extension_that_is_none_leaves_a_gap(
    made: Callable[[Any], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    import lab
    from lab.commands import sections

    result = lab.inspect("scara")
    monkeypatch.setattr(sections, "load_all", lambda _: {"mine": sections.AddedSection(Result, made)})
    with pytest.warns(GapWarning, match="the section of the extension 'mine' is left out"):
        assert "'mine' is left out" in result.summary()
