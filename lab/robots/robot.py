"""Represent a robot before any measurement: a serial arm, a mechanism with loops, or a robot with several tips."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from lab.core.errors import LabError, option_name
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.core.values import Value
from lab.formats.cell_toml import Cell, read_cell
from lab.formats.description import DescriptionFormat, IdentifiedRobot, with_comment
from lab.kinematics.array_arm import ArrayArm
from lab.kinematics.closed.closed_arm import ClosedArm
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.effects.arm_with_effects import Arm, affected
from lab.kinematics.effects.effect import SessionInfo
from lab.kinematics.effects.effect_registry import effect
from lab.kinematics.effects.range_errors import range_errors
from lab.kinematics.effects.sessions import stations
from lab.kinematics.effects.steps import steps
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.kinematics.serial.serial_arm import DEFAULT_TOOL, SerialArm
from lab.kinematics.tree import TreeArm, point_of
from lab.prediction.arm_on_arrays import ArmOnArrays
from lab.robots.description_formats import CLOSED_FORMATS, MAKER_FORMATS, SERIAL_FORMATS, TREE_FORMATS
from lab.simulation.cell import implausible, in_cell
from lab.simulation.closed_robot import ClosedModel, TrueMechanism, random_values, true_mechanism
from lab.simulation.load_model import loads_of
from lab.simulation.robot_model import OpenModel, RobotModel, SerialModel, TreeModel
from lab.simulation.true_robot import (
    GeometryErrors,
    TrueOpenRobot,
    TrueRobot,
    random_perturbation,
    random_table,
    true_robot,
    true_robot_from_table,
)

__all__ = ["ClosedRobot", "Robot", "SerialRobot", "TreeRobot"]


@dataclass(frozen=True, eq=False, repr=False)
class Robot(Value, ArmOnArrays):
    """A robot before any measurement.

    Robots are equal if all their data are. A pickled robot is loaded again from its files, which must be
    unchanged. ``points``, ``jacobian`` and so on work on plain arrays: one configuration or many. Its arms are built at
    their first use, and kept.

    Example:
        >>> import lab, numpy as np
        >>> robot = lab.load_robot("irb120")
        >>> robot.points(np.zeros(6)).shape, robot.points(np.zeros((9, 6)), targets=["p1"]).shape
        ((3, 3), (9, 1, 3))
        >>> robot.identifiability(targets=["p1"]).rank
        27

    Attributes:
        model: its MuJoCo model; built from the table of a robot given as one.
        warnings: for the user, on its files.
        loads: its masses, for gravity effects; None if the file gives none.
        formats: of its descriptions.
    """

    model: RobotModel
    warnings: tuple[str, ...] = ()
    loads: Loads | None = None
    formats: ClassVar[tuple[DescriptionFormat[Any, Any], ...]]

    def _about(self) -> str:
        joints, targets = len(self.chain.joint_names), ", ".join(self.tool) or "none"
        cell = "" if self.cell is None else f", in {self.cell.path.name}"
        return f"{self.name}, {joints} joints, targets {targets}{cell}"

    def _facts(self) -> Mapping[str, str]:
        return {
            "robot": self.name,
            "loaded from": self.source,
            "joints": ", ".join(self.chain.joint_names),
            "targets": ", ".join(self.tool) or "none",
            "cell": "none" if self.cell is None else str(self.cell.path),
        }

    @property
    def sha256(self) -> str:
        """Digest of its files."""
        return self.model.origin.sha256

    @property
    def source(self) -> str:
        """The name or path that it was loaded by."""
        return self.model.origin.source

    @property
    def cell(self) -> Cell | None:
        """Its cell; None without one."""
        return self.model.origin.cell

    @property
    def name(self) -> str:
        """The robot's name."""
        return self.chain.name

    @property
    def chain(self) -> JointSpec:
        """The nominal model, whose joints are measured."""
        return self.model.chain

    @property
    def tool(self) -> dict[str, Array]:
        """Positions ``(3,)`` of its targets (m, in the last frame, or the platform's)."""
        return self.model.tool

    @property
    def stations(self) -> tuple[str, ...]:
        """Stations of the instrument that its cell names."""
        return self.model.stations

    @property
    def T_world_frame0(self) -> Array:
        """Pose ``(4, 4)`` (m) of the base's frame (frame 0) in the world of the MuJoCo model."""
        return self.model.T_world_frame0

    @property
    def link_compliances(self) -> Array | None:
        """``(n, 4)`` of its links (``beam.COMPLIANCES``), from its description; None without any."""
        return None

    @property
    @abstractmethod
    def serial_model(self) -> SerialModel:
        """Its model, if it is a serial arm.

        Raises:
            LabError: the robot has loops.
        """

    def serial_arm(self, targets: tuple[str, ...]) -> SerialArm:
        """Return the kinematic model of a serial arm.

        Raises:
            LabError: the robot has loops.
        """
        self.serial_model  # noqa: B018 (which raises for others)
        arm = self.arm(targets)
        assert isinstance(arm, SerialArm)
        return arm

    @cached_property
    def _arms(self) -> dict[tuple[str, ...], RigidArm]:
        return {}

    def arm(self, targets: tuple[str, ...]) -> RigidArm:
        """Return the kinematic model with these targets; it is built once, and kept."""
        built = self._arms.get(targets)
        return self._arms.setdefault(targets, self._built_arm(targets)) if built is None else built

    @abstractmethod
    def _built_arm(self, targets: tuple[str, ...]) -> RigidArm:
        """Build the kinematic model with these targets."""

    def arm_with(
        self,
        targets: tuple[str, ...],
        groups: Sequence[str],
        session: SessionInfo = SessionInfo(),  # noqa: B008
        moving: bool = False,
    ) -> Arm:
        """Return the kinematic model with groups of effects, by name.

        Raises:
            LabError: there is no such group, or no masses or sessions for it, or two are incompatible.
        """
        named = [effect(name, self.chain, self.loads, session, moving=moving) for name in groups]
        of_instrument = *stations(session.stations), *range_errors(session.range_prior)
        return affected(self.arm(targets), [*of_instrument, *steps(session.steps, self.chain.size), *named])

    def _compiled(self, targets: tuple[str, ...] | None) -> ArrayArm:
        """Build the nominal model, its base at the origin; all targets of the tool unless some are named."""
        names = tuple(self.tool or DEFAULT_TOOL) if targets is None else targets
        self.refuse_unknown(names)
        arm = self.arm(names)
        nominal = arm.nominal(self.tool)
        return ArrayArm(arm, nominal, nominal)

    @abstractmethod
    def simulated_loads(self) -> Loads | None:
        """Return the masses of its model, assumed ones too; None without any, or for a mechanism."""

    @abstractmethod
    def perturbed(self, errors: GeometryErrors, T_world_tracker: Array, rng: np.random.Generator) -> TrueRobot:
        """Draw a true robot, without effects: its geometry with errors, before a tracker.

        Args:
            errors: standard deviations of the geometry, and their sampler.
            T_world_tracker: pose ``(4, 4)`` (m) of the tracker's frame in the world of the MuJoCo model.

        Raises:
            LabError: this kind of robot does not have such errors.
        """

    @property
    def description_files(self) -> tuple[str, ...]:
        """The files that can describe it with identified parameters; the last is exact to the bit."""
        return tuple(each.file for each in self.formats)

    def description(self, file: str, targets: tuple[str, ...], values: Array, comment: str = "") -> str:
        """Return the content of such a file for the arm with these targets and parameters ``(p,)``, base included.

        Args:
            comment: at its head.
        """
        identified = IdentifiedRobot(self.name, self.arm(targets), values, self.loads, self.model)
        return with_comment(file, {each.file: each for each in self.formats}[file].text(identified), comment)

    @property
    def stored_file(self) -> str:
        """The one of ``description_files`` that a run keeps: in the robot's own format, or near it."""
        return self.description_files[-1] if self.model.path.suffix == ".toml" else self.description_files[0]

    @property
    def stored_files(self) -> tuple[str, ...]:
        """The ones that a run keeps: also those of the controller's maker, if they are for such a robot."""
        return (self.stored_file, *(each.file for each in MAKER_FORMATS if each.file in self.description_files))

    def placed_in(self, cell: Path | None) -> Self:
        """Return the robot in the cell of a file; unchanged without a file.

        Raises:
            LabError: the file cannot be read, or is not for such a robot.
        """
        if cell is None:
            return self
        described = read_cell(cell)
        model = in_cell(self.model, described)
        warnings = (*self.warnings, *implausible(model, described))
        placed = replace(self, model=model, warnings=warnings)
        return placed if self.loads is None else replace(placed, loads=placed.simulated_loads())

    def on_tips(self, targets: tuple[str, ...]) -> tuple[str, ...]:
        """Return targets, of which one without a tip stands for that of every tip: ``p1`` for left.p1 and right.p1."""
        return targets

    def refuse_unknown(self, targets: tuple[str, ...]) -> None:
        """Refuse a target that the robot (or the default tool, if it has none) does not have, with a LabError."""
        known = self.tool or DEFAULT_TOOL
        for target in (target for target in targets if target not in known):
            raise LabError(f"target '{target}' is unknown: robot {self.name} has {', '.join(known)}")

    def refuse_impossible(self, path: Path, data: Measurements) -> None:
        """Refuse joint positions of a file that are impossible for the nominal model, with a LabError."""
        if (lost := np.flatnonzero(~self.chain.is_assemblable(data.joints))).size:
            why = self.chain.infeasibility_reason(data.joints[lost[0]])
            more = f" (and {len(lost) - 1} more)" if len(lost) > 1 else ""
            raise LabError(f"{path}: {data.where(int(lost[0]))}{more}: {why}; mend the joint positions, or use = skip")

    def refuse_beyond_limits(self, path: Path, data: Measurements, slack: float) -> None:
        """Refuse joint positions of a file beyond the limits by more than ``slack`` (rad or m), with a LabError."""
        outside = self.chain.beyond_limits(data.joints, slack)
        if outside.any():
            row, joint = np.argwhere(outside)[0].tolist()
            raise LabError(
                f"{path}: {data.where(row)}, {self.chain.limit_note(joint, data.joints[row, joint])}; mend the pose, "
                "or the column's unit, or take the right --robot"
            )


