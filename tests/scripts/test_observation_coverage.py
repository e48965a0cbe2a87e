"""Every kind of observation: exact without noise, and intervals that hold; small here, whole where marked slow."""

import pytest
from helpers.run_script import answer_of
from observation_coverage import CASES, Options, answer

from lab.core.errors import LabError

FEW = ("--robots", 1, "--draws", 30)


@pytest.mark.parametrize("kind", ["pose", "cable", "cube", "self-contact"])
def test_a_few_campaigns(kind: str) -> None:
    """Thirty draws of 30 and more parameters: of their mean coverage one standard error is 0.9 %."""
    found = answer_of("observation_coverage.py", *FEW, "--kinds", kind)[kind]
    assert found["noise_free_error_largest"] < 1e-9
    assert found["coverage_mean"] == pytest.approx(0.95, abs=0.03)
    assert found["nees_per_parameter"] == pytest.approx(1.0, abs=0.16)  # chi2 of 900 numbers: 3.3 standard errors
    assert 0.3 < found["floor_over_predicted"] < 2.0


@pytest.mark.slow
@pytest.mark.parametrize("kind", CASES)
def test_a_thousand_campaigns(kind: str) -> None:
    found = answer_of("observation_coverage.py", "--kinds", kind)[kind]
    assert found["noise_free_error_largest"] < 1e-9
    assert 0.94 < found["coverage_mean"] < 0.96
    assert found["nees_per_parameter"] == pytest.approx(1.0, abs=0.03)
    assert found["floor_over_predicted"] == pytest.approx(1.0, abs=0.25)


def test_an_unknown_kind() -> None:
    with pytest.raises(LabError, match="--kinds smell: unknown; give some of points, pose, cable"):
        answer(Options(kinds=("smell",)))
