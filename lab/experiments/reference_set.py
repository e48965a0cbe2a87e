"""Do two checkouts give the same answers? Forty commands run with both, and every number and decision compared.

Each command runs in a process of its own, with either checkout as ``PYTHONPATH``. Commands that read measurements read
those that the first checkout simulated, so that both identify the same numbers.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lab.core.errors import LabError
from lab.experiments.script import Answer
from lab.render.document import Document, Paragraph

__all__ = ["COMMANDS", "Difference", "Options", "answer", "difference"]

_CALIBRATE: Mapping[str, str] = {
    "default": "",
    "thirty": "--seed 2 --poses 30",
    "targets": "--seed 3 --targets p1,p2,p3",
    "tx40": "--seed 4 --robot tx40",
    "rx130": "--seed 5 --robot rx130",
    "scara": "--seed 6 --robot scara",
    "scorbot": "--seed 7 --robot scorbot",
    "prior": "--seed 8 --prior",
    "sequential": "--seed 9 --method sequential --observe pose",
    "pose": "--seed 10 --observe pose",
    "cable": "--seed 11 --observe cable --prior",
    "socket": "--seed 12 --observe socket --prior",
    "plane": "--seed 13 --observe plane --prior",
    "bad": "--seed 14 --robust --bad-share 0.06 --bad-mm 1,5",
    "dh": "--seed 15 --dh-only",
    "tracker": "--seed 16 --instrument leica-at960",
    "hexapod": "--seed 17 --robot hexapod",
    "soft": "--seed 18 --payload-kg 0,3 --stiffness-nm-per-rad 20000 --model compliance",
    "shared": "--seed 19 --poses 80 --noise-correlation 0.8",
    "tails": "--seed 20 --noise-tail-dof 3",
    "backlash": "--seed 21 --backlash-mrad 0.3 --poses 80",
}
COMMANDS: Mapping[str, str] = {
    **{f"calibrate {name}": f"calibrate {words} --out {{own}}/{name}" for name, words in _CALIBRATE.items()},
    "identify": "identify {first}/default/measurements.csv",
    "identify, noise given": "identify {first}/default/measurements.csv --noise-mm 0.0046",
    "identify, prior": "identify {first}/default/measurements.csv --prior",
    "identify, fixed": "identify {first}/default/measurements.csv --fix link4.d",
    "identify, robust": "identify {first}/bad/measurements.csv --robust",
    "identify, auto": "identify {first}/thirty/measurements.csv --model auto",
    "identify, three targets": "identify {first}/targets/measurements.csv --instrument uniform-8um",
    "identify, poses": "identify {first}/pose/measurements.csv --observe pose",
    "identify, two sessions": "identify {data}/irb120_liaowu_calib36.csv --validate {data}/irb120_liaowu_test40.csv "
    "--refit tool",
    "identify, wire": "identify {data}/irb120_cable_robotcali_1042.csv --observe cable --prior",
    "identify, UR10": "identify {data}/ur10_ipa_D.csv --robot {data}/ur10.toml --holdout 0.3",
    "identify, sockets": "identify {data}/panda_sockets_mukca_3.csv --robot {data}/panda.toml --observe socket "
    "--socket-distance-mm 50 --prior",
    "inspect": "inspect irb120",
    "inspect, compliance": "inspect irb120 --model compliance+harmonics --fix link4.d",
    "kinematics": "kinematics irb120 --pose=302,0,558,0,90,0",
    "verify": "verify {own}/default {first}/thirty/measurements.csv --force",
    "certify": "certify {own}/default",
    "compare": "compare {own}/default {own}/dh --force",
    "design": "design --poses 12 --candidates 200",
}
_LEAST = 1e-9  # of a standard deviation: what the answers may differ by
_NOT_COMPARED = {"seconds", "iterations", "sha256", "version", "options", "date", "file", "run", "path", "out"}
_PROSE = {"words", "reason", "reasons", "warnings", "adequacy", "title", "description"}


@dataclass(frozen=True)
class Options:
    """What two checkouts are compared by.

    Attributes:
        before: root of the checkout whose answers are the reference.
        after: root of the other.
        folder: where the runs go; those that are there are read, not run again.
        data: the folder of measured arms.
        json: print one JSON object.
    """

    before: Path
    after: Path
    folder: Path
    data: Path
    json: bool = False


@dataclass(frozen=True)
class Difference:
    """How two answers of one command differ.

    Attributes:
        name: of the command.
        estimates: largest difference of a parameter over its standard deviation; NaN where there are none.
        intervals: the same of the ends of intervals.
        numbers: largest difference of any other number, relative to it.
        where: of that number.
        decisions: what is decided otherwise: place, before, after.
        words: places of sentences that changed.
    """

    name: str
    estimates: float
    intervals: float
    numbers: float
    where: str
    decisions: tuple[str, ...]
    words: tuple[str, ...]

    @property
    def same(self) -> bool:
        """Whether nothing is decided otherwise, and parameters and intervals are within 1e-9 of their sigma."""
        return not self.decisions and not bool(np.fmax(self.estimates, self.intervals) > _LEAST)


def difference(name: str, before: Mapping[str, Any], after: Mapping[str, Any]) -> Difference:
    """Compare two answers, each with ``result`` and ``parameters`` as the files of a run have them.

    What only one of them has, as a key that a later version added, is not compared.
    """
    estimates, intervals, decisions = np.nan, np.nan, []
    second = {row["name"]: row for row in after["parameters"]}
    for row in before["parameters"]:
        other = second.get(row["name"])
        if other is None or row["status"] != other["status"]:
            decisions.append(f"{row['name']}: {row['status']}, {other and other['status']}")
        elif row["std"]:
            estimates = np.fmax(estimates, _apart([row["estimate"]], [other["estimate"]]) / row["std"])
            intervals = np.fmax(intervals, _apart(row["interval_95"], other["interval_95"]) / row["std"])
    numbers, where, words = 0.0, "", []
    there = dict(_leaves(after["result"]))
    for place, value in _leaves(before["result"]):
        if place not in there or _NOT_COMPARED & set(place.split("/")):
            continue
        other = there[place]
        if isinstance(value, float) and isinstance(other, float):
            if (apart := abs(value - other) / max(abs(value), 1e-9)) > numbers:
                numbers, where = apart, place
        elif value != other and _PROSE & set(place.split("/")):
            words.append(place)
        elif value != other:
            decisions.append(f"{place}: {value}, {other}")
    return Difference(name, float(estimates), float(intervals), numbers, where, tuple(decisions), tuple(words))


def _apart(before: Sequence[float | None] | None, after: Sequence[float | None] | None) -> float:
    """Largest difference of numbers; infinite where there is one on one side alone."""
    pairs = zip(before or (), after or (), strict=False)
    if len(before or ()) != len(after or ()):
        return np.inf
    return max((0.0 if a == b else np.inf if a is None or b is None else abs(a - b) for a, b in pairs), default=0.0)


def _leaves(value: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Every number and word of an answer with its place, and how long each list is."""
    if isinstance(value, list):
        yield f"{place}/length", len(value)
    if isinstance(value, dict | list):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _leaves(part, f"{place}/{key}")
    else:
        yield place, value


