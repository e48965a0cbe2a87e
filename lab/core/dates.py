"""Days as people write them in options and files: YYYY-MM-DD."""

import re
from datetime import date

from lab.core.errors import LabError

__all__ = ["day"]

_FORM = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}")


def day(where: str, text: str) -> date:
    """The day that a text names.

    Args:
        where: the option or file that holds it.

    Raises:
        LabError: it is no day in the form YYYY-MM-DD.
    """
    try:
        if not _FORM.fullmatch(text):  # ISO 8601 has others, which a reader would have to know
            raise ValueError
        return date.fromisoformat(text)
    except ValueError:
        raise LabError(f"{where} {text}: is no day; write it as 2026-03-01") from None
