"""Plan the shortest measurement session: a closed tour from home through all poses and back.

A move is the fastest straight path of the joint positions in which all joints begin, cruise and end together, at rest
at both ends (``kinematics.trajectory.profiles``). Only moves of a candidate tour are checked for collisions. A move
that is not free is replaced by the fastest detour through other free poses; the order is then optimized again with the
corrected costs. Costs only rise, so an order that is best among costs of which all of its own are checked is best
among the true ones.

Tours over the symmetric cost matrix are improved by 2-opt, Or-opt and kicks, many at once: k tours over m nodes are an
array ``(k, m)``, each row a permutation (Lin & Kernighan 1973 and Or 1976 for the moves; Martin, Otto & Felten 1991 for
the double bridge as a kick).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
import scipy  # its parts are loaded at their first use
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.progress import Progress, no_progress
from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec
from lab.kinematics.trajectory.profiles import Trajectory, joined, rest_to_rest_seconds
from lab.kinematics.trajectory.trajectory import common_phases

__all__ = [
    "DEFAULT_SLIDE_SPEED",
    "DEFAULT_SPEED",
    "FULL_SPEED_S",
    "FreePath",
    "RoadmapGraph",
    "Tour",
    "double_bridge",
    "fastest_path",
    "improve",
    "lengths",
    "move_seconds",
    "one_after_another",
    "plan_tour",
    "random_starts",
    "rated",
    "tour_trajectory",
    "waypoints_in_order",
    "with_reference",
]

_Indices = NDArray[np.int_]
_STARTS = 24
_MAX_SEGMENT = 3
_GAIN = 1e-12


def lengths(cost: Array, tours: _Indices) -> Array:
    """Return the length ``(k,)`` of each closed tour."""
    total: Array = cost[tours, np.roll(tours, -1, axis=1)].sum(axis=1)
    return total


def random_starts(cost: Array, rng: np.random.Generator, count: int = _STARTS) -> _Indices:
    """Draw tours ``(count, m)``: half by nearest neighbour from different nodes, node 0 first, half random."""
    size = len(cost)
    starts = np.append(0, rng.permutation(np.arange(1, size)))[: max(1, count // 2)]
    nearest = [_nearest_neighbour(cost, int(start)) for start in starts]
    return np.array([*nearest, *(rng.permutation(size) for _ in range(count - len(nearest)))])


def improve(cost: Array, tours: _Indices) -> _Indices:
    """Apply the best 2-opt or Or-opt move to each tour until none shortens it."""
    tours = tours.copy()
    if tours.shape[1] < 4:
        return tours  # three nodes have one tour
    active = np.arange(len(tours))
    while len(active):
        moved, gained = _best_move(cost, tours[active])
        tours[active[gained]] = moved[gained]
        active = active[gained]
    return tours


def double_bridge(tours: _Indices, rng: np.random.Generator) -> _Indices:
    """Exchange two neighbouring stretches of each tour (a double bridge)."""
    size = tours.shape[1]
    if size < 5:
        return tours
    kicks = []
    for tour in tours:
        a, b, c = np.sort(rng.choice(np.arange(1, size), 3, replace=False))
        kicks.append(np.concatenate([tour[:a], tour[b:c], tour[a:b], tour[c:]]))
    return np.array(kicks)


def _nearest_neighbour(cost: Array, start: int) -> _Indices:
    tour, left = [start], np.ones(len(cost), dtype=bool)
    left[start] = False
    while left.any():
        tour.append(int(np.argmin(np.where(left, cost[tour[-1]], np.inf))))
        left[tour[-1]] = False
    return np.array(tour)


def _best_move(cost: Array, tours: _Indices) -> tuple[_Indices, NDArray[np.bool_]]:
    moved, changes = tours.copy(), []
    between = cost[tours[:, :, None], tours[:, None, :]]  # (k, m, m)
    kinds = [(0, False), *product(range(1, min(_MAX_SEGMENT, tours.shape[1] - 3) + 1), (False, True))]
    for length, turned in kinds:
        change = _or_change(between, length, turned) if length else _two_opt_change(between)
        changes.append(change.reshape(len(tours), -1))
    best = np.array([change.argmin(axis=1) for change in changes])  # (kinds, k)
    value = np.array([change.min(axis=1) for change in changes])
    kind, shorter = value.argmin(axis=0), value.min(axis=0) < -_GAIN
    for row in np.flatnonzero(shorter):
        i, j = divmod(int(best[kind[row], row]), tours.shape[1])
        length, turned = kinds[kind[row]]
        moved[row] = _or_moved(tours[row], i, j, length, turned) if length else _reversed(tours[row], i, j)
    return moved, shorter


def _two_opt_change(between: Array) -> Array:
    """Return the changes ``(k, m, m)`` of length from replacing legs i and j by (i, j) and (i + 1, j + 1)."""
    leg = _legs(between)
    change: Array = between + np.roll(between, (-1, -1), (1, 2)) - leg[:, :, None] - leg[:, None, :]
    at = np.arange(between.shape[1])
    change[:, at, at] = np.inf
    return change


def _or_change(between: Array, length: int, turned: bool) -> Array:
    """Return the changes ``(k, m, m)`` from moving the segment at i between j and j + 1; inf if j is in it."""
    size, at = between.shape[1], np.arange(between.shape[1])
    before, last, after = (at - 1) % size, (at + length - 1) % size, (at + length) % size
    leg = _legs(between)
    closed = between[:, before, after] - leg[:, before] - leg[:, last]  # (k, m): the segment taken out
    first_end, second_end = (last, at) if turned else (at, last)
    opened = between[:, first_end] + np.roll(between[:, second_end], -1, axis=2) - leg[:, None, :]
    change: Array = closed[:, :, None] + opened
    change[:, (at[None] - before[:, None]) % size <= length] = np.inf
    return change


def _legs(between: Array) -> Array:
    at = np.arange(between.shape[1])
    legs: Array = between[:, at, np.roll(at, -1)]
    return legs


def _reversed(tour: _Indices, i: int, j: int) -> _Indices:
    i, j = min(i, j), max(i, j)
    return np.concatenate([tour[: i + 1], tour[j:i:-1], tour[j + 1 :]])


def _or_moved(tour: _Indices, i: int, j: int, length: int, turned: bool) -> _Indices:
    around = np.roll(tour, -i)
    segment, rest = around[:length], around[length:]
    cut = (j - i) % len(tour) - length + 1
    return np.concatenate([rest[:cut], segment[::-1] if turned else segment, rest[cut:]])


DEFAULT_SPEED = np.pi  # rad/s; small arms' axes reach 2.5 to 7
DEFAULT_SLIDE_SPEED = 0.5  # m/s
FULL_SPEED_S = 0.3  # to full speed, for a joint without a given acceleration
FreePath = Callable[[Array, Array], bool]
_PATIENCE = 20  # rounds of kicks without a shorter tour
_GAIN_S = 1e-9


@dataclass(frozen=True)
class Tour:
    """A closed tour.

    Attributes:
        order: ``(m,)``, the poses in the order in which they are first measured.
        waypoints: ``(s, n)`` joint positions to move to one after the other: home, poses and detours' poses, home.
        measured: ``(s,)``, the pose measured at each waypoint, -1 for none.
        seconds: time of all moves, without measuring.
        breaks: waypoints at home, between the first and the last, at which the instrument is moved.
    """

    order: _Indices
    waypoints: Array
    measured: _Indices
    seconds: float
    breaks: tuple[int, ...] = ()

    @property
    def via(self) -> int:
        """Number of waypoints without a measurement, except home."""
        return int((self.measured[1:-1] < 0).sum()) - len(self.breaks)

    def among(self, poses: _Indices) -> "Tour":
        """Return the tour with the poses' numbers ``(m,)`` among more poses."""
        return replace(self, order=poses[self.order], measured=np.where(self.measured < 0, -1, poses[self.measured]))


