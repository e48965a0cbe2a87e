"""Parameters of a model: name, owner, unit, typical size, and nominal value."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from lab.core.se3 import Array
from lab.core.units import DEGREES, MM, MRAD, PPM, Unit

__all__ = [
    "BASE_PARAMETERS",
    "PARALLEL_RAD",
    "SIZE",
    "TOLERANCE_M",
    "TOLERANCE_RAD",
    "Kind",
    "Parameter",
    "frame_rotations",
    "indices_of_groups",
    "is_reserved_owner",
    "joint_parameter",
    "link_end_parameter",
    "link_parameter",
    "mount_parameters",
    "names_of",
    "placed_parameters",
    "section_parameter",
    "targets_of",
    "tool_parameters",
]

Kind = Literal["length", "angle", "ratio", "compliance", "section", "mass", "length rate", "angle rate", "ratio rate"]

TOLERANCE_M, TOLERANCE_RAD = 0.5e-3, 1.5e-3  # default standard deviations of a link's manufacture
PARALLEL_RAD = 3.5e-3  # of twists between nominally parallel axes
SIZE: Final = "size"  # group: shares by which artefacts are larger than stated
_UNITS: Final[Mapping[Kind, Unit]] = {
    "length": MM,
    "angle": DEGREES,
    "ratio": PPM,
    "compliance": Unit("rad/Nm", "µrad/Nm", 1e6),
    "section": Unit("1/(N m^2)", "1/(MN m²)", 1e6),
    "length rate": Unit("m/h", "mm/h", 1e3, 4),
    "angle rate": Unit("rad/h", "mrad/h", 1e3, 4),
    "ratio rate": Unit("1/h", "ppm/h", 1e6, 2),
}
_EFFECT_UNITS: Final[Mapping[Kind, Unit]] = {**_UNITS, "angle": MRAD}  # in a joint or a link
_EFFECT_SCALES: Final[Mapping[Kind, float]] = {  # large, so that a prior only bounds the effects
    "length": 1e-2,
    "angle": 1e-3,
    "ratio": 1e-3,
    "compliance": 1e-4,
    "section": 1e-4,
    "length rate": 1e-2,
    "angle rate": 1e-2,
    "ratio rate": 1e-3,
}
_OWNERS = (  # no links
    *("base", "tool", "drift", "session", "station", "step", "payload", "instrument"),
    *("anchor", "socket", "plane", "cable", "cube", "plate", "bar", "dial", "camera", "board"),
)


@dataclass(frozen=True)
class Parameter:
    """A parameter of a model.

    Attributes:
        owner: part of its name before the last dot: ``link2``, ``tool.p1``, ``joint3``.
        symbol: its name within the owner: ``alpha``, ``x``, ``compliance``.
        group: ``base``, ``tool`` or ``link`` (dimensions of the nominal model), else the effect or the kind of fixture
            (``anchor``, ``socket``, ``plane``).
        kind: the quantity.
        unit: display unit; values are in its SI unit.
        scale: typical size, one standard deviation (SI): a link's tolerance of manufacture, an effect's size; infinite
            without prior information.
        nominal: nominal value (SI).
        joint: its joint, from 0, or None.
        target: the target that it locates, or "".
        wave: periods in a turn of the joint, for a periodic effect; else 0.
        turning: the joint, from 0, in whose position it is periodic; None for ``joint``.
    """

    owner: str
    symbol: str
    group: str
    kind: Kind
    unit: Unit
    scale: float = np.inf
    nominal: float = 0.0
    joint: int | None = None
    target: str = ""
    wave: int = 0
    turning: int | None = None

    @property
    def name(self) -> str:
        """Name in files and on the command line."""
        return f"{self.owner}.{self.symbol}"

    @property
    def is_link(self) -> bool:
        """True for a dimension of the nominal model: of a link, a frame or a rod."""
        return self.group == "link"

    @property
    def is_angle(self) -> bool:
        """True if the SI unit is rad."""
        return self.unit.si == "rad"

    @property
    def unit_of_change(self) -> Unit:
        """Display unit of a change."""
        return MRAD if self.is_angle else self.unit


def names_of(parameters: Iterable[Parameter]) -> tuple[str, ...]:
    """Return the names."""
    return tuple(parameter.name for parameter in parameters)


def targets_of(parameters: Iterable[Parameter]) -> tuple[str, ...]:
    """Return the targets that these parameters locate."""
    return tuple(dict.fromkeys(parameter.target for parameter in parameters if parameter.target))


def indices_of_groups(parameters: Iterable[Parameter], groups: Sequence[str]) -> tuple[int, ...]:
    """Return the indices of the parameters of some groups, ascending."""
    return tuple(i for i, parameter in enumerate(parameters) if parameter.group in groups)


def frame_rotations(parameters: Sequence[Parameter]) -> tuple[list[int], ...]:
    """Return the indices of rotation vectors (rx, ry, rz) of the base, of instrument stations, cameras and boards."""
    frames = ("base", "stations", "camera", "board")
    owners = dict.fromkeys(each.owner for each in parameters if each.group in frames)
    return tuple([i for i, each in enumerate(parameters) if each.owner == owner and each.is_angle] for owner in owners)


def link_parameter(
    owner: str, symbol: str, kind: Kind, nominal: float, *, between_parallel_axes: bool = False
) -> Parameter:
    """Return a dimension of the nominal model.

    Its scale is the standard deviation of manufacture. Factory calibrations of 19 arms of Universal Robots have lengths
    0.41 mm from their tables (root mean square), twists 0.92 mrad, and twists between nominally parallel axes 3.6 mrad.

    Args:
        between_parallel_axes: whether it is a twist (alpha, beta) of two nominally parallel axes.
    """
    angle = PARALLEL_RAD if between_parallel_axes else TOLERANCE_RAD
    return Parameter(owner, symbol, "link", kind, _UNITS[kind], angle if kind == "angle" else TOLERANCE_M, nominal)


def mount_parameters(name: str, nominal: Array) -> tuple[Parameter, ...]:
    """Return the pose of a chain's frame 0 in that of a robot's first chain: position (m) and rotation vector (rad)."""
    placed = placed_parameters(f"mount.{name}", "link", ("x", "y", "z", "rx", "ry", "rz"))
    return tuple(
        replace(each, nominal=float(value), scale=TOLERANCE_RAD if each.is_angle else TOLERANCE_M)
        for each, value in zip(placed, nominal, strict=True)
    )


def tool_parameters(positions: Mapping[str, Array]) -> tuple[Parameter, ...]:
    """Return coordinates of targets with nominal positions ``(3,)`` (m) in the last frame."""
    return tuple(
        Parameter(f"tool.{target}", axis, "tool", "length", MM, nominal=float(value), target=target)
        for target, position in positions.items()
        for axis, value in zip("xyz", position, strict=True)
    )


def placed_parameters(
    owner: str,
    group: str,
    symbols: Sequence[str],
    *,
    rate: bool = False,
    scaled: bool = False,
    scale: float = np.inf,
) -> tuple[Parameter, ...]:
    """Return coordinates of a frame or a fixture: angles ``rx``, ``ry``, ``rz``, a ratio ``scale``, else lengths.

    Args:
        rate: changes per hour.
        scaled: an effect with a typical size.
        scale: the typical size (SI) of another; without prior information where it is infinite.
    """
    found = []
    for symbol in symbols:
        kind: Kind = "angle" if symbol in ("rx", "ry", "rz") else "ratio" if symbol == "scale" else "length"
        if rate:
            rates: Mapping[Kind, Kind] = {"length": "length rate", "angle": "angle rate", "ratio": "ratio rate"}
            kind = rates[kind]
        size = _EFFECT_SCALES[kind] if scaled else scale
        found.append(Parameter(owner, symbol, group, kind, _UNITS[kind], size))
    return tuple(found)


def joint_parameter(
    group: str,
    joint: int,
    symbol: str,
    kind: Kind = "angle",
    *,
    unit: Unit | None = None,
    scale: float | None = None,
    wave: int = 0,
    turning: int | None = None,
) -> Parameter:
    """Return a parameter of an effect in one joint.

    Args:
        group: name of the effect.
        joint: its joint, from 0; its name counts from 1.
        symbol: its name in the joint: ``cos2`` of ``joint1.cos2``.
        kind: the quantity, which gives its unit and its typical size.
        unit: instead of the kind's own.
        scale: typical size (SI), instead of the kind's own.
        wave: periods in a turn of the joint, for a periodic effect; else 0.
        turning: the joint, from 0, in whose position it is periodic; None for ``joint``.

    Returns:
        The parameter, zero in the nominal model.

    Raises:
        KeyError: there is no such kind.
    """
    size = _EFFECT_SCALES[kind] if scale is None else scale
    unit = unit or _EFFECT_UNITS[kind]
    return Parameter(f"joint{joint + 1}", symbol, group, kind, unit, size, joint=joint, wave=wave, turning=turning)


def link_end_parameter(group: str, link: int, symbol: str, kind: Literal["length", "angle"], turning: int) -> Parameter:
    """Return a displacement of a link's far end, periodic in a joint; both from 0."""
    return Parameter(
        f"link{link + 1}", symbol, group, kind, _EFFECT_UNITS[kind], _EFFECT_SCALES[kind], wave=1, turning=turning
    )


def section_parameter(group: str, link: int, symbol: str) -> Parameter:
    """Return a compliance of a link's section, 1/EI, 1/GJ or 1/EA; the link is from 0 here and from 1 in its name."""
    unit = Unit("1/N", "1/MN", 1e6) if symbol == "ea" else _UNITS["section"]
    return Parameter(f"link{link + 1}", symbol, group, "section", unit, _EFFECT_SCALES["section"])


def is_reserved_owner(name: str) -> bool:
    """Check whether other parameters have this owner, so that it is no name of a frame or a rod."""
    return name in _OWNERS or name.removeprefix("joint").isdigit()


BASE_PARAMETERS: Final = placed_parameters("base", "base", ("x", "y", "z", "rx", "ry", "rz"))
