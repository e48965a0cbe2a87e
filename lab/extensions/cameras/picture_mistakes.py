"""Miss pictures of boards by a nominal arm, placed robustly among them, and find what may be wrong with them.

Each picture gives its board's pose in the camera. Cameras and boards are placed in pairs by ``A X = Z B`` (Shah 2013)
from several subsets of the pictures at once, refined on the pictures near the majority (Rousseeuw & Van Driessen 2006).
A picture is missed by the distance, across the line of sight, between the board as seen and as the arm places it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.diagnosis.hypothesis import Hypothesis, unchanged
from lab.extensions.cameras.closed_forms import board_poses, robot_worlds
from lab.extensions.cameras.geometry import sight_lines
from lab.extensions.cameras.rig import HAND, PX, WORLD, Board, Camera, Rig
from lab.kinematics.model import Model
from lab.sensors.tip import tip_origins, tip_rotations

__all__ = ["Pictures", "PlacedPictures", "picture_mistakes", "placed_pictures"]

_SUBSETS, _SUBSET_PICTURES = 40, 4
_REFINED = 4  # of the subsets, the best
_LEAST_PICTURES = 4  # that place a camera and a board
_ROUNDS = 3  # on the pictures near the majority
_NEAR, _CAP = 2.5, 3.0  # times the median miss
_LEAST_M = 1e-5
_BLURRED = 10.0  # times the median residual of a board's pose: its corners are not where their numbers say
_CLEARLY = 3.0  # times as small a miss, of a picture that is read otherwise
_SHIFTS = (1, -1, 2, -2)
_MOST_PAIRS = 3  # of exchanged pictures, the likeliest
_RATIOS = 20  # that a ratio is chosen from
_PLAUSIBLE = (0.01, 100.0)  # ratios
_RATIO = 0.01  # of a focal length or a square: nearer to one, another explains it


@dataclass(frozen=True, eq=False)
class Pictures:
    """Pictures of one board by one camera each.

    Attributes:
        view: ``(n,)`` picture of each row; -1 without a place.
        first, middle: ``(v,)`` rows of each picture.
        pose: ``(v,)`` number of the arm's pose that each was taken in, and ``(n,)`` that of each row.
        camera, board: ``(v,)`` indices in the rig.
        Ts: ``(v, 4, 4)`` m, the board in the camera; NaN where too few corners are seen, or those of no board.
    """

    view: NDArray[np.int_]
    first: NDArray[np.int_]
    middle: NDArray[np.int_]
    pose: NDArray[np.int_]
    pose_of_row: NDArray[np.int_]
    camera: NDArray[np.int_]
    board: NDArray[np.int_]
    Ts: Array

    @staticmethod
    def of(rig: Rig, data: Measurements, numbers: NDArray[np.int_], seen: NDArray[np.bool_]) -> "Pictures":
        """Return the pictures in measurements.

        Args:
            numbers: ``(n,)`` of each row's corner in the rig.
            seen: ``(n,)`` rows with a place in a picture.
        """
        camera, board, corner = rig.parts(numbers)
        _, poses = np.unique(data.joints, axis=0, return_inverse=True)
        rows = np.flatnonzero(seen)
        keys = np.column_stack([poses, camera, board])[rows]
        _, first, view_of = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        rank = np.argsort(np.argsort(first))  # in the order of the file
        view = np.full(len(data), -1)
        view[rows] = rank[view_of]
        first = rows[np.sort(first)]
        order = np.argsort(view[rows], kind="stable")
        starts = np.searchsorted(view[rows][order], np.arange(len(first)))
        counts = np.diff([*starts, len(rows)])
        middle = rows[order][starts + counts // 2]
        pose_rank = np.unique(poses[first], return_inverse=True)[1]
        by_pose = np.argsort(np.argsort([int(first[pose_rank == i].min()) for i in range(pose_rank.max() + 1)]))
        pose = by_pose[pose_rank]
        pose_of_row = np.where(view >= 0, pose[view], -1)
        places = np.asarray(PX.to_si(np.column_stack([data.conditions["u_px"], data.conditions["v_px"]])))
        Ts = np.full((len(first), 4, 4), np.nan)
        for i, j in product(range(len(rig.cameras)), range(len(rig.boards))):
            own = np.flatnonzero((camera[first] == i) & (board[first] == j))
            if len(own):
                Ts[own] = _board_poses(rig.cameras[i], rig.boards[j], (own, view, corner, places))
        return Pictures(view, first, middle, pose, pose_of_row, camera[first], board[first], Ts)


def _board_poses(
    camera: Camera, board: Board, seen: tuple[NDArray[np.int_], NDArray[np.int_], NDArray[np.int_], Array]
) -> Array:
    """Return a board's poses ``(m, 4, 4)`` in a camera, in some pictures; NaN where these show no such board."""
    own, view, corner, places = seen
    rows = np.flatnonzero(np.isin(view, own))
    flat = np.full((len(own), len(board), 2), np.nan)
    flat[np.searchsorted(own, view[rows]), corner[rows]] = sight_lines(places[rows], camera.intrinsic_values)
    Ts, residual = board_poses(board.corners, flat)
    known = np.isfinite(residual)
    if known.any():
        strange = (residual[known] > _BLURRED * np.median(residual[known])) | (Ts[known, 2, 3] <= 0)
        Ts[np.flatnonzero(known)[strange]] = np.nan
    return Ts


