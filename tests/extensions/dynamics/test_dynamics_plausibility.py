"""Dynamics that cannot be are told with what is wrong, and are not good; dynamics that can be are not doubted."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lab
from lab.extensions.dynamics.arm.base_parameters import base_parameters
from lab.extensions.dynamics.arm.identify_dynamics import DynamicModel, identify_dynamics, nearest_physical_arm
from lab.extensions.dynamics.arm_simulation import LoadBench, RigidLoad, RunErrors, drawn_mounting
from lab.extensions.dynamics.dynamics_phrases import phrase
from lab.extensions.dynamics.dynamics_plausibility import ArmSize, implausible_dynamics
from lab.extensions.dynamics.load_files import PayloadSamples, write_loads
from lab.extensions.dynamics.payload.excitation import Limits, random_path
from lab.kinematics.dynamics.rigid_body import ArmDynamics, khalil_chain
from lab.robots.load_robot import load_virtual
from lab.simulation.load_model import link_inertias

TX40 = load_virtual("tx40")
LOAD = RigidLoad(1.5, np.array([0.010, -0.005, 0.060]), np.diag([22.5, 26, 12.5]) * 1e-4)


@pytest.fixture(scope="module")
def samples() -> PayloadSamples:
    """A loaded and an unloaded motion of five seconds, as the drives feel it."""
    path = random_path(Limits.of(TX40.chain), np.random.default_rng(3), at_rest=True).at
    noise = RunErrors(torque_noise=0.005, coulomb_nm=2.0, viscous_nm_s=1.0, motor_inertia_kgm2=0.1)
    bench = LoadBench(TX40.serial_model, LOAD, drawn_mounting(TX40.serial_model), noise)
    return replace(bench.moving(path, 5.0, 100.0, np.random.default_rng(1)), wrench=None)


@pytest.fixture(scope="module")
def model() -> DynamicModel:
    arm = ArmDynamics(khalil_chain(TX40.serial_model.chain), drawn_mounting(TX40.serial_model).gravity, np.eye(6))
    return DynamicModel(TX40.serial_model.chain, arm, base_parameters(arm, np.random.default_rng(0)))


def doubts(samples: PayloadSamples, model: DynamicModel, *, bodies: bool = False) -> list[str]:
    links = link_inertias(TX40.serial_model)
    nominal, size = model.base.projection @ model.arm.standard(links, {}), ArmSize.of(TX40.chain, TX40.loads)
    with np.errstate(all="ignore"):  # as the command: numbers of a nonsensical file may overflow
        found = identify_dynamics(model, samples)
        nearest = nearest_physical_arm(model, found, links) if bodies else None
        return [phrase(each) for each in implausible_dynamics(found, model, size, nominal, nearest)]


def noise(samples: PayloadSamples) -> PayloadSamples:
    return replace(samples, torques=10 * np.random.default_rng(0).standard_normal(samples.torques.shape))


MISTAKES: dict[str, tuple[Callable[[PayloadSamples], PayloadSamples], str]] = {
    "torques in Nmm": (lambda s: replace(s, torques=1e3 * s.torques), "are torques in Nmm?"),
    "torques in kNm": (lambda s: replace(s, torques=s.torques / 1e3), "are torques in another unit, or is gravity"),
    "loaded and unloaded exchanged": (lambda s: replace(s, loaded=~s.loaded), "loaded and unloaded rows exchanged?"),
    "torques that are constant": (lambda s: replace(s, torques=1 + 0 * s.torques), "do not change along the motion"),
    "torques of another motion": (lambda s: replace(s, torques=s.torques[::-1]), "of what the torques change by"),
    "torques that are noise": (noise, "of what the torques change by"),
}


def test_dynamics_that_can_be_are_not_doubted(samples: PayloadSamples, model: DynamicModel) -> None:
    assert doubts(samples, model) == []


@pytest.mark.sampled(3)
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_named(mistake: str, samples: PayloadSamples, model: DynamicModel) -> None:
    change, says = MISTAKES[mistake]
    assert any(says in words for words in doubts(change(samples), model))


@pytest.mark.thorough
def test_a_drive_of_the_other_sign_is_no_arm(samples: PayloadSamples, model: DynamicModel) -> None:
    """Its motor would have a negative inertia; with the right signs nothing is said."""
    assert doubts(samples, model, bodies=True) == []
    turned = replace(samples, torques=samples.torques * np.where(np.arange(6) == 3, -1.0, 1.0))
    assert any("standard deviations from those of any arm" in words for words in doubts(turned, model, bodies=True))


@pytest.mark.thorough
def test_what_is_not_plausible_is_told_and_not_good(samples: PayloadSamples, tmp_path: Path) -> None:
    wrong = replace(samples, torques=1e3 * samples.torques)
    write_loads(tmp_path / "motion.csv", wrong, TX40.chain.joint_names, TX40.chain.prismatic)
    found = lab.dynamics(tmp_path / "motion.csv", robot=TX40)
    assert any(said.startswith("not plausible: ") and "Nmm" in said for said in found.warnings)
    assert found.estimate.adequate is not False and found.exit_code == 1
    assert "Nmm" in " ".join(found.to_dict()["implausible"])
