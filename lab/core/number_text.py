"""Write numbers and sentences as people read them."""

from math import floor, isfinite, log10

__all__ = ["capital", "digits_of", "fixed", "format_magnification", "plus_minus", "sentence", "short"]


def short(value: float | None, unit: str = "") -> str:
    """Three significant digits, with a unit where one is given; a dash for None."""
    if value is None:
        return "–"
    if value == 0:
        text = "0"
    elif abs(value) < 1e-4:
        text = f"{value:.1e}"
    else:
        text = f"{value:,.0f}" if abs(value) >= 1000 else f"{value:#.3g}".rstrip(".")
    return text.replace("-", "−") + (f" {unit}" if unit else "")


def fixed(value: float, digits: int, *, signed: bool = False) -> str:
    """A number with ``digits`` digits after the point."""
    return f"{value:{'+' if signed else ''}z.{digits}f}".replace("-", "−")  # z: no −0


def digits_of(half_width: float, most: int) -> int:
    """Return the number of decimals of a value: two digits of its interval's half-width, ``most`` at most.

    A half-width that is zero or not finite leaves ``most``.
    """
    if not (isfinite(half_width) and half_width > 0):
        return most
    return min(max(1 - floor(log10(half_width)), 0), most)


def plus_minus(half_width: float, digits: int) -> str:
    """Half of an interval, ``± 0.0038``, with the ``digits`` of its value; three significant where those are fewer."""
    says_enough = digits >= digits_of(half_width, digits + 1)
    return f"± {fixed(half_width, digits) if says_enough else short(half_width)}"


def format_magnification(factor: float) -> str:
    """A magnification, as ``× 10,000``."""
    return f"× {factor:,.0f}" if factor >= 1 else f"× {factor:g}"


def capital(text: str) -> str:
    """The text with a capital first letter; the name of a parameter or a file, ``link4.theta``, stays as it is."""
    first = text.partition(" ")[0]
    is_name = "." in first.rstrip(".") and not first.endswith(".")
    return text if is_name else text[:1].upper() + text[1:]


def sentence(text: str) -> str:
    """The text with a capital first letter and a full stop, where it does not end a sentence already."""
    return capital(text) + "." * (not text.endswith((".", "?", "!")))
