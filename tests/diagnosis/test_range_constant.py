"""Range errors as a fit found them: what they do to the arm, when they are a finding, when a stated one gives way."""

from dataclasses import replace

import numpy as np
import pytest

import lab
from lab.calibration.fit_options import PLAIN, FitOptions
from lab.calibration.identification import Identification, identify
from lab.calibration.observation import observation_of
from lab.calibration.weights import Noise, weigh
from lab.core.measurements import Measurements, measured
from lab.core.probability import Uncertain
from lab.core.random import rng_for
from lab.diagnosis.fine import fine_mistakes
from lab.diagnosis.range_constant import fitted_range, range_findings
from lab.kinematics.effects.arm_with_effects import affected
from lab.kinematics.effects.effect import FREE_RANGE, RangePrior
from lab.kinematics.effects.range_errors import CONSTANT, SCALE, range_errors, with_range_errors
from lab.library.certify import certify
from lab.noise.instruments import INSTRUMENTS, TrackerErrors
from lab.options.command_options import CertifyOptions
from lab.options.virtual_campaign import VirtualCampaign
from lab.phrases.phrase import phrase
from lab.robots.load_robot import load_robot
from lab.verdict.pipeline import start

TRACKER = INSTRUMENTS["leica-at960"]
ROBOTS = {name: load_robot(name) for name in ("irb120", "ur5e", "iiwa14")}
THREE = ("p1", "p2", "p3")


def campaign(constant: float, poses: int = 40, seed: int = 1, robot: str = "irb120", targets: tuple = THREE):
    """A nominal arm 2.1 m before a tracker whose range has a constant (m), and its noise."""
    loaded, rng = ROBOTS[robot], np.random.default_rng(seed)
    arm = loaded.arm(targets)
    values, joints = arm.nominal(loaded.tool), loaded.chain.random_joints(poses, rng)
    values[:6] = 1.9, -0.6, -0.7, 0.1, 0.2, 2.9
    points = with_range_errors(arm.points(joints, values), np.tile([constant, 0.0], (poses, 1)))
    return measured(loaded.chain.joint_names, joints, targets, TRACKER.sample(points, rng)), values


def fitted(data: Measurements, values: np.ndarray, prior: RangePrior, robot: str = "irb120") -> Identification:
    model = affected(ROBOTS[robot].arm(data.targets), range_errors(prior))
    return identify(model, data, np.append(values, [0.0, 0.0]), Noise(TRACKER), PLAIN)


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_constant_left_out_displaces_the_arm_as_it_is_said(robot: str) -> None:
    """The whole constant in the instrument's frame; about a tenth or two of it relative to the base."""
    data, values = campaign(2e-3, robot=robot)
    free, held = (fitted(data, values, RangePrior(size, 1e-9), robot) for size in (10.0, 1e-12))
    found = fitted_range(free)
    assert found is not None
    inputs = free.model.structure_joints(200, rng_for(0, "structure"))
    moved = []
    for part in (slice(0, None), slice(6, None)):  # the whole arm, and the arm on the free fit's base
        arms = [each.values.copy() for each in (free, held)]
        arms[1][: part.start] = arms[0][: part.start]
        for arm in arms:
            arm[-2:] = 0.0
        off = np.subtract(*(free.model.points(inputs, arm) for arm in arms))
        moved.append(float(np.sqrt((off**2).sum(axis=-1).mean())))
    expected = abs(found.constant_m) * np.array([found.in_frame, found.in_shape])
    np.testing.assert_allclose(moved, expected, rtol=0.02)
    assert 0.9 < found.in_frame < 1.1 and 0.02 < found.in_shape < 0.4


@pytest.mark.parametrize(
    "constant, poses, targets, named",
    [
        (0.0, 40, THREE, False),
        (6e-5, 60, THREE, False),  # beyond five standard deviations, but small
        (2e-4, 40, THREE, True),
        (-2e-4, 40, THREE, True),
        (5e-4, 20, ("p1",), True),
        (3e-4, 9, ("p1",), False),  # nine poses show nothing of it
        (2e-4, 10, ("p1",), False),  # large, but it may be chance: found at 0.36 ± 0.15 mm (1 sigma)
    ],
)
def test_a_constant_is_a_finding_where_it_is_large_and_sure(constant, poses, targets, named) -> None:
    data, values = campaign(constant, poses, seed=3 if poses == 10 else 1, targets=targets)
    found = fitted(data, values, replace(FREE_RANGE, scale=1e-6))
    findings = range_findings(found)
    assert len(findings) == named
    for each in findings:
        assert each.accepted and each.check.outcome == "noted"
        assert abs(each.sizes[0] - constant) < 4 * each.stds[0]
        assert "range" in phrase(each.check)


