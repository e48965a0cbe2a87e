"""Run about sixty commands with two checkouts of the lab, and compare every number, verdict and exit code.

Each command runs in a process of its own, with either checkout as ``PYTHONPATH``. Commands that read files read those
that the first checkout wrote, so that both compute from the same numbers. Answers that are in the folder already are
read, not computed again. Sentences are not compared: they may change.

Usage: ``python scripts/maintenance/reference_set.py BEFORE AFTER --folder FOLDER --data DATA [--only PART]
[--renamed FILE] [--json]``; exit code 1 if an answer differs. The file names each key that was renamed on purpose, as
TOML: ``old = "new"``, at its top for all commands, or in a table ``[NAME]`` for those of that first word.
"""

import argparse
import io
import json
import math
import os
import re
import subprocess
import sys
import tokenize
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

__all__ = ["COMMANDS", "Difference", "difference", "main"]

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
    "delta": "--seed 22 --robot delta",
    "residual": "--seed 23 --poses 60 --ripple-mrad 0.1 --model residual --prior off",
    "gate": "--seed 24 --gate-mm 0.001",
}
_CALL = """
import json, sys
import numpy as np
import lab
session = lab.simulate("irb120", poses=25, seed=31, targets=("p1", "p2"))
result = lab.identify(session.measurements, robot="irb120", instrument="uniform-8um", holdout=0.2)
answer = {"points": session.measurements.points.tolist(), "result": result.to_dict()}
answer["inverse"] = lab.solve_kinematics("irb120", pose=(302, 0, 558, 0, 90, 0)).to_dict()
answer["design"] = lab.design("irb120", poses=10, candidates=100, starts=1, no_check=True).to_dict()
answer["verify"] = lab.verify(result, lab.simulate("irb120", poses=8, seed=32).measurements, force=True).to_dict()
other = lab.identify(lab.simulate("irb120", poses=30, seed=31, targets=("p1", "p2")).measurements, robot="irb120")
answer["history"] = lab.history([result, other], force=True).to_dict()["arms"]
print(json.dumps(answer))
"""
COMMANDS: Mapping[str, str] = {
    **{f"calibrate {name}": f"calibrate {words} --out {{own}}/{name}" for name, words in _CALIBRATE.items()},
    "identify": "identify {first}/default/measurements.csv --out {own}/history/day1 --date 2026-01-12 --serial A1",
    "identify, second": "identify {first}/thirty/measurements.csv --out {own}/history/day2 --date 2026-02-12 "
    "--serial A1",
    "identify, noise given": "identify {first}/default/measurements.csv --noise-mm 0.0046",
    "identify, prior": "identify {first}/default/measurements.csv --prior",
    "identify, fixed": "identify {first}/default/measurements.csv --fix link4.d",
    "identify, robust": "identify {first}/bad/measurements.csv --robust",
    "identify, outliers kept": "identify {first}/bad/measurements.csv",
    "identify, auto": "identify {first}/thirty/measurements.csv --model auto",
    "identify, soft auto": "identify {first}/soft/measurements.csv --model auto --require good",
    "identify, later rows": "identify {first}/targets/measurements.csv --holdout-last 0.3 --region workspace",
    "identify, three targets": "identify {first}/targets/measurements.csv --instrument uniform-8um",
    "identify, poses": "identify {first}/pose/measurements.csv --observe pose",
    "identify, two sessions": "identify {data}/irb120_liaowu_calib36.csv --validate {data}/irb120_liaowu_test40.csv "
    "--refit tool --out {own}/liaowu",
    "identify, moved tracker": "identify {inputs}/moved.csv",
    "identify, wire": "identify {data}/irb120_cable_robotcali_1042.csv --observe cable --prior",
    "identify, UR10": "identify {data}/ur10_ipa_D.csv --robot {data}/ur10.toml --holdout 0.3",
    "identify, UR5": "identify {data}/ur5_jacobi_20.csv --robot {data}/ur5.toml --model auto",
    "identify, sockets": "identify {data}/panda_sockets_mukca_3.csv --robot {data}/panda.toml --observe socket "
    "--socket-distance-mm 50 --prior",
    "inspect": "inspect irb120",
    "inspect, compliance": "inspect irb120 --model compliance+harmonics --fix link4.d",
    "inspect, delta": "inspect delta",
    "kinematics": "kinematics irb120 --pose=302,0,558,0,90,0",
    "kinematics, five axes": "kinematics scorbot --pose=300,100,400,10,20,30",
    "kinematics, delta": "kinematics delta --pose 100,50,-950",
    "kinematics, matrices": "kinematics irb120 --joints 0,0,-90,-90,90,-90 --matrices",
    "kinematics, rates": "kinematics irb120 --joints 0,30,-40,0,60,0 --rates 10,0,0,0,0,0 --frame tool",
    "workspace": "workspace carrier/spherical scara --places 2000",
    "trajectory": "trajectory {inputs}/goals.csv --robot irb120",
    "reproduce thesis": "reproduce thesis",
    "reproduce elastic": "reproduce elastic",
    "reproduce course": "reproduce course",
    "reproduce staubli": "reproduce staubli",
    "design": "design --poses 12 --candidates 200",
    "design, targets": "design --robot tx40 --poses 15 --candidates 300 --targets p1,p2 --criterion I "
    "--controller val3",
    "design, accuracy": "design --accuracy-mm 0.05 --candidates 200 --starts 1 --reference-every 5",
    "import": "import {inputs}/points.txt --joints {inputs}/joints.csv --robot irb120 --unit mm --by name",
    "compensate": "compensate {inputs}/few.csv --run {first}/default",
    "compensate, springs": "compensate {inputs}/soft.csv --run {first}/soft --no-check --force",
    "compensate, program": "compensate --program {inputs}/Pick.mod --run {first}/targets --force",
    "predict": "predict {first}/soft {first}/soft/measurements.csv",
    "verify": "verify {first}/default {first}/thirty/measurements.csv --force",
    "verify, same arm": "verify {first}/default {first}/default/measurements.csv --force",
    "certify": "certify {first}/default",
    "certify, real arm": "certify {first}/liaowu",
    "history, robots": "history {first}/default {first}/dh --force",
    "history, two runs": "history {first}/history/day1 {first}/history/day2 --force",
    "history": "history {first}/history --on 2026-03-01",
    "payload": "payload --robot tx40 --simulate --seconds 4 --rate-hz 100",
    "dynamics": "dynamics --robot course2r --simulate --rate-hz 100 --rounds 0",
    "dynamics, base parameters": "dynamics --robot tx40 --without motor-inertia,friction,offsets",
    "study": "study {inputs}/grid.toml",
    "calls from Python": "",
}
_PROGRAM = r"""MODULE Pick
  PERS tooldata tGripper:=[TRUE,[[0,0,120],[1,0,0,0]],[1,[0,0,60],[1,0,0,0],0,0,0]];
  PERS wobjdata wTable:=[FALSE,TRUE,"",[[300,0,100],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  CONST robtarget pPick:=[[50.00,40.00,60.00],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget pPlace:=[[50.00,-80.00,60.00],[0,0,1,0],[-1,0,-1,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC main()
    MoveL pPick,v100,fine,tGripper\WObj:=wTable;
    MoveJ pPlace,v500,fine,tGripper\WObj:=wTable;
  ENDPROC
ENDMODULE
"""
_GRID = 'name = "small"\nrobots = 2\ndraws = 3\nfresh = 50\n[factors]\nposes = [20, 30]\ncriterion = ["random"]\n'
_LEAST = 1e-9  # of a standard deviation: what estimates and intervals may differ by
_LEAST_NUMBER = 1e-6  # relative: what any other number may, whose digits cancel
_FLOOR = 1e-9  # below which a number is rounding
_NOT_COMPARED = {
    "campaigns_per_second",
    "seconds",
    "iterations",
    "sha256",
    "version",
    "options",
    "date",
    "file",
    "run",
    "path",
    "out",
    "folder",
}
_PROSE = {"words", "reason", "reasons", "warnings", "adequacy", "title", "description", "text", "notes", "headline"}
_PROSE |= {"measure_next", "why", "why_not", "what", "scaling", "source"}
_SKIPPED_FILES = {"config.json", "SHA256SUMS", "README.txt", "provenance.json", "result.json", "parameters.json"}
_TABLES_AND_MODELS = {".csv", ".json", ".toml", ".txt", ".urdf", ".xml", ".yaml", ".conf", ".py"}
_PROGRAMS = {".mod", ".script", ".src", ".dat", ".ls", ".dtx", ".jbi", ".pgx"}
_NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])")
_COMMENT = re.compile(r"<!--.*?-->|^\s*(?:#|;|!|//).*?$|^\s*\"\"\".*?\"\"\"", re.DOTALL | re.MULTILINE)


