"""Independent random streams by seed and purpose, and Sobol points.

A stream depends on the seed and its own name alone: drawing more poses does not change the arm. ``scipy.stats.qmc`` has
the same points, but importing it takes longer than drawing a plan's candidates.
"""

from typing import Literal
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array

__all__ = ["MOST_DIMENSIONS", "Purpose", "ScrambledSobol", "rng_for", "seed_of"]

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
    """Return the generator of a purpose, e.g. ``rng_for(7, "noise")``, and of one of many things by its numbers."""
    return np.random.default_rng(_sequence(seed, purpose, *of))


def seed_of(seed: int, purpose: Purpose, *of: int) -> int:
    """Return a seed for one of many things."""
    return int(_sequence(seed, purpose, *of).generate_state(1)[0])


def _sequence(seed: int, purpose: Purpose, *of: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(seed, spawn_key=(crc32(purpose.encode()), *of))


_BITS = 30
_NUMBERS = (  # of each dimension but the first: a primitive polynomial, and the first direction numbers
    (3, 1), (7, 1, 3), (11, 1, 3, 1), (13, 1, 1, 1), (19, 1, 1, 3, 3), (25, 1, 3, 5, 13), (37, 1, 1, 5, 5, 17),
    (41, 1, 1, 5, 5, 5), (47, 1, 1, 7, 11, 19), (55, 1, 1, 5, 1, 1), (59, 1, 1, 1, 3, 11), (61, 1, 3, 5, 5, 31),
    (67, 1, 3, 3, 9, 7, 49), (91, 1, 1, 1, 15, 21, 21), (97, 1, 3, 1, 13, 27, 49), (103, 1, 1, 1, 15, 7, 5),
    (109, 1, 3, 1, 15, 13, 25), (115, 1, 1, 5, 5, 19, 61), (131, 1, 3, 7, 11, 23, 15, 103), (137, 1, 3, 7, 13,
    13, 15, 69), (143, 1, 1, 3, 13, 7, 35, 63), (145, 1, 3, 5, 9, 1, 25, 53), (157, 1, 3, 1, 13, 9, 35, 107),
    (167, 1, 3, 1, 5, 27, 61, 31), (171, 1, 1, 5, 11, 19, 41, 61), (185, 1, 3, 5, 3, 3, 13, 69), (191, 1, 1, 7,
    13, 1, 19, 1), (193, 1, 3, 7, 5, 13, 19, 59), (203, 1, 1, 3, 9, 25, 29, 41), (211, 1, 3, 5, 13, 23, 1, 55),
    (213, 1, 3, 7, 3, 13, 59, 17), (229, 1, 3, 1, 3, 5, 53, 69), (239, 1, 1, 5, 5, 23, 33, 13), (241, 1, 1, 7,
    7, 1, 61, 123), (247, 1, 1, 7, 9, 13, 61, 49), (253, 1, 3, 3, 5, 3, 55, 33), (285, 1, 3, 1, 15, 31, 13, 49,
    245), (299, 1, 3, 5, 15, 31, 59, 63, 97), (301, 1, 3, 1, 11, 11, 11, 77, 249),
)  # fmt: skip
MOST_DIMENSIONS = 1 + len(_NUMBERS)


class ScrambledSobol:
    """Sobol's sequence in a cube, scrambled by random matrices and a random shift.

    The direction numbers are those of Joe and Kuo (2008), the scrambling that of Matoušek (1998).
    """

    def __init__(self, dimensions: int, rng: np.random.Generator) -> None:
        """Begin a sequence of up to ``MOST_DIMENSIONS`` dimensions; refuse more with a LabError."""
        if dimensions > MOST_DIMENSIONS:
            raise LabError(
                f"{dimensions} joints: poses are drawn evenly over up to {MOST_DIMENSIONS}; fix some of them"
            )
        (own,) = rng.spawn(1)
        powers = 1 << np.arange(_BITS, dtype=np.uint32)
        self._shift = _bits(own, (dimensions, _BITS)) @ powers
        mixing = np.tril(_bits(own, (dimensions, _BITS, _BITS)), -1) + np.eye(_BITS, dtype=np.uint32)
        plain = np.array([_directions(k) for k in range(dimensions)], np.uint32)  # (dimensions, bits)
        digits = (
            plain[:, None, :] >> np.arange(_BITS, dtype=np.uint32)[::-1, None] & 1
        )  # the first digit is the largest
        rows = (mixing @ digits & 1) * powers[::-1, None]
        self._directions: NDArray[np.uint32] = rows.sum(axis=1, dtype=np.uint32)
        self._drawn = 0

    def points(self, count: int) -> Array:
        """Return the next ``(count, dimensions)`` points, from 0 to 1; powers of two are most even."""
        rank = np.arange(self._drawn, self._drawn + count)
        self._drawn += count
        gray = rank ^ rank >> 1
        at = np.broadcast_to(self._shift, (count, len(self._shift))).copy()
        for bit in range(int(rank[-1]).bit_length() if count else 0):
            at[gray >> bit & 1 == 1] ^= self._directions[:, bit]
        return at / float(1 << _BITS)


def _bits(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.uint32]:
    return rng.integers(2, size=shape, dtype=np.uint32)


def _directions(dimension: int) -> list[int]:
    """Return direction numbers by the recurrence of Bratley and Fox (1988)."""
    if dimension == 0:
        return [1 << _BITS - 1 - k for k in range(_BITS)]
    polynomial, *odd = _NUMBERS[dimension - 1]
    degree = polynomial.bit_length() - 1
    for _ in range(_BITS - degree):
        following = odd[-degree]
        for k in range(1, degree + 1):
            if polynomial >> degree - k & 1:
                following ^= odd[-k] << k
        odd.append(following)
    return [number << _BITS - 1 - k for k, number in enumerate(odd)]
