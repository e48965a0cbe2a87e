"""Score calibrations of real robots on fixed splits: the error at held-out poses, and how honest its bounds are.

Without options, the methods that run here predict the held-out poses of the data sets that come with the lab. With
``--predictions``, those of any other tool are scored. ``--export`` writes what such a tool needs.
"""

import csv
import hashlib
import json
import math
import shutil
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import numpy as np
import peers
from numpy.typing import NDArray
from scipy import stats
from shared import Answer, Block, Document, Flag, Section, Table, example, paragraphs, run_script, short

import lab
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.prediction.estimate import Estimate
from lab.report.document import Strong, Text
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot

sys.path.append(str(peers.FOLDER))
Arm = import_module("scipy_jobs").Arm  # a chain of numpy alone, written apart from the lab

SETS = Path(__file__).with_suffix(".toml")
STORED = peers.STORED.with_name("leaderboard.json")
POSITION = ("x_mm", "y_mm", "z_mm")
COVARIANCE = tuple(f"cov_{pair}_mm2" for pair in ("xx", "xy", "xz", "yy", "yz", "zz"))
MEASURED = (*POSITION, "rx_deg", "ry_deg", "rz_deg")  # ends of columns that a method has to predict
INSIDE = float(stats.chi2.ppf(0.95, 3))  # a point is within its 95 % region if e' V^-1 e is below
LEVEL = 0.95
PEER_ROWS = 100  # of the rows to fit, evenly taken: other packages need minutes for a thousand


