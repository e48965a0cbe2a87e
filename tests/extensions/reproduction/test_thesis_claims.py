"""The thesis' statements, computed a second way: own kinematics, own draws, none of the lab's models."""

import numpy as np
import pytest
from helpers.printed_irb120 import TABLE, frames, table_of

from lab.extensions.reproduction.thesis_claims import (
    PAIRS,
    EffectSizes,
    contradiction,
    error_sources,
    growth_along,
    machine,
    paired_ratio,
    ratio_of,
    serial_over_parallel,
    thesis_arm_sources,
    wrist_workspace,
)

IRB120_LIMITS = np.deg2rad([165, 110, 110, 160, 120, 400]), np.deg2rad([165, 110, 70, 160, 120, 400])
TARGET = np.array([0.03, 0.02, 0.1])  # the lab's default


def uniform(lower: np.ndarray, upper: np.ndarray, count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(lower, upper, (count, len(lower)))


def derivative(points, q: np.ndarray) -> np.ndarray:
    """Central differences ``(n, d, joints)``."""
    step = 1e-6
    columns = [(points(q + step * e) - points(q - step * e)) / (2 * step) for e in np.eye(q.shape[1])]
    return np.stack(columns, axis=2)


def test_intervals_of_ratios_are_those_of_the_lognormal() -> None:
    rng = np.random.default_rng(0)
    held_paired = held_free = 0
    for _ in range(100):
        first, second = np.exp(rng.normal(0.5, 0.3, 40)), np.exp(rng.normal(0.0, 0.3, 40))
        paired, free = paired_ratio(first, second), ratio_of(rng.normal(0, 2.0, 100), rng.normal(0, 1.0, 100))
        held_paired += paired.lower < np.exp(0.5) < paired.upper
        held_free += free.lower < 2.0 < free.upper
    assert 89 <= held_paired <= 99 and 87 <= held_free <= 99
    assert paired_ratio(np.array([2.0, 8.0]), np.array([1.0, 1.0])).value == pytest.approx(4.0)
    assert ratio_of(np.array([3.0, 3.0]), np.array([1.0, 1.0])).side == 1


def test_the_wrists_workspace_by_a_grid_of_two_joints() -> None:
    """Axis 1 makes a whole turn: the volume is that of the rings that joints 2 and 3 sweep."""
    reach, space = wrist_workspace("irb140", 512)
    q2, q3 = np.meshgrid(np.deg2rad(np.linspace(-90, 110, 1200)), np.deg2rad(np.linspace(-230, 50, 1200)))
    r = 0.07 + 0.36 * np.sin(q2) + 0.38 * np.cos(q2 + q3)
    z = 0.352 + 0.36 * np.cos(q2) - 0.38 * np.sin(q2 + q3)
    seen, edges, levels = np.histogram2d(np.abs(r).ravel(), z.ravel(), bins=200, range=((0, 0.82), (-0.5, 1.2)))
    rings = 2 * np.pi * (edges[1:] + edges[:-1]) / 2 * np.diff(edges) * (levels[1] - levels[0])
    volume = float(rings @ (seen > 0).sum(axis=1))
    assert reach == pytest.approx(np.abs(r).max(), abs=1e-4)
    assert abs(space.measured.size - volume) < 4 * space.measured.standard_error + 0.02 * volume


R, ARM, ROD, P = 0.163678801315, 0.524, 1.244, 0.043878620458
AZIMUTHS = np.deg2rad([-90, 30, 150])


def delta_platform(q: np.ndarray) -> np.ndarray:
    """The lower of the two points at one rod's length from three elbows: three spheres."""
    out = np.stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS), 0 * AZIMUTHS], axis=1)
    wide = R + ARM * np.cos(q) - P
    c = wide[..., None] * out - ARM * np.sin(q)[..., None] * np.array([0, 0, 1.0])
    u, v = c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]
    n = np.cross(u, v)
    n2 = (n**2).sum(axis=1, keepdims=True)
    foot = np.cross((u**2).sum(axis=1, keepdims=True) * v - (v**2).sum(axis=1, keepdims=True) * u, n) / (2 * n2)
    height = np.sqrt(ROD**2 - (foot**2).sum(axis=1, keepdims=True))
    down = np.where(n[:, 2:] > 0, -1.0, 1.0)
    return c[:, 0] + foot + down * height * n / np.sqrt(n2)


def carrier_end(q: np.ndarray) -> np.ndarray:
    across = np.cos(q[:, 1]) + np.cos(q[:, 1] + q[:, 2])
    return np.stack(
        [across * np.cos(q[:, 0]), across * np.sin(q[:, 0]), np.sin(q[:, 1]) + np.sin(q[:, 1] + q[:, 2])], 1
    )


