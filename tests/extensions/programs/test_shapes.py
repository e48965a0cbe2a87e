# ruff: noqa: E501 (lines of programs are as long as they are)
"""Shapes that programs have in public, read by hand beforehand: what is a target, with which frames, and what is not."""

from pathlib import Path

import numpy as np
import pytest
from helpers.robots import IRB120

from lab.core import se3
from lab.core.errors import LabError
from lab.extensions.programs.jbi import Jbi
from lab.formats.programs.languages import languages, read_program
from lab.formats.programs.program_text import ArmShape, Outside, ProgramText, postures_of
from lab.formats.programs.protocol import MeasuringTour, TargetMoves

SHAPE = ArmShape.of(IRB120.chain)


def read(name: str, text: str, frames: dict | None = None, pulses: tuple[float, ...] = ()) -> ProgramText:
    return read_program(Path(name), text, IRB120.chain, None, Outside(frames or {}, pulses))[1]


def names(found: ProgramText) -> list[str]:
    return [each.name for each in found.targets]


def left(found: ProgramText) -> dict[int, str]:
    return {each.line: each.reason for each in found.uncorrected}


NONE = "[9E9,9E9,9E9,9E9,9E9,9E9]"
RAPID = f"""MODULE M
  CONST robtarget p10:=[[600,0,500],[0,0,1,0],[0,0,-1,1],{NONE}];
  PERS robtarget pList{{2}}:=[[[1,2,3],[1,0,0,0],[0,0,0,0],{NONE}],[[4,5,6],[1,0,0,0],[0,0,0,0],{NONE}]];
  VAR robtarget pNow;
  VAR robtarget pSet:=[[1,2,3],[1,0,0,0],[0,0,0,0],{NONE}];
  CONST robtarget pTrack:=[[1,2,3],[1,0,0,0],[0,0,0,0],[100,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget pTwo:=[[1,2,3],[1,0,0,0],[0,0,0,0],{NONE}];
  CONST robtarget pIdle:=[[1,2,3],[1,0,0,0],[0,0,0,0],{NONE}];
  CONST jointtarget jHome:=[[0,-10,20,0,45,0],{NONE}];
  PERS tooldata tA:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
  PERS wobjdata wA:=[FALSE,TRUE,"",[[100,0,0],[1,0,0,0]],[[0,50,0],[1,0,0,0]]];
  PERS tooldata tFixed:=[FALSE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
  ! MoveJ pIdle,v100,fine,tA;
  PROC main()
    MoveAbsJ jHome\\NoEOffs,v1000,z50,tA;
    MoveJ \\Conc, p10,v100,fine\\Inpos:=inpos50,tA\\WObj:=wA;
    movel Offs(p10,0,0,100),v100,fine,ta\\wobj:=WA;
    MoveC pList{{1}},pList{{2}},v100,fine,tA;
    MoveL [[7,8,9],[1,0,0,0],[0,0,0,0],{NONE}],v100,fine,tool0;
    MoveL pTrack,v100,fine,tA;
    MoveL pTwo,v100,fine,tA;
    MoveL pTwo,v100,fine,tool0;
    pSet.trans.z:=20;
    MoveL pSet,v100,fine,tA;
    MoveL pElse,v100,fine,tA;
    ArcL p10,v100,seam1,weld1,z10,tA\\WObj:=wA;
    PDispOn \\Rot, p10, tA;
    TPWrite "MoveL pIdle,v100,fine,tA;";
  ENDPROC
ENDMODULE
"""


