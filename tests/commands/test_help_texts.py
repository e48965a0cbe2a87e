"""What the help of commands says of what may be given."""

import re
import shlex

import pytest

from lab.cli.command_line import parsed
from lab.cli.commands import all_commands, command_named
from lab.cli.help_text import HELP_FLAGS, grouped, help_text, options_of_command
from lab.cli.main import main
from lab.noise.instruments import INSTRUMENTS, observers
from lab.options.command import Command


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


@pytest.mark.parametrize("command", all_commands(), ids=lambda each: each.name)
def test_examples_in_the_help_are_accepted(command: Command) -> None:
    """They are parsed, and their values pass the options' own checks."""
    assert len(command.examples) == 2
    shown = help_text(command, width=80)
    for example in command.examples:
        options = parsed(command, shlex.split(example)).options
        for name in ("refuse_nonsense", "check"):
            if callable(check := getattr(options, name, None)):
                check()
                break
        assert f"  lab {command.name} {example}" in shown.splitlines()


@pytest.mark.parametrize("command", all_commands(), ids=lambda each: each.name)
def test_every_option_is_in_one_group_of_the_whole_help(command: Command) -> None:
    options = options_of_command(command)
    every = [each.name for group in grouped(command, options, every=True).values() for each in group]
    assert sorted(every) == sorted(each.name for each in options if not each.positional)
    assert "more options" not in grouped(command, options, every=True)  # a new option is put into a group
    known = {each.name for each in options} | {each.group for each in options}
    assert {name for group in command.groups for name in (*group.common, *group.more)} <= known
    brief, whole = help_text(command, width=100), help_text(command, every=True, width=100)
    flags = [set(re.findall(r"^  (--[a-z0-9-]+)", text, re.MULTILINE)) for text in (brief, whole)]
    hidden = len(flags[1] - flags[0])
    assert flags[0] <= flags[1] == {each.flag for each in options if not each.positional}
    assert brief.endswith(f"\n{hidden} more: lab {command.name} --help-all") == (hidden > 0)


def test_defaults_are_those_of_the_options_or_of_an_earlier_run() -> None:
    command, names = command_named("calibrate"), ("seed", "backlash_mrad", "robust")
    given = parsed(command, ["--seed", "5", "--backlash-mrad", "0.25", "--robust"]).options
    shown = [{each.name: each.default for each in options_of_command(command, options)} for options in (None, given)]
    assert [[each[name] for name in names] for each in shown] == [["0", "", ""], ["5", "0.25", "given"]]
    assert "(default: 5)" in help_text(command, every=True, defaults=given)


@pytest.mark.parametrize("flag", HELP_FLAGS)
def test_help_is_printed_whatever_else_is_given(flag: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["import", "--no-such-option", flag])
    assert stop.value.code == 0
    assert capsys.readouterr().out.rstrip() == help_text(command_named("import"), every=flag == "--help-all")


def test_help_lists_every_command_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    listed = re.findall(r"^  (\w+) ", capsys.readouterr().out, re.MULTILINE)
    assert sorted(listed) == sorted(command.name for command in all_commands())
