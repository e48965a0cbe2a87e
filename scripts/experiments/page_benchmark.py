"""How long a page takes to be written, on one thread, and how large it is: small and large runs, a plan.

The first page of a process also loads what draws; the others are what each further page takes. Times are of the
processor, so that other work on the machine counts little; a page should take at most a second. With a scene in 3D a
page should stay below 2 MB, without one below 1 MB.
"""

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from shared import Answer, Document, Flag, Table, run_script

import lab
from lab.core.errors import LabError
from lab.library.result import Result
from lab.robots.load_robot import load_robot

LIMIT_S, LIMITS_MB = 1.0, {True: 2.0, False: 1.0}  # with a scene, without


@dataclass(frozen=True)
class Options:
    """What to time."""

    times: int = 5
    """How often each page is written after its first time."""
    json: Flag = False
    """Print one JSON object."""


def measured(name: str) -> Path:
    """A file of the UR10's measurements, beside its model."""
    return load_robot("ur10").model.path.parent / "measured" / name


PAGES: dict[str, Callable[[], Result]] = {
    "irb120, 50 poses": lambda: lab.calibrate("irb120", poses=50, seed=7),
    "UR10, 442 poses, chosen effects": lambda: lab.identify(
        measured("ur10_ipa_D.csv"), robot="ur10", holdout=0.3, model="auto"
    ),
    "UR10, 2,773 poses": lambda: lab.identify(measured("ur10_ipa_C.csv"), robot="ur10", holdout=0.3),
    "plan of 20 poses": lambda: lab.design("irb120", poses=20, candidates=200, starts=1),
    "inspect irb120": lambda: lab.inspect("irb120"),
}


def answer(options: Options) -> Answer:
    """Time the pages and weigh them."""
    if options.times < 1:
        raise LabError(f"--times {options.times}: write each page at least once more")
    values, rows = {}, []
    with tempfile.TemporaryDirectory() as folder:
        for name, make in PAGES.items():
            result, path, seconds = make(), Path(folder) / "report.html", []
            for _ in range(1 + options.times):
                start = time.process_time()
                result.report(path)
                seconds.append(time.process_time() - start)
            text = path.read_text(encoding="utf-8")
            scene, size = '<figure id="' in text and 'class="scene' in text, path.stat().st_size / 1e6
            within = max(seconds) <= LIMIT_S and size < LIMITS_MB[scene]
            later = median(seconds[1:])
            values[name] = {
                "first_s": seconds[0], "later_s": later, "size_mb": size, "scene": scene, "within_limits": within,
            }  # fmt: skip
            rows.append((name, f"{seconds[0]:.2f}", f"{later:.2f}", f"{size:.2f}", "yes" if scene else "no",
                         "yes" if within else "no"))  # fmt: skip
    columns = ("page", "first, s", "later, s", "size, MB", "3D", "within limits")
    return Answer(values, Document("Pages", (Table(columns, tuple(rows)),)))


if __name__ == "__main__":
    run_script("page_benchmark")