def test_rapid() -> None:
    found = read("m.mod", RAPID)
    assert names(found) == ["p10", "pList{1}", "pList{2}", "pTrack", "jHome", "line 19"]
    p10, inline = found.targets[0], found.targets[-1]
    assert (p10.tool, p10.base, p10.line, inline.tool, inline.base) == ("ta", "wa", 2, "tool0", "wobj0")
    np.testing.assert_allclose(found.frames["wa"][:3, 3], [0.1, 0.05, 0])
    np.testing.assert_allclose(np.rad2deg(found.targets[4].joints), [0, -10, 20, 0, 45, 0])
    said = left(found)
    assert set(said) == {4, 5, 6, 7, 8, 12, 17, 24, 25, 27}
    assert "follows the correction of p10" in said[17] and "not in this module" in said[25] and "PDispOn" in said[27]
    assert "ta and wobj0 as well as tool0 and wobj0" in said[7] and "external axes" in said[6]
    assert [(move.line, move.motion) for move in found.moves] == [
        (15, "joints"), (16, "joints"), (19, "line"), (20, "line"), (26, "line")]  # fmt: skip
    assert p10.allowed is not None
    joints = np.deg2rad([[10, 0, 0, 20, -30, -40], [10, 0, 0, 20, 30, -40], [100, 0, 0, 20, -30, -40]])
    assert p10.allowed(SHAPE, joints).tolist() == [True, False, False]


KRL = """&ACCESS RVP
DEF Prog( )
DECL E6POS XP1
;FOLD PTP HOME  Vel= 100 % DEFAULT;%{PE}%R 5.2
BAS (#PTP_PARAMS,100 )
;ENDFOLD
BAS(#TOOL,1)
BAS(#BASE,2)
PTP {X 1, Y 2, Z 3, A 10, B 20, C 30, S 2, T 27}
LIN {X 1.0,Y 2.0,Z 3.0,A 10.0,B 20.0,C 30.0} C_DIS
LIN_REL {Z 100}
PTP {A1 10}
PTP {A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0,E1 0}
PTP XHOME
LIN XP1:{X 0,Y 0,Z 100,A 0,B 0,C 0}
$TOOL=TOOL_DATA[3]:XP1
LIN {X 5,Y 6,Z 7,A 0,B 0,C 0}
END
"""


def test_krl() -> None:
    frames = {"TOOL_DATA[1]": (0.0, 0, 100, 0, 0, 0), "BASE_DATA[2]": (500.0, 0, 0, 90, 0, 0),
              "$TOOL@16": (0.0,) * 6}  # fmt: skip
    found = read("prog.src", KRL, frames)
    assert names(found) == ["line 9", "line 10", "line 13", "line 17"]
    assert {(each.tool, each.base) for each in found.targets[:2]} == {("TOOL_DATA[1]", "BASE_DATA[2]")}
    assert set(left(found)) == {11, 12, 14, 15}
    np.testing.assert_allclose(np.rad2deg(found.targets[2].joints), [0, -90, 90, 0, 0, 0])
    first = found.targets[0].allowed
    signs = np.deg2rad([[-10, -90, 90, -10, -20, 5], [10, -90, 90, -10, -20, 5]])
    assert first is not None and found.targets[1].allowed is None
    assert first(SHAPE, signs).tolist() == [bool(SHAPE.in_front(signs[:1])[0]), False]
    with pytest.raises(
        LabError, match=r"TOOL_DATA\[1\], BASE_DATA\[2\] are not .*while the program runs; give --frames"
    ):
        read("prog.src", KRL)


KRL_DATA = """&ACCESS RVP
DEFDAT  PROG
EXT  BAS (BAS_COMMAND  :IN,REAL  :IN )
DECL BASIS_SUGG_T LAST_BASIS={POINT1[] "P2                      ",POINT2[] "P2   ",CP_PARAMS[] "CPDAT0 "}
DECL E6POS XP1={X 500.5,Y -20.25,Z 700.125,A 180.0,B 0.0,C 179.99,S 2,T 35,E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}
DECL FDAT FP1={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " "}
DECL E6AXIS XHOME={A1 0.0,A2 -90.0,A3 90.0,A4 0.0,A5 30.0,A6 0.0,E1 0.0}
DECL PDAT PPDAT1={VEL 100.000,ACC 100.000,APO_DIST 100.000}
ENDDAT
"""


def test_a_data_list_of_krl() -> None:
    found = read("prog.dat", KRL_DATA, {"TOOL_DATA[1]": (0.0, 0, 100, 0, 0, 0)})
    assert names(found) == ["XP1", "XHOME"] and not found.uncorrected
    assert (found.targets[0].tool, found.targets[0].base) == ("TOOL_DATA[1]", "$NULLFRAME")
    assert [each.text for each in found.targets[0].numbers] == ["500.5", "-20.25", "700.125", "180.0", "0.0", "179.99"]


