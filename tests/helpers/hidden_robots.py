"""Robots that differ from their nominal models, and a controller that runs programs on them with nominal kinematics.

All poses are MuJoCo's. The flange, and the controller's nominal arm, are read off three sites beside the measured ones;
no line here uses the lab's kinematics.
"""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import lab
from helpers.controller_programs import posed, read_back, spelt
from lab.campaign.robot import Robot, load_virtual
from lab.commands.calibrate.result import CalibrationResult
from lab.commands.calibrate.run import identify
from lab.commands.calibrate.simulate import simulate
from lab.core.instruments import instrument
from lab.core.se3 import Array
from lab.experiments.ur5e import ur5e_urdf
from lab.simulation.collisions import random_poses
from lab.simulation.observations.points import track
from lab.simulation.true_robot import TrueRobot

__all__ = ["Day", "Ran", "calibrated_day", "corrected_text", "hidden_cell", "ran", "rigid_rest", "taught"]

POINTS = {"p1": (40, 0, 60), "p2": (-25, 45, 50), "p3": (-30, -40, 70)}
INSTRUMENT = "uniform-8um"
TRIAD = {"f0": (0, 0, 0), "fx": (1000, 0, 0), "fy": (0, 1000, 0)}


@dataclass(frozen=True)
class Day:
    """A hidden robot and its calibration."""

    robot: Robot
    real: TrueRobot
    run: CalibrationResult

    def nominal_flange(self, joints: Array) -> Array:
        """Pose ``(4, 4)`` (m) of the flange in the base, of the controller's arm."""
        model, data = self.robot.model.model, mujoco.MjData(self.robot.model.model)
        data.qpos[:] = self.robot.model.qpos(joints[None])[0]
        mujoco.mj_kinematics(model, data)
        return np.linalg.inv(self.robot.T_world_frame0) @ _triad([data.site(name).xpos for name in TRIAD])

    def real_flange(self, joints: Array) -> Array:
        """Poses ``(n, 4, 4)`` (m) of the physical flange in the physical base."""
        nominal, real, base = self.robot.model.model, self.real.model, self.robot.model.base_body
        moved = np.eye(4) if not base else _body(real, base) @ np.linalg.inv(_body(nominal, base))
        T_base_tracker = np.linalg.inv(moved @ self.robot.T_world_frame0) @ self.real.T_world_tracker
        load = {"payload_kg": np.zeros(len(joints))}
        return np.array([T_base_tracker @ _triad(each) for each in self.real.points(joints, tuple(TRIAD), load)])

    def controller(self, T_base_flange: Array, near: Array) -> Array:
        """Joint positions ``(6,)`` rad at which the controller's arm has its flange at a pose."""

        def missed(joints: Array) -> Array:
            T = self.nominal_flange(joints)
            turn = Rotation.from_matrix(T_base_flange[:3, :3].T @ T[:3, :3]).as_rotvec()
            return np.concatenate([T[:3, 3] - T_base_flange[:3, 3], 0.3 * turn])

        found = least_squares(missed, near, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14)
        assert np.abs(found.fun).max() < 1e-8
        return found.x


def _body(model: mujoco.MjModel, name: str) -> Array:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return posed(Rotation.from_matrix(data.body(name).xmat.reshape(3, 3)), data.body(name).xpos)


def _triad(points: list[Array] | Array) -> Array:
    origin, x, y = np.array(points)
    x, y = x - origin, y - origin
    return posed(Rotation.from_matrix(np.stack([x, y, np.cross(x, y)], axis=1)), origin)


def hidden_cell(folder: Path, name: str) -> tuple[str, Path]:
    """The robot ``ur5e``, or one of the lab's, with three stated targets: what to load, and the cell's file."""
    robot = str(ur5e_urdf(folder / "ur5e.urdf")) if name == "ur5e" else name
    text = "".join(f'[[tool]]\nname = "{k}"\nposition_mm = {list(v)}\n' for k, v in {**POINTS, **TRIAD}.items())
    (folder / "cell.toml").write_text(text)
    return robot, folder / "cell.toml"


