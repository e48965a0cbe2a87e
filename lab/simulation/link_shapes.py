"""Bodies for an arm of which only the axes are known: rods for links, as thick as the arm is large, and their masses.

A link runs along its own axis for d and along the common normal for a. A slide is a rod as long as its
stroke that reaches back from the link, or, where another slide rides on it, a carriage on a column. Two links
whose rods meet in most poses (around a wrist, say) cannot be judged by rods, so they may touch. So may what sits on a
slide's own line and the link that guides it: a quill is drawn back into the arm with the hand that turns about it.
"""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.formats.link_tree import link_tree
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.chain import Chain
from lab.simulation.collisions import at_contacts
from lab.simulation.model import at_zero, body_pose, compiled, coordinates, flange_body, let_weigh_nothing

__all__ = ["DENSITY", "dress", "link_rods", "reach_of"]

DENSITY = 1500.0  # kg/m^3 of a rod: castings are hollow, motors and gears are not
_THICK, _TAPER = 0.06, 0.55  # radius of the first link beside the arm's reach; how much less the last one's is
_SPOKE_M, _BALL_M = 0.004, 0.014  # radius of what carries a target; how far from the target it ends
_SOME_KG = 1e-6  # a body with less has no mass of its own
_SHORT_M = 1e-3  # a shorter stretch is drawn as a ball
_ALIKE_RAD = 1e-3  # axes that differ by less are one
_POSES, _MOST = 200, 0.5  # poses at which rods are looked at; in more than this share of them links only seem to touch
_PAINT, _STEEL = (0.95, 0.38, 0.06, 1.0), (0.58, 0.60, 0.64, 1.0)


@dataclass(frozen=True)
class Rod:
    """A stretch with round ends of the link that ``joint`` (from 0; -1 is the base) moves.

    ``start`` and ``end`` are ``(3,)`` m in frame 0, joint positions zero.
    """

    joint: int
    start: Array
    end: Array
    radius: float


def reach_of(chain: Chain) -> float:
    """How far (m) the last frame gets from frame 0, in random poses within the limits."""
    arm = SerialArm(chain)
    joints = chain.random_joints(_POSES, rng_for(0, "structure"))
    return float(np.linalg.norm(arm.flange(joints, arm.nominal())[:, :3, 3], axis=1).max())


def link_rods(chain: Chain) -> list[Rod]:
    """The rods of all links, at least one each."""
    n, (frames_at, last) = chain.size, _frames(chain)
    ends = [frame[:3, 3] - row[1] * frame[:3, 2] for frame, row in zip(frames_at, chain.table, strict=True)]
    ends.append(last[:3, 3])  # where the link before each joint ends, and the last
    radii = _THICK * max(reach_of(chain), 0.1) * (1 - _TAPER * np.arange(n) / max(n - 1, 1))
    rods = []
    for i in range(n):
        here, z = frames_at[i][:3, 3], frames_at[i][:3, 2]
        stretches = [(here, ends[i + 1])]
        if not chain.prismatic[i]:
            stretches.append((ends[i], here))
        elif i + 1 < n and chain.prismatic[i + 1]:
            low, high = np.sort(chain.sign[i] * np.array([min(chain.lower[i], 0.0), max(chain.upper[i], 0.0)]))
            rods.append(Rod(i - 1, here + low * z, here + high * z, radii[i]))
        else:
            stretches.append((here - chain.sign[i] * _stroke(chain.lower[i], chain.upper[i]) * z, here))
        long = [pair for pair in stretches if np.linalg.norm(pair[1] - pair[0]) > _SHORT_M]
        if i == n - 1:
            long = [(start, _short_of(last[:3, 3], start, end, radii[i])) for start, end in long]
        rods += [Rod(i, start, end, radii[i]) for start, end in long or [(here, here)]]
    return rods


def _frames(chain: Chain) -> tuple[list[Array], Array]:
    """The frame ``(4, 4)`` of each joint's link in frame 0, and the last frame, joint positions zero."""
    arm = SerialArm(chain)
    tree, frame, found = link_tree(arm, arm.nominal()), np.eye(4), list[Array]()
    for link in tree.moving:
        frame = frame @ link.T_parent_link
        found.append(frame)
    return found, frame @ tree.moving[-1].T_link_frame


def _drawn_in(chain: Chain) -> list[tuple[int, int]]:
    """Pairs of a slide's guide (-1 is the base) and what the slide carries on its own line into it.

    That is links which turn about the line or slide along it, and, ``chain.size``, the flange if it is there too.
    """
    frames, last = _frames(chain)
    found = list[tuple[int, int]]()
    for i in [joint for joint, slides in enumerate(chain.prismatic) if slides]:
        origin, along = frames[i][:3, 3], frames[i][:3, 2]
        for k, frame in enumerate([*frames, last][i + 1 :], start=i + 1):
            off = np.cross(frame[:3, 3] - origin, along)
            across = np.cross(frame[:3, 2], along) if k < chain.size else np.zeros(3)
            if np.linalg.norm(off) > _SHORT_M or np.linalg.norm(across) > _ALIKE_RAD:
                break
            found.append((i - 1, k))
    return found