def one_after_another(tours: Sequence[Tour]) -> Tour:
    """Join tours from home to home into one, with stops at home between them."""
    waypoints = np.concatenate([tours[0].waypoints, *(tour.waypoints[1:] for tour in tours[1:])])
    measured = np.concatenate([tours[0].measured, *(tour.measured[1:] for tour in tours[1:])])
    breaks = np.cumsum([len(tour.waypoints) - 1 for tour in tours[:-1]], dtype=np.int_).tolist()
    order, seconds = np.concatenate([tour.order for tour in tours]), sum(tour.seconds for tour in tours)
    return Tour(order, waypoints, measured, seconds, tuple(breaks))


class RoadmapGraph:
    """Cost of moving between home (node 0) and the poses (nodes 1 to m), as far as computed.

    Detours pass through home, through ``safe`` poses, or through poses of the plan.
    """

    def __init__(
        self,
        joints: Array,
        speed: Array,
        acceleration: Array,
        free: FreePath,
        home: Array | None = None,
        safe: Array | None = None,
    ) -> None:
        """Set up nodes from joints ``(m, n)``, home ``(n,)`` (zero by default) and safe ``(k, n)``."""
        size = joints.shape[1]
        start = np.zeros(size) if home is None else home
        extra = np.empty((0, size)) if safe is None else safe
        self.nodes = np.concatenate([start[None], joints, extra])
        self.count = 1 + len(joints)
        self._free, self._checked = free, np.eye(len(self.nodes), dtype=bool)
        self._graph = move_seconds(self.nodes, speed, acceleration)  # inf: not free
        self.cost = self._graph[: self.count, : self.count].copy()  # (m + 1, m + 1): direct until checked
        self._settled = np.eye(self.count, dtype=bool)
        self._routes: dict[tuple[int, int], tuple[int, ...]] = {}

    def settle(self, a: int, b: int) -> bool:
        """Make the cost of the move between two nodes true; False if it was already."""
        if self._settled[a, b]:
            return False
        a, b = min(a, b), max(a, b)
        route = self.fastest(a, b)
        self._routes[a, b] = route
        self._settled[a, b] = self._settled[b, a] = True
        self.cost[a, b] = self.cost[b, a] = sum(self._graph[i, j] for i, j in pairwise(route))
        return True

    def settle_tour(self, tour: _Indices) -> bool:
        """Make the costs of all moves of a closed tour ``(m + 1,)``; False if all were already true."""
        changed = [self.settle(int(a), int(b)) for a, b in zip(tour, np.roll(tour, -1), strict=True)]
        return any(changed)

    def seconds(self, order: _Indices) -> float:
        """Return the duration of the tour that measures the poses in this order."""
        tour = np.append(0, np.asarray(order) + 1)
        self.settle_tour(tour)
        return float(lengths(self.cost, tour[None])[0])

    def tour(self, order: _Indices) -> Tour:
        """Return the tour that measures the poses in this order, detours included."""
        seconds, waypoints, measured = self.seconds(order), [0], [-1]
        nodes = [0, *(np.asarray(order) + 1).tolist(), 0]
        for a, b in pairwise(nodes):
            route = self._routes.get((min(a, b), max(a, b)), (a, b))
            waypoints += route[1:] if route[0] == a else route[-2::-1]
            measured += [-1] * (len(route) - 2) + [b - 1]
        return Tour(np.asarray(order), self.nodes[waypoints], np.array(measured), seconds)

    def fastest(self, a: int, b: int) -> tuple[int, ...]:
        """Return the nodes on the fastest free path; only moves on candidate fastest paths are checked."""
        while True:
            route = self._shortest(a, b)
            blocked = [leg for leg in pairwise(route) if not self._is_free(*leg)]
            if not blocked:
                return route

    def _shortest(self, a: int, b: int) -> tuple[int, ...]:
        """Return the nodes on the shortest path from a to b by the present costs."""
        if np.isfinite(self._graph[a, b]):
            return a, b  # the direct move is never slower than one through another node
        far, previous = scipy.sparse.csgraph.dijkstra(self._graph, directed=False, indices=a, return_predecessors=True)
        if not np.isfinite(far[b]):
            raise LabError(
                f"no free way to {self._cut_off(a, b)}, through any of {len(self.nodes)} places: "
                "give more safe poses, another home, or leave that pose out"
            )
        path = [b]
        while path[-1] != a:
            path.append(int(previous[path[-1]]))
        return tuple(reversed(path))

    def _cut_off(self, a: int, b: int) -> str:
        """Return the unreachable one of two nodes without a path between them."""
        if np.isfinite(self._graph[0]).sum() == 1:
            return "home"
        far = scipy.sparse.csgraph.dijkstra(self._graph, directed=False, indices=0)
        return f"pose {(b if np.isfinite(far[a]) else a) - 1}"

    def _is_free(self, a: int, b: int) -> bool:
        if not self._checked[a, b]:
            self._checked[a, b] = self._checked[b, a] = True
            if not self._free(self.nodes[min(a, b)], self.nodes[max(a, b)]):
                self._graph[a, b] = self._graph[b, a] = np.inf
        return bool(np.isfinite(self._graph[a, b]))


