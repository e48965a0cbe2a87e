"""Independent, named streams of random numbers from one seed.

A stream depends on the seed and on its own name alone, so drawing more poses changes
neither the arm nor the fresh poses.
"""

from typing import Literal
from zlib import crc32

import numpy as np

__all__ = ["Purpose", "rng_for", "seed_of"]

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
    "flips",
    "targets",
    "visits",
    "bootstrap",
    "robots",
]


def rng_for(seed: int, purpose: Purpose, *of: int) -> np.random.Generator:
    """The generator of one purpose, e.g. ``rng_for(7, "noise")``; of one thing of many, by its numbers."""
    return np.random.default_rng(_sequence(seed, purpose, *of))


def seed_of(seed: int, purpose: Purpose, *of: int) -> int:
    """A seed of its own for one thing of many."""
    return int(_sequence(seed, purpose, *of).generate_state(1)[0])


def _sequence(seed: int, purpose: Purpose, *of: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(seed, spawn_key=(crc32(purpose.encode()), *of))
