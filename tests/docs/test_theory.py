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
from scipy.linalg import expm

import lab
from lab.calibration.prior import Prior
from lab.core.linear_model import LinearModel, half_width_95, p_value_of_squares
from lab.core.probability import Uncertain
from lab.core.se3 import exp, left_jacobian, log, pose, skew
from lab.kinematics.dynamics.beam import MATERIALS, Beam, loads_on, tube
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.dynamics.rigid_body import HandMotion, load_of, pseudo_inertia, wrench_regressor
from lab.kinematics.effects.arm import ArmWithEffects
from lab.kinematics.effects.registry import effect
from lab.kinematics.serial.arm import SerialArm
from lab.noise.correlation import Correlation
from lab.noise.instruments import TrackerErrors
from lab.pose_selection.criteria import criterion, indices
from lab.pose_selection.exchange import certify
from lab.sensors.cameras.closed_forms import hand_eye, robot_world
from lab.sensors.cameras.geometry import projected

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
LINK = {"theta": 0.3, "d": 0.4, "a": 0.5, "alpha": 0.6}


def rot(axis: str, angle: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = exp(angle * np.eye(3)["xyz".index(axis)])
    return matrix


def move(axis: str, length: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = length * np.eye(3)["xyz".index(axis)]
    return matrix


def one_link(convention: str) -> np.ndarray:
    """The pose of a robot of one hinge whose reading is zero, by the lab."""
    table = [[LINK["theta"], LINK["d"], LINK["a"], LINK["alpha"]]]
    robot = lab.robot_from_dh(table, convention=convention, tool={"p1": [0, 0, 0]})
    return robot.poses([0.0])


@shows("distal")
def _() -> None:
    t, d, a, al = LINK.values()
    c, s, ca, sa = np.cos(t), np.sin(t), np.cos(al), np.sin(al)
    printed = np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])
    assert_allclose(printed, rot("z", t) @ move("z", d) @ move("x", a) @ rot("x", al), atol=1e-15)
    assert_allclose(one_link("distal"), printed, atol=1e-15)


@shows("craig")
def _() -> None:
    t, d, a, al = LINK.values()
    c, s, ca, sa = np.cos(t), np.sin(t), np.cos(al), np.sin(al)
    printed = np.array([[c, -s, 0, a], [s * ca, c * ca, -sa, -d * sa], [s * sa, c * sa, ca, d * ca], [0, 0, 0, 1]])
    assert_allclose(printed, rot("x", al) @ move("x", a) @ rot("z", t) @ move("z", d), atol=1e-15)
    assert_allclose(one_link("craig"), printed, atol=1e-15)


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


@shows("rodrigues")
def _() -> None:
    for w in (np.array([0.3, -0.5, 0.9]), np.array([2.0, 1.0, -1.0])):
        size = np.linalg.norm(w)
        printed = np.eye(3) + np.sin(size) / size * skew(w) + (1 - np.cos(size)) / size**2 * skew(w) @ skew(w)
        assert_allclose(exp(w), printed, atol=1e-14)
        assert_allclose(expm(skew(w)), printed, atol=1e-14)


@shows("left-jacobian")
def _() -> None:
    w = np.array([0.3, -0.5, 0.9])
    size, cross = np.linalg.norm(w), skew(w)
    printed = np.eye(3) + (1 - np.cos(size)) / size**2 * cross + (size - np.sin(size)) / size**3 * cross @ cross
    assert_allclose(left_jacobian(w), printed, atol=1e-14)
    change = 1e-6 * np.array([0.2, 0.5, -0.4])
    assert_allclose(exp(w + change) @ exp(w).T - np.eye(3), skew(printed @ change), atol=1e-11)


@shows("joint-column")
def _() -> None:
    robot = lab.robot_from_dh(TABLE, tool={"p1": [0.03, 0.02, 0.1]})
    q, frame = np.array([0.2, -0.4, 0.6]), np.eye(4)
    point = robot.points(q)[0]
    for i, (theta, d, a, alpha) in enumerate(TABLE):
        column = np.cross(frame[:3, 2], point - frame[:3, 3])
        assert_allclose(robot.jacobian(q)[:, i], np.concatenate([column, frame[:3, 2]]), atol=1e-14)
        frame = frame @ rot("z", theta + q[i]) @ move("z", d) @ move("x", a) @ rot("x", alpha)
    slide = lab.robot_from_dh(
        TABLE, tool={"p1": [0.03, 0.02, 0.1]}, prismatic=[True, False, False], limits=[[0, 1], [-3, 3], [-3, 3]]
    )
    assert_allclose(slide.jacobian(q)[:, 0], [0, 0, 1, 0, 0, 0], atol=1e-15)


