"""Measurement files: nothing is lost, units come from names."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.robots import IRB120, VERSATRAN, data_file
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.formats import csv_table, measurement_csv
from lab.formats.measurement_csv import ObservedColumns, read_measurements, write_measurements

NAMES, SLIDES = IRB120.chain.joint_names, IRB120.chain.prismatic


def random_measurements(rng: np.random.Generator, slides) -> Measurements:
    n, k, j = 200, 2, len(slides)
    points = rng.normal(size=(n, k, 3)) * 10.0 ** rng.integers(-12, 3, (n, k, 3))
    points[rng.random((n, k)) < 0.2] = np.nan
    joints = rng.normal(size=(n, j)) * 10.0 ** rng.integers(-12, 1, (n, j))
    sigma = np.where(rng.random(n) < 0.5, np.nan, rng.random(n))
    use = tuple(rng.choice(["calibrate", "reference", "test", "skip"], n))
    names = tuple(f"q{i + 1}" for i in range(j))
    other = {"note": tuple('a,"b"' for _ in range(n))}
    conditions = {"temp_C": np.where(rng.random(n) < 0.5, np.nan, 20 + rng.random(n)), "approach_q2": np.ones(n)}
    ids, days = tuple(f"row{i}" for i in range(n)), tuple(rng.choice(["mon", "tue"], n))
    return Measurements(
        names, joints, ("ball", "p2"), points, ids, use, days, sigma, other, True, conditions=conditions
    )


def test_what_is_written_reads_back_to_the_bit(tmp_path) -> None:
    for slides in (SLIDES, VERSATRAN.prismatic):
        data = random_measurements(np.random.default_rng(0), slides)
        path = tmp_path / "data.csv"
        write_measurements(path, data, slides)
        back = read_measurements(path, data.joint_names, slides)
        for name in ("joints", "points", "sigma_m"):
            np.testing.assert_array_equal(getattr(back, name), getattr(data, name))
        for name in ("joint_names", "targets", "ids", "use", "sessions", "other", "marked"):
            assert getattr(back, name) == getattr(data, name)
        assert list(back.conditions) == list(data.conditions)
        for name, column in data.conditions.items():
            np.testing.assert_array_equal(back.conditions[name], column)


TEXTS = st.text(st.characters(exclude_categories=["C"], exclude_characters="\ufeff"), min_size=1).map(str.strip)
NUMBERS = st.floats(-1e3, 1e3, allow_subnormal=True)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(TEXTS.filter(bool), NUMBERS, NUMBERS), min_size=1, max_size=5, unique_by=lambda row: row[0]))
def test_whatever_ids_and_numbers_are_they_read_back(tmp_path, rows: list[tuple[str, float, float]]) -> None:
    ids, angles, lengths = zip(*rows, strict=True)
    joints = np.tile(np.array(angles)[:, None] / 1e3, (1, 6))
    points = np.tile(np.array(lengths)[:, None, None], (1, 1, 3))
    data = replace(measured(NAMES, joints, ("p1",), points), ids=ids)
    write_measurements(tmp_path / "data.csv", data, SLIDES)
    back = read_measurements(tmp_path / "data.csv", NAMES, SLIDES)
    assert back.ids == data.ids
    np.testing.assert_array_equal(back.joints, joints)
    np.testing.assert_array_equal(back.points, points)


def test_units_come_from_names(tmp_path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("q1_deg,q2_rad,q3_deg,q4_deg,q5_deg,q6_deg,x_m,y_mm,z_mm\n180,1.5,0,0,0,-90,1.5,2.5,-3\n")
    data = read_measurements(path, NAMES, SLIDES)
    np.testing.assert_allclose(data.joints, [[np.pi, 1.5, 0, 0, 0, -np.pi / 2]])
    np.testing.assert_array_equal(data.points, [[[1.5, 0.0025, -0.003]]])
    assert data.targets == ("p1",) and data.ids == ("0",) and not data.warnings


def test_decimal_commas_read_like_points(tmp_path) -> None:
    header = [f"q{i}_deg" for i in range(1, 7)] + ["p1_x_mm", "p1_y_mm", "p1_z_mm", "id"]
    row = ["1.5", "-2.25", "3", "4", "5", "6", "100.125", "-7.5", "8", "first"]
    comma, point = tmp_path / "comma.csv", tmp_path / "point.csv"
    point.write_text(",".join(header) + "\n" + ",".join(row) + "\n")
    comma.write_text(";".join(header) + "\n" + ";".join(cell.replace(".", ",") for cell in row) + "\n")
    a, b = (read_measurements(path, NAMES, SLIDES) for path in (comma, point))
    np.testing.assert_array_equal(a.joints, b.joints)
    np.testing.assert_array_equal(a.points, b.points)
    assert a.ids == ("first",)


def test_where_a_row_stands(tmp_path) -> None:
    path = tmp_path / "a.csv"
    head = ",".join(f"q{i}_deg" for i in range(1, 7))
    path.write_text(f"id,{head},x_mm,y_mm,z_mm\na,0,0,0,0,0,0,1,2,3\n\nb,0,0,0,0,0,0,1,2,3\n")
    data = read_measurements(path, NAMES, SLIDES)
    assert [data.where(i) for i in range(2)] == ["line 2", "line 4"]
    assert data[[1]].where(0) == "line 4"
    assert replace(data, lines=()).where(1) == "row b"


@pytest.mark.parametrize(("kg", "right"), [("0", True), ("1000", True), ("", True), ("-0.1", False), ("1001", False)])
def test_a_payload_is_what_an_arm_may_carry(kg: str, right: bool, tmp_path) -> None:
    path = tmp_path / "a.csv"
    head = ",".join(f"q{i}_deg" for i in range(1, 7))
    path.write_text(f"{head},x_mm,y_mm,z_mm,payload_kg\n0,0,0,0,0,0,1,2,3,2\n0,0,0,0,0,0,1,2,3,{kg}\n")
    if right:
        payloads = read_measurements(path, NAMES, SLIDES).conditions["payload_kg"]
        np.testing.assert_array_equal(payloads, [2.0, float(kg or "nan")])
    else:
        with pytest.raises(LabError, match=r"line 3, column payload_kg: outside 0 to 1,000 kg"):
            read_measurements(path, NAMES, SLIDES)


def test_ids_sessions_and_uses_are_kept_with_their_rows(tmp_path) -> None:
    path = tmp_path / "a.csv"
    head = ",".join(f"q{i}_deg" for i in range(1, 7))
    path.write_text(f"id,use,session,{head},x_mm,y_mm,z_mm\n,skip,s1,0,0,0,0,0,0,1,2,3\nb,test,s2,0,0,0,0,0,0,,,\n")
    data = read_measurements(path, NAMES, SLIDES)
    assert data.ids == ("0", "b") and data.use == ("skip", "test") and data.sessions == ("s1", "s2")
    assert data.seen.tolist() == [[True], [False]]
    picked = data.only("test")
    assert picked.ids == ("b",) and picked.sessions == ("s2",) and len(picked) == 1


def test_a_real_file_of_three_targets_is_understood() -> None:
    three = read_measurements(data_file("irb120_liaowu_calib36.csv"), NAMES, SLIDES)
    assert three.targets == ("p1", "p2", "p3") and three.points.shape == (36, 3, 3) and not three.warnings


def test_a_real_file_with_orientations_and_temperatures_is_understood() -> None:
    probe = read_measurements(data_file("ur10_ipa_D.csv"), NAMES, SLIDES)
    assert len(probe) == 632 and len(probe.warnings) == 1
    assert all(name in probe.warnings[0] for name in ("rx_deg", "ry_deg", "rz_deg"))
    assert set(probe.other) == {"rx_deg", "ry_deg", "rz_deg"} and set(probe.conditions) == {"temp_C"}


def test_a_kind_of_observation_has_columns_of_its_own(tmp_path) -> None:
    path = tmp_path / "m.csv"
    path.write_text(
        "q1_deg,q2_deg,x_mm,y_mm,z_mm,qw,qx,qy,qz,range_mm,mirror\n1,2,3,4,5,1,0,0,0,100,a\n1,2,,,,,,,,,b\n"
    )
    columns = ObservedColumns(positions=False, numbers=("range_mm",), texts=("mirror",), observed="range")
    data = read_measurements(path, ("a", "b"), (False, False), columns=columns)
    np.testing.assert_array_equal(data.conditions["range_mm"], [100.0, np.nan])
    assert data.other["mirror"] == ("a", "b") and "range_mm" not in data.other
    ignored = [warning.removeprefix(f"{path}: ") for warning in data.warnings]
    assert ignored == [
        "orientation columns qw, qx, qy, qz are ignored: --observe range",
        "points p1 are ignored: --observe range",
    ]
    points = read_measurements(path, ("a", "b"), (False, False))
    assert "range_mm" in points.other and "range_mm, mirror have no meaning here" in points.warnings[-1]


FORMULAS = ("=cmd|' /C calc'!A0", "+1+cmd", "-2+3", "@SUM(A1)", "'=x", "''-x", "-5", "+1.5", "'", "it's", "a=b")


@pytest.mark.parametrize("text", FORMULAS)
def test_texts_are_no_formulas_to_a_spreadsheet_and_come_back(text: str, tmp_path: Path) -> None:
    """OWASP's CSV injection: a cell that begins with = + - @ is run by whoever opens the file."""
    data = measured(("q1",), np.zeros((2, 1)), ("p1",), np.ones((2, 1, 3)))
    data = replace(data, ids=(text, "plain"), sessions=(text, "s"), other={"note": (text, "-3.5")})
    path = tmp_path / "day.csv"
    write_measurements(path, data, (False,))
    written = list(csv.reader(path.read_text().splitlines()))
    formulas = [cell for row in written for cell in row if cell[:1] in ("=", "+", "-", "@")]
    assert all(np.isfinite(float(cell)) for cell in formulas)  # a plain number is none
    back = read_measurements(path, ("q1",), (False,))
    assert back.ids == data.ids and back.sessions == data.sessions and back.other["note"] == (text, "-3.5")


