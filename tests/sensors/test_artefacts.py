"""Artefacts of known dimensions: derivatives, places from contacts, the size of an arm and its uncertainty."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.observed_files import HEADER, read
from helpers.robots import IRB120, assert_derivatives

import lab
from lab.core.errors import LabError
from lab.core.measurements import FIXTURE
from lab.core.se3 import exp, log
from lab.kinematics.gauge import base_set
from lab.kinematics.serial.serial_arm import SerialArm
from lab.sensors.artefact import FEATURE, Artefact
from lab.sensors.ball_bar import BallBar
from lab.sensors.cube import Cube
from lab.sensors.dial import Dials
from lab.sensors.sensor_options import FitInputs, SensorOptions
from lab.sensors.sensor_registry import configured_sensor, sensor_named
from lab.sensors.sphere_plate import SpherePlate, TouchedSpheres

ARM = SerialArm(IRB120.chain)
FACES = tuple((*(sense * np.eye(3)[i]), 0.1, 0.003) for i in range(3) for sense in (1.0, -1.0))  # x+ x- y+ y- z+ z-
SPHERES = ((0.0, 0.0, 0.0, 0.02), (0.2, 0.0, 0.01, 0.02), (0.0, 0.15, 0.0, 0.02), (0.2, 0.15, 0.03, 0.02))
KINDS: dict[type[Artefact], tuple[tuple[float, ...], ...]] = {
    Cube: FACES,
    SpherePlate: SPHERES,
    TouchedSpheres: SPHERES,
    BallBar: ((0.3,), (0.2,)),
}


def artefact(kind: type[Artefact], places: int = 2, features: tuple[int, ...] = (), **more) -> Artefact:
    """An arm at so many artefacts, each touched at these features; at all where none are named."""
    known = KINDS[kind]
    touched = tuple((place, feature) for place in range(places) for feature in features or range(len(known)))
    labels = tuple(str(place) for place in range(places))
    return kind(ARM, ARM.nominal(), tuple(range(places)), labels, features=known, touched=touched, **more)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("uncertain", [False, True])
def test_derivatives_at_artefacts(kind, uncertain: bool) -> None:
    rng, model = np.random.default_rng(0), artefact(kind, size_u=1e-3 * uncertain)
    values = model.nominal(model.nominal_arm)
    values[len(ARM.names) :] = rng.normal(0, 0.5, len(values) - len(ARM.names))
    rows = model.structure_rows(12)
    inputs = np.column_stack([IRB120.chain.random_joints(12, rng), rows])
    observed, jacobian = model.observe(inputs, values)
    np.testing.assert_array_equal(observed, model.points(inputs, values))
    assert_derivatives(lambda v: model.points(inputs, v), jacobian, values)
    assert len(model.shared) == uncertain


@pytest.mark.parametrize("kind", [Cube, SpherePlate, TouchedSpheres, BallBar])
def test_an_artefact_is_placed_by_its_contacts_alone(kind) -> None:
    """Points on its features, in any pose, give that pose without a guess."""
    model, rng = artefact(kind), np.random.default_rng(1)
    for _ in range(5):
        pose = np.concatenate([rng.normal(0, 1, 3), log(exp(rng.normal(0, 2, 3)))])[: len(model.axes)]
        rows = np.repeat(np.arange(len(KINDS[kind])), 6)[:, None].astype(float)
        known, near = np.array(model.features)[rows[:, 0].astype(int)], rng.normal(0, 0.1, (len(rows), 3))
        for _ in range(3):  # onto the feature: gaps of the plane, of a point, of a sphere
            gap, by_near, _ = model.gap(near, known, 1.0)
            near = near - (np.linalg.pinv(by_near) @ gap[..., None])[..., 0]
        R = exp(pose[3:]) if len(pose) > 3 else np.eye(3)
        found = model.located(near @ R.T + pose[:3], np.zeros_like(gap), rows)
        np.testing.assert_allclose(found, pose, atol=1e-9)


RANKS = {  # 21 of an arm that is touched, less one where its size is free; six of each place, three of a bar's
    "cube, all faces": (Cube, 2, (), 21 + 12),
    "cube, opposite faces of one axis": (Cube, 1, (0, 1, 2, 4), 21 + 6),
    "cube, three faces": (Cube, 2, (0, 2, 4), 21 + 12 - 1),
    "plate, centred": (SpherePlate, 2, (), 21 + 12),
    "plate, one sphere": (TouchedSpheres, 2, (0,), 21 + 6),
    "bar": (BallBar, 2, (0,), 21 + 6),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("kind", "places", "features", "rank"), RANKS.values(), ids=RANKS)
def test_what_artefacts_identify(kind, places, features, rank) -> None:
    model = artefact(kind, places, features)
    found = base_set(model, model.nominal(model.nominal_arm))
    assert len(found.identifiable) == rank
    assert (model.scale_link in found.identifiable) == (features != (0, 2, 4))


def test_indicators_give_the_size_by_their_stroke() -> None:
    model = Dials(ARM, ARM.nominal(), (0, 1, 2), ("a", "b", "c"))
    values = model.nominal(model.nominal_arm)
    values[model.first :] = np.random.default_rng(0).normal(0, 0.5, 9)
    found = base_set(model, values)
    assert len(found.identifiable) == 21 + 9 and model.scale_link in found.identifiable


@pytest.fixture(scope="module")
def cubes() -> lab.MeasurementSession:
    return lab.simulate(
        "irb120", observe="cube", poses=100, fixtures=2, seed=3, instrument="touch-probe", tip_radius_mm=3.0
    )


@pytest.mark.thorough
def test_opposite_faces_give_the_size_and_three_faces_do_not(cubes: lab.MeasurementSession) -> None:
    data = cubes.measurements
    whole = lab.identify(data, observe="cube", tip_radius_mm=3.0, noise_mm=0.01)
    assert whole.to_dict()["verdict"] == "good" and not whole.identification.lacks_size
    kept = [i for i, face in enumerate(data.other["face"]) if face in ("x+", "y+", "z+")]
    three = lab.identify(data[kept], observe="cube", tip_radius_mm=3.0, noise_mm=0.01)
    assert three.identification.lacks_size and three.to_dict()["verdict"] == "doubtful"
    assert any("do not determine the arm's size" in text for text in three.to_dict()["warnings"])


@pytest.mark.thorough
@pytest.mark.parametrize("noise_mm", [0.01, None])
def test_the_uncertainty_of_an_artefact_goes_into_the_size_of_the_arm(
    cubes: lab.MeasurementSession, noise_mm: float | None
) -> None:
    """An uncertainty of 0.01 % is 1e-4 of every length; no contact tells more, whether the noise is given or not."""
    data = cubes.measurements
    exact, found = (
        lab.identify(data, observe="cube", tip_radius_mm=3.0, size_u_percent=u, noise_mm=noise_mm).identification
        for u in (0.0, 0.01)
    )
    names = [found.model.names[i] for i in found.fit.free]
    assert found.std[names.index("cube.scale")] == pytest.approx(1e-4, rel=0.05)
    link = found.model.names[found.model.scale_link]
    alone = exact.std[[exact.model.names[i] for i in exact.fit.free].index(link)]
    expected = np.hypot(alone, 1e-4 * abs(found.values[found.model.scale_link]))
    assert found.std[names.index(link)] == pytest.approx(expected, rel=0.1)
    assert np.abs(found.residuals - exact.residuals).max() < 1e-7


REFUSED = {
    "no face": ("cube", "edge_mm", ["200"], "column face is missing"),
    "a face that is none": ("cube", "face,edge_mm", ["x+,200", "top,200"], "line 3, column face: 'top' is none of x"),
    "no edge": ("cube", "face", ["x+"], "column edge_mm is missing"),
    "an empty edge": ("cube", "face,edge_mm", ["x+,200", "x-,"], "line 3, column edge_mm: give a length above zero"),
    "two edges": ("cube", "face,edge_mm", ["x+,200", "x+,201"] * 4, "line 3: cube .* other dimensions at x"),
    "faces of two axes": ("cube", "face,edge_mm", ["x+,200", "y+,200"] * 4, "no face along z was touched"),
    "no sphere": ("sphere-plate", "sphere_x_mm", ["1"], "column sphere is missing"),
    "no coordinate": ("sphere-plate", "sphere,sphere_x_mm,sphere_y_mm", ["a,1,1"], "column sphere_z_mm is missing"),
    "spheres on a line": (
        "sphere-plate",
        "sphere,sphere_x_mm,sphere_y_mm,sphere_z_mm",
        ["a,0,0,0", "b,100,0,0", "c,200,0,0"],
        "lie on a line",
    ),
    "no length": ("ball-bar", "location", ["1"], "column bar_mm is missing"),
    "a negative length": ("ball-bar", "bar_mm", ["-300"], "line 2, column bar_mm: give a length above zero"),
    "no reading": ("dial", "location", ["1"], "column dial_mm is missing"),
    "no indicator's name": ("dial", "location,dial_mm", ["a,1", ",1"], "line 3, column location: empty"),
    "few": ("cube", "face,edge_mm", ["x+,200", "y+,200", "z+,200"], "no cube has more than 3 rows; .*takes 6"),
}


@pytest.mark.parametrize(("observe", "columns", "rows", "what"), REFUSED.values(), ids=REFUSED)
def test_rows_that_make_no_artefact_are_refused(observe, columns, rows, what, tmp_path) -> None:
    lines = "".join(f"{10 * i},20,30,40,50,60,{row}\n" for i, row in enumerate(rows))
    data = read(tmp_path, f"{HEADER},{columns}\n{lines}", observe)
    with pytest.raises(LabError, match=what):
        sensor_named(observe)().observation(ARM, data, ARM.nominal())


def test_a_radius_of_the_tip_is_of_touched_surfaces(tmp_path) -> None:
    sensor = configured_sensor("sphere-plate", SensorOptions(tip_radius_mm=3.0), FitInputs())
    columns = "sphere,sphere_x_mm,sphere_y_mm,sphere_z_mm"
    rows = [f"{i},2,3,4,5,6,{name},{100 * (i % 2)},{100 * (i // 2 % 2)},0" for i, name in enumerate("abcd" * 2)]
    data = read(tmp_path, f"{HEADER},{columns}\n" + "\n".join(rows) + "\n", "sphere-plate")
    with pytest.raises(LabError, match="tip-radius-mm is of touched surfaces"):
        sensor.observation(ARM, data, ARM.nominal())
    touched = replace(data, conditions={**data.conditions, "radius_mm": np.full(len(data), 15.0)})
    model, seen = sensor.observation(ARM, touched, ARM.nominal())
    assert isinstance(model, TouchedSpheres) and seen.points.shape == (8, 1, 1)
    assert {feature[3] for feature in model.features} == {0.018}
    assert set(seen.conditions[FEATURE]) == {0.0, 1.0, 2.0, 3.0} and set(seen.conditions[FIXTURE]) == {0.0}


@pytest.mark.parametrize(
    ("observe", "options", "what"),
    [
        ("ball-bar", {"tip_radius_mm": 1.0}, "--tip-radius-mm is of --observe cube"),
        ("plane", {"size_u_percent": 1.0}, "--size-u-percent is of --observe "),
        ("cube", {"size_u_percent": -1.0}, "--size-u-percent -1: give percent .* from 0"),
        ("socket", {"size_u_percent": np.nan}, "--size-u-percent nan: give percent"),
        ("sphere-plate", {"tip_radius_mm": -1.0}, "--tip-radius-mm -1: give a number above"),
    ],
)
def test_options_of_artefacts(observe, options, what) -> None:
    with pytest.raises(LabError, match=what):
        configured_sensor(observe, SensorOptions(**options), FitInputs())


def test_an_artefact_without_a_size_or_of_points_is_refused() -> None:
    with pytest.raises(LabError, match="--artefact-mm 0: give"):
        lab.simulate("irb120", observe="cube", poses=20, artefact_mm=0.0)
    with pytest.raises(LabError, match="--artefact-mm is of --observe cube, sphere-plate, ball-bar"):
        lab.simulate("irb120", observe="plane", poses=20, artefact_mm=100.0)
