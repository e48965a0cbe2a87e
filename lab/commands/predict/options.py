"""Options of ``lab predict``."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from lab.campaign.option_types import Flag

__all__ = ["PredictOptions"]


@dataclass(frozen=True)
class PredictOptions:
    """Joint positions of a calibrated arm."""

    run: tyro.conf.Positional[Path]
    """The folder of a run of lab calibrate or lab identify."""
    file: tyro.conf.Positional[Path]
    """Joint positions and the model's conditions, in the columns of a measurement file: CSV."""
    force: Flag = False
    """Also accept a run whose verdict is bad or not judged. The result repeats the reasons of a doubtful verdict."""
    accept_edited: Flag = False
    """Also accept a run whose files were edited after writing."""
    load: Path | None = None
    """The folder of a run of lab payload: what the arm carries in each pose (as heavy as payload_kg, where given)."""
