"""The serial number of an arm: kept in its runs, inherited by what is built on them, and never mixed with another."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.campaigns import own_copy, run_of
from helpers.drawing import nothing_drawn

import lab
from lab.cli.main import main
from lab.core.errors import LabError
from lab.formats.measurement_csv import write_measurements
from lab.library.calibration_result import CalibrationResult

DETAILS = '[robot]\nserial_number = "{}"\n'


def named(result: CalibrationResult, serial: str | None, date: str | None = None) -> CalibrationResult:
    return replace(result, options=replace(result.options, serial=serial, date=date, no_recording=True))


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory, seven: CalibrationResult) -> Path:
    """The run of an arm, one of the same arm without a name, and new measurements."""
    folder = tmp_path_factory.mktemp("arms")
    with nothing_drawn():
        for name, serial, date in (("a17", "A-17", "2026-01-10"), ("a18", "A-18", "2026-02-10")):
            named(seven, serial, date).save(folder / name)
    own_copy(run_of(seed=7), folder / "old")
    new = replace(seven.measurements, points=seven.measurements.points + 1e-9)[:10]
    write_measurements(folder / "new.csv", new, seven.robot.chain.prismatic)
    return folder


def result_of(folder: Path) -> dict:
    return json.loads((folder / "result.json").read_text())


@pytest.mark.thorough
def test_whatever_is_built_on_a_run_has_its_arm(place: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(place)
    assert result_of(place / "a17")["serial"] == "A-17" and result_of(place / "old")["serial"] is None
    commands = ("verify a17 new.csv", "compensate new.csv --run a17 --no-check", "certify a17")
    for command in commands:
        out = tmp_path / command.split()[0]
        assert main([*command.split(), "--out", str(out)]) in (0, 1), command
        assert result_of(out)["serial"] == "A-17", command
    assert main(["verify", "old", "new.csv", "--json"]) == 0
    assert '"serial": null' in capsys.readouterr().out


@pytest.mark.parametrize("command", ["verify a17 new.csv --serial A-18", "history a17 a18", "certify a17 --details d"])
def test_runs_of_two_arms_are_refused_in_one_line(place: Path, command: str, monkeypatch, capsys) -> None:
    monkeypatch.chdir(place)
    (place / "d").write_text(DETAILS.format("A-18"))
    assert main(command.split()) == 2
    told = capsys.readouterr().err.strip()
    assert "A-17" in told and "A-18" in told and "names the arm" in told and "\n" not in told


def test_the_same_arm_and_an_unnamed_one_go_together(place: Path) -> None:
    assert lab.verify(place / "a17", place / "new.csv", serial="A-17").serial == "A-17"
    assert lab.verify(place / "old", place / "new.csv", serial="A-18").serial == "A-18"
    with pytest.raises(LabError, match="has the parameters of"):  # and not: of another arm
        lab.history([place / "a17", place / "old"])


def test_details_without_a_serial_number_get_that_of_the_run(place: Path, tmp_path: Path) -> None:
    from lab.formats.certificate_toml import read_certificate_details

    (tmp_path / "d.toml").write_text('[robot]\nmodel = "IRB 120"\n')
    details = read_certificate_details(tmp_path / "d.toml")
    assert "robot.serial_number" in details.missing
    own = details.of_arm("A-17", "d.toml", "run")
    assert own.robot.serial_number == "A-17" and "robot.serial_number" not in own.missing
    assert own.robot.model == "IRB 120" and details.of_arm(None, "d.toml", "run") == details
    (tmp_path / "d.toml").write_text(DETAILS.format("A-18"))
    with pytest.raises(LabError, match=r"serial_number of \[robot\]: .*A-18.*A-17"):
        read_certificate_details(tmp_path / "d.toml").of_arm("A-17", "d.toml", "run")


@pytest.mark.parametrize("serial", ["", " A", "a\nb", "x" * 201])
def test_a_serial_number_is_one_line(serial: str) -> None:
    with pytest.raises(LabError, match="--serial"):
        lab.calibrate(serial=serial)


@pytest.mark.parametrize(
    ("verdict", "code", "required"), [("good", 0, 0), ("doubtful", 0, 3), ("not judged", 0, 3), ("bad", 1, 1)]
)
def test_exit_codes_of_verdicts(seven: CalibrationResult, verdict: str, code: int, required: int) -> None:
    word = replace(seven.verdict, word=verdict)
    judged = replace(seven, state=replace(seven.state, verdict=word))
    asked = replace(judged, options=replace(seven.options, require="good"))
    assert (judged.exit_code, asked.exit_code) == (code, required)


@pytest.mark.parametrize(("verdict", "shift", "required"), [("good", 0, 0), ("doubtful", 0, 3), ("doubtful", 2e-4, 1)])
def test_a_verification_of_a_doubtful_run_is_not_good(
    seven: CalibrationResult, verdict: str, shift: float, required: int
) -> None:
    run = replace(seven, state=replace(seven.state, verdict=replace(seven.verdict, word=verdict)))
    points = seven.measurements.points + np.array([shift + 1e-9, 0, 0])
    new = replace(seven.measurements, points=points)[:8]
    found = lab.verify(run, new)
    assert found.exit_code == (1 if shift else 0) and found.verdict == ("bad" if shift else verdict)
    assert lab.verify(run, new, require="good").exit_code == required


@pytest.mark.parametrize(("verdict", "required"), [("good", 0), ("doubtful", 3)])
def test_compensation_for_a_doubtful_run_is_not_good(
    seven: CalibrationResult, tmp_path: Path, verdict: str, required: int
) -> None:
    run = replace(seven, state=replace(seven.state, verdict=replace(seven.verdict, word=verdict)))
    x, y, z = 1e3 * seven.measurements.points[0, 0]
    (tmp_path / "targets.csv").write_text(f"p1_x_mm,p1_y_mm,p1_z_mm\n{x},{y},{z}\n")
    codes = [
        lab.compensate(tmp_path / "targets.csv", run=run, no_check=True, require=require).exit_code
        for require in (None, "good")
    ]
    assert codes == [0, required]


@pytest.mark.thorough
def test_payload_and_dynamics_keep_the_arm(place: Path) -> None:
    named = (lab.payload(robot="tx40", simulate=True, serial="A-17"), lab.dynamics(robot="scara", serial="A-17"))
    assert all(found.to_dict()["serial"] == "A-17" for found in named)
    assert lab.dynamics(robot="scara").to_dict()["serial"] is None
    with pytest.raises(LabError, match=r"--serial: .*A-18.*A-17"):
        lab.payload(place / "new.csv", run=place / "a17", serial="A-18")
