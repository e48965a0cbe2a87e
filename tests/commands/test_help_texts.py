"""What the help of commands says of what may be given."""

import re

import pytest

from lab.cli import main
from lab.commands.registry import all_commands
from lab.noise.instruments import INSTRUMENTS, observers
from lab.pose_selection.criteria import CRITERIA


def help_of(command: str, capsys: pytest.CaptureFixture[str]) -> str:
    """Return the help of a command in one line, without its frames."""
    with pytest.raises(SystemExit):
        main([command, "--help"])
    return " ".join(re.sub("[╭╮╰╯│─]", " ", capsys.readouterr().out).split())


@pytest.mark.parametrize("command", ["calibrate", "design", "identify", "verify"])
def test_help_names_the_instruments_that_there_are(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The texts are typed by hand, so that a command line is parsed without numpy."""
    lists = re.findall(r"(?:exact, )?uniform-8um, [a-z0-9, -]*? or [a-z0-9-]+", help_of(command, capsys))
    assert lists
    for listed in lists:
        named = INSTRUMENTS if "draw-wire" in listed else observers("points")
        possible = [name for name in named if name != "exact" or listed.startswith("exact")]
        assert listed == f"{', '.join(possible[:-1])} or {possible[-1]}"


def test_help_names_the_criteria_that_there_are(capsys: pytest.CaptureFixture[str]) -> None:
    assert f"{', '.join(CRITERIA[:-1])} or {CRITERIA[-1]}." in help_of("design", capsys)


@pytest.mark.thorough
@pytest.mark.parametrize("columns", [80, 140])
def test_help_of_every_command_fits_the_terminal(columns: int, monkeypatch, capsys: pytest.CaptureFixture[str]) -> None:
    """No line is longer, none is cut, and what need not be given is said in words."""
    monkeypatch.setenv("COLUMNS", str(columns))
    assert main(["--help"]) == 0
    told = {"lab": capsys.readouterr().out}
    for command in all_commands():
        with pytest.raises(SystemExit):
            main([command.name, "--help"])
        told[command.name] = capsys.readouterr().out
    for name, text in told.items():
        assert max(map(len, text.splitlines())) <= columns, name
        assert not re.search(r"None|…$|\.\.\. *│|options options", text, re.MULTILINE), name
    assert {name for name in told if told[name]} == {"lab", *(each.name for each in all_commands())}
    again = " ".join(told["certify"].split())
    assert "earlier run's config.json gives the defaults." in again
