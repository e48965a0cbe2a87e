"""Exports of trackers' programs: the same points from every form, and one line for each that cannot be understood."""

from pathlib import Path

import numpy as np
import pytest
from day_files import BEGIN, leica
from helpers.tracker_files import plain, polyworks, spatial_analyzer

from lab.core.errors import LabError
from lab.formats.loose_table import PointColumns, heading_of, read_column_map, read_loose
from lab.formats.tracker_export import TrackerPoints, read_tracker_points

NAMES = ("A1", "A2", "B 3", "A4")
POINTS = np.array([[1.25, -0.5, 0.125], [2.0, 0.75, -0.0625], [-1.5, 0.25, 3.0], [0.5, 0.5, 0.5]])
SIGMA = 1e-6 * np.array([[10, 12, 14], [20, 20, 20], [9, 8, 7], [30, 10, 10.0]])


def read(path: Path, text: str | None = None, *, unit: str | None = None, coverage: float = 1.0) -> TrackerPoints:
    if text is not None:
        path.write_text(text)
    return read_tracker_points(read_loose(path, 3), PointColumns(), unit, coverage)


def test_every_program_s_form_gives_the_same_points(tmp_path: Path) -> None:
    for write in (spatial_analyzer, polyworks):
        found = read(write(tmp_path / write.__name__, NAMES, POINTS))
        assert found.names == NAMES
        np.testing.assert_allclose(found.positions, POINTS, atol=1e-12)
        assert np.isnan(found.sigma_m).all()
    found = read(plain(tmp_path / "plain", ("A1", "A2", "A3", "A4"), POINTS), unit="mm")
    np.testing.assert_allclose(found.positions, POINTS, atol=1e-12)


def test_leica_s_conditions_and_uncertainties(tmp_path: Path) -> None:
    found = read(leica(tmp_path / "l.csv", NAMES, POINTS, SIGMA, (0.0, 30.5, 61.0, 90.25)))
    np.testing.assert_allclose(found.positions, POINTS, atol=1e-12)
    np.testing.assert_allclose(found.sigma_m, np.sqrt((SIGMA**2).mean(axis=1)), rtol=1e-6)
    assert found.clock == "date"
    np.testing.assert_allclose(found.seconds - BEGIN.timestamp(), [0.0, 30.5, 61.0, 90.25], atol=1e-5)
    np.testing.assert_allclose(found.temperature_c, [20.0, 20.1, 20.2, 20.3])
    np.testing.assert_allclose(found.pressure_hpa, 1013.2)
    assert [(each.line, each.why) for each in found.left_out] == [(1, "above the table")]


def test_uncertainties_for_two_standard_deviations_are_halved(tmp_path: Path) -> None:
    file = spatial_analyzer(tmp_path / "sa.txt", NAMES, POINTS, SIGMA)
    np.testing.assert_allclose(read(file, coverage=2.0).sigma_m, np.sqrt((SIGMA**2).mean(axis=1)) / 2, rtol=1e-5)


def test_the_uncertainty_of_a_position_is_shared_among_three_coordinates(tmp_path: Path) -> None:
    found = read(tmp_path / "u.csv", "name,x_mm,y_mm,z_mm,uncertainty_um\nA,1,2,3,30\nB,2,3,4,30\n")
    np.testing.assert_allclose(found.sigma_m, 30e-6 / np.sqrt(3))
    assert "1/√3" in found.notes[0]


def test_what_is_not_used_is_told(tmp_path: Path) -> None:
    found = read(polyworks(tmp_path / "p.txt", NAMES, POINTS))
    assert found.unused == ("Nominal X",)
    assert [(each.what, each.why) for each in found.left_out] == [
        ("Project: arm", "above the table"),
        ("End of report", "1 cells, where the table has 6"),
    ]


def test_points_that_were_not_measured_are_left_out_and_told(tmp_path: Path) -> None:
    found = read(tmp_path / "e.csv", "name,x_mm,y_mm,z_mm\nA,1,2,3\nB,,,\nC,4,5,6\nD,7,8,9\n")
    assert found.names == ("A", "C", "D")
    assert [each.line for each in found.left_out] == [3]


@pytest.mark.parametrize(
    ("text", "key", "unit"),
    [("X [mm]", "x", "mm"), ("x_m", "x", "m"), ("Meas. X (mm)", "meas x", "mm"), ("PointName", "point name", ""),
     ("J1 (°)", "j1", "deg"), ("u_x/µm", "u x", "um"), ("X, in", "x", "in"), ("m", "m", "")],
)  # fmt: skip
def test_headings_are_taken_apart(text: str, key: str, unit: str) -> None:
    assert (heading_of(text).key, heading_of(text).unit) == (key, unit)


