"""What can be asked of ``lab verify``."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from lab.campaign.option_types import Flag, Names
from lab.core.errors import LabError
from lab.core.numbers import positive

__all__ = ["VerifyOptions"]


@dataclass(frozen=True)
class VerifyOptions:
    """A few new measurements against a calibrated arm."""

    run: tyro.conf.Positional[Path]
    """The folder of the run that calibrated the arm."""
    file: tyro.conf.Positional[Path]
    """New measurements, CSV."""
    refit: Names = ()
    """What was set up anew, and is fitted: base, tool, or base,tool."""
    instrument: str | None = None
    """Whose noise these measurements have: uniform-8um, leica-at960, leica-at500, faro-vantage, optical-cmm or
    krypton-k600, with its head at the file's origin; by default what the run took it for.
    Or the TOML file of a tracker."""
    noise_mm: float | None = None
    """Their noise (1σ per axis) instead."""
    force: Flag = False
    """Verify against a run too whose verdict is bad or not judged, and by rows that it was identified from."""
    accept_edited: Flag = False
    """Build on a run too whose files were changed since it was written."""

    def check(self) -> None:
        """Refuse options that make no sense or contradict each other, with a LabError that names them."""
        if stray := sorted(set(self.refit) - {"base", "tool"}):
            raise LabError(f"--refit {stray[0]}: unknown; give base, tool or base,tool")
        if self.noise_mm is not None:
            positive("--noise-mm", self.noise_mm)
            if self.instrument is not None:
                raise LabError("--instrument and --noise-mm both say what the noise is; give one")
        if self.instrument == "exact":
            raise LabError("--instrument exact: without noise there is nothing to test by; give --noise-mm")
