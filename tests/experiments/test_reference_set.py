"""Two checkouts' answers are told apart where they differ, and only there."""

import json
from pathlib import Path
from typing import Any

import pytest

from lab.core.errors import LabError
from lab.experiments.reference_set import COMMANDS, Options, answer, difference

ROOT = Path(__file__).parents[2]
PARAMETER = {"name": "link1.d", "status": "identified", "estimate": 0.3, "std": 1e-5, "interval_95": [0.29998, 0.30002]}
RESULT = {"verdict": "good", "outliers": ["4"], "rank": 27, "residual_mm": 0.0046, "seconds": 1.0, "reason": "p = 0.51"}


def made(result: dict[str, Any] | None = None, **parameter: Any) -> dict[str, Any]:
    return {"result": RESULT | (result or {}), "parameters": [PARAMETER | parameter]}


def test_the_same_answers_are_the_same_whatever_time_they_took_and_whatever_was_added():
    found = difference("identify", made(), made({"seconds": 7.0, "new key": 3.0, "reason": "p = 0.5"}))
    assert found.same and found.estimates == found.intervals == found.numbers == 0
    assert found.words == ("/reason",)


@pytest.mark.parametrize(
    ("other", "decides"),
    [
        (made(estimate=0.3 + 2e-14), False),  # 2e-9 of sigma
        (made(interval_95=[0.29998, 0.30002 + 2e-14]), False),
        (made(estimate=None), False),
        (made(interval_95=None), False),
        (made(status="fixed"), True),
        (made({"verdict": "doubtful"}), True),
        (made({"outliers": []}), True),
        (made({"outliers": ["4", "5"]}), True),
        (made({"rank": 26}), True),
        (made({"residual_mm": None}), True),
        (made() | {"parameters": []}, True),
    ],
)
def test_a_parameter_that_moved_or_a_decision_that_changed_is_told(other: dict[str, Any], decides: bool):
    found = difference("identify", made(), other)
    assert not found.same and bool(found.decisions) == decides


def test_less_than_the_bound_is_the_same_and_its_size_is_told():
    found = difference("identify", made(), made({"residual_mm": 0.0046 * (1 + 1e-6)}, estimate=0.3 + 5e-15))
    assert found.same and found.estimates == pytest.approx(5e-10, rel=0.02)
    assert found.numbers == pytest.approx(1e-6, rel=1e-3) and found.where == "/residual_mm"


def test_answers_that_are_there_are_compared_without_running_the_commands_again(tmp_path: Path):
    for side in ("before", "after"):
        (tmp_path / side).mkdir()
        for name in COMMANDS:
            file = tmp_path / side / (name.replace(", ", "-").replace(" ", "-") + ".json")
            changed = {"rank": 26} if (side, name) == ("after", "design") else None
            file.write_text(json.dumps(made(changed)))
    found = answer(Options(ROOT, ROOT, tmp_path, tmp_path))
    assert len(COMMANDS) == 40 and found.document.title.startswith("39 of 40")
    assert [name for name, each in found.values.items() if not each["same"]] == ["design"]


def test_a_folder_that_is_no_checkout_is_told(tmp_path: Path):
    with pytest.raises(LabError, match="nowhere is no checkout of the lab"):
        answer(Options(ROOT, tmp_path / "nowhere", tmp_path / "runs", tmp_path))


def test_a_command_that_fails_is_told_with_its_checkout(tmp_path: Path):
    (tmp_path / "lab").mkdir()
    (tmp_path / "lab" / "__init__.py").touch()
    (tmp_path / "lab" / "__main__.py").write_text("raise SystemExit('lab: out of order')")
    with pytest.raises(LabError, match=f"calibrate --out .* with {tmp_path}: lab: out of order"):
        answer(Options(tmp_path, tmp_path, tmp_path / "runs", tmp_path))