@dataclass(frozen=True)
class Options:
    """What to score, and where its data are."""

    sets: tuple[str, ...] = ()
    """Data sets; by default all that come with the lab, with `--data` all."""
    methods: tuple[str, ...] = ()
    """Methods that predict; by default all that can run."""
    predictions: Path | None = None
    """CSV file of another tool's predictions for one set; scored alone."""
    export: Path | None = None
    """Write the rows to fit and the joint positions to predict into this folder, and stop."""
    data: Path | None = None
    """Folder with the data that do not come with the lab."""
    folder: Path = Path("build/peers")
    """Folder of the environments of pybotics and FIGAROH, as `scripts/experiments/peers.py` makes them."""
    limit_s: float = 600
    """Seconds that another package may take for a set."""
    write: Flag = False
    """Store the scores beside those stored before; the page docs/results/leaderboard.md shows all."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class DataSet:
    """Measurements of a real robot with a fixed split; the keys of ``leaderboard.toml``.

    Attributes:
        held_out: data rows from 0, of ``held_out_file`` where there is one.
        ships: whether it comes with the lab.
    """

    name: str
    robot: str
    measured: str
    address: str
    licence: str
    ships: bool
    file: str
    sha256: str
    rule: str
    held_out: str
    held_out_file: str = ""
    held_out_sha256: str = ""

    @property
    def rows(self) -> NDArray[np.int_]:
        """The held-out rows."""
        found: list[int] = []
        for part in self.held_out.replace("\n", " ").split(","):
            first, _, last = part.strip().partition("-")
            found += range(int(first), int(last or first) + 1)
        return np.array(found)

    def paths(self, data: Path | None) -> dict[Path, str]:
        """Return the files, with the digests that they should have."""
        folder = load_robot(self.robot).model.path.parent / "measured" if self.ships else data
        if folder is None:
            raise LabError(f"{self.name}: it does not come with the lab; get it from {self.address} and give --data")
        named = {self.file: self.sha256} | ({self.held_out_file: self.held_out_sha256} if self.held_out_file else {})
        return {folder / name: digest for name, digest in named.items()}


@dataclass(frozen=True)
class Task:
    """What a method is given.

    Attributes:
        fit: measurements to fit.
        held_out: joint positions and conditions to predict; without measured points.
        references: rows of the held-out file that are given, a point of each session; None where there are none.
    """

    about: DataSet
    robot: Robot
    fit: Measurements
    held_out: Measurements
    references: Measurements | None


@dataclass(frozen=True)
class Predictions:
    """Predicted points ``(n, 3)`` m, and the covariances ``(n, 3, 3)`` m² of measured less predicted ones, if any."""

    points: Array
    covariances: Array | None = None


def data_sets() -> dict[str, DataSet]:
    """Read the data sets by name."""
    read = tomllib.loads(SETS.read_text(encoding="utf-8"))["set"]
    return {each["name"]: DataSet(**each) for each in read}


def task_of(about: DataSet, data: Path | None) -> tuple[Task, Array]:
    """Return what a method is given, and the measured points ``(n, 3)`` of the held-out rows.

    Raises:
        LabError: a file is missing, or is not the one of the split.
    """
    robot, files = load_robot(about.robot), []
    for path, digest in about.paths(data).items():
        if not path.is_file():
            raise LabError(f"{about.name}: {path} is missing; get it from {about.address}")
        if hashlib.sha256(path.read_bytes()).hexdigest() != digest:
            raise LabError(f"{path}: not the file of the split: its SHA-256 is not {digest}")
        files.append(lab.read_measurements(path, robot))
    held, other = files[-1][about.rows], np.setdiff1d(np.arange(len(files[-1])), about.rows)
    rest = files[-1][other] if len(other) else None
    fit, references = (files[0], rest) if len(files) > 1 else (rest, None)
    assert fit is not None
    unseen = replace(held, points=np.full_like(held.points, np.nan), other={})
    return Task(about, robot, fit, unseen, references), held.points[:, 0]


# Scores


def scored(measured: Array, predicted: Predictions) -> dict[str, float | int | None]:
    """Return error and coverage of predictions, with 95 % intervals.

    The interval of the RMS is that of a mean of squares (normal), of the 95th percentile by order statistics
    (binomial), and of the coverage Wilson's (1927).
    """
    error = 1e3 * (measured - predicted.points)
    lengths, n = np.sort(np.linalg.norm(error, axis=1)), len(error)
    squares, z = lengths**2, float(stats.norm.ppf((1 + LEVEL) / 2))
    spread = z * squares.std(ddof=1) / math.sqrt(n) if n > 1 else math.nan
    low, high = stats.binom.ppf([(1 - LEVEL) / 2, (1 + LEVEL) / 2], n, 0.95).astype(int)
    found: dict[str, float | int | None] = {
        "poses": n,
        "rms_mm": math.sqrt(squares.mean()),
        "rms_low_mm": math.sqrt(max(squares.mean() - spread, 0.0)),
        "rms_high_mm": math.sqrt(squares.mean() + spread),
        "p95_mm": float(np.quantile(lengths, 0.95, method="inverted_cdf")),
        "p95_low_mm": float(lengths[max(low - 1, 0)]),
        "p95_high_mm": float(lengths[high]) if high < n else None,
        "coverage": None,
    }
    if predicted.covariances is None:
        return found
    V = 1e6 * predicted.covariances
    squared = np.einsum("ni,ni->n", error, np.linalg.solve(V, error[..., None])[..., 0])
    inside = int((squared <= INSIDE).sum())
    share, weight = inside / n, z**2 / n
    middle, half = share + weight / 2, z * math.sqrt(share * (1 - share) / n + weight / (4 * n))
    return found | {
        "coverage": share,
        "coverage_low": (middle - half) / (1 + weight),
        "coverage_high": (middle + half) / (1 + weight),
        "region_mm": float(np.median(np.cbrt(np.sqrt(np.linalg.det(V))))) * math.sqrt(INSIDE),
    }


def read_predictions(path: Path, about: DataSet) -> Predictions:
    """Read a file of predictions: a row for each held-out row, with ``row`` and a position, and perhaps a covariance.

    Raises:
        LabError: the file is wrong; the message names the line.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            heads, lines = [each.strip() for each in reader.fieldnames or ()], list(reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise LabError(f"{path}: cannot be read as CSV: {getattr(error, 'strerror', None) or error}") from error
    needed = ["row", *POSITION]
    if missing := [name for name in needed if name not in heads]:
        raise LabError(f"{path}: no column {missing[0]}; give {', '.join(needed)}, and perhaps {', '.join(COVARIANCE)}")
    given = [name for name in COVARIANCE if name in heads]
    if given and len(given) < len(COVARIANCE):
        lacking = next(name for name in COVARIANCE if name not in given)
        raise LabError(f"{path}: no column {lacking}; give all of {', '.join(COVARIANCE)}, or none")
    columns, found = (*POSITION, *given), dict[int, list[float]]()
    wanted = set(about.rows.tolist())
    for line, cells in enumerate(lines, 2):
        values = [_number(path, line, name, cells) for name in ("row", *columns)]
        row = int(values[0])
        if row != values[0] or row not in wanted:
            raise LabError(f"{path}, line {line}: row {cells['row']} is not held out in {about.name}")
        if row in found:
            raise LabError(f"{path}, line {line}: row {row} is there twice")
        found[row] = values[1:]
        if given and not _is_covariance(values[4:]):
            raise LabError(f"{path}, line {line}: the covariance is not positive definite")
    if lost := sorted(wanted - set(found)):
        raise LabError(f"{path}: {len(lost)} of {len(wanted)} held-out rows are not predicted (first: row {lost[0]})")
    table = np.array([found[row] for row in about.rows.tolist()])
    covariances = 1e-6 * np.array([_matrix(row) for row in table[:, 3:]]) if given else None
    return Predictions(table[:, :3] / 1e3, covariances)


def _number(path: Path, line: int, name: str, cells: Mapping[str | None, Any]) -> float:
    named = {(key or "").strip(): value for key, value in cells.items()}
    try:
        value = float(named[name])
    except (KeyError, TypeError, ValueError):
        value = math.nan
    if not math.isfinite(value):
        raise LabError(f"{path}, line {line}, column {name}: {named.get(name)!r} is no finite number")
    return value


def _matrix(six: Sequence[float] | Array) -> Array:
    xx, xy, xz, yy, yz, zz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _is_covariance(six: Sequence[float]) -> bool:
    return bool(np.linalg.eigvalsh(_matrix(six)).min() > 0)


# Methods


def by_the_lab(task: Task, *_others: Any, **options: Any) -> Predictions:
    """The lab's own models; the covariance is that of the prediction and of the noise of a new measurement."""
    estimate = _estimate(task, **options)
    inputs = task.held_out.inputs(estimate.arm.conditions)
    if task.references is not None:
        return Predictions(_with_own_points(task, estimate, inputs))
    found = estimate.predict(inputs)
    return Predictions(found.points[:, 0], found.covariance[:, 0] + estimate.noise_m**2 * np.eye(3))


def _estimate(task: Task, **options: Any) -> Estimate:
    # a few fitted rows as validation data: without any, the lab would cross-validate, which is not asked for here
    return lab.identify(task.fit, task.robot, validate=task.fit[:5], **options).estimate


def _with_own_points(task: Task, estimate: Estimate, inputs: Array) -> Array:
    """Predict the point of each session, which its reference row gives in the last frame."""
    assert task.references is not None
    target = estimate.arm.targets[0]
    values = estimate.parameter_values((target,))
    names = estimate.parameter_names((target,))
    own = [names.index(f"tool.{target}.{axis}") for axis in "xyz"]
    there = task.references.inputs(estimate.arm.conditions)
    poses = estimate.poses(there, target=target)
    points = np.empty((len(inputs), 3))
    for i, session in enumerate(task.references.sessions):
        rows = np.array([each == session for each in task.held_out.sessions])
        moved = values.copy()
        moved[own] += poses[i, :3, :3].T @ (task.references.points[i, 0] - poses[i, :3, 3])
        points[rows] = estimate.points(inputs[rows], moved, targets=(target,))[:, 0]
    return points


def learned(task: Task, *_others: Any) -> Predictions:
    """What scikit-learn's Gaussian process adds to the geometry, as in ``scripts/examples/own_corrector.py``."""
    try:
        LearnedCorrector = example("own_corrector").LearnedCorrector
    except ImportError as error:
        raise LabError(f"scikit-learn is missing: {error}") from error
    _refuse_sessions(task)
    estimate = _estimate(task)
    first = LearnedCorrector(estimate, task.fit[np.linspace(0, len(task.fit) - 1, 500).astype(int)])
    both = LearnedCorrector(estimate, task.fit, first.process.kernel_)  # its scales, on all rows
    joints = task.held_out.joints
    spread = both.process.predict(np.concatenate([np.sin(joints), np.cos(joints)], axis=1), return_std=True)[1]
    return Predictions(both.predict(joints), np.einsum("ni,ij->nij", spread**2, np.eye(3)))


def by_scipy(task: Task, *_others: Any, fitted: bool) -> Predictions:
    """Geometry by scipy's least squares on a chain written apart from the lab, or base and target alone."""
    _refuse_sessions(task)
    arm, joints, points = _placed(task)
    x = arm.fitted(joints, points, 1e-12).x if fitted else np.zeros(arm.size)
    free = list(range(arm.size)) if fitted else [*range(6), *range(arm.size - 3, arm.size)]
    J = arm.jacobian(joints, x)[:, :, free].reshape(-1, len(free))
    scale = np.linalg.norm(J, axis=0)
    _, s, Vt = np.linalg.svd(J / np.where(scale > 0, scale, 1), full_matrices=False)
    kept = s > 1e-7 * s[0]
    variance = float(((points - arm.points(joints, x)) ** 2).sum()) / (J.shape[0] - kept.sum())
    root = (Vt[kept].T / s[kept]) / np.where(scale > 0, scale, 1)[:, None]
    new = arm.jacobian(task.held_out.joints, x)[:, :, free] @ root
    return Predictions(arm.points(task.held_out.joints, x), variance * (np.eye(3) + new @ np.swapaxes(new, 1, 2)))


def _placed(task: Task) -> tuple[Any, Array, Array]:
    """Return the nominal arm with base and target near the fitted rows, and those rows."""
    joints, points = task.fit.joints, task.fit.points[:, 0]
    arm = Arm(_standard_table(task.robot), np.full(3, np.nan))
    arm.aligned(joints, points)
    return arm, joints, points


def _standard_table(robot: Robot) -> Array:
    """Return theta, d, a, alpha in the classical convention; what is before the first joint is part of the base."""
    chain = robot.serial_model.chain
    table = np.asarray(chain.table)[:, :4]
    if chain.convention == "craig":
        table = np.column_stack([table[:, :2], np.vstack([table[1:, 2:], np.zeros(2)])])
    return table


def _modified_table(standard: Array) -> Array:
    """Return alpha, a, theta, d of Craig's convention of a chain whose last link has neither a nor alpha."""
    before = np.vstack([np.zeros(2), standard[:-1, 2:]])
    return np.column_stack([before[:, 1], before[:, 0], standard[:, 0], standard[:, 1]])


def by_peer(task: Task, folder: Path, limit_s: float, *, tool: str) -> Predictions:
    """What another package fits within some seconds, of at most ``PEER_ROWS`` rows, in an environment of its own."""
    _refuse_sessions(task)
    python = peers.environment(tool, folder)
    count = min(len(task.fit), PEER_ROWS)
    part = replace(task, fit=task.fit[np.linspace(0, len(task.fit) - 1, count).astype(int)])
    arm, joints, points = _placed(part)
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        given = {
            "joints": joints, "points": points, "new_joints": task.held_out.joints,
            "modified": _modified_table(arm.table), "target": arm.target,
        }  # fmt: skip
        np.savez(place / "measures.npz", allow_pickle=False, **given)
        values = task.robot.parameter_values(("p1",))
        values[-3:] = arm.target
        text = task.robot.description("calibrated.urdf", ("p1",), values)
        (place / "arm.urdf").write_text(text, encoding="utf-8")
        worker = peers.Worker(tool, python, place, limit_s)
        try:
            worker.ask(work="predict", measure="predict", answer="predicted.npy")
        finally:
            worker.close()
        return Predictions(np.load(place / "predicted.npy"))


def _refuse_sessions(task: Task) -> None:
    if task.references is not None:
        raise LabError("this method knows one point alone")


METHODS: dict[str, Callable[[Task, Path, float], Predictions]] = {
    "nominal": partial(by_scipy, fitted=False),
    "lab, geometric": by_the_lab,
    "lab, geometric with prior": partial(by_the_lab, prior=True),
    "lab, auto": partial(by_the_lab, model="auto"),
    "lab, residual": partial(by_the_lab, model="residual"),
    "scipy, geometric": partial(by_scipy, fitted=True),
    "pybotics": partial(by_peer, tool="pybotics"),
    "FIGAROH": partial(by_peer, tool="figaroh"),
    "scikit-learn on the lab's geometry": learned,
}


# What is printed


def _chosen(given: Sequence[str], valid: Sequence[str], option: str) -> list[str]:
    if unknown := [name for name in given if name not in valid]:
        raise LabError(f"{option} {unknown[0]}: give {'; '.join(valid)}")
    return [name for name in valid if name in given] if given else list(valid)


def compared(options: Options) -> dict[str, Any]:
    """Let the methods predict, and score them."""
    every = data_sets()
    valid = [name for name, about in every.items() if options.sets or about.ships or options.data is not None]
    values: dict[str, Any] = {
        "date": time.strftime("%Y-%m-%d"), "machine": peers.machine(),
        "versions": {"lab": peers.versions("lab", Path(sys.executable))}, "rows": [], "left_out": {},
    }  # fmt: skip
    if not options.limit_s > 0:
        raise LabError(f"--limit-s {options.limit_s:g}: give more than 0")
    methods = _chosen(options.methods, list(METHODS), "--methods")
    for name in _chosen(options.sets, valid, "--sets"):
        task, measured = task_of(every[name], options.data)
        for method in methods:
            print(f"{name}: {method}", file=sys.stderr)
            try:
                predicted = METHODS[method](task, options.folder, options.limit_s)
            except LabError as error:
                values["left_out"][f"{name}: {method}"] = str(error)
                continue
            values["rows"].append(
                {"set": name, "method": method, "fitted": len(task.fit)} | scored(measured, predicted)
            )
    for tool in ("pybotics", "figaroh"):
        if any(row["method"] == peers.TOOLS[tool].name for row in values["rows"]):
            values["versions"][tool] = peers.versions(tool, peers.environment(tool, options.folder))
    return values


def merged(stored: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """Return stored scores with those of new ones in place of the same set's and method's."""
    order = [(name, method) for name in data_sets() for method in METHODS]
    rows = {(row["set"], row["method"]): row for row in (*stored["rows"], *new["rows"])}
    left_out = {**stored["left_out"], **new["left_out"]}
    return {
        **new,
        "versions": {**stored["versions"], **new["versions"]},
        "rows": [rows[each] for each in order if each in rows],
        "left_out": {name: why for name, why in left_out.items() if tuple(name.split(": ", 1)) not in rows},
    }


def document(values: Mapping[str, Any]) -> Document:
    """Return the scores as a reader sees them: a table for each set, the best first."""
    every = data_sets()
    seen = ", ".join(
        f"{tool} {', '.join(f'{name} {version}' if name != tool else version for name, version in found.items())}"
        for tool, found in values["versions"].items()
    )
    days = sorted({row["date"] for row in values["rows"] if "date" in row})
    lines = [f"{' to '.join(dict.fromkeys((days[0], days[-1])))}; {seen}."] if seen and days else []
    sections = [Section("At a glance", _glance(values["rows"]))] if seen else []
    for name, about in every.items():
        rows = sorted((row for row in values["rows"] if row["set"] == name), key=lambda row: row["rms_mm"])
        if rows:
            caption = f"{about.measured}: {rows[0]['fitted']:,} fitted, {rows[0]['poses']:,} held out."
            sections.append(Section(name, (*paragraphs([caption]), _table(rows))))
    by_reason: dict[tuple[str, str], list[str]] = {}
    for name, reason in values["left_out"].items():
        about_set, _, method = name.partition(": ")
        by_reason.setdefault((about_set, reason), []).append(method)
    left_out = [f"Left out of {name}: {'; '.join(each)}: {reason}." for (name, reason), each in by_reason.items()]
    return Document("Leaderboard", (*paragraphs(lines), *sections, *paragraphs(left_out)))


def _glance(rows: Sequence[Mapping[str, Any]]) -> tuple[Block, ...]:
    """Return who has the lowest error of each set, and a table of methods by sets."""
    sets = [name for name in data_sets() if any(row["set"] == name for row in rows)]
    best = {name: min((row for row in rows if row["set"] == name), key=lambda row: row["rms_mm"]) for name in sets}
    found = {(row["set"], row["method"]): row for row in rows}
    lines = []
    for method in METHODS:
        cells = [found.get((name, method)) for name in sets]
        if any(cells):
            lines.append((method, *("" if row is None else _short_cell(row, best[row["set"]]) for row in cells)))
    winners = "; ".join(f"{name}: {row['method']}" for name, row in best.items())
    caption = "RMS in mm, and in brackets the share within the 95 % region, in %. The lowest RMS of a set is in bold."
    return (
        *paragraphs([f"Lowest RMS by set: {winners}."]),
        Table(("method", *sets), cast(Any, tuple(lines)), caption),
    )


def _short_cell(row: Mapping[str, Any], best: Mapping[str, Any]) -> Text:
    share = "" if row["coverage"] is None else f" ({100 * row['coverage']:.0f})"
    text = f"{row['rms_mm']:.3f}"
    return (Strong(text), share) if row["method"] == best["method"] else text + share


def _table(rows: Sequence[Mapping[str, Any]]) -> Table:
    heads = ("method", "RMS, mm", "95th percentile, mm", "within the 95 % region, %", "radius of that region, mm")
    return Table(
        heads,
        tuple(
            (
                row["method"],
                _interval(*(row[name] for name in ("rms_mm", "rms_low_mm", "rms_high_mm"))),
                _interval(*(row[name] for name in ("p95_mm", "p95_low_mm", "p95_high_mm"))),
                *_coverage(row),
            )
            for row in rows
        ),
    )


def _interval(value: float, low: float, high: float | None) -> str:
    return f"{value:.3f} ({low:.3f} to {'more' if high is None else f'{high:.3f}'})"


def _coverage(row: Mapping[str, Any]) -> tuple[str, str]:
    if row["coverage"] is None:
        return "none given", ""
    share, low, high = (100 * row[name] for name in ("coverage", "coverage_low", "coverage_high"))
    return f"{share:.1f} ({low:.1f} to {high:.1f})", short(row["region_mm"])


def export(options: Options) -> Answer:
    """Write what another tool needs for each set: rows to fit, joint positions to predict, the nominal model."""
    assert options.export is not None
    every, lines = data_sets(), []
    valid = [name for name, about in every.items() if options.sets or about.ships or options.data is not None]
    for name in _chosen(options.sets, valid, "--sets"):
        about, folder = every[name], options.export / name
        task_of(about, options.data)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise LabError(f"--export {folder}: {error.strerror}") from error
        first, *second = about.paths(options.data)
        if second:
            shutil.copy(first, folder / "fit.csv")
        _copy_rows((second or [first])[0], folder, about.rows, "given.csv" if second else "fit.csv")
        model = load_robot(about.robot).model.path
        shutil.copy(model, folder / model.name)
        lines.append(f"{folder}: fit.csv to fit, held_out.csv to predict, {model.name} as the nominal model")
    return Answer({"written": lines}, Document("Written", paragraphs(lines)))


def _copy_rows(path: Path, folder: Path, held_out: NDArray[np.int_], other: str) -> None:
    """Copy data rows with their numbers in a first column ``row``: those held out without what was measured."""
    with path.open(newline="", encoding="utf-8-sig") as file:
        head, *rows = list(csv.reader(file))
    hidden, out = [name.endswith(MEASURED) for name in head], set(held_out.tolist())
    for name, wanted, secret in ((other, set(range(len(rows))) - out, False), ("held_out.csv", out, True)):
        kept = [i for i, each in enumerate(hidden) if not (secret and each)]
        chosen = [[str(i), *(rows[i][k] for k in kept)] for i in sorted(wanted)]
        if chosen:
            with (folder / name).open("w", newline="", encoding="utf-8") as to:
                csv.writer(to, lineterminator="\n").writerows([["row", *(head[k] for k in kept)], *chosen])


def of_predictions(options: Options) -> Answer:
    """Score a file of predictions for one set."""
    assert options.predictions is not None
    every = data_sets()
    if len(options.sets) != 1:
        raise LabError(f"--predictions: name the set that they are for: --sets with one of {', '.join(every)}")
    about = every[_chosen(options.sets, list(every), "--sets")[0]]
    task, measured = task_of(about, options.data)
    predicted = read_predictions(options.predictions, about)
    row = {"set": about.name, "method": options.predictions.stem, "fitted": len(task.fit)}
    values = {"versions": {}, "left_out": {}, "rows": [row | scored(measured, predicted)]}
    return Answer(values, document(values))


def answer(options: Options) -> Answer:
    """Score predictions, write the tasks, or let the methods predict."""
    if options.export is not None:
        return export(options)
    if options.predictions is not None:
        return of_predictions(options)
    values = compared(options)
    if options.write:
        values = merged(json.loads(STORED.read_text(encoding="utf-8")), values) if STORED.is_file() else values
        STORED.write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")
    return Answer(values, document(values))


if __name__ == "__main__":
    run_script("leaderboard")
