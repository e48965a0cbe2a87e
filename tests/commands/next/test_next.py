"""``lab next``: a session that is planned while it is measured, in memory and by a file that grows."""

import json
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from helpers.bad_input import run as run_line
from helpers.campaigns import run_of
from helpers.campaigns import session as simulated
from helpers.robots import ROOT

import lab
from lab.cli.main import main
from lab.core.measurements import measured
from lab.formats.measurement_csv import write_measurements
from lab.library.pose_planner import PosePlanner
from lab.library.run_folder import check_edits
from lab.pose_selection.criteria import is_singular
from lab.pose_selection.exchange import information
from lab.pose_selection.predicted_accuracy import predict

HALF_WIDTH_M = 8e-6  # of uniform-8um


@pytest.fixture(scope="module")
def planner() -> PosePlanner:
    return PosePlanner("scara", accuracy_mm=0.01, candidates=300)


@cache
def session(planner: PosePlanner, noise_times: float, most: int = 200):
    """Measure a virtual arm as proposed, until the accuracy is reached; measurements, proposals and the true robot."""
    rng = np.random.default_rng(4)
    real = simulated("scara", poses=1, seed=9).true_robot
    joints, points, proposals = [], [], []
    while True:
        names, targets = planner.problem.robot.chain.joint_names, planner.options.targets
        data = measured(names, np.reshape(joints, (-1, len(names))), targets, np.reshape(points, (-1, 1, 3)))
        proposals.append(planner.propose(data))
        if proposals[-1].joints is None or len(joints) == most:
            return data, proposals, real
        joints.append(proposals[-1].joints)
        noise = noise_times * rng.uniform(-HALF_WIDTH_M, HALF_WIDTH_M, (1, 3))
        points.append(real.points(joints[-1][None], targets)[0] + noise)


@pytest.mark.thorough
def test_proposed_poses_reach_the_accuracy(planner: PosePlanner) -> None:
    data, proposals, real = session(planner, 1.0)
    last, chain = proposals[-1], planner.problem.robot.chain
    assert last.reached and last.measured == len(data) and last.accuracy_m <= 1e-5 and not last.noise.larger
    found = lab.identify(data, robot="scara", instrument="uniform-8um", gate_mm=0.02)
    assert found.to_dict()["verdict"] == "good"
    fresh = chain.random_joints(500, np.random.default_rng(1))
    errors = found.robot.arm(("p1",)).points(fresh, found.identification.values) - real.points(fresh, ("p1",))
    assert np.quantile(np.linalg.norm(errors, axis=2), 0.95) <= 1e-5
    for before, proposal in zip([planner.problem.access.hubs[0], *data.joints], proposals[:-1], strict=False):
        np.testing.assert_array_equal(proposal.waypoints[[0, -1]], [before, proposal.joints])
        free = planner.problem.access.free
        assert all(free(a, b) for a, b in zip(proposal.waypoints, proposal.waypoints[1:], strict=False))
    known = [each for each in proposals if each.accuracy_m is not None]
    assert len(known) > 3 and all(each.next_m < each.accuracy_m for each in known[:-1])
    left = [each.remaining + each.measured for each in proposals[2:]]
    assert max(left) <= 1.5 * len(data) and min(left) >= 0.6 * len(data)


def test_fewer_poses_than_by_chance(planner: PosePlanner) -> None:
    data, _, _ = session(planner, 1.0)
    order = np.random.default_rng(2).permutation(len(planner.problem.inputs))[: len(data)]
    chosen, by_chance = (information(planner.problem.whitened(q)) for q in (data.joints, planner.problem.inputs[order]))
    radius = predict(chosen, planner.problem.test, np.random.default_rng(0)).coverage_radius
    assert is_singular(by_chance) or (
        predict(by_chance, planner.problem.test, np.random.default_rng(0)).coverage_radius > 1.15 * radius
    )


@pytest.mark.thorough
def test_larger_noise_is_found_and_takes_more_poses(planner: PosePlanner) -> None:
    usual, _, _ = session(planner, 1.0)
    noisy, proposals, _ = session(planner, 3.0, most=2 * len(usual))
    assert len(noisy) == 2 * len(usual)  # the stated noise would have ended it long ago
    assert proposals[-1].noise.larger and proposals[-1].noise.factor > 3.0


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("next") / "plan"
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder.parent)
        line = "design --robot scara --candidates 200 --starts 1 --accuracy-mm 0.01 --no-recording --out plan"
        assert run_line(line) == 0
    return folder


@pytest.mark.thorough
def test_a_call_by_a_run_and_by_its_options(plan: Path, tmp_path: Path) -> None:
    first = lab.next_pose(plan, candidates=200)
    assert first.joints is not None and first.proposal.accuracy_m is None
    data = simulated("scara", poses=20, seed=3).measurements
    write_measurements(tmp_path / "rows.csv", data, (False, False, True, False))
    in_memory = lab.next_pose(plan, data, candidates=200)
    by_file = lab.next_pose(plan, tmp_path / "rows.csv", candidates=200)
    np.testing.assert_array_equal(in_memory.joints, by_file.joints)
    assert in_memory.to_dict()["wanted_mm"] == 0.01
    folder = by_file.save(tmp_path / "run")
    rows = (folder / "next.csv").read_text().splitlines()
    assert len(rows) == len(by_file.proposal.waypoints) and rows[-1].startswith("measure,")
    assert not check_edits(folder, (), accept=False)


