"""Files of every kind, valid ones with something changed: each is read, or refused in one line; nothing else happens.

The long run (``-m slow``) tries as many as ``LAB_FUZZ`` says.
"""

import os
import resource
from pathlib import Path

import numpy as np
import pytest
from helpers.file_kinds import KINDS, STUDY
from helpers.fuzzing import RandomChance, changed, mutated
from helpers.time_limit import ends
from hypothesis import HealthCheck, given, settings

from lab.core.errors import LabError
from lab.options.option_groups import Effects
from lab.studies.grid import read_study

MOST_KIB = 1 << 20


def read_or_refused(kind: str, content: bytes, folder: Path) -> None:
    path = folder / KINDS[kind].name
    path.write_bytes(content)
    try:
        with np.errstate(all="ignore"), ends():
            KINDS[kind].read(path)
    except LabError as error:
        assert "\n" not in str(error).strip() and str(error).strip()
    assert [each.name for each in folder.iterdir()] == [path.name]  # no log


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_as_it_should_be_is_read(kind: str, tmp_path: Path) -> None:
    path = tmp_path / KINDS[kind].name
    path.write_bytes(KINDS[kind].text().encode())
    assert KINDS[kind].read(path) is not None


@pytest.mark.thorough
@pytest.mark.parametrize("kind", KINDS)
def test_a_changed_file_is_read_or_refused(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)

    @settings(max_examples=15, suppress_health_check=list(HealthCheck))
    @given(content=changed(KINDS[kind].text()))
    def tried(content: bytes) -> None:
        read_or_refused(kind, content, tmp_path)

    tried()


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_many_changed_files_are_read_or_refused(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is not handled is named by its seed: ``mutated(KINDS[kind].text(), RandomChance(seed))`` makes it again."""
    monkeypatch.chdir(tmp_path)
    text, wrong = KINDS[kind].text(), dict[str, str]()
    for seed in (f"{kind} {i}" for i in range(int(os.environ.get("LAB_FUZZ", "1000")))):
        try:
            read_or_refused(kind, mutated(text, RandomChance(seed)), tmp_path)
        except Exception as error:
            wrong[seed] = f"{type(error).__name__}: {error}"[:200]
    assert not wrong
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < MOST_KIB


def test_effects_of_a_study_are_the_options_of_a_campaign(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(STUDY)
    assert read_study(tmp_path / "s.toml").effects["soft"] == Effects(stiffness_nm_per_rad=1e5)
