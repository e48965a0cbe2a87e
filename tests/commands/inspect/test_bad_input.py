"""Bad input to ``lab inspect``: one line that names the place and the mend, exit code 2, and no half-written run."""

import json
from pathlib import Path

import pytest
from helpers.bad_input import (
    ARM_TOML,
    ARM_URDF,
    ARM_XML,
    Case,
    assert_told_in_one_line,
    run,
    swapped,
    warnings_of,
    write,
)

pytestmark = pytest.mark.usefixtures("folder")

SECOND_ARM = '<body name="d" pos="1 0 0"><geom size=".1"/><joint name="r1"/></body></worldbody>'


def toml(name: str, text: str | bytes, *says: str) -> Case:
    return Case(f"toml: {name}", "inspect robot.toml", ("robot.toml", *says), {"robot.toml": text})


def model(name: str, text: str | bytes, *says: str, suffix: str = "xml") -> Case:
    return Case(f"{suffix}: {name}", f"inspect robot.{suffix}", (f"robot.{suffix}", *says), {f"robot.{suffix}": text})


OPTIONS = [
    Case("option: unknown target inspected", "inspect arm.toml --targets p1,q", ("'q'", "p1, p2, p3")),
    Case("option: no target", "inspect arm.toml --targets ''", ("targets (none)", "at least one")),
    Case("robot: unknown", "inspect irb121", ("'irb121'", "irb120", ".toml")),
    Case("robot: empty name", "inspect ''", ("''", "irb120")),
    Case("robot: the folder above", "inspect ..", ("'..'", "irb120")),
    Case("robot: a folder", "inspect folder.xml", ("folder.xml", "irb120"), {"folder.xml/x": ""}),
    Case("robot: a file of another kind", "inspect good.csv", ("good.csv", ".xml, .urdf or .toml")),
]

FITTING = [
    Case("model: auto to inspect", "inspect arm.toml --model auto", ("--model auto", "name groups")),
    Case("tool: two numbers", "inspect arm.toml --tool-mm 1,2", ("--tool-mm", "x, y and z")),
    Case("tool: words", "inspect arm.toml --tool-mm a,b,c", ("--tool-mm", "not a number")),
    Case("tool: not finite", "inspect arm.toml --tool-mm nan,0,0", ("--tool-mm nan", "finite")),
    Case("tool: beyond all", "inspect arm.toml --tool-mm 0,-1e999,0", ("--tool-mm -inf", "finite")),
    Case("tool: absurd", "inspect arm.toml --tool-mm 0,0,1e300", ("--tool-mm 1e+300", "at most")),
]

