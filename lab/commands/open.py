"""Open a run's page in the browser, or its recording in the viewer."""

import os
import subprocess
import sys
import webbrowser
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lab.commands.options import OpenOptions
from lab.commands.result import Result
from lab.core.errors import LabError
from lab.render.document import Document, Paragraph

__all__ = ["OpenResult", "open_run"]

_PAGE, _RECORDING = "report.html", "recording.rrd"
_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")  # one of which a window needs on Linux
_STARTED_S = 3.0  # a viewer that runs for so long has opened its window


@dataclass(frozen=True, repr=False, eq=False)
class OpenResult(Result):
    """The file that was opened."""

    command = "open"
    shown_by = "lab.commands.open:_document"
    warnings = ()

    options: OpenOptions
    file: Path

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints."""
        return {"opened": str(self.file)}

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for the file."""
        return {"opened": [str(self.file)]}


def _document(result: OpenResult) -> Document:
    where = "the viewer" if result.options.viewer else "the browser"
    return Document(f"Opened in {where}", (Paragraph(str(result.file)),))


def open_run(options: OpenOptions) -> OpenResult:
    """Open the page of a run, or its recording.

    Raises:
        LabError: the folder has no such file, or there is no browser or display.
    """
    name = _RECORDING if options.viewer else _PAGE
    file = options.run / name
    if not file.is_file():
        fix = "make the run without --no-recording" if options.viewer else "give the folder of a run"
        raise LabError(f"{options.run}: holds no {name}; {fix}")
    if options.viewer:
        _view(file)
    elif not webbrowser.open(file.resolve().as_uri()):
        raise LabError(f"{file}: no browser was found; set BROWSER to one, or open the file elsewhere")
    return OpenResult(options, file)


def _view(recording: Path) -> None:
    """Start the viewer, which goes on when the command has ended."""
    if sys.platform == "linux" and not any(map(os.environ.get, _DISPLAYS)):
        raise LabError(f"{recording}: there is no display; run rerun --web-viewer {recording}, or copy it elsewhere")
    quiet = subprocess.DEVNULL
    viewer = subprocess.Popen(
        [sys.executable, "-m", "rerun", str(recording.resolve())],
        stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True,
    )  # fmt: skip
    try:
        code = viewer.wait(_STARTED_S)
    except subprocess.TimeoutExpired:
        return
    if code:
        raise LabError(f"{recording}: the viewer ended with exit code {code}; run rerun {recording} to see why")
