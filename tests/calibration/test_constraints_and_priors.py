"""What can be asked of an identification: parameters fixed and freed, tolerances as a prior, the most likely arm."""

import numpy as np
import pytest
from helpers.robots import IRB120, perturbed, somewhere
from helpers.truths import truth_of

from lab.calibration import most_likely as lift_module
from lab.calibration.fit_options import PLAIN, FitOptions
from lab.calibration.identifiability import condition_of, scaled_condition, weak_directions
from lab.calibration.identification import identify
from lab.calibration.most_likely import most_likely_parameters
from lab.calibration.prior import Tolerance, alias_matrix, prior_of, standard_deviations
from lab.calibration.weights import Noise
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.kinematics.gauge import base_set
from lab.kinematics.serial.serial_arm import SerialArm

ARM = SerialArm(IRB120.chain)
NOMINAL = ARM.nominal(IRB120.tool)
PLACED = ("base", "tool")
SWAPPED = FitOptions(fix=("link3.d",), free=("link2.d",), prior="off")
SIGMA = 5e-6


def campaign(seed: int, poses: int = 50, noise: float = SIGMA) -> Measurements:
    rng = np.random.default_rng(seed)
    true = truth_of(ARM, rng).values
    joints = IRB120.chain.random_joints(poses, rng)
    points = ARM.points(joints, true) + noise * rng.normal(size=(poses, 1, 3))
    return measured(IRB120.chain.joint_names, joints, ("p1",), points)


def identified(data: Measurements, options: FitOptions = PLAIN, nominal: np.ndarray = NOMINAL):
    return identify(ARM, data, nominal, Noise(sigma_m=SIGMA), options)


FRESH = IRB120.chain.random_joints(300, np.random.default_rng(99))


def test_another_representative_predicts_the_same() -> None:
    data = campaign(0)
    usual, swapped = identified(data), identified(data, SWAPPED)
    assert usual.fit.rank == swapped.fit.rank == 27
    np.testing.assert_allclose(ARM.points(FRESH, usual.values), ARM.points(FRESH, swapped.values), rtol=0, atol=1e-9)
    at = ARM.names.index("link2.d"), ARM.names.index("link3.d")
    assert swapped.values[at[1]] == NOMINAL[at[1]] and usual.values[at[0]] == NOMINAL[at[0]]
    moved = swapped.values[at[0]] - NOMINAL[at[0]]
    assert moved == pytest.approx(usual.values[at[1]] - NOMINAL[at[1]], rel=1e-2)  # one to one


def test_a_parameter_held_lowers_the_rank_and_is_hidden_in_nothing() -> None:
    found = identified(campaign(1), FitOptions(fix=("link4.d", "link2.a"), prior="off"))
    assert found.fit.rank == 25 and not found.unobservable
    held = [ARM.names[i] for i in found.base_set.fixed_observable]
    assert held == ["link2.a", "link4.d"]
    columns = [found.base_set.fixed.index(i) for i in found.base_set.fixed_observable]
    assert not found.base_set.alias[:, columns].any()
    assert found.values[ARM.names.index("link4.d")] == NOMINAL[ARM.names.index("link4.d")]
    assert np.abs(found.residuals).max() > 20 * SIGMA  # it was off, and nothing else can take it over


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        (FitOptions(free=("link2.d",), prior="off"), ("link2.d is not identifiable", "hidden in link3.d", "fix")),
        (FitOptions(free=("link1.theta",), prior="off"), ("hidden in base.rx, base.ry, base.rz",)),
        (
            FitOptions(free=("joint2.compliance",), prior="off"),
            ("--free joint2.compliance", "no such parameter; the groups are base.*, link1.*", "tool.p1.*"),
        ),
        (
            FitOptions(fix=("link7.d",), prior="off"),
            ("--fix link7.d: no such parameter; the nearest are link6.d,", "the groups are base.*"),
        ),
        (FitOptions(fix=("*",), prior="off"), ("--fix", "no parameter")),
        (FitOptions(fix=("link3.d",), free=("link3.*",), prior="off"), ("both name link3.d",)),
    ],
)
def test_wishes_that_cannot_be_met(asked: FitOptions, says: tuple[str, ...]) -> None:
    with pytest.raises(LabError) as error:
        identified(campaign(3), asked)
    assert all(part in str(error.value) for part in says)


