"""Predict where corners of boards appear in the pictures of cameras, with analytic derivatives.

Each row is one corner as one camera sees it at one pose of the arm. Cameras and boards have a pose in the world, which
is the frame of the instrument beside measured points and that of the base without, or in the frame of a tip of the arm.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.core import se3
from lab.core.measurements import FIXTURE, Measurements
from lab.core.se3 import Array
from lab.core.units import Unit
from lab.extensions.cameras.closed_forms import board_poses, hand_eye, mean_pose, robot_world
from lab.extensions.cameras.geometry import INTRINSICS, projected, sight_lines
from lab.extensions.cameras.rig import PX, Board, Camera, Rig
from lab.kinematics.model import Model
from lab.kinematics.parameter import SIZE, Parameter, indices_of_groups, names_of, placed_parameters
from lab.sensors.size import LEAST_NOISE, size_parameters, size_residuals
from lab.sensors.tip import longest_link, tip_frames, tip_origins, tip_rotations, with_tip

__all__ = ["GROUPS", "Pixels"]

GROUPS = ("camera", "board", "intrinsics")
_AXES = ("x", "y", "z", "rx", "ry", "rz")
_AROUND = 0.05  # rad or m of a joint: spread about measured poses of those by which rank is decided
_LEAST_VIEWS = 3  # that place a camera and a board together
_FAR_OFF = 3.0  # times the median residual of the pictures: one above is left out of a start
_FEW_CORNERS = 4


@dataclass(frozen=True)
class _Part:
    """A camera or board in use: where its parameters begin, what carries it, and how many follow its pose."""

    what: Camera | Board
    index: int
    first: int
    mount: int | None
    more: int

    @property
    def pose(self) -> slice:
        return slice(self.first, self.first + 6)

    @property
    def rest(self) -> slice:
        return slice(self.first + 6, self.first + 6 + self.more)


@dataclass(frozen=True)
class Pixels:
    """Corners of boards in the pictures of cameras, in thousands of pixels.

    Attributes:
        arm: the arm, measured by points.
        rig: cameras and boards.
        seen: of the cameras and the boards, which are seen in the rows: indices in the rig.
        near: ``(m, joints + conditions)`` inputs near which the structure's rank is decided.
        sigma: noise of a coordinate (thousands of pixels) by which priors of lenses and of boards' sizes weigh.
        parameters: the arm's, then six of each camera with its intrinsic ones, then six of each board with its scale.
        names: of the parameters.
    """

    arm: Model
    rig: Rig
    seen: tuple[tuple[int, ...], tuple[int, ...]]
    near: Array = field(repr=False)
    sigma: float = LEAST_NOISE
    parameters: tuple[Parameter, ...] = field(init=False, repr=False)
    names: tuple[str, ...] = field(init=False)
    cameras: tuple[_Part, ...] = field(init=False, repr=False)
    boards: tuple[_Part, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        added, first, found = list[Parameter](), len(self.arm.names), list[list[_Part]]()
        both: tuple[tuple[Camera | Board, ...], ...] = (self.rig.cameras, self.rig.boards)
        for kind, parts, which in zip(GROUPS, both, self.seen, strict=False):
            found.append([])
            for index in which:
                part = parts[index]
                own = (*placed_parameters(f"{kind}.{part.name}", kind, _AXES), *_further(part))
                mount = self.rig.mount(part, self.arm.targets)
                found[-1].append(_Part(part, index, first + len(added), mount, len(own) - 6))
                added += own
        object.__setattr__(self, "cameras", tuple(found[0]))
        object.__setattr__(self, "boards", tuple(found[1]))
        object.__setattr__(self, "parameters", (*self.arm.parameters, *added))
        object.__setattr__(self, "names", names_of(self.parameters))

    @property
    def model(self) -> Self:
        """This model, which defines its own observation."""
        return self

    @property
    def targets(self) -> tuple[str, ...]:
        """One observed quantity: the place of a corner."""
        return ("corner",)

    @property
    def conditions(self) -> tuple[str, ...]:
        """The arm's, then the number of the corner in the rig."""
        return (*self.arm.conditions, FIXTURE)

    @property
    def placed(self) -> tuple[str, ...]:
        """Cameras and boards, with the intrinsic parameters that are identified; sizes where none is known."""
        return (*GROUPS, SIZE) if self.unsized else GROUPS

    @property
    def units(self) -> Array:
        """``(1,)``: a thousand pixels weigh as a metre."""
        return np.ones(1)

    @property
    def positions(self) -> int:
        """Zero: no position in an instrument's frame is observed."""
        return 0

    def within(self, data: Measurements) -> Self:
        """Return the model with the cameras and boards that these rows see."""
        rows = np.flatnonzero(data.seen.any(axis=1))
        camera, board, _ = self.rig.parts(data.conditions[FIXTURE][rows].astype(np.int_))
        seen = tuple(np.unique(camera).tolist()), tuple(np.unique(board).tolist())
        if seen == self.seen:
            return self
        camera, board, _ = self.rig.parts(self.near[:, -1].astype(np.int_))
        near = self.near[np.isin(camera, seen[0]) & np.isin(board, seen[1])]
        return replace(self, seen=seen, near=near)

    def nominal(self, values: Array) -> Array:
        """Return the arm's parameters, with cameras and boards at the origins and intrinsic parameters as given."""
        found = np.zeros(len(self.names))
        found[: len(self.arm.names)] = values[: len(self.arm.names)]
        for part in self.cameras:
            if part.more:
                assert isinstance(part.what, Camera)
                found[part.rest] = part.what.intrinsic_values
        return found

    def observe(self, inputs: Array, values: Array) -> tuple[Array, Array]:
        """Return places of corners ``(n, 1, 2)`` and their derivatives ``(n, 1, 2, p)``."""
        scene = _SeenCorners.of(self, inputs, values, rates=True)
        return scene.places[:, None], scene.derivatives(self, values)[:, None]

    def points(self, inputs: Array, values: Array) -> Array:
        """Return places of corners ``(n, 1, 2)``."""
        return _SeenCorners.of(self, inputs, values, rates=False).places[:, None]

    def column_priority(self) -> tuple[int, ...]:
        """Return what is fixed in the world, then the arm's order with the tip's cameras and boards, then the base."""
        base = indices_of_groups(self.arm.parameters, ["base"])
        order = with_tip(self.arm, self.carried, unsized=self.unsized)
        return (*self.in_world, *(i for i in order if i not in base), *base)

    @property
    def unsized(self) -> bool:
        """Check whether no board has a known size, so that nothing shows the arm's."""
        return all(np.isinf(part.what.size_u) for part in self.boards if isinstance(part.what, Board))

    @property
    def scale_link(self) -> int:
        """Index of the link that stays nominal where nothing shows the arm's size."""
        return longest_link(self.arm)

    @property
    def in_world(self) -> tuple[int, ...]:
        """Indices of parameters of what stands in the world, and of those that no pose shares."""
        parts = (*self.cameras, *self.boards)
        poses = [i for part in parts if part.mount is None for i in range(part.pose.start, part.pose.stop)]
        return (*poses, *(i for part in parts for i in range(part.rest.start, part.rest.stop)))

    @property
    def carried(self) -> tuple[int, ...]:
        """Indices of the poses of what the arm's tips carry."""
        parts = (*self.cameras, *self.boards)
        return tuple(i for part in parts if part.mount is not None for i in range(part.pose.start, part.pose.stop))

    def weighed(self, sigma: float) -> Self:
        """Return the model whose priors of lenses and sizes weigh by this noise (thousands of pixels)."""
        return replace(self, sigma=sigma)

    def rank_point(self, values: Array) -> Array:
        """Return the arm's ``(p,)``; cameras and boards as they are in ``values``."""
        size = len(self.arm.names)
        return np.concatenate([self.arm.rank_point(values[:size]), values[size:]])

    def structure_joints(self, count: int, rng: np.random.Generator) -> Array:
        """Draw inputs near the measured ones, where the boards are in sight, with other conditions."""
        rows = np.linspace(0, len(self.near) - 1, count).round().astype(np.int_)
        inputs = self.near[rows]
        joints = inputs.shape[1] - len(self.conditions)
        inputs[:, joints:-1] = self.arm.structure_joints(count, rng)[:, joints:]
        inputs[:, :joints] += _AROUND * rng.standard_normal((count, joints))
        return inputs

    def extra_residuals(self, values: Array) -> tuple[Array, Array]:
        """Return the priors of intrinsic parameters and of boards' sizes, weighted as places are."""
        sizes, slopes = size_residuals(self.parameters, values, self.sigma)
        rows, residuals = [slopes], sizes.tolist()
        for part in self.cameras:
            assert isinstance(part.what, Camera)
            if part.what.intrinsics == "prior":
                weight = self.sigma / part.what.prior_sigma
                residuals += (weight * (part.what.intrinsic_values - values[part.rest])).tolist()
                rows.append(weight[:, None] * np.eye(len(self.names))[part.rest])
        return np.array(residuals), np.concatenate(rows)

    def errors(self, data: Measurements, values: Array) -> Array:
        """Return lengths ``(n, 1)`` in m of the errors across the line of sight, at the distance of each corner.

        NaN for corners of a board, or pictures of a camera, that ``values`` lack.
        """
        camera, board, _ = self.rig.parts(data.conditions[FIXTURE].astype(np.int_))
        known = np.flatnonzero(np.isin(camera, self.seen[0]) & np.isin(board, self.seen[1]))
        errors = np.full((len(data), 1), np.nan)
        part = data[known]
        scene = _SeenCorners.of(self, part.inputs(self.conditions), values, rates=False)
        angle = (part.points[:, 0] - scene.places) / scene.intrinsics[:, :2]
        errors[known, 0] = np.linalg.norm(angle, axis=1) * np.abs(scene.in_camera[:, 2])
        return errors

    def wholes(self, inputs: Array) -> NDArray[np.int_]:
        """Return the number of each row's picture: of one board by one camera in one pose."""
        pairs = inputs[:, -1].astype(np.int_) // self.rig.corners_each
        keys = np.column_stack([_runs(inputs[:, :-1])[1], pairs])
        return np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)

    def cv_groups(self, data: Measurements) -> None:
        """Return None: the corners of a configuration are held out together."""

    def initial_guess(self, observed: Observations, values: Array) -> Array:
        """Place cameras and boards in closed form, with the arm at ``values``."""
        return _Start(self, observed, values).found()


