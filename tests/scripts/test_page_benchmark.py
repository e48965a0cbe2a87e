"""The benchmark of pages, on its smallest one."""

import pytest
from page_benchmark import PAGES, Options, answer

from lab.core.errors import LabError


def test_a_page_is_timed_and_weighed(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        for name in [each for each in PAGES if not each.startswith("inspect")]:
            patch.delitem(PAGES, name)
        (found,) = answer(Options(times=1)).values.values()
    assert found["first_s"] >= 0 and found["later_s"] >= 0 and 0.005 < found["size_mb"] < 2 and found["scene"]
    with pytest.raises(LabError, match="--times 0"):
        answer(Options(times=0))