@dataclass(frozen=True, eq=False)
class _Pair:
    """Pictures of one board by one camera: where both are placed, and by which pictures.

    Attributes:
        views: ``(m,)`` numbers of the pictures with a board's pose.
        seen: ``(m, c, 3)`` m, marks of the board as seen in the camera.
        marks: ``(c, 4)`` m, of the board in its frame.
        X, Z: ``(4, 4)`` camera and board, in what carries them.
        misses: ``(m,)`` m.
    """

    views: NDArray[np.int_]
    Bs: Array
    seen: Array
    marks: Array
    X: Array
    Z: Array
    misses: Array

    def at(self, As: Array, seen: Array | None = None) -> Array:
        """Return the misses ``(..., m)`` with other ``A`` ``(..., m, 4, 4)`` or other marks than seen."""
        return _misses(As, self.X, self.Z, self.seen if seen is None else seen, self.marks)


@dataclass(frozen=True, eq=False)
class PlacedPictures:
    """A nominal arm with cameras and boards placed by most pictures.

    Attributes:
        As: ``(v, 4, 4)`` m, the frame that carries the camera in that which carries the board, of each picture.
        pairs: by camera and board.
        misses: ``(v,)`` m, NaN where the board's pose is not known.
    """

    pictures: Pictures
    As: Array
    pairs: Mapping[tuple[int, int], _Pair]
    misses: Array

    @property
    def ordinary_m(self) -> float:
        """Miss of a picture like most others (m)."""
        known = self.misses[np.isfinite(self.misses)]
        return max(float(np.median(known)) if len(known) else _LEAST_M, _LEAST_M)


def placed_pictures(rig: Rig, pictures: Pictures, arm: Model, data: Measurements, nominal: Array) -> PlacedPictures:
    """Place each camera and board by pictures of which a part may be wrong; links stay nominal.

    Args:
        arm: measured by points.
        nominal: ``(p,)`` nominal parameters of ``arm``.
    """
    inputs = data.inputs(arm.conditions)[pictures.middle]
    As = _carriers(rig, pictures, arm, inputs, nominal)
    used = data.used[pictures.middle]
    pairs, misses = {}, np.full(len(As), np.nan)
    for i, j in rig.pairs:
        own = (pictures.camera == i) & (pictures.board == j) & used
        known = np.flatnonzero(own & np.isfinite(pictures.Ts).all(axis=(1, 2)))
        if len(known) < _LEAST_PICTURES:
            continue
        pairs[i, j] = _placed(known, As[known], pictures.Ts[known], rig.boards[j])
        misses[known] = pairs[i, j].misses
    return PlacedPictures(pictures, As, pairs, misses)


