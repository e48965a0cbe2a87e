"""Poses, cables, sockets and planes: derivatives, ranks, exact recovery, measured arms, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.pose_data import off_by, seen_poses
from helpers.robots import IRB120, RX130, assert_derivatives, data_file, table_robot

from lab.calibration.identify import Identification, IdentifyOptions, identify
from lab.calibration.observations.anchor_changepoints import found_sessions, with_sessions
from lab.calibration.observations.cable import Cable, CableKind
from lab.calibration.observations.fixtures import FIXTURE, Fixtures
from lab.calibration.observations.full_pose import PoseKind, Poses, balanced
from lab.calibration.observations.options import FitInputs, ObservationOptions
from lab.calibration.observations.plane import PlaneKind, Planes
from lab.calibration.observations.points import PointsKind
from lab.calibration.observations.protocol import Observation, Points, observation_of
from lab.calibration.observations.socket import SocketKind, Sockets
from lab.calibration.prior import Tolerance
from lab.calibration.statistics.joint_rounding import rounding
from lab.calibration.validation import Errors, Validation, configurations, errors_of, kept_together, split_by_label
from lab.calibration.verdict import Verdict, rotation_noise_rad, verdict
from lab.calibration.weights import Noise
from lab.campaign.observation_kinds import configured_kind, kind_named
from lab.campaign.option_groups import Fitting
from lab.commands.calibrate.options import MeasuredCampaign
from lab.commands.calibrate.run import run_measured
from lab.core import se3
from lab.core.errors import LabError
from lab.core.instruments import INSTRUMENTS
from lab.core.measurements import Measurements, measured
from lab.core.se3 import Array
from lab.formats.measurement_csv import read_measurements, write_measurements
from lab.kinematics.gauge import base_set
from lab.kinematics.serial.arm import SerialArm

ARM = SerialArm(IRB120.chain)
NAMES = IRB120.chain.joint_names
KINDS: dict[str, type[Fixtures]] = {"cable": Cable, "socket": Sockets, "plane": Planes}


def many(kind: type[Fixtures], places: int, arm: SerialArm = ARM, **more) -> Fixtures:
    """A sighting of some places, without data."""
    labels = [f"l{i // 2}.{i % 2}" for i in range(places)]
    return kind(arm, arm.nominal(), tuple(range(places)), tuple(labels), **more)


def somewhere_true(observation: Fixtures, rng: np.random.Generator) -> Array:
    """True values: the base at the origin, links and tool off, places where the arm can touch them."""
    true = off_by(observation, observation.nominal(observation.nominal_arm), rng)
    joints = observation.arm.structure_joints(len(observation.numbers), rng)
    points = observation.arm.points(joints, true[: len(observation.arm.names)])[:, 0]
    if isinstance(observation, Cable):
        points = points + np.array([0.1, -0.9, -0.6])
        true[len(observation.arm.names) : observation.first] = -0.012
    true[observation.first :] = observation.random_fixtures(points, rng).ravel()
    return true


def seen_places(observation: Fixtures, rows: int, rng: np.random.Generator) -> tuple[Measurements, Array]:
    """Exact measurements of each place in turn, and the truth."""
    true = somewhere_true(observation, rng)
    turns = np.resize(np.array(observation.numbers, float), 20 * rows)
    inputs = np.column_stack([observation.arm.structure_joints(20 * rows, rng), turns])
    if observation.contact:
        inputs = observation.inputs_in_contact(inputs, true)
    inputs = inputs[:rows]
    observed = np.zeros((len(inputs), 1, observation.points(inputs, true).shape[2]))
    if not observation.contact:
        observed = observation.points(inputs, true)
    data = measured(NAMES, inputs[:, :-1], observation.targets, observed)
    assert len(data) == rows
    return replace(data, conditions={FIXTURE: inputs[:, -1]}), true


# Derivatives


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_derivatives_of_places(kind) -> None:
    rng = np.random.default_rng(0)
    observation = many(kind, 3)
    true = somewhere_true(observation, rng)
    inputs = np.column_stack([IRB120.chain.random_joints(7, rng), [0, 1, 2, 2, 0, 1, 0]])
    observed, jacobian = observation.observe(inputs, true)
    np.testing.assert_array_equal(observed, observation.points(inputs, true))
    assert_derivatives(lambda values: observation.points(inputs, values), jacobian, true)


def test_a_level_plane_is_no_singularity() -> None:
    rng = np.random.default_rng(0)
    observation = many(Planes, 1)
    values = np.append(observation.nominal_arm, [0.0, 0.0, 0.3])
    inputs = np.column_stack([IRB120.chain.random_joints(5, rng), np.zeros(5)])
    assert_derivatives(lambda v: observation.points(inputs, v), observation.observe(inputs, values)[1], values)
    sizes = np.linalg.svd(observation.observe(inputs, values)[1][:, 0, 0, -3:], compute_uv=False)
    assert sizes[-1] > 0.1


def log_of_small(rotation: Array) -> Array:
    """Rotation vector of a rotation by less than a quarter turn, written so that a complex step passes."""
    odd = (rotation - np.swapaxes(rotation, -1, -2)) / 2
    sine = np.stack([odd[..., 2, 1], odd[..., 0, 2], odd[..., 1, 0]], axis=-1)
    size = np.sqrt((sine * sine).sum(axis=-1, keepdims=True))
    return np.arcsin(size) / size * sine


@pytest.mark.parametrize("arm", [ARM, SerialArm(RX130), SerialArm(IRB120.chain, ("p1", "p2"))], ids=["1", "craig", "2"])
def test_derivatives_of_poses(arm: SerialArm) -> None:
    """The residual's own formula, complex, at rotations by up to a radian: not the code's."""
    observation, data, true = (
        seen_poses(arm, 6, 0, sigma_rad=0.3) if len(arm.targets) == 1 else (Poses(arm, "p1"), None, None)
    )
    rng = np.random.default_rng(1)
    if data is None:
        true = observation.nominal(arm.nominal()) + 0.1 * rng.normal(size=len(observation.names))
        joints = arm.chain.random_joints(6, rng)
        near = arm.flange(joints, true[:-3])[:, :3, :3] @ se3.exp(true[-3:] + 0.2)
        inputs = np.column_stack([joints, se3.quaternion_from_rotation(near)])
    else:
        inputs = data.inputs(observation.conditions)
    measured_back = np.swapaxes(se3.rotation_from_quaternion(inputs[:, -4:]), 1, 2)

    def rotation(values: Array) -> Array:
        predicted = arm.flange(inputs[:, :-4], values[:-3])[:, :3, :3] @ se3.exp(values[-3:])
        return log_of_small(measured_back @ predicted)

    observed, jacobian = observation.observe(inputs, true)
    np.testing.assert_allclose(observed[:, -1], rotation(true), atol=1e-14)
    assert 0.1 < np.abs(observed[:, -1]).max() < 1.2
    assert_derivatives(rotation, jacobian[:, -1], true, relative=1e-12)
    assert_derivatives(lambda v: arm.points(inputs[:, :-4], v[:-3]), jacobian[:, :-1], true)


# Ranks


def test_ranks_of_poses() -> None:
    """4 R + 6 of a pose (facts.md, section 2), and the same ones whatever the numbers."""
    for chain in (IRB120.chain, RX130):
        observation = Poses(SerialArm(chain), "p1")
        kept = base_set(observation, observation.nominal(SerialArm(chain).nominal())).kept
        assert len(kept) == 30 and len(observation.names) == 37
        assert {"tool.rx", "tool.ry", "tool.rz"} <= {observation.names[i] for i in kept}
    three = SerialArm(IRB120.chain, ("p1", "p2", "p3"))
    observation = Poses(three, "p2")
    assert len(base_set(observation, observation.nominal(three.nominal())).kept) == 33 + 3


RANKS = {
    ("cable", 1, None): 21 + 3 + 1,  # 27 of a point less the base, which the anchor is; an offset
    ("cable", 3, None): 21 + 9 + 1,
    ("socket", 2, None): 21 + 6 - 1,  # the scale is not seen
    ("socket", 2, 0.05): 21 + 6,
    ("socket", 4, 0.05): 21 + 12,
    ("plane", 3, None): 21 + 9 - 1,
}


@pytest.mark.parametrize(("kind", "places", "distance"), RANKS)
def test_ranks_of_places(kind: str, places: int, distance: float | None) -> None:
    more = {} if distance is None else {"distance_m": distance}
    observation = many(KINDS[kind], places, **more)
    values = somewhere_true(observation, np.random.default_rng(0))
    structure = base_set(observation, values, known=observation.extra_residuals(observation.rank_point(values))[1])
    assert len(structure.kept) == RANKS[kind, places, distance]
    fixed = {observation.names[i] for i in structure.fixed}
    assert {f"base.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz")} <= fixed
    assert ("link4.d" in fixed) == (kind != "cable" and distance is None)  # 302 mm: the longest link is the scale


def test_structure_poses_touch() -> None:
    for kind in (Sockets, Planes):
        observation = many(kind, 4)
        inputs = observation.structure_joints(60, np.random.default_rng(0))
        values = observation.rank_point(observation.nominal(observation.nominal_arm))
        assert inputs.shape == (60, 7) and np.abs(observation.points(inputs, values)).max() < 1e-11
        assert set(inputs[:, -1]) == {0, 1, 2, 3}


# Recovery


def test_exact_poses_give_the_truth() -> None:
    for seed, arm in enumerate([ARM, SerialArm(RX130)]):
        observation, data, true = seen_poses(arm, 30, seed)
        assert isinstance(observation, Observation) and observation_of(observation) is observation
        found = identify(observation, data, arm.nominal())
        assert found.status == "converged" and len(found.fit.free) == 30 and found.spread == pytest.approx(1, abs=0.2)
        assert np.abs(found.values - true).max() < 1e-11


@pytest.mark.parametrize(("kind", "places", "rows", "distance"),
                         [(Cable, 2, 80, None), (Sockets, 4, 60, None), (Planes, 3, 120, None)])  # fmt: skip
def test_exact_places_give_the_truth(kind, places: int, rows: int, distance: float | None) -> None:
    for seed in range(3):
        rng = np.random.default_rng(seed)
        observation = many(kind, places)
        data, true = seen_places(observation, rows, rng)
        found = identify(observation, data, ARM.nominal())
        assert found.status == "converged" and not found.unobservable and found.plausible
        assert np.abs(found.values - true).max() < 1e-11


def test_a_known_distance_is_the_scale() -> None:
    """Sockets of an arm 1 % too long: without the distance it is not seen, with it every length comes out."""
    rng = np.random.default_rng(0)
    observation = many(Sockets, 4)
    data, true = seen_places(observation, 80, rng)
    centres = true[observation.first :].reshape(2, 2, 3)
    apart = np.linalg.norm(centres[:, 1] - centres[:, 0], axis=1)
    scaled = replace(observation, distance_m=float(apart[0] * 1.01))
    data = data.take(np.flatnonzero(data.conditions[FIXTURE] < 2))  # one location, one distance
    found = identify(scaled, data, ARM.nominal())
    assert found.status == "converged"
    assert found.values[observation.names.index("link4.d")] == pytest.approx(0.302 * 1.01, abs=1e-9)
    free = identify(replace(observation, distance_m=None), data, ARM.nominal())
    assert free.values[observation.names.index("link4.d")] == 0.302


def test_known_noise_leaves_the_distance_its_weight() -> None:
    rng = np.random.default_rng(1)
    observation = many(Sockets, 2)
    data, true = seen_places(observation, 60, rng)
    apart = float(np.linalg.norm(np.diff(true[observation.first :].reshape(2, 3), axis=0)))
    noisy = replace(data, points=data.points + 1e-4 * rng.normal(size=data.points.shape))
    values = []
    for noise in (Noise(), Noise(sigma_m=1e-4)):
        found = identify(replace(observation, distance_m=apart), noisy, ARM.nominal(), noise)
        values.append(found.values)
    np.testing.assert_allclose(values[0], values[1], atol=1e-9)


# Metres and radians


def test_the_ratio_of_the_noises_is_found() -> None:
    """From 60 poses 2 (180 - 15) numbers: one part in 18 or so for each; and from either side."""
    ratios = []
    for seed in range(6):
        observation, data, _ = seen_poses(ARM, 60, seed, 1e-4, 3e-4)
        found = [balanced(replace(observation, ratio=start), data, ARM.nominal()).ratio for start in (0.1, 30.0)]
        assert found[0] == pytest.approx(found[1], rel=0.02)
        ratios.append(found[0])
    assert np.mean(ratios) == pytest.approx(3.0, rel=0.08)
    assert np.std(ratios) < 0.5


def test_the_ratio_matters_and_exact_poses_leave_it() -> None:
    observation, data, _ = seen_poses(ARM, 30, 0)
    assert balanced(observation, data, ARM.nominal()).ratio == observation.ratio
    errors: dict[float, list[float]] = {1.0: [], 30.0: []}
    for seed in range(6):
        observation, data, true = seen_poses(ARM, 40, seed, 1e-4, 3e-3)
        fresh = IRB120.chain.random_joints(200, np.random.default_rng(seed))
        for ratio, out in errors.items():
            found = identify(replace(observation, ratio=ratio), data, ARM.nominal())
            off = ARM.points(fresh, found.values[:-3]) - ARM.points(fresh, true[:-3])
            out.append(float(np.linalg.norm(off, axis=2).mean()))
    assert np.mean(errors[30.0]) < 0.8 * np.mean(errors[1.0])


def test_a_trackers_weights_are_for_positions() -> None:
    observation, data, true = seen_poses(ARM, 40, 0, 1e-5, 1e-5)
    found = identify(observation, data, ARM.nominal(), Noise(INSTRUMENTS["leica-at960"]))
    assert found.status == "converged" and np.abs(found.values - true).max() < 1e-3
    cable = many(Cable, 2)
    with pytest.raises(LabError, match=r"leica-at960 measures points.*--noise-mm"):
        identify(cable, seen_places(cable, 80, np.random.default_rng(0))[0], ARM.nominal(),
                 Noise(INSTRUMENTS["leica-at960"]))  # fmt: skip


def test_rows_without_an_orientation_still_give_a_position() -> None:
    observation, data, true = seen_poses(ARM, 30, 2)
    points = data.points.copy()
    points[::3, 1] = np.nan
    points[1::3, 0] = np.nan
    found = identify(observation, replace(data, points=points), ARM.nominal())
    assert np.abs(found.values - true).max() < 1e-11
    assert np.isnan(observation.errors(replace(data, points=points), true)[1::3]).all()


# Rows that were not fitted


def test_positions_alone_are_judged() -> None:
    observation, data, true = seen_poses(ARM, 40, 0, 1e-4, 1e-1)
    np.testing.assert_allclose(
        observation.errors(data, true)[:, 0],
        np.linalg.norm(data.points[:, 0] - ARM.points(data.joints, true[:-3])[:, 0], axis=1),
    )
    assert observation.errors(data, true).shape == (40, 1)


def test_places_that_were_not_fitted_are_placed_by_their_own_rows() -> None:
    for kind in (Sockets, Planes, Cable):
        rng = np.random.default_rng(0)
        observation = many(kind, 6)
        data, _ = seen_places(observation, 180, rng)
        known = data.conditions[FIXTURE] < 4
        found = identify(observation, data.take(np.flatnonzero(known)), ARM.nominal())
        assert len(found.model.numbers) == 4 and len(found.values) == len(observation.names) - 6
        errors = errors_of(found, data)
        assert errors.after.shape == (180, 1) and np.nanmax(errors.after) < 1e-7
        assert np.nanmean(errors.before) > 1e-4


def test_a_place_of_a_few_rows_is_not_judged_by_itself() -> None:
    """One ball in a socket sits exactly in the mean of itself: that says nothing."""
    observation = many(Sockets, 6)
    data, _ = seen_places(observation, 60, np.random.default_rng(0))
    place = data.conditions[FIXTURE]
    found = identify(observation, data.take(np.flatnonzero(place < 4)), ARM.nominal())
    rest = data.take([*np.flatnonzero(place == 4)[:3], *np.flatnonzero(place == 5)])
    errors = errors_of(found, rest).after
    assert np.isnan(errors[:3]).all() and np.isfinite(errors[3:]).all()


def test_locations_are_held_out_whole() -> None:
    data, _ = seen_places(many(Sockets, 6), 60, np.random.default_rng(0))
    labels = kept_together(many(Sockets, 6), data)
    np.testing.assert_array_equal(labels, data.conditions[FIXTURE] // 2)
    few = data.take(np.flatnonzero(data.conditions[FIXTURE] < 4))
    assert many(Sockets, 4).cv_groups(few) is None  # two locations: by configuration


# Measured arms


def cable_file() -> tuple[SerialArm, Measurements]:
    file = data_file("irb120_cable_robotcali_1042.csv")
    data = read_measurements(file, NAMES, IRB120.chain.prismatic, columns=kind_named("cable").columns)
    assert len(data.warnings) == 1 and "points p1 are ignored" in data.warnings[0]
    return ARM, data


def test_a_draw_wire() -> None:
    """Three anchors: at most 0.36 mm on rows held out (0.264 is the rounding of the joints alone)."""
    arm, data = cable_file()
    observation, seen = CableKind().observation(arm, with_sessions(data, (0, 140, 506)), arm.nominal())
    assert isinstance(observation, Cable) and observation.labels == ("1", "2", "3")
    assert [warning for warning in seen.warnings if warning.startswith("row 950: its point is 99")]
    before, after = [], []
    for seed in range(4):
        rows, held = split_by_label(configurations(seen.joints), 0.3, seed)
        found = identify(observation, seen.take(rows), arm.nominal(), request=IdentifyOptions(tolerance=Tolerance()))
        assert found.status == "converged" and len(found.fit.free) == 31
        errors = errors_of(found, seen.take(held))
        before.append(np.sqrt(np.mean(errors.before**2)))
        after.append(np.sqrt(np.mean(errors.after**2)))
    assert 0.27e-3 < np.mean(after) <= 0.36e-3 and np.mean(after) < np.mean(before)
    values = dict(zip(found.model.names, found.values, strict=True))
    assert 0.055 < values["tool.p1.z"] < 0.065  # as the README of the data has it
    assert values["cable.offset"] == pytest.approx(-12.5e-3, abs=2e-3)
    limit = rounding(found.model, seen, found.values)
    assert limit is not None and np.rad2deg(limit.step_rad) == pytest.approx(0.1)
    assert 0.25e-3 < limit.rms_m < 0.28e-3


def test_anchors_that_moved_are_found() -> None:
    """From residuals alone, with rows 201 and 950 among them; and nothing is found where nothing moved."""
    arm, data = cable_file()
    observation, seen = CableKind().observation(arm, data, arm.nominal())
    starts = found_sessions(observation, seen, arm.nominal())
    assert len(starts) == 3 and starts[0] == 0 and abs(starts[1] - 140) <= 2 and abs(starts[2] - 506) <= 2
    spoilt = seen.points.copy()
    spoilt[[60, 300, 301, 900]] += 0.05
    again = found_sessions(observation, replace(seen, points=spoilt), arm.nominal())
    assert len(again) == 3 and np.abs(np.subtract(again, starts)).max() <= 3
    still = found_sessions(observation, seen.take(range(140, 506)), arm.nominal())
    assert still == (0,)


def wire_readings(seed: int, marks: list[int], move_m: float) -> tuple[Fixtures, Measurements]:
    """A wrong arm's wire lengths with 0.3 mm of noise, three of them bad; the anchor moves at these rows."""
    rng = np.random.default_rng(seed)
    observation = many(Cable, 1)
    true = somewhere_true(observation, rng)
    joints = 0.6 * IRB120.chain.random_joints(300, rng)
    anchors = np.array([0.3, -1.0, -0.3]) + move_m * rng.normal(size=(len(marks) + 1, 3))
    there = anchors[np.searchsorted(marks, np.arange(300), side="right")]
    lengths = np.linalg.norm(ARM.points(joints, true[: len(ARM.names)])[:, 0] - there, axis=1)
    lengths += 0.3e-3 * rng.normal(size=300)
    lengths[[50, 155, 250]] += 0.08
    data = measured(NAMES, joints, observation.targets, lengths[:, None, None])
    return observation, replace(data, conditions={FIXTURE: np.zeros(300)})