def fastest_path(start: Array, end: Array, safe: Array, chain: JointSpec, free: FreePath) -> Array:
    """Return the fastest free path between two joint positions ``(n,)``, straight or through others.

    Args:
        safe: ``(k, n)`` joint positions that a detour may pass through.
        chain: with known rates (``rated``).
        free: whether the straight joint path between two joint positions is free, the same both ways.

    Returns:
        Joint positions ``(s, n)``: the start, those in between, and the end.

    Raises:
        LabError: there is no free path.
    """
    roads = RoadmapGraph(end[None], chain.speed, chain.acceleration, free, start, safe)
    return roads.nodes[list(roads.fastest(0, 1))]


def waypoints_in_order(
    joints: Array, safe: Array, chain: JointSpec, free: FreePath, progress: Progress = no_progress
) -> tuple[Array, _Indices]:
    """Find a free path from home through poses in the given order, and home again.

    Args:
        joints: ``(n, joints)``, each with a free path to it.
        safe: ``(k, joints)`` home, and further joint positions that a detour may pass through.
        chain: with known rates (``rated``).
        free: whether the straight joint path between two joint positions is free.
        progress: called with the number of checked paths.

    Returns:
        Joint positions ``(s, joints)`` to move to one after the other, each in a straight line of all joints, and
        ``(s,)`` the pose of each, -1 for home and detours.
    """
    home, stored = safe[0], dict[bytes, bool]()

    def once(start: Array, end: Array) -> bool:
        key = start.tobytes() + end.tobytes()
        if key not in stored:
            stored[key] = free(start, end)
        return stored[key]

    nodes = np.concatenate([home[None], joints, home[None]])

    waypoints, which = [home[None]], [np.array([-1])]
    for i in range(len(joints) + 1):
        progress(i, len(joints) + 1)
        path = fastest_path(nodes[i], nodes[i + 1], safe, chain, once)[1:]
        waypoints.append(path)
        which.append(np.append(np.full(len(path) - 1, -1), i if i < len(joints) else -1))
    return np.concatenate(waypoints), np.concatenate(which)


