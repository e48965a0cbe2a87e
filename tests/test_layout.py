"""How the project is laid out: tests beside what they test, modules that take of each other what is public.

All of it is read from the sources, nothing is imported.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from helpers.robots import ROOT

MODULES = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in sorted(ROOT.glob("lab/**/*.py"))}
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