def test_a_position_of_krl_is_moved_to_by_its_name() -> None:
    declared = "XP1={X 1,Y 0,Z 5,A 0,B 0,C 0}\nDECL FDAT FP1={TOOL_NO 0,BASE_NO 0}\n"
    found = read("a.src", f"DEF m()\n{declared}PTP XP1\nEND\n")
    assert [(each.name, each.tool, each.base) for each in found.targets] == [("XP1", "$NULLFRAME", "$NULLFRAME")]
    assert [(move.line, move.motion, move.target) for move in found.moves] == [(4, "joints", 0)]


URSCRIPT = """def Prog():
  set_tcp(p[0.0,0.0,0.15,0.0,0.0,0.0])
  global feature=p[.4, -.3, .1, 0.0, 0.0, 1.5707963]
  global Waypoint_1_p=p[.123456, -.2, .3, 2.2, -2.2, 0.0]
  global Waypoint_1_q=[-1.6, -1.7, -2.2, -0.8, 1.59, -0.03]
  while (True):
    $ 2 "MoveJ"
    movej(get_inverse_kin(Waypoint_1_p, qnear=Waypoint_1_q), a=1.4, v=1.05)
    movel(pose_trans(feature, p[0.1,0,0.2,0,3.14159,0]), a=1.2, v=0.25)
    movej(Waypoint_1_q)
    movel(pose_add(Waypoint_1_p, p[0,0,0.1,0,0,0]), a=1.2)
    movec(p[.1,.2,.3,0,0,0], p[.2,.2,.3,0,0,0], a=1)
    moving = get_actual_tcp_pose()
    movel(moving)
    moving = p[1,2,3,0,0,0]
  end
end
def movej_slow(x):
  movej(x)
end
"""


def test_urscript() -> None:
    found = read("prog.script", URSCRIPT)
    assert names(found) == ["Waypoint_1_p", "Waypoint_1_q", "line 9", "line 12", "line 12"]
    assert [each.base for each in found.targets] == ["base of the robot", "", "feature", *["base of the robot"] * 2]
    np.testing.assert_allclose(found.frames["feature"][:3, :3] @ [1, 0, 0], [0, 1, 0], atol=1e-7)
    assert set(left(found)) == {11, 14, 19}
    with pytest.raises(LabError, match=r"tcp is not in the text; give --frames 'tcp=x,y,z,a,b,c'"):
        read("prog.script", URSCRIPT.replace("  set_tcp(p[0.0,0.0,0.15,0.0,0.0,0.0])\n", ""))


FANUC = """/PROG  A
/MN
   1:  UFRAME_NUM=1 ;
   2:J P[1:home] 50% FINE    ;
   3:L P[2] 100mm/sec FINE Offset,PR[3]    ;
   4:L P[3] 100mm/sec FINE INC    ;
   5:L PR[1] 100mm/sec FINE    ;
   6:J P[R[2]] 10% FINE    ;
   7:C P[4]
    :  P[5] 100mm/sec FINE    ;
   8:  ! L P[5] ;
/POS
P[1:"home"]{
   GP1:
\tUF : 1, UT : 1,\t
\tJ1=     0.000 deg,\tJ2=   -10.000 deg,\tJ3=    20.000 deg,
\tJ4=     0.000 deg,\tJ5=   -45.000 deg,\tJ6=     0.000 deg
   GP2:
\tUF : 1, UT : 1,\t
\tJ1=     6.207 deg
};
P[2]{
   GP1:
\tUF : 1, UT : 1,\t\tCONFIG : 'N U B, 0, 0, -1',
\tX =   600.000  mm,\tY =     0.000  mm,\tZ =   500.000  mm,
\tW =   180.000 deg,\tP =     0.000 deg,\tR =  -180.000 deg
};
P[3]{
   GP1:
\tUF : 1, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',
\tX =     0.000  mm,\tY =     0.000  mm,\tZ =   100.000  mm,
\tW =     0.000 deg,\tP =     0.000 deg,\tR =     0.000 deg
};
P[4]{
   GP1:
\tUF : 0, UT : 0,\t\tCONFIG : 'N U T, 0, 0, 0',
\tX =     1.000  mm,\tY =     2.000  mm,\tZ =   100.000  mm,
\tW =     0.000 deg,\tP =     0.000 deg,\tR =     0.000 deg
};
P[5]{
   GP1:
\tUF : 0, UT : 0,\t\tCONFIG : 'N U T, 0, 0, 0',
\tX = ********  mm,\tY =     2.000  mm,\tZ =   100.000  mm,
\tW =     0.000 deg,\tP =     0.000 deg,\tR =     0.000 deg
};
/END
"""