def _stroke(lower: float, upper: float) -> float:
    """A slide's stroke (m); negative where it moves out against its axis, as a quill does whose axis points up."""
    return float(np.copysign(upper - lower, upper if abs(upper) >= abs(lower) else lower))


def _short_of(flange: Array, start: Array, end: Array, radius: float) -> Array:
    """Where a rod's axis ends, so that its round end just reaches the flange."""
    along = end - start
    length = float(np.linalg.norm(along))
    meets = np.linalg.norm(end - flange) < _SHORT_M and length > 2 * radius
    return np.asarray(end - along * (radius / length if meets else 0.0))


def dress(
    path: Path,
    spec: mujoco.MjSpec,
    chain: Chain,
    T_world_frame0: Array,
    bodies: Sequence[str],
    tool: Mapping[str, Array],
    mass_kg: Array | None = None,
) -> bool:
    """Give bodies that stand on the chain's axes rods, and spokes to the targets ``tool`` (m, in the last frame).

    Args:
        bodies: of the joints, outward.
        mass_kg: ``(joints,)`` of links that have none yet, NaN where unknown; those are as heavy as their rods.

    Returns:
        Whether the mass of any had to be assumed.
    """
    bare = spec.copy()
    let_weigh_nothing(bare)
    model = compiled(path, bare)
    data = at_zero(model)
    rods, known = link_rods(chain), np.full(chain.size, np.nan) if mass_kg is None else mass_kg
    volume = np.zeros(chain.size)
    for rod in rods:
        if rod.joint >= 0:
            volume[rod.joint] += _volume(rod)
    density = np.where(np.isnan(known), DENSITY, known / volume)
    heavy = model.body_mass[[model.body(name).id for name in bodies]] > _SOME_KG
    density[heavy] = 0.0
    base = model.body(int(model.body(bodies[0]).parentid[0])).name
    for rod in rods:
        name = bodies[rod.joint] if rod.joint >= 0 else base
        T_body_frame0 = se3.inverse(body_pose(data, model.body(name).id)) @ T_world_frame0
        _add(spec.body(name), rod, T_body_frame0, density[rod.joint] if rod.joint >= 0 else 0.0)
    T_frame0_last = SerialArm(chain).flange(np.zeros((1, chain.size)), SerialArm(chain).nominal())[0]
    hand = flange_body(model, bodies)
    T_body_frame0 = se3.inverse(body_pose(data, model.body(hand).id)) @ T_world_frame0
    for place in tool.values():
        length = np.linalg.norm(place)
        if length > 2 * _BALL_M:
            tip = se3.transform(T_frame0_last, (place * (1 - _BALL_M / length))[None])[0]
            _add(spec.body(hand), Rod(chain.size, T_frame0_last[:3, 3], tip, _SPOKE_M), T_body_frame0, 0.0)
    named = [*bodies, hand, base]  # -1 is the base
    _let_touch(path, spec, chain, {(named[guide], named[carried]) for guide, carried in _drawn_in(chain)})
    return bool((np.isnan(known) & ~heavy).any())


def _volume(rod: Rod) -> float:
    length = float(np.linalg.norm(rod.end - rod.start))
    return np.pi * rod.radius**2 * (length + 4 / 3 * rod.radius)


def _add(body: mujoco.MjsBody, rod: Rod, T_body_frame0: Array, density: float) -> None:
    """A capsule, or a ball."""
    ends = se3.transform(T_body_frame0, np.array([rod.start, rod.end]))
    colour = _PAINT if rod.joint % 2 == 0 else _STEEL
    if np.linalg.norm(ends[1] - ends[0]) <= _SHORT_M:
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[rod.radius, 0, 0], pos=ends[0], density=density, rgba=colour
        )
        return
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        size=[rod.radius, 0, 0],
        fromto=ends.ravel(),
        density=density,
        rgba=colour,
    )


def _let_touch(path: Path, spec: mujoco.MjSpec, chain: Chain, drawn_in: Set[tuple[str, str]]) -> None:
    """Exclude contacts between bodies that touch in most poses, and between these pairs."""
    model = compiled(path, spec)
    counts: dict[tuple[int, int], int] = {}
    joints = chain.random_joints(_POSES, rng_for(0, "structure"))
    for data in at_contacts(model, coordinates(model, chain.joint_names, joints)):
        pairs = np.sort(model.geom_bodyid[data.contact.geom[: data.ncon]], axis=1)
        for a, b in {(int(a), int(b)) for a, b in pairs}:
            counts[a, b] = counts.get((a, b), 0) + 1
    named = [tuple(model.body(body).name for body in pair) for pair, count in counts.items() if count > _MOST * _POSES]
    for first, second in named:
        spec.add_exclude(bodyname1=first, bodyname2=second)
    for first, second in sorted(drawn_in):
        if first != second and not {(first, second), (second, first)} & set(named):
            spec.add_exclude(bodyname1=first, bodyname2=second)
