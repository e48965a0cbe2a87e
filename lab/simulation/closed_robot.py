"""Model robots with loops in MuJoCo: nominal, with dimensions in error, and identified.

A mechanism has a body for each frame, joints for its steps that move, and tendons for rods. The model rests (``qpos0``)
in the nominal position: joints at home, passive values nominal. MuJoCo computes the length of a tendon there whenever
it compiles; the tendon's equality adds the rest of the rod, so that a file of the model is complete. Shapes collide
with nothing: they are for display.

``closed_qpos`` solves the configuration by Newton's method on MuJoCo's own constraints, which shares no code with
``kinematics.closed``. The rows of ``mjData.efc_pos`` are the gaps: a tendon's length less the rod's (m), or, of a pin,
one end less the other along the world's axes, which are the base's; ``efc_J`` are their derivatives by ``qvel``. Both
are made by ``mj_makeConstraint`` after kinematics, ``mj_comPos`` and ``mj_tendon``; limits and friction would add rows.
"""

import copy
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.formats.description import DescriptionFormat
from lab.formats.mechanism_toml import MechanismFile
from lab.kinematics.closed.closed_arm import ClosedArm
from lab.kinematics.closed.loop_closure import (
    BASE,
    CONTRACTED,
    FIRST_STEP,
    LEAST_STEP,
    MOST_CORRECTIONS,
    ROUNDING_M,
    Configuration,
    Dimensions,
    Step,
)
from lab.kinematics.closed.mechanism import Mechanism
from lab.simulation.build_serial import DENSITY, PAINT, STEEL
from lab.simulation.effects import TrueEffects
from lab.simulation.load_model import set_vectors, write_in_full
from lab.simulation.robot_model import (
    TRACKER,
    RobotModel,
    add_targets,
    add_tracker,
    allow_massless,
    at_pose,
    compiled,
    coordinates,
    named_tool,
    update_constants,
)
from lab.simulation.sampler import NORMAL, Sampler
from lab.simulation.true_robot import TrueRobot, put_before_tracker

__all__ = [
    "CLOSED_MJCF",
    "ClosedModel",
    "TrueMechanism",
    "closed_mjcf",
    "closed_model",
    "closed_qpos",
    "closed_spec",
    "random_values",
    "true_mechanism",
]

_BASE_BODY = "base"
_SAMPLES = 1000  # random poses
_ARM, _PLATE, _BALL, _ROD, _SPOKE = 0.02, 0.012, 0.014, 0.007, 0.004  # radii beside the mechanism's size
_SHORT_M = 1e-3  # a shorter stretch is not drawn
_SETTLED_M = 1e-9  # after a correction of less, the next would be below rounding, as they shrink quadratically
_FAR_RAD = 0.5  # a correction of an angle by more may wind up, or reach another mode
_ADDS_ROWS = mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ClosedModel(RobotModel):
    """The nominal model of a mechanism.

    Attributes:
        height_m: of its base above the floor; None where there is none.
    """

    travel_is_bounded: ClassVar[bool] = False

    chain: Mechanism
    height_m: float | None

    def qpos(self, joints: Array) -> Array:
        """Return MuJoCo's coordinates ``(n, nq)``, passive joints from the nominal model's loops."""
        closed = self.chain.assembled(joints, self.chain.nominal_values)
        return _passive_coordinates(
            self.model, self.chain, joints, np.where(closed.fits, closed.configuration.passive, np.nan)
        )

    def travel_per_joint(self) -> Array:
        """Return the largest motion of a target per joint (m per m or rad), over many random poses."""
        arm = ClosedArm(self.chain, tuple(self.tool))
        joints = arm.structure_joints(_SAMPLES, rng_for(0, "structure"))
        moved = arm.joint_derivatives(arm.observe(joints, arm.nominal(self.tool))[1])
        return np.asarray(np.linalg.norm(moved, axis=2).max(axis=(0, 1)))

    def with_parameters(self, targets: tuple[str, ...], values: Array, joints: Array) -> tuple[mujoco.MjModel, Array]:
        """Return a mechanism with these parameters, its loops closed at the joint positions."""
        passive = self.chain.assembled(joints, values).configuration.passive
        model = self.with_values(values, {}).compile()
        return model, _passive_coordinates(model, self.chain, joints, passive)

    def with_values(self, values: Array, tool: Mapping[str, Array]) -> mujoco.MjSpec:
        """Return a copy with the mechanism's parameters ``(p,)`` and these targets (m, on the platform)."""
        return closed_spec(self.chain, values, tool, self.height_m)


