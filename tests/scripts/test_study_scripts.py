"""The scripts that answer questions by studies: small here, whole where marked slow."""

from pathlib import Path

import numpy as np
import pytest
from helpers.run_script import answer_in_processes, answer_of

from lab.extensions.reproduction.thesis_case import (
    HIDDEN,
    INTO,
    OFFSETS,
    errors,
    rows_of_table,
    thesis_case,
    without,
)

ROW = list(OFFSETS).index


def answer(name: str, out: Path, *flags: object):
    return answer_in_processes(name, "--out", out, *flags)


def test_the_rms_of_the_thesis_is_what_it_hides() -> None:
    """Whatever the poses: here 20 random ones; 0.60 / sqrt(19) = 0.1377."""
    poses = np.random.default_rng(0).uniform(-np.pi, np.pi, (20, 6))
    off, clean = (errors(poses, 200, hidden=hidden) for hidden in (HIDDEN, {}))
    rms = rows_of_table(off)["RMS"]
    assert rms.mean() == pytest.approx(0.60 / np.sqrt(19), abs=0.0015) and rms.std() > 0.0005
    aliased = {name: off[:, ROW(name)].mean() for name in INTO.values()}
    assert aliased["link3.d"] == pytest.approx(0.60, abs=0.004)  # 200 draws of sigma 0.01
    assert aliased["link5.theta"] == pytest.approx(-0.36 / 72, rel=0.02)
    assert aliased["link5.alpha"] == pytest.approx(0.93 / 72, rel=0.02)
    assert rows_of_table(clean)["RMS"].mean() < 0.005  # noise alone
    assert without(clean).shape == (200, 16)
    bent = off[:, ROW("link6.d")].mean() - clean[:, ROW("link6.d")].mean()
    assert bent == pytest.approx(0.0, abs=1e-6)


def test_linear_errors_are_those_of_small_ones() -> None:
    """An arm a thousandth as far off, without noise, is a linear one."""
    case, joints = thesis_case(), np.random.default_rng(0).uniform(-np.pi, np.pi, (20, 6))
    step = case.truth() - case.nominal
    moved = case.arm.points(joints, case.nominal + 1e-3 * step) - case.arm.points(joints, case.nominal)
    rates = case.arm.observe(joints, case.nominal)[1]
    np.testing.assert_allclose(moved, 1e-3 * rates @ step, atol=1e-10)


def test_rows_of_a_table_by_hand() -> None:
    found = rows_of_table(np.array([3.0, -1.0, 1.0, 1.0]))
    assert found["RMS"] == pytest.approx(np.sqrt(3)) and found["MAE"] == 1.5
    assert found["RSD"] == pytest.approx(np.sqrt(8 / 3))  # about the mean of 1


@pytest.mark.slow
def test_thesis_tables(tmp_path: Path) -> None:
    """The answer, by 10,000 paired campaigns a cell, on two cores within ten minutes."""
    found = answer("thesis_tables.py", tmp_path)
    assert found["seconds"] <= 600
    rows = found["answer"]["rows"]
    assert len(rows) == 4 * 3 * (2 + 4 * 4) and all(row["campaigns"] == 10_000 for row in rows)
    fresh = {(row["criterion"], row["scaling"], row["poses"]): row for row in rows if row["metric"] == "fresh_mean_mm"}
    for poses in (10, 20, 40):
        random = fresh["random", "any", poses]["to_o1"]
        assert random["lower"] > 1.1 and random["p_holm"] < 0.05  # 153 pairs, of which none is told below 1e-4 alone
        assert all(fresh["O2", scaling, poses]["to_o1"]["lower"] > 1.1 for scaling in ("raw", "length", "whitened"))
        assert 0.85 < fresh["O5", "whitened", poses]["to_o1"]["effect"] < 1.1
        assert fresh["O1", "any", poses]["ranks_95"][0] <= 3


@pytest.mark.thorough
def test_the_best_o1_of_the_thesis_case_from_two_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("best_o1.STARTS", 2)  # of twelve: fewer chances to find it
    assert answer_of("best_o1.py", "--ignore-limits")["o1"] >= 12.25


@pytest.mark.slow
@pytest.mark.parametrize(("limits", "least"), [(False, 12.25), (True, 12.03)])
def test_the_best_o1_of_the_thesis_case(limits: bool, least: float) -> None:
    flags = [] if limits else ["--ignore-limits"]
    found = answer_in_processes("best_o1.py", *flags)
    assert found["o1"] >= least and found["seconds"] < 60
    joints = np.array(found["joints_deg"])
    if limits:
        assert (np.abs(joints) <= [165, 110, 110, 160, 120, 400]).all() and (joints[:, 2] <= 70).all()
