"""Build a serial arm's MuJoCo model from its Denavit-Hartenberg table: bodies on the axes, with rods for links.

Rods are as thick as the arm is large, and give links without masses theirs. A link runs along its own axis for d and
along the common normal for a. A slide is a rod as long as its stroke that reaches back from the link, or, where another
slide rides on it, a carriage on a column. Two links whose rods meet in most poses (around a wrist, say) may touch, as
rods do not show whether they collide. So may the bodies on a slide's own line and the link that guides it: a quill is
drawn back into the arm with the hand that turns about it.
"""

from collections import Counter
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.formats.link_tree import link_tree
from lab.formats.robot_toml import RobotTable
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm
from lab.simulation.collisions import touching_bodies
from lab.simulation.robot_model import (
    FLANGE,
    SerialModel,
    add_targets,
    add_tracker,
    allow_massless,
    at_pose,
    at_zero,
    body_pose,
    compiled,
    coordinates,
    flange_body,
    named_tool,
)

__all__ = ["DENSITY", "PAINT", "STEEL", "add_rods", "link_rods", "reach_of", "table_model"]

_SMALL_M = 1.0  # reach of an arm with the tracker at its default distance
_PEDESTAL = 0.1  # radius of a floor-standing arm's column, as a share of its reach
DENSITY = 1500.0  # kg/m^3 of a rod: castings are hollow, motors and gears are not
_THICK, _TAPER = 0.06, 0.55  # radius of the first link over the arm's reach; relative decrease to the last one
_SPOKE_M, _BALL_M = 0.004, 0.014  # radius of a target's spoke; distance of its end from the target
_MASSLESS_KG = 1e-6  # a body with less has no mass of its own
_SHORT_M = 1e-3  # a shorter stretch is drawn as a ball
_SAME_RAD = 1e-3  # axes that differ by less are one
_POSES, _MAX_SHARE = 200, 0.5  # checked poses; links whose rods touch in a larger share of them may touch
PAINT, STEEL = (0.95, 0.38, 0.06, 1.0), (0.58, 0.60, 0.64, 1.0)


def table_model(path: Path, table: RobotTable) -> SerialModel:
    """Return the arm of a table, on the floor if the table gives a height; else in the air."""
    chain = table.chain
    tool = named_tool(table.tool)
    arm = SerialArm(chain, tuple(tool))
    tree, reach = link_tree(arm, arm.nominal(tool)), reach_of(chain)
    spec = mujoco.MjSpec()
    spec.compiler.autolimits, spec.compiler.degree = True, False
    T_world_frame0 = table.T_world_frame0
    if T_world_frame0 is None:
        T_world_frame0 = se3.pose(np.eye(3), np.array([0.0, 0.0, table.height_m or 0.0]))
    # The base, a body for each joint, and the hand with flange and targets.
    body = base = _add_body(spec.worldbody, tree.base.name, T_world_frame0)
    if table.height_m is not None:
        _add_pedestal(spec, base, table.height_m, _PEDESTAL * reach)
    bodies = []
    for link in tree.moving:
        assert link.joint is not None
        body = _add_body(body, link.name, link.T_parent_link)
        bodies.append(link.name)
        _add_joint(body, chain, link.joint, link.sign, float(table.torque[link.joint]))
    hand = _add_body(body, tree.flange.name, tree.flange.T_parent_link)
    hand.add_site(name=FLANGE)
    add_targets(hand, np.eye(4), tool)
    add_tracker(spec, max(1.0, reach / _SMALL_M))
    weighted = add_rods(path, spec, chain, T_world_frame0, bodies, tool, table.mass_kg)
    model = compiled(path, spec)
    return SerialModel(
        path=path, spec=spec, model=model, chain=chain, T_world_frame0=T_world_frame0, bodies=tuple(bodies),
        base_body=tree.base.name, tool=tool, shapes_assumed=True, masses_assumed=weighted,
        links=table.links,
    )  # fmt: skip


def _add_joint(body: mujoco.MjsBody, chain: Chain, i: int, sign: float, torque: float) -> None:
    """Give a body its joint about or along z; without a limit of its torque (Nm, N) where that is NaN."""
    body.add_joint(
        name=chain.joint_names[i],
        type=mujoco.mjtJoint.mjJNT_SLIDE if chain.prismatic[i] else mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0.0, 0.0, sign],
        range=[chain.lower[i], chain.upper[i]],
        **({} if np.isnan(torque) else {"actfrcrange": [-torque, torque]}),
    )


def _add_body(parent: mujoco.MjsBody, name: str, T_parent_body: Array) -> mujoco.MjsBody:
    return parent.add_body(name=name, **at_pose(T_parent_body))


