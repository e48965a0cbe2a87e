# ruff: noqa: E501 (lines of programs are as long as they are)
"""Programs in the languages of controllers, in the shapes of public ones, with random targets and all that is around."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from lab.core.se3 import Array
from lab.formats.programs.program_text import ArmShape

LANGUAGES = ("rapid", "krl", "urscript", "fanuc", "val3", "jbi")
END = {"rapid": ".mod", "krl": ".src", "urscript": ".script", "fanuc": ".ls", "val3": ".dtx", "jbi": ".jbi"}
EULER = {"krl": "ZYX", "fanuc": "xyz", "jbi": "xyz", "val3": "XYZ"}  # SciPy's letters: capitals turn about new axes


@dataclass(frozen=True)
class Written:
    """A program and what is in it: ``(n, 4, 4)`` poses (m) of the tool in the base, and both frames."""

    language: str
    content: bytes
    poses: Array
    joints: Array
    T_flange_tool: Array
    T_robot_base: Array


def posed(rotation: Rotation, place: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation.as_matrix(), place
    return T


def spelt(language: str, T: Array, digits: int) -> list[str]:
    """A pose in a language's numbers, by SciPy alone."""
    R = Rotation.from_matrix(T[:3, :3])
    if language == "urscript":
        return [f"{each:.{digits + 3}f}" for each in (*T[:3, 3], *R.as_rotvec())]
    place = [f"{1e3 * each:.{digits}f}" for each in T[:3, 3]]
    if language == "rapid":
        return [*place, *(f"{each:.{digits + 4}f}" for each in R.as_quat()[[3, 0, 1, 2]])]
    return [*place, *(f"{each:.{digits}f}" for each in R.as_euler(EULER[language], degrees=True))]


def read_back(language: str, values: Array) -> Array:
    """The pose (m) of a language's numbers, by SciPy alone."""
    if language == "urscript":
        return posed(Rotation.from_rotvec(values[3:]), values[:3])
    if language == "rapid":
        return posed(Rotation.from_quat(values[[4, 5, 6, 3]]), values[:3] / 1e3)
    return posed(Rotation.from_euler(EULER[language], values[3:], degrees=True), values[:3] / 1e3)


def program(language: str, poses: Array, joints: Array, T_tool: Array, T_base: Array, rng: np.random.Generator,
            configurations: list[str] | None = None, digits: int | None = None) -> Written:  # fmt: skip
    """A program through poses ``(n, 4, 4)`` (m) of the tool in the base, and through joint positions ``(m, 6)`` rad.

    Line ends, indents, comments and their encoding vary, and digits where they are not given.
    """
    drawn, end = int(rng.integers(3, 7)), str(rng.choice(["\r\n", "\n"]))
    digits = drawn if digits is None else digits
    where = configurations or [CONFIGURATION[language]] * len(poses)
    lines = WRITERS[language](poses, joints, T_tool, T_base, digits, rng, where)
    encoding = str(rng.choice(["latin-1", "utf-8"]))
    text = end.join(lines) + (end if rng.random() < 0.8 else "")
    return Written(language, text.encode(encoding), poses, joints, T_tool, T_base)


def configuration(language: str, shape: ArmShape, joints: Array) -> str:
    """What a program says of an arm at joint positions ``(6,)``."""
    front, up = bool(shape.in_front(joints[None])[0]), bool(shape.elbow_up(joints[None])[0])
    quarters = ",".join(str(int(np.floor(each / (np.pi / 2)))) for each in joints[[0, 3, 5]])
    return {
        "rapid": f"[{quarters},{int(joints[4] < 0) + 4 * (not front)}]",
        "krl": f",S {int(not front) + 4 * int(joints[4] < 0)},T {sum(int(joints[k] < 0) << k for k in range(6))}",
        "fanuc": f"N U {'T' if front else 'B'}, 0, 0, 0",
        "jbi": f"{int(abs(joints[3]) > np.pi / 2)},{int(not up)},{int(not front)},0,0,0,0,0",
    }.get(language, "")


CONFIGURATION = {"rapid": "[0,0,0,0]", "krl": "", "urscript": "", "fanuc": "N U T, 0, 0, 0", "val3": "", "jbi": ""}


