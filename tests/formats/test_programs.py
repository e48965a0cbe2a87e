"""Languages of programs, and robot descriptions as URDF: what joints they can move."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from typing import get_args

import pytest
from helpers.robots import IRB120, SCARA

from lab.formats.description import IdentifiedRobot
from lab.formats.programs.languages import (
    PLAN,
    Controller,
    language_of,
    languages,
    plan_or_refusal,
    refusal,
)
from lab.formats.urdf import identified_urdf


def test_each_language_moves_the_joints_or_says_why_not() -> None:
    assert tuple(language.name.lower() for language in languages()) == get_args(Controller)
    for language in languages():
        name = language.name.lower()
        assert plan_or_refusal(IRB120.chain, name)[name] == PLAN + language.suffix
        assert refusal(IRB120.chain, name) is None
        why = language.refusal(SCARA)
        assert why is not None and plan_or_refusal(SCARA, name)[name] == refusal(SCARA, name) == why
        others = {key: said for key, said in plan_or_refusal(IRB120.chain, name).items() if key != name}
        assert all(said.startswith(f"no program in it: {language.name}") for said in others.values())


@pytest.mark.parametrize(
    ("robot", "language"),
    [
        ("irb120", "RAPID"), ("abb_irb1200_5_90", "RAPID"), ("ur5_robot", "URScript"), ("ur10e", "URScript"),
        ("kr6_r900", "KRL"), ("kuka_arm", "KRL"), ("lrmate200id", "FANUC"), ("tx40", "VAL3"), ("rx160", "VAL3"),
        ("panda", None), ("turtle", None), ("arm", None), ("krane", None), ("two links", None),
    ],
)  # fmt: skip
def test_a_makers_language_is_told_by_the_robots_name(robot: str, language: str | None) -> None:
    """No RAPID for a Universal Robot; where the maker is not known there is no program, and it is said."""
    chain = replace(IRB120.chain, name=robot)
    found = language_of(chain, None)
    assert (found and found.name) == language
    if language is None:
        assert f"the maker of robot {robot} is not known; choose --controller of fanuc," in (refusal(chain, None) or "")
        assert not any(each.startswith(PLAN) for each in plan_or_refusal(chain, None).values())
    asked = language_of(chain, "krl")
    assert asked is not None and asked.name == "KRL"


def test_the_urdf_of_a_robot_has_its_joints() -> None:
    arm = IRB120.arm(("p1",))
    text = identified_urdf(IdentifiedRobot("irb120", arm, arm.nominal(IRB120.tool), None, None))
    joints = [joint.get("name") for joint in ET.fromstring(text).iter("joint") if joint.get("type") == "revolute"]
    assert tuple(joints) == IRB120.chain.joint_names
