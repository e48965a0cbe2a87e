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
    """Who measured what, when, where and with which instrument: TOML. Missing entries are listed."""
    instrument: str | None = None
    """The TOML file of the tracker with its systematic errors; by default the instrument of the run."""
    tolerance_mm: float | None = None
    """Say whether the robot conforms to this tolerance; by default to the run's gate, if it had one."""
    statistic: Literal["mean", "p95", "max"] = "mean"
    """Of the position errors on validation poses: which is compared with the tolerance."""
    decision_rule: Literal["guard-band", "simple"] = "guard-band"
    """Take the expanded uncertainty off the tolerance, or accept whatever is within the tolerance."""
    force: Flag = False
    """Certify a run too whose verdict is bad or not judged."""
    accept_edited: Flag = False
    """Read a run too whose files were changed since it was written."""

    def check(self) -> None:
        """Refuse numbers that make no sense, with a LabError that names the option."""
        if self.tolerance_mm is not None:
            positive("--tolerance-mm", self.tolerance_mm)
