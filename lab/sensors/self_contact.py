"""Measure a robot with several tips whose tool points touch each other: a ball on one tip in a socket on the other.

In contact two points are one: p_a - p_b = 0, wherever the robot and the instrument stand. Rows in contact and rows of
measured points are fitted together. Contacts alone place no base and give no size, as the residual stays zero where the
robot moves as a whole or shrinks; which parameters are identifiable is therefore decided at poses in contact.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations, fit
from lab.calibration.identify import Identification
from lab.calibration.initial_guess import initial_guess
from lab.calibration.observation import no_extra_residuals, placed_in_instrument_frame
from lab.calibration.sensor import SensorTerms
from lab.core.errors import LabError, option_name
from lab.core.linear_model import triangle, unit_columns
from lab.core.measurements import FIXTURE, Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.formats.measurement_csv import ObservedColumns
from lab.kinematics.gauge import STRUCTURE_POSES, independent_columns, placed_after_tool
from lab.kinematics.model import Model
from lab.kinematics.parameter import Parameter, indices_of_groups
from lab.kinematics.serial.axes_to_dh import Truth
from lab.kinematics.tree import TreeArm, point_of, tip_of
from lab.sensors.contact import FixtureSimulation, without_gaps
from lab.sensors.options import VirtualSetup
from lab.sensors.virtual_sensor import SimulatedReadings, VirtualSensor
from lab.simulation.collisions import collides
from lab.simulation.model import TreeModel
from lab.simulation.tracking import VirtualMeasurement, track_with_errors
from lab.simulation.true_robot import TrueRobot

__all__ = ["SelfContact", "SelfContactSensor"]

_COLUMN, _BETWEEN = "contact", "="  # the column of pairs, and what is between two names in a cell
_IN_CONTACT_M = 1e-11
_ROUNDS, _DRAWN = 20, 8
_TRUE_M = 1e-9  # largest misfit of true parameters in another gauge


@dataclass(frozen=True)
class SelfContact:
    """A robot of which points are measured, in the instrument's frame, and which touches itself.

    Observed are the positions of measured targets (m), then the vector (m) between the two points in contact, zero.

    Attributes:
        arm: the robot, measured by all points: the measured ones first.
        nominal_arm: ``(p,)`` its nominal parameters.
        positions: number of measured targets.
        pairs: of the targets that touch each other, by number; the condition ``fixture`` of a row is that of its pair.
    """

    arm: Model
    nominal_arm: Array
    positions: int
    pairs: tuple[tuple[int, int], ...]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The robot's."""
        return self.arm.parameters

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return self.arm.names

    @property
    def model(self) -> Self:
        """This model, which defines its own observation."""
        return self

    @property
    def targets(self) -> tuple[str, ...]:
        """The measured targets, then the contact."""
        return (*self.arm.targets[: self.positions], _COLUMN)

    @property
    def conditions(self) -> tuple[str, ...]:
        """The robot's, then the number of the pair."""
        return (*self.arm.conditions, FIXTURE)

    @property
    def placed(self) -> tuple[str, ...]:
        """Groups of parameters without a nominal value; without measured points the base is not observed."""
        return placed_in_instrument_frame(self.arm) if self.positions else ("tool",)

    @property
    def units(self) -> Array:
        """``(k + 1,)`` ones: all are lengths."""
        return np.ones(self.positions + 1)

    def within(self, data: Measurements) -> Self:
        """Return the model: no parameter is of some rows alone."""
        return self

    def nominal(self, values: Array) -> Array:
        """Return the robot's own ``(p,)``."""
        return values

    def points(self, inputs: Array, values: Array) -> Array:
        """Return positions and the vector between the points in contact ``(n, k + 1, 3)``, m."""
        points = self.arm.points(inputs[:, :-1], values)
        return np.concatenate([points[:, : self.positions], self._apart(points, inputs[:, -1])], axis=1)

    def observe(self, inputs: Array, values: Array) -> tuple[Array, Array]:
        """Return these, and their derivatives ``(n, k + 1, 3, p)``."""
        points, jacobian = self.arm.observe(inputs[:, :-1], values)
        both = [
            np.concatenate([each[:, : self.positions], self._apart(each, inputs[:, -1])], axis=1)
            for each in (points, jacobian)
        ]
        return both[0], both[1]

    def _apart(self, each: Array, numbers: Array) -> Array:
        """Return ``(n, 1, ...)`` of ``(n, k, ...)``: that of the first point less that of the second of each pair."""
        which = np.array(self.pairs)[np.maximum(numbers.astype(np.int_), 0)]
        rows = np.arange(len(each))
        return np.asarray(each[rows, which[:, 0]] - each[rows, which[:, 1]])[:, None]

    @property
    def unsized(self) -> bool:
        """Check whether contacts alone are observed, which determine the robot's shape and not its size."""
        return not self.positions

    @cached_property
    def scale_link(self) -> int:
        """Index of the length that stays nominal where no point is measured: the one that best gives the size."""
        order = self._without_base
        links = [i for i, each in enumerate(self.parameters) if each.is_link and each.kind == "length"]
        if self.positions:  # which give the size
            return max(links, key=lambda i: abs(self.nominal_arm[i]))
        inputs = self.structure_joints(STRUCTURE_POSES, rng_for(0, "structure"))
        jacobian = triangle(self.observe(inputs, self.rank_point(self.nominal_arm))[1].reshape(-1, len(self.names)))
        conditions = dict[int, float]()
        for i in independent_columns(jacobian, order):
            if i in links and self.nominal_arm[i]:
                seen = independent_columns(jacobian, [*(other for other in order if other != i), i])
                if i not in seen:
                    conditions[i] = float(np.linalg.cond(unit_columns(jacobian)[0][:, list(seen)]))
        return min(conditions, key=lambda i: conditions[i])

    @property
    def _without_base(self) -> list[int]:
        base = indices_of_groups(self.parameters, ["base"])
        return [i for i in self.arm.column_priority() if i not in base]

    def column_priority(self) -> tuple[int, ...]:
        """Return the robot's order; where no point is measured, the longest link after the targets, the base last."""
        if self.positions:
            return self.arm.column_priority()
        order = placed_after_tool(self.parameters, self._without_base, last=self.scale_link)
        return (*order, *indices_of_groups(self.parameters, ["base"]))

    def rank_point(self, values: Array) -> Array:
        """Return the nominal robot's ``(p,)``, which touches itself in the poses of ``structure_joints``."""
        return self.arm.rank_point(self.nominal_arm)

    def structure_joints(self, count: int, rng: np.random.Generator) -> Array:
        """Draw poses of the nominal robot in contact, each pair in turn.

        Raises:
            LabError: the points of a pair never meet.
        """
        return self.inputs_in_contact(count, self.rank_point(self.nominal_arm), rng)

    def inputs_in_contact(self, count: int, values: Array, rng: np.random.Generator) -> Array:
        """Return inputs ``(count, joints + conditions)`` at which a robot of these parameters touches itself.

        Raises:
            LabError: the points of a pair never meet.
        """
        numbers = np.resize(np.arange(len(self.pairs), dtype=np.float64), count)
        found, missing = np.empty((0, 0)), np.arange(count)
        for _ in range(_ROUNDS):
            near = np.column_stack([self.arm.structure_joints(len(missing), rng), numbers[missing]])
            size = near.shape[1] - len(self.conditions)

            def gaps(joints: Array, rows: NDArray[np.int_], near: Array = near, size: int = size) -> Array:
                return self.points(np.concatenate([joints, near[rows, size:]], axis=1), values)[:, -1]

            near[:, :size] = without_gaps(gaps, near[:, :size], np.arange(len(near)))
            touch = np.abs(gaps(near[:, :size], np.arange(len(near)))).max(axis=1) < _IN_CONTACT_M
            if not found.size:
                found = near.copy()
            found[missing[touch]] = near[touch]
            missing = missing[~touch]
            if not len(missing):
                return found
        pair = self.pairs[int(numbers[missing[0]])]
        first, second = (self.arm.targets[i] for i in pair)
        raise LabError(f"{first} and {second} of the nominal robot do not meet: check the robot's limits and points")

    def initial_guess(self, observed: Observations, values: Array) -> Array:
        """Estimate the base and measured targets from the positions; others start at nominal."""
        if not self.positions:
            return values
        rows = observed.seen[:, :-1].any(axis=1)
        points = np.full((int(rows.sum()), len(self.arm.targets), 3), np.nan)
        points[:, : self.positions] = observed.points[rows, :-1]
        positions = Observations(observed.inputs[rows, :-1], points, np.ones(points.shape[:2]))
        found = initial_guess(self.arm, positions, values)
        tool = list(indices_of_groups(self.parameters, ["tool"]))
        unseen = [tool[3 * k + i] for k in range(self.positions, len(self.arm.targets)) for i in range(3)]
        found[unseen] = values[unseen]
        return found

    def extra_residuals(self, values: Array) -> tuple[Array, Array]:
        """Return no further residuals."""
        return no_extra_residuals(self)

    def errors(self, data: Measurements, values: Array) -> Array:
        """Return lengths ``(n, k)`` in m of position errors, and of contacts if the data have them."""
        if data.points.shape[1] == len(self.targets):
            residuals = self.points(data.inputs(self.conditions), values) - data.points
        else:
            residuals = self.arm.points(data.inputs(self.arm.conditions), values)[:, : self.positions] - data.points
        return np.asarray(np.linalg.norm(residuals, axis=2))

    def cv_groups(self, data: Measurements) -> None:
        """Return None: repeats of a configuration are held out together."""

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """The pairs as a file names them: ``left.p1=right.p1``."""
        return tuple(_BETWEEN.join(self.arm.targets[i] for i in pair) for pair in self.pairs)


