"""Which of hundreds of small groups of parameters a robot has: a search on the linearized problem, with one level.

A group here is one joint's or link's: its error is a few functions of the pose, such as the sine and cosine of twenty
times the joint's angle. All are tried at once by how much of the residual they explain beyond what is fitted already
(the score test), the best is taken, and so on: orthogonal matching pursuit (Pati, Rezaiifar & Krishnaprasad 1993).

The level is that of the whole search. How far the best of all groups lowers the squares by chance is found by flipping
the signs of whole configurations' residuals (Hemerik, Goeman & Finos 2020). So the level holds where the noise is no
instrument's: where joints scatter from pose to pose, and move all targets of a pose together, where errors have heavy
tails, or differ over the workspace.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import ExtraResiduals, Observations
from lab.calibration.statistics.clustered_rows import cluster_sums, clusters_first, jackknifed
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.core.linear_model import p_value_of_squares, unit_columns
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.core.significance import TERM_SEARCH
from lab.kinematics.effects.effect import Effect
from lab.kinematics.model import Model
from lab.kinematics.parameter import names_of

__all__ = ["FoundTerm", "TermSearch", "TermTable"]

FLIPS = 999  # of signs: the level is exact for so many and one
_STAGE = 8  # groups that are taken before all others are looked at anew
_POOL = 48  # groups that a stage chooses from
_LEFT = 1e-3  # share of a column's squares that what is fitted has to leave
_TIE = 1e-3  # share of a fall by which groups that say the same differ beside geometry: the table's first is taken
_APART = 1e-3  # share of the squares that two columns of a group have apart


@dataclass(frozen=True)
class FoundTerm:
    """A group that the search takes.

    Attributes:
        p: the chance of as large a fall by noise alone, were it the only group that is tried.
    """

    name: str
    p: float


@dataclass(frozen=True)
class TermTable:
    """What each group does to the joints, or to the far ends of links, at some poses.

    Attributes:
        names: of the groups, g of them.
        functions: ``(n, p)`` rad or m a unit of each of their parameters.
        motion: ``(p,)`` what that moves: a joint, from 0, or, beyond the joints, one of six motions of each link's far
            end.
        joints: how many joints there are.
        owner: ``(p,)`` the group that each parameter is of; one has one parameter or two.
        parameters: the names of each group's parameters.
    """

    names: tuple[str, ...]
    functions: Array
    motion: NDArray[np.int_]
    joints: int
    owner: NDArray[np.int_]
    parameters: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, effects: Mapping[str, Effect], data: Measurements) -> "TermTable":
        """Of effects that are linear in their parameters, each of which moves one joint or displaces one link's end."""
        size = data.joints.shape[1]
        functions, motion, owner = [], [], []
        for i, effect in enumerate(effects.values()):
            conditions = data.inputs(effect.conditions)[:, size:]
            moved = effect.offsets(data.joints, conditions, np.zeros(len(effect.parameters)))[1]
            assert effect.moves in ("joints", "links") and len(effect.links) <= 1 and len(effect.parameters) <= 2
            first = size + 6 * effect.links[0] if effect.links else 0
            for k in range(len(effect.parameters)):
                component = int(np.abs(moved[..., k]).sum(axis=0).argmax())
                functions.append(moved[:, component, k])
                motion.append(first + component)
                owner.append(i)
        columns = np.stack(functions, axis=1) if functions else np.empty((len(data), 0))
        parameters = tuple(names_of(effect.parameters) for effect in effects.values())
        return cls(tuple(effects), columns, np.array(motion, np.int_), size, np.array(owner, np.int_), parameters)

    @cached_property
    def showing_ends(self) -> dict[int, int]:
        """For each motion of a link's end that a group has, the first such group."""
        found: dict[int, int] = {}
        for column in np.flatnonzero(self.motion >= self.joints).tolist():
            found.setdefault(int(self.motion[column]), int(self.owner[column]))
        return found

    def slopes(self, model: Model, with_ends: Model, observed: Observations, values: Array) -> Array:
        """Derivatives ``(n, k, d, motions)`` of what is observed by each motion; zero where no group has it.

        Args:
            with_ends: the model with the groups ``showing_ends`` beside, whose columns are a motion times waves: they
                give the motion by least squares, pose by pose.
            values: ``(p,)`` of the model.
        """
        by_joints = by_joint_positions(model, observed.inputs, values, self.joints)
        if not self.showing_ends:
            return by_joints
        start = dict(zip(model.names, values.tolist(), strict=True))
        at = np.array([start.get(name, 0.0) for name in with_ends.names])
        jacobian = with_ends.observe(observed.inputs, at)[1]
        slopes = np.zeros((*by_joints.shape[:3], max(self.showing_ends) + 1))
        slopes[..., : self.joints] = by_joints
        for motion, group in self.showing_ends.items():
            functions = self.functions[:, self.owner == group]
            columns = jacobian[..., [with_ends.names.index(name) for name in self.parameters[group]]]
            weights = functions / (functions**2).sum(axis=1, keepdims=True)
            slopes[..., motion] = np.einsum("nkdp,np->nkd", columns, weights)
        return slopes


