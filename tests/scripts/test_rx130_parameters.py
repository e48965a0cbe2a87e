"""An RX 130's parameters by both methods: intervals that hold; many campaigns where marked slow."""

import pytest
from helpers.run_script import answer_of
from rx130_parameters import METHODS, Options, answer

from lab.core.errors import LabError


@pytest.mark.thorough
def test_intervals_of_both_methods_hold() -> None:
    """24 campaigns of 30 parameters: of their mean coverage one standard error is 1 %, or a little more."""
    found = answer_of("rx130_parameters.py", "--robots", 2, "--draws", 12)
    for name in METHODS:
        assert found["coverage"][name]["coverage_mean"] == pytest.approx(0.95, abs=0.03)
        assert found["coverage"][name]["squares_by_variance"] == pytest.approx(1.0, abs=0.15)
    assert found["coverage"]["global"]["wider_than_global"] == 1.0
    assert 1.1 < found["coverage"]["sequential"]["wider_than_global"] < 2.0
    rows = found["parameters"]
    assert len(rows) == 30
    for row in rows:
        assert abs(row["sequential"] - row["true"]) < 2.5 * row["sequential_half_width"]
        assert row["sequential_half_width"] > 0.999 * row["global_half_width"]


@pytest.mark.slow
@pytest.mark.parametrize("noise_mrad", [0.3, 1.0])
def test_a_thousand_campaigns(noise_mrad: float) -> None:
    found = answer_of("rx130_parameters.py", "--noise-mrad", noise_mrad)["coverage"]
    for name in METHODS:
        assert 0.94 < found[name]["coverage_mean"] < 0.96
        assert found[name]["squares_by_variance"] == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (Options(draws=1), "--draws 2 or more"),
        (Options(noise_mrad=0.0), "--noise-mrad"),
        (Options(noise_mm=-1.0), "--noise-mm"),
    ],
)
def test_bad_input(options: Options, words: str) -> None:
    with pytest.raises(LabError, match=words):
        answer(options)
