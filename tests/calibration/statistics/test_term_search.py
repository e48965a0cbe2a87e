"""The search of single joints' groups: its statistic against refits, its level under noise of many kinds, its power."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120

from lab.calibration.gauss_newton import Observations
from lab.calibration.identification import WEAK, Identification, identify
from lab.calibration.row_groups import configurations
from lab.calibration.statistics.candidate_models import TermSearch, TermTable
from lab.calibration.statistics.model_selection import Selection, select
from lab.core.measurements import Measurements, measured
from lab.core.significance import TERM_SEARCH
from lab.kinematics.effects.arm_with_effects import ArmWithEffects
from lab.kinematics.effects.effect import ArmFacts, Effect
from lab.kinematics.effects.effect_registry import expected_terms, searched_terms
from lab.kinematics.gauge import base_set
from lab.kinematics.serial.serial_arm import SerialArm

SIGMA = 8e-6
TERMS = searched_terms(ArmFacts(IRB120.chain, IRB120.loads))
THREE = ("p1", "p2", "p3")


def campaign(
    seed: int, terms: dict[str, float], poses: int = 80, targets: tuple[str, ...] = ("p1",), noise: str = "plain"
) -> Measurements:
    """An arm off by 0.5 mm and mrad, with parameters of effects, before noise of 8 um."""
    rng = np.random.default_rng(seed)
    groups = sorted({name for name, each in TERMS.items() if {p.name for p in each.parameters} & set(terms)})
    arm = IRB120.arm_with(targets, groups)
    rigid = IRB120.arm(targets)
    values = np.zeros(len(arm.names))
    values[: len(rigid.names)] = rigid.nominal(IRB120.tool)
    kept = list(base_set(rigid, values[: len(rigid.names)]).identifiable)
    values[kept] += 5e-4 * rng.normal(size=len(kept))
    for name, value in terms.items():
        values[arm.names.index(name)] = value
    joints = IRB120.chain.random_joints(poses, rng)
    moved = joints + (3e-5 * rng.standard_normal(joints.shape) if noise == "joints" else 0.0)
    points = arm.points(moved, values)
    error = rng.standard_normal(points.shape)
    if noise == "drift":
        error += 4 * np.linspace(-1, 1, poses)[:, None, None] * rng.standard_normal(3)
    return measured(IRB120.chain.joint_names, joints, targets, points + SIGMA * error)


def geometry(data: Measurements) -> Identification:
    arm = IRB120.arm(data.targets)
    return identify(arm, data, arm.nominal(IRB120.tool))


def search_of(
    data: Measurements,
    found: Identification,
    names: list[str] | None = None,
    largest_std: float = WEAK,
    terms: Mapping[str, Effect] = TERMS,
) -> TermSearch:
    table = TermTable.of({name: terms[name] for name in names or terms}, data)
    ends = [table.names[group] for group in table.showing_ends.values()]
    assert isinstance(found.model, SerialArm | ArmWithEffects)
    return TermSearch.at(
        table,
        found.model,
        IRB120.arm_with(data.targets, list(dict.fromkeys([*found.model.groups, *ends]))),
        Observations.unweighted(data),
        found.values,
        found.fit.free,
        configurations(data.joints),
        found.extra_residuals,
        largest_std=largest_std,
        floor=1e-9,
    )


def found_in(data: Measurements) -> Selection:
    return select(
        lambda groups: IRB120.arm_with(data.targets, groups),
        data,
        lambda model: model.nominal(IRB120.tool),
        candidates=(),
        terms=TERMS,
    )


def test_a_table_has_the_functions_that_its_groups_have() -> None:
    """Waves are computed together, other functions by each group: both are what moves the joints and links' ends."""
    data = campaign(0, {}, poses=25)
    table, size = TermTable.of(TERMS, data), IRB120.chain.size
    assert sum(each.wave is not None for each in TERMS.values()) > 0.9 * len(TERMS) < len(TERMS)
    for i, effect in enumerate(TERMS.values()):
        own = np.flatnonzero(table.owner == i)
        derivative = effect.offsets(data.joints, np.zeros((25, 0)), np.zeros(len(own)))[1]
        first = size + 6 * effect.links[0] if effect.links else 0
        for k, column in enumerate(own):
            moved = np.zeros(derivative.shape[:2])
            moved[:, table.motion[column] - first] = table.functions[:, column]
            np.testing.assert_allclose(derivative[..., k], moved, rtol=1e-14, atol=1e-15)


