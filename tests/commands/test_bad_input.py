"""Bad input: one line that names the place and the mend, exit code 2, and no half-written run."""

import errno
import io
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from helpers.bad_input import (  # noqa: F401
    ARM_TOML,
    ARM_URDF,
    ARM_XML,
    GOOD,
    INERTIA,
    ROWS,
    contents,
    csv,
    folder,
    good_table,
    run,
    swapped,
    the_line,
)
from helpers.no_rendering import nothing_drawn  # noqa: F401

from lab.campaign.robot import load_robot, load_virtual

IDENTIFY = "identify m.csv --robot arm.toml"
CALIBRATE = "calibrate --robot arm.xml --poses 12"


# Texts of files with one thing wrong


POINTS = ("p1_x_mm", "p1_y_mm", "p1_z_mm")


DECIMAL_COMMAS = csv([[cell.replace(".", ",") for cell in row] for row in GOOD], ";")


def edited(*cells: tuple[int, str, str], table: list[list[str]] = GOOD) -> str:
    """The file with some cells changed; lines as an editor counts them."""
    new = [list(row) for row in table]
    for line, column, text in cells:
        new[line - 1][new[0].index(column)] = text
    return csv(new)


def renamed(*pairs: tuple[str, str]) -> str:
    names = dict(pairs)
    return csv([[names.get(name, name) for name in GOOD[0]], *GOOD[1:]])


def without(column: str) -> str:
    at = GOOD[0].index(column)
    return csv([row[:at] + row[at + 1 :] for row in GOOD])


def cells(text: str) -> list[list[str]]:
    return [line.split(",") for line in text.splitlines()]


def joined(name: str, texts: Mapping[int, str] | str = "", table: list[list[str]] = GOOD) -> str:
    """The file with one more column: the same text in every row, or texts by line."""
    of_line = texts if isinstance(texts, Mapping) else {}
    rest = texts if isinstance(texts, str) else ""
    return csv([[*row, name if i == 0 else of_line.get(i + 1, rest)] for i, row in enumerate(table)])


def emptied(*lines: int) -> str:
    return edited(*((line, column, "") for line in lines for column in POINTS))


def approached(blank: int = 0) -> str:
    """The file with sides from which each joint came; no side for the second joint in a line."""
    table = GOOD
    for k, joint in enumerate(("q1", "q2", "rail")):
        sides = {line: "1" if (line >> k) % 2 else "-1" for line in range(2, ROWS + 2)}
        if joint == "q2":
            sides.pop(blank, None)
        table = cells(joined(f"approach_{joint}", sides, table))
    return csv(table)


def plan(*poses: tuple[float, float, float]) -> str:
    return "q1_deg,q2_deg,q3_deg\n" + "".join(",".join(map(str, pose)) + "\n" for pose in poses)


@dataclass(frozen=True)
class Case:
    """Arguments, the files they speak of, and what the one line must contain."""

    id: str
    argv: str
    says: tuple[str, ...]
    files: Mapping[str, str | bytes] = field(default_factory=dict)


def measured(name: str, text: str | bytes, *says: str, options: str = "") -> Case:
    return Case(f"csv: {name}", f"{IDENTIFY} {options}", ("m.csv", *says), {"m.csv": text})


def toml(name: str, text: str | bytes, *says: str) -> Case:
    return Case(f"toml: {name}", "inspect robot.toml", ("robot.toml", *says), {"robot.toml": text})


def model(name: str, text: str | bytes, *says: str, suffix: str = "xml") -> Case:
    return Case(f"{suffix}: {name}", f"inspect robot.{suffix}", (f"robot.{suffix}", *says), {f"robot.{suffix}": text})


def planned(name: str, text: str, *says: str) -> Case:
    return Case(f"plan: {name}", f"{CALIBRATE} --plan p.csv", ("p.csv", *says), {"p.csv": text})


