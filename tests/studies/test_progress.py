"""Studies one after another into folders, each on with what is there."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from study_runs import study_runner

from lab.studies.grid import Study


def test_a_study_that_is_there_is_not_computed_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("study_runs.local_executor", lambda workers: ThreadPoolExecutor(1))
    study = Study(name="small", robots=2, draws=2, fresh=10, factors={"criterion": ("random",), "poses": (12,)})
    with study_runner(1) as run:
        campaigns, first = run(study, tmp_path / "below" / "study")
        again, second = run(study, tmp_path / "below" / "study")
    assert (first.computed, second.computed) == (4, 0)
    assert len(campaigns.columns["fresh_mean_mm"]) == 4
    assert (campaigns.columns["fresh_mean_mm"] == again.columns["fresh_mean_mm"]).all()
