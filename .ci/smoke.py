"""Try an installed package as its user would, in an empty folder: python .ci/smoke.py [--without-kernels].

It reads nothing beside itself, and fails if the lab is imported from the checkout. Run it with the Python into which
the wheel or the source distribution was installed.
"""

import json
import os
import platform
import shlex
import subprocess
import sys
import tempfile
from importlib.metadata import entry_points, version
from pathlib import Path


def lab(folder: Path, *arguments: str) -> str:
    """Run a command in that folder; return what it prints."""
    command = [sys.executable, "-m", "lab", *arguments]
    # UTF-8, whatever the system's code page is; a user's settings of Python stay out, as does the checkout
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8", "MPLBACKEND": "agg"}
    done = subprocess.run(command, capture_output=True, cwd=folder, env=environment, timeout=600)
    if done.returncode:
        raise SystemExit(f"{shlex.join(command)}: exit code {done.returncode}\n{done.stderr.decode()}")
    return done.stdout.decode()


def main() -> None:
    """Run all checks; the first one that fails ends the program."""
    sys.path[:] = [each for each in sys.path if Path(each or ".").resolve() != Path(__file__).resolve().parent]
    import lab as package
    from lab.kinematics.compiled.kernels import compiled

    place = Path(package.__file__).resolve().parent
    assert place.parent != Path(__file__).resolve().parents[1], f"imported from the checkout: {place}"
    assert compiled() != ("--without-kernels" in sys.argv), f"kernels loaded: {compiled()}"
    assert version("virtual-calibration-lab") == package.__version__
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        assert lab(folder, "--version").split() == ["lab", package.__version__]
        commands = lab(folder, "--help")
        assert all(each.name in commands for each in entry_points(group="lab.commands"))

        examples = json.loads(lab(folder, "example", "--json"))["examples"]
        assert len(examples) > 1
        assert not list(folder.iterdir()), "a command that only prints has written a file"
        (found,) = json.loads(lab(folder, "example", "ur5", "--json"))["examples"]
        _, *identify = shlex.split(found["command"])
        after = json.loads(lab(folder, *identify, "--json", "--out", "ur5", "--no-recording"))["after_mm"]
        assert after["count"] == 20 and after["mean"] < 0.11, after  # models/ur5/README.md: 0.101

        lab(folder, "reproduce", "staubli", "--item", "1.2")  # its exercises are data of the package
        lab(folder, "design", "--poses", "12", "--out", "plan", "--no-recording")
        assert (folder / "plan" / "plan.csv").is_file()
        lab(folder, "calibrate", "--out", "virtual")
        made = {path.name for path in (folder / "virtual").iterdir()}
        assert {"result.json", "report.html", "recording.rrd", "SHA256SUMS"} <= made, made
    kernels = "with" if compiled() else "without"
    print(
        f"lab {package.__version__} works on Python {platform.python_version()}, {platform.system()}, {kernels} kernels"
    )


if __name__ == "__main__":
    main()
