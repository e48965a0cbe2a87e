"""Descriptions of mechanisms: back and forth to the bit; what is wrong with one is told in one line, exit code 2."""

from pathlib import Path

import numpy as np
import pytest
from helpers.mechanisms import CRANK
from helpers.robots import ROOT

from lab.cli.main import main
from lab.formats.mechanism_toml import read_mechanism, write_mechanism
from lab.kinematics.closed.loop_closure import Tree
from lab.kinematics.closed.mechanism import Mechanism

MODELS = ROOT / "models"

TWO_LEGS = """\
name = "two"
height_mm = 0
platform = "P"

[[joint]]
name = "rho1"
type = "prismatic"
lower_mm = 350
upper_mm = 800

[[joint]]
name = "rho2"
type = "prismatic"
lower_mm = 350
upper_mm = 800

[[frame]]
name = "A1"
path = [{ x_mm = 0 }, { y_mm = 0 }]

[[frame]]
name = "A2"
path = [{ x_mm = 600 }, { y_mm = 0 }]

[[frame]]
name = "P"
path = [{ x_mm = 300, passive = true }, { y_mm = 500, passive = true }]

[[rod]]
name = "leg1"
between = ["P", "A1"]
joint = "rho1"

[[rod]]
name = "leg2"
between = ["P", "A2"]
joint = "rho2"

[tool]
p1 = [0.0, 0.0, 0.05]
"""
LEG1, LEG2 = (f'[[rod]]\nname = "leg{i}"\nbetween = ["P", "A{i}"]\njoint = "rho{i}"\n' for i in (1, 2))
JOINT2 = '[[joint]]\nname = "rho2"\ntype = "prismatic"\nlower_mm = 350\nupper_mm = 800\n'


def two(*changes: tuple[str, str]) -> str:
    """The two legs, with pieces of text replaced once each."""
    return changed(TWO_LEGS, changes)


def changed(text: str, changes: tuple[tuple[str, str], ...]) -> str:
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return text


def path_of_a2(path: str) -> str:
    return two(("path = [{ x_mm = 600 }, { y_mm = 0 }]", path))


def rod(length: str) -> str:
    """The second leg is a rod, the first joint still a leg's length."""
    return two((JOINT2, ""), (LEG2, LEG2.replace('joint = "rho2"', length)))


LOOSE = '[[frame]]\nname = "D"\npath = [{ x_mm = 0, joint = "rho2" }]\n'
PIN = '[[pin]]\nname = "pin1"\nbetween = ["P", "A2"]\nalong = "xy"\n'

