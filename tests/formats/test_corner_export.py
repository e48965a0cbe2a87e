"""Corners in pictures from a program's table: places, pictures, and tables that hold something else."""

from pathlib import Path

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.formats.corner_export import CornerRows, holds_corners, read_corners
from lab.formats.loose_table import PointColumns, read_loose
from lab.formats.tracker_export import TrackerPoints

TABLE = """time,camera,board,corner,u_px,v_px
12.5,wrist,table,0,100.25,200.5
12.5,wrist,table,1,150.0,201.0
12.5,wall,table,1,400.0,300.0
14.0,wrist,table,7,90.0,80.0
"""

RECOGNIZED = PointColumns()


def read(folder: Path, text: str, columns: PointColumns = RECOGNIZED) -> tuple[TrackerPoints, CornerRows]:
    (file := folder / "corners.csv").write_text(text)
    table = read_loose(file, 3)
    assert holds_corners(table, columns)
    return read_corners(table, columns)


def test_pictures_are_those_of_one_camera_at_one_time(tmp_path: Path) -> None:
    pictures, corners = read(tmp_path, TABLE)
    assert corners.picture.tolist() == [0, 0, 1, 2] and corners.texts["corner"] == ("0", "1", "1", "7")
    np.testing.assert_array_equal(corners.places[0], [100.25, 200.5])
    np.testing.assert_array_equal(pictures.seconds, [12.5, 12.5, 14.0])
    assert pictures.lines == (2, 4, 5) and pictures.clock == "seconds" and pictures.unused == ()


def test_a_map_names_columns(tmp_path: Path) -> None:
    columns = PointColumns(time="when", u="col", v="row", corner="tag")
    text = TABLE.replace("time,", "when,").replace("corner,u_px,v_px", "tag,col,row")
    np.testing.assert_array_equal(read(tmp_path, text, columns)[1].places, read(tmp_path, TABLE)[1].places)


def test_points_of_a_tracker_are_no_corners(tmp_path: Path) -> None:
    (file := tmp_path / "points.csv").write_text("name,x_mm,y_mm,z_mm,u\nA,1,2,3,0.1\nB,2,3,4,0.1\n")
    assert not holds_corners(read_loose(file, 3), PointColumns())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("corner,", "spot,", "no column is corner .*--columns"),
        ("v_px", "w", "no column is v .*--columns"),
        ("time,", "frame,", "no column is the picture's time .*--columns"),
        ("u_px,v_px", "u_mm,v_mm", "column u_mm: its unit is mm; export corners in pixels"),
        ("200.5", "", "line 2, column v_px: '' is not a number"),
    ],
)
def test_wrong_columns_are_refused_in_one_line(old: str, new: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(LabError, match=message) as refused:
        read(tmp_path, TABLE.replace(old, new))
    assert "\n" not in str(refused.value)


def test_normalized_coordinates_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LabError, match="normalized coordinates; export pixels"):
        read(tmp_path, "time,corner,u,v\n1.0,0,0.1,0.2\n2.0,0,0.3,-0.2\n")
