"""The public names, commands and options of this version: python -m helpers.public_surface writes them to its file."""

import json
from pathlib import Path

import lab
from lab.commands.help_text import options_of_command
from lab.commands.registry import all_commands

RELEASED = Path(__file__).with_suffix(".json")  # of the last release


def surface() -> dict[str, object]:
    """All that ``docs/developers/stability.md`` calls public and that can be listed."""
    own = [each for each in all_commands() if each.options.startswith("lab.")]  # of no other package
    commands = {each.name: sorted(option.name for option in options_of_command(each)) for each in own}
    return {"version": lab.__version__, "names": sorted(lab.__all__), "commands": commands}


if __name__ == "__main__":
    RELEASED.write_text(json.dumps(surface(), indent=1) + "\n", encoding="utf-8")