@dataclass(frozen=True)
class Difference:
    """The difference of two answers of one command.

    Attributes:
        name: of the command.
        estimates: largest difference of a parameter over its standard deviation; NaN where there are none.
        intervals: the same of the ends of intervals.
        numbers: largest relative difference of any other number.
        where: place of that number.
        compared: how many numbers were compared.
        decisions: what is decided otherwise: place, before, after.
    """

    name: str
    estimates: float
    intervals: float
    numbers: float
    where: str
    compared: int
    decisions: tuple[str, ...]

    @property
    def same(self) -> bool:
        """Whether nothing is decided otherwise and every number is within its bound."""
        apart = max(0.0 if math.isnan(each) else each for each in (self.estimates, self.intervals))
        return not self.decisions and apart <= _LEAST and self.numbers <= _LEAST_NUMBER


def difference(
    name: str, before: Mapping[str, Any], after: Mapping[str, Any], renamed: Mapping[str, Any] = MappingProxyType({})
) -> Difference:
    """Compare two answers, each with ``exit``, ``result``, ``parameters`` and the numbers of its ``files``.

    What only the second has, as a key that a later version added, is not compared.

    Args:
        renamed: new names of keys by the old ones; those of one command in a mapping under its name.
    """
    own = renamed.get(re.split(r"\W", name)[0], {})
    keys = {old: new for old, new in renamed.items() if isinstance(new, str)} | dict(own)
    estimates, intervals, compared, decisions = [math.nan], [math.nan], 0, []
    second = {row["name"]: row for row in after["parameters"]}
    for row in before["parameters"]:
        other = second.get(row["name"])
        if other is None or row["status"] != other["status"]:
            decisions.append(f"{row['name']}: {row['status']}, {other and other['status']}")
        elif row["std"]:
            estimates.append(_apart([row["estimate"]], [other["estimate"]]) / row["std"])
            intervals.append(_apart(row["interval_95"], other["interval_95"]) / row["std"])
            compared += 3
    numbers, where = 0.0, ""
    there = dict(_leaves({key: after.get(key) for key in ("exit", "result", "files")}))
    for place, value in _leaves({key: before.get(key) for key in ("exit", "result", "files")}):
        parts = set(place.split("/"))
        if _NOT_COMPARED & parts or (_PROSE & parts and isinstance(value, str)):
            continue
        place = "/".join(keys.get(part, part) for part in place.split("/"))
        if place not in there:
            decisions.append(f"{place}: {value}, missing")
            continue
        other = there[place]
        if isinstance(value, int) and isinstance(other, int) and value != other:
            decisions.append(f"{place}: {value}, {other}")
        elif _is_number(value) and _is_number(other):
            compared += 1
            if value != other and not (math.isnan(value) and math.isnan(other)):
                apart = abs(value - other) / max(abs(value), _FLOOR)
                if apart > numbers or math.isnan(apart):
                    numbers, where = (math.inf if math.isnan(apart) else apart), place
        elif value != other:
            decisions.append(f"{place}: {value}, {other}")
    return Difference(name, _largest(estimates), _largest(intervals), numbers, where, compared, tuple(decisions))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _largest(values: Sequence[float]) -> float:
    found = [each for each in values if not math.isnan(each)]
    return max(found) if found else math.nan


