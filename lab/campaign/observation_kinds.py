"""The kinds of observation that there are: a line each, with its calibration and its simulation.

Their modules are imported when a kind is asked for: a command line is parsed with the names alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Annotated

import tyro

from lab.calibration.observations.options import FitInputs, ObservationOptions, flags_given
from lab.core.errors import LabError

if TYPE_CHECKING:
    from lab.calibration.observations.kind import ObservationKind
    from lab.simulation.observations.protocol import Simulate

__all__ = ["KINDS", "KindName", "RegisteredKind", "configured_kind", "kind_named", "simulation_of"]


@dataclass(frozen=True)
class RegisteredKind:
    """Where a kind is, as ``module:name``.

    Attributes:
        calibration: the class of the kind, an ``ObservationKind``.
        simulation: the function that measures a virtual arm by it, a ``Simulate``.
        setup: the fields of ``options.MeasuringSetup`` that this function reads.
    """

    calibration: str
    simulation: str
    setup: tuple[str, ...]


_CALIBRATION, _SIMULATION = "lab.calibration.observations", "lab.simulation.observations"
KINDS: Mapping[str, RegisteredKind] = {
    "points": RegisteredKind(
        f"{_CALIBRATION}.points:PointsKind", f"{_SIMULATION}.points:observe_points", ("occlusion",)
    ),
    "pose": RegisteredKind(
        f"{_CALIBRATION}.full_pose:PoseKind",
        f"{_SIMULATION}.full_pose:observe_poses",
        ("occlusion", "orientation_share"),
    ),
    "cable": RegisteredKind(f"{_CALIBRATION}.cable:CableKind", f"{_SIMULATION}.cable:observe_cable", ("fixtures",)),
    "socket": RegisteredKind(
        f"{_CALIBRATION}.socket:SocketKind", f"{_SIMULATION}.socket:observe_sockets", ("fixtures",)
    ),
    "plane": RegisteredKind(f"{_CALIBRATION}.plane:PlaneKind", f"{_SIMULATION}.plane:observe_planes", ("fixtures",)),
}

KindName = Annotated[
    str,
    tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="{" + ",".join(KINDS) + "}",
        instance_from_str=lambda given: given[0],
        is_instance=lambda instance: isinstance(instance, str),
        str_from_instance=lambda name: [name],
        choices=tuple(KINDS),
    ),
]
"""A kind's name, as a command line takes it."""


def kind_named(name: str) -> "type[ObservationKind]":
    """The kind of this name.

    Raises:
        LabError: there is none.
    """
    if name not in KINDS:
        raise LabError(f"--observe {name}: unknown; give one of {', '.join(KINDS)}")
    kind: type[ObservationKind] = resolve_name(KINDS[name].calibration)
    return kind


def configured_kind(name: str, options: ObservationOptions, fit: FitInputs) -> "ObservationKind":
    """The kind of this name with its options.

    Args:
        name: as ``--observe`` takes it.
        options: of all kinds.
        fit: what a kind may have to know of the other options.

    Raises:
        LabError: there is no such kind, an option is of another kind, or makes no sense.
    """
    chosen = kind_named(name)
    kind = chosen.configured(options, fit)
    for other in (kind_named(each) for each in KINDS):
        if other is not chosen and (given := flags_given(options, other.flags)):
            raise LabError(f"{given[0]} is of --observe {other.name}; give that too, or leave it out")
    return kind


def simulation_of(name: str) -> "Simulate":
    """The function that measures a virtual arm by the kind of this name.

    Raises:
        LabError: there is no such kind.
    """
    simulate: Simulate = resolve_name(KINDS[kind_named(name).name].simulation)
    return simulate
