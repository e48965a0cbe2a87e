"""Split the remaining error into the instrument, errors that poses share, and an unexplained rest.

The mean square of the residuals is the instrument's part (given, or estimated from rigid distances), that of the noise
model beside it, and a rest. A rest that is correlated at neighbouring joint positions is the arm's, one correlated
from pose to pose is time's: the mean product of neighbours' residuals over their mean square, against permutations.

On the linear problem at the fit, a group of effects adds J_g v_g to the predictions. Without it the others would be
refitted: the part orthogonal to their columns is left (Seber & Lee 2003, section 3.9). Overlapping effects each look
small alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.calibration.row_groups import configurations
from lab.core.errors import option_name
from lab.core.linear_model import unit_columns
from lab.core.measurements import Measurements, evenly, seen_mask, thinned
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.significance import MODEL_GROUPS
from lab.core.units import MM
from lab.kinematics.model import Model
from lab.noise.error_model import ErrorModel

__all__ = ["NEARLY", "ExplainedError", "RemainingError", "explained_errors", "remaining_error"]

_DRAWS = 199  # (draws + 1) x level is a whole number
_MOST_PAIRS = 5000  # whose correlation is estimated
_LEAST_POSES = 20
NEARLY = 0.05  # p-value of a group that was not taken, but is reported
_SMALL = 0.1  # of the mean square: a rest that needs no explanation


@dataclass(frozen=True)
class _Likeness:
    """Correlation of the residuals of neighbours.

    Attributes:
        correlation: one where they are equal, zero where they have nothing in common.
        p: the chance of as much without any order of the poses.
    """

    correlation: float
    p: float

    @property
    def is_shown(self) -> bool:
        """Check whether the correlation is significant (1 %)."""
        return self.correlation > 0 and self.p <= MODEL_GROUPS


@dataclass(frozen=True)
class RemainingError:
    """The residuals of one coordinate, root mean squares in m.

    Attributes:
        total_m: of the residuals, for the parameters that were fitted.
        instrument_m: the instrument's part; NaN if unknown.
        shared_m: the part of joint scatter, wandering and drift.
        rest_m: what is left of the total.
        over_joints: of neighbours in joint positions; None where poses are few.
        over_time: of poses one after the other; None where poses are few.
        nearly: groups that were tried, seen at 5 % and not taken.
        searched: whether the groups were searched for (``--model auto``).
    """

    total_m: float
    instrument_m: float
    shared_m: float
    rest_m: float
    over_joints: _Likeness | None
    over_time: _Likeness | None
    nearly: tuple[str, ...] = ()
    searched: bool = False

    @property
    def is_explained(self) -> bool:
        """Check whether the instrument and shared errors explain nearly all of the remaining error."""
        return bool(np.isfinite(self.instrument_m) and self.rest_m**2 <= _SMALL * self.total_m**2)

    @property
    def description(self) -> str:
        """Describe the shares of the remaining error."""
        messages = [f"What remains is {MM.text(self.total_m, 2)} per axis (root mean square)"]
        if np.isfinite(self.instrument_m):
            messages.append(f"the instrument makes {MM.text(self.instrument_m, 2)} of it")
        if self.shared_m:
            messages.append(f"errors that poses share make {MM.text(self.shared_m, 2)}")
        if not self.is_explained:
            whose = "the instrument's or the arm's" if np.isnan(self.instrument_m) else "of unknown origin"
            messages.append(f"{MM.text(self.rest_m, 2)} is {whose}")
        for found, where in ((self.over_joints, "neighbouring joint positions"), (self.over_time, "successive poses")):
            if found is not None and found.is_shown:
                messages.append(
                    f"residuals of {where} are alike (correlation {found.correlation:.2g}, p = {found.p:.2g})"
                )
        if self.nearly:
            messages.append(f"seen at 5 % and not taken: {', '.join(self.nearly)}")
        return f"{'; '.join(messages)}. Next: {self.measure_next}."

    @property
    def measure_next(self) -> str:
        """Advise on the next measurements."""
        if self.over_time is not None and self.over_time.is_shown and not self.shared_m:
            return "measure a reference pose repeatedly, and record time_s: the residuals follow the time"
        if self.over_joints is not None and self.over_joints.is_shown:
            model = "auto+residual" if self.searched else "auto, then residual"
            return (
                f"measure more poses where the robot is to work, and try {option_name('model')} {model}: the "
                "residuals are alike at neighbouring joint positions, so the arm makes them"
            )
        if not np.isfinite(self.instrument_m):
            return (
                f"measure some poses twice, or give {option_name('instrument')}: otherwise errors of instrument and "
                "arm are confounded"
            )
        if self.shared_m > max(self.instrument_m, self.rest_m):
            return "visit some poses several times: only repeats separate joint scatter from model discrepancy"
        if self.is_explained:
            return "more poses lower the parameters' uncertainty; no effect is left to be found at this noise"
        return "visit some poses several times: repeats show whether residuals recur with the pose"


def remaining_error(
    residuals: Array,
    joints: Array,
    order: Array,
    dof: int,
    *,
    instrument_m: float,
    shared: ErrorModel | None,
    scatter_slopes: Array,
    nearly: tuple[str, ...] = (),
    searched: bool = False,
) -> RemainingError | None:
    """Take the residuals of a fit apart; None where nothing is left over.

    Args:
        residuals: ``(n, k, 3)`` m, NaN where not observed.
        joints: ``(n, joints)`` rad or m.
        order: ``(n,)`` when each pose was measured.
        instrument_m: the instrument's noise of a coordinate; NaN if unknown.
        scatter_slopes: ``(n, k, 3, joints)`` derivatives by the joints' positions.
    """
    mask = seen_mask(residuals)
    numbers = 3 * int(mask.sum())
    if dof < 1 or not np.any(filled := np.where(mask[..., None], residuals, 0.0)):
        return None
    total = float((filled**2).sum()) / dof
    common = 0.0
    if shared is not None:
        slopes = np.where(mask[..., None, None], scatter_slopes, 0.0)
        scattered = np.einsum("nkdi,ij,nkdj->", slopes, shared.joint_covariance(joints.shape[1]), slopes)
        common = sum(shared.within_m2, float(scattered) / numbers)
    own = 0.0 if np.isnan(instrument_m) else instrument_m**2
    rest = max(total - own - common, 0.0)
    joints_apart, in_time = None, None
    if len(joints) >= _LEAST_POSES:
        joints_apart = _likeness(filled, _neighbours(joints))
        ordered = np.argsort(order, kind="stable")
        in_time = _likeness(filled, np.stack([ordered[:-1], ordered[1:]], axis=1))
    sizes = (float(np.sqrt(each)) for each in (total, common, rest))
    found, common_m, rest_m = sizes
    return RemainingError(found, instrument_m, common_m, rest_m, joints_apart, in_time, nearly, searched)


def _neighbours(joints: Array) -> NDArray[np.int_]:
    """Return each pose with the nearest one that is no repeat of it ``(n, 2)``."""
    labels = configurations(joints)
    first = np.unique(labels, return_index=True)[1]
    if len(first) < 2:
        return np.empty((0, 2), dtype=np.int_)
    scaled = (joints / np.maximum(joints.std(axis=0), 1e-12))[first]
    asked = _thinned(np.arange(len(first)))
    nearest = scipy.spatial.cKDTree(scaled).query(scaled[asked], k=2)[1][:, 1]
    return np.stack([first[asked], first[nearest]], axis=1)


def _thinned(pairs: NDArray[np.int_]) -> NDArray[np.int_]:
    some = evenly(len(pairs), _MOST_PAIRS)
    return pairs if some is None else pairs[some]


def _likeness(residuals: Array, pairs: NDArray[np.int_]) -> _Likeness | None:
    """Return the mean product of pairs' residuals over their mean square, against random orders of the poses.

    Of more poses than twice those pairs have, only theirs change places.
    """
    if len(pairs) < _LEAST_POSES // 2:
        return None
    pairs, rows = _thinned(pairs), residuals.reshape(len(residuals), -1)
    if len(rows) > 2 * _MOST_PAIRS:
        poses, index = np.unique(pairs, return_inverse=True)
        pairs, rows = index.reshape(pairs.shape), rows[poses]
    rng, square = rng_for(0, "flips"), float((rows**2).mean())

    def mean(order: NDArray[np.int_]) -> float:
        return float((rows[order[pairs[:, 0]]] * rows[order[pairs[:, 1]]]).mean()) / square

    here = mean(np.arange(len(rows)))
    drawn = np.array([mean(rng.permutation(len(rows))) for _ in range(_DRAWS)])
    return _Likeness(here, float((1 + np.count_nonzero(drawn >= here)) / (1 + _DRAWS)))


_SPANNED = 1e-10  # of the largest singular value: directions below are dropped
_MOST_POSES = 4_000  # used of more


@dataclass(frozen=True)
class ExplainedError:
    """Error explained by one group, root mean squares of a coordinate over the measured poses.

    Attributes:
        size_m: by how much the predictions would be off without it, all else fitted anew.
        share: of the mean square that geometry alone would leave; shares of groups that are confounded do not add up.
    """

    group: str
    size_m: float
    share: float


def explained_errors(
    model: Model, data: Measurements, values: Array, free: Sequence[int], groups: Mapping[str, Sequence[str]]
) -> tuple[ExplainedError, ...]:
    """Return the error that each group explains, in the order given; empty without groups.

    Args:
        values: ``(p,)`` as they were found.
        groups: by name, the names of their parameters.
    """
    if not groups:
        return ()
    data = thinned(data, _MOST_POSES)
    predicted, jacobian = model.observe(data.inputs(model.conditions), values)
    columns = jacobian[data.seen].reshape(-1, len(values))
    residual = (data.points - predicted)[data.seen].ravel()
    own = {name: [i for i in free if model.names[i] in set(parameters)] for name, parameters in groups.items()}
    effects = [i for indices in own.values() for i in indices]
    rest = _left_by(columns[:, [i for i in free if i not in effects]], columns[:, effects] @ values[effects] + residual)
    whole = float(rest @ rest)
    found = []
    for name, indices in own.items():
        others = [i for i in free if i not in indices]
        left = _left_by(columns[:, others], columns[:, indices] @ values[indices])
        square = float(left @ left)
        found.append(ExplainedError(name, float(np.sqrt(square / len(left))), min(square / max(whole, 1e-300), 1.0)))
    return tuple(found)


def _left_by(columns: Array, vector: Array) -> Array:
    basis, sizes, _ = np.linalg.svd(unit_columns(columns)[0], full_matrices=False)
    basis = basis[:, sizes > _SPANNED * sizes.max(initial=0.0)]
    return np.asarray(vector - basis @ (basis.T @ vector))
