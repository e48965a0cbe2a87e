"""What `lab inspect` says of mechanisms with loops: freedoms, modes, places, singularities, what can be identified."""

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.robots import ROOT
from scipy.integrate import dblquad

import lab
from lab.cli.main import main
from lab.core.gaps import GapWarning
from lab.extensions.robotics.closed.recognition import classical_model_of
from lab.formats.mechanism_toml import read_mechanism
from lab.kinematics.closed.mechanism import Mechanism, platform_poses
from lab.kinematics.closed.mobility import SINGULAR
from lab.kinematics.joints import JointSpec
from lab.library.inspected_model import ClosedShape, closed_shape_of

MODELS = ROOT / "models"
NAMES = ("rpr2/mechanism", "rpr3/mechanism", "delta/mechanism", "delta/small", "delta/six_rods")


@pytest.fixture(scope="module")
def shapes() -> dict[str, tuple[Mechanism, ClosedShape]]:
    found = {name: read_mechanism(MODELS / f"{name}.toml").mechanism for name in NAMES}
    return {name: (mechanism, closed_shape_of(mechanism)) for name, mechanism in found.items()}


Shapes = dict[str, tuple[Mechanism, ClosedShape]]


@pytest.mark.thorough
def test_freedoms_and_modes(shapes: Shapes) -> None:
    counted = {
        name: (s.mobility, s.freedoms, *((f.modes, f.working) if (f := s.closed_form) else (None, None)))
        for name, (_, s) in shapes.items()
    }
    assert counted == {
        "rpr2/mechanism": (2, 2, 2, 1),
        "rpr3/mechanism": (3, 3, 2, 1),
        "delta/mechanism": (3, 3, 2, 8),
        "delta/small": (3, 3, 2, 8),
        "delta/six_rods": (3, 3, None, None),
    }


@pytest.mark.thorough
@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", NAMES)
def test_the_extents_hold_every_place_that_is_named_or_drawn(name: str, shapes: Shapes) -> None:
    """No nearest pose and no random one is outside; and of many more random ones hardly one comes as far."""
    mechanism, shape = shapes[name]
    for each in shape.closed_form.singularities if shape.closed_form else ():
        assert (each.place >= shape.extents[:, 0] - 1e-12).all() and (each.place <= shape.extents[:, 1] + 1e-12).all()
    joints = JointSpec.random_joints(mechanism, 5000, np.random.default_rng(8))
    closed = mechanism.assembled(joints, mechanism.nominal_values)
    places = platform_poses(mechanism, joints[closed.fits], closed.configuration.passive.T[closed.fits])[:, :3, 3]
    slack = 1e-3 * np.ptp(shape.extents, axis=1)
    assert (places >= shape.extents[:, 0] - slack).all() and (places <= shape.extents[:, 1] + slack).all()


@pytest.mark.thorough
def test_a_delta_hangs_lowest_with_all_arms_down(shapes: Shapes) -> None:
    """Its lowest place is in the corner of the limits, by three spheres about the elbows."""
    mechanism, shape = shapes["delta/mechanism"]
    arm, rod, radii, down = 0.524, 1.244, 0.163678801 - 0.043878620, mechanism.upper[0]
    elbow = radii + arm * np.cos(down)
    assert shape.extents[2, 0] == pytest.approx(-arm * np.sin(down) - np.sqrt(rod**2 - elbow**2), abs=1e-5)


@pytest.mark.thorough
def test_an_area_is_the_integral_over_the_readings(shapes: Shapes) -> None:
    """Of the 2-RPR dx dy = rho1 rho2 / (L y) d rho1 d rho2, once each way of assembling."""
    mechanism, shape = shapes["rpr2/mechanism"]
    span, (low, high) = 0.6, (mechanism.lower[0], mechanism.upper[0])

    def density(b: float, a: float) -> float:
        x = (a**2 - b**2 + span**2) / (2 * span)
        return a * b / (span * float(np.sqrt(a**2 - x**2)))

    assert shape.closed_form.reachable == pytest.approx(dblquad(density, low, high, low, high)[0], rel=0.01)