@dataclass(frozen=True)
class SelfContactSensor(VirtualSensor):
    """Contacts between points of two tips, beside measured points; the column ``contact`` names the two points."""

    name: ClassVar[str] = "self-contact"
    terms: ClassVar[SensorTerms] = SensorTerms(
        measured="points and contacts",
        reading="measured point or contact",
        error="position error",
        placed="base and tool",
        names_targets=True,
    )
    columns: ClassVar[ObservedColumns] = ObservedColumns(texts=(_COLUMN,), observed=name, required=False)
    in_instrument_frame: ClassVar[bool] = True
    read_by: ClassVar[str] = "points"
    setup: ClassVar[tuple[str, ...]] = ("contact_share",)

    def rows(self, data: Measurements) -> NDArray[np.bool_]:
        """Return the rows ``(n,)`` with a measured point or a contact."""
        return np.asarray(super().rows(data) | np.array([bool(cell) for cell in self._cells(data)]))

    def targets(self, data: Measurements) -> tuple[str, ...]:
        """Return the measured targets, then those that touch.

        Raises:
            LabError: a cell names no pair of points on two tips.
        """
        touching = [name for pair in self._pairs(data).values() for name in pair]
        return tuple(dict.fromkeys((*data.targets, *touching)))

    def observation(self, arm: Model, data: Measurements, nominal: Array) -> tuple[Model, Measurements]:
        """Return the robot with its contacts, and the rows with a point or a contact.

        Raises:
            LabError: the column is missing or empty, or a cell names no pair of points on two tips.
        """
        cells, pairs = self._cells(data), self._pairs(data)
        if not pairs:
            raise LabError(
                f"no row has a contact: {option_name('observe')} {self.name} needs a column {_COLUMN} with the two "
                f"points that touch, such as left.p1{_BETWEEN}right.p1"
            )
        seen = [k for k in range(len(data.targets)) if np.isfinite(data.points[:, k]).any()]
        if seen != list(range(len(seen))) or data.targets[: len(seen)] != arm.targets[: len(seen)]:
            raise LabError("columns of points without a single position stand before others; take them out of the file")
        index = {name: i for i, name in enumerate(arm.targets)}
        model = SelfContact(arm, np.asarray(nominal), len(seen), tuple((index[a], index[b]) for a, b in pairs.values()))
        numbers = {cell: i for i, cell in enumerate(pairs)}
        number = np.array([numbers.get(cell, -1) for cell in cells], dtype=np.float64)
        contact = np.where((number >= 0)[:, None, None], 0.0, np.full((len(data), 1, 3), np.nan))
        full = replace(
            data,
            targets=model.targets,
            points=np.concatenate([data.points[:, : len(seen)], contact], axis=1),
            conditions={**data.conditions, FIXTURE: number},
        )
        return model, full.take(np.flatnonzero(self.rows(data)))

    def _cells(self, data: Measurements) -> tuple[str, ...]:
        return data.other.get(_COLUMN, ("",) * len(data))

    def _pairs(self, data: Measurements) -> dict[str, tuple[str, str]]:
        """Return the two points of each cell that names some."""
        found: dict[str, tuple[str, str]] = {}
        for row, cell in enumerate(self._cells(data)):
            if not cell or cell in found:
                continue
            names = tuple(part.strip() for part in cell.split(_BETWEEN))
            if len(names) != 2 or not all(names) or tip_of(names[0]) == tip_of(names[1]):
                raise LabError(
                    f"{data.where(row)}, column {_COLUMN}: '{cell}' is no pair of points on two tips; write "
                    f"left.p1{_BETWEEN}right.p1, or leave it empty"
                )
            found[cell] = (names[0], names[1])
        return found

    def simulate(self, poses: VirtualMeasurement, setup: VirtualSetup) -> SimulatedReadings:
        """Measure points in some poses, and bring the first points of two tips together in as many new ones.

        Raises:
            LabError: the targets are not on two tips, or the share is not between 0 and 1.
        """
        share, count = setup.contact_share, len(poses.joints)
        if not 0 < share < 1:
            raise LabError(f"{option_name('contact_share')} {share:g}: give a share above 0 and below 1")
        touching = min(max(round(share * count), 1), count - 1)
        first = poses.targets[0]
        other = next((target for target in poses.targets if tip_of(target) != tip_of(first)), "")
        if not other:
            raise LabError(
                f"{option_name('observe')} {self.name} takes targets on two tips: give "
                f"{option_name('targets')} such as left.{point_of(first)},right.{point_of(first)}"
            )
        measured, meeting = _split(poses, count - touching)
        data, bad, _ = track_with_errors(measured)
        at = meeting.robot.points(meeting.joints, (first,))[:, 0]
        arm = FixtureSimulation.drawn(self.name, replace(meeting, targets=(first, other)), 3, at)
        contacts = arm.measurements(_joints_touching(arm))
        cells = ("",) * len(data) + (f"{first}{_BETWEEN}{other}",) * touching
        unseen = np.full((touching, *data.points.shape[1:]), np.nan)
        joined = replace(
            data,
            joints=np.concatenate([data.joints, contacts.joints]),
            points=np.concatenate([data.points, unseen]),
            ids=tuple(map(str, range(count))),
            use=data.use + contacts.use,
            sessions=data.sessions + contacts.sessions,
            sigma_m=np.concatenate([data.sigma_m, contacts.sigma_m]),
            lines=data.lines + contacts.lines,
            conditions={
                name: np.concatenate([column, contacts.conditions[name]]) for name, column in data.conditions.items()
            },
            other={**{name: cells + ("",) * touching for name, cells in data.other.items()}, _COLUMN: cells},
        )
        return SimulatedReadings(joined, np.concatenate([bad, arm.bad]))

    def observed_truth(
        self, truth: Truth, found: Identification, real: TrueRobot, placed: Mapping[str, Array]
    ) -> Truth | None:
        """Return the truth, in the gauge of the points and contacts where these show less than the points alone."""
        model = found.model
        assert isinstance(model, SelfContact)
        if set(found.base_set.identifiable) == set(truth.base_set.identifiable):
            return truth
        inputs = model.inputs_in_contact(STRUCTURE_POSES, truth.values, rng_for(0, "structure"))
        exact = model.points(inputs, truth.values)
        start = found.values.copy()
        free = found.base_set.identifiable
        values = fit(
            model, Observations(inputs, exact, np.ones(exact.shape[:2])), free, start, tolerance_m=1e-12
        ).values
        missed = np.abs(model.points(inputs, values) - exact).max()
        return replace(truth, values=values, base_set=found.base_set) if missed < _TRUE_M else None


