"""The course's models of the 2-RPR, the 3-RPR and the Delta: published numbers, round trips, derivatives, singular."""

from collections.abc import Callable

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.robotics.closed.classical_mechanisms import AZIMUTHS_RAD, Delta, SharedPin, ThreeLegs, TwoLegs
from lab.kinematics.closed.mobility import mobility

DRAWS = 10_000
PI = np.pi
EXACT = 1e-14  # of a distance from singular, which has no unit

TWO = TwoLegs(0.8)
FLEX_PICKER = Delta(0.567 / np.sqrt(12), 0.076 / np.sqrt(3), 0.524, 1.244, AZIMUTHS_RAD)
CENTRED = np.array([[np.cos(a), np.sin(a)] for a in np.radians([-150, -30, 90])])  # an equilateral triangle
SIXTY = np.array([[0.5, np.sqrt(0.75)], [-np.sqrt(0.75), 0.5]])


def triangle(ab: float, ac: float, bc: float) -> Array:
    """Corners a, b, c of sides: a is the origin, b on the x axis, c to the left."""
    x = (ab**2 + ac**2 - bc**2) / (2 * ab)
    return np.array([[0, 0], [ab, 0], [x, np.sqrt(ac**2 - x**2)]])


SIX_MODES = ThreeLegs(np.array([[0, 0], [15.91, 0], [0, 10]]), triangle(17.04, 20.84, 16.54))
SCALENE = ThreeLegs(
    np.array([[0.1, -0.2], [0.9, 0.0], [0.3, 0.7]]), np.array([[-0.1, -0.1], [0.25, -0.05], [0.02, 0.2]])
)
PINNED = SharedPin(np.array([[0.0, 0.0], [0.7, 0.3], [0.9, 0.1]]), 0.35)
PLANAR = {
    "six modes": ThreeLegs(SIX_MODES.base / 20, SIX_MODES.platform / 20),
    "scalene": SCALENE,
    "platform in line": ThreeLegs(SCALENE.base, np.array([[0, 0], [0.3, 0], [0.1, 0]])),
    "base in line": ThreeLegs(np.array([[0, 0], [0.8, 0], [0.5, 0]]), SCALENE.platform),
    "both in line": ThreeLegs(np.array([[0, 0], [0.8, 0], [0.5, 0]]), np.array([[0, 0], [0.3, 0], [0.1, 0]])),
    "alike, turned alike": ThreeLegs(0.6 * CENTRED, 0.2 * CENTRED),
    "alike, turned by 60 degrees": ThreeLegs(0.6 * CENTRED, 0.2 * CENTRED @ SIXTY),
    "alike, turned by half a turn": ThreeLegs(0.6 * CENTRED, -0.2 * CENTRED),
    "two share a pin of the platform": PINNED.legs,
    "two share an anchor": ThreeLegs(np.array([[0, 0], [0, 0], [0.9, 0.1]]), SCALENE.platform),
    "two share an anchor, two a pin": ThreeLegs(PINNED.base[[0, 1, 0]], PINNED.legs.platform[[0, 1, 1]]),
}


def poses_of(legs: ThreeLegs, count: int, seed: int = 0) -> Array:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-0.5, 1.2, (count, 2)), rng.uniform(-PI, PI, count)])


def apart(a: Array, b: Array) -> Array:
    """The largest difference of poses (x, y, angle), whole turns aside."""
    difference = a - b
    difference[..., 2] = (difference[..., 2] + PI) % (2 * PI) - PI
    return np.abs(difference).max(axis=-1)


def differences(function: Callable[[Array], Array], at: Array, step: float = 1e-5) -> Array:
    """Central ones of a function of rows, ``(n, values, columns)``."""
    steps = step * np.eye(at.shape[1])
    return np.stack([(function(at + h) - function(at - h)) / (2 * step) for h in steps], axis=2)


# 2-RPR


def test_two_legs_there_and_back() -> None:
    points = np.random.default_rng(1).uniform([-0.5, -1], [1.3, 1], (DRAWS, 2))
    modes = TWO.direct(TWO.inverse(points))
    assert (modes[:, 0, 1] >= 0).all()
    np.testing.assert_array_equal(modes[:, 1], modes[:, 0] * [1, -1])
    missed = np.linalg.norm(modes - points[:, None], axis=2).min(axis=1)
    assert (missed * TWO.distances(points).parallel).max() < 2e-14


