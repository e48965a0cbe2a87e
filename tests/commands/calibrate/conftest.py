"""A campaign and its recording, made once."""

from pathlib import Path

import pytest
from helpers.campaigns import calibration

from lab.report.views.calibration_recording import record


@pytest.fixture(scope="session")
def outcome():
    return calibration(seed=7, poses=30)


@pytest.fixture(scope="session")
def recording(outcome, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "recording.rrd"
    record(path, outcome)
    return path