@dataclass(frozen=True, eq=False, repr=False)
class SerialRobot(Robot):
    """A serial arm."""

    formats: ClassVar[tuple[DescriptionFormat[Any, Any], ...]] = SERIAL_FORMATS
    model: SerialModel

    @property
    def serial_model(self) -> SerialModel:
        """Its model."""
        return self.model

    @property
    def link_compliances(self) -> Array | None:
        """``(n, 4)`` of its links, from its description; None without any."""
        return None if self.model.links is None else self.model.links.compliances

    def _built_arm(self, targets: tuple[str, ...]) -> SerialArm:
        return SerialArm(self.model.chain, targets)

    def simulated_loads(self) -> Loads | None:
        """Return the masses of its model, assumed ones too; None without any."""
        loads = loads_of(self.model)
        return loads if loads.mass_kg.any() else None

    def perturbed(self, errors: GeometryErrors, T_world_tracker: Array, rng: np.random.Generator) -> TrueOpenRobot:
        """Draw errors of every body and joint, or of the entries of the Denavit-Hartenberg table alone."""
        if not errors.table_alone:
            return _perturbed_bodies(self.model, errors, T_world_tracker, rng)
        arm = self.serial_arm(tuple(self.tool))
        sigmas = errors.position_sigma_m, errors.rotation_sigma_rad
        base, table, _ = arm.split(random_table(arm, *sigmas, rng, errors.sampler))
        values = arm.assemble(base, table, arm.split(arm.nominal(self.tool))[2])
        return true_robot_from_table(self.model, arm, values, T_world_tracker)