def test_moved_anchors_of_a_virtual_wire() -> None:
    """Moves of centimetres beside links off by 0.5 mm and 1 mrad; none where there was none."""
    right = 0
    for seed in range(8):
        marks = [80, 150, 220]
        observation, data = wire_readings(seed, marks, 20e-3)
        found = found_sessions(observation, data, ARM.nominal())
        right += len(found) == 4 and np.abs(np.subtract(found[1:], marks)).max() <= 3
    assert right >= 7
    for seed in range(5):
        assert found_sessions(*wire_readings(seed, [], 0.0), ARM.nominal()) == (0,)


def sockets_file(distance: float | None) -> tuple[SerialArm, Sockets, Measurements]:
    robot = table_robot("panda.toml")
    file = data_file("panda_sockets_mukca_3.csv")
    data = read_measurements(file, robot.chain.joint_names, robot.chain.prismatic, columns=kind_named("socket").columns)
    assert not data.warnings
    arm = robot.arm(("p1",))
    observation, seen = SocketKind(distance).observation(arm, data, arm.nominal())
    assert isinstance(observation, Sockets)
    return arm, observation, seen


def test_balls_in_sockets() -> None:
    """The last location held out, its centres from its own rows: at most 0.25 mm, 2.90 before."""
    arm, observation, seen = sockets_file(0.05)
    location = kept_together(observation, seen)
    assert sorted(set(location)) == list(range(6))
    last = location == 5
    found = identify(observation, seen.take(np.flatnonzero(~last)), arm.nominal())
    errors = errors_of(found, seen.take(np.flatnonzero(last)))
    assert found.status == "converged" and len(found.fit.free) == 25 + 30
    assert errors.after.size == 60 and 1e3 * errors.before.mean() == pytest.approx(2.90, abs=0.02)
    assert 0.15 < 1e3 * errors.after.mean() <= 0.25
    centres = found.values[found.model.first :].reshape(-1, 2, 3)
    np.testing.assert_allclose(np.linalg.norm(np.diff(centres, axis=1), axis=2), 0.05, atol=5e-6)


