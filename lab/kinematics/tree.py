"""A robot with several tips: serial chains from one base that share joints, such as a torso with two arms.

Each tip has a Denavit-Hartenberg chain from the base, and chains with the same first joints share these joints and
their links. A link is shared as far as two chains run along the same joints: beyond the last shared joint the row of
that joint's link is each branch's own (of a Craig table its theta and d), as it ends at the branch's next axis. Khalil
and Kleinfinger (1986) describe that fork by two more numbers, gamma and b, which add to theta and d. Chains that share
no joint stand each on a mount, a pose in frame 0 of the first.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError, option_name
from lab.core.limits import checked_name
from lab.core.se3 import Array, exp, inverse, left_jacobian, log, pose
from lab.kinematics.gauge import preferred_cells
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import Skeleton
from lab.kinematics.parameter import (
    BASE_PARAMETERS,
    Parameter,
    mount_parameters,
    names_of,
    tool_parameters,
)
from lab.kinematics.serial.chain import COLUMNS, Chain
from lab.kinematics.serial.serial_arm import DEFAULT_TOOL, SerialArm, target_positions

__all__ = ["TreeArm", "TreeChain", "first_of_tips", "point_of", "tip_of", "tree_chain"]

_BASE = len(BASE_PARAMETERS)
_AFTER_JOINT = {"distal": COLUMNS, "craig": ("theta", "d")}  # columns that place the next joint beside the row's own


def tip_of(target: str) -> str:
    """Return the tip of a target, ``left`` of ``left.p1``; "" if its name has none."""
    return target.partition(".")[0] if "." in target else ""


def point_of(target: str) -> str:
    """Return a target's name on its tip, ``p1`` of ``left.p1``."""
    return target.partition(".")[2] or target


def first_of_tips(targets: Sequence[str]) -> tuple[int, ...]:
    """Return the index of the first target, and of the first of each further tip."""
    first: dict[str, int] = {}
    for i, target in enumerate(targets):
        first.setdefault(tip_of(target), i)
    return tuple(first.values())