def _rapid(poses, joints, T_tool, T_base, digits, rng, where):
    def pose(T):
        values = spelt("rapid", T, 8)
        return f"[[{','.join(values[:3])}],[{','.join(values[3:])}]]"

    none = "[9E9,9E9,9E9,9E9,9E9,9E9]" if rng.random() < 0.5 else "[9E+09, 9E+09, 9E+09, 9E+09, 9E+09, 9E+09]"
    lines = ["%%%", "  VERSION:1", "  LANGUAGE:ENGLISH", "%%%", "MODULE Teile", "  ! Greifer für Ölwanne: MoveL p10,v5;",
             f"  PERS tooldata tGripper:=[TRUE,{pose(T_tool)},[1.5,[0,0,80],[1,0,0,0],0,0,0]];",
             f'  TASK PERS wobjdata wTable:=[FALSE,TRUE,"",{pose(T_base)},[[0,0,0],[1,0,0,0]]];',
             "  VAR num n:=0;"]  # fmt: skip
    for i, (T, configuration) in enumerate(zip(poses, where, strict=True)):
        v = spelt("rapid", T, digits)
        kind = rng.choice(["CONST", "PERS", "LOCAL CONST"])
        space = rng.choice(["", " "])
        lines.append(
            f"  {kind} robtarget p{10 * i}:={space}[[{','.join(v[:3])}],{space}[{','.join(v[3:])}],{configuration},{none}];"
        )
    for i, q in enumerate(np.rad2deg(joints)):
        lines.append(f"  CONST jointtarget jPos{i}:=[[{','.join(f'{x:.{digits}f}' for x in q)}],{none}];")
    lines += ["", "  PROC main()", '    TPWrite "MoveL p999, fertig";']
    lines += [f"    MoveAbsJ jPos{i}\\NoEOffs,v1000,fine,tGripper;" for i in range(len(joints))]
    for i in range(len(poses)):
        how = rng.choice(["MoveJ", "MoveL"])
        lines.append(f"    {how} p{10 * i}, v500, {rng.choice(['fine', 'z10'])}, tGripper\\WObj:=wTable;  ! naß")
    lines += ["    WHILE n<3 DO", "      n:=n+1;", "    ENDWHILE", "  ENDPROC", "ENDMODULE"]
    return lines


def _krl(poses, joints, T_tool, T_base, digits, rng, where):
    def frame(T, keys="XYZABC"):
        return "{" + ",".join(f"{key} {value}" for key, value in zip(keys, spelt("krl", T, 8), strict=True)) + "}"

    lines = ["&ACCESS RVP", "&REL 12", "&PARAM TEMPLATE = C:\\KRC\\Roboter\\Template\\vorgabe", "DEF Greifer( )",
             ";FOLD INI;%{PE}", "  BAS (#INITMOV,0 )", ";ENDFOLD (INI)", f"$TOOL = {frame(T_tool)}",
             f"$BASE={frame(T_base)} ; Tisch, 30° gedreht"]  # fmt: skip
    angles = [",".join(f"A{i} {x:.{digits}f}" for i, x in enumerate(q, start=1)) for q in np.rad2deg(joints)]
    lines += [f"PTP {{AXIS: {each}}}" for each in angles]
    for T, configuration in zip(poses, where, strict=True):
        v = spelt("krl", T, digits)
        parts = ",".join(f"{key} {value}" for key, value in zip("XYZABC", v, strict=True))
        how = rng.choice(["PTP", "LIN", "SLIN", "SPTP"])
        lines.append(
            f"{how} {{{'E6POS: ' if rng.random() < 0.3 else ''}{parts}{configuration}}}{' C_DIS' if how == 'LIN' else ''}"
        )
    return [*lines, "; PTP {X 1,Y 2,Z 3,A 0,B 0,C 0}", "$OUT[3]=TRUE", "WAIT SEC 0.5", "END"]


def _urscript(poses, joints, T_tool, T_base, digits, rng, where):
    del where
    assert np.allclose(T_base, np.eye(4))
    lines = ["def Greifer():", "  # Öl: movej(p[1,2,3,4,5,6])", f"  set_tcp(p[{','.join(spelt('urscript', T_tool, 8))}])",
             "  set_payload(1.2, [0.0, 0.0, 0.05])"]  # fmt: skip
    for i, T in enumerate(poses):
        lines.append(f"  global Waypoint_{i}_p=p[{', '.join(spelt('urscript', T, digits))}]")
    lines += [f"  movej([{', '.join(f'{x:.{digits + 3}f}' for x in q)}], a=1.4, v=1.05)" for q in joints]
    for i, T in enumerate(poses):
        how = rng.integers(4)
        inline = f"p[{','.join(spelt('urscript', T, digits))}]"
        lines.append([f"  movel(Waypoint_{i}_p, a=1.2, v=0.25)", f"  movej(get_inverse_kin(Waypoint_{i}_p), a=1.4, v=1.05)",
                      f"  movel({inline}, a=1.2, v=0.25, r=0.001)", f"  movej({inline},a=1.4,v=1.05)"][how])  # fmt: skip
    return [*lines, '  textmsg("movel(p[0,0,0,0,0,0])")', "  set_digital_out(1, True)", "  sleep(0.5)", "end"]


