"""Whether what is read of a run's folder is what the run wrote."""

from collections.abc import Sequence
from pathlib import Path

from lab.campaign.config_file import input_names, read_config
from lab.core.errors import LabError
from lab.core.limits import TEXT_BYTES
from lab.core.whole_folder import CHECKSUMS, edited_files
from lab.formats.text_file import read_text

__all__ = ["ACCEPT_EDITED", "is_older", "refuse_edits", "said_of_edits"]

ACCEPT_EDITED = "--accept-edited"


def said_of_edits(folder: Path, names: Sequence[str], *, accept: bool) -> tuple[str, ...]:
    """Refuse files of a run that were changed since it was written, or tell of them where they are accepted.

    A run of an older lab that never had checksums is read with a word about it.

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
    elif is_older(folder):
        return (
            f"{folder}: an older version of the lab made this run, without checksums: nothing tells whether it was "
            f"edited; lab migrate {folder} adds them",
        )
    if not accept:
        raise LabError(f"{folder}: {found}; make the run again, or say {ACCEPT_EDITED} to build on it as it is")
    return (f"{folder}: {found}: built on as it is",)


def refuse_edits(folder: Path) -> None:
    """Refuse a run any file of which was changed since it was written.

    Raises:
        LabError: one was, or the checksums of a run that had some are gone.
    """
    own = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file() and path != folder / CHECKSUMS)
    said_of_edits(folder, sorted({*(path.as_posix() for path in own), *input_names(folder)}), accept=False)


def is_older(folder: Path) -> bool:
    """Whether a lab without versions of the schema made this run."""
    return read_config(folder).schema == 0
