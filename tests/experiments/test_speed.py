"""The benchmark's clock and scale."""

import numpy as np

from lab.experiments.speed import BUDGET_MS, Yardstick, machine, median_ms, over_yardstick, peak_beyond_result_mb


def test_a_median_leaves_out_the_first_call() -> None:
    calls: list[int] = []
    assert median_ms(lambda: calls.append(1), 3) >= 0 and len(calls) == 4


def test_memory_beyond_the_result() -> None:
    def call() -> tuple[np.ndarray, np.ndarray]:
        spare = np.ones(1_000_000)  # 8 MB
        return np.zeros(10), spare[:10].copy()

    assert 7.9 < peak_beyond_result_mb(call) < 9
    assert all(budget > 0 for budget in BUDGET_MS.values())


def test_ratios_to_the_yardstick_leave_the_machine_out() -> None:
    """What takes three yardsticks is told to; a machine that is twice as slow in between is no change."""
    yardstick = Yardstick()

    def three() -> None:
        for _ in range(3):
            yardstick()

    figures, ratios = over_yardstick([lambda: {"three": median_ms(three, 9), "MB of it": 1.0}])
    assert set(figures) == {"three", "MB of it"} and set(ratios) == {"three"}
    assert 1.5 < ratios["three"] < 6
    assert "Python" in machine() and "kernels" in machine()
