"""Measure the structure of a checkout: modules, lines, imports, circles, and what one identification enters.

Usage: ``python scripts/maintenance/structure.py [ROOT] [--measurements FILE]``.

Prints one JSON object. Files are read as text; only the last four rows run something: ``lab identify`` on a measurement
file, with every call between modules noted.
"""

import argparse
import ast
import io
import json
import statistics
import subprocess
import sys
import tempfile
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

_TRACE = """
import atexit, json, sys
from pathlib import Path
root, out = Path(sys.argv[1]).resolve() / "lab", Path(sys.argv[2])
pairs, functions, names = set(), set(), {}  # what runs while modules are imported is not counted
def module(code):
    name = names.get(code)
    if name is None:
        path = Path(code.co_filename)
        inside = path.suffix == ".py" and path.is_relative_to(root)
        name = ".".join(path.relative_to(root.parent).with_suffix("").parts) if inside else ""
        names[code] = name = name if code.co_flags & 1 or not inside else "import"  # the body of a module or class
    return name
def profile(frame, event, _):
    if event == "call" and (name := module(frame.f_code)) not in ("", "import"):
        caller = frame.f_back
        while caller is not None and not module(caller.f_code):
            caller = caller.f_back
        by = "" if caller is None else module(caller.f_code)
        if by == "import":
            return
        functions.add(frame.f_code)
        pairs.add((by, name))
atexit.register(lambda: (sys.setprofile(None), out.write_text(json.dumps([sorted(pairs), len(functions)]))))
try:
    from lab.cli.main import main
except ImportError:  # of an earlier checkout
    from lab.cli import main
sys.argv = ["lab", "identify", sys.argv[3], "--out", sys.argv[4], "--json"]
sys.setprofile(profile)
main()
"""


def _modules(root: Path) -> dict[str, ast.Module]:
    """Return every module of the package by its name."""
    found = {}
    for path in sorted((root / "lab").rglob("*.py")):
        parts = path.relative_to(root).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = ast.parse(path.read_text(encoding="utf-8"))
    return found


def _imported(tree: ast.AST, modules: Mapping[str, ast.Module]) -> Iterator[str]:
    """Yield the package's modules that a module imports anywhere in it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names if each.name in modules)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            whole = [f"{node.module}.{each.name}" for each in node.names]
            yield from (each for each in whole if each in modules)
            if node.module in modules and any(each not in modules for each in whole):
                yield node.module


def _circles(imports: Mapping[str, set[str]]) -> list[list[str]]:
    """Return the strongly connected sets of more than one module (Tarjan 1972)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in sorted(imports[name]):
            if other not in index:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], index[other])
        if low[name] == index[name]:
            circle = []
            while not circle or circle[-1] != name:
                circle.append(stack.pop())
            if len(circle) > 1:
                found.append(sorted(circle))

    sys.setrecursionlimit(10_000)
    for name in imports:
        if name not in index:
            visit(name)
    return found


def _public(tree: ast.Module) -> int:
    """Count the names without an underscore that a module defines."""
    count = 0
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            count += not node.name.startswith("_")
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = [each.id for target in targets for each in ast.walk(target) if isinstance(each, ast.Name)]
            count += sum(not name.startswith("_") for name in names)
    return count


def _complexity(function: ast.AST) -> int:
    """Count the decisions of a function, conditions of expressions and comprehensions among them, and one."""
    branches = ast.If | ast.For | ast.While | ast.ExceptHandler | ast.IfExp | ast.Assert | ast.match_case
    count = 1
    for node in ast.walk(function):
        if isinstance(node, branches):
            count += 1
        elif isinstance(node, ast.comprehension):
            count += 1 + len(node.ifs)
        elif isinstance(node, ast.BoolOp):
            count += len(node.values) - 1
    return count


