"""Registry of all effects: the groups of ``--model`` and the options of a virtual arm.

``EFFECTS`` lists the lab's. A package adds an effect by an entry point of ``lab.effects``.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from difflib import get_close_matches
from functools import partial
from typing import TypeVar

from lab.core.errors import LabError, option_name
from lab.core.limits import OPTION_SIZE
from lab.core.recent import recent
from lab.extension_points import added
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.effects.backlash import Backlash, Hysteresis, Lag
from lab.kinematics.effects.bending import Bending
from lab.kinematics.effects.compliance import Compliance, GravityCompensator, Hardening
from lab.kinematics.effects.coupling import Coupling, FullCoupling, Gear
from lab.kinematics.effects.effect import (
    NO_SESSIONS,
    OWN_EFFECTS,
    ArmFacts,
    Effect,
    FittedGroup,
    SessionInfo,
    TermFamily,
    VirtualEffect,
    is_usual,
)
from lab.kinematics.effects.harmonics import CrossHarmonics, Harmonics, Ripple
from lab.kinematics.effects.own import fitted_own, own_function
from lab.kinematics.effects.range_errors import RangeErrors
from lab.kinematics.effects.readings import BadReadings, EncoderRounding, InstrumentNoise, Repeatability
from lab.kinematics.effects.sessions import Bump, Duration, Payloads
from lab.kinematics.effects.temperature import Drift, Growth, Temperature, ZerosByTemperature
from lab.kinematics.joints import JointSpec

__all__ = [
    "CAMPAIGN_SPECIFIC",
    "CANDIDATES",
    "EFFECTS",
    "GROUPS",
    "EffectOptions",
    "describe_term",
    "effect",
    "expected_terms",
    "fitted_groups",
    "own_columns",
    "own_effect",
    "own_effect_options",
    "own_group",
    "searched_terms",
]

_Kind = TypeVar("_Kind", bound=VirtualEffect)


EFFECTS: tuple[type[VirtualEffect], ...] = (
    Compliance,
    Payloads,
    Harmonics,
    Gear,
    Coupling,
    Backlash,
    Repeatability,
    Lag,
    Drift,
    Bump,
    Growth,
    Duration,
    BadReadings,
    Bending,
    Ripple,
    FullCoupling,
    InstrumentNoise,
    EncoderRounding,
    Hysteresis,
    GravityCompensator,
    Hardening,
    Temperature,
    ZerosByTemperature,
    CrossHarmonics,
    RangeErrors,
)  # in the order of options, groups and random substreams: a new one goes to the end, so that the draws of others stay


@dataclass(frozen=True)
class EffectOptions(*reversed(EFFECTS)):  # type: ignore[misc]  # a dataclass takes the fields of its last base first
    """Options of all effects."""

    def of(self, kind: type[_Kind]) -> _Kind:
        """Return the options of one effect."""
        return kind(**{each.name: getattr(self, each.name) for each in fields(kind)})

    def each(self) -> Iterator[VirtualEffect]:
        """Iterate over the options of every effect."""
        return (self.of(kind) for kind in EFFECTS)

    @property
    def added(self) -> Mapping[str, VirtualEffect]:
        """Options of the effects that packages add, by name; here none."""
        return {}

    def check(self) -> None:
        """Refuse numbers out of range with a LabError about the option."""
        for each in fields(EffectOptions):
            value, flag = getattr(self, each.name), "--" + each.name.replace("_", "-")
            for number in value if isinstance(value, tuple) else (value,):
                if number is not None and number not in OPTION_SIZE:
                    raise LabError(f"{flag} {number:g}: give a number from 0 to {OPTION_SIZE.most:g}")
        for effect_options in (*self.each(), *self.added.values()):
            effect_options.check()


_FITTED = {group.name: group for kind in EFFECTS for group in kind.groups}
GROUPS = tuple(_FITTED)
CANDIDATES = tuple(group.name for group in _FITTED.values() if group.is_candidate)  # that --model auto tries
_KEPT_ARMS, _KEPT = 4, 2_000  # the last arms, and their effects: a search tries 500 of each
OWN_EFFECTS.taken = GROUPS
_TERM_FAMILIES = tuple(family for kind in EFFECTS for family in kind.terms)
_FAMILIES = {(str(family.owner), family.symbol, bool(family.number)): family for family in _TERM_FAMILIES}
_TERM = re.compile(r"(joint|link)([1-9]\d*)\.([a-z_]+)([1-9]\d*)?")
CAMPAIGN_SPECIFIC = tuple(group.name for group in _FITTED.values() if group.of_one_campaign)


def fitted_groups() -> tuple[FittedGroup, ...]:
    """Return the groups that ``--model`` accepts."""
    return tuple(_FITTED.values())


def effect(
    name: str, chain: JointSpec, loads: Loads | None, sessions: SessionInfo = NO_SESSIONS, *, moving: bool = False
) -> Effect:
    """Return the fitted group of that name for an arm; ``moving`` as in ``ArmFacts``.

    Raises:
        LabError: there is no such group, the arm cannot have it, or it needs masses or sessions.
    """
    lasting = name in _FITTED or _term(name) is not None  # a package may be loaded again
    return (_kept if lasting else _made)(name, chain, loads, sessions, moving)


def _made(name: str, chain: JointSpec, loads: Loads | None, sessions: SessionInfo, moving: bool) -> Effect:
    made = _fitted(name, ArmFacts(chain, loads, sessions, moving=moving))
    return replace(made, made_by=partial(effect, name, chain, loads, sessions, moving=moving))


_kept = recent(_KEPT)(_made)


def _fitted(name: str, facts: ArmFacts) -> Effect:
    chain = facts.chain
    if (term := _term(name)) is not None:
        family, joint, number = term
        if joint > chain.size:
            raise LabError(f"{option_name('model')} {name}: robot {chain.name} has {family.owner}s 1 to {chain.size}")
        return family.fitted(facts, joint - 1, number)
    found = _FITTED[name].fitted(facts) if name in _FITTED else fitted_own(own_group(name), facts)
    if not found.parameters:
        raise LabError(
            f"{option_name('model')} {name}: robot {chain.name} has no joint or link that could have it; leave it out"
        )
    return found


def own_effect(name: str) -> type[VirtualEffect]:
    """Return the effect that a package adds by this name.

    Raises:
        LabError: there is none, its package cannot be imported, or it gives something else.
    """
    if name not in (names := added(OWN_EFFECTS.group, GROUPS)):
        raise LabError(
            f"{option_name('own_effects')} {name}: unknown; packages add {', '.join(names) or 'none'}"
            f"{_nearest(name, names) or '; if its package was removed, install it again'}"
        )
    kind: type[VirtualEffect] = OWN_EFFECTS.named(name)
    if not isinstance(kind, type) or not is_dataclass(kind):
        raise LabError(f"effect '{name}': {kind!r} is no dataclass; decorate it by @dataclass(frozen=True)")
    return kind


def own_effect_options(text: str) -> tuple[str, VirtualEffect]:
    """Return the name and the options of an effect that a package adds, from e.g. ``runout:size_mrad=0.1:turns=3``.

    Raises:
        LabError: there is no such effect or option, or a value is no number.
    """
    name, *given = text.split(":")
    kind = own_effect(name)
    known, values = [each.name for each in fields(kind)], dict[str, float]()
    for part in given:
        option, _, number = part.partition("=")
        flag = f"{option_name('own_effects')} {text}"
        if option not in known or option in values:
            raise LabError(f"{flag}: '{option}' is no option, or given twice; there are {', '.join(known) or 'none'}")
        try:
            values[option] = float(number)
        except ValueError:
            raise LabError(f"{flag}: '{number}' is no number") from None
        if values[option] not in OPTION_SIZE:
            raise LabError(f"{flag}: give a number from 0 to {OPTION_SIZE.most:g}")
    with own_function(name, kind.__name__):
        options = kind(**values)
    return name, options


def own_group(name: str) -> FittedGroup:
    """Return the group that a package's effect of this name fits.

    Raises:
        LabError: there is no such effect, its package cannot be imported, or it has no group of its name.
    """
    if name not in (names := added(OWN_EFFECTS.group, GROUPS)):
        terms = ", ".join(family.name(0, 2 if family.number else 0) for family in _TERM_FAMILIES)
        hint = _nearest(name, (*GROUPS, *names)) or "; if a package added it, install the package again"
        raise LabError(
            f"{option_name('model')} {name}: no such group; there are geometric, auto, "
            f"{', '.join((*GROUPS, *names))}, and {terms}{hint}"
        )
    groups = _groups_of(name)
    if name not in groups:
        raise LabError(
            f"{option_name('model')} {name}: its group is named {' and '.join(groups)}; name the entry so, or the "
            f"group {name}"
        )
    return groups[name]


def _groups_of(name: str) -> dict[str, FittedGroup]:
    """Return the groups of a package's effect by name, at least one."""
    groups = own_effect(name).groups
    if not isinstance(groups, tuple) or not all(isinstance(each, FittedGroup) for each in groups):
        raise LabError(f"effect '{name}': groups is {groups!r}; give a tuple of FittedGroup, e.g. (FittedGroup(...),)")
    if not groups:
        raise LabError(f"{option_name('model')} {name}: this effect is simulated alone; it has no group of its name")
    return {group.name: group for group in groups}


