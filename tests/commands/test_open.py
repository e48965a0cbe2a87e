"""``lab open``: the page in the browser, the recording in the viewer, and a line where neither is there."""

import json
import subprocess
import sys
import webbrowser
from pathlib import Path
from typing import Any

import pytest

from lab.cli import main
from lab.commands.open import open_run
from lab.commands.options import OpenOptions
from lab.core.errors import LabError


@pytest.fixture
def run(tmp_path: Path) -> Path:
    folder = tmp_path / "a run"
    folder.mkdir()
    (folder / "report.html").write_text("<p>page</p>")
    (folder / "recording.rrd").write_bytes(b"recording")
    return folder


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    found = list[str]()

    def browser(address: str) -> bool:
        found.append(address)
        return True

    monkeypatch.setattr(webbrowser, "open", browser)
    return found


def test_the_page_is_opened(run: Path, opened: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["open", str(run), "--json"]) == 0
    assert opened == [(run / "report.html").as_uri()] and "%20" in opened[0]
    assert json.loads(capsys.readouterr().out) == {"opened": str(run / "report.html")}
    assert main(["open", str(run)]) == 0
    assert "Opened in the browser" in capsys.readouterr().out


@pytest.mark.parametrize(("name", "flags"), [("report.html", []), ("recording.rrd", ["--viewer"])])
def test_a_folder_without_the_file_is_reported_in_one_line(
    name: str, flags: list[str], run: Path, opened: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    (run / name).unlink()
    for folder in (run, run / "nowhere"):
        assert main(["open", str(folder), *flags]) == 2
        said = capsys.readouterr().err
        assert f"{folder}: holds no {name}" in said and said.count("\n") == 1
    assert opened == []


def test_a_machine_without_a_browser_is_told_the_file(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(webbrowser, "open", lambda address: False)
    with pytest.raises(LabError, match=r"report\.html: no browser was found"):
        open_run(OpenOptions(run))


class _Viewer:
    """A viewer that runs on, or ends at once."""

    def __init__(self, code: int | None) -> None:
        self.code = code
        self.started = list[list[str]]()

    def __call__(self, arguments: list[str], **_: Any) -> "_Viewer":
        self.started.append(arguments)
        return self

    def wait(self, timeout: float) -> int:
        if self.code is None:
            raise subprocess.TimeoutExpired("viewer", timeout)
        return self.code


@pytest.fixture
def display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":0")


@pytest.mark.usefixtures("display")
@pytest.mark.parametrize("code", [None, 0])
def test_the_recording_is_shown_by_the_viewer(
    code: int | None, run: Path, opened: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(subprocess, "Popen", viewer := _Viewer(code))
    found = open_run(OpenOptions(run, viewer=True))
    assert viewer.started == [[sys.executable, "-m", "rerun", str(run / "recording.rrd")]]
    assert found.file == run / "recording.rrd" and opened == []


@pytest.mark.skipif(sys.platform != "linux", reason="other systems always have a display")
def test_without_a_display_no_viewer_is_started(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(subprocess, "Popen", viewer := _Viewer(0))
    with pytest.raises(LabError, match="there is no display; run rerun --web-viewer"):
        open_run(OpenOptions(run, viewer=True))
    assert viewer.started == []


@pytest.mark.usefixtures("display")
def test_a_viewer_that_cannot_start_is_an_error(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subprocess, "Popen", _Viewer(1))
    with pytest.raises(LabError, match="the viewer ended with exit code 1"):
        open_run(OpenOptions(run, viewer=True))
