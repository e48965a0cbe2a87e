"""Pages of the reference: every command with every option, every object with its arguments, types and units."""

import dataclasses
import inspect
import re
import sys
from importlib import import_module

import pytest
from helpers.robots import ROOT

import lab
from lab.cli.commands import all_commands
from lab.cli.help_text import options_of_command

pytest.importorskip("sphinx")
pytestmark = pytest.mark.thorough  # sphinx is of the extra docs
EXTENSIONS = ROOT / "docs" / "_extensions"
sys.path.insert(0, str(EXTENSIONS))
try:
    commands, interface, sidebar = map(import_module, ("command_pages", "interface", "sidebar"))
finally:
    sys.path.remove(str(EXTENSIONS))
OBJECTS = {each.path: each for group in interface.documented().values() for each in group}
CALLS = [path for path, each in OBJECTS.items() if each.is_call]
CLASSES = [path for path, each in OBJECTS.items() if not each.is_call]


def test_every_public_name_has_a_page_of_its_own() -> None:
    assert {path for path in OBJECTS if ":" not in path} == set(lab.__all__) - {"__version__"}
    pages = [each.page.lower() for each in OBJECTS.values()]
    assert len(set(pages)) == len(pages)  # also where files do not differ in capitals


def test_every_group_is_on_the_page_of_the_interface() -> None:
    text = (ROOT / "docs" / "reference" / "interface.md").read_text(encoding="utf-8")
    assert re.findall(r"^\.\. interface-index:: (.+)$", text, re.MULTILINE) == list(interface.documented())


@pytest.mark.parametrize("path", CALLS)
def test_a_call_shows_every_argument_with_type_default_and_meaning(path: str) -> None:
    each = OBJECTS[path]
    page = interface.call_page(each)
    rows = dict(re.findall(r"\* - ``(\w+)``\n\n((?:.|\n)*?)(?=\n   \* -|\n\n\S|\Z)", page))
    assert set(rows) == set(inspect.signature(each.value).parameters)
    for name, row in rows.items():
        kind, default, meaning = re.findall(r"^     -(.*)$", row, re.MULTILINE)
        assert kind.strip() and default.strip() and meaning.strip(), f"{path}: {name}"
    assert {"Returns", "Raises"} <= set(each.sections) or inspect.signature(each.value).return_annotation is None


@pytest.mark.parametrize("path", CLASSES)
def test_a_class_shows_every_attribute_with_type_and_meaning(path: str) -> None:
    each = OBJECTS[path]
    found = interface.attributes(each)
    for name, (kind, _, meaning) in found.items():
        assert kind and meaning, f"{path}: {name}"
    if dataclasses.is_dataclass(each.value) and not each.only:
        names = {field.name for field in dataclasses.fields(each.value) if not field.name.startswith("_")}
        assert names <= set(found), f"{path}: {names - set(found)} undocumented"
    assert set(each.only) <= set(found) | set(interface.methods(each))
    assert all((getattr(each.value, name).__doc__ or "").strip() for name in interface.methods(each))


@pytest.mark.parametrize("command", all_commands(), ids=lambda command: command.name)
def test_a_command_shows_every_option_once_with_an_anchor(command) -> None:
    page, options = commands.command_page(command), options_of_command(command)
    anchors = re.findall(rf"\.\. _lab-{command.name}-([\w-]+):", page)
    assert sorted(anchors) == sorted(each.name.replace("_", "-") for each in options)
    assert all(example in page for example in command.examples)
    for each in options:
        assert (each.name.upper() if each.positional else each.flag) in page
        assert commands.meaning(each.help) in page or "\n\n" in each.help
