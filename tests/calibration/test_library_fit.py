"""lab.fit: the estimate of an identification, of one campaign or many, without a judgement."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120

import lab
from lab.core.measurements import Measurements, measured
from lab.core.values import Deferred, DeferredField, same
from lab.kinematics.gauge import base_set

SIGMA_M = 8e-6


def campaign(seed: int = 0, poses: int = 50, sigma_m: float = SIGMA_M, targets: tuple[str, ...] = ("p1",)):
    """An arm off by 0.5 mm and mrad, seen from a base that nobody knows; its parameters and its measurements."""
    rng = np.random.default_rng(seed)
    arm = IRB120.arm(targets)
    values = arm.nominal(IRB120.tool)
    kept = list(base_set(arm, values).identifiable)
    values[kept] += 5e-4 * rng.normal(size=len(kept))
    values[:6] = rng.normal(size=6)
    joints = IRB120.chain.random_joints(poses, rng)
    points = arm.points(joints, values)
    data = measured(IRB120.chain.joint_names, joints, targets, points + sigma_m * rng.standard_normal(points.shape))
    return dict(zip(arm.names, values, strict=True)), replace(data, robot=IRB120.source)


def data_of(seed: int = 0, **options: object) -> Measurements:
    return campaign(seed, **options)[1]  # type: ignore[arg-type]


def assert_same(one: lab.Estimate, other: lab.Estimate, rtol: float = 0.0) -> None:
    assert one.identified == other.identified and one.dof == other.dof
    std = np.sqrt(np.diag(other.covariance))
    index = [row.name for row in one.rows]
    assert index == [row.name for row in other.rows]
    for name, sigma in zip(one.identified, std, strict=True):
        assert abs(one.params[name].value - other.params[name].value) <= rtol * sigma
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=max(rtol, 1e-15))
    np.testing.assert_allclose(one.values, other.values, rtol=0, atol=max(rtol * std.min(), 0.0))


@pytest.mark.parametrize(
    "options",
    [{}, {"prior": "on"}, {"fix": ("link3.d",), "free": ("link2.d",)}],
    ids=str,
)
def test_it_is_the_estimate_of_an_identification_that_widens_nothing(options: dict[str, object]) -> None:
    data = data_of()
    result = lab.identify(data, robot=IRB120, noise_mm=0.008, **options)
    assert not result.estimate.cluster_robust and result.estimate.shared is None
    assert_same(lab.fit(data, robot=IRB120, noise_mm=0.008, **options), result.estimate)


def test_with_effects_and_several_targets_too() -> None:
    day = lab.simulate(
        IRB120, poses=40, seed=3, targets=("p1", "p2"), effects=lab.Effects(stiffness_nm_per_rad=1e5)
    ).measurements
    options = {"model": "compliance", "instrument": "uniform-8um"}
    assert_same(lab.fit(day, IRB120, **options), lab.identify(day, IRB120, **options).estimate)


def test_parameters_are_recovered_without_noise() -> None:
    truth, data = campaign(1, sigma_m=0.0)
    estimate = lab.fit(data)
    for name in estimate.identified:
        if not name.startswith("base.r"):
            assert abs(estimate.params[name].value - truth[name]) < 1e-9


def test_the_covariance_is_that_of_the_estimates() -> None:
    """Over campaigns of one arm at the same poses, e' C^-1 e of f parameters is a chi squared: f on average."""
    truth, data = campaign(2, sigma_m=0.0)
    rng, count = np.random.default_rng(0), 30
    points = data.points + SIGMA_M * rng.standard_normal((count, *data.points.shape))
    estimates = lab.fit(data, points=points, noise_mm=1e3 * SIGMA_M)
    links = [i for i, name in enumerate(estimates[0].identified) if name.startswith("link")]
    squares = []
    for each in estimates:
        names = [each.identified[i] for i in links]
        error = np.array([each.params[name].value - truth[name] for name in names])
        squares.append(error @ np.linalg.solve(each.covariance[np.ix_(links, links)], error))
    sure = 4 * np.sqrt(2 * len(links) / count)  # standard deviation of the mean of so many chi squareds
    assert abs(np.mean(squares) - len(links)) < sure


