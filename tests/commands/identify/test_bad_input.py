"""Bad input to ``lab identify``: one line that names the place and the mend, exit code 2, and no half-written run."""

import json
from pathlib import Path
from typing import Any

import pytest
from helpers.bad_input import (
    GOOD,
    POINTS,
    ROWS,
    Case,
    approached,
    assert_told_in_one_line,
    cells,
    csv,
    edited,
    emptied,
    joined,
    renamed,
    run,
    swapped,
    warnings_of,
    without,
    write,
)

pytestmark = pytest.mark.usefixtures("folder")

IDENTIFY = "identify m.csv --robot arm.toml"
GIVEN = "identify good.csv --robot arm.toml"
DECIMAL_COMMAS = csv([[cell.replace(".", ",") for cell in row] for row in GOOD], ";")
POSED = "q1_deg,q2_deg,rail_mm,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg\n" + "\n".join(
    f"{7 * i},{5 * i - 40},{10 * i},1,2,3,{i},0,0" for i in range(ROWS)
)


def measured(name: str, text: str | bytes, *says: str, options: str = "") -> Case:
    return Case(f"csv: {name}", f"{IDENTIFY} {options}", ("m.csv", *says), {"m.csv": text})


OPTIONS = [
    Case("option: noise infinite", "identify good.csv --robot arm.toml --noise-mm inf", ("--noise-mm inf", "from")),
    Case("option: gate negative", "identify good.csv --robot arm.toml --gate-mm -1", ("--gate-mm -1", "above zero")),
    Case(
        "option: unknown instrument to weigh",
        "identify good.csv --robot arm.toml --instrument ''",
        ("--instrument ''", "exact"),
    ),
    Case(
        "option: instrument and noise",
        "identify good.csv --robot arm.toml --instrument exact --noise-mm 1",
        ("--instrument and --noise-mm", "give one"),
    ),
    Case("option: holdout 2", "identify good.csv --robot arm.toml --holdout 2", ("--holdout 2", "between 0 and 1")),
    Case("option: holdout NaN", "identify good.csv --robot arm.toml --holdout nan", ("--holdout nan", "0.3")),
    Case("option: holdout of nothing", "identify good.csv --robot arm.toml --holdout 0.001", ("--holdout", "change")),
    Case("option: holdout of all", "identify good.csv --robot arm.toml --holdout 0.9", ("good.csv", "at least 5")),
    Case(
        "option: holdout and validate",
        "identify good.csv --robot arm.toml --holdout 0.3 --validate good.csv",
        ("--holdout and --validate", "give one"),
    ),
    Case(
        "option: refit without validate",
        "identify good.csv --robot arm.toml --refit base",
        ("--refit", "give --validate FILE"),
    ),
    Case(
        "option: refit links",
        "identify good.csv --robot arm.toml --validate good.csv --refit links",
        ("--refit links", "base, tool"),
    ),
    Case("robot: no such file", "identify good.csv --robot gone.xml", ("gone.xml", "irb120")),
    Case("out: nowhere to write", "identify good.csv --robot arm.toml --out /proc/run", ("/proc/run", "--out")),
]

