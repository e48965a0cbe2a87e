"""What the shape of a mechanism with loops says before anything is measured: freedoms, places, what is singular."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extension_points import load_all
from lab.kinematics.closed.configuration import Configuration
from lab.kinematics.closed.mechanism import Mechanism, platform_poses
from lab.kinematics.closed.mobility import ClosedFormShape
from lab.kinematics.joints import JointSpec
from lab.kinematics.reach import extents

__all__ = ["ClosedShape", "closed_shape_of"]

TAKES = 4000  # random readings by which extents are found
RANK = 1e-9  # of the largest singular value


@dataclass(frozen=True)
class ClosedShape:
    """Of a drawing, in the drawn mode.

    Attributes:
        mobility: joints and passive values less the closures' equations.
        freedoms: joints and passive values less the rank of what they do to the closures at home.
        closed_form: what its closed form says, if it has one.
        share: of readings within the limits those at which the loops close.
        extents: ``(3, 2)`` least and largest coordinates (m) of the platform's origin in the base.
        conditions: of the closures by the passive values: the least, the middle and the largest.
    """

    mobility: int
    freedoms: int
    closed_form: ClosedFormShape | None
    share: float
    extents: Array
    conditions: Array


def closed_shape_of(mechanism: Mechanism) -> ClosedShape:
    """The shape of a mechanism as drawn."""
    taken = JointSpec.random_joints(mechanism, TAKES, rng_for(0, "structure"))
    closed = mechanism.assembled(taken, mechanism.nominal_values)
    joints, passive = taken[closed.fits], closed.configuration.passive.T[closed.fits]
    home = mechanism.assembled(mechanism.home[None], mechanism.nominal_values).configuration
    shapes = (find(mechanism, joints, passive) for find in load_all("lab.shapes").values())
    form: ClosedFormShape | None = next((shape for shape in shapes if shape is not None), None)
    others = () if form is None else [each.place for each in form.singularities]
    return ClosedShape(
        mobility=mechanism.size + len(mechanism.tree.passive) - mechanism.tree.equations,
        freedoms=mechanism.size + len(mechanism.tree.passive) - _rank(home),
        closed_form=form,
        share=float(closed.fits.mean()),
        extents=_extents(mechanism, joints, _places(mechanism, joints, passive), others),
        conditions=np.quantile(closed.condition[closed.fits], [0.0, 0.5, 1.0]),
    )


def _extents(mechanism: Mechanism, joints: Array, places: Array, others: Sequence[Array]) -> Array:
    """The least and largest coordinates ``(3, 2)`` m of the platform's origin, within the limits."""

    def places_of(tried: Array) -> Array:
        closed = mechanism.assembled(tried, mechanism.nominal_values, quickly=True)
        fits, found = closed.fits, np.full((len(tried), 3), np.nan)
        found[fits] = _places(mechanism, tried[fits], closed.configuration.passive.T[fits])
        return found

    return extents(mechanism, places_of, joints, places, others)


def _places(mechanism: Mechanism, joints: Array, passive: Array) -> Array:
    """Of the platform's origin in the base ``(n, 3)`` m."""
    return platform_poses(mechanism, joints, passive)[:, :3, 3]


def _rank(configuration: Configuration) -> int:
    """Of the closures' derivatives by all that moves, in a configuration of one pose."""
    tree, directions = configuration.tree, configuration.closures()[1]
    rows = np.zeros((tree.equations, len(tree.passive) + len(configuration.joint_values)))
    for i, opening in enumerate(tree.openings):
        for step, end, sign in opening:
            described = tree.step(*step)
            if described.passive or described.joint is not None:
                slope = configuration.slope(step, configuration.frames[end][1], directions[i])
                moved = tree.passive.index(step) if described.joint is None else len(tree.passive) + described.joint
                rows[i, moved] += sign * float(np.ravel(slope)[0])
    for i, rod in enumerate(tree.rods):
        if rod.joint is not None:
            rows[i, len(tree.passive) + rod.joint] -= 1.0
    sizes = np.linalg.svd(rows, compute_uv=False)
    return int((sizes > RANK * sizes.max(initial=0.0)).sum())
