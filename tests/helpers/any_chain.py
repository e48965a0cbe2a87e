"""A serial chain of no special shape, for tests of what holds for every table."""

import numpy as np

from lab.kinematics.serial.chain import Chain, Convention, parallel_links

__all__ = ["random_chain"]


def random_chain(convention: Convention, rng: np.random.Generator) -> Chain:
    """Five joints, a slide among them, with parallel, opposite, square and skew axes, signs and offsets."""
    alpha = np.array([0.0, np.pi, np.pi / 2, 0.7, -np.pi / 2])
    table = np.column_stack([rng.uniform(-3, 3, 5), rng.normal(size=5), rng.normal(size=5), alpha, np.zeros(5)])
    table[1, 0], table[2, 1] = np.pi / 2, 0.0
    return Chain(
        name="any", convention=convention, joint_names=tuple("abcde"), prismatic=(False, False, True, False, False),
        table=table, sign=np.array([1.0, -1, 1, -1, 1]), lower=-np.ones(5), upper=np.ones(5),
        speed=np.full(5, np.nan), acceleration=np.full(5, np.nan), parallel=parallel_links(convention, alpha),
    )  # fmt: skip
