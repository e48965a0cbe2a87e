"""Run ``lab kinematics``: direct, inverse and differential models, at joint positions or for poses."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.limits import PLACED
from lab.core.se3 import Array
from lab.core.units import DEGREES, MM
from lab.extensions.robotics.kinematics.kinematics_options import KinematicsOptions
from lab.extensions.robotics.kinematics.kinematics_result import KinematicsResult, LinkMatrices
from lab.extensions.robotics.kinematics.letters import ModelsInLetters
from lab.extensions.robotics.kinematics.nominal_models import (
    Placement,
    Reached,
    Solution,
    Solver,
    SourcedRobot,
    matching,
    nominal_robot,
    placements,
)
from lab.extensions.robotics.kinematics.rotation import Rotation, converted
from lab.formats.target_csv import holds_targets, read_joints, read_targets
from lab.kinematics.closed.mobility import mobility_of
from lab.kinematics.inverse.closed_form import closed_form_of
from lab.kinematics.inverse.newton_inverse import PoseTarget
from lab.kinematics.model import RigidArm
from lab.kinematics.serial.serial_arm import SerialArm
from lab.options.call_options import options_of, takes

if TYPE_CHECKING:
    from lab.robots.robot import Robot

__all__ = ["convert_rotation", "kinematics_of", "solve_kinematics"]

_TARGET = "p1"
_REACHED_M = 1e-9  # of a plane: a place nearer to it is in it
_TILTED_RAD = 1e-6  # a rotation that is missed by more is reported


_Targets = tuple[tuple[str, ...], PoseTarget, Array]  # ids, poses and given joint positions ``(n, joints)`` or NaN


_OF_A_ROTATION = ("angles", "order", "fixed", "axis", "angle", "quaternion", "matrix", "radians")
_OF_A_ROBOT = tuple(each.name for each in fields(KinematicsOptions) if each.name not in _OF_A_ROTATION)


@takes(KinematicsOptions, unused=_OF_A_ROTATION)
def solve_kinematics(robot: "str | Path | Robot | KinematicsOptions" = "irb120", **options: Any) -> KinematicsResult:
    """Compute the direct, inverse and differential models of a nominal robot.

    Args:
        robot: a model's name, a path, or a loaded robot; or all options in one object.
        options: those of ``lab kinematics``, by name: ``joints`` or ``pose`` or ``file``, and the models to compute.

    Returns:
        The robot at the joint positions, or in every solution of the poses, with Jacobian and singularities.

    Raises:
        LabError: there is no such robot, or an option does not fit it.

    Example:
        >>> import lab
        >>> found = lab.solve_kinematics("irb120", pose=(-44.11, 383.46, 786, 77.71, -0.38, 170.88))
        >>> found.to_dict()["poses"][0]["solutions"]
        8
    """
    if isinstance(robot, KinematicsOptions):
        return _solved(robot, nominal_robot(robot.robot))
    nominal = nominal_robot(robot)
    return _solved(options_of("lab.solve_kinematics", KinematicsOptions, {"robot": nominal.source, **options}), nominal)


@takes(KinematicsOptions, unused=[name for name in _OF_A_ROBOT if name not in ("out", "overwrite")])
def convert_rotation(**options: Any) -> Rotation:
    """Convert a rotation into all its descriptions.

    Args:
        options: those of ``lab kinematics`` for rotations, by name: one of ``matrix``, ``quaternion``, ``angles`` and
            ``axis`` with ``angle``; ``order`` and ``fixed`` for ``angles``.

    Returns:
        The rotation in all descriptions, with both solutions, and what is determined where one is singular.

    Raises:
        LabError: what is given is no rotation.

    Example:
        >>> import lab
        >>> lab.convert_rotation(angles=(30, 90, 0), order="zyx").to_dict()["orders"]["zyx"]["determined"]
        'c − a'
    """
    requested = options_of("lab.convert_rotation", KinematicsOptions, options)
    if not requested.of_a_rotation:
        raise LabError("lab.convert_rotation: give one of matrix, quaternion, angles, and axis with angle")
    return _converted(requested)


def kinematics_of(options: KinematicsOptions) -> KinematicsResult | Rotation:
    """Run the command ``lab kinematics``: of a robot, or of a rotation."""
    return _converted(options) if options.of_a_rotation else _solved(options, nominal_robot(options.robot))


def _converted(options: KinematicsOptions) -> Rotation:
    options.check()
    found = converted(replace(options, out=None, overwrite=False))  # the folder is no part of the result
    if options.out is not None:
        found.save(options.out, overwrite=options.overwrite)
    return found


def _solved(options: KinematicsOptions, robot: SourcedRobot) -> KinematicsResult:
    options.check()
    arm = robot.arm((_TARGET,))
    _check_frame(options, robot, arm)
    model = _Model(options, robot, arm, arm.nominal({_TARGET: options.tool_m}))
    targets, notes = model.targets()
    if targets is None:
        ids, rows, notes = model.joint_rows()
        placed, reached = model.placed(rows, ids), tuple[Reached, ...]()
    else:
        placed, reached = model.solved(targets)
    links = np.empty((0, 4, 4))
    if isinstance(arm, SerialArm) and placed:
        links = np.asarray(arm.links(placed[0].joints[None], model.values)[0])
    if (options.matrices or options.between) and not len(links):
        raise LabError(f"robot {robot.name}: link matrices are of serial arms with a solution; leave out --matrices "
                       "and --between")  # fmt: skip
    if options.between is not None and not 0 <= options.between[0] < options.between[1] <= len(links):
        raise LabError(
            f"--between {options.between[0]} {options.between[1]}: give two frames of 0 to {len(links)}, the one "
            "nearer to the base first"
        )
    warnings = (*robot.warnings, *notes, *model.warnings(placed, reached))
    matrices, letters = LinkMatrices(links, options.between), _in_letters(options, robot, arm)
    plain = replace(options, out=None, overwrite=False)  # the folder is no part of the result
    found = KinematicsResult(plain, robot, placed, reached, model.assembly_modes(placed), matrices, letters, warnings)
    if options.out is not None:
        found.save(options.out, overwrite=options.overwrite)
    return found


def _in_letters(options: KinematicsOptions, robot: SourcedRobot, arm: RigidArm) -> ModelsInLetters | None:
    """Return the models in letters, if they are requested."""
    if not (options.symbolic or options.symbolic_inverse):
        return None
    if not isinstance(arm, SerialArm):
        raise LabError(
            f"robot {robot.name}: models in letters are of serial arms; leave out --symbolic, --symbolic-inverse"
        )
    axes = options.axes
    frame = axes if isinstance(axes, int) else 0 if axes == "base" else arm.chain.size
    return ModelsInLetters.of(
        arm.chain, frame, options.tool_m, options.between,
        matrices=options.symbolic, inverse_jacobian=options.inverse_jacobian, inverse=options.symbolic_inverse,
    )  # fmt: skip


def _check_frame(options: KinematicsOptions, robot: SourcedRobot, arm: RigidArm) -> None:
    """Refuse a frame that the robot does not have."""
    if isinstance(options.axes, str):
        return
    if not isinstance(arm, SerialArm):
        raise LabError(f"--frame {options.frame}: robot {robot.name} has loops; give base or tool")
    if options.axes > arm.chain.size:
        raise LabError(f"--frame {options.frame}: give base, tool, or a frame's number from 0 to {arm.chain.size}")


@dataclass(frozen=True)
class _Model:
    """A nominal robot and the options."""

    options: KinematicsOptions
    robot: SourcedRobot
    arm: RigidArm
    values: Array

    @property
    def given(self) -> Array | None:
        """Joint positions of ``--joints``."""
        return self.options.joint_row(self.robot.chain, "joints") if self.options.joints else None

    def targets(self) -> tuple[_Targets | None, tuple[str, ...]]:
        """Return the target poses, if there are any, and warnings about their file."""
        options, chain = self.options, self.robot.chain
        near = np.full(chain.size, np.nan) if self.given is None else self.given
        if options.pose:
            return (("",), options.wanted, near[None]), ()
        if options.file is None or not holds_targets(options.file, PLACED):
            return None, ()
        read = read_targets(options.file, chain.joint_names, chain.prismatic, options.orientation)
        near = np.where(np.isfinite(read.joints), read.joints, near)
        return (read.ids, PoseTarget(read.positions, read.rotations), near), read.warnings

    def joint_rows(self) -> tuple[tuple[str, ...], Array, tuple[str, ...]]:
        """Return ids and rows ``(n, joints)`` of the joint positions, and warnings about their file."""
        chain = self.robot.chain
        if self.options.file is not None:
            if self.given is not None:
                raise LabError("--joints and --file both set the joint positions; give one")
            rows = read_joints(self.options.file, chain.joint_names, chain.prismatic)
            return rows.ids, rows.joints, rows.warnings
        if self.given is None:
            return ("home",), np.array([chain.home]), ()
        return ("given",), self.given[None], ()

    def placed(
        self, rows: Array, ids: Sequence[str], solved: Sequence[Solution] | None = None
    ) -> tuple[Placement, ...]:
        """Place the robot at each row of joint positions, or in each solution."""
        options, chain = self.options, self.robot.chain
        nominal = self.arm.dh_chain(self.values)
        form = None if nominal is None else closed_form_of(nominal, options.tool_m)
        return placements(
            self.arm,
            self.values,
            None if form is None else form.determinant,
            rows,
            ids,
            solved,
            frame=options.axes,
            rates=options.joint_row(chain, "rates") if options.rates else None,
            twist=options.twist_si if options.twist else None,
        )

    def solved(self, targets: _Targets) -> tuple[tuple[Placement, ...], tuple[Reached, ...]]:
        """Place the robot in each solution of each pose."""
        (names, poses, near), solutions, ids, reached = targets, list[Solution](), list[str](), []
        for i, found in enumerate(Solver(self.arm, self.values)(poses, near)):
            retained = matching(found, self.options.of)
            numbers = tuple(range(len(solutions), len(solutions) + len(retained.solutions)))
            solutions += retained.solutions
            ids += [f"{names[i]}-{k + 1}" if len(names) > 1 else f"{k + 1}" for k in range(len(numbers))]
            rest = retained.gap_m, retained.how, retained.reassembled, retained.others
            reached.append(Reached(names[i], poses.positions[i], poses.rotations[i], numbers, *rest))
        rows = np.array([solution.joints for solution in solutions]).reshape(-1, self.robot.chain.size)
        return self.placed(rows, ids, solutions), tuple(reached)

    def assembly_modes(self, placed: Sequence[Placement]) -> Array:
        """Return every pose of the platform of a mechanism with a closed form, at the first joint positions."""
        mechanism = self.robot.chain
        if not mechanism.has_loops:
            return np.empty((0, 4, 4))
        from lab.extensions.robotics.closed.recognition import assembly_modes, classical_model_of
        from lab.kinematics.closed.mechanism import Mechanism

        classical = classical_model_of(mechanism) if isinstance(mechanism, Mechanism) and placed else None
        if classical is None or not isinstance(mechanism, Mechanism):
            return np.empty((0, 4, 4))
        poses = assembly_modes(mechanism, classical, placed[0].joints)
        poses[:, :3, 3] += poses[:, :3, :3] @ self.options.tool_m
        return poses

    def warnings(self, placed: Sequence[Placement], reached: Sequence[Reached]) -> list[str]:
        """Warn of poses without a solution, rotation errors, and joint positions beyond the limits."""
        messages = []
        for pose in reached:
            solutions = [placed[i] for i in pose.solutions]
            if not solutions:
                messages.append(f"{_called(pose)} has no solution{self._reason(pose)}")
            elif (tilt := max(solution.tilt_rad for solution in solutions)) > _TILTED_RAD:
                messages.append(
                    f"{_called(pose)} asks for a turn that an arm of {self.robot.chain.size} joints does not have: its "
                    f"place is met, its rotation missed by {DEGREES.text(tilt)}{self._axis_of_miss(pose, solutions)}"
                )
        messages += [f"{each.name}: {each.beyond}" for each in placed if each.beyond and not reached]
        return messages

    def _reason(self, pose: Reached) -> str:
        """Describe why a pose has no solution; empty where that is unknown."""
        if self.options.of and pose.gap_m == 0:
            return f" of --of {','.join(self.options.of)}"
        return self._distance_from_plane(pose) or (f": {pose.away}" if pose.away else "")

    def _axis_of_miss(self, wanted: Reached, placed: Sequence[Placement]) -> str:
        """Describe the axis in the base of the smallest rotation error."""
        miss = min((se3.log(wanted.rotation @ each.T_base_tool[:3, :3].T) for each in placed), key=np.linalg.norm)
        axis = miss / max(float(np.linalg.norm(miss)), 1e-300)
        return " about ({:.2f}, {:.2f}, {:.2f}) of the base".format(*(axis + 0.0)).replace("-", "−")

    def _distance_from_plane(self, wanted: Reached) -> str:
        """Describe a place's distance from the plane in which a planar arm moves; empty where it is in it."""
        chain = self.arm.dh_chain(self.values)
        if chain is None or not (found := mobility_of(chain)).planar:
            return ""
        T = self.arm.tool(chain.home[None], self.values)[0][0]
        normal = self.arm.T_tracker_frame0(self.values)[:3, :3] @ found.fixed_directions[0]
        off = float(normal @ (wanted.position - T[:3, 3]))
        if abs(off) <= _REACHED_M:
            return ""
        across = ", ".join(f"{each:.6g}" for each in normal + 0.0)
        text = f": it is {MM.text(abs(off), 6)} off the plane across ({across}) in which the arm moves"
        return text.replace("-", "−")


def _called(each: Reached) -> str:
    return f"pose {each.name}" if each.name else "the pose"
