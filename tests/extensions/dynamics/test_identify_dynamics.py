"""An arm's parameters from MuJoCo's torques: exact without noise, within intervals with it, and what biases them."""

from dataclasses import replace

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.extensions.dynamics.arm.base_parameters import base_parameters
from lab.extensions.dynamics.arm.identify_dynamics import (
    DynamicModel,
    DynamicsEstimate,
    identify_dynamics,
    nearest_physical_arm,
    thinned_run,
)
from lab.extensions.dynamics.arm_simulation import LoadBench, RigidLoad, RunErrors, drawn_mounting
from lab.extensions.dynamics.dynamics_phrases import phrase
from lab.extensions.dynamics.load_files import PayloadSamples
from lab.extensions.dynamics.payload.excitation import Limits, random_path
from lab.kinematics.dynamics.rigid_body import ArmDynamics
from lab.robots.load_robot import load_virtual
from lab.simulation.load_model import link_inertias

TX40 = load_virtual("tx40").serial_model
MOUNTING = drawn_mounting(TX40)
LOAD = RigidLoad(1.5, np.array([0.010, -0.005, 0.060]), np.diag([22.5, 26, 12.5]) * 1e-4)
MOTORS = np.array([0.36, 0.36, 0.1, 0.03, 0.04, 0.01])
COULOMB, VISCOUS = np.array([7.0, 8, 6, 2.5, 3, 2]), np.array([8.0, 5, 2, 1.1, 1.8, 0.7])
OFFSETS = (0.3, -0.2, 0.1, 0.05, -0.1, 0.02)
DRIVEN = RunErrors(
    coulomb_nm=COULOMB, viscous_nm_s=VISCOUS, motor_inertia_kgm2=MOTORS, torque_offset_nm=OFFSETS
)  # fmt: skip
NOISY = replace(DRIVEN, torque_noise=0.005)
PATHS = [random_path(Limits.of(TX40.chain), np.random.default_rng(seed), at_rest=True) for seed in (3, 4)]
WRIST = np.eye(6)
WRIST[5, 4] = 32 / 31.2
SECONDS, RATE_HZ = 10.0, 100.0
BY_CHANCE = 1e-3  # a right model is told to be wrong in one of twenty runs, and in one of a thousand by this p


def model_of(couplings: np.ndarray | None = None, **parts: bool) -> DynamicModel:
    arm = replace(ArmDynamics.of(TX40.chain, MOUNTING.gravity, couplings), **parts)
    return DynamicModel(TX40.chain, arm, base_parameters(arm, np.random.default_rng(0)))


MODEL = model_of()


def truth(model: DynamicModel, **more: float) -> np.ndarray:
    each = (("Ia", MOTORS), ("Fc", COULOMB), ("Fv", VISCOUS), ("off", OFFSETS))
    others = {f"{kind}{j + 1}": float(value) for kind, values in each for j, value in enumerate(values)}
    return model.base.projection @ model.arm.standard(link_inertias(TX40), others | more)


