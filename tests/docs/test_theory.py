"""Formulas of docs/theory are evaluated with numpy and compared with what the code computes."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from helpers.pages import PAGES
from numpy.testing import assert_allclose
from numpy.typing import ArrayLike
from scipy import stats

import lab
from lab.calibration.prior import Prior
from lab.core.linear_model import half_width_95, p_value_of_squares
from lab.core.se3 import exp
from lab.extensions.cameras.geometry import projected
from lab.kinematics.dynamics.beam import MATERIALS, Beam, loads_on, tube
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.dynamics.rigid_body import load_of, pseudo_inertia
from lab.kinematics.effects.arm_with_effects import ArmWithEffects
from lab.kinematics.effects.effect_registry import effect
from lab.kinematics.serial.serial_arm import SerialArm
from lab.noise.instruments import TrackerErrors

THEORY = [page for page in PAGES if page.name.startswith("docs/theory/")]
NUMBERED = re.compile(r"^\$\$.*\$\$ \(([\w-]+)\)$", re.MULTILINE)

CHECKS: dict[str, Callable[[], None]] = {}


def shows(*labels: str) -> Callable[[Callable[[], None]], Callable[[], None]]:
    """Register the check of some formulas."""

    def register(check: Callable[[], None]) -> Callable[[], None]:
        CHECKS.update(dict.fromkeys(labels, check))
        return check

    return register


def test_every_formula_is_numbered_once_and_a_check_is_of_one() -> None:
    found = [label for page in THEORY for label in NUMBERED.findall(page.text)]
    assert len(found) == len(set(found)) and set(CHECKS) <= set(found)


def test_every_source_of_a_page_is_in_the_bibliography() -> None:
    text = next(page for page in THEORY if page.name.endswith("bibliography.md")).text
    entries = [re.sub(r"\s+", " ", each) for each in text.split("\n- ")[1:]]
    for page in THEORY:
        for listed in re.findall(r"^Sources: (.*?)\.$", page.text, re.MULTILINE | re.DOTALL):
            for source in re.sub(r"\s+", " ", listed).split("; "):
                first = re.match(r"(ISO [\d-]+|JCGM \d+|van der \w+|[\w-]+)", source)
                year = re.search(r"\b(19|20)\d\d\b", source)
                assert first and year, source
                assert any(each.startswith(first[0]) and year[0] in each for each in entries), source


RNG = np.random.default_rng(0)


def rot(axis: str, angle: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = exp(angle * np.eye(3)["xyz".index(axis)])
    return matrix


def move(axis: str, length: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = length * np.eye(3)["xyz".index(axis)]
    return matrix


TABLE = np.array([[0, 0.29, 0, -np.pi / 2], [-np.pi / 2, 0, 0.27, 0], [0.1, 0, 0.07, -np.pi / 2]])


@shows("chain", "hayati")
def _() -> None:
    robot = lab.robot_from_dh(TABLE, tool={"p1": [0.03, 0.02, 0.1]})
    values, q, beta = robot.parameter_values(), np.array([0.2, -0.4, 0.6]), 0.01
    values[robot.parameter_names().index("link2.beta")] = beta
    total = np.eye(4)
    for i, (theta, d, a, alpha) in enumerate(TABLE):
        total = total @ rot("z", theta + q[i]) @ move("z", d) @ move("x", a) @ rot("x", alpha)
        total = total @ rot("y", beta if i == 1 else 0.0)
    assert_allclose(robot.points(q, values)[0], (total @ [0.03, 0.02, 0.1, 1])[:3], atol=1e-15)


@shows("null-space", "alias")
def _() -> None:
    robot = lab.load_robot("irb120")
    shown, joints = robot.identifiability(targets=["p1"]), RNG.uniform(-1.5, 1.5, (60, 6))
    columns = robot.parameter_jacobian(joints, targets=["p1"]).reshape(180, -1)
    fitted = columns[:, shown.free]
    for i, name in enumerate(shown.parameters):
        if i in shown.free:
            continue
        share = np.linalg.pinv(fitted) @ columns[:, i]
        assert_allclose(fitted @ share, columns[:, i], atol=1e-9)
        stated = shown.aliases[name]
        for into, factor in zip(shown.identifiable, share, strict=True):
            assert_allclose(stated.get(into, 0.0), factor, atol=1e-6)
        change = np.zeros(len(shown.parameters))
        change[i], change[list(shown.free)] = 1.0, -share
        assert_allclose(columns @ change, 0, atol=1e-9)


def campaign(noise: float = 0.0) -> tuple[lab.Robot, list[int], np.ndarray, np.ndarray, np.ndarray]:
    """An arm with errors: the robot, its free parameters, their true values, joints and measured points."""
    rng = np.random.default_rng(1)
    robot = lab.load_robot("irb120")
    free = list(robot.identifiability(targets=["p1"]).free)
    true = robot.parameter_values(targets=["p1"])
    true[free] += 5e-4 * rng.standard_normal(len(free))
    joints = rng.uniform(-1.5, 1.5, (60, 6))
    exact = robot.points(joints, true, targets=["p1"])
    return robot, free, true, joints, exact + noise * rng.standard_normal(exact.shape)


def identified(noise: float) -> tuple[lab.CalibrationResult, np.ndarray, np.ndarray]:
    """The lab's result, and residuals and derivatives by the free parameters there."""
    robot, free, _, joints, points = campaign(noise)
    result = lab.identify(lab.measurements(joints, points[:, 0], robot=robot, targets=["p1"]), robot=robot)
    residual, jacobian = result.estimate.residuals(joints, points, targets=["p1"])
    return result, residual, jacobian[:, free]


