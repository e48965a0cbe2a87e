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

from shared import Answer, Document, paragraphs, run_script

from lab.core.errors import LabError

_SIZE: Final = (1600, 900)
_BAR: Final = 37  # rows of the viewer's menu, which is no part of the recording
_OPENS_S, _SETTLES_S = 60.0, 6.0  # how long the viewer may take to open, and to draw once it is there
_QUIET: Final = {"RUST_LOG": "off", "RERUN_ANALYTICS": "0"}


@dataclass(frozen=True)
class Shown:
    """What a picture shows: the recording of a command or a script, at a moment.

    Attributes:
        command: as it is typed, but for ``--out``.
        moment: s on the recording's timeline ``time``, or a whole number on its timeline ``step``.
        line: of what the command prints, the one that is kept with the picture, from 0.
    """

    command: str
    moment: float | int
    line: int = 0

    def record(self, folder: Path) -> tuple[Path, str]:
        """Run the command: its recording, and the line that it prints.

        Raises:
            LabError: it wrote no recording.
        """
        program, *arguments = self.command.split()
        recording = folder / "run" / "recording.rrd"
        if program == "lab":
            whole = [sys.executable, "-m", "lab", *arguments, "--out", str(recording.parent)]
        else:
            recording.parent.mkdir()
            whole = [sys.executable, *arguments, "--out", str(recording)]
        done = subprocess.run(whole, capture_output=True, encoding="utf-8", env=os.environ | {"PYTHONUTF8": "1"})
        if not recording.is_file():
            raise LabError(f"{self.command}: wrote no recording ({done.stderr.strip()})")
        return recording, [line.strip() for line in done.stdout.splitlines() if line.strip()][self.line]


PICTURES: Final[Mapping[str, Shown]] = {
    "first_calibration.png": Shown("lab calibrate", 9.0),
    "delta.png": Shown("lab calibrate --robot delta", 3.5),
    "effects_found.png": Shown(
        "lab calibrate --poses 80 --stiffness-nm-per-rad 1e5 --harmonic-mrad 0.2 --payload-kg 0,3 --model auto "
        "--bad-share 0.05 --robust",
        14.0,
    ),
    "closed_loop.png": Shown("python scripts/experiments/closed_loop.py --arms 1", 60, line=3),
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
            recording, headline = shown.record(Path(folder))
            about = {"Title": headline, "Description": shown.command}
            draw_recording(recording, shown.moment, options.out / name, about)
        made[name] = headline
    lines = [f"{name}: {headline}" for name, headline in made.items()]
    return Answer(made, Document("Pictures of recordings", paragraphs(lines)))


def draw_recording(recording: Path, moment: float | int, picture: Path, about: Mapping[str, str]) -> None:
    """Open a recording in a viewer without a window, go to a moment, and keep what it shows.

    Args:
        moment: s on the timeline ``time``, or a whole number on ``step``.
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
            if isinstance(moment, int):
                client.set_time("step", sequence=moment)
            else:
                client.set_time("time", duration=moment)
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


if __name__ == "__main__":
    run_script("recording_pictures")
