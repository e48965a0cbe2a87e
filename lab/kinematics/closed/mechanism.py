"""A nominal mechanism with loops: its structure, joints, parameters, and possible poses."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.random import ScrambledSobol, rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.kinematics.closed.loop_closure import (
    CLOSED_M,
    LEAST_STEP,
    SINGULAR,
    Assembly,
    Closed,
    Configuration,
    Dimensions,
    Frame,
    Rod,
    SolvedPoses,
    Step,
    Tree,
)
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import BASE_PARAMETERS, Parameter, link_parameter, names_of

__all__ = ["Mechanism", "platform_poses"]


def _refuse_unsound(joints: JointSpec, tree: Tree) -> None:
    _refuse_misnamed(joints, tree)
    missing = len(tree.passive) - tree.equations
    if missing:
        counted = f"passive values: {len(tree.passive)}, equations of rods and pins: {tree.equations}"
        raise LabError(
            f"robot '{joints.name}': its mobility is {joints.size + missing}, its measured joints are {joints.size} "
            f"({counted}); " + ("add rods or pins" if missing > 0 else "take rods or pins out, or make steps passive")
        )
    _refuse_idle(joints, tree)
    for rod in tree.rods:
        if rod.joint is not None:
            _refuse_short(joints, rod, rod.joint)


def _refuse_misnamed(joints: JointSpec, tree: Tree) -> None:
    """Refuse joints that do not move exactly one step or rod each."""
    movers = [step.joint for frame in tree.frames for step in frame.path] + [rod.joint for rod in tree.rods]
    for i, name in enumerate(joints.joint_names):
        if movers.count(i) != 1:
            times = f"{movers.count(i)} steps or rods" if movers.count(i) else "nothing"
            raise LabError(f"robot '{joints.name}', joint {name}: moves {times}; let one step or rod name it")


def _refuse_idle(joints: JointSpec, tree: Tree) -> None:
    """Refuse passive values that move no closure, and joints that move neither a closure nor the platform."""
    carrying = tree.ancestry(tree.platform)
    ends = [*(end for rod in tree.rods for end in rod.ends), *(end for pin in tree.pins for end in pin.ends)]
    closing = {step for end in ends for step in tree.ancestry(end)}
    for f, frame in enumerate(tree.frames):
        for s, step in enumerate(frame.path):
            if (f, s) not in closing:
                _refuse_loose(joints, frame, step, carries=(f, s) in carrying)
    if not any(tree.step(*step).moves for step in carrying):
        name = tree.frames[tree.platform].name
        raise LabError(f"robot '{joints.name}': nothing moves {name}, its platform; name a frame that moves")


def _refuse_loose(joints: JointSpec, frame: Frame, step: Step, *, carries: bool) -> None:
    """Refuse a step that moves and is part of no loop, unless a joint moves it and it carries the platform."""
    if step.passive:
        raise LabError(
            f"robot '{joints.name}', frame {frame.name}: no rod or pin holds its passive {step.kind}; join one"
        )
    if step.joint is not None and not carries:
        raise LabError(
            f"robot '{joints.name}', joint {joints.joint_names[step.joint]}: moves frame {frame.name}, which "
            "neither closes a loop nor carries the platform; join a rod or a pin to it"
        )


def _refuse_short(joints: JointSpec, rod: Rod, joint: int) -> None:
    """Refuse a leg without a positive length at any position of its joint."""
    ends = rod.length_m + joints.sign[joint] * np.array([joints.lower[joint], joints.upper[joint]])
    if ends.min() <= 0:
        raise LabError(
            f"robot '{joints.name}', rod {rod.name}: within the limits of joint {joints.joint_names[joint]} its length "
            f"goes from {MM.of(ends.min()):.6g} to {MM.text(ends.max(), 6)}; keep it above zero"
        )


_SAMPLED = 1.5  # largest condition of random poses, relative to the nominal position's
_STATION = 3.0  # largest condition of the closures at a station
_COPIES, _COPY_ERROR = 3, 1e-3  # imperfect copies that also take random poses, with errors in m and rad
_WITH_COPIES = 2.0  # largest condition of copies, relative to the nominal model's
_QUICK_STEP = 0.25  # least step of a quick continuation
_MAX_COPY_ERROR = 0.05  # m or rad: continuation is quick for larger errors
_STATIONS = 512  # joint positions with passive values solved beforehand
_LEAST_LEVER_M = 1e-3
_BLOCK, _MOST_BLOCKS = 256, 200  # of random joint positions


@dataclass(frozen=True, kw_only=True)
class Mechanism(JointSpec):
    """A mechanism whose joints are measured and whose passive values the closures give."""

    tree: Tree

    def __post_init__(self) -> None:
        super().__post_init__()
        _refuse_unsound(self, self.tree)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters without targets: of the base, ``<frame>.<step>``, ``<rod>.length``.

        The constant of a step or a rod that a joint moves is that joint's offset.
        """
        tree, found = self.tree, list(BASE_PARAMETERS)
        for f, s in tree.constants:
            step = tree.step(f, s)
            found.append(
                link_parameter(tree.frames[f].name, step.kind, "angle" if step.is_turn else "length", step.value)
            )
        found += [link_parameter(tree.rods[i].name, "length", "length", tree.rods[i].length_m) for i in tree.lengths]
        return tuple(found)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return names_of(self.parameters)

    @cached_property
    def nominal_values(self) -> Array:
        """Nominal parameters ``(p,)``, with the base at the tracker's origin."""
        tree = self.tree
        steps = [tree.step(f, s).value for f, s in tree.constants]
        return np.array([*np.zeros(6), *steps, *(tree.rods[i].length_m for i in tree.lengths)])

    def dimensions(self, values: Array) -> Dimensions:
        """Return the dimensions from parameters ``(p,)``; further ones are ignored."""
        tree, first = self.tree, 6 + len(self.tree.constants)
        kind = values.dtype
        steps = [np.array([step.value for step in frame.path], dtype=kind) for frame in tree.frames]
        for (f, s), value in zip(tree.constants, values[6:first], strict=True):
            steps[f][s] = value
        lengths = np.array([rod.length_m for rod in tree.rods], dtype=kind)
        lengths[list(tree.lengths)] = values[first : first + len(tree.lengths)]
        return Dimensions(values[:6], tuple(steps), lengths, self.sign)

    @property
    def has_loops(self) -> bool:
        """Always true."""
        return True

    @property
    def offset_lengths(self) -> tuple[str, ...]:
        """Names of the lengths of legs that joints measure."""
        return tuple(f"{rod.name}.length" for rod in self.tree.rods if rod.joint is not None)

    def offset_of(self, joint: int) -> str:
        """Return the name of the constant that a joint's position adds to."""
        for f, s in self.tree.constants:
            if self.tree.step(f, s).joint == joint:
                return self.tree.name_of(f, s)
        return next(f"{rod.name}.length" for rod in self.tree.rods if rod.joint == joint)

    def assembled(self, joints: Array, values: Array, *, quickly: bool = False) -> Closed:
        """Close the loops at ``joints`` ``(n, joints)``, in the mode of the nominal position.

        By continuation from a station; if that fails, with the nominal parameters, then to these at the joint
        positions.

        Args:
            quickly: take few steps; poses that need more, are nearly singular or of another mode stay open.
        """
        nearest, assembly = self._nearest(joints), self._assembly(values)
        own = slice(len(BASE_PARAMETERS), len(self.names))
        quickly |= bool(np.abs(values[own] - self.nominal_values[own]).max(initial=0.0) > _MAX_COPY_ERROR)
        found = assembly.from_solved(joints, nearest, _QUICK_STEP if quickly else LEAST_STEP)
        lost = np.flatnonzero(~np.isfinite(found.configuration.passive).all(axis=0))
        if quickly or not lost.size or values is self.nominal_values:
            return found
        drawn = self._assembly(self.nominal_values).from_solved(joints[lost], nearest.take(lost))
        again = assembly.from_solved(
            joints[lost], SolvedPoses(joints[lost], drawn.configuration.passive, nearest.sense)
        )
        passive = found.configuration.passive.copy()
        passive[:, lost] = again.configuration.passive
        found.configuration.move(passive)
        return assembly.closed(found.configuration, nearest.sense)

    def _nearest(self, joints: Array) -> SolvedPoses:
        stations, tree = self._stations
        return stations.take(tree.query(joints / self._ranges)[1])

    def _assembly(self, values: Array) -> Assembly:
        return Assembly(self.tree, self.dimensions(values), self.levers, self._rotational)

    def refuse_open(self) -> None:
        """Raise a LabError if the loops do not close in the nominal position."""
        assert self._stations

    def is_assemblable(self, joints: Array, *, well: bool = False) -> NDArray[np.bool_]:
        """Flag joint positions at which the nominal model's loops close, in the nominal mode."""
        if not well:
            return np.asarray(self.assembled(joints, self.nominal_values).condition < SINGULAR)
        most = _SAMPLED * max(self._home_condition, 1.0)
        fits = self.assembled(joints, self.nominal_values).condition < most
        for values in self._copies:
            fits[fits] = self.assembled(joints[fits], values, quickly=True).condition < _WITH_COPIES * most
        return np.asarray(fits)

    @cached_property
    def _home_condition(self) -> float:
        return float(self.assembled(self.home[None], self.nominal_values).condition[0])

    @cached_property
    def _copies(self) -> list[Array]:
        """Parameters ``(p,)`` of imperfect copies, with larger errors than real ones."""
        rng = rng_for(0, "arm")
        return [
            self.nominal_values + _COPY_ERROR * rng.standard_normal(len(self.nominal_values)) for _ in range(_COPIES)
        ]

    def random_joints(self, count: int, rng: np.random.Generator) -> Array:
        """Draw ``(count, joints)`` uniform within the limits where the nominal model assembles, away from
        singularities.
        """
        found: list[Array] = []
        have = 0
        for _ in range(_MOST_BLOCKS + count // _BLOCK):
            block = super().random_joints(_BLOCK, rng)
            found.append(block[self.is_assemblable(block, well=True)])
            have += len(found[-1])
            if have >= count:
                return np.concatenate(found)[:count]
        raise LabError(
            f"robot '{self.name}': almost no joint positions within limits close its loops; narrow the joints' limits"
        )

    def infeasibility_reason(self, joints: Array) -> str:
        """Describe why the nominal model's loops do not close at joint positions ``(joints,)``; empty if they do."""
        found = self.assembled(joints[None], self.nominal_values)
        if found.fits[0]:
            return ""
        start = self._nearest(joints[None]).passive[:, 0]
        gaps = self._assembly(self.nominal_values).nearest(joints, start)[1]
        if np.abs(gaps).max() > CLOSED_M:
            return self._describe_open(joints, gaps)
        if np.isfinite(found.condition[0]):
            return f"at a parallel singularity: the closures' condition is {found.condition[0]:.2g}"
        return "beyond a parallel singularity: its loops close there only in another assembly mode"

    def _describe_open(self, joints: Array, gaps: Array) -> str:
        """Describe the closures that stay open at joint positions ``(joints,)``."""
        configuration = Configuration.of(
            self.tree, self.dimensions(self.nominal_values), joints[None], self._nominal_passive[:, None]
        )
        long = np.array([float(np.ravel(length)[0]) for length in configuration.lengths()])
        rods, opened = len(long), np.abs(gaps)
        opened[:rods] = np.abs(np.sqrt(np.maximum(long**2 + 2 * long * gaps[:rods], 0.0)) - long)
        names = [rod.name for rod in self.tree.rods] + [pin.name for pin in self.tree.pins for _ in pin.axes]
        left = list(dict.fromkeys(name for name, gap in zip(names, opened, strict=True) if gap > 0.1 * opened.max()))
        return f"{', '.join(left)} cannot meet: {MM.text(opened.max())} stay open"

    @cached_property
    def levers(self) -> Array:
        """One for a passive slide, ``(z,)``; for a turn, its motion of the closures in the nominal position, m."""
        configuration = self._at_home(self._nominal_passive)
        slopes = np.abs(configuration.by_passive(configuration.closures()[1])[0]).max(axis=0, initial=_LEAST_LEVER_M)
        return np.where(self._rotational, slopes, 1.0)

    @cached_property
    def _rotational(self) -> NDArray[np.bool_]:
        return np.array([self.tree.step(f, s).is_turn for f, s in self.tree.passive], dtype=bool)

    @property
    def nominal_home(self) -> Array:
        """Joint positions zero, or the middle of the limits if zero is beyond them."""
        within = (self.lower <= 0) & (self.upper >= 0)
        return np.where(within, 0.0, (self.lower + self.upper) / 2)

    @property
    def _nominal_passive(self) -> Array:
        return np.array([self.tree.step(f, s).value for f, s in self.tree.passive])

    def _at_home(self, passive: Array) -> Configuration:
        return Configuration.of(self.tree, self.dimensions(self.nominal_values), self.home[None], passive[:, None])

    @property
    def _ranges(self) -> Array:
        return self.upper - self.lower

    @cached_property
    def _stations(self) -> tuple[SolvedPoses, Any]:
        """Nominal poses with solved passive values, continued from home pose by pose; and their search tree."""
        assembly = self._assembly(self.nominal_values)
        passive, gaps = assembly.nearest(self.home, self._nominal_passive)
        if np.abs(gaps).max(initial=0.0) > CLOSED_M:
            at = ", ".join(f"{name} {self.shown(i, self.home[i])}" for i, name in enumerate(self.joint_names))
            raise LabError(
                f"robot '{self.name}': in the nominal position ({at}) {self._describe_open(self.home, gaps)}; mend "
                "lengths, places of their ends, or limits: the nominal position is at zero joint positions, or amid "
                "limits that zero is beyond"
            )
        configuration = self._at_home(passive)
        sense = float(np.sign(np.linalg.det(configuration.by_passive(configuration.closures()[1])[0])))
        if not assembly.closed(configuration, sense).fits[0]:
            raise LabError(
                f"robot '{self.name}': the nominal position is singular, the closures do not hold the platform there; "
                "place rods that are alike or in line otherwise, or describe another position"
            )
        stations = SolvedPoses(self.home[None], passive[:, None], sense)
        even = ScrambledSobol(self.size, rng_for(0, "structure")).points(_STATIONS)
        left = self.lower + even * (self.upper - self.lower)
        grown = True
        while grown and len(left):
            nearest = scipy.spatial.cKDTree(stations.joints / self._ranges).query(left / self._ranges)[1]
            found = assembly.from_solved(left, stations.take(nearest))
            good = found.condition < _STATION  # an imperfect copy may lack what is nearly singular
            stations = SolvedPoses(
                np.concatenate([stations.joints, left[good]]),
                np.concatenate([stations.passive, found.configuration.passive[:, good]], axis=1),
                stations.sense,
            )
            left, grown = left[~good], bool(good.any())
        return stations, scipy.spatial.cKDTree(stations.joints / self._ranges)


def platform_poses(mechanism: Mechanism, joints: Array, passive: Array) -> Array:
    """Return poses ``(n, 4, 4)`` of the nominal platform in the base; ``passive`` is ``(n, z)``."""
    dimensions = mechanism.dimensions(mechanism.nominal_values)
    axes, origin = Configuration.of(mechanism.tree, dimensions, joints, passive.T).frames[mechanism.tree.platform]
    shape = (3, len(joints))
    columns = [np.broadcast_to(axis[:3], shape).T for axis in axes]
    return se3.pose(np.stack(columns, axis=2), np.broadcast_to(origin[:3], shape).T)
