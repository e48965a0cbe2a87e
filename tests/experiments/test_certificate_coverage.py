"""Does a certificate's 95 % cover the true error: a little here, 10,000 campaigns a case where marked slow."""

import numpy as np
import pytest
from helpers.run_script import answer_of

COVERING = ("known noise", "estimated noise")


def test_the_budget_covers_the_error_a_little() -> None:
    """40 campaigns a case, whose positions hang together: one sigma of the share is 3.4 % at most."""
    found = answer_of("certificate_coverage.py", "--robots", 2, "--draws", 20)
    for case in COVERING:
        for measurand in ("position", "distance"):
            assert found[case][f"{measurand}_covered_of_all_10"] == pytest.approx(0.95, abs=3 * np.sqrt(0.0475 / 40))
    assert found["systematic errors left out"]["position_covered"] < 0.7


@pytest.mark.slow
def test_the_budget_covers_the_error() -> None:
    found = answer_of("certificate_coverage.py", "--cases", *COVERING)
    for case in COVERING:
        assert found[case]["campaigns"] == 10_000
        for measurand in ("position", "distance"):
            assert 0.94 <= found[case][f"{measurand}_covered"] <= 0.96
