"""Methods on plain arrays: against MuJoCo, differences, textbook formulas and a calibration's own covariance."""

import copy
import pickle
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import lab
from lab.core.errors import LabError
from lab.core.se3 import Array, inverse, transform
from lab.prediction.arm_on_arrays import ArmOnArrays

ROBOT = lab.load_robot("irb120")
JOINTS = ROBOT.chain.random_joints(40, np.random.default_rng(2))


@pytest.fixture(scope="module")
def result() -> lab.CalibrationResult:
    """Of an arm measured with known noise, which the model explains."""
    day = lab.simulate("irb120", poses=50, seed=3)
    return lab.identify(day.measurements, instrument="uniform-8um", prior="off")


def differences(arm: ArmOnArrays, joints: Array, step: float = 1e-6) -> Array:
    """Derivatives ``(n, k, 3, p)`` of the points by central differences."""
    values = arm.parameter_values()
    moved = [
        (arm.points(joints, values + step * unit) - arm.points(joints, values - step * unit)) / (2 * step)
        for unit in np.eye(len(values))
    ]
    return np.stack(moved, axis=-1)


def test_points_are_those_of_mujoco() -> None:
    """In the frame of the robot's base, whose pose in MuJoCo's world is known."""
    day = lab.simulate("irb120", poses=9, seed=1, instrument="exact", position_sigma_mm=0.0, rotation_sigma_mrad=0.0,
                       targets=("p1", "p2"))  # fmt: skip
    frames = lab.world_frames(day)
    expected = transform(inverse(frames.T_world_base) @ frames.T_world_instrument, day.measurements.points)
    found = day.robot.points(day.measurements.joints, targets=("p1", "p2"))
    np.testing.assert_allclose(found, expected, atol=1e-12)
    T = day.robot.poses(day.measurements.joints, target="p2")
    np.testing.assert_allclose(T[:, :3, 3], expected[:, 1], atol=1e-12)
    np.testing.assert_allclose(T[:, :3, :3] @ T[:, :3, :3].swapaxes(1, 2), np.tile(np.eye(3), (9, 1, 1)), atol=1e-12)


@pytest.mark.parametrize("name", ["irb120", "versatran", "delta"])
def test_derivatives_are_differences_of_one_configuration_and_of_many(name: str) -> None:
    robot = lab.load_robot(name)
    joints = robot.chain.random_joints(3, np.random.default_rng(0))
    exact = robot.parameter_jacobian(joints)
    np.testing.assert_allclose(exact, differences(robot, joints), atol=2e-6)
    np.testing.assert_array_equal(robot.parameter_jacobian(joints[1]), exact[1])
    np.testing.assert_array_equal(robot.points(joints[1].tolist()), robot.points(joints)[1])
    first = robot.jacobian(joints)
    rates = 1e-6 * np.eye(joints.shape[1])
    moved = [(robot.points(joints + rate)[:, 0] - robot.points(joints - rate)[:, 0]) / 2e-6 for rate in rates]
    np.testing.assert_allclose(first[:, :3], np.stack(moved, axis=-1), atol=1e-6)
    np.testing.assert_array_equal(robot.jacobian(joints[0]), first[0])


def test_result_and_estimate_name_the_same_parameters_and_predict_the_same(result: lab.CalibrationResult) -> None:
    """What was not identified is nominal in the one and most likely in the other: the points are the same."""
    data, estimate = result.measurements, result.estimate
    assert result.names == estimate.names == tuple(estimate.params)
    assert len(result.names) == len(result.values) == len(estimate.values)
    np.testing.assert_allclose(
        estimate.points(data.joints, result.values), estimate.points(data.joints, estimate.values), rtol=0, atol=1e-9
    )


