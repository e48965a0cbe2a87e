"""The models of a robot at some joint positions: typed, and as plain values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.commands.result import Result
from lab.commands.stops import joint_columns
from lab.commands.values import joint_values, number, tidy
from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.robotics.kinematics.matrices import Matrices
from lab.extensions.robotics.kinematics.nominal_robot import NominalRobot
from lab.extensions.robotics.kinematics.options import KinematicsOptions
from lab.extensions.robotics.kinematics.placement import Placement
from lab.formats.csv_table import write_columns

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lab.render.document import Document

__all__ = ["KinematicsResult", "Reached", "matrix_values", "pose_values"]


@dataclass(frozen=True)
class Reached:
    """What came of one pose that was to be reached.

    Attributes:
        name: the row's id.
        position: ``(3,)`` m.
        rotation: ``(3, 3)``, NaN where the orientation is free.
        solutions: numbers of its placements, from 0.
        gap_m: how far it is out of reach, of a search by how much the nearest place that it found misses it; NaN where
            that is not known.
        how: ``closed form``, whose solutions are all, or ``search``.
        reassembled: how many more there are in another assembly mode of a mechanism with loops.
        others: how many more there are in configurations that were not asked for.
    """

    name: str
    position: Array
    rotation: Array
    solutions: tuple[int, ...]
    gap_m: float
    how: str
    reassembled: int = 0
    others: int = 0

    @property
    def away(self) -> str:
        """How far it is from what was reached, in words; empty where it has solutions, or that is not known."""
        if self.solutions or not self.gap_m or not np.isfinite(self.gap_m):
            return ""
        gap = f"{1e3 * self.gap_m:.6g} mm"
        return f"it is {gap} out of reach" if self.how == "closed form" else f"the nearest place found is {gap} away"


@dataclass(frozen=True, repr=False, eq=False)
class KinematicsResult(Result):
    """A robot at some joint positions, or in all solutions of some poses, with its models there.

    Attributes:
        options: what was asked.
        placements: the robot at each row of joint positions, or in each solution.
        reached: what came of each pose that was to be reached; empty where joint positions were given.
        assembly_modes: ``(m, 4, 4)`` every pose (m) that the platform of a mechanism with a closed form can have at the
            first joint positions; empty where it has none.
        matrices: the link matrices and their products at the first placement.
    """

    options: KinematicsOptions
    robot: NominalRobot
    placements: tuple[Placement, ...]
    reached: tuple[Reached, ...]
    assembly_modes: Array
    matrices: Matrices
    warnings: tuple[str, ...]

    @property
    def exit_code(self) -> int:
        """1 where a pose has no solution, or the robot cannot stand at given joint positions; else 0."""
        stands = all(np.isfinite(each.T_base_tool).all() for each in self.placements)
        return 0 if stands and all(each.solutions for each in self.reached) else 1

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints: mm and degrees; Jacobians, determinants and manipulabilities in m and rad."""
        chain, options, matrices = self.robot.chain, self.options, self.matrices
        values: dict[str, Any] = {
            "robot": self.robot.name,
            "joints": list(chain.joint_names),
            "units": ["mm" if slides else "deg" for slides in chain.prismatic],
            "frame": options.frame,
            "tool_mm": [tidy(each) for each in 1e3 * options.tool_m],
            "placements": [self._placement(each) for each in self.placements],
            "poses": [_reached(each) for each in self.reached],
            "assembly_modes": [pose_values(T) for T in self.assembly_modes],
            "warnings": list(self.warnings),
        }
        if options.matrices:
            values["link_matrices"] = [matrix_values(T) for T in matrices.links]
            values["products"] = [matrix_values(matrices.product(0, i + 1)) for i in range(len(matrices.links))]
        if options.between is not None:
            values["between"] = matrix_values(matrices.product(*options.between))
        if options.symbolic:
            values["symbolic"] = {"letters": matrices.letter_values(), **matrices.texts()}
        return values

    def document(self) -> "Document":
        """What a person reads: poses, solutions, the Jacobian with what is singular, and matrices where asked for."""
        from lab.extensions.robotics.kinematics.document import kinematics_document

        return kinematics_document(self)

    def columns(self) -> Mapping[str, Sequence[Any] | Array]:
        """A row for each placement: its name, joint positions and the tool's pose, mm and degrees."""
        chain = self.robot.chain
        table: dict[str, Sequence[Any] | Array] = {"id": [each.name for each in self.placements]}
        table |= joint_columns(chain, np.array([each.joints for each in self.placements]).reshape(-1, chain.size))
        Ts = np.array([each.T_base_tool for each in self.placements]).reshape(-1, 4, 4)
        for i, axis in enumerate("xyz"):
            table[f"{axis}_mm"] = 1e3 * Ts[:, i, 3]
        quaternions = se3.quaternion_from_rotation(Ts[:, :3, :3])
        for i, part in enumerate("wxyz"):
            table[f"q{part}"] = quaternions[:, i]
        return table

    def plot(self) -> "Figure":
        """Draw the robot in its first placement, with its frames."""
        from lab.extensions.robotics.kinematics.document import placement_pictures

        return placement_pictures(self)[0].draw()

    def write(self, folder: Path) -> None:
        """Write ``config.json``, ``result.json``, ``joints.csv``, ``report.html`` and ``recording.rrd``."""
        from lab.commands.run_folder import write_config, write_json
        from lab.extensions.robotics.kinematics.recording import record_kinematics

        write_config(folder, "kinematics", self.options, self.robot.sha256)
        write_json(folder / "result.json", self.to_dict())
        write_columns(folder / "joints.csv", self.columns())
        self.report(folder / "report.html")
        if not self.options.no_recording:
            record_kinematics(folder / "recording.rrd", self)

    def _placement(self, each: Placement) -> dict[str, Any]:
        chain = self.robot.chain
        names = chain.joint_names
        rates = None if each.rates is None else [number(v) for v in joint_values(chain.prismatic, each.rates)]
        return {
            "id": each.name,
            "joints": [tidy(value) for value in joint_values(chain.prismatic, each.joints)],
            **pose_values(each.T_base_tool),
            "within_limits": not each.beyond,
            "beyond": each.beyond,
            "configuration": dict(each.configuration),
            "free": list(each.free),
            "tilt_deg": number(np.rad2deg(each.tilt_rad)),
            "jacobian": [[number(value) for value in row] for row in each.jacobian],
            "rank": each.rank,
            "manipulability": number(each.manipulability),
            "determinant": None if each.determinant is None else number(each.determinant),
            "factors": {name: number(value) for name, value in each.factors.items()},
            "self_motions": [
                {name: tidy(part) for name, part in zip(names, row, strict=True) if part} for row in each.self_motions
            ],
            "lost_directions": [[tidy(part) for part in row] for row in each.lost],
            "rates": rates,
            "twist": None if each.twist is None else _twist_values(each.twist),
            "missing": None if each.missing is None else _twist_values(each.missing),
        }


