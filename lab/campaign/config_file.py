"""The options of an earlier run, from its ``config.json``."""

from pathlib import Path
from typing import TypeVar

from lab.core.errors import LabError
from lab.formats.structured import read_json, structured

__all__ = ["read_options"]

Options = TypeVar("Options")


def read_options(path: Path, command: str, kind: type[Options]) -> Options:
    """The options that a run of ``command`` was given; those that the file leaves out are at their defaults.

    Raises:
        LabError: the file cannot be read, is of another command, or holds what is no option.
    """
    content = read_json(path, "give a run's config.json")
    if not isinstance(content, dict) or not isinstance(content.get("options"), dict):
        raise LabError(f"{path}: has no options; give a run's config.json")
    if content.get("command", command) != command:
        raise LabError(f"{path}: is of lab {content['command']}, not of lab {command}; run that")
    return structured(path, kind, content["options"])
