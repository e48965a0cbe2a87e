"""Simulate corners in pictures of a virtual arm: where cameras and boards stand, what they see, and with what noise."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError, option_name
from lab.core.measurements import measured
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.cameras.geometry import projected
from lab.extensions.cameras.rig import PX, Board, Camera, Rig, Simulated
from lab.kinematics.effects.effect import BUMPED, ShapesNoise, TrackerMotion
from lab.kinematics.joints import JointSpec
from lab.kinematics.serial.serial_arm import SerialArm
from lab.sensors.size import drawn_size
from lab.sensors.virtual_sensor import SimulatedReadings
from lab.simulation.candidate_poses import refuse_unknown_targets
from lab.simulation.collisions import collides, kinematics_at, random_poses
from lab.simulation.robot_model import SerialModel, TreeModel, site_pose
from lab.simulation.sight import unhidden
from lab.simulation.tracking import VirtualMeasurement, target_rotations
from lab.simulation.true_robot import TrueRobot, TrueSerialRobot

__all__ = ["CameraArm", "CameraScene", "corner_noise_px", "drawn_scene", "placed_scene", "simulated_corners"]

_BLOCK, _ROUNDS = 2048, 400  # of drawn joint positions
_AROUND = 0.5  # rad or m of a joint: spread of every other draw about poses that see the board
_ASIDE_M, _BACK_M, _BEYOND_M = 0.06, 0.03, 0.03  # a camera is beside the target and behind it, a board beyond it
_SPREAD_M, _SPREAD = 0.01, 0.08  # of a drawn place in the hand, m and rad
_TILT = 0.3  # rad: spread of a board's normal about the line of sight of the pose that it is placed by
_LOWEST_M, _OFF_AXIS_M = 0.02, 0.25  # of what stands in the world, above the base and away from its axis
_PLACINGS, _SCENES = 200, 20


@dataclass(frozen=True)
class CameraScene:
    """Cameras and boards of a virtual arm.

    Attributes:
        rig: their descriptions.
        cameras, boards: poses ``(4, 4)`` (m) in the instrument's frame, or in that of the target of their tip.
        seeing: ``(s, joints)`` poses that see a board.
        sizes: shares by which the boards are larger than stated; none where they are exact.
    """

    rig: Rig
    cameras: tuple[Array, ...]
    boards: tuple[Array, ...]
    seeing: Array
    sizes: tuple[float, ...] = ()

    def seen(
        self, camera: int, board: int, Ts_tip: Array, targets: tuple[str, ...], displaced: Array | float = 0.0
    ) -> tuple[Array, NDArray[np.bool_], Array]:
        """Return how a camera sees a board at some poses of the arm, before anything hides it.

        Args:
            Ts_tip: ``(n, k, 4, 4)`` poses (m) of the targets of the arm, in the instrument's frame.
            targets: their names.
            displaced: ``(n, c, 3)`` m, of corners.

        Returns:
            Places ``(n, c, 2)`` in thousands of pixels; ``(n, c)`` which are in sight: in the picture, and under an
            incidence that is allowed; and the corners ``(n, c, 3)`` m in the instrument's frame.
        """
        seer, plate = self.rig.cameras[camera], self.rig.boards[board]
        T_world_camera = _in_world(self.cameras[camera], self.rig.mount(seer, targets), Ts_tip)
        T_world_board = _in_world(self.boards[board], self.rig.mount(plate, targets), Ts_tip)
        size = 1.0 + (self.sizes[board] if self.sizes else 0.0)
        corners = size * plate.corners @ np.swapaxes(T_world_board[:, :3, :3], 1, 2) + T_world_board[:, None, :3, 3]
        corners = corners + displaced
        lines = corners - T_world_camera[:, None, :3, 3]
        points = lines @ T_world_camera[:, :3, :3]
        places = projected(points.reshape(-1, 3), seer.intrinsic_values)[0].reshape(*points.shape[:2], 2)
        facing = np.einsum("nci,ni->nc", lines, T_world_board[:, :3, 2]) / np.linalg.norm(lines, axis=2)
        inside = seer.sees(places.reshape(-1, 2)).reshape(points.shape[:2]) & (points[..., 2] > 0)
        return places, inside & (facing > np.cos(np.deg2rad(self.rig.simulated.incidence_deg))), corners

    def origins(self, camera: int, Ts_tip: Array, targets: tuple[str, ...]) -> Array:
        """Return the places ``(n, 3)`` m of a camera in the instrument's frame."""
        mount = self.rig.mount(self.rig.cameras[camera], targets)
        return _in_world(self.cameras[camera], mount, Ts_tip)[:, :3, 3]

    def visible(
        self, camera: int, board: int, arm: "CameraArm", joints: Array, tips: Array
    ) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        """Return ``seen`` with the corners that nothing hides, and the places ``(n, 3)`` m of the camera.

        Args:
            arm: whose shapes hide corners at poses ``(n, joints)``.
            tips: ``(n, k, 4, 4)`` poses (m) of its targets there, in the instrument's frame.
        """
        places, inside, corners = self.seen(camera, board, tips, arm.targets)
        origins, some = self.origins(camera, tips, arm.targets), np.flatnonzero(inside.any(axis=1))
        shown = np.where(inside[some, :, None], corners[some], np.nan)
        inside[some] &= ~arm.hidden(joints[some], origins[some], shown)
        return places, inside, corners, origins

    def shows(self, arm: "CameraArm") -> bool:
        """Check whether the poses by which cameras and boards were placed see enough of a board, unhidden."""
        tips, shown = arm.tips(self.seeing), np.zeros(len(self.seeing), dtype=np.bool_)
        for camera in range(len(self.cameras)):
            for board in range(len(self.boards)):
                inside = self.visible(camera, board, arm, self.seeing, tips)[1]
                shown |= inside.sum(axis=1) >= self.rig.simulated.corners
        return bool(shown.all())

    @property
    def placed(self) -> dict[str, Array]:
        """Cameras and boards ``(6,)``, m and rad, with a camera's intrinsic parameters, by the owner's name."""
        found = dict[str, Array]()
        both: tuple[tuple[str, tuple[Camera | Board, ...], tuple[Array, ...]], ...] = (
            ("camera", self.rig.cameras, self.cameras),
            ("board", self.rig.boards, self.boards),
        )
        for kind, parts, Ts in both:
            for part, T in zip(parts, Ts, strict=True):
                sizes = self.sizes or (0.0,) * len(self.boards)
                more = part.intrinsic_values if isinstance(part, Camera) else sizes[self.rig.boards.index(part)]
                found[f"{kind}.{part.name}"] = np.append(np.append(T[:3, 3], se3.log(T[:3, :3])), more)
        return found


