"""Whether what is read of a run's folder is what the run wrote."""

from collections.abc import Sequence
from pathlib import Path

from lab.core.errors import LabError
from lab.core.limits import TEXT_BYTES
from lab.core.whole_folder import CHECKSUMS, edited_files
from lab.formats.text_file import read_text

__all__ = ["ACCEPT_EDITED", "said_of_edits"]

ACCEPT_EDITED = "--accept-edited"


def said_of_edits(folder: Path, names: Sequence[str], *, accept: bool) -> tuple[str, ...]:
    """Refuse files of a run that were changed since it was written, or, where they are accepted, what to tell of them.

    Args:
        names: of the files that matter, as far as they are there.

    Raises:
        LabError: they are not accepted.
    """
    found = "its checksums are missing"
    if (folder / CHECKSUMS).is_file():
        edited = edited_files(folder, read_text(folder / CHECKSUMS, TEXT_BYTES), names)
        if not edited:
            return ()
        found = f"{', '.join(edited)} {'was' if len(edited) == 1 else 'were'} changed since the run was written"
    if not accept:
        raise LabError(f"{folder}: {found}; make the run again, or say {ACCEPT_EDITED} to build on it as it is")
    return (f"{folder}: {found}: built on as it is",)
