"""A virtual arm measured by each kind of observation, and identified again: exactly without noise, else within it."""

import numpy as np
import pytest
from helpers.robots import IRB120

import lab
from lab.core.errors import LabError
from lab.core.se3 import exp, inverse, log, rotation_from_quaternion, transform
from lab.formats.orientations import read_orientations
from lab.noise.instruments import INSTRUMENTS
from lab.sensors.sensor_options import VirtualSetup
from lab.sensors.sensor_registry import sensor_named
from lab.sensors.socket import SocketSensor
from lab.simulation.tracking import VirtualMeasurement, target_rotations

SEED = 3
CASES = {  # of each kind, how many poses show all of an arm
    "pose, mixed": {"poses": 30, "orientation_share": 0.3},
    "pose as angles": {"poses": 20, "orientation": "fixed-xyz", "method": "sequential"},
    "cable": {"poses": 60},
    "socket": {"poses": 40, "socket_distance_mm": 80.0, "fixtures": 3, "size_u_percent": 0.0},
    "plane": {"poses": 60},
    "sphere-plate": {"poses": 40, "fixtures": 2, "size_u_percent": 0.0},
    "ball-bar": {"poses": 60, "size_u_percent": 0.0},
    "dial": {"poses": 60},
}


def campaign(name: str, **options) -> lab.CalibrationResult:
    return lab.calibrate(
        "irb120", **{"observe": name.replace(",", "").split()[0], "seed": SEED, **CASES[name], **options}
    )


DEFAULT = ("pose, mixed", "cable", "ball-bar")


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.thorough] * (n not in DEFAULT)) for n in CASES])
def test_without_noise_an_arm_is_found_as_it_truly_is(name: str) -> None:
    """The truth is read off MuJoCo's joint axes and sites, the errors are of MuJoCo's own points."""
    result = campaign(name, instrument="exact").to_dict()
    assert result["rank"] == result["identifiable"] and result["status"] == "converged"
    assert result["truth"]["max_abs_error"] < 1e-9
    knows_its_size = name != "plane"
    assert (result["after_mm"]["max"] < 1e-6) == knows_its_size
    assert any("do not determine the arm's size" in said for said in result["warnings"]) != knows_its_size
    assert result["before_mm"]["mean"] > 1


NOISY = {  # of each error model one
    "pose, mixed": {"instrument": "leica-at960"},
    "cable": {"instrument": "draw-wire"},
}


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.thorough] * (n != "cable")) for n in NOISY])
def test_with_noise_an_arm_is_found_within_it(name: str) -> None:
    found = campaign(name, **NOISY[name])
    at_fixtures = not name.startswith("pose")
    assert ("position error, the base placed anew, on 666 points" in found.summary()) == at_fixtures
    result = found.to_dict()
    assert result["adequate"] and result["rank"] == result["identifiable"]
    assert result["truth"]["max_abs_z"] < 4.5  # of up to 45: once in 3,000
    assert 0.4 < result["truth"]["nees_per_parameter"] < 2.0  # chi2 of 30 and more, a share each


def test_a_frame_turns_as_its_target_moves() -> None:
    """The rotation of a target's frame, against the vectors between targets that are fixed to the same body."""
    day = lab.simulate(
        "irb120", poses=12, seed=SEED, targets=("p1", "p2", "p3"), effects=lab.Effects(stiffness_nm_per_rad=2e4)
    )
    real, joints = day.true_robot, day.measurements.joints
    points = real.points(joints, ("p1", "p2", "p3"))
    rotations = target_rotations(real, joints, "p1")
    np.testing.assert_allclose(rotations @ np.swapaxes(rotations, 1, 2), np.tile(np.eye(3), (12, 1, 1)), atol=1e-14)
    for other in (1, 2):
        own = np.swapaxes(rotations, 1, 2) @ (points[:, other] - points[:, 0])[..., None]
        np.testing.assert_allclose(own, np.broadcast_to(own[0], own.shape), atol=1e-13)


def test_orientations_have_the_instruments_noise_and_share() -> None:
    day = lab.simulate("irb120", observe="pose", poses=400, seed=SEED, instrument="krypton-k600", orientation_share=0.5)
    measured = read_orientations(day.measurements, "p1")
    there = np.isfinite(measured).all(axis=1)
    assert there.sum() == 200 and day.measurements.seen.all()
    exact = target_rotations(day.true_robot, day.measurements.joints[there], "p1")
    off = log(np.swapaxes(exact, 1, 2) @ rotation_from_quaternion(measured[there]))
    assert np.std(off) == pytest.approx(200e-6, rel=0.12)  # 600 numbers: 4 standard deviations
    assert np.abs(off.mean(axis=0)).max() < 4 * 200e-6 / np.sqrt(200)


