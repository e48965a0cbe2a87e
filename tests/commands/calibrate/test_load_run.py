"""A run's folder, read back as a calibrated arm."""

import hashlib
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from helpers.campaigns import calibration, own_copy, run_of

from lab.core.errors import LabError
from lab.library.load_run import load_run
from lab.robots.load_robot import load_robot

SOFT = {"stiffness_nm_per_rad": 1e5, "payload_kg": (0.0, 3.0), "model": "compliance+drift", "hours": 1.0}


@pytest.fixture(scope="module")
def soft() -> Path:
    return run_of(seed=3, **SOFT)


@pytest.mark.thorough
def test_it_predicts_what_was_identified_without_what_was_of_its_day(soft: Path) -> None:
    calibrated = load_run(soft)
    assert calibrated.estimate.groups == ("compliance",) and calibrated.estimate.arm.conditions == ("payload_kg",)
    outcome = calibration(seed=3, **SOFT)
    joints = calibrated.robot.chain.random_joints(100, np.random.default_rng(0))
    at_start = np.concatenate([joints, np.full((100, 1), 3.0), np.zeros((100, 1))], axis=1)
    whole = outcome.identification.model.points(at_start, outcome.identification.values)
    np.testing.assert_allclose(
        calibrated.estimate.arm.points(at_start[:, :-1], calibrated.estimate.values), whole, rtol=0, atol=1e-12
    )
    names = [outcome.identification.model.names[i] for i in outcome.identification.fit.free]
    kept = [i for i, name in enumerate(names) if not name.startswith("drift.")]
    assert calibrated.estimate.free_names == tuple(names[i] for i in kept) and len(kept) == len(names) - 7
    assert (calibrated.estimate.free_covariance == outcome.identification.covariance[np.ix_(kept, kept)]).all()
    assert calibrated.estimate.left_out == ("drift",)
    assert calibrated.estimate.residual_m == pytest.approx(calibrated.estimate.noise_m, rel=0.3)


def broken(soft: Path, tmp_path: Path, name: str, change) -> Path:
    folder = own_copy(soft, tmp_path / "run")
    path = folder / name
    if change is None:
        path.unlink()
    else:
        path.write_text(change(path.read_text()))
    return folder


def edited(**values: object):
    return lambda text: json.dumps({**json.loads(text), **values})


def without_tool(text: str) -> str:
    return json.dumps([row for row in json.loads(text) if not row["name"].startswith("tool.")])


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("config.json", None, "cannot be read"),
        ("config.json", edited(command="design"), "no run of lab calibrate"),
        ("config.json", edited(model_sha256="0"), "another robot"),
        ("result.json", lambda text: text[:-9], "not JSON"),
        ("result.json", lambda text: "[]", "is not in the lab's format"),
        ("parameters.json", without_tool, "has no tool"),
        ("parameters.json", lambda text: text.replace("link3.d", "link3.e"), "has no link3.d"),
        ("parameters.json", lambda text: text.replace("exported", "export"), "'0.exported' is missing"),
        ("covariance.csv", lambda text: text.replace("parameter", "name"), "name different parameters"),
        ("covariance.csv", lambda text: text.replace("e-1", "f-1"), "identify again"),
    ],
)
def test_a_run_that_is_none_is_told_in_one_line(soft: Path, tmp_path, name: str, change, words: str) -> None:
    with pytest.raises(LabError, match=words) as told:
        load_run(broken(soft, tmp_path, name, change))
    assert str(tmp_path) in str(told.value) and "\n" not in str(told.value)


@pytest.mark.thorough
def test_only_a_good_run_is_fit_to_build_on(soft: Path, tmp_path, word: str = "not judged") -> None:
    load_run(soft).refuse_unfit("an export")
    other = broken(soft, tmp_path, "result.json", edited(verdict=word, reason="why"))
    run = load_run(other, accept_edited=True)
    with pytest.raises(LabError, match=rf"'{word}' \(why\).*refused.*--force"):
        run.refuse_unfit("an export")


