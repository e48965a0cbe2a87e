"""Elastic links of the virtual arm: against beam formulas, a chain of rigid pieces on springs, and the identifier's."""

from pathlib import Path

import numpy as np
import pytest
from beam_chain import BeamChain
from helpers.robots import IRB120

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.effects.bending import ElasticLinks
from lab.kinematics.effects.effect import ArmFacts
from lab.kinematics.effects.effect_registry import EffectOptions
from lab.robots.load_robot import load_robot, load_virtual
from lab.robots.robot import Robot
from lab.simulation.effects import random_effects, true_parameters
from lab.simulation.elastic_links import AT_REST, FlexibleArm, JointMotion

ALUMINIUM = np.array([2.067e-5, 2.067e-5, 2.79e-5, 1.5e-8])  # a tube of 80 x 4 mm: 1/EI, 1/EI, 1/GJ, 1/EA
JOINTS = IRB120.chain.random_joints(2, np.random.default_rng(1))
PAYLOAD = np.array([0.5, 3.0])


def sections(*links: int, size: int = 6, scale: float = 1.0) -> Array:
    """Links (from 1) of tube."""
    found = np.zeros((size, 4))
    found[[link - 1 for link in links]] = scale * ALUMINIUM
    return found


def cantilever(tmp_path: Path, mass: float, tip: str, weight: float) -> Robot:
    """A level beam of 0.8 m, its mass along it, with one body at its end."""
    path = tmp_path / "beam.xml"
    path.write_text(
        "<mujoco><compiler angle='radian'/><worldbody>"
        "<body name='post'><joint name='q1' axis='0 0 1' range='-2 2'/>"
        f"<inertial pos='.4 0 0' mass='{mass}' diaginertia='1e-3 1e-1 1e-1'/>"
        "<body name='hand' pos='.8 0 0'><joint name='q2' axis='0 0 1' range='-2 2'/>"
        f"<inertial pos='{tip}' mass='{weight}' diaginertia='1e-3 1e-3 1e-3'/><site name='p1' pos='0 0 0'/>"
        "<site name='flange' pos='0 0 0'/></body></body></worldbody></mujoco>"
    )
    return load_robot(str(path))


def sag(robot: Robot, made: FlexibleArm, payload_kg: float = 0.0) -> Array:
    """How far the first target goes ``(3,)``."""
    zero = np.zeros((1, robot.chain.size))
    sites = [robot.serial_model.model.site("p1").id]
    settled = made.settled(zero, np.zeros(robot.chain.size), np.array([payload_kg]))
    return (made.positions(settled, sites) - made.positions(made.straight(zero), sites))[0, 0]


def test_a_single_link_sags_as_the_textbook_says(tmp_path) -> None:
    """F L^3 / 3EI + w L^4 / 8EI, and a hand beside the end twists it; to what the load's own turn changes."""
    EI, GJ, length = 1 / ALUMINIUM[0], 1 / ALUMINIUM[2], 0.8
    robot = cantilever(tmp_path, 4.0, "0 0 0", 5.0)
    made = FlexibleArm(robot.serial_model.model, robot.serial_model, sections=sections(1, size=2))
    expected = -9.81 * (5 * length**3 / 3 + 4 / length * length**4 / 8) / EI
    assert sag(robot, made)[2] == pytest.approx(expected, rel=1e-5)
    assert sag(robot, made, 3.0)[2] == pytest.approx(expected - 9.81 * 3 * length**3 / 3 / EI, rel=1e-5)
    aside = cantilever(tmp_path, 4.0, "0 .1 0", 5.0)
    made = FlexibleArm(aside.serial_model.model, aside.serial_model, sections=sections(1, size=2))
    settled = made.settled(np.zeros((1, 2)), np.zeros(2), np.zeros(1))
    assert settled.torsors[0, 0, 3] == pytest.approx(-9.81 * 5 * 0.1 * length / GJ, rel=1e-4)


