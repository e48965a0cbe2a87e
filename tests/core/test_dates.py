"""Days as options name them."""

from datetime import date

import pytest

from lab.core.errors import LabError
from lab.core.limits import day


def test_a_day_is_read() -> None:
    assert day("--date", "2028-02-29") == date(2028, 2, 29)


ELSEWHERE = "٢٠٢٦-٠٣-٠١"


@pytest.mark.parametrize(
    "text", ["2026-13-01", "2027-02-29", "1.3.2026", "20260301", "2026-W10-1", "2026-3-1", ELSEWHERE, "", "yesterday"]
)
def test_what_is_no_day_is_refused(text: str) -> None:
    with pytest.raises(LabError, match="is no day; write it as 2026-03-01"):
        day("--date", text)
