"""The course as a source."""

from lab.extensions.reproduction.course.examples import (
    ARM_ITEMS,
    BASIC_ITEMS,
    MOTION_ITEMS,
    ROTATION_ITEMS,
    VOLUME_ITEMS,
)
from lab.extensions.reproduction.course.machines import CARRIER_ITEMS, PARALLEL_ITEMS, VERSATRAN_ITEMS
from lab.extensions.reproduction.item import Missing, Source

__all__ = ["COURSE"]

COURSE = Source(
    "course",
    "Mallem 2011, geometric and kinematic models of robots (ENSIIE)",
    (
        *VOLUME_ITEMS, *BASIC_ITEMS[:2], *CARRIER_ITEMS, *VERSATRAN_ITEMS, *ARM_ITEMS, *MOTION_ITEMS, *PARALLEL_ITEMS,
        *BASIC_ITEMS[2:], *ROTATION_ITEMS,
    ),
    (
        Missing("Sections 1 to 4", "Robotics, its disciplines, parts and functions", "words and illustrations"),
        Missing("Sections 5.1 to 5.6", "Definitions of the models",
                "no example: the models are computed in sections 7 and 8"),
        Missing("Sections 6.1, 6.2, figures", "Structures drawn",
                "photographs and drawings of makers' arms; their volumes are section 6.1"),
        Missing("Section 9", "Use of the models", "a diagram"),
        Missing("Sections 10.1, 10.2", "Principle and algorithm", "steps in words; section 10.3 is their example"),
        Missing("Sections 11.1, 11.2, 11.4.1 to 11.4.3", "Kinds of joints and robots",
                "tables of symbols and drawings; lab inspect delta, hexapod, rpr3, prr3 and rrr3 have such robots"),
    ),
)  # fmt: skip
