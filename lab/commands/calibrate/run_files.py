"""The files of a run of ``lab calibrate`` or ``lab identify``: read through one gate, typed, whole, and as written."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lab.campaign.config_file import CONFIG_FILE, RunConfig, RunInputs, input_names, read_config
from lab.campaign.options import VirtualCampaign
from lab.commands.calibrate.options import MeasuredCampaign
from lab.commands.calibrate.range_dict import POSES_FILE
from lab.commands.calibrate.residual_file import RESIDUAL_FILE
from lab.commands.calibrate.run_findings import Findings
from lab.commands.integrity import said_of_edits
from lab.commands.run_folder import LOAD_FILE
from lab.core.covariance import refuse_impossible_covariance
from lab.core.errors import LabError, error_context
from lab.core.ranges import LENGTH_M
from lab.core.se3 import Array
from lab.formats.csv_table import CsvTable
from lab.formats.structured import read_structured, structured

__all__ = [
    "CALIBRATIONS",
    "MEASUREMENTS_FILE",
    "READ_FILES",
    "Campaign",
    "RunFiles",
    "SavedParameter",
    "read_run_files",
]

Campaign = VirtualCampaign | MeasuredCampaign
CALIBRATIONS: Mapping[str, type[Campaign]] = {"calibrate": VirtualCampaign, "identify": MeasuredCampaign}
MEASUREMENTS_FILE, _COVARIANCE_FILE, _PARAMETERS_FILE = "measurements.csv", "covariance.csv", "parameters.json"
_RESULT_FILE = "result.json"
READ_FILES = (
    CONFIG_FILE, _RESULT_FILE, _PARAMETERS_FILE, _COVARIANCE_FILE, RESIDUAL_FILE, POSES_FILE, MEASUREMENTS_FILE,
    LOAD_FILE,
)  # fmt: skip
_MEND = "give the folder of a run of lab calibrate or lab identify, or make the run again"


@dataclass(frozen=True)
class SavedParameter:
    """A parameter (SI) as ``parameters.json`` holds it; its keys."""

    name: str
    nominal: float
    exported: float
    estimate: float
    std: float | None = None
    status: str | None = None
    unit: str | None = None

    def __post_init__(self) -> None:
        """Refuse a size that no parameter has, with a LabError."""
        for key in ("nominal", "exported", "estimate"):
            if abs(value := getattr(self, key)) not in LENGTH_M:
                raise LabError(f"{self.name}: {key} is {value:g}; no parameter is larger than {LENGTH_M.most:g}")


@dataclass(frozen=True)
class RunFiles:
    """What the files of a run hold that tell of its identification.

    Attributes:
        options: of the command that made the run.
        parameters: by name.
        identified: the parameters that ``covariance`` ``(f, f)`` is of.
    """

    folder: Path
    config: RunConfig
    options: Campaign
    findings: Findings
    parameters: Mapping[str, SavedParameter]
    identified: tuple[str, ...]
    covariance: Array

    @property
    def inputs(self) -> RunInputs:
        """What the run was made from."""
        return RunInputs(self.folder, self.config)

    def edits(self, *, accept: bool) -> tuple[str, ...]:
        """What is to be told of files that were changed since the run was written.

        Raises:
            LabError: some were, and are not accepted.
        """
        return said_of_edits(self.folder, (*READ_FILES, *input_names(self.folder)), accept=accept)


def read_run_files(folder: Path) -> RunFiles:
    """Read the files of a run.

    Raises:
        LabError: it is no such run, or a file is missing or does not hold what a run writes.
    """
    config = read_config(folder, _MEND)
    findings = read_structured(folder / _RESULT_FILE, Findings, _MEND)
    if config.command not in CALIBRATIONS:
        raise LabError(f"{folder}: is no run of lab calibrate or lab identify; give the folder of one")
    options = structured(f"{folder / CONFIG_FILE}: options", CALIBRATIONS[config.command], config.options, extra=True)
    if config.schema:  # what an older version let pass may be refused today
        with error_context(folder / CONFIG_FILE):
            options.check()
    rows = read_structured(folder / _PARAMETERS_FILE, tuple[SavedParameter, ...], _MEND)
    labels, matrix = _covariance(folder / _COVARIANCE_FILE)
    return RunFiles(folder, config, options, findings, {row.name: row for row in rows}, labels, matrix)


def _covariance(path: Path) -> tuple[tuple[str, ...], Array]:
    """The identified parameters' names and covariance."""
    if not path.is_file():
        raise LabError(f"{path}: is missing: an older version of the lab made this run; make it again")
    table = CsvTable(path)
    labels = table.texts("parameter")
    if labels is None or tuple(table.header[1:]) != labels:
        raise LabError(f"{path}: its rows are not those of its columns; identify again")
    try:
        matrix = np.array([table.texts(name) for name in labels], dtype=np.float64).T
    except ValueError as error:
        raise LabError(f"{path}: {error}; identify again") from error
    refuse_impossible_covariance(path, matrix)
    return labels, matrix
