"""Measure the lab's accuracy and speed anew, and store the figures that the pages of results show as tables.

Each table is a file of docs/results/stored: its columns, and rows of numbers with their command, date and machine. A
row that is measured takes the place of the stored row of its name; the others stay, with their older dates. The pages
are built from these files, and the numbers that texts quote are compared with them by a test.

    python scripts/experiments/stored_results.py --only 'accuracy:UR5*'
"""

import contextlib
import io
import json
import os
import platform
import shlex
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from functools import partial
from importlib.metadata import version
from pathlib import Path
from statistics import mean, median
from typing import Any

import benchmark
import compare_estimators
import extrapolation
import learning_curve
import page_benchmark
from benchmark import machine, median_ms
from shared import Answer, Document, Flag, paragraphs, run_script

import lab
from lab.calibration.identification import identify
from lab.calibration.weights import Noise
from lab.cli.main import main
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.kinematics.compiled import kernels
from lab.kinematics.inverse.closed_form import closed_form_of
from lab.library.virtual_arm import perturbed_arm
from lab.noise.instruments import instrument
from lab.options.virtual_campaign import VirtualCampaign
from lab.robots.load_robot import load_robot
from lab.simulation.collisions import random_poses
from lab.simulation.tracking import track

STORED = Path(__file__).parents[2] / "docs" / "results" / "stored"
MODELS = Path("models")
Values = Mapping[str, Any]


@dataclass(frozen=True)
class Options:
    """What to measure, and where the data are that do not ship."""

    only: str = "*"
    """A pattern of TABLE:ROW, such as 'accuracy:UR5*' or 'speed:*'."""
    data: Path | None = None
    """The folder of the measurements without a licence (two sets of IRB 120s); without it their rows stay."""
    list: Flag = False
    """Measure nothing, and list the tables and rows."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Row:
    """A row of a table.

    Attributes:
        name: its first cell, unique in the table.
        measure: returns the values of the other columns by their keys.
        command: that measures the same by hand; "" where it is the script's own.
    """

    name: str
    measure: Callable[[], Values]
    command: str = ""


@dataclass(frozen=True)
class StoredTable:
    """A table: its columns are its title, key and format."""

    first: str
    columns: tuple[tuple[str, str, str], ...]
    rows: Callable[[Options], Iterator[Row]]


def answers_of(command: str) -> list[dict[str, Any]]:
    """Run a command of the lab, and return its JSON; ``0..9`` in it stands for ten runs."""
    if "0..9" in command:
        return [found for seed in range(10) for found in answers_of(command.replace("0..9", str(seed)))]
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()) as printed:
        main([*shlex.split(command)[1:], "--json", "--no-recording", "--out", f"{folder}/run"])
    return [json.loads(printed.getvalue())]


def validated(command: str, statistic: str = "mean") -> Values:
    """Return the errors at poses that were not fitted: means over the runs, and the largest of all."""
    found = answers_of(command)
    nominal, calibrated = ([each[key] for each in found] for key in ("before_mm", "after_mm"))
    return {
        "nominal_mm": mean(each[statistic] for each in nominal),
        "calibrated_mm": mean(each[statistic] for each in calibrated),
        "largest_mm": max(each["max"] for each in calibrated) if statistic == "mean" else None,
    }


REAL = {  # by the first cell: the command; {D} is the folder of --data
    "ABB IRB 120, 36 poses with three targets; 40 others in two sessions (Liao et al., T-ASE 2015)":
        "lab identify {D}/irb120_liaowu_calib36.csv --robot irb120 --validate {D}/irb120_liaowu_test40.csv "
        "--refit tool",
    "UR5, 1,000 poses on a grid, 30 % held out (Jacobi 2025)":
        "lab identify {M}/ur5/measured/ur5_jacobi_1000.csv --robot ur5 --holdout 0.3",
    "UR10, 2,773 random poses, 30 % held out, ten splits (Landgraf, CASE 2021, set C)":
        "lab identify {M}/ur10/measured/ur10_ipa_C.csv --robot ur10 --holdout 0.3 --seed 0..9",
    "UR10, 632 poses in ISO cubes, 30 % held out, ten splits (set D)":
        "lab identify {M}/ur10/measured/ur10_ipa_D.csv --robot ur10 --holdout 0.3 --seed 0..9",
    "Franka Panda, a ball in sockets, cross-validated by location (Mukca)":
        "lab identify {M}/panda/measured/panda_sockets_mukca_3.csv --robot panda --observe socket "
        "--socket-distance-mm 50",
    "Franka Panda, a ball in sockets, the last of six locations held out (Mukca)":
        "lab identify last_location_marked.csv --robot panda --observe socket --socket-distance-mm 50",
}  # fmt: skip
CABLE = "ABB IRB 120 with a draw-wire, 1,042 lengths, five-fold, with --prior (RobotCali); RMS"


def last_location_held_out(command: str) -> Values:
    """Return the errors at the Panda's last location, whose rows are marked ``test`` in a column ``use``."""
    lines = (MODELS / "panda" / "measured" / "panda_sockets_mukca_3.csv").read_text(encoding="utf-8").splitlines()
    header, *rows = [line for line in lines if line and not line.startswith("#")]
    at = header.split(",").index("location")
    last = rows[-1].split(",")[at]
    uses = ["test" if row.split(",")[at] == last else "calibrate" for row in rows]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "last_location_marked.csv"
        path.write_text(
            "\n".join([f"{header},use", *map(",".join, zip(rows, uses, strict=True))]) + "\n", encoding="utf-8"
        )
        return validated(command.replace(path.name, str(path)))


