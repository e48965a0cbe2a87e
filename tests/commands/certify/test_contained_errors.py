"""A certificate's U contains the true errors of campaigns with a mistake, and grows little without one.

The share of poses that a campaign's U covers hangs together within the campaign: the bounds here are of campaigns.
"""

from pathlib import Path

import numpy as np
import pytest
from helpers.certified import MISTAKES, Outcome, outcome

GOOD = [name for name in MISTAKES if name.startswith("none")]
STUDIED = 40  # campaigns of each mistake, where marked slow


def certified(folder: Path, name: str, count: int) -> list[Outcome]:
    return [outcome(MISTAKES[name], seed, folder / str(seed)) for seed in range(count)]


def covered(found: list[Outcome]) -> float:
    """The share of poses within U, of the campaigns that have a certificate."""
    return float(np.mean([each.covered.mean() for each in found if each.certificate is not None]))


@pytest.mark.thorough
def test_a_step_of_3_mm_is_fitted_and_the_arm_is_the_one_after_it(tmp_path: Path) -> None:
    found = outcome(MISTAKES["step of 3 mm"], 7, tmp_path / "run")
    certificate = found.certificate
    assert certificate is not None
    after = certificate.calibrated.result.after_mm
    assert after is not None and after["p95"] < 0.05  # about the base as it is after the step
    assert found.verdict == "good"


@pytest.mark.thorough
def test_a_good_campaign_has_the_uncertainty_that_it_had(tmp_path: Path) -> None:
    found = certified(tmp_path, "none, stated", 3)
    assert np.median([each.over_today for each in found]) <= 1.3
    assert all(each.certificate is not None and each.verdict == "good" for each in found)


@pytest.mark.slow
@pytest.mark.parametrize("name", MISTAKES)
def test_the_true_error_is_contained(name: str, tmp_path: Path) -> None:
    found = certified(tmp_path, name, STUDIED)
    assert covered(found) >= 0.95
    if name in GOOD:
        assert np.quantile([each.over_today for each in found], 0.9) <= 1.3