def test_two_legs_matrices_are_derivatives_of_the_closure() -> None:
    points = np.random.default_rng(2).uniform(-1, 1, (50, 2))
    lengths = TWO.inverse(points)
    A, B = TWO.matrices(points)

    def closure(P: Array, rho: Array) -> Array:
        x, y = P.T
        return np.column_stack([x**2 + y**2 - rho[:, 0] ** 2, (x - 0.8) ** 2 + y**2 - rho[:, 1] ** 2])

    np.testing.assert_allclose(A, differences(lambda P: closure(P, lengths), points), atol=1e-9)
    np.testing.assert_allclose(B, differences(lambda rho: closure(points, rho), lengths), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(A), 4 * 0.8 * points[:, 1], atol=1e-14)
    dX = -np.linalg.solve(A, B)  # with the minus, P does follow
    side = np.where(points[:, 1] > 0, 0, 1)
    followed = differences(lambda rho: TWO.direct(rho)[np.arange(50), side], lengths, 1e-7)
    clear = np.abs(points[:, 1]) > 0.1
    np.testing.assert_allclose(dX[clear], followed[clear], atol=1e-6)


def test_two_legs_are_singular_in_line_and_where_one_is_zero() -> None:
    on_line, at_a1, at_a2, square = np.array([[0.3, 0.0], [0, 0], [0.8, 0], [0.4, 0.4]])
    parallel, serial, constraint = TWO.distances(np.array([on_line, at_a1, at_a2, square]))
    np.testing.assert_allclose(parallel, [0, 0, 0, 1], atol=EXACT)
    np.testing.assert_allclose(serial[1:3], 0, atol=0)
    assert serial[0] > 0.3 and serial[3] > 0.5
    np.testing.assert_array_equal(constraint, 1)
    A, B = TWO.matrices(np.array([at_a1, at_a2]))
    np.testing.assert_array_equal(np.linalg.det(B), 0)
    np.testing.assert_array_equal(np.linalg.det(A), 0)


# 3-RPR


def test_the_known_lengths_have_their_six_modes() -> None:
    found = SIX_MODES.direct(np.array([[14.98, 15.38, 12.0]]))[0]
    np.testing.assert_array_equal(
        np.round(found[:, 2], 6), [-0.986974, -0.047331, 0.245310, 0.585673, 1.002039, 2.132904]
    )
    np.testing.assert_allclose(SIX_MODES.inverse(found), [[14.98, 15.38, 12.0]] * 6, rtol=1e-13)


def test_the_modes_are_the_roots_of_the_courses_sextic() -> None:
    """In t = tan(phi / 2), the raw polynomial of degree eight has an exact factor 1 + t^2."""
    (_, a2, a3), (_, b2, b3) = SIX_MODES.base, SIX_MODES.platform
    rho = np.array([14.98, 15.38, 12.0])
    t = np.polynomial.chebyshev.chebpts1(9) * 1.5
    turns = np.moveaxis(np.array([[1 - t**2, -2 * t], [2 * t, 1 - t**2]]) / (1 + t**2), 2, 0)
    v = np.stack([turns @ b2 - a2, turns @ b3 - a3], axis=1)
    c = (rho[1:] ** 2 - rho[0] ** 2 - (v**2).sum(axis=2)) / 2
    D = np.linalg.det(v)
    N = np.stack([c[:, 0] * v[:, 1, 1] - c[:, 1] * v[:, 0, 1], c[:, 1] * v[:, 0, 0] - c[:, 0] * v[:, 1, 0]], axis=1)
    raw = np.polynomial.Polynomial.fit(t, ((N**2).sum(axis=1) - rho[0] ** 2 * D**2) * (1 + t**2) ** 4, 8).convert()
    sextic, rest = divmod(raw, np.polynomial.Polynomial([1, 0, 1]))
    assert np.abs(rest.coef).max() < 1e-10 * np.abs(raw.coef).max()
    phi = np.sort(2 * np.arctan(sextic.roots().real))
    np.testing.assert_allclose(SIX_MODES.direct(rho[None])[0, :, 2], phi, atol=1e-9)
    assert np.abs(sextic.roots().imag).max() < 1e-9


