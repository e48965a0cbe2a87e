"""Which effects an arm has: what is there is taken, what is not is not, and the table's figures are those of refits."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120, data_file, somewhere

from lab.calibration.fit_options import PLAIN
from lab.calibration.identification import Identification, identify
from lab.calibration.statistics.candidate_models import FullModel, HeldOutGain, Score, SelectionTask
from lab.calibration.statistics.model_selection import Selection, objection, select
from lab.calibration.weights import Noise
from lab.core.measurements import Measurements, measured
from lab.core.se3 import Array
from lab.core.units import MRAD
from lab.formats.measurement_csv import read_measurements
from lab.kinematics.effects.arm_with_effects import affected
from lab.kinematics.effects.effect import ArmFacts, Effect, SessionInfo
from lab.kinematics.effects.effect_registry import CANDIDATES, EffectOptions
from lab.kinematics.gauge import base_set
from lab.kinematics.model import Model
from lab.kinematics.parameter import Parameter
from lab.noise.instruments import instrument
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot
from lab.simulation.collisions import random_poses
from lab.simulation.effects import random_effects
from lab.simulation.tracking import track
from lab.simulation.true_robot import random_perturbation, random_tracker, true_robot

SIGMA = 5e-6
SESSIONS = SessionInfo(("a", "b"))
SIZE = {
    "ei_y": 2e-5,
    "ei_z": 2e-5,
    "compliance": 1e-5,
    "gear": 2e-4,
    "backlash": 1e-4,
    "drift": 1e-4,
    "hardening": 1e-8,
    "expansion": 2e-5,
    "thermal": 1e-5,
}  # of others 1e-4


def nominal(model: Model) -> Array:
    return model.nominal(IRB120.tool)


def irb120(groups: Sequence[str]) -> Model:
    return IRB120.arm_with(("p1",), groups, SESSIONS)


def simulated(arm: Model, values: Array, poses: int, rng: np.random.Generator, sigma_m: float = SIGMA) -> Measurements:
    """What Gaussian noise leaves of an arm with effects, with all conditions that any group asks for."""
    every = IRB120.arm_with(arm.targets, CANDIDATES, SESSIONS)
    inputs = every.structure_joints(poses, rng)
    columns = {name: inputs[:, 6 + i] for i, name in enumerate(every.conditions)}
    asked = [columns[name][:, None] for name in arm.conditions]
    points = arm.points(np.concatenate([inputs[:, :6], *asked], axis=1), values)
    points = points + sigma_m * rng.standard_normal(points.shape)
    return replace(measured(IRB120.chain.joint_names, inputs[:, :6], arm.targets, points), conditions=columns)


def values_with(arm: Model, rng: np.random.Generator) -> Array:
    """Geometry off by 0.5 mm and mrad, effects of the size that arms have."""
    rigid = IRB120.arm(arm.targets)
    values = np.concatenate([somewhere(rigid, rng), np.zeros(len(arm.names) - len(rigid.names))])
    kept = list(base_set(rigid, values[: len(rigid.names)]).identifiable)
    values[kept] += 5e-4 * rng.normal(size=len(kept))
    for i in range(len(rigid.names), len(arm.names)):
        kind = arm.names[i].rpartition(".")[2]
        group = "drift" if arm.names[i].startswith("drift") else kind
        values[i] = SIZE.get(group, 1e-4) * rng.uniform(0.5, 1.5)
    return values


def example(groups: Sequence[str], poses: int = 60, seed: int = 0) -> Measurements:
    rng = np.random.default_rng(seed)
    arm = irb120(groups)
    return simulated(arm, values_with(arm, rng), poses, rng)


def row(selection: Selection, name: str):
    return next(group for group in selection.groups if group.name == name)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("group", ["compliance", "drift"])
def test_the_group_that_is_there_is_taken_alone(group: str) -> None:
    found = select(irb120, example([group]), nominal, Noise(None, SIGMA))
    assert found.chosen == (group,) and [g.name for g in found.groups] == [
        "geometric",
        group,
        *(name for name in CANDIDATES if name != group),
    ]
    geometry, taken = found.groups[:2]
    assert taken.chosen and not taken.infeasibility_reason and geometry.chosen
    assert taken.holdout_m < 0.6 * geometry.holdout_m and taken.bic < geometry.bic - 100 and taken.f_p < 1e-10
    assert len(found.identification.fit.free) == geometry.parameters + taken.parameters
    for other in found.groups[2:]:
        assert not other.chosen and other.infeasibility_reason
        if other.parameters or other.name != "torsion":  # one target hardly turns where links twist
            assert other.parameters > 0 and other.bic > taken.bic - 10


def test_compliance_and_harmonics_of_a_mujoco_arm() -> None:
    """60 random poses with 0 or 3 kg."""
    robot, device = IRB120.model, instrument("uniform-8um")
    rng = np.random.default_rng(0)
    sizes = EffectOptions(stiffness_nm_per_rad=1e5, harmonic_mrad=0.2)
    real = true_robot(robot, random_perturbation(robot, 0.5e-3, 1.5e-3, rng), random_tracker(robot, rng))
    real = real.with_effects(random_effects(ArmFacts(IRB120.chain, IRB120.loads), sizes, rng))
    joints, fresh = random_poses(robot, 60, rng), random_poses(robot, 200, rng)
    conditions = {"payload_kg": rng.choice([0.0, 3.0], 60)}
    data = track(real, joints, ("p1",), device, rng, conditions=conditions)
    found = select(irb120, data, nominal, Noise(device))
    assert sorted(found.chosen) == ["compliance", "harmonics"]
    bought = [group.holdout_m for group in found.groups[:3]]
    assert bought[0] > 0.05e-3 and bought[0] > bought[1] > bought[2] and bought[2] < 0.015e-3
    model, values = found.identification.model, found.identification.values
    exact = real.points(fresh, ("p1",), {"payload_kg": np.full(200, 3.0)})
    inputs = np.insert(fresh, 6, 3.0, axis=1)
    assert np.linalg.norm(model.points(inputs, values) - exact, axis=2).mean() < 0.007e-3
    assert (
        row(found, "backlash").infeasibility_reason.startswith("column approach_")
        and row(found, "drift").parameters == 0
    )


@pytest.fixture(scope="module")
def near_compliance() -> tuple[Measurements, Identification, FullModel]:
    data = example(["compliance", "harmonics"])
    found = identify(irb120(["compliance"]), data, nominal(irb120(["compliance"])), Noise(None, SIGMA))
    task = SelectionTask(irb120, nominal, data, Noise(None, SIGMA), PLAIN)
    return data, found, FullModel.of(task, CANDIDATES, task.identified(()), 0)


def by_known_noise(whole: Identification) -> float:
    """Known noise to that which the table takes: never less, and as much as the residuals."""
    return 1 / max(1.0, float(np.sqrt(2 * whole.fit.cost_trace[-1] / whole.dof)))


@pytest.mark.thorough
@pytest.mark.parametrize("groups", [(), ("compliance", "harmonics")])
def test_scores_are_those_of_refits(near_compliance, groups: tuple[str, ...]) -> None:
    """Sum of squares and held-out errors of nested models, larger and smaller, from one linearization."""
    data, found, large = near_compliance
    table = large.around(found)
    names = large.observation.model.names
    arm = irb120(groups)
    whole = identify(arm, data, nominal(arm), Noise(None, SIGMA))
    score = table.score([names.index(arm.names[i]) for i in whole.fit.free])
    assert score.squares == pytest.approx(2 * whole.fit.cost_trace[-1], rel=1e-3)
    lengths = []
    for fold in range(5):
        part, test = data[large.folds != fold], data[large.folds == fold]
        values = identify(arm, part, nominal(arm), Noise(None, SIGMA)).values
        lengths.append(np.linalg.norm(arm.points(test.inputs(arm.conditions), values) - test.points, axis=2)[:, 0])
    np.testing.assert_allclose(score.errors, np.concatenate(lengths), rtol=1e-2, atol=1e-7)
    free = [names.index(arm.names[i]) for i in whole.fit.free]
    np.testing.assert_allclose(table.std(free) * by_known_noise(whole), whole.std, rtol=1e-2)


def test_p_values(near_compliance) -> None:
    """F's where sigma is given too small or not at all, chi squared's where it says that nothing is amiss."""
    table = replace(near_compliance[2].around(near_compliance[1]), rows=180, floor=1.0)
    few, more = (Score(p, squares, np.zeros(1), 0.0) for p, squares in ((27, 1e4), (29, 9.9e3)))
    assert table.p_value(few, more) == pytest.approx(0.468, abs=0.01)  # F; chi squared would say 1e-22
    few, more = (Score(p, squares, np.zeros(1), 0.0) for p, squares in ((27, 4.0), (29, 3.0)))
    assert table.p_value(few, more) == pytest.approx(np.exp(-0.5), rel=1e-9)  # chi squared; F would say 1e-10
    assert replace(table, floor=1e-9).p_value(few, more) < 1e-8


def test_all_three_must_say_so() -> None:
    """A test of all groups together, very strong evidence by BIC, and held-out errors beyond their scatter."""
    small, big = Score(29, 200.0, np.zeros(60), 0.0), Score(41, 150.0, np.zeros(60), -11.0)
    gain = HeldOutGain(2e-6, 1e-6, 59)
    assert objection(small, big, gain, 0.0099) == ""
    assert objection(small, big, gain, 0.0101) == "not significant"
    assert objection(small, replace(big, bic=-9.0), gain, 0.0) == "BIC does not fall enough"
    assert objection(small, replace(big, bic=1.0), gain, 0.0) == "BIC rises"
    assert objection(small, big, replace(gain, mean_m=0.9e-6), 0.0) == "the held-out error does not fall"


def test_rows_of_one_configuration_are_held_out_together() -> None:
    data = example((), poses=40)
    data = data[np.repeat(np.arange(40), 3)]
    task = SelectionTask(irb120, nominal, data, Noise(), PLAIN)
    large = FullModel.of(task, ["gear"], task.identified(()), 0)
    assert (large.folds.reshape(40, 3) == large.folds[::3, None]).all() and set(large.folds) == set(range(5))
    table = large.around(task.identified(()))
    assert np.bincount(table.cluster).tolist() == [3] * 40
    before = Score(0, 0.0, np.repeat(np.arange(40.0), 3)[np.argsort(large.folds, kind="stable")], 0.0)
    gain = table.gain(before, replace(before, errors=np.zeros(120)))
    values = np.arange(40.0)
    assert gain.mean_m == pytest.approx(values.mean()) and gain.dof == 39
    assert gain.std_m == pytest.approx(values.std(ddof=1) / np.sqrt(40))
    often = replace(table, cluster=np.repeat(np.arange(40), [81, *[1] * 39]))
    before = Score(0, 0.0, np.repeat(values, [81, *[1] * 39]), 0.0)
    again = often.gain(before, replace(before, errors=np.zeros(120)))
    assert again == gain  # a configuration counts once, however often it is measured


REFERENCE_EVERY_10 = [0, *(i for k in range(1, 8) for i in (*range(10 * k - 9, 10 * k), 0, 10 * k))]


def visits(kind: str, poses: int) -> list[int]:
    """The order in which poses are measured: each once, each thrice, or the first again after every ten and last."""
    if kind == "reference":
        return [*REFERENCE_EVERY_10[: poses + (poses - 1) // 10], 0]
    return [i for i in range(poses) for _ in range({"once": 1, "thrice": 3}[kind])]


def repeated(
    groups: Sequence[str],
    order: Sequence[int],
    targets: tuple[str, ...] = ("p1",),
    payloads: tuple[float, ...] = (0.0,),
    seed: int = 0,
    scatter_rad: float = 0.0,
) -> Measurements:
    """Poses in an order of visits, each visit with noise and joints that scatter; a payload stays for a third."""
    rng = np.random.default_rng(seed)
    arm = IRB120.arm_with(targets, groups, SESSIONS)
    names, values = IRB120.chain.joint_names, values_with(arm, rng)
    joints = IRB120.chain.random_joints(max(order) + 1, rng)[list(order)]
    payload = np.repeat(np.resize(payloads, 3), -(-len(order) // 3))[: len(order)]
    conditions = {"payload_kg": payload, "time_s": 60.0 * np.arange(len(order))}
    scattered = joints + scatter_rad * rng.normal(size=joints.shape)
    blank = measured(names, scattered, targets, np.zeros((len(order), len(targets), 3)))
    points = arm.points(replace(blank, conditions=conditions).inputs(arm.conditions), values)
    points = points + SIGMA * rng.standard_normal(points.shape)
    return replace(measured(names, joints, targets, points), conditions=conditions)


def selected(data: Measurements) -> Selection:
    return select(lambda g: IRB120.arm_with(data.targets, g, SESSIONS), data, nominal)


THREE = ("p1", "p2", "p3")


UNLOADED, LOADED = (0.0,), (0.0, 1.5, 3.0)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("poses", "kind", "targets", "payloads"),
    [(25, "reference", ("p1",), UNLOADED), (25, "thrice", THREE, LOADED)],
)
def test_springs_are_found_however_poses_are_repeated(
    poses: int, kind: str, targets: tuple[str, ...], payloads: tuple[float, ...]
) -> None:
    """A reference pose, a cycle of each pose and several targets must not hide what lowers held-out errors tenfold."""
    found = selected(repeated(["compliance"], visits(kind, poses), targets, payloads, seed=poses))
    assert found.chosen == ("compliance",)
    geometry, springs = found.groups[:2]
    assert springs.holdout_m < 0.2 * geometry.holdout_m
    assert springs.gain is not None and springs.gain.p < 1e-6 and springs.gain.dof == poses - 1
    assert springs.configurations is not None and springs.configurations.p < 1e-9


@pytest.mark.thorough
def test_an_arm_without_effects_keeps_none_however_poses_are_repeated() -> None:
    """Joints that scatter by 0.1 mrad move all targets of a pose together."""
    kinds = [("reference", ("p1",)), ("thrice", ("p1",)), ("reference", THREE)]
    wrong = 0
    for seed in range(6):
        kind, targets = kinds[seed % 3]
        data = repeated(
            [], visits(kind, (25, 30, 40)[seed // 3 % 3]), targets, seed=seed, scatter_rad=1e-4 * (seed % 2)
        )
        wrong += selected(data).chosen != ()
    assert wrong == 0


@pytest.mark.parametrize(("poses", "why"), [(5, "these poses do not show it"), (13, "too few poses for 29 parameters")])
def test_cycles_of_few_poses_show_no_effect(poses: int, why: str) -> None:
    """150 rows of 5 poses are 15 numbers, and 390 of 13 poses 39: no more than geometry has, or hardly more."""
    found = selected(repeated(["compliance"], [*range(poses)] * 30))
    assert found.chosen == () and row(found, "compliance").infeasibility_reason == why


def one_joint_or_more(weights: dict[int, float]) -> Effect:
    """A single parameter that makes harmonics of several joints, each with its weight."""
    name = "wave" + "".join(str(i) for i in weights)

    def offsets(joints: Array, _: Array, values: Array) -> tuple[Array, Array]:
        derivative = np.zeros((*joints.shape, 1))
        for i, weight in weights.items():
            derivative[:, i - 1, 0] = weight * np.sin(3 * joints[:, i - 1])
        return derivative @ values, derivative

    return Effect(name, (Parameter(name, "size", name, "angle", MRAD, 1e-3),), offsets)


def test_a_group_that_later_ones_replace_is_dropped() -> None:
    """A surrogate of two effects is taken first, then each of them, then it has nothing left to say."""
    own = {made.name: made for made in map(one_joint_or_more, ({2: 1.0, 3: 1.0, 1: 0.6}, {2: 1.0}, {3: 1.0}))}

    def arm_with(groups: Sequence[str]) -> Model:
        return affected(IRB120.arm(("p1",)), [own[name] for name in groups])

    rng = np.random.default_rng(3)
    arm = arm_with(["wave2", "wave3"])
    values = values_with(arm, rng)
    values[-2:] = 2e-4
    taken: list[tuple[str, ...]] = []

    def watched(groups: Sequence[str]) -> Model:
        taken.append(tuple(groups))
        return arm_with(groups)

    data = simulated(arm, values, 60, rng)
    found = select(watched, data, nominal, Noise(None, SIGMA), candidates=tuple(own))
    assert sorted(found.chosen) == ["wave2", "wave3"]
    assert taken[-1] == found.chosen and "wave231" in taken[-2]
    assert "significant" in row(found, "wave231").infeasibility_reason
    np.testing.assert_allclose(found.identification.values[-2:], 2e-4, atol=1e-5)


def test_what_poses_do_not_show_is_held() -> None:
    """A joint that is always approached from one side has no play to be found; if all are, there is nothing to try."""
    rng = np.random.default_rng(0)
    arm = irb120(["backlash"])
    data = example(["backlash"])
    from_one_side = {**data.conditions, arm.conditions[3]: np.ones(60)}
    data = replace(data, conditions=from_one_side)
    points = arm.points(data.inputs(arm.conditions), values_with(arm, rng)) + SIGMA * rng.standard_normal((60, 1, 3))
    data = replace(data, points=points)
    found = select(irb120, data, nominal, Noise(None, SIGMA))
    taken = row(found, "backlash")
    assert (
        found.chosen == ("backlash",) and taken.fixed == found.fixed == ("joint4.backlash",) and taken.parameters == 5
    )
    assert not found.identification.unobservable
    assert found.identification.values[arm.names.index("joint4.backlash")] == 0.0
    all_from_one_side = {**data.conditions, **{name: np.ones(60) for name in arm.conditions}}
    found = select(irb120, replace(data, conditions=all_from_one_side), nominal)
    assert row(found, "backlash").infeasibility_reason == "these poses do not show it"


def test_parameters_too_unsure_to_tell_are_held() -> None:
    """With a target 0.1 mm off axis 6 its runout is seen to no better than 20 mrad: it is not fitted."""
    rng = np.random.default_rng(1)
    arm = irb120(["harmonics"])
    values = values_with(arm, rng)
    values[[arm.names.index(f"tool.p1.{axis}") for axis in "xyz"]] = 1e-4, 0.0, 0.1
    data = simulated(arm, values, 80, rng, sigma_m=2e-5)
    found = select(irb120, data, lambda model: model.nominal({"p1": np.array([0, 0, 0.1])}))
    assert found.chosen == ("harmonics",)
    assert found.fixed == ("joint6.sin1", "joint6.cos1") and row(found, "harmonics").parameters == 10


def test_masses_and_columns_that_are_missing() -> None:
    robot = load_robot("ur10")
    rng = np.random.default_rng(2)
    arm = robot.arm(("p1",))
    joints = robot.chain.random_joints(60, rng)
    points = arm.points(joints, somewhere(arm, rng)) + SIGMA * rng.standard_normal((60, 1, 3))
    data = measured(robot.chain.joint_names, joints, ("p1",), points)
    found = select(lambda g: robot.arm_with(("p1",), g), data, lambda m: m.nominal(robot.tool))
    assert found.chosen == () and "table without masses" in row(found, "compliance").infeasibility_reason
    assert row(found, "drift").infeasibility_reason == "column time_s is missing: the model needs it in every row"
    assert (
        np.isnan(row(found, "drift").bic)
        and "no such group"
        in row(
            select(lambda g: robot.arm_with(("p1",), g), data, lambda m: m.nominal(robot.tool), candidates=["sag"]),
            "sag",
        ).infeasibility_reason
    )


def measured_arm(file: str, robot: Robot) -> Selection:
    data = read_measurements(data_file(file), robot.chain.joint_names, robot.chain.prismatic).only("calibrate")
    data = data[data.seen.any(axis=1)]
    return select(lambda g: robot.arm_with(data.targets, g), data, lambda m: m.nominal(robot.tool))


@pytest.mark.thorough
def test_a_measured_irb120_gives_way_to_gravity() -> None:
    """36 poses with three targets (Liao et al.): two compliances nearly halve the error at poses held out."""
    found = measured_arm("irb120_liaowu_calib36.csv", IRB120)
    assert found.chosen == ("compliance",)
    geometry, compliance = found.groups[:2]
    assert compliance.parameters == 2 and compliance.holdout_m < 0.65 * geometry.holdout_m
    values = found.identification.values[-2:]
    assert (values > 1e-5).all() and (values < 4e-4).all()