def _frames_of_tips(model: Pixels, inputs: Array, values: Array, *, rates: bool) -> dict[int, tuple[Array, ...]]:
    """Return the frames of the tips that carry cameras or boards, by the number of their target."""
    mounts = {part.mount for part in (*model.cameras, *model.boards) if part.mount is not None}
    own = values[: len(model.arm.names)]
    return {mount: _frames(model.arm, inputs, own, mount, rates=rates) for mount in sorted(mounts)}


def _placed(parts: Sequence[_Part], index: NDArray[np.int_], values: Array) -> tuple[Array, Array]:
    """Return place ``(n, 3)`` and rotation ``(n, 3, 3)``, in what carries it, of each row's camera or board."""
    poses = [_pose_of(values, part) for part in parts]
    return np.stack([place for place, _, _ in poses])[index], np.stack([turn for _, turn, _ in poses])[index]


def _further(part: Camera | Board) -> tuple[Parameter, ...]:
    """Return the parameters of a camera or a board beside its pose."""
    if isinstance(part, Board):
        return size_parameters(f"board.{part.name}", part.size_u)
    if part.intrinsics == "fixed":
        return ()
    found = []
    for symbol in INTRINSICS:
        unit = PX if symbol in INTRINSICS[:4] else Unit("", "", 1.0, 6)
        found.append(Parameter(f"camera.{part.name}", symbol, "intrinsics", "ratio", unit))
    return tuple(found)


