"""The thesis as a source: its items in the order of the text, and what cannot be computed."""

from lab.extensions.reproduction.item import Missing, Source
from lab.extensions.reproduction.thesis.calibration import CALIBRATION_ITEMS, CURVE_ITEMS, INDEX_ITEMS
from lab.extensions.reproduction.thesis.model import MODEL_ITEMS

__all__ = ["THESIS"]

_BEFORE_CURVES = next(i for i, item in enumerate(CALIBRATION_ITEMS) if item.number == "Table IV.2")

THESIS = Source(
    "thesis",
    "Mahdadi and Bouafia 2020, a comparative study of observability indices for robot calibration (M'sila)",
    (*INDEX_ITEMS, *MODEL_ITEMS, *CALIBRATION_ITEMS[:_BEFORE_CURVES], *CURVE_ITEMS,
     *CALIBRATION_ITEMS[_BEFORE_CURVES:]),
    (
        Missing("Figures I.1, I.2, I.3, I.5", "Robots", "photographs"),
        Missing("Figure I.4", "Workspaces of the IRB 140 and 2400",
                "makers' drawings of arms whose tables are not given"),
        Missing("Table I.1", "Parallel and serial robots compared", "words that order the two kinds; no numbers"),
        Missing("Figures I.6, I.7", "Accuracy and repeatability, sources of errors", "illustrations"),
        Missing("Equations II.1 to II.3, IV.1 to IV.6", "Notation",
                "definitions without a value; used in the items above"),
        Missing("Figures III.2 to III.5, III.8, III.9", "Frames and joints",
                "illustrations; their numbers are table III.2"),
        Missing("Equations III.3, III.4, III.14, III.16, III.17, III.20, III.29", "Products of link matrices",
                "statements of what is multiplied; the results are the items above"),
        Missing("Equation IV.11", "The change of a link's matrix", "notation"),
    ),
)  # fmt: skip