def pose_values(T: Array) -> dict[str, Any]:
    """A pose ``(4, 4)`` as position in mm, rotation, fixed angles about x, y and z in degrees, and quaternion."""
    if not np.isfinite(T).all():
        return {"position_mm": None, "rotation": None, "fixed_xyz_deg": None, "quaternion": None}
    return {
        "position_mm": [tidy(each) for each in 1e3 * T[:3, 3]],
        "rotation": [[tidy(each) for each in row] for row in T[:3, :3]],
        "fixed_xyz_deg": [tidy(each) for each in np.rad2deg(se3.roll_pitch_yaw(T[:3, :3]))],
        "quaternion": [tidy(each) for each in se3.quaternion_from_rotation(T[:3, :3])],
    }


def matrix_values(T: Array) -> list[list[float]]:
    """A pose ``(4, 4)`` as rows, its position in mm."""
    scaled = T.copy()
    scaled[:3, 3] *= 1e3
    return [[tidy(each) for each in row] for row in scaled]


def _twist_values(twist: Array) -> list[float | None]:
    """mm/s and degrees/s."""
    return [number(tidy(each)) for each in twist * np.repeat([1e3, 180 / np.pi], 3)]


def _reached(each: Reached) -> dict[str, Any]:
    turned = np.isfinite(each.rotation).all()
    return {
        "id": each.name,
        "position_mm": [tidy(value) for value in 1e3 * each.position],
        "rotation": [[tidy(value) for value in row] for row in each.rotation] if turned else None,
        "solutions": len(each.solutions),
        "placements": list(each.solutions),
        "out_of_reach_mm": number(1e3 * each.gap_m),
        "by": each.how,
        "in_other_assembly_modes": each.reassembled,
        "in_other_configurations": each.others,
    }