def test_what_a_finding_explains_is_what_the_fit_would_leave_without_it() -> None:
    data, values = campaign(1e-3, 60)
    free, held = (fitted(data, values, RangePrior(size, 1e-9)) for size in (10.0, 1e-12))
    squares = [float(np.mean((each.residuals**2).sum(axis=-1))) for each in (free, held)]
    (finding,) = range_findings(free)
    # residuals are weighted: along the line of sight an error counts for more than across it
    assert finding.explains_m == pytest.approx(np.sqrt(squares[1] - squares[0]), rel=0.5)


def test_beside_lack_of_fit_a_constant_has_to_be_surer() -> None:
    data, values = campaign(3e-4, 10, targets=("p1",))
    found = fitted(data, values, replace(FREE_RANGE, scale=1e-6))
    assert 3 < fitted_range(found).constant_m / fitted_range(found).std_m < 5
    assert range_findings(found) and not range_findings(found, adequate=False)


def test_without_a_tracker_there_is_nothing_to_find() -> None:
    data, values = campaign(5e-4)
    found = identify(ROBOTS["irb120"].arm(THREE), data, values, Noise(TRACKER), PLAIN)
    assert fitted_range(found) is None and range_findings(found) == []


@pytest.mark.parametrize("constant, frees", [(0.0, False), (1e-5, False), (2e-4, True), (-5e-4, True)])
def test_a_stated_constant_gives_way_where_the_rows_contradict_it(constant: float, frees: bool) -> None:
    """10 µm are stated: what contradicts them by three standard deviations frees it, and the truth is covered."""
    errors = TrackerErrors(range_offset=Uncertain(6e-6), centring_depth=Uncertain(8e-6))
    device = replace(TRACKER, errors=errors)
    data, _ = campaign(constant, 40)
    state = start(ROBOTS["irb120"], data, VirtualCampaign().kind(), Noise(device), FitOptions())
    assert state.fitter.frees_range == frees
    found = fitted_range(state.fitter.identified_with(state.given, (), ()))
    assert found is not None and (found.prior_m is None) == frees
    assert abs(found.constant_m - constant) < 3 * found.std_m


def test_a_stated_constant_counts_once_also_where_tolerances_take_part_everywhere() -> None:
    data, values = campaign(0.0, 25)
    model = affected(ROBOTS["irb120"].arm(THREE), range_errors(RangePrior(1e-5, 1e-6)))
    stds = []
    for prior in ("off", "on"):
        found = identify(model, data, np.append(values, [0.0, 0.0]), Noise(TRACKER), FitOptions(prior=prior))
        stds.append(dict(zip((model.names[i] for i in found.fit.free), found.std.tolist(), strict=True))[SCALE])
    assert stds == pytest.approx([1e-6, 1e-6], rel=1e-3)  # the measurements say nothing of it


def test_a_constant_that_nothing_states_needs_no_second_look() -> None:
    data, _ = campaign(5e-4, 40)
    state = start(ROBOTS["irb120"], data, VirtualCampaign().kind(), Noise(TRACKER), FitOptions())
    assert not state.fitter.frees_range and state.fitter.with_credible_range(state.given) is state.fitter


def test_range_errors_part_the_covariance_of_the_arm() -> None:
    """Less what constant and scale bring, it is that of a fit with both held; and what they bring is their shifts."""
    data, _ = campaign(3e-4)
    options = {"robot": "irb120", "instrument": "leica-at960", "prior": "off"}
    free, held = lab.fit(data, **options), lab.fit(data, **options, fix=(CONSTANT, SCALE))
    shifts = free.shifts_by_range
    left = free.free_covariance - shifts @ shifts.T
    std = np.sqrt(np.diag(held.free_covariance))
    np.testing.assert_allclose(left / np.outer(std, std), held.free_covariance / np.outer(std, std), atol=3e-3)
    assert held.shifts_by_range.shape == (len(held.free), 0) and held.as_measured is held
    along = np.array([free.params[f"base.{axis}"].estimate for axis in "xyz"])
    moved = shifts[[free.free_names.index(f"base.{axis}") for axis in "xyz"], 0]
    constant = free.params[CONSTANT].std
    assert constant is not None
    assert -moved @ along / np.linalg.norm(along) == pytest.approx(constant, rel=0.1)  # in full along the line of sight