def _pose_of(values: Array, part: _Part) -> tuple[Array, Array, Array]:
    """Return place ``(3,)``, rotation ``(3, 3)`` and rotation vector of a camera or board in what carries it."""
    own = values[part.pose]
    return own[:3], se3.exp(own[3:]), own[3:]


@dataclass(frozen=True)
class _SeenCorners:
    """Corners and cameras at the poses of some rows.

    Attributes:
        camera, board: ``(n,)`` indices among those of the model.
        intrinsics: ``(n, 9)``.
        corners: ``(n, 3)`` in the board's frame, scaled.
        on_board: ``(n, 3)`` turned into the frame of what carries the board, from its origin.
        at_board: ``(n, 3)`` the corners in that frame.
        world: ``(n, 3)`` the corners in the world.
        at_camera: ``(n, 3)`` the corners in the frame of what carries the camera.
        in_camera: ``(n, 3)`` in the camera's frame.
        places: ``(n, 2)`` in the picture.
        poses: ``(n,)`` index of each row's pose of the arm.
        frames: origins, rotations and rates of each tip at these poses (``tip_frames``).
    """

    camera: NDArray[np.int_]
    board: NDArray[np.int_]
    intrinsics: Array
    corners: Array
    on_board: Array
    at_board: Array
    world: Array
    at_camera: Array
    in_camera: Array
    places: Array
    by_point: Array
    by_intrinsics: Array
    poses: NDArray[np.int_]
    frames: dict[int, tuple[Array, ...]]
    rotations: tuple[Array, Array]  # (n, 3, 3) of cameras and boards in what carries them

    @staticmethod
    def of(model: Pixels, inputs: Array, values: Array, *, rates: bool) -> "_SeenCorners":
        """Place all at the rows' poses."""
        index = model.rig.parts(inputs[:, -1].real.astype(np.int_))
        camera, board = (_positions(own, numbers) for own, numbers in zip(model.seen, index[:2], strict=True))
        first, poses = _runs(inputs[:, :-1])
        frames = _frames_of_tips(model, inputs[first, :-1], values, rates=rates)
        # corners in the frame of their board, and in what carries it
        scales = np.array([1.0 + values[part.rest].sum() for part in model.boards])
        corners = np.concatenate([_corners(part) for part in model.boards])
        starts = np.cumsum([0, *(len(_corners(part)) for part in model.boards)])[:-1]
        corner = corners[starts[board] + index[2]] * scales[board, None]
        place_board, turn_board = _placed(model.boards, board, values)
        on_board = _turned(turn_board, corner)
        at_board = on_board + place_board
        # in the world
        world = at_board.copy()
        for rows, mount in _by_mount(model.boards, board):
            origin, rotation = (part[poses[rows]] for part in frames[mount][:2])
            world[rows] = origin + _turned(rotation, at_board[rows])
        # in what carries the camera, and in the camera
        at_camera = world.copy()
        for rows, mount in _by_mount(model.cameras, camera):
            origin, rotation = (part[poses[rows]] for part in frames[mount][:2])
            at_camera[rows] = _turned(np.swapaxes(rotation, 1, 2), world[rows] - origin)
        place_camera, turn_camera = _placed(model.cameras, camera, values)
        in_camera = _turned(np.swapaxes(turn_camera, 1, 2), at_camera - place_camera)
        intrinsics = np.stack([_intrinsics(part, values) for part in model.cameras])[camera]
        places, by_point, by_intrinsics = projected(in_camera, intrinsics)
        return _SeenCorners(
            camera, board, intrinsics, corner, on_board, at_board, world, at_camera, in_camera, places, by_point,
            by_intrinsics, poses, frames, (turn_camera, turn_board),
        )  # fmt: skip

    def derivatives(self, model: Pixels, values: Array) -> Array:
        """Return the derivatives ``(n, 2, p)`` of the places.

        A corner that moves by dx in the world moves by R_c' R_tip' (dx - do - w x (x - o)) in a camera on a tip whose
        origin moves by do and which turns by w.
        """
        size = len(model.arm.names)
        turn_camera, _ = self.rotations
        found = np.zeros((len(self.places), 2, len(model.names)), dtype=self.places.dtype)
        moves = self.by_point @ np.swapaxes(turn_camera, 1, 2)  # (n, 2, 3) by the corner in what carries the camera
        by_world = moves.copy()
        for rows, mount in _by_mount(model.cameras, self.camera):
            origin, rotation, moving, turning = (each[self.poses[rows]] for each in self.frames[mount])
            by_world[rows] = moves[rows] @ np.swapaxes(rotation, 1, 2)
            lever = self.world[rows] - origin
            found[rows, :, :size] -= by_world[rows] @ (moving - _crossed(lever, turning))
        by_board = by_world.copy()
        for rows, mount in _by_mount(model.boards, self.board):
            _, rotation, moving, turning = (each[self.poses[rows]] for each in self.frames[mount])
            lever = _turned(rotation, self.at_board[rows])
            found[rows, :, :size] += by_world[rows] @ (moving - _crossed(lever, turning))
            by_board[rows] = by_world[rows] @ rotation
        for i, part in enumerate(model.cameras):
            rows = np.flatnonzero(self.camera == i)
            place, _, vector = _pose_of(values, part)
            found[rows, :, part.first : part.first + 3] = -moves[rows]
            turned = moves[rows] @ se3.skew(self.at_camera[rows] - place)
            found[rows, :, part.first + 3 : part.first + 6] = turned @ se3.left_jacobian(vector)
            if part.more:
                found[rows, :, part.rest] = self.by_intrinsics[rows]
        for i, part in enumerate(model.boards):
            rows = np.flatnonzero(self.board == i)
            _, _, vector = _pose_of(values, part)
            found[rows, :, part.first : part.first + 3] = by_board[rows]
            turned = -by_board[rows] @ se3.skew(self.on_board[rows])
            found[rows, :, part.first + 3 : part.first + 6] = turned @ se3.left_jacobian(vector)
            if part.more:
                scale = 1.0 + values[part.rest].sum()
                found[rows, :, part.rest] = by_board[rows] @ (self.on_board[rows] / scale)[..., None]
        return found


