"""Independent, named streams of random numbers from one seed.

A stream depends on the seed and on its own name alone, so drawing more poses changes
neither the arm nor the fresh poses.
"""

from typing import Literal
from zlib import crc32

import numpy as np

Purpose = Literal[
    "arm",
    "tracker",
    "poses",
    "noise",
    "fresh",
    "split",
    "structure",
    "candidates",
    "design",
    "promise",
    "tour",
    "effects",
    "conditions",
    "touched",
    "places",
    "null",
    "targets",
    "visits",
]


def stream(seed: int, purpose: Purpose) -> np.random.Generator:
    """The generator of one purpose, e.g. ``stream(7, "noise")``."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(crc32(purpose.encode()),)))
