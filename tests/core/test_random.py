"""Streams of random numbers: each by its seed and name alone."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from lab.core.random import rng_for, seed_of

SEEDS = st.integers(0, 2**32 - 1)


@given(SEEDS, st.integers(0, 1000))
def test_a_stream_is_of_its_seed_name_and_number_alone(seed: int, number: int) -> None:
    draws = [rng_for(seed, "noise", number).standard_normal(4) for _ in range(2)]
    np.testing.assert_array_equal(*draws)
    others = rng_for(seed, "poses", number), rng_for(seed + 1, "noise", number), rng_for(seed, "noise", number + 1)
    assert all((rng.standard_normal(4) != draws[0]).any() for rng in others)


@given(SEEDS)
def test_seeds_of_many_things_differ(seed: int) -> None:
    seeds = [seed_of(seed, "robots", i) for i in range(50)]
    assert len(set(seeds)) == 50 and seeds == [seed_of(seed, "robots", i) for i in range(50)]