@pytest.mark.parametrize("name", PLANAR)
def test_three_legs_there_and_back(name: str) -> None:
    legs = PLANAR[name]
    poses = poses_of(legs, 1000 if name in ("six modes", "scalene") else 100)
    lengths = legs.inverse(poses)
    modes = legs.direct(lengths)
    there = np.isfinite(modes[..., 0])
    assert (np.diff(there.astype(int), axis=1) <= 0).all()  # NaN only at the end
    assert (np.diff(modes[..., 2], axis=1)[there[:, 1:]] >= 0).all()
    missed = np.nanmin(apart(modes, poses[:, None]), axis=1)
    distance = legs.distances(poses).parallel
    assert (missed * distance).max() < 1e-12
    assert missed[distance > 0.01].max() < 1e-12
    row, place = np.nonzero(there)
    np.testing.assert_allclose(legs.inverse(modes[row, place]), lengths[row], rtol=0, atol=1e-12)
    assert (there.sum(axis=1)[distance > 1e-3] % 2 == 0).all()


def test_modes_at_special_angles_are_found() -> None:
    """Half a turn, where tan(phi / 2) is infinite, and where N and D are zero: all in line, or two legs alike."""
    half = np.column_stack([np.random.default_rng(4).uniform(0, 1, (200, 2)), np.full(200, PI)])
    modes = SCALENE.direct(SCALENE.inverse(half))
    assert np.nanmin(apart(modes, half[:, None]), axis=1).max() < 1e-11 and np.nanmax(np.abs(modes[..., 2])) <= PI
    in_line = PLANAR["both in line"]
    level = half * [1, 1, 0] + [0, 0.1, 0]
    modes = in_line.direct(in_line.inverse(level))
    for mirrored in (level, level * [1, -1, 1]):
        assert np.nanmin(apart(modes, mirrored[:, None]), axis=1).max() < 1e-11
    for other in (1, 2):
        platform = 0.3 * SCALENE.base + [0.1, 0.2]
        platform[other] = platform[0] + SCALENE.base[other] - SCALENE.base[0]
        alike = ThreeLegs(SCALENE.base, platform)  # legs 1 and other are two sides of a parallelogram
        modes = alike.direct(alike.inverse(level))
        clear = alike.distances(level).parallel > 0.05
        assert clear.sum() > 100
        assert np.nanmin(apart(modes, level[:, None]), axis=1)[clear].max() < 1e-11
        assert (np.isfinite(modes[..., 0]).sum(axis=1)[clear] % 2 == 0).all()


def test_modes_that_merge_are_given_once() -> None:
    """At a singular pose two modes are one, and a longer or shorter leg has two or none of them."""
    legs = PLANAR["alike, turned alike"]
    pose = np.array([[0.1, 0.2, 0.0]])
    lengths = legs.inverse(pose)
    near = apart(legs.direct(lengths), pose[:, None]) < 1e-3
    assert near.sum() == 1
    counts = [(apart(legs.direct(lengths + np.array([d, 0, 0])), pose[:, None]) < 0.1).sum() for d in (-1e-4, 1e-4)]
    assert sorted(counts) == [0, 2]


def test_lengths_that_do_not_reach_have_no_mode() -> None:
    impossible = np.array([[0.01, 5.0, 0.01], [-0.5, 0.5, 0.5], [np.nan, 1, 1], [np.nan] * 3])
    assert np.isnan(SCALENE.direct(impossible)).all() and SCALENE.direct(impossible).shape == (4, 6, 3)
    good = SCALENE.inverse(np.array([[0.4, 0.2, 0.3]]))
    together = SCALENE.direct(np.vstack([impossible, good]))  # others change nothing
    np.testing.assert_array_equal(together[4:], SCALENE.direct(good))
    assert SCALENE.direct(np.empty((0, 3))).shape == (0, 6, 3)


@pytest.mark.parametrize("name", PLANAR)
def test_three_legs_matrices_are_derivatives(name: str) -> None:
    legs = PLANAR[name]
    poses = poses_of(legs, 50)
    A, B = legs.matrices(poses)
    np.testing.assert_allclose(A, differences(legs.inverse, poses), atol=1e-7)
    np.testing.assert_array_equal(B, [-np.eye(3)] * 50)


