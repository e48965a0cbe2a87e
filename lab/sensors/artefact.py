"""Measure on artefacts of known dimensions: an artefact is placed near the arm, and its features are touched.

A cube has faces, a plate has spheres, a bar has one end in a socket. What is known of a feature in the artefact's own
frame is a row of numbers; the pose of the artefact is fitted. As its dimensions are known, contacts determine the size
of the arm too, where the touched features are a known distance apart.

All dimensions of an artefact are larger than stated by one factor, whose uncertainty ``lab/sensors/size.py`` gives.
No contact tells that factor from the size of the arm, so the uncertainty goes into the arm's lengths as it is.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError, option_name
from lab.core.limits import positive
from lab.core.measurements import FIXTURE, Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array, exp, left_jacobian, log, skew, transform
from lab.core.units import MM
from lab.kinematics.model import Model
from lab.kinematics.parameter import Parameter
from lab.sensors.contact import FixtureSimulation
from lab.sensors.fixtures import NONE, FixtureRows, Fixtures, FixtureSensor, PredictedReadings, labels_by_location
from lab.sensors.sensor_options import FitInputs, ProbeOptions, SizeOptions, VirtualSetup
from lab.sensors.size import MACHINED, size_parameters, stated_size_u

__all__ = ["FEATURE", "Artefact", "ArtefactSensor"]

FEATURE = f"{FIXTURE}'s feature"  # condition: number of the touched feature, in ``Artefact.features``
_STARTS = np.array([exp(np.array(v)) for v in ((0, 0, 0), (np.pi, 0, 0), (0, np.pi, 0), (0, 0, np.pi))])
_THIRDS = np.array([exp(k * 2 * np.pi / 3 / np.sqrt(3) * np.ones(3)) for k in range(3)])
_QUARTERS = np.array([np.eye(3), exp(np.array([0.0, 0.0, np.pi / 2]))])
_ROTATIONS = np.einsum("aij,bjk,ckl->abcil", _STARTS, _THIRDS, _QUARTERS).reshape(-1, 3, 3)  # the 24 of a cube
_PLACING_STEPS = 15
_DAMPING = 1e-4  # of the mean square slope
_LONGEST_TURN = 0.7  # rad
_NEAR_M = 0.05  # spread of random artefacts about points of the arm
_PLACINGS, _TRIES = 50, 6  # of a random artefact, and of each of its features there


@dataclass(frozen=True)
class Artefact(Fixtures):
    """An arm at artefacts of known dimensions: the gap between the target and the touched feature is zero.

    Attributes:
        features: what is known of each feature in the artefact's frame, by its number: m, and components of normals.
        touched: pairs of an artefact's number and a feature's, as touched.
        size_u: standard uncertainty of the factor of all dimensions; 0 where they are exact.
    """

    features: tuple[tuple[float, ...], ...] = ()
    touched: tuple[tuple[int, int], ...] = ()
    size_u: float = 0.0
    axes: ClassVar[tuple[str, ...]] = ("x", "y", "z", "rx", "ry", "rz")
    row_conditions: ClassVar[tuple[str, ...]] = (FEATURE, FIXTURE)
    contact: ClassVar[bool] = True
    starts: ClassVar[int] = 3
    draws: ClassVar[int] = 3  # each a search among 24 rotations

    @property
    def shared(self) -> tuple[Parameter, ...]:
        """The factor of all dimensions less one, where it is uncertain."""
        return size_parameters(self.group, self.size_u)

    @abstractmethod
    def gap(self, near: Array, known: Array, scale: float) -> tuple[Array, Array, Array]:
        """Return the gap between points and features in the artefact's frame.

        Args:
            near: ``(n, 3)`` m, points in the artefact's frame.
            known: ``(n, k)`` of the feature of each.
            scale: factor of all dimensions.

        Returns:
            Gaps ``(n, d)`` m, and their derivatives ``(n, d, 3)`` by the point and ``(n, d)`` by the factor.
        """

    def predict(self, points: Array, fixtures: Array, rows: Array = NONE, shared: Array = NONE) -> PredictedReadings:
        """Return gaps ``(n, d)``: a rotation w of the artefact moves a point in its frame by R'(p - t) x w."""
        turns = fixtures.shape[1] > 3
        rotation = fixtures[:, 3:] if turns else np.zeros_like(fixtures)
        R, away = exp(rotation), points - fixtures[:, :3]
        inverse = np.swapaxes(R, -1, -2)
        known = np.array(self.features)[rows[:, 0].astype(np.int_)]
        observed, by_near, by_scale = self.gap((inverse @ away[..., None])[..., 0], known, 1.0 + shared.sum())
        by_point = by_near @ inverse
        by_fixture = -by_point
        if turns:
            by_fixture = np.concatenate([by_fixture, by_point @ skew(away) @ left_jacobian(rotation)], axis=2)
        return PredictedReadings(observed, by_point, by_fixture, by_scale[..., None][..., : len(shared)])

    def located(self, points: Array, observed: Array, rows: Array = NONE) -> Array:
        """Return the pose ``(6,)`` of least squares, by damped Gauss-Newton steps from the 24 rotations of a cube."""
        count, n = len(_ROTATIONS), len(points)
        centre = self.centres(np.array(self.features)[rows[:, 0].astype(np.int_)]).mean(axis=0)
        poses = np.concatenate([points.mean(axis=0) - _ROTATIONS @ centre, log(_ROTATIONS)], axis=1)
        many, these = np.tile(points, (count, 1)), np.tile(rows, (count, 1))
        for _ in range(_PLACING_STEPS):
            found = self.predict(many, np.repeat(poses, n, axis=0), these)
            slopes = found.by_fixture.reshape(count, -1, poses.shape[1])
            normal = np.swapaxes(slopes, 1, 2) @ slopes
            damping = _DAMPING * np.trace(normal, axis1=1, axis2=2)[:, None, None] / poses.shape[1]
            pull = np.swapaxes(slopes, 1, 2) @ found.observed.reshape(count, -1, 1)
            step = -np.linalg.solve(normal + damping * np.eye(poses.shape[1]), pull)[..., 0]
            step[:, 3:] = np.clip(step[:, 3:], -_LONGEST_TURN, _LONGEST_TURN)
            poses = poses + step
        gaps = self.predict(many, np.repeat(poses, n, axis=0), these).observed.reshape(count, -1)
        best = poses[int(np.argmin((gaps**2).sum(axis=1)))]
        return np.concatenate([best[:3], log(exp(best[3:]))])

    @abstractmethod
    def centres(self, known: Array) -> Array:
        """Return where features are in the artefact's frame, ``(n, 3)`` m, from what is known of them ``(n, k)``."""

    def random_fixtures(self, points: Array, rng: np.random.Generator) -> Array:
        """Draw poses ``(k, 6)`` of artefacts near the points ``(k, 3)``."""
        near = points + rng.normal(0, _NEAR_M, points.shape)
        return np.concatenate([near, rng.uniform(-1.5, 1.5, points.shape)], axis=1)

    def at_base(self, placed: Array, T_base_instrument: Array, scale: float) -> Array:
        """Return poses ``(k, 6)`` in the base's frame from those in the instrument's."""
        rotations = T_base_instrument[:3, :3] @ exp(placed[:, 3:])
        return np.concatenate([transform(T_base_instrument, scale * placed[:, :3]), log(rotations)], axis=1)

    def within(self, data: Measurements) -> Self:
        """Return the model with the artefacts and features of these rows."""
        seen = data.with_points()
        return replace(super().within(data), touched=_pairs(seen))

    def rank_point(self, values: Array) -> Array:
        """Return the nominal arm's, with artefacts of which it reaches every touched feature.

        Raises:
            LabError: no such place was found.
        """
        return np.concatenate([self.arm.rank_point(self.nominal_arm), np.zeros(len(self.shared)), self._reached])

    @cached_property
    def _reached(self) -> Array:
        """Parameters ``(k m,)`` of artefacts that are drawn until the nominal arm reaches all of each."""
        arm, rng = self.arm.rank_point(self.nominal_arm), rng_for(1, "structure")
        placed, missing = np.zeros((len(self.numbers), len(self.axes))), list(range(len(self.numbers)))
        for _ in range(_PLACINGS):
            points = self.arm.points(self.arm.structure_joints(len(missing), rng), arm)[:, 0]
            placed[missing] = self.random_fixtures(points, rng)
            wanted = {pair for pair in self.touched if self.numbers.index(pair[0]) in missing}
            rows = np.tile([(feature, number) for number, feature in sorted(wanted)], (_TRIES, 1)).astype(float)
            inputs = np.column_stack([self.arm.structure_joints(len(rows), rng), rows])
            found = self.inputs_in_contact(inputs, np.concatenate([arm, np.zeros(len(self.shared)), placed.ravel()]))
            never = wanted - {(int(number), int(feature)) for feature, number in found[:, -2:]}
            if not (missing := sorted({self.numbers.index(number) for number, _ in never})):
                return placed.ravel()
        raise LabError(
            f"the nominal arm reaches no place where it can touch all of {self.group} {self.labels[missing[0]]}"
        )

    def structure_rows(self, count: int) -> Array:
        """Return row conditions ``(count, 2)`` for decisions on rank: each touched feature in turn."""
        return np.resize(np.array([(feature, number) for number, feature in self.touched], float), (count, 2))