def _in_world(T: Array, mount: int | None, Ts_tip: Array) -> Array:
    return np.broadcast_to(T, (len(Ts_tip), 4, 4)) if mount is None else np.asarray(Ts_tip[:, mount] @ T)


@dataclass(frozen=True)
class CameraArm:
    """The nominal arm as cameras are placed by it, in the instrument's frame.

    Attributes:
        robot: nominal, with the instrument where it truly stands.
        targets: of the tips.

    Raises:
        LabError: the robot has no such target.
    """

    robot: SerialModel
    T_world_instrument: Array
    targets: tuple[str, ...]

    def __post_init__(self) -> None:
        refuse_unknown_targets(self.robot, self.targets)

    def tips(self, joints: Array) -> Array:
        """Return the poses ``(n, k, 4, 4)`` m of the targets in the instrument's frame."""
        arm = SerialArm(self.robot.chain, self.targets)
        values = self.robot.values_before(arm, self.T_world_instrument)
        rest = self.robot.chain.home[None]
        found = []
        for i, target in enumerate(self.targets):
            T_last_site = se3.inverse(arm.tool(rest, values, i)[0][0]) @ self._site(rest, target)
            found.append(arm.tool(joints, values, i)[0] @ T_last_site)
        return np.stack(found, axis=1)

    def _site(self, joints: Array, target: str) -> Array:
        T_world_site = site_pose(self.robot.model, next(kinematics_at(self.robot, joints)), target)
        return np.asarray(se3.inverse(self.T_world_instrument) @ T_world_site)

    def hidden(self, joints: Array, origins: Array, corners: Array) -> NDArray[np.bool_]:
        """Return ``(n, c)``: corners that something of the cell hides."""
        T = self.T_world_instrument
        shape = corners.shape
        world = se3.transform(T, corners.reshape(-1, 3)).reshape(shape)
        return ~unhidden(self.robot, joints, se3.transform(T, origins), world)


