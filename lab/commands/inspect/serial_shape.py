"""What the shape of an arm says before anything is measured: its reach, the ways to a pose, where it is singular."""

from dataclasses import dataclass

import numpy as np

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.differential import rates
from lab.kinematics.inverse.closed_form import Factor, closed_form_of
from lab.kinematics.reach import reach_from_axis
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.chain import Chain

__all__ = ["LEAST", "shape_of"]

TRIES = 200  # poses from which a singular one is sought
ZERO = 1e-12  # of a factor (m, or a sine)
LEAST = 1e-6  # of a joint's part in a combination


@dataclass(frozen=True)
class Singularity:
    """One way in which an arm is singular.

    Attributes:
        factor: what of the determinant is zero there.
        joints: ``(n,)`` readings of an example; None where there is none within the limits.
        free: ``(k, n)`` combinations of the joints that move nothing in the example, the largest part 1.
    """

    factor: Factor
    joints: Array | None
    free: Array


@dataclass(frozen=True)
class SerialShape:
    """Of a drawing.

    Attributes:
        reach_m: how far the last frame's origin gets from axis 1, within the limits; from frame 0 where joint 1 slides.
        ways: how many readings lead to a pose; None where no closed form is known.
        determinant: of the Jacobian, in words; "" where no closed form is known.
        moved: what motions the determinant is of, in words.
    """

    reach_m: float
    ways: int | None
    determinant: str
    singularities: tuple[Singularity, ...]
    moved: str = ""


def shape_of(chain: Chain) -> SerialShape:
    """The shape of an arm as drawn."""
    form = closed_form_of(chain)
    if form is None:
        return SerialShape(reach_from_axis(chain), None, "", ())
    singularities = tuple(_singularity(chain, factor) for factor in form.determinant.factors if factor.terms)
    return SerialShape(reach_from_axis(chain), form.branches, form.determinant.text, singularities, form.moved)


def _singularity(chain: Chain, factor: Factor) -> Singularity:
    """An example of a singularity within the limits, by Newton's method on its factor."""
    joints = chain.random_joints(TRIES, rng_for(0, "structure"))
    step = 1e-6
    for _ in range(20):
        value = factor.at(joints)
        slope = np.stack(
            [(factor.at(joints + move) - factor.at(joints - move)) / (2 * step) for move in step * np.eye(chain.size)],
            axis=1,
        )
        size = np.maximum((slope**2).sum(axis=1, keepdims=True), 1e-300)
        joints = joints - value[:, None] * slope / size
    fits = (np.abs(factor.at(joints)) < ZERO) & ~chain.beyond_limits(joints, 0.0).any(axis=1)
    if not fits.any():
        return Singularity(factor, None, np.empty((0, chain.size)))
    example = joints[np.flatnonzero(fits)[0]]
    arm = SerialArm(chain)
    found = rates(arm.tool(example[None], arm.nominal())[1], np.zeros((1, 6)))
    free = found.free[0, : chain.size - int(found.rank[0])]
    return Singularity(factor, example, free / np.abs(free).max(axis=1, keepdims=True))
