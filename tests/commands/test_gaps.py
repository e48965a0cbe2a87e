"""A drawing never destroys a result: with each drawing function broken in turn, numbers and exit code stay."""

import json
import os
import re
import subprocess
import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import wraps
from inspect import unwrap
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import pytest
from day_files import ur5e_urdf
from helpers.bad_input import run
from helpers.campaigns import run_of
from helpers.writing_commands import COMMANDS, STUDY

import lab
from lab.core.gaps import GapWarning, attempted
from lab.extension_points import load_reference
from lab.library.result import Result
from lab.report import document as doc
from lab.report import page
from lab.report.view import document_of, is_recorded, view_of

pytestmark = [pytest.mark.figures, pytest.mark.filterwarnings("always::lab.core.gaps.GapWarning")]

ALONE = {"calibrate", "design", "dynamics", "kinematics", "inspect", "reproduce", "workspace"}  # need no files
QUICK = {"calibrate", "kinematics"}
MORE = [pytest.param(name, marks=pytest.mark.thorough) for name in ("certify", "compensate")]
in_parts = pytest.mark.parametrize("written", [*sorted(QUICK), *MORE], indirect=True, scope="module")


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


def broken_like(function: Any) -> Any:
    """The function, guarded as before, with its inside broken."""
    if not hasattr(function, "__wrapped__"):
        return broken

    @wraps(function)
    def fails(*_: Any, **__: Any) -> Any:
        return broken()

    return doc.guarded(fails)


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
        patch.chdir(folder.parent if name in ALONE else request.getfixturevalue("command_inputs"))
        patch.setattr(Result, "draw", kept)
        patch.setattr("lab.report.view.load_reference", lambda _: broken)
        patch.setattr("lab.report.page.to_html", broken)
        patch.setattr("lab.report.terminal.print_document", broken)
        code = run(f"{COMMANDS[name]} --out {folder}")
    (result,) = results
    return Written(result, folder, code, "\n".join(str(each.message) for each in warned))


def test_numbers_and_exit_code_are_those_without_a_drawing(written: Written) -> None:
    assert written.code == written.result.exit_code
    assert json.loads((written.folder / "result.json").read_text())
    names = {path.name for path in written.folder.iterdir()}
    assert "SHA256SUMS" in names and not {"report.html", "recording.rrd"} & names
    for missing in ("report.html", "the summary", *(["recording.rrd"] * is_recorded(written.result))):
        assert f"{missing} is left out: RuntimeError: broken on purpose" in written.warned


def parts_of(result: Result) -> list[tuple[ModuleType, str]]:
    """The functions that the document's own function calls: module in which it finds them, and name there."""
    make = load_reference(view_of(type(result)).document)
    guards = {attempted.__code__, doc.guarded(parts_of).__code__}  # between a guarded function and its caller
    makers, found = {make.__code__}, list[tuple[ModuleType, str]]()

    def called(frame: Any, event: str, _: Any) -> None:
        above = frame.f_back
        while above is not None and (above.f_code.co_name.startswith("<") or above.f_code in guards):
            above = above.f_back
        if event != "call" or above is None or above.f_code not in makers:
            return
        for name, each in above.f_globals.items():
            if isinstance(each, FunctionType) and unwrap(each).__code__ is frame.f_code:
                if each.__annotations__.get("return") is doc.Document:
                    makers.add(frame.f_code)  # one of several documents
                else:
                    found.append((sys.modules[above.f_globals["__name__"]], name))

    sys.setprofile(called)
    try:
        make(result)
    finally:
        sys.setprofile(None)
    return list(dict.fromkeys(found))


@in_parts
def test_each_part_of_a_document_that_fails_leaves_a_gap(written: Written, monkeypatch: pytest.MonkeyPatch) -> None:
    result = written.result
    monkeypatch.setattr("lab.report.charts.chart.inline_svg", lambda picture: "")
    for module, name in parts_of(result):
        function = getattr(module, name)
        with monkeypatch.context() as patch, pytest.warns(GapWarning, match="broken on purpose"):
            patch.setattr(module, name, broken_like(function))
            shown, printed = page.to_html(document_of(result)), result.summary()
        assert "broken on purpose" in shown + printed, name  # some parts are of one medium alone
        assert ("the text is left out" in printed) != hasattr(function, "__wrapped__"), name


def scenes(blocks: Any) -> list[doc.Scene]:
    """The scenes of blocks, in order."""
    inner = [scenes(each.blocks) for each in blocks if isinstance(each, doc.Section)]
    return [each for each in blocks if isinstance(each, doc.Scene)] + [scene for each in inner for scene in each]


@in_parts
def test_each_figure_and_scene_that_fails_leaves_a_gap(written: Written) -> None:
    document = document_of(written.result)
    for picture in document.pictures:
        with pytest.warns(GapWarning, match=f"the figure '{picture.name}' is left out: RuntimeError"):
            assert "broken on purpose" in page._svg(replace(picture, draw=broken, chart=broken))
    for scene in scenes(document.blocks):
        alone = doc.Document("a scene", (replace(scene, make=broken),))
        with pytest.warns(GapWarning, match=f"the scene '{scene.name}' is left out: RuntimeError"):
            assert "broken on purpose" in page.to_html(alone)