def placed_scene(rig: Rig, arm: CameraArm) -> CameraScene:
    """Place cameras and boards as their file says, each of them."""
    T_frame0 = se3.inverse(arm.T_world_instrument) @ arm.robot.T_world_frame0
    parts: tuple[Camera | Board, ...] = (*rig.cameras, *rig.boards)
    Ts = {part: _given_place(rig, part, arm, T_frame0) for part in parts}
    found = [[T for part, T in Ts.items() if isinstance(part, kind) and T is not None] for kind in (Camera, Board)]
    return CameraScene(rig, tuple(found[0]), tuple(found[1]), np.empty((0, arm.robot.chain.size)))


def _given_place(rig: Rig, part: Camera | Board, arm: CameraArm, T_frame0: Array) -> Array | None:
    """Return the pose of a camera or board as ``CameraScene`` holds it; None where the file does not place it."""
    if part.T_mount is None:
        return None
    return part.T_mount if rig.mount(part, arm.targets) is not None else np.asarray(T_frame0 @ part.T_mount)


def drawn_scene(rig: Rig, arm: CameraArm, rng: np.random.Generator) -> CameraScene:
    """Place cameras and boards: as the file says, else by chance, so that the arm sees something.

    Raises:
        LabError: a camera or a board is fixed to something that the arm does not have, or no place is found.
    """
    joints = random_poses(arm.robot, _PLACINGS, rng)
    tips = arm.tips(joints)
    T_frame0 = se3.inverse(arm.T_world_instrument) @ arm.robot.T_world_frame0
    parts: tuple[Camera | Board, ...] = (*rig.cameras, *rig.boards)
    Ts = _given_or_in_hand(parts, rig, arm, T_frame0, rng)
    seeing = []
    for part in parts:
        if part not in Ts:
            others = rig.boards if isinstance(part, Camera) else rig.cameras
            other = next((each for each in others if each in Ts), None)
            if other is None:  # all stand in the world: the first is where the arm reaches
                Ts[part] = _anywhere(tips, T_frame0, rng)
                continue
            Ts[part], row = _before(part, other, Ts[other], rig, arm, tips, T_frame0, rng)
            seeing.append(joints[row])
    near = np.array(seeing) if seeing else joints
    return CameraScene(rig, tuple(Ts[each] for each in rig.cameras), tuple(Ts[each] for each in rig.boards), near)


def _given_or_in_hand(
    parts: tuple[Camera | Board, ...], rig: Rig, arm: CameraArm, T_frame0: Array, rng: np.random.Generator
) -> dict[Camera | Board, Array]:
    """Return the poses of what the file places, and of what the arm carries; not of others in the world."""
    Ts: dict[Camera | Board, Array] = {}
    for part in parts:
        T = _given_place(rig, part, arm, T_frame0)
        if T is None and rig.mount(part, arm.targets) is not None:
            T = _in_hand(part, rng)
        if T is not None:
            Ts[part] = T
    return Ts


def _in_hand(part: Camera | Board, rng: np.random.Generator) -> Array:
    """Draw the pose of a camera or board in the frame of its target, whose z leads away from the arm."""
    turn = se3.exp(_SPREAD * rng.standard_normal(3))
    spread = _SPREAD_M * rng.standard_normal(3)
    if isinstance(part, Camera):
        around = se3.exp(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))
        return se3.pose(around @ turn, around @ np.array([_ASIDE_M, 0.0, -_BACK_M]) + spread)
    rotation = turn @ np.diag([1.0, -1.0, -1.0])
    return se3.pose(rotation, np.array([0.0, 0.0, _BEYOND_M]) + spread - rotation @ part.corners.mean(axis=0))


