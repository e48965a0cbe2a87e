"""The registry of effects: options, groups and random substreams in one order, and what one effect has to describe."""

from dataclasses import fields, replace

import numpy as np
import pytest
from helpers.robots import IRB120, SCARA

from lab.core.errors import LabError
from lab.kinematics.effects.effect import ArmFacts, MovesJoints, PoseConditions, SessionInfo, SimulatedEffect
from lab.kinematics.effects.effect_registry import (
    EFFECTS,
    EffectOptions,
    describe_term,
    searched_terms,
)
from lab.simulation.effects import random_effects

FACTS = ArmFacts(IRB120.chain, IRB120.loads, SessionInfo(("1", "2")))
ALL_ON = EffectOptions(
    **{
        each.name: 0.5
        for each in fields(EffectOptions)
        if each.name not in ("payload_kg", "bad_mm", "link_ei", "link_gj", "noise_tail_dof")
    },
    link_ei=(1e5,),
    link_gj=(8e4,),
    noise_tail_dof=5.0,  # above 2: below, there is no variance
)


@pytest.mark.parametrize("kind", EFFECTS, ids=lambda kind: kind.__name__)
def test_every_effect_is_off_by_default_and_knows_its_truth(kind) -> None:
    """What it simulates is zero unless asked for; its true parameters are those that its groups fit, and zero then."""
    rngs = [np.random.default_rng(i) for i in range(kind.draws)]
    off, on = kind().simulated(FACTS, rngs), ALL_ON.of(kind).simulated(FACTS, rngs)
    if off is None:
        assert on is None and not kind.groups and not kind.draws
        return
    assert not off.conditions(IRB120.chain.joint_names) and not off.obscured()
    assert not any(off.true_parameters().values())
    truth = on.true_parameters()
    for group in kind.groups:
        names = {each.name for each in group.fitted(FACTS).parameters} - {"payload.mass"}
        assert names and names <= set(truth)
    nothing = type(on).none(IRB120.chain.size)
    assert isinstance(on, SimulatedEffect)
    for name, value in vars(nothing).items():
        assert np.shape(getattr(on, name)) == np.shape(value)


def test_an_effect_draws_from_its_own_streams() -> None:
    """Whatever another effect is asked for, the numbers of this one stay."""
    every = random_effects(FACTS, ALL_ON, np.random.default_rng(3))
    for kind in EFFECTS:
        alone = EffectOptions(**vars(ALL_ON.of(kind)))
        part = next((part for part in every.parts if type(part) is type(kind().simulated(FACTS, _streams()))), None)
        if part is None:
            continue
        same = random_effects(FACTS, alone, np.random.default_rng(3)).part(type(part))
        for name, value in vars(part).items():
            np.testing.assert_array_equal(getattr(same, name), value)


def _streams() -> list[np.random.Generator]:
    return [np.random.default_rng(0), np.random.default_rng(1)]


def test_options_of_one_effect_are_checked_where_it_is_described() -> None:
    for wrong, message in (
        ({"gear_ppm": -1.0}, "--gear-ppm -1: give a number from 0"),
        ({"lag": 1.0}, "--lag 1: give a share from 0 to below 1"),
        ({"bad_share": 1.5}, "--bad-share 1.5: give a share from 0 to 1"),
        ({"stiffness_nm_per_rad": 0.0}, "--stiffness-nm-per-rad 0: give a number above zero"),
        ({"bad_mm": (2.0, 5.0)}, "give --bad-share too"),
        ({"payload_kg": ()}, "--payload-kg: give at least one payload"),
        ({"hours": 0.0}, "--hours 0: give a number above zero"),
        ({"bump_mm": float("nan")}, "--bump-mm nan"),
    ):
        with pytest.raises(LabError, match=message):
            replace(EffectOptions(), **wrong).check()
    EffectOptions().check()


@pytest.mark.parametrize(
    "options", [{"ripple_mrad": 0.1}, {"full_coupling_ppm": 50.0}, {"cross_harmonic_mrad": 0.3}], ids=str
)
def test_a_simulated_effect_is_what_single_joints_groups_fit(options: dict[str, float]) -> None:
    """With the true parameters, the groups of single joints move the joints as the simulation does."""
    part = next(
        part
        for part in random_effects(FACTS, EffectOptions(**options), np.random.default_rng(2)).parts
        if any(part.true_parameters().values())
    )
    assert isinstance(part, MovesJoints)
    joints = IRB120.chain.random_joints(30, np.random.default_rng(0))
    truth, fitted = part.true_parameters(), np.zeros(joints.shape)
    for name, group in searched_terms(FACTS).items():
        own = [each.name for each in group.parameters]
        if set(own) & set(truth):
            values = np.array([truth[each] for each in own])
            fitted += group.offsets(joints, np.zeros((30, 0)), values)[0]
            assert describe_term(name)
    conditions = PoseConditions({}, 30, IRB120.chain.joint_names)
    np.testing.assert_allclose(part.joint_offsets(joints, conditions), fitted, atol=1e-18)
    assert np.abs(fitted).max() > 2e-5 and (np.abs(fitted).max(axis=0) > 0).all()
    slides = ArmFacts(SCARA)
    for each in random_effects(slides, EffectOptions(**options), np.random.default_rng(2)).parts:
        each.refuse_unfit(SCARA)
        if isinstance(each, MovesJoints) and any(each.true_parameters().values()):
            moved = each.joint_offsets(joints[:, :4], PoseConditions({}, 30, SCARA.joint_names))
            assert moved[:, 0].any() and moved[:, 2].any() == ("cross_harmonic_mrad" in options)