def _carriers(rig: Rig, pictures: Pictures, arm: Model, inputs: Array, nominal: Array) -> Array:
    """Return the poses ``(v, 4, 4)`` of what carries the camera in the frame of what carries the board."""
    frames: dict[int | None, Array] = {None: np.broadcast_to(np.eye(4), (len(inputs), 4, 4))}
    points = arm.points(inputs, nominal)
    mounts = [[rig.mount(part, arm.targets) for part in parts] for parts in (rig.cameras, rig.boards)]
    for mount in {each for own in mounts for each in own if each is not None}:
        rotations = tip_rotations(arm, inputs, nominal, points, mount)
        frames[mount] = se3.pose(rotations, tip_origins(arm, nominal, points, rotations, mount))
    As = np.empty((len(inputs), 4, 4))
    for i, j in set(zip(pictures.camera.tolist(), pictures.board.tolist(), strict=True)):
        own = (pictures.camera == i) & (pictures.board == j)
        As[own] = se3.inverse(frames[mounts[1][j]][own]) @ frames[mounts[0][i]][own]
    return As


def _marks(board: Board) -> Array:
    """Return the ends of a board's three directions ``(6, 4)``, m in homogeneous coordinates."""
    corners = board.corners
    spread, axes = np.linalg.svd(corners - corners.mean(axis=0))[1:]
    ends = (spread / np.sqrt(len(corners)))[:, None] * axes
    return np.column_stack([corners.mean(axis=0) + np.concatenate([ends, -ends]), np.ones(6)])


def _misses(As: Array, X: Array, Z: Array, seen: Array, marks: Array) -> Array:
    """Return the root mean square of a coordinate's error across the line of sight, ``(..., m)`` m."""
    predicted = (se3.inverse(As @ X) @ Z) @ marks.T
    off = np.swapaxes(predicted[..., :3, :], -1, -2) - seen
    along = seen / np.linalg.norm(seen, axis=-1, keepdims=True)
    across = off - (off * along).sum(axis=-1, keepdims=True) * along
    return np.asarray(np.sqrt((across**2).sum(axis=-1).mean(axis=-1) / 2))


def _placed(views: NDArray[np.int_], As: Array, Ts: Array, board: Board) -> _Pair:
    """Place one camera and one board by pictures: the best of several subsets, by capped misses."""
    marks, Bs = _marks(board), se3.inverse(Ts)
    seen = np.swapaxes((Ts @ marks.T)[:, :3], 1, 2)
    # subsets of pictures: all, then random ones
    rng, n = rng_for(0, "null"), len(views)
    weights = np.zeros((1 + _SUBSETS, n))
    weights[0] = 1.0
    for mask in weights[1:]:
        mask[rng.permutation(n)[: min(_SUBSET_PICTURES, n)]] = 1.0
    for _ in range(1 + _ROUNDS):
        X, Z = robot_worlds(As, Bs, weights)
        misses = np.nan_to_num(_misses(As, X[:, None], Z[:, None], seen, marks), nan=np.inf)
        middle = np.maximum(np.median(misses, axis=1, keepdims=True), _LEAST_M)
        # the best few go on, by the pictures near their majority
        costs = (np.minimum(misses, _CAP * float(middle.min())) ** 2).sum(axis=1)
        best = np.argsort(costs, kind="stable")[:_REFINED]
        weights = (misses[best] <= _NEAR * middle[best]).astype(np.float64)
    return _Pair(views, Bs, seen, marks, X[best[0]], Z[best[0]], misses[best[0]])


