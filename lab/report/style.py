"""Colours and fonts of pages, charts and recordings, named by their meaning, and the glossary of symbols.

A page and its figures stand on white, or on near black where a reader prefers it: ``DARK_CHARTS`` and the page's own
style give the colours of charts there. A recording stands on near black, so what is ``BEFORE`` on a page is
``RGB_BEFORE``, a brighter shade of the same hue, in a recording.
"""

import re
from collections.abc import Iterable, Sequence
from typing import Any, Final

__all__ = [
    "AFTER", "ARM", "ARROW_AFTER", "AXIS", "BEFORE", "BOUND", "COLOUR_SCALE", "DARK_CHARTS", "EQUAL_CONTRAST",
    "FIGURE_STYLE", "FONT_MONO", "FONT_SANS", "FRAME_AXES", "GATE", "GRID", "HATCH_AFTER", "HATCH_BEFORE",
    "HIGHLIGHT", "INDEX", "INK", "INSTRUMENT", "MARK_AFTER", "MARK_BEFORE", "MARK_EDGE", "MEASURED", "MUTED",
    "ORDER_SCALE", "OUTLIER", "PAGE_DARK", "PAGE_LIGHT", "PREDICTED", "REFERENCE", "RGB_AFTER", "RGB_ARROW",
    "RGB_AXES", "RGB_BACKDROP", "RGB_BEAM", "RGB_BEFORE", "RGB_CURRENT", "RGB_FIRST", "RGB_FLOOR", "RGB_LAST",
    "RGB_LEG", "RGB_LINKS", "RGB_MAPPING", "RGB_MEASURED", "RGB_MUTED", "RGB_OUTLIER", "RGB_PATH", "RGB_PAYLOAD",
    "RGB_ROD", "RGB_TRACKER", "RGB_UNCERTAINTY", "RMS", "SCALINGS", "SERIES", "TICK", "WORST",
    "explained", "luminance", "rgb",
]  # fmt: skip

_Rgb = tuple[int, int, int]

# Text and lines.
INK: Final = "#1f2937"
REFERENCE: Final = "#111827"  # what others are compared with: the darkest
MUTED: Final = "#6b7280"
TICK: Final = "#374151"
AXIS: Final = "#9ca3af"
GRID: Final = "#e5e7eb"
MARK_EDGE: Final = "#57534e"  # round a mark whose fill may be pale

# Errors and predictions.
BEFORE: Final = "#c8500a"  # calibration; vermilion and a dark blue differ for every eye, and in grey
AFTER: Final = "#0b2a6b"
HATCH_BEFORE, HATCH_AFTER = "////", ""  # of areas, for grey prints
MARK_BEFORE, MARK_AFTER = "s", "o"
MEASURED: Final = "#b7791f"
OUTLIER: Final = "#c2185b"
PREDICTED: Final = "#0f766e"  # by a covariance or by a fit
ARROW_AFTER: Final = "#2563eb"  # a blue that shows on white and on near black
BOUND: Final = PREDICTED  # a tolerance bound
GATE: Final = "#111827"  # the largest error that was asked for
WORST: Final = "#c2410c"
RMS: Final = "#3f8f4f"
INDEX: Final = "#7c3aed"  # an observability index
COLOUR_SCALE: Final = ("#fde68a", "#f97316", "#b91c1c", "#4c0519")  # of lengths, from small to large
ORDER_SCALE: Final = (  # from the first pose of a tour to the last: viridis (Smith and van der Walt 2015)
    "#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725",
)  # fmt: skip
EQUAL_CONTRAST: Final = 0.179  # the luminance on which black and white are read alike, at 4.6 to 1

# The arm.
ARM: Final = "#94a3b8"
HIGHLIGHT: Final = "#1e3a5f"
FRAME_AXES: Final = ("#dc2626", "#15803d", "#1d4ed8")  # x, y, z
INSTRUMENT: Final = "#c2185b"

# Series of one kind: the colours rise in lightness, to differ in grey too; marks and dashes distinguish them as well.
SERIES: Final[tuple[tuple[str, str, Any], ...]] = (
    ("#1e1b4b", "o", "-"),
    ("#9d174d", "s", "--"),
    ("#0369a1", "^", "-."),
    ("#059669", "v", ":"),
    ("#f97316", "D", (0, (5, 1, 1, 1, 1, 1))),
    ("#d4a106", "P", (0, (3, 3))),
    ("#7dd3fc", "x", "-"),
    ("#c7c9cf", "|", "--"),
)
SCALINGS: Final = {  # of parameters, with their marks
    "raw": ("#7f1d1d", "o"),
    "unit": ("#0369a1", "s"),
    "length": ("#ea580c", "^"),
    "whitened": ("#f2b705", "D"),
}