@shows("parameter-columns")
def _() -> None:
    robot = lab.robot_from_dh(TABLE, tool={"p1": [0.03, 0.02, 0.1]})
    q, before = np.array([0.2, -0.4, 0.6]), np.eye(4)
    point, names = robot.points(q)[0], robot.parameter_names()
    found = robot.parameter_jacobian(q)[0]
    for i, (theta, d, a, alpha) in enumerate(TABLE, 1):
        after = before @ rot("z", theta + q[i - 1]) @ move("z", d) @ move("x", a) @ rot("x", alpha)
        z, x, y, lever = before[:3, 2], after[:3, 0], after[:3, 1], point - after[:3, 3]
        columns = {"theta": np.cross(z, point - before[:3, 3]), "d": z, "a": x, "alpha": np.cross(x, lever)}
        if i == 2:
            columns["beta"] = np.cross(y, lever)
        for name, column in columns.items():
            assert_allclose(found[:, names.index(f"link{i}.{name}")], column, atol=1e-14)
        before = after


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


@shows("count-points")
def _() -> None:
    for name, hinges, slides in (("irb120", 6, 0), ("scara", 3, 1), ("versatran", 4, 2)):
        for count in (1, 2):
            targets = [f"p{k + 1}" for k in range(count)]
            assert lab.load_robot(name).identifiability(targets=targets).rank == 4 * hinges + 2 * slides + 3 * count


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


@shows("conditioning")
def _() -> None:
    rows, residual = RNG.standard_normal((40, 5)) * [1, 1, 1, 1, 1e-3], RNG.standard_normal(40)
    q, r = np.linalg.qr(rows)
    assert_allclose(np.linalg.cond(r), np.linalg.cond(rows), rtol=1e-9)
    assert_allclose(np.linalg.cond(rows.T @ rows), np.linalg.cond(rows) ** 2, rtol=1e-6)
    assert_allclose(-np.linalg.solve(r, q.T @ residual), LinearModel.of(rows, 1e-12).solve(-residual), rtol=1e-9)


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


def example_rows() -> np.ndarray:
    return RNG.standard_normal((9, 3, 4)) * [1.0, 0.7, 0.4, 0.2]


@shows("O1", "O234", "O5", "D-and-E", "A")
def _() -> None:
    rows = example_rows()
    flat = rows.reshape(-1, 4)
    s = np.linalg.svd(flat, compute_uv=False)
    found, information = indices(rows), flat.T @ flat
    assert_allclose(found.o1, np.prod(s) ** (1 / 4) / np.sqrt(9), rtol=1e-12)
    assert_allclose([found.o2, found.o3, found.o4], [s[-1] / s[0], s[-1], s[-1] ** 2 / s[0]], rtol=1e-12)
    assert_allclose(found.o5, 1 / np.sum(1 / s), rtol=1e-12)
    assert_allclose(np.linalg.det(information), (found.o1 * np.sqrt(9)) ** (2 * 4), rtol=1e-9)
    assert_allclose(np.linalg.eigvalsh(information)[0], found.o3**2, rtol=1e-9)
    assert_allclose(found.a, np.sum(1 / s**2), rtol=1e-9)
    assert_allclose(found.a, np.trace(np.linalg.inv(information)), rtol=1e-9)


@shows("scale-free")
def _() -> None:
    rows, scale = example_rows(), np.array([1.0, 1e3, 2.0, 5.0])
    assert_allclose(indices(rows * scale).o1 / indices(rows).o1, np.prod(scale) ** (1 / 4), rtol=1e-12)


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


