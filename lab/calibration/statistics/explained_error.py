"""How much of the error each group of effects explains, beside geometry and the other groups.

On the linear problem at the fit, what a group adds to the predictions is J_g v_g, its parameters away from zero.
Without it the others would be fitted anew and take up what they can: what is left of it is the part that is orthogonal
to their columns (Seber & Lee 2003, section 3.9). Groups that can say the same explain little each, and more together.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lab.core.linear_model import unit_columns
from lab.core.measurements import Measurements, thinned
from lab.core.se3 import Array
from lab.kinematics.model import Model

__all__ = ["ExplainedError", "explained_errors"]

_SPANNED = 1e-10  # of the largest singular value: a direction below says nothing
_MOST_POSES = 4_000  # by which it is told


@dataclass(frozen=True)
class ExplainedError:
    """Of one group, root mean squares of a coordinate over the measured poses.

    Attributes:
        group: its name.
        size_m: by how much the predictions would be off without it, all else fitted anew.
        share: of the mean square that geometry alone would leave; shares of groups that can say the same do not add up.
    """

    group: str
    size_m: float
    share: float


def explained_errors(
    model: Model, data: Measurements, values: Array, free: Sequence[int], groups: Mapping[str, Sequence[str]]
) -> tuple[ExplainedError, ...]:
    """What each group explains, in the order given; nothing where there are no groups.

    Args:
        model: of measured points, fitted to ``data``.
        values: ``(p,)`` as they were found.
        free: which of these were fitted.
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
    """What is orthogonal to the columns."""
    basis, sizes, _ = np.linalg.svd(unit_columns(columns)[0], full_matrices=False)
    basis = basis[:, sizes > _SPANNED * sizes.max(initial=0.0)]
    return np.asarray(vector - basis @ (basis.T @ vector))
