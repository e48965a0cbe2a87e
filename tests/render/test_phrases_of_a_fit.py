"""Every check of a fit has a phrase, and no number of a result depends on one."""

import ast

import pytest
from helpers.robots import ROOT

from lab.core.checks import Check
from lab.render.phrases.fit import listed
from lab.render.phrases.registry import PHRASES, phrase, phrases

MAKERS = {"Check", "_noted", "_failed"}


def names_of_checks() -> set[str]:
    """The names that the modules of ``calibration`` give to checks, read from their sources."""
    calls = (
        node
        for path in (ROOT / "lab" / "calibration").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in MAKERS and node.args
    )
    return {node.args[0].value for node in calls if isinstance(node.args[0], ast.Constant)}


def test_every_check_has_a_phrase() -> None:
    assert names_of_checks() - set(PHRASES) == set()


def test_phrases_are_clauses_with_their_figures_in_the_units_of_a_person() -> None:
    rounded = Check("joints.rounded", "failed", data={"step_rad": 0.017453292519943295, "rms_m": 2.5e-4})
    assert phrase(rounded).startswith("joint positions are rounded to 1°") and "0.25 mm" in phrase(rounded)
    held = Check("outliers.held_out", "failed", data={"count": 1})
    assert phrases([held, rounded]) == (phrase(held), phrase(rounded)) and "1 pose of the hold-out set is" in phrase(
        held
    )
    assert listed(("compliance",)) == ("compliance",)
    with pytest.raises(KeyError):
        phrase(Check("unheard.of", "noted"))