def test_contacts_touch_within_limits_and_sockets_are_apart() -> None:
    day = lab.simulate(
        "irb120", observe="socket", poses=24, fixtures=3, seed=SEED, socket_distance_mm=50.0, size_u_percent=0.0
    )
    data, real = day.measurements, day.true_robot
    noise = 8e-6
    points = real.points(data.joints, ("p1",))[:, 0]
    sockets = sorted(set(zip(data.other["location"], data.other["socket"], strict=True)))
    assert len(sockets) == 6
    centres = {}
    for pair in sockets:
        rows = [i for i in range(24) if (data.other["location"][i], data.other["socket"][i]) == pair]
        centres[pair] = points[rows].mean(axis=0)
        assert np.abs(points[rows] - centres[pair]).max() < 2 * noise
        assert np.ptp(data.joints[rows], axis=0).max() > 0.3  # from different sides
    for location in {name for name, _ in sockets}:
        apart = np.linalg.norm(centres[location, "a"] - centres[location, "b"])
        assert apart == pytest.approx(0.05, abs=2 * noise)
    assert not IRB120.chain.beyond_limits(data.joints, 0.0).any()


@pytest.mark.thorough
def test_a_file_of_each_kind_reads_back(tmp_path) -> None:
    """What a virtual day writes is what ``lab identify`` reads: the same numbers, and the same fit."""
    for name in ("pose, mixed", "cable", "ball-bar", "socket"):
        options = {"observe": name.replace(",", "").split()[0], "seed": SEED, **CASES[name]}
        day = lab.simulate("irb120", **options)
        lab.write_measurements(tmp_path / "day.csv", day.measurements)
        read = lab.read_measurements(tmp_path / "day.csv", "irb120", observe=options["observe"])
        np.testing.assert_array_equal(read.joints, day.measurements.joints)
        assert {key: read.other[key] for key in day.measurements.other} == day.measurements.other
        for column, numbers in day.measurements.conditions.items():
            np.testing.assert_array_equal(read.conditions[column], numbers)
        assert ("cable_mm" in read.conditions) == (name == "cable")
    kind = SocketSensor()
    assert kind.rows(read).all()


def test_a_plane_is_the_same_seen_from_another_frame() -> None:
    """``at_base`` of planes: points that lie on one before lie on it after, scaled."""
    from helpers.fixture_data import many

    from lab.sensors.plane import Planes

    rng = np.random.default_rng(0)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = exp(rng.normal(size=3)), rng.normal(size=3)
    model, normals = many(Planes, 3), rng.normal(size=(3, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    on, scale = rng.normal(size=(3, 3)), 1.003
    placed = np.column_stack([normals, (normals * on).sum(axis=1)])
    fixtures = model.at_base(placed, T, scale)
    gaps = model.predict(transform(T, scale * on), fixtures)[0]
    assert np.abs(gaps).max() < 1e-14
    assert np.abs(model.predict(transform(inverse(T), on), fixtures)[0]).max() > 1e-3


REFUSED = {
    "another kind's instrument": ({"observe": "cable", "instrument": "leica-at960"}, "leica-at960 measures points, po"),
    "no orientations": ({"observe": "pose", "instrument": "faro-vantage"}, "faro-vantage measures points, not pose"),
    "fixtures of points": (
        {"fixtures": 2},
        "--fixtures is of --observe cable, socket, plane, cube, sphere-plate, ball-bar, dial",
    ),
    "occlusion of a cable": ({"observe": "cable", "occlusion": True}, "--occlusion is of --observe points, pose"),
    "no share": ({"observe": "pose", "orientation_share": 0.0}, "--orientation-share 0: give a share above 0"),
    "no fixtures": ({"observe": "cable", "fixtures": 0}, "--fixtures 0"),
    "two targets": ({"observe": "plane", "targets": ("p1", "p2")}, "--observe plane is of one point of the tool, p1"),
    "a tracker that drifts": ({"observe": "cable", "drift_mm_per_h": 1.0}, "drift, bumps and steps are of a tracker"),
    "a method of points": ({"method": "sequential"}, "--method sequential is of --observe pose"),
    "one plane of few": ({"observe": "socket", "poses": 4}, "no socket has more than 1 row"),
}


@pytest.mark.parametrize(("options", "what"), REFUSED.values(), ids=REFUSED)
def test_what_makes_no_sense_is_refused(options: dict, what: str) -> None:
    with pytest.raises(LabError, match=what):
        lab.calibrate("irb120", **options)


def test_each_kind_at_fixtures_is_measured_by_one_point() -> None:
    day = lab.simulate("irb120", poses=2, seed=SEED)
    rng, joints = np.random.default_rng(0), day.measurements.joints
    for name in ("cable", "plane", "socket", "cube", "sphere-plate", "ball-bar", "dial"):
        with pytest.raises(LabError, match="leave out --targets p2"):
            poses = VirtualMeasurement(day.true_robot, joints, ("p2",), INSTRUMENTS["exact"], rng)
            sensor_named(name)().simulate(poses, VirtualSetup())


def test_a_mechanism_has_no_fixtures() -> None:
    with pytest.raises(LabError, match="delta has loops: a virtual one is measured by --observe points or pose"):
        lab.calibrate("delta", observe="cable", poses=60)