# what is wrong, the file, what the line says beside the file's name
BAD: dict[str, tuple[str, tuple[str, ...]]] = {
    "too few closures": (two((LEG2, ""), (JOINT2, "")), ("mobility is 2", "joints are 1", "add rods or pins")),
    "too many closures": (
        two((LEG2, LEG2 + LEG2.replace("leg2", "leg3").replace('joint = "rho2"', "length_mm = 500"))),
        ("mobility is 1", "joints are 2", "take rods or pins out"),
    ),
    "nothing is passive": (
        two(("{ x_mm = 300, passive = true }, { y_mm = 500, passive = true }", "")),
        ("mobility is 0", "make steps passive"),
    ),
    "no rods": (two((LEG1, ""), (LEG2, "")), ("joint rho1", "moves nothing", "let one step or rod name it")),
    "ends that cannot meet": (
        two(("x_mm = 600", "x_mm = 1700")),
        ("in the nominal position (rho1 575 mm, rho2 575 mm) leg1, leg2 cannot meet: 275 mm stay open", "mend lengths"),
    ),
    "a joint that moves nothing": (
        two((LEG2, LEG2.replace('joint = "rho2"', "length_mm = 500"))),
        ("joint rho2: moves nothing",),
    ),
    "a joint of a loose frame": (
        two((LEG2, LEG2.replace('joint = "rho2"', "length_mm = 500") + LOOSE)),
        ("joint rho2", "frame D", "join a rod or a pin"),
    ),
    "a joint of two legs": (two(('joint = "rho2"', 'joint = "rho1"')), ("joint rho1: moves 2 steps or rods",)),
    "a passive step of nothing": (
        two(
            (LEG2, LEG2 + PIN.replace('"xy"', '"x"') + '[[frame]]\nname = "D"\npath = [{ z_mm = 0, passive = true }]\n')
        ),
        ("frame D", "no rod or pin holds its passive z"),
    ),
    "an unknown joint": (two(('joint = "rho2"', 'joint = "rho9"')), ("rod leg2", "no joint 'rho9'", "rho1, rho2")),
    "a joint as a list": (two(('joint = "rho2"', 'joint = ["rho2"]')), ("rod leg2", "no joint ['rho2']")),
    "an unknown frame": (two(('["P", "A2"]', '["P", "A9"]')), ("rod leg2", "no frame 'A9'", "base, A1, A2, P")),
    "on an unknown frame": (
        two(('name = "A1"', 'name = "A1"\non = "B"')),
        ("frame A1", "no frame 'B'", "there are base"),
    ),
    "on a later frame": (two(('name = "A1"', 'name = "A1"\non = "A2"')), ("frame A1", "no frame 'A2' before it")),
    "on a list": (two(('name = "A1"', 'name = "A1"\non = ["A2"]')), ("frame A1", "no frame ['A2']")),
    "between one": (two(('["P", "A2"]', '["P"]')), ("rod leg2", "between is ['P']", "two frames")),
    "between one and itself": (two(('["P", "A2"]', '["P", "P"]')), ("rod leg2", "two frames")),
    "between lists": (two(('["P", "A2"]', '[["P"], "A2"]')), ("rod leg2", "no frame ['P']")),
    "between nothing": (two(("between", "betwen")), ("rod leg1", "between is missing", "two frames")),
    "between the base": (two(('["P", "A2"]', '["P", "base"]')), ("rod leg2", "base itself", "a frame of its own")),
    "two motions": (
        two(("{ x_mm = 600 }", "{ x_mm = 600, y_mm = 0 }")),
        ("frame A2, step 1: 2 motions", "give one of"),
    ),
    "no motion": (two(("{ x_mm = 600 }", "{ }")), ("frame A2, step 1: 0 motions", "give one of")),
    "the wrong unit": (
        two(("{ x_mm = 600 }", "{ x_deg = 600 }")),
        ("frame A2, step 1: unknown key 'x_deg'", "x, y, z with _mm"),
    ),
    "two units": (two(("{ x_mm = 600 }", "{ x_mm = 600, x_m = 2 }")), ("step 1", "x_m and x_mm", "keep one")),
    "a motion twice": (
        two(("{ x_mm = 600 }", "{ x_mm = 600 }, { x_mm = 1 }")),
        ("frame A2", "x is there twice", "between"),
    ),
    "passive with a joint": (
        two((LEG2, ""), ("{ x_mm = 600 }", '{ x_mm = 600, passive = true, joint = "rho2" }')),
        ("frame A2, step 1", "keep one"),
    ),
    "passive in words": (two(("passive = true", 'passive = "yes"')), ("frame P, step 1", "write true or false")),
    "a slide that turns": (
        two((LEG2, ""), ("{ x_mm = 600 }", '{ rz_deg = 0, joint = "rho2" }')),
        ("rz turns, but joint rho2 does not", "make the joint revolute"),
    ),
    "a length that turns": (
        two(('type = "prismatic"\nlower_mm = 350\nupper_mm = 800', "lower_deg = -90\nupper_deg = 90")),
        ("rod leg1", "cannot be joint rho1, which turns", "prismatic"),
    ),
    "an exact leg": (two((LEG1, LEG1 + "exact = true\n")), ("rod leg1", "exact is for rods", "leave it out")),
    "no length": (rod(""), ("rod leg2", "length is missing", "length_mm")),
    "a length of zero": (rod("length_mm = 0"), ("rod leg2", "length is 0 mm", "more than zero")),
    "a length below zero": (rod("length_mm = -5"), ("rod leg2", "length is -5 mm", "more than zero")),
    "a leg without length": (
        two(("lower_mm = 350", "lower_mm = 0")),
        ("rod leg1", "limits of joint rho1", "from 0 to 800 mm", "above zero"),
    ),
    "a leg below zero": (
        two((LEG1, LEG1 + "length_mm = -400\n")),
        ("rod leg1", "from -50 to 400 mm", "above zero"),
    ),
    "an unknown key": (two(("height_mm", "heigth_mm")), ("unknown key 'heigth_mm'", "known are name")),
    "an unknown key of a frame": (two(("path", "pth")), ("frame A1", "unknown key 'pth'", "name, on, path")),
    "an unknown key of a step": (
        two(("{ x_mm = 600 }", "{ x_mm = 600, exct = true }")),
        ("step 1", "unknown key 'exct'"),
    ),
    "an unknown key of a rod": (two((LEG1, LEG1 + "lenght_mm = 3\n")), ("rod leg1", "unknown key 'lenght_mm'")),
    "an unknown key of a pin": (two((LEG2, PIN.replace("along", "alng"))), ("pin pin1", "unknown key 'alng'")),
    "an unknown key of a joint": (
        two(("upper_mm = 800", "upper_mm = 800\nuper = 1")),
        ("joint rho1", "unknown key 'uper'"),
    ),
    "no TOML": (two(("[[rod]]", "[[rod]")), ("not a TOML file", "line 29", "fix it there")),
    "no platform": (two(('platform = "P"', "")), ("platform is missing", "name the frame", "A1, A2, P")),
    "an unknown platform": (two(('platform = "P"', 'platform = "Q"')), ("platform is 'Q'", "A1, A2, P")),
    "a list of platforms": (two(('platform = "P"', 'platform = ["P"]')), ("platform is ['P']", "A1, A2, P")),
    "a platform that stands still": (two(('platform = "P"', 'platform = "A1"')), ("nothing moves A1", "name a frame")),
    "an empty path": (path_of_a2("path = []"), ("the nominal position is singular", "place rods")),
    "no path": (path_of_a2(""), ("the nominal position is singular", "place rods")),
    "a number for a path": (path_of_a2("path = 3"), ("frame A2", "path is 3", "list of steps")),
    "a number for a step": (path_of_a2("path = [600]"), ("frame A2", "a step is 600", "x_mm = 100")),
    "NaN": (two(("x_mm = 600", "x_mm = nan")), ("frame A2, step 1", "x_mm is nan", "finite number")),
    "infinite": (two(("x_mm = 600", "x_mm = -inf")), ("frame A2, step 1", "x_mm is -inf", "finite number")),
    "beyond all": (two(("x_mm = 600", "x_mm = 1e300")), ("frame A2, step 1", "x_mm is 1e+300", "finite number")),
    "too large": (two(("x_mm = 300", "x_mm = 1e14")), ("frame P, step 1", "1e+11 m", "at most 1e+06 m")),
    "more than a turn": (
        two(("{ y_mm = 0 }", "{ rz_deg = 1e9 }")),
        ("frame A1, step 2", "1,000,000,000°", "full turn"),
    ),
    "a text": (two(("x_mm = 600", 'x_mm = "600"')), ("frame A2, step 1", "x_mm is '600'", "finite number")),
    "limits of NaN": (two(("upper_mm = 800", "upper_mm = nan")), ("joint rho1", "upper_mm is nan")),
    "no limits": (two(("upper_mm = 800", "")), ("joint rho1", "a slide needs its limits", "upper_mm")),
    "limits the wrong way round": (two(("upper_mm = 800", "upper_mm = 80")), ("joint rho1", "swap or correct")),
    "a target of NaN": (two(("0.05]", "nan]")), ("[tool] p1", "three numbers")),
    "legs alike": (two(('["P", "A2"]', '["P", "A1"]')), ("nominal position is singular", "place rods that are alike")),
    "legs in line": (two(("x_mm = 600", "x_mm = 1150")), ("nominal position is singular", "another position")),
    "frames named alike": (two(('name = "A2"', 'name = "A1"')), ("frame 2", "the name A1 is already used", "another")),
    "legs named alike": (
        two(('name = "leg2"', 'name = "leg1"')),
        ("rod 2", "the name leg1 is already used", "another"),
    ),
    "a leg named as a frame": (
        two(('name = "leg2"', 'name = "A2"')),
        ("rod 2", "the name A2 is already used", "another"),
    ),
    "a pin named as a leg": (
        two((LEG2, PIN.replace("pin1", "leg1"))),
        ("pin 1", "the name leg1 is already used", "another"),
    ),
    "joints named alike": (two(('"rho2"\ntype', '"rho1"\ntype')), ("joints 1 and 2", "both named rho1", "rename")),
    "a frame named base": (two(('name = "A1"', 'name = "base"')), ("frame 1", "the name base is already used")),
    "a frame named tool": (two(('name = "A1"', 'name = "tool"')), ("frame 1", "the name tool is already used")),
    "a frame without a name": (two(('name = "A1"', "")), ("frame 1", "name is None", "give it a name")),
    "an empty name": (two(('name = "leg1"', 'name = ""')), ("rod 1", "name is ''", "give it a name")),
    "a blank name": (two(('name = "A1"', 'name = " "')), ("frame 1", "name is ' '", "give it a name")),
    "a dot in a name": (two(('name = "A1"', 'name = "A.1"')), ("frame 1", "name is 'A.1'", "without a dot")),
    "an empty joint": (two(('"rho2"\ntype', '""\ntype')), ("joint 2", "empty name", "name it")),
    "a nameless robot": (two(('name = "two"', 'name = ""')), ("name is ''", "name the robot")),
    "a pin along x twice": (two((LEG2, PIN.replace('"xy"', '"xx"'))), ("pin pin1", "along is 'xx'", '"xy"')),
    "no joints": ('[[frame]]\nname = "A"\n', ("no joints", "[[joint]]")),
    "frame is a number": ('frame = 3\n[[joint]]\nname = "q"\n', ("no frames", "[[frame]]")),
    "frames are numbers": ('frame = [1]\n[[joint]]\nname = "q"\n', ("frame 1: is 1", "section")),
}


