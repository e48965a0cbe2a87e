"""A mechanism with loops as MuJoCo has it: a body for each frame, joints for what moves, tendons for rods.

The model rests (``qpos0``) in the nominal position: joints at home, passive values nominal. MuJoCo computes
the length of a tendon there whenever it compiles; the tendon's equality adds what the rod is longer, so that a file
of the model stands alone. Shapes collide with nothing: they are there to be looked at.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.closed.configuration import Configuration, Dimensions
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.closed.structure import BASE, Step
from lab.simulation.link_shapes import DENSITY
from lab.simulation.model import add_targets, add_tracker, compiled, let_weigh_nothing
from lab.simulation.write_mjcf import set_vectors, write_in_full

__all__ = ["BASE_BODY", "closed_mjcf", "closed_spec"]

BASE_BODY = "base"
_ARM, _PLATE, _BALL, _ROD, _SPOKE = 0.02, 0.012, 0.014, 0.007, 0.004  # radii beside the mechanism's size
_SHORT_M = 1e-3  # a shorter stretch is not drawn
_PAINT, _STEEL = (0.95, 0.38, 0.06, 1.0), (0.58, 0.60, 0.64, 1.0)


def closed_spec(
    mechanism: Mechanism, values: Array, tool: Mapping[str, Array], height_m: float | None
) -> mujoco.MjSpec:
    """The mechanism of parameters ``(p,)``, its base upright at this height; in the air where there is none.

    A joint that is measured is called like the robot's, and its ``qpos`` is its position; one that is passive is called
    ``<frame>.<step>``. A leg whose length is a joint position has no joint: its equality is set pose by pose
    (``loops.closed_qpos``), and rests at home. Tendons and equalities are called like rods and pins. A pin is three
    equations here, whatever axes it is along: of a planar mechanism the third is 0 = 0.

    Args:
        values: in the order of ``mechanism.names``, or more that follow; ``base.*`` is not used.
        tool: targets (m) in the platform's frame.
    """
    tree, dimensions = mechanism.tree, mechanism.dimensions(values)
    rest = _rest(mechanism)
    size = max(float(np.linalg.norm(origin[:3, 0])) for _, origin in rest.frames)
    spec = mujoco.MjSpec()
    spec.modelname = mechanism.name
    spec.compiler.autolimits, spec.compiler.degree = True, False
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    spec.option.gravity = np.zeros(3)
    let_weigh_nothing(spec)
    spec.worldbody.add_body(name=BASE_BODY, pos=[0.0, 0.0, height_m or 0.0])
    bodies = _bodies(mechanism, dimensions, rest.passive[:, 0])
    for body in bodies:
        _add_body(spec, mechanism, body)
    platform = tree.frames[tree.platform].name
    add_targets(spec.body(platform), np.eye(4), tool)
    add_tracker(spec, max(1.0, size))
    _dress(spec, mechanism, bodies, size)
    for place in tool.values():
        _add_stretch(spec.body(platform), np.zeros(3), place, _SPOKE * size, 0)
    if height_m is not None:
        _stand(spec, bodies, height_m, size, hangs=bool(rest.frames[tree.platform][1][2, 0] < 0))
    _close(spec, mechanism, dimensions, size)
    return spec


def closed_mjcf(spec: mujoco.MjSpec) -> str:
    """The spec as MJCF whose positions are the spec's to rounding: of every number MuJoCo writes six digits."""
    model = compiled(Path(spec.modelname), spec)
    root = ET.fromstring(spec.to_xml())
    write_in_full(root, model)
    for element in root.iter("joint"):
        joint = model.joint(element.get("name", ""))
        limits = {"range": joint.range} if "range" in element.attrib else {}
        set_vectors(element, ref=model.qpos0[joint.qposadr], **limits)
    for element in root.findall("equality/tendon"):
        set_vectors(element, polycoef=model.equality(element.get("name", "")).data[:5])
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


