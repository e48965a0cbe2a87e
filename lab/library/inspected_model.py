"""The nominal model and the shape of a robot, as plain values: an arm, several tips, or a mechanism with loops."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import DEGREES, MM
from lab.extension_points import load_all
from lab.kinematics.closed.layout import layout_of
from lab.kinematics.closed.loop_closure import BASE, Configuration, Step
from lab.kinematics.closed.mechanism import Mechanism, platform_poses
from lab.kinematics.closed.mobility import SINGULAR, ClosedFormShape, body_count, mobility_of
from lab.kinematics.differential import rates
from lab.kinematics.inverse.closed_form import Factor, closed_form_of
from lab.kinematics.joints import JointSpec
from lab.kinematics.reach import extents, reach_from_axis
from lab.kinematics.serial.chain import COLUMNS, Chain
from lab.kinematics.serial.khalil_frames import ANGULAR, khalil_frame
from lab.kinematics.serial.serial_arm import SerialArm
from lab.kinematics.tree import TreeChain
from lab.library.result import joint_values, number, tidy

__all__ = [
    "ClosedShape",
    "closed_nominal",
    "closed_shape",
    "closed_shape_of",
    "mm",
    "serial_frames",
    "serial_nominal",
    "serial_shape",
    "shape_of",
    "tree_nominal",
]

_TRIES = 200  # poses from which a singular one is sought
_ZERO = 1e-12  # of a factor (m, or a sine)
_LEAST = 1e-6  # of a joint's part in a combination


class _Singularity(NamedTuple):
    factor: Factor  # of the determinant, which is zero there
    joints: Array | None  # (n,) positions of an example; None where there is none within the limits
    free: Array  # (k, n) combinations of the joints that move nothing in the example, the largest part 1


class _SerialShape(NamedTuple):
    reach_m: float  # largest distance of the last frame from axis 1, or frame 0 where joint 1 slides
    branches: int | None  # IK solutions of a pose; None where no closed form is implemented
    determinant: str  # of the Jacobian, in words; "" where no closed form is implemented
    singularities: tuple[_Singularity, ...]
    moved: str = ""  # motions that the determinant refers to, in words


def shape_of(chain: Chain) -> _SerialShape:
    """The shape of an arm as drawn."""
    form = closed_form_of(chain)
    if form is None:
        return _SerialShape(reach_from_axis(chain), None, "", ())
    singularities = tuple(_singularity(chain, factor) for factor in form.determinant.factors if factor.terms)
    return _SerialShape(reach_from_axis(chain), form.branches, form.determinant.text, singularities, form.moved)


def _singularity(chain: Chain, factor: Factor) -> _Singularity:
    """An example of a singularity within the limits, by Newton's method on its factor."""
    joints = chain.random_joints(_TRIES, rng_for(0, "structure"))
    step = 1e-6
    for _ in range(20):
        value = factor.at(joints)
        slope = np.stack(
            [(factor.at(joints + move) - factor.at(joints - move)) / (2 * step) for move in step * np.eye(chain.size)],
            axis=1,
        )
        size = np.maximum((slope**2).sum(axis=1, keepdims=True), 1e-300)
        joints = joints - value[:, None] * slope / size
    fits = (np.abs(factor.at(joints)) < _ZERO) & ~chain.beyond_limits(joints, 0.0).any(axis=1)
    if not fits.any():
        return _Singularity(factor, None, np.empty((0, chain.size)))
    example = joints[np.flatnonzero(fits)[0]]
    arm = SerialArm(chain)
    found = rates(arm.tool(example[None], arm.nominal())[1], np.zeros((1, 6)))
    free = found.free[0, : chain.size - int(found.rank[0])]
    return _Singularity(factor, example, free / np.abs(free).max(axis=1, keepdims=True))


def _joint_kind(joints: JointSpec, i: int) -> dict[str, Any]:
    kind = "prismatic" if joints.prismatic[i] else "revolute"
    return {"name": joints.joint_names[i], "type": kind, "sign": int(joints.sign[i])}