FITTING = [
    Case("model: no masses", f"{GIVEN} --model compliance", ("compliance", "without masses", "MJCF")),
    Case("model: no approach", f"{GIVEN} --model backlash", ("good.csv", "approach_q1", "missing")),
    Case(
        "fix: unknown",
        f"{GIVEN} --fix link9.d",
        ("--fix link9.d", "no such parameter", "nearest are", "link3.d", "groups are base.*, link1.*"),
    ),
    Case("fix: everything", f"{GIVEN} --fix '*'", ("--fix", "no parameter")),
    Case("free: hidden", f"{GIVEN} --free link1.theta", ("--free link1.theta", "hidden in", "base.rz")),
    Case("free: both", f"{GIVEN} --free link1.a --fix link1.a", ("--fix and --free", "link1.a")),
    Case("prior: no tolerance", f"{GIVEN} --prior --tolerance-mm 0", ("--tolerance-mm 0", "above zero")),
    Case("observe: no cable", f"{GIVEN} --observe cable", ("good.csv", "cable_mm", "missing")),
    Case("observe: no sockets", f"{GIVEN} --observe socket", ("good.csv", "location", "missing")),
    Case("observe: no orientation", f"{GIVEN} --observe pose", ("good.csv", "orientation")),
    Case("observe: unknown", f"{GIVEN} --observe light", ("--observe", "light", "socket")),
    Case(
        "observe: angles of unknown meaning",
        "identify posed.csv --robot arm.toml --observe pose",
        ("posed.csv", "--orientation", "intrinsic-xyz"),
        {"posed.csv": POSED},
    ),
    Case("observe: validated", f"{GIVEN} --observe cable --validate good.csv", ("--observe cable", "--validate")),
    Case("orientation: of points", f"{GIVEN} --orientation fixed-xyz", ("--orientation", "--observe pose")),
    Case("noise: mrad of points", f"{GIVEN} --noise-mrad 1", ("--noise-mrad", "--observe pose")),
    Case("method: of points", f"{GIVEN} --method sequential", ("--method sequential", "--observe pose")),
    Case("socket: of points", f"{GIVEN} --socket-distance-mm 50", ("--socket-distance-mm", "--observe socket")),
    Case(
        "config: no file to identify",
        "identify --config c.json",
        ("c.json", "missing"),
        {"c.json": '{"schema": 1, "options": {}}'},
    ),
]

