"""The options of each kind of observation that has any, as the command line takes them.

They are apart from the kinds' own modules, so that a command line is parsed without numpy.
"""

from dataclasses import dataclass, fields
from typing import Any, Literal

from lab.core.errors import LabError
from lab.core.orientation import AngleConvention

__all__ = ["FitInputs", "ObservationOptions", "PoseOptions", "SocketOptions", "flags_given"]


@dataclass(frozen=True)
class FitInputs:
    """What a kind may have to know of an identification's other options, to check its own beside them.

    Attributes:
        noise_mm: the noise that is assumed of a position (1σ per axis); None where it is not given.
        prior: whether the manufacturing tolerances are a prior.
        instrument, validation_file: whether these are given, which are of points alone.
    """

    noise_mm: float | None = None
    prior: bool = False
    instrument: bool = False
    validation_file: bool = False

    def refuse_those_of_points(self, kind: str) -> None:
        """Refuse what only measured points can be judged or weighed by.

        Raises:
            LabError: an instrument or a validation file is given.
        """
        if self.instrument or self.validation_file:
            raise LabError(f"--observe {kind}: --validate and --instrument are of points; leave them out")

    def refuse_validation_file(self, kind: str) -> None:
        """Refuse a file of points to validate on.

        Raises:
            LabError: there is one.
        """
        if self.validation_file:
            raise LabError(f"--observe {kind}: --validate is of points; leave it out")


@dataclass(frozen=True, kw_only=True)
class PoseOptions:
    """Of measured positions and orientations."""

    orientation: AngleConvention | None = None
    """What the angles rx, ry, rz of a measured pose mean."""
    noise_mrad: float | None = None
    """Weigh measured orientations by this noise, beside --noise-mm; without both the ratio is estimated."""
    method: Literal["global", "sequential"] = "global"
    """Fit everything at once; or of poses the angles first, then the lengths."""


@dataclass(frozen=True, kw_only=True)
class SocketOptions:
    """Of a ball in sockets."""

    socket_distance_mm: float | None = None
    """Known distance between the sockets of a location."""


@dataclass(frozen=True, kw_only=True)
class ObservationOptions(SocketOptions, PoseOptions):
    """The options of all kinds."""


def flags_given(options: object, flags: type[Any] | None) -> list[str]:
    """The flags of one kind that differ from their defaults, as they are typed.

    Args:
        options: what was given, of all kinds.
        flags: the dataclass of the kind's own; None for a kind that has none.
    """
    given = []
    for field in fields(flags) if flags is not None else ():
        if (value := getattr(options, field.name)) != field.default:
            name = "--" + field.name.replace("_", "-")
            given.append(name if field.default is None else f"{name} {value}")
    return given
