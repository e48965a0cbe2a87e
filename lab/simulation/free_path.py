"""Check paths between poses, and build the model to plan with, whose shapes keep clearances.

In the model to plan with, reflectors and nests are solid. The arm keeps a clearance from its surroundings, including
the floor, and another one between its own links. MuJoCo reports a contact where two shapes are nearer than their
margin, so a pose without contacts keeps the clearances.
"""

import copy
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, product
from typing import TypeVar

import mujoco
import numpy as np

from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.link_tree import free_name
from lab.noise.instruments import Instrument
from lab.simulation.candidate_poses import LARGE_REFLECTOR_M, SMALL_REFLECTOR_M, view_of
from lab.simulation.collisions import REFLECTOR, contacts_at
from lab.simulation.robot_model import RobotModel, compiled

__all__ = [
    "CLEARANCE_MM",
    "INCIDENCE_MARGIN_RAD",
    "Clearances",
    "path_check",
    "path_step",
    "planning_model",
    "reflector_radii",
]

_STEP_M = 0.001  # along a path no point of the arm moves further than this between two places
_ESTIMATED_STEP_M = 0.010  # of a mechanism, whose points' travel is estimated, and each configuration is checked
_CLEAR_M = 0.040  # shapes that are farther apart than that and their clearance are not measured
_SLACK_M = 1e-4  # of a computed distance
_STILL_M = 1e-12  # two shapes that move less against each other stay as they are
_GOLDEN = (np.sqrt(5) - 1) / 2


def path_check(robot: RobotModel) -> Callable[[Array, Array], bool]:
    """Return a test: whether the arm touches nothing while all joints move in proportion from ``(n,)`` to ``(n,)``.

    Checked configurations are so dense that no point of the arm moves more than ``path_step`` in between. One thread.
    """
    return _Serial(robot) if robot.travel_is_bounded else _PlaceByPlace(robot)


def path_step(robot: RobotModel) -> float:
    """Return the largest motion (m) of a point of the arm between two checked configurations of a path."""
    return _STEP_M if robot.travel_is_bounded else _ESTIMATED_STEP_M


class _PlaceByPlace:
    """Path checks at evenly spaced configurations, for robots whose points' travel is only estimated."""

    def __init__(self, robot: RobotModel) -> None:
        self.robot, self.data, self.reach = robot, mujoco.MjData(robot.model), robot.travel_per_joint()

    def __call__(self, start: Array, end: Array) -> bool:
        """Decide whether the path between two joint positions ``(joints,)`` is free of contact."""
        steps = max(1, int(np.ceil(np.abs(end - start) @ self.reach / path_step(self.robot))))
        qpos = self.robot.qpos(start + np.linspace(0.0, 1.0, steps + 1)[:, None] * (end - start))
        if np.isnan(qpos).any():
            return False
        spread = np.argsort(np.arange(len(qpos)) * _GOLDEN % 1.0)  # so that an obstacle is met early
        return not any(data.ncon for data in contacts_at(self.robot.model, qpos[spread], self.data))


