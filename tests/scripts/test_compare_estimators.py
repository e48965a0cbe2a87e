"""Estimators beside the lab's on the same campaigns, of few arms."""

import numpy as np
import pytest
from helpers.run_script import threads_for_processes

pytestmark = pytest.mark.thorough  # scikit-learn is of the extra dev
pytest.importorskip("sklearn")
compare_estimators = pytest.importorskip("compare_estimators")


def test_a_ratio_is_the_geometric_mean_with_students_interval_over_arms() -> None:
    known = np.ones((3, 2))
    found = compare_estimators.ratio(np.exp([[0.1, 0.3], [0.2, 0.4], [0.3, 0.5]]), known)
    assert found["ratio"] == pytest.approx(np.exp(0.3))
    assert np.log(found["to"] / found["ratio"]) == pytest.approx(4.302653 * 0.1 / np.sqrt(3), rel=1e-5)
    assert found["from"] * found["to"] == pytest.approx(found["ratio"] ** 2)


@pytest.mark.thorough
def test_each_estimator_has_its_condition() -> None:
    options = compare_estimators.Options(campaigns=8, draws=2, fresh=50)
    with threads_for_processes():
        found = compare_estimators.answer(options).values["conditions"]
    clean, outliers, gears = found.values()
    for condition in found.values():
        assert abs(condition["Kalman, iterated"]["ratio"] - 1) < 0.02
    assert 1.0 < clean["Tukey"]["ratio"] < 1.3 and outliers["Tukey"]["ratio"] < 0.1
    assert gears["learned corrector"]["ratio"] < 0.99 < outliers["learned corrector"]["ratio"]
