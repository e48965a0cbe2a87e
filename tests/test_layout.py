"""How the project is laid out: tests beside what they test, modules that take of each other what is public.

All of it is read from the sources, nothing is imported.
"""

import ast
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from helpers.robots import ROOT

MODULES = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in sorted(ROOT.glob("lab/**/*.py"))}
ROOMS = sorted(path.name for path in (ROOT / "lab").iterdir() if (path / "__init__.py").is_file())
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
ENTRY_POINTS = {each.partition(":")[0] for group in PROJECT["entry-points"].values() for each in group.values()}
BLOCKS = ("body", "orelse", "finalbody", "handlers", "cases")  # the statements within a statement
TESTS = sorted((ROOT / "tests").rglob("*.py"))


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def imports_in(path: Path) -> Iterator[ast.Import | ast.ImportFrom]:
    """The import statements of a file, those within functions among them; expressions are not searched."""
    todo = [*tree_of(path).body]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        todo += [each for part in BLOCKS for each in getattr(node, part, ())]


def names_of(node: ast.Import | ast.ImportFrom) -> set[str]:
    """Every module that a statement may import."""
    names = {each.name for each in node.names}
    if isinstance(node, ast.Import):
        return names
    return {node.module, *(f"{node.module}.{name}" for name in names)} if node.module else set()


@cache
def names_in(path: Path) -> frozenset[str]:
    """Every module that a file may import: by a statement, by its name in a string, by a script that it runs."""
    names = set[str]()
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names |= names_of(node)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            if "lab." in node.value:
                names |= set(re.findall(r"lab(?:\.\w+)+", node.value))
            elif re.fullmatch(r"\w+\.py", node.value) and (script := next((ROOT / "scripts").rglob(node.value), None)):
                names |= names_in(script)
    return frozenset(names)


def reached_in(room: str) -> set[str]:
    """The modules of a room that its tests import, themselves, through others of the room, or by the command line."""
    own = {name for name in MODULES if name.startswith(f"lab.{room}.") or name.count(".") == 1}
    todo = {name for path in TESTS if path.is_relative_to(ROOT / "tests" / room) for name in names_in(path)} & own
    reached: set[str] = set()
    while todo:
        name = todo.pop()
        reached.add(name)
        found = names_in(MODULES[name]) | (ENTRY_POINTS if name == "lab.cli" else set())  # what a command may load
        todo |= (found & own) - reached
    return reached


@pytest.mark.thorough
def test_every_module_is_imported_by_a_test_of_its_folder() -> None:
    left = []
    for room in ROOMS:
        own = {name for name in MODULES if name.startswith(f"lab.{room}.") and not name.endswith("__init__")}
        left += sorted(own - reached_in(room))
    assert left == []


def public_names(path: Path) -> list[str] | None:
    """What a module says in ``__all__``; None where it says nothing."""
    for node in tree_of(path).body:
        if isinstance(node, ast.Assign) and [ast.unparse(each) for each in node.targets] == ["__all__"]:
            return list(ast.literal_eval(node.value))
    return None


@pytest.mark.thorough
def test_modules_take_of_each_other_what_is_public() -> None:
    inner = {name: path for name, path in MODULES.items() if path.stem not in ("__init__", "__main__")}
    public = {name: public_names(path) for name, path in inner.items()}
    assert [name for name, names in public.items() if names is None] == []
    taken = [
        f"{path.relative_to(ROOT)}: {node.module}.{each.name}"
        for path in MODULES.values()
        for node in imports_in(path)
        if isinstance(node, ast.ImportFrom) and node.module in public
        for each in node.names
        if each.name not in (public[node.module] or ())
    ]
    assert taken == []


def test_no_test_module_imports_another() -> None:
    """What tests share are fixtures of a ``conftest.py`` and ``tests/helpers``."""
    modules = {path.stem for path in TESTS if path.name.startswith("test_")}
    wrong = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in TESTS
        if re.search(r"(?<!def )\btest_", path.read_text(encoding="utf-8"))  # few name one: the others are not parsed
        for node in imports_in(path)
        for name in names_of(node)
        if not name.startswith("lab.") and modules & set(name.split("."))
    ]
    assert wrong == []


def test_shared_pieces_are_no_imported_fixtures() -> None:
    """A fixture that is imported into a test module needs the check of redefinitions switched off."""
    marked = [path for path in TESTS if re.search(r"noqa: .*F(401|811)", path.read_text(encoding="utf-8"))]
    assert [path for path in marked if path != Path(__file__)] == []
