"""Range errors of a tracker: closed forms, derivatives, what is fitted undoes what is simulated, at every station."""

import numpy as np
import pytest

import lab
from lab.calibration.fit_options import PLAIN
from lab.calibration.identification import identify
from lab.calibration.weights import Noise
from lab.core import se3
from lab.core.measurements import STATION, measured
from lab.core.probability import Uncertain
from lab.kinematics.effects.arm_with_effects import ArmWithEffects, affected
from lab.kinematics.effects.effect import PoseConditions, RangePrior, SessionInfo
from lab.kinematics.effects.range_errors import (
    CONSTANT,
    SCALE,
    RangeErrors,
    TrueRangeErrors,
    range_errors,
    with_range_errors,
)
from lab.kinematics.effects.sessions import StationPoses, station_parameters, stations
from lab.noise.instruments import INSTRUMENTS, Instrument, TrackerErrors
from lab.robots.load_robot import load_robot
from lab.simulation.effects import TrueEffects

ROBOT = load_robot("irb120")
PRIOR = RangePrior(2e-5, 1e-6)
TRACKER = INSTRUMENTS["leica-at960"]


def arm_at(distance_m: float = 2.0, targets: tuple[str, ...] = ("p1", "p2")) -> tuple[ArmWithEffects, np.ndarray]:
    """An arm before a tracker, and its parameters with range errors of half a millimetre and 400 ppm."""
    arm = affected(ROBOT.arm(targets), range_errors(PRIOR))
    values = np.concatenate([ROBOT.arm(targets).nominal(ROBOT.tool), [5e-4, 4e-4]])
    values[:6] = distance_m, -0.3, -0.6, 0.1, 0.2, 2.9
    return arm, values


def joints(poses: int = 12, seed: int = 3) -> np.ndarray:
    return ROBOT.chain.random_joints(poses, np.random.default_rng(seed))


@pytest.mark.parametrize("constant, scale", [(5e-4, 0.0), (0.0, 1e-3), (-2e-3, 5e-4)])
def test_a_range_is_measured_longer_by_the_constant_and_its_share(constant: float, scale: float) -> None:
    points = np.random.default_rng(1).normal((3.0, 0.0, 0.0), 1.0, (5, 2, 3))
    seen = with_range_errors(points, np.tile([constant, scale], (5, 1)))
    ranges, longer = (np.linalg.norm(each, axis=-1) for each in (points, seen))
    np.testing.assert_allclose(longer, (1 + scale) * ranges + constant, rtol=1e-14)
    np.testing.assert_allclose(np.cross(points, seen), 0.0, atol=1e-14)  # the direction stays


@pytest.mark.parametrize("distance_m", [0.8, 2.0, 9.0])
def test_derivatives_are_those_of_differences(distance_m: float) -> None:
    arm, values = arm_at(distance_m)
    inputs = joints()
    jacobian = arm.observe(inputs, values)[1]
    for i in range(len(values)):
        step = np.zeros(len(values))
        step[i] = 1e-6
        slope = (arm.points(inputs, values + step) - arm.points(inputs, values - step)) / 2e-6
        np.testing.assert_allclose(jacobian[..., i], slope, atol=1e-8 * (1 + distance_m))


def test_a_pose_is_where_its_point_is_measured() -> None:
    arm, values = arm_at()
    Ts, _ = arm.tool(joints(), values)
    np.testing.assert_allclose(Ts[:, :3, 3], arm.points(joints(), values)[:, 0], atol=1e-14)


def test_every_station_has_the_same_constant_at_its_own_head() -> None:
    T = se3.pose(se3.exp(np.array([0.1, 0.0, 2.0])), np.array([1.0, 3.0, 0.2]))
    rigid = ROBOT.arm(("p1",))
    arm = affected(rigid, [*stations(("a", "b")), *range_errors(PRIOR)])
    at_b = np.arange(12) % 2
    inputs = np.column_stack([joints(), at_b])
    base = rigid.nominal(ROBOT.tool)
    base[:6] = 2.0, -0.3, -0.6, 0.1, 0.2, 2.9
    values = np.concatenate([base, station_parameters(np.stack([np.eye(4), T])).ravel(), [5e-4, 4e-4]])
    # whichever order the effects are drawn in, the range is measured last, by the head that measures it
    effects = TrueEffects.none(6).having(TrueRangeErrors(5e-4, 4e-4), StationPoses({"b": T}))
    conditions = PoseConditions({STATION + "b": at_b.astype(float)}, 12, ROBOT.chain.joint_names)
    simulated = effects.seen_after(rigid.points(joints(), base), conditions)
    np.testing.assert_allclose(arm.points(inputs, values), simulated, atol=1e-13)


