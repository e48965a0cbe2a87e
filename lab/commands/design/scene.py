"""Scene of a plan: what its pictures and its recording show."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lab.calibration.identify import ellipsoids
from lab.commands.design.result import DesignResult, visit_ids
from lab.core.se3 import Array
from lab.formats.programs.protocol import PAUSE_S
from lab.pose_selection.exchange import information
from lab.pose_selection.tour import rated, tour_trajectory
from lab.render.scene import Legs, MagnifiedEllipsoids, magnified, moved, reach_of, skeleton, world_legs
from lab.simulation.meshes import Shell, body_poses, shells

__all__ = ["PlanScene", "plan_scene"]

_STEP_S = 0.1  # between two pictures of the moving arm
_POINTS_PER_PATH = 16  # points drawn of the path between two stops


@dataclass(frozen=True)
class PlanScene:
    """The stops of a tour: home, poses and the poses passed on the way, home.

    Attributes:
        measured: ``(s,)``, whether a stop is measured.
        ids: ``(n,)`` of the measured ones, as in ``plan.csv``.
        points: ``(s, k, 3)`` targets.
        path: ``(p, 3)``, the first target's way through all stops.
        Ts_world_station: ``(q, 4, 4)``, where the instrument measures from, with its names in ``stations``.
        station: ``(s,)`` from where it measures at each stop.
        reach_m: the largest distance of a target, or a leg's end, from frame 0.
        shells: of the bodies in ``bodies``.
        bodies: world poses ``(s, 4, 4)`` by name.
        origins: ``(s, f, 3)`` of the arm's frames.
        home: lines ``(f, 3)`` from frame to frame, of the arm at home.
        legs: in the world.
        mapping: sensitivity of the position to the scaled parameters.
        uncertainty: predicted 1 sigma of the first target after calibration.
        arrivals, departures: ``(s,)`` s, when the arm comes to each stop and leaves it, at its full speed.
        times: ``(t,)`` s while it moves, with ``moving``, poses ``(t, 4, 4)`` of the bodies by name,
            ``moving_legs``, and ``moving_points`` ``(t, k, 3)``.
    """

    measured: NDArray[np.bool_]
    ids: tuple[str, ...]
    points: Array
    path: Array
    Ts_world_station: Array
    stations: tuple[str, ...]
    station: NDArray[np.int_]
    reach_m: float
    shells: tuple[Shell, ...]
    bodies: dict[str, Array]
    origins: Array
    home: tuple[Array, ...]
    legs: Legs
    mapping: MagnifiedEllipsoids
    uncertainty: MagnifiedEllipsoids
    arrivals: Array
    departures: Array
    times: Array
    moving: dict[str, Array]
    moving_legs: Legs
    moving_points: Array

    @property
    def head(self) -> Array:
        """The tracker's at its first station ``(3,)``."""
        head: Array = self.Ts_world_station[0, :3, 3]
        return head

    @property
    def heads(self) -> Array:
        """The tracker's at each stop ``(s, 3)``."""
        heads: Array = self.Ts_world_station[self.station, :3, 3]
        return heads


@lru_cache(maxsize=1)
def plan_scene(plan: DesignResult) -> PlanScene:
    """The scene of a plan, of the nominal arm and the tracker where the model has it."""
    problem, waypoints = plan.problem, plan.tour.waypoints
    model, arm, values = problem.robot.model, problem.arm, problem.values
    tracker, frame0, names = model.T_world_tracker, model.T_world_frame0, model.stations or ("",)
    points = moved(tracker, arm.points(waypoints, values))
    share = np.linspace(0, 1, _POINTS_PER_PATH, endpoint=False)[None, :, None]
    between = waypoints[:-1, None] + share * (waypoints[1:] - waypoints[:-1])[:, None]  # (s - 1, looks, joints)
    way = np.concatenate([between.reshape(-1, waypoints.shape[1]), waypoints[-1:]])
    mapping, uncertainty = _shapes(plan)
    waiting = np.where(plan.tour.measured >= 0, float(PAUSE_S), 0.0)
    day, arrivals = tour_trajectory(rated(problem.robot.chain)[0], waypoints, waiting)
    times = np.concatenate(
        [np.arange(left, came, _STEP_S)[1:] for left, came in zip(arrivals + waiting, arrivals[1:], strict=False)]
    )
    on_the_way = day.at(times)[0]
    visible, way_poses = tuple(shells(model)), body_poses(model, arm, values, on_the_way)
    legs = world_legs(frame0, arm, values, waypoints)
    reach = reach_of(frame0, points, legs)
    return PlanScene(
        np.asarray(plan.tour.measured >= 0),
        visit_ids(plan.tour, plan.pose_ids),
        points,
        moved(tracker, arm.points(way, values))[:, 0],
        model.Ts_world_station,
        model.stations or ("tracker",),
        np.array([names.index(name) for name in plan.waypoints.stations or names[:1] * len(waypoints)]),
        reach,
        visible,
        body_poses(model, arm, values, waypoints),
        moved(frame0, skeleton(arm, values, waypoints).origins),
        tuple(moved(frame0, line[0]) for line in skeleton(arm, values, waypoints[:1]).frame_lines),
        legs,
        magnified(ellipsoids(mapping @ np.swapaxes(mapping, 1, 2)), points[:, 0], tracker, reach),
        magnified(ellipsoids(uncertainty @ np.swapaxes(uncertainty, 1, 2)), points[:, 0], tracker, reach),
        arrivals,
        arrivals + waiting,
        times,
        {shell.body: way_poses[shell.body] for shell in visible},
        world_legs(frame0, arm, values, on_the_way),
        moved(tracker, arm.points(on_the_way, values)),
    )


def _shapes(plan: DesignResult) -> tuple[Array, Array]:
    """Compute factors F ``(s, 3, p)`` at every waypoint, of the squares F F' of mapping and uncertainty ellipsoids.

    The parameters of the mapping are scaled so that over all measured poses each moves the
    whitened points alike; the uncertainty is J C J', the inverse of the information being C.
    """
    problem = plan.problem
    _, jacobian = problem.arm.observe(plan.tour.waypoints, problem.values)
    seen = [
        i for i in problem.structure.identifiable if i < len(problem.arm.names)
    ]  # the places of stations move no point
    here = np.zeros((*jacobian.shape[:1], 3, len(problem.structure.identifiable)))
    here[..., : len(seen)] = jacobian[:, 0][..., seen]
    total = information(problem.whitened(np.concatenate([plan.design.joints, problem.already])))
    size = np.sqrt(np.diag(total))
    root = np.linalg.cholesky(total / np.outer(size, size))
    factor = np.linalg.inv(root).T / size[:, None]  # C = factor factor'
    return here / size, here @ factor
