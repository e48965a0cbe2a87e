"""The canonical gauge: which parameters of an arm can be told apart, one choice for each arm.

Columns of the Jacobian are taken in a fixed order of preference, and one is kept if it says
something that those before it do not. Every parameter left out is an alias of kept ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lab.frames import Array
from lab.geometry.chain import Chain
from lab.geometry.model import Model
from lab.seeds import stream

INDEPENDENT = 1e-8  # the least part of a unit column that is orthogonal to those kept
STRUCTURE_POSES = 200


@dataclass(frozen=True)
class BaseSet:
    """The identifiable parameters, and what each of the others is hidden in.

    Attributes:
        kept: indices of the identifiable parameters, ascending.
        fixed: indices of the others, ascending.
        alias: ``(kept, fixed)``: an error of 1 in a fixed parameter looks exactly like errors of
            its column in the kept ones (units: those of kept per fixed, in m and rad).
    """

    kept: tuple[int, ...]
    fixed: tuple[int, ...]
    alias: Array


def base_set(model: Model, values: Array, joints: Array | None = None) -> BaseSet:
    """The identifiable parameters at ``values``, from ``joints`` or 200 random readings in the limits.

    Take ``values`` at the nominal links: away from them the null directions are only nearly
    null, and no tolerance repairs that.
    """
    if joints is None:
        joints = model.structure_joints(STRUCTURE_POSES, stream(0, "structure"))
    _, jacobian = model.observe(joints, model.structural(values))
    return base_set_of(jacobian.reshape(-1, len(model.names)), model.preferred())


def base_set_of(jacobian: Array, order: Sequence[int]) -> BaseSet:
    """The base set of a Jacobian ``(rows, p)``, its columns preferred in ``order``."""
    triangle = np.asarray(np.linalg.qr(jacobian, mode="r"))  # the same inner products, fewer rows
    kept = independent_columns(triangle, order)
    fixed = tuple(column for column in range(jacobian.shape[1]) if column not in kept)
    norms = np.linalg.norm(triangle, axis=0)
    scale = np.where(norms > 0, norms, 1.0)
    scaled = triangle / scale
    alias = np.linalg.lstsq(scaled[:, kept], scaled[:, fixed], rcond=None)[0]
    return BaseSet(kept, fixed, alias * scale[list(fixed)] / scale[list(kept)][:, None])


def independent_columns(jacobian: Array, order: Sequence[int]) -> tuple[int, ...]:
    """Columns that those before them in ``order`` do not span, ascending (Gram-Schmidt, done twice)."""
    norms = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / np.where(norms > 0, norms, 1.0)
    basis = np.empty((len(scaled), len(order)), order="F")
    kept: list[int] = []
    for column in order:
        rest = scaled[:, column]
        known = basis[:, : len(kept)]
        rest = rest - known @ (known.T @ rest)
        rest = rest - known @ (known.T @ rest)
        size = np.sqrt(rest @ rest)
        if norms[column] > INDEPENDENT and size > INDEPENDENT:
            basis[:, len(kept)] = rest / size
            kept.append(column)
    return tuple(sorted(kept))


def preferred_columns(chain: Chain, names: Sequence[str]) -> tuple[int, ...]:
    """All columns of a serial arm in the order of preference that gives the canonical gauge.

    First the base, which carries the first link; then each link outward without what its
    neighbours carry (Hayati's beta instead of d between parallel axes; neither d nor, in a
    Craig table, a of a slide); then the tool, which carries the last link; then all the rest.
    """
    rule = _preferred_distal if chain.convention == "distal" else _preferred_craig
    links = [f"link{i + 1}.{column}" for i in range(chain.size) for column in rule(chain, i)]
    first = [name for name in names if name.startswith("base.")]
    tools = [name for name in names if name.startswith("tool.")]
    order = [names.index(name) for name in [*first, *links, *tools]]
    return (*order, *(i for i in range(len(names)) if i not in order))


def _preferred_distal(chain: Chain, i: int) -> list[str]:
    if i == chain.size - 1:
        return []
    drop = set()
    if chain.joins_parallel_axes(i):
        drop |= {"d"}
    else:
        drop |= {"beta"}
    if i == 0:
        drop |= {"theta", "d"}
    if chain.prismatic[i]:
        drop |= {"d", "theta"} if chain.joins_parallel_axes(i) else {"d"}
    if chain.prismatic[i + 1]:
        drop |= {"a"}
    return [column for column in ("theta", "d", "a", "alpha", "beta") if column not in drop]


def _preferred_craig(chain: Chain, i: int) -> list[str]:
    if i == 0:
        return []
    drop = set()
    if not chain.joins_parallel_axes(i - 1):
        drop |= {"beta"}
    if chain.joins_parallel_axes(i):
        drop |= {"d"}
    if chain.prismatic[i]:
        drop |= {"a", "d", "theta"} if chain.joins_parallel_axes(i) else {"a", "d"}
    if i == chain.size - 1:
        drop |= {"theta", "d"}
    return [column for column in ("alpha", "a", "beta", "theta", "d") if column not in drop]