def picture_mistakes(sensor: Any, at: PlacedPictures, data: Measurements) -> Iterator[Hypothesis]:
    """Yield what may be wrong with pictures.

    Args:
        sensor: of the pictures.
        at: the nominal arm among them.
    """
    yield from _turned(sensor.rig, at, data)
    yield from _exchanged(at, data)
    yield from _shifted(at, data)
    yield from _mounted(sensor)
    yield from _scaled(sensor, at)


def _turns(board: Board) -> list[tuple[str, NDArray[np.int_]]]:
    """Return the turns of a board that its pattern does not show, each as the numbers that its corners then have."""
    if board.kind != "checkerboard":
        return []
    grid = np.arange(len(board)).reshape(board.rows, board.columns)
    turns = {"half": 2} if board.rows != board.columns else {"half": 2, "quarter": 1, "three-quarter": 3}
    return [(name, np.rot90(grid, by).ravel()) for name, by in turns.items()]


def _turned(rig: Rig, at: PlacedPictures, data: Measurements) -> Iterator[Hypothesis]:
    """Yield pictures whose corners are numbered from another corner of the board."""
    pictures = at.pictures
    for (_, j), pair in at.pairs.items():
        for name, numbers in _turns(rig.boards[j]):
            # corner c, as numbered, is corner numbers[c] of the board
            corners = rig.boards[j].corners
            turn = _motion(corners, corners[numbers])
            seen = np.swapaxes((pictures.Ts[pair.views] @ se3.inverse(turn) @ pair.marks.T)[:, :3], 1, 2)
            there = pair.at(at.As[pair.views], seen)
            better = (_CLEARLY * np.maximum(there, at.ordinary_m) < pair.misses) | (_CLEARLY * there < pair.misses)
            better &= pair.misses > _CLEARLY * at.ordinary_m
            if not (k := int(better.sum())) or k > len(better) / 2:
                continue
            views = pair.views[better]
            undo = partial(_renumbered, rows=np.isin(pictures.view, views), numbers=numbers)
            ids = tuple(data.ids[row] for row in pictures.first[views])
            of = tuple(_named_picture(data, row) for row in pictures.first[views])
            more = (("turn", name), ("rows", ids))
            yield Hypothesis("board_turned", of, comb(len(better), k), undo, data=more)


def _motion(before: Array, after: Array) -> Array:
    """Return the rigid motion ``(4, 4)`` that takes points ``(c, 3)`` to others."""
    a, b = before - before.mean(axis=0), after - after.mean(axis=0)
    R = se3.nearest_rotation(b.T @ a)
    return se3.pose(R, after.mean(axis=0) - R @ before.mean(axis=0))


def _renumbered(data: Measurements, rows: NDArray[np.bool_], numbers: NDArray[np.int_]) -> Measurements:
    cells = list(data.other["corner"])
    for row in np.flatnonzero(rows).tolist():
        cells[row] = str(int(numbers[int(cells[row])]))
    return replace(data, other={**data.other, "corner": tuple(cells)})


def _named_picture(data: Measurements, row: int) -> str:
    """Return the name of a row's picture: in its column, else the row's."""
    for column in ("image", "picture"):
        if column in data.other:
            return data.other[column][row]
    return data.ids[row]


def _exchange_costs(at: PlacedPictures) -> Array:
    """Return the costs ``(p, p)`` (m²) of the pictures of each pose of the arm, taken in each pose instead."""
    count, cap = int(at.pictures.pose.max()) + 1, (10 * at.ordinary_m) ** 2
    costs = np.zeros((count, count))
    for pair in at.pairs.values():
        As, pose = at.As[pair.views], at.pictures.pose[pair.views]
        own = np.full((count, count), np.inf)
        own[pose[:, None], pose] = (pair.at(As[:, None]) ** 2).T
        seen = np.isin(np.arange(count), pose)
        costs[seen] += np.minimum(own[seen], cap)
    return costs


