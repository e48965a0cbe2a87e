"""Links that bend and twist: beams with far ends displaced by the torsor of their loads (``dynamics.beam``).

Fitted are compliances, 1/EI and 1/GJ, with the nominal model's masses at the nominal pose: displacements are linear in
them. The change of the loads by the sag is neglected: for a sag s over a reach r, the share s/r.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from lab.core.errors import LabError, option_name
from lab.core.se3 import Array
from lab.kinematics.dynamics.beam import COMPLIANCES
from lab.kinematics.dynamics.gravity import LinkLoads, link_loads
from lab.kinematics.effects.effect import (
    PAYLOAD,
    ArmFacts,
    Effect,
    FittedGroup,
    SimulatedEffect,
    VirtualEffect,
    rates_in,
    rates_of,
    refuse_negative,
)
from lab.kinematics.parameter import section_parameter

__all__ = ["Bending", "ElasticLinks"]

_TWIST_OF_TUBES = 1.32  # EI / GJ = 1 + Poisson's ratio, 0.29 to 0.35 of steel and aluminium (Gere & Goodno 2009, H-2)
_Symbols = Mapping[str, tuple[float, float, float, float]]
_FITTED: Mapping[str, _Symbols] = {  # factors of a link's COMPLIANCES, by parameter
    "bending": {"ei_y": (1, 0, 0, 0), "ei_z": (0, 1, 0, 0)},
    "torsion": {"gj": (0, 0, 1, 0)},
    "extension": {"ea": (0, 0, 0, 1)},
    "tubes": {"ei": (1, 1, _TWIST_OF_TUBES, 0)},
}


def _elastic_links(group: str, links: LinkLoads, *, moving: bool = False) -> Effect:
    """Return the fitted group: ``bending``, 1/EI about two axes (1/(N m^2)) of every link; ``torsion``, 1/GJ.

    ``extension`` is 1/EA (1/N); ``tubes`` is one 1/EI a link of round metal tubes, which bend about every axis and
    twist by it. With ``moving``, inertia is a load, too.
    """
    own = [(link, symbol) for link in links.beams for symbol in _FITTED[group]]
    parameters = tuple(section_parameter(group, link, symbol) for link, symbol in own)
    used = 18 if moving else 9  # at rest gravity is the same everywhere
    # displacement of the far end by each load, for a compliance of one
    by_loads = [
        np.tensordot(links.beams[link].by_loads[:used], _FITTED[group][symbol], axes=(1, 0)) for link, symbol in own
    ]
    chain = links.loads.chain

    def loads_at(joints: Array, conditions: Array) -> Array:
        if moving:
            return links.moving(joints, *rates_in(conditions, chain.size), conditions[:, 0])
        return links.at_rest(joints, conditions[:, 0])[..., :used]

    def offsets(joints: Array, conditions: Array, values: Array) -> tuple[Array, Array]:
        loads = loads_at(joints, conditions)
        derivative = np.zeros((len(joints), len(links.beams), 6, len(own)), dtype=loads.dtype)
        place = {link: at for at, link in enumerate(links.beams)}
        for k, (link, _) in enumerate(own):
            derivative[:, place[link], :, k] = loads[:, link] @ by_loads[k]
        flat = derivative.reshape(len(joints), 6 * len(links.beams), len(own))
        return flat @ values, flat

    def terms(values: Array) -> list[dict[str, Any]]:
        beams = {link: np.zeros((used, 6)) for link in links.beams}
        for (link, _), value, rows in zip(own, values, by_loads, strict=True):
            beams[link] += value * rows
        return [{"beams": {link: rows.tolist() for link, rows in beams.items()}}]

    required = (PAYLOAD, *rates_of(chain.joint_names)) if moving else (PAYLOAD,)
    return Effect(
        group,
        parameters,
        offsets,
        required,
        moves="links",
        links=tuple(links.beams),
        terms=None if moving else terms,
    )


def _fitted(group: str, arm: ArmFacts) -> Effect:
    if beside := arm.chain.beside_serial:
        raise LabError(
            f"{option_name('model')} {group}: robot {arm.chain.name} has {beside}, and nothing bends such a robot here"
        )
    if arm.loads is None:
        raise LabError(
            f"{option_name('model')} {group}: robot {arm.chain.name} is a table without masses; give it as MJCF or URDF"
        )
    return _elastic_links(group, link_loads(arm.loads), moving=arm.moving)


@dataclass(frozen=True)
class ElasticLinks(SimulatedEffect):
    """Elastic links of one arm; ``simulation.elastic`` finds the equilibrium.

    Attributes:
        compliances: ``(n, 4)`` of each link, as ``dynamics.beam.COMPLIANCES``: 1/EI about y and z and 1/GJ in 1/(N
            m^2), 1/EA in 1/N; zero for a stiff link.
    """

    compliances: Array

    def __post_init__(self) -> None:
        refuse_negative("compliances", self.compliances)

    @classmethod
    def none(cls, joints: int) -> Self:
        """Return stiff links."""
        return cls(np.zeros((joints, len(COMPLIANCES))))

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the payload."""
        return (PAYLOAD,) if self.compliances.any() else ()

    def true_parameters(self) -> dict[str, float]:
        """Return 1/EI, 1/GJ and 1/EA; for tubes the mean 1/EI across."""
        found = {}
        for link, own in enumerate(self.compliances):
            for symbols in _FITTED.values():
                for symbol, shares in symbols.items():
                    across = np.array(shares) * [1, 1, 0 if sum(shares) > 1 else 1, 1]
                    found[f"link{link + 1}.{symbol}"] = float(own @ across / across.sum())
        return found


