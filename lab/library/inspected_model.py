"""The nominal model and the shape of a robot, as plain values: an arm, several tips, or a mechanism with loops."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from lab.core import se3
from lab.core.errors import counted
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import DEGREES, MM
from lab.extension_points import load_all
from lab.kinematics.closed.loop_closure import BASE, Configuration, Step
from lab.kinematics.closed.loop_closure import SINGULAR as REFUSED
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
from lab.library.result import joint_values, number, printed, tidy
from lab.report.document import Block, Bullets, Paragraph, Table, guarded
from lab.report.views.layout_graph import layout_values

__all__ = [
    "ClosedShape", "closed_blocks", "closed_nominal", "closed_shape", "closed_shape_of", "serial_blocks",
    "serial_frames", "serial_nominal", "serial_shape", "shape_of", "tree_blocks", "tree_nominal",
]  # fmt: skip

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


def _limits_and_speed(joint: dict[str, Any]) -> tuple[str, str]:
    unit = "mm" if joint["type"] == "prismatic" else "deg"
    speed = joint[f"speed_{unit}_per_s"]
    limits = f"{printed(joint[f'lower_{unit}'])} … {printed(joint[f'upper_{unit}'])}"
    return limits, "–" if speed is None else printed(speed)


def _with_joint(joint: str, sign: int, offset: float) -> str:
    """A value to which a joint's position adds, by its sign: the joint and the offset."""
    position = joint if sign > 0 else f"−{joint}"
    return position if offset == 0 else f"{position} {'−' if offset < 0 else '+'} {printed(abs(offset))}"


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


@guarded
def tree_blocks(values: Mapping[str, Any]) -> tuple[Block, ...]:
    """The Denavit-Hartenberg table of each tip's chain, with limits, and its reach."""
    blocks = list[Block]()
    for tip in values["tips"]:
        mount = tip["mount"]
        stands = ""
        if mount is not None:
            at, turn = (", ".join(printed(x) for x in mount[key]) for key in ("position_mm", "rotation_vector_deg"))
            stands = f"; its frame 0 stands at ({at}) mm, turned by ({turn})°, in that of {values['tips'][0]['name']}"
        reach = printed(tip["reach_mm"])
        blocks += [
            Paragraph(
                f"{values['robot']} to {tip['name']}: Denavit-Hartenberg, {tip['convention']}, "
                f"{_ORDERS[tip['convention']]}; mm and °; reach {reach} mm from axis 1 to the last frame{stands}"
            ),
            Table(
                ("link", "θ", "d", "a", "α", "limits", "speed per s"),
                tuple(
                    (joint["link"], *row[1:]) for joint, row in zip(tip["joints"], _rows(tip["joints"]), strict=True)
                ),
            ),
        ]
    return tuple(blocks)


_NEAREST = "a pose is met in its place, and in its rotation as near as these can"
_ORDERS = {"distal": "Rz(θ) Tz(d) Tx(a) Rx(α)", "craig": "Rx(α) Tx(a) Rz(θ) Tz(d)"}


@guarded
def serial_blocks(values: Mapping[str, Any]) -> tuple[Block, ...]:
    """The Denavit-Hartenberg table with limits, the reach, and the singularities."""
    convention = values["convention"]
    solutions = "" if values["ways"] is None else f"; {values['ways']} inverse-kinematics solutions of a pose"
    return (
        Paragraph(f"{values['robot']}: Denavit-Hartenberg, {convention}, {_ORDERS[convention]}; mm and °"),
        Table(("i", "θ", "d", "a", "α", "limits", "speed per s"), _rows(values["joints"])),
        Paragraph(f"reach {printed(values['reach_mm'])} mm from axis 1 to the last frame{solutions}"),
        Paragraph(_freedoms_text(values["freedoms"])),
        *_singularities(values),
        *_frames(values["khalil"]),
    )


def _freedoms_text(values: Mapping[str, Any]) -> str:
    index, freedoms = values["index"], values["degrees_of_freedom"]
    text = f"mobility index {index}, {freedoms} degrees of freedom of the last frame"
    if values["redundancy"]:
        text += f": redundant by {values['redundancy']}; {', '.join(values['free'])} can move while it stands still"
    else:
        text += ": not redundant but at singularities"
    if values["planar"]:
        turns = " and turns about its normal" if freedoms > 2 else ", and its turn follows from its place"
        return f"{text}; it moves in a plane{turns}"
    lacks = [f"{count} {name}" for count, name in ((values["missing_displacements"], "of its displacements"),
                                                   (values["missing_turns"], "of its turns")) if count]  # fmt: skip
    if not lacks:
        return text if freedoms >= 6 or index >= 6 else f"{text}; {_NEAREST}"
    return f"{text}; no joint makes {' and '.join(lacks)}; {_NEAREST}"