def _with_joints_of(rows: Measurements, pose_of_row: NDArray[np.int_], wanted: NDArray[np.int_]) -> Measurements:
    """Return the rows with the joint positions of other poses ``(p,)``; those that have none are skipped.

    Args:
        pose_of_row: ``(n,)``, -1 of a row without a place in a picture.
        wanted: of each pose, the pose whose joint positions it takes; beyond the last there are none.
    """
    first = np.array([int(np.argmax(pose_of_row == pose)) for pose in range(len(wanted))])
    within = (wanted >= 0) & (wanted < len(wanted))
    joints = rows.joints[first[np.where(within, wanted, np.arange(len(wanted)))]]
    in_pose = pose_of_row >= 0
    use = tuple("skip" if of >= 0 and not within[of] else each for of, each in zip(pose_of_row, rows.use, strict=True))
    return replace(rows, joints=np.where(in_pose[:, None], joints[pose_of_row], rows.joints), use=use)


def _names_of_poses(at: PlacedPictures, data: Measurements) -> list[str]:
    first = [int(at.pictures.first[at.pictures.pose == i].min()) for i in range(int(at.pictures.pose.max()) + 1)]
    return [_named_picture(data, row) for row in first]


def _exchanged(at: PlacedPictures, data: Measurements) -> Iterator[Hypothesis]:
    """Yield pairs of poses whose pictures, or joint positions, are exchanged."""
    costs, names = _exchange_costs(at), _names_of_poses(at, data)
    count = len(costs)
    own = np.diag(costs)
    better = _CLEARLY**2 * costs < own[:, None]
    gain = np.where(better & better.T, own[:, None] + own - costs - costs.T, 0.0)
    found = [divmod(int(i), count) for i in np.argsort(-np.triu(gain, 1), axis=None)[:_MOST_PAIRS]]
    for a, b in found:
        if gain[a, b] <= 0:
            break
        wanted = np.arange(count)
        wanted[[a, b]] = b, a
        undo = partial(_with_joints_of, pose_of_row=at.pictures.pose_of_row, wanted=wanted)
        yield Hypothesis("pictures_exchanged", (names[a], names[b]), comb(count, 2), undo)


def _shifted(at: PlacedPictures, data: Measurements) -> Iterator[Hypothesis]:
    """Yield pictures that were taken in the pose before or after, all of them or from one on."""
    costs, names = _exchange_costs(at), _names_of_poses(at, data)
    count = len(costs)
    for by in _SHIFTS:
        if abs(by) >= count:
            continue
        there = np.arange(count) + by
        inside = (there >= 0) & (there < count)
        gain = np.where(inside, np.diag(costs) - costs[np.arange(count), np.clip(there, 0, count - 1)], 0.0)
        start = int(np.argmax(np.cumsum(gain[::-1])[::-1]))
        for first in {0, start}:
            wanted = np.where(np.arange(count) >= first, there, np.arange(count))
            undo = partial(_with_joints_of, pose_of_row=at.pictures.pose_of_row, wanted=wanted)
            of = (f"{by:+d}", *([names[first]] if first else []))
            yield Hypothesis("pictures_shifted", of, len(_SHIFTS) * (count if first else 1), undo)


def _mounted(sensor: Any) -> Iterator[Hypothesis]:
    """Yield that cameras and boards are fixed the other way round, in the hand and in the room."""
    rig, other = sensor.rig, {HAND: WORLD, WORLD: HAND}
    if any(part.fixed_to not in other for part in (*rig.cameras, *rig.boards)):
        return
    turned = replace(
        rig,
        cameras=tuple(replace(part, fixed_to=other[part.fixed_to]) for part in rig.cameras),
        boards=tuple(replace(part, fixed_to=other[part.fixed_to]) for part in rig.boards),
    )
    of = tuple(part.name for part in rig.cameras)
    yield Hypothesis("camera_mount", of, 2, unchanged, replace(sensor, rig=turned))


