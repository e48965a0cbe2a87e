"""A load from torques, wrench and sag: exact without noise, honest intervals with it, biases shown and cured."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from helpers.dynamics import inverse_dynamics
from numpy.testing import assert_allclose
from scipy import signal

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.core.significance import PAYLOAD_RESIDUALS
from lab.extensions.dynamics.dynamics_phrases import phrase
from lab.extensions.dynamics.filtering import band_of
from lab.extensions.dynamics.load_files import Mounting, PayloadSamples
from lab.extensions.dynamics.payload.methods import CompliantArm, from_sag, from_torques, from_wrench
from lab.extensions.dynamics.payload.payload_estimate import LoadEstimate
from lab.extensions.dynamics.payload.physical_consistency import nearest_physical, physical_estimate
from lab.extensions.dynamics.regression import least_squares
from lab.kinematics.dynamics.rigid_body import (
    LOAD,
    hand_motion,
    inertia_about_centre,
    is_physical,
    load_of,
    pseudo_inertia,
    torque_regressor,
    wrench_regressor,
)
from lab.kinematics.serial.serial_arm import SerialArm
from lab.robots.load_robot import load_virtual
from lab.simulation.load_model import loads_of

TX40 = load_virtual("tx40").model
ARM = SerialArm(TX40.chain)
VALUES = ARM.nominal()
GRAVITY = np.array([0.0, 0.0, -9.81])
UPRIGHT = Mounting(GRAVITY)
TRUTH = load_of(1.5, np.array([0.010, -0.005, 0.060]), np.diag([22.5e-4, 26e-4, 12.5e-4]))
CENTRE = TRUTH[1:4] / TRUTH[0]
PEAK_NM = np.array([131.8, 131.8, 103.5, 46.1, 43.2, 30.7])
TORQUE_NOISE = 0.005 * PEAK_NM
SENSOR_NOISE = np.array([0.05] * 3 + [0.002] * 3)
ENCODER_NOISE = 1e-6  # rad
OFFSETS = np.array([3.0, -2.0, 5.0, 0.1, -0.2, 0.05])
TIMES = np.arange(10_000) * 1e-3

Motion = tuple[Array, Array, Array]


def fourier(seed: int, times: Array, speed: float = 1.0) -> Motion:
    """A smooth path of five harmonics and 5 s (by ``speed``), within the joints' limits of reading and speed."""
    chain, rng = TX40.chain, np.random.default_rng(seed)
    w = 2 * np.pi * speed / 5 * np.arange(1, 6)[:, None]
    a, b = rng.normal(size=(2, 5, 6)) / np.arange(1, 6)[:, None]

    def at(times: Array) -> Motion:
        sine, cosine = np.sin(w * times), np.cos(w * times)
        return (
            sine.T @ a + cosine.T @ b,
            (w * cosine).T @ a - (w * sine).T @ b,
            -(w**2 * sine).T @ a - (w**2 * cosine).T @ b,
        )

    reading, rate, _ = (np.abs(values).max(axis=0) for values in at(np.linspace(0, 5 / speed, 500)))
    room = np.minimum(0.4 * (chain.upper - chain.lower) / reading, 0.9 * chain.speed / rate)
    q, v, acceleration = (values * room for values in at(times))
    return q + (chain.upper + chain.lower) / 2, v, acceleration


def own(*motion: Array) -> Array:
    """The arm's own torques, by MuJoCo without contacts and limits."""
    return inverse_dynamics(TX40, None, motion)


def nearly_own(*motion: Array) -> Array:
    return 1.1 * own(*motion)


def added(motion: Motion) -> Array:
    return torque_regressor(ARM, VALUES, *motion, GRAVITY) @ TRUTH


@dataclass(frozen=True)
class Bench:
    """Two runs without noise, and the options that cure what is wrong with them."""

    joints: tuple[Array, Array]
    torques: tuple[Array, Array]
    cure: dict

    def measured(self, rng: np.random.Generator | None) -> PayloadSamples:
        joints, torques = np.concatenate(self.joints), np.concatenate(self.torques)
        if rng is not None:
            noise = [TORQUE_NOISE * rng.standard_normal(run.shape) for run in self.torques]
            torques = torques + np.concatenate(noise)
            joints = joints + ENCODER_NOISE * rng.standard_normal(joints.shape)
        n = len(self.joints[0])
        return PayloadSamples(np.tile(TIMES[:n], 2), joints, torques, None, np.repeat([True, False], n))

    def identified(self, rng: np.random.Generator | None, cured: bool = False, **options: object) -> LoadEstimate:
        return from_torques(ARM, VALUES, self.measured(rng), GRAVITY, **(self.cure if cured else {}), **options)


