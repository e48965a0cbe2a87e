"""Options of sensors, of their simulation, and the options of a fit that a sensor checks beside its own."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from lab.core.errors import LabError, option_name
from lab.core.orientation import AngleConvention

__all__ = [
    "CameraOptions",
    "FitInputs",
    "PoseOptions",
    "ProbeOptions",
    "SensorOptions",
    "SizeOptions",
    "SocketOptions",
    "VirtualSetup",
]


@dataclass(frozen=True, kw_only=True)
class PoseOptions:
    """Options of measured positions and orientations."""

    orientation: AngleConvention | None = None
    """What the angles rx, ry, rz of a measured pose mean."""
    noise_mrad: float | None = None
    """Weigh measured orientations by this noise, beside --noise-mm; without both the ratio is estimated."""
    method: Literal["global", "sequential"] = "global"
    """Fit everything at once; or of poses the angles first, then the lengths."""


@dataclass(frozen=True, kw_only=True)
class SizeOptions:
    """Options of an artefact of known dimensions."""

    size_u_percent: float | None = None
    """Standard uncertainty of all lengths of a board, cube, plate, bar or pair of sockets, as one share; 0 for exact.
    By default 0.5 for printed boards, 0.005 for cubes, plates and bars, 0.1 for the distance of sockets."""


@dataclass(frozen=True, kw_only=True)
class SocketOptions(SizeOptions):
    """Options of a ball in sockets."""

    socket_distance_mm: float | None = None
    """Known distance between the sockets of a location."""


@dataclass(frozen=True, kw_only=True)
class ProbeOptions(SizeOptions):
    """Options of an artefact whose surfaces are touched."""

    tip_radius_mm: float | None = None
    """Known radius of the ball that touches the faces of a cube or the surfaces of spheres; a point without."""


@dataclass(frozen=True, kw_only=True)
class CameraOptions(SizeOptions):
    """Options of corners of boards in pictures."""

    cameras: Path | None = None
    """Cameras and boards (intrinsic parameters, corners, what they are fixed to): TOML. By default a camera in the
    hand, and a board of 9 by 6 corners."""
    noise_px: float | None = None
    """The noise of a corner that the identifier assumes (1σ per axis); by default it is estimated."""


@dataclass(frozen=True, kw_only=True)
class SensorOptions(CameraOptions, ProbeOptions, SocketOptions, PoseOptions):
    """The options of all sensors."""


@dataclass(frozen=True, kw_only=True)
class VirtualSetup:
    """Measurement set-up of a virtual arm, beside arm and instrument; a sensor's ``setup`` lists its fields."""

    occlusion: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Leave out what the instrument does not see: out of its sight, or behind the arm."""
    orientation_share: float = 1.0
    """Share of the poses whose orientation is measured, by chance; of the others the position alone."""
    fixtures: int = 4
    """How many anchors of a cable, locations of two sockets each, planes, indicators, or places of an artefact."""
    artefact_mm: float = 200.0
    """Size of a simulated artefact: a cube's edges, the sides of a square of spheres, a ball bar's length."""


@dataclass(frozen=True)
class FitInputs:
    """Options of an identification that a sensor checks beside its own.

    Attributes:
        noise_mm: assumed noise of a position (1σ per axis); None where it is not given.
        prior: whether the manufacturing tolerances are a prior.
        instrument, validation_file: whether these are given; they are for points alone.
    """

    noise_mm: float | None = None
    prior: bool = False
    instrument: bool = False
    validation_file: bool = False

    def refuse_those_of_points(self, sensor: str) -> None:
        """Refuse options for measured points alone.

        Raises:
            LabError: an instrument or a validation file is given.
        """
        if self.instrument or self.validation_file:
            raise LabError(
                f"{option_name('observe')} {sensor}: {option_name('validate')} and {option_name('instrument')} "
                f"are of points; leave them out"
            )

    def refuse_validation_file(self, sensor: str) -> None:
        """Refuse a file of points to validate on.

        Raises:
            LabError: a file is given.
        """
        if self.validation_file:
            raise LabError(f"{option_name('observe')} {sensor}: {option_name('validate')} is of points; leave it out")
