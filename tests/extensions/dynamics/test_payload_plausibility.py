"""A payload that cannot be is told with what would make it one; a payload that can be is not."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.extensions.dynamics.arm_simulation import LoadBench, RigidLoad, RunErrors
from lab.extensions.dynamics.dynamics_options import PayloadOptions
from lab.extensions.dynamics.dynamics_phrases import phrase
from lab.extensions.dynamics.dynamics_plausibility import ArmSize, implausibilities
from lab.extensions.dynamics.load_files import Mounting, PayloadSamples, write_loads, write_mounting
from lab.extensions.dynamics.payload.identify_payload import payload
from lab.extensions.dynamics.payload.payload_result import PayloadResult
from lab.robots.load_robot import load_virtual
from lab.simulation.collisions import random_poses

TX40 = load_virtual("tx40")
LOAD = RigidLoad(1.5, np.array([0.010, -0.005, 0.060]), np.diag([22.5, 26, 12.5]) * 1e-4)
MOUNTING = Mounting.tilted(np.zeros(2), sign=-1.0)
NOISE = RunErrors(torque_noise=0.005, force_noise_n=0.05, moment_noise_nm=0.002)


@pytest.fixture(scope="module")
def samples() -> PayloadSamples:
    bench = LoadBench(TX40.model, LOAD, MOUNTING, NOISE)
    return bench.resting(random_poses(TX40.model, 16, np.random.default_rng(5)), np.random.default_rng(2))


def identified(samples: PayloadSamples, folder: Path, method: str) -> PayloadResult:
    chain = TX40.chain
    write_loads(folder / "runs.csv", samples, chain.joint_names, chain.prismatic)
    write_mounting(folder / "sensor.toml", MOUNTING)
    return payload(PayloadOptions(folder / "runs.csv", "tx40", sensor=folder / "sensor.toml", method=method))


def later(samples: PayloadSamples, rows: int) -> PayloadSamples:
    """Joint positions that are written so many rows late, within each run."""
    joints = samples.joints.copy()
    for loaded in (True, False):
        run = samples.loaded == loaded
        joints[run] = np.roll(joints[run], rows, axis=0)
    return replace(samples, joints=joints)


WRENCH_MISTAKES: dict[str, tuple[Callable[[PayloadSamples], PayloadSamples], str]] = {
    "moments in Nmm": (lambda s: replace(s, wrench=s.wrench * [1, 1, 1, 1e3, 1e3, 1e3]), "moments in Nmm (it would be"),
    "forces in kgf, moments in Nmm": (
        lambda s: replace(s, wrench=s.wrench * [*3 * [1 / 9.80665], 1e3, 1e3, 1e3]),
        "forces in kgf and moments in Nmm (it would be",
    ),
    "forces and moments in mN": (lambda s: replace(s, wrench=s.wrench * 1e3), "forces in Nmm or mN?"),
    "joints a row late": (lambda s: later(s, 1), "seem to be 1 row later than"),
    "joints two rows early": (lambda s: later(s, -2), "seem to be 2 rows earlier than"),
    "joints four rows late": (lambda s: later(s, 4), "seem to be 4 rows later than"),
    "degrees that are radians": (lambda s: replace(s, joints=s.joints * np.pi / 180), "radians in columns of degrees"),
    "every row loaded": (lambda s: replace(s, loaded=np.ones(len(s), dtype=bool)), "half seems to be"),
    "nothing was carried": (lambda s: replace(s, loaded=~s.loaded, wrench=s.wrench * 1e-6), "no load at all"),
}
TORQUE_MISTAKES: dict[str, tuple[Callable[[PayloadSamples], PayloadSamples], str]] = {
    "torques in Nmm": (lambda s: replace(s, torques=s.torques * 1e3), "are torques or forces in Nmm or mN?"),
    "joints a row late": (lambda s: later(s, 1), "seem to be 1 row later than"),
    "joints three rows early": (lambda s: later(s, -3), "seem to be 3 rows earlier than"),
}


@pytest.mark.parametrize("method", ["wrench", "torques"])
def test_a_payload_that_can_be_is_not_doubted(method: str, samples: PayloadSamples, tmp_path: Path) -> None:
    found = identified(samples, tmp_path, method)
    assert found.implausible == () and found.exit_code == 0
    assert abs(found.estimate.mass_kg - 1.5) < 1.5 * found.estimate.mass_half_width_kg


@pytest.mark.parametrize(
    ("method", "mistake"),
    [*(("wrench", each) for each in WRENCH_MISTAKES), *(("torques", each) for each in TORQUE_MISTAKES)],
)
def test_a_mistake_is_named_and_is_not_good(method: str, mistake: str, samples: PayloadSamples, tmp_path: Path) -> None:
    change, says = {"wrench": WRENCH_MISTAKES, "torques": TORQUE_MISTAKES}[method][mistake]
    try:
        found = identified(change(samples), tmp_path, method)
    except LabError as error:  # of a payload that would weigh less than nothing
        assert says in str(error) and "the load would weigh -" in str(error)
        return
    assert says in " ".join(found.warnings)
    assert found.implausible and found.exit_code == 1
    assert found.to_dict()["implausible"] == [phrase(each) for each in found.implausible]


def test_a_centre_that_is_not_known_is_not_called_far(samples: PayloadSamples, tmp_path: Path) -> None:
    found = identified(samples, tmp_path, "wrench").estimate
    arm = ArmSize(0.6, 30.0)
    far = replace(found, phi=found.phi * [1, 1e3, 1e3, 1e3, 1, 1, 1, 1, 1, 1])
    assert implausibilities(found, arm) == ()
    (told,) = implausibilities(far, arm)
    assert told.outcome == "failed" and "farther than the arm reaches (0.6 m)" in phrase(told)
    assert implausibilities(replace(far, com_half_width=np.full(3, 99.0)), arm) == ()
