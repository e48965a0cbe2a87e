# ruff: noqa: E501 (lines of programs are as long as they are)
"""Programs whose targets are corrected in their text, as a user calls it: what is hit, what stays, what is refused."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.controller_programs import (
    END,
    LANGUAGES,
    PULSES,
    Written,
    configuration,
    posed,
    program,
    read_back,
    spelt,
)
from helpers.estimates import with_values
from scipy.spatial.transform import Rotation

from lab.cli.main import main
from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.programs.program_text import ArmShape
from lab.library.calibration_result import CalibrationResult
from lab.library.compensate import compensate
from lab.library.compensation_result import CompensationResult
from lab.library.corrected_program import open_program
from lab.library.load_run import CalibrationRun, calibrated_by
from lab.library.run_folder import _refuse_other_files
from lab.options.compensation import CompensateOptions
from lab.simulation.collisions import collides

TOOL = posed(Rotation.from_rotvec([0.3, 0, 0.1]), np.array([0.01, 0.02, 0.1]))
TABLE = posed(Rotation.from_rotvec([0.1, 0.2, 0.3]), np.array([0.3, 0.1, 0.2]))


@pytest.fixture(scope="module")
def calibrated(seven: CalibrationResult) -> CalibrationRun:
    return calibrated_by(seven, Path("run"))


def made_program(language: str, run: CalibrationRun, count: int = 3, seed: int = 2) -> tuple[Written, Array]:
    """A program to free poses, and the joint positions ``(count, 6)`` that the controller's arm has there."""
    nominal, rng = run.estimate.nominal_inverse(0), np.random.default_rng(seed)
    joints = rng.uniform(-0.9, 0.9, (20 * count, 6))
    joints[:, 4] = np.abs(joints[:, 4]) + 0.3
    joints = joints[~collides(run.robot.model, joints)][:count]
    Ts = se3.inverse(nominal.arm.T_tracker_frame0(nominal.values)) @ nominal.tool(joints)[0]
    Ts[:, :3, 3] -= Ts[:, :3, :3] @ nominal.tools[0]
    base = np.eye(4) if language == "urscript" else TABLE
    chain = nominal.arm.dh_chain(nominal.values)
    assert chain is not None
    where = [configuration(language, ArmShape.of(chain), each) for each in joints]
    return program(language, se3.inverse(base) @ Ts @ TOOL, joints[:1], TOOL, base, rng, where), joints


def options_for(language: str, folder: Path, made: Written, **more: object) -> CompensateOptions:
    path = folder / f"prog{END[language]}"
    path.write_bytes(made.content)
    names = {"fanuc": ("UTOOL[2]", "UFRAME[3]"), "jbi": ("TOOL[2]", "USER[3]")}.get(language, ())
    pairs = zip(names, (TOOL, TABLE), strict=False)
    frames = "; ".join(f"{name}={','.join(spelt(language, T, 10))}" for name, T in pairs)
    pulses = tuple(PULSES.tolist()) if language == "jbi" else ()
    return CompensateOptions(Path("run"), program=path, frames=frames, pulses_per_deg=pulses, **more)


