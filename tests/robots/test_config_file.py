"""Options of an earlier run, read back."""

import json
from pathlib import Path

import pytest

from lab.core.errors import LabError
from lab.options.virtual_campaign import VirtualCampaign
from lab.robots.config_file import read_config, read_options


def written(folder: Path, content: object) -> Path:
    path = folder / "config.json"
    path.write_text(json.dumps(content))
    return path


def test_what_is_left_out_is_at_its_default(tmp_path: Path) -> None:
    options = {"poses": 12, "targets": ["p1", "p2"], "fitting": {"robust": True}, "effects": {"payload_kg": [0, 3]}}
    path = written(tmp_path, {"schema": 1, "command": "calibrate", "options": options})
    found = read_options(path, "calibrate", VirtualCampaign)
    assert (found.poses, found.targets, found.seed) == (12, ("p1", "p2"), 0)
    assert found.fitting.robust and found.fitting.model == "geometric" and found.effects.payload_kg == (0, 3)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ([], "is to be a group of options"),
        ({"options": 3}, "3 is not a value of option 'options'"),
        ({"schema": 1, "command": "identify", "options": {}}, "lab identify"),
        ({"schema": 1, "options": {"pose": 3}}, "'pose'"),
    ],
)
def test_what_is_no_config(content: object, says: str, tmp_path: Path) -> None:
    with pytest.raises(LabError, match=says):
        read_options(written(tmp_path, content), "calibrate", VirtualCampaign)


@pytest.mark.parametrize("schema", [{}, {"schema": 0}, {"schema": 2}])
def test_a_run_of_another_schema_is_refused_with_the_version_that_wrote_it(schema: dict, tmp_path: Path) -> None:
    path = written(tmp_path, {"options": {}, "versions": {"virtual-calibration-lab": "7.8.9"}, **schema})
    for read in (lambda: read_config(tmp_path), lambda: read_options(path, "calibrate", VirtualCampaign)):
        with pytest.raises(LabError) as refused:
            read()
        assert str(path) in str(refused.value) and "lab 7.8.9" in str(refused.value)
