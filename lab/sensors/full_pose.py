"""Measure full poses of a target: its position, and the orientation of a frame that is fixed to it.

Metres and radians are compared by one number, the ratio of their noises. It is given, or estimated from the
residuals as a ratio of two variance components (Foerstner 1979): the sums of squares of the positions' and of the
rotations' residuals, each over its own share of the degrees of freedom. Few poses give a rough ratio: n poses leave
each share about 3 n - 15 numbers, so that the ratio is known to one part in sqrt(3 n - 15).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np

from lab.calibration.fit_options import PLAIN, FitOptions, Solve
from lab.calibration.gauss_newton import Observations
from lab.calibration.guess import initial_guess
from lab.calibration.identification import Identification, component_variances, identify
from lab.calibration.observation import ROTATION_PARAMETERS, no_extra_residuals, placed_in_instrument_frame
from lab.calibration.sensor import SensorTerms
from lab.calibration.weights import Noise
from lab.core import se3
from lab.core.errors import LabError, option_name
from lab.core.limits import positive
from lab.core.measurements import Measurements
from lab.core.orientation import AngleConvention
from lab.core.se3 import Array
from lab.diagnosis.hypothesis import Hypothesis
from lab.formats.measurement_csv import ObservedColumns
from lab.formats.orientations import orientation_texts, oriented_target, read_orientations
from lab.kinematics.compiled.kernels import real, with_fallback
from lab.kinematics.model import Model, RigidArm
from lab.kinematics.parameter import Parameter, indices_of_groups, names_of
from lab.kinematics.serial.axes_to_dh import Truth
from lab.kinematics.serial.serial_arm import SerialArm
from lab.kinematics.tree import TreeArm
from lab.noise.instruments import Instrument, PoseInstrument
from lab.sensors.orientation_mistakes import orientation_mistakes, turned_misses
from lab.sensors.sensor_options import FitInputs, PoseOptions, VirtualSetup
from lab.sensors.sequential_fit import fit_sequentially
from lab.sensors.tip import tip_rates, tip_rotations
from lab.sensors.virtual_sensor import SimulatedReadings, VirtualSensor
from lab.simulation.effects import TrueEffects
from lab.simulation.tracking import VirtualMeasurement, target_rotations, track_with_errors, visible_targets
from lab.simulation.true_robot import TrueRobot

__all__ = ["QUATERNION", "PoseSensor", "Poses", "balanced"]

QUATERNION = ("qw", "qx", "qy", "qz")
_START_RATIO = 1.0  # rad per m: 1 mrad beside 1 mm, until it is estimated from residuals
_ROUNDS = 4  # of the ratio's iteration
_SETTLED = 0.01  # relative change of the ratio that ends its iteration
_EXACT = 1e-12  # residuals below this have no noise to be compared


@dataclass(frozen=True)
class Poses:
    """An arm of which positions and one orientation are measured, in the instrument's frame.

    Observed are the positions of the arm's targets (m), then log(R_measured' R_predicted) (rad), measured as zero.
    The measured orientation is a condition of the row: the quaternion ``<target>_qw`` to ``_qz``.

    Attributes:
        arm: the arm, measured by points.
        oriented: the target whose orientation was measured.
        ratio: the noise of a rotation (rad) where that of a position is 1 m.
        parameters: the arm's, then the rotation vector of the measured frame in the last one.
        names: of the parameters.
    """

    arm: Model
    oriented: str
    ratio: float = _START_RATIO
    parameters: tuple[Parameter, ...] = field(init=False, repr=False)
    names: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        assert self.ratio > 0 and self.oriented in self.arm.targets
        parameters = (*self.arm.parameters, *ROTATION_PARAMETERS)
        object.__setattr__(self, "parameters", parameters)
        object.__setattr__(self, "names", names_of(parameters))

    @property
    def placed(self) -> tuple[str, ...]:
        """Groups of parameters without a nominal value."""
        return placed_in_instrument_frame(self.arm)

    @property
    def model(self) -> Self:
        """This model, which defines its own observation."""
        return self

    @property
    def targets(self) -> tuple[str, ...]:
        """The arm's, then the orientation."""
        return (*self.arm.targets, f"{self.oriented} orientation")

    @property
    def conditions(self) -> tuple[str, ...]:
        """The arm's, then the measured quaternion."""
        return (*self.arm.conditions, *(f"{self.oriented}_{part}" for part in QUATERNION))

    @property
    def units(self) -> Array:
        """``(k + 1,)``: one for a position, the ratio for the rotation."""
        return np.append(np.ones(self.positions), self.ratio)

    @property
    def positions(self) -> int:
        """Number of observed quantities that are positions: all but the orientation."""
        return len(self.arm.targets)

    @property
    def _which(self) -> int:
        """Number of the oriented target."""
        return self.arm.targets.index(self.oriented)

    def within(self, data: Measurements) -> Self:
        """Return the model: no parameter is of some rows alone."""
        return self

    def nominal(self, values: Array) -> Array:
        """Return the arm's parameters, with the measured frame along the last one."""
        return np.concatenate([values[: len(self.arm.names)], np.zeros(3)])

    @property
    def in_world(self) -> tuple[int, ...]:
        """Indices of parameters that no tip carries: none beside the arm's."""
        return ()

    @property
    def carried(self) -> tuple[int, ...]:
        """Indices of the rotation vector that the tip carries."""
        return tuple(range(len(self.names) - 3, len(self.names)))

    def column_priority(self) -> tuple[int, ...]:
        """Return the arm's order; the tool's rotation after its positions."""
        order = list(self.arm.column_priority())
        after = 1 + max(order.index(i) for i in indices_of_groups(self.arm.parameters, ["tool"]))
        return (*order[:after], *range(len(self.names) - 3, len(self.names)), *order[after:])

    def rank_point(self, values: Array) -> Array:
        """Return the arm's ``(p,)``; the tool's rotation as it is in ``values``."""
        return np.concatenate([self.arm.rank_point(values[:-3]), values[-3:]])

    def structure_joints(self, count: int, rng: np.random.Generator) -> Array:
        """Return the arm's ``(count, joints + conditions)`` with no rotation measured: another turns the same rows."""
        identity = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (count, 4))
        return np.concatenate([self.arm.structure_joints(count, rng), identity], axis=1)

    def _compilable(self, inputs: Array, values: Array) -> bool:
        return isinstance(self.arm, SerialArm) and real(inputs, values)

    def _points(self, inputs: Array, values: Array) -> Array:
        arm_inputs, measured = inputs[:, :-4], se3.rotation_from_quaternion(inputs[:, -4:])
        points = self.arm.points(arm_inputs, values[:-3])
        flange = tip_rotations(self.arm, arm_inputs, values[:-3], points, self._which)
        rotation = se3.log(np.swapaxes(measured, 1, 2) @ flange @ se3.exp(values[-3:]))
        return np.concatenate([points, rotation[:, None]], 1)

    @with_fallback(_points, when=_compilable)
    def points(self, inputs: Array, values: Array) -> Array:
        """Return positions and rotations ``(n, k + 1, 3)``, m and rad."""
        return self._oriented(inputs, values, rates=False)[0]

    def _observe(self, inputs: Array, values: Array) -> tuple[Array, Array]:
        """Compute ``observe`` by numpy.

        A rotation w of the predicted frame (in the instrument's) changes the residual v = log(R_measured' R) by
        J_l(v)^-1 R_measured' w.
        """
        arm_inputs, measured = inputs[:, :-4], se3.rotation_from_quaternion(inputs[:, -4:])
        points, jacobian = self.arm.observe(arm_inputs, values[:-3])
        flange, rates = tip_rates(self.arm, arm_inputs, values[:-3], jacobian, self._which)
        inverse = np.swapaxes(measured, 1, 2)
        rotation = se3.log(inverse @ flange @ se3.exp(values[-3:]))  # (n, 3)
        rates = np.concatenate([rates, flange @ se3.left_jacobian(values[-3:])], axis=2)  # (n, 3, p)
        rows = np.linalg.solve(se3.left_jacobian(rotation), inverse) @ rates
        wide = np.concatenate([jacobian, np.zeros((*jacobian.shape[:3], 3))], axis=3)
        return np.concatenate([points, rotation[:, None]], 1), np.concatenate([wide, rows[:, None]], 1)

    @with_fallback(_observe, when=_compilable)
    def observe(self, inputs: Array, values: Array) -> tuple[Array, Array]:
        """Return positions and rotations ``(n, k + 1, 3)`` and their derivatives ``(n, k + 1, 3, p)``."""
        return self._oriented(inputs, values, rates=True)

    def _oriented(self, inputs: Array, values: Array, *, rates: bool) -> tuple[Array, Array]:
        assert isinstance(self.arm, SerialArm)
        code = self.arm.compiled
        return code.oriented(inputs[:, :-4], values[:-3], values[-3:], inputs[:, -4:], rates=rates)

    def initial_guess(self, observed: Observations, values: Array) -> Array:
        """Estimate base and tool from the positions; the tool's rotation as the mean of R_flange' R_measured."""
        n = len(self.names) - 3
        whiten = observed.whiten[:, : self.positions]
        positions = Observations(observed.inputs[:, :-4], observed.points[:, :-1], whiten)
        arm = initial_guess(self.arm, positions, values[:n])
        rows = np.isfinite(observed.points[:, -1]).all(axis=1)
        inputs = positions.inputs[rows]
        flange = tip_rotations(self.arm, inputs, arm, self.arm.points(inputs, arm), self._which)
        measured = se3.rotation_from_quaternion(observed.inputs[rows, -4:])
        mean = se3.nearest_rotation((np.swapaxes(flange, 1, 2) @ measured).sum(axis=0))
        return np.concatenate([arm, se3.log(mean)])

    def extra_residuals(self, values: Array) -> tuple[Array, Array]:
        """Return no further residuals."""
        return no_extra_residuals(self)

    def errors(self, data: Measurements, values: Array) -> Array:
        """Return lengths ``(n, k)`` of position errors in m: rotations are fitted, but not validated."""
        arm = self.arm.points(data.inputs(self.arm.conditions), values[:-3])
        return np.asarray(np.linalg.norm(arm - data.points[:, : self.positions], axis=2))

    def cv_groups(self, data: Measurements) -> None:
        """Return None: repeats of a configuration are held out together."""