@pytest.mark.sampled(11)
@pytest.mark.parametrize("command", ["inspect", "calibrate --poses 20 --robot"])
@pytest.mark.parametrize("name", BAD)
def test_what_is_wrong_is_told_in_one_line(
    name: str, command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    text, says = BAD[name]
    monkeypatch.chdir(tmp_path)
    Path("robot.toml").write_text(text)
    assert main([*command.split(), "robot.toml"]) == 2
    out, err = capfd.readouterr()
    line = err.removesuffix("\n")
    assert out == "" and line.startswith("lab: robot.toml") and "\n" not in line
    assert [fragment for fragment in says if fragment not in line] == [], line
    assert [path.name for path in tmp_path.iterdir()] == ["robot.toml"]


def test_the_files_that_are_spoilt_are_sound(tmp_path: Path) -> None:
    for text in (TWO_LEGS, CRANK):
        (tmp_path / "robot.toml").write_text(text)
        mechanism = read_mechanism(tmp_path / "robot.toml").mechanism
        assert mechanism.assembled(mechanism.home[None], mechanism.nominal_values).fits.all()


def same_structure(a: Tree, b: Tree) -> bool:
    """All but the numbers of constants."""

    def bare(tree: Tree) -> object:
        paths = [[(s.kind, s.exact, s.joint, s.passive) for s in frame.path] for frame in tree.frames]
        frames = [(frame.name, frame.on) for frame in tree.frames]
        return frames, paths, [(r.name, r.ends, r.exact, r.joint) for r in tree.rods], tree.pins, tree.platform

    return bare(a) == bare(b)


@pytest.mark.parametrize("name", ["rpr2/mechanism", "rpr3/mechanism", "delta/mechanism", "delta/six_rods", "crank"])
def test_written_and_read_it_is_the_same_to_the_bit(name: str, tmp_path: Path) -> None:
    (tmp_path / "crank.toml").write_text(CRANK)
    file = read_mechanism(tmp_path / "crank.toml" if name == "crank" else MODELS / f"{name}.toml")
    drawn, rng = file.mechanism, np.random.default_rng(3)
    values = drawn.nominal_values + 1e-4 * rng.standard_normal(len(drawn.nominal_values))
    tool = {"p1": rng.standard_normal(3), "the second": rng.standard_normal(3)}
    (tmp_path / "again.toml").write_text(write_mechanism(drawn, values, tool), encoding="utf-8")
    again = read_mechanism(tmp_path / "again.toml")
    assert again.base is not None and np.array_equal(again.base, values[:6])
    assert np.array_equal(again.mechanism.nominal_values[6:], values[6:]) and again.mechanism.names == drawn.names
    assert {name: place.tolist() for name, place in again.tool.items()} == {n: p.tolist() for n, p in tool.items()}
    assert same_structure(again.mechanism.tree, drawn.tree)
    assert joints_of(again.mechanism) == joints_of(drawn)
    (tmp_path / "thrice.toml").write_text(write_mechanism(again.mechanism, values, tool), encoding="utf-8")
    assert (tmp_path / "thrice.toml").read_text() == (tmp_path / "again.toml").read_text()


def joints_of(mechanism: Mechanism) -> object:
    limits = mechanism.lower.tolist(), mechanism.upper.tolist(), mechanism.sign.tolist()
    return mechanism.name, mechanism.joint_names, mechanism.prismatic, limits
