"""Load what installed packages add to the lab, by their entry points.

A package adds an object by a line of its ``pyproject.toml``, e.g. ``[project.entry-points."lab.commands"]`` with
``weigh = "my_package.commands:WEIGH"``. These are the groups, with what an entry names and what its own name means:

- ``lab.commands``: a ``Command`` of ``lab.commands.registry``; the name is what is typed.
- ``lab.names``: a function or a class that ``import lab`` offers as ``lab.NAME``.
- ``lab.languages``: the class of a ``Language`` of ``lab.formats.programs.protocol``, which is made without arguments;
  the name is its ``name`` in small letters, and the value of ``--controller``.
- ``lab.inverses``: a function from a ``Chain`` and the tool ``(3,)`` m in its last frame to a ``ClosedForm`` of
  ``lab.kinematics.inverse.closed_form``, or to None where it has none for such an arm.
- ``lab.shapes``: a function from a ``Mechanism`` to what ``lab inspect`` reports of its closed form, or None.
- ``lab.sections``: an ``AddedSection`` of ``lab.commands.sections``.
- ``lab.criteria``: an object or a subclass of ``lab.Criterion``; the name is the value of ``--criterion``.
- ``lab.sources``: a ``Source`` of ``lab.extensions.reproduction.item``; the name is what ``lab reproduce`` takes.

An extension may use the public interface ``lab``, this module, and the toolbox, which the import contract names:

- ``lab.core``: transforms, units, errors, limits, named random streams;
  ``lab.kinematics``: arms, mechanisms, derivatives.
- ``lab.formats``: robot tables and the readers of files; ``lab.campaign.robot`` and ``option_types``: robots by name,
  and the types of options.
- ``lab.simulation``: models of MuJoCo, collisions, meshes;
  ``lab.pose_selection``: criteria, exchange, durations of moves.
- ``lab.render``: documents, charts, recordings; the modules of ``lab.commands`` (not the commands): a command's result,
  its run's folder, values for ``--json``.

The lab's own extensions (``lab.extensions``) are registered in the same way. An entry is imported when it is used. One
that cannot be imported is left out, and reported in one line on the standard error.
"""

import sys
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal

from lab.core.errors import LabError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

__all__ = ["choice_of", "load", "load_all", "load_reference", "registered"]

_reported = set[str]()  # entries, so that each is reported once


@cache
def _entries(group: str) -> "dict[str, EntryPoint]":
    """Return the entry points of a group by name, in alphabetical order; of several with one name the first found."""
    from importlib.metadata import entry_points  # slow to import, and not every process needs it

    found: dict[str, EntryPoint] = {}
    for entry in entry_points(group=group):
        found.setdefault(entry.name, entry)
    return dict(sorted(found.items()))


def registered(group: str) -> tuple[str, ...]:
    """Return the names that are registered in a group; nothing of them is imported."""
    return tuple(_entries(group))


def load(group: str, name: str) -> Any:
    """Import a registered object.

    Raises:
        LabError: no such name is registered, or its package cannot be imported.
    """
    entry = _entries(group).get(name)
    if entry is None:
        known = ", ".join(registered(group)) or "none"
        raise LabError(f"'{name}' is not registered as an entry point of {group}; there are {known}")
    try:
        return entry.load()
    except Exception as error:
        raise LabError(
            f"extension '{name}' ({entry.value}) cannot be loaded ({type(error).__name__}: {_one_line(error)}); "
            "repair or uninstall its package"
        ) from error


def load_all(group: str) -> dict[str, Any]:
    """Import all registered objects of a group, by their names; those that cannot be imported are left out."""
    found = dict[str, Any]()
    for name in registered(group):
        try:
            found[name] = load(group, name)
        except LabError as error:
            if f"{group}:{name}" not in _reported:
                _reported.add(f"{group}:{name}")
                print(f"lab: warning: {error}", file=sys.stderr)
    return found


def load_reference(reference: str) -> Any:
    """Import what ``module:name`` names."""
    module, _, name = reference.partition(":")
    return getattr(import_module(module), name)


def choice_of(group: str) -> Any:
    """Return the type of an option whose values are the registered names; ``str`` where there is none."""
    names = registered(group)
    return Literal[names] if names else str


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