def _fanuc(poses, joints, T_tool, T_base, digits, rng, where):
    del T_tool, T_base
    digits, count = min(digits, 3), len(poses) + len(joints)
    lines = ["/PROG  GREIFER", "/ATTR", "OWNER\t\t= MNEDITOR;", 'COMMENT\t\t= "Ölwanne";', "PROG_SIZE\t= 2606;",
             f"LINE_COUNT\t= {count + 3};", "DEFAULT_GROUP\t= 1,*,*,*,*;", "CONTROL_CODE\t= 00000000 00000000;", "/MN",
             "   1:  UFRAME_NUM=3 ;", "   2:  UTOOL_NUM=2 ;", "   3:  !L P[1] 5mm/sec ;"]  # fmt: skip
    for i in range(1, count + 1):
        how = "J" if i > len(poses) or rng.random() < 0.5 else "L"
        lines.append(f"{i + 3:4d}:{how} P[{i}] {'100% CNT100' if how == 'J' else '250mm/sec FINE'}    ;")
    lines.append("/POS")
    for i, (T, configuration) in enumerate(zip(poses, where, strict=True), start=1):
        v = spelt("fanuc", T, digits)
        comment = ':"nah"' if rng.random() < 0.3 else ""
        lines += [f"P[{i}{comment}]{{", "   GP1:", f"\tUF : 3, UT : 2,\t\tCONFIG : '{configuration}',",
                  f"\tX ={v[0]:>10}  mm,\tY ={v[1]:>10}  mm,\tZ ={v[2]:>10}  mm,",
                  f"\tW ={v[3]:>10} deg,\tP ={v[4]:>10} deg,\tR ={v[5]:>10} deg", "};"]  # fmt: skip
    for i, q in enumerate(np.rad2deg(joints), start=len(poses) + 1):
        j = [f"J{k}={x:>10.{digits}f} deg" for k, x in enumerate(q, start=1)]
        lines += [
            f"P[{i}]{{",
            "   GP1:",
            "\tUF : 3, UT : 2,\t",
            "\t" + ",\t".join(j[:3]) + ",",
            "\t" + ",\t".join(j[3:]),
            "};",
        ]
    return [*lines, "/END"]


def _val3(poses, joints, T_tool, T_base, digits, rng, where):
    del where

    def value(T, father, more="", count=digits):
        keys = zip(("x", "y", "z", "rx", "ry", "rz"), spelt("val3", T, count), strict=True)
        return (
            f'<Value key="0" {" ".join(f"{k}=" + chr(34) + v + chr(34) for k, v in keys)}{more} fatherId="{father}" />'
        )

    def data(name, kind, content):
        return [
            f'    <Data name="{name}" access="private" xsi:type="array" type="{kind}" size="1">',
            f"      {content}",
            "    </Data>",
        ]

    lines = ['<?xml version="1.0" encoding="utf-8"?>',
             '<Database xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmlns="http://www.staubli.com/robotics/VAL3/Data/2">',
             "  <!-- <Value key='0' /> Öl -->", "  <Datas>"]  # fmt: skip
    lines += data("fTable", "frame", value(T_base, "world[0]", "", 8))
    lines += data("tGripper", "tool", value(T_tool, "flange[0]", "", 8))
    for i, T in enumerate(poses):
        lines += data(f"pPos{i}", "pointRx", value(T, "fTable[0]", ' shoulder="ssame" elbow="esame" wrist="wsame"'))
    for i, q in enumerate(np.rad2deg(joints)):
        angles = " ".join(f'j{k}="{x:.{digits}f}"' for k, x in enumerate(q, start=1))
        lines += data(f"jPos{i}", "jointRx", f'<Value key="0" {angles} />')
    lines += data("nSpeed", "num", '<Value key="0" value="25" />')
    return [*lines, "  </Datas>", "</Database>"]


def _jbi(poses, joints, T_tool, T_base, digits, rng, where):
    del T_tool, T_base
    count = len(poses) + len(joints)
    lines = ["/JOB", "//NAME GREIFER", "//POS", f"///NPOS {count},0,0,0,0,0"]
    if len(joints):
        lines += ["///TOOL 2", "///POSTYPE PULSE", "///PULSE"]
        lines += [f"C{i:05d}={','.join(str(round(x)) for x in np.rad2deg(q) * PULSES)}" for i, q in enumerate(joints)]
    lines += ["///USER 3", "///TOOL 2", "///POSTYPE USER", "///RECTAN"]
    for i, (T, configuration) in enumerate(zip(poses, where, strict=True), start=len(joints)):
        lines += [f"///RCONF {configuration}"] if configuration else []
        lines.append(f"C{i:05d}={','.join(spelt('jbi', T, min(digits, 4)))}")
    lines += ["//INST", "///DATE 2016/03/02 10:15", "///COMM Ölwanne", "///ATTR SC,RW", "///GROUP1 RB1", "NOP",
              "'MOVL C00000 V=5.0"]  # fmt: skip
    lines += [
        f"MOV{'J' if i < len(joints) or rng.random() < 0.5 else 'L'} C{i:05d} {rng.choice(['VJ=10.00', 'V=46.0 PL=0'])}"
        for i in range(count)
    ]
    return [*lines, "DOUT OT#(1) ON", "END"]


PULSES = np.array([1341.4, 1341.4, 1000.0, 622.6, 731.8, -455.1])
WRITERS = {"rapid": _rapid, "krl": _krl, "urscript": _urscript, "fanuc": _fanuc, "val3": _val3, "jbi": _jbi}