def closed_model(path: Path, described: MechanismFile) -> ClosedModel:
    """Build the model of a described mechanism."""
    mechanism = described.mechanism
    tool = named_tool(described.tool)
    spec = closed_spec(mechanism, mechanism.nominal_values, tool, described.height_m)
    return ClosedModel(
        path=path,
        spec=spec,
        model=compiled(path, spec),
        chain=mechanism,
        T_world_frame0=se3.pose(np.eye(3), np.array([0.0, 0.0, described.height_m or 0.0])),
        base_body=_BASE_BODY,
        tool=tool,
        height_m=described.height_m,
    )


def _identified_mjcf(robot: ClosedModel, arm: ClosedArm, values: Array) -> str:
    """Return the identified mechanism as MJCF; with loops closed, its sites are the identified ones."""
    spec = robot.with_values(values, arm.tool_positions(values))
    model = compiled(robot.path, spec)
    robot.place_tracker(model, robot.T_world_frame0 @ se3.inverse(arm.T_tracker_frame0(values)))
    carrier = spec.site(TRACKER).parent
    placed = model.body(carrier.name)
    carrier.pos, carrier.quat = placed.pos, placed.quat
    return closed_mjcf(spec)


CLOSED_MJCF: DescriptionFormat[ClosedArm, ClosedModel] = DescriptionFormat(
    "calibrated.xml", lambda identified: _identified_mjcf(identified.model, identified.arm, identified.values)
)


def _passive_coordinates(model: mujoco.MjModel, mechanism: Mechanism, joints: Array, passive: Array) -> Array:
    """Return MuJoCo's coordinates ``(n, nq)`` at joint positions ``(n, joints)`` and passive values ``(z, n)``."""
    legs = [f"{rod.name}.length" for rod in mechanism.tree.rods]
    moving = [i for i in range(len(mechanism.joint_names)) if mechanism.offset_of(i) not in legs]
    names = [mechanism.joint_names[i] for i in moving]
    names += [mechanism.tree.name_of(f, s) for f, s in mechanism.tree.passive]
    return coordinates(model, names, np.concatenate([joints[:, moving], passive.T], axis=1))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TrueMechanism(TrueRobot):
    """A mechanism with errors of its dimensions.

    Attributes:
        values: ``(p,)`` of ``Mechanism.names``; the base has its nominal pose in the world.
    """

    robot: ClosedModel
    values: Array

    def truth(self, targets: tuple[str, ...]) -> None:
        """Return None: dimensions of a mechanism are not read off its joint axes."""

    def with_effects(self, effects: TrueEffects) -> Self:
        """Return this robot with these effects alone; it is rigid.

        Raises:
            LabError: the effects bend its links, or are for other joints.
        """
        if effects.is_elastic:
            raise LabError(f"robot {self.robot.chain.name} has loops, and nothing bends such a robot here")
        return super().with_effects(effects)

    def _qpos(self, driven: Array) -> Array:
        """Solve MuJoCo's constraints from nominal passive values; a jump to another mode is NaN."""
        chain = self.robot.chain
        start = chain.assembled(driven, chain.nominal_values).configuration.passive
        coordinates_of = np.full((len(driven), self.model.nq), np.nan)
        near = np.isfinite(start).all(axis=0)
        qpos, jumped = closed_qpos(self.model, chain, self.values, driven[near], start[:, near])
        coordinates_of[near] = np.where(jumped[:, None], np.nan, qpos)
        return coordinates_of