def test_residuals_leave_out_what_was_not_seen_and_their_jacobian_is_theirs(result: lab.CalibrationResult) -> None:
    data, estimate = result.measurements, result.estimate
    points = data.points.copy()
    points[4, 0, 2] = np.nan
    values = estimate.parameter_values() + 1e-4
    found = estimate.residuals(data.joints, points[:, 0], values)
    assert found.values.shape == (3 * (len(data) - 1),) and found.jacobian.shape == (*found.values.shape, len(values))
    expected = (estimate.points(data.joints, values) - points)[np.isfinite(points).all(axis=2)].ravel()
    np.testing.assert_array_equal(found.values, expected)
    step = np.full(len(values), 1e-7)
    ahead = estimate.residuals(data.joints, points, values + step).values
    np.testing.assert_allclose(ahead - found.values, found.jacobian @ step, atol=1e-12)
    assert np.sqrt(np.mean(estimate.residuals(data.joints, data.points).values ** 2)) < 1e-5


def test_identifiability_is_that_of_inspect_and_of_the_rank() -> None:
    found, inspected = ROBOT.identifiability(targets=["p1"]), lab.inspect("irb120").to_dict()
    assert found.rank == inspected["rank"] and list(found.identifiable) == inspected["identifiable"]
    assert found.condition == pytest.approx(inspected["condition"])
    flat = ROBOT.parameter_jacobian(JOINTS, targets=["p1"]).reshape(-1, len(found.parameters))
    assert np.linalg.matrix_rank(flat / np.maximum(np.linalg.norm(flat, axis=0), 1e-12), tol=1e-8) == found.rank
    for name, into in found.aliases.items():  # an error of a fixed parameter is one of the free ones
        error = np.array([into.get(each, 0.0) for each in found.identifiable])
        column = flat[:, found.parameters.index(name)]
        np.testing.assert_allclose(flat[:, list(found.free)] @ error, column, atol=1e-8)
    few = ROBOT.identifiability(JOINTS[:4], targets=["p1"])
    assert few.rank < found.rank and len(few.singular_values) == few.rank


def test_criteria_are_the_textbook_s() -> None:
    free = list(ROBOT.identifiability(targets=["p1"]).free)
    names = [ROBOT.parameter_names(["p1"])[i] for i in free]
    unit = np.array([1.0 if name.endswith(("theta", "alpha", "beta", "rx", "ry", "rz")) else 1e-3 for name in names])
    stacked = 1e3 * unit * ROBOT.parameter_jacobian(JOINTS, targets=["p1"])[..., free].reshape(-1, len(free))
    s = np.linalg.svd(stacked, compute_uv=False)
    found = ROBOT.criteria(JOINTS, JOINTS[:5], targets=["p1"])
    assert found["o1"] == pytest.approx(np.prod(s ** (1 / len(s))) / np.sqrt(len(JOINTS)), rel=1e-6)
    assert found["o3"] == pytest.approx(s[-1], rel=1e-5) and found["condition"] == pytest.approx(s[0] / s[-1], rel=1e-5)
    assert found["a"] == pytest.approx((1 / s**2).sum(), rel=1e-5)
    covariance = np.linalg.inv(stacked.T @ stacked)
    rows = stacked.reshape(len(JOINTS), 3, -1)[:5]
    variances = np.einsum("nip,pq,niq->n", rows, covariance, rows)
    assert found["g"] == pytest.approx(variances.max(), rel=1e-4) and found["i"] == pytest.approx(
        variances.mean(), rel=1e-4
    )
    assert np.isnan(ROBOT.criteria(JOINTS)["g"])
    halved = ROBOT.criteria(JOINTS, sigma_m=2e-3, scaling="whitened")["o1"]
    assert halved == pytest.approx(ROBOT.criteria(JOINTS, sigma_m=1e-3, scaling="whitened")["o1"] / 2)