GIVEN = "identify good.csv --robot arm.toml"
POSED = "q1_deg,q2_deg,rail_mm,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg\n" + "\n".join(
    f"{7 * i},{5 * i - 40},{10 * i},1,2,3,{i},0,0" for i in range(ROWS)
)


def configured(name: str, text: str, *says: str, command: str = CALIBRATE) -> Case:
    return Case(f"config: {name}", f"{command} --config c.json", ("c.json", *says), {"c.json": text})


FITTING = [
    Case("model: unknown", f"{CALIBRATE} --model sag", ("--model sag", "compliance, payload, harmonics")),
    Case("model: empty", f"{CALIBRATE} --model ''", ("--model", "geometric, auto")),
    Case("model: twice", f"{CALIBRATE} --model gear+gear", ("--model gear+gear", "different groups")),
    Case("model: auto beside a group", f"{CALIBRATE} --model auto+gear", ("--model auto", "no such group")),
    Case("model: both compliances", f"{CALIBRATE} --model compliance+payload", ("compliance+payload", "choose one")),
    Case("model: no masses", f"{GIVEN} --model compliance", ("compliance", "without masses", "MJCF")),
    Case("model: no approach", f"{GIVEN} --model backlash", ("good.csv", "approach_q1", "missing")),
    Case("model: auto to inspect", "inspect arm.toml --model auto", ("--model auto", "name groups")),
    Case(
        "fix: unknown",
        f"{GIVEN} --fix link9.d",
        ("--fix link9.d", "no such parameter", "nearest are", "link3.d", "groups are base.*, link1.*"),
    ),
    Case("fix: everything", f"{GIVEN} --fix '*'", ("--fix", "no parameter")),
    Case("free: hidden", f"{GIVEN} --free link1.theta", ("--free link1.theta", "hidden in", "base.rz")),
    Case("free: both", f"{GIVEN} --free link1.a --fix link1.a", ("--fix and --free", "link1.a")),
    Case("prior: no tolerance", f"{GIVEN} --prior --tolerance-mm 0", ("--tolerance-mm 0", "above zero")),
    Case("tool: two numbers", "inspect arm.toml --tool-mm 1,2", ("--tool-mm", "x, y and z")),
    Case("tool: words", "inspect arm.toml --tool-mm a,b,c", ("--tool-mm", "not a number")),
    Case("tool: not finite", "inspect arm.toml --tool-mm nan,0,0", ("--tool-mm nan", "finite")),
    Case("tool: beyond all", "inspect arm.toml --tool-mm 0,-1e999,0", ("--tool-mm -inf", "finite")),
    Case("tool: absurd", "inspect arm.toml --tool-mm 0,0,1e300", ("--tool-mm 1e+300", "at most")),
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
    Case("effects: lag", f"{CALIBRATE} --lag 1", ("--lag", "below 1")),
    Case("effects: negative", f"{CALIBRATE} --harmonic-mrad -1", ("--harmonic-mrad -1", "from 0")),
    Case("effects: no stiffness", f"{CALIBRATE} --stiffness-nm-per-rad 0", ("--stiffness-nm-per-rad", "above zero")),
    Case("effects: half a range", f"{CALIBRATE} --bad-mm 5", ("--bad-mm", "least and the largest")),
    Case("effects: payload in words", f"{CALIBRATE} --payload-kg heavy", ("--payload-kg", "not a number")),
    Case("config: missing", f"{CALIBRATE} --config gone.json", ("gone.json", "config.json")),
    Case("config: no file named", f"{CALIBRATE} --config", ("--config", "config.json")),
    configured("not JSON", "poses: 3", "not JSON"),
    configured("a list", "[]", "has no options"),
    configured("of another command", '{"command": "identify", "options": {}}', "lab identify"),
    configured("unknown option", '{"options": {"pose": 12}}', "'pose'", "poses"),
    configured("wrong kind", '{"options": {"poses": "many"}}', "'many'", "poses"),
    configured("wrong group", '{"options": {"effects": 3}}', "'effects'"),
    configured("a truth in a list", '{"options": {"effects": {"payload_kg": [true]}}}', "[True]", "payload_kg'"),
    configured("a number among names", '{"options": {"targets": ["p1", 1]}}', "'targets'"),
    configured("no file to identify", '{"options": {}}', "missing", command="identify"),
]

