"""Test every day whether the arm still meets a socket as before, and name the joint whose zero moved if not.

A ball on the tool is put into a fixed socket in the same few configurations. Where the joints put it, less the socket,
is an error in each configuration: the same every day, but for noise, until something moves. A joint's zero that moves
by d moves these errors by -d times the derivative by that joint; a socket that moves, or a tool that is bent, moves
them too, each in its own pattern (Basseville & Nikiforov 1993, section 7.2). What socket and tool can do together is a
subspace in which days differ more: a table warms up, a tool is changed. Noise is estimated there and in the rest apart.

In each the days are a constant, plus noise of one variance whose days are independent, or autocorrelated (AR(1) with a
share of independent noise): the likelier by restricted maximum likelihood (Patterson & Thompson 1971). After each day
the last n days, for several n, are compared by generalized least squares with those before. The tests of a year, over
all causes and n, share one level (Bonferroni), so that an unchanged arm raises an alarm in at most that share of years.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.core.linear_model import half_width_95
from lab.core.probability import chi2_isf, f_isf, f_sf, t_isf
from lab.core.se3 import Array, skew
from lab.core.significance import TREND_YEAR

__all__ = [
    "LEAST_CONFIGURATIONS",
    "REFERENCE",
    "Candidate",
    "Cause",
    "Change",
    "Distinction",
    "Scan",
    "SocketChecks",
    "best_configurations",
    "causes_of",
]

LEAST_CONFIGURATIONS = 4  # of a check
REFERENCE = 10  # checks, before the first that is tested
POWER = 0.95
_AFTER = (1, 2, 3, 5, 8, 13, 20)  # days that are compared with those before
_BEFORE = 60  # days at most
_DAYS_A_YEAR = 366  # at most one check a day
_LEVEL_OF_ALL = TREND_YEAR / _DAYS_A_YEAR
_UNEXPLAINED = 1e-3  # level at which a cause leaves too much
_AS_BEFORE = 0.01  # level above which the day after a bad touch is as the days before
_DISTINCT = 0.01  # level at which one cause explains better than another
_CHECKS = 3  # after a change, in which it is to be named
_SAME = 0.05  # share of a pattern that another cause does not explain, below which the two are the same
_NOISES = ((0.0, 0.0), *((share, rho) for share in (0.3, 0.6, 0.9, 1.0) for rho in (0.5, 0.7, 0.85, 0.95)))
_AS_LIKELY = 2.0  # of log likelihoods: a noise this much less likely than the likeliest is not ruled out
_RENEWED = 5  # checks, after which the noise is estimated anew
_RANK = 1e-6
_SEARCHED = 300  # choices of configurations


@dataclass(frozen=True)
class Cause:
    """What may move the errors at the socket.

    Attributes:
        kind: ``joint``, ``socket``, ``base``, ``tool``, or ``touch``: one bad touch on one day.
        name: of the joint or the socket, or the number of the configuration; "" of others.
        columns: ``(3 m, k)`` change of the errors (m) in all configurations by each of its numbers.
    """

    kind: str
    name: str
    columns: Array


def causes_of(
    joints: Sequence[str], by_joint: Array, by_tool: Array, points: Array, sockets: Sequence[str]
) -> tuple[Cause, ...]:
    """Return the causes that are tried.

    Args:
        joints: names of the joints.
        by_joint: ``(m, 3, joints)`` derivatives of the ball's position by the joint positions, in m configurations.
        by_tool: ``(m, 3, 3)`` by its position on the tool.
        points: ``(m, 3)`` m, where the ball is.
        sockets: ``(m,)`` name of the socket of each configuration.
    """
    m = len(points)
    found = [Cause("joint", name, -by_joint[:, :, j].reshape(-1, 1)) for j, name in enumerate(joints)]
    names = list(dict.fromkeys(sockets))
    for name in names:
        there = np.array([each == name for each in sockets], dtype=np.float64)
        found.append(Cause("socket", name, np.asarray(np.kron(there[:, None], np.eye(3)), dtype=np.float64)))
    if len(names) > 1:
        around = points - points.mean(axis=0)
        found.append(Cause("base", "", np.concatenate([np.tile(np.eye(3), (m, 1, 1)), skew(around)], 2).reshape(-1, 6)))
    found.append(Cause("tool", "", -by_tool.reshape(-1, 3)))
    ones = np.eye(3 * m)
    return (*found, *(Cause("touch", str(1 + i), ones[:, 3 * i : 3 * i + 3]) for i in range(m)))


@dataclass(frozen=True)
class Candidate:
    """A cause that explains a change.

    Attributes:
        size: of a joint's zero, in rad or m; else the length (m) by which socket, base or tool moved.
        half_width: half of its 95 % interval, of a joint; NaN else.
        p: chance of as much that it leaves unexplained, were it the cause.
    """

    cause: Cause
    size: float
    half_width: float
    p: float


@dataclass(frozen=True)
class Change:
    """A change of the errors at the socket.

    Attributes:
        first: index of the first check after it.
        found_at: index of the check that raised the alarm.
        candidates: the causes that explain it, the likeliest first; the likeliest of all where none explains it.
        explained: whether one does.
        p: chance of so strong an alarm in its test, had nothing changed; compared with ``level``.
    """

    first: int
    found_at: int
    candidates: tuple[Candidate, ...]
    explained: bool
    p: float
    level: float

    @property
    def named(self) -> bool:
        """Check whether one cause alone explains the change."""
        return self.explained and len(self.candidates) == 1


@dataclass(frozen=True)
class Scan:
    """All checks tested one after the other.

    Attributes:
        change: the first change that lasts; None where nothing has changed.
        bad_touches: indices of checks that raised an alarm, while the next one was as those before.
        tested: how many checks were tested.
    """

    change: Change | None
    bad_touches: tuple[int, ...]
    tested: int


@dataclass(frozen=True)
class Distinction:
    """How well a cause is seen in these configurations, before anything has changed.

    Attributes:
        detected: smallest size (rad or m) that the next check detects with a probability of 95 %.
        named: smallest size that three checks tell from every other cause; infinite where one has the same pattern.
        confounded: the causes that have the same pattern, by ``(kind, name)``.
    """

    cause: Cause
    detected: float
    named: float
    confounded: tuple[tuple[str, str], ...]


def best_configurations(
    joints: Sequence[str],
    by_joint: Array,
    by_tool: Array,
    points: Array,
    count: int,
    rng: np.random.Generator,
    sockets: Sequence[str] = (),
) -> tuple[list[int], float]:
    """Choose configurations in which the causes are told apart best, by a random search.

    The choice is the one whose least distinct pair of causes is the most distinct; pairs that are the same in all
    configurations together do not count.

    Args:
        joints, by_joint, by_tool, points: as in ``causes_of``, of all configurations to choose from.
        count: how many to choose.
        sockets: name of the socket of each, of which as many are chosen at each; one where not given.

    Returns:
        Their indices, and the share of the least distinct cause's pattern that no other cause explains.
    """
    labels = list(sockets) or [""] * len(points)
    of_sockets = [np.flatnonzero([label == name for label in labels]) for name in dict.fromkeys(labels)]

    def drawn() -> list[int]:
        parts = [rng.permutation(rows)[: (count + i) // len(of_sockets)] for i, rows in enumerate(of_sockets)]
        return list(np.sort(np.concatenate(parts)).tolist())

    def distinct(rows: list[int]) -> Array:
        causes = causes_of(joints, by_joint[rows], by_tool[rows], points[rows], [labels[i] for i in rows])
        return _unexplained([cause.columns for cause in causes if cause.kind != "touch"])

    # pairs that no configurations tell apart do not count
    counted = distinct(list(range(len(points)))) > _RANK
    tried = [drawn() for _ in range(_SEARCHED)]
    shares = [float(distinct(rows)[counted].min()) for rows in tried]
    best = int(np.argmax(shares))
    return tried[best], shares[best]


def _unexplained(patterns: Sequence[Array]) -> Array:
    """Return the share ``(pairs,)`` of each pattern that each other one leaves; one of a pattern beside itself."""
    return np.array(
        [
            np.linalg.norm(one - _projected(other, one)) / np.linalg.norm(one) if i != j else 1.0
            for i, one in enumerate(patterns)
            for j, other in enumerate(patterns)
        ]
    )


class _Noise(NamedTuple):
    """Noise of some coordinates: the models that are not ruled out, and the likeliest.

    Attributes:
        models: ``(k,)`` indices in ``_NOISES``, of which ``best`` is the likeliest.
        largest: ``(k,)`` variance by each, of the direction that varies most; ``typical`` is the mean by the best.
    """

    models: NDArray[np.int_]
    largest: Array
    best: int
    typical: float
    dof: float

    def of_change(self, before: int, after: int, *, likeliest: bool) -> tuple[Array, float]:
        """Return the weights of the days in a change of the mean, and its variance.

        Args:
            likeliest: by the likeliest model; else by the one of the largest variance.
        """
        weights, sizes = _weights(before, after)
        if likeliest:
            return weights[self.best], float(self.typical * sizes[self.best])
        variances = self.largest * sizes[self.models]
        worst = int(np.argmax(variances))
        return weights[self.models[worst]], float(variances[worst])


class _Compared(NamedTuple):
    whitened: Array  # (3 m,) the change, in standard deviations
    scales: Array  # (3 m,) those of each coordinate, m
    dof: float


class SocketChecks:
    """Tests of the errors at a socket, for some causes."""

    def __init__(self, causes: Sequence[Cause], reference: int = REFERENCE) -> None:
        """Prepare the tests.

        Args:
            causes: of ``causes_of``.
            reference: number of checks before the first test.
        """
        self.causes, self.reference = tuple(causes), reference
        basis, ends = np.empty((len(self.causes[0].columns), 0)), [0]
        for kind in ("socket", "tool", "touch"):
            columns = np.concatenate([c.columns for c in self.causes if c.kind == kind], axis=1)
            basis = np.concatenate([basis, _beyond(basis, columns / np.linalg.norm(columns, axis=0))], axis=1)
            ends.append(basis.shape[1])
        self._parts = tuple(slice(a, b) for a, b in pairwise(ends))  # of sockets, of what the tool adds, of the rest
        self._basis = basis
        self._columns = [basis.T @ cause.columns for cause in self.causes]
        self.level = _LEVEL_OF_ALL / (len(self.causes) * len(_AFTER))

    def scan(self, errors: Array) -> Scan:
        """Test the checks in their order, as if each had been the last.

        Args:
            errors: ``(days, m, 3)`` m, where the joints put the ball, less the socket.
        """
        z = errors.reshape(len(errors), -1) @ self._basis
        kept, bad, alarm, tested = list(range(min(self.reference, len(z)))), list[int](), None, 0
        noises: dict[int, list[_Noise]] = {}  # by the number of days that they are estimated from
        for day in range(self.reference, len(z)):
            if alarm is not None:
                if not (alarm[0] == alarm[1] == day - 1 and self._was_bad_touch(z, kept, day)):
                    continue
                bad.append(day - 1)
                alarm = None
            tested += 1
            if (estimated := self._estimated(len(kept))) not in noises:
                noises[estimated] = self._noises(z[kept[:estimated]][-_BEFORE:])
            n, p = self._smallest(z, kept, day, noises)
            if p < self.level:
                alarm = ([*kept, day][-n], day, p)
                kept = kept[: len(kept) + 1 - n]
            else:
                kept.append(day)
        if alarm is None:
            return Scan(None, tuple(bad), tested)
        first, found_at, p = alarm
        return Scan(self._described(z, kept, first, found_at, p), tuple(bad), tested)

    def distinctions(self, errors: Array) -> tuple[Distinction, ...]:
        """Return how well each cause but bad touches is seen, with the noise of these checks.

        Args:
            errors: ``(days, m, 3)`` m, of unchanged checks.
        """
        z = (errors.reshape(len(errors), -1) @ self._basis)[-_BEFORE:]
        noises = self._noises(z)
        one = self._comparable(noises, len(z), 1, likeliest=False)
        three = self._comparable(noises, len(z), _CHECKS, likeliest=True)
        needed = float(t_isf(self.level / 2, one.dof) + t_isf(1 - POWER, one.dof))
        found = []
        for i, cause in enumerate(self.causes):
            if cause.kind == "touch":
                continue
            size = self._typical(self._columns[i] / one.scales[:, None])
            own = self._columns[i] / three.scales[:, None]
            whole, named, same = self._typical(own), 0.0, []
            for j, other in enumerate(self.causes):
                if j == i or other.kind == "touch":
                    continue
                rest = own - _projected(self._columns[j] / three.scales[:, None], own)
                if (left := self._typical(rest)) < _SAME * whole:
                    same.append((other.kind, other.name))
                else:
                    named = max(named, _apart(other.columns.shape[1], cause.columns.shape[1]) / left)
            found.append(Distinction(cause, needed / size, np.inf if same else named, tuple(same)))
        return tuple(found)

    @staticmethod
    def _typical(columns: Array) -> float:
        """Return the length of a change by one; of several numbers the mean (root mean square) of all directions."""
        return float(np.sqrt((columns**2).sum() / columns.shape[1]))

    def _smallest(self, z: Array, kept: list[int], day: int, noises: Mapping[int, list[_Noise]]) -> tuple[int, float]:
        """Return the number of days that differ most from those before, and the p-value of that.

        Args:
            noises: by ``_estimated`` of the number of days before.
        """
        best, days = (1, 1.0), [*kept, day]
        for n in _AFTER:
            if len(days) - n < self.reference:
                break
            compared = self._compare(
                z[days[:-n]], z[days[-n:]], noises[self._estimated(len(days) - n)], likeliest=False
            )
            if float(compared.whitened @ compared.whitened) < _least_square(self.level, compared.dof):
                continue  # no cause explains more than all there is
            squares = self._explained(compared, touches=n == 1)[0]
            p = min(_p(square, self._columns[i].shape[1], compared.dof) for i, square in squares.items())
            best = min(best, (n, p), key=lambda each: each[1])
        return best

    def _estimated(self, days: int) -> int:
        """Return from how many of the days before a test the noise is estimated: anew after every few checks."""
        return days - (days - self.reference) % _RENEWED

    def _was_bad_touch(self, z: Array, kept: list[int], day: int) -> bool:
        """Decide whether the alarm of the day before was one bad touch: this day is as the days before that."""
        compared = self._compare(z[kept], z[[day]], self._noises(z[kept][-_BEFORE:]), likeliest=False)
        whole = float(compared.whitened @ compared.whitened)
        return _p(whole, len(compared.whitened), compared.dof) > _AS_BEFORE

    def _described(self, z: Array, kept: list[int], first: int, found_at: int, p: float) -> Change:
        after = z[first:][-_BEFORE:]
        compared = self._compare(z[kept], after, self._noises(z[kept][-_BEFORE:]), likeliest=True)
        squares, sizes, halves = self._explained(compared, touches=len(after) == 1)
        whole, n = float(compared.whitened @ compared.whitened), len(compared.whitened)
        chances = {i: _p(whole - square, n - self._columns[i].shape[1], compared.dof) for i, square in squares.items()}
        numbers = {i: self._columns[i].shape[1] for i in squares}
        rivals = [
            i
            for i in squares
            if chances[i] > _UNEXPLAINED
            and not any(squares[j] - squares[i] > _margin(numbers[j], numbers[i]) for j in squares)
        ]
        explained = bool(rivals)
        order = sorted(rivals or [max(squares, key=lambda i: squares[i])], key=lambda i: (numbers[i], -squares[i]))
        candidates = tuple(Candidate(self.causes[i], sizes[i], halves[i], chances[i]) for i in order)
        return Change(first, found_at, candidates, explained, p, self.level)

    def _explained(
        self, compared: _Compared, *, touches: bool
    ) -> tuple[dict[int, float], dict[int, float], dict[int, float]]:
        """Return by cause the explained square, the size, and the half-width of a joint's interval."""
        squares, sizes, halves = {}, {}, {}
        for i, cause in enumerate(self.causes):
            if cause.kind == "touch" and not touches:
                continue
            q, r = np.linalg.qr(self._columns[i] / compared.scales[:, None])
            along = q.T @ compared.whitened
            squares[i] = float(along @ along)
            numbers = np.linalg.lstsq(r, along)[0]
            one = cause.kind == "joint"
            sizes[i] = float(numbers[0]) if one else float(np.linalg.norm(numbers[:3]))
            halves[i] = float(half_width_95(compared.dof) / abs(r[0, 0])) if one and r[0, 0] else float("nan")
        return squares, sizes, halves

    def _compare(self, before: Array, after: Array, noises: Sequence[_Noise], *, likeliest: bool) -> _Compared:
        before = before[-_BEFORE:]
        known = self._comparable(noises, len(before), len(after), likeliest=likeliest)
        change, series = np.empty(before.shape[1]), np.concatenate([before, after])
        for part, noise in zip(self._parts, noises, strict=True):
            change[part] = noise.of_change(len(before), len(after), likeliest=likeliest)[0] @ series[:, part]
        return known._replace(whitened=change / known.scales)

    def _comparable(self, noises: Sequence[_Noise], before: int, after: int, *, likeliest: bool) -> _Compared:
        """Return the standard deviations of a change between so many days and the next; the change itself is zero."""
        scales = np.empty(len(self._basis))
        for part, noise in zip(self._parts, noises, strict=True):
            scales[part] = np.sqrt(noise.of_change(before, after, likeliest=likeliest)[1])
        dof = min(noise.dof for part, noise in zip(self._parts, noises, strict=True) if part.start < part.stop)
        return _Compared(np.zeros(len(scales)), scales, dof)

    def _noises(self, before: Array) -> list[_Noise]:
        *setup, rest = (np.ascontiguousarray(before[:, part]) for part in self._parts)
        return [*(_noise(days, alike=False) for days in setup), _noise(rest, alike=True)]


