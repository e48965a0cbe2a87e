"""Options of ``lab verify``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from lab.campaign.option_types import Flag, Names, NoRecording
from lab.core.errors import LabError
from lab.core.limits import check_serial, day, positive

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
    serial: str | None = None
    """The serial number of the arm that was measured; refused where the run is of another one."""
    date: str | None = None
    """The day of the measurements, YYYY-MM-DD, by which lab status puts verifications in order."""
    require: Literal["good"] | None = None
    """Exit with 3 where the measurements are within the predicted error of a run that is not good itself."""
    no_recording: NoRecording = False
    force: Flag = False
    """Verify against a run too whose verdict is bad or not judged, and by rows that it was identified from."""
    accept_edited: Flag = False
    """Build on a run too whose files were changed since it was written."""

    def check(self) -> None:
        """Refuse options that make no sense or contradict each other, with a LabError that names them."""
        if stray := sorted(set(self.refit) - {"base", "tool"}):
            raise LabError(f"--refit {stray[0]}: unknown; give base, tool or base,tool")
        check_serial(self.serial)
        if self.date is not None:
            day("--date", self.date)
        if self.noise_mm is not None:
            positive("--noise-mm", self.noise_mm)
            if self.instrument is not None:
                raise LabError("--instrument and --noise-mm both set the noise; give one")
        if self.instrument == "exact":
            raise LabError("--instrument exact: without noise there is nothing to test by; give --noise-mm")
