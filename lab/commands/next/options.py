"""Options of ``lab next``."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from lab.campaign.option_types import Flag, NoRecording
from lab.core.errors import LabError
from lab.core.limits import CANDIDATES, SEED, positive, whole

__all__ = ["NextOptions"]

_LONGEST_S = 86_400.0


@dataclass(frozen=True)
class NextOptions:
    """Which pose to measure next, given all poses measured so far."""

    plan: tyro.conf.Positional[Path]
    """The folder of a run of lab design, whose robot, cell, instrument and targets are measured, or of lab identify."""
    file: tyro.conf.Positional[Path | None] = None
    """The measurements so far (CSV); those of the run of lab identify, if not given; nothing for lab design."""
    accuracy_mm: float | None = None
    """Stop when 95 % of the validation poses are predicted within this, in 95 % of the campaigns; that of the plan,
    if not given."""
    criterion: str = "I"
    """What the next pose is to make as good as can be: O1, O2, O3, O4, O5, condition, A, G or I. Packages may add
    others."""
    instrument: str | None = None
    """Whose noise and sight to count with; that of the run, if not given."""
    follow: Flag = False
    """Go on as the file grows, and propose a pose after each new row, until the accuracy is reached."""
    patience_s: float = 600.0
    """End following if the file has not grown for so long, s."""
    connect: str | None = None
    """Also show every proposal in a running rerun viewer at this address: rerun+http://127.0.0.1:9876/proxy is that
    of a viewer on this machine."""
    candidates: int = 2000
    """How many feasible poses to choose from."""
    no_recording: NoRecording = False
    seed: int = 0
    """Random seed of the candidates and of the validation poses."""

    def check(self) -> None:
        """Refuse numbers that make no sense, with a LabError that names the option."""
        whole("--seed", self.seed, 0, SEED)
        whole("--candidates", self.candidates, 1, CANDIDATES)
        if self.accuracy_mm is not None:
            positive("--accuracy-mm", self.accuracy_mm)
        if not 0 < self.patience_s <= _LONGEST_S:
            raise LabError(f"--patience-s {self.patience_s:g}: give a time above 0 and up to {_LONGEST_S:g} s")
        if self.follow and self.file is None:
            raise LabError("--follow: give the measurement file that grows")