def clean(seed: int) -> Bench:
    motion = fourier(seed, TIMES)
    alone = own(*motion)
    return Bench((motion[0], motion[0]), (alone + added(motion), alone), {})


def late(seed: int) -> Bench:
    motion = fourier(seed, TIMES - 1e-3)
    alone = own(*motion)
    return Bench((fourier(seed, TIMES)[0],) * 2, (alone + added(motion), alone), {"delay": True})


def rubbing(seed: int) -> Bench:
    """Coulomb and viscous friction, and 5 % of what a joint bears."""
    motion = fourier(seed, TIMES)
    alone, load = own(*motion), added(motion)
    steady = 0.02 * PEAK_NM * np.sign(motion[1]) + 0.01 * PEAK_NM * motion[1]
    runs = [torque + 0.05 * np.abs(torque) * np.sign(motion[1]) + steady for torque in (alone + load, alone)]
    return Bench((motion[0],) * 2, tuple(runs), {"friction": True, "own": nearly_own})


def shifted(seed: int) -> Bench:
    """Servos that give way to the load by up to 2 mrad."""
    motion = fourier(seed, TIMES)
    shift = -added(motion) / (50 * PEAK_NM)
    rate = np.gradient(shift, 1e-3, axis=0)
    loaded = tuple(a + b for a, b in zip(motion, (shift, rate, np.gradient(rate, 1e-3, axis=0)), strict=True))
    torques = (own(*loaded) + added(loaded), own(*motion))
    return Bench((loaded[0], motion[0]), torques, {"own": nearly_own})


BIASES = {
    "lag": late,
    "friction": rubbing,
    "shifted path": shifted,
}


def static_poses(count: int, seed: int) -> Motion:
    joints = TX40.chain.random_joints(count, np.random.default_rng(seed))
    return joints, 0 * joints, 0 * joints


def static_torques(count: int, seed: int, rng: np.random.Generator | None = None) -> PayloadSamples:
    motion = static_poses(count, seed)
    alone = own(*motion)
    torques = np.concatenate([alone + added(motion), alone])
    if rng is not None:
        torques = torques + TORQUE_NOISE * rng.standard_normal(torques.shape)
    return PayloadSamples(None, np.tile(motion[0], (2, 1)), torques, None, np.repeat([True, False], count))


def sensed(motion: Motion, mounting: Mounting = UPRIGHT, gain: float | Array = 1.0) -> Array:
    """What a sensor with offsets reads."""
    wrench = wrench_regressor(hand_motion(ARM, VALUES, *motion), mounting.gravity) @ TRUTH
    turned = np.einsum("ji,nhj->nhi", mounting.rotation, wrench.reshape(-1, 2, 3)).reshape(-1, 6)
    return mounting.sign * gain * turned + OFFSETS


def wrench_records(joints: Array, wrench: Array, rng: np.random.Generator | None, moving: bool) -> PayloadSamples:
    if rng is not None:
        wrench = wrench + SENSOR_NOISE * rng.standard_normal(wrench.shape)
        joints = joints + ENCODER_NOISE * rng.standard_normal(joints.shape)
    times = TIMES[: len(joints)] if moving else None
    return PayloadSamples(times, joints, None, wrench, np.ones(len(joints), dtype=bool))


# --- the signals and the solver ---


def test_speeds_and_accelerations_come_from_positions_to_a_billionth():
    motion = fourier(3, TIMES)
    band = band_of(TIMES)
    for found, truth in zip(band.motion(motion[0]), motion, strict=True):
        assert np.abs(found - band.trimmed(truth)).max() < 1e-9 * np.abs(truth).max()


@pytest.mark.parametrize("rate_hz", [50, 160, 1000, 4000])
def test_white_noise_stays_white_when_it_is_thinned(rate_hz):
    band = band_of(np.arange(10 * rate_hz) / rate_hz)
    noise = band.decimated(np.random.default_rng(1).normal(size=(band.every * 5000, 4)))
    assert abs(noise.std() / np.linalg.norm(band.impulse) - 1) < 0.02  # 20,000 numbers: 0.005
    for lag in (1, 2, 3):
        assert abs((noise[lag:] * noise[:-lag]).mean() / noise.var()) < 0.03  # 0.007