COMMAND_LINE = [
    Case("cli: no command", "", ("calibrate, identify, inspect", "--help")),
    Case("cli: unknown command", "callibrate", ("callibrate", "--help")),
    Case("cli: identify nothing", "identify", ("identify", "PATH", "--help")),
    Case("cli: unknown flag", "calibrate --bogus 3", ("--bogus", "--help")),
    Case("cli: poses not whole", "calibrate --poses 1.5", ("--poses", "'1.5' is not a whole number")),
    Case("cli: gate not a number", "calibrate --gate-mm wide", ("--gate-mm", "'wide' is not a number")),
    Case("cli: value missing", "calibrate --poses", ("--poses", "Missing value")),
    Case("cli: one argument too many", "inspect arm.toml more", ("more", "--help")),
    Case("option: no poses", f"{CALIBRATE} --poses 0", ("--poses 0", "1 or more")),
    Case("option: negative poses", f"{CALIBRATE} --poses -3", ("--poses -3", "1 or more")),
    Case("option: too few poses", f"{CALIBRATE} --poses 3", ("--poses 3", "need at least 5", "measure more")),
    Case("option: one pose", f"{CALIBRATE} --poses 1", ("--poses 1", "at least 5 poses")),
    Case("option: no readings", f"{CALIBRATE} --readings 0", ("--readings 0", "1 or more")),
    Case("option: negative seed", f"{CALIBRATE} --seed -1", ("--seed -1", "0 or more")),
    Case("option: negative sigma", f"{CALIBRATE} --position-sigma-mm -1", ("--position-sigma-mm -1", "0 to")),
    Case("option: sigma NaN", f"{CALIBRATE} --rotation-sigma-mrad nan", ("--rotation-sigma-mrad nan", "0 to")),
    Case("option: sigma absurd", f"{CALIBRATE} --position-sigma-mm 1e300", ("--position-sigma-mm", "0 to")),
    Case("option: noise zero", f"{CALIBRATE} --noise-mm 0", ("--noise-mm 0", "above zero")),
    Case("option: noise infinite", "identify good.csv --robot arm.toml --noise-mm inf", ("--noise-mm inf", "from")),
    Case("option: gate NaN", f"{CALIBRATE} --gate-mm nan", ("--gate-mm nan", "above zero")),
    Case("option: gate negative", "identify good.csv --robot arm.toml --gate-mm -1", ("--gate-mm -1", "above zero")),
    Case("option: unknown target", f"{CALIBRATE} --targets p9", ("'p9'", "p1, p2, p3")),
    Case("option: unknown target inspected", "inspect arm.toml --targets p1,q", ("'q'", "p1, p2, p3")),
    Case("option: target doubled", f"{CALIBRATE} --targets p1,p1", ("targets p1, p1", "each once")),
    Case("option: no target", "inspect arm.toml --targets ''", ("targets (none)", "at least one")),
    Case("option: unknown instrument", f"{CALIBRATE} --instrument ruler", ("'ruler'", "exact", "leica-at960")),
    Case("option: unknown instrument to weigh", "identify good.csv --robot arm.toml --instrument ''", ("''", "exact")),
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
    Case("robot: unknown", "inspect irb121", ("'irb121'", "irb120", ".toml")),
    Case("robot: empty name", "inspect ''", ("''", "irb120")),
    Case("robot: the folder above", "inspect ..", ("'..'", "irb120")),
    Case("robot: a folder", "inspect folder.xml", ("folder.xml", "irb120"), {"folder.xml/x": ""}),
    Case("robot: a file of another kind", "inspect good.csv", ("good.csv", ".xml, .urdf or .toml")),
    Case("robot: no such file", "identify good.csv --robot gone.xml", ("gone.xml", "irb120")),
    Case("out: is a file", f"{CALIBRATE} --out good.csv", ("good.csv", "is a file", "--out")),
    Case("out: below a file", f"{CALIBRATE} --out good.csv/run", ("good.csv/run", "cannot be written", "--out")),
    Case("out: nowhere to write", "identify good.csv --robot arm.toml --out /proc/run", ("/proc/run", "--out")),
    Case("out: holds other files", f"{CALIBRATE} --out mine", ("mine", "photo.jpg", "--out"), {"mine/photo.jpg": ""}),
    Case("out: the working folder", f"{CALIBRATE} --out .", ("holds arm.toml", "--out")),
    Case(
        "out: a config of something else",
        f"{CALIBRATE} --out mine",
        ("mine", "no run", "--out"),
        {"mine/config.json": "{}"},
    ),
    Case(
        "out: a run with a note in it",
        f"{CALIBRATE} --out mine",
        ("mine", "holds note.txt", "--out"),
        {"mine/config.json": '{"model_sha256": ""}', "mine/note.txt": ""},
    ),
]