def _joints_touching(arm: FixtureSimulation) -> Array:
    """Return joint positions ``(n, joints)`` at which the points touch, near those of the nominal robot.

    Raises:
        LabError: the points hardly ever meet without a collision.
    """
    robot = arm.robot.robot
    nominal = TreeArm(robot.chain, arm.targets) if isinstance(robot, TreeModel) else None
    if nominal is None:
        raise LabError(f"robot {robot.chain.name} has one tip, which touches no other; name several as its tips")
    values = nominal.nominal(robot.tool)
    hardly = f"{' and '.join(arm.targets)} hardly meet within the limits and without a collision"

    def nominal_gaps(joints: Array, _: NDArray[np.int_]) -> Array:
        points = nominal.points(joints, values)
        return np.asarray(points[:, 0] - points[:, 1])

    def gap(points: Array, rows: NDArray[np.int_]) -> Array:
        return np.asarray(points[:, 0] - points[:, 1] - arm.noise[rows] - arm.displaced[rows])

    def starts(_: int, missing: NDArray[np.int_]) -> Array:
        """Poses of the nominal robot in contact and free of collisions, all different."""
        free = np.empty((0, robot.chain.size))
        for _round in range(_ROUNDS):
            drawn = robot.chain.random_joints(_DRAWN * len(missing), arm.rng)
            met = without_gaps(nominal_gaps, drawn, np.arange(len(drawn)))
            met = met[np.abs(nominal_gaps(met, np.arange(len(met)))).max(axis=1) < _IN_CONTACT_M]
            met = met[~robot.chain.beyond_limits(met, 0.0).any(axis=1)]
            free = np.concatenate([free, met[~collides(robot, met)]])
            if len(free) >= len(missing):
                return free[: len(missing)]
        raise LabError(f"robot {robot.chain.name}: {hardly}")

    return arm.joints_from(gap, starts, hardly)


def _split(poses: VirtualMeasurement, count: int) -> tuple[VirtualMeasurement, VirtualMeasurement]:
    """Return the first poses of a session, and the others."""
    parts = (slice(None, count), slice(count, None))
    first, rest = (
        replace(
            poses,
            joints=poses.joints[part],
            conditions={name: column[part] for name, column in poses.conditions.items()},
        )
        for part in parts
    )
    return first, rest
