"""Count the lines that three jobs take with the lab and with its peers, and run them in environments of their own.

The jobs are in ``scripts/peers``: a fit from arrays, a fit of an own residual, and an own study. A job's lines are
those that one has to write for it: of its function and of every function, class and constant of its script that it
uses, with a settings file that it needs. Blank lines, comments, docstrings and imports are not counted. Give the
Python of each peer's environment, such as ``pybotics=env/bin/python``; without any, the lines alone are counted.
"""

import ast
import json
import subprocess
import sys
import tempfile
from argparse import ArgumentParser
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import lab

FOLDER = Path(__file__).with_name("peers")
PEERS = {"lab": (), "pybotics": (), "figaroh": ("figaroh.yaml",), "mujoco": ()}
JOBS = ("fit", "own_residual", "study")
TABLE = [[0, 290, 0, -90], [-90, 0, 270, 0], [0, 0, 70, -90], [0, 302, 0, 90], [0, 0, 0, -90], [180, 72, 0, 0]]


def lines_of(source: str, job: str) -> int:
    """Return the lines of code of a job: its own, and those of what it uses of its module."""
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
    """Return the lines of each job of each package."""
    found = {}
    for peer, settings in PEERS.items():
        source = (FOLDER / f"{peer}_jobs.py").read_text(encoding="utf-8")
        more = sum(len((FOLDER / name).read_text(encoding="utf-8").split("\n")) - 1 for name in settings)
        found[peer] = {job: lines_of(source, job) + more for job in JOBS}
    return found


def prepare(folder: Path) -> Path:
    """Write the arrays of a simulated session, and the nominal robot as TOML, MJCF and URDF."""
    robot = lab.robot_from_dh(TABLE, unit="mm", joint_unit="deg", tool={"p1": [60, 0, 40]}, path=folder / "arm.toml")
    day = lab.simulate(robot, poses=60, seed=7)
    fresh, rows = day.validation, day.measurements
    np.savez(
        folder / "arrays.npz",
        joints=rows.joints, points=rows.points[:, 0], new_joints=fresh.joints, new_points=fresh.points[:, 0],
    )  # fmt: skip
    for kind in ("xml", "urdf"):
        text = robot.description(f"calibrated.{kind}", ("p1",), robot.parameter_values())
        (folder / f"arm.{kind}").write_text(text, encoding="utf-8")
    return folder / "arrays.npz"


def ran(peer: str, python: str, arrays: Path) -> dict[str, Any]:
    """Run the jobs of a package in its environment: what each found, its seconds, and the package's version."""
    about = (
        f"import importlib.metadata as m; print(m.version({'virtual-calibration-lab' if peer == 'lab' else peer!r}))"
    )
    version = subprocess.run([python, "-c", about], capture_output=True, text=True, check=True, cwd=arrays.parent)
    script = str(FOLDER / f"{peer}_jobs.py")
    done = subprocess.run(
        [python, script, str(arrays)], capture_output=True, text=True, check=True, cwd=arrays.parent, timeout=3600
    )
    return {"version": version.stdout.strip(), **json.loads(done.stdout.splitlines()[-1])}


def main(arguments: list[str]) -> int:
    """Print a table, or JSON."""
    parser = ArgumentParser("peers_lines.py", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("environments", nargs="*", metavar="PEER=PYTHON", help=f"of {', '.join(PEERS)}")
    parser.add_argument("--json", action="store_true", help="print the result as one JSON object")
    given = parser.parse_args(arguments)
    pythons = dict(each.split("=", 1) for each in given.environments)
    found: dict[str, dict[str, Any]] = {peer: {"lines": lines} for peer, lines in counted().items()}
    with tempfile.TemporaryDirectory() as folder:
        arrays = prepare(Path(folder)) if pythons else None
        for peer, python in pythons.items():
            assert arrays is not None
            found[peer] |= ran(peer, python, arrays)
    if given.json:
        print(json.dumps(found))
        return 0
    for peer, each in found.items():
        print(f"{peer} {each.get('version', '')}: {each['lines']}")
        for job in (job for job in JOBS if job in each):
            mm = each[job]["mm"]
            shown = ", ".join(f"{value:.4f}" for value in (mm.values() if isinstance(mm, dict) else (mm,)))
            print(f"  {job}: {shown} mm in {each[job]['seconds']:.1f} s")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