def test_three_legs_are_singular_where_their_lines_meet_or_are_parallel() -> None:
    aims = np.array([[0.3, 1.0], [0.0, 0.0], [5.0, -3.0]])
    base = SCALENE.base
    for aim in aims:
        platform = base + 0.3 * (aim - base) * [[1], [1.5], [0.7]]
        assert ThreeLegs(base, platform).distances(np.zeros((1, 3))).parallel[0] < EXACT
        bent = platform + np.array([[0.1, 0.03], [0, 0], [-0.05, 0.1]])
        assert ThreeLegs(base, bent).distances(np.zeros((1, 3))).parallel[0] > 0.01
    alongside = ThreeLegs(base, base + np.array([[0.2], [0.5], [-0.4]]) * [0.6, 0.8])
    A, _ = alongside.matrices(np.zeros((1, 3)))
    assert alongside.distances(np.zeros((1, 3))).parallel[0] < EXACT and abs(np.linalg.det(A[0])) < EXACT
    zero = ThreeLegs(base, base + np.array([[0, 0], [0.5, 0.1], [0.1, 0.4]])).distances(np.zeros((1, 3)))
    assert zero.serial[0] == 0 and zero.parallel[0] < EXACT


# Exercise 11.5: legs 1 and 3 share a pin


def test_a_shared_pin_has_two_or_four_modes_in_closed_form() -> None:
    poses = poses_of(PINNED.legs, DRAWS, seed=6)
    lengths = PINNED.legs.inverse(poses)
    modes = PINNED.direct(lengths)
    clear = PINNED.legs.distances(poses).parallel > 0.01
    assert np.nanmin(apart(modes, poses[:, None]), axis=1)[clear].max() < 1e-12
    counts = np.isfinite(modes[..., 0]).sum(axis=1)
    assert set(counts) == {2, 4}
    everywhere = np.random.default_rng(7).uniform(0, 1.2, (2000, 3))
    found = PINNED.direct(everywhere)
    assert set(np.isfinite(found[..., 0]).sum(axis=1)) == {0, 2, 4}
    both = np.concatenate([modes[clear][:2000], found]), np.concatenate([lengths[clear][:2000], everywhere])
    general = PINNED.legs.direct(both[1])
    steady = np.nanmin(PINNED.legs.distances(both[0].reshape(-1, 3)).parallel.reshape(-1, 4), axis=1, initial=1) > 1e-3
    assert np.isnan(general[:, 4:]).all()
    np.testing.assert_allclose(general[steady, :4], both[0][steady], atol=1e-10)


def test_the_determinant_of_a_shared_pin_is_a_product() -> None:
    poses = poses_of(PINNED.legs, 1000)
    A, _ = PINNED.legs.matrices(poses)
    np.testing.assert_allclose(np.linalg.det(A), PINNED.determinant(poses), atol=1e-15)
    in_line = np.array([[0.45, 0.05, 0.3]])  # P between anchors 1 and 3
    along = np.array([[0.7 - 0.6 * np.cos(1.0), 0.3 - 0.6 * np.sin(1.0), 1.0]])  # leg 2 in line with the bar
    for pose in (in_line, along):
        assert abs(PINNED.determinant(pose)[0]) < EXACT and PINNED.legs.distances(pose).parallel[0] < EXACT


# Delta


def test_williams_numbers() -> None:
    np.testing.assert_array_equal(
        np.round([FLEX_PICKER.base_radius_m, FLEX_PICKER.platform_radius_m], 6), [0.163679, 0.043879]
    )
    joints = np.degrees(FLEX_PICKER.inverse(np.array([[0, 0, -0.9], [0.3, 0.5, -1.1]])))
    np.testing.assert_array_equal(np.round(joints[:, 0], 3), [[-20.547] * 3, [47.504, -11.569, 21.378]])
    points = FLEX_PICKER.direct(np.radians([[10.0, 20.0, 30.0]]))
    np.testing.assert_array_equal(np.round(points[0, 0], 4), [0.1081, -0.1803, -1.2435])
    assert points[0, 1, 2] > 0


def joints_of(count: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).uniform(np.radians(-40), np.radians(80), (count, 3))