TABLES = [
    toml("empty", "", "is empty", "leave it out"),
    toml("malformed", 'name = "x"\nconvention distal\n', "not a TOML file", "line 2"),
    toml("truncated", ARM_TOML[:-12], "not a TOML file"),
    toml("binary", bytes(range(256)), "not a text file in UTF-8 (byte 128)", "save it as UTF-8"),
    toml("convention missing", swapped(ARM_TOML, 'convention = "distal"', ""), "convention", '"distal" or "craig"'),
    toml("convention unknown", swapped(ARM_TOML, "distal", "DH"), "'DH'", '"distal" or "craig"'),
    toml("no joints", 'convention = "distal"', "no joints", "[[joint]]"),
    toml("joints an empty list", 'convention = "distal"\njoint = []', "no joints", "[[joint]]"),
    toml("joints a number", 'convention = "distal"\njoint = 3', "no joints", "[[joint]]"),
    toml("d missing", swapped(ARM_TOML, "d_mm = 300\n", ""), "joint q1", "d is missing", "d_m or _mm"),
    toml(
        "d twice", swapped(ARM_TOML, "d_mm = 300\n", "d_mm = 300\nd_m = 0.3\n"), "joint q1", "d_m and d_mm", "keep one"
    ),
    toml("unknown type", swapped(ARM_TOML, "prismatic", "ball"), "joint rail", "'ball'", '"revolute" or "prismatic"'),
    toml("sign 2", swapped(ARM_TOML, "a_mm = 270\n", "a_mm = 270\nsign = 2\n"), "joint q2", "sign is 2", "1 or -1"),
    toml("sign true", swapped(ARM_TOML, "a_mm = 270\n", "a_mm = 270\nsign = true\n"), "joint q2", "sign", "1 or -1"),
    toml("slide without limits", swapped(ARM_TOML, "lower_mm = 0\nupper_mm = 300\n", ""), "joint rail", "upper_mm"),
    toml("slide without one limit", swapped(ARM_TOML, "upper_mm = 300\n", ""), "joint rail", "give upper_mm"),
    toml("limits crossed", swapped(ARM_TOML, "upper_deg = 150", "upper_deg = -160"), "joint q1", "lower limit", "swap"),
    toml(
        "one limit beyond a turn",
        swapped(ARM_TOML, "lower_deg = -150\nupper_deg = 150", "lower_deg = 190"),
        "q1",
        "swap",
    ),
    toml("unknown key of a joint", swapped(ARM_TOML, "a_mm", "offset = 1\na_mm"), "joint q1", "'offset'", "theta_deg"),
    toml("a slide in degrees", swapped(ARM_TOML, "upper_mm", "upper_deg"), "joint rail", "give upper_mm"),
    toml("unknown key on top", "units = 1\n" + ARM_TOML, "'units'", "drive, height_mm, joint, link, name, tool"),
    toml("a word for a number", swapped(ARM_TOML, "d_mm = 300", 'd_mm = "300"'), "joint q1", "d_mm is '300'", "finite"),
    toml("a truth for a number", swapped(ARM_TOML, "d_mm = 300", "d_mm = true"), "joint q1", "d_mm is True", "finite"),
    toml("infinite", swapped(ARM_TOML, "d_mm = 300", "d_mm = inf"), "joint q1", "d_mm is inf", "finite number"),
    toml(
        "too many digits", swapped(ARM_TOML, "d_mm = 300", f"d_mm = 1{'0' * 400}"), "d_mm", "63 bits", "smaller integer"
    ),
    toml("two joints of one name", swapped(ARM_TOML, '"q2"', '"q1"'), "joints 1 and 2", "named q1", "rename"),
    toml("a joint without a name", swapped(ARM_TOML, '"q2"', '""'), "joint 2", "empty name", "name it"),
    toml(
        "a speed of zero",
        swapped(ARM_TOML, "a_mm = 270", "a_mm = 270\nspeed_deg_per_s = 0"),
        "q2",
        "speed is 0",
        "zero",
    ),
    toml(
        "an acceleration of zero",
        swapped(ARM_TOML, "a_mm = 270", "a_mm = 270\nacceleration_rad_per_s2 = 0.0"),
        "joint q2",
        "acceleration is 0",
        "more than zero",
    ),
    toml(
        "a slide's speed in degrees",
        swapped(ARM_TOML, "upper_mm", "speed_deg_per_s = 9\nupper_mm"),
        "joint rail",
        "'speed_deg_per_s'",
        "of a slide _mm or _m",
    ),
    toml("a mass below zero", swapped(ARM_TOML, "a_mm = 270", "a_mm = 270\nmass_kg = -1"), "q2", "mass is -1", "zero"),
    toml("a height in words", 'height_mm = "high"\n' + ARM_TOML, "height_mm is 'high'", "above the floor"),
    toml("a target of two numbers", ARM_TOML + "[tool]\np1 = [0.1, 0.2]\n", "[tool] p1", "three numbers", "metres"),
    toml("a target of NaN", ARM_TOML + "[tool]\np1 = [0.1, 0.2, nan]\n", "[tool] p1", "three numbers"),
    toml("a tool that is a number", "tool = 5\n" + ARM_TOML, "tool is 5", "[tool]"),
    Case("toml: missing", "inspect robot.toml", ("robot.toml", "no such")),
]

