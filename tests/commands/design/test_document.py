"""The page of a plan."""

import json
from pathlib import Path

import pytest
from helpers.html_page import Page


def test_a_plan_says_what_it_promises(plan_run: Path) -> None:
    seen = Page(plan_run / "report.html")
    result = json.loads((plan_run / "result.json").read_text())
    assert seen.headings == ["irb120: 12 poses to measure", "How many poses", "Where the poses are",
                             "How good the choice is", "What was done"]  # fmt: skip
    assert set(seen.figures) == {"curve-figure", "poses-figure"}
    assert f"within {result['promise_mm']:.4f} mm in 95 %" in seen.text
    for row, step in zip(seen.table("poses", "RMS, mm"), result["curve"], strict=True):
        assert [seen.number(cell) for cell in row] == pytest.approx(list(step.values()), rel=5e-3)
    assert len(seen.table("index")) == len(result["indices"]) and "D-efficiency" in seen.text
