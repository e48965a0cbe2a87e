"""The study of an arm's dynamics in small: exact without noise, intervals, what is told, and the load by both ways."""

from dataclasses import replace

import arm_dynamics as script
import pytest
from scipy import stats

from lab.core.errors import LabError

RUNS = 6
pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def study() -> script.Study:
    return script.study_of(script.Options(runs=RUNS, power_runs=RUNS, load_runs=2, rounds=0))


def test_without_noise_everything_comes_out(study: script.Study) -> None:
    assert max(script.noise_free(study).values()) < 1e-8


def test_intervals_hold_and_another_path_is_predicted(study: script.Study) -> None:
    rows, whole = script.coverage(study)
    assert len(rows) == 58 and {row["unit"] for row in rows} >= {"kg m²", "kg m", "Nm", "Nm s/rad"}
    assert whole["covered_mean"] > 0.88  # the parameters of a run are correlated
    assert 0.6 < whole["squares_by_variance"] < 1.6
    assert whole["prediction_error_by_noise"] < 1.1


def test_what_biases_is_told(study: script.Study) -> None:
    for row in script.power(study, script.BIASES):
        assert row["bias_sigma"] == pytest.approx(4.0, abs=0.1) and row["bias_sigma"] >= 4.0
        assert stats.binomtest(round(row["told"] * RUNS), RUNS, 0.95, "less").pvalue > 1e-3, row


def test_a_load_that_shifts_the_path_is_better_fitted_with_the_arm(study: script.Study) -> None:
    rows = script.loads(replace(study, noise=1e-3 * study.noise))
    same, apart, once, difference = (row["mass_percent"] for row in rows)
    assert same == pytest.approx(apart, rel=0.3) and once < 0.2 * difference
    assert "fit load and arm at once" in script.advice(rows)


def test_one_run_is_refused() -> None:
    with pytest.raises(LabError, match="two runs"):
        script.study_of(script.Options(runs=1))