def test_sockets_without_a_known_distance_show_it() -> None:
    """One link is held as the scale; the distance between the sockets comes out as it is."""
    arm, observation, seen = sockets_file(None)
    found = identify(observation, seen, arm.nominal())
    assert len(found.fit.free) == 24 + 36 and "link5.d" not in [found.model.names[i] for i in found.fit.free]
    centres = found.values[found.model.first :].reshape(-1, 2, 3)
    np.testing.assert_allclose(np.linalg.norm(np.diff(centres, axis=1), axis=2), 0.05, atol=0.2e-3)


def ur10_poses(meaning: str) -> Identification:
    robot = table_robot("ur10.toml")
    file = data_file("ur10_ipa_D.csv")
    data = read_measurements(file, robot.chain.joint_names, robot.chain.prismatic, columns=kind_named("pose").columns)
    arm = robot.arm(("p1",))
    observation, seen = PoseKind(meaning).observation(arm, data, arm.nominal())
    return identify(observation, seen.take(range(0, 632, 2)), arm.nominal())


def test_measured_poses() -> None:
    """Angles in their meaning agree to 0.6 mrad; in another they contradict the positions."""
    found = ur10_poses("intrinsic-xyz")
    assert found.status == "converged" and len(found.fit.free) == 30 and found.plausible
    position, rotation = (float(np.sqrt((found.residuals[:, i] ** 2).mean())) for i in (0, 1))
    assert position < 0.3e-3 and rotation < 0.8e-3
    other = ur10_poses("fixed-xyz")
    assert np.sqrt((other.residuals[:, 1] ** 2).mean()) > 20 * rotation