@shows("least-squares", "normal-equations")
def _() -> None:
    robot, free, _, joints, points = campaign(noise=5e-6)
    values = robot.parameter_values(targets=["p1"])
    for _ in range(5):
        residual, jacobian = robot.residuals(joints, points, values, targets=["p1"])
        j = jacobian[:, free] / 1e-3
        values[free] += np.linalg.solve(j.T @ j, -j.T @ residual) / 1e-3
    result, _, gradient_rows = identified(5e-6)
    residual = robot.residuals(joints, points, values, targets=["p1"]).values
    lengths = np.linalg.norm(gradient_rows, axis=0) * np.linalg.norm(residual)
    assert_allclose(gradient_rows.T @ residual / lengths, 0, atol=1e-9)
    own = result.estimate.points(joints, targets=["p1"])
    assert_allclose(robot.points(joints, values, targets=["p1"]), own, atol=1e-11)


@shows("covariance", "noise-estimate")
def _() -> None:
    result, residual, jacobian = identified(5e-6)
    variance = residual @ residual / (len(residual) - jacobian.shape[1])
    covariance = variance * np.linalg.inv(jacobian.T @ jacobian)
    stated = [parameter.std for parameter in result.parameters if parameter.status == "identified"]
    assert_allclose(stated, np.sqrt(np.diag(covariance)), rtol=1e-3)
    assert_allclose(half_width_95(153.0), stats.t.ppf(0.975, 153), rtol=1e-12)


@shows("predicted-error", "floor")
def _() -> None:
    robot, free, _, joints, _ = campaign()
    sigma = 5e-6
    ahead = robot.parameter_jacobian(joints, targets=["p1"])[:, 0][..., free]
    flat = ahead.reshape(-1, len(free))
    covariance = sigma**2 * np.linalg.inv(flat.T @ flat)
    by_hand = ahead @ covariance @ np.swapaxes(ahead, 1, 2)
    planned = robot.planned_covariance(joints, joints, sigma_m=sigma, targets=["p1"])[:, 0]
    assert_allclose(planned, by_hand, rtol=1e-6, atol=1e-18)
    mean = np.trace(planned, axis1=1, axis2=2).mean()
    assert_allclose(mean, sigma**2 * len(free) / len(joints), rtol=1e-9)


