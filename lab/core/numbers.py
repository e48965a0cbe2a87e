"""Numbers that make no sense are refused, with the flag that gave them."""

from lab.core.errors import LabError
from lab.core.limits import Limit
from lab.core.ranges import POSITIVE_OPTION

__all__ = ["positive", "whole"]


def whole(flag: str, value: int, least: int, most: Limit) -> None:
    """Refuse a count that is too small or too large.

    Raises:
        LabError: ``value`` is below ``least``, or above the limit.
    """
    if value < least:
        raise LabError(f"{flag} {value}: give a whole number of {least} or more")
    most(flag, value)


def positive(flag: str, value: float) -> None:
    """Refuse what is not above zero, or is too large to be meant.

    Raises:
        LabError: ``value`` is outside ``POSITIVE_OPTION``.
    """
    if value not in POSITIVE_OPTION:
        least, most = POSITIVE_OPTION.least, POSITIVE_OPTION.most
        raise LabError(f"{flag} {value:g}: give a number above zero, from {least:g} to {most:g}")