HAND_EDITS = [
    (
        "parameters.json",
        lambda text: re.sub(r'("exported": )(0\.\d+)', r"\g<1>0.123", text, count=1),
        "was changed since",
    ),
    (
        "parameters.json",
        lambda text: re.sub(r'("exported": )[-\d.e]+', r"\1NaN", text, count=1),
        "is nan; give a finite",
    ),
    ("parameters.json", lambda text: re.sub(r'("exported": )[-\d.e]+', r"\g<1>1e999", text, count=1), "is inf; give a"),
    ("parameters.json", lambda text: "[" * 100_000, "levels of nested values"),
    ("result.json", edited(noise_mm=-1.0), "noise_mm is -1; a standard deviation is not below zero"),
    ("result.json", edited(residual_mm=10**400), "more than 63 bits"),
    ("result.json", edited(noise_mm=1e-9), "was changed since the run was written"),
    ("covariance.csv", lambda text: covariance(text, lambda C: C + np.triu(C, 1)), "not symmetric"),
    ("covariance.csv", lambda text: covariance(text, lambda C: -C), "variance below zero"),
    ("covariance.csv", lambda text: covariance(text, lambda C: C * np.nan), "not finite"),
    ("covariance.csv", lambda text: covariance(text, lambda C: 3 * C - 2 * np.diag(np.diag(C))), "semidefinite"),
    ("covariance.csv", lambda text: covariance(text, lambda C: C / 100), "was changed since the run was written"),
    ("SHA256SUMS", None, "its checksums are missing; repeat the run, or accept the edits by --accept-edited"),
]


def covariance(text: str, change) -> str:
    header, *rows = [line.split(",") for line in text.splitlines()]
    changed = change(np.array([row[1:] for row in rows], dtype=float))
    lines = [[row[0], *map(repr, numbers)] for row, numbers in zip(rows, changed.tolist(), strict=True)]
    return "".join(",".join(line) + "\n" for line in [header, *lines])


@pytest.mark.parametrize(("name", "change", "words"), HAND_EDITS)
def test_a_run_that_was_edited_by_hand_is_refused(soft: Path, tmp_path, name: str, change, words: str) -> None:
    with pytest.raises(LabError, match=re.escape(words)) as told:
        load_run(broken(soft, tmp_path, name, change))
    assert str(tmp_path) in str(told.value)


def test_what_was_edited_is_accepted_by_word_alone_and_then_told(soft: Path, tmp_path) -> None:
    other = broken(soft, tmp_path, "covariance.csv", lambda text: covariance(text, lambda C: C / 100))
    (told,) = set(load_run(other, accept_edited=True).warnings) - set(load_run(soft).warnings)
    assert "covariance.csv was changed since the run was written: the edited files are used" in told


def test_checksums_are_those_that_sha256sum_checks(soft: Path, tmp_path) -> None:
    lines = (soft / "SHA256SUMS").read_text().splitlines()
    files = {path.name for path in soft.iterdir()} - {"SHA256SUMS"}
    assert {line.partition("  ")[2] for line in lines} == files
    for line in lines:
        digest, _, name = line.partition("  ")
        assert hashlib.sha256((soft / name).read_bytes()).hexdigest() == digest


def test_the_robot_of_a_run_is_the_calibrated_one(soft: Path, tmp_path: Path) -> None:
    """Its geometry is that of the estimate, in the base's frame; a folder of another run is refused."""
    run, robot = load_run(str(soft)), load_robot(soft)
    rigid, values = run.estimate.geometry
    joints = rigid.chain.random_joints(20, np.random.default_rng(1))
    T = rigid.T_tracker_frame0(values)
    expected = (rigid.points(joints, values) - T[:3, 3]) @ T[:3, :3]
    arm = robot.arm(rigid.targets)
    own = arm.nominal(robot.tool)
    T = arm.T_tracker_frame0(own)
    np.testing.assert_allclose((arm.points(joints, own) - T[:3, 3]) @ T[:3, :3], expected, rtol=0, atol=1e-9)
    shutil.copy(soft / "config.json", tmp_path / "config.json")
    with pytest.raises(LabError, match="holds no calibrated robot"):
        load_robot(tmp_path)