def _pairs(data: Measurements) -> tuple[tuple[int, int], ...]:
    columns = [data.conditions[name].astype(np.int_).tolist() for name in (FIXTURE, FEATURE)]
    return tuple(sorted(set(zip(*columns, strict=True))))


@dataclass(frozen=True)
class ArtefactSensor(FixtureSensor):
    """Contacts with the features of an artefact.

    Attributes:
        size_u: standard uncertainty of the factor of all dimensions; 0 where they are exact.
        tip_m: known radius (m) of the ball that touches; 0 for a point.
    """

    flags: ClassVar[type[SizeOptions]] = SizeOptions
    setup: ClassVar[tuple[str, ...]] = ("fixtures", "artefact_mm")

    size_u: float = MACHINED
    tip_m: float = 0.0

    @classmethod
    def configured(cls, options: SizeOptions, fit: FitInputs) -> Self:
        """Return the sensor with the uncertainty of its artefact, and the radius of the ball that touches.

        Raises:
            LabError: an instrument or a validation file is given, a radius is not above zero, or an uncertainty is
                below.
        """
        fit.refuse_those_of_points(cls.name)
        size_u = stated_size_u(options.size_u_percent, MACHINED)
        radius_mm = options.tip_radius_mm if isinstance(options, ProbeOptions) else None
        if radius_mm is None or not issubclass(cls.flags, ProbeOptions):
            return cls(size_u)
        positive(option_name("tip_radius_mm"), radius_mm)
        return cls(size_u, MM.to_si(radius_mm))

    @abstractmethod
    def known(self, data: Measurements) -> tuple[Sequence[str], Array]:
        """Read what each row touched.

        Returns:
            Name ``(n,)`` of the feature, "" where the row has none; and what is known of it ``(n, k)``, in SI units.

        Raises:
            LabError: a column is missing, or a cell has an impossible value.
        """

    @abstractmethod
    def undetermined(self, known: Array) -> str:
        """Return what the pose of an artefact lacks that was touched on these features ``(f, k)``; "" if nothing."""

    def rows(self, data: Measurements) -> NDArray[np.bool_]:
        """Return the rows ``(n,)`` that name a feature."""
        return np.array([bool(name) for name in self.known(data)[0]], dtype=np.bool_)

    def fixture_rows(self, data: Measurements) -> FixtureRows:
        """Return the artefacts by location or session, and gaps of zero where a row names a feature.

        Raises:
            LabError: a column is missing, a row does not name its artefact, or a dimension contradicts another one.
        """
        there = self.rows(data)
        labels = labels_by_location(data, self.model.group, there)
        return labels, np.where(there[:, None], np.zeros((len(data), self.numbers_a_row(data))), np.nan)

    def numbers_a_row(self, data: Measurements) -> int:
        """Return how many numbers a contact is: here one, a distance."""
        return 1

    def observation(self, arm: Model, data: Measurements, nominal: Array) -> tuple[Model, Measurements]:
        """Return the artefacts that have enough rows, and these rows; a warning for each of the others.

        Raises:
            LabError: as for every fixture; a feature has two dimensions; or the touched features do not place one.
        """
        names, known = self.known(data)
        labels = labels_by_location(data, self.model.group, self.rows(data))
        rows = [tuple(row) for row in known.tolist()]
        stated: dict[tuple[str, str], tuple[float, ...]] = {}
        for row, feature in enumerate(zip(labels, names, strict=True)):
            if not feature[1] or data.use[row] == "skip":
                continue
            if stated.setdefault(feature, rows[row]) != rows[row]:
                raise LabError(
                    f"{data.where(row)}: {self.model.group} {feature[0]} has other dimensions at {feature[1]} than in "
                    "a row before; mend it, or name another location"
                )
        features = tuple(dict.fromkeys(stated.values()))
        index = {feature: float(i) for i, feature in enumerate(features)}
        number = np.array([index.get(row, 0.0) for row in rows])
        data = replace(data, conditions={**data.conditions, FEATURE: number})
        model, seen = super().observation(arm, data, nominal)
        assert isinstance(model, Artefact)
        model = replace(model, features=features, touched=_pairs(seen), size_u=self.size_u)
        self._refuse_undetermined(model)
        return model, seen

    def _refuse_undetermined(self, model: Artefact) -> None:
        """Refuse an artefact whose pose the touched features do not determine."""
        for fixture, label in zip(model.numbers, model.labels, strict=True):
            used = np.array([model.features[feature] for at, feature in model.touched if at == fixture])
            if lacks := self.undetermined(used):
                raise LabError(f"{self.model.group} {label or 'of the file'}: {lacks}")

    def on_a_table(
        self, arm: FixtureSimulation, setup: VirtualSetup, corners: Array, features: int
    ) -> tuple[Array, Array, NDArray[np.int_], NDArray[np.int_]]:
        """Place artefacts on a table where the arm reaches all corners ``(c, 3)``, to touch each feature in turn.

        Returns:
            Poses ``(k, 4, 4)`` m in the instrument's frame, joint positions ``(k, joints)`` near them, and the
            artefact and the feature ``(n,)`` of each row.
        """
        frames, near = arm.frames_within_reach(setup.fixtures, corners, upright=True)
        row = np.arange(len(arm.bad))
        return frames, near, row % setup.fixtures, row // setup.fixtures % features

    def placed_artefacts(self, frames: Array, scale: float) -> Mapping[str, Array]:
        """Return the true poses of simulated artefacts and the factor of their dimensions, by owner."""
        vectors, group = np.concatenate([frames[:, :3, 3], log(frames[:, :3, :3])], axis=1), self.model.group
        return {f"{group}.{1 + i}": vector for i, vector in enumerate(vectors)} | {group: np.array([scale])}
