"""A campaign and its recording, made once."""

from pathlib import Path

import pytest

from lab.campaign.options import VirtualCampaign
from lab.commands.calibrate.recording import record
from lab.commands.calibrate.run import calibrate


@pytest.fixture(scope="session")
def outcome():
    return calibrate(VirtualCampaign(seed=7, poses=30))


@pytest.fixture(scope="session")
def recording(outcome, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "recording.rrd"
    record(path, outcome)
    return path
