"""Load extensions of installed packages by their entry points.

A package adds an object by a line of its ``pyproject.toml``, e.g. ``[project.entry-points."lab.commands"]`` with
``weigh = "my_package.commands:WEIGH"``. These are the groups, with the object and the meaning of its name:

- ``lab.commands``: a ``Command`` of ``lab.options.command``; the name is the command.
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
- ``lab.sensors``: what a sensor is and takes; a sensor is a part of the fit, and may use ``lab.calibration``.

The lab's own extensions (``lab.extensions``) are registered in the same way. An entry is imported at its first use. One
that cannot be imported is left out, with a line on the standard error.

A part of a calibration needs no package: every call takes it as an object (``named_parts``), and the program knows it
by its name from then on. What a part's methods raise and return is checked by its base class, a ``Part``.
"""

import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache, wraps
from importlib import import_module
from inspect import isabstract
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from lab.core.errors import LabError, option_name

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from lab.core.se3 import Array

__all__ = [
    "Part",
    "PartKind",
    "add",
    "added",
    "choice_of",
    "load",
    "load_all",
    "load_reference",
    "named_parts",
    "numbers",
    "own_errors",
    "receive_parts",
    "registered",
    "sent_parts",
    "texts",
]

_OPTIONS = {  # that take a part, and the group of its kind
    "criterion": "lab.criteria",
    "estimator": "lab.estimators",
    "sampler": "lab.samplers",
    "instrument": "lab.instruments",
    "observe": "lab.sensors",
    "model": "lab.effects",
    "own_effects": "lab.effects",
    "error_terms": "lab.error_terms",
}
_JOINED = ("model", "observe")  # options whose names are joined by +
_LARGEST = 1e100  # of a part's numbers: products of larger ones overflow
_kinds: dict[str, "PartKind"] = {}  # of parts whose base class is imported, by group
_given: dict[str, dict[str, Any]] = {}  # parts of this program, by group and name
_reported = set[str]()  # entries that cannot be used: each is reported once


@dataclass
class PartKind:
    """A kind of parts of a calibration that users write: criteria, estimators, effects and so on.

    Attributes:
        group: of the entry points that register such parts.
        what: what such a part is called in messages, e.g. ``criterion``.
        option: that takes one in a call.
        taken: names of the lab's own parts of this kind.
        returned: checks of what the methods of a part return, by the method's name. Each gets ``part 'name': method``,
            what was returned, and the arguments of the method; it returns what the lab uses, or raises a LabError.
        method: the only one that a part needs, so that a function is enough; "" where it needs several.
        is_made: whether a class is called without arguments where a part is given; else it stays a class.
        base: the base class of such parts; it sets itself.
    """

    group: str
    what: str
    option: str
    taken: Collection[str] = ()
    returned: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    method: str = ""
    is_made: bool = True
    base: type["Part"] = field(init=False)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the lab's own parts of this kind, and of those that packages and this program add."""
        return (*self.taken, *added(self.group, self.taken))

    def named(self, name: str) -> Any:
        """Return the part that a package or this program adds by this name.

        Raises:
            LabError: there is none of this name, it cannot be imported, is of another kind, or has another name than
                its entry.
        """
        if name not in added(self.group, self.taken):
            shown = name or "''"
            raise LabError(f"{option_name(self.option)} {shown}: unknown; give one of {', '.join(self.names)}")
        part = self.own(load(self.group, name))
        if part.name != name:
            raise LabError(f"{self.what} '{part.name}' is registered in {self.group} as '{name}'; name both alike")
        return part

    def own(self, given: Any) -> Any:
        """Return a part that a user or a package gives: an object, or a class of such objects.

        Raises:
            LabError: it is no part of this kind, it has no name, or the name of one of the lab's.
        """
        if self.is_made and self._has(given) and isinstance(given, type):
            try:
                with own_errors(self.what, given.__name__, TypeError):
                    given = given()
            except TypeError as error:
                raise LabError(f"{self.what} {given!r}: it needs arguments ({error}); give an object") from error
        name = getattr(given, "name", None)
        if not self._has(given) or not isinstance(name, str) or not name:
            raise LabError(f"{self.what} {given!r}: give an object of a subclass of {_public(self.base)} with a name")
        if name in self.taken:
            raise LabError(f"{self.what} '{name}': the lab has one of that name; give yours another")
        return given

    def _has(self, given: object) -> bool:
        if isinstance(given, type):
            return issubclass(given, self.base) and not isabstract(given)
        return isinstance(given, self.base)

    def of_function(self, function: Callable[..., Any]) -> "Part":
        """Return a part of this kind whose only method is a function, named like it.

        Raises:
            LabError: parts of this kind have several methods.
        """
        if not self.method:
            raise LabError(f"{self.what} {function!r}: a function is not enough; give a {_public(self.base)}")
        name = getattr(function, "__name__", "function").strip("<>")
        members = {"name": name, self.method: staticmethod(function), "__module__": function.__module__}
        part: Part = type(name, (self.base,), members)()
        return part