def test_noise_of_channels_is_found_and_intervals_are_student_s():
    rng = np.random.default_rng(2)
    columns = rng.normal(size=(40, 3, 4))
    sizes, truth, hits = np.array([0.1, 1.0, 5.0]), np.array([1.0, -2, 3, -4]), []
    for _ in range(200):
        seen = columns @ truth + sizes * rng.normal(size=(40, 3))
        found = least_squares("abcd", columns, seen, [0, 0, 0])
        hits.append(np.abs(found.values - truth) < found.half_widths(np.eye(4)))
    assert_allclose(found.sigma, sizes, rtol=0.5)
    assert 0.92 < np.mean(hits) < 0.98  # 800 of 0.95: 0.008, as wide as four of it


def test_a_parameter_that_no_row_shows_is_told_and_the_others_are_not_harmed():
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(30, 2, 3))
    columns[..., 1] = 0.0
    both = np.concatenate([columns, columns[..., :1] + 0.5 * columns[..., 1:2]], axis=2)  # 0 and 3 are the same
    found = least_squares("abcd", both, columns @ np.array([1.0, 2.0, 3.0]), [0, 0])
    assert found.model.rank == 2 and found.identifiable.tolist() == [False, False, True, False]
    assert_allclose(found.values[2], 3.0, rtol=1e-12)


# --- exact without noise ---


def test_two_static_poses_show_mass_and_centre_of_mass_by_torques():
    found = from_torques(ARM, VALUES, static_torques(2, 1), GRAVITY)
    assert (found.rank, found.columns) == (4, 10) and found.identified == LOAD[:4]
    assert_allclose(found.phi[:4], TRUTH[:4], rtol=0, atol=1e-12)
    assert np.isnan(found.phi[4:]).all() and np.isnan(found.inertia_com_half_width).all() and found.physical
    assert "static poses show mass and centre of mass alone" in found.unidentified[0] and "q6" in found.unidentified[0]


def test_one_static_pose_weighs_but_does_not_place():
    found = from_torques(ARM, VALUES, static_torques(1, 16), GRAVITY)
    assert found.rank == 3 and found.identified == ("mass",)
    assert (
        found.unidentified[0]
        == "mcx, mcy, mcz: not identifiable one by one; add poses that turn the hand about other horizontal axes"
    )
    with pytest.raises(LabError, match="nothing to make physical"):
        physical_estimate(found)


def test_a_moving_run_is_exact_from_positions_alone():
    found = clean(3).identified(None)
    assert (found.rank, found.columns) == (10, 10) and found.adequate and found.physical and not found.unidentified
    assert_allclose(found.phi, TRUTH, rtol=2e-8, atol=1e-11)
    assert_allclose(found.com_m, CENTRE, rtol=1e-8)
    assert_allclose(found.inertia_com_kgm2, inertia_about_centre(TRUTH), atol=1e-11)


@pytest.mark.parametrize(("poses", "options", "rank"), [(3, {}, 10), (20, {"tilt": True, "turn": True}, 15)])
def test_static_poses_with_a_wrench(poses, options, rank):
    tilt, turn = np.array([0.01, -0.02]), np.array([0.02, -0.01, 0.015])
    mounting = Mounting.tilted(tilt, sign=-1.0, turn_rad=turn) if options else replace(UPRIGHT, sign=-1.0)
    motion = static_poses(poses, 4)
    records = wrench_records(motion[0], sensed(motion, mounting), None, moving=False)
    found = from_wrench(ARM, VALUES, records, replace(UPRIGHT, sign=-1.0), **options)
    assert found.rank == rank and found.identified == LOAD[:4]
    assert_allclose(found.phi[:4], TRUTH[:4], rtol=0, atol=1e-11)
    nuisance = {each.name: each.value for each in found.nuisance}
    assert_allclose([nuisance[f"offset.{name}"] for name in ("fx", "mz")], [3.0, 0.05], atol=1e-10)
    if options:
        assert_allclose([nuisance["tilt.x"], nuisance["tilt.y"]], tilt, atol=2e-6)  # the parts commute to first order
        assert_allclose([nuisance[f"turn.{axis}"] for axis in "xyz"], turn, atol=1e-9)


