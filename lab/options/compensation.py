"""Options of ``lab compensate``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from lab.core.errors import LabError
from lab.core.limits import DIGITS
from lab.core.orientation import AngleConvention
from lab.formats.programs.languages import Controller
from lab.options.option_types import Flag, NoRecording, Numbers
from lab.robots.config_file import refuse_own_name

__all__ = ["CompensateOptions"]


@dataclass(frozen=True)
class CompensateOptions:
    """Targets to correct, and the calibrated arm."""

    run: Path
    """The folder of a run of lab calibrate or lab identify."""
    targets: tyro.conf.Positional[Path | None] = None
    """Targets of the tool, in the frame in which the arm was measured: CSV."""
    program: Path | None = None
    """Instead of targets: a controller program, whose targets are corrected in its text."""
    orientation: AngleConvention | None = None
    """Convention of the targets' angles rx, ry, rz."""
    force: Flag = False
    """Also accept a run whose verdict is bad or not judged. The result repeats the reasons of a doubtful verdict."""
    accept_edited: Flag = False
    """Also accept a run whose files were edited after writing."""
    cell: Path | None = None
    """The cell (obstacles, narrower limits): TOML; that of the run by default."""
    controller: Controller | None = None
    """The language of its program; that of the robot's maker, by default, if the robot's name shows it."""
    no_check: Flag = False
    """Skip the collision checks of the corrected targets and of the paths between them."""
    load: Path | None = None
    """The folder of a run of lab payload: the payload at each target, with the mass payload_kg where given."""
    frames: str = ""
    """For a program: tools and frames missing from its text, as the controller shows them: NAME=x,y,z,…; parted by
    semicolons. base is the controller's base in frame 0 of the table, flange its flange in the last frame."""
    pulses_per_deg: Numbers = ()
    """For a JBI program with positions in pulses: pulses per degree of the joints S, L, U, R, B and T."""
    require: Literal["good"] | None = None
    """Exit with code 3 if all targets are reached and the verdict is doubtful."""
    no_recording: NoRecording = False
    digits: int | None = None
    """Of a program: places behind the point, at least; those of its text, if not given. Numbers get more where rounding
    would lose their correction."""

    @property
    def source(self) -> Path:
        """The file that is corrected."""
        return self.program or self.targets or Path("targets.csv")

    def refuse_conflicts(self) -> None:
        """Refuse what does not go together.

        Raises:
            LabError: with what to leave out, or to give.
        """
        if (self.targets is None) == (self.program is None):
            text = "both are given" if self.targets else "none is given"
            raise LabError(f"give targets as a CSV file, or --program FILE: {text}")
        if self.program is not None:
            refuse_own_name(f"--program {self.program}", self.program.name)
        if self.program is not None and self.orientation is not None:
            raise LabError("--orientation is for angles of a CSV file; a program's language defines its angles")
        given = {"--frames": self.frames, "--pulses-per-deg": self.pulses_per_deg, "--digits": self.digits is not None}
        if self.program is None and (alone := [name for name, there in given.items() if there]):
            raise LabError(f"{alone[0]} goes with --program FILE")
        if self.digits is not None and self.digits not in DIGITS:
            raise LabError(f"--digits is {self.digits}: give 0 to 12")