def test_fanuc() -> None:
    frames = {"UFRAME[1]": (100.0, 0, 0, 0, 0, 0), "UTOOL[1]": (0.0, 0, 100, 0, 0, 0)}
    found = read("a.ls", FANUC, frames)
    assert names(found) == ["P[1]", "P[2]", "P[4]"]
    np.testing.assert_allclose(np.rad2deg(found.targets[0].joints), [0, -10, 20, 0, -45, 0])
    assert set(left(found)) == {5, 6, 7, 8, 40} and "INC" in left(found)[6]
    assert [(move.line, move.motion) for move in found.moves] == [(4, "joints"), (5, "line"), (9, "line")]
    second = found.targets[1].allowed
    behind = np.deg2rad([[0.0, -85, 0, 0, 20, -300], [0.0, -85, 0, 0, 20, 0], [0.0, 0, 0, 0, 20, -300]])
    assert second is not None and SHAPE.in_front(behind).tolist() == [False, False, True]
    assert second(SHAPE, behind).tolist() == [True, False, False]
    with pytest.raises(LabError, match=r"UTOOL\[1\], UFRAME\[1\] are not in the text"):
        read("a.ls", FANUC)


VAL3 = """<?xml version="1.0" encoding="utf-8"?>
<Database xmlns="http://www.staubli.com/robotics/VAL3/Data/2">
  <Datas>
    <Data name="fPart" access="public" xsi:type="array" type="frame" size="1">
      <Value key="0" x="10" y="0" z="0" rx="0" ry="0" rz="0" fatherId="fTable[0]" />
    </Data>
    <Data name="fTable" access="public" xsi:type="array" type="frame" size="1">
      <Value key="0" x="100" y="0" z="0" rx="0" ry="0" rz="90" fatherId="world[0]" />
    </Data>
    <Data name="pPick" type="pointRx" size="2">
      <Value key="0" x="1" y="2" z="3" rx="0" ry="90" rz="0" shoulder="lefty" elbow="enegative" wrist="wpositive" fatherId="fPart[0]" />
      <Value key="1" x="1" y="2" rx="0" ry="0" rz="0" fatherId="fPart[0]" />
    </Data>
    <Data name="jHome" type="jointRx" size="1"><Value key="0" j1="0" j2="10" j3="90" j4="0" j5="80" j6="0" /></Data>
    <Data name="tHand" type="tool" size="1"><Value key="0" x="0" y="0" z="50" rx="0" ry="0" rz="0" fatherId="flange[0]" /></Data>
  </Datas>
</Database>
"""


def test_val3() -> None:
    found = read("a.dtx", VAL3)
    assert names(found) == ["jHome", "pPick[0]"] and list(left(found)) == [12]
    pick = found.targets[1]
    assert (pick.tool, pick.base) == ("tHand", "fPart")
    np.testing.assert_allclose(found.frames["fPart"][:3, 3], [0.1, 0.01, 0], atol=1e-12)
    assert pick.allowed is not None
    joints = np.deg2rad([[0, 0, -90, 0, 10, 0], [0, 0, 90, 0, 10, 0], [0, 0, -90, 0, -10, 0]])
    assert pick.allowed(SHAPE, joints).tolist() == [True, False, False]
    two = VAL3.replace('"tHand"', '"tOther"').replace("  </Datas>", VAL3[VAL3.index('    <Data name="tHand"') :], 1)
    with pytest.raises(LabError, match="tool is not in the text"):
        read("a.dtx", two)
    assert read("a.dtx", two, {"tool": "tOther"}).targets[1].tool == "tOther"


