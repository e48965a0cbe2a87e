"""Simulate the case of Mahdadi & Bouafia (2020): 19 parameters of the IRB 120, by its flange's origin, base given.

The flange's origin does not show d2, d5, a5, theta6 and alpha6: the thesis drops them, and their errors appear in d3,
theta5 and alpha5. Units are millimetres and radians, as in the thesis.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.reproduction.source_models import serial
from lab.kinematics.parameter import Parameter
from lab.kinematics.serial.serial_arm import SerialArm
from lab.noise.instruments import instrument
from lab.pose_selection.criteria import Criterion, Scaling, criterion, indices
from lab.pose_selection.exchange import Design, OneCriterion, climb, exchange

__all__ = [
    "CRITERIA",
    "DROPPED",
    "HIDDEN",
    "INTO",
    "OFFSETS",
    "PRINTED",
    "converging",
    "errors",
    "rows_of_table",
    "searched",
    "thesis_case",
    "without",
]

CRITERIA = ("O1", "O2", "O3", "O4", "O5", "condition")
_POSES = 20
# Table IV.2: errors of the arm (mm, rad), in the thesis' order of the 19.
OFFSETS: Mapping[str, float] = MappingProxyType(
    {
        "link1.theta": 0.0013, "link1.d": 1.005, "link1.a": 1.23, "link1.alpha": 0.0017,
        "link2.theta": 0.0014, "link2.a": 1.44, "link2.alpha": 0.0013,
        "link3.theta": 0.0022, "link3.d": 0.21, "link3.a": 0.165, "link3.alpha": 0.0004,
        "link4.theta": 0.0168, "link4.d": 0.54, "link4.a": 1.155, "link4.alpha": 0.0004,
        "link5.theta": 0.0021, "link5.alpha": 0.0007,
        "link6.d": 0.57, "link6.a": 0.495,
    }
)  # fmt: skip
# Unprinted errors, by those of d3, theta5 and alpha5 in every column of table IV.2. theta6 and alpha6 have no effect.
HIDDEN: Mapping[str, float] = MappingProxyType({"link2.d": 0.60, "link5.a": 0.36, "link5.d": 0.93})
DROPPED = (*HIDDEN, "link6.theta", "link6.alpha")
INTO = {"link2.d": "link3.d", "link5.a": "link5.theta", "link5.d": "link5.alpha"}
# Table IV.3, as printed.
PRINTED: Mapping[str, tuple[float, ...]] = MappingProxyType(
    {
        "RMS": (0.1376, 0.1383, 0.1374, 0.1376, 0.1389, 0.1383),
        "MAE": (0.0327, 0.0329, 0.0327, 0.0328, 0.0333, 0.0330),
        "RSD": (0.1375, 0.1382, 0.1373, 0.1375, 0.1388, 0.1381),
    }
)


@dataclass(frozen=True)
class _Case:
    """The arm of the thesis.

    Attributes:
        arm: with the flange's origin as only target.
        nominal: parameters ``(p,)`` of the nominal model, SI; the base at rest.
        free: indices of the 19, in the order of ``OFFSETS``.
        mm: factors ``(19,)`` from SI to mm or rad.
    """

    arm: SerialArm
    nominal: Array
    free: tuple[int, ...]
    mm: Array

    def parameter(self, name: str) -> Parameter:
        """Return the parameter of this name."""
        return self.arm.parameters[self.arm.names.index(name)]

    def truth(self, hidden: Mapping[str, float] = HIDDEN) -> Array:
        """Return the parameters ``(p,)``, SI, of the measured arm."""
        values = self.nominal.copy()
        for name, off in (*OFFSETS.items(), *hidden.items()):
            values[self.arm.names.index(name)] += off if self.parameter(name).is_angle else off / 1e3
        return values


@cache
def thesis_case() -> _Case:
    """Return the nominal arm of the thesis."""
    arm, nominal = serial("irb120")
    free = tuple(arm.names.index(name) for name in OFFSETS)
    return _Case(arm, nominal, free, np.array([1.0 if arm.parameters[i].is_angle else 1e3 for i in free]))


def searched(name: str, seed: int, count: int, starts: int, *, limits: bool = False, poses: int = _POSES) -> Design:
    """Search the best of some exchanges among random candidates, each followed by an ascent.

    Args:
        limits: keep the joints within theirs; else they turn freely.
    """
    search = _CandidateSearch.of(name, seed, count, limits=limits)
    return max((search.ascended(search.exchanged(poses)) for _ in range(starts)), key=lambda design: design.score)


def converging(seed: int, count: int, starts: int, rounds: int) -> Array:
    """Return O1 ``(starts, rounds + 1)`` of 20 poses: after each start's exchange, and each round of its ascent."""
    search = _CandidateSearch.of("O1", seed, count, limits=False)
    found = []
    for _ in range(starts):
        design = search.exchanged(_POSES)
        found.append([float(indices(design.jacobian).o1)])
        for _ in range(rounds):
            design = search.ascended(design, rounds=1)
            found[-1].append(float(indices(design.jacobian).o1))
    return np.array(found)


