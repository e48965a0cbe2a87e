"""Serial numbers: the identity of one arm among several of the same model."""

from collections.abc import Mapping

from lab.core.errors import LabError
from lab.core.limits import LINE_OF_TEXT

__all__ = ["called", "check_serial", "one_serial"]


def check_serial(serial: str | None) -> None:
    """Refuse an option ``--serial`` that is empty, longer than a line, or not printable, with a LabError."""
    if serial is None:
        return
    if len(serial) > LINE_OF_TEXT.most or not serial.isprintable() or serial != serial.strip() or not serial:
        raise LabError(
            f"--serial {serial!r}: give one line of 1 to {LINE_OF_TEXT.most} characters, without blanks around"
        )


def called(robot: str, serial: str | None) -> str:
    """Return how a person names the arm: its model, and its serial number where that is known."""
    return robot if serial is None else f"{robot} {serial}"


def one_serial(serials: Mapping[str, str | None], mend: str) -> str | None:
    """Return the serial number that several sources share; None where none of them states one.

    Args:
        serials: by the source's name, as an error gives it, the serial number that it states.
        mend: what to do where they differ, for the end of the message.

    Raises:
        LabError: two sources state different ones.
    """
    stated = [(where, serial) for where, serial in serials.items() if serial is not None]
    for where, serial in stated[1:]:
        if serial != stated[0][1]:
            raise LabError(f"{where}: names the arm {serial}, but {stated[0][0]} names {stated[0][1]}; {mend}")
    return stated[0][1] if stated else None