def test_delta_there_and_back() -> None:
    joints = joints_of(DRAWS)
    points = FLEX_PICKER.direct(joints)
    assert np.isfinite(points).all() and (points[:, 0, 2] < points[:, 1, 2]).all()
    found = FLEX_PICKER.inverse(points[:, 0])
    _, serial, _ = FLEX_PICKER.distances(points[:, 0], joints)
    outward = serial > 0.01
    assert outward.mean() > 0.9
    assert np.abs(found - joints[:, None]).min(axis=1)[outward].max() < 1e-12
    assert np.abs(found[:, 0] - joints).max(axis=1)[outward & (joints > 0).all(axis=1)].max() < 1e-12
    for way in range(2):  # the other elbows hold the same point
        back = FLEX_PICKER.direct(found[:, way])
        missed = np.linalg.norm(back - points[:, :1], axis=2).min(axis=1)
        assert (missed * FLEX_PICKER.distances(points[:, 0], found[:, way]).parallel).max() < 1e-12
    elbows = [np.cos(found[:, way]) for way in range(2)]
    assert (elbows[0] >= elbows[1])[outward].all()


def test_delta_knows_what_is_out_of_reach() -> None:
    far = np.array([[0, 0, -1.9], [0, 0, -0.9], [1.5, 0, -0.9]])
    found = FLEX_PICKER.inverse(far)
    assert np.isnan(found[[0, 2]]).any(axis=(1, 2)).all() and np.isfinite(found[1]).all()
    wide = Delta(0.9, 0.1, 0.5, 0.6, AZIMUTHS_RAD)
    assert np.isnan(wide.direct(np.zeros((1, 3)))).all()  # the spheres do not meet
    distances = FLEX_PICKER.distances(far, found[:, 0])
    assert np.isnan(distances.parallel[0]) and np.isfinite(distances.parallel[1])


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 1, 0]])
def test_delta_matrices_are_derivatives(order: list[int]) -> None:
    robot = Delta(0.2, 0.052, 0.3545, 0.8, AZIMUTHS_RAD[order] + 0.4)
    joints = joints_of(50)
    points = robot.direct(joints)[:, 0]
    assert (points[:, 2] < 0).all()
    A, B = robot.matrices(points, joints)
    np.testing.assert_allclose(np.linalg.norm(A, axis=2), 0.8, atol=1e-13)
    parallel = robot.distances(points, joints).parallel > 0.1
    by_differences = differences(lambda q: robot.direct(q)[:, 0], joints)
    np.testing.assert_allclose(np.linalg.solve(A, B)[parallel], by_differences[parallel], atol=1e-7)


def test_delta_is_singular_with_rods_flat_or_parallel() -> None:
    flat = Delta(0.2, 0.05, 0.5, 0.6, AZIMUTHS_RAD)
    joints = np.full((1, 3), np.arccos(0.9))  # 0.15 + 0.5 cos q = 0.6
    points = flat.direct(joints)
    np.testing.assert_allclose(points, [[[0, 0, -0.5 * np.sin(joints[0, 0])]] * 2], atol=1e-7)
    at = np.array([[0, 0, -0.5 * np.sin(joints[0, 0])]])
    assert flat.distances(at, joints).parallel[0] < EXACT
    tucked = np.full((1, 3), np.arccos(-0.15 / 0.5))
    below = np.array([[0, 0, -0.5 * np.sin(tucked[0, 0]) - 0.6]])  # all rods hang straight
    parallel, _, constraint = flat.distances(below, tucked)
    assert parallel[0] < EXACT and constraint[0] < EXACT
    assert np.isnan(flat.direct(tucked)).all()  # the spheres are one
    assert FLEX_PICKER.distances(np.array([[0, 0, -0.9]]), FLEX_PICKER.inverse(np.array([[0, 0, -0.9]]))[:, 0])[0] > 0.3


def test_delta_is_singular_with_an_arm_in_line_with_its_rods() -> None:
    reach = FLEX_PICKER.arm_m + FLEX_PICKER.rod_m
    inward = FLEX_PICKER.base_radius_m - FLEX_PICKER.platform_radius_m
    stretched = np.array([[0, 0, -np.sqrt(reach**2 - inward**2)]])
    found = FLEX_PICKER.inverse(stretched)
    np.testing.assert_allclose(found[:, 0], found[:, 1], atol=1e-6)
    joints = np.full((1, 3), np.arctan2(-stretched[0, 2], -inward))
    assert FLEX_PICKER.distances(stretched, joints).serial[0] < EXACT
    assert np.abs(np.linalg.det(FLEX_PICKER.matrices(stretched, joints)[1]))[0] < EXACT
    np.testing.assert_allclose(found[:, 0], joints, atol=1e-6)
    assert np.isnan(FLEX_PICKER.inverse(stretched - [0, 0, 1e-6])).all()