def test_criteria_of_chosen_parameters_take_all_others_as_exact() -> None:
    """In SI units they are the textbook's of the columns chosen, by name, by pattern, or by one text."""
    chosen = ["link2.a", "link3.a", "link2.theta", "link3.theta"]
    columns = [ROBOT.parameter_names(["p1"]).index(name) for name in chosen]
    stacked = ROBOT.parameter_jacobian(JOINTS, targets=["p1"])[..., columns].reshape(-1, 4)
    s = np.linalg.svd(stacked, compute_uv=False)
    found = ROBOT.criteria(JOINTS, targets=["p1"], parameters=chosen, scaling="si")
    assert found["o1"] == pytest.approx(np.prod(s) ** (1 / 4) / np.sqrt(len(JOINTS)), rel=1e-6)
    patterns = ["link[23].a", "link[23].theta"]
    assert ROBOT.criteria(JOINTS, targets=["p1"], parameters=patterns, scaling="si")["a"] == found["a"]
    in_mm = ROBOT.criteria(JOINTS, targets=["p1"], parameters=chosen)["o1"]
    assert in_mm == pytest.approx(found["o1"] * np.sqrt(1000))  # two of four are angles
    alone = ROBOT.criteria(JOINTS, targets=["p1"], parameters="link2.a", scaling="si")
    assert alone["o1"] == pytest.approx(np.linalg.norm(stacked[:, 0]) / np.sqrt(len(JOINTS)), rel=1e-6)


def test_the_planned_covariance_is_that_of_the_calibration(result: lab.CalibrationResult) -> None:
    """The fit's own covariance of the parameters, at the measured poses; other joints are predicted worse."""
    estimate, data = result.estimate, result.measurements
    at = ROBOT.chain.random_joints(5, np.random.default_rng(7))
    known = replace(estimate, adequate=True, shared=None, measured=None)
    by_fit = known.predicted_covariance(at)
    planned = estimate.planned_covariance(data.joints, at, sigma_m=estimate.noise_m)
    np.testing.assert_allclose(planned, by_fit, rtol=0.05, atol=1e-13)
    alone = known.predicted_covariance(at[2])  # a product of other shapes: equal but for rounding
    np.testing.assert_allclose(alone, by_fit[2], rtol=1e-12)
    twice = estimate.planned_covariance(np.tile(data.joints, (2, 1)), at[0], sigma_m=estimate.noise_m)
    np.testing.assert_allclose(2 * twice, planned[0], rtol=1e-6)


@pytest.mark.thorough
def test_an_estimate_with_effects_takes_their_conditions_behind_the_joints() -> None:
    soft = lab.calibrate(
        "irb120", poses=30, seed=3, model="compliance",
        effects=lab.Effects(stiffness_nm_per_rad=1e5, payload_kg=(0.0, 3.0)),
    ).estimate  # fmt: skip
    assert soft.inputs()[-1] == "payload_kg" and ROBOT.inputs() == ROBOT.chain.joint_names
    loaded, empty = (soft.points([*JOINTS[0], kg])[0] for kg in (3.0, 0.0))
    assert 1e-5 < np.linalg.norm(loaded - empty) < 1e-2
    assert soft.jacobian([*JOINTS[0], 3.0]).shape == (6, 6)
    with pytest.raises(
        LabError, match=r"joints have shape \(6,\); give \(7,\) or \(..., 7\) finite numbers: .*payload_kg"
    ):
        soft.points(JOINTS[0])