@dataclass(frozen=True, eq=False, repr=False)
class ClosedRobot(Robot):
    """A mechanism with loops."""

    formats: ClassVar[tuple[DescriptionFormat[Any, Any], ...]] = CLOSED_FORMATS
    model: ClosedModel

    @property
    def serial_model(self) -> SerialModel:
        """Raise an error: a robot with loops has no serial model.

        Raises:
            LabError: always.
        """
        raise LabError(
            f"robot {self.name} has loops: this is for serial arms alone; its identified dimensions are in "
            "calibrated.toml"
        )

    def _built_arm(self, targets: tuple[str, ...]) -> ClosedArm:
        return ClosedArm(self.model.chain, targets)

    def simulated_loads(self) -> None:
        """Return None: a mechanism is rigid."""

    def perturbed(self, errors: GeometryErrors, T_world_tracker: Array, rng: np.random.Generator) -> TrueMechanism:
        """Draw errors of every dimension.

        Raises:
            LabError: an error of serial arms alone is requested.
        """
        if errors.table_alone or errors.joint_offset_sigma:
            raise LabError(
                f"--dh-only and --offset-sigma-mrad are of serial arms; of {self.name} every dimension is off, "
                "its joints' offsets too"
            )
        sigmas = errors.position_sigma_m, errors.rotation_sigma_rad
        values = random_values(self.model.chain, *sigmas, rng, errors.sampler)
        return true_mechanism(self.model, values, T_world_tracker)