def test_variables_of_val3_without_values_hide_nothing() -> None:
    """As RoboDK's post processor writes them: an element that closes itself before the points."""
    empty = (
        '<Data name="nTraj" access="public" xsi:type="array" type="num" size="1"/>\n    <Data name="mSpeed" />\n    '
    )
    more = VAL3.replace("<Data ", empty + "<Data ")
    assert names(read("a.dtx", more)) == names(read("a.dtx", VAL3)) and len(left(read("a.dtx", more))) == 1


JBI = """/JOB
//NAME A
//POS
///NPOS 3,0,0,1,0,0
///TOOL 0
///POSTYPE PULSE
///PULSE
C00000=0,-1000,2000,0,-4500,0
///USER 01
///POSTYPE USER
///RECTAN
///RCONF 1,0,0,0,0,0,0,0
C00001=1.000,2.000,3.000,180.0000,0.0000,-180.0000
///POSTYPE TOOL
C00002=0.000,0.000,10.000,0.0000,0.0000,0.0000
///POSTYPE BASE
P00005=0.000,0.000,10.000,0.0000,0.0000,0.0000
//INST
///DATE 2020/01/01 10:00
///ATTR SC,RW
NOP
MOVJ C00000 VJ=10.00
'MOVL C00001 V=1.0
MOVL C00001 V=100.0
MOVL P001 V=10.0
IMOV P00005 V=10.0
SFTON P002
END
"""


def test_jbi() -> None:
    found = read("a.jbi", JBI, {"USER[1]": (0.0,) * 6}, (100.0,) * 6)
    assert names(found) == ["C00000", "C00001"] and set(left(found)) == {15, 25, 26, 27}
    np.testing.assert_allclose(np.rad2deg(found.targets[0].joints), [0, -10, 20, 0, -45, 0])
    assert (found.targets[1].tool, found.targets[1].base) == ("TOOL[0]", "USER[1]")
    assert [(move.line, move.motion) for move in found.moves] == [(22, "joints"), (24, "line")]
    with pytest.raises(LabError, match=r"line 8: C00000 is in pulses; give --pulses-per-deg"):
        read("a.jbi", JBI)


@pytest.mark.parametrize("language", languages(), ids=lambda each: each.name)
def test_what_the_exporters_write_is_read(language) -> None:
    """Joint positions, or for JBI the poses of the tool, to the last digit; by the moves in their order."""
    arm = IRB120.arm(("p1",))
    values = arm.nominal(IRB120.tool)
    stops = np.random.default_rng(1).uniform(-1, 1, (5, 6))
    stops[-1] = stops[0]  # a tour ends where it begins
    T_tool = se3.pose(se3.exp(np.array([0.1, 0.2, 0.3])), np.array([0.03, -0.02, 0.1]))
    T_frame = se3.pose(se3.exp(np.array([0.3, 0.2, -0.1])), np.array([-1.6, 1.3, -1.1]))
    postures = postures_of(arm, values, stops)
    assert postures is not None
    moves = TargetMoves("arm", tuple("abc"), stops, np.array([-1, 0, 1, 2, -1]), T_tool, T_frame, True, postures)
    tour = MeasuringTour("arm", stops, np.array([-1, 0, 1, 2, -1]), ("7", "8", "9"), True, postures)
    numbers = (0.0,) * 6
    for content in (language.target_moves(moves), language.measuring_tour(tour)):
        frames = {"TOOL[1]": numbers, "USER[1]": numbers} if isinstance(language, Jbi) else {}
        found = read("a" + language.suffix, content.decode("ascii"), frames)
        assert len(found.moves) == 5 and not any("computed" in each.reason for each in found.uncorrected)
        order = [found.targets[move.target] for move in found.moves]
        if not isinstance(language, Jbi):
            np.testing.assert_allclose([each.joints for each in order], stops, atol=1e-5)
            continue
        inverse = se3.inverse(T_frame) if "USER 1" in content.decode() else np.eye(4)
        tool = T_tool if "USER 1" in content.decode() else np.eye(4)
        expected = inverse @ postures.Ts_frame0_last @ tool
        np.testing.assert_allclose([each.spelling.pose(each.values) for each in order], expected, atol=3e-6)
        for each, joints in zip(order, stops, strict=True):
            assert each.allowed(SHAPE, joints[None]).all()
