"""Results of ``lab kinematics``: typed, as plain values, and as a document."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.robotics.kinematics.kinematics_options import KinematicsOptions
from lab.extensions.robotics.kinematics.letters import ModelsInLetters
from lab.extensions.robotics.kinematics.nominal_models import Placement, Reached, SourcedRobot
from lab.formats.csv_table import write_columns
from lab.formats.formula_program import FILE_ENDS, function_name, programs_text
from lab.kinematics.model import RigidArm
from lab.kinematics.serial.serial_arm import SerialArm
from lab.library.result import Result, joint_values, number, tidy
from lab.library.run_folder import joint_columns

__all__ = ["MOST_DRAWN", "KinematicsResult", "LinkMatrices", "coordinates", "frames_of", "pose_values", "tidied"]


@dataclass(frozen=True)
class LinkMatrices:
    """Link matrices and their products.

    Attributes:
        links: ``(n, 4, 4)`` T_i-1,i (m) at the first placement; none of a robot with loops.
        between: the two frames whose product is requested.
    """

    links: Array
    between: tuple[int, int] | None

    def to_dict(self) -> dict[str, Any]:
        """Return the link matrices, and the poses of all frames in the base."""
        products = [self.product(0, i + 1) for i in range(len(self.links))]
        return {
            "link_matrices": [_matrix_values(T) for T in self.links],
            "products": [_matrix_values(T) for T in products],
        }

    def product(self, first: int, last: int) -> Array:
        """Return the pose ``(4, 4)`` (m) of frame ``last`` in frame ``first``."""
        T = np.eye(4)
        for link in self.links[first:last]:
            T = T @ link
        return T


@dataclass(frozen=True, repr=False, eq=False)
class KinematicsResult(Result):
    """Models of a robot at joint positions, or in all solutions of poses.

    Attributes:
        placements: the robot at each row of joint positions, or in each solution.
        reached: the solutions of each target pose; empty where joint positions were given.
        assembly_modes: ``(m, 4, 4)`` all poses (m) of the platform at the first joint positions, by a closed form;
            empty where there is none.
        matrices: the link matrices and their products at the first placement.
        letters: the models in letters, where requested.
    """

    command = "kinematics"

    options: KinematicsOptions
    robot: SourcedRobot
    placements: tuple[Placement, ...]
    reached: tuple[Reached, ...]
    assembly_modes: Array
    matrices: LinkMatrices
    letters: ModelsInLetters | None
    warnings: tuple[str, ...]

    @property
    def model_sha256(self) -> str:
        """Digest of the robot's description."""
        return self.robot.sha256

    @property
    def exit_code(self) -> int:
        """1 if a pose has no solution, or the loops do not close at given joint positions; else 0."""
        stands = all(np.isfinite(each.T_base_tool).all() for each in self.placements)
        return 0 if stands and all(each.solutions for each in self.reached) else 1

    def to_dict(self) -> dict[str, Any]:
        """Return the output of ``--json``: mm and degrees; Jacobians, determinants, manipulabilities in m and rad."""
        chain, options, matrices = self.robot.chain, self.options, self.matrices
        values: dict[str, Any] = {
            "robot": self.robot.name,
            "joints": list(chain.joint_names),
            "units": ["mm" if slides else "deg" for slides in chain.prismatic],
            "frame": options.frame,
            "tool_mm": tidied(MM.of(options.tool_m)),
            "placements": [self._placement(each) for each in self.placements],
            "poses": [_reached(each) for each in self.reached],
            "assembly_modes": [pose_values(T) for T in self.assembly_modes],
            "warnings": list(self.warnings),
        }
        if options.matrices:
            values |= matrices.to_dict()
        if options.between is not None:
            values["between"] = _matrix_values(matrices.product(*options.between))
        if self.letters is not None:
            values["symbolic"] = self.letters.to_dict()
        return values

    def write_files(self, folder: Path) -> None:
        """Write ``joints.csv``, and models in letters as programs: ``model.py``, ``model.c`` and ``model.m``."""
        write_columns(folder / "joints.csv", self.columns())
        if self.letters is not None:
            programs = self.letters.programs(function_name(self.robot.name))
            for language in FILE_ENDS:
                text = programs_text(programs, language)
                (folder / f"model.{FILE_ENDS[language]}").write_text(text, encoding="utf-8")

    def columns(self) -> Mapping[str, Sequence[Any] | Array]:
        """Return a row for each placement: its name, joint positions and the tool's pose, mm and degrees."""
        chain = self.robot.chain
        table: dict[str, Sequence[Any] | Array] = {"id": [each.name for each in self.placements]}
        table |= joint_columns(chain, np.array([each.joints for each in self.placements]).reshape(-1, chain.size))
        Ts = np.array([each.T_base_tool for each in self.placements]).reshape(-1, 4, 4)
        for i, axis in enumerate("xyz"):
            table[f"{axis}_mm"] = MM.of(Ts[:, i, 3])
        quaternions = se3.quaternion_from_rotation(Ts[:, :3, :3])
        for i, part in enumerate("wxyz"):
            table[f"q{part}"] = quaternions[:, i]
        return table

    def _placement(self, each: Placement) -> dict[str, Any]:
        chain = self.robot.chain
        names = chain.joint_names
        rates = None if each.rates is None else [number(v) for v in joint_values(chain.prismatic, each.rates)]
        return {
            "id": each.name,
            "joints": tidied(joint_values(chain.prismatic, each.joints)),
            **pose_values(each.T_base_tool),
            **coordinates(each.T_base_tool),
            "within_limits": not each.beyond,
            "beyond": each.beyond,
            "configuration": dict(each.configuration),
            "free": list(each.free),
            "tilt_deg": number(np.rad2deg(each.tilt_rad)),
            "jacobian": _rows(each.jacobian),
            **_inverse_values(each, requested=self.options.inverse_jacobian),
            "rank": each.rank,
            "manipulability": number(each.manipulability),
            "determinant": None if each.determinant is None else number(each.determinant),
            "factors": {name: number(value) for name, value in each.factors.items()},
            "self_motions": [
                {name: tidy(part) for name, part in zip(names, row, strict=True) if part} for row in each.self_motions
            ],
            "lost_directions": [tidied(row) for row in each.lost],
            "rates": rates,
            "twist": _twist_values(each.twist),
            "missing": _twist_values(each.missing),
        }


