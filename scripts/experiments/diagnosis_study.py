"""Does the diagnosis name the mistake? Virtual campaigns with a known mistake each, and campaigns without one.

The true arms have compliance, run-out, joints that scatter, and links off by the usual tolerances; a tracker measures
one to three targets. Per kind of mistake and size: how often the first finding is the mistake, how often it is another
one, and how often there is none. ``clean`` has no mistake; ``effects`` has none either, but an effect that is not
fitted: what is found in these is an accusation. ``pairs`` has two mistakes at once. Every campaign is a line of the
file ``--rows``: a run that was stopped goes on where it was.
"""

import json
import os
import signal
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import mistakes
import numpy as np
from shared import Answer, Document, Flag, Section, Table, paragraphs, run_script

import lab
from lab.core.errors import LabError
from lab.core.progress import keep_line

__all__ = ["Campaign", "findings_of", "named", "read_rows", "table_of"]

TARGETS = ("p1", "p2", "p3")
INSTRUMENTS = {"points": "leica-at960", "pose": "leica-at960", "socket": "ball-in-socket", "cable": "draw-wire"}
_UNJUDGED_M = 2e-4  # taken for the reached accuracy where too few poses were measured to judge it
_LIMIT_S = 120  # processor time of one identification
_MISSING = ("backlash", "gear", "cross harmonics", "ripple", "hardening", "compensator", "noise", "tails", "bending")
_PAIRED = ("clean", "effects", "pairs")
ALIKE: Mapping[str, frozenset[str]] = {  # what the measurements cannot tell apart, and so names the mistake as well
    "target_step": frozenset({"tool_step"}),  # one target
    "joint_sign": frozenset({"points_mirrored"}),  # all joints of an arm that has a plane of symmetry
    "points_mirrored": frozenset({"joint_sign"}),
    "scale": frozenset({"link"}),  # no length in the campaign is known
    "joint_unit": frozenset({"joint_gain"}),  # gon for degrees
    "rows_reversed": frozenset({"rows_exchanged"}),  # some rows: pairs of them are exchanged
    "rows_shifted": frozenset({"rows_shifted_from"}),
    "gear": frozenset({"joint_gain"}),
    "coupling": frozenset({"joint_coupling"}),
}


