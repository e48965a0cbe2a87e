"""Options of the judgement of a fit: the same for a virtual campaign and for measurements."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from lab.core.errors import LabError
from lab.core.limits import positive
from lab.core.units import MM
from lab.options.option_types import Names
from lab.prediction.task_region import REGION_HELP, task_region

if TYPE_CHECKING:
    from lab.calibration.sensor import ArmSensor
    from lab.core.measurements import Measurements
    from lab.verdict.fitted import JudgementOptions

__all__ = ["Judging", "ValidatedJudging"]


@dataclass(frozen=True)
class Judging:
    """Options of the judgement."""

    gate_mm: float | None = None
    """A larger mean error on poses not fitted is a bad result; by default the result is judged without a gate."""
    region: Annotated[str, tyro.conf.arg(help=REGION_HELP)] = "measured"
    require: Literal["good"] | None = None
    """Exit with 3 where the verdict is doubtful or nothing was validated; a bad one exits with 1 in any case."""

    def check_judging(self, sensor: "ArmSensor") -> None:
        """Refuse a gate or a region that makes no sense, with a LabError that names the option."""
        if self.gate_mm is not None:
            positive("--gate-mm", self.gate_mm)
        if task_region(self.region).kind != "measured" and not sensor.in_instrument_frame:
            raise LabError(
                f"--region {self.region}: of --observe {sensor.name} errors are predicted where poses were measured; "
                "leave it out"
            )

    def judgement(self) -> "JudgementOptions":
        """Return the options of the judgement in SI units.

        Raises:
            LabError: the region cannot be read.
        """
        from lab.verdict.fitted import JudgementOptions

        gate_m = None if self.gate_mm is None else MM.to_si(self.gate_mm)
        return JudgementOptions(gate_m, task_region(self.region), f"--region {self.region}")


@dataclass(frozen=True)
class ValidatedJudging(Judging):
    """Options of the judgement by measurements that were not fitted."""

    holdout: float | None = None
    """Hold out this share of the poses, at random, and validate on them."""
    holdout_last: float | None = None
    """Hold out this share of the poses, the last by time_s or else in the file, and validate on them."""
    validate: Path | None = None
    """Judge by this file."""
    refit: Names = ()
    """What each session of that file may place anew: base, tool, or base,tool."""

    def check_judging(self, sensor: "ArmSensor") -> None:
        """Refuse options that make no sense or contradict each other, with a LabError that names them."""
        sources = {"--holdout": self.holdout, "--holdout-last": self.holdout_last, "--validate": self.validate}
        if len(given := [flag for flag, value in sources.items() if value is not None]) > 1:
            raise LabError(f"{given[0]} and {given[1]} both set the validation data; give one")
        if self.refit and self.validate is None:
            raise LabError("--refit sets what a validation file fits anew; give --validate FILE too")
        super().check_judging(sensor)

    def judgement(self, other: "Measurements | None" = None) -> "JudgementOptions":
        """Return the options of the judgement in SI units.

        Args:
            other: the rows of the file to validate on.

        Raises:
            LabError: the region cannot be read.
        """
        return replace(
            super().judgement(),
            holdout=self.holdout,
            holdout_last=self.holdout_last,
            other=other,
            other_source=str(self.validate),
            refit=self.refit,
        )