def _joint_limits(joints: JointSpec, i: int) -> dict[str, Any]:
    unit = joints.unit(i)
    return {
        f"lower_{unit.key}": tidy(unit.of(joints.lower[i])),
        f"upper_{unit.key}": tidy(unit.of(joints.upper[i])),
        f"speed_{unit.key}_per_s": tidy(unit.of(joints.speed[i])) if np.isfinite(joints.speed[i]) else None,
    }


def _as_read(joints: JointSpec, positions: Array) -> list[float]:
    return [tidy(value) for value in joint_values(joints.prismatic, positions)]


def serial_nominal(chain: Chain) -> dict[str, Any]:
    """The table, its convention, and limits."""
    return {"convention": chain.convention, "joints": [_table_row(chain, i) for i in range(chain.size)]}


def serial_frames(T_world_frame0: Array, tool: Mapping[str, Array]) -> dict[str, Any]:
    """Base and targets in Khalil and Kleinfinger's parameters, mm and degrees, with what is not determined.

    Args:
        T_world_frame0: ``(4, 4)`` m.
        tool: positions ``(3,)`` m of the targets in the last frame.
    """
    poses = {"Z": T_world_frame0, **{f"E.{name}": se3.pose(np.eye(3), place) for name, place in tool.items()}}
    return {"khalil": {name: _khalil(pose) for name, pose in poses.items()}}


def _khalil(pose: Array) -> dict[str, Any]:
    frame = khalil_frame(pose)
    units = (DEGREES if angular else MM for angular in ANGULAR)
    numbers = {f"{s}_{unit.key}": tidy(unit.of(x)) for (s, x), unit in zip(frame.named.items(), units, strict=True)}
    return {**numbers, "note": frame.note or None}


def serial_shape(chain: Chain) -> dict[str, Any]:
    """Reach, ways to a pose, the Jacobian's determinant, and an example of each singularity."""
    shape, names = shape_of(chain), chain.joint_names
    return {
        "reach_mm": tidy(MM.of(shape.reach_m)),
        "ways": shape.branches,
        "freedoms": _degrees_of_freedom(chain),
        "determinant": shape.determinant or None,
        "determinant_of": shape.moved or None,
        "singularities": [
            {
                "name": each.factor.name,
                "where": each.factor.text,
                "example": None if each.joints is None else _as_read(chain, each.joints),
                "free": [
                    {name: tidy(part) for name, part in zip(names, parts, strict=True) if abs(part) > _LEAST}
                    for parts in each.free
                ],
            }
            for each in shape.singularities
        ],
    }


def _degrees_of_freedom(chain: Chain) -> dict[str, Any]:
    """Mobility index, degrees of freedom, redundancy with the joints that it frees, and what no joint moves."""
    found = mobility_of(chain)
    return {
        "index": found.index,
        "degrees_of_freedom": found.freedoms,
        "redundancy": found.redundancy,
        "free": [name for name, moves in zip(chain.joint_names, found.moving, strict=True) if moves],
        "planar": found.planar,
        "missing_displacements": len(found.fixed_directions),
        "missing_turns": len(found.still),
    }


def _table_row(chain: Chain, i: int) -> dict[str, Any]:
    units = [MM if column in "da" else DEGREES for column in COLUMNS]
    cells = {f"{c}_{u.key}": tidy(u.of(chain.table[i, j])) for j, (c, u) in enumerate(zip(COLUMNS, units, strict=True))}
    return {**_joint_kind(chain, i), **cells, **_joint_limits(chain, i)}


def tree_nominal(tree: TreeChain) -> dict[str, Any]:
    """The table of each tip's chain, its convention, limits and reach; the mounts of chains that share no joint."""
    return {
        "joints": [{**_joint_kind(tree, i), **_joint_limits(tree, i)} for i in range(tree.size)],
        "tips": [
            {
                "name": tip,
                "convention": chain.convention,
                "reach_mm": tidy(MM.of(reach_from_axis(chain))),
                "joints": [
                    {**_table_row(chain, i), **_joint_limits(tree, member), "link": tree.owner(c, i, "theta")}
                    for i, member in enumerate(tree.members[c])
                ],
                "mount": None if not tree.roots[c] else _placed(tree.mounts[c]),
            }
            for c, (tip, chain) in enumerate(zip(tree.tips, tree.chains, strict=True))
        ],
    }


