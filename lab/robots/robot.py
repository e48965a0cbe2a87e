"""Load a robot by name or path: a folder of ``models``, an MJCF, a URDF, or a table.

Each kind of robot has its formats of description. The first is the one that a run keeps of a robot given as a model;
the last, exact to the bit, that of a robot given as a table or as a mechanism.
"""

import hashlib
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from os import PathLike, fspath
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

import numpy as np

from lab.calibration.on_arrays import ArmOnArrays, target_names
from lab.core.errors import LabError, error_context, option_name
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.core.values import Value
from lab.formats.cell_toml import Cell, read_cell
from lab.formats.description import DescriptionFormat, IdentifiedRobot, with_comment
from lab.formats.mechanism_toml import MECHANISM_TOML, read_mechanism
from lab.formats.robot_toml import TABLE_TOML, described_links, is_mechanism, links_of, read_table
from lab.formats.ur_calibration import UR_CORRECTIONS, UR_KINEMATICS
from lab.kinematics.closed.closed_arm import ClosedArm
from lab.kinematics.dynamics.gravity import Loads, refuse_without_length
from lab.kinematics.effects.arm_with_effects import Arm, affected
from lab.kinematics.effects.effect import SessionInfo
from lab.kinematics.effects.effect_registry import effect
from lab.kinematics.effects.sessions import stations
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.kinematics.serial.serial_arm import DEFAULT_TOOL, SerialArm
from lab.kinematics.tree import TreeArm, point_of
from lab.robots.config_file import CONFIG_FILE
from lab.robots.robot_files import description_of, ends_of, is_own, joined, parted, sha256_of
from lab.simulation.build_serial import table_model
from lab.simulation.cell import implausible, in_cell
from lab.simulation.closed_robot import (
    CLOSED_MJCF,
    ClosedModel,
    TrueMechanism,
    closed_model,
    random_values,
    true_mechanism,
)
from lab.simulation.load_model import MJCF, TREE_MJCF, URDF, XACRO, load_model, loads_of
from lab.simulation.robot_model import OpenModel, Origin, RobotModel, SerialModel, TreeModel
from lab.simulation.robot_plausibility import implausible_robot
from lab.simulation.true_robot import (
    GeometryErrors,
    TrueOpenRobot,
    TrueRobot,
    random_perturbation,
    random_table,
    true_robot,
    true_robot_from_table,
)

__all__ = [
    "CLOSED_FORMATS", "SERIAL_FORMATS", "TREE_FORMATS", "ClosedRobot", "Robot", "SerialRobot", "TreeRobot",
    "load_robot", "load_virtual", "robot_of_call",
]  # fmt: skip


_Model = TypeVar("_Model", bound=RobotModel)
_MAKER_FORMATS: tuple[DescriptionFormat[SerialArm, SerialModel], ...] = (UR_KINEMATICS, UR_CORRECTIONS)
SERIAL_FORMATS: tuple[DescriptionFormat[SerialArm, SerialModel], ...] = (MJCF, URDF, XACRO, *_MAKER_FORMATS, TABLE_TOML)
CLOSED_FORMATS: tuple[DescriptionFormat[ClosedArm, ClosedModel], ...] = (CLOSED_MJCF, MECHANISM_TOML)
TREE_FORMATS: tuple[DescriptionFormat[TreeArm, TreeModel], ...] = (TREE_MJCF,)