def _positions(own: tuple[int, ...], indices: NDArray[np.int_]) -> NDArray[np.int_]:
    """Return where each index stands among a model's own."""
    at = np.zeros(max(own) + 1, dtype=np.int_)
    at[list(own)] = np.arange(len(own))
    return at[indices]


def _runs(inputs: Array) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Return the first row of each pose of the arm, and the pose of each row ``(n,)``; rows of one follow another."""
    new = np.ones(len(inputs), dtype=np.bool_)
    new[1:] = (inputs[1:] != inputs[:-1]).any(axis=1)
    return np.flatnonzero(new), np.cumsum(new) - 1


def _frames(arm: Model, inputs: Array, values: Array, mount: int, *, rates: bool) -> tuple[Array, ...]:
    if rates:
        return tip_frames(arm, inputs, values, mount)
    points = arm.points(inputs, values)
    rotations = tip_rotations(arm, inputs, values, points, mount)
    return tip_origins(arm, values, points, rotations, mount), rotations


def _by_mount(parts: tuple[_Part, ...], which: NDArray[np.int_]) -> list[tuple[NDArray[np.int_], int]]:
    """Return the rows of what each tip carries, with the tip."""
    mounts = np.array([-1 if part.mount is None else part.mount for part in parts])[which]
    return [(np.flatnonzero(mounts == mount), mount) for mount in np.unique(mounts).tolist() if mount >= 0]


def _intrinsics(part: _Part, values: Array) -> Array:
    assert isinstance(part.what, Camera)
    return values[part.rest] if part.more else part.what.intrinsic_values


def _corners(part: _Part) -> Array:
    assert isinstance(part.what, Board)
    return part.what.corners


def _turned(rotations: Array, vectors: Array) -> Array:
    return np.asarray((rotations @ vectors[..., None])[..., 0])


def _crossed(lever: Array, turning: Array) -> Array:
    """Return ``lever x w`` ``(n, 3, p)`` for angular velocities ``(n, 3, p)``."""
    return np.asarray(se3.skew(lever) @ turning)


@dataclass(frozen=True)
class _View:
    """Pictures of one board by one camera: ``A_i X = Z B_i`` of the camera's pose X and the board's Z."""

    camera: int
    board: int
    As: Array
    Bs: Array
    moves: bool  # against each other: else their pictures show no more than one does


class _Start:
    """Start values of cameras and boards: pairs of many pictures first, then what is known from these."""

    def __init__(self, model: Pixels, observed: Observations, values: Array) -> None:
        self.model, self.values = model, values.copy()
        seen = observed.seen[:, 0]
        self.inputs, self.places = observed.inputs[seen], observed.points[seen, 0]
        camera, board, self.corner = model.rig.parts(self.inputs[:, -1].astype(np.int_))
        self.camera, self.board = _positions(model.seen[0], camera), _positions(model.seen[1], board)
        self.first, self.poses = _runs(self.inputs[:, :-1])
        self.known: dict[tuple[str, int], Array] = {}

    def found(self) -> Array:
        """Return the parameters ``(p,)``."""
        views = [
            view
            for i in range(len(self.model.cameras))
            for j in range(len(self.model.boards))
            if (view := self._view(i, j)) is not None
        ]
        while views:
            view = max(views, key=lambda each: (self._shared(each), each.moves, len(each.As)))
            views.remove(view)
            self._place(view)
        for kind, parts in (("camera", self.model.cameras), ("board", self.model.boards)):
            for i, part in enumerate(parts):
                if (T := self.known.get((kind, i))) is not None:
                    self.values[part.pose] = [*T[:3, 3], *se3.log(T[:3, :3])]
        return self.values

    def _shared(self, view: _View) -> int:
        """Return how much of a view is known: the pair that needs least is placed next."""
        return (("camera", view.camera) in self.known) + (("board", view.board) in self.known)

    def _view(self, camera: int, board: int) -> _View | None:
        rows = np.flatnonzero((self.camera == camera) & (self.board == board))
        if len(rows) < _FEW_CORNERS:
            return None
        parts = self.model.cameras[camera], self.model.boards[board]
        pose, row = np.unique(self.poses[rows], return_inverse=True)
        flat = np.full((len(pose), len(_corners(parts[1])), 2), np.nan)
        flat[row, self.corner[rows]] = sight_lines(self.places[rows], _intrinsics(parts[0], self.values))
        Ts, residual = board_poses(_corners(parts[1]), flat)
        good = np.isfinite(residual) & (Ts[:, 2, 3] > 0)
        if not good.any():
            return None
        good &= residual <= _FAR_OFF * max(float(np.median(residual[good])), 1e-9)
        mounts = [self._mounts(part.mount, pose[good]) for part in parts]
        As, Bs = np.asarray(se3.inverse(mounts[1]) @ mounts[0]), np.asarray(se3.inverse(Ts[good]))
        return _View(camera, board, As, Bs, moves=(parts[0].index, parts[1].index) in self.model.rig.pairs)

    def _mounts(self, mount: int | None, poses: NDArray[np.int_]) -> Array:
        """Return the poses ``(m, 4, 4)`` of what carries a camera or board, in the world."""
        if mount is None:
            return np.broadcast_to(np.eye(4), (len(poses), 4, 4))
        arm, inputs = self.model.arm, self.inputs[self.first[poses], :-1]
        origins, rotations = _frames(arm, inputs, self.values[: len(arm.names)], mount, rates=False)
        return se3.pose(rotations, origins)

    def _place(self, view: _View) -> None:
        """Place the camera and the board of a view, those that are not known yet."""
        camera, board = self.known.get(("camera", view.camera)), self.known.get(("board", view.board))
        if camera is None and board is None:
            camera, board = _solved(view)
        elif camera is None:
            assert board is not None
            camera = mean_pose(se3.inverse(view.As) @ board @ view.Bs)
        elif board is None:
            board = mean_pose(view.As @ camera @ se3.inverse(view.Bs))
        self.known[("camera", view.camera)], self.known[("board", view.board)] = camera, board


def _solved(view: _View) -> tuple[Array, Array]:
    """Return camera and board ``(4, 4)`` by the better of two closed forms, without the pictures that it misses."""
    As, Bs = view.As, view.Bs
    for _ in range(2):
        if len(As) < _LEAST_VIEWS or not view.moves:
            return np.eye(4), mean_pose(As @ se3.inverse(Bs))
        tried = [robot_world(As, Bs)]
        camera = hand_eye(As, Bs)
        tried.append((camera, mean_pose(As @ camera @ se3.inverse(Bs))))
        errors = [_missed(As, Bs, *each) for each in tried]
        best = int(np.argmin([np.median(each) for each in errors]))
        near = errors[best] <= _FAR_OFF * np.median(errors[best])
        if near.all() or near.sum() < _LEAST_VIEWS:
            break
        As, Bs = As[near], Bs[near]
    return tried[best]


def _missed(As: Array, Bs: Array, X: Array, Z: Array) -> Array:
    """Return the distances ``(v,)`` (m) between the cameras' places by ``A X`` and by ``Z B``."""
    return np.asarray(np.linalg.norm((As @ X - Z @ Bs)[:, :3, 3], axis=1))
