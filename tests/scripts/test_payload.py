"""The load, weighed and identified: the script's scatter against its predictions, and its biases with their cures."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import payload as script
import pytest
from helpers.run_script import answer_of
from scipy import stats

from lab.core import se3
from lab.core.errors import LabError
from lab.extensions.dynamics.payload.excitation import Limits, random_path
from lab.extensions.dynamics.simulation import RunErrors
from lab.simulation.collisions import random_poses

RUNS = 4
LIMITS = Limits.of(script.MODEL.chain)
POSES = random_poses(script.MODEL, 20, np.random.default_rng(5))
PLAN = script.Plan(*(random_path(LIMITS, np.random.default_rng(i)) for i in (3, 4)), POSES)
QUIET = RunErrors(1e-9, force_noise_n=1e-5, moment_noise_nm=1e-6, torque_noise=1e-6)


@pytest.fixture(scope="module")
def biases() -> dict:
    """Hardly any noise: what is left is the bias."""
    return {(row["what"], row["method"]): row for row in script.biased(PLAN, QUIET, runs=1, seed=0)}


@pytest.mark.thorough
@pytest.mark.parametrize("method", script.METHODS)
def test_scatter_and_intervals_are_as_predicted(method: str) -> None:
    """The sum of whitened squares over runs is chi squared: two-sided 1e-4 for each method."""
    (found,) = script.measured(PLAN, script.NOISE, method, ("",), RUNS, 1)
    shown = 4 if method == script.RESTING else 10
    covariance = script.foreseen(PLAN)[method][:shown, :shown]
    off = np.array([estimate.phi for estimate in found])[:, :shown] - script.LOAD.phi[:shown]
    squares = np.einsum("ri,ij,rj->", off, np.linalg.inv(covariance), off)
    low, high = stats.chi2.ppf([5e-5, 1 - 5e-5], RUNS * shown)
    assert low < squares < high
    rows = [row for row in script.precision({method: found}, script.foreseen(PLAN)) if "covered" in row]
    assert [row["quantity"] for row in rows] == list(script.QUANTITIES[:shown])
    assert np.mean([row["covered"] for row in rows]) > 0.8
    band = np.sqrt(stats.chi2.ppf([5e-5, 1 - 5e-5], RUNS - 1) / (RUNS - 1))
    assert all(band[0] < row["scatter"] / row["predicted"] < band[1] for row in rows)


def test_propagation_is_the_spread_of_draws() -> None:
    covariance = script.foreseen(PLAN)[script.MOVING]
    drawn = np.random.default_rng(0).multivariate_normal(script.LOAD.phi, covariance, 4000, method="cholesky")
    spread = script.SCALE * np.std([script.quantities(phi) for phi in drawn], axis=0)
    np.testing.assert_allclose(spread, script.propagated(covariance), rtol=0.05)  # 1.1 % each


@pytest.mark.thorough
def test_every_bias_is_seen_and_cured(biases: dict) -> None:
    for row in biases.values():
        assert row["fired"] == 1.0, row["what"]
        assert abs(row["mass_percent_cured"]) < 0.3 and row["centre_mm_cured"] < 0.05
        assert row["centre_mm"] > 10 * row["centre_mm_cured"] and row["cost_um"] > row["cost_um_cured"]


@pytest.mark.thorough
def test_the_sizes_of_biases(biases: dict) -> None:
    """Friction makes a random path's mass wrong by percents; a sensor turned by w sees the centre about -w x c."""
    assert 0.3 < abs(biases["friction of 5 %", script.RANDOM]["mass_percent"]) < 10
    whole = 1e3 * np.linalg.norm(se3.skew(np.array(script.TURN)) @ script.LOAD.centre_m)
    for method in (script.RESTING, script.MOVING):
        assert 0.4 * whole < biases["sensor turned by 1°", method]["centre_mm"] < 1.5 * whole


def test_a_cost_is_that_of_its_weight() -> None:
    """Half the stiffness: twice the cost; facts: 5 % of 2 kg are 3.2 um at 1e5 Nm/rad, of another point of the hand."""
    weight = np.append(1.0, script.LOAD.centre_m)
    one, soft = (script.cost_um(0.1**2 * np.outer(weight, weight), k) for k in (1e5, 5e4))
    assert soft == pytest.approx(2 * one, rel=1e-9) and 3.2 / 2 < one < 3.2 * 2


@pytest.mark.thorough
def test_the_script_answers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(script, "planned", lambda options: replace(PLAN, poses=POSES[:12]))
    monkeypatch.setattr(script, "SECONDS", 2.5)
    found = answer_of("payload.py", "--runs", 2, "--out", tmp_path)
    assert set(found) == {"rows", "biases", "seconds"}
    assert len(found["rows"]) == 10 + 4 + 10 + 3 * 2 and len(found["biases"]) == 8
    assert {"mass_percent", "mass_percent_cured", "centre_mm", "fired", "cost_um_cured"} < set(found["biases"][0])
    with (tmp_path / "payload_biases.csv").open(newline="", encoding="utf-8") as file:
        assert [float(row["z_mm"]) for row in csv.DictReader(file)] == [row["z_mm"] for row in found["biases"]]
    for kind in ("png", "svg"):
        assert (tmp_path / f"payload.{kind}").stat().st_size > 10_000
    assert any("sensor, 20 poses" in line for line in script.report(found["rows"], found["biases"]))


def test_one_run_has_no_scatter() -> None:
    with pytest.raises(LabError, match="two --runs or more"):
        script.planned(script.Options(runs=1))
