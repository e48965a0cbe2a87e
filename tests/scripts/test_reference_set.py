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


def test_an_exported_arm_is_compared_by_where_its_points_are(tmp_path: Path) -> None:
    model = '{"joint_names": ["q1"], "conditions": {"payload_kg": None}}'
    arm = f"import math\nMODEL = {model}\n\n\ndef forward(joints, **conditions):\n"
    texts = {"a": "2 * joints[0] * conditions['payload_kg']", "b": "joints[0] + joints[0]", "c": "3 * joints[0]"}
    answers = {}
    for name, text in texts.items():
        (tmp_path / f"{name}.py").write_text(f"{arm}    return {{'p1': [{text}]}}\n")
        answers[name] = made() | {"files": {"calibrated.py": reference.numbers_of(tmp_path / f"{name}.py")}}
    assert reference.difference("identify", answers["a"], answers["b"]).same
    assert not reference.difference("identify", answers["a"], answers["c"]).same


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


def test_a_renamed_key_is_compared_with_its_new_name_and_an_unnamed_one_is_missing() -> None:
    before, after = made(), made()
    after["result"] = {("order" if key == "rank" else key): value for key, value in RESULT.items()}
    assert reference.difference("identify, default", before, after, {"identify": {"rank": "order"}}).same
    assert reference.difference("identify", before, after, {"rank": "order"}).same
    assert not reference.difference("identify", before, after, {"design": {"rank": "order"}}).same
    after["result"]["order"] = 26
    assert not reference.difference("identify", before, after, {"rank": "order"}).same


def test_doubled_names_decisions_and_comments_of_a_package_are_counted(tmp_path: Path) -> None:
    modules = {
        "lab/core/one.py": "class Twice:\n    # a step\n    pass\n\n\nclass _Own:\n    text = '# no comment'\n",
        "lab/core/two.py": "class Twice:\n    pass\n\n\nclass _Own:\n    pass\n",
        "lab/report/one.py": "def shown(a):\n" + "".join(f"    if a == {i}:\n        return {i}\n" for i in range(10)),
        "lab/core/few.py": "def few(a):\n" + "".join(f"    if a == {i}:\n        return {i}\n" for i in range(9)),
        "lab/library/drawn.py": "from lab.report.one import shown\n\nSHOWN = [shown(a) for a in range(3) if a]\n",
    }
    for name, text in modules.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    counted = script("structure").structure(tmp_path)
    assert counted["public class names in several modules"] == 1 and counted["lines of comments"] == 1
    assert counted["functions above complexity 10"] == 1 and counted["file names in several rooms"] == 1
    assert counted["lines that parse, print or draw, outside extensions"] == 21 + 3