@shows("prior")
def _() -> None:
    rows, residual, sigma = RNG.standard_normal((30, 4)), 0.1 * RNG.standard_normal(30), 0.1
    values, mean, tolerance = RNG.standard_normal(4), np.zeros(4), np.array([1.0, 2.0, 0.5, 1.5])
    precision = np.diag(tolerance**-2)
    by_page = np.linalg.solve(
        rows.T @ rows / sigma**2 + precision, -(rows.T @ residual / sigma**2 + precision @ (values - mean))
    )
    right, columns = Prior(mean, (0, 1, 2, 3), np.diag(1 / tolerance)).rows(sigma)(values)
    stacked, sides = np.concatenate([rows, columns]), np.concatenate([-residual, right])
    assert_allclose(by_page, np.linalg.lstsq(stacked, sides, rcond=None)[0], rtol=1e-9)


PLANAR = lab.robot_from_dh([[0, 0, 0.4, 0], [0, 0, 0.3, 0]], tool={"p1": [0, 0, 0]})
UNKNOWN = ["link1.a", "link2.a", "link1.theta", "link2.theta"]


def planar_o1(degrees: ArrayLike) -> float:
    return PLANAR.criteria(np.deg2rad(degrees), parameters=UNKNOWN, scaling="si")["o1"]


@shows("planar-O1")
def _() -> None:
    poses = np.array([[10.0, 30], [40, 60], [-30, 100], [80, 45]])
    c, s = np.cos(np.deg2rad(poses[:, 1])).mean(), np.sin(np.deg2rad(poses[:, 1])).mean()
    assert_allclose(planar_o1(poses), (0.12 * (1 - c**2 - s**2)) ** 0.25, rtol=1e-6)
    assert_allclose(planar_o1(poses), 0.388614, atol=1e-6)  # by hand
    assert_allclose(planar_o1(poses + np.array([[50, 0], [0, 0], [-120, 0], [7, 0]])), planar_o1(poses), rtol=1e-6)
    for spread in ([[0, 0], [9, 120], [5, -120]], [[0, 0], [0, 90], [0, 180], [0, -90]]):
        assert_allclose(planar_o1(spread), 0.12**0.25, rtol=1e-6)
    assert all(planar_o1(RNG.uniform(-180, 180, (4, 2))) < 0.12**0.25 for _ in range(20))
    with pytest.raises(lab.LabError, match="too alike"):
        planar_o1([[0, 40], [30, 40], [60, 40], [90, 40]])


@shows("spherical")
def _() -> None:
    tracker = replace(lab.instrument("leica-at500"), errors=TrackerErrors())  # without those of nest and range
    point = np.array([2.0, -1.0, 0.5])
    reach = np.linalg.norm(point)
    u = point / reach
    along = tracker.radial_m + tracker.radial_per_m * reach
    across = tracker.transverse_m + tracker.transverse_per_m * reach
    printed = along**2 * np.outer(u, u) + across**2 * (np.eye(3) - np.outer(u, u))
    assert_allclose(tracker.covariance(point), printed, rtol=1e-12)


def with_effect(name: str, loads: Loads | None = None) -> tuple[ArmWithEffects, np.ndarray, np.ndarray]:
    """An IRB 120 with one effect: the model, its parameters (the effect's are zero), joint positions."""
    rigid = SerialArm(lab.load_robot("irb120").chain)
    arm = ArmWithEffects(rigid, (effect(name, rigid.chain, loads),))
    return arm, arm.nominal(), np.random.default_rng(5).uniform(-1, 1, (8, 6))


@shows("harmonics")
def _() -> None:
    arm, values, joints = with_effect("harmonics2")
    s, c = (arm.names.index(f"joint2.{name}") for name in ("sin2", "cos2"))
    values[s], values[c] = 3e-4, -2e-4
    moved = joints + (3e-4 * np.sin(2 * joints) - 2e-4 * np.cos(2 * joints)) * np.eye(6)[1]
    rigid = values[: len(arm.rigid.names)]
    assert_allclose(arm.points(joints, values), arm.rigid.points(moved, rigid), atol=1e-13)


