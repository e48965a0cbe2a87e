"""All solutions of a pose, with the configuration of each, whatever the robot's kind."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.robotics.kinematics.configurations import configurations
from lab.kinematics.inverse.branches import NominalInverse, nearest_whole_turns, ordered
from lab.kinematics.inverse.newton import FREEDOMS, PoseTarget
from lab.kinematics.model import RigidArm

if TYPE_CHECKING:  # loaded for mechanisms alone
    from lab.extensions.robotics.closed.recognition import ClassicalModel
    from lab.kinematics.closed.mechanism import Mechanism

__all__ = ["PoseSolutions", "Solution", "Solver", "matching"]

_SAME = 1e-6  # rad or m: solutions nearer to each other are one
_REACHED_M = 1e-6  # a pose is written to the micron, which joints that are too few for its digits may miss


@dataclass(frozen=True)
class Solution:
    """One way to a pose.

    Attributes:
        joints: ``(n,)`` joint positions, rad or m.
        configuration: on which side of each singularity it is, by its name, + or - (or 0: on it); of a mechanism with
            loops which way each leg takes, by its joint.
        free: ``(n,)`` joints that could stand anywhere, as the arm is singular there.
        tilt_rad: by how much the rotation is missed, where an arm of fewer than six joints cannot take it.
    """

    joints: Array
    configuration: Mapping[str, str]
    free: NDArray[np.bool_]
    tilt_rad: float = 0.0


@dataclass(frozen=True)
class PoseSolutions:
    """All solutions of one pose that were found.

    Attributes:
        solutions: nearest to the reference first.
        gap_m: how far the pose is out of reach, of a search by how much the nearest place that it found misses it;
            zero where there is a solution, NaN where that is not known.
        how: ``closed form`` (then these are all) or ``search``.
        reassembled: how many more there are that a mechanism with loops takes in another assembly mode alone.
        others: how many more there are in configurations that were not asked for.
    """

    solutions: tuple[Solution, ...]
    gap_m: float
    how: str
    reassembled: int = 0
    others: int = 0


@dataclass(frozen=True)
class Solver:
    """The inverse model of a nominal robot.

    Attributes:
        values: parameters ``(p,)``, with one target.
    """

    arm: RigidArm
    values: Array

    def __call__(self, wanted: PoseTarget, reference: Array) -> list[PoseSolutions]:
        """The solutions of each pose.

        Args:
            reference: joint positions ``(n, joints)`` near which solutions are preferred, NaN where none are given.
        """
        legs = self._legs(wanted) if self.arm.chain.has_loops else None
        if legs is not None:
            return [self._by_legs(*legs, wanted.take(np.array([i])), reference[i]) for i in range(len(wanted))]
        inverse = NominalInverse(self.arm, self.values)
        found = inverse.ways(wanted, reference)
        joints, branches = ordered(self.arm.chain, found, reference, np.zeros(found.gap_m.shape, dtype=np.bool_))
        form, closed = inverse.closed_form, inverse.exact(wanted)
        out = []
        for i, order in enumerate(branches):
            gap, tilt, free = found.gap_m[i, order], found.tilt_rad[i, order], found.free[i, order]
            kept = _different(
                joints[i],
                np.flatnonzero(gap <= (0.0 if closed[i] else _REACHED_M)),
                self.arm.chain.prismatic,
            )
            named: list[dict[str, str]] = [{} for _ in kept]
            if form is not None and kept:
                named = configurations(form.determinant, joints[i, kept])
            elif kept and self.arm.chain.size == FREEDOMS:
                signs = np.sign(np.linalg.det(self.arm.tool(joints[i, kept], self.values)[1])).astype(int)
                named = [{"det": "0+-"[sign]} for sign in signs]
            ways = tuple(
                Solution(joints[i, k], name, free[k], float(tilt[k])) for k, name in zip(kept, named, strict=True)
            )
            exact = bool(closed[i])
            if form is not None and form.exact_only and kept and tilt[kept].any():  # near to a pose that it cannot take
                exact = False
            missed = 0.0 if kept else float(gap.min(initial=np.inf))
            out.append(PoseSolutions(ways, missed, "closed form" if exact else "search"))
        return out

    def _legs(self, wanted: PoseTarget) -> "tuple[Mechanism, ClassicalModel] | None":
        """A mechanism with the closed form that answers such poses; None where none does."""
        from lab.extensions.robotics.closed.recognition import classical_model_of
        from lab.kinematics.closed.mechanism import Mechanism

        mechanism = self.arm.chain
        course = classical_model_of(mechanism) if isinstance(mechanism, Mechanism) else None
        if course is None or not isinstance(mechanism, Mechanism) or len(course.order) != mechanism.size:
            return None  # or a joint beside those of the legs
        return (mechanism, course) if wanted.turned.all() or not _turns(mechanism) else None

    def _by_legs(
        self, mechanism: "Mechanism", course: "ClassicalModel", wanted: PoseTarget, reference: Array
    ) -> PoseSolutions:
        """The working modes of a mechanism with a closed form, for one pose."""
        from lab.extensions.robotics.closed.modes import passive_values_of, working_modes

        tool = self.values[-3:]
        home = self.arm.tool(mechanism.home[None], self.values)[0][0, :3, :3]
        rotation = wanted.rotations[0] if wanted.turned[0] else home
        passive, missed = passive_values_of(mechanism, se3.pose(rotation, wanted.positions[0] - rotation @ tool))
        every = working_modes(mechanism, course, passive) if missed <= _REACHED_M else []
        rows = np.array([mode.joints for mode in every]).reshape(-1, mechanism.size)
        there = self.arm.tool(rows, self.values)[0][:, :3, 3] if every else np.empty((0, 3))
        modes = [
            mode for mode, place in zip(every, there, strict=True)
            if np.abs(place - wanted.positions[0]).max() < _REACHED_M
        ]  # fmt: skip
        near = reference if np.isfinite(reference).all() else mechanism.home
        modes.sort(key=lambda mode: float(np.abs(mode.joints - near).max()))
        none = np.zeros(mechanism.size, dtype=np.bool_)
        names, several = mechanism.joint_names, any(any(mode.ways) for mode in modes)
        ways = tuple(
            Solution(
                nearest_whole_turns(mechanism, mode.joints, near),
                {name: "+-"[way] for name, way in zip(names, mode.ways, strict=True)} if several else {},
                none,
            )
            for mode in modes
        )
        gap = 0.0 if ways else missed if missed > _REACHED_M else np.nan
        return PoseSolutions(ways, gap, "closed form", len(every) - len(modes))


def matching(found: PoseSolutions, asked: tuple[str, ...]) -> PoseSolutions:
    """The solutions of one configuration alone, e.g. ``("elbow+", "wrist-")``.

    Raises:
        LabError: no solution has a side of that name, or what is asked has no sign (the message lists those there
            are), or it is asked for with both.
    """
    known = sorted({name for each in found.solutions for name in each.configuration})
    sides: dict[str, str] = {}
    for each in asked:
        name, sign = each[:-1].strip(), each[-1:].replace("−", "-")
        if sign not in ("+", "-") or (found.solutions and name not in known):
            there = ", ".join(f"{name}+ and {name}-" for name in known) or "none: this robot's solutions have no names"
            raise LabError(f"--of {each}: no configuration is called so; there are {there}")
        if sides.setdefault(name, sign) != sign:
            raise LabError(f"--of {name}+,{name}-: a solution has one of the two; ask for one, or leave out {name}")
    kept = tuple(s for s in found.solutions if all(s.configuration.get(name) == sign for name, sign in sides.items()))
    return replace(found, solutions=kept, others=len(found.solutions) - len(kept))


def _turns(mechanism: "Mechanism") -> bool:
    """Whether the platform turns."""
    return any(mechanism.tree.step(*step).is_turn for step in mechanism.tree.passive)


def _different(joints: Array, rows: NDArray[np.int_], prismatic: tuple[bool, ...]) -> list[int]:
    """Of rows of joint positions ``(k, joints)`` the first of those that are the same but for whole turns."""
    kept: list[int] = []
    for row in rows.tolist():
        apart = joints[kept] - joints[row]
        apart = np.where(prismatic, apart, apart - 2 * np.pi * np.round(apart / (2 * np.pi)))
        if not (np.abs(apart).max(axis=1, initial=0.0) < _SAME).any():
            kept.append(row)
    return kept
