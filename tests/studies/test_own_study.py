"""A study with parts of a script: on two processes, killed once and resumed, it has the same bytes."""

import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

SCRIPT = """\
    import sys
    from dataclasses import dataclass

    import numpy as np

    import lab
    from lab.kinematics.effects.effect import Effect, FittedGroup, MovesJoints, SimulatedEffect, VirtualEffect
    from lab.kinematics.parameter import joint_parameter


    class Ridge(lab.Estimator):
        name = "ridge"

        def estimate(self, problem):
            values = problem.start
            for _ in range(5):
                residuals, jacobian = problem.linearized(values)
                covariance = np.linalg.inv(jacobian.T @ jacobian + 1e-3 * np.diag((jacobian**2).sum(axis=0)))
                values = values + covariance @ jacobian.T @ residuals
            return values, covariance


    def waves(joints):
        return np.sin(2 * joints)


    def fitted_waves(facts):
        size = facts.chain.size

        def offsets(joints, conditions, values):
            derivative = waves(joints)[:, :, None] * np.eye(size)
            return derivative @ values, derivative

        return Effect("waves", tuple(joint_parameter("waves", axis, "sin2") for axis in range(size)), offsets)


    @dataclass(frozen=True)
    class TrueWaves(SimulatedEffect, MovesJoints):
        sizes_rad: np.ndarray

        @classmethod
        def none(cls, joints):
            return cls(np.zeros(joints))

        def joint_offsets(self, joints, conditions):
            return waves(joints) * self.sizes_rad


    @dataclass(frozen=True)
    class Waves(VirtualEffect):
        name, draws, groups = "waves", 1, (FittedGroup("waves", fitted_waves),)
        mrad: float = 0.0

        def simulated(self, arm, rngs):
            return TrueWaves(1e-3 * self.mrad * rngs[0].standard_normal(arm.chain.size))


    grid = {
        "robots": 4,
        "draws": 7,
        "fresh": 10,
        "factors": {
            "criterion": [lambda information: np.linalg.slogdet(information)[1]],
            "poses": 12,
            "estimator": ["least-squares", Ridge()],
            "model": ["geometric", Waves],
            "effects": "gears",
        },
        "effects": {"gears": {"own_effects": [Waves(mrad=0.3)]}},
    }
    lab.study(grid, out=sys.argv[1], workers=2, resume="--resume" in sys.argv)
"""


def stored(folder: Path) -> dict[str, bytes]:
    """The numbers of a study: everything but its page and figures."""
    files = [path for path in folder.rglob("*") if path.suffix in (".parquet", ".json", ".csv")]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.mark.thorough
def test_parts_of_a_script_reach_the_workers_and_a_killed_study_goes_on(tmp_path: Path) -> None:
    script, whole, killed = tmp_path / "grid.py", tmp_path / "whole", tmp_path / "killed"
    script.write_text(textwrap.dedent(SCRIPT))
    done = subprocess.run([sys.executable, str(script), str(whole)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    running = subprocess.Popen([sys.executable, str(script), str(killed)])
    while running.poll() is None and len(list(killed.glob("campaigns/*.parquet"))) < 2:
        time.sleep(0.01)
    running.kill()
    running.wait()
    there, of_all = (len(list(folder.glob("campaigns/*.parquet"))) for folder in (killed, whole))
    assert 2 <= there < of_all
    again = subprocess.run([sys.executable, str(script), str(killed), "--resume"], capture_output=True, text=True)
    assert again.returncode == 0, again.stderr
    assert stored(killed) == stored(whole)
