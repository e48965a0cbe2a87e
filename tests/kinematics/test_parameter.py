"""What a model knows of its parameters: units, groups, scales and nominal values, without reading their names."""

import numpy as np
import pytest
from helpers.robots import IRB120, VERSATRAN

from lab.calibration.guess import columns_of
from lab.calibration.prior import Tolerance, standard_deviations
from lab.kinematics.effects.effect import SessionInfo
from lab.kinematics.effects.effect_registry import GROUPS, effect
from lab.kinematics.parameter import (
    BASE_PARAMETERS,
    Parameter,
    is_reserved_owner,
    names_of,
    targets_of,
)
from lab.robots.load_robot import load_robot, load_virtual
from lab.sensors.cable import Cable
from lab.sensors.plane import Planes
from lab.sensors.socket import Sockets

TARGETS = ("p1", "p2")
SESSIONS = SessionInfo(("a", "b"))


def by_name(parameters: tuple[Parameter, ...]) -> dict[str, Parameter]:
    return {parameter.name: parameter for parameter in parameters}


@pytest.mark.parametrize("name", ["irb120", "tx40", "versatran", "scara", "delta", "rpr2"])
def test_a_models_names_and_nominal_values_are_its_parameters(name: str) -> None:
    arm = load_robot(name).arm(TARGETS)
    assert arm.names == names_of(arm.parameters) and len(set(arm.names)) == len(arm.names)
    np.testing.assert_array_equal([each.nominal for each in arm.parameters], arm.nominal())
    assert arm.parameters[:6] == BASE_PARAMETERS and targets_of(arm.parameters) == TARGETS
    assert {each.group for each in arm.parameters} == {"base", "link", "tool"}
    for each in arm.parameters:
        assert each.is_angle == (each.symbol in ("rx", "ry", "rz", "theta", "alpha", "beta"))
        assert each.unit.si == ("rad" if each.is_angle else "m")
        assert np.isfinite(each.scale) == each.is_link


def test_units_of_effects() -> None:
    made = [effect(name, IRB120.chain, IRB120.loads, SESSIONS) for name in GROUPS if name != "compliance"]
    units = {each.name: each.unit.si for effect_ in made for each in effect_.parameters}
    expected = {
        "joint2.compliance": "rad/Nm",
        "payload.mass": "kg",
        "joint1.sin1": "rad",
        "joint6.cos2": "rad",
        "joint1.gear": "",
        "joint6.coupling4": "",
        "joint3.backlash": "rad",
        "drift.x": "m/h",
        "drift.rz": "rad/h",
        "drift.scale": "1/h",
        "session.b.y": "m",
        "session.b.rx": "rad",
        "joint4.hysteresis": "rad",
        "joint2.spring_sin2": "rad",
        "joint3.hardening": "rad/(Nm)^3",
        "thermal.expansion": "1/K",
        "joint6.thermal": "rad/K",
    }
    assert {name: units[name] for name in expected} == expected


def test_a_slide_has_its_own_units() -> None:
    slides = [i for i, slides in enumerate(VERSATRAN.prismatic) if slides]
    made = by_name(effect("backlash", VERSATRAN, None).parameters)
    assert slides == [1, 2]
    assert [made[f"joint{i + 1}.backlash"].unit.si for i in range(3)] == ["rad", "m", "m"]
    robot = load_virtual("scara")
    vertical = robot.chain.prismatic.index(True)
    found = [each for each in effect("compliance", robot.chain, robot.loads).parameters if each.joint == vertical]
    assert [each.unit.si for each in found] == ["m/N"]


def test_places_are_known_by_nothing_and_an_offset_by_its_size() -> None:
    arm = IRB120.arm(("p1",))
    for kind in (Cable, Sockets, Planes):
        model = kind(arm, arm.nominal(), (0, 1), ("a", "b"))
        added = model.parameters[len(arm.parameters) :]
        assert names_of(model.parameters) == model.names
        assert columns_of(model, [kind.group]) == tuple(range(model.first, len(model.names)))
        assert [each.scale for each in added if each.group == kind.group] == [np.inf] * 6
        assert [each.scale for each in added if each.group == "cable"] == [1e-2] * len(model.shared)
    plane = Planes(arm, arm.nominal(), (0,), ("",))
    assert names_of(plane.parameters[-3:]) == ("plane.rx", "plane.ry", "plane.z")
    assert [each.unit.si for each in plane.parameters[-3:]] == ["rad", "rad", "m"]


def test_standard_deviations_are_tolerances_of_links_and_scales_of_the_rest() -> None:
    arm = IRB120.arm_with(("p1",), ("gear", "drift"))
    sigma = dict(zip(arm.names, standard_deviations(arm, Tolerance(1e-4, 2e-4)), strict=True))
    assert sigma["link2.d"] == 1e-4 and sigma["link4.alpha"] == 2e-4
    assert sigma["link2.alpha"] == pytest.approx(2e-4 * 7 / 3)  # axes 2 and 3 are parallel
    assert np.isinf(sigma["base.x"]) and np.isinf(sigma["tool.p1.z"])
    assert sigma["joint1.gear"] == 1e-3 and sigma["drift.x"] == 1e-2 and sigma["drift.scale"] == 1e-3


@pytest.mark.parametrize("name", ["base", "tool", "session", "joint12", "anchor", "cable"])
def test_names_that_a_persons_frames_may_not_have(name: str) -> None:
    assert is_reserved_owner(name)
    assert not is_reserved_owner(f"{name}_of_mine")
