"""Two checkouts' answers are told apart where they differ, and only there; a package's structure is counted."""

import json
import sys
from importlib import util
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
PARAMETER = {"name": "link1.d", "status": "identified", "estimate": 0.3, "std": 1e-5, "interval_95": [0.29998, 0.30002]}
RESULT = {"verdict": "good", "outliers": ["4"], "rank": 27, "residual_mm": 0.0046, "seconds": 1.0, "reason": "p = 0.51"}


def script(name: str) -> ModuleType:
    spec = util.spec_from_file_location(name, ROOT / "scripts" / "maintenance" / f"{name}.py")
    assert spec and spec.loader
    module = util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


reference = script("reference_set")


def made(result: dict[str, Any] | None = None, **parameter: Any) -> dict[str, Any]:
    return {"exit": 0, "result": RESULT | (result or {}), "parameters": [PARAMETER | parameter], "files": {}}


def test_the_same_answers_are_the_same_whatever_time_they_took_and_whatever_was_added() -> None:
    found = reference.difference("identify", made(), made({"seconds": 7.0, "new key": 3.0, "reason": "p = 0.5"}))
    assert found.same and found.estimates == found.intervals == found.numbers == 0 and found.compared == 7


@pytest.mark.parametrize(
    ("other", "decides"),
    [
        (made(estimate=0.3 + 2e-14), False),  # 2e-9 of sigma
        (made(interval_95=[0.29998, 0.30002 + 2e-14]), False),
        (made(estimate=None), False),
        (made(interval_95=None), False),
        (made({"residual_mm": 0.0046 * (1 + 1e-5)}), False),
        (made() | {"exit": 1}, True),
        (made(status="fixed"), True),
        (made({"rank": 26}), True),
        (made({"verdict": "doubtful"}), True),
        (made({"outliers": []}), True),
        (made({"outliers": ["4", "5"]}), True),
        (made({"residual_mm": None}), True),
        (made() | {"parameters": []}, True),
        ({**made(), "result": {key: RESULT[key] for key in RESULT if key != "verdict"}}, True),
    ],
)
def test_a_parameter_that_moved_or_a_decision_that_changed_is_told(other: dict[str, Any], decides: bool) -> None:
    found = reference.difference("identify", made(), other)
    assert not found.same and bool(found.decisions) == decides


def test_numbers_of_files_are_compared_and_their_comments_are_not(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("# 7 rows of p1\nq1_rad,p1_x_mm\n0.5,-1.25e-3\n")
    (tmp_path / "b.py").write_text('"""Version 3."""\nA = (1.5, 2)  # 4\n')
    assert reference.numbers_of(tmp_path / "a.csv") == [0.5, -0.00125]
    assert reference.numbers_of(tmp_path / "b.py") == [1.5, 2.0]


def test_answers_that_are_there_are_compared_without_running_the_commands_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other"
    (other / "lab").mkdir(parents=True)
    (other / "lab" / "__main__.py").touch()
    for side in ("before", "after"):
        (tmp_path / side).mkdir()
        for name in reference.COMMANDS:
            file = tmp_path / side / ("".join(c if c.isalnum() else " " for c in name).replace("  ", " ") + ".json")
            file = file.with_name("-".join(file.stem.split()) + ".answer.json")
            file.write_text(json.dumps(made({"rank": 26} if (side, name) == ("after", "design") else None)))
    code = reference.main([str(ROOT), str(other), "--folder", str(tmp_path), "--data", str(tmp_path), "--json"])
    found = json.loads(capsys.readouterr().out)
    assert code == 1 and len(found) == len(reference.COMMANDS) >= 60
    assert [name for name, each in found.items() if not each["same"]] == ["design"]
