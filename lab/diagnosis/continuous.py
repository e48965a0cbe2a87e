"""Continuous mistakes: columns of what steps, drifts, scales and couples, beside a fit of an arm."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lab.calibration.guess import columns_of
from lab.core.measurements import Measurements, setups
from lab.core.se3 import Array
from lab.diagnosis.hypothesis import Hypothesis
from lab.kinematics.model import Model

__all__ = ["FITTED_ANYWAY", "Space", "Steps", "lasting_mistakes", "moves_before", "steps_of"]

FITTED_ANYWAY = ("link", "joint_zero")  # parameters of every fit: only their size is a finding
_ZERO = re.compile(r"link([1-9]\d*)\.theta")
_SHEARS = ((0, 1), (0, 2), (1, 2))


@dataclass(frozen=True)
class Steps:
    """One thing that may move at any row, from which on its columns count.

    Attributes:
        hypothesis: with the columns ``(n, k, d, c)`` as if it had moved before the first row.
    """

    hypothesis: Hypothesis

    def before(self, row: int, ids: Sequence[str], tried: int) -> Hypothesis:
        """Return the hypothesis that it moved before a row, without columns."""
        of = (*self.hypothesis.of, ids[row - 1], ids[row])
        data = (*self.hypothesis.data, ("row", row))
        return replace(self.hypothesis, of=of, alternatives=tried, columns=None, data=data)

    def from_row(self, row: int, ids: Sequence[str], tried: int) -> Hypothesis:
        """Return the hypothesis that it moved before a row, with its columns."""
        columns = self.hypothesis.columns
        assert columns is not None
        after = np.arange(len(columns)) >= row
        return replace(self.before(row, ids, tried), columns=np.where(after[:, None, None, None], columns, 0.0))


def steps_of(model: Model, jacobian: Array, slopes: Array, joint_names: Sequence[str]) -> Iterator[Steps]:
    """Yield what may step: base, tool, single targets, joint zeros.

    Args:
        jacobian: ``(n, k, d, p)`` derivatives of the observed numbers.
        slopes: ``(n, k, d, joints)`` those by the joint positions.
    """
    base, tool = columns_of(model, ("base",)), columns_of(model, ("tool",))
    if len(base) >= 6:
        units = ("m", "m", "m", "rad", "rad", "rad")
        moved = Hypothesis("base_step", columns=jacobian[..., list(base[:6])], units=units)
        yield Steps(moved)
    places = [i for i in tool if model.parameters[i].symbol in ("x", "y", "z")]
    if len(places) >= 3:
        each = [jacobian[..., places[first : first + 3]] for first in range(0, len(places), 3)]
        yield Steps(Hypothesis("tool_step", columns=sum(each[1:], start=each[0]), units=("m",) * 3))
        for of, columns in enumerate(each if len(each) > 1 else []):
            name = model.parameters[places[3 * of]].target
            yield Steps(Hypothesis("target_step", (name,), columns=columns, units=("m",) * 3))
    for joint, name in enumerate(joint_names):
        column = slopes[..., joint : joint + 1]
        yield Steps(Hypothesis("joint_step", (name,), columns=column, units=("rad",)))


@dataclass(frozen=True)
class Space:
    """Observed things as they are predicted, of which some are positions in a measured space.

    Attributes:
        predicted: ``(n, k, d)``.
        placed: ``(k,)`` which things are positions (m).
        times: ``(n,)`` of the rows, over a span of one.
        base: ``(3,)`` place of the arm's base in it, about which the arm grows; None where nobody knows it.
        is_centred: whether base, tool and zeros are fitted: else mistakes are about the zero of joints and frame.
        moved: ``(n, k, d, c)`` derivatives by a motion of the base; None where it is not placed.
    """

    predicted: Array
    placed: NDArray[np.bool_]
    times: Array
    base: Array | None = None
    is_centred: bool = True
    moved: Array | None = None

    def mistakes(self) -> Iterator[Hypothesis]:
        """Yield mistakes of the measured space: scale, shear, drift and growth."""
        if not self.placed.any():
            return
        points = np.zeros(self.predicted.shape)
        points[:, self.placed] = self.predicted[:, self.placed]
        if self.is_centred:
            points[:, self.placed] -= points[:, self.placed].mean(axis=(0, 1))
        yield Hypothesis("scale", columns=points[..., None], units=("1",))
        sheared = np.zeros((*points.shape, 5))
        for column, (a, b) in enumerate(_SHEARS):
            sheared[..., a, column] = points[..., b]
            sheared[..., b, column] = points[..., a]
        sheared[..., 0, 3], sheared[..., 1, 3] = points[..., 0], -points[..., 1]
        sheared[..., 2, 4], sheared[..., 0, 4] = 2 * points[..., 2], -points[..., 0]
        sheared[..., 1, 4] = -points[..., 1]
        yield Hypothesis("shear", columns=sheared, units=("1",) * 5)
        at = self.times[:, None, None, None]
        if self.moved is None:
            yield Hypothesis("drift", columns=at * np.eye(3) * self.placed[:, None, None], units=("m",) * 3)
        else:
            yield Hypothesis("drift", columns=at * self.moved, units=("m", "m", "m", "rad", "rad", "rad"))
        grown = points if self.base is None else (self.predicted - self.base) * self.placed[:, None]
        yield Hypothesis("growth", columns=at * grown[..., None], units=("1",))


def lasting_mistakes(
    model: Model, jacobian: Array, slopes: Array, rows: Measurements, space: Space, moves: Array | None = None
) -> Iterator[Hypothesis]:
    """Yield mistakes that last for the whole campaign.

    Args:
        moves: ``(n, joints)`` from the pose measured before each row; None where nobody knows them.
    """
    names = rows.joint_names
    about = rows.joints - rows.joints.mean(axis=0) if space.is_centred else rows.joints
    yield from _gains(names, slopes, about)
    if moves is not None and (moving := np.flatnonzero(moves.any(axis=0))).size:
        lag, of_moving = slopes[..., moving] * moves[:, None, None, moving], tuple(names[j] for j in moving)
        units, most = ("1",) * len(moving), (1.0,) * len(moving)
        yield Hypothesis("joint_lag", columns=lag, units=units, largest=most, data=(("joints", of_moving),))
    links = [(i, each) for i, each in enumerate(model.parameters) if each.is_link]
    for i, each in links:
        zero = _ZERO.fullmatch(each.name)
        name, of = ("joint_zero", names[int(zero[1]) - 1]) if zero else ("link", each.name)
        column = jacobian[..., i : i + 1]
        yield Hypothesis(name, (of,), len(links), columns=column, units=(each.unit.si,))
    yield from space.mistakes()


def _gains(names: Sequence[str], slopes: Array, about: Array) -> Iterator[Hypothesis]:
    """Yield joints whose readings are too large by a share of themselves, or of another joint's."""
    count = len(names)
    pairs = count * (count - 1)
    for a in range(count):
        for b in range(count):
            made = slopes[..., a : a + 1] * about[:, None, None, b : b + 1]
            if a == b:
                yield Hypothesis("joint_gain", (names[a],), count, columns=made, units=("1",))
            else:
                yield Hypothesis("joint_coupling", (names[a], names[b]), pairs, columns=made, units=("1",))


def moves_before(data: Measurements, ids: Sequence[str], *, several_a_pose: bool = False) -> Array:
    """Return the joints' moves ``(n, joints)`` from the pose before in its session and station; zeros first.

    Args:
        data: all that was measured, in its order.
        ids: n of its rows.
        several_a_pose: whether consecutive rows with equal joint positions are readings of one pose.
    """
    moves = np.zeros_like(data.joints)
    together = setups(data)
    for setup in dict.fromkeys(together):
        here = np.flatnonzero([each == setup for each in together])
        moves[here[1:]] = np.diff(data.joints[here], axis=0)
        if several_a_pose:
            first = np.append(True, moves[here[1:]].any(axis=1))
            moves[here] = moves[here[np.maximum.accumulate(np.where(first, np.arange(len(here)), 0))]]
    if tuple(ids) == data.ids:
        return moves
    row_of = {name: i for i, name in enumerate(data.ids)}
    return np.asarray(moves[[row_of[name] for name in ids]])
