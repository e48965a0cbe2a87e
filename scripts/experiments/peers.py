"""Compare the lab with other packages: each in an environment and a process of its own, in interleaved rounds.

The packages are installed by pip into one environment each, below a folder that is kept for the next run. In every
round each measurement is taken by all packages, one after the other on one thread, the first in turn; a ratio compares
processor times of one round. The answers are compared, too. What cannot be installed is reported, and left out.
"""

import ast
import json
import os
import platform
import selectors
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from shared import Answer, Document, Flag, Section, Table, paragraphs, processor, run_script, short

import lab
from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.gauge import base_set
from lab.kinematics.serial.serial_arm import SerialArm
from lab.pose_selection.certificate import DesignCertificate, certify, d_value

ROOT = Path(__file__).parents[2]
FOLDER = Path(__file__).with_name("peers")
STORED = ROOT / "docs" / "results" / "stored" / "peers.json"
TABLE = [[0, 290, 0, -90], [-90, 0, 270, 0], [0, 0, 70, -90], [0, 302, 0, 90], [0, 0, 0, -90], [180, 72, 0, 0]]
TARGET = [60, 0, 40]
JOBS = ("fit", "own_residual", "study")
TOPICS = {
    "identify": "Identification: 60 poses, base and target unknown",
    "kinematics": "Kinematics of one target",
    "select": "Selection: 30 poses of the same 300 candidates",
    "inverse": "Inverse kinematics",
    "jobs": "Three jobs, as short as we could write them",
}
SLOW_S, SLOW_ROUNDS = 3.0, 2  # a measurement that takes longer is taken in fewer rounds
INSTALL_S, REQUEST_S = 900, 600
POOL, COUNT, FEW = 300, 30, 20
COUNTS = (1, 50, 1000, 100_000)  # of poses in one call
SAME_M = 1e-6  # answers that differ by less agree
SOLVED_M, SOLVED_RAD = 1e-5, 1e-5  # a solution meets its pose


@dataclass(frozen=True)
class Tool:
    """A package.

    Attributes:
        name: as a reader knows it.
        packages: what pip installs; nothing for the lab, which runs as it is.
        versions: the distributions whose versions are recorded.
        settings: files that one writes for its jobs, besides the script.
    """

    name: str
    packages: tuple[str, ...]
    versions: tuple[str, ...]
    settings: tuple[str, ...] = ()


TOOLS = {
    "lab": Tool("lab", (), ("virtual-calibration-lab", "numpy", "scipy")),
    "pybotics": Tool("pybotics", ("pybotics",), ("pybotics", "numpy", "scipy")),
    "figaroh": Tool("FIGAROH", ("figaroh",), ("figaroh", "pin", "numpy", "scipy"), ("figaroh.yaml",)),
    "mujoco": Tool("MuJoCo", ("mujoco", "scipy"), ("mujoco", "numpy")),
    "scipy": Tool("scipy", ("scipy",), ("scipy", "numpy")),
    "pinocchio": Tool("Pinocchio", ("pin",), ("pin", "numpy")),
    "eaik": Tool("EAIK", ("EAIK",), ("EAIK", "numpy")),
}


@dataclass(frozen=True)
class Options:
    """What to compare, how often, and where the environments are."""

    only: tuple[str, ...] = ()
    """Tools, topics, or pairs such as `pybotics/inverse`; all by default. The lab always runs beside them."""
    rounds: int = 5
    """Interleaved rounds."""
    folder: Path = Path("build/peers")
    """Folder of the environments, kept for another run."""
    write: Flag = False
    """Store the result, which the page docs/results/peers.md shows."""
    json: Flag = False
    """Print one JSON object."""