@dataclass(frozen=True, kw_only=True)
class TreeChain(JointSpec):
    """The joints of a robot with several tips, nominal.

    Attributes:
        tips: names of the tips.
        chains: to each tip from the base; their joints are among these by name.
        mounts: ``(4, 4)`` pose (m) of each chain's frame 0 in frame 0 of the first.
    """

    tips: tuple[str, ...]
    chains: tuple[Chain, ...]
    mounts: tuple[Array, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        assert len(self.tips) == len(self.chains) == len(self.mounts) > 1
        if len(set(self.tips)) < len(self.tips):
            raise LabError(f"robot '{self.name}': two tips have one name; name each tip once")
        for tip in self.tips:
            checked_name(f"robot '{self.name}': tip", tip)

    @property
    def beside_serial(self) -> str:
        """Several tips."""
        return "several tips"

    @cached_property
    def members(self) -> tuple[list[int], ...]:
        """Indices of each chain's joints, from the base outward."""
        at = {name: i for i, name in enumerate(self.joint_names)}
        return tuple([at[name] for name in chain.joint_names] for chain in self.chains)

    @cached_property
    def roots(self) -> tuple[int, ...]:
        """For each chain, the first chain that has the same first joint, and thus the same mount."""
        first = [chain.joint_names[0] for chain in self.chains]
        return tuple(first.index(name) for name in first)

    def next_joint(self, chain: int, row: int) -> str:
        """Return the name of what a row's link carries: the chain's next joint, or its tip."""
        names = (*self.chains[chain].joint_names, self.tips[chain])
        return names[row + 1]

    @cached_property
    def owners(self) -> dict[tuple[str, str], str]:
        """Names of the links, by their joint and what they carry; a link that forks has one for each branch."""
        carried: dict[str, dict[str, None]] = {name: {} for name in self.joint_names}
        for c, chain in enumerate(self.chains):
            for row, name in enumerate(chain.joint_names):
                carried[name][self.next_joint(c, row)] = None
        return {
            (name, end): f"link{i + 1}" if len(carried[name]) == 1 else f"link{i + 1}.{end}"
            for i, name in enumerate(self.joint_names)
            for end in carried[name]
        }

    def owner(self, chain: int, row: int, column: str) -> str:
        """Return the owner of a cell of a chain's table, as in its parameter's name."""
        joint = self.chains[chain].joint_names[row]
        if column in _AFTER_JOINT[self.chains[chain].convention]:
            return self.owners[joint, self.next_joint(chain, row)]
        return f"link{self.joint_names.index(joint) + 1}"


def tree_chain(name: str, tips: Sequence[str], chains: Sequence[Chain], frames: Sequence[Array]) -> TreeChain:
    """Return the robot of these chains, whose joints of the same name are one.

    Args:
        frames: pose ``(4, 4)`` (m) of each chain's frame 0, in one frame; equal for chains with the same first joint.
    """
    where = {joint: (chain, i) for chain in reversed(chains) for i, joint in enumerate(chain.joint_names)}
    order = dict.fromkeys(joint for chain in chains for joint in chain.joint_names)
    first = inverse(frames[0])

    def gathered(field_name: str) -> Array:
        return np.array([getattr(chain, field_name)[i] for chain, i in (where[joint] for joint in order)])

    return TreeChain(
        name=name,
        joint_names=tuple(order),
        prismatic=tuple(bool(slides) for slides in gathered("prismatic")),
        sign=gathered("sign"),
        lower=gathered("lower"),
        upper=gathered("upper"),
        speed=gathered("speed"),
        acceleration=gathered("acceleration"),
        tips=tuple(tips),
        chains=tuple(chains),
        mounts=tuple(first @ T for T in frames),
    )


@dataclass(frozen=True)
class _Branch:
    """A chain with measured targets.

    Attributes:
        arm: its serial arm, with the names of its own targets.
        joints: its joints among the robot's.
        targets: its targets among the robot's.
        columns: the robot's parameter for each of the arm's.
        mount: indices of its mount's six parameters; None on the base itself.
    """

    arm: SerialArm
    joints: list[int]
    targets: list[int]
    columns: NDArray[np.int_]
    mount: list[int] | None


@dataclass(frozen=True)
class TreeArm:
    """A robot with several tips, with a base in the tracker's frame and measured targets on its tips.

    A target is named by its tip: ``left.p1``. The parameters, in the order of ``names``: ``base.x y z rx ry rz``,
    ``mount.<first joint>.x y z rx ry rz`` of chains that share no joint with the first, the links' ``theta d a alpha``
    (and ``beta`` where it exists), by joint, and ``tool.<target>.x y z`` (m, in the tip's last frame). The link of a
    joint that carries several branches has an owner for each: ``link1.<next joint>``.
    """

    chain: TreeChain
    targets: tuple[str, ...]
    conditions: tuple[str, ...] = field(init=False, default=())

    def __post_init__(self) -> None:
        if not self.targets or len(set(self.targets)) < len(self.targets):
            raise LabError(f"targets {', '.join(self.targets) or '(none)'}: name at least one, and each once")
        for target in self.targets:
            if tip_of(target) not in self.chain.tips:
                tips = ", ".join(self.chain.tips)
                raise LabError(
                    f"target '{target}' names no tip of robot {self.chain.name} ({tips}); give "
                    f"{self.chain.tips[0]}.{point_of(target)}, or one tip alone by "
                    f"{option_name('tip')} {self.chain.tips[0]}"
                )

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the base, of the mounts, of the links, and of the targets."""
        chain, links = self.chain, dict[str, Parameter]()
        mounts = [
            each
            for c, root in enumerate(chain.roots)
            if c == root != 0
            for each in mount_parameters(chain.chains[c].joint_names[0], _vector(chain.mounts[c]))
        ]
        for c, branch in enumerate(chain.chains):
            arm = SerialArm(branch)
            for cell, row, column in zip(
                arm.parameters[_BASE:], arm.table_rows.tolist(), arm.table_columns.tolist(), strict=False
            ):
                owner = chain.owner(c, row, COLUMNS[column])
                links.setdefault(f"{owner}.{cell.symbol}", replace(cell, owner=owner))
        ordered = sorted(links.values(), key=lambda each: int(each.owner.split(".")[0].removeprefix("link")))
        return (*BASE_PARAMETERS, *mounts, *ordered, *tool_parameters(_positions(self.targets, {})))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return names_of(self.parameters)

    @cached_property
    def branches(self) -> tuple[_Branch, ...]:
        """The chains that carry measured targets."""
        found = []
        for c, tip in enumerate(self.chain.tips):
            own = [k for k, target in enumerate(self.targets) if tip_of(target) == tip]
            if own:
                found.append(self._branch(c, [self.targets[k] for k in own], own))
        return tuple(found)

    def _branch(self, c: int, targets: Sequence[str], at: list[int]) -> _Branch:
        chain, arm = self.chain, SerialArm(self.chain.chains[c], tuple(targets))
        index = {name: i for i, name in enumerate(self.names)}
        links = [
            index[f"{chain.owner(c, row, COLUMNS[column])}.{COLUMNS[column]}"]
            for row, column in zip(arm.table_rows.tolist(), arm.table_columns.tolist(), strict=True)
        ]
        tools = [index[f"tool.{target}.{axis}"] for target in targets for axis in "xyz"] if at else []
        root, mount = chain.roots[c], None
        if root:
            mount = [index[f"mount.{chain.chains[root].joint_names[0]}.{each.symbol}"] for each in BASE_PARAMETERS]
        return _Branch(arm, chain.members[c], at, np.array([*range(_BASE), *links, *tools], dtype=np.int_), mount)

    def nominal(self, tool: dict[str, Array] | None = None) -> Array:
        """Return nominal parameters: base at the tracker's origin, targets of ``tool`` (m) or the default tool's."""
        values = np.array([parameter.nominal for parameter in self.parameters])
        points = _positions(self.targets, tool or {})
        values[len(values) - 3 * len(points) :] = np.ravel(list(points.values()))
        return values

    def T_tracker_frame0(self, values: Array) -> Array:
        """Pose ``(4, 4)`` of frame 0 in the tracker's frame."""
        return pose(exp(values[3:6]), values[:3])

    def serial_values(self, branch: _Branch, values: Array) -> Array:
        """Return the parameters of a branch's serial arm, whose base is that of its own frame 0."""
        tool = np.zeros(0 if branch.targets else 3)
        own = np.concatenate([values[branch.columns], tool])
        if branch.mount is not None:
            mount, R = values[branch.mount], exp(values[3:6])
            own[:3] = values[:3] + R @ mount[:3]
            own[3:6] = log(R @ exp(mount[3:]))
        return own

    def points(self, joints: Array, values: Array) -> Array:
        """Return target positions ``(n, k, 3)`` in the tracker's frame (m) at joint positions ``(n, joints)``."""
        joints = self._checked(joints)
        out = np.empty((len(joints), len(self.targets), 3), dtype=np.result_type(joints, values))
        for branch in self.branches:
            out[:, branch.targets] = branch.arm.points(
                np.ascontiguousarray(joints[:, branch.joints]), self.serial_values(branch, values)
            )
        return out

    def observe(self, joints: Array, values: Array) -> tuple[Array, Array]:
        """Return target positions ``(n, k, 3)`` and their derivatives ``(n, k, 3, parameters)``."""
        joints = self._checked(joints)
        shape = (len(joints), len(self.targets), 3)
        out = np.empty(shape, dtype=np.result_type(joints, values))
        jacobian = np.zeros((*shape, len(self.names)), dtype=out.dtype)
        for branch in self.branches:
            own = self.serial_values(branch, values)
            points, rates = branch.arm.observe(np.ascontiguousarray(joints[:, branch.joints]), own)
            whole = np.zeros((*points.shape, len(self.names)), dtype=out.dtype)
            whole[..., branch.columns] = rates
            if branch.mount is not None:
                whole[..., 3:6] = _turned_about(points, values[:3], left_jacobian(values[3:6]))
                R = exp(values[3:6])
                whole[..., branch.mount[:3]] = R
                about = R @ left_jacobian(values[branch.mount[3:]])
                whole[..., branch.mount[3:]] = _turned_about(points, own[:3], about)
            out[:, branch.targets], jacobian[:, branch.targets] = points, whole
        return out, jacobian

    def joint_derivatives(self, jacobian: Array) -> Array:
        """Return the columns of derivatives ``(..., parameters)`` for the joint positions, ``(..., joints)``."""
        columns = [jacobian[..., of].sum(axis=-1) for of in self._joint_columns]
        return np.asarray(np.stack(columns, axis=-1) * self.chain.sign)

    @cached_property
    def _joint_columns(self) -> list[list[int]]:
        """Parameters that add to each joint's position: one for each branch that its link carries."""
        found: list[dict[int, None]] = [{} for _ in self.chain.joint_names]
        for branch in self.tips:
            for joint, column in zip(branch.joints, branch.arm.joint_columns, strict=True):
                found[joint][int(branch.columns[column])] = None
        return [list(each) for each in found]

    def branch_of(self, target: int) -> tuple[_Branch, int]:
        """Return the branch that carries a target, by its number, and the target's number there."""
        return next((branch, branch.targets.index(target)) for branch in self.branches if target in branch.targets)

    def tool(self, joints: Array, values: Array, target: int = 0) -> tuple[Array, Array]:
        """Return poses ``(n, 4, 4)`` of a target with the rotation of its tip, and its geometric Jacobian
        ``(n, 6, joints)``: zero for joints that do not carry it.
        """
        joints = self._checked(joints)
        branch, at = self.branch_of(target)
        Ts, own = branch.arm.tool(
            np.ascontiguousarray(joints[:, branch.joints]), self.serial_values(branch, values), at
        )
        jacobian = np.zeros((len(joints), 6, self.chain.size), dtype=own.dtype)
        jacobian[:, :, branch.joints] = own
        return Ts, jacobian

    def singular_distance(self, joints: Array, values: Array, target: int = 0) -> tuple[Array, NDArray[np.int_]]:
        """Return ``RigidArm.singular_distance`` of the chain that carries the target."""
        branch, at = self.branch_of(target)
        distance, joint = branch.arm.singular_distance(
            np.ascontiguousarray(joints[:, branch.joints]), self.serial_values(branch, values), at
        )
        return distance, np.array(branch.joints, dtype=np.int_)[joint]

    @property
    def rigid(self) -> "TreeArm":
        """The robot itself: it has no effects."""
        return self

    @property
    def groups(self) -> tuple[str, ...]:
        """Return no groups: the robot has no effects."""
        return ()

    def dh_chain(self, values: Array) -> None:
        """Return None: a robot with several tips is no single chain."""

    @cached_property
    def tips(self) -> tuple[_Branch, ...]:
        """The chain to every tip, with its last frame's origin in place of targets."""
        return tuple(self._branch(c, [""], []) for c in range(len(self.chain.tips)))

    def skeleton(self, joints: Array, values: Array) -> Skeleton:
        """Return each chain as one line with corners, in frame 0."""
        at_origin = np.concatenate([np.zeros(_BASE), values[_BASE:]])
        lines, frames = list[Array](), list[Array]()
        for branch in self.tips:
            own = self.serial_values(branch, at_origin)
            line = branch.arm.corners(joints[:, branch.joints], own)
            line = line @ exp(own[3:6]).T + own[:3]
            lines.append(line)
            frames.append(line[:, ::2])
        last = [line[:, -1:] for line in lines]
        every = np.concatenate([*(line[:, :-1] for line in frames), *last], axis=1)
        return Skeleton(lines, every, every, np.empty((len(joints), 0, 2, 3)), ())

    def column_priority(self) -> tuple[int, ...]:
        """Return the base, the mounts, the links as in a serial arm's canonical gauge, the targets, then all others.

        The links are those of chains with measured targets, the first of which places the joints that it shares.
        """
        mounts = [i for i, each in enumerate(self.names) if each.startswith("mount.")]
        tools = [i for i, each in enumerate(self.parameters) if each.group == "tool"]
        return tuple(dict.fromkeys([*range(_BASE), *mounts, *self._link_priority(), *tools, *range(len(self.names))]))

    def _link_priority(self) -> list[int]:
        """Return the indices of the links' preferred parameters, of the chains with measured targets."""
        chain, index = self.chain, {name: i for i, name in enumerate(self.names)}
        measured = {chain.tips.index(tip_of(target)) for target in self.targets}
        order, placed = list[int](), set[int]()
        for c in sorted(measured):
            branch = chain.chains[c]
            for row in range(branch.size):
                cells = preferred_cells(branch, row, on_base=chain.roots[c] not in placed)
                order += [index[f"{chain.owner(c, row, cell)}.{cell}"] for cell in cells]
            placed.add(chain.roots[c])
        return order

    def rank_point(self, values: Array) -> Array:
        """Return ``values`` with nominally parallel axes exactly parallel, for decisions on rank."""
        found = values.copy()
        for branch in self.tips:
            own = branch.arm.rank_point(self.serial_values(branch, found))
            found[branch.columns[_BASE:]] = own[_BASE:-3]
        return found

    def structure_joints(self, count: int, rng: np.random.Generator) -> Array:
        """Draw joint positions for identifiability within the limits."""
        return self.chain.random_joints(count, rng)

    def _checked(self, joints: Array) -> Array:
        if joints.ndim != 2 or joints.shape[1] != self.chain.size:
            raise LabError(
                f"joints of shape {joints.shape} do not fit robot '{self.chain.name}': give (poses, {self.chain.size})"
            )
        return joints


def _positions(targets: Sequence[str], tool: Mapping[str, Array]) -> dict[str, Array]:
    """Return nominal positions ``(3,)`` (m, in the tip's last frame): by ``tool``, the default tool's, or zero."""
    default = {target: np.array(DEFAULT_TOOL.get(point_of(target), (0.0, 0.0, 0.0))) for target in targets}
    return target_positions(targets, {**default, **tool})


def _vector(T: Array) -> Array:
    """Return position and rotation vector ``(6,)`` of a pose."""
    return np.concatenate([T[:3, 3], log(T[:3, :3])])


def _turned_about(points: Array, centre: Array, axes: Array) -> Array:
    """Return derivatives ``(n, k, 3, 3)`` of points by turns about the columns of ``axes`` through a centre."""
    lever = (points - centre)[..., None, :]
    return np.asarray(np.cross(axes.T, lever).swapaxes(-1, -2))