@dataclass(frozen=True)
class Bending(VirtualEffect):
    """Elastic links of a virtual arm."""

    link_ei: tuple[float, ...] = ()
    """Bending stiffness EI of the links, N m²: one number for all that have a length, or one each; 0 is stiff."""
    link_gj: tuple[float, ...] = ()
    """Torsional stiffness GJ of the links, N m²: as --link-ei."""

    groups: ClassVar[tuple[FittedGroup, ...]] = (
        FittedGroup("bending", lambda arm: _fitted("bending", arm), "links that bend under their load"),
        FittedGroup("torsion", lambda arm: _fitted("torsion", arm), "links that twist under their load"),
        FittedGroup(  # some 0.1 µm of a metal tube: no candidate
            "extension",
            lambda arm: _fitted("extension", arm),
            "links that grow longer under their load",
            is_candidate=False,
        ),
        FittedGroup(  # which is known beforehand, not found: no candidate
            "tubes",
            lambda arm: _fitted("tubes", arm),
            "links that bend and twist as round metal tubes, by one number each",
            is_candidate=False,
        ),
    )

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Return the compliances of the robot's description; an option replaces its kind (one EI across a link)."""
        compliances = ElasticLinks.none(arm.chain.size).compliances if arm.sections is None else arm.sections.copy()
        for option, symbols in (("ei", ("ei_y", "ei_z")), ("gj", ("gj",))):
            given = getattr(self, f"link_{option}")
            if any(given):
                stiffness = _of_each(option_name(f"link_{option}"), given, arm)
                inverse = np.divide(1.0, stiffness, out=np.zeros_like(stiffness), where=stiffness > 0)
                for symbol in symbols:
                    compliances[:, COMPLIANCES.index(symbol)] = inverse
        return ElasticLinks(compliances)


def _of_each(flag: str, given: tuple[float, ...], arm: ArmFacts) -> Array:
    size, name = arm.chain.size, arm.chain.name
    if arm.chain.beside_serial or arm.loads is None:
        why = f"has {arm.chain.beside_serial}" if arm.chain.beside_serial else "has no masses"
        raise LabError(f"{flag}: robot {name} {why}, so nothing bends it")
    if len(given) not in (1, size):
        raise LabError(f"{flag}: {len(given)} numbers for the {size} links of robot {name}; give one, or one for each")
    bends = np.zeros(size, dtype=np.bool_)
    bends[list(link_loads(arm.loads).beams)] = True
    if len(given) == 1:
        return np.where(bends, given[0], 0.0)
    if short := [link for link in range(size) if given[link] and not bends[link]]:
        raise LabError(f"{flag}: link {short[0] + 1} of robot {name} has no length, so it does not bend; give it 0")
    return np.array(given, dtype=np.float64)