WRONG = {
    "joints": (lambda: ROBOT.points(np.zeros(5)), r"joints have shape \(5,\); give \(6,\) or \(..., 6\)"),
    "number": (lambda: ROBOT.points(0.5), r"joints have shape \(\)"),
    "three axes": (lambda: ROBOT.points(np.zeros((2, 2, 5))), r"joints have shape \(2, 2, 5\)"),
    "one nan of many": (lambda: ROBOT.jacobian(np.where(np.arange(6000) == 17, np.nan, 0.0).reshape(-1, 6)), "finite"),
    "infinite": (
        lambda: ROBOT.parameter_jacobian([0, 0, 0, 0, 0, -np.inf]),
        "^joints: q6 is -inf; give a finite number",
    ),
    "poses": (lambda: ROBOT.inverse(np.eye(3)), r"poses have shape \(3, 3\); give \(4, 4\)"),
    "near": (lambda: ROBOT.inverse(np.tile(np.eye(4), (3, 1, 1)), JOINTS[:2]), "near has 2 rows for 3 poses"),
    "near of five": (lambda: ROBOT.inverse(np.eye(4), [0.0] * 5), r"near have shape \(5,\)"),
    "no closed form": (lambda: lab.load_robot("delta").inverse(np.eye(4)), "no closed form; give near="),
    "nan": (lambda: ROBOT.points([np.nan] * 6), "^joints: q1 is nan; give a finite number"),
    "ragged": (lambda: ROBOT.points([[0.0], [0.0, 1.0]]), "joints: not numbers in rows of one length"),  # type: ignore[list-item]
    "values": (lambda: ROBOT.points(np.zeros(6), [1.0]), r"values have shape \(1,\); give 40 finite numbers"),
    "points": (
        lambda: ROBOT.residuals(JOINTS, np.zeros((40, 3))),
        r"give \(40, 3, 3\): three coordinates of each of p1",
    ),
    "target": (lambda: ROBOT.points(np.zeros(6), targets=["p9"]), "target 'p9' is unknown"),
    "noise": (lambda: ROBOT.criteria(JOINTS, sigma_m=0.0), "sigma_m is 0; give the noise"),
    "few": (
        lambda: ROBOT.planned_covariance(JOINTS[:5], JOINTS, sigma_m=1e-5, targets=["p1"]),
        "joints: 5 poses do not identify 27 parameters, which need 9 poses or more",
    ),
    "few of criteria": (
        lambda: ROBOT.criteria(JOINTS[:5], targets=["p1"]),
        "joints: 5 poses do not identify 27 parameters, which need 9 poses or more",
    ),
    "alike": (lambda: ROBOT.criteria(JOINTS[:1].repeat(30, 0)), "these 30 poses do not identify .* too alike"),
    "degrees": (
        lambda: ROBOT.criteria(np.rad2deg(JOINTS)),
        r"joints: in half of the poses a joint is at \d+ rad or more",
    ),
    "degrees ahead": (
        lambda: ROBOT.planned_covariance(JOINTS, np.rad2deg(JOINTS), sigma_m=1e-5),
        r"at: in half of the poses a joint is at \d+ rad or more; give joints in rad",
    ),
    "no parameter": (lambda: ROBOT.criteria(JOINTS, parameters=["link9.a"]), "parameters link9.a: no such parameter"),
    "none": (lambda: ROBOT.criteria(JOINTS, parameters=[]), "parameters: none is named"),
    "confounded": (
        lambda: ROBOT.criteria(JOINTS, parameters=["base.*", "link1.theta"], targets=["p1"]),
        "parameters: no poses identify all of base.x, .*link1.theta",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_arrays_are_refused_in_a_line(name: str) -> None:
    call, message = WRONG[name]
    with pytest.raises(LabError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_one_target_and_one_pose_are_given_alone(result: lab.CalibrationResult) -> None:
    np.testing.assert_array_equal(ROBOT.points(JOINTS, targets="p1"), ROBOT.points(JOINTS, targets=("p1",)))
    alone, many = result.estimate.predict(JOINTS[0].tolist()), result.estimate.predict(JOINTS[:1])
    np.testing.assert_array_equal(alone.points, many.points)
    np.testing.assert_array_equal(alone.covariance, many.covariance)


@pytest.mark.parametrize("leading", [(), (0,), (5,), (2, 3), (1, 2, 2)])
@pytest.mark.parametrize("name", ["irb120", "delta"])
def test_leading_axes_are_those_of_the_joint_positions(name: str, leading: tuple[int, ...]) -> None:
    robot = lab.load_robot(name)
    rows = robot.chain.random_joints(int(np.prod(leading)), np.random.default_rng(1))
    joints = rows.reshape(*leading, rows.shape[1])
    for method in (robot.points, robot.poses, robot.jacobian, robot.parameter_jacobian):
        many, shaped = method(rows), method(joints)
        assert shaped.shape == (*leading, *many.shape[1:])
        np.testing.assert_array_equal(shaped.reshape(many.shape), many)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["irb120", "ur5e", "scara"])
def test_all_solutions_of_a_pose_reach_it_and_one_is_where_it_was_made(name: str, seed: int) -> None:
    robot = lab.load_robot(name)
    joints = robot.chain.random_joints(12, np.random.default_rng(seed)).reshape(3, 4, -1)
    poses = robot.poses(joints)
    solutions = robot.inverse(poses)
    assert solutions.shape[:2] == (3, 4) and solutions.shape[3] == joints.shape[2]
    there = np.isfinite(solutions).all(axis=-1)
    reached = robot.poses(solutions[there])
    np.testing.assert_allclose(reached, np.broadcast_to(poses[:, :, None], (*there.shape, 4, 4))[there], atol=1e-7)
    turns = np.where(robot.chain.prismatic, 1e9, 2 * np.pi)
    apart = solutions - joints[:, :, None]
    apart = np.abs(apart - turns * np.round(apart / turns)).max(axis=-1)
    assert np.nanmin(apart, axis=-1).max() < 1e-6
    np.testing.assert_array_equal(robot.inverse(poses[1, 2]), solutions[1, 2])


@pytest.mark.parametrize("name", ["irb120", "ur5e", "panda", "delta"])
def test_the_solution_near_joint_positions_is_theirs(name: str) -> None:
    """By the closed form where there is one, else by Newton's method."""
    robot = lab.load_robot(name)
    rng = np.random.default_rng(4)
    joints = robot.chain.home + 0.2 * rng.uniform(-1, 1, (2, 3, robot.chain.size)) * (robot.chain.upper > 0.3)
    joints = joints if name != "delta" else robot.chain.random_joints(6, rng).reshape(2, 3, -1)
    poses = robot.poses(joints)
    close = robot.inverse(poses, joints + 0.01)
    np.testing.assert_allclose(robot.poses(close), poses, atol=1e-8)
    assert np.abs(close - joints).max() < 0.1
    away = poses.copy()
    away[..., 0, 3] += 10.0
    assert np.isnan(robot.inverse(away, joints)).all()


def test_the_inverse_of_an_estimate_meets_its_own_poses(result: lab.CalibrationResult) -> None:
    estimate = result.estimate
    poses = estimate.poses(JOINTS[:5])
    np.testing.assert_allclose(estimate.inverse(poses, JOINTS[:5] + 0.05), JOINTS[:5], atol=1e-6)
    nominal = ROBOT.inverse(poses, JOINTS[:5])
    assert not np.allclose(nominal, JOINTS[:5], atol=1e-6)


def test_the_compiled_arm_is_kept_and_neither_pickled_nor_compared(result: lab.CalibrationResult) -> None:
    for used, at in ((lab.load_robot("irb120"), JOINTS), (result.estimate, JOINTS)):
        fresh = pickle.loads(pickle.dumps(used))
        size = len(pickle.dumps(fresh))
        before = fresh.points(at)
        assert fresh.on_arrays() is fresh.on_arrays() and fresh.on_arrays(["p1"]) is fresh.on_arrays("p1")
        assert len(pickle.dumps(fresh)) == size and fresh == used and hash(fresh) == hash(used)
        again = pickle.loads(pickle.dumps(fresh))
        np.testing.assert_array_equal(again.points(at), before)
        assert replace(fresh) == fresh and copy.deepcopy(fresh) == fresh
    assert ROBOT.arm(("p1",)) is ROBOT.arm(("p1",)) and ROBOT.arm(("p2",)) is not ROBOT.arm(("p1",))


def test_a_result_that_is_written_to_changes_no_later_one() -> None:
    robot = lab.load_robot("irb120")
    values, points = robot.parameter_values(), robot.points(JOINTS[0])
    robot.parameter_values()[:] = 7.0
    robot.points(JOINTS[0])[:] = 7.0
    np.testing.assert_array_equal(robot.parameter_values(), values)
    np.testing.assert_array_equal(robot.points(JOINTS[0]), points)


def test_threads_meet_the_same_arm_at_its_first_use() -> None:
    robot = pickle.loads(pickle.dumps(ROBOT))
    barrier = threading.Barrier(8)

    def first(_: int) -> tuple[int, Array]:
        barrier.wait()
        return id(robot.on_arrays(("p1",))), robot.points(JOINTS, targets=("p1",))

    with ThreadPoolExecutor(8) as pool:
        results = list(pool.map(first, range(8)))
    assert len({kept for kept, _ in results}) == 1
    for _, points in results:
        np.testing.assert_array_equal(points, results[0][1])
