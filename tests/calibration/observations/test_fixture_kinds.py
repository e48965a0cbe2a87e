"""Which rows are of which fixture, and what is refused."""

import pytest
from helpers.observed_files import HEADER, read
from helpers.robots import IRB120

from lab.calibration.observations.socket import SocketKind, Sockets
from lab.campaign.observation_kinds import kind_named
from lab.core.errors import LabError
from lab.kinematics.serial.arm import SerialArm

ARM = SerialArm(IRB120.chain)


BLANKS = {
    "location of a plane": ("plane", "location", ["a", "", "a", "a", "a"], r"line 3, column location: empty; .*plane"),
    "session of a plane": ("plane", "session", ["1", "1", "1", "1", ""], r"line 6, column session: empty; .*plane"),
    "location of a socket": (
        "socket",
        "location,socket",
        ["a,0", "a,1", ",0", "a,0", "a,1"],
        "line 4, column location",
    ),
    "socket": ("socket", "location,socket", ["a,", "a,1", "a,0", "a,0", "a,1"], "line 2, column socket: empty"),
    "every location": ("socket", "location,socket", [",0"] * 5, "line 2, column location: empty"),
    "session of a wire": ("cable", "session,cable_mm", ["1,300", ",300", *["1,300"] * 3], "line 3, column session"),
}


@pytest.mark.parametrize(("kind", "columns", "rows", "what"), BLANKS.values(), ids=BLANKS)
def test_a_row_says_which_fixture_it_is_of(kind, columns, rows, what, tmp_path) -> None:
    lines = "".join(f"{i},2,3,4,5,6,{row}\n" for i, row in enumerate(rows))
    data = read(tmp_path, f"{HEADER},{columns}\n{lines}", kind)
    with pytest.raises(LabError, match=what):
        kind_named(kind)().observation(ARM, data, ARM.nominal())


ALL_TOLD = {
    "one plane": ("plane", "note", ["n"] * 5, ("",)),
    "one plane, with empty columns": ("plane", "session,location", [","] * 5, ("",)),
    "a row to skip": ("plane", "location,use", [*["a,calibrate"] * 4, ",skip"], ("a",)),
    "a wire of one session": ("cable", "session,cable_mm", [",300"] * 5, ("",)),
    "a row without a length": ("cable", "session,cable_mm", [*["a,300"] * 4, ","], ("a",)),
}


@pytest.mark.parametrize(("kind", "columns", "rows", "labels"), ALL_TOLD.values(), ids=ALL_TOLD)
def test_what_needs_no_fixture_may_have_none(kind, columns, rows, labels, tmp_path) -> None:
    lines = "".join(f"{i},2,3,4,5,6,{row}\n" for i, row in enumerate(rows))
    data = read(tmp_path, f"{HEADER},{columns}\n{lines}", kind)
    assert kind_named(kind)().observation(ARM, data, ARM.nominal())[0].labels == labels


def test_few_rows_are_left_out_and_told(tmp_path) -> None:
    rows = "".join(f"{i},2,3,4,5,6,a,{i % 2}\n" for i in range(6)) + "1,1,1,1,1,1,b,0\n"
    data = read(tmp_path, f"{HEADER},location,socket\n{rows}", "socket")
    observation, seen = SocketKind().observation(ARM, data, ARM.nominal())
    assert isinstance(observation, Sockets) and observation.labels == ("a.0", "a.1") and len(seen) == 6
    assert any("socket b.0 has 1 of the 2 rows" in warning for warning in seen.warnings)
    three = read(
        tmp_path, f"{HEADER},location,socket\n" + "".join(f"{i},2,3,4,5,6,a,{i % 3}\n" for i in range(6)), "socket"
    )
    with pytest.raises(LabError, match="location a has 3 sockets"):
        SocketKind(0.05).observation(ARM, three, ARM.nominal())
