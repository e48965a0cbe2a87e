"""A check is plain numbers, which another process reads as they are."""

import pickle

import numpy as np

from lab.core.checks import Check


def test_a_check_survives_another_process() -> None:
    check = Check("lack_of_fit.repeats", "failed", 1.5, 0.003, 0.05, {"dof": (12, 30)})
    assert pickle.loads(pickle.dumps(check)) == check
    fact = Check("fit.residuals", "noted")
    assert np.isnan([fact.statistic, fact.p, fact.level]).all() and not fact.data
