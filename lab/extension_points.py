"""Load extensions of installed packages by their entry points.

A package adds an object by a line of its ``pyproject.toml``, e.g. ``[project.entry-points."lab.commands"]`` with
``weigh = "my_package.commands:WEIGH"``. These are the groups, with the object and the meaning of its name:

- ``lab.commands``: a ``Command`` of ``lab.cli.commands``; the name is the command.
- ``lab.names``: a function or a class, available as ``lab.NAME``.
- ``lab.languages``: the class of a ``Language`` of ``lab.formats.programs.protocol``, made without arguments;
  the name is its ``name`` in small letters, and the value of ``--controller``.
- ``lab.inverses``: a function from a ``Chain`` and the tool ``(3,)`` m in its last frame to a ``ClosedForm`` of
  ``lab.kinematics.inverse.closed_form``, or None if it has none for this arm.
- ``lab.shapes``: a function from a ``Mechanism`` to the ``ClosedFormShape`` that ``lab inspect`` reports, or None.
- ``lab.criteria``: an object or a subclass of ``lab.Criterion``; the name is the value of ``--criterion``.
- ``lab.estimators``: an object or a subclass of ``lab.Estimator``; the name is the value of ``--estimator``.
- ``lab.effects``: a subclass of ``VirtualEffect`` of ``lab.kinematics.effects.effect``; the name is that of the group
  that it fits, in ``--model`` (or ``auto+NAME``), and of what ``--own-effects`` simulates.
- ``lab.sensors``: a subclass of ``VirtualSensor`` of ``lab.sensors.virtual_sensor``; the name is the value of
  ``--observe``.
- ``lab.instruments``: an object or a subclass of ``lab.Instrument``; the name is the value of ``--instrument``.
- ``lab.error_terms``: an object or a subclass of ``ErrorTerm`` of ``lab.noise.error_term``; the name is a value of
  ``--error-terms``.
- ``lab.samplers``: an object or a subclass of ``lab.Sampler``; the name is the value of ``--sampler``.
- ``lab.views``: a ``View`` of ``lab.report.view``, which shows a result; the name is the class of the result.
- ``lab.sources``: a ``Source`` of ``lab.extensions.reproduction.item``; the name is the argument of ``lab reproduce``.

An extension may use the public interface ``lab``, this module, and the toolbox, which the import contract names:

- ``lab.core``: transforms, units, errors, limits, named random streams;
  ``lab.kinematics``: arms, mechanisms, derivatives.
- ``lab.formats``: robot tables and the readers of files; ``lab.robots``: robots by name;
  ``lab.options``: a ``Command``, the types of options, and the keywords of a call.
- ``lab.simulation``: models of MuJoCo, collisions, meshes;
  ``lab.pose_selection``: criteria, exchange, durations of moves.
- ``lab.library``: a call's result, its run's folder, values for ``--json``;
  ``lab.report``: documents, charts, recordings.

The lab's own extensions (``lab.extensions``) are registered in the same way. An entry is imported at its first use. One
that cannot be imported is left out, with a line on the standard error. ``add`` registers an object without a package,
for the calls of one program.
"""

import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from inspect import isabstract
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from lab.core.errors import LabError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

__all__ = [
    "add",
    "added",
    "choice_of",
    "given_parts",
    "load",
    "load_all",
    "load_part",
    "load_reference",
    "own_errors",
    "own_part",
    "registered",
]

_Part = TypeVar("_Part")
_PARTS = (
    "lab.criteria",
    "lab.effects",
    "lab.error_terms",
    "lab.estimators",
    "lab.instruments",
    "lab.samplers",
    "lab.sensors",
)
_given: dict[str, dict[str, Any]] = {}  # objects of this program, by group and name
_reported = set[str]()  # entries that cannot be used: each is reported once


@cache
def _entries(group: str) -> "dict[str, EntryPoint]":
    """Return the entry points of a group by name; the first found of several with one name."""
    found: dict[str, EntryPoint] = {}
    for entry in _all_entries().select(group=group):
        found.setdefault(entry.name, entry)
    return dict(sorted(found.items()))


@cache
def _all_entries() -> Any:
    """Return the entry points of all groups: the metadata of every package are read once."""
    from importlib.metadata import entry_points  # slow to import, and not every process needs it

    return entry_points()


def registered(group: str) -> tuple[str, ...]:
    """Return the names that are registered in a group, without an import."""
    return tuple(sorted({*_entries(group), *_given.get(group, {})}))


def add(group: str, name: str, part: object) -> None:
    """Register an object of this program in a group, as the entry point of a package is; again, in place of the last.

    Worker processes of this machine know it too, if a module defines it that they can import: not the script itself.
    Command lines and clusters do not: install a package for these.

    Raises:
        LabError: the group is of no parts, or a package registers this name.
    """
    if group not in _PARTS:
        raise LabError(f"group '{group}' takes no objects; there are {', '.join(_PARTS)}")
    if name in _entries(group):
        raise LabError(f"'{name}' of {group} is registered by a package; give yours another name")
    _given.setdefault(group, {})[name] = part