def _rows(joints: list[dict[str, Any]]) -> tuple[tuple[str, ...], ...]:
    rows = []
    for i, joint in enumerate(joints):
        slides = joint["type"] == "prismatic"
        theta, d = printed(joint["theta_deg"]), printed(joint["d_mm"])
        moved = _with_joint(joint["name"], joint["sign"], joint["d_mm" if slides else "theta_deg"])
        theta, d = (theta, moved) if slides else (moved, d)
        lengths = printed(joint["a_mm"]), printed(joint["alpha_deg"])
        rows.append((str(i + 1), theta, d, *lengths, *_limits_and_speed(joint)))
    return tuple(rows)


@guarded
def _frames(khalil: Mapping[str, Mapping[str, Any]]) -> tuple[Block, ...]:
    rows = tuple((name, *(printed(each[key]) for key in each if key != "note")) for name, each in khalil.items())
    notes = [f"{name}: {each['note']}".replace("-", "−") for name, each in khalil.items() if each["note"]]
    return (
        Paragraph(
            "base in the world and targets in the last frame, Khalil and Kleinfinger: "
            "Rz(γ) Tz(b) Rx(α) Tx(d) Rz(θ) Tz(r); mm and °"
        ),
        Table(("", "γ", "b", "α", "d", "θ", "r"), rows),
        *((Bullets(tuple(notes)),) if notes else ()),
    )


@guarded
def _singularities(values: Mapping[str, Any]) -> tuple[Block, ...]:
    if values["determinant"] is None:
        return ()
    text = values["determinant"].replace("-", "−").replace("*", "·")
    lines = []
    for each in values["singularities"]:
        where = f"{each['name']}, {each['where']} = 0"
        if each["example"] is None:
            lines.append(f"{where}: not within the limits")
            continue
        parts = " or ".join(" ".join(f"{part:+.3g} {name}" for name, part in one.items()) for one in each["free"])
        at = ", ".join(f"{value:.1f}" for value in np.round(each["example"], 1) + 0.0)
        moves = (
            f"with the self-motion {parts}" if parts else "where one of these motions is lost, and nothing moves alone"
        )
        lines.append(f"{where}: e.g. at ({at}), {moves}")
    ends = "singular where a factor is zero:" if lines else "never singular."
    return (
        Paragraph(f"det J = {text} (m), of {values['determinant_of']}; {ends}"),
        Bullets(tuple(line.replace("-", "−").replace("self−motion", "self-motion") for line in lines)),
    )


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
        "legs": layout_values(mechanism),
        "share_closing": tidy(shape.share),
        "extents_mm": {axis: _mm(ends) for axis, ends in zip("xyz", shape.extents, strict=True)},
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
                "platform_mm": _mm(each.place),
            }
            for each in form.singularities
        ],
    }


