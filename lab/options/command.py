"""Describe a command: its options, the call that it makes, and its help."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from string import Formatter
from typing import Any

from lab.core.errors import LabError
from lab.extension_points import load_reference

__all__ = ["Command", "OptionGroup"]


@dataclass(frozen=True)
class OptionGroup:
    """A group of options in a command's help.

    Attributes:
        title: above the group.
        common: names of the options that ``--help`` shows.
        more: names of those that ``--help-all`` adds; the field of a nested group names all that it holds.
    """

    title: str
    common: tuple[str, ...]
    more: tuple[str, ...] = ()


@dataclass(frozen=True)
class Command:
    """A command of the lab.

    Attributes:
        name: what is typed.
        help: what it does, in a sentence.
        options: ``module:class`` of its options, a dataclass whose fields are its arguments and flags.
        run: ``module:function`` that makes a ``Result`` of them.
        instead: an option, and the ``module:function`` that is run in place of ``run`` where it is given.
        folder: the name of a run's folder, with options in braces (of files and robots their stems); "" for a command
            that writes no run, or looks after its folder itself.
        writes_on_request: it has no such name, and writes a run only where ``--out`` names its folder; its options
            have a field ``out``.
        examples: two usual lines of arguments, shown in its help.
        groups: of its options, in the order of its help; without them the help shows all options in one.
        group: heading under which ``lab --help`` lists it, behind those of a calibration.
        plan: the option whose file may be a plan in the folder of a run of ``lab design``: robot, cell, targets and
            instrument that are not given are those of that run.
    """

    name: str
    help: str
    options: str
    run: str
    folder: str = ""
    writes_on_request: bool = False
    examples: tuple[str, ...] = ()
    groups: tuple[OptionGroup, ...] = ()
    plan: str = ""
    group: str = "other"
    instead: tuple[str, str] | None = None

    def load_options(self) -> type[Any]:
        """Import and return the class of its options.

        Raises:
            LabError: it lacks the field that ``writes_on_request`` needs.
        """
        kind: type[Any] = load_reference(self.options)
        if self.writes_on_request and "out" not in {each.name for each in fields(kind)}:
            raise LabError(
                f"lab {self.name}: writes_on_request needs a field out: Path | None = None in {self.options}; add it"
            )
        return kind

    def load_run(self, options: Any) -> Callable[[Any], Any]:
        """Import and return the function from these options to ``Result``, with the libraries that it needs."""
        option, other = self.instead or ("", "")
        run: Callable[[Any], Any] = load_reference(
            other if option and getattr(options, option) is not None else self.run
        )
        return run

    def folder_name(self, options: Any) -> str:
        """Return the default name of the folder of a run with these options; "" for a command without one."""
        names = [name for _, name, _, _ in Formatter().parse(self.folder) if name]
        given = {name: getattr(options, name) for name in names}
        stems = {name: "simulated" if value is None else Path(str(value)).stem for name, value in given.items()}
        return self.folder.format(**stems)
