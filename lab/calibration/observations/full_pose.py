"""Full poses of a target: its position, and the orientation of a frame that is fixed to it.

Metres and radians are compared by one number, the ratio of their noises. It is given, or found from the
residuals as a ratio of two variance components (Foerstner 1979): a position's and a rotation's sum of squares,
each over its own share of the degrees of freedom. Of few poses that is rough: n poses leave each share about
3 n - 15 numbers, so that the ratio is known to one part in sqrt(3 n - 15).
"""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from lab.calibration.gauss_newton import Observations
from lab.calibration.identify import Identification, IdentifyOptions, identify
from lab.calibration.initial_guess import initial_guess
from lab.calibration.observations.protocol import no_extra_residuals
from lab.calibration.weights import Noise
from lab.core import se3
from lab.core.measurements import Measurements, seen_mask
from lab.core.se3 import Array
from lab.kinematics.model import Model
from lab.kinematics.parameter import Parameter, indices_of_groups, names_of, placed_parameters

ROTATION_PARAMETERS = placed_parameters("tool", "tool", ("rx", "ry", "rz"))
QUATERNION = ("qw", "qx", "qy", "qz")
START_RATIO = 1.0  # rad per m: 1 mrad beside 1 mm, until the residuals say better
ROUNDS = 4  # of the ratio's iteration
SETTLED = 0.01  # a change of the ratio that is none
EXACT = 1e-12  # residuals below this have no noise to be compared


@dataclass(frozen=True)
class Poses:
    """An arm of which positions and one orientation are seen.

    Observed are the positions of the arm's targets, then log(R_measured' R_predicted) (rad), measured as zero.
    The measured orientation is a condition of the pose: ``<target>_qw`` to ``_qz``.

    Attributes:
        arm: the arm, seen by points.
        oriented: the target whose orientation was measured.
        ratio: how large the noise of a rotation is (rad) where a position's is 1 m.
    """

    arm: Model
    oriented: str
    ratio: float = START_RATIO
    parameters: tuple[Parameter, ...] = field(init=False, repr=False)
    names: tuple[str, ...] = field(init=False)
    placed: tuple[str, ...] = ("base", "tool")

    def __post_init__(self) -> None:
        assert self.ratio > 0 and self.oriented in self.arm.targets
        parameters = (*self.arm.parameters, *ROTATION_PARAMETERS)
        object.__setattr__(self, "parameters", parameters)
        object.__setattr__(self, "names", names_of(parameters))

    @property
    def model(self) -> Self:
        """Itself: a model and a sighting."""
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
        """Rotations by the ratio."""
        return np.append(np.ones(self.positions), self.ratio)

    @property
    def positions(self) -> int:
        """All but the orientation."""
        return len(self.arm.targets)

    def within(self, data: Measurements) -> Self:
        """The same whatever was measured."""
        return self

    def nominal(self, values: Array) -> Array:
        """The arm's, and the measured frame along the last one."""
        return np.concatenate([values[: len(self.arm.names)], np.zeros(3)])

    def column_priority(self) -> tuple[int, ...]:
        """The arm's order; the tool's rotation after its places."""
        order = list(self.arm.column_priority())
        after = 1 + max(order.index(i) for i in indices_of_groups(self.arm.parameters, ["tool"]))
        return (*order[:after], *range(len(self.names) - 3, len(self.names)), *order[after:])

    def rank_point(self, values: Array) -> Array:
        """The arm's."""
        return np.concatenate([self.arm.rank_point(values[:-3]), values[-3:]])

    def structure_joints(self, count: int, rng: np.random.Generator) -> Array:
        """The arm's, with no rotation measured: any other would turn the same rows."""
        straight = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (count, 4))
        return np.concatenate([self.arm.structure_joints(count, rng), straight], axis=1)

    def points(self, inputs: Array, values: Array) -> Array:
        """Positions and rotations ``(n, k + 1, 3)``, m and rad."""
        return self.observe(inputs, values)[0]

    def observe(self, inputs: Array, values: Array) -> tuple[Array, Array]:
        """Positions and rotations ``(n, k + 1, 3)`` and their derivatives ``(n, k + 1, 3, p)``.

        A turn w of the predicted frame (in the tracker's) changes the residual v = log(R_measured' R) by
        J_l(v)^-1 R_measured' w.
        """
        arm_settings, measured = inputs[:, :-4], se3.rotation_from_quaternion(inputs[:, -4:])
        points, jacobian = self.arm.observe(arm_settings, values[:-3])
        flange, turns = flange_rotations(self.arm, arm_settings, values[:-3], jacobian)
        back = np.swapaxes(measured, 1, 2)
        rotation = se3.log(back @ flange @ se3.exp(values[-3:]))  # (n, 3)
        turns = np.concatenate([turns, flange @ se3.left_jacobian(values[-3:])], axis=2)  # (n, 3, p)
        rows = np.linalg.solve(se3.left_jacobian(rotation), back @ turns)
        wide = np.concatenate([jacobian, np.zeros((*jacobian.shape[:3], 3))], axis=3)
        return np.concatenate([points, rotation[:, None]], 1), np.concatenate([wide, rows[:, None]], 1)

    def initial_guess(self, seen: Observations, values: Array) -> Array:
        """Base and tool from the positions; the tool's rotation as the mean of R_flange' R_measured."""
        n = len(self.names) - 3
        positions = Observations(seen.inputs[:, :-4], seen.points[:, :-1], seen.whiten[:, : self.positions])
        arm = initial_guess(self.arm, positions, values[:n])
        rows = np.isfinite(seen.points[:, -1]).all(axis=1)
        _, jacobian = self.arm.observe(positions.inputs[rows], arm)
        flange, _ = flange_rotations(self.arm, positions.inputs[rows], arm, jacobian)
        measured = se3.rotation_from_quaternion(seen.inputs[rows, -4:])
        mean = se3.nearest_rotation((np.swapaxes(flange, 1, 2) @ measured).sum(axis=0))
        return np.concatenate([arm, se3.log(mean)])

    def extra_residuals(self, values: Array) -> tuple[Array, Array]:
        """Nothing else is known."""
        return no_extra_residuals(self)

    def errors(self, data: Measurements, values: Array) -> Array:
        """Lengths of position errors ``(n, k)``: rotations are fitted, and not judged."""
        arm = self.arm.points(data.inputs(self.arm.conditions), values[:-3])
        return np.asarray(np.linalg.norm(arm - data.points[:, : self.positions], axis=2))

    def cv_groups(self, data: Measurements) -> None:
        """Repeats of a configuration."""


