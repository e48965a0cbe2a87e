"""Pages of the reference that are written while the documentation is built: one for each command, from its options.

``table``, ``unit_of`` and ``write_pages`` serve the pages of the Python interface too.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from sphinx.application import Sphinx

from lab.cli.commands import all_commands
from lab.cli.help_text import Option, grouped, options_of_command
from lab.options.command import Command

__all__ = ["anchor", "command_page", "heading", "literal", "meaning", "table", "unit_of", "value", "write_pages"]

FOLDER = Path(__file__).parents[1] / "reference" / "commands"
_UNITS = {  # by the end of an option's name, the longest first
    "nm_per_rad": "N m/rad", "ppm_per_k": "ppm/K", "mrad_per_k": "mrad/K", "ppm_per_h": "ppm/h", "mm_per_h": "mm/h",
    "mrad_per_h": "mrad/h", "per_deg": "1/°", "mm_s2": "mm/s²", "mm_s": "mm/s", "deg_s": "°/s", "kgm2": "kg m²",
    "radial_per_m": "m/m", "transverse_per_m": "m/m", "mrad": "mrad", "rad": "rad", "mm": "mm", "m": "m", "deg": "°",
    "kg": "kg", "ppm": "ppm", "px": "px", "hz": "Hz", "ms": "ms", "s": "s", "percent": "%", "days": "days",
    "hours": "h", "share": "0 to 1", "link_ei": "N m²", "link_gj": "N m²", "seconds": "s",
}  # fmt: skip
_PLAIN = {"INT": "whole number", "FLOAT": "number", "PATH": "file or folder", "STR": "text", "": "flag",
          "X,Y,…": "numbers", "A,B,…": "names", "NAME": "name", "FILE": "file"}  # fmt: skip
_FLAG = re.compile(r"(?<![\w`-])--[a-z][a-z-]*[a-z]")


def unit_of(name: str) -> str:
    """Return the unit that a name ends in; "" where it ends in none."""
    return next((unit for end, unit in _UNITS.items() if name == end or name.endswith(f"_{end}")), "")


def escaped(text: str) -> str:
    """Return plain text in which nothing is markup of reStructuredText."""
    return re.sub(r"([\\*`|_])", r"\\\1", text)


def literal(text: str) -> str:
    """Return text in the type of code; "" of "", which has no such markup."""
    return f"``{text}``" if text else ""


def meaning(text: str, of_flag: str = "{flag}") -> str:
    """Return a help text as markup: flags and commands in the type of code, an empty line as a new paragraph.

    Args:
        of_flag: how a flag is written; ``{name}`` for the name of the argument of a call.
    """
    commands = "|".join(sorted((each.name for each in all_commands()), key=len, reverse=True))
    pattern = re.compile(rf"{_FLAG.pattern}|\blab (?:{commands})\b|\b[a-zA-Z]\w*_\w+\b")

    def shown(found: re.Match[str]) -> str:
        text = found.group()
        return literal(of_flag.format(flag=text, name=text[2:].replace("-", "_")) if text.startswith("--") else text)

    paragraphs = []
    for paragraph in text.split("\n\n"):
        flat, at, parts = " ".join(paragraph.split()), 0, []
        for found in pattern.finditer(flat):
            parts += [escaped(flat[at : found.start()]), shown(found)]
            at = found.end()
        parts.append(escaped(flat[at:]))
        paragraphs.append("".join(_spaced(parts)))
    return "\n\n".join(paragraphs)


def _spaced(parts: Sequence[str]) -> list[str]:
    """Return parts of a line, with the invisible space that a literal needs beside a letter."""
    found = list(parts)
    for i in range(1, len(found), 2):
        if found[i - 1][-1:].isalnum():
            found[i] = "\\ " + found[i]
        if found[i + 1][:1].isalnum():
            found[i] += "\\ "
    return found


def heading(text: str, line: str) -> str:
    """Return a heading, underlined by a character."""
    return f"{text}\n{line * len(text)}\n"


def table(titles: Sequence[str], rows: Iterable[Sequence[str]], widths: Sequence[int]) -> str:
    """Return a table whose cells are markup; on a narrow screen a row becomes a block (docs/_static/reference.css)."""
    kind = "reference four" if len(titles) == 4 else "reference"
    lines = [".. list-table::", f"   :class: {kind}", "   :header-rows: 1", f"   :widths: {' '.join(map(str, widths))}"]
    for row in (titles, *rows):
        for number, cell in enumerate(row):
            first, *rest = cell.split("\n")
            lines += ["", f"   {'* -' if number == 0 else '  -'} {first}".rstrip()]
            lines += [f"       {line}".rstrip() for line in rest]
    return "\n".join(lines) + "\n"


def anchor(command: Command, option: Option) -> str:
    """Return the label of an option, for links to it."""
    return f"lab-{command.name}-{option.name.replace('_', '-')}"


def value(option: Option) -> str:
    """Return what is typed after an option."""
    unit = unit_of(option.name)
    if option.metavar.startswith("{") and option.choices:
        return ", ".join(map(literal, option.choices))
    if option.metavar.startswith("{"):
        choices, _, more = option.metavar[1:].partition("}")
        return ", ".join(map(literal, choices.split(","))) + ("; several joined by ``+``" if more else "")
    plain = _PLAIN.get(option.metavar, "")
    shown = plain or literal(option.metavar)
    return f"{shown}, {unit}" if unit and plain else shown


def _row(command: Command, option: Option) -> tuple[str, str, str, str]:
    name = option.name.upper() if option.positional else option.flag
    default = "required" if option.required else literal(option.default)
    return f".. _{anchor(command, option)}:\n\n{literal(name)}", value(option), default, meaning(option.help)


def command_page(command: Command) -> str:
    """Return the page of a command: usage, examples, and a table of options for each group of its help."""
    options = options_of_command(command)
    arguments = [each for each in options if each.positional]
    needed = [f"{each.flag} {each.metavar}" for each in options if each.required and not each.positional]
    places = [each.name.upper() if each.required else f"[{each.name.upper()}]" for each in arguments]
    lines = [f".. _lab-{command.name}:\n", heading(f"lab {command.name}", "="), meaning(command.help), ""]
    usage = " ".join([f"lab {command.name}", *places, *needed, "[OPTIONS]"])
    shown = [usage, "", *(f"lab {command.name} {each}" for each in command.examples)]
    lines += [".. code-block:: text\n", *(f"   {line}".rstrip() for line in shown), ""]
    titles, widths = ("option", "value", "default", "meaning"), (22, 18, 12, 48)
    groups = grouped(command, options, every=True)
    for title, section in {"arguments": tuple(arguments), **groups}.items():
        if section:
            lines += [heading(title[0].upper() + title[1:], "-")]
            lines += [table(titles, (_row(command, each) for each in section), widths)]
    call = command.run.partition(":")[2]
    lines += [f"In Python: :py:func:`lab.{call}`.\n"] if call in _calls() else []
    return "\n".join(lines)


def _calls() -> list[str]:
    import lab

    return lab.__all__


def write_pages(folder: Path, texts: Mapping[str, str]) -> None:
    """Write pages into a folder that holds nothing else; those that are as they were keep their time."""
    folder.mkdir(exist_ok=True)
    for stale in {path.name for path in folder.glob("*.rst")} - {f"{name}.rst" for name in texts}:
        (folder / stale).unlink()
    for name, text in texts.items():
        path = folder / f"{name}.rst"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def write_commands(app: Sphinx) -> None:
    """Write the pages of all commands before the builder looks for pages."""
    write_pages(FOLDER, {command.name: command_page(command) for command in all_commands()})


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages at the start of a build."""
    app.connect("builder-inited", write_commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