NUMBERS = ("+1", "-1", "-0", "+1.5e3", "'-1", "=1", "@x")


def test_names_like_numbers_are_texts_to_a_spreadsheet_and_come_back(tmp_path: Path) -> None:
    """Of an id +1 it would keep the 1, and then there are two."""
    data = measured(("q1",), np.zeros((len(NUMBERS), 1)), ("p1",), np.ones((len(NUMBERS), 1, 3)))
    data = replace(data, ids=NUMBERS, sessions=NUMBERS, other={"note": ("-3.5",) * len(NUMBERS)})
    write_measurements(tmp_path / "day.csv", data, (False,))
    csv_table.write_columns(tmp_path / "joints.csv", {"id": NUMBERS, "q1_deg": [-1.0] * len(NUMBERS)})
    for name, columns in (("day.csv", ("id", "session")), ("joints.csv", ("id",))):
        rows = list(csv.DictReader((tmp_path / name).read_text().splitlines()))
        assert all(row[column].startswith("'") for row in rows for column in columns)
        assert csv_table.CsvTable(tmp_path / name).texts("id") == NUMBERS
    assert {row["note"] for row in csv.DictReader((tmp_path / "day.csv").read_text().splitlines())} == {"-3.5"}
    back = read_measurements(tmp_path / "day.csv", ("q1",), (False,))
    assert back.ids == NUMBERS and back.sessions == NUMBERS