def calibrated_day(
    cell: tuple[str, Path], seed: int, targets: int, off_mm: float = 0.0, poses: int = 30, model: str = "compliance"
) -> Day:
    """Measure and calibrate a robot whose bodies, flange's face among them, are off by 0.4 mm and 1.2 mrad.

    Its zeros are off by 0.8 mrad, two joints have springs, and all scatter by 12 urad.

    Args:
        off_mm: how far the targets together are from where they are stated.
    """
    rng, robot, names = np.random.default_rng([seed, 38]), load_virtual(*cell), tuple(POINTS)[:targets]
    day = simulate(
        cell[0], cell=cell[1], seed=seed, poses=poses, targets=names, position_sigma_mm=0.4, rotation_sigma_mrad=1.2,
        offset_sigma_mrad=0.8, stiffness_nm_per_rad=2e4, repeatability_mrad=0.012, instrument=INSTRUMENT,
    )  # fmt: skip
    real, joints = day.true_robot, day.measurements.joints
    shift, face, turn = rng.standard_normal(3), 0.4e-3 * rng.standard_normal(3), 1.2e-3 * rng.standard_normal(3)
    shift *= off_mm / 1e3 / np.linalg.norm(shift)
    for each in (*POINTS, *TRIAD):
        site = real.model.site(each)
        place = face + Rotation.from_rotvec(turn).apply(site.pos + (shift if each in names else 0))
        real.model.site_pos[site.id] = place
        real.model.site_sameframe[site.id] = 0  # else MuJoCo takes one at its body's origin for the body's frame
    load = {"payload_kg": np.zeros(len(joints))}
    data = track(real, joints, names, instrument(INSTRUMENT), np.random.default_rng([seed, 39]), 1, load)
    data = replace(data, robot=day.measurements.robot)
    return Day(robot, real, identify(data, robot=cell[0], cell=cell[1], instrument=INSTRUMENT, model=model))


def taught(day: Day, count: int, rng: np.random.Generator) -> Array:
    """Joint positions ``(count, 6)`` rad of free poses, away from singularities."""
    drawn = random_poses(day.robot.model, 60 * count, rng)
    arm = day.robot.arm(("p1",))
    away = arm.singular_distance(drawn, arm.nominal({"p1": np.zeros(3)}))[0]
    return drawn[away > np.deg2rad(8)][:count]


@dataclass(frozen=True)
class Ran:
    """Errors (m) of a program's n targets on the hidden robot: in its base, and after the best rigid motion."""

    true: Array
    shape: Array


def ran(day: Day, poses: Array, asked: Array, T_tool: Array, near: Array) -> Ran:
    """Run a program on the hidden robot.

    Args:
        poses: ``(n, 4, 4)`` m of the tool in the base, as the program has them.
        asked: ``(n, 4, 4)`` where the tool shall be.
        near: ``(n, 6)`` joint positions in the configuration of the program.
    """
    T_tool_flange = np.linalg.inv(T_tool)
    joints = np.array([day.controller(T @ T_tool_flange, q) for T, q in zip(poses, near, strict=True)])
    reached = (day.real_flange(joints) @ T_tool)[:, :3, 3]
    wanted = asked[:, :3, 3]
    return Ran(np.linalg.norm(reached - wanted, axis=1), np.linalg.norm(rigid_rest(reached, wanted), axis=1))


def rigid_rest(points: Array, onto: Array) -> Array:
    """What is left ``(n, 3)`` of points after the best rigid motion onto others (Kabsch)."""
    a, b = points - points.mean(axis=0), onto - onto.mean(axis=0)
    turn, _ = Rotation.align_vectors(b, a)
    return turn.apply(a) - b


def written_program(poses: Array, T_tool: Array) -> str:
    """A URScript through poses ``(n, 4, 4)`` (m)."""
    lines = ["def work():", f"  set_tcp(p[{','.join(spelt('urscript', T_tool, 7))}])"]
    lines += [f"  movej(p[{','.join(spelt('urscript', T, 7))}], a=1.2, v=0.8)" for T in poses]
    return "\n".join([*lines, "end", ""])


def corrected_text(content: bytes) -> Array:
    """The poses ``(n, 4, 4)`` of a URScript's moves."""
    found = re.findall(r"movej\(p\[([^\]]*)\]", content.decode())
    return np.array([read_back("urscript", np.array([float(x) for x in each.split(",")])) for each in found])


def corrected_program(day: Day, file: Path, poses: Array, T_tool: Array, **more: object):
    """The result of ``lab compensate`` for a URScript through poses, and the poses of its text."""
    file.write_text(written_program(poses, T_tool))
    result = lab.compensate(program=str(file), run=day.run, force=True, no_check=True, controller="urscript", **more)
    return result, corrected_text(result.program.content)