@pytest.mark.parametrize(("options", "rank"), [({}, 16), ({"tilt": True, "turn": True}, 21), ({"delay": True}, 17)])
def test_a_moving_run_with_a_wrench(options, rank):
    mounting = Mounting.tilted(np.array([0.01, -0.02]), turn_rad=np.array([0.02, -0.01, 0.015]))
    motion = fourier(3, TIMES - (1e-3 if "delay" in options else 0.0))
    wrench = sensed(motion, mounting if "tilt" in options else UPRIGHT)
    records = wrench_records(fourier(3, TIMES)[0], wrench, None, moving=True)
    found = from_wrench(ARM, VALUES, records, UPRIGHT, **options)
    assert (found.rank, found.columns) == (rank, rank) and found.adequate
    assert_allclose(found.phi, TRUTH, rtol=1e-6, atol=1e-8)
    if "delay" in options:
        assert_allclose(found.nuisance[-1].value, 1e-3, atol=1e-8)


def test_an_unloaded_run_tells_of_the_offsets():
    motion, rng = static_poses(20, 5), np.random.default_rng(5)
    joints, wrench = np.tile(motion[0], (2, 1)), np.concatenate([sensed(motion), np.tile(OFFSETS, (20, 1))])
    wrench = wrench + SENSOR_NOISE * rng.standard_normal(wrench.shape)
    both = PayloadSamples(None, joints, None, wrench, np.repeat([True, False], 20))
    both, alone = (from_wrench(ARM, VALUES, each, UPRIGHT) for each in (both, both.run(True)))
    assert all(a.half_width < b.half_width for a, b in zip(both.nuisance, alone.nuisance, strict=True))


def test_sag_shows_mass_and_centre_of_mass_of_a_soft_arm():
    soft = CompliantArm(np.full(6, 1 / 5e3), loads_of(TX40))
    joints = static_poses(20, 6)[0]
    found = from_sag(ARM, VALUES, soft, joints, settled(soft, joints, 0 * TRUTH), settled(soft, joints, TRUTH))
    assert found.rank == 4 and found.identified == LOAD[:4]
    assert_allclose(found.phi[:4], TRUTH[:4], atol=1e-9)


def settled(soft: CompliantArm, joints: Array, phi: Array) -> Array:
    """Where the target comes to rest, by iterating the equilibrium as it is written, with the load as a wrench."""
    sag = np.zeros_like(joints)
    for _ in range(60):
        force, _ = soft.loads.forces(joints + sag, np.zeros(len(joints)))
        regressor = torque_regressor(ARM, VALUES, joints + sag, 0 * joints, 0 * joints, GRAVITY)
        sag = soft.compliance * (force - regressor @ phi)
    return ARM.points(joints + sag, VALUES)


# --- biases and their cures ---


@pytest.mark.thorough
@pytest.mark.parametrize("name", BIASES)
def test_each_bias_shows_and_its_cure_takes_it_away(name):
    bench = BIASES[name](4)
    raw, cured = bench.identified(None), bench.identified(None, cured=True)
    wrong = np.abs(raw.com_m - CENTRE).max() / np.abs(cured.com_m - CENTRE).max()
    assert max(wrong, abs(raw.mass_kg - 1.5) / abs(cured.mass_kg - 1.5)) > 3
    assert abs(cured.mass_kg - 1.5) < 0.002 * 1.5
    rng = np.random.default_rng(7)
    assert not bench.identified(rng).adequate
    found = bench.identified(rng, cured=True)
    assert abs(found.mass_kg - 1.5) < 0.01 * 1.5 and found.verdict.p > 1e-3


def test_a_delay_and_a_share_of_friction_are_found_with_their_intervals():
    rng = np.random.default_rng(8)
    (delay,) = late(3).identified(rng, cured=True).nuisance
    assert (delay.name, delay.unit) == ("delay", "s") and abs(delay.value - 1e-3) < 1.5 * delay.half_width < 6e-4
    shares = rubbing(3).identified(rng, cured=True).nuisance
    assert [each.name for each in shares] == [f"friction.q{i}" for i in range(1, 7)]
    assert all(abs(each.value - 0.05) < 1.5 * each.half_width for each in shares)