def _scaled(sensor: Any, at: PlacedPictures) -> Iterator[Hypothesis]:
    """Yield other focal lengths of a camera, and other squares of a board, by their ratio to the given ones."""
    rig = sensor.rig
    for i, camera in enumerate(rig.cameras):
        pairs = [pair for (which, _), pair in at.pairs.items() if which == i]
        if pairs and camera.intrinsics == "fixed":
            ratio = _ratio(pairs, at.As, depth_alone=True)
            yield from _of_ratio(
                "focal_length", camera.name, len(rig.cameras), ratio, _with_focal_length(sensor, i, ratio)
            )
    for j, board in enumerate(rig.boards):
        pairs = [pair for (_, which), pair in at.pairs.items() if which == j]
        if pairs and np.isfinite(board.size_u):
            ratio = _ratio(pairs, at.As, depth_alone=False)
            yield from _of_ratio("square_size", board.name, len(rig.boards), ratio, _with_squares(sensor, j, ratio))


def _of_ratio(name: str, part: str, parts: int, ratio: float, other: Any) -> Iterator[Hypothesis]:
    if abs(ratio - 1) > _RATIO:
        yield Hypothesis(name, (part,), _RATIOS * parts, unchanged, other, data=(("ratio", ratio),))


def _ratio(pairs: Sequence[_Pair], As: Array, *, depth_alone: bool) -> float:
    """Return the ratio by which all distances of boards, or their depths alone, fit the arm; 1 where they do not tell.

    With the rotations of X and Z, their places and the ratio s are linear in R_A t_X - s R_Z t_B - t_Z = -t_A.
    """
    found = list[float]()
    for pair in pairs:
        A, near = As[pair.views], np.ones(len(pair.views), dtype=np.bool_)
        R_board_camera = pair.Bs[:, :3, :3]
        place = -np.swapaxes(R_board_camera, 1, 2) @ pair.Bs[:, :3, 3, None]  # the board in the camera
        grows = place * [[0.0], [0.0], [1.0]] if depth_alone else place
        stays = place - grows
        by_ratio, fixed = (-(pair.Z[:3, :3] @ R_board_camera @ each)[..., 0] for each in (grows, stays))
        for _ in range(_ROUNDS):
            n = int(near.sum())
            rows = np.concatenate(
                [A[near, :3, :3], np.broadcast_to(-np.eye(3), (n, 3, 3)), -by_ratio[near, :, None]], axis=2
            )
            right = fixed[near] - A[near, :3, 3]
            solved, _, rank, _ = np.linalg.lstsq(rows.reshape(-1, 7), right.ravel())
            if rank < 7:
                break
            left = A[:, :3, :3] @ solved[:3] - solved[3:6] - solved[6] * by_ratio - fixed + A[:, :3, 3]
            size = np.linalg.norm(left, axis=1)
            near = size <= _NEAR * max(float(np.median(size)), _LEAST_M)
        else:
            found.append(float(solved[6]))
    ratio = float(np.median(found)) if found else 1.0
    return ratio if _PLAUSIBLE[0] < ratio < _PLAUSIBLE[1] else 1.0


def _with_focal_length(sensor: Any, camera: int, ratio: float) -> Any:
    own = sensor.rig.cameras[camera]
    changed = replace(own, focal_px=tuple(ratio * each for each in own.focal_px))
    cameras = tuple(changed if i == camera else each for i, each in enumerate(sensor.rig.cameras))
    return replace(sensor, rig=replace(sensor.rig, cameras=cameras))


def _with_squares(sensor: Any, board: int, ratio: float) -> Any:
    own = sensor.rig.boards[board]
    points = tuple(tuple(ratio * each for each in point) for point in own.points_mm)
    lengths = {key: ratio * getattr(own, key) for key in ("square_mm", "tag_mm", "gap_mm", "marker_mm")}
    boards = tuple(
        replace(own, points_mm=points, **lengths) if j == board else each for j, each in enumerate(sensor.rig.boards)
    )
    return replace(sensor, rig=replace(sensor.rig, boards=boards))
