"""Files of loaded and unloaded runs: nothing is lost, units come from names, and what is wrong is told in one line."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.robots import TX40, VERSATRAN

from lab.core import se3
from lab.core.errors import LabError
from lab.extensions.dynamics.load_files import (
    Mounting,
    PayloadSamples,
    read_loads,
    read_mounting,
    write_loads,
    write_mounting,
)

NAMES, SLIDES = TX40.joint_names, TX40.prismatic
LIMITS = np.deg2rad([-180.0, -125, -138, -270, -120, -270]), np.deg2rad([180, 125, 138, 270, 133.5, 270])
ROWS = 24


def random_records(seed: int, slides: tuple[bool, ...], moving: bool, torques: bool, wrench: bool) -> PayloadSamples:
    rng = np.random.default_rng(seed)
    joints = np.where(slides, 0.5, 1.0) * rng.uniform(-1, 1, (ROWS, len(slides)))
    loaded = np.arange(ROWS) < ROWS // 2
    time_s = np.tile(np.arange(ROWS // 2) / 300.0, 2) if moving else None
    size = 10.0 ** rng.integers(-12, 3, (ROWS, 6))
    return PayloadSamples(
        time_s,
        joints,
        rng.normal(size=(ROWS, len(slides))) if torques else None,
        size * rng.normal(size=(ROWS, 6)) if wrench else None,
        loaded,
    )


@pytest.mark.parametrize("slides", [SLIDES, VERSATRAN.prismatic])
@pytest.mark.parametrize(
    ("moving", "torques", "wrench"), [(True, True, True), (False, True, False), (True, False, True)]
)
def test_what_is_written_reads_back_to_the_bit(slides, moving: bool, torques: bool, wrench: bool, tmp_path) -> None:
    records = random_records(1, slides, moving, torques, wrench)
    write_loads(tmp_path / "a.csv", records, NAMES, slides)
    back = read_loads(tmp_path / "a.csv", NAMES, slides)
    for name in ("time_s", "joints", "torques", "wrench", "loaded"):
        ours, theirs = getattr(back, name), getattr(records, name)
        assert (ours is None) == (theirs is None)
        if ours is not None:
            np.testing.assert_array_equal(ours, theirs)
    assert back.lines == tuple(range(2, ROWS + 2)) and not back.warnings
    assert back.step_s == (pytest.approx(1 / 300, rel=1e-12) if moving else None)
    unloaded = back.run(loaded=False)
    assert len(unloaded) == ROWS // 2 and unloaded.lines[0] == ROWS // 2 + 2 and not unloaded.loaded.any()


def good_file(path: Path, moving: bool = True) -> list[list[str]]:
    """A file that reads, as its cells."""
    write_loads(path, random_records(2, SLIDES, moving, True, True), NAMES, SLIDES)
    return [line.split(",") for line in path.read_text().splitlines()]


def put(path: Path, cells: list[list[str]]) -> Path:
    path.write_text("".join(",".join(row) + "\n" for row in cells))
    return path


def without(cells: list[list[str]], *columns: str) -> list[list[str]]:
    kept = [i for i, name in enumerate(cells[0]) if name not in columns]
    return [[row[i] for i in kept] for row in cells]


def test_units_and_names_of_columns(tmp_path) -> None:
    cells = good_file(tmp_path / "a.csv")
    radians = read_loads(tmp_path / "a.csv", NAMES, SLIDES)
    cells[0][1] = "elbow_deg"
    for row in cells[1:]:
        row[1] = "90.0"
    cells[0].append("note")
    for row in cells[1:]:
        row.append("x")
    read = read_loads(put(tmp_path / "b.csv", cells), ("elbow", *NAMES[1:]), SLIDES, LIMITS)
    np.testing.assert_array_equal(read.joints[:, 0], np.full(ROWS, np.deg2rad(90.0)))
    np.testing.assert_array_equal(read.joints[:, 1:], radians.joints[:, 1:])
    assert read.warnings == (f"{tmp_path / 'b.csv'}: columns note have no meaning here and are passed over",)


def test_a_slide_has_forces_and_lengths(tmp_path) -> None:
    cells = [["q1_mm", "f1_n", "run"], ["120.1", "3", "loaded"], ["1.5", "4", "loaded"], ["2", "5", "loaded"]]
    read = read_loads(put(tmp_path / "a.csv", cells), ("q1",), (True,), (np.zeros(1), np.ones(1)))
    np.testing.assert_array_equal(read.joints[:, 0], [0.1201, 0.0015, 0.002])
    assert read.torques is not None and read.torques[0, 0] == 3
    cells[0][0] = "q1_m"
    with pytest.raises(LabError, match=r"line 2, column q1_m: 120.1 m is beyond .* 0 to 1, probably millim"):
        read_loads(put(tmp_path / "a.csv", cells), ("q1",), (True,), (np.zeros(1), np.ones(1)))
    cells[0][1] = "tau1_nm"
    with pytest.raises(LabError, match=r"column tau1_nm: unknown unit or axis; loads .* f1_n"):
        read_loads(put(tmp_path / "a.csv", cells), ("q1",), (True,))


def set_cell(row: int, column: str, text: str):
    def change(cells: list[list[str]]) -> list[list[str]]:
        cells[row - 1][cells[0].index(column)] = text  # row as an editor counts it
        return cells

    return change


def renamed(column: str, name: str):
    return lambda cells: [[name if cell == column else cell for cell in cells[0]], *cells[1:]]


TORQUES = tuple(f"tau{i}_nm" for i in range(1, 7))
WRENCH = ("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")
WRONG = {
    "uneven": (set_cell(9, "time_s", "0.0234"), r"line 9, column time_s: a step of 0.0034 s where .* 0.00333333 s"),
    "gap": (lambda cells: cells[:5] + cells[6:], r"line 6, column time_s: a step of 0.0066666\d* s"),
    "still": (set_cell(4, "time_s", "0"), r"line 4, column time_s: a step of"),
    "backward": (lambda cells: [cells[0], *reversed(cells[1:])], r"line 15, column time_s: the time does not rise"),
    "degrees": (
        set_cell(7, "q2_rad", "90.5"),
        r"line 7, column q2_rad: 90.5 rad is beyond .* degrees; rename .* q2_deg",
    ),
    "limit": (set_cell(7, "q2_rad", "2.4"), r"line 7, column q2_rad: 2.4 rad is beyond its limits of -2.182 to 2.182"),
    "unit": (renamed("tau3_nm", "tau3_ncm"), r"tau3_nm is missing beside tau1_nm"),
    "units": (lambda cells: renamed("tau1_nm", "tau1")(without(cells, *TORQUES[1:])), r"column tau1: unknown unit"),
    "axis": (
        lambda cells: renamed("fx_n", "fx_kn")(without(cells, *WRENCH[1:])),
        r"column fx_kn: unknown unit or axis",
    ),
    "six": (lambda cells: without(cells, "mz_nm"), r"mz_nm is missing beside fx_n; give the columns of all six"),
    "time": (renamed("time_s", "time_ms"), r"column time_ms: unknown unit; give the time as time_s"),
    "joint": (renamed("q4_rad", "q4_turns"), r"column q4_turns: unknown unit"),
    "seventh": (renamed("q4_rad", "q7_rad"), r"joint q4 is missing"),
    "run": (set_cell(3, "run", "full"), r"line 3, column run: 'full' is unknown; write loaded or unloaded"),
    "no run": (lambda cells: without(cells, "run"), r"no column run; state in each row"),
    "nothing": (lambda cells: without(cells, *TORQUES, *WRENCH), r"no torques and no wrench; give tau1_nm"),
    "nan": (set_cell(3, "tau2_nm", "NaN"), r"line 3, column tau2_nm: 'NaN' is not a finite number; give a number"),
    "empty": (set_cell(5, "fx_n", ""), r"line 5, column fx_n: the cell is empty; give a number"),
    "word": (set_cell(5, "fx_n", "1_0"), r"line 5, column fx_n: '1_0' is not a number"),
    "dashes": (set_cell(5, "fx_n", "1-e"), r"line 5, column fx_n: '1-e' is not a number"),
    "huge": (set_cell(5, "fx_n", "1e200"), r"line 5, column fx_n: '1e200' is too large"),
    "few": (lambda cells: cells[:8] + cells[-12:], r"7 rows with run = loaded; give at least 10 samples of a motion"),
    "few others": (lambda cells: cells[:-9], r"3 rows with run = unloaded; give at least 10 samples of a motion"),
    "one pose": (lambda cells: without(cells, "time_s")[:2], r"1 rows with run = loaded; give at least 2 static poses"),
    "two poses": (
        lambda cells: without(cells, "time_s", *TORQUES)[:3],
        r"2 rows with run = loaded; give at least 3 static poses",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_told_with_its_place(name: str, tmp_path) -> None:
    change, said = WRONG[name]
    path = put(tmp_path / "a.csv", change(good_file(tmp_path / "a.csv")))
    with pytest.raises(LabError, match=said) as told:
        read_loads(path, NAMES, SLIDES, LIMITS)
    assert str(told.value).startswith(str(path)) and "\n" not in str(told.value)


def test_steps_may_differ_by_what_clocks_do(tmp_path) -> None:
    cells = set_cell(9, "time_s", repr(7 / 300 * (1 + 1e-3)))(good_file(tmp_path / "a.csv"))
    read_loads(put(tmp_path / "a.csv", cells), NAMES, SLIDES)


def test_a_run_has_its_rows_and_its_step() -> None:
    loaded = np.array([True, True, True, False, False])
    times = np.array([0.0, 0.1, 0.2, 5.0, 5.5])
    samples = PayloadSamples(times, np.arange(10.0).reshape(5, 2), np.ones((5, 2)), None, loaded, (2, 3, 4, 5, 6))
    assert samples.step_s == pytest.approx(0.1) and samples.run(False).step_s == pytest.approx(0.5)
    assert samples.run(True).lines == (2, 3, 4) and len(samples.run(False)) == 2


def test_a_row_at_rest_that_is_a_copy_counts_once() -> None:
    rng = np.random.default_rng(0)
    joints, wrench, loaded = rng.normal(size=(4, 2)), rng.normal(size=(4, 6)), np.array([True, False, True, False])
    plain = PayloadSamples(None, joints, None, wrench, loaded, lines=(2, 3, 4, 5))
    rows = np.array([0, 1, 2, 3, 1, 2])
    again = replace(plain.take(rows), lines=(2, 3, 4, 5, 6, 7)).without_copies("runs.csv")
    assert plain.without_copies("runs.csv") is plain and again.lines == plain.lines
    np.testing.assert_array_equal(again.joints, joints)
    assert again.warnings == (
        "runs.csv: 2 rows are copies of an earlier one to the last digit (the first: line 6, of line 3), which "
        "measurements never are: left out",
    )
    other = replace(plain.take(rows), loaded=np.array([True, False, True, False, True, True]))
    assert len(other.without_copies("a")) == 5  # the same numbers, once with a load and once without
    moving = replace(plain, time_s=np.arange(4.0)).take(rows)
    assert moving.without_copies("a") is moving


# The mounting


def test_gravity_of_a_tilted_base() -> None:
    np.testing.assert_array_equal(Mounting.tilted(np.zeros(2)).gravity, [0, 0, -9.81])
    about_x = Mounting.tilted(np.array([0.1, 0.0]), 9.8).gravity
    np.testing.assert_allclose(about_x, 9.8 * np.array([0, -np.sin(0.1), -np.cos(0.1)]), atol=1e-15)
    about_y = Mounting.tilted(np.array([0.0, 0.1])).gravity
    np.testing.assert_allclose(about_y, 9.81 * np.array([np.sin(0.1), 0, -np.cos(0.1)]), atol=1e-15)
    ceiling = Mounting.tilted(np.array([np.pi, 0.0]))
    np.testing.assert_allclose(ceiling.gravity, [0, 0, 9.81], atol=1e-14)
    np.testing.assert_allclose(np.abs(ceiling.tilt_rad), [np.pi, 0.0], atol=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_a_mounting_reads_back(seed: int, tmp_path) -> None:
    rng = np.random.default_rng(seed)
    tilt, turn = rng.uniform(-2, 2, 2), rng.uniform(-1.5, 1.5, 3)
    mounting = Mounting.tilted(tilt, rng.uniform(9, 10.5), -1.0, turn)
    np.testing.assert_allclose(mounting.tilt_rad, tilt, atol=1e-14)
    write_mounting(tmp_path / "s.toml", mounting)
    back = read_mounting(tmp_path / "s.toml")
    np.testing.assert_allclose(back.gravity, mounting.gravity, atol=1e-14)
    np.testing.assert_allclose(back.rotation, se3.exp(turn), atol=1e-15)
    assert back.sign == -1


def test_what_a_mounting_need_not_say(tmp_path) -> None:
    path = tmp_path / "s.toml"
    path.write_text("[sensor]\nsign = 1\n")
    mounting = read_mounting(path)
    np.testing.assert_array_equal(mounting.gravity, [0, 0, -9.81])
    np.testing.assert_array_equal(mounting.rotation, np.eye(3))
    path.write_text("[base]\ntilt_x_deg = 1\n")
    assert read_mounting(path, sensor=False).gravity[1] < -0.17  # torques alone need no sign


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[base]\ntilt_x_deg = 1\n", r"\[sensor\] sign is missing; write 1 if .* -1 for the opposite"),
        ("[sensor]\nsign = 0\n", r"the sensor's sign is 0; give 1 or -1"),
        ("[sensor]\nsign = '+'\n", r"'\+' is not a value of option 'sensor.sign'; give a number"),
        ("[sensor]\nsign = 1\n[base]\ngravity_m_per_s2 = 9810\n", r"gravity is 9810 m/s\^2; give 9 to 10.5"),
        (
            "[sensor]\nsign = 1\n[base]\ngravity_m_per_s2 = -9.81\n",
            r"gravity is -9.81 m/s\^2; give its size, 9 to 10.5",
        ),
        ("[sensor]\nsign = 1\n[base]\ntilt_x_deg = nan\n", r"\[base\] nan is no finite number"),
        ("[sensor]\nsign = 1\n[base]\ntilt_x_rad = 1\n", r"base: 'tilt_x_rad' is no option; there are tilt_x_deg"),
        (
            "[sensor]\nsign = 1\nrotation_vector_deg = [1, 2]\n",
            r"rotation_vector_deg is \[1.0, 2.0\]; give three",
        ),
        ("sign = 1\n", r"'sign' is no option; there are base, sensor"),
        ("[sensor\n", r"not a TOML file"),
    ],
)
def test_a_mounting_that_cannot_be_used(text: str, said: str, tmp_path) -> None:
    path = tmp_path / "s.toml"
    path.write_text(text)
    with pytest.raises(LabError, match=said) as told:
        read_mounting(path)
    assert str(told.value).startswith(str(path)) and "\n" not in str(told.value)


def test_a_sign_and_a_mounting_that_are_none() -> None:
    down = np.array([0.0, 0.0, -9.81])
    with pytest.raises(LabError, match="sign"):
        Mounting(down, 2.0)
    with pytest.raises(LabError, match="no rotation"):
        Mounting(down, 1.0, np.diag([1.0, 1.0, -1.0]))