def test_further_poses_after_an_identification() -> None:
    run = run_of("scara", poses=20, seed=3)
    found = lab.next_pose(run, accuracy_mm=0.002, candidates=200)
    assert found.proposal.measured == 20 and not found.proposal.reached


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("next plan --follow", "--follow: give the measurement file that grows"),
        ("next plan other.csv", "has the targets p2, but the plan is for p1"),
        ("next plan none.csv", "none.csv: cannot be read"),
        ("next nothing", "nothing"),
        ("next plan --patience-s 0 --follow other.csv", "--patience-s is 0; give 0.1 to 86,400 s"),
        ("next loaded", "is a plan for model compliance; lab next is for geometry alone"),
        ("next predicted", "is a run of lab inspect; give the folder of a run of lab design"),
    ],
)
def test_bad_input_is_one_line(
    line: str, words: str, plan: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(plan.parent)
    if not Path("other.csv").exists():
        data = lab.simulate("scara", poses=5, seed=3, targets=("p2",)).measurements
        write_measurements(Path("other.csv"), data, (False, False, True, False))
        assert main(["inspect", "scara", "--out", "predicted"]) == 0
        Path("loaded").mkdir()
        config = json.loads(Path("plan/config.json").read_text())
        config["options"]["model"] = "compliance"
        Path("loaded/config.json").write_text(json.dumps(config))
        capsys.readouterr()
    assert main([*line.split(), "--out", "never"]) == 2
    printed = capsys.readouterr()
    assert words in printed.err and printed.err.count("\n") == 1 and not Path("never").exists()


@pytest.mark.thorough
def test_a_growing_file_is_followed(plan: Path, tmp_path: Path) -> None:
    """A person reads the line, moves the arm there, and adds a row: here a program does."""
    real, rng = simulated("scara", poses=1, seed=9).true_robot, np.random.default_rng(4)
    chain, file = real.robot.chain, tmp_path / "rows.csv"
    columns = [
        f"{name}_{'mm' if slides else 'deg'}" for name, slides in zip(chain.joint_names, chain.prismatic, strict=True)
    ]
    file.write_text(",".join(["id", *columns, "p1_x_mm", "p1_y_mm", "p1_z_mm"]) + "\n")
    command = [sys.executable, "-m", "lab", "next", str(plan), str(file), "--follow", "--candidates", "200", "--json"]
    command += ["--out", str(tmp_path / "run"), "--patience-s", "60"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT) as process:
        count = 0
        for line in process.stderr:
            if (found := re.search(r"next: (.*?)(;|$)", line)) is None:
                break
            shown = np.array([float(part.split()[-1].replace("−", "-")) for part in found[1].strip().split(", ")])
            joints = shown * np.where(chain.prismatic, 1e-3, np.pi / 180)
            point = real.points(joints[None], ("p1",))[0, 0] + rng.uniform(-HALF_WIDTH_M, HALF_WIDTH_M, 3)
            count += 1
            with file.open("a") as rows:
                rows.write(",".join(map(repr, [count, *shown.tolist(), *(1e3 * point).tolist()])) + "\n")
        printed = json.loads(process.stdout.read())
    assert process.returncode == 0 and printed["reached"] and printed["measured"] == count
    assert len(printed["proposals"]) == count + 1 and printed["accuracy_mm"] <= 0.01
    assert (tmp_path / "run" / "recording.rrd").stat().st_size > 10_000


def test_where_no_way_leads_on_it_begins_at_home(planner: PosePlanner, monkeypatch: pytest.MonkeyPatch) -> None:
    """An arm that the nominal model has in a collision: its way home is the user's, and the rest is free."""
    home, free = planner.problem.access.hubs[0], planner.problem.access.free
    stuck = planner.problem.candidates.joints[7]
    reached = planner._nearest_from
    monkeypatch.setattr(
        planner, "_nearest_from", lambda total, start: None if start is stuck else reached(total, start)
    )
    proposal = planner.propose(at=stuck)
    assert proposal.from_home and proposal.joints is not None
    np.testing.assert_array_equal(proposal.waypoints[:2], [stuck, home])
    assert all(free(a, b) for a, b in zip(proposal.waypoints[1:], proposal.waypoints[2:], strict=False))
    assert not planner.propose(at=home).from_home


def test_measurements_of_another_robot_are_refused(plan: Path) -> None:
    other = lab.simulate("irb120", poses=3, seed=0).measurements
    with pytest.raises(lab.LabError, match=r"irb120, but .* scara"):
        lab.next_pose(plan, other, candidates=60)


@pytest.mark.thorough
def test_poses_for_the_cross_validation_alone_are_called_so() -> None:
    """An accuracy that few poses predict: the further ones are only to show it; a finer one needs them itself."""
    plan = lab.design("scara", poses=14, candidates=100, starts=1)
    day = simulated("scara", poses=10, seed=3).measurements
    easy, fine = (lab.next_pose(plan, day, candidates=100, accuracy_mm=mm) for mm in (5.0, 0.004))
    assert easy.proposal.for_validation and not easy.proposal.reached and easy.proposal.accuracy_m < 5e-3
    left = easy.planner.fewest - easy.proposal.measured
    assert easy.proposal.remaining == left > 0
    assert not fine.proposal.for_validation


@pytest.mark.thorough
def test_a_session_of_two_targets_begins_without_a_row(tmp_path: Path) -> None:
    """Before the first measurement: no file, or a file with a header alone."""
    made = lab.design("scara", poses=8, candidates=60, starts=1, targets=("p1", "p2"))
    first = lab.next_pose(made, candidates=60)
    (tmp_path / "begun.csv").write_text("id,q1_deg,q2_deg,q3_mm,q4_deg,p1_x_mm,p1_y_mm,p1_z_mm\n")
    begun = lab.next_pose(made, tmp_path / "begun.csv", candidates=60)
    for each in (first, begun):
        assert each.joints is not None and each.proposal.measured == 0 and each.data.targets == ("p1", "p2")
    np.testing.assert_array_equal(first.joints, begun.joints)