def test_intervals_of_centre_and_inner_inertia_are_those_of_their_derivatives():
    found = clean(3).identified(np.random.default_rng(10))

    def derived(phi: Array) -> Array:
        return np.append(phi[1:4] / phi[0], inertia_about_centre(phi))

    steps = 1e-3 * found.half_width * np.eye(10)
    slopes = np.array([derived(found.phi + step) - derived(found.phi - step) for step in steps]) / 2
    slopes = slopes.T / (1e-3 * found.half_width)
    widths = np.append(found.com_half_width, found.inertia_com_half_width)
    assert_allclose(widths, 1.9605 * np.sqrt(np.diag(slopes @ found.covariance @ slopes.T)), rtol=5e-3)


def test_what_is_wrong_is_named():
    rng = np.random.default_rng(9)
    sections = signal.butter(2, 20.0, fs=1000, output="sos")
    bench = clean(4)
    filtered = replace(bench, torques=tuple(signal.sosfilt(sections, each, axis=0) for each in bench.torques))
    assert not filtered.identified(rng).adequate
    for name, word in (("lag", "(delay)"), ("shifted path", "(own)")):
        assert word in phrase(BIASES[name](4).identified(rng).verdict)
    poses = static_poses(20, 10)
    for mounting, word in (
        (Mounting.tilted(np.array([np.deg2rad(1), 0])), "(tilt)"),
        (Mounting.tilted(np.zeros(2), turn_rad=np.array([0, np.deg2rad(1), 0])), "(turn)"),
    ):
        records = wrench_records(poses[0], sensed(poses, mounting), rng, moving=False)
        found = from_wrench(ARM, VALUES, records, UPRIGHT)
        assert not found.adequate and word in phrase(found.verdict)
    records = wrench_records(poses[0], sensed(poses), rng, moving=False)
    assert from_wrench(ARM, VALUES, records, UPRIGHT).adequate


def test_the_noise_is_estimated():
    found = clean(3).identified(np.random.default_rng(11))
    assert_allclose(found.sigma, TORQUE_NOISE, rtol=0.12)  # 390 samples: 0.036


# --- physical ---


@pytest.mark.thorough
@pytest.mark.parametrize("speed", [0.2, pytest.param(0.03, marks=pytest.mark.slow)])
def test_the_nearest_physical_load_is_no_farther_from_the_truth(speed):
    rng, unphysical, errors = np.random.default_rng(12), 0, []
    regressor = torque_regressor(ARM, VALUES, *fourier(5, TIMES[::20], speed), GRAVITY)
    rows = (regressor / (np.sqrt(2) * TORQUE_NOISE[:, None])).reshape(-1, 10)
    information = 20 * rows.T @ rows
    covariance = np.linalg.inv(information)
    for _ in range(40):
        phi = rng.multivariate_normal(TRUTH, covariance, method="cholesky")
        if is_physical(phi):
            continue
        unphysical += 1
        near = nearest_physical(phi, covariance)
        assert is_physical(near)
        slope = information @ (near - phi)  # stationary: that of the weak prior
        inverse = np.linalg.inv(pseudo_inertia(near))
        prior = 1e-4 * np.array([np.trace(inverse @ pseudo_inertia(unit)) for unit in np.eye(10)])
        scale = np.sqrt(np.diag(covariance))
        assert np.abs((slope - prior) * scale).max() < 1e-3 * np.abs(slope * scale).max()
        away = [(each - TRUTH) @ information @ (each - TRUTH) for each in (near, phi)]
        assert away[0] < away[1] + 1e-3
        errors.append([np.append(each[0] - 1.5, each[1:4] / each[0] - CENTRE) for each in (near, phi)])
    assert unphysical > 25
    near, raw = np.sqrt(np.mean(np.square(errors), axis=0))
    assert (near < 1.05 * raw).all() and near[1:].sum() < raw[1:].sum()


def test_a_physical_estimate_is_left_alone_and_another_made_one():
    bench = clean(3)
    good = bench.identified(np.random.default_rng(13))
    assert physical_estimate(good) is good
    bad = replace(good, phi=good.phi - np.eye(10)[6] * 0.003)
    mended = physical_estimate(bad)
    assert not bad.physical and mended.physical and abs(mended.mass_kg - good.mass_kg) < good.mass_half_width_kg
    static = from_torques(ARM, VALUES, static_torques(3, 14), GRAVITY)
    light = replace(static, phi=static.phi * np.where(np.arange(10) == 0, -0.01, 1))
    assert not light.physical and physical_estimate(light).mass_kg > 0