@pytest.fixture(scope="module")
def measured_wrongly() -> tuple:
    """A campaign of a tracker that measures 0.5 mm too long, its result, and further rows of the same tracker."""
    asked = {"poses": 70, "seed": 8, "targets": THREE, "instrument": "leica-at960"}
    day, true = lab.simulate("irb120", range_constant_mm=0.5, **asked), lab.simulate("irb120", **asked)
    old = day.measurements[:50]
    return lab.identify(old, robot="irb120", instrument="leica-at960"), day.measurements[50:], true.measurements[50:]


@pytest.mark.thorough
def test_the_same_instrument_verifies_and_validates_and_another_one_does_not(measured_wrongly: tuple) -> None:
    result, same, other = measured_wrongly
    assert lab.verify(result, same).good and lab.verify(result, same, refit=("base",)).good
    assert not lab.verify(result, other).good
    again = lab.identify(result.measurements, robot="irb120", instrument="leica-at960", validate=same)
    assert again.verdict.word == "good" and again.after.rms < 0.04


@pytest.mark.thorough
def test_the_result_says_it_and_the_arm_is_without_it(measured_wrongly: tuple) -> None:
    result, _, _ = measured_wrongly
    told = result.to_dict()["range_errors"]
    low, high = told["interval_95_mm"]
    assert low < 0.5 < high and told["prior_mm"] is None and high - low < 0.08
    (finding,) = (each for each in result.diagnosis if each.name == "range_constant")
    assert finding.sizes == (result.state.range.constant_m,) and result.verdict.word == "good"
    asked = {"poses": 70, "seed": 8, "targets": THREE, "instrument": "exact"}
    exact = lab.simulate("irb120", **asked).measurements
    predicted = result.estimate.predict(exact.inputs(result.estimate.arm.conditions))
    off = predicted.points - exact.points
    assert np.sqrt((off**2).sum(axis=-1).mean()) < 3e-5  # true positions, not those measured half a millimetre off


@pytest.mark.thorough
def test_a_certificate_has_the_fitted_constant_once(measured_wrongly: tuple, tmp_path) -> None:
    """In full for a position, in part for a distance; one that a file states is not counted beside it."""
    run = measured_wrongly[0].save(tmp_path / "run")
    stated = tmp_path / "stated.toml"
    stated.write_text(
        "[noise]\nradial_um = 5\nradial_um_per_m = 0.25\ntransverse_um = 7.5\ntransverse_um_per_m = 3\n[systematic]\n"
        "range_offset_um = { standard = 90 }\ncentring_depth_um = { standard = 90 }\n"
        "range_scale_ppm = { standard = 90 }\n"
    )
    expanded = []
    for device in (None, str(stated)):
        position, distance = certify(CertifyOptions(run, force=True, instrument=device)).budgets
        lines = {line.quantity.name: line for line in position.lines}
        constant = lines["range constant"]
        std = measured_wrongly[0].state.range.std_m
        assert constant.quantity.uncertainty.standard == pytest.approx(std, rel=1e-6)
        assert constant.sensitivity == pytest.approx(measured_wrongly[0].state.range.in_frame, rel=0.05)
        assert constant.contribution_m > 4 * next(
            line.contribution_m for line in distance.lines if line.quantity.name == "range constant"
        )
        expanded.append(position.expanded_m)
    assert expanded[1] == pytest.approx(expanded[0], rel=0.02)


def test_a_wrong_scale_is_found_beside_a_tracker_too() -> None:
    """Half a per cent is more than arms are made off; the scale of the range, of 0.25 ppm, does not take it."""
    data, values = campaign(0.0, 60)
    wrong = replace(data, points=1.005 * data.points)
    found = fitted(wrong, values, TRACKER.range_prior)
    observed, _ = weigh(observation_of(found.model), wrong, Noise(TRACKER))
    names = [each.name for each in fine_mistakes(found, observed, wrong).findings]
    assert names[:1] == ["scale"]
    none, _ = weigh(observation_of(found.model), data, Noise(TRACKER))
    assert not fine_mistakes(fitted(data, values, TRACKER.range_prior), none, data).findings
