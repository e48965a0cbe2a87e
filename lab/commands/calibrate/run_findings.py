"""What of a run's ``result.json`` matters to whoever builds on the run."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from lab.calibration.verdict import gate_words
from lab.commands.calibrate.range_dict import Extrapolation
from lab.commands.calibrate.residual_file import ResidualSizes
from lab.core.errors import LabError
from lab.formats.noise_model import NoiseModel

__all__ = ["ActingTolerances", "Findings", "NamedOutlier"]

_STATISTICS = {"mean", "rms", "p95", "max", "count"}


@dataclass(frozen=True)
class NamedOutlier:
    """A pose that the test of outliers names, and whether it was held out."""

    id: str
    held_out: bool = False


@dataclass(frozen=True)
class ActingTolerances:
    """What tolerances of manufacture did in a fit: how many directions of the parameters they took part in."""

    acts_in: int


@dataclass(frozen=True)
class Findings:
    """What of a run's ``result.json`` matters to whoever builds on it; its keys.

    Attributes:
        freedom: residual degrees of freedom.
        after_mm, before_mm: errors after and before; None where nothing was there to validate on.
        judged_by: on what; None without validation.
        outliers: poses that the test of outliers names.
        outliers_left_out: whether these were not fitted.
        cluster_robust: whether the parameters' covariance is that of whole poses' own residuals.
        noise_model: errors beside the instrument's (``noise_model_to_dict``); None where there are none.
        noise_tail_freedom: degrees of freedom of its tails, of Student's t; None where Gaussian's will do.
        measured_range: the joint positions that were fitted (``measured_range_to_dict``); None where it is not known.
        extrapolation: what the model may lack where nothing was measured (``extrapolation_to_dict``); None likewise.
        prior: of tolerances; None for a run of an older version.
        residual: sizes of the joints' offsets that no group explains (``residual_to_dict``); None where not fitted.
    """

    model: str
    verdict: str
    reason: str
    noise_known: bool
    noise_mm: float | None
    residual_mm: float | None
    freedom: int
    adequate: bool | None
    adequacy: str
    after_mm: Mapping[str, float] | None = None
    before_mm: Mapping[str, float] | None = None
    judged_by: str | None = None
    outliers: tuple[NamedOutlier, ...] = ()
    outliers_left_out: bool = False
    cluster_robust: bool = False
    noise_model: NoiseModel | None = None
    noise_tail_freedom: float | None = None
    measured_range: Mapping[str, Mapping[str, float]] | None = None
    extrapolation: Extrapolation | None = None
    residual: ResidualSizes | None = None
    prior: ActingTolerances | None = None
    reasons: tuple[str, ...] = ()
    gate_mm: float | None = None
    schema: int = 0
    migrated: bool = False

    @property
    def usable(self) -> bool:
        """Whether others may build on the run: it is good, or doubtful for reasons that they are told."""
        return self.verdict in ("good", "doubtful")

    @property
    def words(self) -> str:
        """The verdict with its gate, for a person."""
        return f"{self.verdict}, {gate_words(self.gate_mm)}"

    def to_dict(self) -> dict[str, Any]:
        """What the result of whoever builds on the run holds of its verdict."""
        return {"verdict": self.verdict, "reasons": list(self.reasons), "gate_mm": self.gate_mm}

    def __post_init__(self) -> None:
        """Refuse sizes below zero and lists of errors that lack one, with a LabError."""
        for name in ("after_mm", "before_mm"):
            if (sizes := getattr(self, name)) is not None and (missing := _STATISTICS - set(sizes)):
                raise LabError(f"{name}: '{min(missing)}' is missing")
            if min((sizes or {}).values(), default=0.0) < 0:
                raise LabError(f"{name}: a size of errors is not below zero")
        for name in ("noise_mm", "residual_mm"):
            if (size := getattr(self, name)) is not None and not size >= 0:
                raise LabError(f"{name} is {size:g}; a standard deviation is not below zero")
        if self.freedom < 0:
            raise LabError(f"freedom is {self.freedom}; degrees of freedom are not below zero")
        if self.noise_tail_freedom is not None and not self.noise_tail_freedom > 2:
            raise LabError(f"noise_tail_freedom is {self.noise_tail_freedom:g}; Student's t has a variance above 2")