def balanced(observation: Poses, data: Measurements, nominal: Array, options: FitOptions = PLAIN) -> Poses:
    """Return the observation with the ratio of the two noises estimated from its residuals (Foerstner 1979).

    The residuals are those of least squares, whichever method then fits the parameters.

    Args:
        observation: with any ratio to start from.
        data: the observed poses, as ``identify`` takes them.
        nominal: ``(p,)`` nominal parameters.
        options: the options of the identification.

    Returns:
        The observation as it is where residuals or a noise are zero.
    """
    options = replace(options, solve=None)
    groups = [0] * observation.positions + [1]
    for _ in range(_ROUNDS):
        sums = component_variances(observation, identify(observation, data, nominal, Noise(), options), data, groups)
        if not np.isfinite(sums).all() or (np.sqrt(sums) < _EXACT).any():
            return observation
        change = float(np.sqrt(sums[1] / sums[0]))
        observation = replace(observation, ratio=observation.ratio * change)
        if abs(change - 1) < _SETTLED:
            break
    return observation


@dataclass(frozen=True)
class PoseSensor(VirtualSensor):
    """Positions of targets and the orientation of one.

    Attributes:
        orientation: convention of the three angles; None where the file has quaternions.
        ratio: noise of a rotation over that of a position, rad per m; None to estimate it from the residuals.
        sequential: fit the angles from the orientations first, then the lengths from the positions.
    """

    name: ClassVar[str] = "pose"
    terms: ClassVar[SensorTerms] = SensorTerms(
        measured="positions and orientations",
        reading="measured pose",
        error="position error",
        placed="base and tool",
        names_targets=True,
    )
    columns: ClassVar[ObservedColumns] = ObservedColumns(orientations=True)
    flags: ClassVar[type[Any] | None] = PoseOptions
    in_instrument_frame: ClassVar[bool] = True
    setup: ClassVar[tuple[str, ...]] = ("occlusion", "orientation_share")

    orientation: AngleConvention | None = None
    ratio: float | None = None
    sequential: bool = False

    @classmethod
    def configured(cls, options: PoseOptions, fit: FitInputs) -> Self:
        """Return the sensor with these options.

        Raises:
            LabError: a validation file is given, ``--noise-mrad`` without ``--noise-mm``, or a prior
                for the sequential method.
        """
        fit.refuse_validation_file(cls.name)
        if options.noise_mrad is not None and fit.noise_mm is None:
            raise LabError(
                f"{option_name('noise_mrad')} sets the weight of orientations; give {option_name('noise_mm')} too"
            )
        if options.method == "sequential" and fit.prior:
            raise LabError(
                f"{option_name('prior')} is of {option_name('method')} global: the sequential method takes "
                f"none; leave one out"
            )
        if options.noise_mrad is None or fit.noise_mm is None:
            return cls(options.orientation, None, options.method == "sequential")
        positive(option_name("noise_mrad"), options.noise_mrad)
        return cls(options.orientation, options.noise_mrad / fit.noise_mm, options.method == "sequential")

    @property
    def solve(self) -> Solve | None:
        """The sequential method, if it is requested."""
        return fit_sequentially if self.sequential else None

    def observation(self, arm: Model, data: Measurements, nominal: Array) -> tuple[Model, Measurements]:
        """Return positions of all targets and the orientation of the one that has some.

        Raises:
            LabError: no target has an orientation or several have, or a column or cell of it cannot be read.
        """
        target = oriented_target(data)
        quaternions = read_orientations(data, target, self.orientation)
        blank = np.isnan(quaternions[:, 0])
        rotation = np.where(blank[:, None, None], np.nan, np.zeros((len(data), 1, 3)))  # measured as zero
        stated = np.where(blank[:, None], [1.0, 0.0, 0.0, 0.0], quaternions)
        model = Poses(arm, target, _START_RATIO if self.ratio is None else self.ratio)
        conditions = {f"{target}_{part}": stated[:, i] for i, part in enumerate(QUATERNION)}
        points = np.concatenate([data.points, rotation], axis=1)
        observed = replace(data, targets=model.targets, points=points, conditions={**data.conditions, **conditions})
        return model, observed

    def turned_misses(self, arm: Model, data: Measurements, values: Array) -> Array:
        """Return how far ``(n,)`` orientations are off (m, at a lever), beside an arm that positions place."""
        return turned_misses(self, arm, data, values)

    def mistakes(self, arm: RigidArm, data: Measurements) -> tuple[Hypothesis, ...]:
        """Return other conventions of the orientations."""
        return tuple(orientation_mistakes(self, arm, data))

    def balanced(self, model: Model, data: Measurements, nominal: Array, options: FitOptions) -> Model:
        """Return the model with the ratio of the two noises estimated from its residuals, where none was given."""
        assert isinstance(model, Poses)
        return balanced(model, data, nominal, options) if self.ratio is None else model

    def weighted_by(self, instrument: Instrument, data: Measurements) -> Self:
        """Return the sensor with the instrument's ratio, the noise of a rotation over the mean of a position's."""
        points = data.points[data.seen]
        usable = isinstance(instrument, PoseInstrument) and instrument.kind != "exact"
        if self.ratio is not None or not usable or not len(points):
            return self
        assert isinstance(instrument, PoseInstrument)
        mean = float(np.trace(instrument.covariance(points), axis1=-2, axis2=-1).mean()) / 3
        return replace(self, ratio=instrument.rotation_rad / float(np.sqrt(mean)))

    def weighted_as(self, model: Model) -> Self:
        """Return the sensor with the ratio of this model."""
        assert isinstance(model, Poses)
        return replace(self, ratio=model.ratio)

    def simulate(self, poses: VirtualMeasurement, setup: VirtualSetup) -> SimulatedReadings:
        """Measure points as ``PointSensor`` does, and orientations of the first target, some of which may be missing.

        The points are those of ``--observe points`` with the same numbers drawn; orientations draw from a child.
        """
        assert isinstance(poses.instrument, PoseInstrument)  # else it does not observe poses
        joints, target = poses.joints, poses.targets[0]
        data, bad, scatter = track_with_errors(poses)
        turning = poses.rng.spawn(1)[0]
        exact = target_rotations(poses.robot, joints, target, poses.conditions, scatter)
        rotations = poses.instrument.sample_rotations(exact, turning, poses.readings)
        visible = visible_targets(poses) if setup.occlusion else np.ones((len(joints), len(poses.targets)), np.bool_)
        share = max(1, round(setup.orientation_share * len(joints)))
        oriented = np.zeros(len(joints), dtype=np.bool_)
        oriented[turning.permutation(len(joints))[:share]] = True
        oriented &= visible[:, 0]
        points = np.where(visible[..., None], data.points, np.nan)
        columns = orientation_texts(target, rotations, oriented, self.orientation)
        return SimulatedReadings(replace(data, points=points, other={**data.other, **columns}), bad)

    def observed_truth(
        self, truth: Truth, found: Identification, real: TrueRobot, placed: Mapping[str, Array]
    ) -> Truth | None:
        """Return the truth with the rotation of the measured frame in the arm's last one; None for a mechanism."""
        if not isinstance(truth.arm, SerialArm | TreeArm):
            return None
        rotation = self.placed_truth(found.model, truth, real, placed, np.eye(4))
        return replace(truth, effects={**truth.effects, **rotation})

    def placed_truth(
        self, model: Model, truth: Truth, real: TrueRobot, placed: Mapping[str, Array], T_frame_instrument: Array
    ) -> dict[str, float]:
        """Return the rotation of the measured frame in the arm's last one."""
        assert isinstance(model, Poses) and isinstance(truth.arm, SerialArm | TreeArm)
        rest = np.zeros((1, real.robot.chain.size))
        measured = target_rotations(real.with_effects(TrueEffects.none(real.robot.chain.size)), rest, model.oriented)[0]
        last = truth.arm.tool(rest, truth.values, model._which)[0][0, :3, :3]
        return dict(zip(("tool.rx", "tool.ry", "tool.rz"), se3.log(last.T @ measured).tolist(), strict=True))
