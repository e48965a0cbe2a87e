"""``lab dynamics``: what of an arm's dynamics its torques determine."""

import json
from pathlib import Path

import pytest

import lab
from lab.cli import main


def test_it_prints_the_base_parameters_and_their_formulas(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dynamics", "--robot", "tx40", "--json", "--out", str(tmp_path / "run")]) == 0
    seen = json.loads(capsys.readouterr().out)
    assert (seen["standard_parameters"], seen["base_parameters"], seen["inertial_base_parameters"]) == (84, 58, 40)
    assert seen["formulas"]["ZZR1"] == "ZZ1 + YY2 + YY3 + Ia1 + 2 d3 MZ3 + (a3² + d3²) (M3 + M4 + M5 + M6)"
    assert "M1" in seen["without_effect"]
    assert json.loads((tmp_path / "run" / "result.json").read_text()) == seen
    page = (tmp_path / "run" / "report.html").read_text()
    assert "XX2 − YY2 − a3² (M3 + M4 + M5 + M6)" in page and "40 parameters of links and motors" in page


def test_parts_of_the_model_can_be_left_out() -> None:
    bare = lab.dynamics("tx40", without=("motor-inertia", "friction", "offsets"))
    assert bare.to_dict()["base_parameters"] == 36
    assert bare.columns()["unit"][0] == "kg m²"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--without", "gears"], "--without gears: there are motor-inertia, friction, offsets"),
        (["--robot", "delta"], "serial arms"),
        (["--robot", "nowhere"], "nowhere"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dynamics", *arguments]) == 2
    told = capsys.readouterr()
    assert says in told.err and told.err.count("\n") == 1