@pytest.mark.parametrize("targets", [("p1",), ("p1", "p2", "p3")])
def test_constant_and_arm_are_recovered_without_noise(targets: tuple[str, ...]) -> None:
    """A free constant is found to rounding, and the arm is the one without it; a scale cannot be told from the size."""
    _, values = arm_at(targets=targets)
    values[-2:] = 3e-3, 0.0
    free = affected(ROBOT.arm(targets), range_errors(RangePrior(10.0, 1e-6)))
    points = free.points(joints(40), values)
    data = measured(ROBOT.chain.joint_names, joints(40), targets, points)
    found = identify(free, data, values, Noise(TRACKER), PLAIN)
    np.testing.assert_allclose(found.values, values, atol=2e-9)
    assert found.model.names[-2:] == (CONSTANT, SCALE)


def test_a_scale_has_its_prior_and_lengths_have_its_uncertainty() -> None:
    arm, values = arm_at(targets=("p1", "p2", "p3"))
    values[-2:] = 0.0
    data = measured(ROBOT.chain.joint_names, joints(40), arm.targets, arm.points(joints(40), values))
    stds = {}
    for scale in (1e-9, 1e-3):
        model = affected(ROBOT.arm(arm.targets), range_errors(RangePrior(1e-5, scale)))
        found = identify(model, data, values, Noise(TRACKER), PLAIN)
        named = dict(zip((model.names[i] for i in found.fit.free), found.std.tolist(), strict=True))
        assert named[SCALE] == pytest.approx(scale, rel=1e-6) and abs(found.values[-1]) < 1e-9
        stds[scale] = named["link2.a"]
    assert stds[1e-3] == pytest.approx(np.hypot(stds[1e-9], 1e-3 * 0.27), rel=1e-3)


def test_a_stated_constant_is_a_prior_that_measurements_sharpen() -> None:
    """The information of prior and measurements adds up."""
    arm, values = arm_at(targets=("p1", "p2", "p3"))
    values[-2:] = 0.0
    data = measured(ROBOT.chain.joint_names, joints(25), arm.targets, arm.points(joints(25), values))

    def std(prior: float) -> float:
        model = affected(ROBOT.arm(arm.targets), range_errors(RangePrior(prior, 1e-9)))
        found = identify(model, data, values, Noise(TRACKER), PLAIN)
        return float(found.std[list(found.fit.free).index(model.names.index(CONSTANT))])

    free, stated = std(10.0), std(1e-5)
    assert stated == pytest.approx((free**-2 + 1e-5**-2) ** -0.5, rel=1e-6)


@pytest.mark.parametrize(
    "errors, expected",
    [
        ({}, (1e-2, TRACKER.radial_per_m)),
        ({"range_offset": 3e-6, "centring_depth": 4e-6}, (5e-6, TRACKER.radial_per_m)),
        ({"range_scale": 5e-7}, (1e-2, 5e-7)),
    ],
)
def test_the_prior_is_what_the_instruments_file_states(errors: dict, expected: tuple[float, float]) -> None:
    stated = TrackerErrors(**{name: Uncertain(size) for name, size in errors.items()})
    device = Instrument("t", "spherical", 1e-6, TRACKER.radial_per_m, 1e-5, errors=stated)
    prior = device.range_prior
    assert prior is not None and (prior.constant_m, prior.scale) == pytest.approx(expected)


def test_instruments_without_a_range_have_none() -> None:
    for name, device in INSTRUMENTS.items():
        assert (device.range_prior is None) == (device.kind != "spherical"), name
    assert SessionInfo().range_prior is None and range_errors(None) == ()


def test_a_simulated_constant_is_fitted_and_compared_with_the_truth() -> None:
    made = RangeErrors(0.4, 20.0).simulated(None, ())  # type: ignore[arg-type]
    assert made.true_parameters() == {CONSTANT: 4e-4, SCALE: 2e-5}
    asked = {"poses": 40, "seed": 5, "targets": ("p1", "p2"), "instrument": "leica-at960"}
    day, true = lab.simulate("irb120", range_constant_mm=0.4, **asked), lab.simulate("irb120", **asked)
    along = np.linalg.norm(day.measurements.points, axis=2) - np.linalg.norm(true.measurements.points, axis=2)
    np.testing.assert_allclose(along, 4e-4, atol=1e-9)
    found = lab.fit(day.measurements, instrument="leica-at960")
    at = found.identified.index(CONSTANT)
    std = float(np.sqrt(found.covariance[at, at]))
    row = next(each for each in found.rows if each.name == CONSTANT)
    assert abs(row.estimate - 4e-4) < 4 * std and 5e-6 < std < 4e-5
    assert CONSTANT not in found.arm.names  # an arm that is used has no instrument
    elsewhere = lab.fit(day.measurements, noise_mm=0.01)
    assert CONSTANT not in elsewhere.identified
