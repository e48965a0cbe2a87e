"""Compare the calibrations of an arm: what has changed, when, by how much, and which change would be found."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lab.arm_history.dated_runs import DatedRun
from lab.core.errors import LabError
from lab.core.linear_model import half_width_95
from lab.core.measurements import copied_rows
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM, MRAD, Unit
from lab.kinematics.gauge import STRUCTURE_POSES
from lab.kinematics.parameter import Parameter
from lab.library.load_run import CalibrationRun, refuse_other_parameters
from lab.prediction.estimate import SETUP, Estimate, IdentifiedSubset
from lab.verification.parameter_changes import CalibrationSeries, ChangeDirections, ParameterChange

__all__ = ["Changes", "changes_between"]

_WITHIN = 1e-6  # of a joint's effect that the identified parameters may lack


@dataclass(frozen=True)
class Changes:
    """The calibrations of an arm in order, and the changes between them.

    Attributes:
        dated: the calibrations.
        runs: what each identified.
        estimates: the compared parameters of each.
        found: the changes, in order.
        detectable: the smallest shift of each joint's zero (rad; m of a slide) that one more calibration detects in 95
            of 100; infinite where nothing shows it.
    """

    dated: tuple[DatedRun, ...]
    runs: tuple[CalibrationRun, ...]
    estimates: tuple[IdentifiedSubset, ...]
    found: tuple[ParameterChange, ...]
    detectable: tuple[float, ...]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters that are compared."""
        of = {each.name: each for each in self.runs[0].estimate.arm.parameters}
        return tuple(of[name] for name in self.estimates[0].names)

    @property
    def joint_units(self) -> tuple[Unit, ...]:
        """The unit in which a shift of each joint's zero is displayed."""
        return tuple(MM if slides else MRAD for slides in self.runs[-1].estimate.rigid.chain.prismatic)

    def unit(self, name: str) -> Unit:
        """Return the unit in which a change of a parameter, or of the zero of a joint, is displayed."""
        zeros = {_zero(i): unit for i, unit in enumerate(self.joint_units)}
        return {**zeros, **{each.name: each.unit_of_change for each in self.parameters}}[name]

    @property
    def shifts(self) -> Array:
        """Differences ``(n, f)`` of the parameters from the first calibration (SI), angles by less than half a turn."""
        values = np.array([each.values - self.estimates[0].values for each in self.estimates])
        turned = np.remainder(values + np.pi, 2 * np.pi) - np.pi
        return np.where(np.array(self.estimates[0].is_angle), turned, values)

    @property
    def half_widths(self) -> Array:
        """Half-widths ``(n, f)`` of the differences' 95 % intervals; zero of the first calibration."""
        first, rows = self.estimates[0], [np.zeros(len(self.estimates[0].names))]
        for each in self.estimates[1:]:
            dof = min(each.dof or np.inf, first.dof or np.inf)
            rows.append(half_width_95(dof) * np.sqrt(np.diag(first.covariance + each.covariance)))
        return np.array(rows)

    def at_tool_m(self, change: ParameterChange) -> float:
        """Return how far a change takes the first target (m, RMS over random poses), base and tool the same."""
        estimate = self.runs[0].estimate
        arm, values = estimate.arm, estimate.values.copy()
        names = [name for name in change.named if name in arm.names]
        for name in names if change.several else names[:1]:
            values[arm.names.index(name)] += change.changes[change.named.index(name)]
        inputs = arm.structure_joints(STRUCTURE_POSES, rng_for(0, "structure"))
        apart = (arm.points(inputs, values) - arm.points(inputs, estimate.values))[:, 0]
        return float(np.sqrt((apart**2).sum(axis=1).mean()))


def changes_between(dated: Sequence[DatedRun], runs: Sequence[CalibrationRun], kept: Sequence[str]) -> Changes:
    """Test after each of one or more calibrations of an arm whether it has changed.

    Args:
        kept: parts that were not set up anew between them, and are compared with the links.

    Raises:
        LabError: they are of different robots, have other parameters, or one is a copy of another.
    """
    without = tuple(group for group in SETUP if group not in kept)
    estimates = [run.estimate.subset(without) for run in runs]
    refuse_other_parameters(runs, estimates)
    if copies := copied_rows(np.stack([each.values for each in estimates])):
        folder, same = (runs[i].folder for i in copies[0])
        raise LabError(
            f"{folder}: has the parameters of {same}, to the last digit; give a different calibration of the robot"
        )
    names, last = estimates[0].names, runs[-1].estimate
    zeros = _joint_zeros(last)[[last.free_names.index(name) for name in names]]
    series = CalibrationSeries(estimates, _days(dated), _directions(names, zeros))
    changes = series.change_points()
    return Changes(tuple(dated), tuple(runs), tuple(estimates), changes, _detectable(series, zeros, changes))


def _days(dated: Sequence[DatedRun]) -> list[float]:
    """Return the days from the first calibration with a date; zero of one without."""
    first = next((each.on for each in dated if each.on is not None), None)
    return [0.0 if each.on is None or first is None else float((each.on - first).days) for each in dated]


def _detectable(series: CalibrationSeries, zeros: Array, changes: Sequence[ParameterChange]) -> tuple[float, ...]:
    """Return the smallest shift of each joint's zero that one more calibration detects; infinite if nothing shows it.

    Args:
        zeros: change of the parameters ``(f, joints)`` per unit of joint zero; NaN where none makes it.
    """
    shown = np.isfinite(zeros).all(axis=0) & (zeros != 0).any(axis=0)
    start = max((change.after + 1 for change in changes), default=0)
    sizes = series.detectable(np.where(shown, np.nan_to_num(zeros), 0.0), start)
    return tuple(np.where(shown, sizes, np.inf).tolist())


def _zero(joint: int) -> str:
    return f"zero of joint {joint + 1}"


def _joint_zeros(estimate: Estimate) -> Array:
    """Compute the change of the identified parameters ``(f, joints)`` per unit of joint zero; NaN if impossible."""
    arm, at = estimate.arm, list(estimate.free)
    inputs = arm.structure_joints(STRUCTURE_POSES, rng_for(0, "structure"))
    jacobian = arm.observe(inputs, arm.rank_point(estimate.nominal))[1].reshape(-1, len(arm.names))
    wanted = jacobian @ arm.rigid.joint_derivatives(np.eye(len(arm.names)))
    size = np.linalg.norm(jacobian[:, at], axis=0)
    found = np.linalg.lstsq(jacobian[:, at] / size, wanted, rcond=None)[0]
    left = np.linalg.norm(jacobian[:, at] / size @ found - wanted, axis=0)
    found = np.where(np.abs(found) > _WITHIN * np.abs(found).max(), found, 0.0) / size[:, None]
    return np.where(left > _WITHIN * np.linalg.norm(wanted, axis=0), np.nan, found)


def _directions(names: tuple[str, ...], zeros: Array) -> ChangeDirections:
    """Return the tested directions: each parameter, and each observable joint zero that is no single parameter."""
    other = [i for i in range(zeros.shape[1]) if np.count_nonzero(zeros[:, i]) > 1 and np.isfinite(zeros[:, i]).all()]
    columns = np.concatenate([np.eye(len(names)), zeros[:, other]], axis=1)
    return ChangeDirections((*names, *map(_zero, other)), columns)
