"""Write shell completion of commands, flags and words that options take: a script for bash, zsh or fish."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from lab.campaign.model_files import own_models
from lab.commands.help_text import HELP_FLAGS, Option, options_of_command
from lab.commands.registry import Command, all_commands
from lab.core.errors import LabError
from lab.sensors.registry import SENSORS

__all__ = ["SHELLS", "completion_script"]

SHELLS = ("bash", "zsh", "fish")
_GENERAL = ("--help", "--version", "--completion")
_ROBOTS = ("robot", "robots")  # fields whose value is a name or a file
_LONGEST = 70  # characters of a description

_BASH = """\
_lab() {{
    local current=${{COMP_WORDS[COMP_CWORD]}} words=
    case "${{COMP_WORDS[1]}} ${{COMP_WORDS[COMP_CWORD-1]}}" in
{words}
    *) if [[ $current == -* ]]; then
        case ${{COMP_WORDS[1]}} in
{flags}
        esac
    else
        case ${{COMP_WORDS[1]}} in
{places}
        esac
    fi ;;
    esac
    if [ "$COMP_CWORD" = 1 ]; then words="{commands}"; fi
    COMPREPLY=($(compgen -W "$words" -- "$current"))
}}
complete -o default -F _lab lab
"""
_ZSH = "autoload -U +X compinit && compinit -u\nautoload -U +X bashcompinit && bashcompinit\n"


def completion_script(shell: str) -> str:
    """Return the script that makes a shell complete the arguments of ``lab``; file names where nothing else fits.

    Commands, options and robots are those of now: write it again when one is added.

    Raises:
        LabError: the shell is none of ``SHELLS``.
    """
    if shell not in SHELLS:
        raise LabError(f"--completion {shell}".rstrip() + f": give {', '.join(SHELLS[:-1])} or {SHELLS[-1]}")
    known = {command: [_with_words(each) for each in options_of_command(command)] for command in all_commands()}
    if shell == "fish":
        return "\n".join(_fish(known)) + "\n"
    words = [f'    "--completion --completion") words="{" ".join(SHELLS)}" ;;']
    flags, places = list[str](), list[str]()
    for command, options in known.items():
        names = [*(each.flag for each in options if not each.positional), *HELP_FLAGS[1:]]
        flags.append(f'        {command.name}) words="{" ".join(names)}" ;;')
        for each in options:
            if each.choices:
                before, lines = (command.name, places) if each.positional else (f'"{command.name} {each.flag}"', words)
                lines.append(f'    {before}) words="{" ".join(each.choices)}" ;;')
    commands = " ".join([*(each.name for each in known), *_GENERAL])
    function = _BASH.format(commands=commands, words="\n".join(words), flags="\n".join(flags), places="\n".join(places))
    return _ZSH + function if shell == "zsh" else function


def _with_words(option: Option) -> Option:
    """Return an option with its words: of a robot the names of the lab's own, beside which a shell proposes files."""
    if option.name == "observe":  # several names may be joined, so that the option itself has no choices
        return replace(option, choices=tuple(SENSORS))
    return replace(option, choices=tuple(own_models())) if option.name in _ROBOTS else option


def _fish(known: Mapping[Command, Sequence[Option]]) -> Iterator[str]:
    for flag in _GENERAL:
        values = f" -xa '{' '.join(SHELLS)}'" if flag == "--completion" else ""
        yield f"complete -c lab -n __fish_use_subcommand -l {flag[2:]}{values}"
    for command, options in known.items():
        yield f"complete -c lab -n __fish_use_subcommand -fa {command.name} -d {_quoted(command.help)}"
        inside = f"complete -c lab -n '__fish_seen_subcommand_from {command.name}'"
        for option in options:
            if option.positional:
                if option.choices:
                    yield f"{inside} -a '{' '.join(option.choices)}'"
                if not option.choices or option.name in _ROBOTS:
                    yield f"{inside} -F"
                continue
            only = "-ra" if option.name in _ROBOTS else "-xa"  # a robot may be a file
            value = f" {only} '{' '.join(option.choices)}'" if option.choices else " -r" if option.metavar else ""
            yield f"{inside} -l {option.flag[2:]}{value} -d {_quoted(option.help)}"
        for flag in HELP_FLAGS[1:]:
            yield f"{inside} -l {flag[2:]}"


def _quoted(text: str) -> str:
    """Return the beginning of a text as a word of fish."""
    line = " ".join(text.split())
    if len(line) > _LONGEST:
        line = line[:_LONGEST].rpartition(" ")[0] + " …"
    return "'" + line.replace("\\", "\\\\").replace("'", "\\'") + "'"
