"""The directive `lab-help`: what `lab COMMAND --help-all` prints, so that the reference never lags behind."""

import os
import subprocess
import sys
from pathlib import Path

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]


class LabHelp(Directive):
    """Show the help of the command that the argument names."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Run the command and show its standard output as it is."""
        path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
        environment = os.environ | {"COLUMNS": "84", "NO_COLOR": "1", "PYTHONPATH": path, "TERM": "dumb"}
        done = subprocess.run(
            [sys.executable, "-m", "lab", self.arguments[0], "--help-all"],
            capture_output=True, text=True, check=True, env=environment,
        )  # fmt: skip
        block = nodes.literal_block(done.stdout, done.stdout)
        block["language"] = "text"
        return [block]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("lab-help", LabHelp)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