@dataclass(frozen=True)
class _Body:
    """A stretch of a frame's path, up to a step that moves or to its end.

    Attributes:
        on: the name of the body that it stands on.
        T_on_body: pose ``(4, 4)`` at rest.
        moved: the step that moves it; None where nothing does.
        joint: the name of the joint there.
        at: where that rests, as ``qpos`` (m, rad).
        driven: how many joint positions carry it.
    """

    name: str
    on: str
    T_on_body: Array
    moved: Step | None
    joint: str
    at: float
    driven: int


def _rest(mechanism: Mechanism) -> Configuration:
    """The nominal mechanism, with its loops closed, if it has any."""
    if mechanism.tree.passive:
        return mechanism.assembled(mechanism.home[None], mechanism.nominal_values).configuration
    return Configuration.of(
        mechanism.tree, mechanism.dimensions(mechanism.nominal_values), mechanism.home[None], np.empty((0, 1))
    )


def _bodies(mechanism: Mechanism, dimensions: Dimensions, passive: Array) -> list[_Body]:
    """All bodies, each after the one that it stands on, at passive values ``(z,)`` at rest."""
    tree, bodies, driven = mechanism.tree, [], {BASE_BODY: 0}
    for f, frame in enumerate(tree.frames):
        on = BASE_BODY if frame.on == BASE else tree.frames[frame.on].name
        parts = _parts(frame.path)
        for part in parts:
            T, moved, joint, at = np.eye(4), None, "", 0.0
            for s in part:
                step, value = frame.path[s], float(dimensions.steps[f][s])
                if step.joint is not None:
                    moved, joint, at = step, mechanism.joint_names[step.joint], float(mechanism.home[step.joint])
                    value += float(mechanism.sign[step.joint]) * at
                elif step.passive:
                    value = at = float(passive[tree.passive.index((f, s))])
                    moved, joint = step, tree.name_of(f, s)
                T = T @ _elementary(step, value)
            name = frame.name if part is parts[-1] else tree.name_of(f, part[-1])
            driven[name] = driven[on] + (moved is not None and moved.joint is not None)
            bodies.append(_Body(name, on, T, moved, joint, at, driven[name]))
            on = name
    return bodies


def _parts(path: tuple[Step, ...]) -> list[list[int]]:
    """The steps of a path, cut after each that moves."""
    parts: list[list[int]] = [[]]
    for s in range(len(path)):
        if s and (path[s - 1].passive or path[s - 1].joint is not None):
            parts.append([])
        parts[-1].append(s)
    return parts


def _elementary(step: Step, value: float) -> Array:
    """Pose ``(4, 4)`` of a step."""
    vector = value * np.eye(3)[step.axis]
    return se3.pose(se3.exp(vector), np.zeros(3)) if step.is_turn else se3.pose(np.eye(3), vector)


def _add_body(spec: mujoco.MjSpec, mechanism: Mechanism, body: _Body) -> None:
    """The body, with its joint."""
    quat = se3.quaternion_from_rotation(body.T_on_body[:3, :3])
    added = spec.body(body.on).add_body(name=body.name, pos=body.T_on_body[:3, 3], quat=quat)
    if body.moved is None:
        return
    kind = mujoco.mjtJoint.mjJNT_HINGE if body.moved.is_turn else mujoco.mjtJoint.mjJNT_SLIDE
    joint = added.add_joint(name=body.joint, type=kind, axis=_axis(mechanism, body.moved), ref=body.at)
    if (i := body.moved.joint) is not None:
        joint.range = [mechanism.lower[i], mechanism.upper[i]]


def _axis(mechanism: Mechanism, step: Step) -> Array:
    """Along or about which a step moves where its ``qpos`` grows."""
    axis: Array = np.eye(3)[step.axis] * (1.0 if step.joint is None else mechanism.sign[step.joint])
    return axis