def planar_end(q: np.ndarray) -> np.ndarray:
    a, b, c = np.cumsum(q, axis=1).T
    return np.stack([0.4 * np.cos(a) + 0.3 * np.cos(b) + 0.15 * np.cos(c),
                     0.4 * np.sin(a) + 0.3 * np.sin(b) + 0.15 * np.sin(c)], axis=1)  # fmt: skip


def mean_gain(J: np.ndarray, weights: np.ndarray) -> float:
    return float(np.sqrt(((J**2).sum(axis=(1, 2)) * weights).sum() / weights.sum()))


def test_repeatability_of_a_delta_and_a_carrier_by_own_kinematics() -> None:
    """Legs of one length, joints of one error; poses uniform over the workspace by the Jacobian's determinant."""
    degrees = np.deg2rad
    delta = derivative(delta_platform, uniform(degrees([-40] * 3), degrees([80] * 3), 4000, 1))
    arm = derivative(carrier_end, uniform(degrees([-180] * 3), degrees([180] * 3), 4000, 2))
    gains = [mean_gain(J, np.abs(np.linalg.det(J))) for J in (arm, delta)]
    expected = gains[0] / 2.0 / (gains[1] / (R + ARM + ROD + P))
    found = serial_over_parallel("space", 50, 4)
    ratio = found["repeatability"]["equal length"]
    assert ratio.value == pytest.approx(expected, rel=0.03) and ratio.lower > 1
    assert found["compliance"]["equal length"].value == pytest.approx(expected**2, rel=0.06)
    serial, parallel = (machine(kind) for kind in PAIRS["space"])
    assert serial.size[0] == pytest.approx(32 / 3 * np.pi / 2.0**3, abs=4 * serial.size[1])
    shrunk = (serial.size[0] / parallel.size[0]) ** (-1 / 3)  # of the lengths of the serial arm
    assert found["repeatability"]["equal workspace"].value == pytest.approx(shrunk * ratio.value)
    assert found["repeatability"]["equal workspace"].side == -1


def test_the_deltas_workspace_by_its_inverse() -> None:
    """A place is reached if each leg's equation has an angle within the limits: own formula, own places."""
    rng = np.random.default_rng(3)
    low, high = np.array([-1.3, -1.3, -1.8]), np.array([1.3, 1.3, 0.1])
    p = rng.uniform(low, high, (60_000, 3))
    inside = np.ones(len(p), dtype=bool)
    for azimuth in AZIMUTHS:
        out = np.array([np.cos(azimuth), np.sin(azimuth), 0])
        d = p - (R - P) * out
        along, across, up = d @ out, d @ np.array([-out[1], out[0], 0]), d[:, 2]
        K = (along**2 + across**2 + up**2 + ARM**2 - ROD**2) / (2 * ARM)
        size = np.hypot(along, up)
        with np.errstate(invalid="ignore"):
            bend = np.arccos(K / size)
            angles = [np.arctan2(-up, along) + sign * bend for sign in (-1, 1)]
            fits = [(np.deg2rad(-40) <= a) & (a <= np.deg2rad(80)) for a in (wrapped(angle) for angle in angles)]
        inside &= fits[0] | fits[1]
    volume = inside.mean() * np.prod(high - low)
    own_error = np.sqrt(inside.mean() * (1 - inside.mean()) / len(p)) * np.prod(high - low)
    size, error = (each * PAIRS["space"][1].length_m ** 3 for each in machine(PAIRS["space"][1]).size)
    assert abs(size - volume) < 4 * np.hypot(error, own_error)


