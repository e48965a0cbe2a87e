"""Public things that are renamed work, with a warning, before they go: what the page on stability promises."""

import json

import pytest
from helpers.public_surface import RELEASED, surface

import lab
from lab.cli import main
from lab.core import deprecation
from lab.core.deprecation import COMMANDS, NAMES, OPTIONS, Renamed

RENAMED = Renamed("inspect", "9.1.0")


def numbers(version: str) -> list[int]:
    return [int(each) for each in version.split(".")]


def test_what_the_last_release_had_is_there_or_deprecated() -> None:
    released, now = json.loads(RELEASED.read_text(encoding="utf-8")), surface()
    assert set(released["names"]) <= {*now["names"], *NAMES}
    for command, options in released["commands"].items():
        present = COMMANDS[command].present if command in COMMANDS else command
        assert set(options) <= {*now["commands"][present], *OPTIONS}


def test_a_replacement_is_there_and_what_this_release_removes_is_gone() -> None:
    now = surface()
    options = {option for each in now["commands"].values() for option in each}
    for table, known in ((NAMES, set(now["names"])), (COMMANDS, set(now["commands"])), (OPTIONS, options)):
        assert not known & set(table) and {each.present for each in table.values()} <= known
        assert all(numbers(each.removed_in) > numbers(lab.__version__) for each in table.values())


def test_an_older_name_of_the_interface_warns_where_it_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(NAMES, "examine", RENAMED)
    monkeypatch.setattr("lab.core.errors._as_flags", False)
    with pytest.warns(
        DeprecationWarning, match=r"^lab\.examine is deprecated, and lab 9\.1\.0 removes it; use lab\.insp"
    ) as told:
        assert lab.examine is lab.inspect
    assert told[0].filename == __file__
    with pytest.raises(AttributeError):
        _ = lab.examined


def test_an_older_argument_of_a_call_warns_and_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(OPTIONS, "points", Renamed("targets", "9.1.0"))
    monkeypatch.setattr("lab.core.errors._as_flags", False)
    with pytest.warns(
        DeprecationWarning, match="^points is deprecated, and lab 9.1.0 removes it; use targets$"
    ) as told:
        found = lab.inspect("course2r", points=("p1",))
    assert told[0].filename == __file__ and found.to_dict() == lab.inspect("course2r", targets=("p1",)).to_dict()
    with pytest.raises((lab.LabError, TypeError)):
        lab.inspect("course2r", points=("p1",), targets=("p1",))


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ("examine course2r --json", "lab examine is deprecated, and lab 9.1.0 removes it; use lab inspect"),
        ("inspect course2r --points p1 --json", "--points is deprecated, and lab 9.1.0 removes it; use --targets"),
        ("inspect course2r --points=p1 --json", "--points is deprecated, and lab 9.1.0 removes it; use --targets"),
    ],
)
def test_an_older_command_or_flag_is_told_in_a_line_and_taken(
    arguments: str, line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(deprecation.COMMANDS, "examine", RENAMED)
    monkeypatch.setitem(deprecation.OPTIONS, "points", Renamed("targets", "9.1.0"))
    assert main(arguments.split()) == 0
    printed = capsys.readouterr()
    assert printed.err == f"lab: warning: {line}\n" and json.loads(printed.out)["rank"] > 0
