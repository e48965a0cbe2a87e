"""``calibrated.py`` of a folder, run by a Python without anything but its own library."""

import json
import subprocess
import sys
from pathlib import Path

from lab.core.se3 import Array

__all__ = ["bare_python"]


def bare_python(folder: Path, joints: Array, conditions: dict[str, list[float]] | None = None) -> list[dict]:
    """Points by ``calibrated.py`` at joint positions ``(n, joints)``, with conditions ``(n,)`` each."""
    given = conditions or {}
    rows = [[row, {name: column[i] for name, column in given.items()}] for i, row in enumerate(joints.tolist())]
    (folder / "rows.json").write_text(json.dumps(rows))
    code = (
        "import json; space = {}; exec(open('calibrated.py', encoding='utf-8').read(), space); "
        "print(json.dumps([space['forward'](q, **given)[1] for q, given in json.load(open('rows.json'))]))"
    )
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", code], cwd=folder, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)