def test_ways_are_the_programs_also_to_and_from_what_is_not_corrected(
    calibrated: CalibrationRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second target is through the floor, so it stays as it is, and the controller goes there all the same."""
    from lab.library import compensate as command

    monkeypatch.setattr(command, "load_run", lambda *_, **__: calibrated)
    monkeypatch.setattr(command, "reachability", None)  # asks for ways that the program does not take
    places = ("0,10,5,0,30,0", "0,110,-60,0,30,0", "20,10,5,0,40,0", "30,15,5,0,40,0")
    nine = ",".join(["9E9"] * 6)
    lines = [f"MoveAbsJ [[{each}],[{nine}]],v5,fine,tool0;" for each in places]
    (file := tmp_path / "a.mod").write_text("\n".join(["MODULE a", "PROC main()", *lines, "ENDPROC", "ENDMODULE"]))
    result = compensate(CompensateOptions(Path("run"), program=file))
    assert result.program is not None and [str(name) for name, _ in result.failed] == [result.targets.ids[1]]
    assert [line for line, _ in result.program.touching_paths] == [4, 5]


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_robot_that_is_as_drawn_keeps_its_program(
    language: str, calibrated: CalibrationRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No error, no correction: every byte is the same."""
    from lab.library import compensate as command

    values = calibrated.estimate.nominal.copy()
    values[-3:] = calibrated.robot.tool["p1"]
    perfect = replace(calibrated, estimate=with_values(calibrated.estimate, values))
    monkeypatch.setattr(command, "load_run", lambda *_, **__: perfect)
    made, _ = made_program(language, calibrated, seed=3)
    result = compensate(options_for(language, tmp_path, made, no_check=True))
    assert len(result.reached) == 4 and result.program is not None
    assert result.program.content == made.content


@pytest.mark.thorough
def test_a_program_is_written_beside_its_result_and_checked(
    calibrated: CalibrationRun, seven_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the command; with a target that is out of reach, one in another configuration, and a computed one."""
    made, _ = made_program("rapid", calibrated)
    text = made.content.decode("latin-1").replace(
        "ENDPROC", "MoveL Offs(p0,0,0,9),v5,fine,tGripper\\WObj:=wTable;\nENDPROC"
    )
    far = "  CONST robtarget pFar:=[[9000,0,0],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
    other = (
        far.replace("pFar", "pOther").replace("[[9000,0,0]", "[[-150,100,400]").replace("[0,0,0,0],[9", "[3,3,3,1],[9")
    )
    text = text.replace("  PROC main()", far + other + "  PROC main()").replace(
        "ENDPROC", "MoveJ pFar,v5,fine,tGripper;MoveJ pOther,v5,fine,tool0;\nENDPROC"
    )
    file, out = tmp_path / "Teile.mod", tmp_path / "out"
    file.write_bytes(text.encode("latin-1"))
    assert main(["compensate", "--program", str(file), "--run", str(seven_run), "--out", str(out)]) == 1
    said = capsys.readouterr()
    assert "pFar" in said.out and "Offs(...) is computed" in said.out
    new = (out / "Teile.mod").read_bytes().decode("latin-1")
    assert far.strip() in new and other.strip() in new and new != text and not (out / "program.mod").exists()
    result = json.loads((out / "result.json").read_text())["program"]
    assert any(each["reason"].startswith("pOther: no solution") for each in result["uncorrected"])
    assert len(result["corrected"]) == 4 and result["language"] == "rapid" and result["file"] == "Teile.mod"
    _refuse_other_files(out)  # the corrected program is a file of the run, which may be replaced
    (out / "else.mod").touch()
    with pytest.raises(LabError, match=r"holds else.mod"):
        _refuse_other_files(out)


RAPID = (
    "MODULE M\n  CONST robtarget p1:=[[300,0,400],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
    "  PROC main()\n    MoveL p1,v5,fine,tool0;\n  ENDPROC\nENDMODULE\n"
)
KRL = "DEF A()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nLIN {X 300,Y 0,Z 400,A 0,B 90,C 0}\nEND\n"
UR = "def a():\n  set_tcp(p[0,0,0,0,0,0])\n  movel(p[0.3,0,0.4,0,3.1,0])\nend\n"
LS = "/PROG A\n/MN\n   1:L P[1] 100mm/sec FINE ;\n/POS\nP[1]{\n   GP1:\n\tUF : 0, UT : 0, CONFIG : 'N U T, 0, 0, 0',\n\tX = 300.0 mm, Y = 0.0 mm, Z = 400.0 mm,\n\tW = 180.0 deg, P = 0.0 deg, R = 0.0 deg\n};\n/END\n"
VAL = '<Database><Datas><Data name="p" type="pointRx"><Value key="0" x="300" y="0" z="400" rx="0" ry="90" rz="0" fatherId="world[0]"/></Data><Data name="t" type="tool"><Value key="0" x="0" y="0" z="0" rx="0" ry="0" rz="0" fatherId="flange[0]"/></Data></Datas></Database>\n'
JBI = "/JOB\n//NAME A\n//POS\n///NPOS 1,0,0,0,0,0\n///TOOL 0\n///POSTYPE ROBOT\n///RECTAN\nC00000=300.0,0.0,400.0,180.0,0.0,0.0\n//INST\nNOP\nMOVL C00000 V=5.0\nEND\n"
GOOD = {"a.mod": RAPID, "a.src": KRL, "a.script": UR, "a.ls": LS, "a.dtx": VAL, "a.jbi": JBI}
WRONG = [
    ("a.mod", "", "no target of this RAPID program"),
    ("a.mod", "MODULE M\nENDMODULE\n", "none is there"),
    ("a.mod", RAPID.replace("300,0,400", "300,0"), "cannot be read as a robtarget"),
    ("a.mod", RAPID.replace("300,0,400", "300,0,nHigh"), "cannot be read as a robtarget"),
    ("a.mod", RAPID.replace("[0,0,1,0],[0", "[0,0,0,0],[0"), "cannot be read as a robtarget"),
    ("a.mod", RAPID.replace("[0,0,1,0],[0", "[0,0,3,0],[0"), "cannot be read as a robtarget"),
    ("a.mod", RAPID.replace("]];", "];"), "p1 is computed"),
    ("a.mod", RAPID.replace("tool0;", "tHand;"), "thand is not in the text; give --frames 'thand=x,y,z,q1,q2,q3,q4'"),
    ("a.mod", RAPID.replace("tool0;", "tool0\\WObj:=wA;"), "wa is not in the text"),
    ("a.mod", RAPID.replace("  PROC", "  PERS wobjdata wA:=[FALSE,TRUE,\"\",[[0,0,1],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];\n  PROC").replace("MoveL p1,v5,fine,tool0;", "wA:=wMeasured;MoveL p1,v5,fine,tool0\\WObj:=wA;"), "wa (line 3) is given a value only while the program runs; give --frames 'wa=x,y,z,q1,q2,q3,q4' (mm and a quaternion wxyz, as the controller shows it when that line has run)"),
    ("a.mod", RAPID.replace("MoveL p1", "MoveL p2"), "p2: its value is not in this module"),
    ("a.mod", RAPID.replace("MoveL p1", "! MoveL p1"), "p1 is not moved to"),
    ("a.mod", RAPID.replace("MoveL p1,v5,fine,tool0;", "MoveL p1;"), "MoveL cannot be read"),
    ("a.mod", RAPID.replace("  PROC", "  VAR num n;\n  PROC").replace("MoveL p1", "p1:=CRobT();MoveL p1"), "p1 is computed"),
    ("a.mod", RAPID.replace("CONST robtarget p1:=", "VAR robtarget p1;! "), "p1 has no value here"),
    ("a.mod", RAPID.replace("[0,0,0,0],[9", "[3,3,3,1],[9"), "p1: no solution of the nominal arm"),
    ("a.mod", RAPID.replace("[0,0,0,0],[9", "[0,0,0,x],[9"), "p1 cannot be read"),
    ("a.mod", RAPID.replace("  PROC", '  PERS tooldata tH:=[FALSE,[[0,0,1],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n  PROC').replace("tool0;", "tH;"), "th is not in the text"),
    ("a.mod", RAPID.replace("  PROC", '  PERS wobjdata wM:=[FALSE,FALSE,"STN1",[[0,0,1],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];\n  PROC').replace("tool0;", "tool0\\WObj:=wM;"), "wm is not in the text"),
    ("a.src", "", "no target of this KRL program"),
    ("a.src", KRL.replace("$TOOL=$NULLFRAME\n", ""), "$TOOL is not in the text"),
    ("a.src", KRL.replace("$BASE=$NULLFRAME\n", ""), "$BASE is not in the text"),
    ("a.src", KRL.replace("$NULLFRAME", "TOOL_DATA[7]", 1), "TOOL_DATA[7] is not in the text"),
    ("a.src", KRL.replace("$BASE=$NULLFRAME", "$BASE=A:B"), "$BASE@3 (line 3) is given a value only while the program runs; give --frames '$BASE@3=x,y,z,a,b,c'"),
    ("a.src", KRL.replace("LIN {", "LIN_REL {"), "LIN_REL is relative"),
    ("a.src", KRL.replace("X 300,", ""), "kept from where the arm is"),
    ("a.src", KRL.replace("X 300", "X nHere"), "kept from where the arm is"),
    ("a.src", KRL.replace("LIN {X 300,Y 0,Z 400,A 0,B 90,C 0}", "LIN XP1"), "XP1 is not in this file"),
    ("a.src", KRL.replace("C 0}", "C 0}:{X 1,Y 0,Z 0,A 0,B 0,C 0}"), "is computed"),
    ("a.src", KRL.replace("C 0}", "C 0,S 2,T 63}"), "no solution of the nominal arm"),
    ("a.script", "def a():\nend\n", "no target of this URScript program"),
    ("a.script", UR.replace("set_tcp", "# set_tcp"), "tcp is not in the text"),
    ("a.script", UR.replace("  set_tcp(p[0,0,0,0,0,0])", "  set_tcp(hand)"), "hand is not in the text"),
    ("a.script", UR.replace("p[0.3,0,0.4,0,3.1,0]", "p[0.3,0,0.4,0,3.1]"), "is computed"),
    ("a.script", UR.replace("p[0.3,0,0.4,0,3.1,0]", "p[0.3,0,h,0,3.1,0]"), "is computed"),
    ("a.script", UR.replace("p[0.3,0,0.4,0,3.1,0]", "pose_add(a, b)"), "is computed"),
    ("a.script", UR.replace("p[0.3,0,0.4,0,3.1,0]", "somewhere"), "somewhere is computed"),
    ("a.script", UR.replace("movel(p[0.3,0,0.4,0,3.1,0]", "movej([0,0,0,0,0]"), "is computed"),
    ("a.script", UR.replace("movel(p[0.3,0,0.4,0,3.1,0]", "movej([9,0,0,0,0,0]"), "beyond the limits"),
    ("a.ls", "/PROG A\n/MN\n/POS\n/END\n", "none is there"),
    ("a.ls", LS.replace("UT : 0", "UT : 4"), "UTOOL[4] is not in the text"),
    ("a.ls", LS.replace("UF : 0", "UF : F"), "UFRAME[F] is not in the text"),
    ("a.ls", LS.replace("300.0", "********"), "has not six numbers"),
    ("a.ls", LS.replace("FINE ;", "FINE INC ;"), "relative (INC)"),
    ("a.ls", LS.replace("L P[1]", "L PR[1]").replace("/POS", "/POS\n/END").split("/END")[0], "is a register"),
    ("a.ls", LS.replace("N U T, 0, 0, 0", "N U T, 0, 1, 0"), "no solution of the nominal arm"),
    ("a.ls", LS.replace("UF : 0, UT : 0, ", ""), "has not six numbers"),
    ("a.dtx", "<Database></Database>\n", "no target of this VAL3 program"),
    ("a.dtx", VAL.replace('"t" type="tool"', '"t" type="num"'), "tool is not in the text"),
    ("a.dtx", VAL.replace("world[0]", "fElse[0]"), "fElse is not in the text"),
    ("a.dtx", VAL.replace('x="300" ', ""), "leaves out x"),
    ("a.dtx", VAL.replace("flange[0]", "t[0]"), "t is not in the text"),
    ("a.jbi", "/JOB\nEND\n", "no target of this JBI program"),
    ("a.jbi", JBI.replace("///RECTAN", "///PULSE"), "is in pulses; give --pulses-per-deg"),
    ("a.jbi", JBI.replace("TOOL 0", "TOOL 2"), "TOOL[2] is not in the text"),
    ("a.jbi", JBI.replace("POSTYPE ROBOT", "POSTYPE USER\n///USER 2"), "USER[2] is not in the text"),
    ("a.jbi", JBI.replace("POSTYPE ROBOT", "POSTYPE MTOOL"), "in the frame MTOOL"),
    ("a.jbi", JBI.replace("300.0,0.0,", "300.0,"), "has not six numbers"),
    ("a.jbi", JBI.replace("MOVL C00000", "IMOV C00000"), "relative (IMOV)"),
    ("a.jbi", JBI.replace("///RECTAN", "///RECTAN\n///RCONF 0,0,0,1,1,1,0,0"), "no solution of the nominal arm"),
    ("a.txt", RAPID, "p1"),
    ("a.mod", RAPID.encode("utf-16").decode("latin-1"), "is not a text file"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "text", "words"), WRONG, ids=[f"{i}-{each[0]}" for i, each in enumerate(WRONG)])
def test_a_wrong_program_is_told_in_a_line(
    name: str, text: str, words: str, calibrated: CalibrationRun, tmp_path: Path
) -> None:
    assert name == "a.txt" or text != GOOD[name]
    (tmp_path / name).write_bytes(text.encode("latin-1"))
    options = CompensateOptions(Path("run"), program=tmp_path / name)
    if name == "a.txt":  # by the robot's maker
        assert open_program(options, calibrated).targets.ids == (words,)
        return
    with pytest.raises(LabError) as told:
        open_program(options, calibrated)
    assert words in str(told.value) and str(told.value).startswith(str(tmp_path / name))
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("name", GOOD)
def test_the_programs_that_are_spoilt_are_good(name: str, calibrated: CalibrationRun, tmp_path: Path) -> None:
    (tmp_path / name).write_text(GOOD[name], newline="")
    opened = open_program(CompensateOptions(Path("run"), program=tmp_path / name), calibrated)
    assert len(opened.targets) == 1 and not opened.left and not opened.read.uncorrected


OPTIONS = [
    ([], "give targets as a CSV file, or --program FILE: none is given"),
    (["t.csv", "--program", "a.mod"], "both are given"),
    (["t.csv", "--frames", "a=1,2,3,4,5,6"], "--frames goes with --program"),
    (["t.csv", "--digits", "3"], "--digits goes with --program"),
    (["t.csv", "--pulses-per-deg", "1,2,3,4,5,6"], "--pulses-per-deg goes with --program"),
    (["--program", "a.mod", "--orientation", "zyx-deg"], "orientation"),
    (["--program", "a.mod", "--digits", "-1"], "--digits is -1"),
    (["--program", "a.mod", "--digits", "99"], "--digits is 99"),
    (["--program", "a.mod", "--digits", "x"], "digits"),
    (["--program", "none.mod"], "none.mod: cannot be read"),
    (["--program", "."], "is a directory"),
    (["--program", "a.mod", "--controller", "basic"], "controller"),
    (["--program", "a.mod", "--controller", "krl"], "no target of this KRL program"),
    (["--program", "a.mod", "--frames", "tool"], "'tool' is no NAME=numbers"),
    (["--program", "a.mod", "--frames", "=1,2,3"], "is no NAME=numbers"),
    (["--program", "a.mod", "--frames", "a=1,2,3,4,5,6"], "a has 6 numbers; this controller writes 7"),
    (["--program", "a.mod", "--frames", "a=1,2,3,x,5,6,7"], "a value that is not a number"),
    (["--program", "a.mod", "--frames", "a=1,2,3,nan,5,6,7"], "not finite"),
    (["--program", "a.mod", "--frames", "a=1,2,3,0,0,0,0"], "the quaternion of a has the length 0"),
    (["--program", "a.mod", "--frames", "a=1,2,3,1,0,0,0;a=1,2,3,1,0,0,0"], "a is given twice"),
    (["--program", "a.mod", "--pulses-per-deg", "1,2,3,4,5,6"], "--pulses-per-deg is for JBI"),
    (["--program", "a.mod", "--pulses-per-deg", "1,2,3"], "--pulses-per-deg takes six numbers"),
    (["--program", "a.mod", "--pulses-per-deg", "1,2,3,0,5,6"], "--pulses-per-deg takes six numbers"),
]


@pytest.mark.thorough
@pytest.mark.parametrize(("arguments", "words"), OPTIONS, ids=[" ".join(each[0]) for each in OPTIONS])
def test_wrong_options_are_told_in_a_line_and_nothing_is_written(
    arguments: list[str], words: str, calibrated: CalibrationRun, folder: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    from lab.library import compensate as command

    monkeypatch.setattr(command, "load_run", lambda *_, **__: calibrated)
    (folder / "a.mod").write_text(RAPID)
    before = sorted(folder.rglob("*"))
    assert main(["compensate", *arguments, "--run", "run"]) == 2
    said = capsys.readouterr()
    assert words in said.err and said.err.count("\n") == 1 and not said.out
    assert sorted(folder.rglob("*")) == before


def urscript_of(tools: list[str], run: CalibrationRun) -> tuple[str, Array]:
    """A URScript with a pose for each tool, given as six numbers, and the flange's poses there ``(n, 4, 4)`` (m)."""
    _, joints = made_program("urscript", run, count=len(tools))
    arm = run.robot.arm(("p1",))
    Ts = arm.tool(joints, arm.nominal({"p1": np.zeros(3)}))[0]
    lines = ["def a():"]
    for tool, T in zip(tools, Ts, strict=True):
        T_tool = read_back("urscript", np.array([float(each) for each in tool.split(",")]))
        lines += [f"  set_tcp(p[{tool}])", f"  movej(p[{','.join(spelt('urscript', T @ T_tool, 6))}])"]
    return "\n".join([*lines, "end", ""]), Ts


def corrected_urscript(tools: list[str], run: CalibrationRun, folder: Path, monkeypatch: pytest.MonkeyPatch):
    from lab.library import compensate as command

    monkeypatch.setattr(command, "load_run", lambda *_, **__: run)
    text, Ts = urscript_of(tools, run)
    (file := folder / "a.script").write_text(text)
    return compensate(CompensateOptions(Path("run"), program=file, controller="urscript", no_check=True)), Ts


def test_every_tool_of_a_program_is_its_own(
    calibrated: CalibrationRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two tools: the flange is where each asks for it, and the longer lever has the larger expected error."""
    result, Ts = corrected_urscript(["0,0,0.05,0,0,0", "0,0.1,0.4,1,0,0"], calibrated, tmp_path, monkeypatch)
    (arm, values), reference = calibrated.estimate.geometry, result.reference
    assert reference is not None and result.expected is not None
    T_frame0_instrument = se3.inverse(arm.T_tracker_frame0(values))
    flanges = T_frame0_instrument @ arm.flange(result.found.joints, values) @ reference.flange.T_last_flange
    np.testing.assert_allclose(flanges, Ts, atol=1e-7)  # of the digits that were read
    short, long = result.to_dict()["program"]["tools"]
    np.testing.assert_allclose([*short["position_mm"], *long["position_mm"]], [0, 0, 50, 0, 100, 400], atol=1e-9)
    assert result.expected.flange_95_m[1] > 1.5 * result.expected.flange_95_m[0]


def test_a_tool_near_the_measured_point_is_named_with_the_distance(
    calibrated: CalibrationRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """p1 is 6 mm from the tool of the program; another tool is elsewhere."""
    x, y, z = calibrated.robot.tool["p1"]
    tools = [f"{x},{y},{z + 0.006},0,0,0", f"{x},{y},{z + 0.06},0,0,0"]
    result, _ = corrected_urscript(tools, calibrated, tmp_path, monkeypatch)
    near, far = (each["measured"] for each in result.to_dict()["program"]["tools"])
    assert near["point"] == "p1" and near["distance_mm"] == pytest.approx(6, abs=0.5) and far is None


def test_what_is_expected_to_get_worse_stays_as_it_is(
    calibrated: CalibrationRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A calibration that knows less than the nominal model corrects nothing."""
    poor = replace(calibrated, estimate=replace(calibrated.estimate, covariance=1e6 * calibrated.estimate.covariance))
    with pytest.raises(LabError, match=r"no target can be corrected; line 3"):
        corrected_urscript(["0,0,0.05,0,0,0", "0,0.1,0.4,1,0,0"], poor, tmp_path, monkeypatch)


def test_some_targets_are_left_and_the_others_corrected(
    calibrated: CalibrationRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = property(lambda result: {0: "too far"} if len(result.targets) == 2 else {})
    monkeypatch.setattr(CompensationResult, "better_left", left)
    tools = ["0,0,0.05,0,0,0", "0,0.1,0.4,1,0,0"]
    result, _ = corrected_urscript(tools, calibrated, tmp_path, monkeypatch)
    before, after = urscript_of(tools, calibrated)[0].splitlines(), result.program.content.decode().splitlines()
    assert [i for i, (a, b) in enumerate(zip(before, after, strict=True)) if a != b] == [4]
    assert [(each.line, each.reason) for each in result.program.uncorrected] == [(3, "too far")]
    assert result.exit_code == 1 and len(result.reached) == 1