@dataclass(frozen=True)
class Options:
    """Which campaigns."""

    kinds: tuple[str, ...] = ()
    """Kinds of mistakes, clean, effects, pairs; all kinds of mistakes if none is given."""
    robots: tuple[str, ...] = ("irb120", "ur5e", "panda")
    """Arms that are measured."""
    campaigns: int = 60
    """Campaigns of each kind, size and robot; of clean, effects and pairs of each robot."""
    first: int = 0
    """Seed of the first of them: it also says how many targets are measured."""
    poses: int = 60
    """Poses of a campaign."""
    observe: str = "points"
    """What is measured: points, pose, pixels, socket or cable."""
    model: str = "geometric"
    """Model that is identified."""
    holdout: float = 0.0
    """Share of the poses that is held out; cross-validation, if 0."""
    rows: Path = Path("diagnosis_study.jsonl")
    """A line a campaign; campaigns that it has are not run again."""
    processes: int = 2
    """Processes that run campaigns."""
    show: Flag = False
    """Run nothing: tabulate the lines that are there."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True, order=True)
class Campaign:
    """A virtual campaign: everything about it follows from these numbers."""

    seed: int
    kind: str
    size: float
    robot: str
    poses: int
    observe: str = "points"
    model: str = "geometric"
    holdout: float = 0.0

    @property
    def key(self) -> str:
        """Its name among the lines."""
        return f"{self.robot} {self.observe} {self.model} {self.poses} {self.kind} {self.size:g} {self.seed}"

    @property
    def targets(self) -> tuple[str, ...]:
        """Targets that are measured: one to three, as many as the kind needs."""
        if self.observe != "points":
            return TARGETS[:1]
        least = mistakes.KINDS[self.kind].targets if self.kind in mistakes.KINDS else 2 * (self.kind == "pairs")
        return TARGETS[: max(1 + self.seed % 3, least)]


def campaigns(options: Options) -> list[Campaign]:
    """All campaigns, seed by seed, so that a part of them has some of each."""
    kinds = options.kinds or tuple(mistakes.kinds_for(3, options.observe))
    found, seeds = [], range(options.first, options.first + options.campaigns)
    for kind in kinds:
        sizes = mistakes.KINDS[kind].sizes if kind in mistakes.KINDS else (0.0,)
        for robot in options.robots:
            what = (robot, options.poses, options.observe, options.model, options.holdout)
            found += [Campaign(seed, kind, size, *what) for size in sizes for seed in seeds]
    return sorted(found)


# -- one campaign ------------------------------------------------------------------------------------------------------


def true_effects(rng: np.random.Generator, missing: str = "") -> dict[str, Any]:
    """Effects of a true arm: compliance, run-out and scatter always, and one that is missing in every model."""
    usual: dict[str, Any] = {
        "stiffness_nm_per_rad": float(np.exp(rng.uniform(*np.log([1e5, 5e5])))),
        "harmonic_mrad": rng.uniform(0.01, 0.1),
        "repeatability_mrad": rng.uniform(0.005, 0.03),
    }
    further: dict[str, dict[str, Any]] = {
        "backlash": {"backlash_mrad": 0.1},
        "gear": {"gear_ppm": 50.0},
        "cross harmonics": {"cross_harmonic_mrad": 0.05},
        "ripple": {"ripple_mrad": 0.05},
        "hardening": {"hardening_mrad": 0.2},
        "compensator": {"compensator_mrad": 0.2},
        "noise": {"noise_correlation": 0.8},
        "tails": {"noise_tail_dof": 3.0},
        "bending": {"link_ei": (2e4,)},
    }
    return usual | further.get(missing, {})


@cache
def _robot(name: str) -> Any:
    return lab.load_robot(name)


def simulated(campaign: Campaign) -> tuple[Any, str]:
    """The measurement session of a campaign, without its mistake, and the effect that is missing."""
    rng = np.random.default_rng([campaign.seed, 1])
    missing = _MISSING[campaign.seed % len(_MISSING)] if campaign.kind == "effects" else ""
    effects = lab.Effects(**true_effects(rng, missing))
    drawn: dict[str, Any] = {
        "poses": campaign.poses,
        "seed": campaign.seed,
        "targets": campaign.targets,
        "effects": effects,
    }
    if campaign.observe in INSTRUMENTS:
        drawn["instrument"] = INSTRUMENTS[campaign.observe]
    day = lab.simulate(_robot(campaign.robot), observe=campaign.observe, **drawn)
    return day, missing


def with_mistake(campaign: Campaign, session: mistakes.Session) -> list[mistakes.Mistaken]:
    """The mistakes of a campaign, each made in the measurements with those before it; none of a clean one."""
    rng = np.random.default_rng([campaign.seed, 2])
    if campaign.kind in ("clean", "effects"):
        return []
    if campaign.kind != "pairs":
        return [mistakes.KINDS[campaign.kind].make(session, campaign.size, rng)]
    usable = [name for name in mistakes.kinds_for(len(campaign.targets)) if name not in ("other_robot", "point_unit")]
    made: list[mistakes.Mistaken] = []
    for name in rng.choice(usable, 2, replace=False):
        kind = mistakes.KINDS[name]
        made.append(kind.make(session, kind.sizes[-1 if kind.unit == "times" else rng.integers(len(kind.sizes))], rng))
        session = mistakes.Session(made[-1].data, session.arm, session.values, session.accuracy_m)
    return made


def run(campaign: Campaign, accuracy_m: float) -> dict[str, Any]:
    """The line of a campaign: what was made, and what was found."""
    day, missing = simulated(campaign)
    session = mistakes.session_of(day, accuracy_m)
    made = with_mistake(campaign, session)
    line: dict[str, Any] = {
        "key": campaign.key,
        "kind": campaign.kind,
        "size": campaign.size,
        "robot": campaign.robot,
        "targets": len(campaign.targets),
        "made": [each.name for each in made],
        "of": [each.of[:8] for each in made],
        "rms_mm": [1e3 * each.rms_m for each in made],
        "numbers": [each.number for each in made],
        "missing": missing,
    }
    if made and campaign.observe == "points":
        line["visible_mm"] = 1e3 * mistakes.visible_m(session, made[-1])
    given = made[-1].robot if made and made[-1].robot else campaign.robot
    data = made[-1].data if made else session.data
    options: dict[str, Any] = dict(made[-1].options) if made else {}
    options |= {"observe": campaign.observe, "model": campaign.model}
    if campaign.observe in ("points", "pose"):
        options["instrument"] = INSTRUMENTS[campaign.observe]
    if campaign.holdout:
        options["holdout"] = campaign.holdout
    with NamedTemporaryFile("w", suffix=".toml") as file:
        if "cameras" in options:
            print(options["cameras"], file=file, flush=True)
            options["cameras"] = Path(file.name)
        return line | identified(data, _robot(given), options)


def identified(data: Any, robot: Any, options: Mapping[str, Any]) -> dict[str, Any]:
    """What an identification of these measurements finds, and its processor time."""
    began = time.process_time()
    try:
        with _limited(_LIMIT_S), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            result = lab.identify(data, robot=robot, **options)
    except LabError as error:
        return {"refused": str(error)[:300], "seconds": time.process_time() - began, "found": []}
    except TimeoutError:
        return {"refused": "no end", "seconds": time.process_time() - began, "found": []}
    except Exception as error:
        return {
            "crashed": f"{type(error).__name__}: {error}"[:300],
            "seconds": time.process_time() - began,
            "found": [],
        }
    seconds = time.process_time() - began
    said = result.to_dict()
    reasons = [str(reason)[:200] for reason in said["reasons"][:3]]
    after = said["after_mm"] or {}
    return {
        "found": findings_of(result),
        "outliers": [each["id"] for each in said["outliers"] or ()],
        "verdict": said["verdict"],
        "reasons": reasons,
        "after_mm": after.get("mean") if isinstance(after, Mapping) else after,
        "seconds": seconds,
    }


def findings_of(result: Any) -> list[dict[str, Any]]:
    """Findings of a result, the foremost first."""
    if (found := getattr(result, "diagnosis", None)) is not None:
        return [
            {
                "name": each.name,
                "of": [str(part) for part in each.hypothesis.of[:8]],
                "evidence": float(each.evidence),
                "sizes": [float(size) for size in each.sizes],
                "stds": [float(std) for std in each.stds],
                "explains_mm": 1e3 * float(each.explains_m),
                "rivals": list(each.rivals),
                "accepted": bool(each.accepted),
            }
            for each in found
        ]
    return [
        {"name": check.name.removeprefix("diagnosis."), "of": list(check.data.get("of", ())), "rivals": []}
        for check in result.checks
        if check.name.startswith("diagnosis.")
    ]


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Raise a TimeoutError after so much processor time."""

    def stop(*_: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


# -- all campaigns -----------------------------------------------------------------------------------------------------


def accuracy_of(robot: str, options: Options) -> float:
    """Mean error (m) that a calibration with chosen effects reaches in sound campaigns of a robot."""
    reached = []
    for seed in range(1000, 1003):
        campaign = Campaign(seed, "clean", 0.0, robot, options.poses, options.observe)
        day = simulated(campaign)[0]
        known: dict[str, Any] = (
            {"instrument": INSTRUMENTS[options.observe]} if options.observe in ("points", "pose") else {}
        )
        found = lab.identify(day.measurements, robot=_robot(robot), observe=options.observe, model="auto", **known)
        reached.append(float((found.to_dict()["after_mm"] or {"mean": np.nan})["mean"]))
    judged = [each for each in reached if np.isfinite(each)]
    return 1e-3 * float(np.mean(judged)) if judged else _UNJUDGED_M


def read_rows(path: Path) -> dict[str, dict[str, Any]]:
    """Lines of a file of campaigns, by their keys."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    rows = (json.loads(line) for line in lines if line.endswith("}"))
    return {row["key"]: row for row in rows}


def _run_missing(options: Options, wanted: Sequence[Campaign]) -> dict[str, dict[str, Any]]:
    """All lines, after the campaigns that have none were run."""
    rows, reached = read_rows(options.rows), {}
    with options.rows.open("a", encoding="utf-8") as file:

        def keep(row: dict[str, Any]) -> None:
            rows[row["key"]] = row
            file.write(json.dumps(row) + "\n")
            file.flush()

        for robot in options.robots:
            if (key := f"accuracy {robot} {options.observe} {options.poses}") not in rows:
                keep({"key": key, "kind": "accuracy", "accuracy_m": accuracy_of(robot, options)})
            reached[robot] = rows[key]["accuracy_m"]
        missing = [each for each in wanted if each.key not in rows]
        os.environ["OPENBLAS_NUM_THREADS"] = "1"
        with ProcessPoolExecutor(options.processes) as pool:
            jobs = [pool.submit(run, each, reached[each.robot]) for each in missing]
            for number, job in enumerate(as_completed(jobs), start=1):
                keep(job.result())
                if number % 50 == 0:
                    keep_line("diagnosis", f"{number} of {len(jobs)} campaigns")
    return rows


def named(row: Mapping[str, Any]) -> str:
    """How a campaign with one mistake went: first, alike, later, rival, another, missed, refused or crashed."""
    if "crashed" in row or "refused" in row:
        return "crashed" if "crashed" in row else "refused"
    name, found = row["made"][0], [each["name"] for each in row["found"]]
    if name in _OF_ROWS and set(row["of"][0]) & set(row.get("outliers", ())) and name not in found[:1]:
        return "first" if name == "outliers" and not found else "later" if found else "alike"
    if not found:
        return "missed"
    alike = ALIKE.get(name, frozenset()) if name != "target_step" or row["targets"] == 1 else frozenset()
    if found[0] == name:
        return "first"
    if found[0] in alike:
        return "alike"
    if any(rival.startswith(name) for rival in row["found"][0].get("rivals", ())):
        return "rival"
    return "later" if name in found else "another"


def covers(made: float, found: Mapping[str, Any]) -> bool | None:
    """Whether the 95 % interval of a finding's size has the true number in it; None where there is no number."""
    sizes, stds = np.array(found.get("sizes", ())), np.array(found.get("stds", ()))
    if not (sizes.size and np.isfinite(made) and np.isfinite(stds).all()):
        return None
    length = float(np.linalg.norm(sizes))
    return bool(abs(length - abs(made)) <= 1.96 * np.linalg.norm(sizes * stds) / length)


_OF_ROWS = ("outliers", "row_repeated", "rows_exchanged")  # whose rows a list of outliers may name
_WAYS = ("first", "alike", "rival", "later", "another", "missed", "refused", "crashed")


def table_of(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Counts by kind and size."""
    lines = []
    for kind, size in sorted({(row["kind"], row["size"]) for row in rows}):
        some = [row for row in rows if (row["kind"], row["size"]) == (kind, size)]
        count = Counter(named(row) for row in some)
        blamed = Counter(row["found"][0]["name"] for row in some if named(row) == "another")
        rms = float(np.median([row["rms_mm"][0] for row in some]))
        cells = [str(count[way]) if count[way] else "" for way in _WAYS]
        most = ", ".join(f"{name} {number}" for name, number in blamed.most_common(3))
        right = [covers(row["numbers"][0], row["found"][0]) for row in some if named(row) == "first" and row["found"]]
        inside = f"{sum(map(bool, right))}/{len(right) - right.count(None)}" if len(right) > right.count(None) else ""
        lines.append((kind, f"{size:g}", f"{rms:.3g}", str(len(some)), *cells, inside, most))
    return Table(("kind", "size", "mm rms", "of", *_WAYS, "size covered", "blamed"), tuple(lines))


def _accused(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """Sound campaigns in which something was found that is not there."""
    lines: list[tuple[str, ...]] = []
    for kind in ("clean", "effects"):
        some = [row for row in rows if row["kind"] == kind]
        wrong = [{each["name"] for each in row["found"]} - ALIKE.get(row["missing"], frozenset()) for row in some]
        count = Counter(name for names in wrong for name in names)
        seconds = [row["seconds"] for row in some]
        if some:
            share = 100 * sum(map(bool, wrong)) / len(some)
            most = ", ".join(f"{name} {number}" for name, number in count.most_common(6))
            lines.append((kind, str(len(some)), f"{share:.1f} %", f"{np.median(seconds):.2f}", most))
    return lines


def _both(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """How campaigns with two mistakes went."""
    count: Counter[str] = Counter()
    for row in rows:
        found, made = [each["name"] for each in row["found"]], set(row["made"])
        right = len(made & set(found[:2]))
        count["both named first" if right == 2 else "one of them" if right else "none of them"] += 1
        count["something else before both"] += bool(found) and found[0] not in made
        count["something else besides"] += bool(set(found) - made)
        count["refused or crashed"] += "refused" in row or "crashed" in row
    return [f"{name}: {number} of {len(rows)}" for name, number in count.items()]


def answer(options: Options) -> Answer:
    """Run what is missing, and tabulate all lines of the campaigns that are asked for."""
    wanted = campaigns(options)
    rows = read_rows(options.rows) if options.show else _run_missing(options, wanted)
    some = [rows[each.key] for each in wanted if each.key in rows]
    single = [row for row in some if row["kind"] not in _PAIRED]
    sections = []
    if single:
        sections.append(Section("One mistake", (table_of(single),)))
    if accused := _accused(some):
        head = ("campaigns", "number", "accused", "seconds", "of")
        sections.append(Section("Without a mistake", (Table(head, tuple(accused)),)))
    if pairs := [row for row in some if row["kind"] == "pairs"]:
        sections.append(Section("Two mistakes", paragraphs(_both(pairs))))
    values = {
        "campaigns": len(some),
        "named": Counter(f"{row['kind']} {row['size']:g} {named(row)}" for row in single),
        "seconds": {
            kind: float(np.median([row["seconds"] for row in some if row["kind"] == kind]))
            for kind in {row["kind"] for row in some}
        },
    }
    return Answer(values, Document("Does the diagnosis name the mistake?", tuple(sections)))


if __name__ == "__main__":
    run_script("diagnosis_study")