def own_columns(groups: Iterable[str], chain: JointSpec, loads: Loads | None) -> tuple[str, ...]:
    """Return the columns of a file that own effects among these groups name, beside the lab's."""
    found = dict[str, None]()
    for name in set(groups) & set(added(OWN_EFFECTS.group, GROUPS)):
        with suppress(LabError):  # what cannot be built is refused where it is fitted
            found |= dict.fromkeys(effect(name, chain, loads).conditions)
    return tuple(name for name in found if not is_usual(name))


def _nearest(name: str, names: Iterable[str]) -> str:
    near = get_close_matches(name, tuple(names), 1)
    return f"; did you mean {near[0]}?" if near else ""


def searched_terms(facts: ArmFacts) -> dict[str, Effect]:
    """Return the groups of single joints and links that ``--model auto`` searches, by name."""
    return _searched_terms(facts.chain, facts.loads, facts.sessions)


@recent(_KEPT_ARMS)
def _searched_terms(chain: JointSpec, loads: Loads | None, sessions: SessionInfo) -> dict[str, Effect]:
    facts = ArmFacts(chain, loads, sessions)
    names = (family.name(*pair) for family in _TERM_FAMILIES for pair in family.searched(facts))
    return {name: effect(name, chain, loads, sessions) for name in names}


def expected_terms(facts: ArmFacts) -> tuple[str, ...]:
    """Return those of ``searched_terms`` that the robot's description suggests."""
    return tuple(family.name(*pair) for family in _TERM_FAMILIES for pair in family.expected(facts))


def describe_term(name: str) -> str:
    """Describe a group of a single joint or link; empty for any other group."""
    if (term := _term(name)) is None:
        return ""
    family, joint, number = term
    return family.describe(joint, number)


def _term(name: str) -> tuple[TermFamily, int, int] | None:
    """Return family, joint or link from 1, and number of a name; 0 without one."""
    match = _TERM.fullmatch(name)
    if match is None or (family := _FAMILIES.get((match[1], match[3], match[4] is not None))) is None:
        return None
    return family, int(match[2]), int(match[4] or 0)
