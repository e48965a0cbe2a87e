"""The error of the lab, its context, and the numbers and names that raise it."""

import pickle

import pytest

import lab
from lab.cli.main import main
from lab.core import errors
from lab.core.errors import LabError, error_context, option_name, options_as_flags
from lab.core.limits import POSES, POSITIVE_OPTION, positive, whole


def test_an_error_gets_its_context_before_it() -> None:
    with pytest.raises(LabError, match=r"^outer: inner: what$"), error_context("outer"), error_context("inner"):
        raise LabError("what")


def test_an_option_is_named_as_its_reader_gives_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(errors, "_as_flags", False)
    assert option_name("noise_mm") == "noise_mm"
    with options_as_flags(), options_as_flags():
        assert option_name("noise_mm") == "--noise-mm"
    assert option_name("noise_mm") == "noise_mm"


def test_a_call_names_arguments_and_its_command_flags(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    """Also after a command ended in an error."""
    monkeypatch.setattr(errors, "_as_flags", False)
    assert main(["calibrate", "--model", "rust"]) == 2
    assert capsys.readouterr().err.startswith("lab: --poses 50: --model rust: no such group")
    with pytest.raises(LabError, match=r"^poses 50: model rust: no such group"):
        lab.calibrate("irb120", model="rust")


@pytest.mark.parametrize(
    ("message", "in_a_call"),
    [
        ("--noise-mm -1: give a number", "noise_mm -1: give a number"),
        ("--holdout and --holdout-last both set it; give one", "holdout and holdout_last both set it; give one"),
        ("day.csv: mend it, or take the right --robot", "day.csv: mend it, or take the right robot"),
        ("run lab history runs --on 2026-01-01, or --force", "run lab history runs --on 2026-01-01, or force"),
        ("my--file.csv: not there; /a/--b neither; 3 -- 4", "my--file.csv: not there; /a/--b neither; 3 -- 4"),
    ],
)
def test_an_error_of_a_call_names_no_flag(message: str, in_a_call: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert str(LabError(message)) == message  # tests run as commands do
    monkeypatch.setattr(errors, "_as_flags", False)
    assert str(LabError(message)) == in_a_call == str(pickle.loads(pickle.dumps(LabError(message))))


def test_other_errors_pass_as_they_are() -> None:
    with pytest.raises(KeyError, match="what"), error_context("outer"):
        raise KeyError("what")


@pytest.mark.parametrize(
    "value", [0.0, -1.0, POSITIVE_OPTION.least / 2, 2 * POSITIVE_OPTION.most, float("nan"), float("inf")]
)
def test_what_is_not_above_zero_is_refused(value: float) -> None:
    with pytest.raises(LabError, match="--noise-mm"):
        positive("--noise-mm", value)


def test_numbers_at_the_ends_are_taken() -> None:
    positive("--noise-mm", POSITIVE_OPTION.least)
    positive("--noise-mm", POSITIVE_OPTION.most)
    whole("--poses", 5, 5, POSES)
    with pytest.raises(LabError, match=r"--poses 4: .* 5 or more"):
        whole("--poses", 4, 5, POSES)