@lru_cache(maxsize=4096)
def _least_square(level: float, dof: float) -> float:
    """Return the square of one number that is significant at this level; that of several is larger."""
    return float(f_isf(level, 1, dof))


def _projected(onto: Array, columns: Array) -> Array:
    return np.asarray(onto @ np.linalg.lstsq(onto, columns)[0])


def _p(square: float, numbers: int, dof: float) -> float:
    return 1.0 if numbers == 0 else float(f_sf(square / numbers, numbers, dof))


def _margin(more: int, numbers: int) -> float:
    """Return by how much more a cause of ``more`` numbers has to explain than one of ``numbers`` that is ruled out."""
    return float(chi2_isf(_DISTINCT, 1 + max(0, more - numbers)))


def _apart(others: int, own: int) -> float:
    """Return the part of a change that another cause does not explain, which rules that out with a power of 95 %.

    What the two explain differs by x^2 less the further numbers of the other, with a standard deviation of 2 x.
    """
    normal, most = 1.645, _margin(own, others) + max(0, others - own)
    return float(normal + np.sqrt(normal**2 + most))


def _beyond(basis: Array, columns: Array) -> Array:
    """Return an orthonormal basis of what columns add to a space with an orthonormal basis."""
    u, sizes, _ = np.linalg.svd(columns - basis @ (basis.T @ columns), full_matrices=False)
    return np.asarray(u[:, sizes > _RANK])