def with_reference(tour: Tour, every: int, safe: Array, chain: JointSpec, free: FreePath) -> Tour:
    """Return the tour with its first pose measured again after every so many poses, and last.

    Args:
        tour: from home to home.
        every: number of poses.
        safe: ``(k, n)`` joint positions that a detour may pass through.
        chain: with known rates (``rated``).
        free: whether the straight joint path between two joint positions is free, the same both ways.

    Raises:
        LabError: there is no free path.
    """
    places = np.flatnonzero(tour.measured >= 0)
    reference = tour.waypoints[places[0]]
    waypoints, measured = [tour.waypoints[: places[0]]], tour.measured[: places[0]].tolist()
    ends = [*places[1:].tolist(), len(tour.waypoints) - 1]
    for count, (here, end) in enumerate(zip(places.tolist(), ends, strict=True), start=1):
        waypoints.append(tour.waypoints[here : here + 1])
        measured.append(int(tour.measured[here]))
        if (count % every and count < len(places)) or len(places) == 1:
            waypoints.append(tour.waypoints[here + 1 : end])
            measured += tour.measured[here + 1 : end].tolist()
            continue
        to_reference = fastest_path(tour.waypoints[here], reference, safe, chain, free)[1:]
        back = fastest_path(reference, tour.waypoints[end], safe, chain, free)[1:-1]
        waypoints += [to_reference, back]
        measured += [-1] * (len(to_reference) - 1) + [int(tour.order[0])] + [-1] * len(back)
    waypoints.append(tour.waypoints[-1:])
    all_waypoints = np.concatenate(waypoints)
    seconds = rest_to_rest_seconds(np.diff(all_waypoints, axis=0), chain.speed, chain.acceleration).sum()
    return Tour(tour.order, all_waypoints, np.array([*measured, -1]), float(seconds))


