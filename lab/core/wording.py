"""Counts in sentences: one pose is, two poses are."""

__all__ = ["be", "counted"]


def counted(count: int, noun: str) -> str:
    """A count and what it counts: ``1 pose``, ``12,000 poses``; the plural takes an s."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def be(count: int) -> str:
    """The verb that fits a count: ``is`` or ``are``."""
    return "is" if count == 1 else "are"
