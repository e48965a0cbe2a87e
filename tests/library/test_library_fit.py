"""lab.fit: the estimate of an identification, of one campaign or many, without a judgement."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120

import lab
import lab.library.fit as library_fit
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


def assert_nearly_same(one: lab.Estimate, other: lab.Estimate) -> None:
    """Values by 1e-9 standard deviations, covariances by the rounding of a last step."""
    assert one.identified == other.identified and one.dof == other.dof
    std = np.sqrt(np.diag(other.covariance))
    at = [other.arm.names.index(name) for name in other.identified]
    assert np.abs((one.values - other.values)[at] / std).max() < 1e-9
    assert np.abs((one.covariance - other.covariance) / np.outer(std, std)).max() < 1e-7


def joined_fits(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Record of each further campaign whether it was fitted together with the first."""
    taken, together = list[bool](), library_fit.identify_alike

    def recorded(*args: object) -> list[object]:
        found = together(*args)  # type: ignore[arg-type]
        taken.extend(one is not None for one in found)
        return found  # type: ignore[return-value]

    monkeypatch.setattr(library_fit, "identify_alike", recorded)
    return taken


STACKED = {
    "noise from the residuals": {},
    "a given noise": {"noise_mm": 0.008},
    "an instrument": {"instrument": "uniform-8um"},
    "weights of each point": {"instrument": "krypton-k600"},
    "no prior": {"prior": "off"},
    "other parameters": {"fix": ("link3.d",), "free": ("link2.d",)},
}


@pytest.mark.parametrize("case", STACKED)
@pytest.mark.parametrize("targets", [("p1",), ("p1", "p2")], ids=len)
def test_campaigns_solved_together_are_those_solved_alone(
    case: str, targets: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Other arms on other bases at the same poses, and the same poses in another campaign as a table of its own."""
    data, rng, arm = data_of(4, targets=targets), np.random.default_rng(9), IRB120.arm(targets)
    points = []
    for _ in range(4):
        values = arm.nominal(IRB120.tool)
        values[6:] += 3e-4 * rng.normal(size=len(values) - 6)
        values[:6] = rng.normal(size=6)
        exact = arm.points(data.joints, values)
        points.append(exact + SIGMA_M * rng.standard_normal(exact.shape))
    taken = joined_fits(monkeypatch)
    campaigns = [data, *(replace(data, points=each) for each in points)]
    together = lab.fit(campaigns, **STACKED[case])
    assert taken == [True] * 4
    for one, own in zip(together, campaigns, strict=True):
        alone = lab.fit(own, **STACKED[case])
        assert_nearly_same(one, alone)
        assert one.checks == alone.checks and one.noise_known == alone.noise_known
        assert (one.noise_m, one.residual_m) == pytest.approx((alone.noise_m, alone.residual_m), rel=1e-9)
        for row, expected in zip(one.rows, alone.rows, strict=True):
            assert row.status == expected.status and set(row.aliases) == set(expected.aliases)
            assert row.exported == pytest.approx(expected.exported, abs=1e-9)
            assert row.aliases == pytest.approx(expected.aliases, abs=1e-6)


def test_weakly_observable_parameters_are_refined_as_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """In poses of a part of the range, fits of a condition of some hundreds: the predicted points settle first."""
    data, rng, arm = data_of(8), np.random.default_rng(4), IRB120.arm(("p1",))
    data = replace(data, joints=0.3 * data.joints)
    points = []
    for _ in range(3):
        values = arm.nominal(IRB120.tool)
        values[6:] += 3e-4 * rng.normal(size=len(values) - 6)
        exact = arm.points(data.joints, values)
        points.append(exact + 1e-4 * rng.standard_normal(exact.shape))
    taken = joined_fits(monkeypatch)
    for one, own in zip(lab.fit(data, points=points, prior="off"), points, strict=True):
        assert_nearly_same(one, lab.fit(replace(data, points=own), prior="off"))
    assert taken == [True] * 2


def test_of_campaigns_with_gaps_those_with_the_same_are_solved_together(monkeypatch: pytest.MonkeyPatch) -> None:
    data = data_of(5, targets=("p1", "p2"))
    points = data.points + SIGMA_M * np.random.default_rng(1).standard_normal((6, *data.points.shape))
    points[[1, 3], 7] = np.nan  # a pose that two campaigns did not see
    points[[2, 4], 3, 1] = np.nan  # one of the targets of a pose: these two are fitted alone
    taken = joined_fits(monkeypatch)
    for one, own in zip(lab.fit(data, points=points), points, strict=True):
        assert_nearly_same(one, lab.fit(replace(data, points=own)))
    assert taken == [True, True, False]


def test_what_is_not_plain_least_squares_is_fitted_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    data = data_of(6)
    points = data.points + SIGMA_M * np.random.default_rng(2).standard_normal((3, *data.points.shape))
    points[2, 4] += 0.05  # a gross error: a fit of other residuals is no neighbour of the first
    taken = joined_fits(monkeypatch)
    lab.fit(data, points=points, prior="off")
    assert taken == [True, False]
    taken.clear()
    of_tracker = {"instrument": "leica-at960"}  # whose range has a constant
    for options in ({"prior": "on"}, {"robust": True}, {"fix": ("base.*",)}, {"model": "compliance"}, of_tracker):
        for one, own in zip(lab.fit(data, points=points[:2], **options), points[:2], strict=True):
            assert_same(one, lab.fit(replace(data, points=own), **options))
    assert not any(taken)


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda points: 1e3 * points, "campaign 3 of 4: .* are in mm"),
        (lambda points: np.full_like(points, np.nan), "campaign 3 of 4: "),
        (lambda points: np.where(np.arange(len(points))[:, None, None] < 5, points, np.nan), "campaign 3 of 4: "),
    ],
)
def test_a_bad_campaign_among_good_ones_is_named_in_one_line(spoil, says: str) -> None:  # type: ignore[no-untyped-def]
    data = data_of(7)
    points = data.points + SIGMA_M * np.random.default_rng(3).standard_normal((4, *data.points.shape))
    points[2] = spoil(points[2])
    with pytest.raises(lab.LabError, match=says) as error:
        lab.fit(data, points=points)
    assert "\n" not in str(error.value)


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
