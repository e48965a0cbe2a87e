"""A check holds numbers, no sentence."""

import dataclasses

import numpy as np
import pytest

from lab.core.checks import Check


def test_a_check_without_a_test_has_no_numbers_of_one() -> None:
    fact = Check("rows.blank", "noted", data={"blank": 2})
    assert np.isnan([fact.statistic, fact.p, fact.level]).all() and fact.data["blank"] == 2
    with pytest.raises(dataclasses.FrozenInstanceError):
        fact.outcome = "passed"  # type: ignore[misc]