def test_the_condition_of_columns_of_any_size() -> None:
    straight = np.diag([1e-3, 1.0, 1e6])
    assert scaled_condition(straight) == pytest.approx(1.0)
    leaning = np.array([[1.0, 1.0], [0.0, 0.1]])
    assert scaled_condition(leaning) == pytest.approx(scaled_condition(leaning * [1.0, 1e5]))
    assert scaled_condition(leaning) == pytest.approx(20, rel=0.01)  # 2 / angle between two unit columns
    for short in (straight[:2], straight * [1.0, 0.0, 1.0], np.ones((4, 2))):
        assert np.isinf(scaled_condition(short))


def test_what_is_exported_does_not_depend_on_the_representative() -> None:
    """And predicts the same; the aliased error is shared by the tolerances' squares."""
    data = campaign(4)
    usual, swapped = identified(data), identified(data, SWAPPED)
    arms = [most_likely_parameters(found, NOMINAL, Tolerance()) for found in (usual, swapped)]
    np.testing.assert_allclose(arms[0], arms[1], rtol=0, atol=2e-9)
    for found, arm in zip((usual, swapped), arms, strict=True):
        np.testing.assert_allclose(ARM.points(FRESH, arm), ARM.points(FRESH, found.values), rtol=0, atol=1e-13)
    a, b = ARM.names.index("link2.d"), ARM.names.index("link3.d")
    assert arms[0][a] - NOMINAL[a] == pytest.approx(arms[0][b] - NOMINAL[b], rel=1e-2)
    assert usual.values[a] == NOMINAL[a]  # what is not lifted depends on it


def test_the_prior_of_the_base_set_is_that_of_the_drawing() -> None:
    """Draw all parameters by their tolerances and gather them: the covariance is the prior's."""
    values = somewhere(ARM, np.random.default_rng(0))
    structure = base_set(ARM, values)
    prior = prior_of(ARM, structure, values, Tolerance())
    covariance = np.linalg.inv(prior.whiten.T @ prior.whiten)
    sigma, wide = standard_deviations(ARM, Tolerance()), alias_matrix(structure, len(ARM.names))
    drawn = np.isfinite(sigma)
    rows = wide[[structure.identifiable.index(i) for i in prior.of]][:, drawn]
    expected = (rows * sigma[drawn] ** 2) @ rows.T
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(covariance / np.outer(size, size), expected / np.outer(size, size), atol=1e-6)
    assert not any(ARM.names[i].startswith(PLACED) for i in prior.of)
    d3 = prior.of.index(ARM.names.index("link3.d"))
    assert size[d3] == pytest.approx(np.sqrt(2) * 0.5e-3)  # link2.d goes into it