# Files and what is refused


HEADER = ",".join(f"q{i}_deg" for i in range(1, 7))


def read(tmp_path, lines: str, observe: str = "pose") -> Measurements:
    path = tmp_path / "m.csv"
    path.write_text(lines)
    return read_measurements(path, NAMES, IRB120.chain.prismatic, columns=kind_named(observe).columns)


def test_every_way_to_write_an_orientation(tmp_path) -> None:
    vector = np.array([0.2, -0.4, 0.7])
    rotation = se3.exp(vector)
    q = se3.quaternion_from_rotation(rotation)
    inner = np.rad2deg([np.arctan2(-rotation[1, 2], rotation[2, 2]), np.arcsin(rotation[0, 2]),
                        np.arctan2(-rotation[0, 1], rotation[0, 0])])  # fmt: skip
    outer = np.rad2deg([np.arctan2(rotation[2, 1], rotation[2, 2]), -np.arcsin(rotation[2, 0]),
                        np.arctan2(rotation[1, 0], rotation[0, 0])])  # fmt: skip
    ways = {
        None: ("qw,qx,qy,qz", q),
        "intrinsic-xyz": ("rx_deg,ry_deg,rz_deg", inner),
        "fixed-xyz": ("ball_rx_deg,ball_ry_deg,ball_rz_deg", outer),
        "rotation-vector": ("rx_deg,ry_deg,rz_deg", np.rad2deg(vector)),
    }
    for meaning, (columns, numbers) in ways.items():
        row = ",".join(repr(float(number)) for number in numbers)
        stem = "ball_" if columns.startswith("ball") else ""
        point = ",".join(f"{stem}{axis}_mm" for axis in "xyz")
        text = f"{HEADER},{point},{columns}\n0,0,0,0,0,0,1,2,3,{row}\n1,0,0,0,0,0,1,2,3{',' * len(numbers)}\n"
        data = read(tmp_path, text)
        assert not data.warnings
        arm = SerialArm(IRB120.chain, data.targets)
        observation, seen = PoseKind(meaning).observation(arm, data, arm.nominal())
        turned = se3.rotation_from_quaternion(seen.inputs(observation.conditions)[0, -4:])
        np.testing.assert_allclose(turned, rotation, atol=1e-14)
        assert seen.seen.tolist() == [[True, True], [True, False]]
        write_measurements(tmp_path / "again.csv", data, IRB120.chain.prismatic)
        again = (tmp_path / "again.csv").read_text().splitlines()
        assert again[0].endswith(columns) and again[1].endswith(row)