MEASUREMENTS = [
    Case("csv: missing", IDENTIFY, ("m.csv", "No such file", "check the path")),
    Case("csv: a folder", IDENTIFY, ("m.csv", "directory", "check the path"), {"m.csv/x": ""}),
    measured("empty", "", "empty", "header"),
    measured("only blank lines", "\n \n", "empty", "header"),
    measured("header alone", csv(GOOD[:1]), "no rows", "below the header"),
    measured("no header", csv(GOOD[1:]), "line 1", "q1"),
    measured("blank first line", "\n" + csv(), "line 1 is blank", "header"),
    measured("empty cells first", ",,\n" + csv(), "line 1 is blank", "header"),
    measured("binary", bytes(range(256)) * 4, "not a text file", "UTF-8"),
    measured("UTF-16", csv().encode("utf-16"), "not a text file", "UTF-8"),
    measured("zero bytes", b"\0\1\2\3" * 50, "not a text file", "UTF-8"),
    measured("UTF-16 without a mark", csv().encode("utf-16-le"), "not a text file", "UTF-8"),
    measured("tabs", csv(separator="\t"), "line 1", "tabs", "commas"),
    measured("unclosed quote", edited((7, "q1_deg", '"12')), "line 7", "quote"),
    measured("text after a quote", edited((7, "q1_deg", '"12"3')), "line 7", "quote"),
    measured("truncated in a row", csv()[:-40], "line 25", "cells", "header has 6"),
    measured("one cell too many", edited((2, "q2_deg", "1,2")), "line 2", "7 cells", "header has 6"),
    measured("blank lines are counted", "\n\n".join(edited((4, "q2_deg", "x")).splitlines()), "line 7", "q2_deg"),
    measured(
        "decimal marks that differ", swapped(DECIMAL_COMMAS, ",", "."), "line 3, column q1_deg", "line 2", "use one"
    ),
    measured("a thousands mark", swapped(DECIMAL_COMMAS, "\n", "\n1.0"), "line 2", "column q1_deg", "is not a number"),
    measured("commas below semicolons", swapped(csv(), ",", ";", 5), "line 2", "1 cells", "header has 6"),
    measured("Windows lines", edited((4, "q2_deg", "?")).replace("\n", "\r\n"), "line 4", "column q2_deg"),
    measured("column doubled", renamed(("p1_y_mm", "p1_x_mm")), "line 1", "p1_x_mm", "twice", "keep one"),
    measured("column without a name", renamed(("p1_y_mm", "")), "line 1", "column 5", "name it"),
    measured("joint missing", without("q2_deg"), "line 1", "joint q2 is missing", "q2_rad or q2_deg"),
    measured("slide missing", without("rail_mm"), "joint rail is missing", "rail_mm"),
    measured("joint twice, two units", joined("q1_rad", "0"), "line 1", "q1_deg", "q1_rad", "keep one"),
    measured("joint twice, two names", joined("q3_mm", "0"), "line 1", "rail_mm", "q3_mm", "keep one"),
    measured("joint in grads", renamed(("q2_deg", "q2_grad")), "line 1", "q2_grad", "unknown unit", "q2_deg"),
    measured("joint without a unit", renamed(("q2_deg", "q2")), "line 1", "column q2", "q2_rad or q2_deg"),
    measured("joint's further column", joined("q1_current", "1"), "line 1", "q1_current", "unknown unit", "_deg"),
    measured("hinge in mm", renamed(("q1_deg", "q1_mm")), "line 1", "q1", "deg or rad", "rename"),
    measured("slide in degrees", renamed(("rail_mm", "rail_deg")), "line 1", "rail", "mm or m", "rename"),
    measured("too many joints", joined("q4_deg", "1"), "line 1", "q4_deg", "q1, q2, rail", "--robot"),
    measured("joints of another robot", renamed(("q1_deg", "A1_deg")), "line 1", "q1", "q1, q2, rail"),
    measured("text in a joint", edited((9, "q1_deg", "left")), "line 9", "column q1_deg", "'left'", "give a number"),
    measured("NaN in a joint", edited((9, "q2_deg", "NaN")), "line 9", "column q2_deg", "not a finite number"),
    measured("infinite point", edited((9, "p1_x_mm", "-inf")), "line 9", "column p1_x_mm", "not a finite number"),
    measured("empty joint", edited((9, "rail_mm", "")), "line 9", "column rail_mm", "empty", "give a number"),
    measured("huge number", edited((9, "p1_x_mm", "1e300")), "line 9", "p1_x_mm", "too large", "unit"),
    measured("number beyond all", edited((9, "q1_deg", "1e99999999999")), "line 9", "q1_deg", "too large", "unit"),
    measured("underscore in a number", edited((9, "q1_deg", "1_0")), "line 9", "q1_deg", "'1_0'", "give a number"),
    measured("a unit in the cell", edited((9, "p1_z_mm", "12 mm")), "line 9", "p1_z_mm", "'12 mm'", "give a number"),
    measured("quoted decimal comma", edited((9, "q1_deg", '"1,5"')), "line 9", "q1_deg", "'1,5'", "decimal point"),
    measured("no point at all", csv([row[:3] for row in GOOD]), "line 1", "no measured point", "p1_x_mm"),
    measured("axis missing", without("p1_y_mm"), "line 1", "target p1 has no y", "p1_y_mm"),
    measured("point in inches", renamed(("p1_z_mm", "p1_z_in")), "line 1", "p1_z_in", "unknown unit", "_mm"),
    measured(
        "all of the point in cm",
        renamed(*((name, name.replace("mm", "cm")) for name in POINTS)),
        "line 1",
        "p1_x_cm",
        "unknown unit",
        "_mm",
    ),
    measured("unknown axis", joined("p1_w_mm", "1"), "line 1", "p1_w_mm", "unknown unit or axis", "p1_x_mm"),
    measured("unknown angle", joined("p1_rx_rad", "1"), "line 1", "p1_rx_rad", "unknown unit or axis"),
    measured("point in mm and m", joined("p1_x_m", "1"), "line 1", "p1_x_mm", "p1_x_m", "keep one"),
    measured("plain x beside p1", joined("x_mm", "1"), "line 1", "plain x, y, z", "p1_x_mm"),
    measured("plain x without a unit", joined("x", "1"), "line 1", "column x", "unknown unit", "_mm"),
    measured("half a point", edited((9, "p1_y_mm", "")), "line 9", "column p1_y_mm", "all three or none"),
    measured("every point empty", emptied(*range(2, ROWS + 2)), "every point is empty", "measured position"),
    measured("too few points", emptied(*range(5, ROWS + 2)), "3 poses", "at least 5", "measure more"),
    measured("two points", emptied(*range(4, ROWS + 2)), "2 measured points", "at least 5 poses"),
    measured("too few rows", csv(GOOD[:5]), "4 poses", "at least 5", "measure more"),
    measured("one id twice", joined("id", {4: "a", 9: "a"}), "line 9", "column id", "line 4", "its own"),
    measured(
        "bad use", joined("use", dict.fromkeys(range(2, 40), "fit")), "line 2", "column use", "'fit'", "calibrate"
    ),
    measured("empty use", joined("use", {2: "calibrate"}), "line 3", "column use", "skip"),
    measured("nothing to calibrate with", joined("use", "skip"), "use = calibrate", "mark"),
    measured("sigma zero", joined("sigma_mm", "0"), "line 2", "column sigma_mm", "above zero"),
    measured("sigma negative", joined("sigma_mm", {6: "-0.1"}), "line 6", "column sigma_mm", "above zero"),
    measured("sigma in some rows", joined("sigma_mm", {2: "1", 3: "1"}), "line 4", "column sigma_mm", "--noise-mm"),
    measured("sigma a word", joined("sigma_mm", {3: "small"}), "line 3", "column sigma_mm", "'small'"),
    measured("temperature a word", joined("temp_C", {3: "warm"}), "line 3", "column temp_C", "'warm'"),
    measured("approach of an unknown joint", joined("approach_q9", "1"), "line 1", "approach_q9", "q1, q2, rail"),
    measured("approach by two", joined("approach_q2", {5: "2"}), "line 5", "column approach_q2", "neither 1 nor -1"),
    measured("approach NaN", joined("approach_q2", {5: "nan"}), "line 5", "column approach_q2", "not a finite number"),
    measured("time infinite", joined("time_s", {5: "inf"}), "line 5", "column time_s", "not a finite number"),
    measured("payload NaN", joined("payload_kg", {5: "NaN"}), "line 5", "column payload_kg", "not a finite number"),
    measured("payload negative", joined("payload_kg", {5: "-1"}), "line 5", "column payload_kg", "0 to 1,000 kg"),
    measured("payload in grams", joined("payload_kg", {5: "2500"}), "line 5", "column payload_kg", "its unit"),
    measured("time empty", joined("time_s", {4: "3"}), "line 2", "column time_s", "fill", options="--model drift"),
    measured(
        "approach empty", approached(7), "line 7", "approach_q2", "empty", "fill it in", options="--model backlash"
    ),
    measured("holdout leaves too few", csv(GOOD[:7]), "at least 5", "measure more", options="--holdout 0.5"),
    measured(
        "one pose measured again and again",
        csv([GOOD[0], *[GOOD[1]] * 4]),
        "3 rows are copies",
        "1 row is left",
        "measure more",
    ),
    Case(
        "csv: nothing seen to test by",
        IDENTIFY,
        ("m.csv", "use = test", "measure"),
        {"m.csv": joined("use", dict.fromkeys(range(2, 25), "calibrate") | {25: "test"}, cells(emptied(25)))},
    ),
    Case(
        "validation: broken",
        "identify good.csv --robot arm.toml --validate v.csv",
        ("v.csv", "line 9", "column q1_deg"),
        {"v.csv": edited((9, "q1_deg", "left"))},
    ),
    Case(
        "validation: unknown target",
        "identify good.csv --robot arm.toml --validate v.csv",
        ("v.csv", "target p7", "those are p1", "--refit tool"),
        {"v.csv": renamed(*((name, name.replace("p1", "p7")) for name in POINTS))},
    ),
    Case(
        "validation: a condition missing",
        "identify m.csv --robot arm.toml --model backlash --validate good.csv",
        ("lab: good.csv: column approach_q1 is missing", "in every row"),
        {"m.csv": approached()},
    ),
    Case(
        "validation: a condition empty",
        "identify m.csv --robot arm.toml --model backlash --validate v.csv",
        ("lab: v.csv: line 6, column approach_q2: empty", "fill it in"),
        {"m.csv": approached(), "v.csv": approached(6)},
    ),
    Case(
        "validation: nothing to refit with",
        "identify good.csv --robot arm.toml --validate v.csv --refit base",
        ("v.csv", "use = reference", "mark one"),
        {"v.csv": joined("use", "test")},
    ),
    Case(
        "validation: too little to refit with",
        "identify good.csv --robot arm.toml --validate v.csv --refit base,tool",
        ("v.csv", "1 reference rows", "mark more"),
        {"v.csv": joined("use", dict.fromkeys(range(3, 26), "test") | {2: "reference"})},
    ),
    Case(
        "validation: nothing to judge",
        "identify good.csv --robot arm.toml --validate v.csv",
        ("v.csv", "no row left to validate on", "reference"),
        {"v.csv": joined("use", "reference")},
    ),
]

