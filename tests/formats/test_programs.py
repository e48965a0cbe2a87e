"""Languages of programs, and robot descriptions as URDF: what joints they can move."""

import xml.etree.ElementTree as ET

from helpers.robots import IRB120, SCARA

from lab.formats.programs.registry import LANGUAGES, languages_of, plan_or_refusal, program_file_names, refusals
from lab.formats.urdf import URDF


def test_each_language_moves_the_joints_or_says_why_not() -> None:
    assert languages_of(IRB120.chain) == LANGUAGES and refusals(IRB120.chain) == ()
    assert len(languages_of(SCARA)) + len(refusals(SCARA)) == len(LANGUAGES)
    for language in LANGUAGES:
        name = language.name.lower()
        assert plan_or_refusal(IRB120.chain)[name] in program_file_names()
        why = language.refusal(SCARA)
        assert plan_or_refusal(SCARA)[name] == (why or f"plan{language.suffix}")


def test_the_urdf_of_a_robot_has_its_joints() -> None:
    arm = IRB120.arm(("p1",))
    text = IRB120.description(next(name for name in IRB120.description_files if name.endswith("urdf")), ("p1",),
                              arm.nominal(IRB120.tool))  # fmt: skip
    joints = [joint.get("name") for joint in ET.fromstring(text).iter("joint") if joint.get("type") == "revolute"]
    assert tuple(joints) == IRB120.chain.joint_names and URDF.file.endswith(".urdf")