POINT = "x_mm,y_mm,z_mm"
REFUSED = {
    "no orientation": (POINT, "1,2,3", "pose", None, "no orientation"),
    "no meaning": (f"{POINT},rx_deg,ry_deg,rz_deg", "1,2,3,4,5,6", "pose", None, "say --orientation intrinsic-xyz"),
    "norm": (f"{POINT},qw,qx,qy,qz", "1,2,3,1,0.1,0,0", "pose", None, r"line 2, columns qw to qz.*norm is 1\.00499"),
    "half": (f"{POINT},qw,qx,qy,qz", "1,2,3,1,0,,0", "pose", None, "line 2, column qy: empty"),
    "missing": (f"{POINT},qw,qx,qy", "1,2,3,1,0,0", "pose", None, "column p1_qz is missing beside qw"),
    "both": (f"{POINT},qw,qx,qy,qz,rx_deg,ry_deg,rz_deg", "1,2,3,1,0,0,0,1,2,3", "pose", "fixed-xyz", "both say"),
    "twice": ("p1_x_mm,p1_y_mm,p1_z_mm,qw,p1_qw,qx,qy,qz", "1,2,3,1,1,0,0,0", "pose", None, "qw are the same"),
    "no cable": (POINT, "1,2,3", "cable", None, "column cable_mm is missing"),
    "negative cable": ("cable_mm", "-3", "cable", None, "line 2, column cable_mm: a wire's length is above zero"),
    "one length": (
        "cable_mm",
        "300",
        "cable",
        None,
        "no anchor has more than 1 row; its own position takes 3 numbers.*at least 4",
    ),
    "no length": ("cable_mm,note", ",n", "cable", None, "no anchor has more than 0 rows"),
    "no socket": ("location", "a", "socket", None, "column socket is missing"),
    "once": ("location,socket", "a,0", "socket", None, "no socket has more than 1 row; .*at least 2 poses"),
    "plane": ("location", "a", "plane", None, "no plane has more than 1 row"),
}