def _close(spec: mujoco.MjSpec, mechanism: Mechanism, dimensions: Dimensions, size: float) -> None:
    """Rods and pins, between sites at the origins of the frames that they join, with balls there."""
    tree = mechanism.tree
    ends = [end for pair in [*(rod.ends for rod in tree.rods), *(pin.ends for pin in tree.pins)] for end in pair]
    sites = {tree.frames[end].name: f"{tree.frames[end].name}.origin" for end in ends}
    for name, site in sites.items():
        spec.body(name).add_site(name=site)
        ball = mujoco.mjtGeom.mjGEOM_SPHERE
        spec.body(name).add_geom(type=ball, size=[_BALL * size, 0, 0], rgba=_STEEL, contype=0, conaffinity=0)
    for rod in tree.rods:
        colour = _STEEL if rod.joint is None else _PAINT
        tendon = spec.add_tendon(name=rod.name, width=_ROD * size, rgba=colour)
        for end in rod.ends:
            tendon.wrap_site(sites[tree.frames[end].name])
        spec.add_equality(name=rod.name, type=mujoco.mjtEq.mjEQ_TENDON, name1=rod.name)
    for pin in tree.pins:
        first, second = (sites[tree.frames[end].name] for end in pin.ends)
        kind, joined = mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtObj.mjOBJ_SITE
        spec.add_equality(name=pin.name, type=kind, objtype=joined, name1=first, name2=second)
    at_rest = compiled(Path(mechanism.name), spec).tendon_length0
    for rod, length, now in zip(tree.rods, dimensions.lengths, at_rest, strict=True):
        reading = 0.0 if rod.joint is None else dimensions.scale[rod.joint] * mechanism.home[rod.joint]
        spec.equality(rod.name).data[0] = length + reading - now


def _dress(spec: mujoco.MjSpec, mechanism: Mechanism, bodies: list[_Body], size: float) -> None:
    """Stretches from the origin of each body to those that stand on it; slides are drawn as rods in sleeves."""
    driven = {BASE_BODY: 0} | {body.name: body.driven for body in bodies}
    for body in bodies:
        place = body.T_on_body[:3, 3]
        if body.moved is not None and not body.moved.is_turn:
            if (joint := body.moved.joint) is None:
                continue
            axis, low, high = _axis(mechanism, body.moved), mechanism.lower[joint], mechanism.upper[joint]
            place = place + (low - body.at) * (body.T_on_body[:3, :3] @ axis)
            _add_stretch(spec.body(body.name), (low - high) * axis, np.zeros(3), _PLATE * size, body.driven)
        thick = _ARM if driven[body.on] else _PLATE
        _add_stretch(spec.body(body.on), np.zeros(3), place, thick * size, driven[body.on])


def _stand(spec: mujoco.MjSpec, bodies: list[_Body], height_m: float, size: float, hangs: bool) -> None:
    """A floor, and what holds the base above it: a column, or a plate if the mechanism hangs."""
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05])
    if height_m > 0:
        wide = max(float(np.hypot(*body.T_on_body[:2, 3])) for body in bodies if body.on == BASE_BODY)
        low, high, radius = (-_PLATE, _PLATE, wide) if hangs else (-height_m / size, 0.0, 3 * _ARM * size)
        start, end = size * np.array([[0.0, 0.0, low], [0.0, 0.0, high]])
        _add_stretch(spec.body(BASE_BODY), start, end, radius, 0, mujoco.mjtGeom.mjGEOM_CYLINDER)


def _add_stretch(
    body: mujoco.MjsBody,
    start: Array,
    end: Array,
    radius: float,
    driven: int,
    kind: mujoco.mjtGeom = mujoco.mjtGeom.mjGEOM_CAPSULE,
) -> None:
    """What is seen, and weighs, but touches nothing."""
    if np.linalg.norm(end - start) > _SHORT_M:
        body.add_geom(
            type=kind,
            size=[radius, 0, 0],
            fromto=np.append(start, end),
            density=DENSITY,
            rgba=_PAINT if driven % 2 else _STEEL,
            contype=0,
            conaffinity=0,
        )
