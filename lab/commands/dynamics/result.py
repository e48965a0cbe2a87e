"""The dynamic parameters of an arm: typed, and as plain values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lab.campaign.robot import Robot
from lab.commands.dynamics.options import DynamicsOptions
from lab.commands.result import Result
from lab.commands.values import plain_numbers
from lab.kinematics.dynamics.arm_dynamics import ArmDynamics
from lab.kinematics.dynamics.base_parameters import BaseParameters
from lab.kinematics.dynamics.regrouping import Formula

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lab.render.document import Document

__all__ = ["DynamicsResult"]


@dataclass(frozen=True, repr=False, eq=False)
class DynamicsResult(Result):
    """What of an arm's dynamics its torques can show.

    Attributes:
        options: what was asked.
        arm: the inverse dynamic model.
        base: its base parameters.
        formulas: what each of them is made of.
        singular_values: ``(b,)`` of the base regressor with unit columns over random states, largest first.
    """

    options: DynamicsOptions
    robot: Robot
    arm: ArmDynamics
    base: BaseParameters
    formulas: tuple[Formula, ...]
    singular_values: tuple[float, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a reader should be told of the robot."""
        return self.robot.warnings

    @property
    def exit_code(self) -> int:
        """0: a base set is neither good nor bad."""
        return 0

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints: base parameters with their formulas, and what affects no torque."""
        base = self.base
        return {
            "robot": self.robot.name,
            "gravity_m_per_s2": plain_numbers(self.arm.gravity),
            "standard_parameters": len(base.names),
            "base_parameters": base.size,
            "inertial_base_parameters": base.inertial,
            "formulas": {formula.label: formula.words() for formula in self.formulas},
            "without_effect": [base.names[i] for i in base.without_effect],
            "warnings": list(self.warnings),
        }

    def document(self) -> "Document":
        """What a person reads: the base parameters, and what is grouped into each."""
        from lab.commands.dynamics.document import dynamics_document

        return dynamics_document(self)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each base parameter: its name, its formula and its unit."""
        names = [formula.name for formula in self.formulas]
        return {
            "parameter": [formula.label for formula in self.formulas],
            "formula": [formula.words() for formula in self.formulas],
            "unit": list(self.arm.units(names)),
        }

    def plot(self) -> "Figure":
        """Draw the singular values of the base regressor over random states, columns of unit length."""
        from lab.commands.dynamics.document import singular_values_picture

        return singular_values_picture(self).draw()

    def write(self, folder: Path) -> None:
        """Write ``config.json``, ``result.json`` and ``report.html``."""
        from lab.commands.run_folder import config, write_json

        write_json(folder / "config.json", config("dynamics", self.options, self.robot.sha256))
        write_json(folder / "result.json", self.to_dict())
        self.report(folder / "report.html")