@pytest.mark.parametrize("made", [lambda _: "a text", lambda _: None, broken], ids=["text", "nothing", "error"])
def test_a_section_of_another_type_is_left_out(made: Callable[[Any], Any], monkeypatch: pytest.MonkeyPatch) -> None:
    result = lab.inspect("scara")
    monkeypatch.setattr("lab.report.views.provenance.provenance_section", made)
    with pytest.warns(GapWarning, match="the section on what was done is left out"):
        assert "is left out" in result.summary()


def missing_meshes(folder: Path) -> str:
    """A maker's URDF without its files of shapes, a primitive at the tool."""
    text = ur5e_urdf(folder / "arm.urdf").read_text()
    assert run(f"calibrate --robot {folder}/arm.urdf --poses 30 --no-recording --out {folder}/day") == 0
    mesh = '<visual><geometry><mesh filename="package://arm/meshes/link.dae"/></geometry></visual>'
    ball = '<visual><geometry><sphere radius="0.01"/></geometry></visual>'
    text = re.sub(r"<collision>.*?</collision>", mesh, text, flags=re.DOTALL)
    (folder / "lite.urdf").write_text(text.replace('<link name="tool0"/>', f'<link name="tool0">{ball}</link>'))
    return f"identify {folder}/day/measurements.csv --robot {folder}/lite.urdf"


def denormal_points(folder: Path) -> str:
    """Points so near to zero that a scale by their size is infinite."""
    lines = (run_of(poses=30) / "measurements.csv").read_text().splitlines()
    rows = [",".join([*line.split(",")[:6], *["5e-324"] * 3]) for line in lines[1:]]
    (folder / "day.csv").write_text("\n".join([lines[0], *rows]) + "\n")
    return f"identify {folder}/day.csv"


def name_of_any_bytes(folder: Path) -> str:
    """A file whose name is no text in UTF-8."""
    path = os.fsencode(folder / "day") + b"\xff.csv"
    Path(os.fsdecode(path)).write_bytes((run_of(poses=30) / "measurements.csv").read_bytes())
    return f"identify {os.fsdecode(path)}"


@pytest.mark.thorough
@pytest.mark.parametrize("case", [missing_meshes, denormal_points, name_of_any_bytes])
def test_what_once_cost_an_identification_is_drawn_whole(case: Callable[[Path], str], tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", GapWarning)
        assert run(f"{case(tmp_path)} --out {tmp_path}/run") in (0, 1)
    names = {path.name for path in (tmp_path / "run").iterdir()}
    assert {"result.json", "calibrated.py", "report.html", "recording.rrd"} <= names
    assert lab.load_run(tmp_path / "run").estimate


WITHOUT = """
import sys
from importlib import metadata

for module in ("rerun", "matplotlib", "cv2", "sympy", "distributed", "trimesh"):
    sys.modules[module] = None  # as where it is not installed
version = metadata.version
metadata.version = lambda name: version("nothing-of-that-name" if name == "rerun-sdk" else name)
from lab.cli.main import main

for arguments in sys.argv[1:]:
    sys.argv[1:] = arguments.split()
    print("EXIT", main(), file=sys.stderr)
"""


@pytest.mark.thorough
def test_a_package_that_is_missing_is_said_in_one_line(tmp_path: Path) -> None:
    """Whatever can go on goes on; SOURCE_DATE_EPOCH, which ends numpy's import, is no date."""
    (tmp_path / "study.toml").write_text(STUDY)
    commands = {
        "calibrate --poses 30 --out run": (0, "recording.rrd is left out: it needs rerun, which is not installed"),
        "study study.toml --out study --workers 1": (0, r"virtual-calibration-lab\[plots\]"),
        "study study.toml --out other --scheduler tcp://127.0.0.1:1": (2, r"virtual-calibration-lab\[cluster\]"),
        "kinematics irb120 --symbolic --out letters": (2, r"virtual-calibration-lab\[symbolic\]"),
    }
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, *commands], cwd=tmp_path, capture_output=True, text=True, check=True,
        env=os.environ | {"SOURCE_DATE_EPOCH": "yesterday"},
    )  # fmt: skip
    parts = re.split(r"EXIT (\d+)\n", done.stderr)
    for (command, (code, said)), text, ended in zip(commands.items(), parts[::2], parts[1::2], strict=False):
        assert int(ended) == code and re.search(said, text), (command, text)
        assert all(line.startswith("lab: ") for line in text.splitlines()), text
    assert (tmp_path / "run" / "report.html").is_file() and (tmp_path / "study" / "report.html").is_file()
    assert not (tmp_path / "run" / "recording.rrd").exists()
