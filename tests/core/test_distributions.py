"""Uncertain quantities: standard uncertainties of their limits, and draws that have them."""

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.core.probability import DistributionName, Uncertain


@pytest.mark.parametrize(("form", "root"), [("rectangular", 3.0), ("triangular", 6.0), ("arcsine", 2.0)])
def test_draws_lie_within_the_limit_and_have_the_standard_uncertainty(form: DistributionName, root: float) -> None:
    quantity = Uncertain.within(2e-6, form)
    assert quantity.standard == pytest.approx(2e-6 / np.sqrt(root)) and quantity.limit == pytest.approx(2e-6)
    drawn = quantity.sample(np.random.default_rng(0), 20_000)
    assert np.abs(drawn).max() <= 2e-6 * (1 + 1e-11)
    assert drawn.std() == pytest.approx(quantity.standard, rel=0.02)  # 4 standard deviations of 20,000 draws


def test_a_normal_quantity_has_no_limits() -> None:
    assert Uncertain(1.0).limit == np.inf
    with pytest.raises(LabError, match="give its standard uncertainty"):
        Uncertain.within(1.0, "normal")