@pytest.mark.thorough
def test_a_chain_with_corners_converges_to_the_l_shaped_beam(tmp_path) -> None:
    """An upper arm in a U and a forearm in an L: order N^-2, 0.1 % at 64, loaded, at rest and in motion."""
    described = tmp_path / "corners.toml"
    lines = {2: [[0, 0, 0], [0, 0, 90], [270, 0, 90], [270, 0, 0]], 4: [[0, 0, 0], [0, 60, 0], [0, 0, 302]]}
    tubes = [
        f"[[link]]\nnumber={n}\nmaterial='aluminium'\ntube_mm=[80,4]\npath_mm={line}\n" for n, line in lines.items()
    ]
    described.write_text("robot = 'irb120'\n" + "".join(tubes))
    robot, rng = load_robot(str(described)), np.random.default_rng(4)
    model, elastic = robot.serial_model, robot.link_compliances
    assert elastic is not None
    made, sites = FlexibleArm(model.model, model, sections=elastic), [model.model.site("p1").id]
    joints, load = JOINTS[:1], PAYLOAD[1:]
    rigid = made.positions(made.straight(joints), sites)
    for motion in (AT_REST, JointMotion(2 * rng.normal(size=(1, 6)), 10 * rng.normal(size=(1, 6)))):
        moved = made.positions(made.settled(joints, np.zeros(6), load, motion), sites) - rigid
        off = []
        for pieces in (4, 8, 64) if motion is AT_REST else (4, 8):
            chain = BeamChain(model.model, model, elastic, pieces).positions(joints, ("p1",), load, motion) - rigid
            off.append(np.linalg.norm(chain - moved) / np.linalg.norm(moved))
        assert off[0] / off[1] == pytest.approx(4, rel=0.05) and off[-1] < (1e-3 if motion is AT_REST else 2e-2)
    known = FlexibleArm(IRB120.model.model, IRB120.model, sections=elastic)  # the same tubes in straight lines
    straight = known.positions(known.settled(joints, np.zeros(6), load), sites) - rigid
    bent = made.positions(made.settled(joints, np.zeros(6), load), sites) - rigid
    assert np.linalg.norm(bent - straight) > 0.2 * np.linalg.norm(straight)


def test_an_arm_with_a_table_and_a_load_aside_bends_as_its_chain() -> None:
    """The TX 40, whose table has the other convention, with a load beside the flange."""
    robot, at = load_virtual("tx40"), np.array([0.01, -0.005, 0.06])
    model, elastic = robot.serial_model, sections(2, 4, 6, scale=3)
    joints = robot.chain.random_joints(2, np.random.default_rng(3))
    made, load = FlexibleArm(model.model, model, at, elastic), np.full(2, 1.5)
    sites = [model.model.site("p1").id]
    rigid = made.positions(made.straight(joints), sites)
    moved = made.positions(made.settled(joints, np.zeros(6), load), sites) - rigid
    chain = BeamChain(model.model, model, elastic, 32, at).positions(joints, ("p1",), load) - rigid
    assert np.linalg.norm(chain - moved) < 2e-4 * np.linalg.norm(moved)


def test_the_identifiers_arm_is_the_virtual_one() -> None:
    """Loads at the nominal pose leave out what the sag changes in them: a share of sag over reach."""
    tubes = sections(1, 2, 3, 4, 6) * [1.0, 1.0, 1.0, 0.0]
    made = FlexibleArm(IRB120.model.model, IRB120.model, sections=tubes)
    arm = IRB120.arm_with(("p1",), ("bending", "torsion"))
    nominal = IRB120.model.values_before(arm.rigid, np.eye(4))
    true = true_parameters(random_effects(FACTS, SIZES, np.random.default_rng(0)))
    effects = np.array([true[name] for name in arm.names[len(nominal) :]])
    inputs, size = np.column_stack([JOINTS, PAYLOAD]), len(effects)
    moved = arm.points(inputs, np.append(nominal, effects)) - arm.points(inputs, np.append(nominal, np.zeros(size)))
    sites = [IRB120.model.model.site("p1").id]
    settled = made.settled(JOINTS, np.zeros(6), PAYLOAD)
    expected = made.positions(settled, sites) - made.positions(made.straight(JOINTS), sites)
    np.testing.assert_allclose(moved, expected, atol=2e-3 * np.abs(expected).max())


FACTS = ArmFacts(IRB120.chain, IRB120.loads)
SIZES = EffectOptions(link_ei=(1 / ALUMINIUM[0],), link_gj=(1 / ALUMINIUM[2],))


def test_options_say_which_links_are_elastic() -> None:
    every = random_effects(FACTS, SIZES, np.random.default_rng(0)).part(ElasticLinks).compliances
    assert (every[[0, 1, 2, 3, 5], :3] > 0).all() and not every[4].any()  # link 5 has no length
    some = random_effects(FACTS, EffectOptions(link_ei=(0, 2e4, 0, 5e4, 0, 0)), np.random.default_rng(0))
    np.testing.assert_allclose(some.part(ElasticLinks).compliances[1], [5e-5, 5e-5, 0, 0])
    assert true_parameters(some)["link4.ei_z"] == pytest.approx(2e-5) and some.is_elastic
    for wrong, message in (
        (EffectOptions(link_ei=(1.0, 2.0)), "--link-ei: 2 numbers for the 6 links of robot irb120"),
        (EffectOptions(link_gj=(0, 0, 0, 0, 1e4, 0)), "--link-gj: link 5 of robot irb120 has no length"),
    ):
        with pytest.raises(LabError, match=message):
            random_effects(FACTS, wrong, np.random.default_rng(0))
    with pytest.raises(LabError, match="has no masses, so nothing bends it"):
        random_effects(ArmFacts(IRB120.chain), SIZES, np.random.default_rng(0))