def wanted(only: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return the topics of each tool.

    Raises:
        LabError: an entry is no tool, topic or pair of them.
    """
    found: dict[str, set[str]] = {}
    for entry in only or list(TOOLS):
        tool, _, topic = entry.partition("/")
        if entry in TOPICS:
            tool, topic = "", entry
        known = (not tool or tool in TOOLS) and (not topic or topic in TOPICS)
        if not known or not entry.strip("/") == entry or not entry:
            raise LabError(
                f"--only {entry}: give a tool ({', '.join(TOOLS)}), a topic ({', '.join(TOPICS)}), "
                "or a pair such as pybotics/inverse"
            )
        for each in [tool] if tool else TOOLS:
            found.setdefault(each, set()).update([topic] if topic else TOPICS)
    found["lab"] = set().union(*found.values())  # it runs beside all others
    return {tool: tuple(topic for topic in TOPICS if topic in found[tool]) for tool in TOOLS if tool in found}


# Lines of the jobs


def lines_of(source: str, job: str) -> int:
    """Return the lines of code of a job: its own, and those of what it uses of its module.

    Blank lines, comments, docstrings and imports are not counted.
    """
    parts = dict(_parts(ast.parse(source)))
    used, waiting = set[str](), [job]
    while waiting:
        name = waiting.pop()
        if name in parts and name not in used:
            used.add(name)
            waiting += [each.id for each in ast.walk(parts[name]) if isinstance(each, ast.Name)]
    lines = set[int]()
    for name in used:
        lines |= _code(parts[name])
    return len(lines)


def _parts(module: ast.Module) -> Iterator[tuple[str, ast.stmt]]:
    """Yield the functions, classes and constants of a module by name."""
    for each in module.body:
        if isinstance(each, ast.FunctionDef | ast.ClassDef):
            yield each.name, each
        elif isinstance(each, ast.Assign) and isinstance(each.targets[0], ast.Name):
            yield each.targets[0].id, each


def _code(part: ast.stmt) -> set[int]:
    """Return the numbers of the lines of a part that hold code."""
    found = {
        line
        for each in ast.walk(part)
        if isinstance(each, ast.expr | ast.stmt | ast.arg | ast.keyword)
        for line in (each.lineno, each.end_lineno or each.lineno)
    }
    for each in ast.walk(part):
        if isinstance(each, ast.FunctionDef | ast.ClassDef) and ast.get_docstring(each) is not None:
            text = each.body[0]
            found -= set(range(text.lineno, (text.end_lineno or text.lineno) + 1))
    ends = {each.end_lineno for each in ast.walk(part) if isinstance(each, ast.FunctionDef | ast.ClassDef)}
    return found | {line for line in ends if line is not None}


def counted() -> dict[str, dict[str, int]]:
    """Return the lines of each job of each tool that does the jobs."""
    found = {}
    for tool, about in TOOLS.items():
        source = (FOLDER / f"{tool}_jobs.py").read_text(encoding="utf-8")
        more = sum(len((FOLDER / name).read_text(encoding="utf-8").split("\n")) - 1 for name in about.settings)
        if "def fit(" in source:
            found[tool] = {job: lines_of(source, job) + more for job in JOBS}
    return found


# Environments and processes


def environment(tool: str, folder: Path) -> Path:
    """Return the Python of a tool's environment, installed if it is not there yet.

    Raises:
        LabError: it cannot be installed.
    """
    if not TOOLS[tool].packages:
        return Path(sys.executable)
    place = folder.resolve() / tool
    python, done = place / ("Scripts" if os.name == "nt" else "bin") / "python", place / "installed"
    if done.is_file() and python.exists():
        return python
    print(f"installing {', '.join(TOOLS[tool].packages)} into {place}", file=sys.stderr)
    for command in (
        [sys.executable, "-m", "venv", "--clear", str(place)],
        [str(python), "-m", "pip", "install", "--quiet", *TOOLS[tool].packages],
    ):
        try:
            subprocess.run(command, check=True, capture_output=True, text=True, timeout=INSTALL_S, env=_variables())
        except subprocess.TimeoutExpired as error:
            raise LabError(f"not installed within {INSTALL_S} s") from error
        except (subprocess.CalledProcessError, OSError) as error:
            raise LabError(f"not installed: {_reason(getattr(error, 'stderr', '') or str(error))}") from error
    done.write_text("\n".join(TOOLS[tool].packages) + "\n", encoding="utf-8")
    return python


def _variables() -> dict[str, str]:
    """Return the environment variables of one thread, without this process's own modules."""
    mine = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    threads = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
    return mine | dict.fromkeys(threads, "1")


def _reason(text: str) -> str:
    """Return the line of a long message that tells most: the last error, else the last line."""
    lines = [line.strip() for line in text.splitlines() if line.strip()] or ["no reason was given"]
    return next((line for line in reversed(lines) if "error" in line.lower()), lines[-1])[:200]


class Worker:
    """A process of a tool, which answers requests."""

    def __init__(self, tool: str, python: Path, folder: Path, limit_s: float = REQUEST_S) -> None:
        self.tool, self.limit_s, own = tool, limit_s, folder / tool
        own.mkdir()
        self.errors = (own / "errors.txt").open("w+", encoding="utf-8")
        path = {"PYTHONPATH": str(ROOT)} if tool == "lab" else {}
        self.process = subprocess.Popen(
            [str(python), str(FOLDER / f"{tool}_jobs.py"), str(folder / "arrays.npz")],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.errors, cwd=own, env=_variables() | path,
        )  # fmt: skip

    def ask(self, **request: str) -> dict[str, Any]:
        """Return the reply to a request.

        Raises:
            LabError: the package failed, ended, or took too long.
        """
        assert self.process.stdin is not None and self.process.stdout is not None
        try:
            self.process.stdin.write((json.dumps(request) + "\n").encode())
            self.process.stdin.flush()
        except BrokenPipeError as error:
            raise LabError(f"ended: {self._last()}") from error
        with selectors.DefaultSelector() as waiting:
            waiting.register(self.process.stdout, selectors.EVENT_READ)
            if not waiting.select(self.limit_s):
                self.process.kill()
                raise LabError(f"no result within {self.limit_s:g} s")
        line = self.process.stdout.readline()
        if not line:
            raise LabError(f"ended: {self._last()}")
        reply: dict[str, Any] = json.loads(line)
        if "error" in reply:
            raise LabError(reply["error"])
        return reply

    def _last(self) -> str:
        self.process.wait(10)
        self.errors.seek(0)
        return _reason(self.errors.read())

    def close(self) -> None:
        """End the process."""
        if self.process.stdin is not None and not self.process.stdin.closed:
            with suppress(BrokenPipeError):
                self.process.stdin.close()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        if self.process.stdout is not None:
            self.process.stdout.close()
        self.errors.close()


def versions(tool: str, python: Path) -> dict[str, str]:
    """Return the versions of a tool and of what it computes with."""
    names = TOOLS[tool].versions
    about = f"import importlib.metadata as m, json; print(json.dumps({{n: m.version(n) for n in {names!r}}}))"
    done = subprocess.run([str(python), "-c", about], capture_output=True, text=True, check=True, env=_variables())
    found: dict[str, str] = json.loads(done.stdout)
    return found


# The problems


@dataclass(frozen=True)
class Problems:
    """What all tools are given, and by which their answers are compared.

    Attributes:
        arm: the nominal arm.
        nominal: its parameters.
        arrays: joints, measured points, candidates' derivatives, poses.
        bound: of the selection.
    """

    arm: SerialArm
    nominal: Array
    arrays: Mapping[str, Array]
    bound: DesignCertificate


def prepare(folder: Path) -> Problems:
    """Write the arrays of a simulated session, and the nominal robot as TOML, MJCF and URDF."""
    robot = lab.robot_from_dh(TABLE, unit="mm", joint_unit="deg", tool={"p1": TARGET}, path=folder / "arm.toml")
    day = lab.simulate(robot, poses=60, seed=7)
    fresh, rows = day.validation, day.measurements
    session = {
        "joints": rows.joints, "points": rows.points[:, 0],
        "new_joints": fresh.joints, "new_points": fresh.points[:, 0],
    }  # fmt: skip
    np.savez(folder / "arrays.npz", allow_pickle=False, **session)
    for kind in ("xml", "urdf"):
        text = robot.description(f"calibrated.{kind}", ("p1",), robot.parameter_values())
        (folder / f"arm.{kind}").write_text(text, encoding="utf-8")
    arm = robot.serial_arm(("p1",))
    nominal, rng = arm.nominal(robot.tool), np.random.default_rng(7)
    pool = arm.observe(rng.uniform(-2, 2, (POOL, 6)), nominal)[1][:, 0][:, :, list(base_set(arm, nominal).identifiable)]
    pool = pool / np.linalg.norm(pool, axis=(0, 1))
    there = rng.uniform(-2, 2, (COUNTS[-1], 6))
    many = np.concatenate([fresh.joints, rng.uniform(-2, 2, (COUNTS[-1] - len(fresh.joints), 6))])
    arrays = session | {
        "table": np.array(TABLE) * [np.pi / 180, 1e-3, 1e-3, np.pi / 180],
        "target": np.array(TARGET) / 1e3,
        "pool": pool, "count": np.array(COUNT), "few": np.array(FEW),
        "counts": np.array(COUNTS), "many": many, "T_last_p1": se3.pose(np.eye(3), np.array(TARGET) / 1e3),
        "poses": arm.flange(there, nominal), "near": there[:FEW] + rng.uniform(-0.3, 0.3, (FEW, 6)),
    }  # fmt: skip
    np.savez(folder / "measures.npz", allow_pickle=False, **arrays)
    return Problems(arm, nominal, arrays, certify(pool))


def judged(problems: Problems, topic: str, measure: str, answer: Array, of_the_lab: Array | None) -> dict[str, Any]:
    """Return how good an answer is, and how far it is from the lab's.

    The value ``agrees`` is missing where there is nothing to agree on.
    """
    given, arm = problems.arrays, problems.arm
    if topic == "identify":
        found: dict[str, Any] = {"held_out_mm": _mean_mm(answer - given["new_points"])}
        if of_the_lab is not None:
            found["from_lab_um"] = 1e6 * float(np.linalg.norm(answer - of_the_lab, axis=1).max())
            found["agrees"] = found["from_lab_um"] < 1e6 * SAME_M
        return found
    if topic == "kinematics" and of_the_lab is not None:
        if measure.startswith("parameter"):
            missed = _unexplained(of_the_lab, answer) if len(answer) * 3 >= 2 * answer.shape[2] else None
        else:
            missed = float(np.abs(answer - of_the_lab).max())
        return {} if missed is None else {"from_lab": missed, "agrees": missed < SAME_M}
    if topic == "select":
        rows = answer.astype(int)
        whole = len(set(rows.tolist())) == len(rows) == COUNT and set(rows.tolist()) <= set(range(POOL))
        found = {
            "of_bound": problems.bound.efficiency(d_value(given["pool"][rows]), len(rows)) if whole else 0.0,
            "agrees": whole,
        }
        if of_the_lab is not None:
            found["in_common"] = len(set(rows.tolist()) & set(of_the_lab.astype(int).tolist()))
        return found
    if topic == "inverse":
        return _solved(arm, problems.nominal, given["poses"][: len(answer)], answer)
    return {}


def _mean_mm(difference: Array) -> float:
    return 1e3 * float(np.linalg.norm(difference, axis=1).mean())


def _unexplained(wanted: Array, given: Array) -> float:
    """Return the share of derivatives that lies outside the space of others: 0 if those describe the same changes."""
    A, B = given.reshape(-1, given.shape[-1]), wanted.reshape(-1, wanted.shape[-1])
    left = B - A @ np.linalg.lstsq(A, B, rcond=1e-10)[0]
    return float(np.linalg.norm(left) / np.linalg.norm(B))


def _solved(arm: SerialArm, nominal: Array, Ts: Array, answer: Array) -> dict[str, Any]:
    """Return how many solutions meet their poses, and the largest errors of those that do."""
    n, k, size = answer.shape
    rows = answer.reshape(-1, size)
    there = np.isfinite(rows).all(axis=1, keepdims=True)
    reached = arm.flange(np.where(there, rows, 0.0), nominal).reshape(n, k, 4, 4)
    off = np.linalg.norm(reached[..., :3, 3] - Ts[:, None, :3, 3], axis=2)
    turn = np.swapaxes(Ts[:, None, :3, :3], 2, 3) @ reached[..., :3, :3]
    skew = turn - np.swapaxes(turn, 2, 3)
    turned = np.arctan2(
        np.linalg.norm(skew, axis=(2, 3)) / np.sqrt(2), np.trace(turn, axis1=2, axis2=3) - 1
    )  # 2 sin, 2 cos of the angle
    good: NDArray[np.bool_] = np.asarray(there.reshape(n, k) & (off < SOLVED_M) & (turned < SOLVED_RAD))
    return {
        "solved": float(good.any(axis=1).mean()),
        "solutions": float(good.sum(axis=1).mean()),
        "largest_m": float(off[good].max()) if good.any() else None,
        "largest_rad": float(turned[good].max()) if good.any() else None,
        "agrees": bool(good.any(axis=1).all()),
    }


# Rounds


@dataclass
class _Series:
    """Seconds of one measurement of one tool, by round, with the judgement of its answer."""

    seconds: dict[int, float] = field(default_factory=dict)
    judgement: dict[str, Any] = field(default_factory=dict)


def measured(
    workers: Mapping[str, Worker], topics: Mapping[str, tuple[str, ...]], problems: Problems, folder: Path, rounds: int
) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """Take all measurements in interleaved rounds; return a row for each, and why tools failed."""
    failed: dict[str, str] = {}
    plan: dict[tuple[str, str], list[str]] = {}  # tools by topic and measurement, the lab first
    for tool, worker in workers.items():
        for topic in topics[tool]:
            try:
                for measure in worker.ask(work=topic)["measures"] if topic != "jobs" else ():
                    plan.setdefault((topic, measure), []).append(tool)
            except LabError as error:
                failed[f"{tool}/{topic}"] = str(error)
    found: dict[tuple[str, str, str], _Series] = {}
    for number in range(rounds):
        for (topic, measure), tools in plan.items():
            first = number % len(tools)
            for tool in tools[first:] + tools[:first]:
                _take(workers[tool], (topic, measure), number, found, failed)
    rows = []
    for (topic, measure), tools in sorted(plan.items(), key=lambda each: list(TOPICS).index(each[0][0])):
        own = _counterpart(found, topic, measure)
        for tool in tools:
            series = found.get((topic, measure, tool))
            if series is None or not series.seconds:
                continue
            answer = np.load(folder / _answer_name(tool, topic, measure))
            with_lab = None if tool == "lab" or own is None else np.load(folder / _answer_name("lab", topic, own))
            row = {"topic": topic, "measure": measure, "tool": tool, "rounds": len(series.seconds)}
            row |= {"seconds": median(series.seconds.values())}
            if own is not None and (tool != "lab" or own != measure):
                beside = found[topic, own, "lab"].seconds
                ratios = [s / beside[r] for r, s in series.seconds.items() if r in beside]
                row |= {"ratio": median(ratios), "ratio_least": min(ratios), "ratio_most": max(ratios)}
            rows.append(row | judged(problems, topic, measure, answer, with_lab))
    return rows, failed


def _counterpart(found: Mapping[tuple[str, str, str], _Series], topic: str, measure: str) -> str | None:
    """Return the lab's measurement to compare with: the same, or the one of which it is a variant."""
    names = (measure, measure.partition(", ")[0])
    return next((name for name in names if (topic, name, "lab") in found), None)


def _answer_name(tool: str, topic: str, measure: str) -> str:
    return f"{tool} {topic} {measure}.npy"


def _take(
    worker: Worker,
    what: tuple[str, str],
    number: int,
    found: dict[tuple[str, str, str], _Series],
    failed: dict[str, str],
) -> None:
    topic, measure = what
    series = found.setdefault((topic, measure, worker.tool), _Series())
    if f"{worker.tool}/{topic}" in failed:
        return
    if number >= SLOW_ROUNDS and series.seconds and max(series.seconds.values()) > SLOW_S:
        return
    try:
        reply = worker.ask(work=topic, measure=measure, answer=_answer_name(worker.tool, topic, measure))
    except LabError as error:
        failed[f"{worker.tool}/{topic}"] = f"{measure}: {error}"
        return
    series.seconds[number] = reply["seconds"]


def jobs_done(
    workers: Mapping[str, Worker], topics: Mapping[str, tuple[str, ...]], failed: dict[str, str]
) -> dict[str, Any]:
    """Return the lines of the jobs, and where the jobs ran, their errors and seconds."""
    found: dict[str, Any] = {}
    for tool, lines in counted().items():
        if "jobs" not in topics.get(tool, ()):
            continue
        found[tool] = {"lines": lines}
        if tool in workers:
            try:
                found[tool] |= workers[tool].ask(work="jobs")["jobs"]
            except LabError as error:
                failed[f"{tool}/jobs"] = str(error)
    return found


# What is printed


def machine() -> str:
    """Return the processor's name, how many of them, and this Python."""
    return f"{processor()}, {platform.system()}, Python {platform.python_version()}"


def _load() -> float | None:
    return round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None


def compared(options: Options) -> dict[str, Any]:
    """Install, run and compare; return everything that is printed."""
    topics = wanted(options.only)
    if options.rounds < 1:
        raise LabError(f"--rounds {options.rounds}: give at least 1")
    if options.folder.exists() and not options.folder.is_dir():
        raise LabError(f"--folder {options.folder}: it is a file; give a folder")
    values: dict[str, Any] = {
        "date": time.strftime("%Y-%m-%d"), "machine": machine(), "load_before": _load(), "rounds": options.rounds,
        "versions": {}, "left_out": {},
    }  # fmt: skip
    workers: dict[str, Worker] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        problems = prepare(folder)
        try:
            for tool in topics:
                try:
                    python = environment(tool, options.folder)
                    values["versions"][tool] = versions(tool, python)
                    workers[tool] = Worker(tool, python, folder)
                except (LabError, subprocess.CalledProcessError, OSError) as error:
                    values["left_out"][tool] = _reason(getattr(error, "stderr", "") or str(error))
            rows, failed = measured(workers, topics, problems, folder, options.rounds)
            values["rows"], values["jobs"] = rows, jobs_done(workers, topics, failed)
            values["left_out"] |= failed
        finally:
            for worker in workers.values():
                worker.close()
    values["load_after"] = _load()
    return values


def document(values: Mapping[str, Any]) -> Document:
    """Return the result as a reader sees it."""
    seen = ", ".join(
        f"{TOOLS[tool].name} {' '.join(each[:1])}" + (f" ({', '.join(each[1:])})" if each[1:] else "")
        for tool, each in ((tool, _version_texts(tool, found)) for tool, found in values["versions"].items())
    )
    loads = [values[name] for name in ("load_before", "load_after") if values[name] is not None]
    lines = [
        f"{values['date']}; {values['machine']}; load of the machine {' before, '.join(map(str, loads))} after; "
        f"{values['rounds']} interleaved rounds; processor time of one thread, medians. A ratio is the time over the "
        "lab's in the same round: median (range).",
        f"Versions: {seen}.",
        *(f"Left out: {name}: {reason}" for name, reason in values["left_out"].items()),
    ]
    sections = [Section(TOPICS[topic], (_table(topic, values["rows"]),)) for topic in TOPICS if _of(topic, values)]
    if values["jobs"]:
        sections.append(Section(TOPICS["jobs"], (_jobs_table(values["jobs"]),)))
    differ = [f"{row['tool']}, {row['measure']}" for row in values["rows"] if row.get("agrees") is False]
    last = f"Answers that differ from the lab's or miss a pose: {'; '.join(differ) or 'none'}."
    return Document("The lab and other packages", (*paragraphs(lines), *sections, *paragraphs([last])))


def _version_texts(tool: str, found: Mapping[str, str]) -> list[str]:
    names = list(found)
    return [found[names[0]], *(f"{name} {found[name]}" for name in names[1:])]


def _of(topic: str, values: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [row for row in values["rows"] if row["topic"] == topic]


def _table(topic: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    own = [row for row in rows if row["topic"] == topic]
    heads = {
        "identify": ("time, ms", "error at new poses, mm", "farthest from the lab's prediction, µm"),
        "kinematics": ("time a pose, µs", "largest difference"),
        "select": ("time, s", "of the upper bound, %", "poses that the lab chose, too"),
        "inverse": (
            "time a pose, µs",
            "solutions a pose",
            "poses solved, %",
            "largest error, nm",
            "largest error, nrad",
        ),
    }[topic]
    lines = []
    for row in own:
        spent, *rest = _cells(topic, row)
        lines.append((row["measure"], TOOLS[row["tool"]].name, spent, _ratio(row), *rest))
    return Table(("work", "tool", heads[0], "ratio", *heads[1:]), cast(Any, tuple(lines)))


def _cells(topic: str, row: Mapping[str, Any]) -> tuple[str, ...]:
    seconds, measure = row["seconds"], row["measure"]
    if topic == "identify":
        return short(1e3 * seconds), f"{row['held_out_mm']:.5f}", _given(row.get("from_lab_um"))
    if topic == "kinematics":
        return short(1e6 * seconds / int(measure.rpartition(", ")[2])), _given(row.get("from_lab"))
    if topic == "select":
        return short(seconds), f"{100 * row['of_bound']:.2f}", str(row.get("in_common", ""))
    poses = FEW if measure == "one solution" else int(measure.rpartition(", ")[2])
    largest = (_given(None if row[name] is None else 1e9 * row[name]) for name in ("largest_m", "largest_rad"))
    return short(1e6 * seconds / poses), f"{row['solutions']:.2f}", f"{100 * row['solved']:.1f}", *largest


def _given(value: float | None) -> str:
    return "" if value is None else f"{value:.1e}" if value < 1e-2 else short(value)


def _ratio(row: Mapping[str, Any]) -> str:
    if "ratio" not in row:
        return "1" if row["tool"] == "lab" else ""
    middle, least, most = (short(row[name]) for name in ("ratio", "ratio_least", "ratio_most"))
    return f"{middle} ({least} to {most})"


def _jobs_table(jobs: Mapping[str, Any]) -> Table:
    rows = []
    for tool, found in jobs.items():
        cells = []
        for job in JOBS:
            text = str(found["lines"][job])
            if job in found:
                mm = found[job]["mm"]
                errors = ", ".join(f"{value:.4f}" for value in (mm.values() if isinstance(mm, dict) else (mm,)))
                text += f" ({errors}; {found[job]['seconds']:.1f} s)"
            cells.append(text)
        rows.append((TOOLS[tool].name, *cells))
    heads = ("tool", "from arrays to a fit: lines (error, mm; time)", "own residual", "own study")
    return Table(heads, cast(Any, tuple(rows)))


def answer(options: Options) -> Answer:
    """Compare, print and, if asked, store."""
    if options.write and options.only:
        raise LabError("--write stores a whole comparison: run it without --only")
    values = compared(options)
    if options.write:
        STORED.write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")
    return Answer(values, document(values))


if __name__ == "__main__":
    run_script("peers")
