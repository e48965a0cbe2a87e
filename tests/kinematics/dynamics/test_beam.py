"""Beams against closed forms, statics and an integral that knows no formula; the loads on links against Newton."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120, SCARA, TX40, VERSATRAN

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.dynamics.beam import Beam, loads_on
from lab.kinematics.dynamics.gravity import Loads, link_loads
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm

L, EI_Y, EI_Z, GJ, EA = 0.7, 150.0, 90.0, 60.0, 4e4
STIFF = np.array([EI_Y, EI_Z, GJ, EA])
ALONG_X = np.array([[0.0, 0.0, 0.0], [L, 0.0, 0.0]])
ZERO = np.zeros(3)


def straight(mass: float = 0.0, centre: Array = ALONG_X[1] / 2) -> Beam:
    return Beam(ALONG_X, mass, centre)


@pytest.mark.parametrize(
    ("force", "moment", "weight", "expected"),
    [
        ((0, 7, 0), (0, 0, 0), 0, (0, 7 * L**3 / (3 * EI_Z), 0, 0, 0, 7 * L**2 / (2 * EI_Z))),
        ((0, 0, 7), (0, 0, 0), 0, (0, 0, 7 * L**3 / (3 * EI_Y), 0, -7 * L**2 / (2 * EI_Y), 0)),
        ((0, 0, 0), (0, 0, 5), 0, (0, 5 * L**2 / (2 * EI_Z), 0, 0, 0, 5 * L / EI_Z)),
        ((0, 0, 0), (0, 5, 0), 0, (0, 0, -5 * L**2 / (2 * EI_Y), 0, 5 * L / EI_Y, 0)),
        ((0, 0, 0), (5, 0, 0), 0, (0, 0, 0, 5 * L / GJ, 0, 0)),
        ((7, 0, 0), (0, 0, 0), 0, (7 * L / EA, 0, 0, 0, 0, 0)),
        ((0, 0, 0), (0, 0, 0), -3, (0, 0, -3 * L**4 / (8 * EI_Y), 0, 3 * L**3 / (6 * EI_Y), 0)),
    ],
    ids=["force y", "force z", "moment z", "moment y", "twist", "pull", "own weight"],
)
def test_a_cantilever_is_that_of_the_textbook(force, moment, weight, expected) -> None:
    beam = straight(mass=abs(weight) * L)  # N/m under 1 m/s^2
    loads = loads_on(np.array(force, float), np.array(moment, float), np.array([0.0, 0.0, np.sign(weight)]))
    np.testing.assert_allclose(beam.torsor(loads, 1 / STIFF), expected, rtol=1e-12, atol=1e-18)


def integrated(beam: Beam, loads: Array, compliances: Array) -> Array:
    """The far end's torsor by a numeric integral of the curvature that the section's forces make, cut by cut."""
    force, moment, pull, change = loads[:3], loads[3:6], loads[6:9], loads[9:].reshape(3, 3)
    end, density, beside = beam.path[-1], beam.mass_kg / beam.length_m, beam.beside_m
    grid, weights = np.polynomial.legendre.leggauss(12)
    pieces = list(zip(beam.path[:-1], beam.path[1:], strict=True))

    def beyond(piece: int, share: float) -> tuple[Array, Array]:
        """Force and moment on the section at ``share`` of a piece, of all that is beyond."""
        near, far = pieces[piece]
        here = near + share * (far - near)
        f, m = force.copy(), moment + np.cross(end - here, force)
        for other, (a, b) in enumerate(pieces[piece:], start=piece):
            low = share if other == piece else 0.0
            for node, weight in zip(low + (1 - low) * (grid + 1) / 2, (1 - low) * weights / 2, strict=True):
                at = a + node * (b - a)
                part = weight * np.linalg.norm(b - a) * density * (pull + change @ (at + beside - beam.path[0]))
                f, m = f + part, m + np.cross(at + beside - here, part)
        return f, m

    total = np.zeros(6)
    for piece, (near, far) in enumerate(pieces):
        length = np.linalg.norm(far - near)
        x = (far - near) / length
        y = np.cross([0, 0, 1.0], x)
        y = np.array([1.0, 0, 0]) if np.linalg.norm(y) < 1e-9 else y / np.linalg.norm(y)
        axes = np.stack([x, y, np.cross(x, y)])
        for share, weight in zip((grid + 1) / 2, weights / 2, strict=True):
            f, m = beyond(piece, share)
            curved = axes.T @ (axes @ m * [compliances[2], compliances[0], compliances[1]]) * length * weight
            total[3:] += curved
            total[:3] += np.cross(curved, end - near - share * (far - near))
            total[:3] += x * (x @ f) * compliances[3] * length * weight
    return total


def test_any_link_under_any_load_is_the_integral_of_its_curvature() -> None:
    """Straight, bent in an L and in space, its mass beside it, at rest and in motion: all that the formulas add up."""
    rng = np.random.default_rng(0)
    for corners in (2, 3, 4):
        for _ in range(3):
            beam = Beam(rng.normal(size=(corners, 3)), 2.5, rng.normal(size=3))
            loads, compliances = rng.normal(size=18), rng.uniform(0.1, 1, 4)
            expected = integrated(beam, loads, compliances)
            np.testing.assert_allclose(beam.torsor(loads, compliances), expected, rtol=1e-10, atol=1e-12)
    upright = Beam(np.array([ZERO, [0, 0, 0.4]]), 1.0, np.array([0.1, 0.0, 0.3]))
    np.testing.assert_allclose(upright.torsor(loads, compliances), integrated(upright, loads, compliances), rtol=1e-10)


def test_a_path_that_is_none_is_refused() -> None:
    with pytest.raises(LabError, match="give finite points"):
        Beam(np.zeros((1, 3)), 1.0, ZERO)
    with pytest.raises(LabError, match="are the same"):
        Beam(np.zeros((2, 3)), 1.0, ZERO)
    assert IRB120.loads is not None
    with pytest.raises(LabError, match="path of link 2: it runs from 0, 0, 0 to 270, 0, 0 mm"):
        link_loads(replace(IRB120.loads, link_paths={1: ALONG_X}))


def random_loads(chain: Chain, rng: np.random.Generator) -> Loads:
    places = rng.normal(0, 0.1, (chain.size, 3))
    return Loads(chain, rng.uniform(1, 5, chain.size), places, rng.normal(0, 9.81, 3), rng.normal(0, 0.1, 3))


@pytest.mark.parametrize("chain", [IRB120.chain, TX40, SCARA, VERSATRAN], ids=lambda chain: chain.name)
def test_loads_on_links_are_what_the_links_beyond_weigh(chain: Chain) -> None:
    """Moments about the joints' axes are gravity's generalized forces; the table says where links end."""
    rng = np.random.default_rng(4)
    loads, joints = random_loads(chain, rng), chain.random_joints(5, rng)
    links, payload = link_loads(loads), rng.uniform(0, 3, 5)
    found, placed = links.at_rest(joints, payload), loads.frames(joints)
    force = loads.forces(joints, payload)[0]
    for j in range(chain.size - 1):
        world = [(placed.rotations[:, j] @ found[:, j, part, None])[..., 0] for part in (slice(3), slice(3, 6))]
        axis, slides = placed.axes[:, j + 1], chain.prismatic[j + 1]
        np.testing.assert_allclose((axis * world[0 if slides else 1]).sum(axis=1), force[:, j + 1], atol=1e-10)
    still = np.zeros_like(joints)
    np.testing.assert_allclose(links.moving(joints, still, still, payload), found, atol=1e-12)


@pytest.mark.parametrize("chain", [IRB120.chain, TX40, SCARA, VERSATRAN], ids=lambda chain: chain.name)
def test_loads_in_motion_are_those_of_newton(chain: Chain) -> None:
    """Forces and moments by second differences of where the masses are, each link a line of points, or one point."""
    rng = np.random.default_rng(5)
    loads, h = random_loads(chain, rng), 1e-4
    links = link_loads(loads)
    q, v, a = chain.random_joints(1, rng), rng.normal(size=(1, chain.size)), rng.normal(size=(1, chain.size))
    found = links.moving(q, v, a, np.array([2.0]))[0]
    times = np.array([-h, 0.0, h])[:, None]
    placed = loads.frames(q + v * times + a * times**2 / 2)
    far = [placed.end if j == chain.size - 1 else placed.anchors[:, j + 1] for j in range(chain.size)]
    masses: list[tuple[float, Array]] = [(2.0, placed.payload)]
    grid, weights = np.polynomial.legendre.leggauss(3)
    for j in reversed(range(chain.size)):
        force, moment = np.zeros(3), np.zeros(3)
        for mass, points in masses:
            pull = mass * (loads.gravity - (points[2] - 2 * points[1] + points[0]) / h**2)
            force, moment = force + pull, moment + np.cross(points[1] - far[j][1], pull)
        turn = placed.rotations[1, j]
        expected = np.concatenate([turn.T @ force, turn.T @ moment])
        np.testing.assert_allclose(found[j, :6], expected, atol=2e-4)
        if j not in links.beams:
            masses.append((loads.mass_kg[j], placed.centres[:, j]))
            continue
        beam = links.beams[j]
        for node, weight in zip((grid + 1) / 2, weights / 2, strict=True):
            local = node * beam.path[1] + beam.beside_m
            near = far[j] - placed.rotations[:, j] @ links.ends[j]
            masses.append((weight * beam.mass_kg, near + placed.rotations[:, j] @ local))


def test_t_flex_stands_where_the_source_has_it() -> None:
    """Benmisra 2007, eq. 3.22: Trans(x, L) T_flex Rot(x, alpha) Rot(z, theta), with T_flex = Rot Trans; both tables."""
    rng = np.random.default_rng(6)
    for chain in (IRB120.chain, TX40):
        arm = SerialArm(chain)
        q, values = chain.random_joints(3, rng), arm.nominal()
        torsors = {link: 1e-2 * rng.normal(size=(3, 6)) for link in (1, 3, 5)}
        T = np.tile(np.eye(4), (3, 1, 1))
        rows, distal = chain.table, chain.convention == "distal"
        for i, (theta, d, a, alpha, beta) in enumerate(rows):
            if not distal:
                T = T @ slid(0, a) @ flex(torsors, i - 1) @ turned(0, alpha) @ turned(1, beta)
            T = T @ np.stack([turned(2, theta + each) for each in q[:, i]]) @ slid(2, d)
            if distal:
                T = T @ slid(0, a) @ flex(torsors, i) @ turned(0, alpha) @ turned(1, beta)
        T = T if distal else T @ flex(torsors, chain.size - 1)
        expected = (T @ np.append(values[-3:], 1.0))[:, :3]
        np.testing.assert_allclose(arm.points(q, values, torsors)[:, 0], expected, atol=1e-14)
        np.testing.assert_allclose(arm.tool(q, values, 0, torsors)[0][:, :3, :3], T[:, :3, :3], atol=1e-14)


def flex(torsors: dict[int, Array], link: int) -> Array:
    if link not in torsors:
        return np.eye(4)
    rotation = se3.pose(se3.exp(torsors[link][:, 3:]), np.zeros((3, 3)))
    rotation[:, :3, 3] = (rotation[:, :3, :3] @ torsors[link][:, :3, None])[..., 0]
    return rotation


def turned(axis: int, angle: float) -> Array:
    return se3.pose(se3.exp(angle * np.eye(3)[axis]), ZERO)


def slid(axis: int, length: float) -> Array:
    return se3.pose(np.eye(3), length * np.eye(3)[axis])