def _anywhere(tips: Array, T_frame0: Array, rng: np.random.Generator) -> Array:
    return np.asarray(tips[_reachable(tips[:, 0, :3, 3], T_frame0)[0], 0])


def _reachable(places: Array, T_frame0: Array) -> NDArray[np.int_]:
    """Return the rows of places ``(n, 3)`` that are above the base and away from its axis; all where none is."""
    local = se3.transform(se3.inverse(T_frame0), places)
    good = np.flatnonzero((local[:, 2] > _LOWEST_M) & (np.hypot(local[:, 0], local[:, 1]) > _OFF_AXIS_M))
    return good if len(good) else np.arange(len(places))


def _before(
    part: Camera | Board,
    other: Camera | Board,
    T_other: Array,
    rig: Rig,
    arm: CameraArm,
    tips: Array,
    T_frame0: Array,
    rng: np.random.Generator,
) -> tuple[Array, int]:
    """Return the pose of what stands in the world before what is placed already, and the pose of the arm there."""
    scene = rig.simulated
    Ts = _in_world(T_other, rig.mount(other, arm.targets), tips)
    distance = MM.to_si(rng.uniform(1.2 * scene.nearest_mm, 0.5 * (scene.nearest_mm + scene.farthest_mm)))
    roll = se3.exp(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))
    turn = se3.exp(_TILT * np.append(rng.standard_normal(2), 0.0)) @ roll
    T_camera_board = np.eye(4)
    plate = part if isinstance(part, Board) else other
    assert isinstance(plate, Board)
    T_camera_board[:3, :3] = turn
    T_camera_board[:3, 3] = np.array([0.0, 0.0, distance]) - turn @ plate.corners.mean(axis=0)
    there = Ts @ (T_camera_board if isinstance(part, Board) else se3.inverse(T_camera_board))
    row = int(_reachable(there[:, :3, 3], T_frame0)[0])
    return there[row], row


def simulated_corners(rig: Rig, poses: VirtualMeasurement) -> SimulatedReadings:
    """Take pictures of boards with a virtual arm: at the poses of a plan, else at new ones that see a board.

    Boards are as much larger or smaller than stated as the uncertainty of their size lets them be.
    Noise grows with blur: a corner whose blur has a diameter of c pixels has ``noise_px sqrt(1 + c^2)``.

    Raises:
        LabError: the robot's effects are of a tracker, or the arm sees no board.
    """
    real, rng, scene = _serial_robot(poses.robot), poses.rng, rig.simulated
    scattering, failing, shaping, placing, missing, printing = rng.spawn(6)
    targets = tuple(dict.fromkeys((*poses.targets, *rig.targets)))
    nominal = CameraArm(real.robot, real.T_world_tracker, targets)
    # cameras and boards that the nominal arm sees, and the true arm's pose at each picture
    placed = _scene_that_shows(rig, nominal, placing)
    placed = replace(placed, sizes=tuple(drawn_size(board.size_u, printing) for board in rig.boards))
    joints = poses.joints if poses.planned else _seeing_poses(placed, nominal, len(poses.joints), placing)
    conditions = {name: column for name, column in poses.conditions.items() if name != BUMPED}
    scatter = real.effects.scatter(len(joints), scattering)
    tips = _true_tips(real, joints, targets, conditions, scatter)
    true_arm = replace(nominal, robot=replace(real.robot, model=real.model))
    row, cell, exact, distance = _seen_corners(placed, true_arm, joints, tips, missing)
    # noise, wrong corners, and what displaces the point of the tool
    noise = corner_noise_px(scene, distance)
    if poses.instrument.kind == "exact":
        noise = np.zeros_like(noise)
    standard = real.effects.shaped_noise(rng.standard_normal((len(row), 1, 2)), shaping)[:, 0]
    errors = PX.to_si(noise[:, None] * standard / np.sqrt(poses.readings))
    wrong = missing.random(len(row)) < scene.wrong
    errors[wrong] += PX.to_si(missing.uniform(-scene.wrong_px, scene.wrong_px, (int(wrong.sum()), 2)))
    displaced, bad = real.effects.displacements(len(row), failing)
    focal = np.array([PX.to_si(camera.focal_px[0]) for camera in rig.cameras])
    errors += displaced[:, :2] * (focal[cell[:, 0]] / distance)[:, None]
    shown_px = PX.of(exact + errors)
    data = measured(real.robot.chain.joint_names, real.effects.shown(joints)[row], (), np.empty((len(row), 0, 3)))
    texts = {
        "camera": tuple(rig.cameras[i].name for i in cell[:, 0]),
        "board": tuple(rig.boards[i].name for i in cell[:, 1]),
        "corner": tuple(map(str, cell[:, 2].tolist())),
    }
    numbers = {name: column[row] for name, column in conditions.items()}
    numbers |= {"u_px": shown_px[:, 0], "v_px": shown_px[:, 1]}
    return SimulatedReadings(replace(data, other=texts, conditions=numbers), bad | wrong, placed.placed)