def _placed(T: Array) -> dict[str, Any]:
    """A pose as position (mm) and rotation vector (degrees)."""
    turn = DEGREES.of(se3.log(T[:3, :3]))
    return {
        "position_mm": [tidy(x) for x in MM.of(T[:3, 3])],
        "rotation_vector_deg": [tidy(x) for x in turn],
    }


_TAKES = 4000  # random readings by which extents are found
_RANK = 1e-9  # of the largest singular value


@dataclass(frozen=True)
class ClosedShape:
    """Structure of a closed-loop nominal model, in the nominal assembly mode."""

    mobility: int  # joints and passive values less the closures' equations
    freedoms: int  # joints and passive values less the rank of the closures' Jacobian at home
    closed_form: ClosedFormShape | None  # parameters of its closed form, if it has one
    share: float  # of joint positions within the limits, those at which the loops close
    extents: Array  # (3, 2) least and largest coordinates (m) of the platform's origin in the base
    conditions: Array  # of the closures' Jacobian by the passive values: least, median and largest


def closed_shape_of(mechanism: Mechanism) -> ClosedShape:
    """The shape of a mechanism as drawn."""
    taken = JointSpec.random_joints(mechanism, _TAKES, rng_for(0, "structure"))
    closed = mechanism.assembled(taken, mechanism.nominal_values)
    joints, passive = taken[closed.fits], closed.configuration.passive.T[closed.fits]
    home = mechanism.assembled(mechanism.home[None], mechanism.nominal_values).configuration
    shapes = (find(mechanism, joints, passive) for find in load_all("lab.shapes").values())
    form: ClosedFormShape | None = next((shape for shape in shapes if shape is not None), None)
    others = () if form is None else [each.place for each in form.singularities]
    return ClosedShape(
        mobility=mechanism.size + len(mechanism.tree.passive) - mechanism.tree.equations,
        freedoms=mechanism.size + len(mechanism.tree.passive) - _rank(home),
        closed_form=form,
        share=float(closed.fits.mean()),
        extents=_extents(mechanism, joints, platform_poses(mechanism, joints, passive)[:, :3, 3], others),
        conditions=np.quantile(closed.condition[closed.fits], [0.0, 0.5, 1.0]),
    )


def _extents(mechanism: Mechanism, joints: Array, places: Array, others: Sequence[Array]) -> Array:
    """The least and largest coordinates ``(3, 2)`` m of the platform's origin, within the limits."""

    def places_of(tried: Array) -> Array:
        closed = mechanism.assembled(tried, mechanism.nominal_values, quickly=True)
        fits, found = closed.fits, np.full((len(tried), 3), np.nan)
        found[fits] = platform_poses(mechanism, tried[fits], closed.configuration.passive.T[fits])[:, :3, 3]
        return found

    return extents(mechanism, places_of, joints, places, others)


def _rank(configuration: Configuration) -> int:
    """Compute the rank of the closures' Jacobian by all moving parts, at a single pose."""
    tree, directions = configuration.tree, configuration.closures()[1]
    rows = np.zeros((tree.equations, len(tree.passive) + len(configuration.joint_values)))
    for i, opening in enumerate(tree.openings):
        for step, end, sign in opening:
            described = tree.step(*step)
            if described.passive or described.joint is not None:
                slope = configuration.slope(step, configuration.frames[end][1], directions[i])
                moved = tree.passive.index(step) if described.joint is None else len(tree.passive) + described.joint
                rows[i, moved] += sign * float(np.ravel(slope)[0])
    for i, rod in enumerate(tree.rods):
        if rod.joint is not None:
            rows[i, len(tree.passive) + rod.joint] -= 1.0
    sizes = np.linalg.svd(rows, compute_uv=False)
    return int((sizes > _RANK * sizes.max(initial=0.0)).sum())


