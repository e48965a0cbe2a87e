"""``lab compare`` on calibrations of one virtual arm, before and after a zero of a joint has moved."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lab
from lab.calibration.statistics.goodness_of_fit import lack_of_fit_not_tested
from lab.cli import main
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.kinematics.gauge import STRUCTURE_POSES
from lab.render.document import plain

MOVED_RAD = 0.5e-3


@pytest.fixture(scope="module")
def three() -> list:
    """An arm calibrated twice, and once more after the zero of its third joint moved."""
    day = lab.simulate("irb120", poses=90, seed=7, targets=("p1", "p2")).measurements
    parts = [day.take(range(i, i + 30)) for i in (0, 30, 60)]
    joints = parts[2].joints.copy()
    joints[:, 2] -= MOVED_RAD  # what the controller says, when the joint stands farther than it knows
    parts[2] = replace(parts[2], joints=joints)
    return [lab.identify(part, robot="irb120", instrument="uniform-8um") for part in parts]


def test_the_joint_that_moved_is_named(three: list) -> None:
    found = lab.compare(three).to_dict()
    same, other = found["compared"]
    assert not same["changed"] and same["moved"] == []
    assert other["changed"] and other["moved"][0] == "link3.theta"
    change = other["differences"]["link3.theta"]
    assert change["interval_95"][0] < MOVED_RAD < change["interval_95"][1]
    assert not any(name.startswith(("base", "tool")) for name in other["differences"])
    page = " ".join(lab.compare(three).summary().split())
    assert "Moved: link3.theta by +0.49" in page and "No change of the links is detectable" in page


def test_the_page_begins_with_how_far_the_change_takes_the_tool(three: list) -> None:
    """A zero of the third joint that is off moves the tool as a reading of that joint that is off does."""
    result = lab.compare(three)
    card = next(block for block in result.document().blocks if block.kind == "card")
    numbers = {caption: number for caption, number, _ in card.numbers}
    moved = result.differences[-1].changes[result.differences[-1].names.index("link3.theta")]
    estimate = three[0].estimate
    joints = estimate.arm.structure_joints(STRUCTURE_POSES, rng_for(0, "structure"))
    turned = joints.copy()
    turned[:, 2] += moved
    apart = (estimate.arm.points(turned, estimate.values) - estimate.arm.points(joints, estimate.values))[:, 0]
    expected = 1e3 * np.sqrt((apart**2).sum(axis=1).mean())
    assert float(numbers["at the tool"].removesuffix(" mm")) == pytest.approx(expected, rel=0.02)
    assert numbers["zero of joint 3 (link3.theta)"].endswith(" mrad") and numbers["parameters moved"].startswith(
        "1 of "
    )
    same = lab.compare(three[:2])
    card = next(block for block in same.document().blocks if block.kind == "card")
    assert "at the tool" not in dict(each[:2] for each in card.numbers) and str(card.next_step).startswith("Keep")


def test_all_differences_are_in_one_table_what_moved_first(three: list) -> None:
    result = lab.compare([three[0], three[1], three[2]])
    (table,) = (block for block in result.document().blocks[-2].blocks if block.kind == "table")
    assert table.rows[0][0].text == "link3.theta" and len(table.rows) == len(result.differences[0].names)
    assert [plain(row[-1]) != "" for row in table.rows] == [kind != "quiet" for kind in table.row_kinds]
    said = " ".join(result.summary().split())
    assert "Not different from the first: run-2-in-memory. Changed: run-3-in-memory." in said


def test_folders_are_compared_as_results_are(three: list, tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    folders = [str(result.save(tmp_path / f"run{i}")) for i, result in enumerate(three)]
    assert main(["compare", *folders, "--json", "--out", "compared"]) == 1
    told = json.loads(capsys.readouterr().out)
    in_memory = lab.compare(three).to_dict()
    for ours, theirs in zip(told["compared"], in_memory["compared"], strict=True):
        assert ours["p"] == pytest.approx(theirs["p"], rel=1e-6) and ours["moved"] == theirs["moved"]
    assert main(["compare", *folders[:2], "--out", folders[0]]) == 2  # which would replace what it reads
    assert "an input of this run" in capsys.readouterr().err
    assert main(["compare", folders[0]]) == 2 and "two or more runs" in capsys.readouterr().err


def test_a_run_given_twice_is_refused(three: list) -> None:
    with pytest.raises(LabError, match=r"run-3-in-memory: has the parameters of run-1-in-memory, to the last digit"):
        lab.compare([three[0], three[1], three[0]])


@pytest.mark.thorough
def test_what_cannot_be_compared_is_refused(three: list) -> None:
    other = lab.calibrate("scara", poses=12)
    with pytest.raises(LabError, match="is of another robot"):
        lab.compare([three[0], other])
    fixed = lab.identify(three[1].measurements, robot="irb120", instrument="uniform-8um", fix=("link3.a",))
    with pytest.raises(LabError, match=r"link3\.a was identified in it or in .*, but not in both"):
        lab.compare([three[0], fixed])
    bad = replace(three[1].verdict, word="bad", reasons=(lack_of_fit_not_tested("too few"),))
    unjudged = replace(three[1], fit=replace(three[1].fit, verdict=bad))
    with pytest.raises(LabError, match="the verdict of this run is 'bad'"):
        lab.compare([three[0], unjudged])
    assert np.isfinite(lab.compare([three[0], unjudged], force=True).differences[0].p)