def flange_rotations(arm: Model, inputs: Array, values: Array, jacobian: Array) -> tuple[Array, Array]:
    """The last frame's rotations ``(n, 3, 3)`` and what turns them, ``(n, 3, p)``, in the tracker's frame.

    A target's place in the last frame enters as p = o + R t: its derivatives are the frame's axes r, and where
    t is moved by one axis's unit, every other derivative changes by dr. A turn w makes dr = w x r, so
    w = (1/2) sum r x dr over the three axes.

    Args:
        jacobian: ``(n, k, 3, p)`` of the arm at ``values``.
    """
    tool = list(indices_of_groups(arm.parameters, ["tool"]))[:3]
    stretched = jacobian[:, 0][..., tool]
    size = np.sqrt((stretched**2).sum(axis=1, keepdims=True))  # 1, but in a frame that grows
    rotation = stretched / size
    turns = np.zeros((len(inputs), 3, len(values)), dtype=jacobian.dtype)
    for axis, column in enumerate(tool):
        moved = values.copy()
        moved[column] += 1.0
        change = arm.observe(inputs, moved)[1][:, 0] - jacobian[:, 0]
        turns += 0.5 * se3.skew(rotation[..., axis]) @ (change / size[:, :, axis, None])
    return rotation, turns


def balanced(observation: Poses, data: Measurements, nominal: Array, request: IdentifyOptions | None = None) -> Poses:
    """The same with the ratio of the noises that the residuals show (the module's text).

    Args:
        data: sighted, as ``identify`` takes it.
    """
    for _ in range(ROUNDS):
        sums = np.array(_variances(observation, identify(observation, data, nominal, Noise(), request), data))
        if not np.isfinite(sums).all() or (np.sqrt(sums) < EXACT).any():
            return observation
        change = float(np.sqrt(sums[1] / sums[0]))
        observation = replace(observation, ratio=observation.ratio * change)
        if abs(change - 1) < SETTLED:
            break
    return observation


def _variances(observation: Poses, found: Identification, data: Measurements) -> tuple[float, float]:
    """Variances of positions and of rotations in m^2: sums of squares over their shares of the freedom."""
    _, jacobian = observation.observe(data.inputs(observation.conditions), found.values)
    rows = jacobian[..., list(found.fit.free)] / observation.units[:, None, None]
    used = ((rows @ found.fit.unit_covariance()) * rows).sum(axis=-1)  # (n, k, 3) leverages
    seen = seen_mask(data.points)
    result = []
    for part in (slice(None, observation.positions), slice(observation.positions, None)):
        squares = (found.residuals[:, part] / observation.units[part, None])[seen[:, part]] ** 2
        dof = float((1 - used[:, part][seen[:, part]]).sum())
        result.append(float(squares.sum()) / dof if dof > 0.5 else float("nan"))
    return result[0], result[1]