def closed_nominal(mechanism: Mechanism) -> dict[str, Any]:
    """Joints with limits, the paths to the frames, and what closes the loops."""
    tree = mechanism.tree
    names = [frame.name for frame in tree.frames]
    return {
        "joints": [
            {**_joint_kind(mechanism, i), "offset": mechanism.offset_of(i), **_joint_limits(mechanism, i)}
            for i in range(mechanism.size)
        ],
        "frames": [
            {
                "name": frame.name,
                "on": "base" if frame.on == BASE else names[frame.on],
                "path": [_step(mechanism, step) for step in frame.path],
            }
            for frame in tree.frames
        ],
        "platform": names[tree.platform],
        "rods": [
            {
                "name": rod.name,
                "between": [names[end] for end in rod.ends],
                "length_mm": tidy(MM.of(rod.length_m)),
                "joint": None if rod.joint is None else mechanism.joint_names[rod.joint],
                "exact": rod.exact,
            }
            for rod in tree.rods
        ],
        "pins": [
            {
                "name": pin.name,
                "between": [names[end] for end in pin.ends],
                "along": "".join("xyz"[a] for a in pin.axes),
            }
            for pin in tree.pins
        ],
        "passive": len(tree.passive),
        "closures": tree.equations,
    }


def _step(mechanism: Mechanism, step: Step) -> dict[str, Any]:
    unit = DEGREES if step.is_turn else MM
    return {
        "kind": step.kind,
        f"value_{unit.key}": tidy(unit.of(step.value)),
        "joint": None if step.joint is None else mechanism.joint_names[step.joint],
        "passive": step.passive,
        "exact": step.exact,
    }


def closed_shape(mechanism: Mechanism) -> dict[str, Any]:
    """Freedoms, modes, where it gets, and how near it comes to being singular."""
    shape, count = closed_shape_of(mechanism), body_count(mechanism.tree)
    form = shape.closed_form
    flat = form is not None and form.is_planar
    reached = None if form is None else number(form.reachable)
    return {
        "mobility": shape.mobility,
        "freedoms_at_home": shape.freedoms,
        "grubler": {
            "planar": count.planar,
            "bodies": count.bodies,
            "joints": len(count.freedoms),
            "joint_freedoms": sum(count.freedoms),
            "internal": count.internal,
            "mobility": count.mobility,
        },
        "closed_form": None if form is None else {"of": form.name, **_numbers(form.dimensions)},
        "assembly_modes": None if form is None else form.modes,
        "working_modes": None if form is None else form.working,
        "legs": _legs(mechanism),
        "share_closing": tidy(shape.share),
        "extents_mm": {axis: mm(ends) for axis, ends in zip("xyz", shape.extents, strict=True)},
        "area_m2": reached if flat else None,
        "volume_m3": None if flat else reached,
        "closures_condition": dict(zip(("least", "middle", "largest"), map(number, shape.conditions), strict=True)),
        "singularities": None
        if form is None
        else [
            {
                "name": each.kind,
                "where": each.where,
                "distance": number(each.distance),
                "within_limits": each.distance < SINGULAR,
                "example": _as_read(mechanism, each.joints),
                "platform_mm": mm(each.place),
            }
            for each in form.singularities
        ],
    }


def _legs(mechanism: Mechanism) -> list[list[dict[str, Any]]]:
    """Return the joints of each leg from the base to the platform."""
    layout = layout_of(mechanism.tree)
    return [
        [{"kind": layout.joints[i].kind, "actuated": layout.joints[i].actuated} for i in leg] for leg in layout.legs
    ]


def _numbers(dimensions: dict[str, Array]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in dimensions.items():
        if name.endswith("_rad"):
            found[f"{name.removesuffix('_rad')}_deg"] = [tidy(angle) for angle in np.degrees(value)]
        else:
            found[f"{name.removesuffix('_m')}_mm"] = (
                [mm(point) for point in value] if value.ndim else tidy(MM.of(float(value)))
            )
    return found


def mm(lengths: Array) -> list[float]:
    """Return lengths in mm, without the last digits of the conversion."""
    return [tidy(value) for value in MM.of(lengths)]
