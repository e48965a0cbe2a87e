"""The benchmark's clock and scale."""

import numpy as np

from lab.experiments.speed import BUDGET_MS, median_ms, peak_beyond_result_mb


def test_a_median_leaves_out_the_first_call() -> None:
    calls: list[int] = []
    assert median_ms(lambda: calls.append(1), 3) >= 0 and len(calls) == 4


def test_memory_beyond_the_result() -> None:
    def call() -> tuple[np.ndarray, np.ndarray]:
        spare = np.ones(1_000_000)  # 8 MB
        return np.zeros(10), spare[:10].copy()

    assert 7.9 < peak_beyond_result_mb(call) < 9
    assert all(budget > 0 for budget in BUDGET_MS.values())