class _Serial:
    """Path checks of a serial arm, with few configurations where shapes are far apart.

    At one configuration the distance of each pair of shapes beyond its clearance is measured. Until the pair has moved
    that far relative to each other, it stays clear: only joints between its two bodies move them, none by more than its
    travel. At small distances the next configuration is at most a step away.
    """

    def __init__(self, robot: RobotModel) -> None:
        self.robot, self.model, self.data = robot, robot.model, mujoco.MjData(robot.model)
        self.widened = copy.deepcopy(robot.model)  # in contact ``_CLEAR_M`` earlier than in the model
        self.widened.pair_margin[:] += _CLEAR_M + _SLACK_M
        self.widened.geom_margin[:] += (_CLEAR_M + _SLACK_M) / 2  # of two shapes, MuJoCo adds the margins
        self.widened.body_margin[:] += (_CLEAR_M + _SLACK_M) / 2
        self.reach, self.step = robot.travel_per_joint(), path_step(robot)
        moved = [int(self.model.joint(name).bodyid[0]) for name in robot.chain.joint_names]
        carried = np.zeros((self.model.nbody, len(moved)), dtype=bool)  # whether a joint moves a body
        for body in range(1, self.model.nbody):  # MuJoCo numbers parents before children
            carried[body] = carried[self.model.body_parentid[body]] | (np.array(moved) == body)
        self.relative = (carried[:, None] ^ carried).astype(float)  # 1 where a joint moves two bodies apart

    def __call__(self, start: Array, end: Array) -> bool:
        """Decide whether the path between two joint positions ``(joints,)`` is free of contact."""
        travel = np.abs(end - start) * self.reach
        total, ends = float(travel.sum()), self.robot.qpos(np.stack([start, end]))
        if any(data.ncon for data in contacts_at(self.model, ends, self.data)):
            return False
        count = int(np.ceil(total / (2 * _CLEAR_M)))
        edges = np.linspace(0.0, 1.0, count + 1)
        # evenly spread from the first check on, so that an obstacle is met early
        order = np.argsort(np.arange(count) * _GOLDEN % 1.0).tolist()
        stretches = deque((float(edges[i]), float(edges[i + 1])) for i in order)
        while stretches:
            begin, end_share = stretches.popleft()
            middle, half = (begin + end_share) / 2, (end_share - begin) / 2
            clear = self._clear_share(ends[0] + middle * (ends[1] - ends[0]), travel, total)
            if clear < 0:
                return False
            if clear < half:
                stretches.extend([(begin, middle - clear), (middle + clear, end_share)])
        return True

    def _clear_share(self, qpos: Array, travel: Array, total: float) -> float:
        """Return the share of the path on either side of ``(nq,)`` that is clear; negative if ``(nq,)`` is not.

        Args:
            travel: ``(joints,)`` largest motion (m) of a point by each joint on all of the path; ``total`` by all.
        """
        data = self.data
        data.qpos[:] = qpos
        mujoco.mj_kinematics(self.widened, data)
        mujoco.mj_collision(self.widened, data)
        if not data.ncon:
            return _CLEAR_M / total
        contact = data.contact
        room = contact.dist - contact.includemargin + (_CLEAR_M + _SLACK_M)
        if room.min() < 0:
            return -1.0
        pairs = self.model.geom_bodyid[contact.geom]
        moving = self.relative[pairs[:, 0], pairs[:, 1]] @ travel + _STILL_M
        return min(float((np.maximum(room - _SLACK_M, self.step / 2) / moving).min()), _CLEAR_M / total)


_Model = TypeVar("_Model", bound=RobotModel)

CLEARANCE_MM = 20.0  # default, from surroundings, and of links that are not neighbours
INCIDENCE_MARGIN_RAD = np.deg2rad(3.0)  # kept from the largest angle that a reflector takes
_MARGIN_SHARE = 0.1  # of that angle: a reflector that takes a few degrees keeps most of them
_NEST = 4 / 3  # of the ball's radius: from its centre to the base of its nest
_CLEARANCE_SLACK_M = 1e-5  # of a computed distance
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))  # of a box of two metres
_INVISIBLE = (0.0, 0.0, 0.0, 0.0)  # no ray meets a shape that is transparent


@dataclass(frozen=True)
class Clearances:
    """Clearances of a plan.

    Attributes:
        surroundings_m: between the arm and its surroundings, unless the cell states another.
        own_m: between links of the arm that are not neighbours, at most that at its nominal poses.
    """

    surroundings_m: float = MM.to_si(CLEARANCE_MM)
    own_m: float = MM.to_si(CLEARANCE_MM)


def reflector_radii(robot: RobotModel, targets: Sequence[str], instrument: Instrument) -> Array:
    """Return radius ``(k,)`` (m) of the ball at each target: of its site, else the usual one of the instrument.

    A site smaller than a half-inch reflector states nothing. Trackers measure 1.5-inch reflectors unless the robot or
    its cell states others; targets of cameras and of ideal instruments are taken for half an inch.
    """
    usual = LARGE_REFLECTOR_M if instrument.kind == "spherical" else SMALL_REFLECTOR_M
    stated = np.array([float(robot.model.site(name).size[0]) for name in targets])
    return np.where(stated < SMALL_REFLECTOR_M - 1e-9, usual, np.minimum(stated, LARGE_REFLECTOR_M))


