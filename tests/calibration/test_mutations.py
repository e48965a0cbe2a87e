"""Small wrong changes of the statistics, found by their function, each of which tests named beside it have to find."""

import ast
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CORRELATION = "tests/noise/test_variance_components.py"
ESTIMATED = "tests/verification/test_new_measurements.py"
PROCESS = "tests/calibration/residual/test_gaussian_process.py"
BEYOND = "tests/prediction/test_extrapolation.py"


@dataclass(frozen=True)
class Mutation:
    """An expression of a function, by its module and qualified name; what stands there instead, and tests."""

    function: str
    right: str
    wrong: str
    tests: str

    def __str__(self) -> str:
        return f"{self.function}: {self.wrong}"


MUTATIONS = [
    Mutation(
        "verification.predicted_points:with_estimated_noise", "change + rows @ known @ rows.T", "change", ESTIMATED
    ),
    Mutation("verification.predicted_points:_matched", "1 - second / q", "1 + second / q", ESTIMATED),
    Mutation("verification.predicted_points:_matched", "4 + (q + 2) / excess", "4 + q / excess", ESTIMATED),
    Mutation(
        "noise.variance_components:small_sample",
        "slopes / np.diag(middle.covariance) / 2",
        "slopes / np.diag(middle.covariance)",
        CORRELATION,
    ),
    Mutation("noise.variance_components:RestrictedProblem._autocorrelated", "1 - carry**2", "1 - carry", CORRELATION),
    Mutation(
        "kinematics.compiled.numpy_kernels:innovations", "gains[t] @ gains[t].T", "-gains[t] @ gains[t].T", CORRELATION
    ),
    Mutation("noise.correlation:Correlation._filter", "self.carry**gaps", "self.carry + 0 * gaps", CORRELATION),
    Mutation(
        "calibration.residual.gaussian_process:PredictedBy.covariance", "half.T @ half", "-half.T @ half", PROCESS
    ),
    Mutation("calibration.residual.gaussian_process:JointKernels.of_offsets", "1 + scaled", "1", PROCESS),
    Mutation("prediction.extrapolation:MeasuredRange.beyond", "self.lower - joints", "joints - self.upper", BEYOND),
    Mutation("prediction.extrapolation:_left_out", "inverse @ -score_left_out", "inverse @ score_left_out", BEYOND),
]


def mutated(source: str, mutation: Mutation) -> str:
    """The module with the expression of the function replaced, wherever it stands in it."""
    tree, place = ast.parse(source), mutation.function.split(":")[1].split(".")
    node: ast.AST = tree
    for name in place:
        (node,) = (each for each in ast.iter_child_nodes(node) if getattr(each, "name", None) == name)
    right, wrong = (ast.parse(each, mode="eval").body for each in (mutation.right, mutation.wrong))
    found = []

    class Change(ast.NodeTransformer):
        def visit(self, each: ast.AST) -> ast.AST:
            if ast.dump(each) == ast.dump(right):
                found.append(each)
                return wrong
            return super().visit(each)

    Change().visit(node)
    assert found, mutation
    return ast.unparse(ast.fix_missing_locations(tree))


@pytest.mark.slow
@pytest.mark.parametrize("mutation", MUTATIONS, ids=str)
def test_a_wrong_change_is_found(mutation: Mutation, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "lab", tmp_path / "lab", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("models", "scripts", "tests", "pyproject.toml"):
        (tmp_path / name).symlink_to(ROOT / name)
    module = tmp_path / "lab" / f"{mutation.function.split(':')[0].replace('.', '/')}.py"
    module.write_text(mutated(module.read_text("utf-8"), mutation), "utf-8")
    command = [sys.executable, "-m", "pytest", "-n0", "-q", "-x", "-p", "no:cacheprovider"]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    chosen = [*command, "-m", "not slow and not thorough", mutation.tests]
    ended = subprocess.run(chosen, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert ended.returncode == 1 and "FAILED tests" in ended.stdout, ended.stdout[-2000:] + ended.stderr[-500:]
