"""What a robot is, and what of it can be identified: as plain values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lab.campaign.robot import Robot
from lab.commands.inspect.options import InspectOptions
from lab.commands.result import Result
from lab.core.se3 import Array
from lab.kinematics.parameter import Parameter

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lab.render.document import Document

__all__ = ["Inspection"]


@dataclass(frozen=True, repr=False, eq=False)
class Inspection(Result):
    """A robot's nominal model, its limits, its shape, and what of it can be identified.

    Attributes:
        options: what was asked.
        values: what ``to_dict`` gives: millimetres and degrees; aliases in SI units.
        parameters: all of the arm, in the order of its values.
        singular_values: ``(r,)`` of the Jacobian with unit columns over random poses, largest first.
    """

    options: InspectOptions
    robot: Robot
    values: Mapping[str, Any]
    parameters: tuple[Parameter, ...]
    singular_values: Array

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a reader should be told of the robot."""
        return self.robot.warnings

    @property
    def exit_code(self) -> int:
        """0: a robot that can be read is neither good nor bad."""
        return 0

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints: millimetres and degrees; aliases in SI units; None where not finite."""
        return dict(self.values)

    def document(self) -> "Document":
        """What a person reads: the nominal model, its shape, and what can be identified."""
        from lab.commands.inspect.document import inspection_document

        return inspection_document(self)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each parameter that is identifiable or aliased: its name, and with what it is aliased."""
        kept, aliases = self.values["identifiable"], self.values["aliases"]
        return {
            "parameter": [*kept, *aliases],
            "identifiable": [True] * len(kept) + [False] * len(aliases),
            "aliased_with": [""] * len(kept) + [", ".join(into) for into in aliases.values()],
        }

    def plot(self) -> "Figure":
        """Draw the singular values of the Jacobian (unit columns) of the identifiable parameters, largest first."""
        from lab.commands.inspect.document import singular_values_picture

        return singular_values_picture(self).draw()

    def write(self, folder: Path) -> None:
        """Write ``config.json``, ``result.json`` and ``report.html``."""
        from lab.commands.run_folder import write_config, write_json

        write_config(folder, "inspect", self.options, self.robot.sha256)
        write_json(folder / "result.json", self.to_dict())
        self.report(folder / "report.html")