@shows("exchange")
def _() -> None:
    rows = example_rows()
    flat, further = rows.reshape(-1, 4), RNG.standard_normal((3, 4))
    information = flat.T @ flat
    gain = np.linalg.slogdet(np.eye(3) + further @ np.linalg.inv(information) @ further.T)[1]
    grown = np.linalg.slogdet(information + further.T @ further)[1]
    assert_allclose(grown, np.linalg.slogdet(information)[1] + gain, rtol=1e-12)
    goal = criterion("O1", 4)
    scores = goal.score(np.stack([information, information + further.T @ further]))
    assert np.diff(scores)[0] > 0  # the lab's score ranks by the same determinant


@shows("certificate")
def _() -> None:
    candidates = RNG.standard_normal((60, 3, 4))
    weights = RNG.dirichlet(np.ones(60))
    each = np.swapaxes(candidates, 1, 2) @ candidates
    information = np.einsum("i,ijk->jk", weights, each)
    gains = np.trace(np.linalg.inv(information) @ each, axis1=1, axis2=2)
    bound = np.linalg.slogdet(information)[1] + 4 * np.log(gains.max() / 4)
    best = certify(candidates, gap=1e-6)
    optimum = np.einsum("i,ijk->jk", best.weights, each)
    assert np.linalg.slogdet(optimum)[1] <= bound
    assert_allclose(np.trace(np.linalg.inv(optimum) @ each, axis1=1, axis2=2).max(), 4, rtol=1e-5)


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


@shows("rectangular", "limits")
def _() -> None:
    for shape, root in (("rectangular", 3), ("triangular", 6), ("arcsine", 2)):
        assert_allclose(Uncertain.within(2.0, shape).standard, 2.0 / np.sqrt(root), rtol=1e-12)
    assert_allclose(lab.instrument("uniform-8um").radial_m, 8e-6 / np.sqrt(3), rtol=1e-3)


def correlation(carry: float, size: float, poses: int) -> Correlation:
    """One number a pose, with an autoregressive error of some size beside white noise of size one."""
    none = np.zeros((poses, 1, 0))
    return Correlation(none, np.full((poses, 1, 1), size), carry, none, np.arange(float(poses)))


@shows("joint-scatter")
def _() -> None:
    joints = RNG.standard_normal((5, 3, 2))
    none = np.zeros((5, 3, 0))
    whitened = Correlation(joints, none, 0.0, none, np.arange(5.0)).white(np.broadcast_to(np.eye(3), (5, 3, 3)))
    for root, moved in zip(whitened, joints, strict=True):
        assert_allclose(root @ (np.eye(3) + moved @ moved.T) @ root.T, np.eye(3), atol=1e-12)


@shows("ar1")
def _() -> None:
    rho, size, poses = 0.8, 2.0, 12
    root = correlation(rho, size, poses).white(np.eye(poses)[:, None, :])[:, 0]
    lag = np.abs(np.subtract.outer(np.arange(poses), np.arange(poses)))
    assert_allclose(root @ (np.eye(poses) + size**2 * rho**lag) @ root.T, np.eye(poses), atol=1e-12)


def with_effect(name: str, loads: Loads | None = None) -> tuple[ArmWithEffects, np.ndarray, np.ndarray]:
    """An IRB 120 with one effect: the model, its parameters (the effect's are zero), joint positions."""
    rigid = SerialArm(lab.load_robot("irb120").chain)
    arm = ArmWithEffects(rigid, (effect(name, rigid.chain, loads),))
    return arm, arm.nominal(), np.random.default_rng(5).uniform(-1, 1, (8, 6))


@shows("compliance")
def _() -> None:
    assert_allclose(1e6 * 9.81 / 1e5, 98.1, rtol=1e-3)  # urad, as the page states
    chain = lab.load_robot("irb120").chain
    mass, centres = np.array([0, 0, 2.0, 0, 0, 0]), np.zeros((6, 3))  # at the end of link 3
    arm, values, joints = with_effect("compliance", Loads(chain, mass, centres, np.array([0, 0, -9.81])))
    compliance = 1e-7
    values[arm.names.index("joint3.compliance")] = compliance
    plain, nominal = arm.rigid, arm.nominal()[: len(arm.rigid.names)]
    # the weight's torque about joint 3, by the height of the mass
    lifted = plain.frame(joints + 1e-6 * np.eye(6)[2], nominal, 3)[:, 2, 3]
    lowered = plain.frame(joints - 1e-6 * np.eye(6)[2], nominal, 3)[:, 2, 3]
    torque = 2.0 * 9.81 * (lifted - lowered) / 2e-6
    moved = joints - compliance * torque[:, None] * np.eye(6)[2]
    unloaded = np.column_stack([joints, np.zeros(8)])
    assert_allclose(arm.points(unloaded, values), plain.points(moved, nominal), atol=1e-9)


