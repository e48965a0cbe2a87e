"""What can be asked of a calibration from measurements; of a virtual one, ``lab.campaign.options`` says."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import tyro

from lab.campaign.option_groups import Fitting, Names, positive
from lab.campaign.options import VirtualCampaign, check_common
from lab.core.errors import LabError

__all__ = ["MeasuredCampaign", "VirtualCampaign"]


@dataclass(frozen=True)
class MeasuredCampaign:
    """A calibration from a measurement file."""

    file: tyro.conf.Positional[Path]
    """Measurements, CSV."""
    robot: str = "irb120"
    """A model's name, or a path to an MJCF, a URDF, or a TOML table or mechanism."""
    seed: int = 0
    """Of the split into poses to fit and poses to judge by."""
    instrument: str | None = None
    """Weigh the points by the noise of exact, uniform-8um, leica-at960, leica-at500, faro-vantage or optical-cmm,
    with its head at the file's origin."""
    noise_mm: float | None = None
    """Weigh the points by this noise (1σ per axis); without either it is estimated."""
    holdout: float | None = None
    """Hold out this share of the poses, and judge by them."""
    validate: Path | None = None
    """Judge by this file."""
    refit: Names = ()
    """What each session of that file may place anew: base, tool, or base,tool."""
    gate_mm: float = 1.0
    """A larger mean error on poses not fitted is a bad result."""
    observe: Literal["points", "pose", "cable", "socket", "plane"] = "points"
    """Which of the file's columns are the measurements."""
    orientation: Literal["intrinsic-xyz", "fixed-xyz", "rotation-vector"] | None = None
    """What the angles rx, ry, rz of a measured pose mean."""
    noise_mrad: float | None = None
    """Weigh measured orientations by this noise, beside --noise-mm; without both the ratio is estimated."""
    method: Literal["global", "sequential"] = "global"
    """Fit everything at once; or of poses the angles first, then the lengths."""
    socket_distance_mm: float | None = None
    """Known distance between the sockets of a location."""
    fitting: tyro.conf.OmitArgPrefixes[Fitting] = field(default_factory=Fitting)
    """How parameters are fitted."""

    def check(self) -> None:
        """Refuse options that make no sense or contradict each other, with a LabError that names them."""
        check_common(self.fitting, self.seed, self.gate_mm, self.noise_mm)
        if self.noise_mm is not None and self.instrument is not None:
            raise LabError("--instrument and --noise-mm both say what the noise is; give one")
        if self.holdout is not None and self.validate is not None:
            raise LabError("--holdout and --validate both say how to judge; give one")
        if self.refit and self.validate is None:
            raise LabError("--refit says what a validation file may fit anew; give --validate FILE too")
        if self.observe != "points" and (self.validate is not None or self.instrument is not None):
            raise LabError(f"--observe {self.observe}: --validate and --instrument are of points; leave them out")
        for flag, given, kind in (
            ("--orientation", self.orientation, "pose"),
            ("--noise-mrad", self.noise_mrad, "pose"),
            ("--method sequential", self.method == "sequential" or None, "pose"),
            ("--socket-distance-mm", self.socket_distance_mm, "socket"),
        ):
            if given is not None and self.observe != kind:
                raise LabError(f"{flag} is of --observe {kind}; give that too, or leave it out")
        if self.noise_mrad is not None and self.noise_mm is None:
            raise LabError("--noise-mrad says what orientations weigh beside positions; give --noise-mm too")
        if self.method == "sequential" and self.fitting.prior:
            raise LabError("--prior is of --method global: the sequential method takes none; leave one out")
        for flag, number in (("--noise-mrad", self.noise_mrad), ("--socket-distance-mm", self.socket_distance_mm)):
            if number is not None:
                positive(flag, number)
