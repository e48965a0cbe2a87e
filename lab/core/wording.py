"""Counts and lengths in sentences: one pose is, two poses are, 3 mm."""

__all__ = ["be", "counted", "short_length"]


def counted(count: int, noun: str) -> str:
    """A count and what it counts: ``1 pose``, ``12,000 poses``; the plural takes an s."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def be(count: int) -> str:
    """The verb that fits a count: ``is`` or ``are``."""
    return "is" if count == 1 else "are"


def short_length(length_m: float) -> str:
    """A length with two digits: ``52 µm``, ``590 µm``, ``1.5 mm``."""
    size, unit = (1e6 * length_m, "µm") if length_m < 0.95e-3 else (1e3 * length_m, "mm")
    return f"{float(f'{size:.2g}'):g} {unit}"