def six_rods(robot: Delta, points: Array, joints: Array, half_m: float) -> Array:
    """Plücker rows ``(n, 6, 6)`` of two rods a leg about P, half_m to either side along its hip."""
    e = np.column_stack([np.cos(robot.azimuths_rad), np.sin(robot.azimuths_rad), np.zeros(3)])
    hips = np.column_stack([-e[:, 1], e[:, 0], np.zeros(3)])
    out = robot.base_radius_m + robot.arm_m * np.cos(joints)
    elbows = out[..., None] * e - (robot.arm_m * np.sin(joints))[..., None] * [0, 0, 1]
    rows = []
    for side in (half_m, -half_m):
        ends = robot.platform_radius_m * e + side * hips
        rods = points[:, None] + ends - elbows - side * hips
        rows.append(np.concatenate([rods, np.cross(ends, rods)], axis=2))
    return np.concatenate(rows, axis=1) / robot.rod_m


def test_constraint_and_parallel_are_what_locks_all_six_freedoms() -> None:
    joints = joints_of(300, seed=8)
    points = FLEX_PICKER.direct(joints)[:, 0]
    rods, _ = FLEX_PICKER.matrices(points, joints)
    normals = np.cross(rods / 1.244, FLEX_PICKER.hip_axes)
    determinant = np.linalg.det(six_rods(FLEX_PICKER, points, joints, 0.05))
    expected = np.linalg.det(rods / 1.244) * np.linalg.det(normals) * 0.1**3
    np.testing.assert_allclose(np.abs(determinant), np.abs(expected), rtol=1e-9, atol=1e-18)
    constraint = FLEX_PICKER.distances(points, joints).constraint
    np.testing.assert_allclose(constraint, np.linalg.svd(normals, compute_uv=False)[:, -1], atol=EXACT)


# All


def test_grueblers_count() -> None:
    assert mobility(5, [1] * 5, planar=True) == 2  # 2-RPR
    assert mobility(8, [1] * 9, planar=True) == 3  # 3-RPR
    legs = [1, 2, 2] * 3  # a Delta as hinge and two universal joints a leg, the course's "RR"
    assert mobility(8, legs) == 3
    assert mobility(12, [*legs, 1, 2, 1, 2, 1]) == 4  # a motor, the telescopic axis, and the tool in the platform
    assert mobility(11, [1, 2, 2, 3, 3] * 3) == 3  # six rods, a universal and a ball joint each
    assert mobility(2, [1]) == 1 and mobility(1, []) == 0


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: TwoLegs(0.0), "span_m is 0"),
        (lambda: ThreeLegs(np.zeros((2, 2)), CENTRED), "base has shape"),
        (lambda: ThreeLegs(CENTRED, np.full((3, 2), np.nan)), "platform has shape"),
        (lambda: ThreeLegs(CENTRED, np.ones((3, 2))), "turns freely"),
        (lambda: ThreeLegs(CENTRED[[0, 1, 0]], CENTRED[[0, 1, 0]]), "share both ends"),
        (lambda: SharedPin(CENTRED, -1.0), "bar_m is -1"),
        (lambda: SharedPin(CENTRED[[0, 1, 0]], 1.0), "share both ends"),
        (lambda: Delta(0.2, 0.1, 0.0, 1.0, AZIMUTHS_RAD), "arm_m is 0"),
        (lambda: Delta(-0.2, 0.1, 0.5, 1.0, AZIMUTHS_RAD), "base_radius_m"),
        (lambda: Delta(0.2, 0.1, 0.5, 1.0, AZIMUTHS_RAD[:2]), "three angles"),
        (lambda: mobility(3, [6]), "joints of 1 to 5"),
    ],
)
def test_what_cannot_be_is_refused(make: Callable[[], object], says: str) -> None:
    with pytest.raises(LabError, match=says):
        make()