def _scene_that_shows(rig: Rig, arm: CameraArm, rng: np.random.Generator) -> CameraScene:
    """Draw scenes until one shows a board to the arm, or the last of some."""
    scene = drawn_scene(rig, arm, rng)
    for _ in range(_SCENES):
        if scene.shows(arm):
            break
        scene = drawn_scene(rig, arm, rng)
    return scene


def _seen_corners(
    placed: CameraScene, arm: CameraArm, joints: Array, tips: Array, missing: np.random.Generator
) -> tuple[NDArray[np.int_], NDArray[np.int_], Array, Array]:
    """Return the corners in the pictures of all cameras, in the order of the poses.

    Args:
        arm: the true one, with the poses of its tips at ``joints`` ``(n, joints)``.
        missing: random numbers, by which some corners are not found.

    Returns:
        The pose ``(m,)`` of each; camera, board and corner ``(m, 3)``; its exact place ``(m, 2)`` (thousands of pixels)
        and distance ``(m,)`` m from the camera.

    Raises:
        LabError: there is none.
    """
    rig, scene = placed.rig, placed.rig.simulated
    rows, cells, places, distances = list[NDArray[np.int_]](), list[NDArray[np.int_]](), list[Array](), list[Array]()
    for camera, board in np.ndindex(len(rig.cameras), len(rig.boards)):
        exact, inside, corners, origins = placed.visible(camera, board, arm, joints, tips)
        inside &= missing.random(inside.shape) >= scene.missed
        inside &= (inside.sum(axis=1) >= scene.corners)[:, None]
        row, corner = np.nonzero(inside)
        rows.append(row)
        cells.append(np.column_stack([np.full_like(row, camera), np.full_like(row, board), corner]))
        places.append(exact[row, corner])
        distances.append(np.linalg.norm(corners[row, corner] - origins[row], axis=1))
    row, cell = np.concatenate(rows), np.concatenate(cells)
    if not len(row):
        raise LabError(
            f"{option_name('observe')} pixels: no camera sees {scene.corners} corners of a board in any pose"
        )
    order = np.lexsort((cell[:, 2], cell[:, 1], cell[:, 0], row))
    return row[order], cell[order], np.concatenate(places)[order], np.concatenate(distances)[order]


def corner_noise_px(scene: Simulated, distance_m: Array) -> Array:
    """Return the noise ``(n,)`` of corners at some distances, in pixels: it grows with their blur."""
    return np.asarray(scene.noise_px * np.sqrt(1 + _blur_px(scene, distance_m) ** 2))


def _blur_px(scene: Simulated, distance_m: Array) -> Array:
    """Return the diameter ``(n,)`` of a corner's blur by a thin lens: it grows with |1 / focus - 1 / distance|."""
    if scene.focus_mm is None:
        return np.zeros_like(distance_m)
    return np.asarray(scene.blur_px * 2 * np.abs(MM.to_si(scene.focus_mm) / distance_m - 1))