def test_a_map_names_what_headings_do_not(tmp_path: Path) -> None:
    file, toml = tmp_path / "odd.csv", tmp_path / "map.toml"
    file.write_text("k;a;b;c;e;when\nP;1,5;2,5;3,5;0,02;05/06/2026 10:00:00\nQ;2;3;4;0,03;05/06/2026 10:01:00\n")
    toml.write_text('[points]\nname="k"\nx="2"\ny="b"\nz="c"\nunit="mm"\nsigma=["e"]\ntime="when"\ndates="mdy"\n')
    found = read_tracker_points(read_loose(file, 3), read_column_map(toml).points, None, 1.0)
    np.testing.assert_allclose(found.positions, 1e-3 * np.array([[1.5, 2.5, 3.5], [2, 3, 4]]))
    np.testing.assert_allclose(found.sigma_m, 1e-3 * np.array([0.02, 0.03]) / np.sqrt(3))
    assert np.diff(found.seconds) == [60.0]


ROW = "name,x_mm,y_mm,z_mm\n"
WRONG = {
    "empty": ("", "empty"),
    "no numbers": ("hello\nworld\n", "3 or more numbers"),
    "no unit": ("name,x,y,z\nA,1,2,3\nB,2,3,4\n", "--unit"),
    "units differ": ("name,x_mm,y_m,z_mm\nA,1,2,3\n", "different units"),
    "angles as coordinates": ("name,x [deg],y [deg],z [deg]\nA,1,2,3\n", "not lengths"),
    "no z": ("name,x_mm,y_mm,t\nA,1,2,3\nB,2,3,4\n", "no column is z"),
    "two of x": ("name,x_mm,x_mm,y_mm,z_mm\nA,1,2,3,4\n", "2 columns may be x"),
    "a coordinate is missing": (ROW + "A,1,2,3\nB,1,2,\nC,3,4,5\n", "left out"),
    "text for a number": (ROW + "A,1,2,3\nB,1,2,3x,\nC,1,2,3\n", "left out"),
    "all empty": ("name;x_mm;y_mm;z_mm;a;b;c\nA;;;;1;2;3\nB;;;;1;2;3\n", "every point is empty"),
    "too large": (ROW + "A,1e30,2,3\nB,1,2,3\n", "too large"),
    "two decimal marks": ("name;x_mm;y_mm;z_mm\nA;1,5;2;3\nB;1.5;2;3\n", "one decimal mark"),
    "columns of numbers": ("1.5 2.5 3.5 4.5\n2.5 3.5 4.5 5.5\n", "without a header"),
    "some uncertainties": ("name,x_mm,y_mm,z_mm,ux_mm\nA,1,2,3,0.1\n", "not all uncertainties of x, y and z"),
    "uncertainty of zero": ("name,x_mm,y_mm,z_mm,ux_mm,uy_mm,uz_mm\nA,1,2,3,0.1,0,0.1\n", "above zero"),
    "uncertainty as an angle": ("name,x_mm,y_mm,z_mm,ux (deg),uy,uz\nA,1,2,3,0.1,0.1,0.1\n", "not a unit of length"),
    "no such time": ("name,x_mm,y_mm,z_mm,time\nA,1,2,3,noon\nB,1,2,3,10:00:00\n", "is not a time"),
    "no such hour": ("name,x_mm,y_mm,z_mm,time\nA,1,2,3,25:00:00\n", "is not a time of day"),
    "day or month": ("name,x_mm,y_mm,z_mm,time\nA,1,2,3,05/06/2026 10:00:00\n", "order of day and month is ambiguous"),
    "no such day": ("name,x_mm,y_mm,z_mm,time\nA,1,2,3,31.02.2026 10:00:00\n", "is not a date"),
    "dates and none": ("name,x_mm,y_mm,z_mm,time\nA,1,2,3,10:00:00\nB,1,2,3,2026-05-01 10:00:00\n", "write all alike"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_be_understood_is_told_in_one_line(name: str, tmp_path: Path) -> None:
    text, told = WRONG[name]
    if told == "left out":
        assert any(each.line == 3 for each in read(tmp_path / "t.csv", text).left_out)
        return
    with pytest.raises(LabError) as error:
        read(tmp_path / "t.csv", text)
    assert told in str(error.value) and "\n" not in str(error.value)


def test_a_file_that_says_its_unit_is_believed(tmp_path: Path) -> None:
    with pytest.raises(LabError, match="leave out --unit m"):
        read(spatial_analyzer(tmp_path / "sa.txt", NAMES, POINTS), unit="m")


def test_a_binary_file_is_no_export(tmp_path: Path) -> None:
    (tmp_path / "b.xit64").write_bytes(bytes(range(256)) * 20)
    with pytest.raises(LabError, match="not a text file"):
        read(tmp_path / "b.xit64")


MAPS = {
    "unknown key": ('[points]\nlabel="a"\n', "'label' is no option"),
    "two sigmas": ('[points]\nsigma=["a","b"]\n', "points.sigma has 2"),
    "x alone": ('[points]\nx="a"\n', "all three or none"),
    "no such unit": ('[points]\nunit="ell"\n', "one of mm, m, in, um"),
    "joints as text": ('[joints]\njoints="a"\n', "a list"),
}


@pytest.mark.parametrize("name", MAPS)
def test_wrong_maps_are_told_in_one_line(name: str, tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(MAPS[name][0])
    with pytest.raises(LabError) as error:
        read_column_map(tmp_path / "map.toml")
    assert MAPS[name][1] in str(error.value) and "\n" not in str(error.value)
