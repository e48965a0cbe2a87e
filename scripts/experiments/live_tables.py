"""Compute tables IV.2 and IV.3 of Mahdadi and Bouafia 2020 for any index, noise and seed, and each index's wins.

The errors are those of ``thesis_case``: a linear arm, so that the part by noise grows with the noise, and the bias by
the dropped parameters does not. That bias is in three of the 19 rows alone, d3, theta5 and alpha5. With them the RMS is
the bias; without them it is the root mean variance of the 16 others, which criterion A minimizes for all 19.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lab.core.errors import LabError
from lab.core.probability import t_isf
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.reproduction.thesis_case import (
    CRITERIA,
    OFFSETS,
    errors,
    rows_of_table,
    searched,
    thesis_case,
    without,
)
from lab.pose_selection.criteria import indices

__all__ = ["INDICES", "Chance", "LiveTables", "chances", "commonest_order", "live_tables"]

INDICES = (*CRITERIA, "A", "random")
_NOISE_UM = 8.0  # of the thesis, half the width of a uniform distribution
_CANDIDATES, _POSES = 200, 20
_TAIL = 0.025
_SCORES = ("o1", "o2", "o3", "o4", "o5")


@dataclass(frozen=True)
class LiveTables:
    """Both tables for the poses of one search by each index.

    Attributes:
        seed: of the candidates, the search and the noise.
        noise_um: half the width of the uniform noise of each coordinate.
        joints: joint angles ``(20, 6)`` by index.
        errors: estimated less true values ``(draws, 19)``, mm and rad, by index; all indices see the same noise.
    """

    seed: int
    noise_um: float
    joints: Mapping[str, Array]
    errors: Mapping[str, Array]

    def kept(self, *, all_rows: bool) -> dict[str, Array]:
        """Return the errors ``(draws, 19)``, or those ``(draws, 16)`` without the three biased rows."""
        return {name: off if all_rows else without(off) for name, off in self.errors.items()}

    def estimates(self, draw: int = 0) -> dict[str, Array]:
        """Return the estimated values ``(19,)`` of table IV.2, mm and rad, of one draw of the noise."""
        true = np.array(list(OFFSETS.values()))
        return {name: true + off[draw] for name, off in self.errors.items()}

    def rows(self, *, all_rows: bool) -> dict[str, dict[str, Array]]:
        """Return RMS, MAE and RSD ``(draws,)`` of table IV.3, by row and index."""
        found = {name: rows_of_table(off) for name, off in self.kept(all_rows=all_rows).items()}
        return {row: {name: rows[row] for name, rows in found.items()} for row in ("RMS", "MAE", "RSD")}

    def shares(self, *, all_rows: bool) -> dict[str, float]:
        """Return the share of draws in which an index has the least RMS; indices with the same poses share it."""
        rms = np.array(list(self.rows(all_rows=all_rows)["RMS"].values()))
        least = np.isclose(rms, rms.min(axis=0), rtol=1e-9, atol=0)
        return dict(zip(self.errors, (least / least.sum(axis=0)).mean(axis=1).tolist(), strict=True))

    @cached_property
    def expected(self) -> dict[str, float]:
        """The root of the expected mean square error of the 16 unbiased rows, mm and rad, by index."""
        variance, found = (self.noise_um / 1e3) ** 2 / 3, {}
        for name, joints in self.joints.items():
            rates = _rates(joints)
            information = np.einsum("ndp,ndq->pq", rates, rates)
            found[name] = float(np.sqrt(variance * without(np.diag(np.linalg.inv(information))).mean()))
        return found

    @property
    def scores(self) -> dict[str, dict[str, float]]:
        """O1 to O5 of each set of poses, over the best of all sets: by the index that chose it, then by index."""
        found = {name: indices(_rates(joints)) for name, joints in self.joints.items()}
        best = {each: max(float(getattr(one, each)) for one in found.values()) for each in _SCORES}
        return {
            name: {each.upper(): float(getattr(one, each)) / best[each] for each in _SCORES}
            for name, one in found.items()
        }

    @cached_property
    def order(self) -> tuple[str, ...]:
        """The indices by their expected error without the three rows, the best first."""
        return tuple(sorted(self.expected, key=lambda name: self.expected[name]))


@dataclass(frozen=True)
class Chance:
    """The probability that an index has the least RMS, mean over the searches, with its 95 % interval (Student's t)."""

    mean: float
    lower: float
    upper: float


def live_tables(
    names: Sequence[str] = CRITERIA, noise_um: float = _NOISE_UM, seed: int = 0, draws: int = 2000
) -> LiveTables:
    """Choose 20 poses by each index, as the thesis without joint limits, and simulate campaigns with them.

    Args:
        names: of ``INDICES``; O2 and its inverse, the condition number, have the same poses.
        noise_um: half the width of the uniform noise of each coordinate.

    Raises:
        LabError: there is no such index, an index is named twice, or the noise or the draws are not positive.
    """
    _check_names(names)
    if not 0 < noise_um < np.inf:
        raise LabError(f"noise of {noise_um:g} µm: give a positive one")
    if draws < 1:
        raise LabError(f"{draws} draws: give 1 or more")
    chosen: dict[str, Array] = {}
    for name in names:
        twin = {"O2": "condition", "condition": "O2"}.get(name, name)
        chosen[name] = chosen[twin] if twin in chosen else _poses(name, seed)
    return LiveTables(seed, noise_um, chosen, {name: _errors(at, noise_um, seed, draws) for name, at in chosen.items()})


def _check_names(names: Sequence[str]) -> None:
    if unknown := [name for name in names if name not in INDICES]:
        raise LabError(f"index '{unknown[0]}' is unknown: choose of {', '.join(INDICES)}")
    if not names or len(set(names)) < len(names):
        raise LabError("indices: name each one once, and at least one")


def _rates(joints: Array) -> Array:
    """Return Jacobians ``(n, 3, 19)``, mm and rad."""
    case = thesis_case()
    return np.asarray(MM.of(case.arm.observe(joints, case.nominal)[1][:, 0][..., list(case.free)]) / case.mm)


def _poses(name: str, seed: int) -> Array:
    if name == "random":
        return rng_for(seed, "poses").uniform(-np.pi, np.pi, (_POSES, thesis_case().arm.chain.size))
    return searched("O2" if name == "condition" else name, seed, _CANDIDATES, 1).joints


def _errors(joints: Array, noise_um: float, seed: int, draws: int) -> Array:
    """Scale the part of the errors that noise makes, and add the bias of the dropped parameters."""
    clean = errors(joints, draws, seed, hidden={})
    bias = errors(joints, 1, seed)[0] - clean[0]
    return np.asarray(clean * (noise_um / _NOISE_UM) + bias)


def chances(searches: Sequence[LiveTables], *, all_rows: bool) -> dict[str, Chance]:
    """Return each index's probability of the least RMS; with one search the interval is that of its draws.

    Args:
        searches: of different seeds, with the same indices.
    """
    found = {}
    for name in searches[0].errors:
        shares = np.array([each.shares(all_rows=all_rows)[name] for each in searches])
        mean = float(shares.mean())
        if len(shares) > 1:
            half = float(t_isf(_TAIL, len(shares) - 1)) * float(shares.std(ddof=1)) / np.sqrt(len(shares))
        else:
            half = 1.96 * float(np.sqrt(mean * (1 - mean) / len(searches[0].errors[name])))
        found[name] = Chance(mean, max(mean - half, 0.0), min(mean + half, 1.0))
    return found


def commonest_order(searches: Sequence[LiveTables]) -> tuple[tuple[str, ...], int]:
    """Return the order of the indices without the three rows that most searches have, and in how many."""
    return Counter(each.order for each in searches).most_common(1)[0]
