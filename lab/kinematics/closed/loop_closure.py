"""What the closures make of a mechanism's passive values: Newton's method from places where they are known.

A mechanism assembles in several ways (modes), and Newton's method from afar may end in any. Meant is the mode into
which a known place can be moved. So the passive values are followed from there, in steps that shrink until Newton's
corrections do: by Deuflhard's monotonicity test (Newton Methods for Nonlinear Problems, 2004, section 5.1) corrections
of at most a quarter of the one before say that the way has not been left. A turn is no small correction by itself: a
first one of radians may end a turn away with nothing to be noticed. And on a way without singularities the determinant
of the closures' derivatives keeps its sign.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.kinematics.closed.configuration import Configuration, Dimensions
from lab.kinematics.closed.structure import Tree

__all__ = [
    "CLOSED_M",
    "CONTRACTED",
    "FIRST_STEP",
    "LEAST_STEP",
    "MOST_CORRECTIONS",
    "ROUNDING_M",
    "SINGULAR",
    "Assembly",
    "Closed",
    "SolvedPoses",
]

SINGULAR = 1e3  # condition of the closures by the passive values from which on a pose is refused
CONTRACTED = 0.25  # of the correction before, the next at most
_LARGEST_TURN = 0.5  # rad, of a first correction
CLOSED_M = 1e-9  # a closure open by less closes to rounding with one more correction
ROUNDING_M = 1e-11  # corrections below this say nothing
MOST_CORRECTIONS = 8
FIRST_STEP, LEAST_STEP = 0.5, 2.0**-6  # of the way from a known place


@dataclass(frozen=True)
class SolvedPoses:
    """Poses whose passive values are known, all of one mode.

    Attributes:
        joints: joint positions ``(m, joints)``.
        passive: ``(z, m)``.
        sense: the sign of the determinant of the closures' derivatives by the passive values.
    """

    joints: Array
    passive: Array
    sense: float

    def take(self, rows: NDArray[np.int_]) -> "SolvedPoses":
        """Some of them."""
        return SolvedPoses(self.joints[rows], self.passive[:, rows], self.sense)


@dataclass(frozen=True)
class Assembly:
    """A mechanism of given dimensions, to be assembled.

    Attributes:
        lever_m: ``(z,)`` one for a slide; for a turn the length at which its corrections compare with a slide's.
        rotational: ``(z,)`` which passive values are turns.
    """

    tree: Tree
    dimensions: Dimensions
    lever_m: Array
    rotational: NDArray[np.bool_]

    def from_known(self, joints: Array, known: SolvedPoses, least_step: float = LEAST_STEP) -> "Closed":
        """At joint positions ``(n, joints)``, each from a known place of its own.

        Args:
            least_step: of the way there, below which it is taken to end.
        """
        with np.errstate(all="ignore"):  # on a way to nowhere numbers may grow
            configuration, smooth = self._corrected(joints, known.passive, 0.0)
            if not smooth.all():
                rows = np.flatnonzero(~smooth)
                passive = configuration.passive.copy()
                passive[:, rows] = self._followed(joints[rows], known.take(rows), least_step)
                configuration.move(passive)
            return self.closed(configuration, known.sense)

    def nearest(self, joints: Array, passive: Array) -> tuple[Array, Array]:
        """Of one pose ``(joints,)``: the passive values ``(z,)`` near these that open the closures least, and by what.

        Of use where they cannot be closed, or to close them for the first time; the gaps ``(closures,)`` are in m.
        """
        configuration = Configuration.of(self.tree, self.dimensions, joints[None], passive[:, None])
        if not len(passive):
            return passive, np.empty(0)

        def gaps(values: Array) -> Array:
            configuration.move(values[:, None] / self.lever_m[:, None])
            return np.concatenate([np.atleast_1d(gap) for gap in configuration.closures()[0]])

        found = scipy.optimize.least_squares(gaps, passive * self.lever_m, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        return np.asarray(found.x / self.lever_m), gaps(found.x)

    def _corrected(
        self, joints: Array, start: Array, open_by: Array | float
    ) -> tuple[Configuration, NDArray[np.bool_]]:
        """Newton's method from passive values ``(z, n)``; and ``(n,)`` where it stayed on its way and closed.

        The loop is its own: it follows a way that must not be left, so that a step which is not much shorter than the
        one before ends a row, and what counts is how far the loops are open.

        Args:
            open_by: gaps ``(closures, n)`` m that are to be left.
        """
        configuration = Configuration.of(self.tree, self.dimensions, joints, start)
        smooth, before = np.ones(len(joints), dtype=bool), np.full(len(joints), np.inf)
        for _ in range(MOST_CORRECTIONS):
            gaps, directions = configuration.closures()
            opened = np.array([*gaps]).reshape(len(gaps), len(joints)) - open_by
            moved = _solved(configuration.by_passive(directions), opened.T).T
            configuration.move(configuration.passive - moved)
            size = np.sqrt(((moved * self.lever_m[:, None]) ** 2).sum(axis=0))
            smooth &= size <= np.maximum(CONTRACTED * before, ROUNDING_M)
            smooth &= (np.abs(moved[self.rotational]) < _LARGEST_TURN).all(axis=0)
            shut, before = np.abs(opened).max(axis=0, initial=0.0) < CLOSED_M, size
            if (shut | ~smooth).all():
                return configuration, smooth
        return configuration, smooth & shut

    def _followed(self, joints: Array, known: SolvedPoses, least_step: float) -> Array:
        """Passive values ``(z, n)`` along straight ways from known places; NaN where a way ends.

        The gaps that these dimensions leave at a place known of others are closed in proportion on the way.
        """
        passive, reached = known.passive.copy(), np.zeros(len(joints))
        step = np.full(len(joints), FIRST_STEP)
        gaps = np.array(Configuration.of(self.tree, self.dimensions, known.joints, passive).closures()[0])
        while (rows := np.flatnonzero((reached < 1) & (step >= least_step))).size:
            to = np.minimum(reached[rows] + step[rows], 1.0)
            at = known.joints[rows] + to[:, None] * (joints[rows] - known.joints[rows])
            configuration, smooth = self._corrected(at, passive[:, rows], (1 - to) * gaps[:, rows])
            there = rows[smooth]
            passive[:, there], reached[there] = configuration.passive[:, smooth], to[smooth]
            step[rows[~smooth]] /= 2
        passive[:, reached < 1] = np.nan
        return passive

    def closed(self, configuration: Configuration, sense: float) -> "Closed":
        """What a configuration is, if its passive values are those of closed loops in the mode of such a sense."""
        with np.errstate(all="ignore"):  # of what is not closed
            directions = configuration.closures()[1]
            matrix = configuration.by_passive(directions)
            inverse = _solved(matrix, np.broadcast_to(np.eye(len(self.lever_m)), matrix.shape))
            alike = matrix / self.lever_m, inverse * self.lever_m[:, None]
            sizes = [np.sqrt((part**2).sum(axis=(1, 2))) for part in alike]
            condition = sizes[0] * sizes[1] / max(len(self.lever_m), 1)
            same = np.sign(np.linalg.det(matrix)) == sense
        return Closed(configuration, directions, inverse, np.where(same & np.isfinite(condition), condition, np.inf))


@dataclass(frozen=True)
class Closed:
    """n poses whose loops are closed, where they can be.

    Attributes:
        configuration: there; NaN where they cannot be in the mode of what was known.
        directions: of the closures (``Configuration.closures``).
        inverse: ``(n, z, closures)`` of the closures' derivatives by the passive values.
        condition: ``(n,)`` of these, one at best, lengths beside levers; inf where the loops are open.
    """

    configuration: Configuration
    directions: list[Array]
    inverse: Array
    condition: Array

    @property
    def fits(self) -> NDArray[np.bool_]:
        """``(n,)`` which poses close, away from parallel singularities."""
        return np.asarray(self.condition < SINGULAR)


def _solved(matrix: Array, right: Array) -> Array:
    """The solutions of systems ``(n, z, z)``, NaN of singular ones."""
    vector = right.ndim == 2
    right = right[..., None] if vector else right
    try:
        found = np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        singular = np.linalg.det(matrix) == 0
        found = np.linalg.solve(np.where(singular[:, None, None], np.eye(matrix.shape[1]), matrix), right)
        found[singular] = np.nan
    return np.asarray(found[..., 0] if vector else found, dtype=np.float64)
