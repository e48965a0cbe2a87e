"""Bending links of steel and joint springs at one target: one explanation of two, and said so; of aluminium, told."""

import numpy as np
import pytest
from designed_campaign import DesignedCampaign

from lab.library.virtual_arm import perturbed_arm
from lab.options.option_groups import Effects
from lab.options.virtual_campaign import VirtualCampaign
from lab.phrases.phrase import phrases
from lab.verdict.fit_checks import check_alternatives

STEEL, ALUMINIUM = 175_000.0, 48_400.0  # N m²: tubes of 80 x 5 and 80 x 4 mm
DAY = DesignedCampaign("irb120", ("p1",), ("compliance", "bending"))


@pytest.mark.thorough
@pytest.mark.parametrize("ei", [STEEL, ALUMINIUM])
def test_what_cannot_be_told_apart_is_said(ei: float) -> None:
    real = perturbed_arm(DAY.robot, VirtualCampaign(seed=1, effects=Effects(link_ei=(0, ei, 0, ei, 0, 0))))
    data = DAY.measured(real, 1)
    found = DAY.selected(data)
    said = phrases(check_alternatives(found, data))
    if ei == ALUMINIUM:
        assert found.chosen == ("bending",) and not said
        return
    assert found.chosen == ("compliance",) and len(said) == 1
    assert said[0].startswith("compliance and bending are confounded at these poses")
    assert "no pose and payload would separate them: they differ by at most" in said[0]
    each = found.alternatives[0]
    assert each.fit_rise < 10 and not each.is_distinguishable and each.differ_m < 3 * found.identification.sigma_m
    assert np.isfinite(each.inputs).all()
