"""Measurements of things whose places nobody knows: anchors of a cable, sockets, planes.

Each place adds three parameters, and carries what a base would: the base stays at the origin. A residual that
is zero where the arm touches its place is zero too when arm and place shrink together; what can be told apart is
therefore decided at poses that touch, and the longest link is the scale unless a distance is known.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations, fit
from lab.calibration.observations.protocol import no_extra_residuals
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.model import Model
from lab.kinematics.parameter import Parameter, indices_of_groups, names_of, placed_parameters

PLACE = "place"  # the condition that numbers a row's place
TOUCHES = 1e-11  # m
JUDGED = 2  # times the rows that its place takes, and a place is judged by its own
_NEWTON_STEPS = 12
_LONGEST_STEP = 0.5  # rad or m of a joint
_DIFFERENCE = 1e-7
_ROUNDS = 20


@dataclass(frozen=True)
class Fixtures(ABC):
    """An arm with one target, and places that it is tied to or touches.

    Attributes:
        arm: the arm, seen by one point.
        drawing: ``(arm's p,)`` the drawing's parameters, base at the origin.
        numbers: of the places, as the condition ``place`` says them, ascending.
        labels: of the places, as their parameters say them: ``anchor.<label>.x``; "" if it has no name.
    """

    arm: Model
    drawing: Array
    numbers: tuple[int, ...]
    labels: tuple[str, ...]
    parameters: tuple[Parameter, ...] = field(init=False, repr=False)
    names: tuple[str, ...] = field(init=False)
    group: ClassVar[str]  # what a place is called
    axes: ClassVar[tuple[str, str, str]] = ("x", "y", "z")
    least_rows: ClassVar[int]  # that say anything of the arm beyond the place
    touched: ClassVar[bool]  # whether the residual is zero at the place
    offset: ClassVar[tuple[Parameter, ...]] = ()  # a parameter that adds to all that is observed, if there is one

    def __post_init__(self) -> None:
        assert len(self.arm.targets) == 1 and len(self.drawing) == len(self.arm.names)
        owners = [f"{self.group}.{label}" if label else self.group for label in self.labels]
        added = [parameter for owner in owners for parameter in placed_parameters(owner, self.group, self.axes)]
        object.__setattr__(self, "parameters", (*self.arm.parameters, *self.offset, *added))
        object.__setattr__(self, "names", names_of(self.parameters))

    @abstractmethod
    def seen(self, points: Array, places: Array) -> tuple[Array, Array, Array]:
        """Observed ``(n, d)`` of points and their places ``(n, 3)``; derivatives ``(n, d, 3)`` by either."""

    @abstractmethod
    def placed_by(self, points: Array, observed: Array) -> Array:
        """A place ``(3,)`` from predicted points ``(m, 3)`` and what was observed there ``(m, d)``."""

    @abstractmethod
    def through(self, points: Array, rng: np.random.Generator) -> Array:
        """Places ``(m, 3)``, else random, that the points ``(m, 3)`` touch."""

    @property
    def first(self) -> int:
        """The index of the first place's first parameter."""
        return len(self.arm.names) + len(self.offset)

    @property
    def model(self) -> Self:
        """Itself: a model and a sighting."""
        return self

    @property
    def targets(self) -> tuple[str, ...]:
        """What is observed."""
        return (self.group,)

    @property
    def conditions(self) -> tuple[str, ...]:
        """The arm's, then the number of the place."""
        return (*self.arm.conditions, PLACE)

    @property
    def placed(self) -> tuple[str, ...]:
        """The places, the target, and the offset."""
        return (self.group, "tool", *(parameter.group for parameter in self.offset))

    @property
    def units(self) -> Array:
        """Metres."""
        return np.ones(1)

    @property
    def positions(self) -> int:
        """None: nothing was seen in an instrument's frame."""
        return 0

    def within(self, data: Measurements) -> Self:
        """The same with the places of these rows."""
        there = np.unique(data.conditions[PLACE][data.seen.any(axis=1)])
        picked = [i for i, number in enumerate(self.numbers) if number in there]
        return replace(
            self, numbers=tuple(self.numbers[i] for i in picked), labels=tuple(self.labels[i] for i in picked)
        )

    def nominal(self, values: Array) -> Array:
        """The arm's, with every place at the origin."""
        return np.concatenate([values[: len(self.arm.names)], np.zeros(len(self.names) - len(self.arm.names))])

    def observe(self, inputs: Array, values: Array) -> tuple[Array, Array]:
        """Observations ``(n, 1, d)`` and their derivatives ``(n, 1, d, p)``."""
        size, index = len(self.arm.names), self._index(inputs[:, -1])
        points, jacobian = self.arm.observe(inputs[:, :-1], values[:size])
        observed, by_point, by_place = self.seen(points[:, 0], values[self.first :].reshape(-1, 3)[index])
        n, d = observed.shape
        observed = observed + values[size : self.first].sum()
        derivative = np.zeros((n, 1, d, len(self.names)), dtype=observed.dtype)
        derivative[:, 0, :, :size] = by_point @ jacobian[:, 0]
        derivative[..., size : self.first] = 1.0
        columns = self.first + 3 * index[:, None] + np.arange(3)
        derivative[np.arange(n)[:, None, None], 0, np.arange(d)[:, None], columns[:, None]] = by_place
        return observed[:, None], derivative

    def points(self, inputs: Array, values: Array) -> Array:
        """Observations ``(n, 1, d)``."""
        size, index = len(self.arm.names), self._index(inputs[:, -1])
        points = self.arm.points(inputs[:, :-1], values[:size])[:, 0]
        observed = self.seen(points, values[self.first :].reshape(-1, 3)[index])[0]
        return np.asarray(observed[:, None] + values[size : self.first].sum())

    def column_priority(self) -> tuple[int, ...]:
        """The places; then the arm's order, the longest link after the target if it is the scale; the base last."""
        parameters = self.arm.parameters
        base = indices_of_groups(parameters, ["base"])
        order = [i for i in self.arm.column_priority() if i not in base]
        if self.touched:
            after_tool = 1 + max(order.index(i) for i in indices_of_groups(parameters, ["tool"]))
            links = [i for i in order[:after_tool] if parameters[i].is_link and parameters[i].kind == "length"]
            longest = max(links, key=lambda i: abs(self.drawing[i]))
            order.insert(after_tool - 1, order.pop(order.index(longest)))
        return (*range(self.first, len(self.names)), *range(len(parameters), self.first), *order, *base)

    def rank_point(self, values: Array) -> Array:
        """The arm's at ``values``, or on the drawing with the places that ``structure_joints`` touches."""
        size = len(self.arm.names)
        if not self.touched:
            return np.concatenate([self.arm.rank_point(values[:size]), values[size:]])
        assert not self.offset
        arm = self.arm.rank_point(self.drawing)
        joints = self.arm.structure_joints(len(self.numbers), rng_for(0, "structure"))
        return np.concatenate([arm, self.through(self.arm.points(joints, arm)[:, 0], rng_for(1, "structure")).ravel()])

    def structure_joints(self, count: int, rng: np.random.Generator) -> Array:
        """The arm's, with each place in turn; where places are touched, poses near those that do."""
        turns = np.resize(np.array(self.numbers, dtype=np.float64), count)
        if not self.touched:
            return np.column_stack([self.arm.structure_joints(count, rng), turns])
        values, found = self.rank_point(self.nominal(self.drawing)), np.empty((0, 0))
        for _ in range(_ROUNDS):
            inputs = self._touching(np.column_stack([self.arm.structure_joints(count, rng), turns]), values)
            found = np.concatenate([found, inputs]) if found.size else inputs
            if len(found) >= count:
                return found[:count]
        raise LabError(f"the drawing's arm cannot reach every {self.group} again: check the robot's limits")

    def initial_guess(self, seen: Observations, values: Array) -> Array:
        """Each place by the arm as it is in ``values``."""
        number = seen.inputs[:, -1]
        points = self.arm.points(seen.inputs[:, :-1], values[: len(self.arm.names)])[:, 0]
        rows = np.isfinite(seen.points).all(axis=(1, 2))
        observed = seen.points[:, 0] - values[len(self.arm.names) : self.first].sum()
        chosen = [rows & (number == i) for i in self.numbers]
        return np.concatenate([values[: self.first], *(self.placed_by(points[i], observed[i]) for i in chosen)])

    def extra_residuals(self, values: Array) -> tuple[Array, Array]:
        """Nothing else is known."""
        return no_extra_residuals(self)

    def errors(self, data: Measurements, values: Array) -> Array:
        """Lengths ``(n, 1)`` of what is left, where places that ``values`` do not have are placed by these rows.

        NaN where such a place has too few rows to be judged by them.
        """
        there, rows = np.unique(data.conditions[PLACE][data.seen[:, 0]], return_counts=True)
        enough = there[rows >= JUDGED * self.least_rows].astype(np.int_).tolist()
        new = [number for number in enough if number not in self.numbers]
        wide = replace(self, numbers=(*self.numbers, *new), labels=(*self.labels, *map(str, new)))
        known = data.take(np.flatnonzero(np.isin(data.conditions[PLACE], wide.numbers)))
        if new:
            values = wide._with_places(known.take(np.flatnonzero(np.isin(known.conditions[PLACE], new))), values, new)
        errors = np.full((len(data), 1), np.nan)
        left = wide.points(known.inputs(self.conditions), values) - known.points
        errors[np.isin(data.conditions[PLACE], wide.numbers)] = np.linalg.norm(left, axis=2)
        return errors

    def _with_places(self, data: Measurements, values: Array, new: Sequence[int]) -> Array:
        """``values``, which end before the ``new`` places, with these as the rows of ``data`` say."""
        seen = Observations(data.inputs(self.conditions), data.points, np.ones(data.points.shape[:2]))
        alone = replace(self, numbers=tuple(new), labels=tuple(map(str, new)))
        start = alone.initial_guess(seen, np.concatenate([values[: self.first], np.zeros(3 * len(new))]))[self.first :]
        columns = range(len(values), len(values) + 3 * len(new))
        return fit(self, seen, columns, np.concatenate([values, start])).values

    def cv_groups(self, data: Measurements) -> NDArray[np.int_] | None:
        """Repeats of a configuration."""
        return None

    def _index(self, numbers: Array) -> NDArray[np.int_]:
        """Where the places of some rows stand among the parameters."""
        where = {number: i for i, number in enumerate(self.numbers)}
        seen, rows = np.unique(numbers.astype(np.int_), return_inverse=True)
        return np.array([where[number] for number in seen.tolist()], dtype=np.int_)[rows]

    def _touching(self, inputs: Array, values: Array) -> Array:
        """Those of the settings that Newton's steps of the joints bring to their places, ``(m, joints + c)``."""
        joints = inputs.shape[1] - len(self.conditions)
        for _ in range(_NEWTON_STEPS):
            left = self.points(inputs, values)[:, 0]
            slopes = np.empty((*left.shape, joints))
            for j in range(joints):
                moved = inputs.copy()
                moved[:, j] += _DIFFERENCE
                slopes[..., j] = (self.points(moved, values)[:, 0] - left) / _DIFFERENCE
            step = (np.linalg.pinv(slopes) @ left[..., None])[..., 0]
            inputs[:, :joints] -= np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)
        size = np.linalg.norm(self.points(inputs, values)[:, 0], axis=1)
        return np.asarray(inputs[size < TOUCHES])