def true_mechanism(robot: ClosedModel, values: Array, T_world_tracker: Array) -> TrueMechanism:
    """Return the robot with other dimensions, before a tracker."""
    model = robot.with_values(values, robot.tool).compile()
    put_before_tracker(model, robot, T_world_tracker)
    return TrueMechanism(
        robot=robot,
        model=model,
        T_world_tracker=T_world_tracker,
        values=values,
        effects=TrueEffects.none(robot.chain.size),
    )


def random_values(
    mechanism: Mechanism,
    position_sigma_m: float,
    rotation_sigma_rad: float,
    rng: np.random.Generator,
    sampler: Sampler = NORMAL,
) -> Array:
    """Draw parameters ``(p,)`` with errors of these standard deviations, the base at its nominal pose."""
    turns = [tree_step.is_turn for tree_step in (mechanism.tree.step(f, s) for f, s in mechanism.tree.constants)]
    sigma = np.array([rotation_sigma_rad if turn else position_sigma_m for turn in turns])
    sigma = np.concatenate([np.zeros(6), sigma, np.full(len(mechanism.tree.lengths), position_sigma_m)])
    off: Array = mechanism.nominal_values + sigma * sampler.draw(rng, (len(sigma),))
    return off


def closed_spec(
    mechanism: Mechanism, values: Array, tool: Mapping[str, Array], height_m: float | None
) -> mujoco.MjSpec:
    """Build the mechanism of parameters ``(p,)``, its base upright at this height; in the air without one.

    A measured joint has the robot's name for it, and its ``qpos`` is its position; a passive one is named
    ``<frame>.<step>``. A leg whose length is a joint position has no joint: its equality is set pose by pose
    (``closed_qpos``), and rests at home. Tendons and equalities have the names of rods and pins. A pin is three
    equations, whatever its axes: in a planar mechanism the third is 0 = 0.

    Args:
        values: in the order of ``mechanism.names``, and others after them; ``base.*`` is not used.
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
    allow_massless(spec)
    spec.worldbody.add_body(name=_BASE_BODY, pos=[0.0, 0.0, height_m or 0.0])
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
        _add_support(spec, bodies, height_m, size, hangs=bool(rest.frames[tree.platform][1][2, 0] < 0))
    _close(spec, mechanism, dimensions, size)
    return spec


def closed_mjcf(spec: mujoco.MjSpec) -> str:
    """Return the spec as MJCF with positions exact to rounding: MuJoCo writes six digits."""
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
        on: the name of its parent.
        T_on_body: pose ``(4, 4)`` at rest.
        moved: the step that moves it; None if fixed.
        joint: the name of the joint there.
        at: ``qpos`` of the joint at rest (m, rad).
        driven: number of measured joints below it.
    """

    name: str
    on: str
    T_on_body: Array
    moved: Step | None
    joint: str
    at: float
    driven: int


def _rest(mechanism: Mechanism) -> Configuration:
    """Return the nominal configuration, with its loops closed, if it has any."""
    if mechanism.tree.passive:
        return mechanism.assembled(mechanism.home[None], mechanism.nominal_values).configuration
    return Configuration.of(
        mechanism.tree, mechanism.dimensions(mechanism.nominal_values), mechanism.home[None], np.empty((0, 1))
    )


def _bodies(mechanism: Mechanism, dimensions: Dimensions, passive: Array) -> list[_Body]:
    tree, bodies, driven = mechanism.tree, [], {_BASE_BODY: 0}
    for f, frame in enumerate(tree.frames):
        on = _BASE_BODY if frame.on == BASE else tree.frames[frame.on].name
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
    parts: list[list[int]] = [[]]
    for s in range(len(path)):
        if s and (path[s - 1].passive or path[s - 1].joint is not None):
            parts.append([])
        parts[-1].append(s)
    return parts


