"""Take the robot, the cell, the targets and the instrument of a plan from the run of ``lab design`` that made it."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from lab.core.errors import LabError
from lab.core.whole_folder import CHECKSUMS, edited_files, file_digest
from lab.formats.structured import read_checksums
from lab.robots.config_file import CONFIG_FILE, RunInputs, input_names, read_config
from lab.robots.robot_files import parted

__all__ = ["PlanSettings", "filled_in", "settings_of_plan"]

_Options = TypeVar("_Options")
_OF_MEASUREMENTS = ("robot", "cell", "instrument")
_SETTINGS = (*_OF_MEASUREMENTS, "targets")
_OF_PICTURES = ("observe", "cameras")  # of a plan for pictures
_CLEARANCES = ("clearance_mm", "self_clearance_mm")
_USUAL_ROBOT = "irb120"  # of every command
_USUAL_INSTRUMENT = "uniform-8um"  # of a plan whose user named none


@dataclass(frozen=True)
class PlanSettings:
    """Settings of the run of ``lab design`` in whose folder a plan lies.

    Attributes:
        folder: of that run.
        values: by the names of options, as plain values; files are the copies in the folder.
        stated: the same as the run was given them.
        observe: what the plan is measured by.
    """

    folder: Path
    values: Mapping[str, Any]
    stated: Mapping[str, Any]
    observe: str

    def only(self, names: Collection[str]) -> "PlanSettings":
        """Return the settings of these names."""
        kept = {name: value for name, value in self.values.items() if name in names}
        return replace(self, values=kept)

    def without(self, *names: str) -> "PlanSettings":
        """Return the settings but those of these names."""
        return self.only([name for name in self.values if name not in names])

    @property
    def has_own_instrument(self) -> bool:
        """True where the plan was made with another instrument than the usual one."""
        return self.values.get("instrument") not in (None, _USUAL_INSTRUMENT)

    def taken_note(self, options: object, default: object) -> str:
        """Describe in one line what options took from the plan that is not their default; "" for nothing."""
        names = [
            name
            for name in self.values
            if self._is_own(name, getattr(options, name)) and not self._is_own(name, getattr(default, name))
        ]
        if not names:
            return ""
        found = ", ".join(f"{_flag(name)} {_text(self.stated[name])}" for name in names)
        changed = [f"{_flag(name)} {self.stated[name]}" for name in names if self._is_changed(name)]
        since = f"; changed since, so give {', '.join(changed)} for the present file" if changed else ""
        return f"taken from {self.folder / CONFIG_FILE}: {found}{since}"

    def _is_changed(self, name: str) -> bool:
        """Check whether the file that the run was given is there and is no longer that of its copy."""
        file, own = (Path(parted(str(value))[0]) for value in (self.stated[name], self.values[name]))
        return file != own and file.is_file() and own.is_file() and file_digest(file) != file_digest(own)

    def differences(self, options: object) -> tuple[str, ...]:
        """Describe each option that is given and is another one than the plan's."""
        return tuple(
            f"{_flag(name)} is {_text(given)}, but the plan in {self.folder} was made with {_text(self.stated[name])}"
            for name in self.values
            if not self._same(name, given := getattr(options, name))
        )

    def _is_own(self, name: str, given: object) -> bool:
        """Check whether a value is the plan's own: of a file, its copy."""
        ours = self.values[name]
        plain = list(given) if isinstance(given, tuple) else str(given) if isinstance(given, Path) else given
        return bool(plain == ours)

    def _same(self, name: str, given: object) -> bool:
        """Check whether a value is equal to the plan's: of a file, by its content."""
        ours = self.values[name]
        if self._is_own(name, given) or given is None or ours is None:
            return self._is_own(name, given)
        (file, ends), (own, own_ends) = parted(str(given)), parted(str(ours))
        if Path(file).is_file() and Path(own).is_file():
            return ends == own_ends and file_digest(Path(file)) == file_digest(Path(own))
        return False


def settings_of_plan(plan: Path, *, clearances: bool = False) -> PlanSettings | None:
    """Return the settings of the run of ``lab design`` in whose folder a plan lies; None for any other file.

    Args:
        clearances: whether its clearances are among them.

    Raises:
        LabError: the folder's ``config.json`` cannot be read, or a copy of an input was changed.
    """
    folder = plan.parent
    if not (folder / CONFIG_FILE).is_file():
        return None
    config = read_config(folder)
    if config.command != "design":
        return None
    if config.inputs and (folder / CHECKSUMS).is_file():
        text = read_checksums(folder)
        if edited := edited_files(folder, text, input_names(folder)):
            raise LabError(f"{folder}: {edited[0]} was changed since the plan was made; put it back, or plan anew")
    observe = str(config.options.get("observe", "points"))
    names = (*_SETTINGS, *(_OF_PICTURES if observe != "points" else ()), *(_CLEARANCES if clearances else ()))
    stated = {name: config.options[name] for name in names if name in config.options}
    inputs = RunInputs(folder, config)
    return PlanSettings(folder, {name: inputs.located(value) for name, value in stated.items()}, stated, observe)


def filled_in(options: _Options, file: Path) -> tuple[_Options, tuple[str, ...]]:
    """Fill in what options of ``lab identify`` leave open, for the filled-in plan of a run of ``lab design``.

    The instrument is taken where the plan was made with another one than the usual, and neither it nor the noise is
    given. A file of another run has its robot.

    Returns:
        The options, and lines on what was taken, and on what is given and differs.
    """
    settings = settings_of_plan(file)
    if settings is None:
        return options, ()
    given = {name: value for name in _OF_MEASUREMENTS if (value := getattr(options, name, None)) is not None}
    compared = [name for name in given if name != "instrument" or settings.has_own_instrument]
    warnings = tuple(f"warning: {each}" for each in settings.only(compared).differences(options))
    if "robot" in given and settings.only(["robot"]).differences(options):
        return options, warnings  # of another robot nothing is taken
    taken = _taken(settings, options, given)
    filled = replace(options, **taken)  # type: ignore[type-var]
    note = settings.only(taken).taken_note(filled, options)
    return filled, (*((note,) if note else ()), *warnings)


def _taken(settings: PlanSettings, options: object, given: Collection[str]) -> dict[str, Any]:
    """Return what options that are not given take from the plan: its robot, its cell, and its instrument."""
    taken: dict[str, Any] = {}
    if "robot" not in given and settings.values["robot"] != _USUAL_ROBOT:
        taken["robot"] = settings.values["robot"]
    if "cell" not in given and (cell := settings.values.get("cell")) is not None:
        taken["cell"] = Path(cell)
    of_points = settings.observe == getattr(options, "observe", "points") == "points"
    noise_given = "instrument" in given or getattr(options, "noise_mm", None) is not None
    if of_points and settings.has_own_instrument and not noise_given:
        taken["instrument"] = settings.values["instrument"]
    return taken


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")


def _text(value: object) -> str:
    if isinstance(value, tuple | list):
        return ",".join(map(str, value))
    return "none" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
