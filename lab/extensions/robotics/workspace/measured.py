"""Measure one robot's workspace: size, sections, orientations, and the part reached without collision."""

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.campaign.robot import Robot
from lab.commands.result import number, tidy
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.core.whole_folder import current_keep, of_one
from lab.extensions.robotics.workspace.membership import anyhow
from lab.extensions.robotics.workspace.options import WorkspaceOptions
from lab.extensions.robotics.workspace.space import Section, Workspace, workspace_of
from lab.kinematics.reach import reach_from_axis
from lab.render.terminal import Stage, no_stage
from lab.simulation.collisions import collides

__all__ = ["RobotWorkspace", "robot_workspace"]

_PLACES = 200  # at which orientations are tried where a closed form answers; by search fewer
_BY_SEARCH, _OF_LOOPS = 60, 20
_IN_CELL = 400  # places at which is looked for a way without a collision


@dataclass(frozen=True)
class RobotWorkspace:
    """The workspace of one robot.

    Attributes:
        reach_m: least and largest distance from axis 1 (frame 0 where joint 1 slides); None of mechanisms with loops.
        shared: ``(k, 3)`` m places at which orientations were tried, and ``shares`` ``(k,)`` of them.
        asked: ``(c, 3)`` m places checked for an IK solution without a collision, and ``free`` ``(c,)`` whether
            there is one; none without a cell.
    """

    robot: Robot
    options: WorkspaceOptions
    space: Workspace
    reach_m: tuple[float, float] | None
    shared: Array
    shares: Array
    checked: Array
    free: NDArray[np.bool_]

    @property
    def plane(self) -> bool:
        """The workspace is an area."""
        return self.space.domain.kind == "plane"

    @property
    def size(self) -> float:
        """m³, of a plane m²: by sections where there are, else by Monte Carlo."""
        return self.space.measured.size if self.space.by_sections is None else self.space.by_sections

    @cached_property
    def sections(self) -> tuple[Section, ...]:
        """The x-z section through the base's axis and a horizontal one; of a plane the plane."""
        domain, found = self.space.domain, list[Section]()
        tried = self.options.orientations if self.space.by_pose.exact else 0
        if self.plane:
            first, second = domain.axes
            return (self.space.section((first, second), domain.level_m, tried),)
        coordinates = self.space.measured.drawn(2000, rng_for(0, "structure"))
        level = float(np.round(domain.places(coordinates)[:, 2].mean(), 3))
        if self.options.level_mm is not None:
            level = MM.to_si(self.options.level_mm)
        low, high = domain.extents[1]
        across = 0.0 if low < 0 < high else float((low + high) / 2)
        found = [self.space.section((0, 2), across, tried), self.space.section((0, 1), level, tried)]
        return tuple(found)

    def to_dict(self) -> dict[str, Any]:
        """Plain values: m³ or m², mm."""
        space, measured, reach = self.space, self.space.measured, self.reach_m
        by_sections = space.by_sections is not None
        return {
            "robot": self.robot.name,
            "volume_m3": None if self.plane else number(self.size),
            "area_m2": number(self.size) if self.plane else None,
            "method": "sections" if by_sections else "Monte Carlo",
            "by": "closed form" if space.by_place.exact else "search",
            "monte_carlo": {
                "places": len(measured.reached),
                "size": number(measured.size),
                "standard_error": number(measured.standard_error),
                "cell_mm": tidy(MM.of(measured.cell_m)),
            },
            "extents_mm": {
                axis: [tidy(MM.of(end)) for end in ends] for axis, ends in zip("xyz", space.domain.extents, strict=True)
            },
            "least_reach_mm": None if reach is None else tidy(MM.of(reach[0])),
            "reach_mm": None if reach is None else tidy(MM.of(reach[1])),
            "voids": [number(size) for size in measured.voids],
            "orientations": self._orientation_values(),
            "cell": self._cell_values(),
        }

    def _orientation_values(self) -> dict[str, Any] | None:
        kinds = self.space.orientations
        if kinds is None:
            return None
        dexterous = self.shares == 1.0
        return {
            "about": None if kinds.axis is None else [tidy(part) for part in np.abs(kinds.axis)],
            "tried": self.options.orientations,
            "places": len(self.shares),
            "mean_share": number(float(self.shares.mean())),
            "all_reached_share": number(float(dexterous.mean())),
            "all_reached_size": number(float(dexterous.mean()) * self.size),
        }

    def _cell_values(self) -> dict[str, Any] | None:
        if self.robot.cell is None:
            return None
        share = float(self.free.mean())
        return {
            "name": self.robot.cell.name,
            "places": len(self.free),
            "free_share": number(share),
            "free_share_standard_error": number(float(np.sqrt(share * (1 - share) / max(len(self.free), 1)))),
            "free_size": number(share * self.size),
        }


def robot_workspace(robot: Robot, options: WorkspaceOptions, stage: Stage = no_stage) -> RobotWorkspace:
    """Measure one robot's workspace.

    Raises:
        LabError: its point stays on a line or a surface, which has no volume.
    """
    arm = robot.arm(("p1",))
    values = arm.nominal({"p1": options.tool_m})
    looked = partial(stage, f"{robot.name}, 1 of 2, places")
    keep = of_one(current_keep(), robot.source, robot.sha256)
    space = workspace_of(arm, values, options.places, rng_for(options.seed, "poses"), looked, keep)
    stage(f"{robot.name}, 2 of 2, reach and orientations")
    chain, reach = arm.dh_chain(values), None
    if chain is not None:
        reach = (reach_from_axis(chain, options.tool_m, least=True), reach_from_axis(chain, options.tool_m))
    shared, shares = np.empty((0, 3)), np.empty(0)
    rng = rng_for(options.seed, "poses", 1)
    if space.orientations is not None:
        count = _PLACES if space.by_pose.exact else _OF_LOOPS if arm.chain.has_loops else _BY_SEARCH
        shared = space.domain.spread(space.measured.drawn(count, rng), rng)
        shares = space.shares(shared, options.orientations)
    requested, free = np.empty((0, 3)), np.zeros(0, dtype=np.bool_)
    if robot.cell is not None:
        requested = space.domain.spread(space.measured.drawn(_IN_CELL, rng), rng)
        free = _free(robot, space.by_place.solutions(anyhow(requested)))
    return RobotWorkspace(robot, options, space, reach, shared, shares, requested, free)


def _free(robot: Robot, solutions: Array) -> NDArray[np.bool_]:
    """Decide whether a place has a collision-free IK solution among ``(n, k, joints)``, NaN where there are fewer."""
    there = np.isfinite(solutions[:, :, 0])
    free = np.zeros(there.shape, dtype=np.bool_)
    free[there] = ~collides(robot.model, solutions[there])
    return np.asarray(free.any(axis=1))
