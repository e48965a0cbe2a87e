"""The pictures of recordings in README and pages, made again: each from the command beside it.

A picture keeps the command and the headline of its result in its file; a test compares it with what the command prints.
The viewer draws without a window, which needs a Vulkan driver; one that draws by software will do.
"""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from lab.core.errors import LabError
from lab.experiments.script import Answer, paragraphs
from lab.render.document import Document

__all__ = ["PICTURES", "Options", "Shown", "answer", "draw_recording", "headline_of"]

_SIZE: Final = (1600, 900)
_BAR: Final = 37  # rows of the viewer's menu, which is no part of the recording
_OPENS_S, _SETTLES_S = 60.0, 6.0  # how long the viewer may take to open, and to draw once it is there
_QUIET: Final = {"RUST_LOG": "off", "RERUN_ANALYTICS": "0"}


@dataclass(frozen=True)
class Shown:
    """What a picture shows: a command's recording, at a moment of its timeline ``time`` (s)."""

    command: str
    seconds: float


PICTURES: Final[Mapping[str, Shown]] = {
    "first_calibration.png": Shown("lab calibrate", 9.0),
    "delta.png": Shown("lab calibrate --robot delta", 3.5),
}


@dataclass(frozen=True)
class Options:
    """Which pictures to make, and where."""

    out: Path = Path("docs/pictures")
    """The folder that they are written to."""
    only: tuple[str, ...] = tuple(PICTURES)
    """Their names."""
    json: bool = False
    """Print one JSON object."""


def answer(options: Options) -> Answer:
    """Run each command, open its recording, keep what it shows.

    Raises:
        LabError: a name is none of the pictures, the folder is missing, a command fails, or the viewer cannot draw
            here.
    """
    if not options.out.is_dir():
        raise LabError(f"{options.out}: is no folder; give --out the one of the pictures")
    made = {}
    for name in options.only:
        if name not in PICTURES:
            raise LabError(f"there is no picture '{name}'; there are {', '.join(PICTURES)}")
        shown = PICTURES[name]
        with TemporaryDirectory() as folder:
            run = Path(folder) / "run"
            command = [sys.executable, "-m", "lab", *shown.command.split()[1:], "--out", str(run)]
            done = subprocess.run(command, capture_output=True, encoding="utf-8", env=os.environ | {"PYTHONUTF8": "1"})
            if not (run / "recording.rrd").is_file():
                raise LabError(f"{shown.command}: wrote no recording ({done.stderr.strip()})")
            headline = headline_of(done.stdout)
            about = {"Title": headline, "Description": shown.command}
            draw_recording(run / "recording.rrd", shown.seconds, options.out / name, about)
        made[name] = headline
    lines = [f"{name}: {headline}" for name, headline in made.items()]
    return Answer(made, Document("Pictures of recordings", paragraphs(lines)))


def headline_of(printed: str) -> str:
    """The first line that a command prints."""
    return next(line.strip() for line in printed.splitlines() if line.strip())


def draw_recording(recording: Path, seconds: float, picture: Path, about: Mapping[str, str]) -> None:
    """Open a recording in a viewer without a window, go to a moment of its timeline ``time``, and keep what it shows.

    Args:
        about: words that are kept in the picture's file, by their PNG keywords.

    Raises:
        LabError: the viewer does not draw here.
    """
    import matplotlib.image as images
    import rerun_cli  # type: ignore[import-untyped]
    from rerun.experimental import ViewerClient

    program = Path(rerun_cli.__file__).parent / ("rerun.exe" if sys.platform == "win32" else "rerun")
    port, size = _free_port(), "x".join(map(str, _SIZE))
    flags = ["--headless", "--bind", "127.0.0.1", "--port", str(port), "--hide-welcome-screen", "--window-size", size]
    silent = subprocess.DEVNULL
    viewer = subprocess.Popen([str(program), *flags], env=os.environ | _QUIET, stdout=silent, stderr=silent)
    try:
        client, until = None, time.monotonic() + _OPENS_S
        while client is None:
            try:
                client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            except Exception as error:
                if viewer.poll() is not None or time.monotonic() > until:
                    raise LabError(f"{recording}: the viewer does not open ({error}); it needs Vulkan") from error
                time.sleep(0.5)
        with client:
            client.open(str(recording))
            client.set_time("time", duration=seconds)
            time.sleep(_SETTLES_S)
            client.save_screenshot(str(picture))
    finally:
        viewer.terminate()
        viewer.wait(10)
    images.imsave(picture, images.imread(picture)[_BAR:, :, :3].copy(order="C"), metadata=dict(about))


def _free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])