@shows("harmonics")
def _() -> None:
    arm, values, joints = with_effect("harmonics2")
    s, c = (arm.names.index(f"joint2.{name}") for name in ("sin2", "cos2"))
    values[s], values[c] = 3e-4, -2e-4
    moved = joints + (3e-4 * np.sin(2 * joints) - 2e-4 * np.cos(2 * joints)) * np.eye(6)[1]
    rigid = values[: len(arm.rigid.names)]
    assert_allclose(arm.points(joints, values), arm.rigid.points(moved, rigid), atol=1e-13)


@shows("expansion")
def _() -> None:
    arm, values, joints = with_effect("expansion")
    steel, warmer = 11.5e-6, 10.0
    values[-1] = steel
    rigid = values[: len(arm.rigid.names)]
    grown = (1 + steel * warmer) * arm.rigid.points(joints, rigid)  # all lengths grow alike, angles stay
    inputs = np.column_stack([joints, np.full(8, 20.0 + warmer)])
    assert_allclose(arm.points(inputs, values), grown, atol=1e-12)


@shows("f-test", "pure-error")
def _() -> None:
    squares, extra, left, dof = 8.0, 2, 40.0, 60
    ratio = (squares / extra) / (left / dof)
    assert_allclose(p_value_of_squares(squares, extra, dof, left / dof), stats.f.sf(ratio, extra, dof), rtol=1e-9)


@shows("chi-square")
def _() -> None:
    assert_allclose(p_value_of_squares(180.0, 153), stats.chi2.sf(180.0, 153), rtol=1e-9)


@shows("wanted", "newton", "sent")
def _() -> None:
    robot = lab.load_robot("irb120")
    nominal = robot.parameter_values(targets=["p1"])
    real = nominal + 5e-4 * np.random.default_rng(2).standard_normal(len(nominal))
    planned = np.deg2rad([10, 20, 30, 40, 50, 60])
    wanted, joints = robot.poses(planned, target="p1"), planned.copy()
    for _ in range(5):
        there = robot.poses(joints, real, target="p1")
        turn = wanted[:3, :3] @ there[:3, :3].T
        angle = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        missed = np.concatenate([wanted[:3, 3] - there[:3, 3], angle])
        joints = joints + np.linalg.solve(robot.jacobian(joints, target="p1"), missed)
    assert_allclose(robot.poses(joints, real, target="p1"), wanted, atol=1e-12)
    assert np.linalg.norm(robot.poses(joints, target="p1")[:3, 3] - wanted[:3, 3]) > 1e-4  # what is sent differs


@shows("closure", "two-rpr", "loop-jacobian")
def _() -> None:
    robot = lab.load_robot("rpr2")
    values, names = robot.parameter_values(targets=["p1"]), robot.parameter_names(targets=["p1"])
    base = values[names.index("A2.x")] - values[names.index("A1.x")]
    joints = np.array([[0.5, 0.45], [0.4, 0.6]])
    x = (joints[:, 0] ** 2 - joints[:, 1] ** 2 + base**2) / (2 * base)
    y = np.sqrt(joints[:, 0] ** 2 - x**2)
    points = robot.points(joints, values, targets=["p1"])[:, 0]
    assert_allclose(np.abs(points[:, :2]), np.column_stack([x, y]), atol=1e-12)
    found = robot.parameter_jacobian(joints, values, targets=["p1"])[:, 0]
    # by the formula: closures (x - A1)^2 + (y - A1)^2 - rho^2 of both legs, the point itself is passive
    sign = np.sign(points[0, 1])
    for i, (rho1, rho2) in enumerate(joints):
        at = np.array([x[i], sign * y[i]])
        by_point = 2 * np.stack([at, at - [base, 0]])
        by_parameters = np.zeros((2, len(names)))
        by_parameters[0, [names.index("A1.x"), names.index("A1.y")]] = -2 * at
        by_parameters[1, [names.index("A2.x"), names.index("A2.y")]] = -2 * (at - [base, 0])
        by_parameters[0, names.index("leg1.length")] = -2 * rho1
        by_parameters[1, names.index("leg2.length")] = -2 * rho2
        own = [k for k in range(len(names)) if not names[k].startswith(("base.", "tool."))]
        printed = -np.linalg.solve(by_point, by_parameters)  # H_p = 0, H_z = 1
        assert_allclose(found[i, :2][:, own], printed[:, own], atol=1e-9)


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