def given_parts() -> dict[str, dict[str, Any]]:
    """Return the registered objects of this program, by group and name, that another process can import."""
    return {
        group: {name: part for name, part in parts.items() if _defined_in(part) != "__main__"}
        for group, parts in _given.items()
    }


def _defined_in(part: object) -> str:
    return part.__module__ if isinstance(part, type) else type(part).__module__


def load(group: str, name: str) -> Any:
    """Import a registered object.

    Raises:
        LabError: no such name is registered, or its package cannot be imported.
    """
    if name in _given.get(group, {}):
        return _given[group][name]
    entry = _entries(group).get(name)
    if entry is None:
        names = ", ".join(registered(group)) or "none"
        raise LabError(f"'{name}' is not registered as an entry point of {group}; there are {names}")
    try:
        return entry.load()
    except Exception as error:
        cause = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise LabError(
            f"extension '{name}' ({entry.value}) cannot be loaded ({cause}); repair or uninstall its package"
        ) from error


def load_all(group: str) -> dict[str, Any]:
    """Import all registered objects of a group; leave out those that cannot be imported, with a warning."""
    found = dict[str, Any]()
    for name in registered(group):
        try:
            found[name] = load(group, name)
        except LabError as error:
            _report(f"{group}:{name}", str(error))
    return found


def _report(entry: str, message: str) -> None:
    if entry not in _reported:
        _reported.add(entry)
        print(f"lab: warning: {message}", file=sys.stderr)


def added(group: str, names: Collection[str]) -> tuple[str, ...]:
    """Return the names that packages add in a group to the lab's own ``names``, without an import.

    An entry that has one of these is left out, with a warning.
    """
    for name in set(names) & set(registered(group)):
        _report(f"{group}:{name}", f"'{name}' of {group} is left out: the lab has one of that name; rename the entry")
    return tuple(name for name in registered(group) if name not in names)


def own_part(given: object, kind: type[_Part], what: str, names: Collection[str] = ()) -> _Part:
    """Return a part that a user or a package gives: an object, or a class that is called without arguments.

    Args:
        kind: the base class of such parts.
        what: their name in messages, e.g. ``criterion``.
        names: of the lab's own parts, which an object's name must not be.

    Raises:
        LabError: it is none, it has no name, or its name is one of ``names``.
    """
    if isinstance(given, type) and issubclass(given, kind) and not isabstract(given):
        try:
            given = given()
        except TypeError as error:
            raise LabError(f"{what} {given!r}: it needs arguments ({error}); give an object") from error
    if not isinstance(given, kind) or not isinstance(name := getattr(given, "name", None), str) or not name:
        raise LabError(f"{what} {given!r}: give an object of a subclass of {_called(kind)} with a name")
    if name in names:
        raise LabError(f"{what} '{name}': the lab has one of that name; give yours another")
    return given


@contextmanager
def own_errors(what: str, name: str, *passed: type[Exception], function: str = "") -> Iterator[None]:
    """Turn the errors of a user's part into one line that names it.

    Args:
        what: the kind of part, e.g. ``criterion``.
        passed: errors that the lab handles, which stay as they are.
        function: that is called, of a part with several.

    Raises:
        LabError: the part raised an error.
    """
    part = f"{what} '{name}'"
    try:
        yield
    except passed:
        raise
    except LabError as error:
        raise LabError(str(error) if str(error).startswith(f"{part}: ") else f"{part}: {error}") from error
    except Exception as error:
        cause = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise LabError(f"{part}{function and f': {function}'} raises {cause}; repair it") from error


def load_part(group: str, name: str, kind: type[_Part], what: str) -> _Part:
    """Import a part that a package registers in a group.

    Raises:
        LabError: it cannot be imported, is of another type, or has another name than its entry.
    """
    part = own_part(load(group, name), kind, what)
    if (own := getattr(part, "name", "")) != name:
        raise LabError(f"{what} '{own}' is registered in {group} as '{name}'; name both alike")
    return part


def _called(kind: type[Any]) -> str:
    """Name a class as its user imports it: from ``lab``, if it is public there."""
    public = kind.__name__ in sys.modules["lab"].__all__
    return f"{'lab' if public else kind.__module__}.{kind.__name__}"


def load_reference(reference: str) -> Any:
    """Import the object ``module:name``."""
    module, _, name = reference.partition(":")
    return getattr(import_module(module), name)


def choice_of(group: str) -> Any:
    """Return the type of an option whose values are the registered names; ``str`` without any."""
    names = registered(group)
    return Literal[names] if names else str