def rated(chain: JointSpec) -> tuple[JointSpec, tuple[str, ...]]:
    """Return the chain with representative speeds and accelerations where they are not given, and a warning then."""
    slow, sudden = np.isnan(chain.speed), np.isnan(chain.acceleration)
    speed = np.where(slow, np.where(chain.prismatic, DEFAULT_SLIDE_SPEED, DEFAULT_SPEED), chain.speed)
    acceleration = np.where(sudden, speed / FULL_SPEED_S, chain.acceleration)
    notes = []
    if slow.any():
        assumed = f"{np.rad2deg(DEFAULT_SPEED):.0f} deg/s ({DEFAULT_SLIDE_SPEED:g} m/s for a slide)"
        notes.append(f"no speed for {_named(chain, slow)}: {assumed} is assumed")
    if sudden.any():
        notes.append(f"no acceleration for {_named(chain, sudden)}: full speed in {FULL_SPEED_S:g} s is assumed")
    changed = (f"robot {chain.name} gives {'; '.join(notes)}",) if notes else ()
    return replace(chain, speed=speed, acceleration=acceleration), changed


def _named(chain: JointSpec, which: NDArray[np.bool_]) -> str:
    return "any joint" if which.all() else ", ".join(np.array(chain.joint_names)[which])


def move_seconds(joints: Array, speed: Array, acceleration: Array) -> Array:
    """Return the durations ``(m, m)`` of moves between joint positions ``(m, n)``, by the joints' rates ``(n,)``."""
    return rest_to_rest_seconds(joints[:, None] - joints[None], speed, acceleration)


def tour_trajectory(chain: JointSpec, waypoints: Array, waiting: Array) -> tuple[Trajectory, Array]:
    """Return the motion of the joints through waypoints, with the arrival time at each ``(s,)`` s.

    Args:
        chain: with known rates.
        waypoints: joint positions ``(s, n)``, from rest to rest.
        waiting: ``(s,)`` s at each.
    """
    parts, arrivals = [], [0.0]
    for (start, end), seconds in zip(pairwise(waypoints), waiting, strict=False):
        still = np.zeros((1, chain.size))
        wait = Trajectory(np.array([seconds]), still, start, still[0])
        move = common_phases(chain, start, end)
        parts += [wait, move]
        arrivals.append(arrivals[-1] + wait.seconds + move.seconds)
    return joined(parts), np.array(arrivals)


def plan_tour(
    joints: Array,
    speed: Array,
    acceleration: Array,
    free: FreePath,
    rng: np.random.Generator,
    home: Array | None = None,
    safe: Array | None = None,
) -> Tour:
    """Plan a short closed tour from home through the poses ``(m, n)``, every move of it free.

    Nearest neighbour and random starts, 2-opt and Or-opt, then kicks (double bridges) until a number of
    rounds without improvement: optimal for a dozen poses, without a certificate for more.

    Args:
        joints: ``(m, n)`` joint positions, rad or m.
        speed, acceleration: ``(n,)`` largest ones of the joints (see ``rated``).
        free: whether the straight joint path between two joint positions ``(n,)`` is free, the same both ways.
        rng: determines the tour.
        home: ``(n,)`` joint positions; zero if not given.
        safe: ``(k, n)`` further joint positions that detours may pass through.

    Raises:
        LabError: a pose cannot be reached, or a speed or an acceleration is missing.
    """
    roads = RoadmapGraph(joints, speed, acceleration, free, home, safe)
    tours = improve(roads.cost, random_starts(roads.cost, rng))
    quiet = 0
    while True:
        before = lengths(roads.cost, tours)
        shortest = tours[np.argmin(before)]
        if roads.settle_tour(shortest):
            quiet, tours = 0, improve(roads.cost, tours)
            continue
        if quiet == _PATIENCE:
            break
        tried = improve(roads.cost, double_bridge(tours, rng))
        after = lengths(roads.cost, tried)
        tours = np.where((after < before)[:, None], tried, tours)
        quiet = 0 if after.min() < before.min() - _GAIN_S else quiet + 1
    at_home = int(np.flatnonzero(shortest == 0)[0])
    return roads.tour(np.roll(shortest, -at_home)[1:] - 1)