@shows("linear-in-masses", "newton-euler", "steiner")
def _() -> None:
    mass, centre, about_centre = 1.5, np.array([0.1, -0.2, 0.3]), np.diag([0.02, 0.03, 0.04])
    phi = load_of(mass, centre, about_centre)
    inertia = about_centre + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    elements = [inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    assert_allclose(phi, [mass, *(mass * centre), *elements], rtol=1e-12)
    omega, alpha, acceleration = RNG.standard_normal((3, 3))
    gravity = np.array([0, 0, -9.81])
    motion = HandMotion(np.eye(3)[None], omega[None], alpha[None], acceleration[None])
    found = wrench_regressor(motion, gravity)[0] @ phi
    felt = acceleration - gravity
    force = mass * felt + (skew(alpha) + skew(omega) @ skew(omega)) @ (mass * centre)
    moment = np.cross(mass * centre, felt) + inertia @ alpha + np.cross(omega, inertia @ omega)
    assert_allclose(found, np.concatenate([force, moment]), rtol=1e-12)


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


@shows("combined")
def _() -> None:
    reading, scale, length = 5e-6, 10e-6, 0.6
    drawn = reading * RNG.standard_normal(400_000) + length * Uncertain.within(scale).sample(RNG, 400_000)
    assert_allclose(drawn.std(), np.hypot(reading, length * scale / np.sqrt(3)), rtol=0.01)


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


def pictures(noise: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Poses A of the hand and B of the camera in the board's frame, and the true X and Z."""
    X, Z = (pose(exp(np.array(turn)), np.array(place)) for turn, place in
            (((0.1, -0.2, 0.3), (0.06, 0.0, 0.04)), ((3.0, 0.1, 0.2), (0.45, 0.1, 0.0))))  # fmt: skip
    As = pose(exp(RNG.normal(0, 0.8, (12, 3))), RNG.uniform(-0.5, 0.5, (12, 3)))
    Bs = np.linalg.inv(Z) @ As @ X
    Bs[:, :3, 3] += noise * RNG.standard_normal((12, 3))
    return As, Bs, X, Z


@shows("robot-world", "kronecker", "places")
def _() -> None:
    As, Bs, X, Z = pictures()
    assert_allclose(As @ X, Z @ Bs, atol=1e-12)
    summed = sum(np.kron(A[:3, :3], B[:3, :3]) for A, B in zip(As, Bs, strict=True))
    assert_allclose(summed @ X[:3, :3].ravel(), 12 * Z[:3, :3].ravel(), atol=1e-12)
    assert_allclose(np.linalg.svd(summed, compute_uv=False)[0], 12.0)
    assert_allclose(As[:, :3, :3] @ X[:3, 3] - Z[:3, 3], Bs[:, :3, 3] @ Z[:3, :3].T - As[:, :3, 3], atol=1e-12)
    for found, true in zip(robot_world(As, Bs), (X, Z), strict=True):
        assert_allclose(found, true, atol=1e-9)


@shows("hand-eye")
def _() -> None:
    As, Bs, X, _ = pictures()
    A, B = np.linalg.inv(As[1]) @ As[0], np.linalg.inv(Bs[1]) @ Bs[0]
    assert_allclose(A @ X, X @ B, atol=1e-12)
    assert_allclose(log(A[:3, :3]), X[:3, :3] @ log(B[:3, :3]), atol=1e-12)
    assert_allclose(hand_eye(As, Bs), X, atol=1e-9)


@pytest.mark.parametrize("label", sorted(CHECKS))
def test_the_formula_agrees_with_the_code(label: str) -> None:
    CHECKS[label]()
