"""Systematic errors of a tracker: each closed form against a gimbal turned by matrices, and a ray followed in air."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lab.core.errors import LabError
from lab.core.probability import Uncertain
from lab.core.se3 import Array, exp
from lab.noise.instruments import (
    AIR_INDEX_PER_K,
    PLACEMENT,
    SYSTEMATIC_ERRORS,
    TrackerErrors,
    air_index,
)

TERM = {term.name: term for term in SYSTEMATIC_ERRORS}
POINTS = np.array([[2.0, 1.0, 0.5], [-1.5, 2.5, -1.0], [0.3, -3.0, 2.0], [-4.0, -0.5, 0.1]])
SIZE = 1e-6  # of a misalignment, m or rad: what is of second order is below 1e-11 m
STEP = 1e-6
Z, X, Y = np.eye(3)[[2, 0, 1]]


def pointed(azimuth: float, elevation: float, reach: float, **off: float) -> Array:
    """Where a tracker's beam really ends, ``(3,)`` m, whose circles and range show these numbers.

    A beam along x, from a transit axis y that carries it, on a standing axis z: turned one after the other.
    """
    azimuth -= off.get("azimuth_cos", 0.0) * np.cos(azimuth) + off.get("azimuth_sin", 0.0) * np.sin(azimuth)
    elevation -= off.get("elevation_cos", 0.0) * np.cos(elevation) + off.get("elevation_sin", 0.0) * np.sin(elevation)
    elevation -= off.get("elevation_index", 0.0)
    length = reach - off.get("range_offset", 0.0) - off.get("range_scale", 0.0) * reach
    beam = exp(-off.get("collimation", 0.0) * Z) @ (length * X) - off.get("beam_offset", 0.0) * Y
    carried = exp(off.get("transit_tilt", 0.0) * X) @ exp(-elevation * Y) @ beam + off.get("transit_offset", 0.0) * X
    return np.asarray(exp(azimuth * Z) @ carried)


def shown(point: Array, second_face: bool, **off: float) -> Array:
    """What a tracker with misalignments makes of a point ``(3,)``: its circles turned until the beam ends there."""
    reach, level = float(np.linalg.norm(point)), float(np.hypot(point[0], point[1]))
    reading = np.array([np.arctan2(point[1], point[0]), np.arctan2(point[2], level), reach])
    if second_face:
        reading[:2] = reading[0] + np.pi, np.pi - reading[1]
    for _ in range(4):
        here = pointed(*reading, **off)
        columns = [(pointed(*(reading + STEP * axis), **off) - here) / STEP for axis in np.eye(3)]
        reading = reading + np.linalg.solve(np.array(columns).T, point - here)
    return pointed(*reading)


OF_COMPONENT = {
    "azimuth_eccentricity": ("azimuth_cos", "azimuth_sin"),
    "elevation_eccentricity": ("elevation_cos", "elevation_sin"),
}
MECHANICAL = [
    "transit_offset", "transit_tilt", "collimation", "beam_offset", "elevation_index", "azimuth_eccentricity",
    "elevation_eccentricity", "range_offset", "range_scale",
]  # fmt: skip


@pytest.mark.parametrize("name", MECHANICAL)
@pytest.mark.parametrize("two_face", [False, True])
def test_a_closed_form_is_what_a_misaligned_gimbal_shows(name: str, two_face: bool) -> None:
    term = TERM[name]
    found = TrackerErrors(two_face=two_face).displacements(term, POINTS)
    assert found.shape == (*POINTS.shape, term.components)
    for component, off in enumerate(OF_COMPONENT.get(name, (name,))):
        faces = (False, True) if two_face else (False,)
        for point, row in zip(POINTS, found[..., component], strict=True):
            really = np.mean([shown(point, face, **{off: SIZE}) for face in faces], axis=0) - point
            np.testing.assert_allclose(SIZE * row, really, atol=2e-11)


def test_the_mean_of_two_faces_takes_away_what_it_is_known_to() -> None:
    """Collimation, tilts, offsets and the zero of the elevation go; range, refraction and one of four circles stay."""
    both = TrackerErrors(two_face=True)
    left = {
        term.name: np.abs(both.displacements(term, POINTS)).max(axis=(0, 1))
        for term in SYSTEMATIC_ERRORS
        if term not in PLACEMENT
    }
    gone = {"transit_offset", "transit_tilt", "collimation", "beam_offset", "elevation_index", "azimuth_eccentricity"}
    for name, sizes in left.items():
        assert (sizes.max() < 1e-12) == (name in gone), name
    assert left["elevation_eccentricity"][0] > 1 and left["elevation_eccentricity"][1] < 1e-12


def test_a_ray_followed_through_a_temperature_gradient_bends_as_the_closed_form_says() -> None:
    """The ray equation d(n t)/ds = grad n, to a target 12 m away, by a Runge-Kutta method."""
    gradient, elevation, reach = 2.0, 0.3, 12.0
    slope = AIR_INDEX_PER_K * gradient

    def index(height: float) -> float:
        return 1 + slope * height

    def along(_: float, state: Array) -> Array:
        _, z, px, pz = state[:4]
        n = index(z)
        return np.array([px / n, pz / n, 0.0, slope, n])

    target = reach * np.array([np.cos(elevation), np.sin(elevation)])
    start = elevation
    for _ in range(4):  # shoot until the ray meets the target
        path = solve_ivp(
            along, (0, reach), [0, 0, np.cos(start), np.sin(start), 0], rtol=1e-12, atol=1e-14, max_step=0.5
        )
        end = path.y[:2, -1]
        start += np.arctan2(target[1], target[0]) - np.arctan2(end[1], end[0])
    length = path.y[4, -1] + (reach - np.linalg.norm(end))  # optical, as the tracker measures it
    shown_at = length * np.array([np.cos(start), 0.0, np.sin(start)])
    point = np.array([target[0], 0.0, target[1]])
    expected = gradient * TrackerErrors().displacements(TERM["temperature_gradient"], point)[:, 0]
    np.testing.assert_allclose(shown_at - point, expected, atol=2e-8)  # of 134 um; what is left is of second order
    assert np.linalg.norm(expected) > 1e-4


def test_the_air_is_that_of_the_updated_formula_of_edlen() -> None:
    """1.000271628, at 20 degrees, 1013.25 hPa and 20 % humidity (NIST's calculator): dry air is 1.7e-7 above."""
    assert air_index(20.0) == pytest.approx(1.0002716291691649 + 1.7e-7, abs=3e-8)
    assert pytest.approx(-0.93e-6, abs=0.01e-6) == AIR_INDEX_PER_K


def test_errors_are_multiplied_and_sorted_by_how_long_they_last() -> None:
    errors = TrackerErrors(range_scale=Uncertain(2e-6), nest=Uncertain.within(3e-6), two_face=True)
    assert [term.name for term in errors.lasting] == ["range_scale"]
    assert [term.name for term in errors.placement] == ["nest"]
    twice = errors.times(2.0)
    assert twice.two_face and twice.range_scale.standard == 4e-6 and twice.nest.limit == pytest.approx(6e-6)
    assert not errors.times(0.0).stated


def test_a_campaign_has_one_set_of_misalignments_and_terms_are_independent() -> None:
    tilt, scale = TrackerErrors(transit_tilt=Uncertain(5e-6)), TrackerErrors(range_scale=Uncertain(5e-6))
    both = TrackerErrors(transit_tilt=Uncertain(5e-6), range_scale=Uncertain(5e-6))
    drawn = [each.sample(POINTS, np.random.default_rng(3)) for each in (tilt, scale, both)]
    np.testing.assert_allclose(drawn[0] + drawn[1], drawn[2], atol=1e-18)
    ratios = drawn[1] / POINTS  # a scale is one number for all points
    np.testing.assert_allclose(ratios, ratios[0, 0])
    assert not TrackerErrors().sample(POINTS, np.random.default_rng(3)).any()


@pytest.mark.parametrize("distribution", ["rectangular", "triangular", "arcsine"])
def test_what_lies_between_limits_has_its_standard_uncertainty(distribution: str) -> None:
    quantity = Uncertain.within(2.0, distribution)  # type: ignore[arg-type]
    drawn = quantity.sample(np.random.default_rng(0), 100_000)
    assert np.abs(drawn).max() <= 2.0 and quantity.limit == pytest.approx(2.0)
    assert drawn.std() == pytest.approx(quantity.standard, rel=0.01) and abs(drawn.mean()) < 0.02


def test_degrees_of_freedom_make_tails_and_contradictions_are_refused() -> None:
    drawn = Uncertain(1.0, dof=5.0).sample(np.random.default_rng(0), 100_000)
    assert drawn.var() == pytest.approx(5 / 3, rel=0.05)
    for wrong in (
        lambda: Uncertain(-1.0),
        lambda: Uncertain(1.0, dof=1.0),
        lambda: Uncertain.within(1.0, "normal"),
    ):
        with pytest.raises(LabError):
            wrong()