def planning_model(robot: _Model, targets: Sequence[str], instrument: Instrument, clearances: Clearances) -> _Model:
    """Return a copy of a robot's model whose contacts are those that a plan avoids.

    Each target is a ball in its nest, and two shapes touch as soon as they are within their clearance, and half of a
    path check's step more. An obstacle's or the cell's own clearance comes first. Neighbouring links keep none; other
    links, and the first link from the surroundings, keep at most that at the nominal poses: home, joint
    positions of zero, and the keyframes of the robot's file. Reflectors take a smaller angle, by
    ``INCIDENCE_MARGIN_RAD``.

    Raises:
        LabError: MuJoCo cannot build the model.
    """
    spec = robot.spec.copy()
    _add_reflectors(robot, spec, targets, reflector_radii(robot, targets, instrument))
    _name_shapes(spec)
    _mesh_boxes(spec)
    bare = compiled(robot.path, spec)
    shapes = _SolidShapes.of(bare, robot.base_body)
    stated = [name for name, clearance_m in robot.obstacles.items() if clearance_m is not None]
    # Surroundings keep their own clearance, or that of the plan.
    around_m, own_m = (_required_clearance(robot, each) for each in (clearances.surroundings_m, clearances.own_m))
    for geom in shapes.around:
        name, margin = bare.geom(geom).name, _required_clearance(robot, float(bare.geom_margin[geom]))
        spec.geom(name).margin = margin if name in stated else max(margin, around_m)
    # Pairs of links, and of the first link and its surroundings, keep no more than at the nominal poses.
    own, first = shapes.own_pairs(), shapes.first_link_pairs(stated)
    _add_pairs(spec, robot, shapes, [*own, *first], np.array([own_m] * len(own) + [around_m] * len(first)))
    # Reflectors take a smaller angle.
    acceptance = view_of(robot, instrument).acceptance_rad
    narrower = acceptance - min(INCIDENCE_MARGIN_RAD, _MARGIN_SHARE * acceptance)
    model = compiled(robot.path, spec)
    model.opt.disableflags |= robot.model.opt.disableflags  # of a robot that is not checked, which its spec lacks
    return replace(
        robot,
        spec=spec,
        model=model,
        acceptance_rad=robot.acceptance_rad if acceptance >= np.pi else narrower,
    )


def _add_pairs(
    spec: mujoco.MjSpec, robot: RobotModel, shapes: "_SolidShapes", pairs: Sequence[tuple[int, int]], wanted: Array
) -> None:
    """Let pairs of shapes keep ``wanted`` clearances (m), or their least distance at the nominal poses."""
    bare = shapes.model
    nearest = _least_distances(replace(robot, model=bare), pairs, wanted)
    for pair, least, margin in zip(pairs, nearest, wanted, strict=True):
        if least <= 0 and shapes.reflectors & set(pair):
            one, other = (bare.body(int(bare.geom_bodyid[each])).name for each in pair)
            spec.add_exclude(bodyname1=one, bodyname2=other)  # a ball inside a link's assumed shape
            continue
        one, other = (bare.geom(each).name for each in pair)
        spec.add_pair(geomname1=one, geomname2=other, margin=max(0.0, min(margin, least - _CLEARANCE_SLACK_M)))


def _required_clearance(robot: RobotModel, clearance_m: float) -> float:
    """Return a clearance plus half a path check's step; zero stays zero."""
    return clearance_m + path_step(robot) / 2 if clearance_m else 0.0


def _add_reflectors(robot: RobotModel, spec: mujoco.MjSpec, targets: Sequence[str], radii: Array) -> None:
    taken = {body.name for body in spec.bodies}
    for target, radius in zip(targets, radii.tolist(), strict=True):
        site = robot.model.site(target)
        name = free_name(f"{REFLECTOR}{target}", taken)
        body = spec.site(target).parent.add_body(name=name, pos=site.pos, quat=site.quat)
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], rgba=_INVISIBLE, mass=0)
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[radius, _NEST * radius / 2, 0],
            pos=[0, 0, -_NEST * radius / 2],
            rgba=_INVISIBLE,
            mass=0,
        )


def _name_shapes(spec: mujoco.MjSpec) -> None:
    geoms = list(spec.geoms)
    taken = {geom.name for geom in geoms}
    for i, geom in enumerate(geoms):
        if not geom.name:
            world = geom.parent.name == "world"
            wanted = f"shape {i} of the surroundings" if world else f"{geom.parent.name} shape {i}"
            geom.name = free_name(wanted, taken)
            taken.add(geom.name)


def _mesh_boxes(spec: mujoco.MjSpec) -> None:
    """Make the solid boxes of bodies meshes: MuJoCo overlooks some pairs of boxes that are near but do not touch."""
    for geom in spec.geoms:
        box = geom.type == mujoco.mjtGeom.mjGEOM_BOX and not np.isfinite(geom.fromto[0])
        if box and geom.parent.name != "world" and (geom.contype or geom.conaffinity):
            mesh = f"{geom.name} of its corners"
            spec.add_mesh(name=mesh, uservert=(_CORNERS * geom.size).ravel())
            geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, mesh