def test_a_file_of_several_blocks_reads_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_table, "_BLOCK", 7)
    monkeypatch.setattr(measurement_csv, "_BLOCK", 9)
    data = random_measurements(np.random.default_rng(5), SLIDES)
    write_measurements(tmp_path / "data.csv", data, SLIDES)
    names = tuple(data.joint_names)
    back = read_measurements(tmp_path / "data.csv", names, SLIDES)
    np.testing.assert_array_equal(back.joints, data.joints)
    np.testing.assert_array_equal(back.points, data.points)
    assert back.ids == data.ids and back.other == data.other and back.lines == tuple(range(2, 202))


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_end_as_on_any_system(tmp_path: Path, end: str) -> None:
    (tmp_path / "a.csv").write_bytes(end.join(["a,b", "1, 2 ", "", ' ,""', '"x\ny",3']).encode())
    table = csv_table.CsvTable(tmp_path / "a.csv")
    assert table.texts("a") == ("1", "x\ny") and table.texts("b") == ("2", "3")
    assert list(table.lines) == [2, 5]


def test_a_late_error_names_its_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_table, "_BLOCK", 3)
    rows = "".join(f"{i},{i}.5\n" for i in range(10))
    (tmp_path / "a.csv").write_text("a,b\n" + rows + "x,1\n1,2\n")
    table = csv_table.CsvTable(tmp_path / "a.csv")
    with pytest.raises(LabError, match=r"line 12, column a: 'x' is not a number"):
        table.numbers("a")
    np.testing.assert_array_equal(table.numbers("b")[:3], [0.5, 1.5, 2.5])
    (tmp_path / "a.csv").write_text("a,b\n" + rows + "1\n")
    with pytest.raises(LabError, match=r"line 12: 1 cells, but the header has 2"):
        csv_table.CsvTable(tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("text", "hinted"),
    [
        ("Measurement log, CellView 3.2\nNo;X [mm];Axis 1 [deg]\nP1;1,5;2,5\n", True),
        ("No;X [mm];Axis 1 [deg]\nP1;1.5;2.5\n", True),
        ("q1_deg,p1_x_mm\n1\n", False),
        ("q1,p1_x_mm\n1,2\n", False),
        ("", False),
    ],
)
def test_an_instrument_s_own_file_is_pointed_to_the_import(text: str, hinted: bool, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(text)
    with pytest.raises(LabError) as error:
        read_measurements(tmp_path / "log.csv", ("q1",), (False,))
    assert ("lab import" in str(error.value)) == hinted and "\n" not in str(error.value)