def _add_pedestal(spec: mujoco.MjSpec, base: mujoco.MjsBody, height_m: float, radius_m: float) -> None:
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05])
    if height_m > 0:
        size, at = [radius_m, height_m / 2, 0], [0, 0, -height_m / 2]
        base.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=size, pos=at, rgba=STEEL, mass=0)


@dataclass(frozen=True)
class _Rod:
    """A stretch with round ends of the link that ``joint`` (from 0; -1 is the base) moves.

    ``start`` and ``end`` are ``(3,)`` m in frame 0, joint positions zero.
    """

    joint: int
    start: Array
    end: Array
    radius: float


def reach_of(chain: Chain) -> float:
    """Return the largest distance (m) of the last frame from frame 0, in random poses within the limits."""
    arm = SerialArm(chain)
    joints = chain.random_joints(_POSES, rng_for(0, "structure"))
    return float(np.linalg.norm(arm.flange(joints, arm.nominal())[:, :3, 3], axis=1).max())


def link_rods(chain: Chain) -> list[_Rod]:
    """Return the rods of all links, at least one each."""
    n, (frames_at, last) = chain.size, _frames(chain)
    ends = [frame[:3, 3] - row[1] * frame[:3, 2] for frame, row in zip(frames_at, chain.table, strict=True)]
    ends.append(last[:3, 3])  # where the link before each joint ends, and the last
    radii = _THICK * max(reach_of(chain), 0.1) * (1 - _TAPER * np.arange(n) / max(n - 1, 1))
    rods = []
    for i in range(n):
        origin, along = frames_at[i][:3, 3], frames_at[i][:3, 2]
        stretches = [(origin, ends[i + 1])]
        if not chain.prismatic[i]:
            stretches.append((ends[i], origin))
        elif i + 1 < n and chain.prismatic[i + 1]:
            low, high = np.sort(chain.sign[i] * np.array([min(chain.lower[i], 0.0), max(chain.upper[i], 0.0)]))
            rods.append(_Rod(i - 1, origin + low * along, origin + high * along, radii[i]))
        else:
            stroke = _stroke(chain.lower[i], chain.upper[i])
            stretches.append((origin - chain.sign[i] * stroke * along, origin))
        flange = last[:3, 3] if i == n - 1 else None
        rods += _link_of_stretches(i, stretches, radii[i], flange)
    return rods


def _link_of_stretches(
    joint: int, stretches: Sequence[tuple[Array, Array]], radius: float, flange: Array | None
) -> list[_Rod]:
    """Return the rods of a link's stretches; a ball at its origin, the first start, where all are short.

    Args:
        flange: where the last link's rods end; None for other links.
    """
    long = [pair for pair in stretches if np.linalg.norm(pair[1] - pair[0]) > _SHORT_M]
    if flange is not None:
        long = [(start, _short_of(flange, start, end, radius)) for start, end in long]
    return [_Rod(joint, start, end, radius) for start, end in long or [(stretches[0][0], stretches[0][0])]]


def _frames(chain: Chain) -> tuple[list[Array], Array]:
    """Return each joint's link frame ``(4, 4)`` in frame 0, and the last frame, joint positions zero."""
    arm = SerialArm(chain)
    tree, frame, frames = link_tree(arm, arm.nominal()), np.eye(4), list[Array]()
    for link in tree.moving:
        frame = frame @ link.T_parent_link
        frames.append(frame)
    return frames, frame @ tree.moving[-1].T_link_frame


def _drawn_in(chain: Chain) -> list[tuple[int, int]]:
    """Return pairs of a slide's guide (-1 is the base) and a link that the slide draws into it along its own line.

    The link turns about the line or slides along it, or is the flange (``chain.size``).
    """
    frames, last = _frames(chain)
    pairs = list[tuple[int, int]]()
    for i in [joint for joint, slides in enumerate(chain.prismatic) if slides]:
        origin, along = frames[i][:3, 3], frames[i][:3, 2]
        for k, frame in enumerate([*frames, last][i + 1 :], start=i + 1):
            off = np.cross(frame[:3, 3] - origin, along)
            across = np.cross(frame[:3, 2], along) if k < chain.size else np.zeros(3)
            if np.linalg.norm(off) > _SHORT_M or np.linalg.norm(across) > _SAME_RAD:
                break
            pairs.append((i - 1, k))
    return pairs


def _stroke(lower: float, upper: float) -> float:
    """Return a slide's stroke (m); negative if it moves out against its axis, as a quill whose axis points up."""
    return float(np.copysign(upper - lower, upper if abs(upper) >= abs(lower) else lower))


def _short_of(flange: Array, start: Array, end: Array, radius: float) -> Array:
    """Return the end of a rod's axis at which its round end just reaches the flange."""
    along = end - start
    length = float(np.linalg.norm(along))
    meets = np.linalg.norm(end - flange) < _SHORT_M and length > 2 * radius
    return np.asarray(end - along * (radius / length if meets else 0.0))


