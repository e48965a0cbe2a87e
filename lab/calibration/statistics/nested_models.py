"""All nested models of one large model at once: near a solution every one of them is linear.

One orthogonal factorization of the large model's whitened Jacobian beside the residual holds each nested one's
sum of squares in its triangle, and one for each fold what the other poses predict there.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import RANK_TOLERANCE, ExtraResiduals, Observations
from lab.calibration.observation import Observation
from lab.calibration.statistics.clustered_rows import ClusteredRows, ClusterTest
from lab.core.linear_model import LinearModel, p_value_of_squares
from lab.core.probabilities import t_sf
from lab.core.se3 import Array

__all__ = ["HeldOutGain", "Labels", "NestedModels", "Score", "nested_at"]

Labels = NDArray[np.int_]


@dataclass(frozen=True)
class Score:
    """How a nested model does.

    Attributes:
        parameters: how many it fits.
        squares: its sum of squared whitened residuals.
        errors: ``(m,)`` lengths (m) of held-out errors, one per observed thing.
        bic: Bayes' information criterion (Schwarz 1978), lower is better.
    """

    parameters: int
    squares: float
    errors: Array
    bic: float


@dataclass(frozen=True)
class HeldOutGain:
    """Estimate how far the error at held-out configurations falls, each configuration counted once.

    Attributes:
        mean_m: the mean over configurations.
        std_m: its standard error.
        dof: of that standard error: configurations less one.
    """

    mean_m: float
    std_m: float
    dof: int

    @property
    def p(self) -> float:
        """The chance of as large a gain if there is none: Student's t, one-sided."""
        if self.dof < 1 or not self.std_m > 0:
            return 1.0
        return float(t_sf(self.mean_m / self.std_m, self.dof))


@dataclass(frozen=True)
class NestedModels:
    """The large model, linearized.

    Attributes:
        columns: the parameters (of the large model) that some nested model fits, c of them.
        scale: ``(c,)`` the norms that their columns had.
        away: ``(c,)`` how far each of them, scaled, stands from its nominal value, which it has where it is not fitted.
        whole: ``(<= c + 1, c + 1)`` triangle of the scaled whitened Jacobian and, last, the residual.
        training: the same of all folds but one.
        held: ``(m_f, d, c + 1)`` of each fold: derivatives and residual of its things, in m.
        cluster: ``(m,)`` what each thing of the folds, one after the other, was held out together with.
        rows: the number of residuals.
        floor: the least standard deviation that a whitened residual may have: 1 where sigma is known.
        witnesses: the scaled rows themselves, residual last, by the poses whose errors may go together.
    """

    columns: tuple[int, ...]
    scale: Array
    away: Array
    whole: Array
    training: tuple[Array, ...]
    held: tuple[Array, ...]
    cluster: Labels
    rows: int
    floor: float
    witnesses: ClusteredRows

    def score(self, fitted: Sequence[int]) -> Score:
        """The nested model that fits these columns, held-out errors by linear prediction from the other folds.

        BIC = N log s^2 + RSS / s^2 + p log N, with s^2 = RSS / N but never below what the noise is known to be:
        the likelihood's maximum under that bound, so that a sigma given too small does not let every column in.
        """
        squares = float(np.sum(self._left(self.whole, fitted)[1] ** 2))
        lengths = [
            np.linalg.norm(held @ self._left(triangle, fitted)[0], axis=1)
            for triangle, held in zip(self.training, self.held, strict=True)
        ]
        return Score(len(fitted), squares, np.concatenate(lengths), self._bic(squares, len(fitted)))

    def bic_without(self, fitted: Sequence[int], parts: Sequence[Sequence[int]]) -> Array:
        """BIC of the models that fit these columns less one of the parts each, as by ``score``, all at once.

        What holding a part b at its nominal value adds to the squares is d' (C_bb)^-1 d, with d how far the fit moves
        it from there and C the covariance of unit noise (Seber & Lee 2003, section 4.3).
        """
        index = [self.columns.index(i) for i in fitted]
        weights, left = self._left(self.whole, fitted)
        back = LinearModel.of(self.whole[:, index], RANK_TOLERANCE, scaled=True).back
        moved = self.away[index] - weights[index]
        found = []
        for part in parts:
            own = [k for k, i in enumerate(fitted) if i in part]
            rise = moved[own] @ np.linalg.lstsq(back[own] @ back[own].T, moved[own], rcond=None)[0]
            squares = float(left @ left + rise)
            found.append(self._bic(squares, len(index) - len(own)))
        return np.array(found)

    def _bic(self, squares: float, parameters: int) -> float:
        variance = max(squares / self.rows, self.floor**2)
        return float(self.rows * np.log(variance) + squares / variance + parameters * np.log(self.rows))

    def std(self, fitted: Sequence[int]) -> Array:
        """Standard deviations of the parameters that are fitted; of noise as large as the residuals, or as is known."""
        index = [self.columns.index(i) for i in fitted]
        left = self._left(self.whole, fitted)[1]
        variance = max(float(left @ left) / max(self.rows - len(index), 1), self.floor**2)
        back = LinearModel.of(self.whole[:, index], RANK_TOLERANCE, scaled=True).back
        std: Array = np.sqrt(variance * (back**2).sum(axis=1)) / self.scale[index]
        return std

    def p_value(self, small: Score, big: Score) -> float:
        """The chance of a fall in squares as large as from ``small`` to ``big`` if what was added is not there.

        The larger of the F-test's and of the chi squared test's by the known sigma (Seber & Lee 2003, section
        4.3): a sigma given too small makes the second one far too sure, and one that says that the smaller model
        is adequate already must not be overruled by the first.
        """
        added, dof = big.parameters - small.parameters, self.rows - big.parameters
        fall = max(small.squares - big.squares, 0.0)
        by_noise = p_value_of_squares(fall, added, variance=self.floor**2)
        by_residuals = p_value_of_squares(fall, added, dof, max(big.squares / dof, 1e-300))
        return float(max(by_noise, by_residuals))

    def test_by_configurations(self, fitted: Sequence[int], added: Sequence[int]) -> ClusterTest | None:
        """Test what columns explain beyond those fitted, with errors that are correlated within a configuration.

        Unlike ``p_value`` it does not take the targets or repeats of a pose for independent; None where there is one
        of each, as there is nothing to allow for.
        """
        if not self.witnesses.shared:
            return None
        return self.witnesses.test(*([self.columns.index(i) for i in each] for each in (fitted, added)))

    def gain(self, before: Score, after: Score) -> HeldOutGain:
        """Return the paired fall of the held-out error: a configuration counts once, however often it was measured."""
        count = np.bincount(self.cluster)
        fall = (np.bincount(self.cluster, before.errors - after.errors) / np.maximum(count, 1))[count > 0]
        spread = float(fall.std(ddof=1)) if len(fall) > 1 else 0.0
        return HeldOutGain(float(fall.mean()), spread / np.sqrt(len(fall)), len(fall) - 1)

    def _left(self, triangle: Array, fitted: Sequence[int]) -> tuple[Array, Array]:
        """Weights ``(c + 1,)`` of columns and residual in what is left, and what is left of the triangle's rows."""
        index = [self.columns.index(i) for i in fitted]
        weights = np.append(self.away, 1.0)
        weights[index] = 0.0
        nested = LinearModel.of(triangle[:, index], RANK_TOLERANCE, scaled=True)
        weights[index] = -nested.solve(triangle @ weights)
        return weights, triangle @ weights