@pytest.mark.parametrize(("columns", "row", "kind", "meaning", "what"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_observed_is_refused(columns, row, kind, meaning, what, tmp_path) -> None:
    data = read(tmp_path, f"{HEADER},{columns}\n1,2,3,4,5,6,{row}\n", kind)
    with pytest.raises(LabError, match=what):
        configured_kind(kind, ObservationOptions(orientation=meaning), FitInputs()).observation(
            ARM, data, ARM.nominal()
        )


BLANKS = {
    "location of a plane": ("plane", "location", ["a", "", "a", "a", "a"], r"line 3, column location: empty; .*plane"),
    "session of a plane": ("plane", "session", ["1", "1", "1", "1", ""], r"line 6, column session: empty; .*plane"),
    "location of a socket": (
        "socket",
        "location,socket",
        ["a,0", "a,1", ",0", "a,0", "a,1"],
        "line 4, column location",
    ),
    "socket": ("socket", "location,socket", ["a,", "a,1", "a,0", "a,0", "a,1"], "line 2, column socket: empty"),
    "every location": ("socket", "location,socket", [",0"] * 5, "line 2, column location: empty"),
    "session of a wire": ("cable", "session,cable_mm", ["1,300", ",300", *["1,300"] * 3], "line 3, column session"),
}


@pytest.mark.parametrize(("kind", "columns", "rows", "what"), BLANKS.values(), ids=BLANKS)
def test_a_row_says_which_place_it_is_of(kind, columns, rows, what, tmp_path) -> None:
    lines = "".join(f"{i},2,3,4,5,6,{row}\n" for i, row in enumerate(rows))
    data = read(tmp_path, f"{HEADER},{columns}\n{lines}", kind)
    with pytest.raises(LabError, match=what):
        kind_named(kind)().observation(ARM, data, ARM.nominal())


ALL_TOLD = {
    "one plane": ("plane", "note", ["n"] * 5, ("",)),
    "one plane, with empty columns": ("plane", "session,location", [","] * 5, ("",)),
    "a row to skip": ("plane", "location,use", [*["a,calibrate"] * 4, ",skip"], ("a",)),
    "a wire of one session": ("cable", "session,cable_mm", [",300"] * 5, ("",)),
    "a row without a length": ("cable", "session,cable_mm", [*["a,300"] * 4, ","], ("a",)),
}


@pytest.mark.parametrize(("kind", "columns", "rows", "labels"), ALL_TOLD.values(), ids=ALL_TOLD)
def test_what_needs_no_place_may_have_none(kind, columns, rows, labels, tmp_path) -> None:
    lines = "".join(f"{i},2,3,4,5,6,{row}\n" for i, row in enumerate(rows))
    data = read(tmp_path, f"{HEADER},{columns}\n{lines}", kind)
    assert kind_named(kind)().observation(ARM, data, ARM.nominal())[0].labels == labels


# What no place holds: the result is bad


NONSENSE = {
    "one plane": ("plane", "operator", lambda i: "Ann"),
    "three planes": ("plane", "location", lambda i: "abc"[i % 3]),
    "three sockets": ("socket", "location,socket", lambda i: f"a,{i % 3}"),
    "six sockets": ("socket", "location,socket", lambda i: f"{i % 6 // 2},{i % 2}"),
    "a wire of one length": ("cable", "cable_mm", lambda i: "500"),
}


@pytest.mark.parametrize(
    ("kind", "columns", "cell"),
    [pytest.param(*case, id=name, marks=[pytest.mark.slow] * ("three" in name)) for name, case in NONSENSE.items()],
)
def test_random_poses_are_of_no_place(kind, columns, cell, tmp_path) -> None:
    """Arm and places shrink together until all residuals are zero: that is no calibration."""
    joints = np.rad2deg(IRB120.chain.random_joints(60, np.random.default_rng(0)))
    rows = "".join(f"{','.join(map(str, row))},{cell(i)}\n" for i, row in enumerate(joints))
    path = tmp_path / "m.csv"
    path.write_text(f"{HEADER},{columns}\n{rows}")
    words = "what was measured is the same in every pose" if kind == "cable" else "302 mm from the drawing"
    for prior in (False, True):
        outcome = run_measured(MeasuredCampaign(path, observe=kind, fitting=Fitting(prior=prior)))
        assert outcome.verdict.word == "bad" and words in outcome.verdict.reason
        assert np.nanmax(np.abs(outcome.identification.residuals)) < 1e-3  # it fits, and says nothing


FITS = Validation("holdout", Errors(np.zeros((1, 1)), np.zeros((1, 1))))


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_poses_at_places_are_good(kind) -> None:
    observation = many(kind, 3)
    data, true = seen_places(observation, 120, np.random.default_rng(0))
    found = identify(observation, data, ARM.nominal())
    assert verdict(found, FITS, 1e-3) == Verdict("good")
    off = found.values.copy()
    off[observation.names.index("link4.a")] += 19e-3 - true[observation.names.index("link4.a")]
    assert verdict(replace(found, values=off), FITS, 1e-3).word == "good"
    off[observation.names.index("link4.a")] += 2e-3
    assert "21 mm from the drawing" in verdict(replace(found, values=off), FITS, 1e-3).reason


def test_orientations_that_do_not_fit_are_bad() -> None:
    """A constant quaternion beside good positions, whether the noise is given or not; a poor probe is no such thing."""
    for sigma_rad, word in ((1e-4, "good"), (30e-3, "good"), (90e-3, "bad")):
        observation, data, _ = seen_poses(ARM, 60, 0, 1e-4, sigma_rad)
        found = identify(balanced(observation, data, ARM.nominal()), data, ARM.nominal())
        assert rotation_noise_rad(found) == pytest.approx(sigma_rad, rel=0.15)
        assert verdict(found, FITS, 1e-3).word == word
    same = {name: np.full(60, float(name == "p1_qw")) for name in data.conditions}
    constant = replace(data, conditions=same)
    found = identify(balanced(observation, constant, ARM.nominal()), constant, ARM.nominal())
    given = identify(found.model, constant, ARM.nominal(), Noise(sigma_m=1e-4))
    for each in (found, given):
        judged = verdict(each, FITS, 1e-3)
        assert judged.word == "bad" and "measured orientations do not fit" in judged.reason


def test_points_have_no_noise_of_rotations() -> None:
    _, data, _ = seen_poses(ARM, 40, 0, 1e-4)
    points = measured(NAMES, data.joints, ("p1",), data.points[:, :1])
    found = identify(ARM, points, ARM.nominal())
    assert np.isnan(rotation_noise_rad(found)) and verdict(found, FITS, 1e-3).word == "good"
    wire = many(Cable, 2)
    found = identify(wire, seen_places(wire, 80, np.random.default_rng(0))[0], ARM.nominal())
    assert np.isnan(rotation_noise_rad(found))


def test_two_orientations_and_two_targets_are_refused(tmp_path) -> None:
    names = [f"{t}_{c}" for t in ("p1", "p2") for c in ("x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz")]
    data = read(tmp_path, f"{HEADER},{','.join(names)}\n0,0,0,0,0,0,{','.join(['1,2,3,1,0,0,0'] * 2)}\n")
    arm = SerialArm(IRB120.chain, ("p1", "p2"))
    with pytest.raises(LabError, match="p1 and p2 have orientations"):
        PoseKind().observation(arm, data, arm.nominal())
    with pytest.raises(LabError, match="--observe plane takes one target"):
        PlaneKind().observation(arm, data, arm.nominal())


def test_few_rows_are_left_out_and_told(tmp_path) -> None:
    rows = "".join(f"{i},2,3,4,5,6,a,{i % 2}\n" for i in range(6)) + "1,1,1,1,1,1,b,0\n"
    data = read(tmp_path, f"{HEADER},location,socket\n{rows}", "socket")
    observation, seen = SocketKind().observation(ARM, data, ARM.nominal())
    assert isinstance(observation, Sockets) and observation.labels == ("a.0", "a.1") and len(seen) == 6
    assert any("socket b.0 has 1 of the 2 rows" in warning for warning in seen.warnings)
    three = read(
        tmp_path, f"{HEADER},location,socket\n" + "".join(f"{i},2,3,4,5,6,a,{i % 3}\n" for i in range(6)), "socket"
    )
    with pytest.raises(LabError, match="location a has 3 sockets"):
        SocketKind(0.05).observation(ARM, three, ARM.nominal())


def test_points_are_left_as_they_are() -> None:
    data = measured(NAMES, np.zeros((1, 6)), ("p1",), np.zeros((1, 1, 3)))
    model, same = PointsKind().observation(ARM, data, ARM.nominal())
    assert model is ARM and same is data and isinstance(observation_of(ARM), Points)


def test_readings_that_are_not_rounded_have_no_limit() -> None:
    rng = np.random.default_rng(0)
    joints = IRB120.chain.random_joints(40, rng)
    data = measured(NAMES, joints, ("p1",), ARM.points(joints, ARM.nominal()))
    assert rounding(ARM, data, ARM.nominal()) is None
    step = np.deg2rad(0.5)
    rounded = replace(data, joints=step * np.round(joints / step))
    found = rounding(ARM, rounded, ARM.nominal())
    assert found is not None and found.step_rad == pytest.approx(step)
    made = np.linalg.norm(ARM.points(rounded.joints, ARM.nominal()) - data.points, axis=2)
    assert found.rms_m == pytest.approx(np.sqrt((made**2).mean()), rel=0.3)
