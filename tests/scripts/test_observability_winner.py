"""The script of live tables: an order that seeds do not change, and a winner that they do."""

import pytest
from helpers.run_script import answer_of


@pytest.mark.slow
def test_without_the_three_rows_the_order_is_stable_and_with_them_it_is_chance() -> None:
    indices = ("O1", "O2", "O3", "O4", "O5")
    found = answer_of("observability_winner.py", "--searches", 3, "--draws", 500, "--seed", 20, "--indices", *indices)
    assert found["order_without"] == ["O5", "O3", "O1", "O4", "O2"] and found["searches_with_it"] == 3
    whole, without = (
        {name: each["mean"] for name, each in found["least_rms"][rows].items()} for rows in ("all", "without")
    )
    assert list(found["expected_without"]) == list(indices) and found["expected_without"]["O5"] < 0.00135
    assert max(whole.values()) < 0.4 and max(without, key=lambda name: without[name]) == "O5"
    assert sum(whole.values()) == pytest.approx(1.0) and sum(without.values()) == pytest.approx(1.0)
    for name in indices:
        own = found["scores"][name][name]  # each set is the best by its own index, as far as the search goes
        assert own > 0.99 > min(found["scores"][name].values())  # and not by all others