def nested_at(
    observation: Observation,
    observed: Observations,
    values: Array,
    columns: Sequence[int],
    nominal: Array,
    folds: Labels,
    clusters: Labels,
    extra_residuals: ExtraResiduals,
    floor: float,
    configurations: Labels,
) -> NestedModels:
    """The large model near ``values`` ``(p,)``.

    Args:
        columns: the parameters that some nested model fits.
        nominal: ``(c,)`` what they are where they are not fitted.
        folds, clusters: ``(n,)`` labels: a row's fold, from 0 on, and what it is held out together with.
        extra_residuals: what is known beside the measurements, weighted as they are.
        configurations: ``(n,)`` labels from 0 on: rows whose errors may go together.
    """
    index, count = list(columns), int(folds.max()) + 1
    predicted, jacobian = observation.model.observe(observed.inputs, values)
    both = np.concatenate([jacobian[..., index], (observed.points - predicted)[..., None]], axis=3)
    rows, mask = observed.apply(both), observed.seen
    scale = np.append(np.linalg.norm(rows[:, :-1], axis=0), 1.0)
    scale[scale == 0] = 1.0
    residual, slopes = extra_residuals(values)
    beside = np.column_stack([slopes[:, index], residual]) / scale
    fold = np.repeat(folds[np.nonzero(mask)[0]], observed.points.shape[2])
    parts = [_stacked([rows[fold == f] / scale]) for f in range(count)]
    in_m = (both / observation.units[:, None, None])[:, : observation.positions or None]
    inside = [mask[:, : in_m.shape[1]] & (folds == f)[:, None] for f in range(count)]
    return NestedModels(
        columns=tuple(columns),
        scale=scale[:-1],
        away=(values[index] - nominal) * scale[:-1],
        whole=_stacked([*parts, beside]),
        training=tuple(_stacked([*parts[:f], *parts[f + 1 :], beside]) for f in range(count)),
        held=tuple(in_m[part] / scale for part in inside),
        cluster=np.concatenate([clusters[np.nonzero(part)[0]] for part in inside]),
        rows=len(rows) + len(residual),
        floor=floor,
        witnesses=ClusteredRows.of(
            np.concatenate([rows / scale, beside]), configurations[np.nonzero(mask)[0]], both.shape[2]
        ),
    )


def _stacked(parts: Sequence[Array]) -> Array:
    """The triangle of rows below each other."""
    return np.asarray(np.linalg.qr(np.concatenate(parts), mode="r"))
