"""Colours that everyone can tell: before from after with normal sight, without red or green cones, and in grey."""

import numpy as np
import pytest

from lab.render import style

SRGB_TO_LMS = np.array([[17.8824, 43.5161, 4.11935], [3.45565, 27.1554, 3.86714], [0.0299566, 0.184309, 1.46709]])
BLIND = {  # Viénot, Brettel & Mollon 1999
    "nobody": np.eye(3),
    "deuteranope": np.array([[1, 0, 0], [0.494207, 0, 1.24827], [0, 0, 1]]),
    "protanope": np.array([[0, 2.02344, -2.52581], [0, 1, 0], [0, 0, 1]]),
}


def linear(colour: str) -> np.ndarray:
    """Linear RGB of a colour."""
    values = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def seen_by(colour: str, eye: str) -> np.ndarray:
    """Linear RGB that a person without one kind of cones sees."""
    seen = np.linalg.inv(SRGB_TO_LMS) @ BLIND[eye] @ SRGB_TO_LMS @ linear(colour)
    return np.clip(seen, 0, 1)


def contrast(first: np.ndarray, second: np.ndarray) -> float:
    """WCAG 2 contrast of two linear colours."""
    low, high = sorted(float(each @ [0.2126, 0.7152, 0.0722]) for each in (first, second))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("eye", BLIND)
@pytest.mark.parametrize("page", [style.PAGE_LIGHT, style.PAGE_DARK], ids=["light", "dark"])
def test_before_and_after_are_told_apart(eye: str, page: dict) -> None:
    """By their luminance alone, that is in grey, and by their colour beside it."""
    before, after = (seen_by(page[name], eye) for name in ("before", "after"))
    if page is style.PAGE_LIGHT:
        assert contrast(before, after) >= (2.8 if eye == "nobody" else 2.0)  # red and green had 1.15
    assert before[0] > before[2] and after[2] > after[0]  # one is orange or yellow, the other blue


@pytest.mark.parametrize("page", [style.PAGE_LIGHT, style.PAGE_DARK], ids=["light", "dark"])
def test_words_can_be_read(page: dict) -> None:
    paper = linear(page["paper"])
    for name in ("ink", "note", "quiet", "before", "after"):
        assert contrast(linear(page[name]), paper) >= 4.5, name
    for name in ("good", "doubtful", "bad", "open"):
        assert contrast(linear(page[name]), linear(page["badge-ink"])) >= 4.5, name


def test_figures_use_the_colours_of_the_page() -> None:
    assert (style.PAGE_LIGHT["before"], style.PAGE_LIGHT["after"]) == (style.BEFORE, style.AFTER)
    assert style.HATCH_BEFORE != style.HATCH_AFTER and style.MARK_BEFORE != style.MARK_AFTER


@pytest.mark.parametrize("eye", BLIND)
def test_before_and_after_are_told_apart_in_recordings(eye: str) -> None:
    """Arrows on a near black ground: by luminance, and by which of red and blue is more."""
    before, after = (
        seen_by("#{:02x}{:02x}{:02x}".format(*colour), eye) for colour in (style.RGB_BEFORE, style.RGB_AFTER)
    )
    assert contrast(before, after) >= (2.0 if eye == "nobody" else 1.5)
    assert before[0] > before[2] and after[2] > after[0]
