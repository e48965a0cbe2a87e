"""Good data of any kind are identified, or refused for what they lack: no set of them is a defect of the lab."""

from pathlib import Path

import numpy as np
import pytest
from helpers.good_data import good_data

from lab.cli.main import main

TOO_FEW = ("too few", "need at least", "leave no residuals")  # the only reasons to refuse good data
QUICK = (17, 21)  # one that is identified within a second, and one that is refused
FOUND = (1031, 1173, 1288)  # sets that were once called a defect of the lab


def wrong_with(seed: int, folder: Path, capfd: pytest.CaptureFixture[str], **sizes: int) -> str | None:
    """What was wrong with how the identification of a random good data set ended, if anything."""
    given = good_data(seed, folder, **sizes)
    given.write(folder)
    with np.errstate(all="ignore"):
        code = main(["identify", *given.options, "--out", "run", "--overwrite"])
    lines = [line for line in capfd.readouterr().err.splitlines() if not line.startswith("lab: warning: ")]
    refused = code == 2 and len(lines) == 1 and any(why in lines[0] for why in TOO_FEW)
    return None if code in (0, 1) or refused else f"code {code}, {lines[:3]}; {given.about}"


@pytest.mark.parametrize(
    "seed",
    [seed if seed in QUICK else pytest.param(seed, marks=pytest.mark.thorough) for seed in (2, 5, 8, *QUICK)],
)
def test_small_good_data_are_identified_or_refused_as_too_few(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """2 to 12 poses, each visited 1 to 4 times."""
    monkeypatch.chdir(tmp_path)
    assert wrong_with(seed, tmp_path, capfd, most_poses=12, most_repeats=4) is None


@pytest.mark.thorough
@pytest.mark.parametrize("seed", FOUND)
def test_good_data_are_identified_or_refused_as_too_few(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """2 to 60 poses, each visited 1 to 12 times."""
    monkeypatch.chdir(tmp_path)
    assert wrong_with(seed, tmp_path, capfd) is None


@pytest.mark.slow
def test_many_good_data_are_identified_or_refused_as_too_few(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert [said for seed in range(1000, 1300) if (said := wrong_with(seed, tmp_path, capfd))] == []
