"""Formulas as textbooks print them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from lab.core.errors import LabError
from lab.extensions.reproduction.answer import evaluated

V = {name: np.linspace(0.2, 1.1, 7) * (i + 1) for i, name in enumerate(("q1", "q2", "q3", "L2", "px", "a"))}
Q1, Q2, Q3, L2, PX, A = V.values()


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("c1 s2 − s1 c2", np.sin(Q2 - Q1)),
        ("c1s2-s1c2", np.sin(Q2 - Q1)),
        ("L2 c23 + L2c123", L2 * np.cos(Q2 + Q3) + L2 * np.cos(Q1 + Q2 + Q3)),
        ("−px^2/2 · 3", -1.5 * PX**2),
        ("−(px + a) (px − a)", A**2 - PX**2),
        ("atan2(−px, a) + √(px² + a²)", np.arctan2(-PX, A) + np.hypot(PX, A)),
        ("a cos(q1)", A * np.cos(Q1)),
        ("2 π − 0.5", np.full(7, 2 * np.pi - 0.5)),
        ("- c1 - - s1", np.sin(Q1) - np.cos(Q1)),
    ],
)
def test_a_formula_has_the_value_that_it_says(text: str, value: np.ndarray) -> None:
    assert_allclose(evaluated(text, V), value, atol=1e-14)


@pytest.mark.parametrize(
    "text", ["", "c1 +", "c4", "(c1", "c1)", "atan2(a)", "cos(a, a)", "b", "px^a", "a ** 2", "(" * 60]
)
def test_what_is_no_formula_is_told_with_the_letters(text: str) -> None:
    with pytest.raises(LabError, match="formula"):
        evaluated(text, V)