def _comment_lines(text: str) -> int:
    """Count the comments that have a line of their own."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return sum(token.type == tokenize.COMMENT and token.line.lstrip().startswith("#") for token in tokens)


_SHELL = ("cli", "commands", "options", "render", "report", "phrases")  # parse, print or draw; of earlier checkouts too
_DRAWING = ("lab.render", "lab.report")  # who imports these, draws too


def _is_shell(name: str, imports: set[str]) -> bool:
    """Check whether a module of the core parses, prints or draws."""
    return name.split(".")[1:2] in [[room] for room in _SHELL] or any(each.startswith(_DRAWING) for each in imports)


def _lines_of(tree: ast.Module) -> tuple[set[int], set[int], set[int]]:
    """Return the numbers of the lines of docstrings, of imports and ``__all__``, and of all else with code."""
    docstrings, formal, code = set[int](), set[int](), set[int]()
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        first = body[0] if isinstance(body, list) and body else None
        if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant) and isinstance(first.value.value, str):
            docstrings |= set(range(first.lineno, (first.end_lineno or first.lineno) + 1))
        listed = isinstance(node, ast.Assign) and any(ast.unparse(each) == "__all__" for each in node.targets)
        if isinstance(node, ast.Import | ast.ImportFrom) or listed:
            formal |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        if isinstance(node, ast.stmt | ast.expr | ast.arg | ast.keyword | ast.alias):
            code |= {node.lineno, node.end_lineno or node.lineno}
    return docstrings, formal, (code | formal) - docstrings


def _walk(root: Path, measurements: Path, rooms: Mapping[str, int]) -> dict[str, Any]:
    """Run ``lab identify`` and count the modules that it enters, and the calls into a room above the caller's."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "calls.json"
        command = [sys.executable, "-c", _TRACE, str(root), str(out), str(measurements.resolve()), f"{folder}/run"]
        done = subprocess.run(
            command, cwd=root, env={"PYTHONPATH": str(root), "PATH": ""}, capture_output=True, text=True
        )
        if not out.exists():
            raise SystemExit(done.stderr)
        pairs, functions = json.loads(out.read_text(encoding="utf-8"))
    calls = {(a, b) for a, b in pairs if a and a != b}
    room = {name: rooms.get(".".join(name.split(".")[1:2]), 0) for pair in calls for name in pair}
    return {
        "modules entered by identify": len({b for _, b in pairs}),
        "functions entered by identify": functions,
        "pairs of modules that call each other both ways": sum((b, a) in calls for a, b in calls) // 2,
        "calls into a room above": sum(room[b] > room[a] for a, b in calls),
    }


def _rooms(root: Path) -> dict[str, int]:
    """Return the height of each room in the import contract."""
    import tomllib

    contracts = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = next(each["layers"] for each in contracts if each["type"] == "layers")
    return {name.strip(): -i for i, layer in enumerate(layers) for name in layer.replace(":", "|").split("|")}


def structure(root: Path, measurements: Path | None = None) -> dict[str, Any]:
    """Return the figures of a checkout.

    Args:
        root: of the checkout.
        measurements: a file that ``lab identify`` is run on; without it nothing is run.
    """
    modules = _modules(root)
    texts = {name: ast.unparse(tree) for name, tree in modules.items()}
    files = {path: path.read_text(encoding="utf-8").splitlines() for path in (root / "lab").rglob("*.py")}
    full = [name for name in texts if len(modules[name].body) > 1]
    lines = dict.fromkeys(modules, 0)
    for path, text in files.items():
        parts = path.relative_to(root).with_suffix("").parts
        lines[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = len(text)
    kinds = [_lines_of(tree) for tree in modules.values()]
    imports = {name: set(_imported(tree, modules)) - {name} for name, tree in modules.items()}
    importers = defaultdict(set)
    for name, taken in imports.items():
        for other in taken:
            importers[other].add(name)
    outside = [name for name in modules if not name.startswith("lab.extensions")]
    circles = _circles(imports)
    code = sum(len(each) for _, _, each in kinds)
    functions = [
        node
        for tree in modules.values()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    public_classes = Counter(
        node.name
        for tree in modules.values()
        for node in tree.body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    file_names = Counter(path.name for path in files if path.name != "__init__.py")
    found: dict[str, Any] = {
        "modules": len(modules),
        "lines": sum(lines.values()),
        "lines of code": code,
        "modules outside extensions": len(outside),
        "lines outside extensions": sum(lines[name] for name in outside),
        "lines that parse, print or draw, outside extensions": sum(
            lines[name] for name in outside if _is_shell(name, imports[name])
        ),
        "lines of comments": sum(_comment_lines("\n".join(text) + "\n") for text in files.values()),
        "functions above complexity 10": sum(_complexity(each) > 10 for each in functions),
        "public class names in several modules": sum(count > 1 for count in public_classes.values()),
        "file names in several rooms": sum(count > 1 for count in file_names.values()),
        "median lines of a module": statistics.median(lines[name] for name in full),
        "imports and __all__, share of code": round(sum(len(each) for _, each, _ in kinds) / code, 3),
        "modules with one importer": sum(len(importers[name]) == 1 for name in full),
        "modules below 60 lines": sum(lines[name] < 60 for name in full),
        "circles of modules": len(circles),
        "modules in circles": sum(map(len, circles)),
        "top-level public names": sum(map(_public, modules.values())),
        "classes": sum(isinstance(node, ast.ClassDef) for tree in modules.values() for node in ast.walk(tree)),
        "imports inside functions": sum(
            isinstance(node, ast.Import | ast.ImportFrom)
            for tree in modules.values()
            for function in ast.walk(tree)
            if isinstance(function, ast.FunctionDef)
            for node in ast.walk(function)
        ),
        "modules that name a flag": sum("'--" in text or " --" in text for text in texts.values()),
    }
    if measurements is not None:
        found |= _walk(root, measurements, _rooms(root))
    return found


def main() -> None:
    """Print the figures of a checkout."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path, nargs="?", default=Path(__file__).resolve().parents[2])
    parser.add_argument("--measurements", type=Path, help="a file of an IRB 120, on which lab identify is run")
    given = parser.parse_args()
    print(json.dumps(structure(given.root.resolve(), given.measurements), indent=1))


if __name__ == "__main__":
    main()
