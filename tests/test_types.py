"""What type checkers see of ``import lab``: every option of every call, and what is wrong with it."""

import subprocess
import sys
from pathlib import Path
from types import FunctionType

import pytest
from public_stub import STUB, stub_text

import lab

ROOT = Path(__file__).resolve().parents[1]

CALLS = """
from pathlib import Path

import numpy as np

import lab


class Volume(lab.Criterion):
    name = "volume"

    def score(self, information: np.ndarray) -> np.ndarray:
        return np.asarray(np.linalg.slogdet(information)[1])


robot = lab.load_robot("irb120")
arm: lab.Robot = lab.robot_from_dh([[0, 0.4, 0, 1.57]], unit="m", tool={"p1": [0, 0, 0.1]})
day: lab.MeasurementSession = lab.simulate(
    robot, poses=50, seed=7, effects=lab.Effects(gear_ppm=20.0), targets=("p1", "p2")
)
own: lab.Measurements = lab.measurements(np.zeros((9, 6)), [[0.0, 0.0, 0.0]] * 9, robot="irb120", unit="mm")
tracker: lab.Instrument = lab.instrument("leica-at960")
result: lab.CalibrationResult = lab.identify(
    day.measurements, "irb120", instrument=tracker, model="auto", prior="off", holdout=0.3, validate=day.validation
)
fitted: lab.Estimate = lab.fit(day.measurements, robot, model="compliance", noise_mm=0.01)
dof: list[int] = [each.dof for each in lab.fit([day.measurements, own])]
first: lab.Estimate = lab.fit(own, points=np.zeros((2, 9, 1, 3)))[0]
lab.identify(Path("day.csv"), validate="test.csv", gate_mm=0.1, require="good")
virtual: lab.CalibrationResult = lab.calibrate(
    "irb120", poses=30, effects=lab.Effects(ripple_mrad=0.1, payload_kg=(0.0, 3.0))
)
lab.design(robot, poses=20, criterion=Volume(), cell="cell.toml")
lab.check_plan("plan.csv", robot)
lab.import_measurements("tracker.txt", "irb120", joints="poses.csv")
targets: lab.CompensationResult = lab.compensate("targets.csv", result)
points: lab.PredictionResult = lab.predict([[0.0] * 6], result)
lab.verify("run", "new.csv")
lab.verify_touches("run", "daily.csv", since="2026-03-02")
lab.plan_touches("run", "daily.csv", 5)
lab.history(["first", "second"])
arms: lab.Result = lab.example("ur5", out="data")
load: lab.PayloadResult = lab.payload("load.csv", "tx40")
lab.dynamics("torques.csv", "tx40")
lab.study("grid.toml", workers=1)
about: lab.Inspection = lab.inspect("irb120")
lab.solve_kinematics("irb120")
lab.trajectory("points.csv")
estimate: lab.Estimate = lab.load_estimate("run")
lab.save_estimate(estimate, "folder")
lab.write_measurements("day.csv", lab.read_measurements("day.csv", robot))
frames: lab.WorldFrames = lab.world_frames(day)
text: str = result.summary()
run = lab.load_run("run")
arm = lab.load_robot(run)
certificate: lab.Result = lab.certify("run", tolerance_mm=0.5)
next_one: lab.Result = lab.next_pose("plan", day.measurements, accuracy_mm=0.02)
printed: lab.Result = lab.reproduce("thesis")
reached: lab.Result = lab.workspace(["irb120", "tx40"], orientations=30)
turned: lab.Result = lab.convert_rotation(angles=(30.0, 90.0, 10.0), order="zyx")
followed: lab.Result = lab.history("runs", kept=["base"])
one: np.ndarray = robot.points([0.0] * 6)
many: np.ndarray = estimate.parameter_jacobian(np.zeros((9, 6)))
left = estimate.residuals(np.zeros((9, 6)), np.zeros((9, 3)))
slopes: np.ndarray = left.jacobian
rank: int = robot.identifiability(targets=["p1"]).rank
indices: dict[str, float] = robot.criteria(np.zeros((9, 6)), scaling="whitened", sigma_m=1e-5)
spread: np.ndarray = estimate.predicted_covariance([0.0] * 6)

lab.calibrate("irb120", instrumnt="x")  # wrong
lab.simulate("irb120", poses="50")  # wrong
lab.simulate("irb120", 50)  # wrong
lab.simulate("irb120", gear_ppm=20.0)  # wrong
lab.simulate("irb120", effects=lab.Effects(gear_ppm="20"))  # wrong
lab.simulate("irb120", model="auto")  # wrong
lab.identify(3)  # wrong
lab.fit("day.csv")  # wrong
lab.fit(own).verdict  # wrong
lab.identify("day.csv", prior="maybe")  # wrong
lab.identify("day.csv", gate_mm="0.1")  # wrong
lab.design("irb120", criterion=abs)  # wrong
lab.measurements([[0.0] * 6], [[0.0] * 3])  # wrong
lab.robot_from_dh([[0.0] * 4], convention="denavit")  # wrong
lab.history("first", "second")  # wrong
lab.check_plan("plan.csv", robot)
lab.import_measurements("tracker.txt")  # wrong
lab.identfy("day.csv")  # wrong
robot.nam  # wrong
robot.criteria(np.zeros((9, 6)), scaling="mm")  # wrong
robot.planned_covariance(np.zeros((9, 6)), np.zeros(6))  # wrong
estimate.points(None)  # wrong
words: list[str] = result.summary()  # wrong
"""


@pytest.mark.thorough
def test_the_stub_holds_every_call_with_its_options() -> None:
    assert STUB.read_text(encoding="utf-8") == stub_text(), "run scripts/maintenance/public_stub.py"


@pytest.mark.thorough
def test_right_calls_pass_and_wrong_ones_are_rejected(tmp_path: Path) -> None:
    file = tmp_path / "calls.py"
    file.write_text(CALLS)
    command = [
        sys.executable,
        "-m",
        "mypy",
        "--strict",
        "--no-error-summary",
        "--config-file=pyproject.toml",
        str(file),
    ]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    found = {
        int(line.split(":")[1])
        for line in done.stdout.splitlines()
        if line.startswith(str(file)) and ": error:" in line
    }
    wrong = {i for i, line in enumerate(CALLS.splitlines(), 1) if line.endswith("# wrong")}
    assert found == wrong and len(wrong) >= 10, done.stdout + done.stderr


def test_every_public_call_is_among_those_that_are_checked() -> None:
    calls = {name for name in lab.__all__ if isinstance(getattr(lab, name), FunctionType)}
    assert {name for name in calls if f"lab.{name}(" not in CALLS} == set()