class Part:
    """A part of a calibration that a user may write; it has a ``name``.

    What the methods of a user's subclass raise is turned into one line that names part and method, and what they
    return is checked, by the part's ``PartKind``.
    """

    _kind: ClassVar[PartKind]

    def __init_subclass__(cls, *, kind: PartKind | None = None, **more: Any) -> None:
        """Take the place of a kind's base class, or let the methods of a user's class be checked."""
        super().__init_subclass__(**more)
        if kind is not None:
            cls._kind, kind.base = kind, cls
            _kinds[kind.group] = kind
        elif cls.__module__.partition(".")[0] != "lab":
            for method in cls._kind.returned.keys() & vars(cls).keys():
                setattr(cls, method, _checked(vars(cls)[method], method))


def _checked(method: Any, name: str) -> Callable[..., Any]:
    """Return a method of a user's part, whose errors are reported and whose result is checked."""

    @wraps(method)
    def checked(self: Any, *given: Any, **named: Any) -> Any:
        kind = self._kind
        with own_errors(kind.what, self.name, function=name):
            returned = method.__get__(self, type(self))(*given, **named)
        return kind.returned[name](f"{kind.what} '{self.name}': {name}", returned, *given, **named)

    return checked


@contextmanager
def own_errors(what: str, name: str, *passed: type[Exception], function: str = "") -> Iterator[None]:
    """Turn the errors of a user's part into one line that names it.

    Args:
        what: the kind of part, e.g. ``criterion``.
        passed: errors that the lab handles, which stay as they are.
        function: that is called, of a part with several.

    Raises:
        LabError: the part raised an error, or would end the program.
    """
    part = f"{what} '{name}'"
    try:
        yield
    except passed:
        raise
    except LabError as error:
        raise LabError(str(error) if str(error).startswith(f"{part}: ") else f"{part}: {error}") from error
    except (Exception, SystemExit) as error:
        raise LabError(f"{part}{function and f': {function}'} raises {_cause(error)}; repair it") from error