MEASUREMENTS = [
    Case("csv: missing", IDENTIFY, ("m.csv", "No such file", "check the path")),
    Case("csv: a folder", IDENTIFY, ("m.csv", "directory", "check the path"), {"m.csv/x": ""}),
    measured("empty", "", "empty", "header"),
    measured("only blank lines", "\n \n", "empty", "header"),
    measured("header alone", csv(GOOD[:1]), "no rows", "one row a pose"),
    measured("no header", csv(GOOD[1:]), "line 1", "q1"),
    measured("blank first line", "\n" + csv(), "line 1 is blank", "header"),
    measured("empty cells first", ",,\n" + csv(), "line 1 is blank", "header"),
    measured("binary", bytes(range(256)) * 4, "not a text file", "UTF-8"),
    measured("UTF-16", csv().encode("utf-16"), "not a text file", "UTF-8"),
    measured("binary that passes for text", b"\0\1\2\3" * 50, "no rows", "give"),
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
        "one pose measured again and again", csv([GOOD[0], *[GOOD[1]] * 4]), "4 poses", "at least 5", "measure more"
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
        ("v.csv", "no row left to judge", "reference"),
        {"v.csv": joined("use", "reference")},
    ),
    planned("out of limits", plan((10, 10, 10), (10, 10, 171)), "line 3", "joint q3", "beyond its limits", "mend"),
    planned("degrees called radians", plan((1, 1, 10)).replace("deg", "rad"), "line 2", "q3", "572.958°", "unit"),
    planned("colliding", plan((10, 10, 10), (0, 108, 0)), "line 3", "collides", "take it out"),
    planned("empty", "", "empty", "header"),
    planned("no pose", "q1_deg,q2_deg,q3_deg\n", "no rows", "one row a pose"),
    planned("a joint missing", "q1_deg,q2_deg\n1,2\n", "line 1", "q3", "q3_deg"),
    planned("a word", plan((1, 2, 3)).replace("3\n", "three\n").replace("qthree", "q3"), "line 2", "'three'"),
    planned("two poses", plan((1, 2, 3), (30, 20, 10)), "2 measured points", "at least 5 poses"),
    planned("too few poses", plan((1, 2, 3), (30, 20, 10), (-10, 5, 30)), "3 poses", "at least 5"),
]

