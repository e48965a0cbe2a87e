"""A robot's nominal equations alone: of a table they are read without the simulator, which takes long to load."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from lab.campaign.model_files import description_of, sha256_of
from lab.formats.robot_toml import described_links, is_mechanism, read_table
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.chain import Chain

if TYPE_CHECKING:
    from lab.campaign.robot import Robot

__all__ = ["NominalRobot", "nominal_robot"]


@dataclass(frozen=True)
class NominalRobot:
    """A nominal robot, with the source of its model.

    Attributes:
        chain: the nominal model, whose joints are measured.
        sha256: of the files that it was read from.
        warnings: about the files, for the user.
        source: the name or path that it was loaded by.
        loaded: the whole loaded robot, where available.
    """

    chain: JointSpec
    sha256: str
    warnings: tuple[str, ...]
    source: str
    loaded: "Robot | None" = field(default=None, repr=False)

    @property
    def name(self) -> str:
        """The robot's name."""
        return self.chain.name

    def arm(self, targets: tuple[str, ...]) -> RigidArm:
        """The arm as equations, with these targets."""
        return SerialArm(self.chain, targets) if isinstance(self.chain, Chain) else self.whole.arm(targets)

    @cached_property
    def whole(self) -> "Robot":
        """The robot with its simulated model, loaded when it is first asked for."""
        from lab.campaign.robot import load_robot

        return self.loaded or load_robot(self.source)


def nominal_robot(robot: "str | Path | Robot") -> NominalRobot:
    """A robot's equations: by the name of a model of the lab or a path, or of a robot that is loaded.

    Raises:
        LabError: there is no such robot, or it cannot be read.
    """
    if isinstance(robot, str | Path):
        path = description_of(str(robot))
        if path.suffix == ".toml" and described_links(path) is None and not is_mechanism(path):
            table = read_table(path)
            return NominalRobot(table.chain, sha256_of(path), table.warnings, str(robot))
    from lab.campaign.robot import load_robot

    known = load_robot(robot)
    return NominalRobot(known.chain, known.sha256, known.warnings, known.source, known)
