"""Robots that differ from their nominal models, and a controller that runs programs on them with nominal kinematics.

All poses are MuJoCo's. The flange, and the controller's nominal arm, are read off three sites beside the measured ones;
no line here uses the lab's kinematics.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from day_files import ur5e_urdf
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import lab
from helpers.controller_programs import END, PULSES, configuration, posed, program, spelt
from helpers.simulated_controllers import Controller
from lab.core.se3 import Array
from lab.formats.programs.program_text import ArmShape
from lab.library.calibration_result import CalibrationResult
from lab.library.compensation_result import CompensationResult
from lab.library.identify import identify
from lab.library.simulate import simulate
from lab.noise.instruments import observing
from lab.options.named_instruments import named_instrument
from lab.options.option_groups import Effects
from lab.robots.load_robot import load_virtual
from lab.robots.robot import Robot
from lab.sensors.sensor_options import VirtualSetup
from lab.sensors.sensor_registry import sensor_named
from lab.simulation.collisions import random_poses
from lab.simulation.tracking import VirtualMeasurement
from lab.simulation.true_robot import TrueRobot

__all__ = ["Day", "Ran", "Trial", "calibrated_day", "hidden_cell", "rigid_rest", "tried"]

POINTS = {"p1": (40, 0, 60), "p2": (-25, 45, 50), "p3": (-30, -40, 70)}
INSTRUMENT = "uniform-8um"
_BASES = ("UFRAME", "USER")
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
    cell: tuple[str, Path], seed: int, targets: int, off_mm: float = 0.0, poses: int = 30, springs: bool = True,
    observe: str = "points",
) -> Day:  # fmt: skip
    """Measure and calibrate a robot whose bodies, flange's face among them, are off by 0.4 mm and 1.2 mrad.

    Its zeros are off by 0.8 mrad, two joints have springs, and all scatter by 12 urad.

    Args:
        off_mm: how far the targets together are from where they are stated.
        springs: whether two joints give way, and are identified to do so.
        observe: ``points`` or ``pose``.
    """
    model = "compliance" if springs else "geometric"
    rng, robot, names = np.random.default_rng([seed, 38]), load_virtual(*cell), tuple(POINTS)[:targets]
    day = simulate(
        cell[0], cell=cell[1], seed=seed, poses=poses, targets=names, position_sigma_mm=0.4, rotation_sigma_mrad=1.2,
        offset_sigma_mrad=0.8, instrument=INSTRUMENT,
        effects=Effects(stiffness_nm_per_rad=2e4 if springs else None, repeatability_mrad=0.012),
    )  # fmt: skip
    real, joints = day.true_robot, day.measurements.joints
    shift, face, turn = rng.standard_normal(3), 0.4e-3 * rng.standard_normal(3), 1.2e-3 * rng.standard_normal(3)
    shift *= off_mm / 1e3 / np.linalg.norm(shift)
    if robot.model.carrier != robot.model.bodies[-1]:  # the flange is a body of its own, and off as all are
        face, turn = np.zeros(3), np.zeros(3)
    for each in (*POINTS, *TRIAD):
        site = real.model.site(each)
        place = face + Rotation.from_rotvec(turn).apply(site.pos + (shift if each in names else 0))
        R = Rotation.from_rotvec(turn) * Rotation.from_quat(site.quat, scalar_first=True)
        real.model.site_pos[site.id], real.model.site_quat[site.id] = place, R.as_quat(scalar_first=True)
        real.model.site_sameframe[site.id] = 0  # else MuJoCo takes one at its body's origin for the body's frame
    load = {"payload_kg": np.zeros(len(joints))}
    rng = np.random.default_rng([seed, 39])
    device = observing(named_instrument(INSTRUMENT), observe)
    poses = VirtualMeasurement(real, joints, names, device, rng, conditions=load)
    data = sensor_named(observe)().simulate(poses, VirtualSetup()).measurements
    data = replace(data, robot=day.measurements.robot)
    run = identify(data, robot=cell[0], cell=cell[1], instrument=INSTRUMENT, model=model, observe=observe)
    return Day(robot, real, run)


def taught(day: Day, count: int, rng: np.random.Generator) -> Array:
    """Joint positions ``(count, 6)`` rad of free poses, away from singularities and limits."""
    drawn = random_poses(day.robot.model, 60 * count, rng)
    drawn = drawn[~day.robot.chain.beyond_limits(drawn, -np.deg2rad(2)).any(axis=1)]
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


@dataclass(frozen=True)
class Trial:
    """A program before and after its correction, of the targets that were corrected."""

    result: CompensationResult
    before: Ran
    after: Ran

    @property
    def within_shape(self) -> Array:
        """``(n,)``: which targets' errors relative to each other are as small as 95 % shall be."""
        return self.after.shape <= self.result.expected.shape_95_m[self.result.reached]

    @property
    def within_base(self) -> Array:
        """``(n,)``: which targets' errors in the base are as small as 95 % shall be."""
        return self.after.true <= self.result.expected.base_95_m[self.result.reached]


def tried(day: Day, folder: Path, language: str, rng: np.random.Generator, count: int = 20) -> Trial:
    """Correct a program with a tool by chance, and run both on the hidden robot."""
    T_tool = posed(
        Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3)), np.append(rng.uniform(-0.06, 0.06, 2), rng.uniform(0.08, 0.2))
    )
    near = taught(day, count, rng)
    asked = np.array([day.nominal_flange(q) for q in near]) @ T_tool
    arm = day.robot.arm(("p1",))
    chain = arm.dh_chain(arm.nominal())
    assert chain is not None
    where = [configuration(language, ArmShape.of(chain), q) for q in near]
    content = program(language, asked, np.empty((0, 6)), T_tool, np.eye(4), rng, where, 4).content
    file = folder / f"work{END[language]}"
    file.write_bytes(content)
    memory = {f"{name}[2]": T_tool for name in ("UTOOL", "TOOL")} | {f"{name}[3]": np.eye(4) for name in _BASES}
    names = {"fanuc": ("UTOOL[2]", "UFRAME[3]"), "jbi": ("TOOL[2]", "USER[3]")}.get(language, ())
    result = lab.compensate(
        program=str(file), run=day.run, force=True, no_check=True, controller=language,
        frames="; ".join(f"{name}={','.join(spelt(language, memory[name], 10))}" for name in names),
        pulses_per_deg=tuple(PULSES.tolist()) if language == "jbi" else (),
    )  # fmt: skip
    controller = Controller(language, None, memory, PULSES)  # which reads alone
    text = result.program.content.decode("latin-1")
    poses = np.array([each.T_root_base @ each.T_base_tool for each in controller.stops(text)])
    rows = result.program.rows[result.reached]
    near = result.targets.joints[result.reached]  # where there is a choice, nearest to the target before
    before, after = (ran(day, each[rows], asked[rows], T_tool, near) for each in (asked, poses))
    return Trial(result, before, after)