def _run(root: Path, folder: Path, name: str, words: str) -> Mapping[str, Any]:
    """The answer of a command with a checkout: what is in its run, or what it printed."""
    own = folder / name.replace(", ", "-").replace(" ", "-")
    answered = own.with_suffix(".json")
    if not answered.exists():
        asked = words.split()
        if "--out" not in asked and asked[0] not in ("inspect", "kinematics"):
            asked += ["--out", str(own)]
        surroundings = os.environ | {"PYTHONPATH": str(root), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "lab", *asked, "--json"]
        done = subprocess.run(command, cwd=root, env=surroundings, capture_output=True, text=True)
        if not done.stdout:
            raise LabError(
                f"{' '.join(asked)} with {root}: {(done.stderr.strip().splitlines() or ['it said nothing'])[-1]}"
            )
        out = Path(asked[asked.index("--out") + 1]) if "--out" in asked else own
        parameters = out / "parameters.json"
        found = json.loads(parameters.read_text(encoding="utf-8")) if parameters.exists() else []
        answered.write_text(json.dumps({"result": json.loads(done.stdout), "parameters": found}), encoding="utf-8")
    answer: Mapping[str, Any] = json.loads(answered.read_text(encoding="utf-8"))
    return answer


def answer(options: Options) -> Answer:
    """Run the commands with both checkouts and compare.

    Raises:
        LabError: there is no lab in a checkout, or a command ends in an error.
    """
    for root in (options.before, options.after):
        if not (root / "lab" / "__main__.py").is_file():
            raise LabError(f"{root} is no checkout of the lab: it has no lab/__main__.py")
    first, second = options.folder.resolve() / "before", options.folder.resolve() / "after"
    for folder in (first, second):
        folder.mkdir(parents=True, exist_ok=True)
    found, lines = [], []
    for name, words in COMMANDS.items():
        each = []
        for root, own in ((options.before.resolve(), first), (options.after.resolve(), second)):
            each.append(_run(root, own, name, words.format(own=own, first=first, data=options.data.resolve())))
        made = difference(name, *each)
        found.append(made)
        lines.append(
            f"{name}: parameters {made.estimates:.1e} σ, intervals {made.intervals:.1e} σ, other numbers "
            f"{made.numbers:.1e} ({made.where}); {'; '.join(made.decisions) or 'every decision the same'}"
        )
    same = sum(each.same for each in found)
    title = f"{same} of {len(found)} commands give the same answers to {_LEAST:g} of a standard deviation"
    values = {each.name: vars(each) | {"same": each.same} for each in found}
    return Answer(values, Document(title, tuple(Paragraph(line) for line in lines)))