def wrapped(angle: np.ndarray) -> np.ndarray:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def test_a_carriers_error_before_and_after_calibration_by_own_draws() -> None:
    """Own derivatives by every entry of the table, own virtual arms; and the noise that a calibration lets through."""
    kind = PAIRS["space"][0]
    rows = ((0, 1.0, 0, 90), (0, 0, 1.0, 0), (0, 0, 1.0, 0))
    table, rng = table_of(rows), np.random.default_rng(5)
    q = uniform(np.full(3, -np.pi), np.full(3, np.pi), 300, 6)
    weights = np.abs(np.linalg.det(derivative(carrier_end, q)))
    shrunk = np.array([1 / kind.length_m, 1, 1, 1 / kind.length_m])  # angles act on legs half as long
    squares = []
    for _ in range(150):
        sigma = np.array([1.5e-3, 0.5e-3, 0.5e-3, 1.5e-3]) * shrunk * 1e-3  # small: linear
        off = frames(table + sigma * rng.standard_normal(table.shape), q)[-1][:, :3, 3] - frames(table, q)[-1][:, :3, 3]
        squares.append((1e6 * (off**2).sum(axis=1) @ weights) / weights.sum())
    beta = (1.5e-3 / kind.length_m) ** 2 * np.average(np.sin(q[:, 2]) ** 2, weights=weights)  # of the parallel axes
    found = machine(kind).uncalibrated(400)
    assert np.sqrt((found**2).mean()) == pytest.approx(np.sqrt(np.mean(squares) + beta), rel=0.06)
    exact = machine(kind).calibrated(40, 0, 0.0)
    floor = 8e-6 / np.sqrt(3) * np.sqrt(15 / 30)  # 15 parameters, 30 poses: no design is better on its own poses
    assert floor < np.median(exact) < 3 * floor


@pytest.mark.parametrize("pair", [pytest.param("plane", marks=pytest.mark.thorough), "space"])
def test_all_parameters_that_show_are_identified(pair: str) -> None:
    for kind in PAIRS[pair]:
        found = machine(kind)
        flat = found.rates.reshape(-1, found.rates.shape[2])
        size = np.linalg.norm(flat, axis=0)
        s = np.linalg.svd(flat[:, size > 0] / size[size > 0], compute_uv=False)
        assert int((s > 1e-8 * s[0]).sum()) == len(found.identifiable)


def test_planar_gains_by_own_kinematics() -> None:
    q = uniform(np.deg2rad([-170, -150, -150]), np.deg2rad([170, 150, 150]), 4000, 3)
    expected = mean_gain(derivative(planar_end, q), np.abs(np.sin(q[:, 1]))) / 0.85
    found = machine(PAIRS["plane"][0])
    assert mean_gain(found.jacobians, found.weights) == pytest.approx(expected, rel=0.03)


def test_errors_grow_outward_in_the_mean_not_in_every_arm() -> None:
    """Own arms, own draws: the same ratios of frames within both intervals."""
    grown = growth_along("irb120", 60, 30)
    table, rng = TABLE, np.random.default_rng(1)
    q = uniform(-IRB120_LIMITS[0], IRB120_LIMITS[1], 30, 2)
    nominal = np.stack(frames(table, q), axis=1)[..., :3, 3]
    sigma = np.array([1.5e-3, 0.5e-3, 0.5e-3, 1.5e-3])
    rms = []
    for _ in range(200):
        off = np.stack(frames(table + sigma * rng.standard_normal(table.shape), q), axis=1)[..., :3, 3] - nominal
        rms.append(np.sqrt((off**2).sum(axis=2).mean(axis=0)))
    logs = np.log(np.array(rms))
    for step, own in zip(grown.steps, np.diff(logs, axis=1).T, strict=True):
        half = 2 * own.std() / np.sqrt(len(own))
        assert step.lower < np.exp(own.mean() + half) and np.exp(own.mean() - half) < step.upper
    assert all(step.lower > 1 for step in grown.steps) and grown.whole.lower > 2
    assert grown.monotone.upper < 0.95  # no law of every arm
    assert abs(grown.monotone.value - (np.diff(logs, axis=1) > 0).all(axis=1).mean()) < 0.2


def test_zeros_and_geometry_displace_the_tool_by_own_draws() -> None:
    """Zeros and gains alone, by the exact kinematics; geometry by all other entries, β of the parallel axes too."""
    table, rng = TABLE, np.random.default_rng(4)
    q = uniform(-IRB120_LIMITS[0], IRB120_LIMITS[1], 60, 5)

    def tool(rows: np.ndarray, joints: np.ndarray) -> np.ndarray:
        T = frames(rows, joints)[-1]
        return T[:, :3, :3] @ TARGET + T[:, :3, 3]

    exact, squares = tool(table, q), {"joints": [], "geometry": []}
    for _ in range(150):
        moved = q + 1.5e-3 * rng.standard_normal(6) + 50e-6 * rng.standard_normal(6) * q
        squares["joints"].append(((tool(table, moved) - exact) ** 2).sum(axis=1).mean())
        sigma = np.array([0, 0.5e-3, 0.5e-3, 1.5e-3])
        squares["geometry"].append(((tool(table + sigma * rng.standard_normal((6, 4)), q) - exact) ** 2).sum(1).mean())
    link2 = frames(table, q)[1]
    lever = np.einsum("nji,nj->ni", link2[:, :3, :3], exact - link2[:, :3, 3])
    squares["geometry"] = np.array(squares["geometry"]) + 1.5e-3**2 * (lever[:, [0, 2]] ** 2).sum(axis=1).mean()
    found = error_sources("irb120", 150, 60)
    for source, values in squares.items():
        assert np.sqrt((found[source] ** 2).mean()) == pytest.approx(np.sqrt(np.mean(values)), rel=0.1)