def _apart(before: Sequence[float | None] | None, after: Sequence[float | None] | None) -> float:
    """Return the largest difference of numbers; infinite where there is one on one side alone."""
    if len(before or ()) != len(after or ()):
        return math.inf
    pairs = zip(before or (), after or (), strict=True)
    return max((0.0 if a == b else math.inf if a is None or b is None else abs(a - b) for a, b in pairs), default=0.0)


def _leaves(value: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every number and word of an answer with its place, and the length of each list."""
    if isinstance(value, list):
        yield f"{place}/length", len(value)
    if isinstance(value, dict | list):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _leaves(part, f"{place}/{key}")
    else:
        yield place, value


def numbers_of(file: Path) -> Any:
    """Return what a file holds: of JSON its values, of an exported arm where its points are, of text its numbers."""
    text = file.read_text(encoding="utf-8", errors="replace")
    if file.suffix == ".json":
        return json.loads(text)
    if file.suffix == ".py" and "\nMODEL" in text:
        return _points_of_arm(text)
    if file.suffix == ".py":
        found = tokenize.generate_tokens(io.StringIO(text).readline)
        return [float(each.string) for each in found if each.type == tokenize.NUMBER and "x" not in each.string]
    return [float(each) for each in _NUMBER.findall(_COMMENT.sub("", text))]


def _points_of_arm(program: str) -> list[Any]:
    """Run an exported arm: where its points are at five positions of its joints, all conditions at one."""
    arm: dict[str, Any] = {}
    exec(compile(program, "calibrated.py", "exec"), arm)
    model = arm["MODEL"]
    joints = [[0.1 * (k + 1) * (-1) ** j / (j + 1) for j in range(len(model["joint_names"]))] for k in range(5)]
    return [arm["forward"](each, **dict.fromkeys(model["conditions"], 1.0)) for each in joints]


def _run(root: Path, folder: Path, name: str, words: str) -> Mapping[str, Any]:
    """Return the answer of a command with a checkout: what it printed, its exit code, and the files of its run."""
    own = folder / re.sub(r"\W+", "-", name)
    answered = own.with_name(own.name + ".answer.json")
    if not answered.exists():
        asked = words.split()
        out = Path(asked[asked.index("--out") + 1]) if "--out" in asked else own
        if asked and "--out" not in asked and asked[0] != "inspect":
            asked += ["--out", str(own)]
        if asked and asked[0] != "history" and "--no-recording" in _help(root, asked[0]):
            asked.append("--no-recording")
        surroundings = os.environ | {"PYTHONPATH": str(root), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "lab", *asked, "--json"] if asked else [sys.executable, "-c", _CALL]
        done = subprocess.run(command, cwd=root, env=surroundings, capture_output=True, text=True)
        if not done.stdout:
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            raise SystemExit(f"{' '.join(asked) or name} with {root}: {last}")
        parameters = out / "parameters.json"
        files = (
            sorted(each for each in out.rglob("*") if each.suffix in _TABLES_AND_MODELS | _PROGRAMS)
            if out.is_dir()
            else []
        )
        kept = {
            each.relative_to(out).as_posix().replace(root.name, ""): numbers_of(each)
            for each in files
            if each.name not in _SKIPPED_FILES and each.stat().st_size < 5e6
        }
        text = done.stdout.replace(str(folder.parent), "").replace("/before/", "/").replace("/after/", "/")
        result = json.loads(text.replace(str(root), ""))
        answer = {
            "exit": done.returncode,
            "result": result,
            "parameters": json.loads(parameters.read_text(encoding="utf-8")) if parameters.exists() else [],
            "files": kept,
        }
        answered.write_text(json.dumps(answer), encoding="utf-8")
    read: Mapping[str, Any] = json.loads(answered.read_text(encoding="utf-8"))
    return read


_HELP: dict[tuple[Path, str], str] = {}


def _help(root: Path, command: str) -> str:
    """Return the help of a command."""
    if (root, command) not in _HELP:
        surroundings = os.environ | {"PYTHONPATH": str(root)}
        asked, text = [sys.executable, "-m", "lab", command], ""
        for flag in ("--help", "--help-all"):  # an older checkout has the first alone
            text += subprocess.run([*asked, flag], cwd=root, env=surroundings, capture_output=True, text=True).stdout
        _HELP[root, command] = text
    return _HELP[root, command]


def write_inputs(folder: Path, first: Path) -> None:
    """Write the files that commands read, from a simulated campaign of the first checkout."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "Pick.mod").write_text(_PROGRAM)
    (folder / "grid.toml").write_text(_GRID)
    soft = first / "soft" / "measurements.csv"
    if soft.exists():
        (folder / "soft.csv").write_text("".join(soft.read_text(encoding="utf-8").splitlines(keepends=True)[:5]))
    measured = first / "default" / "measurements.csv"
    if not measured.exists() or (folder / "goals.csv").exists():
        return
    lines = measured.read_text(encoding="utf-8").splitlines()
    header, rows = lines[0].split(","), [line.split(",") for line in lines[1:]]
    x = header.index("p1_x_mm") if "p1_x_mm" in header else next(i for i, name in enumerate(header) if "x" in name)
    joints = range(1 if header[0] in ("id", "pose") else 0, x)
    joints = [i for i in joints if header[i].startswith("q")]
    goals = [",".join(header[i] for i in joints), *(",".join(row[i] for i in joints) for row in rows[:4])]
    (folder / "goals.csv").write_text("\n".join(goals) + "\n")
    (folder / "few.csv").write_text("\n".join(lines[:5]) + "\n")
    moved = [[*row[:x], str(float(row[x]) + 1.0 * (i >= len(rows) // 2)), *row[x + 1 :]] for i, row in enumerate(rows)]
    (folder / "moved.csv").write_text("\n".join([lines[0], *(",".join(row) for row in moved)]) + "\n")
    (folder / "points.txt").write_text("".join(f"P{i} {' '.join(row[x : x + 3])}\n" for i, row in enumerate(rows[:8])))
    named = [f"P{i}," + ",".join(row[j] for j in joints) for i, row in enumerate(rows[:8])]
    unit = "rad" if "rad" in header[joints[0]] else "deg"
    heads = ",".join(f"J{j + 1} ({unit})" for j in range(len(joints)))
    (folder / "joints.csv").write_text("\n".join([f"Pose,{heads}", *named]) + "\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the commands with both checkouts, print the differences, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path, help="root of the checkout whose answers are the reference")
    parser.add_argument("after", type=Path, help="root of the other checkout")
    parser.add_argument("--folder", type=Path, required=True, help="where answers are kept")
    parser.add_argument("--data", type=Path, required=True, help="folder of measured arms")
    parser.add_argument("--only", action="append", default=[], help="run only the commands whose name has this in it")
    parser.add_argument("--renamed", type=Path, help="TOML file of the keys that were renamed")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    given = parser.parse_args(arguments)
    for root in (given.before, given.after):
        if not (root / "lab" / "__main__.py").is_file():
            parser.error(f"{root} is no checkout of the lab: it has no lab/__main__.py")
    renamed = {} if given.renamed is None else tomllib.loads(given.renamed.read_text(encoding="utf-8"))
    folder = given.folder.resolve()
    first, inputs = folder / "before", folder / "inputs"
    sides = [(given.before.resolve(), first)]
    if given.after.resolve() != given.before.resolve():
        sides.append((given.after.resolve(), folder / "after"))
    found = []
    for name, words in COMMANDS.items():
        if given.only and not any(each in name for each in given.only):
            continue
        write_inputs(inputs, first)
        answers = []
        for root, own in sides:
            own.mkdir(parents=True, exist_ok=True)
            places = {"own": own, "first": first, "inputs": inputs, "data": given.data.resolve()}
            answers.append(_run(root, own, name, words.format(**places)))
        found.append(difference(name, answers[0], answers[-1], renamed))
        if not given.json:
            made = found[-1]
            text = "same" if made.same else "; ".join(made.decisions[:8]) or "numbers differ"
            print(f"{name}: {made.compared} numbers, parameters {made.estimates:.1e} σ, intervals {made.intervals:.1e} "
                  f"σ, others {made.numbers:.1e} {made.where}: {text}", flush=True)  # fmt: skip
    same = sum(each.same for each in found)
    if given.json:
        print(json.dumps({each.name: vars(each) | {"same": each.same} for each in found}))
    else:
        count = sum(each.compared for each in found)
        print(f"{same} of {len(found)} commands give the same answers ({count:,} numbers)")
    return int(same < len(found))


if __name__ == "__main__":
    raise SystemExit(main())