@dataclass(frozen=True, eq=False, repr=False)
class Robot(Value, ArmOnArrays):
    """A robot before any measurement.

    Robots are equal if all their data are. A pickled robot is loaded again from its files, which must be
    unchanged. ``points``, ``jacobian`` and so on work on plain arrays: one configuration or many.

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
        return SerialArm(self.serial_model.chain, targets)

    @abstractmethod
    def arm(self, targets: tuple[str, ...]) -> RigidArm:
        """Return the kinematic model with these targets."""

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
        return affected(self.arm(targets), [*stations(session.stations), *named])

    def _modelled(self, targets: Sequence[str] | None) -> tuple[Arm, Array, Array]:
        """Return the nominal model, its base at the origin; all targets of the tool unless some are named."""
        names = tuple(self.tool or DEFAULT_TOOL) if targets is None else target_names(targets)
        self.refuse_unknown(names)
        arm = self.arm(names)
        nominal = arm.nominal(self.tool)
        return arm, nominal, nominal

    @abstractmethod
    def _simulated_loads(self) -> Loads | None:
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
        return (self.stored_file, *(each.file for each in _MAKER_FORMATS if each.file in self.description_files))

    def placed_in(self, cell: Path | None) -> Self:
        """Return the robot in the cell of a file; unchanged without a file.

        Raises:
            LabError: the file cannot be read, or is not for such a robot.
        """
        if cell is None:
            return self
        described = read_cell(cell)
        model = _in_cell(self.model, described)
        warnings = (*self.warnings, *implausible(model, described))
        placed = replace(self, model=model, warnings=warnings)
        return placed if self.loads is None else replace(placed, loads=placed._simulated_loads())

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

    def arm(self, targets: tuple[str, ...]) -> SerialArm:
        """Return the kinematic model with these targets."""
        return self.serial_arm(targets)

    def _simulated_loads(self) -> Loads | None:
        return _some(loads_of(self.model))

    def perturbed(self, errors: GeometryErrors, T_world_tracker: Array, rng: np.random.Generator) -> TrueOpenRobot:
        """Draw errors of every body and joint, or of the entries of the Denavit-Hartenberg table alone."""
        if not errors.table_alone:
            return _perturbed_bodies(self.model, errors, T_world_tracker, rng)
        arm = self.arm(tuple(self.tool))
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

    def arm(self, targets: tuple[str, ...]) -> ClosedArm:
        """Return the kinematic model with these targets on its platform."""
        return ClosedArm(self.model.chain, targets)

    def _simulated_loads(self) -> None:
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

    def arm(self, targets: tuple[str, ...]) -> TreeArm:
        """Return the kinematic model with these targets on its tips."""
        return TreeArm(self.model.chain, targets)

    def _simulated_loads(self) -> None:
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


def load_robot(
    robot: str | PathLike[str] | Robot, cell: Path | None = None, *, tips: Sequence[str] = (), base: str = ""
) -> Robot:
    """Load a robot: its nominal model, masses and warnings.

    Args:
        robot: the name of a model of the lab; a path to an MJCF, a URDF, or a TOML table or mechanism; or the folder
            of a run of ``lab identify`` or ``lab calibrate``, or what ``lab.load_run`` made of it, for its calibrated
            robot (geometry alone). A loaded robot is unchanged.
        cell: the file that describes its cell, if any.
        tips: of an MJCF or a URDF: the bodies, links or sites that are the ends of its chains. One makes a serial arm,
            several a robot with several tips, whose targets are ``<tip>.p1`` and so on. By default the only chain, or
            every site ``<tip>.flange``.
        base: the body or link below the first joint; joints that move it are held at zero.

    Returns:
        The robot, with warnings on its files.

    Raises:
        LabError: there is no such robot, or it or its cell cannot be read.

    Example:
        >>> import lab
        >>> robot = lab.load_robot("irb120")
        >>> robot.name, len(robot.chain.joint_names)
        ('irb120', 6)
    """
    if isinstance(robot, Robot):
        if tips or base:
            raise LabError(f"robot {robot.name} is loaded already; name its tips where it is loaded")
        return robot.placed_in(cell)
    if not isinstance(robot, str | PathLike):
        raise LabError(f"a robot is given as {type(robot).__name__}; give a name, a path, or a loaded robot")
    source = joined(fspath(robot), base, tips)
    if (Path(source) / CONFIG_FILE).is_file():
        source = _calibrated(Path(source))
    loaded = _loaded(source)
    origin = replace(loaded.model.origin, source=source)
    return replace(loaded, model=replace(loaded.model, origin=origin)).placed_in(cell)


def robot_of_call(call: str, data: object, robot: str | Path | Robot | None) -> Robot:
    """Return the robot that a call was given for measured data; without data the default ``irb120``.

    Raises:
        LabError: data are given without a robot, or it cannot be loaded.
    """
    if robot is None and data is not None:
        raise LabError(f"{call}: {data} names no robot; give robot=")
    return load_robot("irb120" if robot is None else robot)


def _calibrated(run: Path) -> str:
    """Return the path of the calibrated robot in a run's folder."""
    for name in ("calibrated.toml", "calibrated.xml"):
        if (run / name).is_file():
            return str(run / name)
    raise LabError(f"{run}: holds no calibrated robot; give the folder of a run of lab identify or lab calibrate")