def test_the_search_takes_what_lowers_the_squares_most() -> None:
    """Its linear algebra against fits of each group alone, by the exact model."""
    data = campaign(0, {"joint2.sin20": 1e-4, "joint3.gravity3y": 1e-4, "joint5.coupling2": 1e-4})
    found = geometry(data)
    names = ["joint2.harmonic20", "joint2.harmonic19", "joint3.gravity3", "joint5.coupling2", "joint1.harmonic40"]
    search, squares = search_of(data, found, names), []
    before = search.residual @ search.residual
    gram, products = search._gram(), search.columns.T @ search.residual
    for i, name in enumerate(names):
        arm = IRB120.arm_with(("p1",), [name])
        fitted = identify(arm, data, arm.nominal(IRB120.tool))
        squares.append(before - float(np.nansum(fitted.residuals**2)))
        index = np.unique(search._pairs[i])
        matrix = gram[[0]].T[i, None] if len(index) == 1 else gram[[0, 1, 1, 2], i].reshape(2, 2)
        score = products[index]
        assert score @ np.linalg.solve(matrix, score) == pytest.approx(squares[-1], rel=2e-3, abs=1e-5 * before)
    taken = search.run(np.random.default_rng(0), 5)
    assert taken[0].name == names[int(np.argmax(squares))]
    assert {term.name for term in taken} == {"joint2.harmonic20", "joint3.gravity3", "joint5.coupling2"}
    rows = np.concatenate([search.basis, search.residual[:, None]], axis=1)
    assert np.abs(rows[:, :-1].T @ rows[:, -1]).max() < 1e-9 * np.linalg.norm(search.residual)
    np.testing.assert_allclose(search._shared, search.basis.T @ search.columns, atol=1e-9)
    np.testing.assert_allclose(search.basis.T @ search.basis, np.eye(search.basis.shape[1]), atol=1e-12)


KINDS = [("plain", ("p1",)), ("joints", THREE), ("drift", ("p1",))]


def false_alarms(noise: str, targets: tuple[str, ...], seeds: range, poses: int) -> int:
    """Campaigns of a rigid arm that are given anything."""
    count = 0
    for seed in seeds:
        data = campaign(seed, {}, poses, targets, noise)
        count += bool(search_of(data, geometry(data)).run(np.random.default_rng(seed), 9))
    return count


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("noise", "targets"), KINDS)
def test_a_rigid_arm_is_given_nothing(noise: str, targets: tuple[str, ...]) -> None:
    """At a level of 0.5 %, 8 campaigns have 2 or more false alarms once in 1,400."""
    assert false_alarms(noise, targets, range(8), 40) <= 1


@pytest.mark.parametrize("seed", range(1))
def test_what_is_there_is_found_and_nothing_else(seed: int) -> None:
    """Two harmonics of high order on an arm: both are taken, and the error of new poses is that of the noise."""
    truth = {"joint2.sin20": 6e-5, "joint2.cos20": -4e-5, "joint1.sin33": 8e-5}
    found = found_in(campaign(seed, truth))
    assert set(found.chosen) == {"joint2.harmonic20", "joint1.harmonic33"}
    values = dict(zip(found.identification.model.names, found.identification.values, strict=True))
    for name, value in truth.items():
        assert values[name] == pytest.approx(value, abs=1.5e-5)
    rows = {group.name: group for group in found.groups}
    first, second = (rows[name] for name in found.chosen)
    assert rows["geometric"].holdout_m > first.holdout_m > second.holdout_m and second.holdout_m < 0.03e-3
    assert first.parameters == second.parameters == 2 and max(first.f_p, second.f_p) < 1e-4
    assert first.bic > second.bic


@pytest.mark.thorough
def test_repeats_of_a_pose_are_one_witness() -> None:
    """A pose that is measured twenty times with one error of its own shows nothing of the arm."""
    for seed in range(3):
        data = campaign(seed, {}, 40, noise="plain")
        repeated = data[np.repeat(np.arange(40), 20)]
        repeated = replace(repeated, ids=tuple(map(str, range(800))))
        search = search_of(repeated, geometry(repeated))
        assert len(search.starts) == 40
        assert not search.run(np.random.default_rng(0), 9)
    alone = replace(search, starts=np.arange(len(search.residual)), allowed=np.ones(len(TERMS), bool))
    assert alone.run(np.random.default_rng(0), 9)  # as if they were 800 poses