def _numbers(dimensions: dict[str, Array]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in dimensions.items():
        if name.endswith("_rad"):
            found[f"{name.removesuffix('_rad')}_deg"] = [tidy(angle) for angle in np.degrees(value)]
        else:
            found[f"{name.removesuffix('_m')}_mm"] = (
                [_mm(point) for point in value] if value.ndim else tidy(MM.of(float(value)))
            )
    return found


def _mm(lengths: Array) -> list[float]:
    return [tidy(value) for value in MM.of(lengths)]


@guarded
def closed_blocks(values: Mapping[str, Any]) -> tuple[Block, ...]:
    """The joints, the frames and what closes the loops as tables, then the shape."""
    closers = [counted(len(values[kind]), kind[:-1]) for kind in ("rods", "pins") if values[kind]]
    signs = {joint["name"]: joint["sign"] for joint in values["joints"]}
    joints = tuple((joint["name"], joint["offset"], *_limits_and_speed(joint)) for joint in values["joints"])
    paths = [", ".join(_step_text(step, signs) for step in frame["path"]) or "–" for frame in values["frames"]]
    frames = tuple((frame["name"], frame["on"], path) for frame, path in zip(values["frames"], paths, strict=True))
    rods = tuple((rod["name"], " – ".join(rod["between"]), _length(rod, signs)) for rod in values["rods"])
    pins = tuple(
        (pin["name"], " – ".join(pin["between"]), f"meet in {' '.join(pin['along'])}") for pin in values["pins"]
    )
    return (
        Paragraph(
            f"{values['robot']}: a mechanism with loops: {counted(len(values['joints']), 'measured joint')}, "
            f"{counted(values['passive'], 'passive value')}, {' and '.join(closers)}; mobility {values['mobility']}; "
            "mm and °"
        ),
        Table(("joint", "moves", "limits", "speed per s"), joints),
        Table(("frame", "on", "path"), frames),
        Table(("rod" if rods else "pin", "between", "length"), rods + pins),
        *_shape(values),
    )


def _step_text(step: dict[str, Any], signs: dict[str, int]) -> str:
    value = step["value_deg"] if len(step["kind"]) == 2 else step["value_mm"]
    if step["passive"]:
        return f"{step['kind']} passive ({printed(value)})"
    if step["joint"] is not None:
        return f"{step['kind']} {_with_joint(step['joint'], signs[step['joint']], value)}"
    return f"{step['kind']} {printed(value)}{' exact' if step['exact'] else ''}"


def _length(rod: dict[str, Any], signs: dict[str, int]) -> str:
    if rod["joint"] is not None:
        return _with_joint(rod["joint"], signs[rod["joint"]], rod["length_mm"])
    return f"{printed(rod['length_mm'])}{' exact' if rod['exact'] else ''}"


def _gruebler(count: Mapping[str, Any]) -> str:
    most, internal = (3, "") if count["planar"] else (6, f" − {count['internal']} internal")
    turns = "" if count["planar"] or not count["internal"] else "; each rod turns about itself"
    bodies, joints = f"{most} × {count['bodies']} bodies", f"{most} × {count['joints']} joints"
    freedoms = f"{count['joint_freedoms']} freedoms of the joints"
    return f"Grübler's count {count['mobility']} = {bodies} − {joints} + {freedoms}{internal}{turns}"


@guarded
def _shape(values: Mapping[str, Any]) -> tuple[Block, ...]:
    count = f"{counted(len(values['joints']), 'joint')} + {counted(values['passive'], 'passive value')}"
    closures = counted(values["closures"], "closure")
    lines = [
        f"mobility {values['mobility']} = {count} − {closures}; by the rank at the nominal position, "
        f"{values['freedoms_at_home']}",
        _gruebler(values["grubler"]),
    ]
    if values["closed_form"] is None:
        lines.append("no closed form of it is known, so its modes are not counted")
    else:
        lines.append(f"it is a {values['closed_form']['of']}: {_dimensions(values['closed_form'])}")
        lines.append(
            f"at the nominal joint positions it can be assembled in {counted(values['assembly_modes'], 'way')}; "
            f"its legs reach the nominal pose in {counted(values['working_modes'], 'way')}"
        )
    ends = ", ".join(f"{axis} {_ends(pair)}" for axis, pair in values["extents_mm"].items())
    size = ""
    if values["area_m2"] is not None:
        size = f", an area of {values['area_m2']:.3g} m²"
    elif values["volume_m3"] is not None:
        size = f", a volume of {values['volume_m3']:.3g} m³"
    lines.append(f"the origin of {values['platform']} reaches {ends}{size}")
    least, middle, largest = (values["closures_condition"][key] for key in ("least", "middle", "largest"))
    lines.append(
        f"its loops close at {100 * values['share_closing']:.3g} % of random joint positions within the limits, with a "
        f"condition number of {least:.2g} to {largest:.2g}, mostly {middle:.2g} (1 is best, {REFUSED:g} refused)"
    )
    if values["singularities"] is None:
        lines.append("where it is singular is not known, but by that condition number, which grows there")
        return (Bullets(tuple(lines)),)
    return (
        Bullets(tuple(lines)),
        Paragraph("Singularities within the limits (distance from 0, singular, to 1):"),
        Bullets(tuple(_singularity_text(values, each) for each in values["singularities"])),
    )


def _singularity_text(values: Mapping[str, Any], each: dict[str, Any]) -> str:
    units = {" mm" if joint["type"] == "prismatic" else "°" for joint in values["joints"]}
    unit = units.pop() if len(units) == 1 else " mm and °"
    at = f"at ({_rounded(each['example'])}){unit}, {values['platform']} at ({_rounded(each['platform_mm'])}) mm"
    near = f"reached, e.g. {at}" if each["within_limits"] else f"no nearer than {each['distance']:#.2g}, {at}"
    return f"{each['name']}, where {each['where']}: {near}"


def _dimensions(form: dict[str, Any]) -> str:
    if "span_mm" in form:
        return f"anchors {printed(form['span_mm'])} mm apart"
    if "anchors_mm" in form:
        ends = (", ".join(f"({_rounded(point)})" for point in form[f"{name}_mm"]) for name in ("anchors", "pins"))
        return "anchors {} and, on the platform, pins {} mm".format(*ends)
    return (
        f"arms of {printed(form['arm_mm'])} mm at {', '.join(map(printed, form['azimuths_deg']))}°, rods of "
        f"{printed(form['rod_mm'])} mm; hips {printed(form['base_radius_mm'])} mm from the centre, rods' ends "
        f"{printed(form['platform_radius_mm'])} mm"
    )


def _ends(pair: list[float]) -> str:
    low, high = (printed(round(value)) for value in pair)
    return f"{low} … {high} mm" if low != high else f"{low} mm"


def _rounded(values: list[float]) -> str:
    return ", ".join(f"{value:.1f}" for value in np.round(values, 1) + 0.0).replace("-", "−")
