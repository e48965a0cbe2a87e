"""Options of ``lab study``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from lab.campaign.option_types import Flag
from lab.core.errors import LabError

__all__ = ["StudyOptions"]


@dataclass(frozen=True)
class StudyOptions:
    """A study of many simulated calibrations, where it is kept, and who works it out."""

    config: tyro.conf.Positional[Path]
    """The study, TOML."""
    out: Path | None = None
    """The study's folder: runs/study-NAME by default, numbered if taken."""
    resume: Flag = False
    """Resume the interrupted study in --out."""
    workers: int | None = None
    """Number of processes on this machine; one per core by default."""
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="PROTOCOL://HOST:PORT")] = None
    """Address of a dask.distributed scheduler whose workers run the study instead, e.g. tls://host:8786."""

    def check(self) -> None:
        """Refuse options that contradict each other, with a LabError that names them."""
        if self.resume and self.out is None:
            raise LabError("--resume continues a study: give its folder by --out")
        if self.scheduler is not None and self.workers is not None:
            raise LabError("--workers sets processes on this machine, --scheduler a cluster; give one")