MODELS = [
    model("empty", "", "empty file", "mend"),
    model("malformed", "<mujoco><worldbody", "not a readable MJCF or URDF", "mend", "line 1"),
    model("truncated", ARM_XML[:300], "not a readable MJCF or URDF", "mend"),
    model("binary", bytes(range(256)) * 4, "not a readable MJCF or URDF", "mend"),
    model("a page", "<html/>", "not a readable MJCF or URDF", "html"),
    model(
        "an include that is not there",
        swapped(ARM_XML, "<worldbody>", '<include file="gone.xml"/><worldbody>'),
        "gone.xml",
    ),
    model(
        "a texture that is not there",
        swapped(ARM_XML, "<worldbody>", '<asset><texture name="t" type="2d" file="gone.png"/></asset><worldbody>'),
        "gone.png",
        "mend",
    ),
    model("no joints", "<mujoco/>", "no joints", "hinge or slide"),
    model("two arms", swapped(ARM_XML, "</worldbody>", SECOND_ARM), "2 candidate chains", "q1, q2, q3; r1", "keep one"),
    model(
        "a fork",
        swapped(
            ARM_XML,
            '<body name="tip"',
            '<body name="f"><geom size=".1"/><joint name="left"/></body>'
            '<body name="tip"><geom size=".1"/><joint name="right"/></body><body name="tip2"',
        ),
        "2 candidate chains",
        "q1, q2, q3, left; q1, q2, q3, right",
        "keep one",
    ),
    model(
        "a ball joint",
        swapped(ARM_XML, 'axis="0 1 0" range="-170 170"', 'type="ball"'),
        "joint q2",
        "hinges and slides",
    ),
    model(
        "a free body",
        swapped(ARM_XML, "</worldbody>", '<body name="d"><freejoint name="f"/><geom size=".1"/></body></worldbody>'),
        "joint f",
        "hinges and slides",
    ),
    model(
        "two joints in a body",
        swapped(ARM_XML, '<joint name="q2"', '<joint name="x"/><joint name="q2"'),
        "body b",
        "x, q2",
        "its own body",
    ),
    model(
        "a loop",
        swapped(ARM_XML, "</worldbody>", '</worldbody><equality><joint joint1="q1" joint2="q2"/></equality>'),
        "1 equality",
        "remove",
    ),
    model(
        "a slide without range",
        swapped(ARM_XML, '<joint name="q2" axis="0 1 0" range="-170 170"', '<joint name="q2" type="slide"'),
        "slide q2",
        "no range",
        "give it one",
    ),
    model("limits crossed", swapped(ARM_XML, "-150 150", "150 -150"), "joint q1", "range", "swap"),
    model("unnamed body", swapped(ARM_XML, '<body name="b"', "<body"), "body 2", "name both"),
    model("unnamed joint", swapped(ARM_XML, '<joint name="q2"', "<joint"), "body 2", "name both"),
    model("one name twice", swapped(ARM_XML, 'name="q2"', 'name="q1"'), "q1", "mend"),
    model("no mass", swapped(ARM_XML, 'mass="1"', 'mass="0"'), "mass and inertia", "'a'", "mend"),
    model(
        "speeds that do not fit",
        swapped(
            ARM_XML, "<worldbody>", '<custom><numeric name="joint_speed_deg_per_s" data="1 2"/></custom><worldbody>'
        ),
        "2 values for 3 joints",
        "one each",
    ),
    model("malformed", swapped(ARM_URDF, "</robot>", ""), "not a readable MJCF or URDF", "mend", suffix="urdf"),
    model(
        "a link that is not there",
        swapped(ARM_URDF, 'parent link="l1"', 'parent link="l9"'),
        "parent",
        "mend",
        suffix="urdf",
    ),
    model(
        "a link with two parents",
        swapped(
            ARM_URDF,
            "</robot>",
            '<joint name="q3" type="revolute"><parent link="base"/><child link="l2"/><axis xyz="0 1 0"/>'
            '<limit lower="-2" upper="2" effort="1" velocity="1"/></joint></robot>',
        ),
        "multiple parents",
        "mend",
        suffix="urdf",
    ),
    model(
        "links in a ring",
        swapped(ARM_URDF, '<parent link="base"/>', '<parent link="l2"/>'),
        "mend",
        suffix="urdf",
    ),
    model(
        "a mimic joint",
        swapped(
            ARM_URDF, 'velocity="1"/>\n  </joint>\n</robot>', 'velocity="1"/><mimic joint="q1"/>\n  </joint>\n</robot>'
        ),
        "mimic joints",
        "remove",
        suffix="urdf",
    ),
]