@pytest.mark.thorough
@pytest.mark.parametrize("name", NAMES[:4])
def test_a_nearest_pose_is_as_near_as_any_at_random(name: str, shapes: Shapes) -> None:
    mechanism, shape = shapes[name]
    course = classical_model_of(mechanism)
    assert course is not None
    joints = JointSpec.random_joints(mechanism, 5000, np.random.default_rng(7))
    closed = mechanism.assembled(joints, mechanism.nominal_values)
    at_random = course.distances(joints[closed.fits], closed.configuration.passive.T[closed.fits])
    for each in shape.closed_form.singularities:
        assert not mechanism.beyond_limits(each.joints[None], 0.0).any()
        assert each.distance < SINGULAR or each.distance <= getattr(at_random, each.kind).min()
        there = mechanism.assembled(each.joints[None], mechanism.nominal_values)
        if not there.fits.all():  # on the brink
            assert each.kind == "parallel" and each.distance < SINGULAR
            continue
        place = there.configuration.frames[mechanism.tree.platform][1][:3, 0]
        np.testing.assert_allclose(place, each.place, atol=1e-9)
        distances = course.distances(each.joints[None], there.configuration.passive.T)
        assert getattr(distances, each.kind)[0] == pytest.approx(each.distance, abs=1e-9)


@pytest.mark.thorough
def test_two_legs_are_nearest_to_one_line_where_one_is_long_and_one_short(shapes: Shapes) -> None:
    """The smallest singular value of two unit rows at an angle is sqrt(1 - |cos|)."""
    mechanism, shape = shapes["rpr2/mechanism"]
    long, short = mechanism.upper[0], mechanism.lower[0]
    cos = (long**2 + short**2 - 0.6**2) / (2 * long * short)
    assert shape.closed_form.singularities[0].kind == "parallel"
    assert shape.closed_form.singularities[0].distance == pytest.approx(np.sqrt(1 - cos), abs=1e-6)


# the command


def seen(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert main(["inspect", *arguments, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


FRAMED = ("--fix", "base.z,base.rx,base.ry,tool.*")
GROUNDED = ("--fix", "base.*,tool.*", "--free", "A2.y,A3.x,A3.y")
RANKS = {  # facts-robots, section 5, beside what a target in space adds
    "2-RPR, offsets, gains, frame": (("rpr2", "--model", "gear", *FRAMED), 8, 11, 17),
    "3-RPR, pose": (("rpr3", "--targets", "p1,p2,p3", *GROUNDED), 15, 15, 30),
    "Delta, 11 a leg + frame": (("delta", "--fix", "tool.*"), 24, 39, 42),
}


@pytest.mark.thorough
@pytest.mark.parametrize("what", RANKS)
def test_what_can_be_identified(what: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments, rank, left, parameters = RANKS[what]
    found = seen(capsys, *arguments)
    assert (found["rank"], found["not_fixed"], found["parameters"]) == (rank, left, parameters)
    assert len(found["identifiable"]) == rank


def test_without_a_closed_form_and_with_a_pin(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from helpers.mechanisms import CRANK

    (tmp_path / "crank.toml").write_text(CRANK)
    assert main(["inspect", str(tmp_path / "crank.toml")]) == 0
    assert "mobility 1;" in " ".join(capsys.readouterr().out.split())
    found = seen(capsys, str(tmp_path / "crank.toml"))
    assert found["closed_form"] is None and found["pins"][0]["along"] == "xy" and found["assembly_modes"] is None


@pytest.mark.parametrize(
    ("name", "lengths"), [("rpr2", {"span_mm": 600.0}), ("delta", {"arm_mm": 524.0, "rod_mm": 1244.0})]
)
def test_the_dimensions_of_a_closed_form_are_values_in_mm_and_shown(name: str, lengths: dict[str, float]) -> None:
    result = lab.inspect(name)
    form = result.to_dict()["closed_form"]
    assert {key: form[key] for key in lengths} == pytest.approx(lengths)
    with warnings.catch_warnings():
        warnings.simplefilter("error", GapWarning)  # no part of the text is left out
        shown = result.summary()
    assert all(f"{length:g}" in shown for length in lengths.values())
