"""What can be asked of ``lab dynamics``."""

from dataclasses import dataclass

from lab.campaign.option_groups import Names
from lab.core.errors import LabError

__all__ = ["PARTS", "DynamicsOptions"]

PARTS = ("motor-inertia", "friction", "offsets")  # of the model, beside the links


@dataclass(frozen=True)
class DynamicsOptions:
    """Whose dynamic parameters, and which belong to the model."""

    robot: str = "irb120"
    """A model's name, or a path to an MJCF, a URDF or a table."""
    without: Names = ()
    """Leave out of the model: motor-inertia, friction, offsets."""

    def check(self) -> None:
        """Refuse what makes no sense, with a LabError that names the option."""
        for part in self.without:
            if part not in PARTS:
                raise LabError(f"--without {part}: there are {', '.join(PARTS)}")
