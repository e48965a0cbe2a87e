"""The inverse dynamic model of a whole arm: against MuJoCo, against published counts, and against textbook formulas."""

from dataclasses import replace

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.extensions.dynamics.arm.base_parameters import base_parameters, random_states, regrouping_formulas
from lab.extensions.dynamics.arm_simulation import CarryingArm, drawn_mounting
from lab.kinematics.dynamics.rigid_body import (
    ArmDynamics,
    flange_in_last_link,
    load_in_frame,
    torque_regressor,
)
from lab.kinematics.serial.serial_arm import SerialArm
from lab.robots.load_robot import load_virtual
from lab.simulation.load_model import link_inertias

SERIAL = ("irb120", "tx40", "rx130", "scara", "scemi", "versatran", "course2r")
DOWN = np.array([0.0, 0.0, -9.81])
WRIST = np.eye(6)
WRIST[5, 4] = 1.0  # the sixth drive turns with joint 5 too


@pytest.mark.parametrize("name", SERIAL)
def test_the_regressor_gives_mujocos_inverse_dynamics(name: str) -> None:
    model = load_virtual(name).serial_model
    gravity = drawn_mounting(model).gravity + np.array([0.3, -0.2, 0.1])
    arm = ArmDynamics.of(model.chain, gravity)
    states = random_states(arm, 30, np.random.default_rng(1))
    expected = CarryingArm(model, gravity).torques(*states)
    ours = arm.regressor(*states) @ arm.standard(link_inertias(model), {})
    assert np.abs(ours - expected).max() <= 1e-11 * max(1.0, np.abs(expected).max())


def test_drives_and_joints_have_their_inertia_and_friction() -> None:
    arm = ArmDynamics.of(load_virtual("tx40").serial_model.chain, DOWN, WRIST)
    assert len(arm.names) == 86  # 14 a joint, and two of the coupled drive
    joints, speeds, accelerations = random_states(arm, 7, np.random.default_rng(2))
    others = {"Ia6": 0.3, "Fc5": 2.0, "Fv6": 0.7, "Fcm6": 1.5, "Fvm6": 0.2, "off1": 4.0}
    torques = arm.regressor(joints, speeds, accelerations) @ arm.standard(np.zeros((6, 10)), others)
    both = speeds[:, 4] + speeds[:, 5]
    sixth = 0.3 * (accelerations[:, 4] + accelerations[:, 5]) + 1.5 * np.sign(both) + 0.2 * both
    np.testing.assert_allclose(torques[:, 5], sixth + 0.7 * speeds[:, 5], atol=1e-13)
    # tau5 = f5 + f6: what drive 5 gives is joint 5's friction less what drive 6 brings to it beyond its own losses
    np.testing.assert_allclose(torques[:, 4], 2.0 * np.sign(speeds[:, 4]) - 0.7 * speeds[:, 5], atol=1e-13)
    np.testing.assert_allclose(torques[:, 0], 4.0, atol=1e-13)


def test_a_load_at_the_flange_is_one_of_the_last_link() -> None:
    chain = load_virtual("irb120").serial_model.chain
    table = chain.table.copy()
    table[5, 2:4] = 0.05, 0.3  # a distal table's last link ends behind its joint
    chain = chain.with_table(table)
    arm, flange = ArmDynamics.of(chain, DOWN), SerialArm(chain)
    states = random_states(arm, 5, np.random.default_rng(3))
    phi = np.array([1.5, 0.01, -0.02, 0.08, 0.02, 0.03, 0.015, 0.001, -0.002, 0.003])
    in_link = load_in_frame(flange_in_last_link(chain)) @ phi
    links = np.zeros((6, 10))
    links[5] = in_link
    expected = torque_regressor(flange, flange.nominal(), *states, DOWN) @ phi
    np.testing.assert_allclose(arm.regressor(*states) @ arm.standard(links, {}), expected, atol=1e-12)
    assert np.abs(in_link - phi).max() > 0.01  # the flange stands off