@dataclass(frozen=True)
class _CandidateSearch:
    """A search among random candidates; raw units, the arm alone."""

    goal: Criterion
    candidates: Array
    rng: np.random.Generator
    bounds: tuple[Array, Array]

    @classmethod
    def of(cls, name: str, seed: int, count: int, *, limits: bool) -> "_CandidateSearch":
        """Create the search of a seed."""
        rng, chain = rng_for(seed, "design"), thesis_case().arm.chain
        turn = np.full(chain.size, np.pi)
        lower, upper = (chain.lower, chain.upper) if limits else (-turn, turn)
        bounds = (lower, upper) if limits else (-np.inf * turn, np.inf * turn)
        return cls(criterion(name, len(OFFSETS)), rng.uniform(lower, upper, (count, chain.size)), rng, bounds)

    def exchanged(self, poses: int) -> Design:
        """Return the best of one start's exchange."""
        return exchange(self.candidates, _sensitivity(self.candidates), poses, self.goal, self.rng, starts=1)

    def ascended(self, design: Design, rounds: int = 4) -> Design:
        """Return the design after a local ascent in all angles."""
        return climb(design, OneCriterion(_sensitivity, self.goal), _anywhere, *self.bounds, rounds=rounds)


def _sensitivity(joints: Array) -> Array:
    """Return Jacobians ``(n, 3, 19)`` by the 19, in mm and rad."""
    case = thesis_case()
    scale = Scaling("raw").columns([case.parameter(name) for name in OFFSETS], np.empty((0, 3, len(OFFSETS))))
    rates: Array = case.arm.observe(joints, case.nominal)[1][:, 0][..., list(case.free)] * scale
    return rates


def _anywhere(joints: Array) -> NDArray[np.bool_]:
    return np.ones(len(joints), dtype=np.bool_)


def errors(joints: Array, draws: int, seed: int = 0, hidden: Mapping[str, float] = HIDDEN) -> Array:
    """Simulate errors of the 19 ``(draws, 19)``, mm and rad, with noise of ±8 µm, equal for all sets of poses.

    They are linearized about the nominal model: in an exact one d6 would come out 7 µm off, unlike the thesis' value.
    """
    case, device = thesis_case(), instrument("uniform-8um")
    truth, free = case.truth(hidden), list(case.free)
    rates = case.arm.observe(joints, case.nominal)[1].reshape(-1, len(truth))
    inverse = np.linalg.pinv(rates[:, free] * case.mm) * case.mm[:, None]
    silent = np.zeros((len(joints), 1, 3))
    noise = np.array([device.sample(silent, rng_for(seed, "noise", draw)).ravel() for draw in range(draws)])
    off = truth - case.nominal
    found = (noise + rates @ off) @ inverse.T - off[free]
    return np.asarray(found * case.mm, dtype=np.float64)


def rows_of_table(off: Array) -> dict[str, Array]:
    """Return RMS, MAE and RSD ``(...)`` of errors ``(..., 19)`` in mm and rad, as in table IV.3.

    The RSD is the standard deviation of the 19 about their mean, over 18.
    """
    return {
        "RMS": np.sqrt((off**2).mean(axis=-1)),
        "MAE": np.abs(off).mean(axis=-1),
        "RSD": np.asarray(off.std(axis=-1, ddof=1)),
    }


def without(off: Array, names: Sequence[str] = tuple(INTO.values())) -> Array:
    """Return the errors without those of some parameters."""
    return off[..., [i for i, name in enumerate(OFFSETS) if name not in names]]