def test_a_batch_gives_what_single_calls_give() -> None:
    several = [data_of(0), data_of(1, poses=35), data_of(2, targets=("p1", "p2", "p3"))]
    for one, other in zip(lab.fit(several), several, strict=True):
        assert_same(one, lab.fit(other))
    data = data_of(3)
    points = data.points + SIGMA_M * np.random.default_rng(0).standard_normal((4, *data.points.shape))
    points[1, 5] = np.nan  # a pose that was not seen in one campaign
    for one, own in zip(lab.fit(data, points=points, noise_mm=0.008), points, strict=True):
        assert_same(one, lab.fit(replace(data, points=own), noise_mm=0.008), 1e-6)


def test_few_poses_are_named_by_a_check() -> None:
    assert lab.fit(data_of()).checks == ()
    near = data_of(poses=60)
    near = replace(near, joints=near.joints[0] + 1e-2 * (near.joints - near.joints[0]))
    arm = IRB120.arm(("p1",))
    near = replace(near, points=arm.points(near.joints, arm.nominal(IRB120.tool)) + 1e-6)
    assert {check.name for check in lab.fit(near, prior="off").checks} & {
        "parameters.unobservable", "parameters.condition", "convergence.valley", "convergence.failed",
    }  # fmt: skip


def test_what_is_computed_when_read_is_what_an_identification_has() -> None:
    data = data_of()
    estimate, result = lab.fit(data, noise_mm=0.008), lab.identify(data, noise_mm=0.008)
    joints = IRB120.chain.random_joints(20, np.random.default_rng(5))
    np.testing.assert_allclose(
        estimate.predict(joints).extrapolation, result.estimate.predict(joints).extrapolation, rtol=1e-9
    )
    again = pickle.loads(pickle.dumps(lab.fit(data, noise_mm=0.008)))
    assert_same(again, estimate)
    assert same(again.measured, estimate.measured)


BAD = {
    "no measurements": (lambda data: lab.fit([]), "measurements are list"),
    "an array": (lambda data: lab.fit(data.points), "measurements are ndarray"),
    "a list of arrays": (lambda data: lab.fit([data, data.points]), "a list with ndarray"),
    "points of one campaign": (lambda data: lab.fit(data, points=data.points), r"give \(campaigns, 50, 1, 3\)"),
    "points of no campaign": (lambda data: lab.fit(data, points=np.empty((0, 50, 1, 3))), r"give \(campaigns"),
    "points beside a list": (lambda data: lab.fit([data], points=data.points[None]), "points are of campaigns"),
    "a searched model": (lambda data: lab.fit(data, model="auto"), "model auto is found by tests"),
    "a residual": (lambda data: lab.fit(data, model="residual"), "model residual is found by tests"),
    "an option of the judgement": (lambda data: lab.fit(data, holdout=0.3), "holdout changes nothing here"),
    "no such option": (lambda data: lab.fit(data, noise=0.1), "'noise' is no option"),
    "both noises": (lambda data: lab.fit(data, noise_mm=0.1, instrument="exact"), "both set the noise"),
    "few poses": (lambda data: lab.fit(data[:5]), "measure"),
    "few poses of one": (lambda data: lab.fit([data, data[:5]]), "campaign 2 of 2"),
    "millimetres": (lambda data: lab.fit(replace(data, points=1e3 * data.points)), "are in mm"),
    "degrees": (lambda data: lab.fit(replace(data, joints=np.rad2deg(data.joints))), "np.deg2rad"),
    "no robot": (lambda data: lab.fit(replace(data, robot="")), "name no robot"),
    "no such parameter": (lambda data: lab.fit(data, fix=("link9.d",)), "link9.d"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused_in_one_line(case: str) -> None:
    call, says = BAD[case]
    with pytest.raises(lab.LabError, match=says) as error:
        call(data_of())
    assert "\n" not in str(error.value)


def test_a_deferred_field_is_made_once_and_only_when_read() -> None:
    made = []

    class Owner:
        field = DeferredField[int]()

    owner = Owner()
    owner.field = Deferred(lambda: made.append(1) or len(made))  # type: ignore[func-returns-value]
    assert not made
    assert (owner.field, owner.field, made) == (1, 1, [1])
    owner.field = 7
    assert owner.field == 7