@pytest.mark.parametrize(
    ("name", "inertial", "all_of_them"),
    # Six axes, the first along gravity: 36 of links, with the inertias of motors 3 to 6 40, as SYMORO computes of the
    # RX 90 (below); with friction and offsets 58.
    [
        *((name, 40, 58) for name in ("irb120", "tx40", "rx130", "scemi")),
        ("scara", 10, 22),
        ("versatran", 29, 47),
        ("course2r", 8, 14),
    ],
)
def test_there_are_as_many_base_parameters_as_published_and_as_the_rank_says(
    name: str, inertial: int, all_of_them: int
) -> None:
    arm = ArmDynamics.of(load_virtual(name).serial_model.chain, DOWN)
    base = base_parameters(arm, np.random.default_rng(0))
    assert (base.inertial, base.size) == (inertial, all_of_them)
    columns = arm.regressor(*random_states(arm, 60, np.random.default_rng(5))).reshape(-1, len(arm.names))
    values = np.linalg.svd(columns / np.linalg.norm(columns, axis=0).clip(1.0), compute_uv=False)
    assert (values > 1e-10 * values[0]).sum() == all_of_them
    np.testing.assert_allclose(
        columns[:, base.independent] @ base.projection, columns, atol=1e-10 * np.abs(columns).max()
    )


SYMORO = """ZZR1 = IA1 + ZZ1 + YY2 + YY3 + d2*(M3 + M4 + M5 + M6)
XXR2 = XX2 - YY2 - d2*(M3 + M4 + M5 + M6)
XZR2 = XZ2 - d*MZ3
ZZR2 = IA2 + ZZ2 + d2*(M3 + M4 + M5 + M6)
MXR2 = MX2 + d*(M3 + M4 + M5 + M6)
XXR3 = XX3 - YY3 + YY4 + 2*r*MZ4 + r2*(M4 + M5 + M6)
ZZR3 = ZZ3 + YY4 + 2*r*MZ4 + r2*(M4 + M5 + M6)
MYR3 = MY3 + MZ4 + r*(M4 + M5 + M6)
XXR4 = XX4 - YY4 + YY5
ZZR4 = ZZ4 + YY5
MYR4 = MY4 - MZ5
XXR5 = XX5 - YY5 + YY6
ZZR5 = ZZ5 + YY6
MYR5 = MY5 + MZ6
XXR6 = XX6 - YY6"""  # of the RX 90, written out: Robots/RX90/RX90_regp.txt of github.com/symoro/symoro
ALONE = """XY2 YZ2 MY2 XY3 XZ3 YZ3 MX3 IA3 XY4 XZ4 YZ4 MX4 IA4 XY5 XZ5 YZ5 MX5 IA5 XY6 XZ6 YZ6 ZZ6 MX6 MY6
IA6"""


def test_the_rx_90_as_symoro_computes_it() -> None:
    """All 40 base parameters, by numbers: gravity along axis 1, motor inertias, no other parameter zero."""
    chain = load_virtual("scemi").serial_model.chain
    table = chain.table.copy()
    table[5, 1] = 0.0  # the frame of link 6 is at the wrist
    arm = replace(ArmDynamics.of(chain.with_table(table), DOWN), friction=False, offsets=False)
    base = base_parameters(arm, np.random.default_rng(0))
    values = np.random.default_rng(1).normal(size=len(base.names))
    known = {name.upper(): value for name, value in zip(base.names, values.tolist(), strict=True)}
    d, r = arm.chain.table[2, 2], arm.chain.table[3, 1]
    lengths = {"d": d, "d2": d * d, "r": r, "r2": r * r}
    expected = {name: known[name] for name in ALONE.split()}
    expected |= {line.split(" = ")[0]: eval(line.split(" = ")[1], known | lengths) for line in SYMORO.splitlines()}
    found = dict(zip((label.upper() for label in base.labels), base.projection @ values, strict=True))
    assert len(expected) == 40 and found == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_formulas_give_the_numbers_of_the_arm() -> None:
    arm = ArmDynamics.of(load_virtual("irb120").serial_model.chain, DOWN)
    rng = np.random.default_rng(0)
    base = base_parameters(arm, rng)
    names = list(base.names)
    lengths = {
        arm.letter(kind, i + 1): row[column]
        for i, row in enumerate(arm.chain.table)
        for column, kind in ((1, "d"), (2, "a"))
    }
    for formula, row in zip(regrouping_formulas(arm, base, rng), base.projection, strict=True):
        own = np.zeros(len(names))
        own[names.index(formula.name)] = 1.0
        for term in formula.terms:
            own[[names.index(name) for name in term.names]] = term.value(lengths)
        np.testing.assert_allclose(own, row, atol=1e-8)


def test_couplings_that_cannot_be_are_refused() -> None:
    chain = load_virtual("tx40").serial_model.chain
    with pytest.raises(LabError, match="singular"):
        ArmDynamics.of(chain, DOWN, np.ones((6, 6)))
    with pytest.raises(LabError, match=r"\(6, 6\)"):
        ArmDynamics.of(chain, DOWN, np.eye(5))