def test_tolerances_help_where_measurements_do_not() -> None:
    """Few noisy poses of a true arm drawn by the tolerances: MAP is nearer at fresh poses, and its NEES is one."""
    plain, helped, nees = [], [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        true = perturbed(ARM, somewhere(ARM, rng), rng, 0.5e-3, 1.5e-3)
        joints = IRB120.chain.random_joints(14, rng)
        points = ARM.points(joints, true) + 2e-4 * rng.normal(size=(14, 1, 3))
        data = measured(IRB120.chain.joint_names, joints, ("p1",), points)
        noise = Noise(sigma_m=2e-4)
        for options, out in ((PLAIN, plain), (FitOptions(prior="on"), helped)):
            found = identify(ARM, data, NOMINAL, noise, options)
            error = ARM.points(FRESH, found.values) - ARM.points(FRESH, true)
            out.append(np.linalg.norm(error, axis=2).mean())
            if options.prior == "on":
                _, jacobian = ARM.observe(FRESH, found.values)
                rows = jacobian[:, 0][..., list(found.fit.free)]
                predicted = np.trace(rows @ found.covariance @ rows.swapaxes(1, 2), axis1=1, axis2=2).mean()
                nees.append((error**2).sum(axis=(1, 2)).mean() / predicted)
    assert np.mean(helped) < 0.8 * np.mean(plain)
    assert np.mean(nees) == pytest.approx(1.0, abs=0.5)


def test_a_target_on_the_last_axis_leaves_two_directions() -> None:
    """1 mm off it: theta5 goes with a5, and alpha5 with d5; with 50 mm more neither is weak."""
    values = ARM.assemble(np.zeros(6), IRB120.chain.table, np.array([[1e-3, 0.0, 0.1]]))
    inputs = IRB120.chain.random_joints(200, np.random.default_rng(0))
    structure = base_set(ARM, values)
    names = [ARM.names[i] for i in structure.identifiable]
    jacobian = ARM.observe(inputs, values)[1].reshape(-1, len(values))[:, list(structure.identifiable)]
    found = weak_directions(names, jacobian)
    assert len(found) == 2
    for direction in found:
        assert {name for name, _ in direction.parts} == {"link5.theta", "link5.d", "link5.a", "link5.alpha"}
        change = np.zeros(len(names))
        for name, value in direction.parts:
            change[names.index(name)] = value
        moved = np.sqrt(np.mean((jacobian @ change) ** 2))
        assert moved == pytest.approx(direction.moved, rel=0.05) and moved < 5e-6
    away = values.copy()
    away[-3] += 0.05
    assert condition_of(ARM, values, inputs) > 600 and condition_of(ARM, away, inputs) < 30


def test_a_posterior_is_where_measurements_and_prior_balance() -> None:
    """The gradient of both sums of squares is zero, with the prior's residual pulling towards the drawing."""
    data = campaign(8, 14, 2e-4)
    noise = Noise(sigma_m=2e-4)
    found = identify(ARM, data, NOMINAL, noise, FitOptions(prior="on"))
    assert found.status == "converged"
    _, jacobian = ARM.observe(data.joints, found.values)
    by_points = np.einsum("nkdp,nkd->p", jacobian, found.residuals) / 2e-4**2
    prior = prior_of(ARM, found.base_set, NOMINAL, Tolerance())
    off = (NOMINAL - found.values)[list(prior.of)]
    by_prior = np.zeros(len(ARM.names))
    by_prior[list(prior.of)] = prior.whiten.T @ prior.whiten @ off
    kept = list(found.base_set.identifiable)
    size = np.linalg.norm(jacobian.reshape(-1, len(ARM.names)), axis=0)[kept] / 2e-4
    np.testing.assert_allclose((by_points + by_prior)[kept] / size, 0, atol=1e-6)
    assert np.abs(by_prior[kept] / size).max() > 0.1  # and the prior does pull


def test_a_prior_serves_where_poses_are_too_few() -> None:
    """9 poses leave no residual, 6 not even that many equations: with a known noise both work, without neither."""
    for poses in (9, 6):
        data = campaign(9, poses)
        with pytest.raises(LabError, match="--prior: the measurements leave no residuals"):
            identify(ARM, data, NOMINAL, None, FitOptions(prior="on"))
        found = identified(data, FitOptions(prior="on"))
        assert found.status == "converged" and len(found.fit.free) == 27 and np.isfinite(found.std).all()


def test_an_aliased_error_is_shared_by_variances(monkeypatch: pytest.MonkeyPatch) -> None:
    """A link with three times the tolerance of its neighbour takes nine tenths of what both may have."""
    found = identified(campaign(10))
    a, b = ARM.names.index("link2.d"), ARM.names.index("link3.d")

    def uneven(*_) -> np.ndarray:
        sigma = standard_deviations(ARM, Tolerance())
        sigma[a] *= 3
        return sigma

    monkeypatch.setattr(lift_module, "standard_deviations", uneven)
    values = most_likely_parameters(found, NOMINAL, Tolerance())
    assert (values - NOMINAL)[a] == pytest.approx(9 * (values - NOMINAL)[b], rel=1e-2)
