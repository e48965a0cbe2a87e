"""The canonical gauge: one choice of identifiable parameters for each arm.

Columns of the Jacobian are taken in a fixed order of preference, each retained if earlier ones do not span it. Errors
of the others equal errors of retained ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from fnmatch import fnmatchcase
from functools import cached_property, partial

import numpy as np

from lab.core.errors import LabError, option_name
from lab.core.linear_model import triangle, unit_columns
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.values import Deferred, DeferredField
from lab.kinematics.compiled.kernels import independent, with_fallback
from lab.kinematics.model import Model
from lab.kinematics.parameter import Parameter, indices_of_groups
from lab.kinematics.serial.chain import Chain

__all__ = [
    "STRUCTURE_POSES",
    "BaseSet",
    "base_set",
    "base_set_of",
    "independent_columns",
    "named",
    "placed_after_tool",
    "preferred_cells",
    "preferred_columns",
    "same_base_set",
    "scale_link",
    "structure_jacobian",
]

_INDEPENDENT = 1e-8  # least part of a unit column orthogonal to the retained ones
_NO_REPEAT = 0.1  # part of a unit column above which one orthogonalization suffices
STRUCTURE_POSES = 200


@dataclass(frozen=True)
class BaseSet:
    """Identifiable parameters, and the fixed ones that are confounded with them.

    Attributes:
        identifiable: indices, ascending.
        fixed: indices of the others, ascending.
        triangle: ``(r, p)`` R of the Jacobian.
        fixed_observable: fixed parameters that could be identified: fixed on request, or observable only because others
            are fixed.
    """

    identifiable: tuple[int, ...]
    fixed: tuple[int, ...]
    triangle: DeferredField[Array] = DeferredField()  # noqa: RUF009
    fixed_observable: tuple[int, ...] = ()

    @cached_property
    def alias(self) -> Array:
        """Errors ``(identifiable, fixed)`` of identifiable parameters that equal an error of 1 in a fixed one (SI)."""
        identifiable, fixed = list(self.identifiable), list(self.fixed)
        scaled, scale = unit_columns(self.triangle)
        found = np.linalg.lstsq(scaled[:, identifiable], scaled[:, fixed], rcond=None)[0]
        found[:, np.linalg.norm(self.triangle[:, fixed], axis=0) < _INDEPENDENT] = 0.0  # rounding
        found[:, [self.fixed.index(i) for i in self.fixed_observable]] = 0.0
        return np.asarray(found * scale[fixed] / scale[identifiable][:, None])


def base_set(
    model: Model,
    values: Array,
    inputs: Array | None = None,
    *,
    fix: Sequence[str] = (),
    free: Sequence[str] = (),
    prior_rows: Array | None = None,
) -> BaseSet:
    """Return the identifiable parameters at ``values``, from ``inputs`` or at most 200 random ones.

    Take ``values`` at the nominal links: elsewhere the null directions are only nearly null.

    Args:
        fix: parameters to fix at nominal, names or patterns (``tool.*``).
        free: fixed parameters to identify, in place of others.
        prior_rows: ``(r, p)`` derivatives of prior information, in m.

    Raises:
        LabError: a name is unknown, or a parameter to free is not identifiable.
    """
    if inputs is None:
        jacobian = structure_jacobian(model, values, min(STRUCTURE_POSES, 2 * len(model.names)))
    else:
        jacobian = model.observe(inputs, model.rank_point(values))[1]
    flat, order = jacobian.reshape(-1, len(model.names)), model.column_priority()
    if prior_rows is not None:
        flat = np.concatenate([flat, prior_rows])
    if not (fix or free):
        return base_set_of(flat, order)
    fixed, freed = named(model.names, option_name("fix"), fix), named(model.names, option_name("free"), free)
    return _as_wished(model, base_set_of(flat, order), fixed, freed)


def same_base_set(structure: BaseSet, model: Model, values: Array) -> BaseSet:
    """Return a base set for other values of base and tool, which change no identifiability: only the aliases.

    Args:
        values: ``(p,)`` with the nominal links of ``structure``, which is of at most 200 random poses.
    """
    return replace(structure, triangle=Deferred(partial(_structure_triangle, model, values)))


def _structure_triangle(model: Model, values: Array) -> Array:
    """Return R ``(r, p)`` of the Jacobian at the random poses by which a structure is decided."""
    poses = min(STRUCTURE_POSES, 2 * len(model.names))
    return triangle(structure_jacobian(model, values, poses).reshape(-1, len(model.names)))


def structure_jacobian(model: Model, values: Array, poses: int) -> Array:
    """Return derivatives ``(poses, k, d, p)`` at reproducible random poses, for decisions on rank."""
    return model.observe(model.structure_joints(poses, rng_for(0, "structure")), model.rank_point(values))[1]


def named(names: Sequence[str], option: str, patterns: Sequence[str]) -> tuple[int, ...]:
    """Return indices of the parameters that match names or patterns; refuse one without a match."""
    found: set[int] = set()
    for pattern in patterns:
        hits = [i for i, name in enumerate(names) if fnmatchcase(name, pattern)]
        if not hits:
            groups = ", ".join(dict.fromkeys(f"{name.rsplit('.', 1)[0]}.*" for name in names))
            near = get_close_matches(pattern, names)
            nearest = f"the nearest are {', '.join(near)}; " if near else ""
            raise LabError(f"{option} {pattern}: no such parameter; {nearest}the groups are {groups}")
        found.update(hits)
    return tuple(sorted(found))


def _as_wished(model: Model, usual: BaseSet, fix: Sequence[int], free: Sequence[int]) -> BaseSet:
    """Return the base set with some parameters fixed and some freed."""
    if both := set(fix) & set(free):
        raise LabError(
            f"{option_name('fix')} and {option_name('free')} both name {model.names[min(both)]}: name it once"
        )
    upper = usual.triangle
    left = [i for i in usual.identifiable if i not in fix]
    wished = [*left, *(i for i in free if i not in usual.identifiable)]
    if not wished:
        raise LabError(f"{option_name('fix')} leaves no parameter to identify: fix fewer")
    retained = independent_columns(upper, wished)
    if lost := [i for i in wished if i not in retained]:
        raise LabError(_hidden_note(model, usual, lost[0], left))
    wished_set = _of_retained(upper, retained)
    beyond = [i for i in wished_set.fixed if len(independent_columns(upper, [*retained, i])) > len(retained)]
    return replace(wished_set, fixed_observable=tuple(beyond))


def _hidden_note(model: Model, usual: BaseSet, lost: int, left: Sequence[int]) -> str:
    """Describe why a parameter cannot be freed: which of those that are left (their indices) hide it."""
    alias = usual.alias[:, usual.fixed.index(lost)]
    strong = np.abs(alias) > 1e-9 * max(np.abs(alias).max(), 1e-300)
    into = [model.names[i] for i, big in zip(usual.identifiable, strong, strict=True) if big and i in left]
    name = model.names[lost]
    why = f"it is hidden in {', '.join(into)}: fix one of these in its place" if into else "nothing shows it"
    return f"{option_name('free')} {name}: {name} is not identifiable; {why}"


def base_set_of(jacobian: Array, order: Sequence[int]) -> BaseSet:
    """Return the base set of a Jacobian ``(rows, p)`` with columns preferred in ``order``."""
    upper = triangle(jacobian)  # the same inner products, fewer rows
    return _of_retained(upper, independent_columns(upper, order))


def _of_retained(upper: Array, kept: tuple[int, ...]) -> BaseSet:
    return BaseSet(kept, tuple(i for i in range(upper.shape[1]) if i not in kept), upper)


def _gram_schmidt(jacobian: Array, order: Sequence[int]) -> tuple[int, ...]:
    norms = np.linalg.norm(jacobian, axis=0)
    basis = np.empty((len(jacobian), len(order)), order="F")
    retained: list[int] = []
    for column in order:
        if norms[column] <= _INDEPENDENT:
            continue
        rest, spanned = jacobian[:, column] / norms[column], basis[:, : len(retained)]
        for _ in range(2):
            rest = rest - spanned @ (spanned.T @ rest)
            size = np.sqrt(rest @ rest)
            if size > _NO_REPEAT:
                break
        if size > _INDEPENDENT:
            basis[:, len(retained)] = rest / size
            retained.append(column)
    return tuple(sorted(retained))


@with_fallback(_gram_schmidt)
def independent_columns(jacobian: Array, order: Sequence[int]) -> tuple[int, ...]:
    """Return the columns that earlier ones in ``order`` do not span, ascending.

    Gram-Schmidt, repeated if little of a column remains (Daniel et al. 1976).
    """
    wanted = np.array(order, dtype=np.int64)
    return tuple(np.sort(wanted[independent(jacobian, wanted, _INDEPENDENT)]).tolist())


def preferred_columns(chain: Chain, parameters: Sequence[Parameter]) -> tuple[int, ...]:
    """Return all columns of a serial arm in the canonical order of preference.

    First the base, which moves the first link; then each link outward without what its neighbours move (Hayati's beta
    instead of d between parallel axes; neither d nor, in a Craig table, a of a slide); then the tool, which moves the
    last link; then all others.
    """
    at = {parameter.name: i for i, parameter in enumerate(parameters)}
    links = [at[f"link{i + 1}.{column}"] for i in range(chain.size) for column in preferred_cells(chain, i)]
    order = [*indices_of_groups(parameters, ["base"]), *links, *indices_of_groups(parameters, ["tool"])]
    return (*order, *(i for i in range(len(parameters)) if i not in order))


def preferred_cells(chain: Chain, i: int, *, on_base: bool = True) -> list[str]:
    """Return the columns of row ``i`` (from 0) of a chain's table that its neighbours do not move.

    Args:
        on_base: whether the base moves the first link; False for a chain that shares its first joint with another one,
            by which the base is placed.
    """
    rule = _preferred_distal if chain.convention == "distal" else _preferred_craig
    return rule(chain, i, on_base and i == 0)


def scale_link(model: Model, lengths: Array) -> int:
    """Return the index of the longest identifiable length of an arm's links: what sets its size where nothing shows it.

    Args:
        model: the arm, measured by points.
        lengths: ``(p,)`` its nominal parameters.
    """
    order = [i for i in model.column_priority() if model.parameters[i].group != "base"]
    near = [(i, model.parameters[i]) for i in order[: _end_of_tool(model.parameters, order)]]
    return max((i for i, each in near if each.is_link and each.kind == "length"), key=lambda i: abs(lengths[i]))


def placed_after_tool(
    parameters: Sequence[Parameter], order: Sequence[int], carried: Sequence[int] = (), last: int | None = None
) -> tuple[int, ...]:
    """Return an order of preference with further parameters after the tool's.

    Args:
        parameters: of the arm.
        order: indices of parameters, the tool's among them.
        carried: indices of parameters of what the tool carries, which come first after it.
        last: index of a length, preferred to the tool in ``order``, that comes after these, so that it stays nominal
            where nothing shows the arm's size.
    """
    found, end = list(order), _end_of_tool(parameters, order)
    found[end:end] = carried
    if last is not None:
        found.remove(last)
        found.insert(end + len(carried) - 1, last)
    return tuple(found)


def _end_of_tool(parameters: Sequence[Parameter], order: Sequence[int]) -> int:
    return 1 + max(order.index(i) for i in indices_of_groups(parameters, ["tool"]))


def _preferred_distal(chain: Chain, i: int, on_base: bool) -> list[str]:
    if i == chain.size - 1:
        return []
    drop = {"d"} if chain.joins_parallel_axes(i) else {"beta"}
    if on_base:
        drop |= {"theta", "d"}
    if chain.prismatic[i]:
        drop |= {"d", "theta"} if chain.joins_parallel_axes(i) else {"d"}
    if chain.prismatic[i + 1]:
        drop |= {"a"}
    return [column for column in ("theta", "d", "a", "alpha", "beta") if column not in drop]


def _preferred_craig(chain: Chain, i: int, on_base: bool) -> list[str]:
    if on_base:
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
