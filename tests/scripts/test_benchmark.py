"""The benchmark's clock and scale."""

import benchmark
import pytest
from benchmark import machine, median_ms, over_yardstick


def test_ratios_to_the_yardstick_leave_the_machine_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """A load of three yardsticks has the ratio three, also on a machine that becomes slower from one to the next."""
    clock, pace = [0.0], [1.0]

    def work(yardsticks: float) -> None:
        clock[0] += yardsticks * pace[0]

    def slower(ms: dict[str, float]) -> dict[str, float]:
        pace[0] *= 1.5
        return ms

    monkeypatch.setattr(benchmark, "_processor_s", lambda: clock[0])
    monkeypatch.setattr(benchmark.Yardstick, "__call__", lambda self: work(1))
    parts = [
        lambda: {"three": median_ms(lambda: work(3), 9), "MB of it": 1.0},
        lambda: slower({"half": median_ms(lambda: work(0.5), 9)}),
    ]
    figures, ratios = over_yardstick(parts)
    assert set(figures) == {"three", "half", "MB of it"} and set(ratios) == {"three", "half"}
    assert ratios["three"] == pytest.approx(3) and ratios["half"] == pytest.approx(0.5 / 1.25)  # between two paces
    assert "Python" in machine() and "kernels" in machine()
