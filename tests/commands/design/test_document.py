"""The page of a plan."""

import json
from pathlib import Path

import pytest
from helpers.html_page import Page


@pytest.mark.thorough
@pytest.mark.figures
def test_a_plan_says_its_predicted_errors(drawn_plan: Path) -> None:
    seen = Page(drawn_plan / "report.html")
    result = json.loads((drawn_plan / "result.json").read_text())
    assert seen.headings == ["irb120: 12 poses to measure", "Poses and tour", "Number of poses",
                             "Quality of the choice", "What was done", "Glossary"]  # fmt: skip
    assert set(seen.figures) == {"plan-scene", "curve-figure", "poses-figure"}
    assert f"its 95 %/95 % tolerance bound is {result['promise_mm']:.4f} mm" in seen.text
    for row, step in zip(seen.table("poses", "RMS, mm"), result["curve"], strict=True):
        shown = [value for key, value in step.items() if key != "o1"]  # which is the same for any number
        assert [seen.number(cell) for cell in row] == pytest.approx(shown, rel=5e-3)
    assert len(seen.table("index")) == len(result["indices"]) and "D-efficiency" in seen.text
