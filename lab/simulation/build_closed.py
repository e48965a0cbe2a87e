"""A mechanism with loops as MuJoCo has it: a body for each frame, joints for what moves, tendons for rods.

The model rests (``qpos0``) in the nominal position: joints at home, passive values nominal. MuJoCo computes
the length of a tendon there whenever it compiles; the tendon's equality adds what the rod is longer, so that a file
of the model stands alone. Shapes collide with nothing: they are there to be looked at.

Where a closed model stands: Newton's method on MuJoCo's own constraints, which shares no line with ours.

The rows of ``mjData.efc_pos`` are what closes: a tendon's length less the rod's (m), or, of a pin, one end less the
other along the world's axes, which are the base's; ``efc_J`` are their derivatives by ``qvel``. Both are made by
``mj_makeConstraint`` after kinematics, ``mj_comPos`` and ``mj_tendon``; limits and friction would add rows.
"""

import copy
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
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
from lab.simulation.meshes import DENSITY
from lab.simulation.model import add_targets, add_tracker, compiled, let_weigh_nothing, update_constants
from lab.simulation.model_files import set_vectors, write_in_full

__all__ = ["BASE_BODY", "closed_mjcf", "closed_qpos", "closed_spec"]

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
        _add_support(spec, bodies, height_m, size, hangs=bool(rest.frames[tree.platform][1][2, 0] < 0))
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
    """Return all bodies, each after its carrier, at passive values ``(z,)`` at rest."""
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


def _add_support(spec: mujoco.MjSpec, bodies: list[_Body], height_m: float, size: float, hangs: bool) -> None:
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
    """Add a stretch that is visible and has mass, but touches nothing."""
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


_SETTLED_M = 1e-9  # after a correction of less, the next would be below rounding, as they shrink quadratically
_FAR_RAD = 0.5  # turns that a correction changes by more may be wound up, or be past another mode
_ADDS_ROWS = mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS


def closed_qpos(
    model: mujoco.MjModel, mechanism: Mechanism, values: Array, joints: Array, passive: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Solve the configurations of a ``closed_spec`` model at joints ``(n, joints)``, from passive values ``(z, n)``.

    The assembly mode is that of the start. Newton's method keeps to it where no turn changes by
    more than ``_FAR_RAD``, later corrections are at most a quarter of the first (Deuflhard 2004, section 5.1; as in
    ``assembly``), and the determinant of the closures' derivatives keeps its sign. Where it may not, the gaps of the
    start are closed little by little, by steps in which it does; a way that ends is a jump.

    Args:
        values: parameters ``(p,)`` of the model; lengths of rods are taken from here, pose by pose.

    Returns:
        ``qpos (n, nq)``; and ``(n,)`` where it is NaN: the loops do not close, or perhaps in another mode alone.
    """
    loops = _Loops(_quiet(model), mechanism, mechanism.dimensions(values))
    qpos = np.full((len(joints), model.nq), np.nan)
    with np.errstate(all="ignore"):  # on the way to nowhere numbers may grow
        for i, (row, start) in enumerate(zip(joints, passive.T, strict=True)):
            if (found := loops.settled(row, start)) is not None:
                qpos[i] = found
    return qpos, np.asarray(np.isnan(qpos).any(axis=1))


def _quiet(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy that has equalities for constraints, dense derivatives, and lengths at rest of the bodies as they are."""
    model = copy.deepcopy(model)
    model.opt.disableflags |= _ADDS_ROWS
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    update_constants(model)
    return model


@dataclass(frozen=True)
class _Loops:
    """The closures of a model as equations for its passive values, at one pose after another."""

    model: mujoco.MjModel
    mechanism: Mechanism
    dimensions: Dimensions

    @cached_property
    def data(self) -> mujoco.MjData:
        """MuJoCo data of the model, reused for all rows."""
        return mujoco.MjData(self.model)

    @cached_property
    def measured(self) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """Measured joints: which of the robot's, and where in ``qpos``, which is the joint position."""
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
        """Rods' equalities, what those add to a tendon at rest (m), and that per joint position ``(rods, joints)``."""
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
        """The constraints' rows that close: one of a rod, of a pin those along its axes. Equalities come first."""
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
        """The ``qpos`` at one row ``(joints,)``, from passive values ``(z,)``; None where no way leads there."""
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
        """Passive values that close the loops, from others, where the gaps between can be closed little by little."""
        gaps = self._closures(start)[0]
        passive, left, step = start, 1.0, FIRST_STEP
        while left > 0:
            found = self._corrected(passive, max(left - step, 0.0) * gaps)
            if found is not None:
                passive, left, step = found, max(left - step, 0.0), 2 * step
            elif (step := step / 2) < LEAST_STEP:
                return None
        return passive

    def _corrected(self, passive: Array, left: Array) -> Array | None:
        """Newton's method to where the closures are open by ``left`` (m); None where it may not stay on its way.

        The loop is its own: it follows a way, so that a step which is not much shorter than the first ends it, and so
        does a change of the assembly mode.
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
