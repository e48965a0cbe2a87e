"""A built wheel works away from the repository: the models travel in it."""

import json
import os
import shlex
import subprocess
import sys
import zipfile

import pytest
from helpers.robots import ROOT


@pytest.mark.thorough
def test_the_wheel_inspects_a_robot_from_an_empty_folder(tmp_path) -> None:
    wheels, site, empty = (tmp_path / name for name in ("wheels", "site", "empty"))
    empty.mkdir()
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q"]
    build = [*pip, "wheel", str(ROOT), "--no-deps", "--no-build-isolation", "-w", str(wheels)]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = wheels.glob("*.whl")
    assert wheel.stat().st_size < 3_000_000
    zipfile.ZipFile(wheel).extractall(site)
    assert [each.name for each in site.iterdir() if each.suffix != ".dist-info"] == ["lab"]  # no scripts, no tests
    environment = {**os.environ, "PYTHONPATH": str(site), "COLUMNS": "100"}
    where = "import lab, lab.campaign.model_files as r; print(lab.__file__, r.models_folder(), sep='\\n')"
    inspect = "from lab.cli import main; main(['inspect', 'irb120'])"
    command = [sys.executable, "-c", f"{where}; {inspect}"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=empty, env=environment)
    assert all(line.startswith(str(site)) for line in done.stdout.splitlines()[:2])
    assert "q6 + 180" in done.stdout and "27 of 34" in done.stdout
    assert not list(empty.iterdir())
    example = [sys.executable, "-c", "from lab.cli import main; main(['example', 'ur5', '--json'])"]
    done = subprocess.run(example, capture_output=True, text=True, check=True, cwd=empty, env=environment)
    (found,) = json.loads(done.stdout)["examples"]
    _, *arguments = shlex.split(found["command"])
    identify = f"import sys; from lab.cli import main; sys.exit(main({[*arguments, '--json']}))"
    done = subprocess.run([sys.executable, "-c", identify], capture_output=True, check=True, cwd=empty, env=environment)
    after = json.loads(done.stdout)["after_mm"]
    assert after["count"] == 20 and after["mean"] < 0.11  # models/ur5/README.md: 0.101