def real_robots(options: Options) -> Iterator[Row]:
    """Yield the accuracy on measured arms, with geometry alone and with what ``--model auto`` finds."""
    for name, command in REAL.items():
        for model in ("", " --model auto"):
            shown = f"{command}{model}"
            if "{D}" not in shown or options.data is not None:
                filled = shown.format(D=options.data, M=MODELS)
                measure = last_location_held_out if "last_location" in command else validated
                yield Row(f"{name}{model and ','}{model}", partial(measure, filled), shown.format(D="$D", M="models"))
    command = "lab identify {D}/irb120_cable_robotcali_1042.csv --robot irb120 --observe cable --prior"
    if options.data is not None:
        yield Row(CABLE, partial(validated, command.format(D=options.data), "rms"), command.format(D="$D"))


def virtual_robots(options: Options) -> Iterator[Row]:
    """Yield the accuracy on virtual arms by instrument, over seeds 1 to 20."""

    def measured(name: str) -> Values:
        found = [lab.calibrate(seed=seed, instrument=name).to_dict() for seed in range(1, 21)]
        means = [each["after_mm"]["mean"] for each in found]
        return {
            "nominal_mm": mean(each["before_mm"]["mean"] for each in found),
            "calibrated_mm": median(means),
            "worst_mean_mm": max(means),
            "worst_pose_mm": max(each["after_mm"]["max"] for each in found),
        }

    for name in ("uniform-8um", "leica-at960", "faro-vantage", "optical-cmm"):
        yield Row(name, partial(measured, name), f"lab calibrate --instrument {name} --seed 1..20")


def speed(options: Options) -> Iterator[Row]:
    """Yield the figures of ``scripts/experiments/benchmark.py``, measured once for all of its rows."""
    found = dict[str, float]()

    def figure(name: str) -> Values:
        if not found:
            found.update(benchmark.answer(benchmark.Options()).values)
        return {"ms": found[name], "yardsticks": found[f"{name}, yardsticks"]}

    for name in benchmark.BUDGET_MS:
        yield Row(name, partial(figure, name), "python scripts/experiments/benchmark.py")