def _serial_robot(real: TrueRobot) -> TrueSerialRobot:
    """Return a serial robot without effects of a tracker; refuse others."""
    if not isinstance(real, TrueSerialRobot):
        what = "several tips" if isinstance(real.robot, TreeModel) else "loops"
        raise LabError(
            f"robot {real.robot.chain.name} has {what}: a virtual one is measured by {option_name('observe')} points "
            "or pose"
        )
    moving = any(isinstance(part, TrackerMotion) and part.motion.any() for part in real.effects.parts)
    if moving or any(isinstance(part, ShapesNoise) and part.is_of_a_tracker for part in real.effects.parts):
        raise LabError("drift, bumps and steps are of a tracker, and this kind of observation has none: leave them out")
    return real


def _true_tips(
    real: TrueRobot, joints: Array, targets: tuple[str, ...], conditions: dict[str, Array], scatter: Array
) -> Array:
    """Return the exact poses ``(n, k, 4, 4)`` m of the targets' frames in the instrument's frame, with all effects."""
    points = real.points(joints, targets, conditions, scatter)
    turns = [target_rotations(real, joints, target, conditions, scatter) for target in targets]
    return np.stack([se3.pose(turn, points[:, k]) for k, turn in enumerate(turns)], axis=1)


def _seeing_poses(placed: CameraScene, arm: CameraArm, count: int, rng: np.random.Generator) -> Array:
    """Draw ``(count, joints)`` poses without collision, at which each camera in turn sees enough of a board.

    Raises:
        LabError: hardly any pose sees one.
    """
    rig, chain = placed.rig, arm.robot.chain
    pairs = rig.pairs
    drawn = [list[Array]() for _ in pairs]
    wanted = [len(range(i, count, len(pairs))) for i in range(len(pairs))]
    near = placed.seeing
    for number in range(_ROUNDS):
        joints = chain.random_joints(_BLOCK, rng)
        if number % 2:
            joints = _around(chain, near, joints.shape, rng)
        tips = arm.tips(joints)
        for which, (camera, board) in enumerate(pairs):
            if len(drawn[which]) < wanted[which]:
                drawn[which] += _some_seeing(
                    placed, arm, camera, board, joints, tips, wanted[which] - len(drawn[which])
                )
        if all(len(some) == need for some, need in zip(drawn, wanted, strict=True)):
            return np.array([drawn[i % len(pairs)][i // len(pairs)] for i in range(count)])
    raise _hardly_seen(rig, list(map(len, drawn)), wanted)


def _hardly_seen(rig: Rig, counts: list[int], wanted: list[int]) -> LabError:
    """Return the error of the first camera and board with fewer poses than wanted."""
    lacking = next(i for i, count in enumerate(counts) if count < wanted[i])
    camera, board = rig.pairs[lacking]
    return LabError(
        f"camera {rig.cameras[camera].name} sees {rig.simulated.corners} corners of board {rig.boards[board].name} in "
        f"{counts[lacking]} poses alone, of {wanted[lacking]} wanted: place them otherwise, or take another "
        f"{option_name('seed')}"
    )


def _around(chain: JointSpec, near: Array, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Draw joint positions near others, within the limits."""
    joints = near[rng.integers(len(near), size=shape[0])] + _AROUND * rng.standard_normal(shape)
    return np.asarray(joints[~chain.beyond_limits(joints, 0.0).any(axis=1)])


def _some_seeing(
    placed: CameraScene, arm: CameraArm, camera: int, board: int, joints: Array, tips: Array, most: int
) -> list[Array]:
    """Return up to ``most`` of some poses at which a camera sees enough of a board, and the arm touches nothing."""
    scene = placed.rig.simulated
    _, inside, corners = placed.seen(camera, board, tips, arm.targets)
    origins = placed.origins(camera, tips, arm.targets)
    distance = MM.of(np.linalg.norm(corners.mean(axis=1) - origins, axis=1))
    good = (inside.sum(axis=1) >= scene.corners) & (scene.nearest_mm <= distance) & (distance <= scene.farthest_mm)
    some = np.flatnonzero(good)
    some = some[~collides(arm.robot, joints[some])]
    hidden = arm.hidden(joints[some], origins[some], np.where(inside[some, :, None], corners[some], np.nan))
    some = some[((~hidden).sum(axis=1)) >= scene.corners]
    return list(joints[some[:most]])
