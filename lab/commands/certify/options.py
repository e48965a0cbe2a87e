"""Options of ``lab certify``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from lab.campaign.option_types import Flag
from lab.core.limits import positive

__all__ = ["CertifyOptions"]


@dataclass(frozen=True)
class CertifyOptions:
    """A calibration to certify."""

    run: tyro.conf.Positional[Path]
    """The folder of a run of lab calibrate or lab identify."""
    details: Path | None = None
    """TOML file that states who measured what, when, where and with which instrument. Missing entries are listed."""
    instrument: str | None = None
    """The TOML file of the tracker with its systematic errors; by default the instrument of the run."""
    tolerance_mm: float | None = None
    """Tolerance for the statement of conformity; by default the run's gate, if it had one."""
    statistic: Literal["mean", "p95", "max"] = "mean"
    """Statistic of the position errors on validation poses to compare with the tolerance."""
    decision_rule: Literal["guard-band", "simple"] = "guard-band"
    """Subtract the expanded uncertainty from the tolerance (guard-band), or neglect it (simple)."""
    force: Flag = False
    """Also certify a run whose verdict is bad or not judged."""
    accept_edited: Flag = False
    """Also read a run whose files were changed since it was written."""

    def check(self) -> None:
        """Refuse numbers that make no sense, with a LabError that names the option."""
        if self.tolerance_mm is not None:
            positive("--tolerance-mm", self.tolerance_mm)