def compiled_over_numpy(rounds: int = 5) -> Mapping[str, Callable[[], Values]]:
    """Return what to measure with compiled kernels and with numpy, by its name."""
    robot, options = load_robot("irb120"), VirtualCampaign(seed=7)
    arm, tracker = robot.serial_arm(("p1",)), instrument("uniform-8um")
    nominal, closed = arm.nominal(robot.tool), closed_form_of(robot.serial_model.chain)
    real = perturbed_arm(robot, options)
    data = track(real, random_poses(robot.model, 50, rng_for(7, "poses")), ("p1",), tracker, rng_for(7, "noise"))
    many = robot.chain.random_joints(10_000, rng_for(7, "fresh"))
    assert closed is not None
    flanges = arm.flange(many, nominal)
    works: dict[str, tuple[Callable[[], Any], int]] = {
        "position and derivatives by all parameters, 50 poses": (lambda: arm.observe(data.joints, nominal), 50),
        "the same, 10,000 poses": (lambda: arm.observe(many, nominal), 3),
        "identify 27 parameters, 50 poses": (lambda: identify(arm, data, nominal, Noise(tracker)), 5),
        "all inverse solutions, 10,000 poses": (lambda: closed.solve(flanges), 1),
    }

    def interleaved(work: Callable[[], Any], repeats: int) -> Values:
        code, ratios, fast = kernels._CODE, list[float](), list[float]()
        try:
            for _ in range(rounds):
                kernels._CODE = code
                fast.append(median_ms(work, repeats))
                kernels._CODE = None
                ratios.append(median_ms(work, max(repeats // 5, 1)) / fast[-1])
        finally:
            kernels._CODE = code
        return {"ms": median(fast), "ratio": [median(ratios), min(ratios), max(ratios)]}

    return {name: partial(interleaved, *work) for name, work in works.items()}


def kernel_ratios(options: Options) -> Iterator[Row]:
    """Yield how much compiled kernels save."""
    if not kernels.compiled():
        return
    yield from (Row(name, measure) for name, measure in compiled_over_numpy().items())


INVERSES = {
    "spherical wrist on three hinges (IRB 120)": "irb120", "spherical wrist on a hinge and two slides": "versatran",
    "three parallel axes of six (UR5)": "ur5", "SCARA": "scara", "five axes (SCORBOT)": "scorbot",
    "five axes (SO-101)": "so101", "planar, three hinges": "planar3r",
}  # fmt: skip


def inverses(options: Options) -> Iterator[Row]:
    """Yield what one pose by all its solutions takes, in a batch of 20,000, and over that of the IRB 120 beside it."""

    def microseconds(name: str) -> float:
        robot = load_robot(name)
        closed = closed_form_of(robot.serial_model.chain)
        if closed is None:
            raise LabError(f"{name}: has no closed form")
        arm = robot.serial_arm(tuple(robot.tool)[:1])
        flanges = arm.flange(robot.chain.random_joints(20_000, rng_for(7, "poses")), arm.nominal(robot.tool))
        return 1e3 * median_ms(lambda: closed.solve(flanges), 5) / 20_000

    def measured(name: str) -> Values:
        pairs = [(microseconds(name), microseconds("irb120")) for _ in range(3)]
        ratios = [own / other for own, other in pairs]
        return {"us": median(own for own, _ in pairs), "ratio": [median(ratios), min(ratios), max(ratios)]}

    for title, name in INVERSES.items():
        yield Row(title, partial(measured, name))


def page_sizes(options: Options) -> Iterator[Row]:
    """Yield how long pages take, of ``scripts/experiments/page_benchmark.py``."""
    found = dict[str, Any]()

    def figure(name: str) -> Values:
        if not found:
            found.update(page_benchmark.answer(page_benchmark.Options()).values)
        return {**found[name], "scene": "yes" if found[name]["scene"] else "no"}

    for name in page_benchmark.PAGES:
        yield Row(name, partial(figure, name), "python scripts/experiments/page_benchmark.py")


def learning(options: Options) -> Iterator[Row]:
    """Yield mean errors of set C by how many of its poses are fitted (``learning_curve.py``)."""
    poses, command = (
        (100, 200, 400, 800, 1900),
        "python scripts/experiments/learning_curve.py --file models/ur10/measured/",
    )
    command += "ur10_ipa_C.csv --robot ur10 --poses 100 200 400 800 1900 --models"

    def measured(model: str) -> Values:
        file = MODELS / "ur10" / "measured" / "ur10_ipa_C.csv"
        found = learning_curve.answer(learning_curve.Options(file, "ur10", (model,), poses)).values[model]
        return {str(count): error for count, error in zip(poses, found.values(), strict=True)}

    for model in ("geometric", "auto", "residual"):
        yield Row(model, partial(measured, model), f"{command} {model}")


def extrapolated(options: Options) -> Iterator[Row]:
    """Yield errors and coverage where nothing was measured, of set D (``extrapolation.py``)."""
    command = (
        "python scripts/experiments/extrapolation.py --file models/ur10/measured/ur10_ipa_D.csv --robot ur10 --count 4 "
    )

    def measured(kind: Any, model: str) -> Values:
        file = MODELS / "ur10" / "measured" / "ur10_ipa_D.csv"
        chosen = extrapolation.Options(file, "ur10", (model,), (kind,), 4, most_poses=400)
        return extrapolation.answer(chosen).values[f"{kind}, {model}"]  # type: ignore[no-any-return]

    for kind in ("random", "beyond", "regions"):
        for model in ("geometric", "auto", "residual"):
            shown = f"{command}--most-poses 400 --kinds {kind} --models {model}"
            yield Row(f"{kind}, {model}", partial(measured, kind, model), shown)


def estimators(options: Options) -> Iterator[Row]:
    """Yield four estimators on the same 10,000 campaigns of each condition (``compare_estimators.py``)."""

    def measured(condition: str, name: str) -> Values:
        if condition not in found:
            chosen = compare_estimators.Options(conditions=(condition,))
            found.update(compare_estimators.answer(chosen).values["conditions"])
        one = found[condition][name]
        if name == compare_estimators.LEAST_SQUARES:
            return {"mean_um": 1e3 * one["mean_mm"], "ratio": 1}
        return {"mean_um": 1e3 * one["mean_mm"], "ratio": [one["ratio"], one["from"], one["to"]],
                "campaigns": [one["p5"], one["p95"]]}  # fmt: skip

    found: dict[str, Any] = {}
    names = (compare_estimators.LEAST_SQUARES, *compare_estimators.ESTIMATORS, compare_estimators.LEARNED)
    for condition in compare_estimators.CONDITIONS:
        for name in names:
            shown = f"python scripts/experiments/compare_estimators.py --conditions {shlex.quote(condition)}"
            yield Row(f"{condition}, {name}", partial(measured, condition, name), shown)


_MM = ".3f"
TABLES = {
    "learning": StoredTable("model", tuple((f"{count} poses", str(count), _MM) for count in (100, 200, 400, 800, 1900)),
                            learning),
    "extrapolation": StoredTable("poses held out, model", (
        ("mean, mm", "mean_mm", _MM), ("max, mm", "max_mm", ".2f"), ("beyond the range", "beyond_share", ".0%"),
        ("extrapolated", "uncovered_share", ".0%"), ("in 95 % bounds", "within_bounds", ".1%"),
        ("in those of the covariance alone", "within_bounds_of_covariance", ".1%")), extrapolated),
    "estimators": StoredTable("campaigns, estimator", (
        ("mean, µm", "mean_um", ".3g"), ("ratio to least squares", "ratio", ".3g"),
        ("90 % of campaigns", "campaigns", ".3g")), estimators),
    "accuracy": StoredTable("robot, data", (
        ("nominal: mean, mm", "nominal_mm", ".3g"), ("calibrated: mean, mm", "calibrated_mm", _MM),
        ("calibrated: max, mm", "largest_mm", ".2f")), real_robots),
    "virtual": StoredTable("instrument", (
        ("nominal: mean, mm", "nominal_mm", ".2f"), ("calibrated: median of the means", "calibrated_mm", ".4f"),
        ("worst mean", "worst_mean_mm", ".4f"), ("worst pose", "worst_pose_mm", ".4f")), virtual_robots),
    "speed": StoredTable("work", (("ms", "ms", ".3g"), ("yardsticks", "yardsticks", ".3g")), speed),
    "kernels": StoredTable("work", (
        ("compiled, ms", "ms", ".2g"), ("numpy over compiled", "ratio", ".2g")), kernel_ratios),
    "inverses": StoredTable("arm", (
        ("µs a pose", "us", ".2g"), ("over the IRB 120", "ratio", ".2g")), inverses),
    "pages": StoredTable("page", (
        ("first, s", "first_s", ".2f"), ("later, s", "later_s", ".2f"), ("size, MB", "size_mb", ".2f"),
        ("3D", "scene", "")), page_sizes),
}  # fmt: skip


def today() -> dict[str, Any]:
    """Return what a measured row is stored with: date, machine, versions, and how many other processes ran."""
    versions = ", ".join(f"{name} {version(name)}" for name in ("scipy", "mujoco"))
    beside = max(os.getloadavg()[0] - 1, 0)
    return {
        "date": time.strftime("%Y-%m-%d"), "machine": f"{machine()}, {versions}", "lab": lab.__version__,
        "other_processes": round(beside, 1),
    }  # fmt: skip


def stored(name: str) -> dict[str, Any]:
    """Return the stored content of a table; empty where there is none."""
    path = STORED / f"{name}.json"
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {"rows": []}
    return found


def keep(name: str, measured: Sequence[Mapping[str, Any]], options: Options) -> None:
    """Put rows into a table's file, in the place of those of their names; rows that the table no longer has go."""
    table, rows = TABLES[name], {row["name"]: row for row in [*stored(name)["rows"], *measured]}
    order = [row.name for row in table.rows(replace(options, data=options.data or Path()))]
    columns = [{"title": title, "key": key, "format": form} for title, key, form in table.columns]
    content = {"first": table.first, "columns": columns, "rows": [rows[each] for each in order if each in rows]}
    STORED.mkdir(exist_ok=True)
    text = json.dumps(content, indent=1, ensure_ascii=False)
    (STORED / f"{name}.json").write_text(text + "\n", encoding="utf-8")


def answer(options: Options) -> Answer:
    """Measure the selected rows, and store them.

    Raises:
        LabError: no row is selected.
    """
    if options.list:
        names = [f"{name}:{row.name}" for name, table in TABLES.items() for row in table.rows(options)]
        return Answer({"rows": names}, Document("Stored results", paragraphs(names)))
    measured = dict[str, list[str]]()
    for name, table in TABLES.items():
        for row in table.rows(options):
            if fnmatch(f"{name}:{row.name}", options.only):
                found = {"name": row.name, **row.measure(), "command": row.command, **today()}
                keep(name, [found], options)  # what is measured stays, whatever becomes of the next
                measured.setdefault(name, []).append(row.name)
    if not measured:
        raise LabError(f"--only {options.only}: selects no row; --list lists them")
    lines = [f"{name}: {row}" for name, rows in measured.items() for row in rows]
    return Answer({"measured": measured, "python": platform.python_version()}, Document("Stored", paragraphs(lines)))


if __name__ == "__main__":
    run_script("stored_results")