# Recordings.
RGB_BACKDROP: Final[_Rgb] = (30, 33, 40)
RGB_FLOOR: Final = (120, 120, 130, 60)
RGB_AXES: Final[tuple[_Rgb, _Rgb, _Rgb]] = ((230, 70, 70), (90, 190, 90), (80, 130, 240))  # x, y, z
RGB_MEASURED: Final[_Rgb] = (250, 215, 70)
RGB_BEFORE: Final[_Rgb] = (225, 70, 50)  # vermilion and light blue, as dark and as light as on a page
RGB_AFTER: Final[_Rgb] = (130, 205, 255)
RGB_OUTLIER: Final[_Rgb] = (235, 80, 245)
RGB_MAPPING: Final[_Rgb] = (40, 190, 160)
RGB_UNCERTAINTY: Final[_Rgb] = (190, 130, 255)
RGB_BEAM: Final[_Rgb] = (235, 60, 60)
RGB_ROD: Final[_Rgb] = (170, 175, 185)
RGB_TRACKER: Final[_Rgb] = (205, 208, 214)
RGB_LEG: Final[_Rgb] = (242, 97, 15)  # whose length is a joint position
RGB_LINKS: Final[tuple[_Rgb, ...]] = (  # of an arm that bends, and of joints over time, base outward
    (250, 215, 70), (130, 205, 255), (240, 130, 90), (120, 220, 140), (210, 150, 255), (245, 160, 190),
)  # fmt: skip
RGB_ARROW: Final[_Rgb] = (245, 245, 250)  # half-axes, wanted edges
RGB_PATH: Final[_Rgb] = (110, 118, 135)
RGB_CURRENT: Final[_Rgb] = (255, 255, 255)  # where the tour is
RGB_MUTED: Final[_Rgb] = (150, 155, 165)
RGB_FIRST: Final[_Rgb] = (70, 110, 255)  # pose of a tour
RGB_LAST: Final[_Rgb] = RGB_MEASURED
RGB_PAYLOAD: Final[_Rgb] = (60, 205, 130)

# Pages.
FONT_SANS: Final = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, "DejaVu Sans", sans-serif'
FONT_MONO: Final = 'ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono", monospace'
PAGE_LIGHT: Final = {
    "paper": "#ffffff",
    "ink": INK,
    "note": "#4b5563",
    "quiet": MUTED,
    "line": GRID,
    "rule": "#d1d5db",
    "head-line": AXIS,
    "command": "#f3f4f6",
    "before": BEFORE,
    "after": AFTER,
    "good": "#1a7340",
    "doubtful": "#a14a06",
    "bad": "#b3261e",
    "open": "#5b6472",
    "badge-ink": "#ffffff",
    "warning": "#fffbeb",
    "warning-line": "#f0c36d",
    "warning-bar": "#d97706",
}
PAGE_DARK: Final = {
    "paper": "#14171c",
    "ink": "#e5e7eb",
    "note": "#b6bdc9",
    "quiet": "#9aa3b2",
    "line": "#2b313b",
    "rule": "#3a424f",
    "head-line": "#667085",
    "command": "#1f242c",
    "before": "#f5945a",
    "after": "#8fb8ff",
    "good": "#5fc98c",
    "doubtful": "#f0b357",
    "bad": "#f58b82",
    "open": "#9aa3b2",
    "badge-ink": "#14171c",
    "warning": "#2e2613",
    "warning-line": "#6b5320",
    "warning-bar": "#d97706",
}
DARK_CHARTS: Final = {  # a chart's colours on a dark page that are the page's; the others become light or dark there
    "#ffffff": PAGE_DARK["paper"],
    "#000000": PAGE_DARK["ink"],
    INK: PAGE_DARK["ink"],
    GRID: PAGE_DARK["line"],
    BEFORE: PAGE_DARK["before"],
    AFTER: PAGE_DARK["after"],
}

FIGURE_STYLE: Final[Any] = {  # matplotlib's rcParams
    "font.size": 9,
    "font.sans-serif": ["DejaVu Sans", "Arial"],
    "axes.titlesize": 10,
    "axes.labelcolor": INK,
    "axes.edgecolor": AXIS,
    "axes.grid": True,
    "grid.color": GRID,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": TICK,
    "ytick.color": TICK,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "text.parse_math": False,  # names are a user's: a dollar sign is one
    "svg.hashsalt": "lab",  # the same picture, the same bytes
    "svg.fonttype": "none",
}


def rgb(colour: str) -> _Rgb:
    """Return the parts of a colour ``#rrggbb``, 0 to 255."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue


def luminance(parts: Sequence[float]) -> float:
    """Relative luminance, 0 of black to 1 of white, of a colour with parts from 0 to 1 (WCAG 2.2)."""
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return float(0.2126 * red + 0.7152 * green + 0.0722 * blue)


_TERMS = {
    "95 % interval": "A range that holds the true value in 95 of 100 such campaigns.",
    "aliased": "An error of this parameter looks exactly like errors of others, so only these are fitted.",
    "BIC": "Bayesian information criterion: how badly a model fits, with a charge for each parameter; less is better.",
    "condition number": "The ratio of the uncertainties of the worst and the best observed combination of parameters.",
    "cross-validation": "Each pose is predicted by a fit to the others.",
    "degrees of freedom": "How many more numbers were measured than fitted.",
    "gate": "The largest mean error that is acceptable, given by whoever asked for the calibration.",
    "hold-out": "Poses that are measured, but not fitted: the model is validated on them.",
    "identifiable": "Such measurements can tell an error of the parameter from errors of all others.",
    "lack of fit": "The residuals are larger than the noise explains: the model leaves something out.",
    "NEES": "Normalized estimation error squared: near 1 where the stated intervals are right.",
    "nominal": "The model of the drawing, before calibration.",
    "p": "The chance of so large a deviation by noise alone.",
    "residual": "What was measured less what the fitted model predicts.",
    "RMS": "Root mean square.",
    "validation poses": "Poses that were not used to identify.",
    "weakly observable": "Identified, but known no better than to a millimetre or milliradian.",
    "σ": "One standard deviation.",
}


def explained(texts: Iterable[str]) -> tuple[tuple[str, str], ...]:
    """The terms that texts use, each with its explanation, in alphabetical order."""
    whole = "\n".join(texts)
    return tuple(
        (term, meaning)
        for term, meaning in sorted(_TERMS.items(), key=lambda pair: pair[0].casefold())
        if re.search(rf"(?<!\w){re.escape(term)}s?(?!\w)", whole)
    )