@dataclass
class TermSearch:
    """The linearized problem at an identified model, with every group of a table beside it.

    It changes as groups are taken: the basis grows, the residual shrinks.

    Attributes:
        columns: ``(r, p)`` whitened derivatives by the table's parameters, rows of one cluster after another's.
        basis: ``(r, f)`` orthonormal, of what is fitted.
        residual: ``(r,)`` what that leaves.
        starts: ``(clusters,)`` the first row of each cluster: rows whose errors may go together.
        allowed: ``(g,)`` the groups that may be taken.
        largest_std: of a parameter that is of any use (rad, m).
        floor: the least standard deviation of a whitened residual.
    """

    table: TermTable
    columns: Array
    basis: Array
    residual: Array
    starts: NDArray[np.int_]
    allowed: NDArray[np.bool_]
    largest_std: float
    floor: float

    def __post_init__(self) -> None:
        count, owner = np.arange(len(self.table.names)), self.table.owner
        first, last = np.searchsorted(owner, count), np.searchsorted(owner, count, side="right") - 1
        self._pairs = np.stack([first, last], axis=1)  # of a single column twice the same
        self._single = first == last
        self._squares = _products_of_pairs(self.columns, self._pairs)
        self._shared = self.basis.T @ self.columns

    @classmethod
    def at(
        cls,
        table: TermTable,
        model: Model,
        with_ends: Model,
        observed: Observations,
        values: Array,
        free: Sequence[int],
        configurations: NDArray[np.int_],
        extra_residuals: ExtraResiduals,
        *,
        largest_std: float,
        floor: float,
    ) -> "TermSearch":
        """Near ``values`` ``(p,)``, of which those ``free`` are fitted; what is in the model is not tried again.

        Args:
            with_ends: the model with the table's groups ``showing_ends`` beside.
            configurations: ``(n,)`` labels of the poses from 0 on; repeats of one pose share theirs.
            floor: the least standard deviation of a whitened residual.
        """
        index, mask = list(free), observed.seen
        predicted, jacobian = model.observe(observed.inputs, values)
        known, slopes = extra_residuals(values)
        pose = np.repeat(np.nonzero(mask)[0], observed.points.shape[2])
        order, starts = clusters_first(configurations[pose], len(pose) + len(known))
        fitted = np.concatenate([observed.apply(jacobian[..., index]), slopes[:, index]])[order]
        left = np.concatenate([observed.apply(observed.points - predicted), known])[order]
        slope = observed.apply(table.slopes(model, with_ends, observed, values))
        columns = np.zeros((len(order), len(table.motion)))
        columns[: len(pose)] = slope[:, table.motion] * table.functions[pose]
        basis = np.linalg.qr(unit_columns(fitted)[0])[0]
        taken = [bool(set(own) & set(model.names)) for own in table.parameters]
        return cls(
            table,
            columns[order],
            basis,
            left - basis @ (basis.T @ left),
            starts,
            ~np.array(taken, dtype=bool),
            largest_std,
            floor,
        )

    def run(
        self, rng: np.random.Generator, most: int, only: Sequence[str] | None = None, level: float = TERM_SEARCH
    ) -> tuple[FoundTerm, ...]:
        """The groups that are significant, at most so many, in the order in which they are taken.

        Args:
            only: names of those that are searched; all where None.
            level: of this search.
        """
        wanted = None if only is None else set(only)
        among = np.array([wanted is None or name in wanted for name in self.table.names], dtype=bool)
        return tuple(self._taken(rng, most, among, level))

    def _taken(self, rng: np.random.Generator, most: int, among: NDArray[np.bool_], level: float) -> list[FoundTerm]:
        """What is significant at a level among some of the groups."""
        taken: list[FoundTerm] = []
        while len(taken) < most:
            gram, scores = self._gram(), self._scores()
            useful = self._useful(gram) & among
            threshold = self._threshold(scores, gram, useful, rng, level)
            fall = np.where(useful, _quadratic((self.columns.T @ self.residual)[self._pairs], gram), 0.0)
            pool = [int(i) for i in np.argsort(-fall)[:_POOL] if fall[i] > threshold]
            new = self._stage(pool, threshold, min(_STAGE, most - len(taken)))
            if not new:
                break
            taken += new
        return taken

    def _stage(self, pool: list[int], threshold: float, most: int) -> list[FoundTerm]:
        """The groups taken of a pool, the one that lowers the squares most first, while they are significant."""
        found: list[FoundTerm] = []
        while pool and len(found) < most:
            index = self._pairs[pool].ravel()
            own = self.columns[:, index] - self.basis @ self._shared[:, index]
            pairs = np.arange(len(index)).reshape(-1, 2)
            gram, products = _products_of_pairs(own, pairs), (own.T @ self.residual)[pairs]
            fall = _quadratic(products, gram)
            best = min(np.flatnonzero(fall >= (1 - _TIE) * fall.max()).tolist(), key=pool.__getitem__)
            if fall[best] <= threshold:
                break
            scores = cluster_sums(own[:, pairs[best]] * jackknifed(self.residual, self.basis)[:, None], self.starts)
            usual = _quadratic(scores, np.broadcast_to(gram[:, best, None], (3, len(scores)))).sum()
            numbers = 1 if self._single[pool[best]] else 2
            p = float(p_value_of_squares(fall[best], numbers, variance=usual / numbers))
            found.append(FoundTerm(self.table.names[pool[best]], p))
            self.allowed[pool[best]] = False
            self._take(own[:, pairs[best][:numbers]])
            del pool[best]
        return found

    def _take(self, columns: Array) -> None:
        """Fit these columns, orthogonal to the basis, too."""
        more = np.linalg.qr(columns)[0]
        more = np.linalg.qr(more - self.basis @ (self.basis.T @ more))[0]
        self.basis = np.concatenate([self.basis, more], axis=1)
        self._shared = np.concatenate([self._shared, more.T @ self.columns])
        self.residual = self.residual - more @ (more.T @ self.residual)

    def _scores(self) -> Array:
        """``(clusters, p)`` what each cluster contributes to the products of the columns, less their fitted part."""
        errors = jackknifed(self.residual, self.basis)[:, None]
        raw, fitted = (cluster_sums(rows * errors, self.starts) for rows in (self.columns, self.basis))
        return np.asarray(raw - fitted @ self._shared)

    def _gram(self) -> Array:
        """``(3, g)`` inner products of the groups' columns beyond what is fitted."""
        return self._squares - _products_of_pairs(self._shared, self._pairs)

    def _useful(self, gram: Array) -> NDArray[np.bool_]:
        """Which groups say what the fitted columns do not, well enough to be of any use."""
        free = (gram[[0, 2]] > _LEFT * np.maximum(self._squares[[0, 2]], 1e-300)).all(axis=0)
        apart = 1 - gram[1] ** 2 / np.maximum(gram[0] * gram[2], 1e-300)
        share = np.where(self._single, 1.0, np.maximum(apart, 0.0))
        dof = max(len(self.residual) - self.basis.shape[1], 1)
        sigma = max(float(np.sqrt(self.residual @ self.residual / dof)), self.floor)
        least = np.sqrt(np.maximum(np.minimum(gram[0], gram[2]), 0.0) * share)
        return np.asarray(self.allowed & free & (share > _APART) & (sigma < self.largest_std * least))

    def _threshold(
        self, scores: Array, gram: Array, useful: NDArray[np.bool_], rng: np.random.Generator, level: float
    ) -> float:
        """What the largest fall of the squares exceeds by chance as often as the level says."""
        if not useful.any():
            return np.inf
        flips = rng.integers(0, 2, (FLIPS, len(scores))).astype(np.float32) * 2 - 1  # rounding is no matter here
        size = float(np.abs(scores).max()) or 1.0
        products = size * (flips @ (scores / size).astype(np.float32)).astype(np.float64)
        largest = _quadratic(products[:, self._pairs[useful]], gram[:, useful]).max(axis=1)
        return float(np.sort(largest)[-int(level * (FLIPS + 1))])


def _products_of_pairs(rows: Array, pairs: NDArray[np.int_]) -> Array:
    """``(3, g)`` sums over rows ``(r, p)`` of each pair's squares and products: first, mixed, second."""
    first, last = (rows[:, column] for column in pairs.T)
    return np.stack([np.einsum("rg,rg->g", a, b) for a, b in ((first, first), (first, last), (last, last))])


def _quadratic(products: Array, matrix: Array) -> Array:
    """The squares x' M^-1 x ``(..., g)`` of x ``(..., g, 2)`` and M's entries ``(3, g)``; one column twice: x^2 / M."""
    (a, b, d), (x, y) = matrix, np.moveaxis(products, -1, 0)
    determinant = a * d - b**2
    single = determinant <= 1e-9 * a * d
    whole = (x**2 * d - 2 * x * y * b + y**2 * a) / np.where(single, 1.0, determinant)
    return np.asarray(np.where(single, x**2 / np.maximum(a, 1e-300), whole))