def _elementary(step: Step, value: float) -> Array:
    vector = value * np.eye(3)[step.axis]
    return se3.pose(se3.exp(vector), np.zeros(3)) if step.is_turn else se3.pose(np.eye(3), vector)


def _add_body(spec: mujoco.MjSpec, mechanism: Mechanism, body: _Body) -> None:
    added = spec.body(body.on).add_body(name=body.name, **at_pose(body.T_on_body))
    if body.moved is None:
        return
    kind = mujoco.mjtJoint.mjJNT_HINGE if body.moved.is_turn else mujoco.mjtJoint.mjJNT_SLIDE
    joint = added.add_joint(name=body.joint, type=kind, axis=_axis(mechanism, body.moved), ref=body.at)
    if (i := body.moved.joint) is not None:
        joint.range = [mechanism.lower[i], mechanism.upper[i]]


def _axis(mechanism: Mechanism, step: Step) -> Array:
    """Return the axis along or about which a step moves as its ``qpos`` grows."""
    axis: Array = np.eye(3)[step.axis] * (1.0 if step.joint is None else mechanism.sign[step.joint])
    return axis


def _close(spec: mujoco.MjSpec, mechanism: Mechanism, dimensions: Dimensions, size: float) -> None:
    """Add rods and pins, between sites at the origins of the frames that they join, with balls there."""
    tree = mechanism.tree
    sites = _add_ends(spec, mechanism, size)
    # Rods are tendons, pins connect two sites.
    for rod in tree.rods:
        colour = STEEL if rod.joint is None else PAINT
        tendon = spec.add_tendon(name=rod.name, width=_ROD * size, rgba=colour)
        for end in rod.ends:
            tendon.wrap_site(sites[end])
        spec.add_equality(name=rod.name, type=mujoco.mjtEq.mjEQ_TENDON, name1=rod.name)
    for pin in tree.pins:
        first, second = (sites[end] for end in pin.ends)
        kind, joined = mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtObj.mjOBJ_SITE
        spec.add_equality(name=pin.name, type=kind, objtype=joined, name1=first, name2=second)
    # The lengths of the rods, beside those of the tendons at rest.
    at_rest = compiled(Path(mechanism.name), spec).tendon_length0
    for rod, length, now in zip(tree.rods, dimensions.lengths, at_rest, strict=True):
        reading = 0.0 if rod.joint is None else dimensions.scale[rod.joint] * mechanism.home[rod.joint]
        spec.equality(rod.name).data[0] = length + reading - now


def _add_ends(spec: mujoco.MjSpec, mechanism: Mechanism, size: float) -> dict[int, str]:
    """Add sites and balls at the frames that rods and pins join; return the sites' names by frame."""
    tree, sites = mechanism.tree, dict[int, str]()
    joined = [*(rod.ends for rod in tree.rods), *(pin.ends for pin in tree.pins)]
    for end in dict.fromkeys(end for ends in joined for end in ends):
        name, ball = tree.frames[end].name, mujoco.mjtGeom.mjGEOM_SPHERE
        sites[end] = f"{name}.origin"
        spec.body(name).add_site(name=sites[end])
        spec.body(name).add_geom(type=ball, size=[_BALL * size, 0, 0], rgba=STEEL, contype=0, conaffinity=0)
    return sites


def _dress(spec: mujoco.MjSpec, mechanism: Mechanism, bodies: list[_Body], size: float) -> None:
    """Add stretches from the origin of each body to those on it; slides are rods in sleeves."""
    driven = {_BASE_BODY: 0} | {body.name: body.driven for body in bodies}
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


def _add_support(spec: mujoco.MjSpec, bodies: list[_Body], height_m: float, size: float, hangs: bool) -> None:
    """Add a floor, and a column under the base, or a plate if the mechanism hangs."""
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05])
    if height_m > 0:
        wide = max(float(np.hypot(*body.T_on_body[:2, 3])) for body in bodies if body.on == _BASE_BODY)
        low, high, radius = (-_PLATE, _PLATE, wide) if hangs else (-height_m / size, 0.0, 3 * _ARM * size)
        start, end = size * np.array([[0.0, 0.0, low], [0.0, 0.0, high]])
        _add_stretch(spec.body(_BASE_BODY), start, end, radius, 0, mujoco.mjtGeom.mjGEOM_CYLINDER)