TABLES = [
    toml("empty", "", "convention", '"distal" or "craig"'),
    toml("malformed", 'name = "x"\nconvention distal\n', "not a TOML file", "line 2"),
    toml("truncated", ARM_TOML[:-12], "not a TOML file"),
    toml("binary", bytes(range(256)), "not a TOML file"),
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
    toml("unknown key on top", "units = 1\n" + ARM_TOML, "'units'", "convention, height_mm, joint, name, tool"),
    toml("a word for a number", swapped(ARM_TOML, "d_mm = 300", 'd_mm = "300"'), "joint q1", "d_mm is '300'", "finite"),
    toml("a truth for a number", swapped(ARM_TOML, "d_mm = 300", "d_mm = true"), "joint q1", "d_mm is True", "finite"),
    toml("infinite", swapped(ARM_TOML, "d_mm = 300", "d_mm = inf"), "joint q1", "d_mm is inf", "finite number"),
    toml(
        "too many digits", swapped(ARM_TOML, "d_mm = 300", f"d_mm = 1{'0' * 400}"), "joint q1", "d_mm", "finite number"
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

SECOND_ARM = '<body name="d" pos="1 0 0"><geom size=".1"/><joint name="r1"/></body></worldbody>'
MODELS = [
    model("empty", "", "empty file", "mend"),
    model("malformed", "<mujoco><worldbody", "not a readable MJCF or URDF", "mend", "Line number=1"),
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

CASES = [*COMMAND_LINE, *FITTING, *MEASUREMENTS, *TABLES, *MODELS]


def write(folder: Path, files: Mapping[str, str | bytes]) -> None:
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())


def test_the_table_is_long_and_each_case_is_its_own() -> None:
    assert len(CASES) >= 100
    assert len({case.id for case in CASES}) == len(CASES)
    assert len({(case.argv, *map(str, case.files.values())) for case in CASES}) == len(CASES)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_bad_input_is_told_in_one_line(case: Case, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write(folder, case.files)
    before = contents(folder)
    assert run(case.argv) == 2
    out, err = capfd.readouterr()
    line = the_line(err)
    assert out == ""
    assert [fragment for fragment in case.says if fragment not in line] == [], line
    assert contents(folder) == before  # no run, no half of one, no log


@pytest.mark.parametrize(
    "name", ["config.json", "measurements.csv", "parameters.json", "calibrated.xml", "result.json"]
)
@pytest.mark.parametrize("out", ["run", "a/b/run"])
def test_a_disk_that_fills_up_leaves_the_earlier_run(
    name: str, out: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    if out == "run":
        assert run(f"{CALIBRATE} --out {out}") == 0
    before = contents(folder)
    fill_disk_at(name, monkeypatch)
    capfd.readouterr()
    assert run(f"{CALIBRATE} --seed 5 --out {out}") == 2
    written, err = capfd.readouterr()
    assert written == ""
    line = the_line(err)
    assert out in line and "No space left on device" in line and "make room" in line
    assert contents(folder) == before


def fill_disk_at(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of the file of this name goes to the disk, then the disk is full."""
    plain = Path.open

    def full(path: Path, mode: str = "r", *rest: Any, **more: Any) -> Any:
        file = plain(path, mode, *rest, **more)
        if path.name == name and "w" in mode:
            write = file.write

            def half(text: str) -> int:
                write(text[: len(text) // 2])
                raise OSError(errno.ENOSPC, "No space left on device")

            class Full:
                def __enter__(self) -> "Full":
                    return self

                def __exit__(self, *error: object) -> None:
                    file.close()

                write = staticmethod(half)

            return Full()
        return file

    monkeypatch.setattr(Path, "open", full)


def test_a_recording_that_fails_leaves_no_run(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def fail(path: Path, outcome: object) -> None:
        path.write_bytes(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(sys.modules["lab.commands.calibrate.recording"], "record", fail)
    before = contents(folder)
    assert run(CALIBRATE) == 2
    assert "No space left on device" in the_line(capfd.readouterr().err)
    assert contents(folder) == before


def test_a_run_that_cannot_be_put_in_place_leaves_the_earlier_one(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run(f"{CALIBRATE} --out run") == 0
    before, rename = contents(folder), Path.rename

    def busy(path: Path, target: Path) -> Path:
        if ".partial-" in path.name:
            raise OSError(errno.EBUSY, "Device or resource busy")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", busy)
    capfd.readouterr()
    assert run(f"{CALIBRATE} --seed 5 --out run") == 2
    assert "busy" in the_line(capfd.readouterr().err)
    assert contents(folder) == before


def test_output_that_cannot_be_written_is_told(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    class Full(io.StringIO):
        def flush(self) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(sys, "stdout", Full())
    assert run("inspect arm.toml --json") == 2
    assert "No space left on device" in the_line(capfd.readouterr().err)


# What is no error


def warnings_of(err: str) -> list[str]:
    lines = err.splitlines()
    assert all(line.startswith("lab: warning: ") for line in lines), err
    return lines


def identified(folder: Path, text: str | bytes, capfd: pytest.CaptureFixture[str]) -> tuple[int, dict[str, Any], str]:
    """Exit code, result and warnings of identifying from this file."""
    write(folder, {"m.csv": text})
    code = run(f"{IDENTIFY} --out run --json")
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
    "unknown columns": (joined("operator", "Ann"), "columns operator", "kept"),
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


def test_degrees_in_a_radian_column_are_told(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    code, _, warnings = identified(folder, renamed(("q1_deg", "q1_rad")), capfd)
    assert code == 1
    assert "m.csv: joint q1" in warnings and "looks like degrees" in warnings and "_deg" in warnings


def test_joints_that_came_from_one_side_show_no_backlash(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    sides = [(line, "approach_q1", "1") for line in range(2, ROWS + 2)]
    write(folder, {"both.csv": approached(), "one.csv": edited(*sides, table=cells(approached()))})
    assert run("identify both.csv --robot arm.toml --model backlash --json") == 0
    capfd.readouterr()
    assert run("identify one.csv --robot arm.toml --model backlash --json") == 1
    out, err = capfd.readouterr()
    assert "do not tell joint1.backlash apart" in json.loads(out)["reason"]
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


def test_an_earlier_run_is_replaced(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for seed in (1, 2):
        assert run(f"{CALIBRATE} --seed {seed} --out run") == 0
        assert json.loads((folder / "run" / "config.json").read_text())["options"]["seed"] == seed
    assert {path.name for path in folder.iterdir() if path.is_dir()} == {"run"}


def test_an_empty_folder_may_become_the_run(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (folder / "run").mkdir()
    assert run(f"{CALIBRATE} --out run") == 0
    assert (folder / "run" / "result.json").is_file()


def test_a_run_without_out_gets_a_name_of_its_own(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert [run(CALIBRATE), run(CALIBRATE)] == [0, 0]
    assert {path.name for path in (folder / "runs").iterdir()} == {"calibrate-arm-seed0", "calibrate-arm-seed0-2"}


def test_a_small_urdf_works(capfd: pytest.CaptureFixture[str]) -> None:
    assert run("inspect arm.urdf --json") == 0
    table = json.loads(capfd.readouterr().out)
    assert [joint["d_mm"] for joint in table["joints"]] == [400.0, 0.0]
    assert run("calibrate --robot arm.urdf --poses 12 --json") == 0


def test_a_urdf_of_axes_alone_becomes_a_virtual_arm(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write(folder, {"robot.urdf": ARM_URDF.replace(INERTIA, "")})
    assert run("calibrate --robot robot.urdf --poses 20 --json") == 0
    assert "drawn as rods and weigh what rods would" in capfd.readouterr().err
    assert load_robot("robot.urdf").loads is None  # measurements of a real arm are not explained by guessed masses
    loads = load_virtual("robot.urdf").loads
    assert loads is not None and (loads.mass_kg > 0.01).all()


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
    assert f"robot.{suffix}" in line and "gone." in line and "put them there" in line and not Path("run").exists()


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