CASES = [*OPTIONS, *FITTING, *MEASUREMENTS]


@pytest.mark.sampled(4)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_bad_input_is_told_in_one_line(case: Case, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert_told_in_one_line(case, folder, capfd)


def identified(folder: Path, text: str | bytes, capfd: pytest.CaptureFixture[str]) -> tuple[int, dict[str, Any], str]:
    """Exit code, result and warnings of identifying from this file."""
    write(folder, {"m.csv": text})
    code = run(f"{IDENTIFY} --out run --overwrite --json")
    out, err = capfd.readouterr()
    return code, json.loads(out), "\n".join(warnings_of(err))


READ_RIGHT = {
    "as it is": csv(),
    "decimal commas": DECIMAL_COMMAS,
    "semicolons and points": csv(separator=";"),
    "Windows lines and a byte order mark": "\ufeff" + csv().replace("\n", "\r\n"),
    "blank lines": csv().replace("\n", "\n\n"),
    "spaces": csv(separator=" , "),
    "quotes": csv([[f'"{cell}"' for cell in row] for row in GOOD]),
    "plain x, y, z": renamed(*((name, name.removeprefix("p1_")) for name in POINTS)),
    "q1 to q3": renamed(("rail_mm", "q3_mm")),
    "some points not seen": emptied(3, 8),
    "reserved columns": joined("temp_C", {3: "21.5"}),
}


@pytest.mark.sampled(4)
@pytest.mark.parametrize("text", READ_RIGHT.values(), ids=READ_RIGHT)
def test_every_way_to_write_a_file_gives_the_same_arm(
    text: str, folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    code, result, warnings = identified(folder, text, capfd)
    left_out = "lab: warning: 2 of" in warnings and "no measured point" in warnings
    assert code == 0 and (warnings == "" or (text == READ_RIGHT["some points not seen"] and left_out))
    assert result["verdict"] == "good" and result["rank"] == result["identifiable"]
    assert result["after_mm"]["max"] < 1e-5  # the file is exact to 1e-9 mm and deg


WARNED = {
    "unknown columns": (joined("operator", "Ann"), "columns operator", "copied unchanged"),
    "orientation": (joined("p1_rx_deg", "1.5"), "p1_rx_deg", "ignored"),
    "orientation without a target": (joined("qw", "1"), "qw", "ignored"),
}


@pytest.mark.parametrize(("text", "place", "what"), WARNED.values(), ids=WARNED)
def test_what_is_not_used_is_kept_and_told(
    text: str, place: str, what: str, folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    code, result, warnings = identified(folder, text, capfd)
    assert code == 0 and "m.csv" in warnings and place in warnings and what in warnings
    assert result["warnings"]
    kept = (folder / "run" / "measurements.csv").read_text().splitlines()
    assert kept[0].endswith(text.splitlines()[0].split(",")[-1]) and kept[1].endswith(
        text.splitlines()[1].split(",")[-1]
    )


@pytest.mark.thorough
def test_degrees_in_a_radian_column_are_told(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    code, result, _ = identified(folder, renamed(("q1_deg", "q1_rad")), capfd)
    assert code == 1
    assert result["findings"][0]["name"] == "joint_unit" and "q1" in result["findings"][0]["of"]


def test_joints_that_came_from_one_side_show_no_backlash(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    sides = [(line, "approach_q1", "1") for line in range(2, ROWS + 2)]
    write(folder, {"both.csv": approached(), "one.csv": edited(*sides, table=cells(approached()))})
    assert run("identify both.csv --robot arm.toml --model backlash --json") == 0
    capfd.readouterr()
    assert run("identify one.csv --robot arm.toml --model backlash --json") == 1
    out, err = capfd.readouterr()
    assert "joint1.backlash" in json.loads(out)["reason"]
    assert any("joint1.backlash" in line for line in warnings_of(err))


def test_decimal_commas_of_every_numeric_column_are_read_back(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    text = csv(
        [
            [*row, "cable_mm" if i == 0 else "1,5"]
            for i, row in enumerate(cells(DECIMAL_COMMAS.replace(",", ".").replace(";", ",")))
        ],
        ";",
    ).replace(".", ",")
    assert identified(folder, text, capfd)[0] == 0
    assert identified(folder, (folder / "run" / "measurements.csv").read_bytes(), capfd)[0] == 0
