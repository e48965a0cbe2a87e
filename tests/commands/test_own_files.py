"""What a command writes into its run's folder is known as its own, so that ``--overwrite`` replaces the folder."""

import re
from pathlib import Path

import lab.commands
from lab.commands.run_folder import run_folder, write_json
from lab.core.whole_folder import CHECKSUMS


def test_every_file_that_a_command_writes_can_be_replaced(tmp_path) -> None:
    written = set[str]()
    package = Path(lab.commands.__path__[0]).parent
    for module in (each for each in package.rglob("*.py") if each.parent.name != "study"):  # that goes on in its folder
        written |= set(re.findall(r"folder / \"([a-z_]+\.[a-z]+)\"", module.read_text(encoding="utf-8")))
    assert {"result.json", "trajectory.csv", "values.csv", "workspace.csv"} <= written
    folder = tmp_path / "run"
    folder.mkdir()
    for name in (*written, CHECKSUMS):
        (folder / name).write_text("")
    write_json(folder / "config.json", {"model_sha256": ""})
    with run_folder(folder, overwrite=True):
        pass