def test_other_sources_scale_with_their_sizes_and_a_fit_of_base_and_tool_only_helps() -> None:
    none = EffectSizes(gain=0.0, stiffness=1e30, payload_kg=0.0, runout_rad=0.0, backlash_rad=0.0, heat=0.0)
    assert error_sources("irb120", 5, 20, effects=none)["other"].max() < 1e-15
    heat = error_sources("irb120", 400, 20, effects=EffectSizes(0.0, 1e30, 0.0, 0.0, 0.0, 1e-4))["other"]
    q = uniform(-IRB120_LIMITS[0], IRB120_LIMITS[1], 4000, 8)
    T = frames(TABLE, q)[-1]
    far = np.sqrt(((T[:, :3, :3] @ TARGET + T[:, :3, 3]) ** 2).sum(axis=1).mean())
    assert np.sqrt((heat**2).mean()) == pytest.approx(1e-4 * far, rel=0.12)
    given, fitted = (error_sources("irb120", 30, 40, aligned=aligned) for aligned in (False, True))
    assert all((fitted[source] < given[source]).all() for source in given)


def test_the_thesis_arm_by_its_printed_table() -> None:
    """The exact displacement of the flange by the printed zeros, and by the rest with the three hidden values."""
    theta = np.array([1.3e-3, 1.4e-3, 2.2e-3, 16.8e-3, 2.1e-3, 0])
    d = np.array([1.005, 0.60, 0.21, 0.54, 0.93, 0.57]) * 1e-3
    a = np.array([1.23, 1.44, 0.165, 1.155, 0.36, 0.495]) * 1e-3
    alpha = np.array([1.7e-3, 1.3e-3, 0.4e-3, 0.4e-3, 0.7e-3, 0])
    zero = np.zeros(6)
    q = uniform(-IRB120_LIMITS[0], IRB120_LIMITS[1], 2000, 9)
    table = TABLE
    nominal = frames(table, q)[-1][:, :3, 3]
    for source, off in (("joints", (theta, zero, zero, zero)), ("geometry", (zero, d, a, alpha))):
        moved = frames(table + np.stack(off, axis=1), q)[-1][:, :3, 3] - nominal
        expected = np.linalg.norm(moved, axis=1).mean()
        assert thesis_arm_sources(2000)[source].mean() == pytest.approx(expected, rel=0.02)


def test_indices_that_contradict_each_other_by_own_derivatives() -> None:
    """The 19 derivatives by differences and the eigenvalues of J'J give the stored indices, and the same orders."""
    found = contradiction(20, 20, 1)
    table = TABLE
    columns = [(i, j) for i in range(6) for j in range(4) if (i, j) not in ((1, 1), (4, 1), (4, 2), (5, 0), (5, 3))]
    own = {name: np.empty((20, 2)) for name in ("O1", "O2", "O3", "O4", "O5")}
    for pair in range(20):
        for side in range(2):
            q, rates = found.joints[pair, side], []
            for i, j in columns:
                step = np.zeros((6, 4))
                step[i, j] = 1e-6
                moved = (frames(table + step, q)[-1] - frames(table - step, q)[-1])[:, :3, 3] / 2e-6
                rates.append((moved if j in (1, 2) else 1e3 * moved).ravel())  # mm per mm, mm per rad
            s = np.sqrt(np.linalg.eigvalsh(np.array(rates) @ np.array(rates).T))
            values = (np.exp(np.log(s).mean()) / np.sqrt(20), s[0] / s[-1], s[0], s[0] ** 2 / s[-1], 1 / (1 / s).sum())
            for name, value in zip(own, values, strict=True):
                own[name][pair, side] = value
    for name, values in own.items():
        np.testing.assert_allclose(found.scores[name], values, rtol=1e-3)
    first = {name: values[:, 0] > values[:, 1] for name, values in own.items()}
    differ = (first["O1"] != first["O2"]) | (first["O2"] != first["O3"])
    assert found.disagree("O1", "O2", "O3").value == pytest.approx(differ.mean()) and differ.any()
    assert found.disagree("O1", "O1").value == 0.0
    k = found.example()
    assert first["O1"][k] != first["O2"][k] and first["O2"][k] == first["O3"][k]
