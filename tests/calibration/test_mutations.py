"""Small wrong changes of the statistics, each of which a test named beside it has to find."""

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CORRELATION = "tests/noise/test_variance_components.py"
SHARED = "tests/calibration/noise/test_error_model.py"
ESTIMATED = "tests/verification/test_new_measurements.py"
PROCESS = "tests/calibration/residual/test_process.py"
TAILED = "tests/calibration/noise/test_tails.py"
BEYOND = "tests/calibration/test_extrapolation.py"

VERIFIED = "verification/new_measurements.py"
COMPONENTS = "noise/variance_components.py"
FILTER = "noise/correlation.py"
ERRORS = "noise/error_model.py"
TAILS = "calibration/noise/tails.py"
GAUSSIAN = "calibration/residual/process.py"
KERNELS = "calibration/residual/kernels.py"
RANGE = "calibration/extrapolation.py"
COVER = "calibration/pose_cover.py"
REGIONS = "calibration/left_out_regions.py"


@dataclass(frozen=True)
class Mutation:
    """Of a module in ``lab``: what stands there once, what stands there instead, and the tests that find it."""

    module: str
    right: str
    wrong: str
    tests: str

    def __str__(self) -> str:
        return f"{Path(self.module).stem}: {self.wrong.strip()}"


MUTATIONS = [
    Mutation(VERIFIED, "(change + rows @ known @ rows.T)", "change", ESTIMATED),
    Mutation(VERIFIED, "1 / (1 - second / q)", "1 / (1 + second / q)", ESTIMATED),
    Mutation(VERIFIED, "4 + (q + 2) / excess", "4 + q / excess", ESTIMATED),
    Mutation(VERIFIED, "covariance / scale,", "covariance * scale,", ESTIMATED),
    Mutation(
        COMPONENTS,
        "np.diag(middle.covariance) / 2)",
        "np.diag(middle.covariance))",
        CORRELATION,
    ),
    Mutation(
        COMPONENTS,
        "_bounded(middle.covariance, more)",
        "_bounded(middle.covariance, -more)",
        CORRELATION,
    ),
    Mutation(
        COMPONENTS,
        "minus.covariance) / (2 * _STEP)",
        "minus.covariance) / _STEP",
        CORRELATION,
    ),
    Mutation(COMPONENTS, "np.maximum(1 - carry**2,", "np.maximum(1 - carry,", CORRELATION),
    Mutation(COMPONENTS, "LEAST_SHARE, 1.0)", "LEAST_SHARE, 2.0)", CORRELATION),
    Mutation(COMPONENTS, "weight = 1 / np.sqrt(1 + components", "weight = 1 / (1 + components", CORRELATION),
    Mutation(
        "noise/correlation.py",
        "spread - gains[t] @ gains[t].T",
        "spread + gains[t] @ gains[t].T",
        CORRELATION,
    ),
    Mutation(FILTER, "(self.carry**gaps)", "(self.carry + 0 * gaps)", CORRELATION),
    Mutation(ERRORS, "times + APART *", "times + 0 *", SHARED),
    Mutation(ERRORS, "(1 - self.carry) * factor**2", "(1 - self.carry) * factor", "tests/noise/test_error_model.py"),
    Mutation(
        "calibration/noise/tails.py",
        "heights.max() - heights[-1] <",
        "heights.max() - heights[-1] >",
        "tests/calibration/noise/test_tails.py",
    ),
    Mutation(GAUSSIAN, "+ lacking.T @ by_parameters", "- lacking.T @ by_parameters", PROCESS),
    Mutation(GAUSSIAN, "- half.T @ half", "+ half.T @ half", PROCESS),
    Mutation(KERNELS, "(1 + scaled) * np.exp(-scaled)", "np.exp(-scaled)", PROCESS),
    Mutation(COVER, "k=_NEAREST)[0][:, -1]", "k=_NEAREST)[0][:, 0] / 3", BEYOND),
    Mutation(RANGE, "np.maximum(self.lower - joints, joints - self.upper)", "joints - self.upper", BEYOND),
    Mutation(REGIONS, "inverse @ -removed", "inverse @ removed", BEYOND),
    Mutation(REGIONS, "inverse @ -removed", "0 * removed", BEYOND),
]


@pytest.mark.parametrize("mutation", MUTATIONS, ids=str)
def test_what_is_changed_stands_there_once(mutation: Mutation) -> None:
    assert (ROOT / "lab" / mutation.module).read_text("utf-8").count(mutation.right) == 1


@pytest.mark.slow
@pytest.mark.parametrize("mutation", MUTATIONS, ids=str)
def test_a_wrong_change_is_found(mutation: Mutation, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "lab", tmp_path / "lab", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("models", "tests", "pyproject.toml"):
        (tmp_path / name).symlink_to(ROOT / name)
    module = tmp_path / "lab" / mutation.module
    module.write_text(module.read_text("utf-8").replace(mutation.right, mutation.wrong), "utf-8")
    command = [sys.executable, "-m", "pytest", "-n0", "-q", "-x", "-p", "no:cacheprovider"]
    chosen = ["-m", "not slow and not thorough", mutation.tests]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    ended = subprocess.run([*command, *chosen], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert ended.returncode == 1 and "FAILED tests" in ended.stdout, ended.stdout[-2000:] + ended.stderr[-500:]