CASES = [*OPTIONS, *FITTING, *TABLES, *MODELS]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_bad_input_is_told_in_one_line(case: Case, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert_told_in_one_line(case, folder, capfd)


def test_a_small_urdf_works(capfd: pytest.CaptureFixture[str]) -> None:
    assert run("inspect arm.urdf --json") == 0
    table = json.loads(capfd.readouterr().out)
    assert [joint["d_mm"] for joint in table["joints"]] == [400.0, 0.0]
    assert run("calibrate --robot arm.urdf --poses 12 --json") == 0


@pytest.mark.parametrize("suffix", ["urdf", "xml"])
def test_a_missing_mesh_is_told_and_a_virtual_arm_needs_it(
    suffix: str, folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    mesh = '<visual><geometry><mesh filename="package://arm/gone.dae"/></geometry></visual>'
    urdf = swapped(ARM_URDF, '<link name="l2">', '<link name="l2">' + mesh + mesh.replace("visual", "collision"))
    mjcf = swapped(ARM_XML, "<worldbody>", '<asset><mesh name="m" file="gone.stl"/></asset><worldbody>')
    mjcf = swapped(mjcf, '<geom type="box" size=".02 .02 .02" mass="1"/>', '<geom type="mesh" mesh="m"/>')
    write(folder, {"robot.urdf": urdf, "robot.xml": mjcf})
    assert run(f"inspect robot.{suffix} --json") == 0
    warning = "\n".join(warnings_of(capfd.readouterr().err))
    assert f"robot.{suffix}" in warning and "gone." in warning and "left out" in warning
    assert run(f"calibrate --robot robot.{suffix} --poses 12 --out run") == 2
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert f"robot.{suffix}" in line and "gone." in line and "add them" in line and not Path("run").exists()


TETRAHEDRON = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def test_unnamed_parts_and_masses_of_meshes_do_not_matter(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    mjcf = swapped(ARM_XML, "<worldbody>", '<asset><mesh name="m" file="m.obj"/></asset><worldbody>')
    mjcf = swapped(
        mjcf, '<geom type="box" size=".02 .02 .02" mass="1"/>', '<geom type="mesh" mesh="m" contype="0"/><site/>'
    )
    mjcf = swapped(mjcf, '<body name="tip"', "<body")
    write(folder, {"robot.xml": mjcf, "m.obj": TETRAHEDRON})
    assert run("calibrate --robot robot.xml --poses 12 --seed 1 --out run --json") == 0
    assert warnings_of(capfd.readouterr().err) == []
    assert run("inspect run/calibrated.xml --json") == 0


@pytest.mark.pages
def test_an_inspection_is_kept_where_that_is_asked_for(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run("inspect arm.toml --json --out looked") == 0
    result = json.loads((folder / "looked" / "result.json").read_text())
    assert result == json.loads(capfd.readouterr().out)
    assert "<h1>" in (folder / "looked" / "report.html").read_text()
    assert run("inspect arm.toml --out looked") == 2 and "holds an earlier run" in capfd.readouterr().err
    assert run("inspect arm.toml") == 0 and not (folder / "runs").exists()