@dataclass(frozen=True)
class _SolidShapes:
    """The solid shapes of a model: those of the arm, those around it, and those of reflectors, by number."""

    model: mujoco.MjModel
    arm: tuple[int, ...]
    around: tuple[int, ...]
    reflectors: frozenset[int]

    @classmethod
    def of(cls, model: mujoco.MjModel, base_body: str) -> "_SolidShapes":
        """Return the shapes of a model; the arm is all moving bodies, and its base with all on it."""
        base = model.body(base_body).id if base_body else -1
        on_base = np.zeros(model.nbody, dtype=bool)
        for body in range(1, model.nbody):  # MuJoCo numbers parents before children
            on_base[body] = body == base or on_base[model.body_parentid[body]]
        is_arm = (model.body_weldid > 0) | on_base
        arm, around, reflectors = list[int](), list[int](), set[int]()
        for geom in np.flatnonzero(model.geom_contype | model.geom_conaffinity).tolist():
            body = int(model.geom_bodyid[geom])
            (arm if is_arm[body] else around).append(geom)
            if model.body(body).name.startswith(REFLECTOR):
                reflectors.add(geom)
        return cls(model, tuple(arm), tuple(around), frozenset(reflectors))

    def own_pairs(self) -> list[tuple[int, int]]:
        """Return pairs of the arm's shapes that are not of neighbours; a reflector's only neighbour is its carrier."""
        return [
            pair
            for pair in combinations(self.arm, 2)
            if self._may_meet(*pair) and (not self._neighbours(*pair) or self.reflectors & set(pair))
        ]

    def first_link_pairs(self, stated: Sequence[str]) -> list[tuple[int, int]]:
        """Return pairs of the first links and the surroundings without a clearance of their own."""
        weld, parent, of = self.model.body_weldid, self.model.body_parentid, self.model.geom_bodyid
        first = [geom for geom in self.arm if weld[of[geom]] and weld[parent[weld[of[geom]]]] == 0]
        return [
            (one, other)
            for one in first
            for other in self.around
            if self._may_meet(one, other) and self.model.geom(other).name not in stated
        ]

    def _may_meet(self, one: int, other: int) -> bool:
        """Decide whether two shapes move relative to each other, are both solid, and are not excluded from contact."""
        model, bodies = self.model, [int(self.model.geom_bodyid[each]) for each in (one, other)]
        solid = (
            model.geom_contype[one] & model.geom_conaffinity[other]
            or model.geom_contype[other] & model.geom_conaffinity[one]
        )
        if not solid or model.body_weldid[bodies[0]] == model.body_weldid[bodies[1]]:
            return False
        return (min(bodies) << 16) + max(bodies) not in self._excluded

    @cached_property
    def _excluded(self) -> frozenset[int]:
        signatures = np.asarray(self.model.exclude_signature, dtype=np.int64)
        pairs = [(int(each) >> 16, int(each) & 0xFFFF) for each in signatures]
        return frozenset((min(pair) << 16) + max(pair) for pair in pairs)

    def _neighbours(self, one: int, other: int) -> bool:
        weld, parent = self.model.body_weldid, self.model.body_parentid
        a, b = (int(weld[self.model.geom_bodyid[each]]) for each in (one, other))
        return bool((a and weld[parent[a]] == b) or (b and weld[parent[b]] == a))


def _least_distances(robot: RobotModel, pairs: Sequence[tuple[int, int]], wanted: Array) -> Array:
    """Return the least distance (m) of each pair of shapes over the nominal poses, at most ``wanted`` and a slack."""
    model, far = robot.model, wanted + 2 * _CLEARANCE_SLACK_M
    chain, data, least = robot.chain, mujoco.MjData(robot.model), far.copy()
    zero = np.zeros((1, chain.size))
    joints = np.concatenate([chain.home[None], zero[~chain.beyond_limits(zero, 0.0).any(axis=1)]])
    qpos = np.concatenate([robot.qpos(joints), model.key_qpos.reshape(-1, model.nq)])
    for row in qpos[~np.isnan(qpos).any(axis=1)]:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        for i, (one, other) in enumerate(pairs):
            least[i] = min(least[i], mujoco.mj_geomDistance(model, data, one, other, far[i], None))
    return least