def _add_stretch(
    body: mujoco.MjsBody,
    start: Array,
    end: Array,
    radius: float,
    driven: int,
    kind: mujoco.mjtGeom = mujoco.mjtGeom.mjGEOM_CAPSULE,
) -> None:
    """Add a stretch that is visible and has mass, but touches nothing."""
    if np.linalg.norm(end - start) > _SHORT_M:
        body.add_geom(
            type=kind,
            size=[radius, 0, 0],
            fromto=np.append(start, end),
            density=DENSITY,
            rgba=PAINT if driven % 2 else STEEL,
            contype=0,
            conaffinity=0,
        )


def closed_qpos(
    model: mujoco.MjModel, mechanism: Mechanism, values: Array, joints: Array, passive: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Solve the configurations of a ``closed_spec`` model at joints ``(n, joints)``, from passive values ``(z, n)``.

    The assembly mode is that of the start. Newton's method keeps to it if no turn changes by
    more than ``_FAR_RAD``, later corrections are at most a quarter of the first (Deuflhard 2004, section 5.1; as in
    ``assembly``), and the determinant of the closures' derivatives keeps its sign. Otherwise the gaps of the
    start are closed in smaller steps; a path that ends is a jump to another mode.

    Args:
        values: parameters ``(p,)`` of the model; lengths of rods are taken from here, pose by pose.

    Returns:
        ``qpos (n, nq)``; and ``(n,)`` where it is NaN: the loops do not close, or perhaps in another mode alone.
    """
    loops = _Loops(_quiet(model), mechanism, mechanism.dimensions(values))
    qpos = np.full((len(joints), model.nq), np.nan)
    with np.errstate(all="ignore"):  # a diverging iteration may overflow
        for i, (row, start) in enumerate(zip(joints, passive.T, strict=True)):
            if (settled := loops.settled(row, start)) is not None:
                qpos[i] = settled
    return qpos, np.asarray(np.isnan(qpos).any(axis=1))


def _quiet(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy with equality constraints alone, dense derivatives, and rest lengths of the present bodies."""
    model = copy.deepcopy(model)
    model.opt.disableflags |= _ADDS_ROWS
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    update_constants(model)
    return model


@dataclass(frozen=True)
class _Loops:
    """Closure equations of a model for its passive values, at one pose after another."""

    model: mujoco.MjModel
    mechanism: Mechanism
    dimensions: Dimensions

    @cached_property
    def data(self) -> mujoco.MjData:
        """MuJoCo data of the model, reused for all rows."""
        return mujoco.MjData(self.model)

    @cached_property
    def measured(self) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """Indices of the measured joints, and their addresses in ``qpos``."""
        steps = [step.joint for frame in self.mechanism.tree.frames for step in frame.path if step.joint is not None]
        addresses = [int(self.model.joint(self.mechanism.joint_names[i]).qposadr[0]) for i in steps]
        return np.array(steps, dtype=int), np.array(addresses, dtype=int)

    @cached_property
    def passive(self) -> NDArray[np.int_]:
        """Indices of the passive values in ``qpos``, and in ``qvel``: hinges and slides have one number in each."""
        names = [self.mechanism.tree.name_of(f, s) for f, s in self.mechanism.tree.passive]
        return np.array([int(self.model.joint(name).qposadr[0]) for name in names], dtype=int)

    @cached_property
    def rotational(self) -> NDArray[np.bool_]:
        """Mask of the passive values that are angles."""
        tree = self.mechanism.tree
        return np.array([tree.step(f, s).is_turn for f, s in tree.passive])

    @cached_property
    def rods(self) -> tuple[NDArray[np.int_], Array, Array]:
        """Rods' equalities, what they add to a tendon at rest (m), and per joint position ``(rods, joints)``."""
        rods = self.mechanism.tree.rods
        at_rest = self.model.tendon_length0[[self.model.tendon(rod.name).id for rod in rods]]
        by_joint = np.zeros((len(rods), self.mechanism.size))
        for i, rod in enumerate(rods):
            if rod.joint is not None:
                by_joint[i, rod.joint] = self.dimensions.scale[rod.joint]
        equalities = np.array([self.model.equality(rod.name).id for rod in rods], dtype=int)
        return equalities, self.dimensions.lengths - at_rest, by_joint

    @cached_property
    def rows(self) -> NDArray[np.int_]:
        """Rows of the closing constraints: one of a rod, of a pin those along its axes. Equalities come first."""
        kinds = self.model.eq_type
        sizes = np.where(kinds == mujoco.mjtEq.mjEQ_CONNECT, 3, 1)
        first = np.cumsum(sizes) - sizes
        tree = self.mechanism.tree
        rods = [first[self.model.equality(rod.name).id] for rod in tree.rods]
        pins = [first[self.model.equality(pin.name).id] + axis for pin in tree.pins for axis in pin.axes]
        return np.array([*rods, *pins], dtype=int)

    @cached_property
    def entries(self) -> NDArray[np.int_]:
        """Indices in ``efc_J`` of the derivatives by the passive values, ``(z, z)``."""
        return np.asarray(self.rows[:, None] * self.model.nv + self.passive)

    def settled(self, row: Array, start: Array) -> Array | None:
        """Solve ``qpos`` at one row ``(joints,)``, from passive values ``(z,)``; None if no path leads there."""
        which, addresses = self.measured
        equalities, added, by_joint = self.rods
        self.data.qpos[addresses] = row[which]
        self.model.eq_data[equalities, 0] = added + by_joint @ row
        if len(start):
            passive = self._corrected(start, np.zeros(len(start)))
            passive = self._followed(start) if passive is None else passive
            if passive is None:
                return None
            self.data.qpos[self.passive] = passive
        return np.array(self.data.qpos)

    def _followed(self, start: Array) -> Array | None:
        """Solve the passive values by closing the gaps of others little by little; None if that is impossible."""
        gaps = self._closures(start)[0]
        passive, left, step = start, 1.0, FIRST_STEP
        while left > 0:
            corrected = self._corrected(passive, max(left - step, 0.0) * gaps)
            if corrected is not None:
                passive, left, step = corrected, max(left - step, 0.0), 2 * step
            elif (step := step / 2) < LEAST_STEP:
                return None
        return passive

    def _corrected(self, passive: Array, left: Array) -> Array | None:
        """Solve by Newton's method to gaps ``left`` (m); None if it may leave its path.

        It ends at a step that is not much shorter than the first, and at a change of the assembly mode.
        """
        side = allowed = 0.0
        for correction in range(MOST_CORRECTIONS):
            gaps, matrix = self._closures(passive)
            try:
                moved = np.linalg.solve(matrix, gaps - left)
            except np.linalg.LinAlgError:
                return None
            size = float(np.linalg.norm(self.mechanism.levers * moved))
            if correction == 0:
                if np.abs(moved[self.rotational]).max(initial=0.0) > _FAR_RAD:
                    return None
                side, allowed = float(np.linalg.det(matrix)), max(CONTRACTED * size, ROUNDING_M)
            elif not size <= allowed:  # nor if that is not a number
                return None
            passive = passive - moved
            if size < _SETTLED_M:
                return passive if side * np.linalg.det(matrix) > 0 else None
        return None

    def _closures(self, passive: Array) -> tuple[Array, Array]:
        """Compute the gaps of the loops ``(z,)`` (m), and their derivatives ``(z, z)`` by the passive values."""
        self.data.qpos[self.passive] = passive
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_tendon(self.model, self.data)
        mujoco.mj_makeConstraint(self.model, self.data)
        return self.data.efc_pos[self.rows], self.data.efc_J[self.entries]
