"""A script is a program: its help is its docstring and its options, and bad input is one line."""

import subprocess
import sys

import pytest
from helpers.robots import ROOT
from shared import run_script

SCRIPTS = [path for path in sorted((ROOT / "scripts").rglob("*.py")) if "__main__" in path.read_text(encoding="utf-8")]
NO_STUDIES = {f"build_{what}" for what in ("closed_models", "irb120_shells", "kernels")} | {
    "own_corrector",
    "own_effect",
    "own_kalman",
    "own_parts",
    "own_robust",
    "public_stub",
    "reference_pairs",
    "reference_set",
    "structure",
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", [path.stem for path in SCRIPTS if path.stem not in NO_STUDIES])
def test_a_script_runs_as_a_program(name: str) -> None:
    command = [sys.executable, str(next((ROOT / "scripts").rglob(f"{name}.py"))), "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert f"{name}.py [-h]" in done.stdout and "--json" in done.stdout and not done.stderr


def test_bad_input_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        run_script("operations_year", ["--out", str(ROOT)])
    printed = capsys.readouterr()
    assert stop.value.code == 2 and printed.err.startswith("lab: ") and printed.err.count("\n") == 1 and not printed.out