@shows("f-test", "pure-error")
def _() -> None:
    squares, extra, left, dof = 8.0, 2, 40.0, 60
    ratio = (squares / extra) / (left / dof)
    assert_allclose(p_value_of_squares(squares, extra, dof, left / dof), stats.f.sf(ratio, extra, dof), rtol=1e-9)


@shows("chi-square")
def _() -> None:
    assert_allclose(p_value_of_squares(180.0, 153), stats.chi2.sf(180.0, 153), rtol=1e-9)


def straight_beam(length: float, mass: float = 0.0) -> Beam:
    return Beam(np.array([[0.0, 0, 0], [length, 0, 0]]), mass, np.array([length / 2, 0, 0]))


@shows("deflection", "slope", "stretch-twist")
def _() -> None:
    length, mass, ei, gj, ea = 0.5, 2.0, 2e4, 1.5e4, 1e7
    force, moment, pull = np.array([40.0, 0.0, -30.0]), np.array([3.0, 5.0, 0.0]), np.array([0.0, 0.0, -9.81])
    torsor = straight_beam(length, mass).torsor(
        loads_on(force, moment, pull), np.array([1 / ei, 1 / ei, 1 / gj, 1 / ea])
    )
    # down is -z: a moment about +y bends the end towards -z
    f, m, w = -force[2], moment[1], mass * 9.81 / length
    deflection = f * length**3 / (3 * ei) + m * length**2 / (2 * ei) + w * length**4 / (8 * ei)
    slope = f * length**2 / (2 * ei) + m * length / ei + w * length**3 / (6 * ei)
    assert_allclose([-torsor[2], torsor[4]], [deflection, slope], rtol=1e-9)
    assert_allclose([torsor[0], torsor[3]], [force[0] * length / ea, moment[0] * length / gj], rtol=1e-9)


@shows("tube")
def _() -> None:
    steel, outer, inner = MATERIALS["steel"], 0.05, 0.046
    second = np.pi / 4 * (outer**4 - inner**4)
    ei_y, ei_z, gj, _ = 1 / tube(2 * outer, outer - inner, steel)
    assert_allclose([ei_y, ei_z, gj], [steel.young_pa * second] * 2 + [steel.shear_pa * 2 * second], rtol=1e-9)


@shows("pseudo-inertia")
def _() -> None:
    phi = load_of(1.5, np.array([0.1, -0.2, 0.3]), np.diag([0.02, 0.03, 0.04]))
    xx, yy, zz, xy, xz, yz = phi[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    printed = np.empty((4, 4))
    printed[:3, :3] = np.trace(inertia) / 2 * np.eye(3) - inertia
    printed[3, :3] = printed[:3, 3] = phi[1:4]
    printed[3, 3] = phi[0]
    assert_allclose(pseudo_inertia(phi), printed, rtol=1e-12)
    assert (np.linalg.eigvalsh(printed) > 0).all()


LENS = np.array([1200.0, 1100.0, 640.0, 480.0, -0.2, 0.05, 0.001, -0.002, 0.01])
SEEN = np.column_stack([RNG.uniform(-0.2, 0.2, (30, 2)), RNG.uniform(0.4, 0.9, 30)])


@shows("brown", "pinhole")
def _() -> None:
    a, b = SEEN[:, 0] / SEEN[:, 2], SEEN[:, 1] / SEEN[:, 2]
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = LENS
    s = a**2 + b**2
    radial = 1 + k1 * s + k2 * s**2 + k3 * s**3
    bent_a = a * radial + 2 * p1 * a * b + p2 * (s + 2 * a**2)
    bent_b = b * radial + p1 * (s + 2 * b**2) + 2 * p2 * a * b
    places, _, by_intrinsics = projected(SEEN, LENS)
    assert_allclose(places, np.column_stack([fx * bent_a + cx, fy * bent_b + cy]), atol=1e-9)
    assert_allclose(by_intrinsics[:, 0, [0, 2, 4]], np.column_stack([bent_a, np.ones(30), fx * a * s]), atol=1e-9)


@pytest.mark.parametrize("label", sorted(CHECKS))
def test_the_formula_agrees_with_the_code(label: str) -> None:
    CHECKS[label]()