def add_rods(
    path: Path,
    spec: mujoco.MjSpec,
    chain: Chain,
    T_world_frame0: Array,
    bodies: Sequence[str],
    tool: Mapping[str, Array],
    mass_kg: Array | None = None,
) -> bool:
    """Give bodies on the chain's axes rods, and spokes to the targets ``tool`` (m, in the last frame).

    Args:
        bodies: of the joints, outward.
        mass_kg: ``(joints,)`` of links without masses, NaN where unknown; those get the mass of their rods.

    Returns:
        Whether the mass of any had to be assumed.
    """
    bare = spec.copy()
    allow_massless(bare)
    model = compiled(path, bare)
    data = at_zero(model)
    # Masses: of the file, of the table, or of rods of usual density.
    rods, stated = link_rods(chain), np.full(chain.size, np.nan) if mass_kg is None else mass_kg
    heavy = model.body_mass[[model.body(name).id for name in bodies]] > _MASSLESS_KG
    density = np.where(heavy, 0.0, np.where(np.isnan(stated), DENSITY, stated / _volumes(rods, chain.size)))
    # Rods of the links, each on the body of its joint.
    base = model.body(int(model.body(bodies[0]).parentid[0])).name
    for rod in rods:
        name = bodies[rod.joint] if rod.joint >= 0 else base
        T_body_frame0 = se3.inverse(body_pose(data, model.body(name).id)) @ T_world_frame0
        _add(spec.body(name), rod, T_body_frame0, density[rod.joint] if rod.joint >= 0 else 0.0)
    # Spokes to the targets.
    hand = flange_body(model, bodies)
    T_body_frame0 = se3.inverse(body_pose(data, model.body(hand).id)) @ T_world_frame0
    for spoke in _spokes(chain, tool):
        _add(spec.body(hand), spoke, T_body_frame0, 0.0)
    named = [*bodies, hand, base]  # -1 is the base
    _let_touch(path, spec, chain, {(named[guide], named[carried]) for guide, carried in _drawn_in(chain)})
    return bool((np.isnan(stated) & ~heavy).any())


def _volumes(rods: Sequence[_Rod], links: int) -> Array:
    """Return the volume (m^3) of each link's rods, ``(links,)``."""
    volume = np.zeros(links)
    for rod in rods:
        if rod.joint >= 0:
            volume[rod.joint] += _volume(rod)
    return volume


def _spokes(chain: Chain, tool: Mapping[str, Array]) -> list[_Rod]:
    """Return thin rods from the last frame to the targets that are not near it."""
    T_frame0_last = SerialArm(chain).flange(np.zeros((1, chain.size)), SerialArm(chain).nominal())[0]
    spokes = []
    for place in tool.values():
        length = np.linalg.norm(place)
        if length > 2 * _BALL_M:
            tip = se3.transform(T_frame0_last, (place * (1 - _BALL_M / length))[None])[0]
            spokes.append(_Rod(chain.size, T_frame0_last[:3, 3], tip, _SPOKE_M))
    return spokes


def _volume(rod: _Rod) -> float:
    length = float(np.linalg.norm(rod.end - rod.start))
    return np.pi * rod.radius**2 * (length + 4 / 3 * rod.radius)


def _add(body: mujoco.MjsBody, rod: _Rod, T_body_frame0: Array, density: float) -> None:
    ends = se3.transform(T_body_frame0, np.array([rod.start, rod.end]))
    colour = PAINT if rod.joint % 2 == 0 else STEEL
    if np.linalg.norm(ends[1] - ends[0]) <= _SHORT_M:
        kind, place = mujoco.mjtGeom.mjGEOM_SPHERE, {"pos": ends[0]}
    else:
        kind, place = mujoco.mjtGeom.mjGEOM_CAPSULE, {"fromto": ends.ravel()}
    body.add_geom(type=kind, size=[rod.radius, 0, 0], density=density, rgba=colour, **place)


def _let_touch(path: Path, spec: mujoco.MjSpec, chain: Chain, drawn_in: Set[tuple[str, str]]) -> None:
    """Exclude contacts between bodies that touch in most poses, and between these pairs."""
    model = compiled(path, spec)
    joints = chain.random_joints(_POSES, rng_for(0, "structure"))
    counts = Counter(
        pair for pairs in touching_bodies(model, coordinates(model, chain.joint_names, joints)) for pair in pairs
    )
    often = [pair for pair, count in counts.items() if count > _MAX_SHARE * _POSES]
    named = [(str(model.body(a).name), str(model.body(b).name)) for a, b in often]
    for first, second in named:
        spec.add_exclude(bodyname1=first, bodyname2=second)
    for first, second in sorted(drawn_in):
        if first != second and not {(first, second), (second, first)} & set(named):
            spec.add_exclude(bodyname1=first, bodyname2=second)