def runs(
    errors: RunErrors, load: RigidLoad | None = LOAD, path: int = 0, seed: int = 1, **more: np.ndarray
) -> PayloadSamples:
    bench = LoadBench(TX40, load, MOUNTING, errors, **more)
    return bench.moving(PATHS[path].at, SECONDS, RATE_HZ, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def found() -> DynamicsEstimate:
    return identify_dynamics(MODEL, runs(NOISY), other=runs(NOISY, path=1, seed=2), holdout=0.2)


def test_without_noise_every_parameter_comes_out() -> None:
    exact = identify_dynamics(MODEL, runs(DRIVEN))
    assert exact.identified.all() and exact.load is not None and exact.by_difference is not None
    np.testing.assert_allclose(exact.values, truth(MODEL), atol=1e-8)
    for load in (exact.load, exact.by_difference):
        np.testing.assert_allclose(load.phi, LOAD.phi, atol=1e-8)


def test_a_coupled_wrist_comes_out() -> None:
    model = model_of(WRIST)
    own = (0.0, 0, 0, 0, 0, 1.2)
    errors = replace(DRIVEN, motor_coulomb_nm=np.array(own), motor_viscous_nm_s=0.5 * np.array(own))
    exact = identify_dynamics(model, runs(errors, None, couplings=WRIST))
    assert model.base.size == 60
    np.testing.assert_allclose(exact.values, truth(model, Fcm6=1.2, Fvm6=0.6), atol=1e-8)


def test_noise_stays_within_the_intervals_and_the_predictions(found: DynamicsEstimate) -> None:
    errors = found.values - truth(MODEL)
    assert np.mean(np.abs(errors) < found.half_width) > 0.85 and np.sqrt(np.mean((errors / found.sigma) ** 2)) < 1.4
    np.testing.assert_allclose(found.noise, 0.005 * np.array([131.8, 131.8, 103.5, 46.1, 43.2, 30.7]), rtol=0.12)
    assert found.verdict.p > BY_CHANCE
    held, other = found.predictions
    assert held.rows < other.rows and 0.8 < held.total_noise_ratio < 1.2 and 0.9 < other.total_noise_ratio < 1.1
    assert other.total_relative < 0.03


def test_load_at_once_and_by_difference(found: DynamicsEstimate) -> None:
    assert found.load is not None and found.by_difference is not None
    for load in (found.load, found.by_difference):
        assert (np.abs(load.phi - LOAD.phi) < 2 * load.half_width).all()
    assert found.load.half_width[0] < 1.1 * found.by_difference.half_width[0]


@pytest.mark.thorough
def test_a_load_that_is_known_is_taken_off() -> None:
    records = runs(NOISY)
    known = identify_dynamics(MODEL, records, given_load=LOAD.phi)
    assert known.load is None and known.verdict.p > BY_CHANCE
    wrong = identify_dynamics(MODEL, records, given_load=1.1 * LOAD.phi)
    assert wrong.adequate is False and "load" in phrase(wrong.verdict)


@pytest.mark.parametrize(
    ("errors", "says"),
    [
        (replace(NOISY, torque_filter_hz=20.0), "filter|delay"),
        (replace(NOISY, lag_s=5e-3), "delay"),
        (replace(NOISY, load_friction=0.1), "grows"),
    ],
)
def test_what_biases_is_told(errors: RunErrors, says: str) -> None:
    assert identify_dynamics(MODEL, runs(errors, None)).adequate is False


def test_missing_friction_is_told_by_its_name() -> None:
    found = identify_dynamics(model_of(friction=False), runs(NOISY, None))
    assert found.adequate is False and "friction that the model leaves out" in phrase(found.verdict)


@pytest.mark.thorough
def test_a_delay_is_estimated() -> None:
    """Without Coulomb friction, whose jumps fall between two samples at this rate."""
    late = identify_dynamics(MODEL, runs(replace(NOISY, lag_s=2e-3, coulomb_nm=0.0), None), delay=True)
    assert late.delay is not None and late.verdict.p > BY_CHANCE
    assert abs(late.delay.value - 2e-3) < 1.5 * late.delay.half_width < 2e-3


def test_long_runs_are_worked_out_part_by_part(monkeypatch: pytest.MonkeyPatch) -> None:
    records = runs(DRIVEN, None)
    whole = thinned_run(MODEL, records, False)
    monkeypatch.setattr("lab.extensions.dynamics.arm.identify_dynamics._PART", 100)
    parts = thinned_run(MODEL, records, False)
    np.testing.assert_allclose(parts.columns, whole.columns, atol=1e-9 * np.abs(whole.columns).max())
    assert len(whole.times()) == whole.columns.shape[1]
    np.testing.assert_allclose(np.diff(whole.times()), whole.band.every / RATE_HZ)


@pytest.mark.thorough
def test_the_nearest_arm_that_there_can_be(found: DynamicsEstimate) -> None:
    fit = nearest_physical_arm(MODEL, found)
    assert 0 < fit.distance < 5 and fit.p > 0.05 and not fit.physical
    closer = np.linalg.norm((fit.base - truth(MODEL)) / found.sigma)
    assert closer <= np.linalg.norm((found.values - truth(MODEL)) / found.sigma)
    for body in MODEL.arm.bodies():
        phi = fit.standard[body]
        assert phi[0] > 0 and np.linalg.eigvalsh(np.diag(phi[4:7]))[0] > 0


@pytest.mark.thorough
def test_what_an_arm_can_have_stays(found: DynamicsEstimate) -> None:
    sure = replace(found, values=truth(MODEL))
    again = nearest_physical_arm(MODEL, sure, link_inertias(TX40))
    assert again.physical and np.abs((again.base - sure.values) / sure.sigma).max() < 0.1


def test_bad_runs_are_refused() -> None:
    records = runs(DRIVEN)
    with pytest.raises(LabError, match="loaded run alone"):
        identify_dynamics(MODEL, records.run(True))
    with pytest.raises(LabError, match="held out"):
        identify_dynamics(MODEL, records.run(False), holdout=0.99)
    with pytest.raises(LabError, match="time_s"):
        identify_dynamics(MODEL, replace(records.run(False), time_s=None))