def _noise(days: Array, *, alike: bool) -> _Noise:
    """Return the likeliest noises of ``(n, d)`` columns with a constant each.

    Args:
        alike: whether all columns have one variance; else it is the largest of any direction.
    """
    n, d = days.shape
    if d == 0:
        return _Noise(np.zeros(1, np.int_), np.ones(1), 0, 1.0, np.inf)
    inverses, log_sizes = _restricted(n)
    squares = days.T @ (inverses @ days) / (n - 1)  # (models, d, d)
    variances = np.maximum(np.trace(squares, axis1=1, axis2=2) / d, np.finfo(float).tiny)
    likelihoods = -0.5 * d * ((n - 1) * np.log(variances) + log_sizes)
    models, best = np.flatnonzero(likelihoods >= likelihoods.max() - _AS_LIKELY), int(np.argmax(likelihoods))
    largest = variances if alike else np.maximum(np.linalg.eigvalsh(squares)[:, -1], variances)
    return _Noise(models, largest[models], best, float(variances[best]), d * (n - 1))


def _correlations(n: int) -> Array:
    """Return the correlation of n days ``(models, n, n)`` by each noise."""
    apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    return np.stack([(1 - share) * np.eye(n) + share * rho**apart for share, rho in _NOISES])


@lru_cache(maxsize=128)
def _restricted(n: int) -> tuple[Array, Array]:
    """Return the inverse correlations ``(models, n, n)`` without a constant, and ``(models,)`` log |R| |1'R^-1 1|."""
    R = _correlations(n)
    inverses = np.linalg.inv(R)
    ones = inverses.sum(axis=2)
    whole = ones.sum(axis=1)
    restricted = inverses - ones[:, :, None] * ones[:, None] / whole[:, None, None]
    return restricted, np.linalg.slogdet(R)[1] + np.log(whole)


@lru_cache(maxsize=2048)
def _weights(before: int, after: int) -> tuple[Array, Array]:
    """Return the weights of the days in the change of the mean ``(models, before + after)``, and its variance by each.

    The variance ``(models,)`` is that for noise of variance one.
    """
    design = np.column_stack([np.ones(before + after), np.arange(before + after) >= before])
    inverses = np.linalg.inv(_correlations(before + after))
    covariances = np.linalg.inv(design.T @ inverses @ design)
    return (covariances @ design.T @ inverses)[:, 1], covariances[:, 1, 1]