# --- refusals ---


def test_what_cannot_be_identified_is_refused_in_one_line():
    bench = clean(3)
    records = bench.measured(None)

    def refused(words: str, changed: PayloadSamples, **options: object) -> None:
        with pytest.raises(LabError, match=words) as caught:
            from_torques(ARM, VALUES, changed, GRAVITY, **options)
        assert "\n" not in str(caught.value)

    apart = np.where(records.loaded[:, None], 0.02, 0.0)
    refused("1.14592° apart at joint q1", replace(records, joints=records.joints + apart))
    refused("no torques", replace(records, torques=None, wrench=np.zeros((len(records), 6))))
    refused("no unloaded run", replace(records, loaded=np.ones(len(records), dtype=bool)))
    short = np.flatnonzero(np.tile(TIMES < 0.5, 2))
    refused("too short for a band of 20 Hz: give at least 0.844 s", records.take(short))
    doubled = np.where(records.loaded, 1.0, 2.0) * np.tile(TIMES, 2)
    refused("time steps of 0.001 s loaded and 0.002 s unloaded", replace(records, time_s=doubled))
    static = static_torques(3, 15)
    refused("static poses show no friction", static, friction=True)
    refused("3 loaded static poses and 2 unloaded", static.take(np.arange(5)))
    with pytest.raises(LabError, match="no wrench"):
        from_wrench(ARM, VALUES, records, UPRIGHT)
    poses = static_poses(1, 17)
    with pytest.raises(LabError, match="more samples or poses"):
        from_wrench(ARM, VALUES, wrench_records(poses[0], sensed(poses), None, moving=False), UPRIGHT)
    with pytest.raises(LabError, match="no joint has a compliance"):
        from_sag(
            ARM, VALUES, CompliantArm(np.zeros(6), loads_of(TX40)), poses[0], np.zeros((1, 1, 3)), np.zeros((1, 1, 3))
        )


# --- studies ---


def study(identified, runs: int) -> dict[str, Array]:
    """Scatter by prediction, and coverage, of what was identified in so many runs, and how often it was inadequate."""
    found = [identified(np.random.default_rng([run, 99])) for run in range(runs)]
    told = np.isfinite(found[0].phi)
    phi, widths = (np.array([getattr(each, name) for each in found])[:, told] for name in ("phi", "half_width"))
    predicted = np.sqrt(np.mean([np.diag(each.covariance)[told] for each in found], axis=0))
    centre = np.array([np.abs(each.com_m - CENTRE) < each.com_half_width for each in found])
    result = {
        "mass_percent": 100 * phi[:, 0].std() / 1.5,
        "ratio": phi.std(axis=0) / predicted,
        "covered": (np.abs(phi - TRUTH[told]) < widths).mean(axis=0),
        "centre": centre.mean(axis=0),
        "fires": np.mean([each.adequate is False for each in found]),
    }
    if told.all():
        inner = inertia_about_centre(TRUTH)
        inside = [np.abs(each.inertia_com_kgm2 - inner) < each.inertia_com_half_width for each in found]
        result["inner"] = np.mean(inside, axis=0)
    print({name: np.round(value, 4).tolist() for name, value in result.items()})
    return result


def honest(result: dict[str, Array]) -> None:
    """Sigma within 15 %, coverage of 92.5 to 97.5 %, and tests that fire at about their level."""
    assert (np.abs(result["ratio"] - 1) < 0.15).all()
    for name in ("covered", "centre", "inner"):
        if name in result:
            assert ((result[name] > 0.925) & (result[name] < 0.975)).all()
    assert result["fires"] < 2 * PAYLOAD_RESIDUALS


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 4])
def test_a_thousand_moving_runs_by_torques(seed):
    bench = clean(seed)
    honest(study(bench.identified, 1000))


def test_rows_have_the_times_of_what_was_decimated_into_them() -> None:
    """The filters are symmetric: the time itself, decimated as the readings are, is the rows' time."""
    band = band_of(TIMES)
    by_filter = band.decimated(band.trimmed(TIMES[:, None]))[:, 0]
    assert_allclose(band.times(len(by_filter)), by_filter, atol=1e-9)
    uncut = band.decimated(TIMES[:, None])[:, 0]
    assert_allclose(band.times(len(uncut), 0), uncut, atol=1e-9)