def _inverse_values(each: Placement, *, requested: bool) -> dict[str, Any]:
    if not requested:
        return {}
    inverse = each.inverse_jacobian
    if inverse is None:
        return {"inverse_jacobian": None, "inverse_kind": None}
    return {"inverse_jacobian": _rows(inverse.matrix), "inverse_kind": inverse.kind}


def tidied(values: Iterable[float]) -> list[float]:
    """Return numbers as results give them."""
    return [tidy(value) for value in values]


def _rows(matrix: Array) -> list[list[float | None]]:
    """Return the numbers of a matrix, NaN as None."""
    return [[number(value) for value in row] for row in matrix]


def pose_values(T: Array) -> dict[str, Any]:
    """Return a pose as position in mm, rotation, fixed angles about x, y and z in degrees, and quaternion."""
    if not np.isfinite(T).all():
        return {"position_mm": None, "rotation": None, "fixed_xyz_deg": None, "quaternion": None}
    return {
        "position_mm": tidied(MM.of(T[:3, 3])),
        "rotation": [tidied(row) for row in T[:3, :3]],
        "fixed_xyz_deg": tidied(np.rad2deg(se3.roll_pitch_yaw(T[:3, :3]))),
        "quaternion": tidied(se3.quaternion_from_rotation(T[:3, :3])),
    }


def coordinates(T: Array) -> dict[str, Any]:
    """Return a place in cylindrical coordinates (θ1, L, z) and polar ones (θ1, θ2, R), degrees and mm."""
    if not np.isfinite(T).all():
        return {"cylindrical": None, "polar": None}
    x, y, z = MM.of(T[:3, 3])
    level = float(np.hypot(x, y))
    first, second = np.rad2deg(np.arctan2(y, x)), np.rad2deg(np.arctan2(z, level))
    cylindrical, polar = (first, level, z), (first, second, float(np.hypot(level, z)))
    return {"cylindrical": [tidy(each) for each in cylindrical], "polar": [tidy(each) for each in polar]}


def _matrix_values(T: Array) -> list[list[float]]:
    """Return a pose ``(4, 4)`` as rows, its position in mm."""
    scaled = T.copy()
    scaled[:3, 3] *= 1e3
    return [[tidy(each) for each in row] for row in scaled]


def _twist_values(twist: Array | None) -> list[float | None] | None:
    """Return a twist in mm/s and degrees/s."""
    return None if twist is None else [number(value) for value in tidied(twist * np.repeat([1e3, 180 / np.pi], 3))]


def _reached(each: Reached) -> dict[str, Any]:
    turned = np.isfinite(each.rotation).all()
    return {
        "id": each.name,
        "position_mm": tidied(MM.of(each.position)),
        "rotation": [tidied(row) for row in each.rotation] if turned else None,
        "solutions": len(each.solutions),
        "placements": list(each.solutions),
        "out_of_reach_mm": number(MM.of(each.gap_m)),
        "by": each.how,
        "in_other_assembly_modes": each.reassembled,
        "in_other_configurations": each.others,
    }


MOST_DRAWN = 12  # placements in a page's figure


def frames_of(arm: RigidArm, values: Array, joints: Array) -> Array:
    """Return poses ``(n, f, 4, 4)`` (m) of the frames to draw in the base: of a serial arm those of its table."""
    base = np.tile(np.eye(4), (len(joints), 1, 1))
    if not isinstance(arm, SerialArm):
        return base[:, None]
    sizes = range(1, arm.chain.size + 1)
    return np.stack([base, *(arm.frame(joints, values, size) for size in sizes)], axis=1)