def _cause(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def numbers(
    where: str, returned: object, shape: tuple[int | None, ...], what: str = "numbers", *, kinds: str = "biuf"
) -> "Array":
    """Return what a function of a user's part returned, as an array of finite numbers.

    Args:
        where: part and function, for messages.
        shape: of the array; None for a length that the part chooses.
        what: the numbers, for messages.
        kinds: of numpy's dtypes that are numbers here: without c, complex numbers are refused.

    Raises:
        LabError: it is none of this shape, or a number is not finite or too large to compute with.
    """
    import numpy as np  # not every command needs it

    try:
        array = np.asarray(returned)
    except ValueError:  # a ragged sequence
        array = np.empty(0, dtype=object)
    wanted = _shape_text(shape)
    if array.dtype.kind not in kinds:
        kind = "complex numbers" if array.dtype.kind == "c" else type(returned).__name__
        raise LabError(f"{where} returns {kind}; return {what} of shape {wanted}")
    if len(array.shape) != len(shape) or any(map(_differ, shape, array.shape)):
        raise LabError(f"{where} returns {what} of shape {array.shape}; return shape {wanted}")
    array = array if array.dtype.kind == "c" else array.astype(np.float64)
    with np.errstate(invalid="ignore"):
        usable = np.isfinite(array) & (abs(array) < _LARGEST)
    if not usable.all():
        at = tuple(np.argwhere(~usable)[0].tolist())
        raise LabError(f"{where} returns {what} with {array[at]:g} at {at}; return finite ones below {_LARGEST:g}")
    return array


def _differ(wanted: int | None, size: int) -> bool:
    return wanted is not None and wanted != size


def _shape_text(shape: tuple[int | None, ...]) -> str:
    sizes = ["any" if size is None else str(size) for size in shape]
    return f"({', '.join(sizes)}{',' * (len(sizes) == 1)})"


def texts(where: str, returned: object) -> tuple[str, ...]:
    """Return the texts that a user's part returned.

    Raises:
        LabError: it is no tuple or list of texts.
    """
    if not isinstance(returned, tuple | list) or not all(isinstance(text, str) for text in returned):
        raise LabError(f"{where} returns {type(returned).__name__}; return a tuple of texts")
    return tuple(returned)


@cache
def _entries(group: str) -> "dict[str, EntryPoint]":
    """Return the entry points of a group by name; the first of several with one name."""
    entries: dict[str, EntryPoint] = {}
    for entry in _all_entries():
        if entry.group == group:
            entries.setdefault(entry.name, entry)
    return dict(sorted(entries.items()))


@cache
def _all_entries() -> "tuple[EntryPoint, ...]":
    """Return the entry points of all groups of the lab, without those of packages whose metadata cannot be read."""
    from importlib.metadata import distributions  # slow to import, and not every process needs it

    entries: list[EntryPoint] = []
    packages = set[str]()
    for package in distributions():
        name = str(package)
        try:
            name = package.name
            own = [entry for entry in package.entry_points if entry.group.startswith("lab.")]
        except Exception as error:
            _report(f"package:{name}", f"entry points of package '{name}' cannot be read ({_cause(error)}); repair it")
            continue
        normal = re.sub(r"[-_.]+", "-", name).lower()  # PEP 503: a package's name has several spellings
        if normal not in packages:  # the first on the path is the one that is imported
            packages.add(normal)
            entries += own
    return tuple(entries)


def registered(group: str) -> tuple[str, ...]:
    """Return the names that are registered in a group, without an import."""
    return tuple(sorted({*_entries(group), *_given.get(group, {})}))


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
        with redirect_stdout(sys.stderr):  # standard output is for the result alone
            return entry.load()
    except (Exception, SystemExit) as error:
        raise LabError(
            f"extension '{name}' ({entry.value}) cannot be loaded ({_cause(error)}); repair or uninstall its package"
        ) from error


def load_all(group: str) -> dict[str, Any]:
    """Import all registered objects of a group; leave out those that cannot be imported, with a warning."""
    loaded = dict[str, Any]()
    for name in registered(group):
        try:
            loaded[name] = load(group, name)
        except LabError as error:
            _report(f"{group}:{name}", str(error))
    return loaded


def _report(entry: str, message: str) -> None:
    if entry not in _reported:
        _reported.add(entry)
        print(f"lab: warning: {message}", file=sys.stderr)


def added(group: str, names: Collection[str]) -> tuple[str, ...]:
    """Return the names that are added in a group to the lab's own ``names``, without an import.

    An entry that has one of these is left out, with a warning.
    """
    for name in set(names) & set(registered(group)):
        _report(f"{group}:{name}", f"'{name}' of {group} is left out: the lab has one of that name; rename the entry")
    return tuple(name for name in registered(group) if name not in names)


def add(given: object) -> str:
    """Let this program know a part by its name, in the place of an earlier one of that name; return the name.

    Raises:
        LabError: it is no part, has no name, or has the name of one of the lab's.
    """
    if callable(given) and not isinstance(given, type) and not _is_part(given):
        raise LabError(f"parts: {given!r} is a function, whose kind is not known here; give it to its option or factor")
    if not _is_part(given):
        raise LabError(f"{given!r} is no part; give an object of a subclass of e.g. lab.Criterion")
    kind: PartKind = given._kind  # type: ignore[attr-defined]
    part = kind.own(given)
    _given.setdefault(kind.group, {})[part.name] = part
    return str(part.name)


def _is_part(given: object) -> bool:
    return issubclass(given, Part) if isinstance(given, type) else isinstance(given, Part)


def named_parts(option: str, value: Any) -> Any:
    """Return the value of an option, with the names of parts in the place of parts, which this program knows then.

    Args:
        option: its name in a call or a study; values of a mapping are those of the options that its keys name.

    Raises:
        LabError: a part is of another kind than the option takes, or cannot be added.
    """
    if isinstance(value, Mapping):
        return {key: named_parts(key, each) for key, each in value.items()}
    if option not in _OPTIONS or value is None or isinstance(value, str):
        return value
    if not isinstance(value, Iterable) or _is_part(value):
        return _named_part(option, value)
    names = [named_parts(option, each) for each in value]
    return "+".join(names) if option in _JOINED else tuple(names)


def _named_part(option: str, value: Any) -> str:
    """Return the name of an option's part, or of the part that a function is, which this program knows then.

    Raises:
        LabError: it is none of the option's kind, or cannot be added.
    """
    kind = _kinds.get(_OPTIONS[option])
    wanted = "a part" if kind is None else f"a {_public(kind.base)}"
    if kind is not None and callable(value) and not _is_part(value):
        value = kind.of_function(value)
    if not _is_part(value):
        raise LabError(f"'{option}' is {value!r}; give a name, or {wanted}")
    if value._kind is not kind:
        raise LabError(f"'{option}' is {value!r}, which is a {value._kind.what}; give {wanted}")
    if option == "own_effects" and not isinstance(value, type):
        return ":".join([add(type(value)), *_options_of(value)])
    return add(value)


def _options_of(effect: Any) -> Iterator[str]:
    """Yield the options of an effect as a command line takes them.

    Raises:
        LabError: the effect is no dataclass, or an option is no number.
    """
    for each in fields(effect) if is_dataclass(effect) else ():
        value = getattr(effect, each.name)
        if not isinstance(value, int | float):
            raise LabError(f"effect '{effect.name}': option {each.name} is {value!r}; give a number")
        yield f"{each.name}={float(value)!r}"


_sent = set[bytes]()  # by this process, which knows these parts


def sent_parts() -> bytes:
    """Return the parts of this program for another process, pickled by value: also those of a script.

    Raises:
        LabError: a part cannot be pickled.
    """
    if not any(_given.values()):
        return b""
    import cloudpickle

    try:
        content: bytes = cloudpickle.dumps(_given)
    except Exception:
        for parts in _given.values():
            for name, part in parts.items():
                try:
                    cloudpickle.dumps(part)
                except Exception as error:
                    raise LabError(
                        f"{part._kind.what} '{name}' cannot be sent to other processes ({_cause(error)}); give it what "
                        "can"
                    ) from error
        raise
    _sent.add(content)
    return content


@cache
def receive_parts(content: bytes) -> None:
    """Let this process know the parts of another one.

    Raises:
        LabError: a module that defines one cannot be imported here.
    """
    if not content or content in _sent:
        return
    import cloudpickle

    try:
        _given.update(cloudpickle.loads(content))
    except (Exception, SystemExit) as error:
        raise LabError(
            f"a worker cannot load a part ({_cause(error)}); install its package there, or define it in the script"
        ) from error


def _public(kind: type[Any]) -> str:
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
