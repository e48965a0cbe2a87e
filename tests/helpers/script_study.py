"""A script run as a study of virtual campaigns."""

import json
import subprocess
import sys

from helpers.robots import ROOT


def study(name: str, *flags: object):
    command = [sys.executable, str(ROOT / "scripts" / name), *map(str, flags), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    return json.loads(done.stdout)
