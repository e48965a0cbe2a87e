"""A built wheel works away from the repository: the models travel in it."""

import os
import subprocess
import sys
import zipfile

import pytest
from helpers.robots import ROOT

from lab.kinematics.compiled.kernels import compiled


@pytest.mark.thorough
def test_the_wheel_works_from_an_empty_folder(tmp_path) -> None:
    wheels, site = tmp_path / "wheels", tmp_path / "site"
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q"]
    build = [*pip, "wheel", str(ROOT), "--no-deps", "--no-build-isolation", "-w", str(wheels)]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = wheels.glob("*.whl")
    assert wheel.stat().st_size < 3_000_000 and ("-cp311-abi3-" in wheel.name) == compiled()
    zipfile.ZipFile(wheel).extractall(site)
    assert [each.name for each in site.iterdir() if each.suffix != ".dist-info"] == ["lab"]  # no scripts, no tests
    smoke = [sys.executable, str(ROOT / ".ci" / "smoke.py"), *([] if compiled() else ["--without-kernels"])]
    environment = {**os.environ, "PYTHONPATH": str(site)}
    done = subprocess.run(smoke, capture_output=True, text=True, cwd=tmp_path, env=environment)
    assert done.returncode == 0 and " works on Python " in done.stdout, done.stderr