@dataclass(frozen=True, eq=False, repr=False)
class TreeRobot(Robot):
    """A robot with several tips, such as a torso with two arms."""

    formats: ClassVar[tuple[DescriptionFormat[Any, Any], ...]] = TREE_FORMATS
    model: TreeModel

    @property
    def serial_model(self) -> SerialModel:
        """Raise an error: a robot with several tips is no serial arm.

        Raises:
            LabError: always.
        """
        raise LabError(
            f"robot {self.name} has several tips ({', '.join(self.model.chain.tips)}): this is for serial arms alone; "
            f"choose one by {option_name('tip')}"
        )

    def on_tips(self, targets: tuple[str, ...]) -> tuple[str, ...]:
        """Return targets, of which one without a tip stands for that of every tip that has it."""
        every = {target: [name for name in self.tool if point_of(name) == target] or [target] for target in targets}
        return tuple(dict.fromkeys(name for target in targets for name in every[target]))

    def _built_arm(self, targets: tuple[str, ...]) -> TreeArm:
        return TreeArm(self.model.chain, targets)

    def simulated_loads(self) -> None:
        """Return None: a robot with several tips is rigid here."""

    def perturbed(self, errors: GeometryErrors, T_world_tracker: Array, rng: np.random.Generator) -> TrueOpenRobot:
        """Draw errors of every body and joint.

        Raises:
            LabError: errors of the table alone are requested.
        """
        if errors.table_alone:
            raise LabError(f"{option_name('dh_only')} is of serial arms; of {self.name} every body is off")
        return _perturbed_bodies(self.model, errors, T_world_tracker, rng)


def _perturbed_bodies(
    model: OpenModel, errors: GeometryErrors, T_world_tracker: Array, rng: np.random.Generator
) -> TrueOpenRobot:
    sigmas = errors.position_sigma_m, errors.rotation_sigma_rad
    perturbation = random_perturbation(model, *sigmas, rng, errors.joint_offset_sigma, errors.sampler)
    return true_robot(model, perturbation, T_world_tracker)
