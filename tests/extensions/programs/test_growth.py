# ruff: noqa: E501 (lines of programs are as long as they are)
"""Reading a program takes work that grows with its length: long texts of every kind are read, or refused in a line.

No clock is read. A reader whose work grows with the square of the length takes hours for these texts.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.robots import IRB120

from lab.core.errors import LabError
from lab.core.limits import PROGRAM_FRAMES
from lab.formats.programs.languages import read_program
from lab.formats.programs.program_text import Outside, ProgramText

LENGTH = 60_000
END = {"rapid": ".mod", "krl": ".src", "fanuc": ".ls", "val3": ".pgx", "urscript": ".script", "jbi": ".jbi"}
TARGET = "[[100,0,500],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
LISTED = "P[{}]{{\n GP1:\n UF : 0, UT : 0, CONFIG : '{}N U T, 0, 0, 0',\n X = 1 mm, Y = 0 mm, Z = 500 mm, W = 0 deg, P = 0 deg, R = 0 deg\n}};\n"
# A program with one target in each language; filler takes the place of the @.
PROGRAMS = {
    "rapid": f"MODULE M\nCONST robtarget p1:={TARGET};\nPROC main()\n@\nMoveJ p1,v100,fine,tool0;\nENDPROC\n",
    "krl": "DEF m()\n$TOOL=$NULLFRAME\n$BASE=$WORLD\n@\nPTP {X 1,Y 0,Z 500,A 0,B 0,C 0}\nEND\n",
    "fanuc": "/PROG A\n/MN\n@\n 1:J P[1] 100% FINE ;\n/POS\n" + LISTED.format(1, "") + "/END\n",
    "val3": '<Program><Locals><Local name="a" type="jointRx"/></Locals><Code>begin\na={1,2,3,4,5,6}\n@\nmovej(a,t,m)\nend</Code></Program>\n',
    "urscript": "def prog():\n  set_tcp(p[0,0,0.1,0,0,0])\n@\n  movej(p[0.1,0,0.5,0,0,0])\nend\n",
    "jbi": "/JOB\n//POS\n///TOOL 0\n///POSTYPE ROBOT\n///RECTAN\nC0=1,0,500,0,0,0\n//INST\n@\nMOVJ C0 VJ=1\nEND\n",
}  # fmt: skip
COMMENT = {
    "rapid": "! MoveJ",
    "krl": "; PTP",
    "fanuc": " 2:  !J P[1]",
    "val3": "// movej(",
    "urscript": "# movej(",
    "jbi": "'MOVJ",
}
# What begins and does not end, and what a search could begin at every character.
OPEN = {
    "rapid": ("MoveJ Offs(p1", "CONST robtarget p{", "x{", ":=", "IF a THEN", "a   ", ".a", "\\"),
    "krl": ("PTP {X 1", "{", "DECL ", "a   ", "X 1", "A="),
    "fanuc": ("2:J P[2", "P[2]{", "1", ":", "2:J P[1] Offset"),
    "val3": ("<Data ", "<Data>", "<Value ", "<Code>", "<!--", "movej(a ", ".a", 'a="', "movej(", "b ={"),
    "urscript": ("movej(", "movej(p[", "a[", "a=[", "def  ", "movej(get_inverse_kin("),
    "jbi": ("MOVJ P[", "///TOOL 1  ", "C2=", "C2=1,", "///RCONF 1,"),
}  # fmt: skip


def read(language: str, text: str) -> ProgramText:
    return read_program(Path("a" + END[language]), text, IRB120.chain, None, Outside())[1]


def filled(language: str, filler: str, separator: str) -> str:
    piece = filler + separator
    return PROGRAMS[language].replace("@", piece * (LENGTH // len(piece)))


@pytest.mark.parametrize("language", PROGRAMS)
def test_long_comments_and_blank_lines_change_nothing(language: str) -> None:
    plain = read(language, PROGRAMS[language].replace("@", ""))
    assert len(plain.targets) == len(plain.moves) == 1
    for filler, end in ((COMMENT[language], "\n"), (COMMENT[language], " "), ("", "\n"), ("  ", "\r\n"), ("", "\r")):
        text = filled(language, filler, end) if (filler, end) != ("", "\r") else filled(language, "", "\r") + "\n"
        found = read(language, text)
        assert len(found.targets) == len(found.moves) == 1
        np.testing.assert_array_equal(found.targets[0].values, plain.targets[0].values)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("language", PROGRAMS)
def test_long_nonsense_is_read_or_refused_in_a_line(language: str) -> None:
    for filler in (*OPEN[language], "a", "1", "[", "(", '"', "=", "a,", '"a'):
        for separator in ("", "\n"):
            try:
                read(language, filled(language, filler, separator))
            except LabError as error:
                assert "\n" not in str(error) and len(str(error)) < 1_000


def test_more_frames_than_a_controller_keeps_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lab.formats.programs.program_text.PROGRAM_FRAMES", replace(PROGRAM_FRAMES, most=9))
    lines = [f"TOOL_DATA[{i}]={{X 0,Y 0,Z {i},A 0,B 0,C 0}}\n" for i in range(1, 11)]
    for some, words in ((lines[:3], "none is there"), (lines, "tools and bases of a program are too many")):
        with pytest.raises(LabError, match=words):
            read("krl", f"DEF m()\n{''.join(some)}END\n")
