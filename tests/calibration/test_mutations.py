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


@dataclass(frozen=True)
class Mutation:
    """What stands once in ``lab``, in whichever module; what stands there instead, and the tests that find it."""

    right: str
    wrong: str
    tests: str

    def __str__(self) -> str:
        return self.wrong.strip()


MUTATIONS = [
    Mutation("(change + rows @ known @ rows.T)", "change", ESTIMATED),
    Mutation("1 / (1 - second / q)", "1 / (1 + second / q)", ESTIMATED),
    Mutation("4 + (q + 2) / excess", "4 + q / excess", ESTIMATED),
    Mutation("covariance / scale,", "covariance * scale,", ESTIMATED),
    Mutation(
        "np.diag(middle.covariance) / 2)",
        "np.diag(middle.covariance))",
        CORRELATION,
    ),
    Mutation(
        "_bounded(middle.covariance, more)",
        "_bounded(middle.covariance, -more)",
        CORRELATION,
    ),
    Mutation(
        "minus.covariance) / (2 * _STEP)",
        "minus.covariance) / _STEP",
        CORRELATION,
    ),
    Mutation("np.maximum(1 - carry**2,", "np.maximum(1 - carry,", CORRELATION),
    Mutation("LEAST_SHARE, 1.0)", "LEAST_SHARE, 2.0)", CORRELATION),
    Mutation("weight = 1 / np.sqrt(1 + components", "weight = 1 / (1 + components", CORRELATION),
    Mutation(
        "spread - gains[t] @ gains[t].T",
        "spread + gains[t] @ gains[t].T",
        CORRELATION,
    ),
    Mutation("(self.carry**gaps)", "(self.carry + 0 * gaps)", CORRELATION),
    Mutation("times + APART *", "times + 0 *", SHARED),
    Mutation("(1 - self.carry) * factor**2", "(1 - self.carry) * factor", "tests/noise/test_error_model.py"),
    Mutation(
        "heights.max() - heights[-1] <",
        "heights.max() - heights[-1] >",
        "tests/calibration/noise/test_tails.py",
    ),
    Mutation("+ lacking.T @ by_parameters", "- lacking.T @ by_parameters", PROCESS),
    Mutation("- half.T @ half", "+ half.T @ half", PROCESS),
    Mutation("(1 + scaled) * np.exp(-scaled)", "np.exp(-scaled)", PROCESS),
    Mutation("k=_NEAREST)[0][:, -1]", "k=_NEAREST)[0][:, 0] / 3", BEYOND),
    Mutation("beyond = np.maximum(self.lower - joints, joints - self.upper)", "beyond = joints - self.upper", BEYOND),
    Mutation("inverse @ -removed", "inverse @ removed", BEYOND),
    Mutation("inverse @ -removed", "0 * removed", BEYOND),
]


@pytest.mark.slow
@pytest.mark.parametrize("mutation", MUTATIONS, ids=str)
def test_a_wrong_change_is_found(mutation: Mutation, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "lab", tmp_path / "lab", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("models", "scripts", "tests", "pyproject.toml"):
        (tmp_path / name).symlink_to(ROOT / name)
    found = [path for path in tmp_path.glob("lab/**/*.py") if mutation.right in path.read_text("utf-8")]
    assert [path.read_text("utf-8").count(mutation.right) for path in found] == [1]
    (module,) = found
    module.write_text(module.read_text("utf-8").replace(mutation.right, mutation.wrong), "utf-8")
    command = [sys.executable, "-m", "pytest", "-n0", "-q", "-x", "-p", "no:cacheprovider"]
    chosen = ["-m", "not slow and not thorough", mutation.tests]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    ended = subprocess.run([*command, *chosen], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert ended.returncode == 1 and "FAILED tests" in ended.stdout, ended.stdout[-2000:] + ended.stderr[-500:]