def _load_again(origin: Origin) -> RobotModel:
    """Load the model of a pickled robot; refuse missing or changed files."""
    loaded = load_robot(origin.source)
    if loaded.sha256 != origin.sha256:
        raise LabError(f"{origin.source}: the robot's files changed since it was pickled; load it anew")
    return loaded.model if origin.cell is None else _in_cell(loaded.model, origin.cell)


def _in_cell(model: _Model, cell: Cell) -> _Model:
    return replace(in_cell(model, cell), origin=replace(model.origin, cell=cell))


def _loaded(robot: str) -> Robot:
    name, ends = parted(robot)
    path = description_of(name)
    digest = sha256_of(path)
    if ends:
        digest = hashlib.sha256(f"{digest} {ends}".encode()).hexdigest()
    return (_read_once if is_own(path) else _read)(path, digest, ends)


def _read(path: Path, sha256: str, ends: str = "") -> Robot:
    if ends and path.suffix == ".toml":
        raise LabError(
            f"{path}: is a table, whose tips are its own; leave out {option_name('tip')} and {option_name('base')}"
        )
    if path.suffix == ".toml" and (links := described_links(path)) is not None:
        return _with_links(path, sha256, *links)
    if path.suffix == ".toml" and is_mechanism(path):
        described = read_mechanism(path)
        closed = closed_model(path, described)
        return ClosedRobot(replace(closed, origin=Origin(str(path), sha256, load=_load_again)), described.warnings)
    if path.suffix == ".toml":
        table = read_table(path)
        model, warnings = table_model(path, table), table.warnings
    else:
        base, tips = ends_of(ends)
        loaded = load_model(path, tips, base)
        warnings = (f"{loaded.missing}, so no shape is shown",) if loaded.missing else ()
        if loaded.overlapping:
            pairs = ", ".join(f"{first} and {second}" for first, second in loaded.overlapping)
            warnings = (*warnings, f"{pairs} touch by construction: their contacts are not checked")
        if loaded.fixed_joints:
            why = "move no tip, or the base: they are" if ends else "are taken for a gripper's, and"
            warnings = (*warnings, f"{', '.join(loaded.fixed_joints)} {why} held at zero")
        chains = loaded.chain.chains if isinstance(loaded, TreeModel) else (loaded.chain,)
        warnings = (*warnings, *implausible_robot(chains, str(path)))
        if isinstance(loaded, TreeModel):
            return TreeRobot(replace(loaded, origin=Origin(str(path), sha256, load=_load_again)), warnings)
        model = loaded
    loads = None if model.masses_assumed else _some(loads_of(model))
    if model.links is not None:
        with error_context(path):
            refuse_without_length(loads_of(model), model.links)
    return SerialRobot(replace(model, origin=Origin(str(path), sha256, load=_load_again)), warnings, loads)


_read_once = cache(_read)  # by digest: robots are immutable


def _with_links(path: Path, sha256: str, base: str, sections: object) -> Robot:
    beside = path.parent / base if (path.parent / base).is_file() else Path(base)
    if beside.suffix == ".toml" and beside.is_file() and described_links(beside) is not None:
        raise LabError(f"{path}: robot {base} names another robot in its turn; give that one")
    loaded = _loaded(str(beside))
    with error_context(path):
        model = loaded.serial_model
        if model.links is not None:
            raise LabError(f"robot {base} has [[link]] sections of its own; change those")
    links = links_of(path, sections, model.chain.size)
    both = hashlib.sha256(f"{loaded.sha256} {sha256}".encode()).hexdigest()
    model = replace(model, links=links, origin=Origin(str(path), both, load=_load_again))
    with error_context(path):
        refuse_without_length(loads_of(model), links)
    loads = None if loaded.loads is None else loads_of(model)
    return replace(loaded, model=model, loads=loads)


def load_virtual(robot: str | Path | Robot, cell: Path | None = None) -> Robot:
    """Load a robot for a virtual arm: missing shapes and masses are assumed, with a warning.

    Raises:
        LabError: it cannot be loaded, or meshes that it needs cannot be read.
    """
    found = load_robot(robot, cell)
    if found.model.missing:
        raise LabError(f"{found.model.missing}, but a virtual arm needs them: add them, or remove what needs them")
    messages = (
        (*found.warnings, f"robot {found.name}: {found.model.assumed}") if found.model.assumed else found.warnings
    )
    return replace(found, loads=found._simulated_loads(), warnings=tuple(dict.fromkeys(messages)))


def _some(loads: Loads) -> Loads | None:
    return loads if loads.mass_kg.any() else None
