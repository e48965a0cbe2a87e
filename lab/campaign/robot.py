"""A robot by name or path: a folder of ``models``, an MJCF, a URDF, or a table."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import lab
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.formats.dh_table_toml import read_table
from lab.formats.mechanism_toml import is_mechanism, read_mechanism
from lab.kinematics.closed.arm import ClosedArm
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.effects.arm import Arm, affected
from lab.kinematics.effects.groups import SessionInfo, effect
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.kinematics.serial.arm import DEFAULT_TOOL, SerialArm
from lab.simulation.build_serial import table_model
from lab.simulation.closed_robot import closed_model
from lab.simulation.link_masses import loads_of
from lab.simulation.load_mjcf_urdf import load_model
from lab.simulation.model import RobotModel, SerialModel

DESCRIPTION = "mechanism.toml"


@dataclass(frozen=True)
class Robot:
    """What the lab knows of a robot before anything is measured.

    Attributes:
        tool: the targets it has (m, in the last frame).
        model: its MuJoCo model; of a robot given as a table, one that is built from it.
        loads: its masses, for what gravity does; None where the file gives none.
        sha256: of the files that it was read from.
    """

    name: str
    chain: JointSpec
    tool: dict[str, Array]
    model: RobotModel
    sha256: str
    warnings: tuple[str, ...] = ()
    loads: Loads | None = None

    def arm(self, targets: tuple[str, ...]) -> RigidArm:
        """The arm as equations, with these targets."""
        if isinstance(self.chain, Mechanism):
            return ClosedArm(self.chain, targets)
        return self.serial_arm(targets)

    def serial_arm(self, targets: tuple[str, ...]) -> SerialArm:
        """The same, of a serial arm."""
        return SerialArm(self.serial_model.chain, targets)

    @property
    def serial_model(self) -> SerialModel:
        """Its model, for what is of serial arms alone; a LabError where it has loops."""
        if not isinstance(self.model, SerialModel):
            raise LabError(
                f"robot {self.name} has loops: this is for serial arms alone; its identified dimensions are in "
                "calibrated.toml"
            )
        return self.model

    def arm_with(
        self,
        targets: tuple[str, ...],
        groups: Sequence[str],
        course: SessionInfo = SessionInfo(),  # noqa: B008
    ) -> Arm:
        """The arm with groups of effects (``geometry.effects``), by name, for measurements of such a course.

        Raises:
            LabError: there is no such group, or no masses or sessions for it, or two do not go together.
        """
        if isinstance(self.chain, Mechanism) and (bent := {"compliance", "payload"} & set(groups)):
            raise LabError(f"--model {min(bent)}: robot {self.name} has loops, and nothing bends such a robot here")
        return affected(self.arm(targets), [effect(name, self.chain, self.loads, course) for name in groups])

    @property
    def is_table(self) -> bool:
        """Whether it was given as a table, not as a model."""
        return self.model.path.suffix == ".toml"

    def refuse_unknown(self, targets: tuple[str, ...]) -> None:
        """A LabError for a target that the robot (or the default tool, if it has none) does not have."""
        known = self.tool or DEFAULT_TOOL
        for target in targets:
            if target not in known:
                raise LabError(f"target '{target}' is unknown: robot {self.name} has {', '.join(known)}")

    def refuse_impossible(self, path: Path, data: Measurements) -> None:
        """A LabError for readings of a file at which the drawing cannot stand."""
        if (lost := np.flatnonzero(~self.chain.is_assemblable(data.joints))).size:
            why = self.chain.infeasibility_reason(data.joints[lost[0]])
            more = f" (and {len(lost) - 1} more)" if len(lost) > 1 else ""
            raise LabError(f"{path}: {data.where(int(lost[0]))}{more}: {why}; mend the readings, or use = skip")

    def refuse_beyond_limits(self, path: Path, data: Measurements, slack: float) -> None:
        """A LabError for readings of a file that are beyond the limits by more than ``slack`` (rad or m)."""
        outside = self.chain.beyond_limits(data.joints, slack)
        if outside.any():
            row, joint = np.argwhere(outside)[0].tolist()
            raise LabError(
                f"{path}: {data.where(row)}, {self.chain.said_beyond(joint, data.joints[row, joint])}; mend the pose, "
                "or the column's unit, or take the right --robot"
            )


def models_folder() -> Path:
    """Where the robots live: in the installed package, or beside it in a checkout."""
    installed = Path(lab.__file__).parent / "models"
    return installed if installed.is_dir() else installed.parent.parent / "models"


def _models() -> dict[str, Path]:
    """The lab's own robots by name: a folder's, and ``<folder>/<file>`` of what else a mechanism's folder describes."""
    found = {}
    for folder in sorted(path for path in models_folder().iterdir() if (path / "README.md").is_file()):
        files = [folder / name for name in (DESCRIPTION, "scene.xml", "robot.xml", "robot.toml")]
        found[folder.name] = next((path for path in files if path.is_file()), folder)
        if found[folder.name].name == DESCRIPTION:
            found |= {f"{folder.name}/{path.stem}": path for path in sorted(folder.glob("*.toml")) if path not in files}
    return found


def load_robot(robot: str) -> Robot:
    """Load a robot given as on the command line.

    Raises:
        LabError: there is no such robot (the message lists those there are), or it cannot be read.
    """
    models = _models()
    path = models.get(robot, Path(robot))
    if path.suffix not in (".xml", ".urdf", ".toml") or not path.is_file():
        raise LabError(
            f"robot '{robot}': no such model or file; there are {', '.join(models)}, or give a path to .xml, .urdf or "
            ".toml"
        )
    sha256 = _sha256(path)
    if path.suffix == ".toml" and is_mechanism(path):
        described = read_mechanism(path)
        closed = closed_model(path, described)
        return Robot(closed.chain.name, closed.chain, closed.tool, closed, sha256, described.warnings)
    if path.suffix == ".toml":
        table = read_table(path)
        model, warnings = table_model(path, table), table.warnings
    else:
        model = load_model(path)
        warnings = (f"{model.missing}, so no shape is shown",) if model.missing else ()
    loads = None if model.weighed else _some(loads_of(model))
    return Robot(model.chain.name, model.chain, model.tool, model, sha256, warnings, loads)


def load_virtual(robot: str) -> Robot:
    """Load a robot that is to stand for reality: what its file does not say of shapes and masses is assumed, and told.

    Raises:
        LabError: it cannot be loaded, or meshes that it needs cannot be read.
    """
    found = load_robot(robot)
    if found.model.missing:
        raise LabError(f"{found.model.missing}, but a virtual arm needs them: put them there, or take out what asks")
    said = (f"robot {found.name}: {found.model.assumed}",) if found.model.assumed else ()
    loads = _some(loads_of(found.model)) if isinstance(found.model, SerialModel) else None
    return replace(found, loads=loads, warnings=(*found.warnings, *said))


def _some(loads: Loads) -> Loads | None:
    """Masses, if there are any."""
    return loads if loads.mass_kg.any() else None


def _sha256(path: Path) -> str:
    """Of a model's folder of the lab without its README, else of the file alone."""
    digest = hashlib.sha256()
    whole = path.parent.parent == models_folder()
    files = sorted(p for p in path.parent.rglob("*") if p.suffix in (".xml", ".stl", ".toml")) if whole else [path]
    for file in files:
        digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()