def test_compliance_is_found_without_masses() -> None:
    """An arm whose joints 2 and 3 give way to its weight, fitted as if nothing weighed anything."""
    loads = IRB120.loads
    assert loads is not None
    rng = np.random.default_rng(5)
    arm = IRB120.arm_with(("p1",), ["compliance"])
    values = np.concatenate([IRB120.arm(("p1",)).nominal(IRB120.tool), [2e-5, 2e-5]])
    joints = IRB120.chain.random_joints(60, rng)
    inputs = np.column_stack([joints, np.zeros(60)])
    points = arm.points(inputs, values)
    data = measured(IRB120.chain.joint_names, joints, ("p1",), points + SIGMA * rng.standard_normal(points.shape))
    found = found_in(data)
    assert any("gravity" in name for name in found.chosen)
    fresh = IRB120.chain.random_joints(500, rng)
    exact = arm.points(np.column_stack([fresh, np.zeros(500)]), values)

    def error(identification: Identification) -> float:
        return float(np.linalg.norm(identification.model.points(fresh, identification.values) - exact, axis=2).mean())

    assert error(found.identification) < 0.3 * error(geometry(data)) and error(geometry(data)) > 0.1e-3


def test_what_is_fitted_is_not_searched() -> None:
    data = campaign(0, {"joint2.sin20": 1e-4})
    arm = IRB120.arm_with(("p1",), ["joint2.harmonic20", "harmonics"])
    search = search_of(data, identify(arm, data, arm.nominal(IRB120.tool)))
    left = [name for name, allowed in zip(search.table.names, search.allowed, strict=True) if not allowed]
    assert set(left) == {"joint2.harmonic20", *(f"joint{i}.harmonic1" for i in range(1, 7))}


def test_a_joint_that_hardly_moved_says_nothing_of_slow_waves() -> None:
    """Within 0.3 rad a wave of twice a turn looks like an offset: beyond, it would make anything of that."""
    data = campaign(0, {})
    joints = data.joints.copy()
    joints[:, 1] = 0.15 * np.sin(np.arange(len(joints)))
    arm = IRB120.arm(("p1",))
    points = arm.points(joints, arm.nominal(IRB120.tool)) + SIGMA * np.random.default_rng(0).normal(size=(80, 1, 3))
    narrow = measured(IRB120.chain.joint_names, joints, ("p1",), points)
    search = search_of(narrow, geometry(narrow), largest_std=1e-4)
    useful = dict(zip(search.table.names, search._useful(search._gram()), strict=True))
    assert not useful["joint2.harmonic2"] and useful["joint2.harmonic40"] and useful["joint3.harmonic2"]


def test_gear_ratios_name_waves_that_the_search_begins_with() -> None:
    """A wave beyond the usual orders is searched for where a gear ratio names it, and a weaker one is found so."""
    ratios = np.array([-101.0, 80.5, 50.0, 121.0, 100.0, 100.0])
    geared = ArmFacts(replace(IRB120.chain, gear_ratio=ratios), IRB120.loads)
    expected = expected_terms(geared)
    assert expected[:6] == tuple(
        f"joint{i}.harmonic{k}" for i, k in ((1, 101), (1, 202), (2, 80), (2, 81), (2, 161), (3, 50))
    )
    assert not expected_terms(ArmFacts(IRB120.chain, IRB120.loads))
    assert set(searched_terms(geared)) - set(TERMS) == {name for name in expected if not name.endswith("harmonic50")}
    wave = searched_terms(geared)
    data = campaign(3, {})
    found = geometry(data)
    size = 1.35e-5 * np.sin(101 * data.joints[:, 0] + 1.0)
    moved = data.joints + np.outer(size, np.eye(6)[0])
    data = replace(
        data,
        points=data.points + found.model.points(moved, found.values) - found.model.points(data.joints, found.values),
    )
    found, taken = geometry(data), []
    for only, level in ((None, TERM_SEARCH), (expected, TERM_SEARCH / 2)):
        search = search_of(data, found, terms=wave)
        taken.append([term.name for term in search.run(np.random.default_rng(0), 20, only, level)])
    assert taken == [[], ["joint1.harmonic101"]]
